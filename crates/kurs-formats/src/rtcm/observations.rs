//! Messages with observations, whichever kind they are of: the multiple signal messages, and those
//! before them.

use std::collections::BTreeMap;

use kurs::observation::Observation;
use kurs::signal::System;
use kurs::time::GpsTime;

use super::{legacy, msm};
use crate::fields::BitReader;
use crate::logs::lock_time::LockTimes;

/// What stands before the satellites of a message with observations.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct ObservationHeader {
    pub(crate) system: System,
    pub(crate) station: u16,
    /// 30 bits, the meaning of which depends on the system.
    pub(crate) epoch_time: u64,
    /// Another message of the same epoch and station follows; some programs do not set it.
    pub(crate) more_follows: bool,
}

impl ObservationHeader {
    /// Reads the header, if this is a message with observations that are read.
    pub(crate) fn read(message: &[u8]) -> Option<Self> {
        let number = super::number(message);
        if let Some(layout) = legacy::layout(number).filter(|layout| layout.has_whole_ranges()) {
            let mut reader = BitReader::new(message);
            reader.take(12);
            let station = u16::try_from(reader.take(12)).ok()?;
            let time = reader.take(layout.time_bits());
            // GLONASS: the day is left out, which in a multiple signal message is day 7.
            let epoch_time = time | if layout.system == System::Glonass { 7 << 27 } else { 0 };
            let more_follows = reader.take(1) == 1;
            let header = Self { system: layout.system, station, epoch_time, more_follows };
            return reader.is_whole().then_some(header);
        }
        let msm = msm::Header::read(message)?;
        let msm::Header { system, station, epoch_time, more_follows, .. } = msm;
        Some(Self { system, station, epoch_time, more_follows })
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
        if let Some(layout) = legacy::layout(super::number(message)) {
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
