//! The epochs of the fixed station that rows may still want.

use std::collections::VecDeque;
use std::sync::Arc;

use kurs::observation::AntennaEpoch;
use kurs::time::GpsTime;

use crate::intake::Permits;

/// See the module.
pub(crate) struct StationEpochs {
    permits: Arc<Permits>,
    waiting: VecDeque<AntennaEpoch>,
    /// An older epoch serves until it is this old, s.
    max_age_s: f64,
    /// Rows wait for it: all logs are read as fast as possible.
    is_awaited: bool,
    has_left: bool,
}

impl StationEpochs {
    /// None yet; `is_awaited` where rows wait for them.
    pub(crate) fn new(permits: Arc<Permits>, max_age_s: f64, is_awaited: bool) -> Self {
        let waiting = VecDeque::new();
        Self { permits, waiting, max_age_s, is_awaited, has_left: false }
    }

    pub(crate) fn take(&mut self, epoch: AntennaEpoch) {
        /// A station that is ahead of all antennas must not gather.
        const MAX_WAITING: usize = 64;
        self.has_left = false;
        self.waiting.push_back(epoch);
        if !self.is_awaited {
            self.permits.release(1);
            if self.waiting.len() > MAX_WAITING {
                self.waiting.pop_front();
            }
        }
    }

    /// The connection has ended over which they come.
    pub(crate) const fn leave(&mut self) {
        self.has_left = true;
    }

    /// Forgets those that wait.
    pub(crate) fn forget(&mut self) {
        if self.is_awaited {
            self.permits.release(self.waiting.len());
        }
        self.waiting.clear();
    }

    /// Whether a row of this time need not wait.
    pub(crate) fn is_ready(&self, time: GpsTime, window_s: f64) -> bool {
        let is_there = self.waiting.back().is_some_and(|newest| newest.time - time > -window_s);
        !self.is_awaited || self.has_left || is_there
    }

    /// The station's epoch of this time, or the newest before; still older ones are forgotten.
    pub(crate) fn at(&mut self, time: GpsTime, window_s: f64) -> Option<AntennaEpoch> {
        while self.waiting.get(1).is_some_and(|next| next.time - time < window_s) {
            self.waiting.pop_front();
            if self.is_awaited {
                self.permits.release(1);
            }
        }
        let serves = |epoch: &&AntennaEpoch| {
            let age_s = time - epoch.time;
            age_s > -window_s && (age_s < window_s || age_s <= self.max_age_s)
        };
        self.waiting.front().filter(serves).cloned()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_station_serves_until_it_is_too_old() {
        let at = |second: f64| GpsTime::default() + (1e9 + second);
        let mut station = StationEpochs::new(Arc::default(), 2.5, false);
        let mut age_s = |new: Option<f64>, row: f64| {
            let new =
                new.map(|second| AntennaEpoch { time: at(second), ..AntennaEpoch::default() });
            station.waiting.extend(new);
            station.at(at(row), 0.025).map(|epoch| at(row) - epoch.time)
        };
        assert_eq!(age_s(None, 0.0), None);
        assert_eq!(age_s(Some(5.0), 4.95), None, "of the future");
        assert_eq!(age_s(None, 5.0), Some(0.0));
        assert_eq!(age_s(None, 5.5), Some(0.5));
        assert_eq!(age_s(Some(6.0), 7.5), Some(1.5));
        assert_eq!(age_s(None, 8.5), Some(2.5));
        assert_eq!(age_s(None, 8.55), None, "too old");
        assert_eq!(age_s(Some(7.0), 8.55), Some(1.55));
    }
}
