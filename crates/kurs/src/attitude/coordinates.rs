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
use super::wahba::{attitude_profile, nearest_rotation};
use super::weighted::{AttitudeProblem, Matrix9, Minimum, matrix_of, vec_of};

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
    let nearest = nearest_rotation(&attitude_profile(&body, &measured, weights)?)?;
    if !nearest.is_unique() {
        return Err(AttitudeError::Unobservable);
    }
    let rotation = nearest.rotation;
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
    total: Matrix3<f64>,
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
        let mut information = Box::new(Matrix9::zeros());
        let mut linear = Matrix3::zeros();
        let mut join = SMatrix::<f64, 9, 3>::zeros();
        let (mut total, mut weighted_sum) = (Matrix3::zeros(), Vector3::zeros());
        for MeasuredPoint { body_m: p, measured_m: y, information: w } in points {
            let weighted = w * y;
            total += w;
            weighted_sum += weighted;
            linear += weighted * p.transpose();
            for a in 0..3 {
                let mut block = join.fixed_view_mut::<3, 3>(3 * a, 0);
                block += w * p[a];
                for b in a..3 {
                    let mut block = information.fixed_view_mut::<3, 3>(3 * a, 3 * b);
                    block += w * (p[a] * p[b]);
                }
            }
        }
        for (a, b) in [(0, 1), (0, 2), (1, 2)] {
            let block = information.fixed_view::<3, 3>(3 * a, 3 * b).transpose();
            information.fixed_view_mut::<3, 3>(3 * b, 3 * a).copy_from(&block);
        }
        let what = "information of the points";
        if total.iter().chain(weighted_sum.iter()).any(|c| !c.is_finite()) {
            return Err(AttitudeError::NotFinite { what });
        }
        let total_inverse = total.cholesky().ok_or(AttitudeError::Indefinite { what })?.inverse();
        let reduced = join * total_inverse;
        *information -= reduced * join.transpose();
        linear -= matrix_of(&(reduced * weighted_sum));
        let symmetric = 0.5 * (*information + information.transpose());
        *information = symmetric;
        let problem = AttitudeProblem::General { information, linear };
        Ok(Self { problem, total, total_inverse, weighted_sum, join })
    }

    /// Position of the body origin at the attitude `Q`, m: `t = W⁻¹ (Σ Wᵢyᵢ − Kᵀ q)`.
    #[must_use]
    pub fn origin_m(&self, rotation: &Matrix3<f64>) -> Vector3<f64> {
        self.total_inverse * (self.weighted_sum - self.join.transpose() * vec_of(rotation))
    }

    /// Covariance of [`CoordinateNormal::origin_m`], m²: its own noise, `W⁻¹`, and that of the
    /// attitude, `∂t/∂θ P ∂t/∂θᵀ`.
    ///
    /// # Errors
    ///
    /// [`AttitudeError::Unobservable`].
    pub fn origin_covariance_m2(&self, minimum: &Minimum) -> Result<Matrix3<f64>, AttitudeError> {
        let by_turn = -self.total_inverse
            * self.join.transpose()
            * super::weighted::tangent_of(&minimum.rotation);
        let turned = by_turn * minimum.covariance()? * by_turn.transpose();
        Ok(self.total_inverse + turned)
    }

    /// `W`: information of the position if the attitude were known, per m².
    #[must_use]
    pub fn total_information(&self) -> Matrix3<f64> {
        self.total
    }
}
