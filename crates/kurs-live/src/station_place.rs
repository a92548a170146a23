//! Where the fixed station is: as it says itself (1005 and 1006 of RTCM 3), or as the configuration
//! says, which it must not contradict. A virtual station chooses its place, and may choose another
//! one at any time.

use std::sync::Arc;

use kurs::frames::{Ecef, Vector};

use crate::status::StreamStatus;

/// How far what is configured may be from what is stated, m. The frames that stations are given in
/// differ by some two metres (NAD 83 and GDA94 from ITRF), a phase centre from its reference point
/// by less; a height above the sea in place of one above the ellipsoid is tens of metres off,
/// another station kilometres.
const MAX_DIFFERENCE_M: f64 = 20.0;
/// A station that has moved by less, m, has not: 1005 has tenths of millimetres.
const MIN_MOVED_M: f64 = 0.001;
/// Stations that have not been told their place say that they are at the centre of the Earth, m.
const EARTH_M: core::ops::Range<f64> = 6.3e6..7e6;

/// See the module.
pub(crate) struct StationPlace {
    configured_m: Option<Vector<Ecef>>,
    stated_m: Option<Vector<Ecef>>,
    /// Where the engine has it, if that is a place that was stated.
    put_m: Option<Vector<Ecef>>,
    /// The connection has ended over which it was stated.
    has_left: bool,
    status: Arc<StreamStatus>,
}

impl StationPlace {
    pub(crate) const fn new(configured_m: Option<Vector<Ecef>>, status: Arc<StreamStatus>) -> Self {
        Self { configured_m, stated_m: None, put_m: None, has_left: false, status }
    }

    /// Takes what was stated before an epoch. `Some` is a place to which the station has to be put.
    pub(crate) fn take(&mut self, stated_m: Option<Vector<Ecef>>) -> Option<Vector<Ecef>> {
        // The next connection may be one to another virtual station; a contradiction stands until
        // it is taken back.
        if core::mem::take(&mut self.has_left) && self.configured_m.is_none() {
            self.stated_m = None;
        }
        let on_earth_m = stated_m.filter(|place| EARTH_M.contains(&place.norm()));
        self.stated_m = on_earth_m.or(self.stated_m);
        self.status.note_place(self.trouble());
        let is_there = |place: &Vector<Ecef>| {
            self.put_m.is_some_and(|put| (*place - put).norm() <= MIN_MOVED_M)
        };
        let new_m = self.stated_m.filter(|place| self.configured_m.is_none() && !is_there(place));
        self.put_m = new_m.or(self.put_m);
        new_m
    }

    /// Its connection has ended.
    pub(crate) const fn leave(&mut self) {
        self.has_left = true;
    }

    /// The configuration was read again. `Some` is a place to which the station of the new engine
    /// has to be put.
    pub(crate) fn replace(&mut self, configured_m: Option<Vector<Ecef>>) -> Option<Vector<Ecef>> {
        self.configured_m = configured_m;
        self.put_m = self.stated_m.filter(|_| configured_m.is_none());
        self.put_m
    }

    /// Whether coordinates may be relative to it.
    pub(crate) fn is_known(&self) -> bool {
        self.trouble().is_none()
    }

    /// Why not.
    fn trouble(&self) -> Option<String> {
        match (self.configured_m, self.stated_m) {
            (None, None) => Some(
                "has not said where it is (1005 or 1006 of RTCM 3): coordinates are without it until it \
                 does, or `position_ecef_m` is given"
                    .into(),
            ),
            (Some(configured), Some(stated)) => {
                let apart_m = (configured - stated).norm();
                let [x, y, z]: [f64; 3] = stated.xyz().into();
                (apart_m > MAX_DIFFERENCE_M).then(|| {
                    format!(
                        "says that it is at [{x:.3}, {y:.3}, {z:.3}], {apart_m:.0} m from \
                         `position_ecef_m`: coordinates are without it; leave the key out to go by what it says"
                    )
                })
            }
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(x_m: f64) -> Option<Vector<Ecef>> {
        Some(Vector::new(4e6 + x_m, 3e5, 4.9e6))
    }

    fn place(configured_m: Option<Vector<Ecef>>) -> StationPlace {
        StationPlace::new(configured_m, Arc::new(StreamStatus::new("station".into(), None)))
    }

    #[test]
    fn a_station_is_where_it_says_until_it_says_another_place() {
        let mut of = place(None);
        assert_eq!(of.take(None), None);
        assert!(!of.is_known());
        assert!(of.status.trouble().unwrap().contains("has not said where it is"));
        let nowhere = Some(Vector::new(0.0, 0.0, 0.0));
        assert_eq!((of.take(nowhere), of.is_known()), (None, false));
        assert_eq!((of.take(at(0.0)), of.is_known()), (at(0.0), true));
        assert_eq!((of.take(at(1e-4)), of.take(None)), (None, None), "it has not moved");
        assert_eq!(of.take(at(5000.0)), at(5000.0), "a virtual station");
        assert_eq!(of.status.trouble(), None);
        of.leave();
        assert!(of.is_known(), "for what came before");
        assert_eq!((of.take(None), of.is_known()), (None, false), "the next one may be another");
        assert_eq!((of.take(at(5000.0)), of.is_known()), (None, true), "it is not");
    }

    #[test]
    fn a_configured_place_must_not_be_contradicted() {
        let mut of = place(at(0.0));
        for (stated_m, is_known) in
            [(None, true), (at(2.2), true), (at(45.0), false), (at(0.0), true)]
        {
            assert_eq!((of.take(stated_m), of.is_known()), (None, is_known), "{stated_m:?}");
            let told = of.status.trouble();
            assert_eq!(told.is_some_and(|t| t.contains("45 m from `position_ecef_m`")), !is_known);
        }
        of.take(at(45.0));
        of.leave();
        assert_eq!((of.take(None), of.is_known()), (None, false), "nobody took it back");
        assert_eq!((of.replace(None), of.is_known()), (at(45.0), true), "the key was taken out");
    }
}
