//! Ranges as they would be at a place: without ionosphere where two bands tell it, behind the troposphere, with their
//! variance.

use nalgebra::Vector3;

use super::PointSettings;
use super::fit::PositionFit;
use crate::atmosphere::{Troposphere, ionosphere_m};
use crate::frames::{Ecef, Vector};
use crate::point::{Code, Tracked};
use crate::sky::{Horizon, View};

/// Standard deviation of such ranges: troposphere and ionosphere at the horizon.
pub(super) const ROUGH_SD_M: f64 = 100.0;
/// No model knows the ionosphere better than this, m.
const MIN_IONOSPHERE_SD_M: f64 = 0.1;

/// What surrounds the antenna at the current position.
pub(super) struct Surroundings {
    horizon: Horizon,
    troposphere: Troposphere,
    up: Vector3<f64>,
    /// Sine of the lowest elevation that is used.
    lowest: f64,
}

/// The range that counts for one satellite, its atmospheric delay, and the variance of both.
pub(super) struct Modelled {
    pub(super) pseudorange_m: f64,
    pub(super) delay_m: f64,
    /// Derivative of the delay by the antenna's position.
    pub(super) delay_gradient: Vector3<f64>,
    pub(super) variance_m2: f64,
}

impl Modelled {
    /// While the position is not near enough for directions: as good as any other.
    pub(super) fn rough(satellite: &Tracked) -> Self {
        let pseudorange_m = satellite.code.pseudorange_m;
        let delay_gradient = Vector3::zeros();
        Self { pseudorange_m, delay_m: 0.0, delay_gradient, variance_m2: ROUGH_SD_M * ROUGH_SD_M }
    }
}

impl Surroundings {
    pub(super) fn at(antenna_m: Vector<Ecef>, settings: &PointSettings) -> Self {
        let horizon = Horizon::at(antenna_m);
        let lowest = horizon.lowest_elevation_rad(settings.elevation_mask_rad).sin();
        let up = (horizon.ned_from_ecef().inverse() * Vector::new(0.0, 0.0, -1.0)).xyz();
        Self { horizon, troposphere: Troposphere::above(&horizon.geodetic), up, lowest }
    }

    /// Delays and variance; `None` below the mask.
    pub(super) fn model(
        &self,
        satellite: &Tracked,
        view: &View,
        fit: &PositionFit<'_>,
    ) -> Option<Modelled> {
        let direction = self.horizon.direction(view.line_of_sight);
        let sin_elevation = direction.sin_elevation();
        if sin_elevation < self.lowest {
            return None;
        }
        let frequency_hz = satellite.code.frequency_hz;
        let modelled_m = ionosphere_m(
            fit.ionosphere,
            &self.horizon.geodetic,
            &direction,
            fit.time,
            frequency_hz,
        );
        let (range_m, range_m2) = self.range(satellite, sin_elevation, modelled_m, fit);
        let troposphere_m = self.troposphere.delay_m(sin_elevation);
        // A standard atmosphere leaves some centimetres at the zenith.
        let remaining_m2 = (0.05 * troposphere_m).powi(2) + satellite.state.sigma_m.powi(2);
        Some(Modelled {
            pseudorange_m: range_m,
            delay_m: troposphere_m,
            delay_gradient: self.up * self.troposphere.slope(sin_elevation),
            variance_m2: range_m2 + remaining_m2,
        })
    }

    /// Range without ionosphere from one or two code observations, and its variance:
    ///
    /// `P₁ = r + I + e₁`, `P₂ = r + γ I + e₂` with `γ = (f₁ / f₂)²`, and the model's `I` (m, on the
    /// first band) as an observation that is good to its own size (its errors are alike for all
    /// satellites, so it must not outweigh what the second band measures). Group delays that nobody
    /// tells are in `I` too.
    fn range(
        &self,
        satellite: &Tracked,
        sin_elevation: f64,
        modelled_m: f64,
        fit: &PositionFit<'_>,
    ) -> (f64, f64) {
        let weight = |code: &Code| {
            1.0 / fit.settings.noise.variances(code.band, sin_elevation, code.cn0_dbhz).code_m2
        };
        let first = &satellite.code;
        let w1 = weight(first);
        let model_m2 = modelled_m.max(MIN_IONOSPHERE_SD_M).powi(2);
        let w_model = 1.0 / (model_m2 + satellite.delay_sd_m.powi(2));
        let (p2, w2, gamma) = satellite.second.as_ref().map_or((0.0, 0.0, 1.0), |second| {
            let gamma = (first.frequency_hz / second.frequency_hz).powi(2);
            (second.pseudorange_m, weight(second), gamma)
        });
        // Normal equations of (r, I), solved for r
        let (n_ri, n_ii) = (w1 + gamma * w2, w1 + gamma * gamma * w2 + w_model);
        let determinant = (w1 + w2) * n_ii - n_ri * n_ri;
        let b_r = w1 * first.pseudorange_m + w2 * p2;
        let b_i = w1 * first.pseudorange_m + gamma * w2 * p2 + w_model * modelled_m;
        ((n_ii * b_r - n_ri * b_i) / determinant, n_ii / determinant)
    }
}
