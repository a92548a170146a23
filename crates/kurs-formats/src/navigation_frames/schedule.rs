//! When a simulated receiver has received which ephemeris.

use std::collections::{BTreeMap, BTreeSet, VecDeque};

use kurs::ephemeris::{Ephemeris, NavigationData};
use kurs::signal::Satellite;
use kurs::time::GpsTime;

/// Satellites begin to send an ephemeris so long before its reference time, s.
const AHEAD_S: f64 = 2.0 * 3600.0;
/// GLONASS: half of the interval around the reference time, s.
const AHEAD_GLONASS_S: f64 = 900.0;

/// The ephemerides that are still to be sent, in the order of time.
#[derive(Debug)]
pub(crate) struct Schedule {
    waiting: VecDeque<(GpsTime, Ephemeris)>,
    left_out: BTreeSet<Satellite>,
}

impl Schedule {
    /// All ephemerides of `data`.
    pub(crate) fn new(data: &NavigationData) -> Self {
        let begins = |e: &Ephemeris| match e {
            Ephemeris::Kepler(_) => e.reference_time() + -AHEAD_S,
            Ephemeris::Glonass(_) => e.reference_time() + -AHEAD_GLONASS_S,
        };
        let mut waiting: Vec<_> = data.ephemerides.iter().map(|e| (begins(e), *e)).collect();
        waiting.sort_by_key(|(begins, _)| *begins);
        Self { waiting: waiting.into(), left_out: BTreeSet::new() }
    }

    /// The next ephemeris that has begun by `time` and is still good then.
    pub(crate) fn next(&mut self, time: GpsTime) -> Option<Ephemeris> {
        while self.waiting.front().is_some_and(|(begins, _)| *begins <= time) {
            let (_, ephemeris) = self.waiting.pop_front()?;
            if time - ephemeris.reference_time() <= *ephemeris.interval_of_use_s().end() {
                return Some(ephemeris);
            }
        }
        None
    }

    /// Notes that the format of the log has no room for an ephemeris of this satellite.
    pub(crate) fn leave_out(&mut self, satellite: Satellite) {
        self.left_out.insert(satellite);
    }

    /// The satellites with an ephemeris that the log does not have.
    pub(crate) const fn left_out(&self) -> &BTreeSet<Satellite> {
        &self.left_out
    }
}

/// GLONASS frequency channels by orbital slot.
pub(crate) fn glonass_channels(data: &NavigationData) -> BTreeMap<u8, i8> {
    let channel = |ephemeris: &Ephemeris| match ephemeris {
        Ephemeris::Glonass(g) => Some((ephemeris.satellite().number, g.elements().channel)),
        Ephemeris::Kepler(_) => None,
    };
    data.ephemerides.iter().filter_map(channel).collect()
}
