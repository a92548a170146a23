//! The times of epochs: their interval, and where epochs are missing.

use std::collections::BTreeMap;

use kurs::time::GpsTime;
use serde::Serialize;

/// A step longer than this many intervals is a gap.
const GAP_INTERVALS: f64 = 1.5;
/// Gaps that are listed.
const LISTED_MAX: usize = 1000;

/// Takes times in, one after the other and each later than the one before.
#[derive(Debug, Default)]
pub(super) struct Timeline {
    epochs: u64,
    first: Option<GpsTime>,
    last: Option<GpsTime>,
    /// How often each step came, in whole milliseconds (receivers' tags wander by less).
    steps_ms: BTreeMap<i64, u64>,
    /// Steps that were long against the shortest so far, to be judged at the end.
    long: Vec<(GpsTime, GpsTime)>,
}

/// When there are epochs, and when not.
#[derive(Debug, Serialize)]
pub(super) struct TimeReport {
    pub(super) epochs: u64,
    /// Whether the week is known; if not, times are days of a week.
    pub(super) is_dated: bool,
    /// First and last epoch, GPST.
    pub(super) first: Option<String>,
    pub(super) last: Option<String>,
    /// The most frequent step, s.
    pub(super) interval_s: Option<f64>,
    /// Every step with its number, s.
    pub(super) steps: Vec<Step>,
    pub(super) gaps: Gaps,
}

/// How often epochs were this far apart.
#[derive(Debug, Serialize)]
pub(super) struct Step {
    pub(super) step_s: f64,
    pub(super) count: u64,
}

/// Missing epochs.
#[derive(Debug, Default, Serialize)]
pub(super) struct Gaps {
    pub(super) count: u64,
    pub(super) missing_epochs: u64,
    pub(super) longest_s: f64,
    /// The first of them.
    pub(super) listed: Vec<Gap>,
}

/// From the last epoch before it to the first one behind it, GPST.
#[derive(Debug, Serialize)]
pub(super) struct Gap {
    pub(super) from: String,
    pub(super) to: String,
}

impl Timeline {
    /// Takes in the next epoch; returns the step to it, s.
    pub(super) fn add(&mut self, time: GpsTime) -> Option<f64> {
        self.epochs += 1;
        self.first.get_or_insert(time);
        let before = self.last.replace(time)?;
        let step_ms = milliseconds(before, time);
        *self.steps_ms.entry(step_ms).or_default() += 1;
        let shortest = self.steps_ms.first_key_value().map_or(step_ms, |(step, _)| *step);
        if is_gap(step_ms, shortest) && self.long.len() < LISTED_MAX {
            self.long.push((before, time));
        }
        Some(time - before)
    }

    /// The most frequent step, s; of several the shortest.
    pub(super) fn interval_s(&self) -> Option<f64> {
        self.interval_ms().map(|step| step as f64 * 1e-3)
    }

    fn interval_ms(&self) -> Option<i64> {
        let most = self.steps_ms.values().max()?;
        self.steps_ms.iter().find(|(_, count)| *count == most).map(|(step, _)| *step)
    }

    /// The first and the last time.
    pub(super) fn span(&self) -> Option<(GpsTime, GpsTime)> {
        self.first.zip(self.last)
    }

    /// The time of the observations, the interval behind the last one included; `None` of fewer
    /// than two.
    pub(super) fn duration_s(&self) -> Option<f64> {
        let (first, last) = self.span()?;
        Some(last - first + self.interval_s()?)
    }

    /// In words; `is_dated` says whether the week is known.
    pub(super) fn report(&self, is_dated: bool) -> TimeReport {
        let steps = self.steps_ms.iter();
        let words = |time: GpsTime| words(time, is_dated);
        TimeReport {
            epochs: self.epochs,
            is_dated,
            first: self.first.map(words),
            last: self.last.map(words),
            interval_s: self.interval_s(),
            steps: steps
                .map(|(step, count)| Step { step_s: *step as f64 * 1e-3, count: *count })
                .collect(),
            gaps: self.interval_ms().map_or_else(Gaps::default, |ms| self.gaps(ms, words)),
        }
    }

    fn gaps(&self, interval_ms: i64, words: impl Fn(GpsTime) -> String) -> Gaps {
        let mut gaps = Gaps::default();
        for (&step, &count) in self.steps_ms.iter().filter(|(step, _)| is_gap(**step, interval_ms))
        {
            gaps.count += count;
            let intervals = (step + interval_ms / 2) / interval_ms;
            gaps.missing_epochs += count * u64::try_from(intervals - 1).unwrap_or(0);
            gaps.longest_s = step as f64 * 1e-3;
        }
        let long = self.long.iter().filter(|(a, b)| is_gap(milliseconds(*a, *b), interval_ms));
        gaps.listed = long.map(|(a, b)| Gap { from: words(*a), to: words(*b) }).collect();
        gaps
    }
}

/// The date and time, or the day of the week where the week is not known.
fn words(time: GpsTime, is_dated: bool) -> String {
    const DAYS: [&str; 7] =
        ["Sunday", "Monday", "Tuesday", "Wednesday", "Thursday", "Friday", "Saturday"];
    const DAY_NS: i64 = 86_400_000_000_000;
    let text = time.to_string();
    if is_dated {
        return text;
    }
    let day = usize::try_from(time.as_nanoseconds().div_euclid(DAY_NS).rem_euclid(7)).unwrap_or(0);
    let of_day = text.split_once('T').map_or("", |(_, of_day)| of_day);
    format!("{} {of_day}", DAYS[day])
}

fn milliseconds(from: GpsTime, to: GpsTime) -> i64 {
    // At least 1: epochs come in order.
    ((to.as_nanoseconds() - from.as_nanoseconds() + 500_000) / 1_000_000).max(1)
}

fn is_gap(step_ms: i64, interval_ms: i64) -> bool {
    step_ms as f64 > GAP_INTERVALS * interval_ms as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    fn report(tenths: &[i64]) -> TimeReport {
        let mut timeline = Timeline::default();
        for tenth in tenths {
            timeline.add(GpsTime::from_nanoseconds(tenth * 100_000_000));
        }
        timeline.report(true)
    }

    #[test]
    fn gaps_are_steps_of_several_intervals() {
        let times = report(&[0, 10, 20, 50, 60, 70, 170]);
        assert_eq!((times.epochs, times.interval_s), (7, Some(1.0)));
        assert_eq!((times.gaps.count, times.gaps.missing_epochs), (2, 2 + 9));
        assert_eq!(times.gaps.longest_s, 10.0);
        assert_eq!(times.gaps.listed[0].from, "1980-01-06T00:00:02.000");
        assert_eq!(times.gaps.listed[0].to, "1980-01-06T00:00:05.000");
    }

    /// A file that begins with two epochs close to each other has no gaps for that.
    #[test]
    fn a_short_step_is_not_the_interval() {
        let times = report(&[0, 1, 300, 600, 900, 1200]);
        assert_eq!(times.interval_s, Some(30.0));
        assert_eq!(times.gaps.count, 0);
        assert_eq!(times.gaps.listed.len(), 0);
    }

    /// GPS time began on a Sunday.
    #[test]
    fn days_of_an_unknown_week() {
        let mut timeline = Timeline::default();
        timeline.add(GpsTime::from_week_tow(2300, 2.5 * 86_400.0 + 1.25).unwrap());
        timeline.add(GpsTime::from_week_tow(2300, 604_799.0).unwrap());
        let times = timeline.report(false);
        assert_eq!(times.first.as_deref(), Some("Tuesday 12:00:01.250"));
        assert_eq!(times.last.as_deref(), Some("Saturday 23:59:59.000"));
    }

    #[test]
    fn one_epoch_and_none() {
        assert_eq!((report(&[]).epochs, report(&[]).interval_s), (0, None));
        let one = report(&[5]);
        assert_eq!((one.epochs, one.gaps.count), (1, 0));
        assert_eq!(one.first, one.last);
    }
}
