//! Lock times of a receiver that is only simulated: they say what the loss-of-lock bits say.

use std::collections::BTreeMap;

use kurs::observation::Observation;
use kurs::signal::{Satellite, Signal};
use kurs::time::GpsTime;

/// How long a signal is followed before it is observed for the first time, s.
const BEFORE_FIRST_S: f64 = 1.0;

/// Since when every signal is followed without a break.
#[derive(Debug, Default)]
pub(crate) struct LockClock {
    since: BTreeMap<(Satellite, Signal), GpsTime>,
}

impl LockClock {
    /// Lock time of an observation in s: zero where it slipped.
    pub(crate) fn lock_s(&mut self, time: GpsTime, o: &Observation) -> f64 {
        let since = self.since.entry((o.satellite, o.signal)).or_insert(time + -BEFORE_FIRST_S);
        if o.lock.slipped() {
            *since = time;
        }
        time - *since
    }
}
