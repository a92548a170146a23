//! Is the minimum the global one, and does another attitude fit as well?
//!
//! First a certificate, which costs less than a Newton step. Turn the minimum `Q` by any `E` of
//! angle `φ` about the unit vector `n`. With `T = tr(M) I − M`, `M = Qᵀ ∂F/∂Q` (symmetric there),
//! and any symmetric `S ⪰ 0` with `G ⪰ S ⊗ I`,
//!
//! ```text
//! F(QE) − F(Q) = ½ eᵀ G e − (1 − cos φ) nᵀ T n,          e = vec(QE − Q)
//!              ≥ (1 − cos φ) nᵀ (tr(S) I − S − T) n,     as  ‖(E − I) s‖² = 2 (1 − cos φ) ‖n × s‖²
//! ```
//!
//! so `tr(S) I − S − T ⪰ μ I` proves that every attitude `φ` away costs at least `μ (1 − cos φ)`
//! more. `S = λ R` with the spread `R` of the antennas and the smallest `λ` that does.
//! Where the certificate fails, Newton's method is started all around.

use nalgebra::{Matrix3, Vector3};

use super::AttitudeError;
use super::weighted::{AttitudeProblem, Minimum};

/// Minima closer together than this are one.
const SAME_ATTITUDE_RAD: f64 = 1e-4;
/// Share of the information below which a margin is rounding.
const LEAST_MARGIN: f64 = 1e-9;

/// The global minimum, and how alone it is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GlobalMinimum {
    /// The attitude of the lowest cost.
    pub minimum: Minimum,
    /// What is known of the others.
    pub uniqueness: Uniqueness,
}

/// What is known of attitudes away from the minimum.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Uniqueness {
    /// Proven: every attitude an angle `φ` away costs at least `margin · (1 − cos φ)` more.
    Certified {
        /// The factor.
        margin: f64,
    },
    /// The next local minimum.
    SecondMinimum {
        /// Its rotation.
        rotation: Matrix3<f64>,
        /// How much more it costs: half a difference of χ² when the weights are true; ≥ 0.
        cost_gap: f64,
    },
    /// A search all around found no other local minimum.
    OnlyMinimum,
}

impl Uniqueness {
    /// Whether another minimum costs less than `cost_gap` more, so that the attitude is open.
    #[must_use]
    pub fn is_ambiguous(&self, cost_gap: f64) -> bool {
        matches!(self, Self::SecondMinimum { cost_gap: found, .. } if *found < cost_gap)
    }
}

impl AttitudeProblem {
    /// The attitude of the lowest cost: Newton's method from Wahba's solution, then the certificate
    /// with the wanted `margin`, and where it fails the search.
    ///
    /// # Errors
    ///
    /// As [`AttitudeProblem::minimum`].
    pub fn global_minimum(&self, margin: f64) -> Result<GlobalMinimum, AttitudeError> {
        let minimum = self.minimum()?;
        let margin = margin.max(LEAST_MARGIN * minimum.information.trace());
        if self.is_certified(&minimum, margin) {
            return Ok(GlobalMinimum { minimum, uniqueness: Uniqueness::Certified { margin } });
        }
        Ok(self.search(minimum))
    }

    /// Whether it is proven that every attitude `φ` away from this minimum costs at least
    /// `margin · (1 − cos φ)` more.
    #[must_use]
    pub fn is_certified(&self, minimum: &Minimum, margin: f64) -> bool {
        let spread = self.spread();
        // J = tr(R) I − R;  the smallest λ with λ J ⪰ T + μ I
        let j = spread.trace() * Matrix3::identity() - spread;
        let curvature = self.curvature(&minimum.rotation) + margin * Matrix3::identity();
        let Some(cholesky) = j.cholesky() else { return false };
        let Some(inverse) = cholesky.l().try_inverse() else { return false };
        let lambda = (inverse * curvature * inverse.transpose()).symmetric_eigenvalues().max();
        lambda <= 0.0 || self.exceeds(lambda, &spread)
    }

    /// The lowest two local minima found by Newton's method from all around `minimum`.
    #[must_use]
    pub fn search(&self, minimum: Minimum) -> GlobalMinimum {
        let mut lowest = minimum;
        let mut others: Vec<Minimum> = Vec::new();
        for start in self.starts_around(&minimum.rotation) {
            let Ok(found) = self.minimum_from(start) else { continue };
            if angle_between(&found.rotation, &lowest.rotation) < SAME_ATTITUDE_RAD {
                continue;
            }
            if found.cost < lowest.cost {
                others.push(lowest);
                lowest = found;
            } else {
                others.push(found);
            }
        }
        let second = others
            .iter()
            .filter(|other| angle_between(&other.rotation, &lowest.rotation) >= SAME_ATTITUDE_RAD)
            .min_by(|a, b| a.cost.total_cmp(&b.cost));
        let uniqueness = second.map_or(Uniqueness::OnlyMinimum, |second| {
            let cost_gap = (second.cost - lowest.cost).max(0.0);
            Uniqueness::SecondMinimum { rotation: second.rotation, cost_gap }
        });
        GlobalMinimum { minimum: lowest, uniqueness }
    }

    /// The 23 turns of a cube with its axes along those of the array, and the mirror image that
    /// flat arrays leave open under satellites on a cone (Necker's reversal).
    fn starts_around(&self, rotation: &Matrix3<f64>) -> impl Iterator<Item = Matrix3<f64>> {
        let rotation = *rotation;
        let body = self.spread().symmetric_eigen();
        let outside = self.normal().symmetric_eigen();
        // (I − 2 m mᵀ) Q (I − 2 n nᵀ): through the planes of the satellites and of the antennas
        let mirror = |axis: Vector3<f64>| Matrix3::identity() - 2.0 * axis * axis.transpose();
        let m = outside.eigenvectors.column(outside.eigenvalues.imin()).into_owned();
        let n = body.eigenvectors.column(body.eigenvalues.imin()).into_owned();
        let reversed = mirror(m) * rotation * mirror(n);
        let axes = body.eigenvectors;
        let around =
            cube_turns().skip(1).map(move |turn| rotation * axes * turn * axes.transpose());
        std::iter::once(reversed).chain(around)
    }
}

/// The 24 rotations of a cube onto itself, the identity first: permutations of the axes with signs,
/// of determinant +1.
fn cube_turns() -> impl Iterator<Item = Matrix3<f64>> {
    const ORDERS: [[usize; 3]; 6] =
        [[0, 1, 2], [1, 2, 0], [2, 0, 1], [0, 2, 1], [2, 1, 0], [1, 0, 2]];
    ORDERS.into_iter().flat_map(|order| {
        (0..8).filter_map(move |signs| {
            let sign = |bit: usize| if signs >> bit & 1 == 0 { 1.0 } else { -1.0 };
            let mut turn = Matrix3::zeros();
            for (column, row) in order.into_iter().enumerate() {
                turn[(row, column)] = sign(column);
            }
            (turn.determinant() > 0.0).then_some(turn)
        })
    })
}

/// Angle of the rotation from one attitude to the other.
#[must_use]
pub fn angle_between(a: &Matrix3<f64>, b: &Matrix3<f64>) -> f64 {
    // ‖A − B‖ = 2 √2 sin(φ/2)
    2.0 * ((a - b).norm() / 8.0_f64.sqrt()).min(1.0).asin()
}
