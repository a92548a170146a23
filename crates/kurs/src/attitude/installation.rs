//! The turn that errors of the surveyed antenna positions cause.
//!
//! The baselines measure the antennas where they are, `zᵢ = Q (lᵢ + sᵢ − s₀) + noise`; the estimate
//! lays the array onto them where the survey has it. To first order it turns by
//!
//! ```text
//! θ = (Gᵀ Ω G)⁻¹ Gᵀ Ω Q (s − s₀) = Σ Kᵢ Q (sᵢ − s₀),     Gᵢ = ∂(Q exp[θ]× lᵢ)/∂θ = −Q [lᵢ]×
//! ```
//!
//! with the weight `Ω` of the estimate. Errors of the antennas that are independent, with `σ` in each
//! coordinate, give `P = σ² (Σ Kᵢ Kᵢᵀ + K₀ K₀ᵀ)`, `K₀ = −Σ Kᵢ`. The body carries them along: they are
//! the same in every epoch and no mean takes them away.

use nalgebra::{DMatrix, Matrix3, Matrix3x2, Vector3};

use super::direction::tangent_plane;
use crate::frames::skew;

/// Covariance of the rotation vector in body axes, rad², that antenna positions known to `array_sd_m`
/// in each coordinate cause.
///
/// `baselines_m` are those of the array in body axes, `rotation` turns them to the frame in which
/// `covariance_m2` (3k×3k), the inverse of the weight of the estimate, holds. For antennas on one line
/// `line` is its unit vector in body axes: turns about it are left out. `None` if the baselines leave
/// some other turn open.
#[must_use]
pub fn survey_turn_rad2(
    baselines_m: &[Vector3<f64>],
    rotation: &Matrix3<f64>,
    covariance_m2: &DMatrix<f64>,
    line: Option<&Vector3<f64>>,
    array_sd_m: f64,
) -> Option<Matrix3<f64>> {
    if array_sd_m == 0.0 {
        return Some(Matrix3::zeros());
    }
    let (covariance_rad2, weighted) = turns(baselines_m, rotation, covariance_m2, line)?;
    let mut of_first = Matrix3::zeros();
    let mut sum = Matrix3::zeros();
    for block in 0..baselines_m.len() {
        let gain = covariance_rad2 * weighted.fixed_view::<3, 3>(3 * block, 0).transpose();
        of_first -= gain;
        sum += gain * gain.transpose();
    }
    Some((sum + of_first * of_first.transpose()) * array_sd_m.powi(2))
}

/// Covariance of the rotation vector in body axes, rad², that baselines with `covariance_m2` leave; arguments as
/// for [`survey_turn_rad2`].
#[must_use]
pub fn turn_covariance_rad2(
    baselines_m: &[Vector3<f64>],
    rotation: &Matrix3<f64>,
    covariance_m2: &DMatrix<f64>,
    line: Option<&Vector3<f64>>,
) -> Option<Matrix3<f64>> {
    turns(baselines_m, rotation, covariance_m2, line).map(|(covariance_rad2, _)| covariance_rad2)
}

/// `(Gᵀ Ω G)⁻¹` and `Ω G`.
fn turns(
    baselines_m: &[Vector3<f64>],
    rotation: &Matrix3<f64>,
    covariance_m2: &DMatrix<f64>,
    line: Option<&Vector3<f64>>,
) -> Option<(Matrix3<f64>, DMatrix<f64>)> {
    let mut by_turn = DMatrix::zeros(3 * baselines_m.len(), 3);
    for (block, baseline_m) in baselines_m.iter().enumerate() {
        let rows = -rotation * skew(baseline_m);
        by_turn.fixed_view_mut::<3, 3>(3 * block, 0).copy_from(&rows);
    }
    let weighted = covariance_m2.clone().cholesky()?.solve(&by_turn);
    let information: Matrix3<f64> =
        (by_turn.transpose() * &weighted).fixed_view::<3, 3>(0, 0).into();
    let inverse = match line {
        None => information.try_inverse()?,
        Some(axis) => inverse_across(&information, axis)?,
    };
    Some((inverse, weighted))
}

/// `B (Bᵀ M B)⁻¹ Bᵀ`, `B` a basis of the plane across `axis`.
fn inverse_across(information: &Matrix3<f64>, axis: &Vector3<f64>) -> Option<Matrix3<f64>> {
    let plane: Matrix3x2<f64> = tangent_plane(axis);
    let inner = plane.transpose() * information * plane;
    Some(plane * inner.try_inverse()? * plane.transpose())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::array::AntennaArray;
    use crate::attitude::joint;
    use crate::attitude::weighted::{exponential, logarithm};
    use crate::frames::{Ned, Vector};
    use nalgebra::DVector;
    use proptest::prelude::*;

    /// Noise of antenna 0 in all baselines, down twice as large as across.
    fn shared_noise(baselines: usize) -> DMatrix<f64> {
        let between = DMatrix::from_element(baselines, baselines, 1.0)
            + DMatrix::<f64>::identity(baselines, baselines);
        let axes = DMatrix::from_diagonal(&DVector::from_column_slice(&[9e-6, 9e-6, 36e-6]));
        between.kronecker(&axes)
    }

    proptest! {
        /// The formula against antennas that are moved by hand, one coordinate after the other.
        #[test]
        fn antennas_moved_by_hand(v in proptest::array::uniform3(-2.0..2.0f64)) {
            let rotation = exponential(&Vector3::from(v));
            let places = [[0.0, 0.0, 0.0], [1.0, 0.0, -0.1], [0.2, -0.8, 0.0], [-0.4, 0.6, 0.3]];
            let array = AntennaArray::new(places.map(|[x, y, z]| Vector::new(x, y, z)).to_vec());
            let array = array.unwrap();
            let covariance = shared_noise(3);
            let moved = |antenna: usize, axis: usize, step: f64| {
                let mut true_m = places.map(Vector3::from);
                true_m[antenna][axis] += step;
                let baselines: Vec<Vector<Ned>> =
                    (1..4).map(|i| Vector::from_xyz(rotation * (true_m[i] - true_m[0]))).collect();
                let found = joint::solve(&array, &baselines, &covariance, 10.0).unwrap();
                logarithm(&(rotation.transpose() * found.outside_from_body.matrix()))
            };
            let mut expected = Matrix3::zeros();
            for (antenna, axis) in (0..4).flat_map(|a| (0..3).map(move |x| (a, x))) {
                let turn = (moved(antenna, axis, 1e-5) - moved(antenna, axis, -1e-5)) / 2e-5;
                expected += turn * turn.transpose() * 0.01f64.powi(2);
            }
            let body: Vec<_> = (1..4).map(|i| array.baseline_m(i).xyz()).collect();
            let found = survey_turn_rad2(&body, &rotation, &covariance, None, 0.01).unwrap();
            prop_assert!((found - expected).norm() < 1e-5 * expected.norm());
        }
    }

    /// Two antennas 2 m apart, each surveyed to 1 cm: the line turns by √2 · 0.01 / 2 about both axes
    /// across it, and by nothing about itself.
    #[test]
    fn two_antennas_turn_across_their_line() {
        let covariance = DMatrix::identity(3, 3) * 1e-5;
        let baseline = [Vector3::new(2.0, 0.0, 0.0)];
        let line = Some(&Vector3::x());
        let found =
            survey_turn_rad2(&baseline, &Matrix3::identity(), &covariance, line, 0.01).unwrap();
        let expected = Matrix3::from_diagonal(&Vector3::new(0.0, 0.5e-4, 0.5e-4));
        assert!((found - expected).norm() < 1e-15, "{found}");
        let open = survey_turn_rad2(&baseline, &Matrix3::identity(), &covariance, None, 0.01);
        assert_eq!(open, None);
    }
}
