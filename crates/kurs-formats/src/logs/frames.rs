//! The messages of a receiver log, told from what stands between them by their checksums.
//!
//! Receivers write several protocols into one stream: u-blox ones RTCM 3 and NMEA between their own
//! messages, Septentrio ones replies in plain text. Every binary protocol is recognised wherever it
//! begins; text is passed over; anything else but a whole message is damage, and reading goes on at
//! the next byte that begins one.
//!
//! The framing is our own because the damage list wants byte offsets, and because one scan has to
//! know all protocols of a mixed log.

use core::fmt;
use core::str::FromStr;

use super::checksum::{crc16_ccitt, crc24q, fletcher};
use super::message::{MessageKind, Role};
use crate::damage::DamageLog;
use crate::source::{ReadError, Source};

/// A protocol of binary messages.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Protocol {
    /// u-blox: `b5 62 class id length₂ payload checksum₂` (u-blox F9 interface description, 3.2).
    Ubx,
    /// RTCM 3: `d3 length₂ payload crc₃` (RTCM 10403.3, section 4).
    Rtcm3,
    /// Septentrio: `$@ crc₂ id₂ length₂ payload` (mosaic-X5 reference guide, 4.1).
    Sbf,
}

impl fmt::Display for Protocol {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Ubx => "u-blox messages (UBX)",
            Self::Rtcm3 => "RTCM 3 messages",
            Self::Sbf => "Septentrio blocks (SBF)",
        })
    }
}

/// The text is not the name of a protocol.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{0:?} is no protocol of receiver logs: expected ubx, rtcm3 or sbf")]
pub struct UnknownProtocol(String);

impl FromStr for Protocol {
    type Err = UnknownProtocol;

    fn from_str(text: &str) -> Result<Self, UnknownProtocol> {
        match text {
            "ubx" => Ok(Self::Ubx),
            "rtcm3" => Ok(Self::Rtcm3),
            "sbf" => Ok(Self::Sbf),
            _ => Err(UnknownProtocol(text.to_owned())),
        }
    }
}

/// Longest payload of a u-blox message that is looked for: RXM-RAWX of 255 signals has 8176 bytes.
const UBX_PAYLOAD_MAX: usize = 8192;

/// What the bytes at a place are.
enum Judgement {
    /// A message with a good checksum, and its length in bytes, framing included.
    Message(Protocol, usize),
    /// To be decided when there are this many bytes.
    Undecided(usize),
    NoMessage,
}

/// A message with its framing taken off.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Frame<'a> {
    pub(crate) protocol: Protocol,
    /// UBX: class, id, length, payload. RTCM 3: the message. SBF: id, length, body.
    pub(crate) body: &'a [u8],
    /// Where the message begins in the (unpacked) file.
    pub(crate) offset: u64,
}

/// Finds the messages of a log one after the other.
#[derive(Debug, Default)]
pub(crate) struct FrameScanner {
    /// Bytes consumed so far.
    offset: u64,
    /// Length of the message given out last, still to be consumed.
    given: usize,
    skipped: Skipped,
}

/// Bytes in a row that belong to no message.
#[derive(Debug, Default)]
struct Skipped {
    start: u64,
    length: u64,
    /// Whether there is anything but text among them.
    binary: bool,
}

impl FrameScanner {
    /// The next message; `None` at the end.
    pub(crate) fn next<'a>(
        &mut self,
        source: &'a mut Source,
        damage: &mut DamageLog,
    ) -> Result<Option<Frame<'a>>, ReadError> {
        let given = core::mem::take(&mut self.given);
        self.consume(source, given);
        let (protocol, length) = loop {
            let mut wanted = 1;
            let judgement = loop {
                let bytes = source.start(wanted)?;
                if bytes.is_empty() {
                    self.note_skipped(damage);
                    if let Some(reason) = source.take_broken_off() {
                        damage.note(self.offset, reason);
                    }
                    return Ok(None);
                }
                match judge(bytes) {
                    // The log ends within it.
                    Judgement::Undecided(_) if bytes.len() < wanted => break Judgement::NoMessage,
                    Judgement::Undecided(length) => wanted = length,
                    decided => break decided,
                }
            };
            match judgement {
                Judgement::Message(protocol, length) => break (protocol, length),
                _ => self.skip(source)?,
            }
        };
        self.note_skipped(damage);
        self.given = length;
        let bytes = &source.start(length)?[..length];
        Ok(Some(Frame { protocol, body: body_of(protocol, bytes), offset: self.offset }))
    }

    /// The message that was given last will come again.
    pub(crate) const fn give_again(&mut self) {
        self.given = 0;
    }

    /// Goes on to the next byte that may begin a message.
    fn skip(&mut self, source: &mut Source) -> Result<(), ReadError> {
        let bytes = source.start(1)?;
        let next = memchr::memchr3(0xb5, 0xd3, b'$', &bytes[1..]);
        let length = next.map_or(bytes.len(), |next| next + 1);
        let is_text = |byte: &u8| matches!(byte, b'\t' | b'\r' | b'\n' | b' '..=b'~');
        let binary = !bytes[..length].iter().all(is_text);
        if self.skipped.length == 0 {
            self.skipped.start = self.offset;
        }
        self.skipped.length += length as u64;
        self.skipped.binary |= binary;
        self.consume(source, length);
        Ok(())
    }

    fn consume(&mut self, source: &mut Source, length: usize) {
        std::io::BufRead::consume(source, length);
        self.offset += length as u64;
    }

    /// Lists a run of skipped bytes that ends here, unless it was text.
    fn note_skipped(&mut self, damage: &mut DamageLog) {
        let skipped = core::mem::take(&mut self.skipped);
        if skipped.binary {
            damage.note_with(skipped.start, || {
                format!("{} bytes at this offset are no whole message, skipped", skipped.length)
                    .into()
            });
        }
    }
}

/// The protocol of the first whole message in `bytes`, of the first with observations if there is
/// one.
pub(crate) fn first_protocol(bytes: &[u8]) -> Option<Protocol> {
    let (mut at, mut first) = (0, None);
    while let Some(ahead) = memchr::memchr3(0xb5, 0xd3, b'$', &bytes[at..]) {
        at += ahead;
        let Judgement::Message(protocol, length) = judge(&bytes[at..]) else {
            at += 1;
            continue;
        };
        let frame = Frame { protocol, body: body_of(protocol, &bytes[at..at + length]), offset: 0 };
        if MessageKind::of(&frame).role() == Role::Observations {
            return Some(protocol);
        }
        first.get_or_insert(protocol);
        at += length;
    }
    first
}

/// A whole message with its framing taken off.
fn body_of(protocol: Protocol, message: &[u8]) -> &[u8] {
    match protocol {
        Protocol::Ubx => &message[2..message.len() - 2],
        Protocol::Rtcm3 => &message[3..message.len() - 3],
        Protocol::Sbf => &message[4..],
    }
}

/// Judges the message that may begin with the first byte.
fn judge(bytes: &[u8]) -> Judgement {
    let u16_at = |at: usize| Some(u16::from_le_bytes([*bytes.get(at)?, *bytes.get(at + 1)?]));
    let (protocol, length) = match *bytes {
        [0xb5] | [b'$'] => return Judgement::Undecided(2),
        [0xb5, 0x62, ..] => match u16_at(4).map(usize::from) {
            None => return Judgement::Undecided(6),
            Some(payload) if payload > UBX_PAYLOAD_MAX => return Judgement::NoMessage,
            Some(payload) => (Protocol::Ubx, payload + 8),
        },
        [0xd3] | [0xd3, _] => return Judgement::Undecided(3),
        // The six bits before the length are reserved and zero.
        [0xd3, high, low, ..] if high >> 2 == 0 => {
            (Protocol::Rtcm3, usize::from(u16::from_be_bytes([high, low])) + 6)
        }
        [b'$', b'@', ..] => match u16_at(6).map(usize::from) {
            None => return Judgement::Undecided(8),
            Some(length) if length < 8 || length % 4 != 0 => return Judgement::NoMessage,
            Some(length) => (Protocol::Sbf, length),
        },
        _ => return Judgement::NoMessage,
    };
    let Some(bytes) = bytes.get(..length) else { return Judgement::Undecided(length) };
    let good = match protocol {
        Protocol::Ubx => fletcher(&bytes[2..length - 2]) == bytes[length - 2..],
        Protocol::Rtcm3 => crc24q(&bytes[..length - 3]) == bytes[length - 3..],
        Protocol::Sbf => Some(crc16_ccitt(&bytes[4..])) == u16_at(2),
    };
    if good { Judgement::Message(protocol, length) } else { Judgement::NoMessage }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Cursor;

    /// UBX-ACK-ACK, RTCM 3 with an empty message, an SBF block of 8 bytes.
    fn messages() -> [Vec<u8>; 3] {
        let ubx = vec![0xb5, 0x62, 0x05, 0x01, 0x02, 0x00, 0x06, 0x01, 0x0f, 0x38];
        let rtcm = vec![0xd3, 0x00, 0x00, 0x47, 0xea, 0x4b];
        let body = [0x00, 0x10, 0x08, 0x00];
        let crc = crc16_ccitt(&body).to_le_bytes();
        [ubx, rtcm, [b"$@".as_slice(), &crc, &body].concat()]
    }

    fn read(bytes: &[u8]) -> (Vec<(Protocol, u64)>, DamageLog) {
        let mut source = Source::new(Cursor::new(bytes.to_vec()), "log").unwrap();
        let (mut scanner, mut damage) = (FrameScanner::default(), DamageLog::default());
        let mut found = Vec::new();
        while let Some(frame) = scanner.next(&mut source, &mut damage).unwrap() {
            found.push((frame.protocol, frame.offset));
        }
        (found, damage)
    }

    #[test]
    fn protocols_mix_and_text_is_no_damage() {
        let [ubx, rtcm, sbf] = messages();
        let text = b"$GNGGA,,,*56\r\n".to_vec();
        let (found, damage) = read(&[ubx, text, rtcm, sbf].concat());
        assert_eq!(found, [(Protocol::Ubx, 0), (Protocol::Rtcm3, 24), (Protocol::Sbf, 30)]);
        assert_eq!(damage.total(), 0);
    }

    #[test]
    fn damage_is_listed_by_offset_and_the_next_message_is_read() {
        let [ubx, rtcm, _] = messages();
        let mut broken = ubx.clone();
        broken[6] ^= 1;
        let (found, damage) = read(&[&rtcm[..], &broken, &ubx, &ubx[..7]].concat());
        assert_eq!(found, [(Protocol::Rtcm3, 0), (Protocol::Ubx, 16)]);
        let listed: Vec<u64> = damage.listed().iter().map(|d| d.line).collect();
        assert_eq!(listed, [6, 26]);
        assert!(damage.listed()[1].what.starts_with("7 bytes"), "{damage:?}");
    }

    /// A byte that begins a message may stand anywhere in noise, with any length behind it.
    #[test]
    fn messages_behind_a_false_start_are_found() {
        let [ubx, ..] = messages();
        for start in
            [&[0xd3, 0x03, 0xff][..], &[0xb5, 0x62, 2, 0x15, 0, 0x20], b"$@\0\0\0\0\xf8\xff"]
        {
            let (found, damage) = read(&[start, &ubx, &ubx].concat());
            assert_eq!(found.len(), 2, "{start:?}");
            assert_eq!(damage.total(), u64::from(start[0] != b'$' || start.len() > 2));
        }
    }
}
