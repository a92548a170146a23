//! RXM-SFRBX: parts of navigation messages, in words of 32 bits.
//!
//! How u-blox puts the bits of each system into the words is in the interface description, 1.6.

use kurs::ephemeris::{Ephemeris, KeplerElements, Message};
use kurs::signal::{Satellite, System};
use kurs::time::GpsTime;

use super::signal::{glonass_channel, satellite, satellite_ids};
use crate::logs::LittleEndian;
use crate::navigation_frames::{
    Collector, GlonassMessage, KeplerMessage, Taken, beidou, galileo, glonass, gps_lnav,
};

/// Class and number of the message.
pub(crate) const RXM_SFRBX: [u8; 2] = [0x02, 0x13];
const HEADER: usize = 8;
/// Galileo E5a-I, which carries F/NAV; the other signals carry I/NAV.
const E5A: u8 = 3;

/// Takes the part of a navigation message in `payload`, received at about `near`.
pub(crate) fn take(payload: &[u8], near: GpsTime, collector: &mut Collector) -> Taken {
    let [system, number, signal, channel, count] = *payload.first_chunk()?;
    let satellite = satellite(system, number)?;
    let words = payload.get(HEADER..)?.chunks_exact(4).take(usize::from(count));
    let words: Vec<u32> =
        words.filter_map(|w| w.first_chunk()).map(|w| u32::from_le_bytes(*w)).collect();
    let bytes: Vec<u8> = words.iter().flat_map(|word| word.to_be_bytes()).collect();
    match satellite.system {
        System::Gps | System::Qzss if signal == 0 => {
            let subframe = gps_lnav::from_words(words.try_into().ok()?)?;
            collector.lnav(satellite, subframe, near)
        }
        System::Galileo if signal == E5A => {
            let page = bytes.first_chunk::<31>().filter(|page| galileo::is_good_fnav(page))?;
            collector.fnav(satellite, *page.first_chunk()?, near)
        }
        System::Galileo => {
            let word = galileo::word_of_page(bytes.first_chunk()?)?;
            collector.inav(satellite, word, near)
        }
        // B1C and B2a carry other messages, with other counts of words.
        System::BeiDou => {
            let subframe = beidou::from_words(words.try_into().ok()?);
            collector.beidou(satellite, subframe, near)
        }
        System::Glonass => {
            let string = *bytes.first_chunk()?;
            let channel = glonass_channel(channel)?;
            glonass::is_good(&string)
                .then(|| collector.glonass(satellite, channel, string, near))?
        }
        _ => None,
    }
}

/// The Klobuchar parameters of GPS, if `payload` is the page that has them.
pub(crate) fn klobuchar(payload: &[u8]) -> Option<kurs::ephemeris::Klobuchar> {
    const GPS_L1: [u8; 3] = [0, 0, 10];
    if [*payload.first()?, *payload.get(2)?, *payload.get(4)?] != GPS_L1 {
        return None;
    }
    let words = (0..10).map(|i| payload.array(HEADER + 4 * i).map(u32::from_le_bytes));
    let words: Option<Vec<u32>> = words.collect();
    gps_lnav::klobuchar(&gps_lnav::from_words(words?.try_into().ok()?)?)
}

/// The payloads of the messages that send an ephemeris from `sent` on; none if a value of it does
/// not fit into its field.
pub(crate) fn payloads(ephemeris: &Ephemeris, sent: GpsTime) -> Vec<Vec<u8>> {
    let parts = match ephemeris {
        Ephemeris::Kepler(kepler) => kepler_parts(kepler.elements(), sent),
        Ephemeris::Glonass(glonass) => {
            let message = GlonassMessage::of(glonass.elements(), sent);
            glonass::write(&message).map(|strings| strings.map(|s| words_of(&s, 4)).to_vec())
        }
    };
    let channel = match ephemeris {
        Ephemeris::Kepler(_) => 0,
        Ephemeris::Glonass(glonass) => (glonass.elements().channel + 7).cast_unsigned(),
    };
    let signal = match ephemeris.satellite() {
        Satellite { system: System::Galileo, .. } if is_fnav(ephemeris) => E5A,
        // E1-B; B1I of a GEO satellite.
        Satellite { system: System::Galileo, .. } => 1,
        geo if geo.is_beidou_geo() => 1,
        _ => 0,
    };
    let Some((system, number)) = satellite_ids(ephemeris.satellite()) else { return Vec::new() };
    let payload = |words: Vec<u32>| {
        let count = u8::try_from(words.len()).unwrap_or(u8::MAX);
        let mut payload = vec![system, number, signal, channel, count, 0, 2, 0];
        payload.extend(words.iter().flat_map(|word| word.to_le_bytes()));
        payload
    };
    parts.unwrap_or_default().into_iter().map(payload).collect()
}

/// The words of each part of a Keplerian message.
fn kepler_parts(elements: &KeplerElements, sent: GpsTime) -> Option<Vec<Vec<u32>>> {
    /// All messages begin at multiples of this, s.
    const FRAME_S: f64 = 30.0;
    let mut message = KeplerMessage::of(elements, sent);
    message.sent_s = (message.sent_s / FRAME_S).floor() * FRAME_S;
    Some(match elements.message {
        Message::Lnav => gps_lnav::write(&message)?.map(|s| gps_lnav::to_words(&s).to_vec()).into(),
        Message::GalileoInav => {
            let words = galileo::write_inav(&message, sent.leap_seconds())?;
            // The page has eight words; receivers send a ninth one with E1-B.
            words.map(|word| words_of(&galileo::page_of_word(&word), 9)).into()
        }
        Message::BeiDouD1 => {
            beidou::write_d1(&message)?.map(|s| beidou::to_words(&s).to_vec()).into()
        }
        Message::BeiDouD2 => {
            beidou::write_d2(&message)?.map(|s| beidou::to_words(&s).to_vec()).into()
        }
        Message::GalileoFnav => {
            galileo::write_fnav(&message)?.map(|page| words_of(&page, 8)).into()
        }
        Message::GlonassFdma => return None,
    })
}

fn is_fnav(ephemeris: &Ephemeris) -> bool {
    matches!(ephemeris, Ephemeris::Kepler(k) if k.elements().message == Message::GalileoFnav)
}

/// Bits from the first one on, in `count` words.
fn words_of(bytes: &[u8], count: usize) -> Vec<u32> {
    let byte = |at: usize| bytes.get(at).copied().unwrap_or(0);
    let word = |i: usize| u32::from_be_bytes(core::array::from_fn(|k| byte(4 * i + k)));
    (0..count).map(word).collect()
}
