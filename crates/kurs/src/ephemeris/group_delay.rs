//! Delays between the signals of one satellite, as its message gives them.

use super::kepler::{KeplerElements, Message};
use crate::signal::{Band, SPEED_OF_LIGHT_MPS, Signal, System};

/// Bits of the health of QZSS.
const QZSS_L1: u16 = 32;
const QZSS_L1_CA: u16 = 16;
const QZSS_L2C: u16 = 8;
const QZSS_L5: u16 = 4;
const QZSS_L1C: u16 = 2;
const QZSS_L1_CB: u16 = 1;

impl KeplerElements {
    /// How much longer the pseudorange of `signal` is than that of the combination to which the
    /// broadcast clock refers, in metres: **subtract it from the pseudorange**. `None` if the
    /// message does not tell.
    ///
    /// | message | clock refers to | known here |
    /// |---|---|---|
    /// | LNAV | L1 P(Y) and L2 P(Y) without ionosphere | L1: c TGD; L2: (f₁/f₂)² c TGD |
    /// | I/NAV | E1 and E5b without ionosphere | E1: c BGD₅ᵦ; E5b: (f₁/f₅ᵦ)² c BGD₅ᵦ; E5a by BGD₅ₐ |
    /// | F/NAV | E1 and E5a without ionosphere | E1: c BGD₅ₐ; E5a: (f₁/f₅ₐ)² c BGD₅ₐ |
    /// | D1, D2 | B3I | B3I: 0; B1I: c TGD1; B2I: c TGD2 |
    ///
    /// Sources: IS-GPS-200N 20.3.3.3.3.2; Galileo OS SIS ICD 2.1, 5.1.5; BDS-SIS-ICD-B1I-3.0,
    /// 5.2.4.10. Delays between tracking codes of one band are not in these messages.
    #[must_use]
    pub fn group_delay_m(&self, signal: Signal) -> Option<f64> {
        let [first_s, second_s] = self.group_delays_s;
        let digit = signal.band.digit;
        let delay_s = match (self.message, digit, signal.attribute) {
            (Message::Lnav, 1 | 2, _) => squared_ratio(signal.band)? * first_s,
            (Message::GalileoInav, 1 | 7, _) => squared_ratio(signal.band)? * second_s,
            // BGD₅ₐ = (τ₁ − τ₅ₐ) / (1 − (f₁/f₅ₐ)²) and τ₁ = BGD₅ᵦ on the clock of I/NAV
            (Message::GalileoInav, 5, _) => {
                second_s + (squared_ratio(signal.band)? - 1.0) * first_s
            }
            (Message::GalileoFnav, 1 | 5, _) => squared_ratio(signal.band)? * first_s,
            (Message::BeiDouD1 | Message::BeiDouD2, 2, _) => first_s,
            (Message::BeiDouD1 | Message::BeiDouD2, 7, b'I' | b'Q' | b'X') => second_s,
            (Message::BeiDouD1 | Message::BeiDouD2, 6, b'I' | b'Q' | b'X') => 0.0,
            _ => return None,
        };
        (signal.band.system == self.satellite.system).then_some(SPEED_OF_LIGHT_MPS * delay_s)
    }

    /// Whether the satellite's health word admits `signal`.
    ///
    /// Galileo tells the data validity and signal health of E1-B, E5a and E5b separately (bits 0 to
    /// 8 of the RINEX word). QZSS has a bit for each of L1 (32), L1 C/A (16), L2C (8), L5 (4), L1C (2)
    /// and L1 C/B (1): a satellite sends one of C/A and C/B, and the bit of the other one is set
    /// (IS-QZSS-PNT-005, 4.1.2.3). The other messages speak of the satellite as a whole.
    #[must_use]
    pub fn is_healthy(&self, signal: Signal) -> bool {
        if self.satellite.system == System::Qzss {
            let own = match (signal.band.digit, signal.attribute) {
                (1, b'C') => QZSS_L1_CA,
                (1, b'E') => QZSS_L1_CB,
                (1, _) => QZSS_L1C,
                (2, _) => QZSS_L2C,
                (5, _) => QZSS_L5,
                _ => 0,
            };
            return self.is_usable() && self.health & own == 0;
        }
        match (self.message, signal.band.digit) {
            (Message::GalileoInav | Message::GalileoFnav, 1) => self.health & 0b111 == 0,
            (Message::GalileoInav | Message::GalileoFnav, 5) => self.health & 0b11_1000 == 0,
            (Message::GalileoInav | Message::GalileoFnav, 7) => self.health & 0b1_1100_0000 == 0,
            _ => self.health == 0,
        }
    }

    /// Whether the orbit and clock may be used at all: the health of the signal that carries the
    /// message (Galileo: E1 for I/NAV, E5a for F/NAV; QZSS: L1 C/A or C/B).
    #[must_use]
    pub fn is_usable(&self) -> bool {
        if self.satellite.system == System::Qzss {
            let neither = QZSS_L1_CA | QZSS_L1_CB;
            return self.health & QZSS_L1 == 0 && self.health & neither != neither;
        }
        match self.message {
            Message::GalileoInav => self.health & 0b111 == 0,
            Message::GalileoFnav => self.health & 0b11_1000 == 0,
            _ => self.health == 0,
        }
    }
}

/// The two signals whose combination without ionosphere has no group delay against the clocks of
/// precise orbits: the convention of the IGS (GPS, GLONASS: P codes of L1 and L2) and of its
/// multi-GNSS products (Galileo E1 and E5a, BeiDou B1I and B3I, QZSS L1 and L2).
///
/// Source: O. Montenbruck et al., The Multi-GNSS Experiment (MGEX) of the IGS, Advances in Space
/// Research 59 (2017) 1671-1697.
#[must_use]
pub fn precise_clock_signals(system: System) -> Option<[Signal; 2]> {
    let pair = match system {
        System::Gps => [(1, b'W'), (2, b'W')],
        System::Glonass => [(1, b'P'), (2, b'P')],
        System::Galileo => [(1, b'C'), (5, b'Q')],
        System::BeiDou => [(2, b'I'), (6, b'I')],
        System::Qzss => [(1, b'C'), (2, b'L')],
        System::NavIc | System::Sbas => return None,
    };
    Some(pair.map(|(digit, attribute)| Signal::new(system, digit, attribute)))
}

/// (f₁ / f)² of a band of a system whose first frequency is f₁.
fn squared_ratio(band: Band) -> Option<f64> {
    let first = Band::new(band.system, 1).frequency_hz(None)?;
    Some((first / band.frequency_hz(None)?).powi(2))
}

#[cfg(test)]
mod tests {
    use super::super::sample::{beidou_geo, galileo, gps};
    use super::*;

    const C: f64 = SPEED_OF_LIGHT_MPS;

    fn ionosphere_free(first: f64, second: f64, ratio: f64) -> f64 {
        // (P₂ − γ P₁) / (1 − γ)
        (second - ratio * first) / (1.0 - ratio)
    }

    #[test]
    fn the_combination_of_the_clock_has_no_delay() {
        let delay = |elements: KeplerElements, digit: u8, attribute: u8| {
            let signal = Signal::new(elements.satellite.system, digit, attribute);
            elements.group_delay_m(signal).unwrap()
        };
        let gamma = (154.0f64 / 120.0).powi(2);
        let l1_l2 = ionosphere_free(delay(gps(), 1, b'C'), delay(gps(), 2, b'W'), gamma);
        assert!(l1_l2.abs() < 1e-12, "{l1_l2}");

        let fnav = KeplerElements { message: Message::GalileoFnav, ..galileo() };
        let gamma = (154.0f64 / 115.0).powi(2);
        let e1_e5a = ionosphere_free(delay(fnav, 1, b'C'), delay(fnav, 5, b'Q'), gamma);
        assert!(e1_e5a.abs() < 1e-12, "{e1_e5a}");

        let gamma = (154.0f64 / 118.0).powi(2);
        let e1_e5b = ionosphere_free(delay(galileo(), 1, b'C'), delay(galileo(), 7, b'Q'), gamma);
        assert!(e1_e5b.abs() < 1e-12, "{e1_e5b}");

        assert_eq!(delay(beidou_geo(), 6, b'I'), 0.0);
        assert_eq!(delay(beidou_geo(), 2, b'I'), C * 1e-10);
        assert_eq!(delay(beidou_geo(), 7, b'I'), C * -9.3e-9);
    }

    /// BGD is defined by the delays of two signals, so their difference does not depend on the
    /// message.
    #[test]
    fn e5a_against_e1_is_the_same_on_both_clocks() {
        let inav = galileo();
        let fnav = KeplerElements { message: Message::GalileoFnav, ..inav };
        let [e1, e5a] =
            [Signal::new(System::Galileo, 1, b'C'), Signal::new(System::Galileo, 5, b'Q')];
        let apart =
            |e: KeplerElements| e.group_delay_m(e5a).unwrap() - e.group_delay_m(e1).unwrap();
        assert!((apart(inav) - apart(fnav)).abs() < 1e-12);
    }

    #[test]
    fn what_the_message_does_not_tell() {
        for (elements, digit, attribute) in [
            (gps(), 5, b'Q'),
            (galileo(), 6, b'C'),
            (beidou_geo(), 1, b'P'),
            (beidou_geo(), 7, b'D'),
        ] {
            let signal = Signal::new(elements.satellite.system, digit, attribute);
            assert_eq!(elements.group_delay_m(signal), None, "{signal}");
        }
        assert_eq!(gps().group_delay_m(Signal::new(System::Galileo, 1, b'C')), None);
    }

    /// Since the change of 2023 every satellite that sends L1 C/A says 1: no C/B.
    #[test]
    fn qzss_health_is_per_signal() {
        let [c_a, c_b, l1c, l2c] = [(1, b'C'), (1, b'E'), (1, b'X'), (2, b'L')]
            .map(|(digit, attribute)| Signal::new(System::Qzss, digit, attribute));
        let satellite = crate::signal::Satellite::new(System::Qzss, 2);
        let marked = |health| KeplerElements { satellite, health, ..gps() };
        let health = |e: KeplerElements| [c_a, c_b, l1c, l2c].map(|signal| e.is_healthy(signal));
        assert_eq!(health(marked(1)), [true, false, true, true]);
        assert_eq!(health(marked(16)), [false, true, true, true]);
        assert_eq!(health(marked(1 + 8)), [true, false, true, false]);
        assert_eq!(health(marked(32)), [false; 4]);
        let usable = [0, 1, 16, 17, 32, 63].map(|health| marked(health).is_usable());
        assert_eq!(usable, [true, true, true, false, false, false]);
    }

    #[test]
    fn galileo_health_is_per_signal() {
        let [e1, e5a, e5b] = [1, 5, 7].map(|digit| Signal::new(System::Galileo, digit, b'Q'));
        let marked = |health| KeplerElements { health, ..galileo() };
        let health = |e: KeplerElements| [e1, e5a, e5b].map(|signal| e.is_healthy(signal));
        assert_eq!(health(marked(0)), [true; 3]);
        assert_eq!(health(marked(0b10_1000)), [true, false, true]);
        assert_eq!(health(marked(0b1_0000_0001)), [false, true, false]);
        assert!(marked(0b10_1000).is_usable());
        assert!(!marked(0b10).is_usable());
        assert!(!KeplerElements { health: 63, ..gps() }.is_usable());
    }
}
