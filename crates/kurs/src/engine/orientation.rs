//! From baselines to the angles of the body.

use nalgebra::{DMatrix, DVector, Matrix3};

use super::misfit::{Misfit, survey_covariance};

use crate::array::{AntennaArray, Shape};
use crate::attitude::joint;
use crate::baseline::Baselines;
use crate::chi_square::chi_square_tail;
use crate::frames::{Body, Ecef, Ned, Rotation, Vector};
use crate::sky::Horizon;
use crate::solution::{AttitudeEstimate, Reason};

/// A second attitude whose χ² is worse by less than this is not told apart (99.9 %, one degree of
/// freedom).
const TWO_MINIMA_CHI2: f64 = 10.8;
/// Fixed baselines whose misfit to the array is less probable than this do not come from this array.
const MIN_PROBABLE_MISFIT: f64 = 1e-5;

/// How the body stands, and how its baselines fit to the known array.
#[derive(Debug)]
pub(super) struct Orientation {
    pub(super) attitude: Result<AttitudeEstimate, Reason>,
    /// `None` where nothing is known that they could fit to.
    pub(super) misfit: Option<Misfit>,
}

/// Orientation of the body: all three angles for an array that spans a plane, otherwise heading
/// and pitch of the line of antennas.
pub(super) fn orient(
    baselines: &Baselines,
    horizon: &Horizon,
    array: Option<&AntennaArray>,
    array_sd_m: f64,
) -> Orientation {
    let present = array.and_then(|array| present_part(array, baselines));
    match present.filter(|part| part.shape() != Shape::Collinear) {
        Some(part) => full(baselines, horizon, &part, array_sd_m),
        None => of_line(baselines, horizon, array, array_sd_m),
    }
}

/// Heading and pitch of the first baseline.
fn of_line(
    baselines: &Baselines,
    horizon: &Horizon,
    array: Option<&AntennaArray>,
    array_sd_m: f64,
) -> Orientation {
    let ned_from_ecef = horizon.ned_from_ecef();
    let line_ned = ned_from_ecef * baselines.vector_m(0);
    let covariance_m2 = ned_from_ecef.turn_covariance(&baselines.block_m2(0));
    let (reference, rover) = (baselines.reference, baselines.rovers[0]);
    let line_body = array.map(|array| array.positions_m()[rover] - array.positions_m()[reference]);
    let forward = Vector::new(1.0, 0.0, 0.0);
    let attitude = direction(line_ned, &covariance_m2, line_body.unwrap_or(forward));
    let misfit = line_body.map(|line_body| {
        let along = line_ned.direction().xyz();
        let longer_m = line_ned.norm() - line_body.norm();
        let variance_m2 = along.dot(&(covariance_m2 * along));
        Misfit::of_length([reference, rover], line_body.xyz(), longer_m, variance_m2, array_sd_m)
    });
    Orientation { attitude: attitude.ok_or(Reason::Geometry), misfit }
}

/// The antennas that have a baseline, as an array.
fn present_part(array: &AntennaArray, baselines: &Baselines) -> Option<AntennaArray> {
    let all = array.positions_m();
    let mut positions_m = vec![all[baselines.reference]];
    positions_m.extend(baselines.rovers.iter().map(|rover| all[*rover]));
    AntennaArray::new(positions_m).ok()
}

/// All three angles: Wahba start, Newton with the full covariance of the baselines.
fn full(
    baselines: &Baselines,
    horizon: &Horizon,
    array: &AntennaArray,
    array_sd_m: f64,
) -> Orientation {
    let vectors: Vec<_> = (0..baselines.rovers.len()).map(|b| baselines.vector_m(b)).collect();
    let covariance_m2 = &baselines.covariance_m2;
    let Ok(solved) = joint::solve(array, &vectors, covariance_m2, TWO_MINIMA_CHI2 / 2.0) else {
        return Orientation { attitude: Err(Reason::Geometry), misfit: None };
    };
    let survey_m2 = survey_covariance(vectors.len(), array_sd_m);
    let chi2 = squares(&solved.residuals_m, covariance_m2 + survey_m2);
    let fits = chi2.is_some_and(|chi2| {
        chi_square_tail(chi2, solved.degrees_of_freedom) >= MIN_PROBABLE_MISFIT
    });
    let attitude = if !fits {
        Err(Reason::Geometry)
    } else if solved.uniqueness.is_ambiguous(TWO_MINIMA_CHI2 / 2.0) {
        Err(Reason::TwoMinima)
    } else {
        let ned_from_body: Rotation<Ned, Body> = horizon.ned_from_ecef() * solved.outside_from_body;
        Ok(AttitudeEstimate::full(ned_from_body, &solved.covariance_body_rad2))
    };
    Orientation { attitude, misfit: Some(in_body_axes(baselines, array, &solved, array_sd_m)) }
}

/// What the baselines leave against the array, and their covariance, in body axes.
fn in_body_axes(
    baselines: &Baselines,
    array: &AntennaArray,
    solved: &joint::ArrayAttitude<Ecef>,
    array_sd_m: f64,
) -> Misfit {
    let body_from_ecef = solved.outside_from_body.inverse();
    let turned = solved.residuals_m.iter().map(|residual| body_from_ecef * *residual);
    let mut turn = DMatrix::zeros(baselines.vectors_m.len(), baselines.vectors_m.len());
    for block in 0..baselines.rovers.len() {
        turn.fixed_view_mut::<3, 3>(3 * block, 3 * block).copy_from(&body_from_ecef.matrix());
    }
    let positions_m = array.positions_m();
    Misfit {
        antennas: [baselines.reference].iter().chain(&baselines.rovers).copied().collect(),
        known_m: positions_m[1..].iter().map(|p| (*p - positions_m[0]).xyz()).collect(),
        residual_m: DVector::from_iterator(
            baselines.vectors_m.len(),
            turned.flat_map(|residual| <[f64; 3]>::from(residual.xyz())),
        ),
        covariance_m2: &turn * &baselines.covariance_m2 * turn.transpose(),
        array_sd_m,
    }
}

/// `rᵀ Q⁻¹ r` of the residuals of all baselines.
fn squares<F: Copy>(residuals_m: &[Vector<F>], covariance_m2: DMatrix<f64>) -> Option<f64> {
    let components = residuals_m.iter().flat_map(|r| <[f64; 3]>::from(r.xyz()));
    let residual = DVector::from_iterator(3 * residuals_m.len(), components);
    Some(residual.dot(&covariance_m2.cholesky()?.solve(&residual)))
}

/// Heading and pitch of a body, its roll taken as zero, whose antennas on the line `line_body` have
/// the baseline `line` with this covariance; `None` for a vertical one.
fn direction(
    line: Vector<Ned>,
    covariance_m2: &Matrix3<f64>,
    line_body: Vector<Body>,
) -> Option<AttitudeEstimate> {
    let (unit, length) = (line.direction().xyz(), line.norm());
    // ∂u = (I − u uᵀ) ∂line / ‖line‖
    let across = (Matrix3::identity() - unit * unit.transpose()) / length;
    let covariance_rad2 = across * covariance_m2 * across;
    AttitudeEstimate::of_axis(&line_body.direction(), &Vector::from_xyz(unit), &covariance_rad2)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frames::Attitude;
    use nalgebra::Vector3;
    use proptest::prelude::*;

    proptest! {
        /// Whatever the line's direction on the body: without roll, the angles come back, and their
        /// variances are those of differences.
        #[test]
        fn direction_gives_the_angles_back(
            heading in 0.1..6.2f64, pitch in -0.4..0.4f64,
            y in -0.5..0.5f64, z in -0.3..0.3f64,
        ) {
            let line_body = Vector::<Body>::new(1.0, y, z);
            let turn = Attitude { heading_rad: heading, pitch_rad: pitch, roll_rad: 0.0 };
            let line = turn.ned_from_body() * line_body;
            let covariance = Matrix3::from_diagonal(&Vector3::new(1e-6, 2e-6, 3e-6));
            let found = direction(line, &covariance, line_body).unwrap();
            prop_assert!((found.heading_rad.unwrap() - heading).abs() < 1e-9);
            prop_assert!((found.pitch_rad.unwrap() - pitch).abs() < 1e-9);

            let mut expected = Matrix3::<f64>::zeros();
            for axis in 0..3 {
                let mut moved = line.xyz();
                moved[axis] += 1e-5;
                let ahead = direction(Vector::from_xyz(moved), &covariance, line_body).unwrap();
                let row = Vector3::new(
                    ahead.heading_rad.unwrap() - heading, ahead.pitch_rad.unwrap() - pitch, 0.0,
                ) / 1e-5;
                expected += row * row.transpose() * covariance[(axis, axis)];
            }
            let error = (found.covariance_rad2 - expected).norm() / expected.norm();
            prop_assert!(error < 1e-3, "{error}");
        }
    }

    #[test]
    fn a_line_across_the_body_gives_heading_only() {
        let right = Vector::<Body>::new(0.0, 1.0, 0.0);
        let east = Vector::<Ned>::new(0.0, 1.0, 0.05);
        let found = direction(east, &Matrix3::identity(), right).unwrap();
        assert!(found.heading_rad.unwrap().abs() < 1e-12, "a body that points north");
        assert_eq!(found.pitch_rad, None);
        let up = Vector::<Ned>::new(0.0, 0.0, -1.0);
        assert_eq!(direction(up, &Matrix3::identity(), right), None);
    }
}
