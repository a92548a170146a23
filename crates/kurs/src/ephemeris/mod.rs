//! Where satellites are and what their clocks show: navigation data and their evaluation.
//!
//! [`KeplerEphemeris`] evaluates the broadcast orbits of GPS, Galileo, BeiDou and QZSS,
//! [`GlonassEphemeris`] those of GLONASS, [`PreciseOrbits`] interpolates tabulated ones; [`EphemerisStore`] chooses the record for a satellite and instant; [`NavigationData`] holds
//! everything that navigation files say.
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
mod utc;

pub use as_received::AsReceived;
pub use glonass::{GlonassElements, GlonassEphemeris};
pub use group_delay::precise_clock_signals;
pub use kepler::{BadEphemeris, KeplerElements, KeplerEphemeris, Message};
pub use navigation_data::{
    IonosphereParameters, Klobuchar, NavigationData, SystemTimeOffset, UtcParameters,
};
pub use precise::{PreciseNode, PreciseOrbits};
pub use store::{Ephemeris, EphemerisStore, GalileoPreference, NoEphemeris, Transmission};

use crate::frames::{Ecef, Vector};

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
