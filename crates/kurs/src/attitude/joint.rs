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
    let body: Vec<_> = array.baselines_m().map(|b| b.xyz()).collect();
    let measured = stacked(baselines_m);
    let weight = weight_of(covariance_m2)?;
    let global = problem(&body, &measured, &weight)?.global_minimum(cost_gap)?;

    let rotation = global.minimum.rotation;
    let residuals = residuals(baselines_m, body.iter().map(|l| rotation * l));
    Ok(ArrayAttitude {
        outside_from_body: Rotation::from_matrix(rotation),
        covariance_body_rad2: global.minimum.covariance()?,
        chi_squared: chi_squared(&residuals, &weight),
        degrees_of_freedom: measured.len() - 3,
        uniqueness: global.uniqueness,
        residuals_m: residuals,
    })
}

/// Direction of a collinear array, two antennas among them.
#[derive(Debug, Clone, PartialEq)]
pub struct ArrayDirection<To> {
    /// The line of the antennas in body axes: unit vector from antenna 0 to antenna 1.
    pub axis: Vector<Body>,
    /// The line in the outside frame, a unit vector.
    pub direction: Vector<To>,
    /// Covariance of `direction`, across it (rank two), rad².
    pub covariance_rad2: Matrix3<f64>,
    /// As for [`ArrayAttitude`].
    pub chi_squared: f64,
    /// Components measured minus two.
    pub degrees_of_freedom: usize,
    /// How much more (half of χ²) the next local minimum costs, if there is one.
    pub cost_gap: Option<f64>,
    /// Measured minus turned baseline, for antennas 1, 2, …
    pub residuals_m: Vec<Vector<To>>,
}

/// Direction from the baselines antenna 0 → 1, 2, … (m, outside frame) of a collinear array, with
/// their full covariance as for [`solve`]. [`super::line`] turns it into heading and pitch.
///
/// # Errors
///
/// As [`solve`]; antennas off the line are not noticed here but in `chi_squared`.
pub fn solve_direction<To: Copy>(
    array: &AntennaArray,
    baselines_m: &[Vector<To>],
    covariance_m2: &DMatrix<f64>,
) -> Result<ArrayDirection<To>, AttitudeError> {
    let body: Vec<_> = array.baselines_m().map(|b| b.xyz()).collect();
    let measured = stacked(baselines_m);
    let weight = weight_of(covariance_m2)?;
    let axis = body[0].normalize();
    let found = problem(&body, &measured, &weight)?.direction(&axis)?;

    let turned = body.iter().map(|l| found.unit * l.dot(&axis));
    let residuals = residuals(baselines_m, turned);
    Ok(ArrayDirection {
        axis: Vector::from_xyz(axis),
        direction: Vector::from_xyz(found.unit),
        covariance_rad2: found.covariance_rad2,
        chi_squared: chi_squared(&residuals, &weight),
        degrees_of_freedom: measured.len() - 2,
        cost_gap: found.cost_gap,
        residuals_m: residuals,
    })
}

/// Measured minus turned baselines.
fn residuals<To: Copy>(
    baselines_m: &[Vector<To>],
    turned: impl Iterator<Item = Vector3<f64>>,
) -> Vec<Vector<To>> {
    baselines_m.iter().zip(turned).map(|(z, l)| *z - Vector::from_xyz(l)).collect()
}

/// `rᵀ Ω r`.
fn chi_squared<To>(residuals_m: &[Vector<To>], weight: &DMatrix<f64>) -> f64 {
    let residuals = stacked(residuals_m);
    residuals.dot(&(weight * &residuals))
}

/// Components of the baselines, one after the other.
fn stacked<To>(baselines_m: &[Vector<To>]) -> DVector<f64> {
    let components: Vec<f64> = baselines_m.iter().flat_map(|b| <[f64; 3]>::from(b.xyz())).collect();
    DVector::from_vec(components)
}

/// The weight of stacked baselines: the inverse of their covariance (3k×3k, m²), per m².
///
/// # Errors
///
/// A covariance that is not square, not symmetric, or not positive definite.
pub fn weight_of(covariance_m2: &DMatrix<f64>) -> Result<DMatrix<f64>, AttitudeError> {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frames::{Attitude, Ned};
    use approx::assert_relative_eq;

    fn roof() -> AntennaArray {
        let positions = [[0.0, 0.0, 0.0], [0.766, 0.0, -0.03], [0.019, -0.491, 0.001]];
        AntennaArray::new(positions.map(|[x, y, z]| Vector::new(x, y, z)).to_vec()).unwrap()
    }

    /// `s² (I + 11ᵀ) ⊗ I`: all baselines share the noise of antenna 0.
    fn shared_noise(baselines: usize, sd_m: f64) -> DMatrix<f64> {
        let between = DMatrix::from_element(baselines, baselines, 1.0)
            + DMatrix::<f64>::identity(baselines, baselines);
        between.kronecker(&DMatrix::identity(3, 3)) * (sd_m * sd_m)
    }

    #[test]
    fn exact_baselines_give_the_attitude() {
        let truth = Attitude { heading_rad: 5.0, pitch_rad: -0.3, roll_rad: 0.2 }.ned_from_body();
        let array = roof();
        let baselines: Vec<Vector<Ned>> = (1..3).map(|i| truth * array.baseline_m(i)).collect();
        let found = solve(&array, &baselines, &shared_noise(2, 0.003), 10.0).unwrap();
        assert_relative_eq!(found.outside_from_body.matrix(), truth.matrix(), epsilon = 1e-13);
        assert!(found.chi_squared < 1e-20, "{}", found.chi_squared);
        assert_eq!(found.degrees_of_freedom, 3);
        assert!(matches!(found.uniqueness, Uniqueness::Certified { .. }));
        // One metre and 3 mm on either antenna: about 0.2°.
        let sd_rad = found.covariance_body_rad2.diagonal().map(f64::sqrt);
        assert!(sd_rad.iter().all(|sd| (0.003..0.01).contains(sd)), "{sd_rad}");
    }

    #[test]
    fn two_antennas_give_a_direction() {
        let array =
            AntennaArray::new(vec![Vector::new(0.5, 0.0, 0.0), Vector::new(-1.5, 0.0, 0.0)])
                .unwrap();
        // 1 cm too long: the residual tells, the direction does not change.
        let baseline = Vector::<Ned>::new(0.0, -2.01, 0.0);
        let found = solve_direction(&array, &[baseline], &shared_noise(1, 0.003)).unwrap();
        assert_relative_eq!(found.axis.xyz(), -Vector3::x());
        assert_relative_eq!(found.direction.xyz(), -Vector3::y(), epsilon = 1e-15);
        assert_relative_eq!(
            found.residuals_m[0].xyz(),
            Vector3::new(0.0, -0.01, 0.0),
            epsilon = 1e-14
        );
        // Two antennas 2 m apart with 3 mm each: 3 mm √2 / 2 m, in the measured length.
        let expected = 2.0 * 0.003 * 0.003 / (2.0 * 2.0);
        assert_relative_eq!(found.covariance_rad2[(0, 0)], expected, max_relative = 0.01);
        assert_relative_eq!(found.covariance_rad2[(1, 1)], 0.0, epsilon = 1e-20);
        let refused = solve(&array, &[baseline], &shared_noise(1, 0.003), 10.0);
        assert_eq!(refused.unwrap_err(), AttitudeError::Unobservable);
    }

    /// Six coordinates, two of which the direction takes.
    #[test]
    fn a_bent_line_shows_in_the_misfit() {
        let places = [0.0, 1.0, 2.0].map(|x| Vector::new(x, 0.0, 0.0));
        let array = AntennaArray::new(places.to_vec()).unwrap();
        let solved = |across_m: f64| {
            let baselines = [Vector::<Ned>::new(1.0, 0.0, 0.0), Vector::new(2.0, 0.0, across_m)];
            solve_direction(&array, &baselines, &shared_noise(2, 0.003)).unwrap()
        };
        let (straight, bent) = (solved(0.0), solved(0.01));
        assert_eq!((straight.degrees_of_freedom, bent.degrees_of_freedom), (4, 4));
        assert!(straight.chi_squared < 1e-20, "{}", straight.chi_squared);
        // The second difference x₀ − 2 x₁ + x₂ of three antennas of 3 mm: 10² / (6 · 3²)
        assert_relative_eq!(bent.chi_squared, 100.0 / 54.0, max_relative = 1e-3);
    }

    #[test]
    fn wrong_covariances_are_refused() {
        let array = roof();
        let baselines = [Vector::<Ned>::new(1.0, 0.0, 0.0), Vector::new(0.0, 1.0, 0.0)];
        let refusal =
            |covariance: &DMatrix<f64>| solve(&array, &baselines, covariance, 10.0).unwrap_err();
        let mut lopsided = shared_noise(2, 0.003);
        lopsided[(0, 1)] = 1e-6;
        assert!(matches!(refusal(&lopsided), AttitudeError::NotSymmetric { .. }));
        assert!(matches!(refusal(&-shared_noise(2, 0.003)), AttitudeError::Indefinite { .. }));
        assert!(matches!(refusal(&shared_noise(3, 0.003)), AttitudeError::Shape { .. }));
        let nan = shared_noise(2, f64::NAN);
        assert!(matches!(refusal(&nan), AttitudeError::NotFinite { .. }));
    }
}
