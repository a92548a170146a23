//! Where satellites are and what their clocks show: navigation data and their evaluation.
//!
//! [`KeplerEphemeris`] evaluates the broadcast orbits of GPS, Galileo, BeiDou and QZSS,
//! [`GlonassEphemeris`] those of GLONASS, [`PreciseOrbits`] interpolates tabulated ones; [`EphemerisStore`] chooses the
//! record for a satellite and instant; [`NavigationData`] holds everything that navigation files say.
//!
//! A record is checked when it is made ([`BadEphemeris`]), so that its evaluation cannot fail.

mod as_received;
mod glonass;
mod group_delay;
mod kepler;
mod navigation_data;
mod precise;
#[cfg(test)]
mod sample;
mod store;
mod transmissions;
mod utc;

pub use as_received::AsReceived;
pub use glonass::{GlonassElements, GlonassEphemeris};
pub use group_delay::precise_clock_signals;
pub use kepler::{BadEphemeris, KeplerElements, KeplerEphemeris, Message};
pub use navigation_data::{
    IonosphereParameters, Klobuchar, NavigationData, SystemTimeOffset, UtcParameters,
};
pub use precise::{PreciseNode, PreciseOrbits};
pub use store::{Ephemeris, EphemerisStore, NoEphemeris, Transmission};
pub use transmissions::Transmissions;

use nalgebra::Vector3;

use crate::frames::{EARTH_RATE_RADPS, Ecef, Vector};

/// Gravitational constant of the Earth, m³/s² (WGS 84).
const EARTH_GM_M3PS2: f64 = 3.986_004_418e14;

/// A satellite at one instant, in the Earth-fixed axes **of that instant**: the rotation of the
/// Earth while the signal travels is the user's to apply.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SatelliteState {
    /// Antenna phase centre (broadcast) or centre of mass (precise orbits).
    pub position_m: Vector<Ecef>,
    /// Rate of `position_m` in the rotating axes.
    pub velocity_mps: Vector<Ecef>,
    /// Satellite clock minus system time, with the relativistic effect of the eccentricity, without
    /// group delay: subtract it from the satellite's time tag, or add c times it to a pseudorange.
    pub clock_s: f64,
    /// Rate of `clock_s`, s/s.
    pub clock_drift: f64,
    /// Predicted 1-sigma of the range error, as broadcast.
    pub sigma_m: f64,
}

impl SatelliteState {
    /// Longest time over which [`moved`](Self::moved) is exact to a micrometre, s: the flattened Earth, the Moon and
    /// the Sun, whose pull is left out, accelerate a satellite by at most 1e-4 m/s² (half of that times 0.1² s² is 0.5
    /// µm).
    pub const MAX_MOVE_S: f64 = 0.1;

    /// Where the satellite is, and what its clock shows, so many seconds later (earlier if negative), in the axes of
    /// that instant:
    ///
    /// `r(t + δ) = r + v δ + a δ²/2`,   `a = −GM r/|r|³ + Ω² (x, y, 0) + 2Ω (v_y, −v_x, 0)`
    #[must_use]
    pub fn moved(&self, later_s: f64) -> Self {
        let (r, v) = (self.position_m.xyz(), self.velocity_mps.xyz());
        let gravity = -EARTH_GM_M3PS2 / r.norm().powi(3) * r;
        let centrifugal = EARTH_RATE_RADPS * EARTH_RATE_RADPS * Vector3::new(r.x, r.y, 0.0);
        let coriolis = 2.0 * EARTH_RATE_RADPS * Vector3::new(v.y, -v.x, 0.0);
        let acceleration = gravity + centrifugal + coriolis;
        Self {
            position_m: Vector::from_xyz(r + (v + acceleration * (0.5 * later_s)) * later_s),
            velocity_mps: Vector::from_xyz(v + acceleration * later_s),
            clock_s: self.clock_s + self.clock_drift * later_s,
            ..*self
        }
    }
}
