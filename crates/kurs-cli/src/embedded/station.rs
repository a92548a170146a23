//! The epochs of a fixed station that a row may still want.

use std::collections::VecDeque;

use kurs::observation::AntennaEpoch;
use kurs::time::GpsTime;

/// Epochs of a station that are kept where rows do not wait for it: it may be ahead of them.
const MAX_WAITING: usize = 64;

/// See the module.
#[derive(Debug)]
pub(super) struct StationEpochs {
    waiting: VecDeque<AntennaEpoch>,
    /// An epoch that is no older than this, s, serves a row that has none of its own; `None`: rows
    /// wait for the epoch of their time.
    max_age_s: Option<f64>,
}

impl StationEpochs {
    pub(super) const fn new(max_age_s: Option<f64>) -> Self {
        Self { waiting: VecDeque::new(), max_age_s }
    }

    pub(super) fn push(&mut self, epoch: AntennaEpoch) {
        self.waiting.push_back(epoch);
        if self.max_age_s.is_some() && self.waiting.len() > MAX_WAITING {
            self.waiting.pop_front();
        }
    }

    /// Whether a row of this time has nothing to wait for.
    pub(super) fn is_ready(&self, time: GpsTime, window_s: f64) -> bool {
        let newest = self.waiting.back();
        self.max_age_s.is_some() || newest.is_some_and(|newest| newest.time - time > -window_s)
    }

    /// The epoch that serves a row of this time; those before it are forgotten.
    pub(super) fn at(&mut self, time: GpsTime, window_s: f64) -> Option<AntennaEpoch> {
        while self.waiting.get(1).is_some_and(|next| next.time - time < window_s) {
            self.waiting.pop_front();
        }
        let serves = |epoch: &&AntennaEpoch| {
            let age_s = time - epoch.time;
            age_s > -window_s && age_s < window_s.max(self.max_age_s.unwrap_or(0.0))
        };
        self.waiting.front().filter(serves).cloned()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(second: f64) -> GpsTime {
        GpsTime::default() + (1e9 + second)
    }

    fn with(seconds: &[f64], max_age_s: Option<f64>) -> StationEpochs {
        let mut station = StationEpochs::new(max_age_s);
        for second in seconds {
            station.push(AntennaEpoch { time: at(*second), ..AntennaEpoch::default() });
        }
        station
    }

    #[test]
    fn a_row_waits_for_the_epoch_of_its_time() {
        let mut station = with(&[1.0, 2.0], None);
        assert!(station.is_ready(at(2.02), 0.05) && !station.is_ready(at(2.1), 0.05));
        assert_eq!(station.at(at(0.5), 0.05), None, "of the future");
        assert_eq!(station.at(at(1.02), 0.05).map(|epoch| epoch.time), Some(at(1.0)));
        assert_eq!(station.at(at(1.5), 0.05), None, "of another time");
        assert_eq!(station.at(at(2.0), 0.05).map(|epoch| epoch.time), Some(at(2.0)));
    }

    #[test]
    fn an_older_epoch_serves_where_nobody_waits() {
        let mut station = with(&[1.0, 2.0], Some(10.0));
        assert!(station.is_ready(at(9.0), 0.05));
        assert_eq!(station.at(at(9.0), 0.05).map(|epoch| epoch.time), Some(at(2.0)));
        assert_eq!(station.at(at(12.5), 0.05), None, "too old");
    }
}
