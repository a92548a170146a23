//! Fixed columns and the numbers in them.

use core::ops::Range;

/// Powers of ten that are exact as `f64`.
const POWERS_OF_TEN: [f64; 23] = [
    1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12, 1e13, 1e14, 1e15, 1e16,
    1e17, 1e18, 1e19, 1e20, 1e21, 1e22,
];
/// Decimal digits that an `f64` holds exactly.
const EXACT_DIGITS: usize = 15;

/// The part of `columns` (counted from 0) that the line has.
pub(crate) fn columns(line: &[u8], columns: Range<usize>) -> &[u8] {
    let end = columns.end.min(line.len());
    &line[columns.start.min(end)..end]
}

/// The columns as text without surrounding blanks; bytes that are not UTF-8 are replaced.
pub(crate) fn text(line: &[u8], range: Range<usize>) -> String {
    String::from_utf8_lossy(columns(line, range)).trim().to_owned()
}

/// The label of a header line.
pub(crate) fn label(line: &[u8]) -> &[u8] {
    columns(line, 60..80).trim_ascii()
}

/// An integer with blanks around it; `None` for anything else, also for nothing.
pub(crate) fn integer(field: &[u8]) -> Option<i32> {
    let trimmed = field.trim_ascii();
    let (negative, digits) = match trimmed {
        [b'-', digits @ ..] => (true, digits),
        [b'+', digits @ ..] => (false, digits),
        digits => (false, digits),
    };
    if digits.is_empty() || digits.len() > 9 || !digits.iter().all(u8::is_ascii_digit) {
        return None;
    }
    let magnitude = digits.iter().fold(0, |value, digit| value * 10 + i32::from(digit - b'0'));
    Some(if negative { -magnitude } else { magnitude })
}

/// A small integer with blanks around it.
pub(crate) fn small_integer(field: &[u8]) -> Option<u8> {
    integer(field).and_then(|value| u8::try_from(value).ok())
}

/// A decimal number with blanks around it, with or without fraction; `None` for anything else.
///
/// Up to 15 digits the result is the nearest double: both the digits as an integer and the power of
/// ten are exact, so the division rounds once.
pub(crate) fn decimal(field: &[u8]) -> Option<f64> {
    let trimmed = field.trim_ascii();
    let (negative, digits) = match trimmed {
        [b'-', digits @ ..] => (true, digits),
        [b'+', digits @ ..] => (false, digits),
        digits => (false, digits),
    };
    let (mut mantissa, mut count, mut decimals, mut point) = (0_u64, 0, 0, false);
    for &byte in digits {
        match byte {
            b'0'..=b'9' if count < EXACT_DIGITS => {
                mantissa = mantissa * 10 + u64::from(byte - b'0');
                count += usize::from(mantissa > 0);
                decimals += usize::from(point);
            }
            b'.' if !point => point = true,
            _ => {
                return core::str::from_utf8(trimmed)
                    .ok()?
                    .parse()
                    .ok()
                    .filter(|v: &f64| v.is_finite());
            }
        }
    }
    if digits.is_empty() || digits == b"." || decimals > EXACT_DIGITS {
        return None;
    }
    let magnitude = mantissa as f64 / POWERS_OF_TEN[decimals];
    Some(if negative { -magnitude } else { magnitude })
}

/// A number in the notation of FORTRAN (`1.5D-08`) with blanks around it; blank is zero, as the
/// navigation formats say; `None` for anything else.
pub(crate) fn exponential(field: &[u8]) -> Option<f64> {
    let text = field.trim_ascii();
    if text.is_empty() {
        return Some(0.0);
    }
    if let Some(value) = short_exponential(text) {
        return Some(value);
    }
    let mut digits = [0; 32];
    let digits = digits.get_mut(..text.len())?;
    digits.copy_from_slice(text);
    for digit in digits.iter_mut().filter(|digit| matches!(digit, b'D' | b'd')) {
        *digit = b'E';
    }
    let text = core::str::from_utf8(digits).ok()?;
    let value: f64 = match text.parse() {
        Ok(value) => value,
        Err(_) => without_letter(text)?,
    };
    value.is_finite().then_some(value)
}

/// A number of few digits and a small exponent, as nearly all are (`-0.123456789012D-08`): its
/// digits as an integer and the power of ten are exact, so the product or quotient rounds once.
/// `None` for anything else.
fn short_exponential(text: &[u8]) -> Option<f64> {
    let (mut mantissa, mut count, mut decimals) = (0_u64, 0, None);
    let negative = text[0] == b'-';
    let mut rest = text.strip_prefix(b"-").unwrap_or(text).iter();
    let has_exponent = loop {
        match rest.next() {
            Some(digit @ b'0'..=b'9') if count < EXACT_DIGITS => {
                mantissa = mantissa * 10 + u64::from(digit - b'0');
                count += 1;
                decimals = decimals.map(|decimals| decimals + 1);
            }
            Some(b'.') if decimals.is_none() => decimals = Some(0),
            Some(b'D' | b'd' | b'E' | b'e') => break true,
            None => break false,
            Some(_) => return None,
        }
    };
    let exponent: i32 = match has_exponent {
        true => core::str::from_utf8(rest.as_slice()).ok()?.parse().ok()?,
        false => 0,
    };
    let power = exponent.checked_sub(decimals.unwrap_or(0)).filter(|_| count > 0)?;
    let of_ten = POWERS_OF_TEN.get(power.unsigned_abs() as usize)?;
    let digits = mantissa as f64;
    let magnitude = if power < 0 { digits / of_ten } else { digits * of_ten };
    Some(if negative { -magnitude } else { magnitude })
}

/// FORTRAN leaves the letter out where the exponent has three digits (`0.5-269`).
fn without_letter(text: &str) -> Option<f64> {
    let at = text.rfind(['-', '+']).filter(|at| *at > 0)?;
    let (mantissa, exponent) = text.split_at(at);
    let is_exponent = exponent.len() == 4 && mantissa.ends_with(|c: char| c.is_ascii_digit());
    is_exponent.then(|| format!("{mantissa}E{exponent}").parse().ok()).flatten()
}

/// A field holds something else than it should, or a number in the wrong columns.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Damaged;

/// The thousandths in the 14 columns of an observation (F14.3); `None` if they are blank.
///
/// The point must stand in its column and the field must be whole: a number that lost or gained a
/// digit, or that a cut file ends in, is damage and not another number.
pub(crate) fn f14_3(field: &[u8]) -> Result<Option<i64>, Damaged> {
    let Ok(field) = <&[u8; 14]>::try_from(field) else {
        return if field.trim_ascii().is_empty() { Ok(None) } else { Err(Damaged) };
    };
    let [a, b, c, d, e, f, g, h, i, j, k, l, m, n] = *field;
    let first = u64::from_le_bytes([a, b, c, d, e, f, g, h]);
    let last = u64::from_le_bytes([g, h, i, j, k, l, m, n]);
    // Blanks before the number
    let mut start = ((first ^ BLANKS).trailing_zeros() / 8) as usize;
    if start == 8 {
        start += field[8..].iter().take_while(|byte| **byte == b' ').count();
        if start == 14 {
            return Ok(None);
        }
    }
    let negative = field[start] == b'-';
    start += usize::from(negative);
    if field[10] != b'.' || start > 10 {
        return Err(Damaged);
    }
    // Columns 0 to 7, and 8, 9, 11, 12, 13 behind three zeros
    let upper = zeros_before(start, first);
    let lower = (((last >> 16) & 0xffff) | ((last >> 40) << 16)) << 24;
    let lower = zeros_before(3 + start.saturating_sub(8), lower);
    let thousandths = eight_digits(upper)? * 100_000 + eight_digits(lower)?;
    Ok(Some(if negative { -thousandths } else { thousandths }))
}

/// Eight blanks, and eight zeros.
const BLANKS: u64 = u64::from_le_bytes([b' '; 8]);
const ZEROS: u64 = u64::from_le_bytes([b'0'; 8]);
/// In each byte: the upper half, six, the highest bit.
const UPPER_HALVES: u64 = u64::from_le_bytes([0xf0; 8]);
const SIXES: u64 = u64::from_le_bytes([6; 8]);
const HIGH_BITS: u64 = u64::from_le_bytes([0x80; 8]);

/// Eight characters of which the first `count` become zeros.
fn zeros_before(count: usize, characters: u64) -> u64 {
    let kept = if count < 8 { u64::MAX << (8 * count) } else { 0 };
    (characters & kept) | (ZEROS & !kept)
}

/// The number that eight digits make, the first character in the lowest byte: neighbours join to
/// numbers of two, four and eight digits.
fn eight_digits(characters: u64) -> Result<i64, Damaged> {
    let digits = characters ^ ZEROS;
    // The upper half of a digit's byte is zero, also after six are added.
    if (digits | ((digits & !HIGH_BITS) + SIXES)) & UPPER_HALVES != 0 {
        return Err(Damaged);
    }
    let of_two = (digits * 10 + (digits >> 8)) & 0x00ff_00ff_00ff_00ff;
    let of_four = (of_two * 100 + (of_two >> 16)) & 0x0000_ffff_0000_ffff;
    let of_eight = (of_four * 10_000 + (of_four >> 32)) & 0xffff_ffff;
    Ok(of_eight.cast_signed())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn integers() {
        assert_eq!(integer(b"  12 "), Some(12));
        assert_eq!(integer(b"-7"), Some(-7));
        for wrong in [&b""[..], b"   ", b"1 2", b"x", b"1234567890", b"-", b"\xff"] {
            assert_eq!(integer(wrong), None);
        }
    }

    #[test]
    fn decimals() {
        assert_eq!(decimal(b" 0.0000000"), Some(0.0));
        assert_eq!(decimal(b" 30"), Some(30.0));
        assert_eq!(decimal(b" -.5 "), Some(-0.5));
        assert_eq!(decimal(b"30."), Some(30.0));
        assert_eq!(decimal(b"-0.123456789012345678"), Some(-0.123_456_789_012_345_68));
        for wrong in [&b""[..], b".", b"-", b"1.2.3", b"inf", b"nan", b"1e999", b"1 2"] {
            assert_eq!(decimal(wrong), None, "{wrong:?}");
        }
    }

    #[test]
    fn exponentials() {
        assert_eq!(exponential(b" 1.5D-08"), Some(1.5e-8));
        assert_eq!(exponential(b"-.999999999999e+09"), Some(-0.999_999_999_999e9));
        assert_eq!(exponential(b" 0.499063314480-269"), Some(0.499_063_314_48e-269));
        assert_eq!(exponential(b"   "), Some(0.0));
        assert_eq!(exponential(b""), Some(0.0));
        for wrong in [
            &b"1.5 D-08"[..],
            b"1.5-08",
            b"1-2-345x",
            b"nan",
            b"INF",
            b"1e999",
            b"x",
            b"\xff",
            &[b'1'; 40],
        ] {
            assert_eq!(exponential(wrong), None, "{wrong:?}");
        }
    }

    #[test]
    fn observations_keep_their_columns() {
        assert_eq!(f14_3(b"  22907163.076"), Ok(Some(22_907_163_076)));
        assert_eq!(f14_3(b" -16928881.668"), Ok(Some(-16_928_881_668)));
        assert_eq!(f14_3(b"          .500"), Ok(Some(500)));
        for blank in [&b"              "[..], b"", b"   "] {
            assert_eq!(f14_3(blank), Ok(None));
        }
        for zero in [&b"         0.000"[..], b"          .000", b"        -0.000"] {
            assert_eq!(f14_3(zero), Ok(Some(0)));
        }
        for damaged in [
            &b"  2290716.0763"[..],
            b"  22907163",
            b"  22907163.0x6",
            b"  229 7163.076",
            b"             -",
        ] {
            assert_eq!(f14_3(damaged), Err(Damaged), "{damaged:?}");
        }
    }

    proptest! {
        /// The short way is as exact as the long one.
        #[test]
        fn short_numbers_are_the_nearest_doubles(
            digits in -999_999_999_999_999_i64..1_000_000_000_000_000,
            decimals in 0_usize..15,
            exponent in -40_i32..40,
        ) {
            let width = decimals + 2;
            let padded = format!("{:0width$}", digits.abs());
            let (whole, fraction) = padded.split_at(padded.len() - decimals);
            let sign = if digits < 0 { "-" } else { "" };
            let written = format!("{sign}{whole}.{fraction}E{exponent:+03}");
            let fortran = written.replace('E', "D");
            prop_assert_eq!(exponential(fortran.as_bytes()), written.parse().ok());
        }

        #[test]
        fn observations_are_read_as_written(thousandths in -999_999_999_999_i64..9_999_999_999_999) {
            let sign = if thousandths < 0 { "-" } else { "" };
            let magnitude = thousandths.unsigned_abs();
            let written = format!("{sign}{}.{:03}", magnitude / 1000, magnitude % 1000);
            prop_assert_eq!(f14_3(format!("{written:>14}").as_bytes()), Ok(Some(thousandths)));
            // The quotient is the nearest double, as parsing the text gives it.
            let value = written.parse::<f64>().unwrap();
            prop_assert_eq!(thousandths as f64 / 1000.0, value);
            prop_assert_eq!(decimal(written.as_bytes()), Some(value));
        }
    }
}
