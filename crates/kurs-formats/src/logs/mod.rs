//! Receiver logs: files of binary messages as receivers send them.
//!
//! [`LogReader`] gives the observations of one antenna, epoch by epoch; [`crate::navigation`] takes the
//! ephemerides of a whole log. Damage is listed with its byte offset.

pub(crate) mod checksum;
pub(crate) mod frames;
pub(crate) mod lock_clock;
pub(crate) mod lock_time;
pub(crate) mod navigation;
mod reader;

pub use reader::{LogOptions, LogReader};

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
