//! Bit fields of broadcast messages, most significant bit first. A message is described once, as
//! the list of its fields, and the description serves reading and writing.

/// A message that is read or written field by field.
pub(crate) trait Fields {
    /// The next `width` bits (at most 64): reading returns them, writing puts `value` there.
    fn bits(&mut self, width: u32, value: u64) -> u64;

    /// Notes that a value does not fit; only writing can meet one.
    fn refuse(&mut self) {}

    /// An unsigned number.
    fn unsigned(&mut self, width: u32, value: &mut u64) {
        if *value >> (width - 1) > 1 {
            self.refuse();
        }
        *value = self.bits(width, *value & mask(width));
    }

    /// A number in two's complement.
    fn signed(&mut self, width: u32, value: &mut i64) {
        if sign_extended(value.cast_unsigned() & mask(width), width) != *value {
            self.refuse();
        }
        let bits = self.bits(width, value.cast_unsigned() & mask(width));
        *value = sign_extended(bits, width);
    }

    /// A number as a sign bit and its size.
    fn sign_and_size(&mut self, width: u32, value: &mut i64) {
        let size = value.unsigned_abs();
        if size > mask(width - 1) {
            self.refuse();
        }
        let sign = u64::from(*value < 0) << (width - 1);
        let bits = self.bits(width, sign | size & mask(width - 1));
        let size = (bits & mask(width - 1)).cast_signed();
        *value = if bits >> (width - 1) == 0 { size } else { -size };
    }

    /// A real number in units of `unit`, in two's complement.
    fn scaled(&mut self, width: u32, unit: f64, value: &mut f64) {
        let mut whole = units(*value, unit);
        self.signed(width, &mut whole);
        *value = whole as f64 * unit;
    }

    /// A real number that is not negative, in units of `unit`.
    fn scaled_unsigned(&mut self, width: u32, unit: f64, value: &mut f64) {
        let whole = units(*value, unit);
        if whole < 0 {
            self.refuse();
        }
        let mut whole = whole.unsigned_abs();
        self.unsigned(width, &mut whole);
        *value = whole as f64 * unit;
    }

    /// A real number in units of `unit`, as a sign bit and its size.
    fn scaled_sign_and_size(&mut self, width: u32, unit: f64, value: &mut f64) {
        let mut whole = units(*value, unit);
        self.sign_and_size(width, &mut whole);
        *value = whole as f64 * unit;
    }

    /// A time that must be a whole number of units: rounding it would move an orbit by kilometres.
    fn time(&mut self, width: u32, unit_s: f64, value_s: &mut f64) {
        if (*value_s / unit_s).fract() != 0.0 {
            self.refuse();
        }
        self.scaled_unsigned(width, unit_s, value_s);
    }

    /// Bits that mean nothing here: written as `value`, read past.
    fn constant(&mut self, width: u32, value: u64) {
        self.bits(width, value);
    }
}

/// 2 to the power of `exponent`: the units of broadcast messages.
pub(crate) fn two_to(exponent: i32) -> f64 {
    2f64.powi(exponent)
}

const fn mask(width: u32) -> u64 {
    u64::MAX >> (64 - width)
}

pub(crate) const fn sign_extended(bits: u64, width: u32) -> i64 {
    (bits << (64 - width)).cast_signed() >> (64 - width)
}

#[allow(clippy::cast_possible_truncation)] // `as` saturates, and what does not fit is refused
fn units(value: f64, unit: f64) -> i64 {
    (value / unit).round() as i64
}

/// Reads fields.
#[derive(Debug, Clone)]
pub(crate) struct BitReader<'a> {
    bytes: &'a [u8],
    /// Bits read.
    at: u64,
}

impl<'a> BitReader<'a> {
    /// Begins at the first bit.
    pub(crate) const fn new(bytes: &'a [u8]) -> Self {
        Self { bytes, at: 0 }
    }

    /// The next bits as a number.
    pub(crate) fn take(&mut self, width: u32) -> u64 {
        self.bits(width, 0)
    }

    /// Whether the message was long enough for everything that was read.
    pub(crate) const fn is_whole(&self) -> bool {
        self.at <= 8 * self.bytes.len() as u64
    }

    fn at_byte(&self) -> usize {
        usize::try_from(self.at / 8).unwrap_or(usize::MAX)
    }
}

impl Fields for BitReader<'_> {
    /// The first bits of the sixteen bytes from the current one on; zeros follow the message. Only
    /// the last 64 of more bits than that are given.
    fn bits(&mut self, width: u32, _: u64) -> u64 {
        let rest = self.bytes.get(self.at_byte()..).unwrap_or_default();
        let window = rest.first_chunk().copied().unwrap_or_else(|| {
            let mut window = [0; 16];
            window[..rest.len()].copy_from_slice(rest);
            window
        });
        let from_here = u128::from_be_bytes(window) << (self.at % 8);
        self.at += u64::from(width);
        #[allow(clippy::cast_possible_truncation)] // the low 64 bits
        let value = from_here.checked_shr(128u32.saturating_sub(width)).unwrap_or(0) as u64;
        value
    }
}

/// Writes fields.
#[derive(Debug, Clone, Default)]
pub(crate) struct BitWriter {
    bytes: Vec<u8>,
    length: usize,
    refused: bool,
}

impl BitWriter {
    /// The message, its last byte filled up with zeros; `None` if a value did not fit.
    pub(crate) fn finish(self) -> Option<Vec<u8>> {
        (!self.refused).then_some(self.bytes)
    }
}

impl Fields for BitWriter {
    fn bits(&mut self, width: u32, value: u64) -> u64 {
        for bit in (0..width).rev() {
            if self.length.is_multiple_of(8) {
                self.bytes.push(0);
            }
            let place = 7 - self.length % 8;
            if let Some(last) = self.bytes.last_mut() {
                *last |= u8::from(value >> bit & 1 == 1) << place;
            }
            self.length += 1;
        }
        value
    }

    fn refuse(&mut self) {
        self.refused = true;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn describe(f: &mut impl Fields, (a, b, c): &mut (u64, i64, i64), d: &mut f64) {
        f.constant(3, 0b101);
        f.unsigned(13, a);
        f.signed(22, b);
        f.sign_and_size(5, c);
        f.scaled(24, two_to(-43), d);
    }

    #[test]
    fn what_is_written_is_read() {
        for (numbers, real) in
            [((8191, -2_097_152, -15), -3e-7), ((0, 2_097_151, 15), 1e-12), ((77, -1, 0), 0.0)]
        {
            let (mut written, mut d) = (numbers, real);
            let mut writer = BitWriter::default();
            describe(&mut writer, &mut written, &mut d);
            let bytes = writer.finish().unwrap();
            assert_eq!(bytes.len(), 9);
            assert_eq!(bytes[0] >> 5, 0b101);
            let (mut read, mut e) = ((0, 0, 0), 0.0);
            let mut reader = BitReader::new(&bytes);
            describe(&mut reader, &mut read, &mut e);
            assert_eq!(read, numbers);
            assert!((e - real).abs() <= two_to(-44), "{e} {real}");
            assert!(reader.is_whole());
            reader.take(6);
            assert!(!reader.is_whole());
        }
    }

    #[test]
    fn what_does_not_fit_is_refused() {
        for (numbers, real) in
            [((8192, 0, 0), 0.0), ((0, 2_097_152, 0), 0.0), ((0, 0, -16), 0.0), ((0, 0, 0), 1e-6)]
        {
            let (mut numbers, mut real) = (numbers, real);
            let mut writer = BitWriter::default();
            describe(&mut writer, &mut numbers, &mut real);
            assert_eq!(writer.finish(), None);
        }
        let mut writer = BitWriter::default();
        writer.time(16, 16.0, &mut 7208.0);
        assert_eq!(writer.finish(), None);
    }
}
