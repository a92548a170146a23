//! RTCM 3: observations as multiple signal messages (MSM 4 to 7) and the messages before them
//! (1002, 1004, 1010, 1012), ephemerides, the place of a station.
//!
//! Source: RTCM standard 10403.3; numbers of data fields (DF…) are those of its table 3.4-1.
//!
//! The messages are decoded here and not by the crate `rtcm-rs`, which has a type of its own for
//! each of the 28 multiple signal messages: one description of their fields does for all of them,
//! in both directions.

pub(crate) mod clock;
pub(crate) mod ephemeris;
pub(crate) mod epochs;
mod legacy;
mod lock;
mod msm;
mod observations;
pub(crate) mod place;
mod prompt_end;
mod signal;
mod write;

pub(crate) use observations::{ObservationDecoder, ObservationHeader};
pub use signal::has_number;
pub use write::Rtcm3Writer;

use crate::fields::BitReader;

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
