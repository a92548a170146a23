//! The messages of BeiDou: D1 (MEO, IGSO) subframes 1 to 3, D2 (GEO) pages 1 to 10 of subframe 1.
//!
//! Source: BDS-SIS-ICD-B1I-3.0, 5.1.3, 5.2 (figures 5-6 to 5-8) and 5.3 (figures 5-11, 5-13).

use kurs::ephemeris::Message;
use kurs::signal::Satellite;

use super::kepler_message::KeplerMessage;
use crate::fields::{BitReader, BitWriter, Fields};

/// Ten words without parity: 26 bits, then nine times 22.
pub(crate) type Subframe = [u8; 28];

const PREAMBLE: u64 = 0b111_0001_0010;
/// Information bits of the words, and parity bits behind them.
const WIDTHS: [(u32, u32); 10] = {
    let mut widths = [(22, 8); 10];
    widths[0] = (26, 4);
    widths
};
/// The 186 information bits of a D1 subframe behind its head, in steps.
const D1_ORBIT: [u32; 3] = [64, 64, 58];
/// Information bits of a D2 page (figure 5-11) that belong to clock and orbit, from page 3 on: bits
/// to pass over behind the page number, then bits that count. What one page begins the next one
/// ends, so that all of them in a row are the message.
const D2_PAGES: [(u32, u32); 8] =
    [(38, 28), (0, 64), (0, 64), (0, 64), (0, 64), (0, 66), (0, 64), (0, 19)];

/// What begins every subframe: number and second of the week.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Head {
    /// 1 to 5.
    pub(crate) number: u8,
    /// D2: page, 1 to 10, if it is one of subframe 1.
    pub(crate) page: u8,
    pub(crate) second: u64,
}

/// Reads the head; `None` if the preamble is wrong.
pub(crate) fn head(subframe: &Subframe) -> Option<Head> {
    let mut reader = BitReader::new(subframe);
    let preamble = reader.take(11);
    reader.take(4);
    let [number, second, page] = [3, 20, 4].map(|width| reader.take(width));
    let (number, page) = (u8::try_from(number).ok()?, u8::try_from(page).ok()?);
    (preamble == PREAMBLE).then_some(Head { number, page, second })
}

fn write_head(f: &mut impl Fields, number: u64, second: u64) {
    f.constant(11, PREAMBLE);
    f.constant(4, 0);
    f.constant(3, number);
    f.constant(20, second);
}

/// The D1 message of subframes 1 to 3; `None` if they do not follow each other.
pub(crate) fn read_d1(satellite: Satellite, subframes: [&Subframe; 3]) -> Option<KeplerMessage> {
    let heads = subframes.map(head);
    let first = heads[0]?.second;
    let in_turn = |(head, k): (&Option<Head>, u64)| head.is_some_and(|h| h.second == first + 6 * k);
    if !heads.iter().zip(0..).all(in_turn) {
        return None;
    }
    let mut message = KeplerMessage::empty(satellite, Message::BeiDouD1);
    message.sent_s = first as f64;
    let [mut one, mut two, mut three] = subframes.map(|s| after_head(s));
    describe_d1_clock(&mut one, &mut message);
    // tₒₑ begins in subframe 2 and ends in subframe 3.
    let mut orbit = BitWriter::default();
    for reader in [&mut two, &mut three] {
        for width in D1_ORBIT {
            orbit.bits(width, reader.take(width));
        }
    }
    describe_d1_orbit(&mut BitReader::new(&orbit.finish()?), &mut message);
    Some(message)
}

/// The subframes 1 to 3 of a D1 message; `None` if a value does not fit.
pub(crate) fn write_d1(message: &KeplerMessage) -> Option<[Subframe; 3]> {
    let mut message = message.clone();
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // a second of the week
    let first = message.sent_s as u64;
    let mut orbit = BitWriter::default();
    describe_d1_orbit(&mut orbit, &mut message);
    let orbit = orbit.finish()?;
    let mut orbit = BitReader::new(&orbit);
    let mut subframes = [[0; 28]; 3];
    for (subframe, index) in subframes.iter_mut().zip(0..) {
        let mut writer = BitWriter::default();
        write_head(&mut writer, index + 1, first + 6 * index);
        let widths: &[u32] = match index {
            0 => {
                describe_d1_clock(&mut writer, &mut message);
                &[]
            }
            _ => &D1_ORBIT,
        };
        for width in widths {
            writer.bits(*width, orbit.take(*width));
        }
        let bytes = writer.finish()?;
        subframe[..bytes.len()].copy_from_slice(&bytes);
    }
    Some(subframes)
}

fn after_head(subframe: &Subframe) -> BitReader<'_> {
    let mut reader = BitReader::new(subframe);
    reader.take(38);
    reader
}

/// Subframe 1 (figure 5-6).
fn describe_d1_clock(f: &mut impl Fields, m: &mut KeplerMessage) {
    f.unsigned(1, &mut m.health);
    f.unsigned(5, &mut m.clock_issue);
    f.unsigned(4, &mut m.accuracy);
    f.unsigned(13, &mut m.week);
    m.clock_time(f);
    m.group_delay(f, 0);
    m.group_delay(f, 1);
    f.constant(64, 0); // ionosphere
    m.clock_coefficient(f, 2);
    m.clock_coefficient(f, 0);
    m.clock_coefficient(f, 1);
    f.unsigned(5, &mut m.issue);
}

/// Subframes 2 and 3 (figures 5-7, 5-8), without their heads.
fn describe_d1_orbit(f: &mut impl Fields, m: &mut KeplerMessage) {
    m.mean_motion_correction(f);
    m.latitude_harmonic(f, 0);
    m.mean_anomaly(f);
    m.eccentricity(f);
    m.latitude_harmonic(f, 1);
    m.radius_harmonic(f, 0);
    m.radius_harmonic(f, 1);
    m.sqrt_axis(f);
    m.orbit_time(f);
    m.inclination(f);
    m.inclination_harmonic(f, 0);
    m.node_rate(f);
    m.inclination_harmonic(f, 1);
    m.inclination_rate(f);
    m.node(f);
    m.perigee(f);
    f.constant(1, 0);
}

/// The D2 message of pages 1 to 10; `None` if they do not follow each other.
pub(crate) fn read_d2(satellite: Satellite, pages: [&Subframe; 10]) -> Option<KeplerMessage> {
    let heads = pages.map(head);
    let first = heads[0]?.second;
    let in_turn = |(head, k): (&Option<Head>, u64)| head.is_some_and(|h| h.second == first + 3 * k);
    if !heads.iter().zip(0..).all(in_turn) {
        return None;
    }
    let mut message = KeplerMessage::empty(satellite, Message::BeiDouD2);
    message.sent_s = first as f64;
    let mut one = after_head(pages[0]);
    one.take(4);
    describe_d2_first(&mut one, &mut message);
    let mut rest = BitWriter::default();
    for (page, (over, width)) in pages[2..].iter().zip(D2_PAGES) {
        let mut reader = after_head(page);
        reader.take(4 + over);
        for width in [width.min(64), width.saturating_sub(64)] {
            if width > 0 {
                rest.bits(width, reader.take(width));
            }
        }
    }
    describe_d2_rest(&mut BitReader::new(&rest.finish()?), &mut message);
    Some(message)
}

/// The pages 1 to 10 of a D2 message; `None` if a value does not fit.
pub(crate) fn write_d2(message: &KeplerMessage) -> Option<[Subframe; 10]> {
    let mut message = message.clone();
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // a second of the week
    let first = message.sent_s as u64;
    let mut rest = BitWriter::default();
    describe_d2_rest(&mut rest, &mut message);
    let rest = rest.finish()?;
    let mut rest = BitReader::new(&rest);
    let mut pages = [[0; 28]; 10];
    for (index, page) in pages.iter_mut().enumerate() {
        let mut writer = BitWriter::default();
        write_head(&mut writer, 1, first + 3 * index as u64);
        writer.bits(4, index as u64 + 1);
        match index {
            0 => describe_d2_first(&mut writer, &mut message),
            1 => {}
            _ => {
                let (over, width) = D2_PAGES[index - 2];
                for (width, with) in
                    [(over, false), (width.min(64), true), (width.saturating_sub(64), true)]
                {
                    if width > 0 {
                        let bits = if with { rest.take(width) } else { 0 };
                        writer.bits(width, bits);
                    }
                }
            }
        }
        let bytes = writer.finish()?;
        page[..bytes.len()].copy_from_slice(&bytes);
    }
    Some(pages)
}

/// Page 1 behind its number.
fn describe_d2_first(f: &mut impl Fields, m: &mut KeplerMessage) {
    f.unsigned(1, &mut m.health);
    f.unsigned(5, &mut m.clock_issue);
    f.unsigned(4, &mut m.accuracy);
    f.unsigned(13, &mut m.week);
    m.clock_time(f);
    m.group_delay(f, 0);
    m.group_delay(f, 1);
}

/// Pages 3 to 10 in a row.
fn describe_d2_rest(f: &mut impl Fields, m: &mut KeplerMessage) {
    m.clock_coefficient(f, 0);
    m.clock_coefficient(f, 1);
    m.clock_coefficient(f, 2);
    f.unsigned(5, &mut m.issue);
    m.mean_motion_correction(f);
    m.latitude_harmonic(f, 0);
    m.mean_anomaly(f);
    m.latitude_harmonic(f, 1);
    m.eccentricity(f);
    m.sqrt_axis(f);
    m.inclination_harmonic(f, 0);
    m.inclination_harmonic(f, 1);
    m.orbit_time(f);
    m.inclination(f);
    m.radius_harmonic(f, 0);
    m.radius_harmonic(f, 1);
    m.node_rate(f);
    m.node(f);
    m.perigee(f);
    m.inclination_rate(f);
}

/// Remainder of 11 information bits by X⁴ + X + 1: the parity of BCH(15, 11) (5.1.3).
fn parity(information: u64) -> u64 {
    (0..11).rev().fold(information << 4, |rest, bit| {
        if rest >> (bit + 4) & 1 == 1 { rest ^ 0b1_0011 << bit } else { rest }
    })
}

/// A subframe as ten words of 30 bits. The first 15 bits of the first word have no parity; the
/// others are pairs of code words, their information first, then their parity.
pub(crate) fn to_words(subframe: &Subframe) -> [u32; 10] {
    let mut reader = BitReader::new(subframe);
    WIDTHS.map(|(information, parities)| {
        let bits = reader.take(information);
        let [high, low] = [parity(bits >> 11 & 0x7ff), parity(bits & 0x7ff)];
        let check = if parities == 4 { low } else { high << 4 | low };
        u32::try_from(bits << parities | check).unwrap_or(0)
    })
}

/// The information bits of ten words. Their parity is not looked at: a receiver that hands out
/// words has corrected them, and may give parity bits in any order.
pub(crate) fn from_words(words: [u32; 10]) -> Subframe {
    let mut writer = BitWriter::default();
    for (word, (information, parities)) in words.iter().zip(WIDTHS) {
        writer.bits(information, u64::from(word & 0x3fff_ffff) >> parities);
    }
    let mut subframe = [0; 28];
    subframe.copy_from_slice(&writer.finish().unwrap_or_else(|| vec![0; 28]));
    subframe
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_round_trip() {
        let mut subframe: Subframe = core::array::from_fn(|i| u8::try_from(i * 9 + 3).unwrap());
        assert_eq!(from_words(to_words(&subframe)), subframe);
        subframe[27] = 255;
        assert_eq!(from_words(to_words(&subframe)), subframe);
    }

    /// Every code word is a multiple of the generator: its shifts by its own roots agree.
    #[test]
    fn parity_makes_multiples_of_the_generator() {
        for information in 0..2048 {
            let word = information << 4 | parity(information);
            let rest = (0..11).rev().fold(word, |rest: u64, bit| {
                if rest >> (bit + 4) & 1 == 1 { rest ^ 0b1_0011 << bit } else { rest }
            });
            assert_eq!(rest, 0);
        }
        assert_eq!(parity(1), 0b0011);
    }
}
