//! The measurement model of the rotating-frame paper **as published**, equations (35)–(39).
//!
//! Kept as the reference that shows why the published filter cannot work: the turning antenna does
//! not enter pseudorange and range rate, the accelerometers feel no gravity, and the centripetal
//! term is a constant in body axes. Without acceleration of the centre nothing depends on the
//! attitude. [`super::super::model`] is the model to use.

use super::super::ArmMotion;
use super::super::gradient::{Gradient, Motion, Prediction};
use super::super::ranging::SatelliteMotion;

/// D = |r − s| + Δ, equations (35), (36).
#[must_use]
pub fn pseudorange(motion: &Motion, satellite: &SatelliteMotion) -> Prediction {
    let range = motion.position_m - satellite.position_m;
    let distance_m = range.norm();
    Prediction {
        value: distance_m + motion.clock_m,
        gradient: Gradient { position: range / distance_m, clock: 1.0, ..Gradient::ZERO },
    }
}

/// Ḋ = eᵀ(v − ṡ) + Δ̇, equations (37), (38).
#[must_use]
pub fn range_rate(motion: &Motion, satellite: &SatelliteMotion) -> Prediction {
    let range = motion.position_m - satellite.position_m;
    let distance_m = range.norm();
    let e = range / distance_m;
    let velocity = motion.velocity_mps - satellite.velocity_mps;
    let rate_mps = e.dot(&velocity);
    Prediction {
        value: rate_mps + motion.clock_rate_mps,
        gradient: Gradient {
            // ∂Ḋ/∂r = (v − ṡ − Ṙ e) / R
            position: (velocity - e * rate_mps) / distance_m,
            velocity: e,
            clock_rate: 1.0,
            ..Gradient::ZERO
        },
    }
}

/// n = Cᵀ a + ρ̈, equation (39): the three accelerometers.
#[must_use]
pub fn specific_force(motion: &Motion, arm: &ArmMotion) -> [Prediction; 3] {
    let body_from_ecef = motion.ecef_from_body.transpose();
    let in_body = body_from_ecef * motion.acceleration_mps2;
    let value = in_body + arm.acceleration_mps2;
    // ∂(Cᵀ a)/∂φ = [(Cᵀ a)×]
    let by_attitude = in_body.cross_matrix();
    [0, 1, 2].map(|axis| Prediction {
        value: value[axis],
        gradient: Gradient {
            acceleration: body_from_ecef.row(axis).transpose(),
            attitude: by_attitude.row(axis).transpose(),
            arm_angle: arm.acceleration_by_angle[axis],
            ..Gradient::ZERO
        },
    })
}
