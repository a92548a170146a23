//! Raw navigation pages: GPSRawCA, QZSRawL1CA, GALRawINAV, GALRawFNAV, BDSRaw, GLORawCA.
//!
//! Source: reference guide, 4.2.2. The bits are in words of 32, the first one received leading.

use kurs::ephemeris::{Ephemeris, KeplerElements, Message};
use kurs::signal::{Satellite, System};
use kurs::time::GpsTime;

use super::block::Block;
use super::measurements::CHANNEL_OFFSET;
use super::signal::{satellite, satellite_number};
use crate::fields::{BitReader, BitWriter, Fields};
use crate::logs::LittleEndian;
use crate::navigation_frames::{
    Collector, GlonassMessage, KeplerMessage, Taken, beidou, galileo, glonass, gps_lnav,
};

const GPS_RAW_CA: u16 = 4017;
const QZS_RAW_L1CA: u16 = 4066;
const GAL_RAW_INAV: u16 = 4023;
const GAL_RAW_FNAV: u16 = 4022;
const BDS_RAW: u16 = 4047;
const GLO_RAW_CA: u16 = 4026;

/// Bytes before the bits: satellite, whether the checksum fits, errors, signal, GLONASS channel,
/// tracking channel.
const HEADER: usize = 6;
/// Bits of the two parts of an I/NAV page; the six bits that end the first one are left out.
const EVEN_PART: u32 = 114;
const ODD_PART: u32 = 120;

/// A page as a block has it.
struct Page {
    satellite: Satellite,
    channel: i8,
    words: Vec<u32>,
}

impl Page {
    /// Reads the page; `None` if the receiver says that its checksum is wrong.
    fn read(content: &[u8]) -> Option<Self> {
        let [svid, is_good, _, _, channel, _] = content.array::<HEADER>(0)?;
        let words = content.get(HEADER..)?.chunks_exact(4);
        let words = words.filter_map(|w| w.first_chunk()).map(|w| u32::from_le_bytes(*w));
        let page = Self {
            satellite: satellite(svid)?,
            channel: channel.cast_signed().wrapping_sub(CHANNEL_OFFSET),
            words: words.collect(),
        };
        (is_good != 0).then_some(page)
    }

    fn first_words<const N: usize>(&self) -> Option<[u32; N]> {
        self.words.first_chunk().copied()
    }

    fn bytes(&self) -> Vec<u8> {
        self.words.iter().flat_map(|word| word.to_be_bytes()).collect()
    }
}

/// The subframe of GPS or QZSS in a block.
pub(super) fn lnav_subframe(block: &Block<'_>) -> Option<(Satellite, gps_lnav::Subframe)> {
    let system = match block.number {
        GPS_RAW_CA => System::Gps,
        QZS_RAW_L1CA => System::Qzss,
        _ => return None,
    };
    let page = Page::read(block.content).filter(|page| page.satellite.system == system)?;
    Some((page.satellite, gps_lnav::from_checked_words(page.first_words()?)))
}

/// Takes the part of a navigation message in a block, received at `time`.
pub(super) fn take(block: &Block<'_>, time: GpsTime, collector: &mut Collector) -> Taken {
    if let Some((satellite, subframe)) = lnav_subframe(block) {
        return collector.lnav(satellite, subframe, time);
    }
    let system = match block.number {
        GAL_RAW_INAV | GAL_RAW_FNAV => System::Galileo,
        BDS_RAW => System::BeiDou,
        GLO_RAW_CA => System::Glonass,
        _ => return None,
    };
    let page = Page::read(block.content).filter(|page| page.satellite.system == system)?;
    let satellite = page.satellite;
    match block.number {
        GAL_RAW_INAV => {
            let word = galileo::word_of_page(&inav_page(&page.bytes()))?;
            collector.inav(satellite, word, time)
        }
        GAL_RAW_FNAV => {
            let bytes = page.bytes();
            let whole = bytes.first_chunk::<31>().filter(|page| galileo::is_good_fnav(page))?;
            collector.fnav(satellite, *whole.first_chunk()?, time)
        }
        BDS_RAW => {
            let bytes = page.bytes();
            let mut bits = BitReader::new(&bytes);
            let words = [(); 10].map(|()| u32::try_from(bits.take(30)).unwrap_or(0));
            let subframe = bits.is_whole().then(|| beidou::from_words(words))?;
            collector.beidou(satellite, subframe, time)
        }
        _ => {
            let string = *page.bytes().first_chunk()?;
            glonass::is_good(&string)
                .then(|| collector.glonass(satellite, page.channel, string, time))?
        }
    }
}

/// The parts of a page, each from the beginning of 16 bytes.
fn inav_page(bytes: &[u8]) -> galileo::Page {
    let mut bits = BitReader::new(bytes);
    let mut page = [0; 32];
    for (part, width) in page.chunks_exact_mut(16).zip([EVEN_PART, ODD_PART]) {
        let mut writer = BitWriter::default();
        for width in [64, width - 64] {
            writer.bits(width, bits.take(width));
        }
        let written = writer.finish().unwrap_or_default();
        part[..written.len()].copy_from_slice(&written);
    }
    page
}

/// Undoes [`inav_page`].
fn inav_words(page: &galileo::Page) -> Vec<u32> {
    let mut writer = BitWriter::default();
    for (part, width) in page.chunks_exact(16).zip([EVEN_PART, ODD_PART]) {
        let mut bits = BitReader::new(part);
        for width in [64, width - 64] {
            writer.bits(width, bits.take(width));
        }
    }
    words_of(&writer.finish().unwrap_or_default(), 8)
}

/// Number and content of the blocks that carry the pages of an ephemeris from `sent` on; none if a
/// value of it does not fit into its field.
pub(super) fn blocks(ephemeris: &Ephemeris, sent: GpsTime) -> Vec<(u16, Vec<u8>)> {
    let channel = match ephemeris {
        Ephemeris::Kepler(_) => 0,
        Ephemeris::Glonass(glonass) => glonass.elements().channel,
    };
    let pages = match ephemeris {
        Ephemeris::Kepler(kepler) => kepler_pages(kepler.elements(), sent),
        Ephemeris::Glonass(glonass) => {
            let strings = glonass::write(&GlonassMessage::of(glonass.elements(), sent));
            strings.map(|s| (GLO_RAW_CA, GLO_L1CA, s.map(|s| words_of(&s, 3)).to_vec()))
        }
    };
    let numbered = satellite_number(ephemeris.satellite()).zip(pages);
    let Some((svid, (number, signal, pages))) = numbered else { return Vec::new() };
    let channel = (channel + CHANNEL_OFFSET).cast_unsigned();
    let content = |words: Vec<u32>| {
        let mut content = vec![svid, 1, 0, signal, channel, 0];
        content.extend(words.iter().flat_map(|word| word.to_le_bytes()));
        content
    };
    pages.into_iter().map(|words| (number, content(words))).collect()
}

/// Signals that carry the pages.
const GPS_L1CA: u8 = 0;
const QZS_L1CA: u8 = 6;
const GLO_L1CA: u8 = 8;
const GAL_E1: u8 = 17;
const GAL_E5A: u8 = 20;
const BDS_B1I: u8 = 28;

/// Block number, signal and the words of each page of a Keplerian message.
fn kepler_pages(elements: &KeplerElements, sent: GpsTime) -> Option<(u16, u8, Vec<Vec<u32>>)> {
    /// All messages begin at multiples of this, s.
    const FRAME_S: f64 = 30.0;
    let mut message = KeplerMessage::of(elements, sent);
    message.sent_s = (message.sent_s / FRAME_S).floor() * FRAME_S;
    let beidou = |subframe: &beidou::Subframe| {
        let mut writer = BitWriter::default();
        beidou::to_words(subframe).iter().for_each(|word| {
            writer.bits(30, u64::from(*word));
        });
        words_of(&writer.finish().unwrap_or_default(), 10)
    };
    Some(match elements.message {
        Message::Lnav => {
            // The two highest bits of a word are not used.
            let words = |s: &gps_lnav::Subframe| {
                gps_lnav::to_words(s).map(|word| word & 0x3fff_ffff).to_vec()
            };
            let pages = gps_lnav::write(&message)?.each_ref().map(words).to_vec();
            match elements.satellite.system {
                System::Qzss => (QZS_RAW_L1CA, QZS_L1CA, pages),
                _ => (GPS_RAW_CA, GPS_L1CA, pages),
            }
        }
        Message::GalileoInav => {
            let words = galileo::write_inav(&message, sent.leap_seconds())?;
            let pages = words.map(|word| inav_words(&galileo::page_of_word(&word)));
            (GAL_RAW_INAV, GAL_E1, pages.to_vec())
        }
        Message::BeiDouD1 => {
            (BDS_RAW, BDS_B1I, beidou::write_d1(&message)?.each_ref().map(beidou).to_vec())
        }
        Message::BeiDouD2 => {
            (BDS_RAW, BDS_B1I, beidou::write_d2(&message)?.each_ref().map(beidou).to_vec())
        }
        Message::GalileoFnav => {
            let pages = galileo::write_fnav(&message)?;
            (GAL_RAW_FNAV, GAL_E5A, pages.map(|page| words_of(&page, 8)).to_vec())
        }
        Message::GlonassFdma => return None,
    })
}

/// Bits from the first one on, in `count` words.
fn words_of(bytes: &[u8], count: usize) -> Vec<u32> {
    let byte = |at: usize| bytes.get(at).copied().unwrap_or(0);
    let word = |i: usize| u32::from_be_bytes(core::array::from_fn(|k| byte(4 * i + k)));
    (0..count).map(word).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pages_of_galileo_round_trip() {
        let word: galileo::Word = core::array::from_fn(|i| u8::try_from(i * 13 + 5).unwrap());
        let page = galileo::page_of_word(&word);
        let bytes: Vec<u8> = inav_words(&page).iter().flat_map(|w| w.to_be_bytes()).collect();
        assert_eq!(bytes.len(), 32);
        assert_eq!(galileo::word_of_page(&inav_page(&bytes)), Some(word));
    }
}
