//! RTCM 3: observations as multiple signal messages (MSM 4 to 7) and the messages before them (1002,
//! 1004, 1010, 1012), ephemerides, the place of a station.
//!
//! Source: RTCM standard 10403.3; numbers of data fields (DF…) are those of its table 3.4-1.
//!
//! The messages are decoded here and not by the crate `rtcm-rs`, which has a type of its own for each
//! of the 28 multiple signal messages: one description of their fields does for all of them, in both
//! directions.

pub(crate) mod clock;
pub(crate) mod ephemeris;
pub(crate) mod epochs;
pub(crate) mod legacy;
mod lock;
mod msm;
pub(crate) mod place;
mod signal;
mod write;

use std::collections::BTreeMap;

use kurs::observation::Observation;
use kurs::signal::System;
use kurs::time::GpsTime;

pub use signal::has_number;
pub use write::Rtcm3Writer;

use crate::fields::BitReader;
use crate::logs::lock_time::LockTimes;

/// Number of a message.
pub(crate) fn number(message: &[u8]) -> u16 {
    u16::try_from(BitReader::new(message).take(12)).unwrap_or(0)
}

/// What a message is about.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Content {
    Observations,
    /// Observations whose ranges lack their whole milliseconds.
    CutObservations,
    Ephemeris,
    Place,
}

/// What the message of a number is about, if anything is read from it or could be.
pub(crate) fn content(number: u16) -> Option<Content> {
    let whole = |is_whole: bool| match is_whole {
        true => Content::Observations,
        false => Content::CutObservations,
    };
    if let Some(layout) = legacy::layout(number) {
        return Some(whole(layout.has_whole_ranges()));
    }
    if let Some((_, kind)) = signal::kind(number) {
        return Some(whole(kind >= 4));
    }
    match number {
        _ if ephemeris::is_one(number) => Some(Content::Ephemeris),
        place::WITHOUT_HEIGHT | place::WITH_HEIGHT => Some(Content::Place),
        _ => None,
    }
}

/// What stands before the satellites of a message with observations.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct ObservationHeader {
    pub(crate) system: System,
    pub(crate) station: u16,
    /// 30 bits, the meaning of which depends on the system.
    pub(crate) epoch_time: u64,
    /// The message is older than the multiple signal messages.
    pub(crate) is_legacy: bool,
}

impl ObservationHeader {
    /// Reads the header, if this is a message with observations that are read.
    pub(crate) fn read(message: &[u8]) -> Option<Self> {
        let number = number(message);
        if let Some(layout) = legacy::layout(number).filter(|layout| layout.has_whole_ranges()) {
            let mut reader = BitReader::new(message);
            reader.take(12);
            let station = u16::try_from(reader.take(12)).ok()?;
            let time = reader.take(layout.time_bits());
            // GLONASS: the day is left out, which in a multiple signal message is day 7.
            let epoch_time = time | if layout.system == System::Glonass { 7 << 27 } else { 0 };
            let header = Self { system: layout.system, station, epoch_time, is_legacy: true };
            return reader.is_whole().then_some(header);
        }
        let msm = msm::Header::read(message)?;
        let (system, station, epoch_time) = (msm.system, msm.station, msm.epoch_time);
        Some(Self { system, station, epoch_time, is_legacy: false })
    }
}

/// Reads the observations of messages into epochs.
#[derive(Debug, Default)]
pub(crate) struct ObservationDecoder {
    locks: LockTimes,
    legacy: legacy::Memory,
    /// Observations of older messages of the epoch that is coming in.
    legacy_observations: Vec<Observation>,
    /// Systems that the multiple signal messages of this log have.
    newer: Vec<System>,
}

impl ObservationDecoder {
    /// Adds the observations of a message; `None` if it is shorter than it says.
    pub(crate) fn add(
        &mut self,
        message: &[u8],
        time: GpsTime,
        glonass_channels: &mut BTreeMap<u8, i8>,
        observations: &mut Vec<Observation>,
    ) -> Option<()> {
        if let Some(layout) = legacy::layout(number(message)) {
            let observations = &mut self.legacy_observations;
            return self.legacy.read(layout, message, time, glonass_channels, observations);
        }
        let header = msm::Header::read(message)?;
        if !self.newer.contains(&header.system) {
            self.newer.push(header.system);
        }
        msm::read(&header, message, time, &mut self.locks, glonass_channels, observations)
    }

    /// Ends an epoch: older messages give the systems that no newer one has (two phases of one
    /// satellite differ by whole cycles).
    pub(crate) fn finish(&mut self, observations: &mut Vec<Observation>) {
        let newer = &self.newer;
        let wanted = |o: &Observation| !newer.contains(&o.satellite.system);
        observations.extend(self.legacy_observations.drain(..).filter(wanted));
    }
}
