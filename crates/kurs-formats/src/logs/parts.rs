//! The stations or antennas of a log.

use core::fmt;
use std::collections::BTreeSet;

use super::LogOptions;
use super::frames::{FrameScanner, Protocol};
use crate::damage::DamageLog;
use crate::rtcm::msm;
use crate::sbf::block::Block;
use crate::sbf::{AntennaId, measurements};
use crate::source::{ReadError, Source};

/// What of a log has observations of its own.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum LogPart {
    /// A station of RTCM 3 messages.
    Station(u16),
    /// An antenna of a Septentrio receiver.
    Antenna(AntennaId),
}

impl LogPart {
    /// The options that choose it.
    #[must_use]
    pub fn options(self) -> LogOptions {
        match self {
            Self::Station(station) => {
                LogOptions { station: Some(station), ..LogOptions::default() }
            }
            Self::Antenna(antenna) => {
                LogOptions { antenna: Some(antenna), ..LogOptions::default() }
            }
        }
    }
}

impl fmt::Display for LogPart {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Station(station) => write!(f, "station {station}"),
            Self::Antenna(antenna) => write!(f, "antenna {antenna}"),
        }
    }
}

/// Reads a log to its end and tells which stations or antennas have observations in it; a log whose
/// protocol knows of none has no parts.
///
/// # Errors
///
/// [`ReadError::Io`] if it cannot be read.
pub fn parts(source: &mut Source) -> Result<BTreeSet<LogPart>, ReadError> {
    let (mut scanner, mut damage) = (FrameScanner::default(), DamageLog::default());
    let mut parts = BTreeSet::new();
    while let Some(frame) = scanner.next(source, &mut damage)? {
        match frame.protocol {
            Protocol::Ubx => {}
            Protocol::Rtcm3 => {
                parts.extend(msm::Header::read(frame.body).map(|h| LogPart::Station(h.station)));
            }
            Protocol::Sbf => {
                let block = Block::of(frame.body);
                let header = measurements::Header::read(block.content);
                if let (measurements::MEAS_EPOCH, Ok(header)) = (block.number, header) {
                    let mask = header.antennas(block.content);
                    let antennas = (0..AntennaId::COUNT).filter(|n| mask >> n & 1 == 1);
                    parts.extend(antennas.map(|n| LogPart::Antenna(AntennaId(n))));
                }
            }
        }
    }
    Ok(parts)
}
