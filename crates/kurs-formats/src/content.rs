//! What a file holds, told from its first bytes and never from its name.

use core::fmt;

use std::path::Path;

use crate::logs::frames::{self, Protocol};
use crate::logs::start;
use crate::source::{ReadError, Source};

/// The content of a file as its first bytes show it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Content {
    /// No bytes at all.
    Empty,
    /// RINEX observations.
    RinexObservation,
    /// Compact (Hatanaka) RINEX observations.
    CompactRinex,
    /// RINEX navigation data, any version.
    RinexNavigation,
    /// RINEX of another type: meteorological, clocks and others, with the type as written.
    RinexOther(String),
    /// Precise orbits.
    Sp3,
    /// Antenna phase centres.
    Antex,
    /// u-blox messages.
    Ubx,
    /// RTCM 3 messages.
    Rtcm3,
    /// Septentrio blocks.
    Sbf,
    /// NMEA sentences.
    Nmea,
    /// A web page, for example the answer of an archive that wants a login.
    Html,
    /// Other text, with the first words of it.
    Text(String),
    /// Bytes that are neither text nor a known format.
    Noise,
}

impl Content {
    /// Bytes from the start of a file that are enough to judge it.
    pub const ENOUGH: usize = 64 * 1024;

    /// Judges the start of a file: [`Content::ENOUGH`] bytes, or all if there are fewer.
    #[must_use]
    pub fn of(start: &[u8]) -> Self {
        match start.trim_ascii_start() {
            [] => return Self::Empty,
            [b'#', b'a'..=b'd', b'P' | b'V', ..] => return Self::Sp3,
            _ => {}
        }
        start.split(|byte| *byte == b'\n').find_map(Self::of_header_line).unwrap_or_else(|| {
            // A log may begin in the midst of a message, or with text, and with messages of another
            // protocol than its observations.
            if let Some(protocol) = frames::first_protocol(start) {
                return Self::of_protocol(protocol);
            }
            match start {
                [0xb5, 0x62, ..] => return Self::Ubx,
                // RTCM 3: six reserved bits are zero.
                [0xd3, length, ..] if length >> 2 == 0 => return Self::Rtcm3,
                [b'$', b'@', ..] => return Self::Sbf,
                _ => {}
            }
            if let [b'$', b'A'..=b'Z', b'A'..=b'Z', ..] = start {
                return Self::Nmea;
            }
            match start.trim_ascii_start() {
                _ if !is_readable(start) => Self::Noise,
                [b'<', ..] => Self::Html,
                text => Self::Text(first_words(text)),
            }
        })
    }

    /// Judges a file; one that begins with sentences of NMEA is looked through for messages with
    /// observations.
    ///
    /// # Errors
    ///
    /// [`ReadError`] if it cannot be read.
    pub fn of_file(path: impl AsRef<Path>) -> Result<Self, ReadError> {
        let mut source = Source::open(&path)?;
        match Self::of(source.start(Self::ENOUGH)?) {
            Self::Nmea => {
                let start = start::look(&mut Source::open(path)?, None, None)?;
                Ok(start.observing.map_or(Self::Nmea, Self::of_protocol))
            }
            content => Ok(content),
        }
    }

    /// Whether this is a receiver log: binary messages, observations and ephemerides among them.
    #[must_use]
    pub const fn is_log(&self) -> bool {
        matches!(self, Self::Ubx | Self::Rtcm3 | Self::Sbf)
    }

    const fn of_protocol(protocol: Protocol) -> Self {
        match protocol {
            Protocol::Ubx => Self::Ubx,
            Protocol::Rtcm3 => Self::Rtcm3,
            Protocol::Sbf => Self::Sbf,
        }
    }

    /// The protocol of the first messages of a log.
    pub(crate) const fn protocol(&self) -> Option<Protocol> {
        match self {
            Self::Ubx => Some(Protocol::Ubx),
            Self::Rtcm3 => Some(Protocol::Rtcm3),
            Self::Sbf => Some(Protocol::Sbf),
            _ => None,
        }
    }

    fn of_header_line(line: &[u8]) -> Option<Self> {
        let label = line.get(60..)?.trim_ascii();
        let kind = line[20..60].trim_ascii();
        Some(match (label, kind.first()) {
            (b"CRINEX VERS   / TYPE", _) => Self::CompactRinex,
            (b"ANTEX VERSION / SYST", _) => Self::Antex,
            (b"RINEX VERSION / TYPE", Some(b'O' | b'o')) => Self::RinexObservation,
            (b"RINEX VERSION / TYPE", Some(b'N' | b'G' | b'H' | b'L' | b'J')) => {
                Self::RinexNavigation
            }
            (b"RINEX VERSION / TYPE", _) => Self::RinexOther(first_words(kind)),
            _ => return None,
        })
    }
}

/// Whether it is UTF-8 without control characters; the last letter may be cut off.
fn is_readable(start: &[u8]) -> bool {
    let text = match core::str::from_utf8(start) {
        Ok(text) => text,
        Err(error) if error.error_len().is_none() => {
            core::str::from_utf8(&start[..error.valid_up_to()]).unwrap_or_default()
        }
        Err(_) => return false,
    };
    text.chars().all(|letter| matches!(letter, '\t' | '\r' | '\n') || !letter.is_control())
}

fn first_words(text: &[u8]) -> String {
    let line = text.split(|byte| *byte == b'\n').next().unwrap_or_default();
    let words: String = String::from_utf8_lossy(line).chars().take(40).collect();
    // A letter that the end of the part cuts off.
    words.trim_end_matches(char::REPLACEMENT_CHARACTER).trim().to_owned()
}

impl fmt::Display for Content {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Empty => "an empty file",
            Self::RinexObservation => "a RINEX observation file",
            Self::CompactRinex => "a compact RINEX observation file",
            Self::RinexNavigation => "a RINEX navigation file",
            Self::RinexOther(kind) => return write!(f, "a RINEX file of type {kind:?}"),
            Self::Sp3 => "an SP3 orbit file",
            Self::Antex => "an ANTEX antenna file",
            Self::Ubx => return Protocol::Ubx.fmt(f),
            Self::Rtcm3 => return Protocol::Rtcm3.fmt(f),
            Self::Sbf => return Protocol::Sbf.fmt(f),
            Self::Nmea => "NMEA sentences",
            Self::Html => "a web page (HTML)",
            Self::Text(words) => return write!(f, "text that begins with {words:?}"),
            Self::Noise => "bytes that are neither text nor a known format",
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_has_any_letters() {
        let words = "Kurs — heading, «тангаж», крен and some more of it\n";
        let text = Content::Text("Kurs — heading, «тангаж», крен and some".into());
        assert_eq!(Content::of(words.as_bytes()), text);
        // A letter that the end of the part that is read cuts off, and bytes that are none.
        assert_eq!(Content::of(&words.as_bytes()[..6]), Content::Text("Kurs".into()));
        assert_eq!(Content::of(b"Kurs \xff heading"), Content::Noise);
        assert_eq!(Content::of("Kurs \u{1}".as_bytes()), Content::Noise);
    }

    fn header(kind: &str, label: &str) -> Vec<u8> {
        format!("     3.04           {kind:<40}{label}\n").into_bytes()
    }

    #[test]
    fn contents_are_told_apart() {
        let version = "RINEX VERSION / TYPE";
        for (start, content) in [
            (Vec::new(), Content::Empty),
            (b"  \n\n".to_vec(), Content::Empty),
            (header("OBSERVATION DATA    M", version), Content::RinexObservation),
            (header("N: GNSS NAV DATA", version), Content::RinexNavigation),
            (header("GLONASS NAV DATA", version), Content::RinexNavigation),
            (
                header("METEOROLOGICAL DATA", version),
                Content::RinexOther("METEOROLOGICAL DATA".into()),
            ),
            (header("COMPACT RINEX FORMAT", "CRINEX VERS   / TYPE"), Content::CompactRinex),
            (b"#dP2023  2 19  0  0  0.00000000".to_vec(), Content::Sp3),
            (vec![0xb5, 0x62, 2, 0x15], Content::Ubx),
            (b"$GNGGA,,*00\r\n\xd3\0\0\x47\xea\x4b".to_vec(), Content::Rtcm3),
            (b"\0\xb5\xd3\x20\xb5\x62\x05\x01\x02\0\x06\x01\x0f\x38".to_vec(), Content::Ubx),
            (b"$GNGGA,,*00\r\n".to_vec(), Content::Nmea),
            (vec![0xd3, 0, 19, 0x3e], Content::Rtcm3),
            (b"\n\n#cP2023  2 19  0  0  0.00000000".to_vec(), Content::Sp3),
            (b"<!DOCTYPE html>".to_vec(), Content::Html),
            (b"time,heading\n1,2".to_vec(), Content::Text("time,heading".into())),
            (vec![0, 1, 2, 255], Content::Noise),
        ] {
            assert_eq!(Content::of(&start), content);
        }
    }
}
