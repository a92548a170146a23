//! Time tags: `YYYY-MM-DDThh:mm:ss[.d…][Z]` or `YYYY-DDDThh:mm:ss[.d…][Z]` in a named time system.

use kurs::time::{Calendar, GpsTime};

/// TAI − GPST, s.
const TAI_MINUS_GPST_S: f64 = 19.0;
/// TT − TAI, s.
const TT_MINUS_TAI_S: f64 = 32.184;

/// Time systems that ground measurements come in.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TimeSystem {
    /// Coordinated universal time.
    Utc,
    /// GPS time.
    Gps,
    /// International atomic time.
    Tai,
    /// Terrestrial time.
    Tt,
}

impl TimeSystem {
    /// By its name in the registry: `UTC`, `GPS`, `TAI` or `TT`.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        match name {
            "UTC" => Some(Self::Utc),
            "GPS" => Some(Self::Gps),
            "TAI" => Some(Self::Tai),
            "TT" => Some(Self::Tt),
            _ => None,
        }
    }

    /// The instant that a time tag means; `None` if it is not a time.
    #[must_use]
    pub fn instant(self, text: &str) -> Option<GpsTime> {
        let date = calendar(text)?;
        match self {
            Self::Utc => GpsTime::from_utc(date),
            Self::Gps => GpsTime::from_calendar(date),
            Self::Tai => Some(GpsTime::from_calendar(date)? + -TAI_MINUS_GPST_S),
            Self::Tt => Some(GpsTime::from_calendar(date)? + -(TAI_MINUS_GPST_S + TT_MINUS_TAI_S)),
        }
    }
}

fn calendar(text: &str) -> Option<Calendar> {
    let (date, time) = text.strip_suffix('Z').unwrap_or(text).split_once('T')?;
    let mut time = time.split(':');
    let (hour, minute, second) = (digits(time.next()?)?, digits(time.next()?)?, time.next()?);
    let plain = second.bytes().all(|byte| byte.is_ascii_digit() || byte == b'.');
    if time.next().is_some() || !plain {
        return None;
    }
    let mut date = date.split('-');
    let (year, middle, last) = (date.next()?, date.next()?, date.next());
    let (month, day) = match last {
        Some(day) => (digits(middle)?, digits(day)?),
        None => month_and_day(digits(year)?, digits(middle)?)?,
    };
    date.next().is_none().then_some(())?;
    Some(Calendar {
        year: digits(year)?,
        month: u8::try_from(month).ok()?,
        day: u8::try_from(day).ok()?,
        hour: u8::try_from(hour).ok()?,
        minute: u8::try_from(minute).ok()?,
        second: second.parse().ok()?,
    })
}

/// A number of at most four digits.
fn digits(text: &str) -> Option<i32> {
    let plain = (1..=4).contains(&text.len()) && text.bytes().all(|byte| byte.is_ascii_digit());
    if plain { text.parse().ok() } else { None }
}

/// Month and day of a day of the year, 1 to 366.
fn month_and_day(year: i32, day_of_year: i32) -> Option<(i32, i32)> {
    let leap = (year % 4 == 0 && year % 100 != 0) || year % 400 == 0;
    let february = if leap { 29 } else { 28 };
    let mut rest = day_of_year;
    for (month, days) in (1..).zip([31, february, 31, 30, 31, 30, 31, 31, 30, 31, 30, 31]) {
        if (1..=days).contains(&rest) {
            return Some((month, rest));
        }
        rest -= days;
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn day_of_year_and_time_systems() {
        let utc = |text| TimeSystem::Utc.instant(text);
        assert_eq!(utc("2024-061T00:00:00Z"), utc("2024-03-01T00:00:00"));
        assert_eq!(utc("2023-365T23:59:59.5"), utc("2023-12-31T23:59:59.5Z"));
        // GPST − UTC = 18 s in 2024, TAI − GPST = 19 s, TT − TAI = 32.184 s
        let instant = utc("2024-03-01T00:00:00");
        assert_eq!(TimeSystem::Gps.instant("2024-03-01T00:00:18"), instant);
        assert_eq!(TimeSystem::Tai.instant("2024-03-01T00:00:37"), instant);
        assert_eq!(TimeSystem::Tt.instant("2024-03-01T00:01:09.184"), instant);
    }

    #[test]
    fn what_is_not_a_time_is_refused() {
        for text in [
            "",
            "2024",
            "2024-03-01",
            "2024-03-01T00:00",
            "2024-366-1T00:00:00",
            "2023-366T00:00:00",
            "2024-000T00:00:00",
            "2024-03-01T00:00:-1",
            "2024-03-01T0x:00:00",
            "2024-03-01T00:00:00:00",
            "99999-03-01T00:00:00",
            "2024-03-01T00:00:1e1",
            "2024-02-30T00:00:00",
        ] {
            assert_eq!(TimeSystem::Utc.instant(text), None, "{text}");
        }
    }
}
