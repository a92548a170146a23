//! The tracking codes that RINEX has, by system and band.

use kurs::signal::{Signal, System};

/// Bands with the letters of their codes (RINEX 4.02, tables 12 to 18; those of older versions are
/// among them).
const fn bands(system: System) -> &'static [(u8, &'static [u8])] {
    match system {
        System::Gps => &[(1, b"CSLXPWYMNR"), (2, b"CDSLXPWYMNR"), (5, b"IQX")],
        System::Glonass => &[(1, b"CP"), (2, b"CP"), (3, b"IQX"), (4, b"ABX"), (6, b"ABX")],
        System::Galileo => &[(1, b"ABCXZ"), (5, b"IQX"), (6, b"ABCXZ"), (7, b"IQX"), (8, b"IQX")],
        System::Sbas => &[(1, b"C"), (5, b"IQX")],
        System::Qzss => &[(1, b"CESLXZB"), (2, b"SLX"), (5, b"IQXDPZ"), (6, b"SLXEZ")],
        // B1I is band 2. Band 1 is B1C (D, P, X) and B1A (S, L, Z); 7D, 7P and 7Z are B2b.
        System::BeiDou => &[
            (1, b"DPXSLZ"),
            (2, b"IQX"),
            (5, b"DPX"),
            (6, b"IQXADPZ"),
            (7, b"IQXDPZ"),
            (8, b"DPX"),
        ],
        System::NavIc => &[(1, b"DPX"), (5, b"ABCX"), (9, b"ABCX")],
    }
}

/// Whether any version of RINEX has the signal.
pub(crate) fn exists(signal: Signal) -> bool {
    let band = bands(signal.band.system).iter().find(|(digit, _)| *digit == signal.band.digit);
    band.is_some_and(|(_, letters)| letters.contains(&signal.attribute))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_have_a_wavelength_and_a_beidou_1c_does_not_exist() {
        for system in System::ALL {
            for (digit, letters) in bands(system) {
                for letter in *letters {
                    let signal = Signal::new(system, *digit, *letter);
                    assert!(signal.band.wavelength_m(Some(0)).is_some(), "{signal}");
                }
            }
        }
        assert!(!exists(Signal::new(System::BeiDou, 1, b'C')));
        assert!(!exists(Signal::new(System::Gps, 3, b'C')));
    }

    /// Every signal of the logs has its place here.
    #[test]
    fn signals_of_logs_are_signals_of_rinex() {
        let numbered = |signal: &Signal| {
            crate::rtcm::has_number(*signal)
                || crate::sbf::has_number(*signal)
                || crate::ubx::has_number(*signal)
        };
        let all = System::ALL.into_iter().flat_map(|system| {
            (1..=9).flat_map(move |digit| {
                (b'A'..=b'Z').map(move |code| Signal::new(system, digit, code))
            })
        });
        let logged: Vec<Signal> = all.filter(numbered).collect();
        assert!(logged.len() > 70, "{}", logged.len());
        for signal in logged {
            assert!(exists(signal), "{signal}");
        }
    }
}
