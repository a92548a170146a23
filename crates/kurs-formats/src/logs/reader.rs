//! Observations from a log, epoch by epoch.

use std::collections::BTreeMap;

use kurs::ephemeris::NavigationData;
use kurs::frames::{Ecef, Vector};
use kurs::observation::AntennaEpoch;
use kurs::time::GpsTime;

use super::choice::Choice;
use super::frames::{Frame, FrameScanner, Protocol};
use super::lock_time::LockTimes;
use super::news::News;
use super::prompt_end::PromptEnd;
use crate::damage::{Damage, DamageLog};
use crate::rtcm;
use crate::sbf::block::Block;
use crate::sbf::{AntennaId, measurements};
use crate::source::{ReadError, Source};
use crate::ubx::rawx;

/// What a log does not say by itself.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct LogOptions {
    /// RTCM 3: the station whose observations are wanted; needed where there are several.
    pub station: Option<u16>,
    /// SBF: the antenna whose observations are wanted; needed where there are several.
    pub antenna: Option<AntennaId>,
    /// RTCM 3: a time within three days of the log; needed where no message in it tells the date.
    pub approximate_time: Option<GpsTime>,
    /// The log is read as a live stream is: every epoch brings the navigation data that came before it
    /// ([`LogReader::take_news`]), and an epoch of RTCM 3 ends with the message that says so.
    pub as_received: bool,
}

/// Observations of one antenna from a receiver log.
#[derive(Debug)]
pub struct LogReader {
    source: Source,
    scanner: FrameScanner,
    protocol: Protocol,
    /// RTCM 3: of stations; SBF: of antennas.
    choice: Choice,
    locks: LockTimes,
    glonass_channels: BTreeMap<u8, i8>,
    damage: DamageLog,
    /// Time of the last epoch that was begun.
    last: Option<GpsTime>,
    /// RTCM 3: a time within half a week.
    near: GpsTime,
    /// RTCM 3: the epoch whose messages are coming in.
    building: Option<AntennaEpoch>,
    /// Byte offsets of the first message with observations of the epoch whose messages are coming in,
    /// and of the one that was given out last.
    building_at: u64,
    begun_at: u64,
    /// As received: navigation data.
    news: Option<News>,
    /// RTCM 3, as received: whether the messages tell where an epoch ends.
    prompt_end: Option<PromptEnd>,
    /// SBF: observations in blocks that are not read were noted.
    packed_noted: bool,
    /// RTCM 3: where the station says that its antenna is.
    place: Option<Vector<Ecef>>,
}

impl LogReader {
    /// Reads a log from its start.
    ///
    /// # Errors
    ///
    /// [`ReadError::WrongContent`] if it is an RTCM 3 log whose date is not known, or if a station or
    /// antenna is chosen and the protocol has none.
    pub(crate) fn new(
        source: Source,
        protocol: Protocol,
        options: &LogOptions,
        date: Option<GpsTime>,
    ) -> Result<Self, ReadError> {
        const DATE: &str = "a message that does (1019, 1020, 1042, 1044, 1045 or 1046), or the key \
            `approximate_time`, a time within three days of the log";
        if options.antenna.is_some() && protocol != Protocol::Sbf {
            let antenna =
                "Septentrio blocks (SBF), because `antenna_id` chooses one of their antennas";
            return Err(source.wrong_content(protocol.to_string(), antenna));
        }
        if options.station.is_some() && protocol != Protocol::Rtcm3 {
            let station = "RTCM 3 messages, because `station_id` chooses one of their stations";
            return Err(source.wrong_content(protocol.to_string(), station));
        }
        let date = options.approximate_time.or(date);
        if protocol == Protocol::Rtcm3 && date.is_none() {
            return Err(source.wrong_content("RTCM 3 messages that do not tell the week", DATE));
        }
        let news = options.as_received.then(|| News::new(options.approximate_time));
        Ok(Self {
            source,
            scanner: FrameScanner::default(),
            protocol,
            choice: Choice::new(match protocol {
                Protocol::Sbf => options.antenna.map(|antenna| u16::from(antenna.0)),
                _ => options.station,
            }),
            locks: LockTimes::default(),
            glonass_channels: BTreeMap::new(),
            damage: DamageLog::default(),
            last: None,
            near: date.unwrap_or_default(),
            building: None,
            building_at: 0,
            begun_at: 0,
            news,
            prompt_end: options.as_received.then(PromptEnd::default),
            packed_noted: false,
            place: None,
        })
    }

    /// Reads a stream as it comes: its protocol is that of the first message with observations, for
    /// which it waits. `options.as_received` is taken for granted.
    ///
    /// # Errors
    ///
    /// [`ReadError`] if the stream breaks off or ends without any observation, or if a station or an
    /// antenna is chosen and the protocol has none, or if `approximate_time` is needed and not given.
    pub fn of_stream(mut source: Source, options: &LogOptions) -> Result<Self, ReadError> {
        let options = LogOptions { as_received: true, ..*options };
        let (mut scanner, mut damage) = (FrameScanner::default(), DamageLog::default());
        let mut news = News::new(options.approximate_time);
        let protocol = loop {
            let Some(frame) = scanner.next(&mut source, &mut damage)? else {
                return Err(source.wrong_content("no observations", OBSERVATIONS));
            };
            if has_observations(&frame) {
                break frame.protocol;
            }
            news.gather(&frame, &mut damage);
        };
        scanner.give_again();
        let reader = Self::new(source, protocol, &options, None)?;
        Ok(Self { scanner, damage, news: Some(news), ..reader })
    }

    /// Navigation data that came before the first message of the epoch that was read last and after
    /// that of the epoch before; nothing unless the log is read as received.
    pub fn take_news(&mut self) -> NavigationData {
        self.news.as_mut().map(News::take).unwrap_or_default()
    }

    /// Reads the next epoch into `epoch`; `false` (and no observations) at the end of the log.
    ///
    /// # Errors
    ///
    /// [`ReadError::Io`] if the operating system refuses to read on; [`ReadError::WrongContent`] if
    /// there are several stations or antennas and none was chosen, or the chosen one is not there.
    pub fn next_epoch(&mut self, epoch: &mut AntennaEpoch) -> Result<bool, ReadError> {
        epoch.observations.clear();
        (epoch.power_failure, epoch.clock_offset_s) = (false, None);
        let found = match self.protocol {
            Protocol::Ubx => self.next_ubx(epoch),
            Protocol::Rtcm3 => self.next_rtcm(epoch),
            Protocol::Sbf => self.next_sbf(epoch),
        }?;
        if !found && self.choice.is_missing() {
            return Err(self.wrong_choice());
        }
        Ok(found)
    }

    /// RXM-RAWX has a whole epoch.
    fn next_ubx(&mut self, epoch: &mut AntennaEpoch) -> Result<bool, ReadError> {
        while let Some(frame) = self.scanner.next(&mut self.source, &mut self.damage)? {
            if let Some(news) = &mut self.news {
                news.gather(&frame, &mut self.damage);
            }
            if frame.protocol != Protocol::Ubx || frame.body[..2] != rawx::RXM_RAWX {
                continue;
            }
            let (payload, offset) = (&frame.body[4..], frame.offset);
            let Some(time) = rawx::time(payload) else {
                self.damage.note(offset, "RXM-RAWX without a week, skipped");
                continue;
            };
            if !is_later(time, &mut self.last, offset, &mut self.damage) {
                continue;
            }
            (epoch.time, self.begun_at) = (time, offset);
            let channels = &mut self.glonass_channels;
            rawx::read(payload, offset, epoch, &mut self.locks, channels, &mut self.damage);
            if let Some(news) = &mut self.news {
                news.epoch_began();
                news.epoch_ended(&self.glonass_channels);
            }
            return Ok(true);
        }
        Ok(false)
    }

    /// An epoch has several messages: it ends where one of a later time comes, or with the last one if
    /// that is known.
    fn next_rtcm(&mut self, epoch: &mut AntennaEpoch) -> Result<bool, ReadError> {
        if self.building.is_some() && self.prompt_end.as_ref().is_some_and(PromptEnd::is_complete) {
            return Ok(self.give_built(epoch));
        }
        while let Some(frame) = self.scanner.next(&mut self.source, &mut self.damage)? {
            if let Some(news) = &mut self.news {
                news.gather(&frame, &mut self.damage);
            }
            let Frame { protocol: Protocol::Rtcm3, body, offset } = frame else { continue };
            let Some(header) = rtcm::msm::Header::read(body) else {
                rtcm::ephemeris::glonass_channel(body, &mut self.glonass_channels);
                if let Some((station, place)) = rtcm::place::read(body)
                    && self.choice.wanted().is_none_or(|wanted| wanted == station)
                {
                    self.place = Some(place);
                }
                if let Some(date) = self.news.as_mut().and_then(|news| news.other_date(self.near)) {
                    self.damage.note_with(offset, || {
                        format!("ephemerides of {date} tell that the week is wrong").into()
                    });
                    (self.near, self.last, self.building) = (date, None, None);
                }
                continue;
            };
            match self.choice.takes(header.station) {
                Some(true) => {}
                Some(false) => continue,
                None => return Err(self.wrong_choice()),
            }
            let time = rtcm::clock::resolve(header.system, header.epoch_time, self.near);
            let Some(time) = time else {
                self.damage.note(offset, "the epoch time is none, message skipped");
                continue;
            };
            let is_new = self.building.as_ref().is_none_or(|building| building.time != time);
            if is_new && !is_later(time, &mut self.last, offset, &mut self.damage) {
                if let Some(end) = self.prompt_end.as_mut().filter(|_| self.last == Some(time)) {
                    end.came_behind();
                }
                continue;
            }
            self.near = time;
            let complete = if is_new { self.building.take() } else { None };
            let building = self.building.get_or_insert_with(|| core::mem::take(epoch));
            building.time = time;
            let (locks, channels) = (&mut self.locks, &mut self.glonass_channels);
            let observations = &mut building.observations;
            if rtcm::msm::read(&header, body, time, locks, channels, observations).is_none() {
                self.damage.note(offset, "the message is shorter than its masks say, skipped");
            }
            match &mut self.prompt_end {
                Some(end) if is_new => end.begin(header.more_follows),
                Some(end) => end.go_on(header.more_follows),
                None => {}
            }
            if let Some(news) = &mut self.news {
                if complete.is_some() {
                    news.epoch_ended(&self.glonass_channels);
                }
                if is_new {
                    news.epoch_began();
                }
            }
            let before = self.building_at;
            if is_new {
                self.building_at = offset;
            }
            if let Some(complete) = complete {
                (*epoch, self.begun_at) = (complete, before);
                return Ok(true);
            }
            if self.prompt_end.as_ref().is_some_and(PromptEnd::is_complete) {
                return Ok(self.give_built(epoch));
            }
        }
        Ok(self.give_built(epoch))
    }

    /// The epoch of RTCM 3 that has come in so far, if there is one.
    fn give_built(&mut self, epoch: &mut AntennaEpoch) -> bool {
        let Some(complete) = self.building.take() else { return false };
        if let Some(news) = &mut self.news {
            news.epoch_ended(&self.glonass_channels);
        }
        (*epoch, self.begun_at) = (complete, self.building_at);
        true
    }

    /// MeasEpoch has a whole epoch of all antennas.
    fn next_sbf(&mut self, epoch: &mut AntennaEpoch) -> Result<bool, ReadError> {
        while let Some(frame) = self.scanner.next(&mut self.source, &mut self.damage)? {
            if let Some(news) = &mut self.news {
                news.gather(&frame, &mut self.damage);
            }
            let Frame { protocol: Protocol::Sbf, body, offset } = frame else { continue };
            let block = Block::of(body);
            if block.number == measurements::MEAS3_RANGES && !self.packed_noted {
                self.packed_noted = true;
                self.damage.note(
                    offset,
                    "Meas3Ranges are not read, here and behind: let the receiver log MeasEpoch",
                );
            }
            if block.number != measurements::MEAS_EPOCH {
                continue;
            }
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
            if !is_later(time, &mut self.last, offset, &mut self.damage) {
                continue;
            }
            (epoch.time, self.begun_at) = (time, offset);
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
            if let Some(news) = &mut self.news {
                news.epoch_began();
                news.epoch_ended(&self.glonass_channels);
            }
            return Ok(true);
        }
        Ok(false)
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

    /// Byte offset of the first message with observations of the epoch that was read last.
    #[must_use]
    pub const fn begun_at(&self) -> u64 {
        self.begun_at
    }

    /// Where the log says that the antenna is (RTCM 3: its reference point); as of the last message.
    #[must_use]
    pub const fn place_m(&self) -> Option<Vector<Ecef>> {
        self.place
    }

    /// GLONASS frequency channel of each orbital slot that was seen so far.
    #[must_use]
    pub const fn glonass_channels(&self) -> &BTreeMap<u8, i8> {
        &self.glonass_channels
    }

    /// What was skipped so far, the first [`DamageLog::LISTED_MAX`] entries of it.
    #[must_use]
    pub fn damage(&self) -> &[Damage] {
        self.damage.listed()
    }

    /// How much was skipped so far, the unlisted included.
    #[must_use]
    pub const fn damage_count(&self) -> u64 {
        self.damage.total()
    }

    /// Name of the file.
    #[must_use]
    pub fn name(&self) -> &str {
        self.source.name()
    }
}

/// What a stream must bring.
const OBSERVATIONS: &str = "messages with observations: RXM-RAWX (UBX), MSM 4 to 7 (RTCM 3) or \
    MeasEpoch (SBF)";

/// Whether a message has observations.
fn has_observations(frame: &Frame<'_>) -> bool {
    match frame.protocol {
        Protocol::Ubx => frame.body[..2] == rawx::RXM_RAWX,
        Protocol::Rtcm3 => rtcm::msm::Header::read(frame.body).is_some(),
        Protocol::Sbf => Block::of(frame.body).number == measurements::MEAS_EPOCH,
    }
}

/// Whether an epoch is later than those before; if it is not, that is damage.
fn is_later(
    time: GpsTime,
    last: &mut Option<GpsTime>,
    offset: u64,
    damage: &mut DamageLog,
) -> bool {
    let later = last.is_none_or(|last| time > last);
    if later {
        *last = Some(time);
    } else {
        damage.note_with(offset, || {
            format!("epoch {time} is not later than the one before, skipped").into()
        });
    }
    later
}
