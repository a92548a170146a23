//! Which antennas had an epoch when, counted over every epoch of the session: what a sample cannot
//! tell of receivers whose rates differ.

use std::collections::BTreeMap;

use kurs::observation::ArrayEpoch;

use crate::report::span::plain;
use crate::session_span::SessionSpan;

/// Intervals further apart than this factor are different rates.
const SAME_RATE: f64 = 1.5;
/// Epochs that a rate needs.
const MIN_EPOCHS: u64 = 10;
/// Share of an antenna's epochs without the others above which it does not sample with them.
const MOSTLY: f64 = 0.5;

/// See the module; fed epoch by epoch.
#[derive(Debug, Default)]
pub(crate) struct Attendance {
    /// Times at which any antenna has an epoch.
    session: SessionSpan,
    /// In the order of the antennas.
    antennas: Vec<SessionSpan>,
    /// How many epochs have just these antennas.
    sets: BTreeMap<Vec<bool>, u64>,
}

impl Attendance {
    /// Takes an epoch in.
    pub(crate) fn add(&mut self, epoch: &ArrayEpoch) {
        self.session.add(epoch.time);
        self.antennas.resize_with(epoch.antennas.len(), SessionSpan::default);
        let there: Vec<bool> = epoch.antennas.iter().map(Option::is_some).collect();
        for (span, antenna) in self.antennas.iter_mut().zip(&epoch.antennas) {
            antenna.iter().for_each(|own| span.add(own.time));
        }
        *self.sets.entry(there).or_default() += 1;
    }

    /// Times of all epochs.
    pub(crate) fn session(&self) -> &SessionSpan {
        &self.session
    }

    /// Times of one antenna's epochs.
    pub(super) fn of_antenna(&self, antenna: usize) -> &SessionSpan {
        &self.antennas[antenna]
    }

    /// Times of each antenna's epochs.
    pub(super) fn antennas(&self) -> &[SessionSpan] {
        &self.antennas
    }

    /// How many epochs two antennas have, or more.
    pub(super) fn together(&self) -> u64 {
        let several = |there: &[bool]| there.iter().filter(|is_there| **is_there).count() >= 2;
        self.sets.iter().filter(|(there, _)| several(there)).map(|(_, count)| *count).sum()
    }

    /// Share of the epochs in which an antenna is alone.
    pub(super) fn share_alone(&self) -> f64 {
        1.0 - self.together() as f64 / self.session.rows().max(1) as f64
    }

    /// Share of the epochs that an antenna should have at its own rate.
    pub(super) fn share_at_own_rate(&self, antenna: usize) -> f64 {
        let (own, all) = (&self.antennas[antenna], &self.session);
        let slower = self
            .interval_s(antenna)
            .zip(all.interval_s())
            .map_or(1.0, |(own_s, all_s)| own_s / all_s);
        (own.rows() as f64 * slower / all.epochs().max(1) as f64).min(1.0)
    }

    /// The antennas' rates and how often the slower ones are in the epochs; `None` if equal.
    pub(super) fn different_rates(&self, names: &[String]) -> Option<String> {
        let known = |antenna: usize| Some((antenna, self.interval_s(antenna)?));
        let intervals: Vec<(usize, f64)> = (0..names.len()).filter_map(known).collect();
        let fastest_s = intervals.iter().map(|(_, s)| *s).min_by(f64::total_cmp)?;
        let is_slow = |interval_s: f64| interval_s > SAME_RATE * fastest_s;
        let slow: Vec<String> = intervals
            .iter()
            .filter(|(_, interval_s)| is_slow(*interval_s))
            .map(|(antenna, _)| {
                let rows = self.antennas[*antenna].rows() as f64;
                let share = 100.0 * rows / self.session.rows().max(1) as f64;
                format!("{} is in {share:.0} % of the epochs", names[*antenna])
            })
            .collect();
        let rates = intervals
            .iter()
            .map(|(antenna, s)| format!("{} observes {}", names[*antenna], rate(*s)));
        let rates: Vec<String> = rates.collect();
        (!slow.is_empty()).then(|| format!("{}: {}", rates.join(", "), slow.join(", ")))
    }

    /// Whether some antennas have epochs just where others have none, and the other way round,
    /// while all of them observe.
    pub(super) fn take_turns(&self) -> bool {
        let often = |there: &[bool], count: u64| {
            let of = self.antennas.iter().zip(there).filter(|(_, is_there)| **is_there);
            let fewest = of.map(|(span, _)| span.rows()).min().unwrap_or(0);
            count as f64 > MOSTLY * fewest as f64
        };
        let sets = || self.sets.iter().filter(|(there, count)| often(there, **count));
        let disjoint =
            |a: &[bool], b: &[bool]| a.iter().zip(b).all(|(one, other)| !(*one && *other));
        sets().any(|(a, _)| sets().any(|(b, _)| disjoint(a, b))) && self.overlap()
    }

    /// Whether the antennas' spans overlap.
    fn overlap(&self) -> bool {
        let latest_start = self.antennas.iter().filter_map(SessionSpan::first).max();
        let earliest_end = self.antennas.iter().filter_map(SessionSpan::last).min();
        latest_start < earliest_end
    }

    fn interval_s(&self, antenna: usize) -> Option<f64> {
        let span = &self.antennas[antenna];
        span.interval_s().filter(|_| span.rows() >= MIN_EPOCHS)
    }
}

/// `at 10 Hz`, `every 30 s`
fn rate(interval_s: f64) -> String {
    // Receivers have rates of whole Hertz, which intervals in milliseconds round.
    let rate_hz = (10.0 / interval_s).round() / 10.0;
    if interval_s > 1.0 {
        format!("every {} s", plain(interval_s))
    } else {
        format!("at {rate_hz} Hz")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use kurs::observation::AntennaEpoch;
    use kurs::time::GpsTime;

    /// Antennas that have an epoch at every so manieth tick of 0.1 s.
    fn ticking(ticks: u32, every: &[u32]) -> Attendance {
        let mut attendance = Attendance::default();
        for tick in 0..ticks {
            let time = GpsTime::default() + 0.1 * f64::from(tick);
            let own = |every: &u32| {
                (tick % every == 0).then(|| AntennaEpoch { time, ..AntennaEpoch::default() })
            };
            let antennas = every.iter().map(own).collect();
            attendance.add(&ArrayEpoch { time, antennas, station: None });
        }
        attendance
    }

    #[test]
    fn rates_are_told_and_nobody_is_silent_at_its_own() {
        let names = ["A", "B", "C"].map(str::to_owned);
        let mixed = ticking(300, &[10, 1, 20]);
        assert_eq!(
            mixed.different_rates(&names).unwrap(),
            "A observes at 1 Hz, B observes at 10 Hz, C observes every 2 s: \
             A is in 10 % of the epochs, C is in 5 % of the epochs"
        );
        assert_eq!((mixed.together(), mixed.share_alone()), (30, 0.9));
        for antenna in 0..3 {
            assert!(mixed.share_at_own_rate(antenna) > 0.99, "{antenna}");
        }
        assert!(!mixed.take_turns());
        assert_eq!(ticking(300, &[2, 2]).different_rates(&names[..2]), None);
    }
}
