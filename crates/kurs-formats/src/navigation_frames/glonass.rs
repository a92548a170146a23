//! The message of GLONASS: strings 1 to 4.
//!
//! Source: GLONASS ICD 5.1 (2008), 4.4 to 4.7, tables 4.5, 4.6 and 4.13.

use kurs::ephemeris::{Ephemeris, GlonassElements, GlonassEphemeris};
use kurs::frames::{Ecef, Vector};
use kurs::signal::Satellite;
use kurs::time::{Calendar, GpsTime};

use crate::fields::{BitReader, BitWriter, Fields, two_to};

/// 85 bits, the first one (bit 85 of the document) leading.
pub(crate) type GlonassString = [u8; 11];

/// Range accuracy by the index F_T (table 4.4).
const ACCURACY_M: [f64; 15] =
    [1.0, 2.0, 2.5, 4.0, 5.0, 7.0, 10.0, 12.0, 14.0, 16.0, 32.0, 64.0, 128.0, 256.0, 512.0];
/// Where the index says that none is predicted.
const ACCURACY_UNKNOWN_M: f64 = 512.0;
/// Moscow time less UTC.
const MOSCOW_S: f64 = 3.0 * 3600.0;
const DAY_S: f64 = 86_400.0;
/// The years are counted in fours, their days from 1; day 1 of one of them.
const FOUR_YEARS_BEGIN: Calendar =
    Calendar { year: 1996, month: 1, day: 1, hour: 0, minute: 0, second: 0.0 };
const FOUR_YEARS_D: u64 = 1461;

/// What the four strings say, with their short time.
#[derive(Debug, Clone, Default)]
pub(crate) struct GlonassMessage {
    pub(crate) position_km: [f64; 3],
    pub(crate) velocity_kmps: [f64; 3],
    pub(crate) acceleration_kmps2: [f64; 3],
    /// t_b: seconds of the day in Moscow.
    pub(crate) reference_s: f64,
    /// t_k: when the frame began.
    pub(crate) frame_s: f64,
    /// B_n: its highest bit says that the satellite is unhealthy.
    pub(crate) health: u64,
    /// l_n of the third string.
    pub(crate) unhealthy: u64,
    /// γₙ
    pub(crate) drift: f64,
    /// τₙ
    pub(crate) minus_bias_s: f64,
    /// Δτₙ
    pub(crate) l2_delay_s: f64,
    /// F_T
    pub(crate) accuracy: u64,
    /// N_T
    pub(crate) day: u64,
    /// N₄; zero where it is not sent.
    pub(crate) four_years: u64,
    /// n
    pub(crate) slot: u64,
}

impl GlonassMessage {
    /// The message that says `elements`.
    pub(crate) fn of(elements: &GlonassElements, sent: GpsTime) -> Self {
        let moscow = moscow(elements.reference_time);
        let kilometres = |v: Vector<Ecef>| <[f64; 3]>::from((v * 1e-3).xyz());
        Self {
            position_km: kilometres(elements.position_m),
            velocity_kmps: kilometres(elements.velocity_mps),
            acceleration_kmps2: kilometres(elements.acceleration_mps2),
            reference_s: (moscow.tow_s() % DAY_S).round(),
            frame_s: frame_s(sent),
            health: if elements.health == 0 { 0 } else { 4 },
            unhealthy: u64::from(elements.health != 0),
            drift: elements.clock_drift,
            minus_bias_s: -elements.clock_bias_s,
            l2_delay_s: elements.l2_delay_s.unwrap_or(0.0),
            accuracy: accuracy_index(elements.accuracy_m),
            day: 1 + days_since_1996(moscow) % FOUR_YEARS_D,
            four_years: 1 + days_since_1996(moscow) / FOUR_YEARS_D,
            slot: u64::from(elements.satellite.number),
        }
    }

    /// The ephemeris of the day that is next to `near`; the error says what is out of range.
    pub(crate) fn ephemeris(
        &self,
        satellite: Satellite,
        channel: i8,
        near: GpsTime,
    ) -> Result<Ephemeris, String> {
        let metres = |v: [f64; 3]| Vector::new(v[0], v[1], v[2]) * 1e3;
        let reference_time = next_to(near, self.reference_s);
        let elements = GlonassElements {
            satellite,
            reference_time,
            transmission_time: next_to(reference_time, self.frame_s),
            clock_bias_s: -self.minus_bias_s,
            clock_drift: self.drift,
            position_m: metres(self.position_km),
            velocity_mps: metres(self.velocity_kmps),
            acceleration_mps2: metres(self.acceleration_kmps2),
            channel,
            l2_delay_s: Some(self.l2_delay_s),
            health: u16::from(self.health >= 4 || self.unhealthy != 0),
            accuracy_m: accuracy_m(self.accuracy),
        };
        let checked = GlonassEphemeris::new(elements).map_err(|error| error.to_string())?;
        Ok(Ephemeris::Glonass(checked))
    }

    /// Noon of the day that N₄ and N_T name, if they do.
    pub(crate) fn date(&self) -> Option<GpsTime> {
        if self.four_years == 0 || self.day == 0 {
            return None;
        }
        let days = (self.four_years - 1) * FOUR_YEARS_D + self.day - 1;
        let noon = GpsTime::from_calendar(FOUR_YEARS_BEGIN)? + (days as f64 + 0.5) * DAY_S;
        Some(noon + -MOSCOW_S)
    }

    /// Coordinates of one axis as the strings send them: velocity, acceleration, position.
    fn axis(&mut self, f: &mut impl Fields, axis: usize) {
        self.velocity(f, axis);
        self.acceleration(f, axis);
        self.position(f, axis);
    }

    pub(crate) fn position(&mut self, f: &mut impl Fields, axis: usize) {
        f.scaled_sign_and_size(27, two_to(-11), &mut self.position_km[axis]);
    }

    pub(crate) fn velocity(&mut self, f: &mut impl Fields, axis: usize) {
        f.scaled_sign_and_size(24, two_to(-20), &mut self.velocity_kmps[axis]);
    }

    pub(crate) fn acceleration(&mut self, f: &mut impl Fields, axis: usize) {
        f.scaled_sign_and_size(5, two_to(-30), &mut self.acceleration_kmps2[axis]);
    }

    pub(crate) fn frame_time(&mut self, f: &mut impl Fields) {
        let (mut hours, mut minutes, mut half) = (0.0, 0.0, 0.0);
        if self.frame_s > 0.0 {
            hours = (self.frame_s / 3600.0).floor();
            minutes = (self.frame_s % 3600.0 / 60.0).floor();
            half = (self.frame_s % 60.0 / 30.0).floor();
        }
        f.scaled_unsigned(5, 1.0, &mut hours);
        f.scaled_unsigned(6, 1.0, &mut minutes);
        f.scaled_unsigned(1, 1.0, &mut half);
        self.frame_s = hours * 3600.0 + minutes * 60.0 + half * 30.0;
    }

    pub(crate) fn reference_time(&mut self, f: &mut impl Fields) {
        f.time(7, 900.0, &mut self.reference_s);
    }

    pub(crate) fn clock_drift(&mut self, f: &mut impl Fields) {
        f.scaled_sign_and_size(11, two_to(-40), &mut self.drift);
    }

    pub(crate) fn clock_bias(&mut self, f: &mut impl Fields) {
        f.scaled_sign_and_size(22, two_to(-30), &mut self.minus_bias_s);
    }

    pub(crate) fn l2_delay(&mut self, f: &mut impl Fields) {
        f.scaled_sign_and_size(5, two_to(-30), &mut self.l2_delay_s);
    }
}

/// When the frame of an instant began, s of the day in Moscow.
pub(crate) fn frame_s(time: GpsTime) -> f64 {
    const FRAME_S: f64 = 30.0;
    (moscow(time).tow_s() % DAY_S / FRAME_S).floor() * FRAME_S
}

/// The first index F_T that promises no more than `accuracy_m`.
pub(crate) fn accuracy_index(accuracy_m: f64) -> u64 {
    ACCURACY_M.iter().position(|a| *a >= accuracy_m).unwrap_or(ACCURACY_M.len()) as u64
}

/// Range accuracy of an index F_T, m; of none predicted the largest.
pub(crate) fn accuracy_m(index: u64) -> f64 {
    let index = usize::try_from(index).unwrap_or(usize::MAX);
    *ACCURACY_M.get(index).unwrap_or(&ACCURACY_UNKNOWN_M)
}

/// Moscow's date and time on the scale of days and weeks of GPS.
fn moscow(gpst: GpsTime) -> GpsTime {
    gpst + (MOSCOW_S - f64::from(gpst.leap_seconds()))
}

/// The instant next to `near` at which it is `of_day_s` in Moscow, on the other side of a leap
/// second too.
fn next_to(near: GpsTime, of_day_s: f64) -> GpsTime {
    let ahead_s = of_day_s - moscow(near).tow_s() % DAY_S;
    let by_leap_of_near = near + (ahead_s - DAY_S * (ahead_s / DAY_S).round());
    by_leap_of_near + f64::from(by_leap_of_near.leap_seconds() - near.leap_seconds())
}

#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // not negative
fn days_since_1996(moscow: GpsTime) -> u64 {
    let begin = GpsTime::from_calendar(FOUR_YEARS_BEGIN).unwrap_or_default();
    ((moscow - begin) / DAY_S).max(0.0) as u64
}

/// Number of a string, 1 to 15.
pub(crate) fn number(string: &GlonassString) -> u8 {
    string[0] >> 3 & 15
}

/// The message of strings 1 to 4.
pub(crate) fn read(strings: [&GlonassString; 4]) -> GlonassMessage {
    let mut message = GlonassMessage::default();
    for (string, number) in strings.into_iter().zip(1..) {
        describe(&mut BitReader::new(string), &mut message, number);
    }
    message
}

/// The strings of a message, with check bits; `None` if a value does not fit.
pub(crate) fn write(message: &GlonassMessage) -> Option<[GlonassString; 4]> {
    let mut message = message.clone();
    let mut strings = [[0; 11]; 4];
    for (string, number) in strings.iter_mut().zip(1..) {
        let mut writer = BitWriter::default();
        describe(&mut writer, &mut message, number);
        let bytes = writer.finish()?;
        string[..bytes.len()].copy_from_slice(&bytes);
        let check = check_bits(string);
        // Bits 8 to 1 of the document follow 77 bits of data.
        string[9] |= check >> 5;
        string[10] = check << 3;
    }
    Some(strings)
}

/// Table 4.6: the 77 bits of a string before its check bits.
fn describe(f: &mut impl Fields, m: &mut GlonassMessage, number: u64) {
    f.constant(1, 0);
    f.constant(4, number);
    match number {
        1 => {
            f.constant(4, 1); // two reserved bits, P1: an interval of 30 min
            m.frame_time(f);
            m.axis(f, 0);
        }
        2 => {
            f.unsigned(3, &mut m.health);
            f.constant(1, 1); // P2: t_b is odd
            m.reference_time(f);
            f.constant(5, 0);
            m.axis(f, 1);
        }
        3 => {
            f.constant(1, 1); // P3: five satellites in the almanac of the frame
            m.clock_drift(f);
            f.constant(3, 0);
            f.unsigned(1, &mut m.unhealthy);
            m.axis(f, 2);
        }
        _ => {
            m.clock_bias(f);
            m.l2_delay(f);
            f.constant(5 + 14 + 1, 0); // age, reserved, P4
            f.unsigned(4, &mut m.accuracy);
            f.constant(3, 0);
            f.unsigned(11, &mut m.day);
            f.unsigned(5, &mut m.slot);
            f.constant(2, 1); // M: GLONASS-M
        }
    }
}

/// Bit `number` of a string as the document counts them: 85 leads.
fn bit(string: &GlonassString, number: usize) -> bool {
    let at = 85 - number;
    string[at / 8] >> (7 - at % 8) & 1 == 1
}

/// The eight check bits of table 4.13. They are those of a Hamming code: the data bits 9 to 85 have
/// the positions 3, 5, 6, 7, 9, …, which are not powers of two; each of the first seven check bits
/// is the parity of the positions with its power of two, and the eighth that of everything.
fn check_bits(string: &GlonassString) -> u8 {
    let positions = (3u8..).filter(|position| !position.is_power_of_two());
    let data = (9..=85).zip(positions).filter(|(number, _)| bit(string, *number));
    let (hamming, all) =
        data.fold((0, 0), |(hamming, all), (_, position)| (hamming ^ position, all ^ 1));
    let all = all ^ (hamming.count_ones() & 1);
    hamming | u8::from(all == 1) << 7
}

/// Whether the check bits fit.
pub(crate) fn is_good(string: &GlonassString) -> bool {
    check_bits(string) == string[9] << 5 | string[10] >> 3
}

#[cfg(test)]
mod tests {
    use super::*;
    use kurs::signal::System;

    fn message() -> GlonassMessage {
        GlonassMessage {
            position_km: [12_345.678_9, -20_000.123, 5_432.1],
            velocity_kmps: [-1.25, 0.5, 3.000_001],
            acceleration_kmps2: [two_to(-29), 0.0, -two_to(-28)],
            reference_s: 19.0 * 900.0,
            frame_s: 17_130.0,
            health: 0,
            unhealthy: 0,
            drift: two_to(-38),
            minus_bias_s: -1.5e-5,
            l2_delay_s: two_to(-29),
            accuracy: 3,
            day: 1000,
            four_years: 0,
            slot: 7,
        }
    }

    /// 23:45 and 00:15 UTC, seen from both sides of the leap second of 2016.
    #[test]
    fn times_next_to_a_leap_second() {
        let utc = |year, month, day, hour, minute, second| {
            GpsTime::from_utc(Calendar { year, month, day, hour, minute, second }).unwrap()
        };
        let before = utc(2016, 12, 31, 23, 45, 0.0);
        let after = utc(2017, 1, 1, 0, 15, 0.0);
        assert_eq!(after - before, 1801.0);
        for near in [utc(2016, 12, 31, 23, 59, 50.0), utc(2017, 1, 1, 0, 0, 10.0)] {
            assert_eq!(next_to(near, 9900.0), before);
            assert_eq!(next_to(near, 11_700.0), after);
        }
    }

    #[test]
    fn strings_round_trip_and_one_wrong_bit_is_noticed() {
        let strings = write(&message()).unwrap();
        for (string, index) in strings.iter().zip(1..) {
            assert_eq!(number(string), index);
            assert!(is_good(string));
            for at in 0..85 {
                let mut wrong = *string;
                wrong[at / 8] ^= 0x80 >> (at % 8);
                assert!(!is_good(&wrong), "bit {at}");
            }
        }
        let read = read(strings.each_ref());
        let wanted = message();
        for axis in 0..3 {
            assert!((read.position_km[axis] - wanted.position_km[axis]).abs() <= two_to(-12));
            assert!((read.velocity_kmps[axis] - wanted.velocity_kmps[axis]).abs() <= two_to(-21));
        }
        assert_eq!(read.acceleration_kmps2, wanted.acceleration_kmps2);
        assert_eq!((read.reference_s, read.frame_s), (wanted.reference_s, wanted.frame_s));
        assert_eq!((read.day, read.slot, read.accuracy), (1000, 7, 3));
        assert_eq!((read.drift, read.l2_delay_s), (wanted.drift, wanted.l2_delay_s));
    }

    #[test]
    fn times_of_day_are_those_of_moscow() {
        let slot = Satellite::new(System::Glonass, 7);
        let near = GpsTime::from_utc(Calendar {
            year: 2023,
            month: 5,
            day: 1,
            hour: 1,
            minute: 50,
            second: 0.0,
        })
        .unwrap();
        let Ok(Ephemeris::Glonass(read)) = message().ephemeris(slot, 3, near) else { panic!() };
        // 04:45 in Moscow is 01:45 UTC.
        assert_eq!(near - read.elements().reference_time, 300.0);
        let again = GlonassMessage::of(read.elements(), near);
        assert_eq!(again.reference_s, message().reference_s);
        assert_eq!(again.day, 366 + 365 + 365 + 31 + 28 + 31 + 30 + 1);
        assert_eq!(again.four_years, 7);
        // 12:00 in Moscow is 09:00 UTC.
        assert_eq!(again.date().unwrap() + 18.0 - near, 7.0 * 3600.0 + 600.0);
    }
}
