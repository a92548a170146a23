//! What an epoch is on its way from its integers to its row.

use nalgebra::DVector;

use crate::baseline::Baselines;
use crate::solution::{LeftOut, Outcome, PredictionRole};

use super::acceptance::Checks;
use super::fix::{Epoch, Fix};
use super::orientation::Orientation;
use super::predicted_attitude::PredictedBaselines;

/// An epoch whose integers were searched: what was found, or why there are none.
#[derive(Debug)]
pub(super) struct Searched {
    pub(super) epoch: Epoch,
    pub(super) fix: Fix,
    pub(super) left_out: Option<LeftOut>,
    /// Of the integers where they are sure, of the float solution else.
    pub(super) baselines: Baselines,
    /// By which the epoch's own residuals have made their covariance larger than the session's noise does.
    pub(super) factor: f64,
    /// Corrections to the approximate baselines that `baselines` holds, m.
    pub(super) correction_m: DVector<f64>,
    pub(super) predicted: Option<PredictedBaselines>,
    /// By the prediction.
    pub(super) is_decided: bool,
}

/// The body of that epoch.
#[derive(Debug)]
pub(super) struct Oriented {
    pub(super) searched: Searched,
    pub(super) orientation: Orientation,
}

/// What becomes of it.
#[derive(Debug)]
pub(super) struct Judged {
    pub(super) oriented: Oriented,
    pub(super) checks: Checks,
    pub(super) outcome: Outcome,
    pub(super) prediction: Option<PredictionRole>,
}
