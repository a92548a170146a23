//! RTCM 3: observations as multiple signal messages (MSM 4 to 7), ephemerides, the place of a station.
//!
//! Source: RTCM standard 10403.3; numbers of data fields (DF…) are those of its table 3.4-1.
//!
//! The messages are decoded here and not by the crate `rtcm-rs`, which has a type of its own for each
//! of the 28 multiple signal messages: one description of their fields does for all of them, in both
//! directions.

pub(crate) mod clock;
pub(crate) mod ephemeris;
mod lock;
pub(crate) mod msm;
pub(crate) mod place;
mod signal;
mod write;

pub use signal::has_number;
pub use write::Rtcm3Writer;

use crate::fields::BitReader;

/// Number of a message.
pub(crate) fn number(message: &[u8]) -> u16 {
    u16::try_from(BitReader::new(message).take(12)).unwrap_or(0)
}
