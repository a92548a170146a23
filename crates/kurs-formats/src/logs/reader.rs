//! Observations from a log, epoch by epoch.

use std::collections::BTreeMap;

use kurs::observation::AntennaEpoch;
use kurs::time::GpsTime;

use super::frames::{Frame, FrameScanner, Protocol};
use super::lock_time::LockTimes;
use crate::damage::{Damage, DamageLog};
use crate::rtcm;
use crate::source::{ReadError, Source};
use crate::ubx::rawx;

/// What a log does not say by itself.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct LogOptions {
    /// RTCM 3: the station whose observations are wanted; needed where there are several.
    pub station: Option<u16>,
    /// RTCM 3: a time within three days of the log; needed where no message in it tells the date.
    pub approximate_time: Option<GpsTime>,
}

/// Observations of one antenna from a receiver log.
#[derive(Debug)]
pub struct LogReader {
    source: Source,
    scanner: FrameScanner,
    protocol: Protocol,
    /// RTCM 3: the station that was chosen, else the first one.
    station: Option<u16>,
    station_is_chosen: bool,
    locks: LockTimes,
    glonass_channels: BTreeMap<u8, i8>,
    damage: DamageLog,
    /// Time of the last epoch that was begun.
    last: Option<GpsTime>,
    /// RTCM 3: a time within half a week.
    near: GpsTime,
    /// RTCM 3: the epoch whose messages are coming in.
    building: Option<AntennaEpoch>,
}

impl LogReader {
    /// Reads a log from its start.
    ///
    /// # Errors
    ///
    /// [`ReadError::WrongContent`] if it is an RTCM 3 log whose date is not known.
    pub(crate) fn new(
        source: Source,
        protocol: Protocol,
        options: &LogOptions,
        date: Option<GpsTime>,
    ) -> Result<Self, ReadError> {
        const DATE: &str = "a message that does (1019, 1020, 1042, 1044, 1045 or 1046), or the key \
            `approximate_time`, a time within three days of the log";
        let date = options.approximate_time.or(date);
        if protocol == Protocol::Rtcm3 && date.is_none() {
            return Err(source.wrong_content("RTCM 3 messages that do not tell the week", DATE));
        }
        Ok(Self {
            source,
            scanner: FrameScanner::default(),
            protocol,
            station: options.station,
            station_is_chosen: options.station.is_some(),
            locks: LockTimes::default(),
            glonass_channels: BTreeMap::new(),
            damage: DamageLog::default(),
            last: None,
            near: date.unwrap_or_default(),
            building: None,
        })
    }

    /// Reads the next epoch into `epoch`; `false` (and no observations) at the end of the log.
    ///
    /// # Errors
    ///
    /// [`ReadError::Io`] if the operating system refuses to read on; [`ReadError::WrongContent`] if
    /// there are several stations and none was chosen.
    pub fn next_epoch(&mut self, epoch: &mut AntennaEpoch) -> Result<bool, ReadError> {
        epoch.observations.clear();
        (epoch.power_failure, epoch.clock_offset_s) = (false, None);
        match self.protocol {
            Protocol::Ubx => self.next_ubx(epoch),
            _ => self.next_rtcm(epoch),
        }
    }

    /// RXM-RAWX has a whole epoch.
    fn next_ubx(&mut self, epoch: &mut AntennaEpoch) -> Result<bool, ReadError> {
        while let Some(frame) = self.scanner.next(&mut self.source, &mut self.damage)? {
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
            epoch.time = time;
            let channels = &mut self.glonass_channels;
            rawx::read(payload, offset, epoch, &mut self.locks, channels, &mut self.damage);
            return Ok(true);
        }
        Ok(false)
    }

    /// An epoch has several messages: it ends where one of a later time comes.
    fn next_rtcm(&mut self, epoch: &mut AntennaEpoch) -> Result<bool, ReadError> {
        while let Some(frame) = self.scanner.next(&mut self.source, &mut self.damage)? {
            let Frame { protocol: Protocol::Rtcm3, body, offset } = frame else { continue };
            let Some(header) = rtcm::msm::Header::read(body) else {
                rtcm::ephemeris::glonass_channel(body, &mut self.glonass_channels);
                continue;
            };
            let station = *self.station.get_or_insert(header.station);
            if station != header.station {
                if self.station_is_chosen {
                    continue;
                }
                return Err(self.several_stations(station, header.station));
            }
            let time = rtcm::clock::resolve(header.system, header.epoch_time, self.near);
            let Some(time) = time else {
                self.damage.note(offset, "the epoch time is none, message skipped");
                continue;
            };
            let is_new = self.building.as_ref().is_none_or(|building| building.time != time);
            if is_new && !is_later(time, &mut self.last, offset, &mut self.damage) {
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
            if let Some(complete) = complete {
                *epoch = complete;
                return Ok(true);
            }
        }
        Ok(self.building.take().map(|complete| *epoch = complete).is_some())
    }

    fn several_stations(&self, first: u16, second: u16) -> ReadError {
        self.source.wrong_content(
            format!("RTCM 3 messages of stations {first} and {second}"),
            "one station, or the key `station_id` of the antenna",
        )
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
