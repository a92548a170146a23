//! The frame of a block's content: number, revision, time stamp; fields, least significant byte
//! first.

use kurs::time::GpsTime;

use crate::logs::LittleEndian;
use crate::logs::checksum::crc16_ccitt;

/// A block whose checksum is good.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Block<'a> {
    /// Bits 0 to 12 of the ID; the others are the revision, which only adds fields behind the
    /// known.
    pub(crate) number: u16,
    time_stamp: Option<(u32, u16)>,
    /// Everything behind the time stamp.
    pub(crate) content: &'a [u8],
}

/// Bits of the ID that are the number of the block.
const NUMBER: u16 = 0x1fff;

impl<'a> Block<'a> {
    /// Takes apart what stands behind the checksum: ID, length, time stamp, content.
    pub(crate) fn of(body: &'a [u8]) -> Self {
        let tow_ms = body.array(4).map(u32::from_le_bytes);
        Self {
            number: body.u16(0).unwrap_or(0) & NUMBER,
            time_stamp: tow_ms.zip(body.u16(8)),
            content: body.get(10..).unwrap_or_default(),
        }
    }

    /// The time stamp, by the receiver's own clock; `None` while the receiver does not know it.
    pub(crate) fn time(&self) -> Option<GpsTime> {
        let (tow_ms, week) = self.time_stamp?;
        // The values that stand for none are all ones: no millisecond of a week, and week 65535.
        let known = week != u16::MAX;
        GpsTime::from_week_tow(i32::from(week), f64::from(tow_ms) * 1e-3).filter(|_| known)
    }
}

/// A block with its framing, filled up to a multiple of four bytes.
pub(super) fn framed(number: u16, time: GpsTime, content: &[u8]) -> Option<Vec<u8>> {
    const HEADER: usize = 14;
    let length = (HEADER + content.len()).next_multiple_of(4);
    let within_week = time.as_nanoseconds().rem_euclid(WEEK_NS) / 1_000_000;
    let mut body = Vec::with_capacity(length);
    body.extend(number.to_le_bytes());
    body.extend(u16::try_from(length).ok()?.to_le_bytes());
    body.extend(u32::try_from(within_week).ok()?.to_le_bytes());
    body.extend(u16::try_from(time.week()).ok()?.to_le_bytes());
    body.extend(content);
    body.resize(length - 4, 0);
    let checksum = crc16_ccitt(&body).to_le_bytes();
    Some([b"$@".as_slice(), &checksum, &body].concat())
}

const WEEK_NS: i64 = 604_800_000_000_000;

/// What stands in a real number that is not there.
const NO_REAL: f64 = -2e10;

/// A block that is read or written field by field.
pub(super) trait BlockFields {
    /// The next bytes: reading returns them, writing puts `value` there.
    fn bytes<const N: usize>(&mut self, value: [u8; N]) -> [u8; N];

    /// Notes that a value does not fit; only writing can meet one.
    fn refuse(&mut self) {}

    /// An unsigned number of one byte.
    fn u1(&mut self, value: &mut u64) {
        let written = u8::try_from(*value).unwrap_or_else(|_| {
            self.refuse();
            0
        });
        *value = u64::from(u8::from_le_bytes(self.bytes(written.to_le_bytes())));
    }

    /// An unsigned number of two bytes.
    fn u2(&mut self, value: &mut u64) {
        let written = u16::try_from(*value).unwrap_or_else(|_| {
            self.refuse();
            0
        });
        *value = u64::from(u16::from_le_bytes(self.bytes(written.to_le_bytes())));
    }

    /// A signed number of one byte.
    fn i1(&mut self, value: &mut i32) {
        let written = i8::try_from(*value).unwrap_or_else(|_| {
            self.refuse();
            0
        });
        *value = i32::from(i8::from_le_bytes(self.bytes(written.to_le_bytes())));
    }

    /// A time in whole seconds.
    fn seconds(&mut self, value_s: &mut f64) {
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // saturates, is compared
        let written = *value_s as u32;
        if f64::from(written) != *value_s {
            self.refuse();
        }
        *value_s = f64::from(u32::from_le_bytes(self.bytes(written.to_le_bytes())));
    }

    /// A real number of four bytes in units of `unit`; zero where it is not there.
    fn f4(&mut self, unit: f64, value: &mut f64) {
        #[allow(clippy::cast_possible_truncation)] // a relative error of 6·10⁻⁸
        let written = (*value / unit) as f32;
        let read = f64::from(f32::from_le_bytes(self.bytes(written.to_le_bytes())));
        *value = if read <= NO_REAL { 0.0 } else { read * unit };
    }

    /// A real number of eight bytes in units of `unit`; zero where it is not there.
    fn f8(&mut self, unit: f64, value: &mut f64) {
        let read = f64::from_le_bytes(self.bytes((*value / unit).to_le_bytes()));
        *value = if read <= NO_REAL { 0.0 } else { read * unit };
    }

    /// Bytes that mean nothing here: written as zeros, read past.
    fn skip(&mut self, count: usize) {
        for _ in 0..count {
            self.bytes([0]);
        }
    }
}

/// Reads the fields of a block.
#[derive(Debug)]
pub(super) struct BlockReader<'a> {
    rest: &'a [u8],
    is_whole: bool,
}

impl<'a> BlockReader<'a> {
    pub(super) const fn new(content: &'a [u8]) -> Self {
        Self { rest: content, is_whole: true }
    }

    /// Whether the block was long enough for everything that was read.
    pub(super) const fn is_whole(&self) -> bool {
        self.is_whole
    }
}

impl BlockFields for BlockReader<'_> {
    fn bytes<const N: usize>(&mut self, _: [u8; N]) -> [u8; N] {
        let Some((first, rest)) = self.rest.split_first_chunk() else {
            self.is_whole = false;
            return [0; N];
        };
        self.rest = rest;
        *first
    }
}

/// Writes the fields of a block.
#[derive(Debug, Default)]
pub(super) struct BlockWriter {
    content: Vec<u8>,
    refused: bool,
}

impl BlockWriter {
    /// The content; `None` if a value did not fit.
    pub(super) fn finish(self) -> Option<Vec<u8>> {
        (!self.refused).then_some(self.content)
    }
}

impl BlockFields for BlockWriter {
    fn bytes<const N: usize>(&mut self, value: [u8; N]) -> [u8; N] {
        self.content.extend(value);
        value
    }

    fn refuse(&mut self) {
        self.refused = true;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn time_stamps_round_trip_and_unknown_ones_are_none() {
        let time = GpsTime::from_week_tow(2300, 604_799.95).unwrap();
        let framed = framed(4027, time, &[1, 2, 3]).unwrap();
        assert_eq!((framed.len(), &framed[..2]), (20, &b"$@"[..]));
        let block = Block::of(&framed[4..]);
        assert_eq!((block.number, block.time()), (4027, Some(time)));
        assert_eq!(block.content, [1, 2, 3, 0, 0, 0]);
        let mut unknown = framed[4..].to_vec();
        // Revision 2 in the highest bits of the ID.
        unknown[1] |= 2 << 5;
        assert_eq!(Block::of(&unknown).number, 4027);
        unknown[8..10].copy_from_slice(&[255, 255]);
        assert_eq!(Block::of(&unknown).time(), None);
        unknown[8..10].copy_from_slice(&[1, 1]);
        unknown[4..8].copy_from_slice(&[255; 4]);
        assert_eq!(Block::of(&unknown).time(), None);
        assert_eq!(Block::of(&[]).time(), None);
    }

    fn describe(f: &mut impl BlockFields, a: &mut u64, b: &mut i32, c: &mut f64, d: &mut f64) {
        f.u2(a);
        f.i1(b);
        f.skip(1);
        f.seconds(c);
        f.f4(2.0, d);
    }

    #[test]
    fn what_is_written_is_read_and_what_does_not_fit_is_refused() {
        for (a, b, c, d, fits) in [
            (65_535, -128, 4e9, 0.5, true),
            (65_536, 0, 0.0, 0.0, false),
            (0, 200, 0.0, 0.0, false),
            (0, 0, 0.5, 0.0, false),
        ] {
            let mut writer = BlockWriter::default();
            describe(&mut writer, &mut { a }, &mut { b }, &mut { c }, &mut { d });
            let content = writer.finish();
            assert_eq!(content.is_some(), fits);
            let Some(content) = content else { continue };
            let (mut e, mut f, mut g, mut h) = (0, 0, 0.0, 0.0);
            let mut reader = BlockReader::new(&content);
            describe(&mut reader, &mut e, &mut f, &mut g, &mut h);
            assert_eq!((e, f, g, h), (a, b, c, d));
            assert!(reader.is_whole());
            reader.skip(1);
            assert!(!reader.is_whole());
        }
        let mut missing = 1.0;
        BlockReader::new(&(-2e10f32).to_le_bytes()).f4(1e-9, &mut missing);
        assert_eq!(missing, 0.0);
    }
}
