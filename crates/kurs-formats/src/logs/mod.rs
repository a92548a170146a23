//! Receiver logs: files of binary messages as receivers send them.
//!
//! [`LogReader`] gives the observations of one antenna, epoch by epoch; [`crate::navigation`] takes
//! the ephemerides of a whole log. Damage is listed with its byte offset.

mod census;
pub(crate) mod checksum;
mod choice;
pub(crate) mod dating;
mod epochs;
pub(crate) mod file_date;
pub(crate) mod frames;
mod interference;
pub(crate) mod lock_clock;
pub(crate) mod lock_time;
mod message;
pub(crate) mod navigation;
mod news;
mod reader;
pub(crate) mod start;
pub(crate) mod whole_cycles;

use kurs::observation::Observation;
use kurs::time::GpsTime;

pub use census::{Census, LogPart, census};
pub use frames::{Protocol, UnknownProtocol};
pub use message::{MessageKind, Role};
pub use reader::{LogOptions, LogReader};

/// A number that an observation may have: not zero, which means missing, and not absurd.
pub(crate) fn plausible(value: f64) -> Option<f64> {
    (value.is_finite() && value != 0.0 && value.abs() < 1e10).then_some(value)
}

/// Whether an observation says nothing.
pub(crate) fn is_empty(o: &Observation) -> bool {
    [o.pseudorange_m, o.phase_cycles, o.doppler_hz, o.cn0_dbhz].iter().all(Option::is_none)
}

/// The nearest whole millisecond: logs have no finer time tags.
pub(crate) fn whole_milliseconds(time: GpsTime) -> GpsTime {
    const NANOSECONDS: i64 = 1_000_000;
    let rounded = (time.as_nanoseconds() + NANOSECONDS / 2).div_euclid(NANOSECONDS);
    GpsTime::from_nanoseconds(rounded * NANOSECONDS)
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
