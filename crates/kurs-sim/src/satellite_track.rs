//! The true path of a satellite: its broadcast orbit, evaluated once a second and interpolated.
//!
//! Between two seconds the cubic that has the position and velocity of both ends is off by
//! h⁴/384 · |r⁗| = 3e-11 m, so that the interpolated orbit *is* the broadcast orbit, at a small
//! part of its cost.

use kurs::ephemeris::{Ephemeris, EphemerisStore, SatelliteState};
use kurs::signal::Satellite;
use kurs::time::GpsTime;
use nalgebra::Vector3;

/// Distance of the evaluated points, s.
const STEP_S: f64 = 1.0;

/// See the module.
#[derive(Debug, Clone)]
pub(crate) struct SatelliteTrack {
    pub(crate) satellite: Satellite,
    /// Frequency channel of a GLONASS satellite.
    pub(crate) glonass_channel: Option<i8>,
    /// Difference of the true orbit and clock from the broadcast ones.
    pub(crate) orbit_error_m: Vector3<f64>,
    pub(crate) clock_error_s: f64,
    start: GpsTime,
    span: Option<Span>,
}

/// One second of the path.
#[derive(Debug, Clone, Copy)]
struct Span {
    index: f64,
    ephemeris: Ephemeris,
    from: SatelliteState,
    to: SatelliteState,
}

/// Where the satellite is when it sends.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Sender {
    pub(crate) position_m: Vector3<f64>,
    pub(crate) velocity_mps: Vector3<f64>,
    pub(crate) clock_s: f64,
    pub(crate) clock_drift: f64,
}

impl SatelliteTrack {
    pub(crate) fn new(satellite: Satellite, store: &EphemerisStore, start: GpsTime) -> Self {
        let channel = store.iter().find_map(|record| match record {
            Ephemeris::Glonass(glonass) if record.satellite() == satellite => {
                Some(glonass.elements().channel)
            }
            _ => None,
        });
        Self {
            satellite,
            glonass_channel: channel,
            orbit_error_m: Vector3::zeros(),
            clock_error_s: 0.0,
            start,
            span: None,
        }
    }

    /// Brings the path to a time; the broadcast record in force, `None` without one.
    pub(crate) fn advance(&mut self, store: &EphemerisStore, time_s: f64) -> Option<&Ephemeris> {
        let index = (time_s / STEP_S).floor();
        if self.span.is_none_or(|span| span.index != index) {
            self.span = self.evaluate(store, index);
        }
        self.span.as_ref().map(|span| &span.ephemeris)
    }

    fn evaluate(&self, store: &EphemerisStore, index: f64) -> Option<Span> {
        let (from, to) = (self.start + index * STEP_S, self.start + (index + 1.0) * STEP_S);
        let ephemeris = *store.select(self.satellite, from)?;
        Some(Span { index, ephemeris, from: ephemeris.state(from)?, to: ephemeris.state(to)? })
    }

    /// The state at a time near the one of [`SatelliteTrack::advance`]: the cubic is good for some
    /// tenths of a second beyond its second.
    pub(crate) fn at(&self, time_s: f64) -> Option<Sender> {
        let Span { index, from, to, .. } = self.span.as_ref()?;
        let s = time_s / STEP_S - index;
        let (s2, s3) = (s * s, s * s * s);
        let (p, q) = (from.position_m.xyz(), to.position_m.xyz());
        let (v, w) = (from.velocity_mps.xyz() * STEP_S, to.velocity_mps.xyz() * STEP_S);
        let step = q - p;
        Some(Sender {
            // p + s v + s² (3 d − 2 v − w) + s³ (v + w − 2 d)
            position_m: p
                + v * s
                + (step * 3.0 - v * 2.0 - w) * s2
                + (v + w - step * 2.0) * s3
                + self.orbit_error_m,
            velocity_mps: (v
                + (step * 3.0 - v * 2.0 - w) * (2.0 * s)
                + (v + w - step * 2.0) * (3.0 * s2))
                / STEP_S,
            clock_s: from.clock_s + (to.clock_s - from.clock_s) * s + self.clock_error_s,
            clock_drift: from.clock_drift,
        })
    }
}
