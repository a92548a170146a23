//! Receiver logs: files of binary messages as receivers send them.
//!
//! [`LogReader`] gives the observations of one antenna, epoch by epoch; `read_navigation` the
//! ephemerides of a whole log. Damage is listed with its byte offset.

pub(crate) mod checksum;
pub(crate) mod frames;
pub(crate) mod lock_clock;
pub(crate) mod lock_time;

use std::collections::BTreeMap;

use kurs::observation::AntennaEpoch;
use kurs::time::GpsTime;

use crate::damage::{Damage, DamageLog};
use crate::source::{ReadError, Source};
use crate::ubx::rawx;
use frames::{FrameReader, Protocol};
use lock_time::LockTimes;

/// Observations of one antenna from a receiver log.
#[derive(Debug)]
pub struct LogReader {
    frames: FrameReader,
    locks: LockTimes,
    glonass_channels: BTreeMap<u8, i8>,
    damage: DamageLog,
    last: Option<GpsTime>,
}

impl LogReader {
    /// Reads a log from its start.
    #[must_use]
    pub fn new(source: Source) -> Self {
        Self {
            frames: FrameReader::new(source),
            locks: LockTimes::default(),
            glonass_channels: BTreeMap::new(),
            damage: DamageLog::default(),
            last: None,
        }
    }

    /// Reads the next epoch into `epoch`; `false` (and no observations) at the end of the log.
    ///
    /// # Errors
    ///
    /// [`ReadError::Io`] if the operating system refuses to read on.
    pub fn next_epoch(&mut self, epoch: &mut AntennaEpoch) -> Result<bool, ReadError> {
        epoch.observations.clear();
        (epoch.power_failure, epoch.clock_offset_s) = (false, None);
        while let Some(frame) = self.frames.next(&mut self.damage)? {
            if frame.protocol != Protocol::Ubx || frame.body[..2] != rawx::RXM_RAWX {
                continue;
            }
            let (payload, offset) = (&frame.body[4..], frame.offset);
            let Some(time) = rawx::time(payload) else {
                self.damage.note(offset, "RXM-RAWX without a week, skipped");
                continue;
            };
            if self.last.is_some_and(|last| time <= last) {
                self.damage.note_with(offset, || {
                    format!("epoch {time} is not later than the one before, skipped").into()
                });
                continue;
            }
            self.last = Some(time);
            epoch.time = time;
            let channels = &mut self.glonass_channels;
            rawx::read(payload, offset, epoch, &mut self.locks, channels, &mut self.damage);
            return Ok(true);
        }
        Ok(false)
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
        self.frames.source().name()
    }
}

/// A number that an observation may have: not zero, which means missing, and not absurd.
pub(crate) fn plausible(value: f64) -> Option<f64> {
    (value.is_finite() && value != 0.0 && value.abs() < 1e10).then_some(value)
}

/// Numbers at byte offsets of a message, least significant byte first; `None` behind its end.
pub(crate) trait LittleEndian {
    fn array<const N: usize>(&self, at: usize) -> Option<[u8; N]>;

    fn u16(&self, at: usize) -> Option<u16> {
        self.array(at).map(u16::from_le_bytes)
    }

    fn f32(&self, at: usize) -> Option<f32> {
        self.array(at).map(f32::from_le_bytes)
    }

    fn f64(&self, at: usize) -> Option<f64> {
        self.array(at).map(f64::from_le_bytes)
    }
}

impl LittleEndian for [u8] {
    fn array<const N: usize>(&self, at: usize) -> Option<[u8; N]> {
        self.get(at..)?.first_chunk().copied()
    }
}
