//! Delays between the signals of one satellite, as its message gives them.

use super::kepler::{KeplerElements, Message};
use crate::signal::{Band, SPEED_OF_LIGHT_MPS, Signal};

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
    /// 8 of the RINEX word); the other messages speak of the satellite as a whole. The lowest bit of
    /// QZSS is about L1 C/A alone.
    #[must_use]
    pub const fn is_healthy(&self, signal: Signal) -> bool {
        match (self.message, signal.band.digit) {
            (Message::GalileoInav | Message::GalileoFnav, 1) => self.health & 0b111 == 0,
            (Message::GalileoInav | Message::GalileoFnav, 5) => self.health & 0b11_1000 == 0,
            (Message::GalileoInav | Message::GalileoFnav, 7) => self.health & 0b1_1100_0000 == 0,
            _ => self.health == 0,
        }
    }

    /// Whether the orbit and clock may be used at all: the health of the signal that carries the
    /// message (Galileo: E1 for I/NAV, E5a for F/NAV).
    #[must_use]
    pub const fn is_usable(&self) -> bool {
        match self.message {
            Message::GalileoInav => self.health & 0b111 == 0,
            Message::GalileoFnav => self.health & 0b11_1000 == 0,
            _ => self.health == 0,
        }
    }
}

/// (f₁ / f)² of a band of a system whose first frequency is f₁.
fn squared_ratio(band: Band) -> Option<f64> {
    let first = Band::new(band.system, 1).frequency_hz(None)?;
    Some((first / band.frequency_hz(None)?).powi(2))
}
