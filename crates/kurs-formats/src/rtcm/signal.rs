//! Satellites and signals by the numbers of multiple signal messages.

use kurs::signal::{Satellite, Signal, System};

/// The first message number of a system less one: MSM 1 of GPS is 1071.
const SYSTEMS: [(u16, System); 7] = [
    (1070, System::Gps),
    (1080, System::Glonass),
    (1090, System::Galileo),
    (1100, System::Sbas),
    (1110, System::Qzss),
    (1120, System::BeiDou),
    (1130, System::NavIc),
];

/// Signal numbers, 1 to 32 (tables 3.5-91 to 3.5-108), with band and tracking code of RINEX 3.
const fn signals(system: System) -> &'static [(u8, &'static [u8; 2])] {
    match system {
        System::Gps => &[
            (2, b"1C"),
            (3, b"1P"),
            (4, b"1W"),
            (8, b"2C"),
            (9, b"2P"),
            (10, b"2W"),
            (15, b"2S"),
            (16, b"2L"),
            (17, b"2X"),
            (22, b"5I"),
            (23, b"5Q"),
            (24, b"5X"),
            (30, b"1S"),
            (31, b"1L"),
            (32, b"1X"),
        ],
        System::Glonass => &[(2, b"1C"), (3, b"1P"), (8, b"2C"), (9, b"2P")],
        System::Galileo => &[
            (2, b"1C"),
            (3, b"1A"),
            (4, b"1B"),
            (5, b"1X"),
            (6, b"1Z"),
            (8, b"6C"),
            (9, b"6A"),
            (10, b"6B"),
            (11, b"6X"),
            (12, b"6Z"),
            (14, b"7I"),
            (15, b"7Q"),
            (16, b"7X"),
            (18, b"8I"),
            (19, b"8Q"),
            (20, b"8X"),
            (22, b"5I"),
            (23, b"5Q"),
            (24, b"5X"),
        ],
        System::Sbas => &[(2, b"1C"), (22, b"5I"), (23, b"5Q"), (24, b"5X")],
        System::Qzss => &[
            (2, b"1C"),
            (9, b"6S"),
            (10, b"6L"),
            (11, b"6X"),
            (15, b"2S"),
            (16, b"2L"),
            (17, b"2X"),
            (22, b"5I"),
            (23, b"5Q"),
            (24, b"5X"),
            (30, b"1S"),
            (31, b"1L"),
            (32, b"1X"),
        ],
        System::BeiDou => &[
            (2, b"2I"),
            (3, b"2Q"),
            (4, b"2X"),
            (8, b"6I"),
            (9, b"6Q"),
            (10, b"6X"),
            (14, b"7I"),
            (15, b"7Q"),
            (16, b"7X"),
            (22, b"5D"),
            (23, b"5P"),
            (24, b"5X"),
            (25, b"7D"),
            (26, b"7P"),
            (27, b"7Z"),
            (30, b"1D"),
            (31, b"1P"),
            (32, b"1X"),
        ],
        System::NavIc => &[(22, b"5A")],
    }
}

/// The system and kind (1 to 7) of a message with observations.
pub(super) fn kind(number: u16) -> Option<(System, u16)> {
    let (first, system) = SYSTEMS.iter().find(|(first, _)| *first == number / 10 * 10)?;
    let kind = number - first;
    (1..=7).contains(&kind).then_some((*system, kind))
}

/// The number of a message of a system and kind.
pub(super) fn message_number(system: System, kind: u16) -> u16 {
    SYSTEMS.iter().find(|(_, of)| *of == system).map_or(0, |(first, _)| first + kind)
}

/// Satellite by its bit in the mask, 1 to 64.
pub(super) fn satellite(system: System, bit: u8) -> Option<Satellite> {
    let number = if system == System::Sbas { bit + 19 } else { bit };
    let last = match system {
        System::Galileo => 36,
        System::Glonass => 32,
        System::Qzss => 10,
        System::Sbas => 58,
        System::NavIc => 14,
        System::Gps | System::BeiDou => 63,
    };
    (number <= last).then_some(Satellite { system, number })
}

/// The bit of a satellite in the mask.
pub(super) fn satellite_bit(satellite: Satellite) -> Option<u8> {
    let is_sbas = satellite.system == System::Sbas;
    let bit = if is_sbas { satellite.number.checked_sub(19)? } else { satellite.number };
    (1..=64).contains(&bit).then_some(bit)
}

/// Signal by its bit in the mask, 1 to 32.
pub(super) fn signal(system: System, bit: u8) -> Option<Signal> {
    let (_, [digit, attribute]) = signals(system).iter().find(|(number, _)| *number == bit)?;
    Some(Signal::new(system, digit - b'0', *attribute))
}

/// Whether the format has a number for the signal: others are left out of what is written.
#[must_use]
pub fn has_number(wanted: Signal) -> bool {
    signal_bit(wanted).is_some()
}

/// The bit of a signal in the mask.
pub(super) fn signal_bit(wanted: Signal) -> Option<u8> {
    let system = wanted.band.system;
    signals(system).iter().map(|(bit, _)| *bit).find(|bit| signal(system, *bit) == Some(wanted))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_round_trip() {
        for system in System::ALL {
            for bit in 1..=32 {
                let Some(signal) = signal(system, bit) else { continue };
                assert_eq!(signal_bit(signal), Some(bit));
                assert!(signal.band.frequency_hz(Some(0)).is_some(), "{signal}");
            }
            assert_eq!(kind(message_number(system, 7)), Some((system, 7)));
        }
        assert_eq!(kind(1078), None);
        assert_eq!(kind(1005), None);
        let egnos: Satellite = "S23".parse().unwrap();
        assert_eq!(satellite_bit(egnos), Some(4));
        assert_eq!(satellite(System::Sbas, 4), Some(egnos));
    }
}
