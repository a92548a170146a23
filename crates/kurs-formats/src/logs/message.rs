//! The kinds of messages in a log: their names, and what is read from them.

use core::fmt;

use super::frames::{Frame, Protocol};
use crate::rtcm;
use crate::sbf::block::Block;

/// One kind of message.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct MessageKind {
    protocol: Protocol,
    /// UBX: class and number, a byte each; RTCM 3 and SBF: number.
    number: u16,
}

/// What is read from a kind of message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// Observations.
    Observations,
    /// Observations that are not read, and why.
    UnreadObservations(&'static str),
    /// Ephemerides, or parts of them.
    Navigation,
    /// Where the antenna is.
    Place,
    /// What the receiver states about foreign signals.
    Interference,
    /// Nothing.
    Other,
}

/// Why messages of cut ranges are not read.
const CUT_RANGES: &str =
    "their ranges lack the whole milliseconds (let the receiver send MSM 4 to 7)";
const OLD_RAW: &str = "raw data of older receivers (let the receiver send RXM-RAWX)";
const OLD_MEASUREMENTS: &str = "let the receiver log MeasEpoch";

/// Messages of u-blox that have names here: class, number, name, what is read.
const UBX: [(u8, u8, &str, Role); 39] = [
    (0x01, 0x01, "NAV-POSECEF", Role::Other),
    (0x01, 0x02, "NAV-POSLLH", Role::Other),
    (0x01, 0x03, "NAV-STATUS", Role::Interference),
    (0x01, 0x04, "NAV-DOP", Role::Other),
    (0x01, 0x05, "NAV-ATT", Role::Other),
    (0x01, 0x06, "NAV-SOL", Role::Other),
    (0x01, 0x07, "NAV-PVT", Role::Other),
    (0x01, 0x11, "NAV-VELECEF", Role::Other),
    (0x01, 0x12, "NAV-VELNED", Role::Other),
    (0x01, 0x13, "NAV-HPPOSECEF", Role::Other),
    (0x01, 0x14, "NAV-HPPOSLLH", Role::Other),
    (0x01, 0x20, "NAV-TIMEGPS", Role::Other),
    (0x01, 0x21, "NAV-TIMEUTC", Role::Other),
    (0x01, 0x22, "NAV-CLOCK", Role::Other),
    (0x01, 0x26, "NAV-TIMELS", Role::Other),
    (0x01, 0x30, "NAV-SVINFO", Role::Other),
    (0x01, 0x35, "NAV-SAT", Role::Other),
    (0x01, 0x36, "NAV-COV", Role::Other),
    (0x01, 0x3b, "NAV-SVIN", Role::Other),
    (0x01, 0x3c, "NAV-RELPOSNED", Role::Other),
    (0x01, 0x43, "NAV-SIG", Role::Other),
    (0x01, 0x61, "NAV-EOE", Role::Other),
    (0x02, 0x10, "RXM-RAW", Role::UnreadObservations(OLD_RAW)),
    (0x02, 0x11, "RXM-SFRB", Role::Other),
    (0x02, 0x13, "RXM-SFRBX", Role::Navigation),
    (0x02, 0x14, "RXM-MEASX", Role::Other),
    (0x02, 0x15, "RXM-RAWX", Role::Observations),
    (0x02, 0x20, "RXM-SVSI", Role::Other),
    (0x02, 0x32, "RXM-RTCM", Role::Other),
    (0x05, 0x00, "ACK-NAK", Role::Other),
    (0x05, 0x01, "ACK-ACK", Role::Other),
    (0x0a, 0x04, "MON-VER", Role::Other),
    (0x0a, 0x09, "MON-HW", Role::Other),
    (0x0a, 0x31, "MON-SPAN", Role::Other),
    (0x0a, 0x36, "MON-COMMS", Role::Other),
    (0x0a, 0x38, "MON-RF", Role::Interference),
    (0x0d, 0x01, "TIM-TP", Role::Other),
    (0x0d, 0x03, "TIM-TM2", Role::Other),
    (0x27, 0x09, "SEC-SIG", Role::Interference),
];

/// Blocks of Septentrio that have names here.
const SBF: [(u16, &str, Role); 43] = [
    (4001, "DOP", Role::Other),
    (4002, "GALNav", Role::Navigation),
    (4004, "GLONav", Role::Navigation),
    (4006, "PVTCartesian", Role::Other),
    (4007, "PVTGeodetic", Role::Other),
    (4013, "ChannelStatus", Role::Other),
    (4014, "ReceiverStatus", Role::Other),
    (4017, "GPSRawCA", Role::Navigation),
    (4022, "GALRawFNAV", Role::Navigation),
    (4023, "GALRawINAV", Role::Navigation),
    (4026, "GLORawCA", Role::Navigation),
    (4027, "MeasEpoch", Role::Observations),
    (4030, "GALIon", Role::Navigation),
    (4031, "GALUtc", Role::Navigation),
    (4032, "GALGstGps", Role::Navigation),
    (4036, "GLOTime", Role::Navigation),
    (4047, "BDSRaw", Role::Navigation),
    (4066, "QZSRawL1CA", Role::Navigation),
    (4081, "BDSNav", Role::Navigation),
    (4092, "RFStatus", Role::Interference),
    (4095, "QZSNav", Role::Navigation),
    (4109, "Meas3Ranges", Role::UnreadObservations(OLD_MEASUREMENTS)),
    (4110, "Meas3CN0HiRes", Role::Other),
    (4111, "Meas3Doppler", Role::Other),
    (4112, "Meas3PP", Role::Other),
    (4113, "Meas3MP", Role::Other),
    (4120, "BDSIon", Role::Navigation),
    (4121, "BDSUtc", Role::Navigation),
    (5889, "MeasEpoch_v1", Role::UnreadObservations(OLD_MEASUREMENTS)),
    (5891, "GPSNav", Role::Navigation),
    (5892, "GPSAlm", Role::Other),
    (5893, "GPSIon", Role::Navigation),
    (5894, "GPSUtc", Role::Navigation),
    (5896, "GEONav", Role::Other),
    (5902, "ReceiverSetup", Role::Other),
    (5905, "PosCovCartesian", Role::Other),
    (5906, "PosCovGeodetic", Role::Other),
    (5914, "ReceiverTime", Role::Other),
    (5921, "EndOfPVT", Role::Other),
    (5922, "EndOfMeas", Role::Other),
    (5938, "AttEuler", Role::Other),
    (5939, "AttCovEuler", Role::Other),
    (5944, "GenMeasEpoch", Role::UnreadObservations(OLD_MEASUREMENTS)),
];

impl MessageKind {
    /// The kind of a message.
    pub(crate) fn of(frame: &Frame<'_>) -> Self {
        let number = match frame.protocol {
            Protocol::Ubx => u16::from_be_bytes([frame.body[0], frame.body[1]]),
            Protocol::Rtcm3 => rtcm::number(frame.body),
            Protocol::Sbf => Block::of(frame.body).number,
        };
        Self { protocol: frame.protocol, number }
    }

    /// The protocol it is of.
    #[must_use]
    pub const fn protocol(self) -> Protocol {
        self.protocol
    }

    /// What is read from it.
    #[must_use]
    pub fn role(self) -> Role {
        match self.protocol {
            Protocol::Ubx => self.ubx().map_or(Role::Other, |(.., role)| *role),
            Protocol::Sbf => self.sbf().map_or(Role::Other, |(.., role)| *role),
            Protocol::Rtcm3 => match rtcm::content(self.number) {
                Some(rtcm::Content::Observations) => Role::Observations,
                Some(rtcm::Content::CutObservations) => Role::UnreadObservations(CUT_RANGES),
                Some(rtcm::Content::Ephemeris) => Role::Navigation,
                Some(rtcm::Content::Place) => Role::Place,
                None => Role::Other,
            },
        }
    }

    fn ubx(self) -> Option<&'static (u8, u8, &'static str, Role)> {
        let [class, number] = self.number.to_be_bytes();
        UBX.iter().find(|row| (row.0, row.1) == (class, number))
    }

    fn sbf(self) -> Option<&'static (u16, &'static str, Role)> {
        SBF.iter().find(|row| row.0 == self.number)
    }
}

/// `RXM-RAWX`, `1077`, `MeasEpoch`; numbers where there is no name.
impl fmt::Display for MessageKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match (self.protocol, self.ubx(), self.sbf()) {
            (Protocol::Rtcm3, ..) => write!(f, "{}", self.number),
            (Protocol::Ubx, Some((.., name, _)), _) => f.write_str(name),
            (Protocol::Ubx, None, _) => {
                let [class, number] = self.number.to_be_bytes();
                write!(f, "UBX {class:02X} {number:02X}")
            }
            (Protocol::Sbf, _, Some((_, name, _))) => f.write_str(name),
            (Protocol::Sbf, ..) => write!(f, "SBF {}", self.number),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_and_roles() {
        let kind = |protocol, number| MessageKind { protocol, number };
        let rawx = kind(Protocol::Ubx, 0x0215);
        assert_eq!((rawx.to_string().as_str(), rawx.role()), ("RXM-RAWX", Role::Observations));
        let unknown = kind(Protocol::Ubx, 0x0abc);
        assert_eq!((unknown.to_string().as_str(), unknown.role()), ("UBX 0A BC", Role::Other));
        for (number, role) in [
            (1003, Role::UnreadObservations(CUT_RANGES)),
            (1012, Role::Observations),
            (1072, Role::UnreadObservations(CUT_RANGES)),
            (1137, Role::Observations),
            (1006, Role::Place),
            (1042, Role::Navigation),
            (1033, Role::Other),
        ] {
            assert_eq!(kind(Protocol::Rtcm3, number).role(), role, "{number}");
        }
        let packed = kind(Protocol::Sbf, 4109);
        assert_eq!(packed.to_string(), "Meas3Ranges");
        assert_eq!(packed.role(), Role::UnreadObservations(OLD_MEASUREMENTS));
        assert_eq!(kind(Protocol::Sbf, 17).to_string(), "SBF 17");
    }
}
