//! Attitude from fixed baselines with their full covariance: what the engine asks.
//!
//! `z` stacks the measured baselines (antenna 0 to each other one), `Ω` is the inverse of their full
//! covariance. With `z = (lᵀ ⊗ I) q + noise` the problem is `G = Σᵢⱼ lᵢ lⱼᵀ ⊗ Ωᵢⱼ`,
//! `h = vec Σᵢ (Ω z)ᵢ lᵢᵀ`.

use nalgebra::{DMatrix, DVector, Matrix3, Vector3};

use super::AttitudeError;
use super::uniqueness::Uniqueness;
use super::weighted::{AttitudeProblem, Matrix9};
use crate::array::AntennaArray;
use crate::frames::{Body, Rotation, Vector};

/// Relative difference between a weight matrix and its transpose that passes as rounding.
const SYMMETRY: f64 = 1e-9;

/// Attitude of an array, and how well it fits; `To` is the outside frame of the baselines.
#[derive(Debug, Clone, PartialEq)]
pub struct ArrayAttitude<To> {
    /// The attitude of the lowest cost.
    pub outside_from_body: Rotation<To, Body>,
    /// Covariance of the rotation vector in body axes, rad².
    pub covariance_body_rad2: Matrix3<f64>,
    /// `(z − Q l)ᵀ Ω (z − Q l)`: with true weights χ² of [`ArrayAttitude::degrees_of_freedom`].
    pub chi_squared: f64,
    /// Components measured minus three.
    pub degrees_of_freedom: usize,
    /// Whether another attitude fits too.
    pub uniqueness: Uniqueness,
    /// Measured minus turned baseline, for antennas 1, 2, …
    pub residuals_m: Vec<Vector<To>>,
}

/// Attitude from the baselines antenna 0 → 1, 2, … (m, outside frame) of a non-collinear array.
///
/// `covariance_m2` (3k×3k, baseline after baseline) is their full covariance: baselines from one
/// antenna share its noise. The uniqueness is settled to a `cost_gap` (half a difference of χ²).
///
/// # Errors
///
/// [`AttitudeError::Unobservable`] for a collinear array, for which [`super::direction`] gives
/// heading and pitch; a covariance that is not symmetric or not positive definite; counts that do
/// not belong together; numbers that are not finite.
pub fn solve<To: Copy>(
    array: &AntennaArray,
    baselines_m: &[Vector<To>],
    covariance_m2: &DMatrix<f64>,
    cost_gap: f64,
) -> Result<ArrayAttitude<To>, AttitudeError> {
    let body: Vec<Vector3<f64>> =
        (1..array.len()).map(|rover| array.baseline_m(rover).xyz()).collect();
    let measured = stacked(baselines_m);
    let weight = weight_of(covariance_m2)?;
    let global = problem(&body, &measured, &weight)?.global_minimum(cost_gap)?;

    let rotation = global.minimum.rotation;
    let residuals: Vec<Vector3<f64>> =
        baselines_m.iter().zip(&body).map(|(z, l)| z.xyz() - rotation * l).collect();
    let stacked_residuals = DVector::from_iterator(
        measured.len(),
        residuals.iter().flat_map(|residual| residual.iter().copied()),
    );
    Ok(ArrayAttitude {
        outside_from_body: Rotation::from_matrix(rotation),
        covariance_body_rad2: global.minimum.covariance()?,
        chi_squared: stacked_residuals.dot(&(&weight * &stacked_residuals)),
        degrees_of_freedom: measured.len() - 3,
        uniqueness: global.uniqueness,
        residuals_m: residuals.into_iter().map(Vector::from_xyz).collect(),
    })
}

/// Components of the baselines, one after the other.
pub(super) fn stacked<To>(baselines_m: &[Vector<To>]) -> DVector<f64> {
    let components: Vec<f64> = baselines_m.iter().flat_map(|b| <[f64; 3]>::from(b.xyz())).collect();
    DVector::from_vec(components)
}

/// Inverse of a covariance.
pub(super) fn weight_of(covariance_m2: &DMatrix<f64>) -> Result<DMatrix<f64>, AttitudeError> {
    let what = "covariance of the baselines";
    if !covariance_m2.is_square() {
        let (expected, found) = covariance_m2.shape();
        return Err(AttitudeError::Shape { what: "covariance columns", expected, found });
    }
    check_symmetric(what, covariance_m2)?;
    let cholesky = covariance_m2.clone().cholesky().ok_or(AttitudeError::Indefinite { what })?;
    let inverse = cholesky.inverse();
    Ok(0.5 * (&inverse + inverse.transpose()))
}

/// The attitude problem of stacked baselines.
///
/// `body` holds the `k` baselines in body axes (m), `measured_m` (3k) the same ones in the outside
/// frame, baseline after baseline, `weight` (3k×3k, per m²) the inverse of their covariance.
///
/// # Errors
///
/// Counts that do not belong together, numbers that are not finite, and a weight that is not
/// symmetric or has a negative eigenvalue.
pub fn problem(
    body: &[Vector3<f64>],
    measured_m: &DVector<f64>,
    weight: &DMatrix<f64>,
) -> Result<AttitudeProblem, AttitudeError> {
    check(body, measured_m, weight)?;
    let weighted = weight * measured_m;
    let mut information = Box::new(Matrix9::zeros());
    let mut linear = Matrix3::zeros();
    for (i, l_i) in body.iter().enumerate() {
        linear += weighted.fixed_rows::<3>(3 * i) * l_i.transpose();
        for (j, l_j) in body.iter().enumerate() {
            let block = weight.fixed_view::<3, 3>(3 * i, 3 * j);
            for a in 0..3 {
                for b in 0..3 {
                    let mut target = information.fixed_view_mut::<3, 3>(3 * a, 3 * b);
                    target += block * (l_i[a] * l_j[b]);
                }
            }
        }
    }
    Ok(AttitudeProblem::General { information, linear })
}

fn check(
    body: &[Vector3<f64>],
    measured_m: &DVector<f64>,
    weight: &DMatrix<f64>,
) -> Result<(), AttitudeError> {
    let expected = 3 * body.len();
    for (what, found) in [
        ("baseline components", measured_m.len()),
        ("weight rows", weight.nrows()),
        ("weight columns", weight.ncols()),
    ] {
        if found != expected {
            return Err(AttitudeError::Shape { what, expected, found });
        }
    }
    if body.iter().any(|l| l.iter().any(|c| !c.is_finite())) {
        return Err(AttitudeError::NotFinite { what: "body baseline" });
    }
    if measured_m.iter().any(|c| !c.is_finite()) {
        return Err(AttitudeError::NotFinite { what: "measured baseline" });
    }
    let what = "weight of the baselines";
    check_symmetric(what, weight)?;
    let largest = weight.amax();
    let lifted = weight + DMatrix::identity(expected, expected) * (SYMMETRY * largest);
    if largest > 0.0 && lifted.cholesky().is_none() {
        return Err(AttitudeError::Indefinite { what });
    }
    Ok(())
}

fn check_symmetric(what: &'static str, matrix: &DMatrix<f64>) -> Result<(), AttitudeError> {
    if matrix.iter().any(|c| !c.is_finite()) {
        return Err(AttitudeError::NotFinite { what });
    }
    let difference = (matrix - matrix.transpose()).amax();
    if difference > SYMMETRY * matrix.amax() {
        return Err(AttitudeError::NotSymmetric { what, difference });
    }
    Ok(())
}
