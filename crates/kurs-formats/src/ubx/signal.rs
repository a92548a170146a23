//! Satellites and signals by the numbers of u-blox.

use kurs::signal::{Satellite, Signal, System};

/// Numbers of a satellite system (`gnssId`; interface description, 1.5.2).
const SYSTEMS: [(u8, System); 7] = [
    (0, System::Gps),
    (1, System::Sbas),
    (2, System::Galileo),
    (3, System::BeiDou),
    (5, System::Qzss),
    (6, System::Glonass),
    (7, System::NavIc),
];

/// Numbers of a signal (`gnssId`, `sigId`; interface description, 1.5.4) with band and tracking
/// code of RINEX 3. BeiDou's B1I to B3I have two numbers, by the message that they carry (D1, D2);
/// the first one is that of D1.
const SIGNALS: [(System, u8, u8, u8); 34] = [
    (System::Gps, 0, 1, b'C'),
    (System::Gps, 3, 2, b'L'),
    (System::Gps, 4, 2, b'S'),
    (System::Gps, 6, 5, b'I'),
    (System::Gps, 7, 5, b'Q'),
    (System::Sbas, 0, 1, b'C'),
    (System::Galileo, 0, 1, b'C'),
    (System::Galileo, 1, 1, b'B'),
    (System::Galileo, 3, 5, b'I'),
    (System::Galileo, 4, 5, b'Q'),
    (System::Galileo, 5, 7, b'I'),
    (System::Galileo, 6, 7, b'Q'),
    (System::Galileo, 8, 6, b'B'),
    (System::Galileo, 9, 6, b'C'),
    (System::Galileo, 10, 6, b'A'),
    (System::BeiDou, 0, 2, b'I'),
    (System::BeiDou, 1, 2, b'I'),
    (System::BeiDou, 2, 7, b'I'),
    (System::BeiDou, 3, 7, b'I'),
    (System::BeiDou, 4, 6, b'I'),
    (System::BeiDou, 10, 6, b'I'),
    (System::BeiDou, 5, 1, b'P'),
    (System::BeiDou, 6, 1, b'D'),
    (System::BeiDou, 7, 5, b'P'),
    (System::BeiDou, 8, 5, b'D'),
    (System::Qzss, 0, 1, b'C'),
    (System::Qzss, 1, 1, b'Z'),
    (System::Qzss, 4, 2, b'S'),
    (System::Qzss, 5, 2, b'L'),
    (System::Qzss, 8, 5, b'I'),
    (System::Qzss, 9, 5, b'Q'),
    (System::Glonass, 0, 1, b'C'),
    (System::Glonass, 2, 2, b'C'),
    (System::NavIc, 0, 5, b'A'),
];

/// The GLONASS channel of a `freqId`, which is the channel and 7, from 0 to 13.
pub(super) fn glonass_channel(number: u8) -> Option<i8> {
    (number <= 13).then(|| number.cast_signed() - 7)
}

/// A satellite by `gnssId` and `svId`; `None` for one that has no number yet (GLONASS, 255).
pub(super) fn satellite(system: u8, number: u8) -> Option<Satellite> {
    let (_, system) = *SYSTEMS.iter().find(|(id, _)| *id == system)?;
    let number = if system == System::Sbas { number.checked_sub(100)? } else { number };
    (1..=99).contains(&number).then_some(Satellite { system, number })
}

/// `gnssId` and `svId` of a satellite.
pub(super) fn satellite_ids(satellite: Satellite) -> Option<(u8, u8)> {
    let (id, system) = *SYSTEMS.iter().find(|(_, system)| *system == satellite.system)?;
    Some((id, if system == System::Sbas { satellite.number + 100 } else { satellite.number }))
}

/// The signal of a system by `sigId`.
pub(super) fn signal(system: System, id: u8) -> Option<Signal> {
    let row = SIGNALS.iter().find(|(of, number, ..)| *of == system && *number == id);
    row.map(|(_, _, digit, attribute)| Signal::new(system, *digit, *attribute))
}

/// Whether the format has a number for the signal: others are left out of what is written.
#[must_use]
pub fn has_number(wanted: Signal) -> bool {
    SIGNALS.iter().any(|(system, _, digit, code)| wanted == Signal::new(*system, *digit, *code))
}

/// `sigId` of a signal of `satellite`, as u-blox numbers it.
pub(super) fn signal_id(satellite: Satellite, signal: Signal) -> Option<u8> {
    let mut rows = SIGNALS
        .iter()
        .filter(|(system, _, digit, attribute)| signal == Signal::new(*system, *digit, *attribute));
    let row = if satellite.is_beidou_geo() { rows.next_back() } else { rows.next() };
    row.map(|(_, id, ..)| *id)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn channels_are_those_of_the_system() {
        let channels = [0, 13, 14, 128, 255].map(glonass_channel);
        assert_eq!(channels, [Some(-7), Some(6), None, None, None]);
    }

    #[test]
    fn numbers_round_trip() {
        for (system, id, ..) in SIGNALS {
            let signal = signal(system, id).unwrap();
            let [geo, other] = [3, 30].map(|n| signal_id(Satellite::new(system, n), signal));
            assert!(geo == Some(id) || other == Some(id), "{signal}");
        }
        let geo = Satellite::new(System::BeiDou, 3);
        assert_eq!(signal_id(geo, Signal::new(System::BeiDou, 6, b'I')), Some(10));
        for name in ["G05", "S33", "J07", "R24"] {
            let known: Satellite = name.parse().unwrap();
            let (system, number) = satellite_ids(known).unwrap();
            assert_eq!(satellite(system, number), Some(known));
        }
        assert_eq!(satellite(6, 255), None);
    }
}
