//! An attitude predicted from outside – by a gyro, from the fixes before – beside the phases of an epoch.
//!
//! It does two things. Where the epoch alone is not sure of its integers, it decides between them, as a
//! measurement of the baselines: with `x_p = vec(R l)` and `R exp[φ×] l ≈ R l − R [l×] φ`,
//!
//! `Uᵀ x ~ N(Uᵀ x_p, V)`,   `V = Uᵀ (k J P Jᵀ + S) U`,   `J = −R [l×]` of all baselines, `U` a basis of its range
//!
//! (`P` covariance of the prediction, `k` an allowance for sensors that are worse than stated, `S` survey of
//! the antennas). And it refuses a fix that lies too far from it. It decides on integers only: attitude and
//! covariance of a fixed row follow from code and phases, so that whoever made the prediction may take
//! them as new.
//!
//! A wrong prediction must not make wrong fixes. So the integers that it points at have to be plausible
//! with it and without it, and the model so strong that beside a wrong prediction hardly any would be.

use nalgebra::{DMatrix, DVector, Matrix3, Vector3};

use super::acceptance::Known;
use super::fix::{Epoch, Fix};
use super::locate::CommonFrame;
use super::search::{Problem, Searches};
use super::settings::{Constraint, Settings};
use crate::array::survey_covariance;
use crate::baseline::Baselines;
use crate::chi_square::chi_square_tail;
use crate::float_solution::FloatSolution;
use crate::frames::{Body, Ned, Rotation, Vector, skew};
use crate::sky::Horizon;
use crate::solution::PredictionRole;

/// `k`: the prediction counts as twice as uncertain as it says.
const ALLOWANCE: f64 = 4.0;
/// A prediction less certain than this (1-sigma with the allowance) says nothing of integers, and its
/// errors are no longer small turns.
const MAX_SD_RAD: f64 = 0.26;
/// A fix further from the prediction than is this probable contradicts it: five sigmas of a single value.
const MIN_PROBABLE: f64 = 5.7e-7;
/// Integers that fit code and phases worse than this probability are not believed, whatever is
/// predicted.
const MIN_PLAUSIBLE_ALONE: f64 = 1e-4;
/// Integers that fit the predicted baselines worse than this probability are not believed either.
const MIN_PLAUSIBLE: f64 = 0.01;
/// The same bound in standard deviations of a single value.
const PLAUSIBLE_SIGMAS: f64 = 2.326;
/// Least standard deviation of the surveyed positions that is reckoned with here, m.
const MIN_ARRAY_SD_M: f64 = 0.001;
/// Components of the baselines that a turn of the body changes by less than this share of the largest
/// are not changed by it.
const MIN_CHANGE: f64 = 1e-3;

/// An attitude that is expected at the instant of an epoch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PredictedAttitude {
    /// The attitude.
    pub ned_from_body: Rotation<Ned, Body>,
    /// Of the rotation vector of its error in body axes, rad².
    pub covariance_rad2: Matrix3<f64>,
    /// Whether it may decide between integers. Otherwise it only refuses fixes that contradict it.
    pub may_decide: bool,
}

/// What a predicted attitude says of the baselines of an epoch.
#[derive(Debug)]
pub(super) struct PredictedBaselines {
    /// `x_p`, ECEF, m (3k).
    expected_m: DVector<f64>,
    /// `U` (3k × r).
    directions: DMatrix<f64>,
    /// `k J P Jᵀ + S`, m² (3k × 3k).
    covariance_m2: DMatrix<f64>,
    pub(super) may_decide: bool,
}

impl PredictedAttitude {
    /// The baselines of `float`, if the array is known and the prediction certain enough.
    pub(super) fn baselines(
        &self,
        float: &FloatSolution,
        horizon: &Horizon,
        settings: &Settings,
    ) -> Option<PredictedBaselines> {
        let positions_m = settings.array.as_ref()?.positions_m();
        let ecef_from_body = horizon.ned_from_ecef().inverse() * self.ned_from_body;
        let k = float.rovers.len();
        let mut expected_m = DVector::zeros(3 * k);
        let mut turn = DMatrix::zeros(3 * k, 3);
        for (block, rover) in float.rovers.iter().enumerate() {
            let line_body: Vector<Body> = positions_m[*rover] - positions_m[float.reference];
            let line: Vector3<f64> = (ecef_from_body * line_body).xyz();
            expected_m.fixed_rows_mut::<3>(3 * block).copy_from(&line);
            let by_turn = -ecef_from_body.matrix() * skew(&line_body.xyz());
            turn.fixed_view_mut::<3, 3>(3 * block, 0).copy_from(&by_turn);
        }
        let covariance_rad2 = self.covariance_rad2 * ALLOWANCE;
        let finite = expected_m.iter().chain(&covariance_rad2).all(|value| value.is_finite());
        let svd = finite.then(|| turn.clone().svd(true, true))?;
        let (u, turns) = (svd.u?, svd.v_t?);
        let seen: Vec<usize> = (0..3)
            .filter(|i| svd.singular_values[*i] > MIN_CHANGE * svd.singular_values.max())
            .collect();
        let is_certain = |i: &usize| {
            let axis = turns.row(*i).transpose();
            let variance_rad2 = axis.dot(&(covariance_rad2 * &axis));
            (0.0..=MAX_SD_RAD * MAX_SD_RAD).contains(&variance_rad2)
        };
        if seen.is_empty() || !seen.iter().all(is_certain) {
            return None;
        }
        let survey_m2 = survey_covariance(k, settings.array_sd_m.max(MIN_ARRAY_SD_M));
        Some(PredictedBaselines {
            expected_m,
            directions: u.select_columns(&seen),
            covariance_m2: &turn * covariance_rad2 * turn.transpose() + survey_m2,
            may_decide: self.may_decide,
        })
    }
}

impl PredictedBaselines {
    /// What it does for baselines that are fixed, by its own decision or without it.
    pub(super) fn role(&self, fixed: &Baselines, is_decided: bool) -> PredictionRole {
        match is_decided {
            _ if self.contradict(fixed) => PredictionRole::Refused,
            true => PredictionRole::Decided,
            false => PredictionRole::Agreed,
        }
    }

    /// Whether fixed baselines are too far from what is predicted.
    fn contradict(&self, fixed: &Baselines) -> bool {
        if fixed.vectors_m.len() != self.expected_m.len() {
            return false;
        }
        let u = &self.directions;
        let off_m = u.tr_mul(&(&fixed.vectors_m - &self.expected_m));
        let both_m2 = u.tr_mul(&(&self.covariance_m2 + &fixed.covariance_m2)) * u;
        let Some(factor) = both_m2.cholesky() else { return false };
        chi_square_tail(off_m.dot(&factor.solve(&off_m)), off_m.len()) < MIN_PROBABLE
    }

    /// The float solution with the prediction in it.
    fn inform(&self, float: &FloatSolution, frame: &CommonFrame) -> Option<FloatSolution> {
        let measured_m = self.directions.tr_mul(&(&self.expected_m - frame.approximate()));
        let covariance_m2 = self.directions.tr_mul(&self.covariance_m2) * &self.directions;
        float.informed(&self.directions, &measured_m, &covariance_m2)
    }

    /// The float solution with the shape of the array in it too.
    fn inform_of_all(&self, float: &FloatSolution, frame: &CommonFrame) -> Option<FloatSolution> {
        let all = DMatrix::identity(self.expected_m.len(), self.expected_m.len());
        let measured_m = &self.expected_m - frame.approximate();
        float.informed(&all, &measured_m, &self.covariance_m2)
    }
}

impl Searches {
    /// Integers that a predicted attitude makes sure where the epoch alone is not; of these fixes, too, a
    /// share of `max_wrong_fix_rate` may be wrong.
    pub(super) fn fix_with_prediction(
        &mut self,
        predicted: &PredictedBaselines,
        epoch: &Epoch,
        settings: &Settings,
        known: Known,
    ) -> Option<Fix> {
        let Epoch { float, frame, .. } = epoch;
        let array = settings.array.as_ref().filter(|_| settings.constraint != Constraint::None)?;
        if float.ambiguities_cycles.is_empty() {
            return None;
        }
        let beside = predicted.inform_of_all(float, frame)?;
        if chance_of_a_fit(&beside)? > settings.max_wrong_fix_rate {
            return None;
        }
        let informed = predicted.inform(float, frame)?;
        let problem = epoch.problem(&informed, settings, known);
        let found = self.with_array(&problem, array).ok()?;
        let alone = probability(float, &found.integers)?;
        if alone < MIN_PLAUSIBLE_ALONE || probability(&beside, &found.integers)? < MIN_PLAUSIBLE {
            return None;
        }
        let fix = Fix::of(found, &Problem { float, ..problem });
        fix.is_accepted().then_some(fix)
    }
}

/// How probable it is that the true integers are no nearer to a float solution than these:
/// `(â − z)ᵀ Q_â⁻¹ (â − z)` is χ².
fn probability(float: &FloatSolution, integers: &[f64]) -> Option<f64> {
    let off = &float.ambiguities_cycles - DVector::from_column_slice(integers);
    let factor = float.ambiguity_covariance().clone().cholesky()?;
    Some(chi_square_tail(off.dot(&factor.solve(&off)), off.len()))
}

/// How many integer vectors would be plausible by chance beside wrong baselines, where the fractions of
/// the float ambiguities mean nothing: the volume of those that are, in cycles,
///
/// `ω_n ρⁿ √|Q_â|`,   `ω_n` volume of the unit ball
fn chance_of_a_fit(beside: &FloatSolution) -> Option<f64> {
    let n = beside.ambiguities_cycles.len();
    // ½ ln|Q_â|
    let factor = beside.ambiguity_covariance().clone().cholesky()?;
    let log_root: f64 = factor.l_dirty().diagonal().iter().map(|d| d.ln()).sum();
    Some((log_ball(n) + n as f64 * plausible_radius(n).ln() + log_root).exp())
}

/// Root of the χ² with `n` degrees of freedom that is exceeded with [`MIN_PLAUSIBLE`] (Wilson and
/// Hilferty 1931): `χ² ≈ n (1 − 2/9n + z √(2/9n))³`.
fn plausible_radius(n: usize) -> f64 {
    let (n, spread) = (n as f64, 2.0 / (9.0 * n.max(1) as f64));
    (n * (1.0 - spread + PLAUSIBLE_SIGMAS * spread.sqrt()).powi(3)).sqrt()
}

/// Logarithm of the volume of the unit ball: `ω₀ = 1`, `ω₁ = 2`, `ω_n = 2π/n ω_{n−2}`.
fn log_ball(n: usize) -> f64 {
    let first = if n.is_multiple_of(2) { 0.0 } else { core::f64::consts::LN_2 };
    let steps = (2..=n).filter(|m| m % 2 == n % 2);
    first + steps.map(|m| (core::f64::consts::TAU / m as f64).ln()).sum::<f64>()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_volume_of_what_is_plausible() {
        let pi = core::f64::consts::PI;
        for (n, volume) in [(0, 1.0), (1, 2.0), (2, pi), (3, 4.0 * pi / 3.0), (6, pi.powi(3) / 6.0)]
        {
            assert!((log_ball(n) - f64::ln(volume)).abs() < 1e-12, "{n}");
        }
        for n in 3..40 {
            let exceeded = chi_square_tail(plausible_radius(n).powi(2), n);
            assert!((exceeded / MIN_PLAUSIBLE - 1.0).abs() < 0.03, "{n}: {exceeded}");
        }
    }
}
