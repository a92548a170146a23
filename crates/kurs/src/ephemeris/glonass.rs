//! GLONASS broadcast orbits: position and velocity at a reference time, carried on by numerical
//! integration.
//!
//! Source: GLONASS ICD 5.1 (2008), appendix A.3.1.2, with the constants of PZ-90.11; its axes agree
//! with those of WGS 84 within centimetres and are used as they are.

use nalgebra::{Vector3, Vector6};

use super::SatelliteState;
use super::kepler::{BadEphemeris, check_ranges, symmetric};
use crate::frames::{Ecef, Vector};
use crate::signal::{SPEED_OF_LIGHT_MPS, Satellite, Signal, System};
use crate::time::GpsTime;

/// Gravitational constant of PZ-90.11, m³/s².
const GM: f64 = 3.986_004_418e14;
/// Equatorial radius of PZ-90.11, m.
const EARTH_RADIUS_M: f64 = 6_378_136.0;
/// Second zonal harmonic of PZ-90.11, J₂.
const J2: f64 = 1.082_625_75e-3;
/// Earth rotation rate of PZ-90.11, rad/s.
const EARTH_RATE: f64 = 7.292_115e-5;
/// Step of the integration: its error grows to 1.3 mm in half an hour, beside orbits that are broadcast to some metres.
const STEP_S: f64 = 60.0;
/// How far the integration goes; beyond it the constant lunisolar acceleration means nothing.
const MAX_SPAN_S: f64 = 7200.0;

/// The contents of one GLONASS record, times on the GPS scale.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GlonassElements {
    /// The satellite (orbital slot).
    pub satellite: Satellite,
    /// Reference time of orbit and clock, t_b.
    pub reference_time: GpsTime,
    /// When the frame was sent, as far as known (else the reference time).
    pub transmission_time: GpsTime,
    /// Clock bias −τₙ, s.
    pub clock_bias_s: f64,
    /// Relative deviation of the carrier frequency γₙ.
    pub clock_drift: f64,
    /// Position at the reference time.
    pub position_m: Vector<Ecef>,
    /// Velocity at the reference time.
    pub velocity_mps: Vector<Ecef>,
    /// Acceleration by Moon and Sun.
    pub acceleration_mps2: Vector<Ecef>,
    /// Frequency channel.
    pub channel: i8,
    /// Delay of L2 against L1, Δτₙ; `None` if the record does not tell.
    pub l2_delay_s: Option<f64>,
    /// Health word as RINEX prints it: zero is healthy.
    pub health: u16,
    /// Predicted range accuracy.
    pub accuracy_m: f64,
}

/// A record that was checked, so that it can be evaluated.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GlonassEphemeris {
    elements: GlonassElements,
}

impl GlonassEphemeris {
    /// Checks the elements.
    ///
    /// # Errors
    ///
    /// [`BadEphemeris`] for the first element that is not a number or outside its range.
    pub fn new(elements: GlonassElements) -> Result<Self, BadEphemeris> {
        let e = &elements;
        let ranges = [
            ("distance from the Earth's centre", e.position_m.norm(), 2.3e7, 2.8e7),
            ("speed", e.velocity_mps.norm(), 1e3, 6e3),
            ("lunisolar acceleration", e.acceleration_mps2.norm(), 0.0, 1e-4),
            symmetric("clock bias", e.clock_bias_s, 1.0),
            symmetric("clock drift", e.clock_drift, 1e-6),
            ("frequency channel", f64::from(e.channel), -7.0, 24.0),
            symmetric("delay of L2", e.l2_delay_s.unwrap_or(0.0), 1e-5),
            ("accuracy", e.accuracy_m, 0.0, 1e5),
        ];
        check_ranges(e.satellite, ranges)?;
        Ok(Self { elements })
    }

    /// What was broadcast.
    #[must_use]
    pub const fn elements(&self) -> &GlonassElements {
        &self.elements
    }

    /// Position, velocity and clock at `time`; `None` more than two hours from the reference time.
    #[must_use]
    pub fn state(&self, time: GpsTime) -> Option<SatelliteState> {
        let e = &self.elements;
        let since_s = time - e.reference_time;
        if since_s.abs() > MAX_SPAN_S {
            return None;
        }
        let orbit = self.integrate(since_s);
        let state = SatelliteState {
            position_m: Vector::new(orbit[0], orbit[1], orbit[2]),
            velocity_mps: Vector::new(orbit[3], orbit[4], orbit[5]),
            // Δt = −τₙ + γₙ (t − t_b); the relativistic effect is in γₙ.
            clock_s: e.clock_bias_s + e.clock_drift * since_s,
            clock_drift: e.clock_drift,
            sigma_m: e.accuracy_m,
        };
        (state.position_m.is_finite() && state.velocity_mps.is_finite()).then_some(state)
    }

    /// Runge-Kutta steps of [`STEP_S`], and what is left, so that the orbit goes on without a jump.
    fn integrate(&self, span_s: f64) -> Vector6<f64> {
        let (position, velocity) =
            (self.elements.position_m.xyz(), self.elements.velocity_mps.xyz());
        let mut orbit =
            Vector6::new(position.x, position.y, position.z, velocity.x, velocity.y, velocity.z);
        let mut left_s = span_s;
        while left_s.abs() > STEP_S {
            let step_s = STEP_S.copysign(left_s);
            orbit = self.runge_kutta_step(&orbit, step_s);
            left_s -= step_s;
        }
        self.runge_kutta_step(&orbit, left_s)
    }

    fn runge_kutta_step(&self, orbit: &Vector6<f64>, step_s: f64) -> Vector6<f64> {
        let k1 = self.rate(orbit);
        let k2 = self.rate(&(orbit + k1 * (step_s / 2.0)));
        let k3 = self.rate(&(orbit + k2 * (step_s / 2.0)));
        let k4 = self.rate(&(orbit + k3 * step_s));
        // x ← x + h (k₁ + 2 k₂ + 2 k₃ + k₄) / 6
        orbit + (k1 + (k2 + k3) * 2.0 + k4) * (step_s / 6.0)
    }

    /// Equations of motion in the rotating axes.
    fn rate(&self, orbit: &Vector6<f64>) -> Vector6<f64> {
        let position = Vector3::new(orbit[0], orbit[1], orbit[2]);
        let velocity = Vector3::new(orbit[3], orbit[4], orbit[5]);
        let squared = position.norm_squared();
        let cubed = squared * squared.sqrt();
        let sine_squared = position.z * position.z / squared;
        // −GM/r³,   3/2 J₂ GM aₑ²/r⁵
        let central = -GM / cubed;
        let oblate = 1.5 * J2 * GM * EARTH_RADIUS_M * EARTH_RADIUS_M / (cubed * squared);
        // r̈ₓ = (−GM/r³ − o (1 − 5 z²/r²)) x + ω² x + 2 ω ẏ + aₓ,   z: 3 instead of 1, no ω
        let flat = central - oblate * (1.0 - 5.0 * sine_squared) + EARTH_RATE * EARTH_RATE;
        let up = central - oblate * (3.0 - 5.0 * sine_squared);
        let coriolis = 2.0 * EARTH_RATE;
        let outside = self.elements.acceleration_mps2.xyz();
        Vector6::new(
            velocity.x,
            velocity.y,
            velocity.z,
            flat * position.x + coriolis * velocity.y + outside.x,
            flat * position.y - coriolis * velocity.x + outside.y,
            up * position.z + outside.z,
        )
    }
}

impl GlonassElements {
    /// How much longer the pseudorange of `signal` is than that of L1, to which the clock is taken
    /// to refer, in metres: **subtract it from the pseudorange**. `None` if the record does not
    /// tell.
    #[must_use]
    pub fn group_delay_m(&self, signal: Signal) -> Option<f64> {
        match (signal.band.system, signal.band.digit) {
            (System::Glonass, 1) => Some(0.0),
            (System::Glonass, 2) => Some(SPEED_OF_LIGHT_MPS * self.l2_delay_s?),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::sample::glonass;
    use super::*;

    /// Positions that RTKLIB 2.4.3 (`geph2pos`, pyrtklib 0.2.7) computes from the same record; it
    /// takes GM = 3.9860044e14, which makes 0.9 mm in 850 s.
    #[test]
    fn as_rtklib_computes_it() {
        let ephemeris = GlonassEphemeris::new(glonass()).unwrap();
        let cases = [
            (
                850.0,
                [-3_494_077.779_61, -10_277_756.762_95, 23_097_438.268_49],
                5.293_342_292_134_651e-5,
            ),
            (
                -700.0,
                [-8_114_912.252_76, -8_775_382.490_69, 22_551_708.844_85],
                5.293_201_320_455_876e-5,
            ),
        ];
        for (age_s, [x, y, z], clock_s) in cases {
            let state = ephemeris.state(glonass().reference_time + age_s).unwrap();
            let apart_m = (state.position_m - Vector::new(x, y, z)).norm();
            assert!(apart_m < 2e-3, "{age_s} s: {apart_m} m");
            assert!((state.clock_s - clock_s).abs() < 1e-13, "{}", state.clock_s);
        }
    }

    #[test]
    fn velocity_is_the_rate_of_position() {
        let ephemeris = GlonassEphemeris::new(glonass()).unwrap();
        for age_s in [-1800.0, -61.0, 0.0, 30.0, 899.0, 1800.0] {
            let time = glonass().reference_time + age_s;
            let at = |offset_s: f64| ephemeris.state(time + offset_s).unwrap();
            let difference = at(0.5).position_m - at(-0.5).position_m;
            let apart = (difference - at(0.0).velocity_mps).norm();
            assert!(apart < 5e-5, "{age_s} s: {apart} m/s");
        }
    }

    /// The constant of the step length: sixty times more steps move nothing that matters.
    #[test]
    fn the_step_is_short_enough() {
        let ephemeris = GlonassEphemeris::new(glonass()).unwrap();
        let start = ephemeris.integrate(0.0);
        let fine = (0..1800).fold(start, |orbit, _| ephemeris.runge_kutta_step(&orbit, 1.0));
        let apart = (fine - ephemeris.integrate(1800.0)).fixed_rows::<3>(0).norm();
        assert!(apart < 2e-3, "{apart} m");
    }

    #[test]
    fn hostile_records_are_refused() {
        let refuse = |change: fn(&mut GlonassElements)| {
            let mut elements = glonass();
            change(&mut elements);
            GlonassEphemeris::new(elements).unwrap_err().field
        };
        let zero = |e: &mut GlonassElements| e.position_m = Vector::new(0.0, 0.0, 0.0);
        assert_eq!(refuse(zero), "distance from the Earth's centre");
        assert_eq!(refuse(|e| e.velocity_mps = Vector::new(f64::NAN, 0.0, 0.0)), "speed");
        assert_eq!(refuse(|e| e.clock_bias_s = f64::INFINITY), "clock bias");
        assert_eq!(refuse(|e| e.channel = 100), "frequency channel");
    }

    #[test]
    fn the_integration_is_bounded() {
        let ephemeris = GlonassEphemeris::new(glonass()).unwrap();
        assert!(ephemeris.state(glonass().reference_time + 7200.0).is_some());
        assert!(ephemeris.state(glonass().reference_time + 7201.0).is_none());
        assert!(ephemeris.state(GpsTime::from_nanoseconds(i64::MAX)).is_none());
    }
}
