//! The part of a session that is used: `--from`, `--to`, `--every`.

use kurs::time::{Calendar, GpsTime};

use crate::failure::UsageError;

/// How far the time tag of an epoch may be from the multiple of `--every` that it stands for, s:
/// receivers let their clocks drift by a millisecond, some by several, before they correct them.
const MAX_TAG_ERROR_S: f64 = 0.01;

/// Which epochs count.
#[derive(Debug, Clone, Copy, Default, clap::Args)]
pub(crate) struct Window {
    /// Leaves out epochs before this GPS time, such as 2024-06-24T08:20:00.
    #[arg(long, value_name = "TIME", value_parser = parse_time)]
    from: Option<GpsTime>,
    /// Leaves out epochs after this GPS time.
    #[arg(long, value_name = "TIME", value_parser = parse_time)]
    to: Option<GpsTime>,
    /// Takes only the epochs at multiples of this many seconds.
    #[arg(long, value_name = "SECONDS", value_parser = parse_seconds)]
    every: Option<f64>,
}

impl Window {
    /// Refuses a window in which nothing can be.
    pub(crate) fn check(&self) -> Result<(), UsageError> {
        match (self.from, self.to) {
            (Some(from), Some(to)) if to < from => {
                Err(UsageError(format!("--to {to} is before --from {from}")))
            }
            _ => Ok(()),
        }
    }

    /// Whether an epoch counts.
    pub(crate) fn contains(&self, time: GpsTime) -> bool {
        self.from.is_none_or(|from| time >= from)
            && !self.is_after(time)
            && self.every.is_none_or(|every_s| is_multiple(time, every_s))
    }

    /// Whether an epoch, and every later one, is after it.
    pub(crate) fn is_after(&self, time: GpsTime) -> bool {
        self.to.is_some_and(|to| time > to)
    }

    /// The options, as they may be typed; nothing where all epochs count.
    pub(crate) fn options(&self) -> String {
        let from = self.from.map(|time| format!("--from {time}"));
        let to = self.to.map(|time| format!("--to {time}"));
        let every = self.every.map(|every_s| format!("--every {every_s}"));
        [from, to, every].into_iter().flatten().collect::<Vec<_>>().join(" ")
    }

    /// Whether all epochs count.
    pub(crate) fn is_everything(&self) -> bool {
        self.from.is_none() && self.to.is_none() && self.every.is_none()
    }
}

fn is_multiple(time: GpsTime, every_s: f64) -> bool {
    let since_epoch_s = time.as_nanoseconds() as f64 * 1e-9;
    let off_s = since_epoch_s - (since_epoch_s / every_s).round() * every_s;
    off_s.abs() <= MAX_TAG_ERROR_S.min(every_s / 4.0)
}

/// `2024-06-24T08:20:00`, with or without seconds or time of day.
pub(crate) fn parse_time(text: &str) -> Result<GpsTime, String> {
    calendar(text)
        .and_then(GpsTime::from_calendar)
        .ok_or_else(|| "expected a GPS time such as 2024-06-24T08:20:00".to_owned())
}

fn calendar(text: &str) -> Option<Calendar> {
    let (date, clock) = text.split_once(['T', ' ']).unwrap_or((text, "00:00"));
    let (mut date, mut clock) = (date.splitn(3, '-'), clock.splitn(3, ':'));
    Some(Calendar {
        year: date.next()?.parse().ok()?,
        month: date.next()?.parse().ok()?,
        day: date.next()?.parse().ok()?,
        hour: clock.next()?.parse().ok()?,
        minute: clock.next()?.parse().ok()?,
        second: clock.next().unwrap_or("0").parse().ok()?,
    })
}

/// A number of seconds, with or without their letter.
pub(crate) fn parse_seconds(text: &str) -> Result<f64, String> {
    let seconds =
        text.trim_end_matches('s').parse().ok().filter(|s: &f64| s.is_finite() && *s > 0.0);
    seconds.ok_or_else(|| "expected a number of seconds above 0".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_window_has_both_ends_and_steps() {
        let time = |text: &str| parse_time(text).unwrap();
        let window = Window {
            from: Some(time("2024-06-24 08:00")),
            to: Some(time("2024-06-24T09:00:00")),
            every: Some(30.0),
        };
        assert!(window.check().is_ok());
        assert_eq!(
            window.options(),
            "--from 2024-06-24T08:00:00.000 --to 2024-06-24T09:00:00.000 --every 30"
        );
        assert!(window.contains(time("2024-06-24T08:00:00")));
        assert!(window.contains(time("2024-06-24T09:00:00")));
        // A tag of a receiver whose clock is a millisecond slow.
        assert!(window.contains(time("2024-06-24T08:29:59.999")));
        assert!(!window.contains(time("2024-06-24T08:29:59")));
        assert!(!window.contains(time("2024-06-24T07:59:30")));
        assert!(!window.contains(time("2024-06-24T09:00:30")));
        let backwards = Window { from: window.to, to: window.from, every: None };
        assert!(backwards.check().unwrap_err().0.contains("is before --from"));
        assert!(
            Window::default().contains(time("1999-01-01")) && Window::default().is_everything()
        );
        assert_eq!(time("2024-06-24T08:20").tow_s(), 86_400.0 + 8.0 * 3600.0 + 1200.0);
        for wrong in ["", "08:00", "2024-13-01T00:00:00", "yesterdayT00:00", "2024-06-24T08"] {
            assert!(parse_time(wrong).is_err(), "{wrong}");
        }
        assert!(parse_seconds("0").is_err() && parse_seconds("30s") == Ok(30.0));
    }
}
