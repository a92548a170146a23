//! The epochs of one antenna as they stand in a log.

use std::collections::BTreeMap;

use kurs::ephemeris::NavigationData;
use kurs::frames::{Ecef, Vector};
use kurs::observation::AntennaEpoch;
use kurs::time::GpsTime;

use super::choice::Choice;
use super::dating::Begin;
use super::frames::{Frame, FrameScanner, Protocol};
use super::interference::Statements;
use super::lock_time::LockTimes;
use super::message::{MessageKind, Role};
use super::news::News;
use super::reader::LogOptions;
use crate::damage::DamageLog;
use crate::epoch_order::RawEpochs;
use crate::pending_slips::PendingSlips;
use crate::rtcm::epochs::EpochBuilder;
use crate::rtcm::{self, ObservationHeader};
use crate::sbf::block::Block;
use crate::sbf::{AntennaId, measurements};
use crate::source::{ReadError, Source};
use crate::ubx::rawx;

/// What the ephemerides of a stream must be of.
const WEEK: &str = "those of the week that the stream is taken to be of";

/// Reads epoch by epoch; its parts are for [`super::LogReader`].
#[derive(Debug)]
pub(super) struct LogEpochs {
    pub(super) source: Source,
    scanner: FrameScanner,
    pub(super) protocol: Protocol,
    /// The protocol was chosen by name: observations of others do not concern us.
    is_chosen: bool,
    /// RTCM 3: of stations; SBF: of antennas.
    choice: Choice,
    locks: LockTimes,
    pub(super) glonass_channels: BTreeMap<u8, i8>,
    pub(super) damage: DamageLog,
    slips: PendingSlips,
    /// Observations that are not read: where the first of each kind is, and how many there are.
    unread: BTreeMap<MessageKind, (u64, u64)>,
    rtcm: EpochBuilder,
    interference: Statements,
    /// Where a station says that its antenna is.
    pub(super) place: Option<Vector<Ecef>>,
    /// Navigation data, where the log is read as received.
    news: Option<News>,
    /// The week that ephemerides tell, where it is not the one in force.
    pub(super) told_date: Option<GpsTime>,
}

impl LogEpochs {
    pub(super) fn new(
        source: Source,
        protocol: Protocol,
        options: &LogOptions,
        begin: Begin,
        damage: DamageLog,
    ) -> Self {
        Self {
            source,
            scanner: FrameScanner::default(),
            protocol,
            is_chosen: options.chosen_protocol().is_some(),
            choice: Choice::new(match protocol {
                Protocol::Sbf => options.antenna.map(|antenna| u16::from(antenna.0)),
                _ => options.station,
            }),
            locks: LockTimes::default(),
            glonass_channels: BTreeMap::new(),
            damage,
            slips: PendingSlips::default(),
            unread: BTreeMap::new(),
            rtcm: EpochBuilder::new(begin, options.as_received),
            interference: Statements::default(),
            place: None,
            news: options.as_received.then(|| {
                let near = (protocol == Protocol::Rtcm3).then_some(begin.time);
                News::new(near.or(options.approximate_time))
            }),
            told_date: None,
        }
    }

    /// Goes on with a stream whose first messages were looked into.
    pub(super) fn go_on_from(
        &mut self,
        scanner: FrameScanner,
        damage: DamageLog,
        news: News,
        interference: Statements,
    ) {
        (self.scanner, self.damage, self.news) = (scanner, damage, Some(news));
        self.interference = interference;
    }

    /// Navigation data that came before the byte at `offset`, where an epoch begins.
    pub(super) fn news_before(&mut self, offset: u64) -> NavigationData {
        let Some(news) = &mut self.news else { return NavigationData::default() };
        news.before(offset, &self.glonass_channels)
    }

    /// RXM-RAWX has a whole epoch.
    fn next_ubx(&mut self, epoch: &mut AntennaEpoch) -> Result<Option<u64>, ReadError> {
        while let Some(frame) = self.scanner.next(&mut self.source, &mut self.damage)? {
            if let Some(news) = &mut self.news {
                news.gather(&frame, &mut self.damage);
            }
            self.interference.take(&frame, None, &mut self.damage);
            if frame.protocol != Protocol::Ubx || frame.body[..2] != rawx::RXM_RAWX {
                let passed = pass(&frame, self.protocol, self.is_chosen, &mut self.unread);
                if let Err(other) = passed {
                    return Err(self.two_protocols(other));
                }
                take_place(&frame, None, &mut self.place);
                continue;
            }
            let (payload, offset) = (&frame.body[4..], frame.offset);
            let Some(time) = rawx::time(payload) else {
                self.damage.note(offset, "RXM-RAWX without a week, skipped");
                continue;
            };
            epoch.time = time;
            let channels = &mut self.glonass_channels;
            rawx::read(payload, offset, epoch, &mut self.locks, channels, &mut self.damage);
            return Ok(Some(offset));
        }
        Ok(None)
    }

    /// An epoch has several messages: it ends where one of a later time comes.
    fn next_rtcm(&mut self, epoch: &mut AntennaEpoch) -> Result<Option<u64>, ReadError> {
        let mut complete = self.rtcm.next_waiting(&mut self.glonass_channels, &mut self.damage);
        while complete.is_none() {
            let Some(frame) = self.scanner.next(&mut self.source, &mut self.damage)? else {
                complete = self.rtcm.end(&mut self.glonass_channels, &mut self.damage);
                break;
            };
            if let Some(news) = &mut self.news {
                news.set_time(self.rtcm.now());
                self.told_date = news.gather(&frame, &mut self.damage);
                if let Some(date) = self.told_date {
                    return Err(self.source.wrong_content(format!("ephemerides of {date}"), WEEK));
                }
            }
            self.interference.take(&frame, None, &mut self.damage);
            let header = match frame.protocol {
                Protocol::Rtcm3 => ObservationHeader::read(frame.body),
                _ => None,
            };
            let Some(header) = header else {
                let passed = pass(&frame, self.protocol, self.is_chosen, &mut self.unread);
                if let Err(other) = passed {
                    return Err(self.two_protocols(other));
                }
                if frame.protocol == Protocol::Rtcm3 {
                    rtcm::ephemeris::glonass_channel(frame.body, &mut self.glonass_channels);
                }
                take_place(&frame, self.choice.wanted(), &mut self.place);
                continue;
            };
            match self.choice.takes(header.station) {
                Some(true) => {}
                Some(false) => continue,
                None => return Err(self.wrong_choice()),
            }
            let Frame { body, offset, .. } = frame;
            let channels = &mut self.glonass_channels;
            complete = self.rtcm.take(&header, body, offset, channels, &mut self.damage);
        }
        Ok(complete.map(|(complete, offset)| {
            *epoch = complete;
            offset
        }))
    }

    /// MeasEpoch has a whole epoch of all antennas.
    fn next_sbf(&mut self, epoch: &mut AntennaEpoch) -> Result<Option<u64>, ReadError> {
        while let Some(frame) = self.scanner.next(&mut self.source, &mut self.damage)? {
            if let Some(news) = &mut self.news {
                news.gather(&frame, &mut self.damage);
            }
            self.interference.take(&frame, self.choice.wanted(), &mut self.damage);
            let block = (frame.protocol == Protocol::Sbf).then(|| Block::of(frame.body));
            let Some(block) = block.filter(|block| block.number == measurements::MEAS_EPOCH) else {
                let passed = pass(&frame, self.protocol, self.is_chosen, &mut self.unread);
                if let Err(other) = passed {
                    return Err(self.two_protocols(other));
                }
                take_place(&frame, None, &mut self.place);
                continue;
            };
            let offset = frame.offset;
            let header = match measurements::Header::read(block.content) {
                Ok(header) => header,
                Err(what) => {
                    self.damage.note(offset, what);
                    continue;
                }
            };
            let antennas = header.antennas(block.content);
            let mut is_wanted = header.is_empty();
            for antenna in (0..AntennaId::COUNT).filter(|antenna| antennas >> antenna & 1 == 1) {
                match self.choice.takes(u16::from(antenna)) {
                    Some(wanted) => is_wanted |= wanted,
                    None => return Err(self.wrong_choice()),
                }
            }
            if !is_wanted {
                continue;
            }
            let Some(time) = block.time() else {
                self.damage.note(offset, "MeasEpoch without a time, skipped");
                continue;
            };
            epoch.time = time;
            let wanted = self.choice.wanted().and_then(|antenna| u8::try_from(antenna).ok());
            let whole = measurements::Epoch {
                antenna: wanted.map_or(AntennaId::MAIN, AntennaId),
                time,
                locks: &mut self.locks,
                glonass_channels: &mut self.glonass_channels,
                observations: &mut epoch.observations,
            }
            .read(&header, block.content);
            if whole.is_none() {
                self.damage.note(offset, "MeasEpoch is shorter than its counts say, the rest lost");
            }
            return Ok(Some(offset));
        }
        Ok(None)
    }

    /// Names the observations that were not read.
    fn note_unread(&mut self) {
        for (kind, (first, count)) in core::mem::take(&mut self.unread) {
            let Role::UnreadObservations(why) = kind.role() else { continue };
            let (s, are) = if count == 1 { ("", "is") } else { ("s", "are") };
            self.damage.note(first, format!("{count} message{s} {kind} {are} not read: {why}"));
        }
    }

    /// There are several stations or antennas, or not the one that was chosen.
    fn wrong_choice(&self) -> ReadError {
        let is_sbf = self.protocol == Protocol::Sbf;
        let name = |number: u16| match u8::try_from(number) {
            Ok(antenna) if is_sbf => AntennaId(antenna).to_string(),
            _ => number.to_string(),
        };
        let found: Vec<String> = self.choice.found().map(name).collect();
        let source = if is_sbf { "antenna" } else { "station" };
        let plural = if found.len() > 1 { "s" } else { "" };
        let mut text = format!("{} of {source}{plural} {}", self.protocol, found.join(" and "));
        if let Some(wanted) = self.choice.wanted().filter(|_| self.choice.is_missing()) {
            text += &format!(", none of {source} {}", name(wanted));
        }
        let expected = match (is_sbf, self.choice.is_missing()) {
            (true, false) => "one antenna, or the key `antenna_id` of the antenna",
            (true, true) => "the one that the key `antenna_id` names",
            (false, false) => "one station, or the key `station_id` of the antenna",
            (false, true) => "the one that the key `station_id` names",
        };
        self.source.wrong_content(text, expected)
    }

    /// Two protocols have observations, and none was chosen.
    fn two_protocols(&self, other: Protocol) -> ReadError {
        let found = format!("observations in {} and in {other}", self.protocol);
        let expected =
            "those of one protocol, or the key `protocol` of the antenna (ubx, rtcm3, sbf)";
        self.source.wrong_content(found, expected)
    }
}

impl RawEpochs for LogEpochs {
    fn next(&mut self, epoch: &mut AntennaEpoch) -> Result<Option<u64>, ReadError> {
        epoch.observations.clear();
        (epoch.power_failure, epoch.clock_offset_s) = (false, None);
        let found = match self.protocol {
            Protocol::Ubx => self.next_ubx(epoch),
            Protocol::Rtcm3 => self.next_rtcm(epoch),
            Protocol::Sbf => self.next_sbf(epoch),
        }?;
        if found.is_none() {
            self.note_unread();
            if self.choice.is_missing() {
                return Err(self.wrong_choice());
            }
        }
        self.slips.apply(epoch, false);
        epoch.interference = self.interference.at(epoch.time);
        Ok(found)
    }

    fn slips(&mut self) -> &mut PendingSlips {
        &mut self.slips
    }

    fn damage(&mut self) -> &mut DamageLog {
        &mut self.damage
    }
}

/// Passes over a message that has no observations for us, and counts those that are not read; the
/// error is another protocol with observations, where none was chosen.
fn pass(
    frame: &Frame<'_>,
    protocol: Protocol,
    is_chosen: bool,
    unread: &mut BTreeMap<MessageKind, (u64, u64)>,
) -> Result<(), Protocol> {
    let kind = MessageKind::of(frame);
    match kind.role() {
        Role::Observations if frame.protocol != protocol && !is_chosen => {
            return Err(frame.protocol);
        }
        Role::UnreadObservations(_) => unread.entry(kind).or_insert((frame.offset, 0)).1 += 1,
        _ => {}
    }
    Ok(())
}

/// Takes the place of a station, of the wanted one if that is known.
fn take_place(frame: &Frame<'_>, wanted: Option<u16>, place: &mut Option<Vector<Ecef>>) {
    if frame.protocol == Protocol::Rtcm3
        && let Some((station, found)) = rtcm::place::read(frame.body)
        && wanted.is_none_or(|wanted| wanted == station)
    {
        *place = Some(found);
    }
}
