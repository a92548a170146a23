//! What is in a log: its messages with their numbers, and its parts.

use core::fmt;
use std::collections::{BTreeMap, BTreeSet};

use super::LogOptions;
use super::frames::{FrameScanner, Protocol};
use super::message::MessageKind;
use crate::damage::DamageLog;
use crate::rtcm::ObservationHeader;
use crate::sbf::block::Block;
use crate::sbf::{AntennaId, measurements};
use crate::source::{ReadError, Source};
use crate::ubx::rawx;

/// What of a log has observations of its own.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum LogPart {
    /// The receiver that writes u-blox messages.
    Receiver,
    /// A station of RTCM 3 messages.
    Station(u16),
    /// An antenna of a Septentrio receiver.
    Antenna(AntennaId),
}

impl LogPart {
    /// The options that choose it.
    #[must_use]
    pub fn options(self) -> LogOptions {
        let none = LogOptions::default();
        match self {
            Self::Receiver => LogOptions { protocol: Some(Protocol::Ubx), ..none },
            Self::Station(station) => LogOptions { station: Some(station), ..none },
            Self::Antenna(antenna) => LogOptions { antenna: Some(antenna), ..none },
        }
    }
}

impl fmt::Display for LogPart {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Receiver => f.write_str("the receiver's own messages"),
            Self::Station(station) => write!(f, "station {station}"),
            Self::Antenna(antenna) => write!(f, "antenna {antenna}"),
        }
    }
}

/// What is in a log.
#[derive(Debug, Clone, Default)]
pub struct Census {
    /// Every kind of message with its number.
    pub messages: BTreeMap<MessageKind, u64>,
    /// Everything that has observations.
    pub parts: BTreeSet<LogPart>,
}

/// Reads a log to its end and tells what is in it.
///
/// # Errors
///
/// [`ReadError::Io`] if it cannot be read.
pub fn census(source: &mut Source) -> Result<Census, ReadError> {
    let (mut scanner, mut damage) = (FrameScanner::default(), DamageLog::default());
    let mut census = Census::default();
    while let Some(frame) = scanner.next(source, &mut damage)? {
        *census.messages.entry(MessageKind::of(&frame)).or_default() += 1;
        let parts = &mut census.parts;
        match frame.protocol {
            Protocol::Ubx => {
                parts.extend((frame.body[..2] == rawx::RXM_RAWX).then_some(LogPart::Receiver));
            }
            Protocol::Rtcm3 => {
                let header = ObservationHeader::read(frame.body);
                parts.extend(header.map(|header| LogPart::Station(header.station)));
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
    Ok(census)
}
