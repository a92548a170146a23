//! What receivers state about foreign signals: UBX MON-RF, SEC-SIG and NAV-STATUS, SBF RFStatus.
//!
//! Sources: u-blox F9 HPG 1.32 interface description, UBX-22008968, 3.14.10 (MON-RF), 3.15.13
//! (NAV-STATUS); F9 HPG L1L5 1.40, UBX-23006991 (SEC-SIG, both versions); Septentrio mosaic-X5
//! reference guide, firmware 4.14 (RFStatus). The layouts were laid against those of pyubx2 1.4.0
//! and pysbf2 1.0.7.
//!
//! A statement belongs to the epochs behind it in the stream, until the next one of its kind or
//! until it is old.

use kurs::observation::interference::{Interference, Jamming, Spoofing};
use kurs::time::GpsTime;

use super::LittleEndian;
use super::frames::{Frame, Protocol};
use crate::damage::DamageLog;
use crate::sbf::block::Block;

const NAV_STATUS: [u8; 2] = [0x01, 0x03];
const MON_RF: [u8; 2] = [0x0a, 0x38];
const SEC_SIG: [u8; 2] = [0x27, 0x09];
const RF_STATUS: u16 = 4092;
/// The kinds of messages, which replace each other's statements only within a kind.
const KINDS: usize = 4;

/// Receivers repeat their statements every second or few; an older one says nothing any more, s.
const MAX_AGE_S: f64 = 10.0;
/// `agcCnt` at full gain.
const FULL_GAIN: f64 = 8191.0;

/// The newest statement of each kind, and the first epoch behind it.
#[derive(Debug, Default)]
pub(super) struct Statements([Option<(Interference, Option<GpsTime>)>; KINDS]);

impl Statements {
    /// Takes a message, if it is one of these; `antenna` is that of the stream, where several are
    /// in it.
    pub(super) fn take(&mut self, frame: &Frame<'_>, antenna: Option<u16>, damage: &mut DamageLog) {
        let (kind, name, stated) = match frame.protocol {
            Protocol::Ubx => {
                let payload = frame.body.get(4..).unwrap_or_default();
                match [frame.body[0], frame.body[1]] {
                    NAV_STATUS => (0, "NAV-STATUS", nav_status(payload)),
                    MON_RF => (1, "MON-RF", mon_rf(payload)),
                    SEC_SIG => (2, "SEC-SIG", sec_sig(payload)),
                    _ => return,
                }
            }
            Protocol::Sbf => {
                let block = Block::of(frame.body);
                if block.number != RF_STATUS {
                    return;
                }
                (3, "RFStatus", rf_status(block.content, antenna))
            }
            Protocol::Rtcm3 => return,
        };
        match stated {
            Some(stated) => self.0[kind] = Some((stated, None)),
            None => damage.note(frame.offset, format!("{name} is shorter than it should be")),
        }
    }

    /// What counts for an epoch: of several kinds the worst.
    pub(super) fn at(&mut self, time: GpsTime) -> Interference {
        let mut all = Interference::default();
        for statement in &mut self.0 {
            let Some((stated, since)) = statement else { continue };
            if (time - *since.get_or_insert(time)).abs() > MAX_AGE_S {
                *statement = None;
                continue;
            }
            all.spoofing = all.spoofing.max(stated.spoofing);
            all.jamming = all.jamming.max(stated.jamming);
            all.continuous_wave = all.continuous_wave.or(stated.continuous_wave);
            all.gain = all.gain.or(stated.gain);
        }
        all
    }
}

/// `spoofDetState` in bits 3 and 4 of `flags2`.
fn nav_status(payload: &[u8]) -> Option<Interference> {
    const LENGTH: usize = 16;
    let flags = *payload.get(7).filter(|_| payload.len() >= LENGTH)?;
    Some(Interference { spoofing: spoofing(flags >> 3 & 3), ..Interference::default() })
}

/// A block for every band: `jammingState`, `agcCnt`, `jamInd`.
fn mon_rf(payload: &[u8]) -> Option<Interference> {
    const HEADER: usize = 4;
    const BLOCK: usize = 24;
    let count = usize::from(*payload.get(1)?);
    let blocks = payload.get(HEADER..HEADER + count * BLOCK)?.chunks_exact(BLOCK);
    let waves = blocks.clone().map(|block| f64::from(block[16]) / f64::from(u8::MAX));
    let gains = blocks.clone().filter_map(|block| Some(f64::from(block.u16(14)?) / FULL_GAIN));
    Some(Interference {
        jamming: blocks.map(|block| jamming(block[1] & 3)).max().unwrap_or_default(),
        spoofing: Spoofing::Unknown,
        continuous_wave: waves.reduce(f64::max),
        gain: gains.map(|gain| gain.min(1.0)).reduce(f64::min),
    })
}

/// Version 1 has a byte of flags for each of the two, version 2 one for both.
fn sec_sig(payload: &[u8]) -> Option<Interference> {
    const LENGTH_1: usize = 12;
    const LENGTH_2: usize = 4;
    let (jam, spoof) = match payload.first()? {
        1 => (*payload.get(4)?, *payload.get(8).filter(|_| payload.len() >= LENGTH_1)?),
        2 => {
            let both = *payload.get(1).filter(|_| payload.len() >= LENGTH_2)?;
            (both, both >> 3)
        }
        // Another version may mean anything.
        _ => return Some(Interference::default()),
    };
    Some(Interference {
        jamming: jamming(jam >> 1 & 3),
        spoofing: spoofing(spoof >> 1 & 7),
        ..Interference::default()
    })
}

/// Flags for the receiver, then a block for every disturbed band with its antenna.
fn rf_status(content: &[u8], antenna: Option<u16>) -> Option<Interference> {
    const HEADER: usize = 6;
    const INFO: usize = 6;
    /// Signals or messages that are not authentic.
    const MISLEADING: u8 = 0b11;
    let (count, length) = (usize::from(*content.first()?), usize::from(*content.get(1)?));
    let flags = *content.get(2)?;
    if count > 0 && length <= INFO {
        return None;
    }
    let bands = content.get(HEADER..)?.get(..count * length)?;
    let mut worst = Jamming::None;
    for band in bands.chunks_exact(length.max(1)) {
        let info = band[INFO];
        if antenna.is_some_and(|antenna| antenna != u16::from(info >> 6)) {
            continue;
        }
        worst = worst.max(match info & 0xf {
            2 => Jamming::Warning,
            8 => Jamming::Critical,
            // A filter that the user has set, or something unknown.
            _ => Jamming::None,
        });
    }
    let is_misled = flags & MISLEADING != 0;
    let spoofing = if is_misled { Spoofing::Stated } else { Spoofing::None };
    Some(Interference { jamming: worst, spoofing, ..Interference::default() })
}

/// The states of u-blox: unknown, none, indicated, and several or affirmed.
const fn spoofing(state: u8) -> Spoofing {
    match state {
        1 => Spoofing::None,
        2 | 3 => Spoofing::Stated,
        _ => Spoofing::Unknown,
    }
}

const fn jamming(state: u8) -> Jamming {
    match state {
        1 => Jamming::None,
        2 => Jamming::Warning,
        3 => Jamming::Critical,
        _ => Jamming::Unknown,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ubx(kind: [u8; 2], payload: &[u8]) -> Vec<u8> {
        let length = u16::try_from(payload.len()).unwrap().to_le_bytes();
        [&kind, &length, payload].concat()
    }

    /// ID, length, time of week, week, content.
    fn sbf(content: &[u8]) -> Vec<u8> {
        let number = RF_STATUS.to_le_bytes();
        [&number[..], &[0, 0], &1000_u32.to_le_bytes(), &2300_u16.to_le_bytes(), content].concat()
    }

    fn at(second: f64) -> GpsTime {
        GpsTime::from_week_tow(2300, 1000.0 + second).unwrap()
    }

    /// What one message states, and the number of damaged ones.
    fn stated(protocol: Protocol, body: &[u8], antenna: Option<u16>) -> (Interference, u64) {
        let (mut statements, mut damage) = (Statements::default(), DamageLog::default());
        statements.take(&Frame { protocol, body, offset: 0 }, antenna, &mut damage);
        (statements.at(at(0.0)), damage.total())
    }

    fn mon_rf_message() -> Vec<u8> {
        let mut payload = vec![0; 4 + 2 * 24];
        payload[1] = 2;
        (payload[4 + 1], payload[4 + 16]) = (1, 51);
        payload[4 + 14..4 + 16].copy_from_slice(&8191_u16.to_le_bytes());
        (payload[28 + 1], payload[28 + 16]) = (2, 255);
        payload[28 + 14..28 + 16].copy_from_slice(&4096_u16.to_le_bytes());
        ubx(MON_RF, &payload)
    }

    #[test]
    fn messages_of_u_blox() {
        let (of_bands, damage) = stated(Protocol::Ubx, &mon_rf_message(), None);
        assert_eq!(damage, 0);
        assert_eq!((of_bands.jamming, of_bands.spoofing), (Jamming::Warning, Spoofing::Unknown));
        assert_eq!(of_bands.continuous_wave, Some(1.0));
        assert_eq!(of_bands.gain, Some(4096.0 / 8191.0));

        for (state, spoofing) in
            [Spoofing::Unknown, Spoofing::None, Spoofing::Stated, Spoofing::Stated]
                .into_iter()
                .enumerate()
        {
            let state = u8::try_from(state).unwrap();
            let mut status = [0; 16];
            status[7] = 0b1100_0011 | state << 3;
            let (found, _) = stated(Protocol::Ubx, &ubx(NAV_STATUS, &status), None);
            assert_eq!((found.spoofing, found.jamming), (spoofing, Jamming::Unknown));
            let first = [1, 0, 0, 0, 1 | 3 << 1, 0, 0, 0, 1 | state << 1, 0, 0, 0];
            let (found, _) = stated(Protocol::Ubx, &ubx(SEC_SIG, &first), None);
            assert_eq!((found.spoofing, found.jamming), (spoofing, Jamming::Critical));
            let second = [2, 1 | 1 << 1 | 1 << 3 | state << 4, 0, 0];
            let (found, _) = stated(Protocol::Ubx, &ubx(SEC_SIG, &second), None);
            assert_eq!((found.spoofing, found.jamming), (spoofing, Jamming::None));
        }
        let later = [9, 255, 255, 255, 255, 255, 255, 255, 255, 255, 255, 255];
        assert_eq!(
            stated(Protocol::Ubx, &ubx(SEC_SIG, &later), None),
            (Interference::default(), 0)
        );
    }

    #[test]
    fn blocks_of_septentrio_belong_to_antennas() {
        let band = |mode: u8, antenna: u8| [0, 0, 0, 0, 0, 0, mode | antenna << 6, 0];
        let content = [&[2, 8, 0, 0, 0, 0], &band(2, 0)[..], &band(8, 1)].concat();
        for (antenna, jamming) in [
            (None, Jamming::Critical),
            (Some(0), Jamming::Warning),
            (Some(1), Jamming::Critical),
            (Some(2), Jamming::None),
        ] {
            let (found, damage) = stated(Protocol::Sbf, &sbf(&content), antenna);
            assert_eq!((found.jamming, found.spoofing, damage), (jamming, Spoofing::None, 0));
        }
        for (flags, spoofing) in
            [(0, Spoofing::None), (1, Spoofing::Stated), (2, Spoofing::Stated), (4, Spoofing::None)]
        {
            let (found, _) = stated(Protocol::Sbf, &sbf(&[0, 8, flags, 0, 0, 0]), None);
            assert_eq!((found.spoofing, found.jamming), (spoofing, Jamming::None));
        }
    }

    /// Cut anywhere, and with counts that are not true: nothing is stated, and it is told.
    #[test]
    fn lengths_are_not_trusted() {
        let whole = mon_rf_message();
        for length in 4..whole.len() {
            assert_eq!(stated(Protocol::Ubx, &whole[..length], None), (Interference::default(), 1));
        }
        let mut more = whole;
        more[4 + 1] = 255;
        assert_eq!(stated(Protocol::Ubx, &more, None), (Interference::default(), 1));
        for length in 0..16 {
            let cut = ubx(NAV_STATUS, &[0xff; 16][..length]);
            assert_eq!(stated(Protocol::Ubx, &cut, None), (Interference::default(), 1));
        }
        for content in [
            &[1, 8, 3, 0, 0][..],
            &[255, 255, 3, 0, 0, 0],
            &[1, 0, 3, 0, 0, 0, 8],
            &[2, 6, 3, 0, 0, 0],
            &[],
        ] {
            assert_eq!(stated(Protocol::Sbf, &sbf(content), None), (Interference::default(), 1));
        }
    }

    #[test]
    fn a_statement_counts_until_the_next_or_until_it_is_old() {
        let (mut statements, mut damage) = (Statements::default(), DamageLog::default());
        let mut status = [0; 16];
        status[7] = 2 << 3;
        let spoofed = ubx(NAV_STATUS, &status);
        let take = |statements: &mut Statements, body: &[u8], damage: &mut DamageLog| {
            statements.take(&Frame { protocol: Protocol::Ubx, body, offset: 0 }, None, damage);
        };
        assert_eq!(statements.at(at(0.0)), Interference::default());
        take(&mut statements, &spoofed, &mut damage);
        take(&mut statements, &mon_rf_message(), &mut damage);
        let both = statements.at(at(1.0));
        assert_eq!((both.spoofing, both.jamming), (Spoofing::Stated, Jamming::Warning));
        assert_eq!(statements.at(at(11.0)), both);
        assert_eq!(statements.at(at(11.1)), Interference::default());
        take(&mut statements, &spoofed, &mut damage);
        status[7] = 1 << 3;
        take(&mut statements, &ubx(NAV_STATUS, &status), &mut damage);
        assert_eq!(statements.at(at(12.0)).spoofing, Spoofing::None);
    }
}
