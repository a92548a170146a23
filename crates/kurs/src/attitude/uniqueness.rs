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
//! Where the certificate fails, Newton's method is started again: from the mirror image of the
//! minimum, which is where the next one nearly always is, or all around.

use nalgebra::Matrix3;

use super::AttitudeError;
use super::weighted::{AttitudeProblem, Minimum};

/// Minima closer together than this are one.
const SAME_ATTITUDE_RAD: f64 = 1e-4;
/// Share of the information below which a margin is rounding.
const MIN_MARGIN: f64 = 1e-9;

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
        self.cost_gap().is_some_and(|found| found < cost_gap)
    }

    /// How much more the next local minimum costs; `None` where none was found.
    #[must_use]
    pub fn cost_gap(&self) -> Option<f64> {
        match self {
            Self::SecondMinimum { cost_gap, .. } => Some(*cost_gap),
            Self::Certified { .. } | Self::OnlyMinimum => None,
        }
    }
}

impl AttitudeProblem {
    /// The minimum that Newton's method reaches from Wahba's solution or, where that one is not
    /// proven to be the lowest, from its mirror image; whichever is lower. Misses the global minimum
    /// less than once in a thousand random problems (`docs/theory/attitude.md`);
    /// [`AttitudeProblem::global_minimum`] looks all around.
    ///
    /// # Errors
    ///
    /// As [`AttitudeProblem::minimum_from_wahba`].
    pub fn minimum(&self) -> Result<Minimum, AttitudeError> {
        let found = self.minimum_from_wahba()?;
        if self.is_certified(&found, MIN_MARGIN * found.information.trace()) {
            return Ok(found);
        }
        let Ok(other) = self.minimum_from(self.mirror_image(&found.rotation)) else {
            return Ok(found);
        };
        let lower = if other.cost < found.cost { other } else { found };
        Ok(Minimum { iterations: found.iterations + other.iterations, ..lower })
    }

    /// The attitude of the lowest cost: Newton's method from Wahba's solution, then the certificate
    /// with the wanted `margin`, and where it fails the search.
    ///
    /// # Errors
    ///
    /// As [`AttitudeProblem::minimum_from_wahba`].
    pub fn global_minimum(&self, margin: f64) -> Result<GlobalMinimum, AttitudeError> {
        let minimum = self.minimum_from_wahba()?;
        let margin = margin.max(MIN_MARGIN * minimum.information.trace());
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

    /// The mirror image, and the 23 turns of a cube with its axes along those of the array.
    fn starts_around(&self, rotation: &Matrix3<f64>) -> impl Iterator<Item = Matrix3<f64>> {
        let rotation = *rotation;
        let axes = self.spread().symmetric_eigen().eigenvectors;
        let around =
            cube_turns().skip(1).map(move |turn| rotation * axes * turn * axes.transpose());
        std::iter::once(self.mirror_image(&rotation)).chain(around)
    }

    /// What flat arrays leave open under satellites on a cone (Necker's reversal), and nearly do
    /// otherwise: the attitude mirrored in the planes of the satellites and of the antennas,
    /// `(I − 2 m mᵀ) Q (I − 2 n nᵀ)`.
    fn mirror_image(&self, rotation: &Matrix3<f64>) -> Matrix3<f64> {
        let mirror = |moments: Matrix3<f64>| {
            let eigen = moments.symmetric_eigen();
            let normal = eigen.eigenvectors.column(eigen.eigenvalues.imin()).into_owned();
            Matrix3::identity() - 2.0 * normal * normal.transpose()
        };
        mirror(self.normal()) * rotation * mirror(self.spread())
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
