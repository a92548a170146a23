//! Attitude and position together from the coordinates of the antennas.
//!
//! Antenna `i` is measured at `yᵢ = t + Q pᵢ + noise` with information `Wᵢ = Σᵢ⁻¹`. The position `t`
//! is eliminated, which takes the weighted mean of antennas out and singles out none of them:
//!
//! ```text
//! G = Σ pᵢpᵢᵀ ⊗ Wᵢ − K W⁻¹ Kᵀ,   h = Σ pᵢ ⊗ Wᵢyᵢ − K W⁻¹ Σ Wᵢyᵢ,   K = Σ pᵢ ⊗ Wᵢ,  W = Σ Wᵢ
//! ```
//!
//! With weights that are numbers it is Wahba's problem on weighted centroids and has a closed form.

use nalgebra::{Matrix3, SMatrix, Vector3};

use super::AttitudeError;
use super::small::outer;
use super::wahba;
use super::weighted::{AttitudeProblem, Matrix9, Minimum, matrix_of, tangent_of, vec_of};
use crate::frames::skew;

/// A body laid onto measured points: `yᵢ ≈ t + Q pᵢ`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RigidFit {
    /// `Q`: outside frame from body frame.
    pub rotation: Matrix3<f64>,
    /// `t`: the body origin in the outside frame, m.
    pub origin_m: Vector3<f64>,
    /// `√(Σ wᵢ ‖yᵢ − t − Q pᵢ‖² / Σ wᵢ)`.
    pub residual_rms_m: f64,
}

/// The fit with weights `wᵢ` that are numbers: Wahba's closed form about the weighted centroids.
///
/// # Errors
///
/// As [`super::wahba::solve`]: collinear points among them.
pub fn fit(
    body_m: &[Vector3<f64>],
    measured_m: &[Vector3<f64>],
    weights: &[f64],
) -> Result<RigidFit, AttitudeError> {
    let total: f64 = weights.iter().sum();
    let centroid = |points: &[Vector3<f64>]| -> Vector3<f64> {
        let first = points.first().copied().unwrap_or_default();
        let mean: Vector3<f64> =
            points.iter().zip(weights).map(|(point, w)| *w * (point - first)).sum();
        first + mean / total
    };
    let (body_centre, measured_centre) = (centroid(body_m), centroid(measured_m));
    let body: Vec<_> = body_m.iter().map(|p| p - body_centre).collect();
    let measured: Vec<_> = measured_m.iter().map(|y| y - measured_centre).collect();
    let rotation = wahba::solve(&body, &measured, weights)?;
    let squares: f64 = body
        .iter()
        .zip(&measured)
        .zip(weights)
        .map(|((p, y), w)| w * (y - rotation * p).norm_squared())
        .sum();
    Ok(RigidFit {
        rotation,
        origin_m: measured_centre - rotation * body_centre,
        residual_rms_m: (squares / total).sqrt(),
    })
}

/// One antenna: where it is on the body and where it was measured.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MeasuredPoint {
    /// `pᵢ`, body axes, m.
    pub body_m: Vector3<f64>,
    /// `yᵢ`, outside frame, m. Take a nearby origin: Earth-centred numbers cost digits.
    pub measured_m: Vector3<f64>,
    /// `Wᵢ`: inverse of the covariance of `yᵢ`, per m².
    pub information: Matrix3<f64>,
}

/// Coordinates of antennas with the position eliminated.
#[derive(Debug, Clone, PartialEq)]
pub struct CoordinateNormal {
    /// The attitude that remains to be found.
    pub problem: AttitudeProblem,
    total_inverse: Matrix3<f64>,
    weighted_sum: Vector3<f64>,
    join: SMatrix<f64, 9, 3>,
}

impl CoordinateNormal {
    /// Eliminates the position.
    ///
    /// # Errors
    ///
    /// Fewer than two points, numbers that are not finite, informations whose sum is not positive
    /// definite.
    pub fn new(points: &[MeasuredPoint]) -> Result<Self, AttitudeError> {
        if points.len() < 2 {
            return Err(AttitudeError::TooFewVectors { found: points.len() });
        }
        let mut join = SMatrix::<f64, 9, 3>::zeros();
        let (mut total, mut weighted_sum) = (Matrix3::zeros(), Vector3::zeros());
        for MeasuredPoint { body_m: p, measured_m: y, information: w } in points {
            total += w;
            weighted_sum += w * y;
            for a in 0..3 {
                let mut block = join.fixed_view_mut::<3, 3>(3 * a, 0);
                block += w * p[a];
            }
        }
        let what = "information of the points";
        if total.iter().chain(weighted_sum.iter()).any(|c| !c.is_finite()) {
            return Err(AttitudeError::NotFinite { what });
        }
        let total_inverse = total.cholesky().ok_or(AttitudeError::Indefinite { what })?.inverse();
        let problem = if points.iter().all(|point| point.information == points[0].information) {
            separable(points)
        } else {
            general(points, &join, &total_inverse, &weighted_sum)
        };
        Ok(Self { problem, total_inverse, weighted_sum, join })
    }

    /// Position of the body origin at the attitude `Q`, m: `t = W⁻¹ (Σ Wᵢyᵢ − Kᵀ q)`.
    #[must_use]
    pub fn origin_m(&self, rotation: &Matrix3<f64>) -> Vector3<f64> {
        self.total_inverse * (self.weighted_sum - self.join.transpose() * vec_of(rotation))
    }

    /// Covariance of the point `b` of the body, `t + Q b`, m²: the noise of the position, `W⁻¹`, and
    /// that of the attitude, `D P Dᵀ` with `D = ∂t/∂θ − Q [b]×`.
    ///
    /// # Errors
    ///
    /// [`AttitudeError::Unobservable`].
    pub fn point_covariance_m2(
        &self,
        minimum: &Minimum,
        body_m: &Vector3<f64>,
    ) -> Result<Matrix3<f64>, AttitudeError> {
        let origin = -self.total_inverse * self.join.transpose() * tangent_of(&minimum.rotation);
        let by_turn = origin - minimum.rotation * skew(body_m);
        Ok(self.total_inverse + by_turn * minimum.covariance()? * by_turn.transpose())
    }
}

/// Equal informations `W`: `G = R ⊗ W` with the spread `R` about the centroid.
fn separable(points: &[MeasuredPoint]) -> AttitudeProblem {
    let count = points.len() as f64;
    let body_centre = points.iter().map(|point| point.body_m).sum::<Vector3<f64>>() / count;
    let measured_centre = points.iter().map(|point| point.measured_m).sum::<Vector3<f64>>() / count;
    let (mut spread, mut cross) = (Matrix3::zeros(), Matrix3::zeros());
    for point in points {
        let p = point.body_m - body_centre;
        spread += outer(&p, &p);
        cross += outer(&(point.measured_m - measured_centre), &p);
    }
    let normal = points[0].information;
    AttitudeProblem::Separable { normal, spread, cross: normal * cross }
}

/// `G` and `h` as in the header.
fn general(
    points: &[MeasuredPoint],
    join: &SMatrix<f64, 9, 3>,
    total_inverse: &Matrix3<f64>,
    weighted_sum: &Vector3<f64>,
) -> AttitudeProblem {
    let mut information = Box::new(Matrix9::zeros());
    let mut linear = Matrix3::zeros();
    for MeasuredPoint { body_m: p, measured_m: y, information: w } in points {
        linear += w * y * p.transpose();
        *information += (p * p.transpose()).kronecker(w);
    }
    let reduced = join * total_inverse;
    *information -= reduced * join.transpose();
    linear -= matrix_of(&(reduced * weighted_sum));
    let symmetric = 0.5 * (*information + information.transpose());
    *information = symmetric;
    AttitudeProblem::General { information, linear }
}
