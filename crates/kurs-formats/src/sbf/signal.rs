//! Satellites and signals by the numbers of Septentrio.

use kurs::signal::{Satellite, Signal, System};

/// Ranges of satellite numbers (4.1.9): first, last, system, what is taken off. 62 is a GLONASS
/// satellite of unknown slot; 107 to 119 are beams of the L band.
const SATELLITES: [(u8, u8, System, u8); 11] = [
    (1, 37, System::Gps, 0),
    (38, 61, System::Glonass, 37),
    (63, 68, System::Glonass, 38),
    (71, 106, System::Galileo, 70),
    (120, 140, System::Sbas, 100),
    (141, 180, System::BeiDou, 140),
    (181, 190, System::Qzss, 180),
    (191, 197, System::NavIc, 190),
    (198, 215, System::Sbas, 157),
    (216, 222, System::NavIc, 208),
    (223, 245, System::BeiDou, 182),
];

/// Signal numbers (4.1.10) with band and tracking code of RINEX 3. Those of bands that RINEX knows
/// nothing of (23: L band) are left out.
const SIGNALS: [(u8, System, &[u8; 2]); 33] = [
    (0, System::Gps, b"1C"),
    (1, System::Gps, b"1W"),
    (2, System::Gps, b"2W"),
    (3, System::Gps, b"2L"),
    (4, System::Gps, b"5Q"),
    (5, System::Gps, b"1L"),
    (6, System::Qzss, b"1C"),
    (7, System::Qzss, b"2L"),
    (8, System::Glonass, b"1C"),
    (9, System::Glonass, b"1P"),
    (10, System::Glonass, b"2P"),
    (11, System::Glonass, b"2C"),
    (12, System::Glonass, b"3Q"),
    (13, System::BeiDou, b"1P"),
    (14, System::BeiDou, b"5P"),
    (15, System::NavIc, b"5A"),
    (17, System::Galileo, b"1C"),
    (E6, System::Galileo, b"6C"),
    (20, System::Galileo, b"5Q"),
    (21, System::Galileo, b"7Q"),
    (22, System::Galileo, b"8Q"),
    (24, System::Sbas, b"1C"),
    (25, System::Sbas, b"5I"),
    (26, System::Qzss, b"5Q"),
    (27, System::Qzss, b"6L"),
    (28, System::BeiDou, b"2I"),
    (29, System::BeiDou, b"7I"),
    (30, System::BeiDou, b"6I"),
    (32, System::Qzss, b"1L"),
    (33, System::Qzss, b"1Z"),
    (34, System::BeiDou, b"7D"),
    (38, System::Qzss, b"1E"),
    (39, System::Qzss, b"5P"),
];

/// Galileo E6: the component C, or B where a flag of the block says so.
const E6: u8 = 19;

/// The two signals whose strengths have no offset: GPS L1P and L2P.
pub(super) const fn is_gps_p(signal: u8) -> bool {
    matches!(signal, 1 | 2)
}

/// A satellite by its number.
pub(super) fn satellite(svid: u8) -> Option<Satellite> {
    let (_, _, system, less) =
        SATELLITES.iter().find(|(first, last, ..)| (*first..=*last).contains(&svid))?;
    Some(Satellite::new(*system, svid - less))
}

/// The number of a satellite.
pub(super) fn satellite_number(satellite: Satellite) -> Option<u8> {
    let numbered = |svid: &u8| self::satellite(*svid) == Some(satellite);
    SATELLITES.iter().flat_map(|(first, last, ..)| *first..=*last).find(numbered)
}

/// A signal of a system by its number.
pub(super) fn signal(system: System, number: u8, e6b_used: bool) -> Option<Signal> {
    if number == E6 && e6b_used {
        return (system == System::Galileo).then(|| Signal::new(system, 6, b'B'));
    }
    let row = SIGNALS.iter().find(|(of, ..)| *of == number)?;
    let (_, of, [digit, attribute]) = row;
    (*of == system).then(|| Signal::new(system, digit - b'0', *attribute))
}

/// Whether the format has a number for the signal: others are left out of what is written.
#[must_use]
pub fn has_number(wanted: Signal) -> bool {
    signal_number(wanted, false).is_some()
}

/// The number of a signal; of Galileo E6 only where the flag says the same.
pub(super) fn signal_number(wanted: Signal, e6b_used: bool) -> Option<u8> {
    let system = wanted.band.system;
    let same = |number: &u8| signal(system, *number, e6b_used) == Some(wanted);
    SIGNALS.iter().map(|(number, ..)| *number).find(same)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn satellites_are_numbered_without_gaps() {
        for (svid, name) in [
            (1, "G01"),
            (37, "G37"),
            (38, "R01"),
            (61, "R24"),
            (63, "R25"),
            (68, "R30"),
            (71, "E01"),
            (106, "E36"),
            (120, "S20"),
            (140, "S40"),
            (141, "C01"),
            (180, "C40"),
            (181, "J01"),
            (191, "I01"),
            (198, "S41"),
            (215, "S58"),
            (216, "I08"),
            (222, "I14"),
            (223, "C41"),
            (245, "C63"),
        ] {
            let satellite = satellite(svid).unwrap();
            assert_eq!(satellite.to_string(), name);
            assert_eq!(satellite_number(satellite), Some(svid));
        }
        for none in [0, 62, 69, 70, 107, 119, 246, 255] {
            assert_eq!(satellite(none), None);
        }
    }

    #[test]
    fn signals_round_trip() {
        for (number, system, _) in SIGNALS {
            for e6b_used in [false, true] {
                let signal = signal(system, number, e6b_used).unwrap();
                assert_eq!(signal_number(signal, e6b_used), Some(number), "{signal}");
                assert!(signal.band.frequency_hz(Some(0)).is_some(), "{signal}");
            }
        }
        assert_eq!(signal(System::Galileo, 0, false), None);
        assert_eq!(signal(System::Gps, 16, false), None);
        let e6b = Signal::new(System::Galileo, 6, b'B');
        assert_eq!([false, true].map(|flag| signal_number(e6b, flag)), [None, Some(E6)]);
    }
}
