//! What the GNSS receiver on the arm gives to the filters.

use nalgebra::Vector3;

use crate::signal::Satellite;

/// A satellite at the instant of measurement.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SatelliteMotion {
    /// s: ECEF position as seen at reception (Earth rotation during the signal's travel applied).
    pub position_m: Vector3<f64>,
    /// ṡ: ECEF velocity.
    pub velocity_mps: Vector3<f64>,
}

/// A value and the standard deviation of its noise, in the same unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measured {
    /// The value.
    pub value: f64,
    /// 1 σ.
    pub sd: f64,
}

/// One satellite's measurements at one instant, corrected for everything but the receiver: satellite
/// clock and atmosphere are taken out. Any of them may be missing.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ranging {
    /// Which satellite.
    pub satellite: Satellite,
    /// Where it is.
    pub motion: SatelliteMotion,
    /// D, m.
    pub pseudorange_m: Option<Measured>,
    /// Ḋ, m/s, growing distance positive.
    pub range_rate_mps: Option<Measured>,
    /// Carrier phase in m, with an unknown constant.
    pub phase_m: Option<Measured>,
    /// Whether that constant may have changed since the satellite was last seen.
    pub slipped: bool,
}

impl Measured {
    /// Whether value and standard deviation can be used.
    #[must_use]
    pub fn is_usable(&self) -> bool {
        self.value.is_finite() && self.sd.is_finite() && self.sd > 0.0
    }

    /// N.
    #[must_use]
    pub const fn variance(&self) -> f64 {
        self.sd * self.sd
    }
}
