//! Dilutions of precision of a position beyond the horizontal one, which comes with it.
//!
//! All of them are one matrix `Q` with `C = σ² Q`: their ratios are those of the standard
//! deviations, `VDOP / HDOP = σ_D / √(σ_N² + σ_E²)`.

use kurs::solution::PositionEstimate;

/// See the module.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Dilution {
    pub(crate) north: f64,
    pub(crate) east: f64,
    pub(crate) horizontal: f64,
    pub(crate) vertical: f64,
    pub(crate) position: f64,
}

impl Dilution {
    /// `None` where no satellites were used, or the covariance says nothing.
    pub(crate) fn of(position: &PositionEstimate) -> Option<Self> {
        let horizontal = position.hdop?;
        let [north, east, down]: [f64; 3] = position.covariance_m2.diagonal().into();
        let scale = horizontal / (north + east).sqrt();
        let of = |variance: f64| variance.sqrt() * scale;
        let found = Self {
            north: of(north),
            east: of(east),
            horizontal,
            vertical: of(down),
            position: of(north + east + down),
        };
        found.position.is_finite().then_some(found)
    }
}
