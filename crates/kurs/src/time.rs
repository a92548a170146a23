//! Time. Inside Kurs there is one scale, GPS time (GPST); every other one is converted on input.
//!
//! A receiver's clock bias is *not* folded in: 1 ns is 0.3 m of range, so the bias is kept as an
//! `f64` in metres next to the position it was estimated with.

use core::fmt;
use core::ops::{Add, AddAssign, Sub};

/// Seconds in a GPS week.
pub const WEEK_S: f64 = 604_800.0;
/// GPST minus BeiDou time, constant since 2006: BDT = GPST − 14 s.
pub const GPST_MINUS_BDT_S: f64 = 14.0;

const NS_PER_S: i64 = 1_000_000_000;
const NS_PER_DAY: i64 = 86_400 * NS_PER_S;
const NS_PER_WEEK: i64 = 7 * NS_PER_DAY;
/// 1980-01-06, the GPS epoch, in days since 1970-01-01.
const GPS_EPOCH_DAY: i64 = 3657;
/// BeiDou week 0 began in GPS week 1356 (2006-01-01).
const BEIDOU_WEEK_0: i32 = 1356;

/// UTC days that begin with a new leap-second count, and that count: GPST − UTC in seconds.
/// Source: IERS Bulletin C, issues 1 to 71 (no leap second up to December 2026).
const LEAP_SECONDS: [(i32, u8, i32); 18] = [
    (1981, 7, 1),
    (1982, 7, 2),
    (1983, 7, 3),
    (1985, 7, 4),
    (1988, 1, 5),
    (1990, 1, 6),
    (1991, 1, 7),
    (1992, 7, 8),
    (1993, 7, 9),
    (1994, 7, 10),
    (1996, 1, 11),
    (1997, 7, 12),
    (1999, 1, 13),
    (2006, 1, 14),
    (2009, 1, 15),
    (2012, 7, 16),
    (2015, 7, 17),
    (2017, 1, 18),
];

/// An instant on the GPS time scale, in whole nanoseconds since 1980-01-06 00:00:00 GPST.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct GpsTime {
    nanoseconds: i64,
}

/// A calendar date and time of day, in a time scale that its user names.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Calendar {
    /// Full year, for example 2024.
    pub year: i32,
    /// 1 to 12.
    pub month: u8,
    /// 1 to 31.
    pub day: u8,
    /// 0 to 23.
    pub hour: u8,
    /// 0 to 59.
    pub minute: u8,
    /// 0 ≤ `second` < 61 (60 only inside a UTC leap second).
    pub second: f64,
}

#[cfg(feature = "serde")]
impl serde::Serialize for GpsTime {
    /// `{"week": 2320, "tow_s": 116400.0}`
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        use serde::ser::SerializeStruct;
        let mut fields = serializer.serialize_struct("GpsTime", 2)?;
        fields.serialize_field("week", &self.week())?;
        fields.serialize_field("tow_s", &self.tow_s())?;
        fields.end()
    }
}

impl GpsTime {
    /// From a full (not 10-bit) GPS week number and seconds of week, `0 ≤ tow_s < 604800`.
    ///
    /// Returns `None` if `tow_s` is outside the week or not a number, or `week` is negative.
    #[must_use]
    pub fn from_week_tow(week: i32, tow_s: f64) -> Option<Self> {
        let inside = week >= 0 && (0.0..WEEK_S).contains(&tow_s);
        let start = i64::from(week).checked_mul(NS_PER_WEEK).filter(|_| inside)?;
        Some(Self { nanoseconds: start.checked_add(nanoseconds(tow_s))? })
    }

    /// From a BeiDou week and seconds of week (BDT).
    #[must_use]
    pub fn from_beidou_week_tow(week: i32, tow_s: f64) -> Option<Self> {
        Some(Self::from_week_tow(week.checked_add(BEIDOU_WEEK_0)?, tow_s)? + GPST_MINUS_BDT_S)
    }

    /// From a date and time of day on the GPS scale; `None` if a field is out of its range or the
    /// date is before 1980-01-06 or after 2271.
    #[must_use]
    pub fn from_calendar(date: Calendar) -> Option<Self> {
        let Calendar { year, month, day, hour, minute, second } = date;
        let valid = (1980..=9999).contains(&year)
            && (1..=12).contains(&month)
            && (1..=days_in_month(year, month)).contains(&day)
            && hour < 24
            && minute < 60
            && (0.0..61.0).contains(&second);
        if !valid {
            return None;
        }
        let days = days_from_civil(year, month, day) - GPS_EPOCH_DAY;
        let seconds = i64::from(hour) * 3600 + i64::from(minute) * 60;
        let of_day = seconds * NS_PER_S + nanoseconds(second);
        let nanoseconds = days.checked_mul(NS_PER_DAY)?.checked_add(of_day)?;
        (nanoseconds >= 0).then_some(Self { nanoseconds })
    }

    /// From a date and time of day in UTC, by the built-in table of leap seconds.
    #[must_use]
    pub fn from_utc(date: Calendar) -> Option<Self> {
        let leap = leap_seconds_at_utc(date.year, date.month);
        Some(Self::from_calendar(date)? + f64::from(leap))
    }

    /// The instant closest to this one that has these seconds of week: broadcast data give times
    /// without a trustworthy week number. `None` if `tow_s` is not finite or not within two weeks.
    #[must_use]
    pub fn nearest_with_tow(self, tow_s: f64) -> Option<Self> {
        if tow_s.is_nan() || tow_s.abs() > 2.0 * WEEK_S {
            return None;
        }
        let ahead_s = tow_s - self.tow_s();
        Some(self + (ahead_s - WEEK_S * (ahead_s / WEEK_S).round()))
    }

    /// From nanoseconds since 1980-01-06 00:00:00 GPST.
    #[must_use]
    pub const fn from_nanoseconds(nanoseconds: i64) -> Self {
        Self { nanoseconds }
    }

    /// Nanoseconds since 1980-01-06 00:00:00 GPST.
    #[must_use]
    pub const fn as_nanoseconds(self) -> i64 {
        self.nanoseconds
    }

    /// Full GPS week number.
    #[must_use]
    pub const fn week(self) -> i64 {
        self.nanoseconds.div_euclid(NS_PER_WEEK)
    }

    /// Seconds of the GPS week, `0 ≤ tow_s < 604800`: the nearest number, so that whole seconds are
    /// whole (a quotient rounds once, a product with 1e-9 twice).
    #[must_use]
    pub const fn tow_s(self) -> f64 {
        self.nanoseconds.rem_euclid(NS_PER_WEEK) as f64 / NS_PER_S as f64
    }

    /// Date and time of day on the GPS scale.
    #[must_use]
    pub fn calendar(self) -> Calendar {
        let day = self.nanoseconds.div_euclid(NS_PER_DAY);
        let in_day = self.nanoseconds.rem_euclid(NS_PER_DAY);
        let (year, month, day) = civil_from_days(day + GPS_EPOCH_DAY);
        Calendar {
            year,
            month,
            day,
            hour: small(in_day / (3600 * NS_PER_S)),
            minute: small(in_day / (60 * NS_PER_S) % 60),
            second: (in_day % (60 * NS_PER_S)) as f64 * 1e-9,
        }
    }

    /// Date and time of day in UTC, by the built-in table of leap seconds; a leap second itself
    /// reads as second 60.
    #[must_use]
    pub fn utc(self) -> Calendar {
        let leap = self.leap_seconds();
        let utc = (self + -f64::from(leap)).calendar();
        let inside_leap_second = (self + 1.0).leap_seconds() > leap;
        if inside_leap_second && leap_seconds_at_utc(utc.year, utc.month) > leap {
            let mut last = (self + -f64::from(leap + 1)).calendar();
            last.second += 1.0;
            return last;
        }
        utc
    }

    /// GPST − UTC at this instant, in seconds, from the built-in table.
    #[must_use]
    pub fn leap_seconds(self) -> i32 {
        // The count changes when the leap second ends: at 00:00:00 UTC of that day.
        let has_ended = |(year, month, leap): &(i32, u8, i32)| {
            let day = days_from_civil(*year, *month, 1) - GPS_EPOCH_DAY;
            self.nanoseconds >= day * NS_PER_DAY + i64::from(*leap) * NS_PER_S
        };
        LEAP_SECONDS.iter().rfind(|entry| has_ended(entry)).map_or(0, |(_, _, leap)| *leap)
    }
}

impl Calendar {
    /// The time written as ISO 8601 with `digits` decimals of the second and no zone suffix.
    ///
    /// Rounds half up, carrying into the minute and so on, so that "60.000" is never printed for an
    /// ordinary second.
    #[must_use]
    pub fn iso(self, digits: usize) -> String {
        let digits = digits.min(9);
        #[allow(clippy::cast_possible_truncation)] // at most 9
        let scale = 10_u64.pow(digits as u32);
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // 0 ≤ second < 61
        let rounded = (self.second * scale as f64 + 0.5) as u64;
        if rounded >= 60 * scale
            && self.second < 60.0
            && let Some(minute) = GpsTime::from_calendar(Self { second: 0.0, ..self })
        {
            return (minute + 60.0).calendar().iso(digits);
        }
        let fields: [(u64, usize, u8); 5] = [
            (self.year.unsigned_abs().into(), 4, b'-'),
            (self.month.into(), 2, b'-'),
            (self.day.into(), 2, b'T'),
            (self.hour.into(), 2, b':'),
            (self.minute.into(), 2, b':'),
        ];
        let mut text = Vec::with_capacity(32);
        for (number, width, end) in fields {
            push_digits(&mut text, number, width);
            text.push(end);
        }
        push_digits(&mut text, rounded / scale, 2);
        if digits > 0 {
            text.push(b'.');
            push_digits(&mut text, rounded % scale, digits);
        }
        String::from_utf8(text).unwrap_or_default()
    }
}

impl fmt::Display for GpsTime {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.calendar().iso(3))
    }
}

impl Sub for GpsTime {
    type Output = f64;
    /// Elapsed seconds.
    #[allow(clippy::suspicious_arithmetic_impl)] // the factor turns nanoseconds into seconds
    fn sub(self, earlier: Self) -> f64 {
        let elapsed_ns = self.nanoseconds.saturating_sub(earlier.nanoseconds);
        elapsed_ns as f64 * 1e-9
    }
}

impl Add<f64> for GpsTime {
    type Output = Self;
    /// The instant `seconds` later (earlier if negative), rounded to a nanosecond.
    fn add(self, seconds: f64) -> Self {
        Self { nanoseconds: self.nanoseconds.saturating_add(nanoseconds(seconds)) }
    }
}

impl AddAssign<f64> for GpsTime {
    fn add_assign(&mut self, seconds: f64) {
        *self = *self + seconds;
    }
}

#[allow(clippy::cast_possible_truncation)] // `as` saturates, and ±292 years are enough
fn nanoseconds(seconds: f64) -> i64 {
    (seconds * 1e9).round() as i64
}

/// The last `width` digits of a number.
fn push_digits(text: &mut Vec<u8>, number: u64, width: usize) {
    let start = text.len();
    text.resize(start + width, b'0');
    let mut rest = number;
    for digit in text[start..].iter_mut().rev() {
        *digit = b'0' + (rest % 10) as u8;
        rest /= 10;
    }
}

fn small(value: i64) -> u8 {
    u8::try_from(value).unwrap_or(u8::MAX)
}

fn leap_seconds_at_utc(year: i32, month: u8) -> i32 {
    let begun = LEAP_SECONDS.iter().rev().find(|(y, m, _)| (*y, *m) <= (year, month));
    begun.map_or(0, |(_, _, leap)| *leap)
}

fn days_in_month(year: i32, month: u8) -> u8 {
    match month {
        4 | 6 | 9 | 11 => 30,
        2 if year % 4 == 0 && (year % 100 != 0 || year % 400 == 0) => 29,
        2 => 28,
        _ => 31,
    }
}

/// Days since 1970-01-01 of a Gregorian date; the year is counted from March, so that the leap day
/// is its last one.
fn days_from_civil(year: i32, month: u8, day: u8) -> i64 {
    let (month, day) = (i64::from(month), i64::from(day));
    let year = i64::from(year) - i64::from(month <= 2);
    let century_cycle = year.div_euclid(400);
    let year_of_cycle = year.rem_euclid(400);
    let month_from_march = (month + 9) % 12;
    let day_of_year = (153 * month_from_march + 2) / 5 + day - 1;
    let day_of_cycle = year_of_cycle * 365 + year_of_cycle / 4 - year_of_cycle / 100 + day_of_year;
    century_cycle * 146_097 + day_of_cycle - 719_468
}

/// Inverse of [`days_from_civil`].
fn civil_from_days(days: i64) -> (i32, u8, u8) {
    let days = days + 719_468;
    let century_cycle = days.div_euclid(146_097);
    let day_of_cycle = days.rem_euclid(146_097);
    let year_of_cycle =
        (day_of_cycle - day_of_cycle / 1460 + day_of_cycle / 36_524 - day_of_cycle / 146_096) / 365;
    let day_of_year =
        day_of_cycle - (365 * year_of_cycle + year_of_cycle / 4 - year_of_cycle / 100);
    let month_from_march = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * month_from_march + 2) / 5 + 1;
    let month = (month_from_march + 2) % 12 + 1;
    let year = year_of_cycle + century_cycle * 400 + i64::from(month <= 2);
    (i32::try_from(year).unwrap_or(i32::MAX), small(month), small(day))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn date(year: i32, month: u8, day: u8, hour: u8, minute: u8, second: f64) -> Calendar {
        Calendar { year, month, day, hour, minute, second }
    }

    #[test]
    fn week_rollover_is_one_second() {
        let saturday = GpsTime::from_week_tow(2300, 604_799.5).unwrap();
        let sunday = GpsTime::from_week_tow(2301, 0.5).unwrap();
        assert_eq!(sunday - saturday, 1.0);
        assert_eq!(saturday + 1.0, sunday);
        assert_eq!(GpsTime::from_week_tow(2300, 604_800.0), None);
        assert_eq!(GpsTime::from_week_tow(2300, f64::NAN), None);
        assert_eq!(GpsTime::from_week_tow(i32::MAX, 0.0), None);
    }

    /// 118 800 s, Monday 09:00, is one of the products with 1e-9 that miss their whole number.
    #[test]
    fn whole_seconds_of_the_week_are_whole() {
        for second in (0..604_800).step_by(8) {
            let tow_s = f64::from(second);
            assert_eq!(GpsTime::from_week_tow(2300, tow_s).unwrap().tow_s(), tow_s);
        }
    }

    #[test]
    fn nearest_time_of_week_crosses_the_week_boundary() {
        let sunday = GpsTime::from_week_tow(2301, 30.0).unwrap();
        let saturday = GpsTime::from_week_tow(2300, 604_784.0).unwrap();
        assert_eq!(sunday.nearest_with_tow(604_784.0), Some(saturday));
        assert_eq!(saturday.nearest_with_tow(30.0), Some(sunday));
        assert_eq!(saturday.nearest_with_tow(604_830.0), Some(sunday));
        assert_eq!(sunday.nearest_with_tow(f64::NAN), None);
        assert_eq!(sunday.nearest_with_tow(1e9), None);
    }

    #[test]
    fn calendar_round_trips_every_day_of_120_years() {
        for day in 0..365 * 120 {
            let time = GpsTime::from_nanoseconds(day * NS_PER_DAY + 12_345 * NS_PER_S);
            assert_eq!(GpsTime::from_calendar(time.calendar()), Some(time), "{time}");
        }
    }

    /// GPS week 2320, day 1 (Monday) is 2024-06-24.
    #[test]
    fn known_week() {
        let time = GpsTime::from_calendar(date(2024, 6, 24, 8, 20, 0.0)).unwrap();
        assert_eq!((time.week(), time.tow_s()), (2320, 86_400.0 + 8.0 * 3600.0 + 1200.0));
        assert_eq!(GpsTime::from_calendar(date(9999, 1, 1, 0, 0, 0.0)), None);
    }

    #[test]
    fn leap_second_of_2016() {
        let before = GpsTime::from_utc(date(2016, 12, 31, 23, 59, 59.0)).unwrap();
        let after = GpsTime::from_utc(date(2017, 1, 1, 0, 0, 0.0)).unwrap();
        assert_eq!(after - before, 2.0);
        assert_eq!((before.leap_seconds(), after.leap_seconds()), (17, 18));
        assert_eq!((before + 1.0).utc().iso(0), "2016-12-31T23:59:60");
        assert_eq!(before.utc().iso(1), "2016-12-31T23:59:59.0");
        assert_eq!(after.utc().iso(0), "2017-01-01T00:00:00");
    }

    #[test]
    fn rounding_carries_into_the_next_year() {
        assert_eq!(date(2023, 12, 31, 23, 59, 59.9996).iso(3), "2024-01-01T00:00:00.000");
    }

    #[test]
    fn impossible_dates_are_refused() {
        for wrong in [
            date(2023, 2, 29, 0, 0, 0.0),
            date(2023, 13, 1, 0, 0, 0.0),
            date(2023, 1, 1, 24, 0, 0.0),
            date(2023, 1, 1, 0, 0, f64::NAN),
            date(1980, 1, 5, 0, 0, 0.0),
        ] {
            assert_eq!(GpsTime::from_calendar(wrong), None, "{wrong:?}");
        }
    }

    #[test]
    fn beidou_weeks_count_from_2006() {
        let beidou = GpsTime::from_beidou_week_tow(0, 0.0).unwrap();
        assert_eq!(beidou.utc(), date(2006, 1, 1, 0, 0, 0.0));
    }
}
