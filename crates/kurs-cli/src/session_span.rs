//! How many epochs a session has: its span at its interval, gaps that no antenna has included.

use std::collections::BTreeMap;
use std::ops::Range;

use kurs::time::GpsTime;

/// Share of the steps that may be shorter than the interval: a double epoch, a tag that jumped.
const MAX_SHORTER_STEPS: f64 = 0.05;
/// Steps up to this many times the shortest regular one are that interval with jitter, not gaps.
const JITTER: f64 = 1.5;

/// Rows further from all others than this, s, may have a wrong date: receivers that do not know it
/// yet are off by months or years, not by less than a day.
const FAR_S: f64 = 86_400.0;
/// Share of the others that they are at most: more of them are a session of another day.
const MAX_MISDATED: f64 = 0.2;

/// Times of rows, as they come in.
#[derive(Debug, Default)]
pub(crate) struct SessionSpan {
    rows: u64,
    /// In the order of time.
    pieces: Vec<Piece>,
    /// How often each step from row to row came, by milliseconds.
    steps_ms: BTreeMap<u64, u64>,
}

/// Rows without a step of more than [`FAR_S`].
#[derive(Debug, Clone, Copy)]
struct Piece {
    first: GpsTime,
    last: GpsTime,
    rows: u64,
}

impl SessionSpan {
    /// Takes the time of the next row.
    pub(crate) fn add(&mut self, time: GpsTime) {
        self.rows += 1;
        let last = self.pieces.last().map(|piece| piece.last);
        match self.pieces.last_mut().filter(|piece| time - piece.last <= FAR_S) {
            Some(piece) => {
                piece.last = time;
                piece.rows += 1;
            }
            None => self.pieces.push(Piece { first: time, last: time, rows: 1 }),
        }
        if let Some(last) = last {
            *self.steps_ms.entry(step_ms(last, time)).or_default() += 1;
        }
    }

    /// How many rows there are.
    pub(crate) fn rows(&self) -> u64 {
        self.rows
    }

    /// Time of the first row whose date is believed.
    pub(crate) fn first(&self) -> Option<GpsTime> {
        self.pieces[self.believed()].first().map(|piece| piece.first)
    }

    /// Time of the last row whose date is believed.
    pub(crate) fn last(&self) -> Option<GpsTime> {
        self.pieces[self.believed()].last().map(|piece| piece.last)
    }

    /// The rows at either end that are few and further from the others than these span: their dates
    /// are wrong, and the time between is not part of the session.
    pub(crate) fn misdated(&self) -> Option<String> {
        let believed = self.believed();
        let ends = self.pieces[..believed.start].iter().chain(&self.pieces[believed.end..]);
        let told: Vec<String> = ends.map(Piece::text).collect();
        let text = "far from all others: a wrong date? The time between does not count";
        (!told.is_empty()).then(|| format!("{}, {text}", told.join(", ")))
    }

    /// The pieces whose dates are believed.
    fn believed(&self) -> Range<usize> {
        let mut range = 0..self.pieces.len();
        loop {
            match &self.pieces[range.clone()] {
                [first, rest @ ..] if is_misdated(first, rest) => range.start += 1,
                [rest @ .., last] if is_misdated(last, rest) => range.end -= 1,
                _ => return range,
            }
        }
    }

    /// Whether epochs are missing between two rows that are so far apart, s, as far as is known.
    pub(crate) fn is_gap(&self, step_s: f64) -> bool {
        self.interval_s().is_some_and(|interval_s| step_s > JITTER * interval_s)
    }

    /// How many gaps there are, and the longest, s; `None` without any.
    pub(crate) fn gaps(&self) -> Option<(u64, f64)> {
        let interval_ms = 1e3 * self.interval_s()?;
        let unbelieved_ms = self.unbelieved_steps_ms();
        let believed = |(ms, count): (&u64, &u64)| {
            let other = unbelieved_ms.iter().filter(|step_ms| *step_ms == ms).count() as u64;
            (*ms, count - other)
        };
        let steps = self.steps_ms.iter().map(believed);
        let gaps = steps.filter(|(ms, count)| *ms as f64 > JITTER * interval_ms && *count > 0);
        let longest_s = gaps.clone().next_back().map(|(ms, _)| ms as f64 / 1e3)?;
        Some((gaps.map(|(_, count)| count).sum(), longest_s))
    }

    /// The steps from and to rows whose dates are not believed.
    fn unbelieved_steps_ms(&self) -> Vec<u64> {
        let believed = self.believed();
        let pairs = self.pieces.windows(2).enumerate();
        pairs
            .filter(|(index, _)| *index < believed.start || *index + 1 >= believed.end)
            .map(|(_, pair)| step_ms(pair[0].last, pair[1].first))
            .collect()
    }

    /// Regular time from epoch to epoch, s; `None` before there were two.
    pub(crate) fn interval_s(&self) -> Option<f64> {
        let steps = || self.steps_ms.iter().filter(|(step_ms, _)| **step_ms > 0);
        let regular_ms = quantile(steps(), MAX_SHORTER_STEPS)?;
        let with_jitter = steps().take_while(|(ms, _)| (**ms as f64) <= JITTER * regular_ms);
        Some(quantile(with_jitter, 0.5)? / 1e3)
    }

    /// Epochs of the whole span, and the rows outside.
    pub(crate) fn epochs(&self) -> u64 {
        let span_s = self.first().zip(self.last()).map_or(0.0, |(first, last)| last - first);
        // As many as there are steps in the span, and one.
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
        let regular =
            self.interval_s().map_or(0, |interval_s| (span_s / interval_s).round() as u64 + 1);
        let believed: u64 = self.pieces[self.believed()].iter().map(|piece| piece.rows).sum();
        regular.max(believed) + self.rows - believed
    }

    /// Epochs that no antenna has.
    pub(crate) fn missing(&self) -> u64 {
        self.epochs() - self.rows
    }
}

impl Piece {
    fn text(&self) -> String {
        let Self { first, last, rows } = self;
        match rows {
            1 => format!("1 epoch at {first}"),
            _ => format!("{rows} epochs from {first} to {last}"),
        }
    }
}

/// Whether the rows at one end have another date than the rest.
fn is_misdated(piece: &Piece, rest: &[Piece]) -> bool {
    let Some((start, end)) = rest.first().zip(rest.last()) else { return false };
    let distance_s = (start.first - piece.last).max(piece.first - end.last);
    let rows: u64 = rest.iter().map(|piece| piece.rows).sum();
    piece.rows as f64 <= MAX_MISDATED * rows as f64 && distance_s > end.last - start.first
}

/// Milliseconds from one row to the next.
fn step_ms(from: GpsTime, to: GpsTime) -> u64 {
    // Steps are positive and shorter than the age of GPS.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
    let step_ms = (1e3 * (to - from)).round().max(0.0) as u64;
    step_ms
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

    /// A receiver that does not know the date when it is switched on, and one whose clock fails at
    /// the end.
    #[test]
    fn wrong_dates_make_no_session_of_years() {
        let years_s = 3.0 * 365.0 * 86_400.0;
        let right = |count: u32| (0..count).map(move |k| years_s + f64::from(k));
        let session = span((0..5).map(f64::from).chain(right(60)).chain([3.0 * years_s]));
        assert_eq!((session.epochs(), session.missing(), session.gaps()), (66, 0, None));
        assert_eq!(session.first(), Some(GpsTime::default() + years_s));
        assert_eq!(
            session.misdated().unwrap(),
            "5 epochs from 1980-01-06T00:00:00.000 to 1980-01-06T00:00:04.000, \
             1 epoch at 1989-01-03T00:00:00.000, \
             far from all others: a wrong date? The time between does not count"
        );
        // Two sessions of one day each are two sessions, and so are many short ones.
        let days = |days: u32, rows: u32| {
            (0..days)
                .flat_map(move |day| (0..rows).map(move |k| 2e5 * f64::from(day) + f64::from(k)))
        };
        for (count, rows) in [(2, 100), (12, 10)] {
            let session = span(days(count, rows));
            assert_eq!(session.misdated(), None);
            assert_eq!(session.gaps().unwrap().0, u64::from(count) - 1);
        }
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
