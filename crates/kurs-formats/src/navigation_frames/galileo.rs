//! The messages of Galileo: I/NAV words 1 to 5 and F/NAV pages 1 to 4.
//!
//! Source: Galileo OS SIS ICD 2.1, 4.2 to 4.4 and 5.1.

use kurs::ephemeris::Message;
use kurs::signal::Satellite;

use super::kepler_message::KeplerMessage;
use crate::fields::{BitReader, BitWriter, Fields};
use crate::logs::checksum::crc24q;

/// 128 bits of an I/NAV word.
pub(crate) type Word = [u8; 16];
/// A page as it is sent: an even part of 120 bits, then an odd one, each in 16 bytes.
pub(crate) type Page = [u8; 32];
/// 214 bits of an F/NAV page.
pub(crate) type FnavPage = [u8; 27];

/// Type of an I/NAV word or an F/NAV page.
pub(crate) const fn number(first_byte: u8) -> u8 {
    first_byte >> 2
}

/// The I/NAV message of words 1 to 5; `None` if they are of different issues.
pub(crate) fn read_inav(satellite: Satellite, words: [&Word; 5]) -> Option<KeplerMessage> {
    let mut message = KeplerMessage::empty(satellite, Message::GalileoInav);
    let issues = core::array::from_fn::<u64, 5, _>(|index| {
        describe_inav(&mut BitReader::new(words[index]), &mut message, index as u64 + 1);
        message.issue
    });
    issues.iter().all(|issue| *issue == issues[0]).then_some(message)
}

/// The words of a message in the order in which a satellite sends them, with those of the time (0
/// and 6) that belong to a subframe; `None` if a value does not fit.
pub(crate) fn write_inav(message: &KeplerMessage, leap_seconds: i32) -> Option<[Word; 7]> {
    let mut message = message.clone();
    let mut words = [[0; 16]; 7];
    for (word, number) in words.iter_mut().zip([2, 4, 6, 1, 3, 5, 0]) {
        let mut writer = BitWriter::default();
        match number {
            0 | 6 => write_time(&mut writer, &mut message, number, leap_seconds),
            _ => describe_inav(&mut writer, &mut message, number),
        }
        word.copy_from_slice(&writer.finish()?);
    }
    Some(words)
}

/// Tables 42 to 46.
fn describe_inav(f: &mut impl Fields, m: &mut KeplerMessage, number: u64) {
    f.constant(6, number);
    if number <= 4 {
        f.unsigned(10, &mut m.issue);
    }
    match number {
        1 => {
            m.orbit_time(f);
            m.mean_anomaly(f);
            m.eccentricity(f);
            m.sqrt_axis(f);
            f.constant(2, 0);
        }
        2 => {
            m.node(f);
            m.inclination(f);
            m.perigee(f);
            m.inclination_rate(f);
            f.constant(2, 0);
        }
        3 => {
            m.node_rate(f);
            m.mean_motion_correction(f);
            m.latitude_harmonic(f, 0);
            m.latitude_harmonic(f, 1);
            m.radius_harmonic(f, 0);
            m.radius_harmonic(f, 1);
            f.unsigned(8, &mut m.accuracy);
        }
        4 => {
            f.constant(6, u64::from(m.elements.satellite.number));
            m.inclination_harmonic(f, 0);
            m.inclination_harmonic(f, 1);
            m.clock_time(f);
            m.clock_coefficient(f, 0);
            m.clock_coefficient(f, 1);
            m.clock_coefficient(f, 2);
            f.constant(2, 0);
        }
        _ => {
            f.constant(11 + 11 + 14 + 5, 0); // ionosphere
            m.group_delay(f, 0);
            m.group_delay(f, 1);
            health(f, m, &[(2, 7), (2, 1), (1, 6), (1, 0)]);
            f.unsigned(12, &mut m.week);
            f.scaled_unsigned(20, 1.0, &mut m.sent_s);
            f.constant(23, 0);
        }
    }
}

/// Tables 47 (word 6: UTC, here without a difference of fractions) and 50 (word 0).
fn write_time(f: &mut impl Fields, m: &mut KeplerMessage, number: u64, leap_seconds: i32) {
    f.constant(6, number);
    if number == 0 {
        f.constant(2, 0b10);
        f.constant(64, 0); // 88 spare bits
        f.constant(24, 0);
        f.unsigned(12, &mut m.week);
        f.scaled_unsigned(20, 1.0, &mut m.sent_s);
    } else {
        let [mut now, mut then] = [i64::from(leap_seconds); 2];
        f.constant(32 + 24, 0);
        f.signed(8, &mut now);
        f.constant(8 + 8, m.week & 0xff);
        f.constant(8 + 3, (m.week & 0xff) << 3 | 1);
        f.signed(8, &mut then);
        f.scaled_unsigned(20, 1.0, &mut m.sent_s);
        f.constant(3, 0);
    }
}

/// Parts of the health word of RINEX, each of some bits from a bit on: signal health and validity
/// of E1-B (bits 1 and 0), E5a (4, 3) and E5b (7, 6).
pub(crate) fn health(f: &mut impl Fields, m: &mut KeplerMessage, parts: &[(u32, u32)]) {
    for (width, from) in parts {
        let ones = (1 << width) - 1;
        let mut part = m.health >> from & ones;
        f.unsigned(*width, &mut part);
        m.health = m.health & !(ones << from) | part << from;
    }
}

/// The F/NAV message of pages 1 to 4; `None` if they are of different issues.
pub(crate) fn read_fnav(satellite: Satellite, pages: [&FnavPage; 4]) -> Option<KeplerMessage> {
    let mut message = KeplerMessage::empty(satellite, Message::GalileoFnav);
    let issues = core::array::from_fn::<u64, 4, _>(|index| {
        describe_fnav(&mut BitReader::new(pages[index]), &mut message, index as u64 + 1);
        message.issue
    });
    issues.iter().all(|issue| *issue == issues[0]).then_some(message)
}

/// Pages 1 to 4 of a message with their checksums, 244 bits each; `None` if a value does not fit.
pub(crate) fn write_fnav(message: &KeplerMessage) -> Option<[[u8; 31]; 4]> {
    let mut message = message.clone();
    let mut pages = [[0; 31]; 4];
    for (page, number) in pages.iter_mut().zip(1..) {
        let mut data = BitWriter::default();
        describe_fnav(&mut data, &mut message, number);
        let data = data.finish()?;
        page[..data.len()].copy_from_slice(&data);
        let [a, b, c] = fnav_checksum(page);
        let mut whole = BitWriter::default();
        let mut bits = BitReader::new(page);
        for width in FNAV_COVERED {
            whole.bits(width, bits.take(width));
        }
        whole.bits(24, u64::from(u32::from_be_bytes([0, a, b, c])));
        let whole = whole.finish()?;
        page[..whole.len()].copy_from_slice(&whole);
    }
    Some(pages)
}

/// Tables 35 to 38, as far as the ephemeris goes.
fn describe_fnav(f: &mut impl Fields, m: &mut KeplerMessage, number: u64) {
    f.constant(6, number);
    if number == 1 {
        f.constant(6, u64::from(m.elements.satellite.number));
    }
    f.unsigned(10, &mut m.issue);
    match number {
        1 => {
            m.clock_time(f);
            m.clock_coefficient(f, 0);
            m.clock_coefficient(f, 1);
            m.clock_coefficient(f, 2);
            f.unsigned(8, &mut m.accuracy);
            f.constant(11 + 11 + 14 + 5, 0); // ionosphere
            m.group_delay(f, 0);
            health(f, m, &[(2, 4)]);
            f.unsigned(12, &mut m.week);
            f.scaled_unsigned(20, 1.0, &mut m.sent_s);
            health(f, m, &[(1, 3)]);
        }
        2 => {
            m.mean_anomaly(f);
            m.node_rate(f);
            m.eccentricity(f);
            m.sqrt_axis(f);
            m.node(f);
            m.inclination_rate(f);
        }
        3 => {
            m.inclination(f);
            m.perigee(f);
            m.mean_motion_correction(f);
            m.latitude_harmonic(f, 0);
            m.latitude_harmonic(f, 1);
            m.radius_harmonic(f, 0);
            m.radius_harmonic(f, 1);
            m.orbit_time(f);
        }
        _ => {
            m.inclination_harmonic(f, 0);
            m.inclination_harmonic(f, 1);
        }
    }
}

/// Bits that the checksum of an I/NAV page covers: of the even part, of the odd one.
const COVERED: [u32; 2] = [114, 82];

/// The word in a page; `None` if the parts or the checksum are wrong, or if it is an alert page.
pub(crate) fn word_of_page(page: &Page) -> Option<Word> {
    let (mut even, mut odd) = (BitReader::new(&page[..16]), BitReader::new(&page[16..]));
    // Even or odd, nominal or alert.
    if (even.take(2), odd.take(2)) != (0b00, 0b10) {
        return None;
    }
    let mut word = BitWriter::default();
    word.bits(64, even.take(64));
    word.bits(48, even.take(48));
    word.bits(16, odd.take(16));
    odd.take(64);
    let checksum = odd.take(24);
    let [a, b, c] = page_checksum(page);
    let word: Word = word.finish()?.try_into().ok()?;
    (u64::from(u32::from_be_bytes([0, a, b, c])) == checksum).then_some(word)
}

/// The page that carries a word.
pub(crate) fn page_of_word(word: &Word) -> Page {
    let mut reader = BitReader::new(word);
    let mut even = BitWriter::default();
    even.bits(2, 0b00);
    even.bits(64, reader.take(64));
    even.bits(48, reader.take(48));
    let mut odd = BitWriter::default();
    odd.bits(2, 0b10);
    odd.bits(16, reader.take(16));
    let mut page = [0; 32];
    for (writer, at) in [(even, 0), (odd, 16)] {
        let bytes = writer.finish().unwrap_or_default();
        page[at..at + bytes.len()].copy_from_slice(&bytes);
    }
    let [a, b, c] = page_checksum(&page);
    let mut end = BitWriter::default();
    end.bits(2, 0b10);
    end.bits(16, BitReader::new(&word[14..]).take(16));
    end.bits(64, 0);
    end.bits(24, u64::from(u32::from_be_bytes([0, a, b, c])));
    let bytes = end.finish().unwrap_or_default();
    page[16..16 + bytes.len()].copy_from_slice(&bytes);
    page
}

/// CRC-24Q over both parts, with zeros before them up to whole bytes.
fn page_checksum(page: &Page) -> [u8; 3] {
    let mut bits = BitWriter::default();
    bits.bits(8 - COVERED.iter().sum::<u32>() % 8, 0);
    for (part, covered) in page.chunks_exact(16).zip(COVERED) {
        let mut reader = BitReader::new(part);
        for width in [64, covered - 64] {
            bits.bits(width, reader.take(width));
        }
    }
    crc24q(&bits.finish().unwrap_or_default())
}

/// The 214 bits that the checksum of an F/NAV page covers.
const FNAV_COVERED: [u32; 4] = [64, 64, 64, 22];

/// Whether the checksum of an F/NAV page of 244 bits, in 31 bytes, is right.
pub(crate) fn is_good_fnav(page: &[u8; 31]) -> bool {
    let mut reader = BitReader::new(page);
    FNAV_COVERED.iter().for_each(|width| {
        reader.take(*width);
    });
    let [a, b, c] = fnav_checksum(page);
    u64::from(u32::from_be_bytes([0, a, b, c])) == reader.take(24)
}

/// CRC-24Q with zeros before the page up to whole bytes.
fn fnav_checksum(page: &[u8; 31]) -> [u8; 3] {
    let mut reader = BitReader::new(page);
    let mut bits = BitWriter::default();
    bits.bits(2, 0);
    for width in FNAV_COVERED {
        bits.bits(width, reader.take(width));
    }
    crc24q(&bits.finish().unwrap_or_default())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pages_round_trip_and_one_wrong_bit_is_noticed() {
        let word: Word = core::array::from_fn(|i| u8::try_from(i * 13 + 5).unwrap());
        let page = page_of_word(&word);
        assert_eq!(word_of_page(&page), Some(word));
        for at in (0..114).chain(128..128 + 82 + 24) {
            let mut wrong = page;
            wrong[at / 8] ^= 0x80 >> (at % 8);
            assert_eq!(word_of_page(&wrong), None, "bit {at}");
        }
    }
}
