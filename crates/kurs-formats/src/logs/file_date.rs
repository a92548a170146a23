//! The date in the name of a file.

use kurs::time::{Calendar, GpsTime};

/// Noon of the day that a file's name tells, if it tells one: `base_2024-06-16.rtcm3`,
/// `20240616T1200.ubx`, `SITE00XXX_R_20241681200_…` (year and day of the year), `site1680.24_`.
pub(crate) fn of_name(path: &str) -> Option<GpsTime> {
    let name = path.rsplit(['/', '\\']).next()?;
    let runs = digit_runs(name);
    let separated = runs.windows(3).find_map(|three| separated_date(name, three));
    separated
        .or_else(|| runs.iter().find_map(|run| packed_date(run.digits)))
        .or_else(|| short(name))
}

/// Digits in a row.
#[derive(Debug, Clone, Copy)]
struct Run<'a> {
    start: usize,
    digits: &'a str,
}

fn digit_runs(name: &str) -> Vec<Run<'_>> {
    let mut runs = Vec::new();
    let mut rest = 0;
    while let Some(start) = name[rest..].find(|c: char| c.is_ascii_digit()).map(|at| rest + at) {
        let behind = name[start..].find(|c: char| !c.is_ascii_digit());
        let end = behind.map_or(name.len(), |length| start + length);
        runs.push(Run { start, digits: &name[start..end] });
        rest = end;
    }
    runs
}

/// `2024-06-16`, `2024_6_16`: four digits, then at most two and two, one character between them.
fn separated_date(name: &str, runs: &[Run<'_>]) -> Option<GpsTime> {
    let [year, month, day] = runs else { return None };
    let follows = |a: &Run<'_>, b: &Run<'_>| {
        b.start == a.start + a.digits.len() + 1
            && matches!(name.as_bytes()[b.start - 1], b'-' | b'_' | b'.')
    };
    let is_date = year.digits.len() == 4 && month.digits.len() <= 2 && day.digits.len() <= 2;
    (is_date && follows(year, month) && follows(month, day))
        .then(|| {
            noon(year.digits.parse().ok()?, month.digits.parse().ok()?, day.digits.parse().ok()?)
        })
        .flatten()
}

/// `20240616` and what follows it without a break; `20241681200` as the long names of RINEX.
fn packed_date(digits: &str) -> Option<GpsTime> {
    let number = |range: core::ops::Range<usize>| digits.get(range)?.parse::<u16>().ok();
    let year = i32::from(number(0..4)?);
    match digits.len() {
        7 | 11 => day_of_year(year, number(4..7)?),
        8 | 10 | 12 | 14 => {
            noon(year, u8::try_from(number(4..6)?).ok()?, u8::try_from(number(6..8)?).ok()?)
        }
        _ => None,
    }
}

/// `ssssdddf.yyt`: station, day of the year, session, year.
fn short(name: &str) -> Option<GpsTime> {
    let [_, _, _, _, d, dd, ddd, _, b'.', y, yy, _, rest @ ..] = name.as_bytes() else {
        return None;
    };
    let digit = |byte: u8| byte.is_ascii_digit().then(|| u16::from(byte - b'0'));
    if !matches!(rest, [] | [b'.', ..]) {
        return None;
    }
    let day = 100 * digit(*d)? + 10 * digit(*dd)? + digit(*ddd)?;
    let year = i32::from(10 * digit(*y)? + digit(*yy)?);
    day_of_year(if year < 80 { 2000 + year } else { 1900 + year }, day)
}

fn day_of_year(year: i32, day: u16) -> Option<GpsTime> {
    const DAY_S: f64 = 86_400.0;
    let date = noon(year, 1, 1)? + DAY_S * f64::from(day.checked_sub(1)?);
    (date.calendar().year == year).then_some(date)
}

/// Noon of a day between 1990 and 2090.
fn noon(year: i32, month: u8, day: u8) -> Option<GpsTime> {
    let date = Calendar { year, month, day, hour: 12, minute: 0, second: 0.0 };
    GpsTime::from_calendar(date).filter(|_| (1990..2090).contains(&year))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dates_of_names() {
        let day = GpsTime::from_week_tow(2319, 43_200.0);
        for name in [
            "base_2024-06-16.rtcm3",
            "/data/2024_06_16_10-00-00_gnss.ubx",
            "COM3___9600_20240616_101500.ubx",
            "20240616101500.sbf",
            "C:\\logs\\SITE00XXX_R_20241681200_01H_01S_MO.rtcm3.gz",
            "site168a.24_",
            "2023/site1680.24o.Z",
        ] {
            assert_eq!(of_name(name), day, "{name}");
        }
        for name in ["A.rtcm3", "log12345678.ubx", "2024-13-16.ubx", "20249991200", "site9990.24o"]
        {
            assert_eq!(of_name(name), None, "{name}");
        }
    }
}
