//! Septentrio blocks (SBF): measurements of up to eight antennas, navigation pages and messages.
//!
//! Source: Septentrio PolaRx5TR reference guide, firmware 5.5.0, chapter 4 (block headers 4.1.1,
//! time stamps 4.1.3, satellites 4.1.9, signals 4.1.10, blocks 4.2); the mosaic receivers have the
//! same.
//!
//! Each block that is written too is described once, as the list of its fields, for both
//! directions.

pub(crate) mod block;
pub(crate) mod measurements;
mod messages;
pub(crate) mod navigation;
mod pages;
mod parameters;
mod signal;
mod write;

use core::fmt;
use core::str::FromStr;

pub use signal::has_number;
pub use write::SbfWriter;

/// An antenna of a Septentrio receiver, as its logs number them: `main`, `aux1`, `aux2`, …
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct AntennaId(pub(crate) u8);

impl AntennaId {
    /// The main antenna.
    pub const MAIN: Self = Self(0);
    /// Antennas that the blocks have room for.
    pub const COUNT: u8 = 8;
}

impl fmt::Display for AntennaId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            0 => f.write_str("main"),
            number => write!(f, "aux{number}"),
        }
    }
}

/// The text is not the name of an antenna.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{0:?} is no antenna of a Septentrio receiver: expected main, aux1 or aux2")]
pub struct UnknownAntenna(String);

impl FromStr for AntennaId {
    type Err = UnknownAntenna;

    fn from_str(text: &str) -> Result<Self, UnknownAntenna> {
        let named = |number: &u8| Self(*number).to_string() == text;
        (0..Self::COUNT).find(named).map(Self).ok_or_else(|| UnknownAntenna(text.to_owned()))
    }
}
