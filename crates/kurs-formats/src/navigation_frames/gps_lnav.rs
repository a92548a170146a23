//! The legacy message of GPS and QZSS: subframes 1 to 3 of LNAV.
//!
//! Source: IS-GPS-200N, figures 20-1 and 20-2, tables 20-I to 20-III, parity 20.3.5.2;
//! IS-QZSS-PNT-005, 4.1.

use kurs::ephemeris::Message;
use kurs::signal::Satellite;

use super::kepler_message::KeplerMessage;
use crate::fields::{BitReader, BitWriter, Fields, two_to};

/// Ten words of 24 bits, without parity.
pub(crate) type Subframe = [u8; 30];

/// The first byte of every subframe.
const PREAMBLE: u64 = 0x8b;

/// Number of a subframe, 1 to 5; `None` if it does not begin as one.
pub(crate) fn number(subframe: &Subframe) -> Option<u8> {
    let mut reader = BitReader::new(subframe);
    let preamble = reader.take(8);
    reader.take(16 + 17 + 2);
    let number = u8::try_from(reader.take(3)).ok()?;
    (preamble == PREAMBLE && (1..=5).contains(&number)).then_some(number)
}

/// The message of three subframes; `None` if they are of different issues.
pub(crate) fn read(satellite: Satellite, subframes: [&Subframe; 3]) -> Option<KeplerMessage> {
    let mut message = KeplerMessage::empty(satellite, Message::Lnav);
    let mut issues = [0; 2];
    describe_1(&mut BitReader::new(subframes[0]), &mut message);
    describe_2(&mut BitReader::new(subframes[1]), &mut message);
    issues[0] = message.issue;
    describe_3(&mut BitReader::new(subframes[2]), &mut message);
    issues[1] = message.issue;
    (issues[0] == issues[1] && message.clock_issue & 0xff == message.issue).then_some(message)
}

/// The three subframes of a message; `None` if a value does not fit.
pub(crate) fn write(message: &KeplerMessage) -> Option<[Subframe; 3]> {
    let mut message = message.clone();
    message.issue &= 0xff;
    let mut subframes = [[0; 30]; 3];
    for (subframe, index) in subframes.iter_mut().zip(0..) {
        let mut writer = BitWriter::default();
        match index {
            0 => describe_1(&mut writer, &mut message),
            1 => describe_2(&mut writer, &mut message),
            _ => describe_3(&mut writer, &mut message),
        }
        subframe.copy_from_slice(&writer.finish()?);
        message.sent_s += 6.0;
    }
    Some(subframes)
}

/// Telemetry and handover words.
fn head(f: &mut impl Fields, message: &mut KeplerMessage, number: u64) {
    f.constant(8, PREAMBLE);
    f.constant(16, 0);
    // The count is that of the next subframe.
    let mut next = message.sent_s + 6.0;
    f.scaled_unsigned(17, 6.0, &mut next);
    message.sent_s = next - 6.0;
    f.constant(2, 0);
    f.constant(3, number);
    f.constant(2, 0);
}

fn describe_1(f: &mut impl Fields, m: &mut KeplerMessage) {
    head(f, m, 1);
    f.unsigned(10, &mut m.week);
    f.constant(2, 1); // P code on L2
    f.unsigned(4, &mut m.accuracy);
    f.unsigned(6, &mut m.health);
    let [mut issue_high, mut issue_low] = [m.clock_issue >> 8, m.clock_issue & 0xff];
    f.unsigned(2, &mut issue_high);
    f.constant(1, 0);
    f.constant(64, 0); // 87 reserved bits
    f.constant(23, 0);
    m.group_delay(f, 0);
    f.unsigned(8, &mut issue_low);
    m.clock_issue = issue_high << 8 | issue_low;
    m.clock_time(f);
    m.clock_coefficient(f, 2);
    m.clock_coefficient(f, 1);
    m.clock_coefficient(f, 0);
    f.constant(2, 0);
}

fn describe_2(f: &mut impl Fields, m: &mut KeplerMessage) {
    head(f, m, 2);
    f.unsigned(8, &mut m.issue);
    m.radius_harmonic(f, 1);
    m.mean_motion_correction(f);
    m.mean_anomaly(f);
    m.latitude_harmonic(f, 0);
    m.eccentricity(f);
    m.latitude_harmonic(f, 1);
    m.sqrt_axis(f);
    m.orbit_time(f);
    f.unsigned(1, &mut m.long_fit);
    f.constant(5, 0); // age of data offset
    f.constant(2, 0);
}

fn describe_3(f: &mut impl Fields, m: &mut KeplerMessage) {
    head(f, m, 3);
    m.inclination_harmonic(f, 0);
    m.node(f);
    m.inclination_harmonic(f, 1);
    m.inclination(f);
    m.radius_harmonic(f, 0);
    m.perigee(f);
    m.node_rate(f);
    f.unsigned(8, &mut m.issue);
    m.inclination_rate(f);
    f.constant(2, 0);
}

/// The Klobuchar parameters of subframe 4, page 18 (number 56), table 20-X.
pub(crate) fn klobuchar(subframe: &Subframe) -> Option<kurs::ephemeris::Klobuchar> {
    const PAGE_18: u64 = 56;
    let mut reader = BitReader::new(subframe);
    reader.take(48 + 2);
    if number(subframe) != Some(4) || reader.take(6) != PAGE_18 {
        return None;
    }
    let mut numbers = [-30, -27, -24, -24, 11, 14, 16, 16].map(|exponent| {
        let mut value = 0.0;
        reader.scaled(8, two_to(exponent), &mut value);
        value
    });
    let (alpha, beta) = numbers.split_first_chunk_mut::<4>()?;
    Some(kurs::ephemeris::Klobuchar { alpha: *alpha, beta: *beta.first_chunk()? })
}

/// Data bits (1 to 24) of a word that enter into each parity bit, and whether the last parity bit
/// (D30) or the one before it (D29) of the word before does.
const PARITY: [(u32, bool); 6] = [
    (data_bits(&[1, 2, 3, 5, 6, 10, 11, 12, 13, 14, 17, 18, 20, 23]), false),
    (data_bits(&[2, 3, 4, 6, 7, 11, 12, 13, 14, 15, 18, 19, 21, 24]), true),
    (data_bits(&[1, 3, 4, 5, 7, 8, 12, 13, 14, 15, 16, 19, 20, 22]), false),
    (data_bits(&[2, 4, 5, 6, 8, 9, 13, 14, 15, 16, 17, 20, 21, 23]), true),
    (data_bits(&[1, 3, 5, 6, 7, 9, 10, 14, 15, 16, 17, 18, 21, 22, 24]), true),
    (data_bits(&[3, 5, 6, 8, 9, 10, 11, 13, 15, 19, 22, 23, 24]), false),
];

const fn data_bits(numbers: &[u32]) -> u32 {
    let (mut mask, mut i) = (0, 0);
    while i < numbers.len() {
        mask |= 1 << (24 - numbers[i]);
        i += 1;
    }
    mask
}

/// Parity of 24 data bits after a word whose last two parity bits are `before`.
fn parity(data: u32, before: u32) -> u32 {
    PARITY.iter().fold(0, |parity, (mask, with_last)| {
        let of_before = if *with_last { before & 1 } else { before >> 1 };
        parity << 1 | ((data & mask).count_ones() & 1) ^ of_before
    })
}

/// Words 2 and 10 end with two bits that make the last two parity bits zero.
fn with_even_end(data: u32, before: u32) -> u32 {
    (0..4).map(|end| data | end).find(|data| parity(*data, before) & 3 == 0).unwrap_or(data)
}

/// A subframe as words of 32 bits the way u-blox hands them out: the last two parity bits of the
/// word before, 24 data bits, 6 parity bits; all inverted where the last parity bit before is one,
/// so that the data bits are right.
pub(crate) fn to_words(subframe: &Subframe) -> [u32; 10] {
    let mut before = 0;
    core::array::from_fn(|index| {
        let [a, b, c] = core::array::from_fn(|i| subframe[3 * index + i]);
        let data = u32::from_be_bytes([0, a, b, c]);
        let data = if matches!(index, 1 | 9) { with_even_end(data, before) } else { data };
        let parity = parity(data, before);
        let inversion = if before & 1 == 1 { 0xc000_003f } else { 0 };
        let word = (before << 30 | data << 6 | parity) ^ inversion;
        before = parity & 3;
        word
    })
}

/// Undoes [`to_words`]; `None` if a parity is wrong.
pub(crate) fn from_words(words: [u32; 10]) -> Option<Subframe> {
    let mut subframe = [0; 30];
    let mut before = 0;
    for (word, bytes) in words.iter().zip(subframe.chunks_exact_mut(3)) {
        let inversion = if before & 1 == 1 { 0x3f } else { 0 };
        let (data, sent) = (word >> 6 & 0xff_ffff, word & 0x3f ^ inversion);
        if parity(data, before) != sent {
            return None;
        }
        before = sent & 3;
        bytes.copy_from_slice(&data.to_be_bytes()[1..]);
    }
    Some(subframe)
}

/// The data bits of ten words, whose parity the receiver has checked.
pub(crate) fn from_checked_words(words: [u32; 10]) -> Subframe {
    let mut subframe = [0; 30];
    for (word, bytes) in words.iter().zip(subframe.chunks_exact_mut(3)) {
        bytes.copy_from_slice(&(word >> 6 & 0xff_ffff).to_be_bytes()[1..]);
    }
    subframe
}

#[cfg(test)]
mod tests {
    use super::*;
    use kurs::ephemeris::Ephemeris;
    use kurs::signal::System;
    use kurs::time::GpsTime;

    /// Subframes 1 to 3 as a u-blox receiver gave them out: the words are those of the tests of the
    /// crate `ublox` 0.10 (`tests/rxm_sfrbx/gps.rs`), which also names the decoded numbers.
    const WORDS: [[u32; 10]; 3] = [
        [
            0x22c1_3e1b,
            0x1527_c973,
            0x13e4_0004,
            0x104f_5d31,
            0x9744_e6d7,
            0x0775_5783,
            0x330c_80b5,
            0x9250_42a1,
            0x8000_1684,
            0x312c_3033,
        ],
        [
            0x22c1_3e1b,
            0x1527_ea1b,
            0x127f_f165,
            0x8c68_1f7c,
            0x0249_3415,
            0xbff8_811e,
            0x991b_8114,
            0x043e_686e,
            0x8334_7221,
            0x9042_9f7b,
        ],
        [
            0x22c1_3e1b,
            0x1528_0bdb,
            0x000a_ea34,
            0x033c_ffee,
            0xbfe5_c9eb,
            0x136f_b64e,
            0x86f4_ab2c,
            0x0671_eb44,
            0x3fea_f602,
            0x9245_5213,
        ],
    ];

    #[test]
    fn a_received_message_is_decoded() {
        let subframes = WORDS.map(|words| from_words(words).unwrap());
        let [first, second, third] = &subframes;
        let numbers = subframes.each_ref().map(number);
        assert_eq!(numbers, [Some(1), Some(2), Some(3)]);
        let message = read(Satellite::new(System::Gps, 1), [first, second, third]).unwrap();
        assert_eq!((message.week, message.orbit_s, message.clock_s), (318, 266_400.0, 266_400.0));
        let near = GpsTime::from_week_tow(2366, 259_200.0).unwrap();
        assert_eq!(message.date(near).unwrap().week(), 2366);
        let Ok(Ephemeris::Kepler(ephemeris)) = message.ephemeris(near) else { panic!() };
        let e = ephemeris.elements();
        for (found, expected, tolerance) in [
            (e.clock_bias_s, -4.524_961_113_930e-4, 1e-15),
            (e.clock_drift, 1.023_181_539_495e-11, 1e-22),
            (e.radius_harmonics_m[1], -1.843_75, 0.0),
            (e.sqrt_axis, 5_153.602_432_251, 1e-9),
            (e.mean_anomaly_rad, 9.768_415_465_951e-1 * PI, 1e-11),
            (e.latitude_harmonics_rad[0], -5.587_935_447_693e-8, 1e-19),
            (e.eccentricity, 8.578_718_174_249e-3, 1e-14),
            (e.latitude_harmonics_rad[1], 8.093_193_173_409e-6, 1e-17),
            (e.mean_motion_correction_radps, 1.444_277_586_415e-9 * PI, 1e-20),
            (e.inclination_harmonics_rad[0], 8.009_374_141_693e-8, 1e-19),
            (e.inclination_harmonics_rad[1], -1.955_777_406_693e-7, 1e-18),
            (e.radius_harmonics_m[0], 222.5625, 0.0),
            (e.inclination_rad, 3.070_601_043_291e-1 * PI, 1e-11),
            (e.inclination_rate_radps, 1.548_414_729_768e-10 * PI, 1e-21),
            (e.node_rad, -6.871_047_024_615e-1 * PI, 1e-11),
            (e.node_rate_radps, -2.449_269_231_874e-9 * PI, 1e-20),
            (e.perigee_rad, -6.554_632_573_389e-1 * PI, 1e-11),
        ] {
            assert!((found - expected).abs() <= tolerance, "{found} {expected}");
        }
    }

    const PI: f64 = core::f64::consts::PI;

    #[test]
    fn words_are_made_as_they_were_received() {
        for words in WORDS {
            assert_eq!(to_words(&from_words(words).unwrap()), words);
            for bit in 0..30 {
                let mut wrong = words;
                wrong[4] ^= 1 << bit;
                assert_eq!(from_words(wrong), None, "bit {bit}");
            }
        }
    }
}
