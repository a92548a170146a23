//! How many epochs a session has: its span at its interval, gaps that no antenna has included.

use std::collections::BTreeMap;

use kurs::time::GpsTime;

/// Share of the steps that may be shorter than the interval: a double epoch, a tag that jumped.
const MAX_SHORTER_STEPS: f64 = 0.05;
/// Steps up to so many times the shortest regular one are that interval with jitter, longer ones gaps.
const JITTER: f64 = 1.5;

/// Times of rows, as they come in.
#[derive(Debug, Default)]
pub(crate) struct SessionSpan {
    first: Option<GpsTime>,
    last: Option<GpsTime>,
    rows: u64,
    /// How often each step from row to row came, by milliseconds.
    steps_ms: BTreeMap<u64, u64>,
}

impl SessionSpan {
    /// Takes the time of the next row.
    pub(crate) fn add(&mut self, time: GpsTime) {
        self.first.get_or_insert(time);
        self.rows += 1;
        if let Some(last) = self.last.replace(time) {
            // Steps are positive and shorter than the age of GPS.
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
            let step_ms = (1e3 * (time - last)).round().max(0.0) as u64;
            *self.steps_ms.entry(step_ms).or_default() += 1;
        }
    }

    /// How many rows there are.
    pub(crate) fn rows(&self) -> u64 {
        self.rows
    }

    /// Time of the first row.
    pub(crate) fn first(&self) -> Option<GpsTime> {
        self.first
    }

    /// Time of the last row.
    pub(crate) fn last(&self) -> Option<GpsTime> {
        self.last
    }

    /// Whether epochs are missing between two rows that are so far apart, s, as far as is known.
    pub(crate) fn is_gap(&self, step_s: f64) -> bool {
        self.interval_s().is_some_and(|interval_s| step_s > JITTER * interval_s)
    }

    /// How many gaps there are, and the longest, s; `None` without any.
    pub(crate) fn gaps(&self) -> Option<(u64, f64)> {
        let interval_ms = 1e3 * self.interval_s()?;
        let gaps = self.steps_ms.iter().filter(|(ms, _)| **ms as f64 > JITTER * interval_ms);
        let longest_s = gaps.clone().next_back().map(|(ms, _)| *ms as f64 / 1e3)?;
        Some((gaps.map(|(_, count)| count).sum(), longest_s))
    }

    /// Regular time from epoch to epoch, s; `None` before there were two.
    pub(crate) fn interval_s(&self) -> Option<f64> {
        let steps = || self.steps_ms.iter().filter(|(step_ms, _)| **step_ms > 0);
        let regular_ms = quantile(steps(), MAX_SHORTER_STEPS)?;
        let with_jitter = steps().take_while(|(ms, _)| (**ms as f64) <= JITTER * regular_ms);
        Some(quantile(with_jitter, 0.5)? / 1e3)
    }

    /// Epochs of the whole span.
    pub(crate) fn epochs(&self) -> u64 {
        let span_s = self.first.zip(self.last).map_or(0.0, |(first, last)| last - first);
        // As many as there are steps in the span, and one.
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
        let regular =
            self.interval_s().map_or(0, |interval_s| (span_s / interval_s).round() as u64 + 1);
        regular.max(self.rows)
    }

    /// Epochs that no antenna has.
    pub(crate) fn missing(&self) -> u64 {
        self.epochs() - self.rows
    }
}

/// The value that a share of all counted ones does not exceed; `None` without any.
fn quantile<'a>(
    counts: impl Iterator<Item = (&'a u64, &'a u64)> + Clone,
    share: f64,
) -> Option<f64> {
    let total: u64 = counts.clone().map(|(_, count)| count).sum();
    let mut below = 0;
    let mut reached = counts.skip_while(|(_, count)| {
        below += **count;
        below as f64 <= share * total as f64
    });
    reached.next().map(|(value, _)| *value as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn span(times_s: impl IntoIterator<Item = f64>) -> SessionSpan {
        let mut span = SessionSpan::default();
        times_s.into_iter().for_each(|time_s| span.add(GpsTime::default() + time_s));
        span
    }

    #[test]
    fn gaps_count_at_the_interval() {
        let with_gap = (0..100).chain(400..500).map(|k| 0.2 * f64::from(k));
        let session = span(with_gap);
        assert_eq!(
            (session.interval_s(), session.epochs(), session.missing()),
            (Some(0.2), 500, 300)
        );
        // Every second epoch is missing for most of the time.
        let torn = (0..40).map(f64::from).chain((40..240).step_by(2).map(f64::from));
        assert_eq!(span(torn).epochs(), 239);
    }

    #[test]
    fn a_double_epoch_and_jitter_are_no_interval() {
        let doubled = (0..100).map(f64::from).chain([99.1]).chain((100..200).map(f64::from));
        assert_eq!(span(doubled).epochs(), 201, "no fewer than there are rows");
        let shaken = (0..200).map(|k| f64::from(k) + 0.02 * f64::from(k * 7 % 5 - 2));
        assert_eq!(span(shaken).epochs(), 200);
        assert_eq!(span([]).epochs(), 0);
        assert_eq!(span([5.0]).epochs(), 1);
        assert_eq!(span([5.0, 5.0]).epochs(), 2);
    }
}
