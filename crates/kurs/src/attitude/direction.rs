//! Antennas on one line: only the direction of the line is observable, two angles.
//!
//! With all antennas along the body axis `e`, `Q l = s Q e = s u`: the cost depends on the unit
//! vector `u` alone,
//!
//! ```text
//! F = ½ uᵀ A u − cᵀ u → min over ‖u‖ = 1,     A = Σ eₐ e_b G_ab,  c = mat(h) e
//! (A + λ I) u = c,     Σ cᵢ² / (aᵢ + λ)² = 1 with λ ≥ −a₁       (secular equation)
//! ```
//!
//! in the eigenvectors of `A` with eigenvalues `a₁ ≤ a₂ ≤ a₃`. The root right of `−a₁` is the global
//! minimum; at most one more local minimum exists, the root next to the left of it (Martínez 1994).

use nalgebra::{Matrix3, Matrix3x2, SymmetricEigen, Vector3};

use super::AttitudeError;
use super::weighted::AttitudeProblem;

/// Halvings of an interval: more than the bits of a double.
const HALVINGS: usize = 80;
/// Share of the larger tangential information below which the smaller counts as zero.
const SINGULAR_RATIO: f64 = 1e-12;

/// The direction of a line of antennas in the outside frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LineDirection {
    /// `u = Q e`, a unit vector.
    pub unit: Vector3<f64>,
    /// `F(u)`.
    pub cost: f64,
    /// Covariance of `u`, across `u` (rank two), rad².
    pub covariance_rad2: Matrix3<f64>,
    /// How much more the next local minimum costs, if there is one; ≥ 0.
    pub cost_gap: Option<f64>,
}

impl LineDirection {
    /// Standard deviation to the side where it is least certain, rad.
    #[must_use]
    pub fn max_sd_rad(&self) -> f64 {
        self.covariance_rad2.symmetric_eigenvalues().max().max(0.0).sqrt()
    }
}

impl AttitudeProblem {
    /// Where the body axis `axis` (a unit vector along the line of the antennas) points.
    ///
    /// # Errors
    ///
    /// Input errors as for [`AttitudeProblem::minimum`], an axis that is not a unit vector, and
    /// [`AttitudeError::Unobservable`] if the satellites do not determine the direction.
    pub fn direction(&self, axis: &Vector3<f64>) -> Result<LineDirection, AttitudeError> {
        let norm = axis.norm();
        if norm.is_nan() || (norm - 1.0).abs() > 1e-6 {
            return Err(AttitudeError::NotPositive {
                what: "length of the body axis",
                value: norm,
            });
        }
        self.check_numbers()?;
        let (information, linear) = self.along(axis);
        minimum_on_sphere(&information, &linear)
    }

    /// `A` and `c` for antennas along `axis`.
    fn along(&self, axis: &Vector3<f64>) -> (Matrix3<f64>, Vector3<f64>) {
        match self {
            Self::Separable { normal, spread, cross } => {
                (normal * axis.dot(&(spread * axis)), cross * axis)
            }
            Self::General { information, linear } => {
                let mut along = Matrix3::zeros();
                for a in 0..3 {
                    for b in 0..3 {
                        along += information.fixed_view::<3, 3>(3 * a, 3 * b) * (axis[a] * axis[b]);
                    }
                }
                (along, linear * axis)
            }
        }
    }
}

/// The minimum of `½ uᵀ A u − cᵀ u` over unit vectors `u`, for a symmetric `A ⪰ 0`.
///
/// # Errors
///
/// [`AttitudeError::Unobservable`] if `u` is not determined, `c = 0` among it.
pub fn minimum_on_sphere(
    information: &Matrix3<f64>,
    linear: &Vector3<f64>,
) -> Result<LineDirection, AttitudeError> {
    if information.iter().chain(linear.iter()).any(|c| !c.is_finite()) {
        return Err(AttitudeError::NotFinite { what: "problem" });
    }
    if linear.norm() == 0.0 {
        return Err(AttitudeError::Unobservable);
    }
    let secular = Secular::new(information, linear);
    let unit = secular.unit_vector(secular.right_root());
    let cost = |u: &Vector3<f64>| 0.5 * u.dot(&(information * u)) - linear.dot(u);
    let second = secular.mirrored().or_else(|| secular.left_root().map(|m| secular.unit_vector(m)));
    Ok(LineDirection {
        unit,
        cost: cost(&unit),
        covariance_rad2: tangential_inverse(information, &unit)?,
        cost_gap: second.map(|other| (cost(&other) - cost(&unit)).max(0.0)),
    })
}

/// The secular equation in `μ = λ + a₁`: `Σ cᵢ² / (gᵢ + μ)² = 1` with the gaps `gᵢ = aᵢ − a₁`.
struct Secular {
    axes: Matrix3<f64>,
    gaps: Vector3<f64>,
    components: Vector3<f64>,
}

impl Secular {
    fn new(information: &Matrix3<f64>, linear: &Vector3<f64>) -> Self {
        let SymmetricEigen { eigenvalues, eigenvectors } = information.symmetric_eigen();
        let mut order = [0, 1, 2];
        order.sort_by(|i, j| eigenvalues[*i].total_cmp(&eigenvalues[*j]));
        let axes = Matrix3::from_columns(&order.map(|i| eigenvectors.column(i)));
        let gaps = Vector3::from(order.map(|i| eigenvalues[i] - eigenvalues[order[0]]));
        Self { axes, gaps, components: axes.transpose() * linear }
    }

    /// `Σ cᵢ² / (gᵢ + μ)² − 1`.
    fn value(&self, mu: f64) -> f64 {
        let terms = self.components.zip_map(&self.gaps, |c, gap| term(c, gap + mu).powi(2));
        terms.sum() - 1.0
    }

    /// The root with `μ ≥ 0`, between `|c₁|` and `‖c‖`; 0 in the hard case, where `c₁ = 0`.
    fn right_root(&self) -> f64 {
        let (mut low, mut high) = (self.components[0].abs(), self.components.norm());
        if self.value(low) <= 0.0 {
            return low;
        }
        for _ in 0..HALVINGS {
            let newton = self.newton_step(low);
            let middle = 0.5 * (low + high);
            let next = if newton > low && newton < high { newton } else { middle };
            if next <= low || next - low <= f64::EPSILON * next {
                return next;
            }
            if self.value(next) > 0.0 {
                low = next
            } else {
                high = next
            }
            if high - low <= f64::EPSILON * high {
                return high;
            }
            // From the right Newton's step would overshoot: keep the left end moving.
            if high == next {
                let middle = 0.5 * (low + high);
                if self.value(middle) > 0.0 { low = middle } else { high = middle }
            }
        }
        0.5 * (low + high)
    }

    /// Newton's step from `mu` on `1/√Σ − 1`, which is nearly straight there.
    fn newton_step(&self, mu: f64) -> f64 {
        let (mut sum, mut slope) = (0.0, 0.0);
        for (c, gap) in self.components.iter().zip(self.gaps.iter()) {
            let square = term(*c, gap + mu).powi(2);
            sum += square;
            slope += square / (gap + mu);
        }
        mu + (sum.sqrt() - 1.0) * sum / slope
    }

    /// The root with `−g₂ < μ < 0` where the sum rises to the right: the other local minimum.
    fn left_root(&self) -> Option<f64> {
        let slope = |mu: f64| {
            let terms = self
                .components
                .zip_map(&self.gaps, |c, gap| -term(c, gap + mu).powi(2) / (gap + mu));
            terms.sum()
        };
        let (mut low, mut high) = (-self.gaps[1], 0.0);
        for _ in 0..HALVINGS {
            let middle = 0.5 * (low + high);
            if slope(middle) < 0.0 { low = middle } else { high = middle }
        }
        let lowest = 0.5 * (low + high);
        if lowest >= 0.0 || self.value(lowest) >= 0.0 {
            return None;
        }
        let (mut low, mut high) = (lowest, 0.0);
        for _ in 0..HALVINGS {
            let middle = 0.5 * (low + high);
            if self.value(middle) < 0.0 { low = middle } else { high = middle }
        }
        Some(low)
    }

    /// `uᵢ = cᵢ / (gᵢ + μ)`; the component along `a₁` fills up to unit length where `c₁` is nothing.
    fn unit_vector(&self, mu: f64) -> Vector3<f64> {
        let mut u = self.components.zip_map(&self.gaps, |c, gap| term(c, gap + mu));
        let rest = 1.0 - u[1] * u[1] - u[2] * u[2];
        if rest > u[0] * u[0] && mu.abs() <= f64::EPSILON * self.gaps[2] {
            u[0] = rest.sqrt();
        }
        (self.axes * u).normalize()
    }

    /// The equal minimum of the hard case: the mirror image along the weakest axis.
    fn mirrored(&self) -> Option<Vector3<f64>> {
        let is_hard = self.components[0].abs() <= f64::EPSILON * self.components.norm();
        if !is_hard || self.value(self.components[0].abs()) > 0.0 {
            return None;
        }
        let unit = self.unit_vector(self.right_root());
        let weakest = self.axes.column(0);
        Some(unit - weakest * (2.0 * weakest.dot(&unit)))
    }
}

/// `c / d`, and nothing where `c` is nothing.
fn term(c: f64, d: f64) -> f64 {
    if c == 0.0 { 0.0 } else { c / d }
}

/// Inverse of `A` on the tangent plane at `u`: `B (Bᵀ A B)⁻¹ Bᵀ`.
fn tangential_inverse(
    information: &Matrix3<f64>,
    unit: &Vector3<f64>,
) -> Result<Matrix3<f64>, AttitudeError> {
    let tangent = tangent_plane(unit);
    let inner = tangent.transpose() * information * tangent;
    let (trace, determinant) = (inner.trace(), inner.determinant());
    if determinant.is_nan() || determinant <= SINGULAR_RATIO * trace * trace {
        return Err(AttitudeError::Unobservable);
    }
    let inverse = inner.try_inverse().ok_or(AttitudeError::Unobservable)?;
    Ok(tangent * inverse * tangent.transpose())
}

/// Two unit vectors across `unit` and each other.
pub(super) fn tangent_plane(unit: &Vector3<f64>) -> Matrix3x2<f64> {
    let mut aside = Vector3::zeros();
    aside[unit.iamin()] = 1.0;
    let first = unit.cross(&aside).normalize();
    Matrix3x2::from_columns(&[first, unit.cross(&first)])
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn cost(a: &Matrix3<f64>, c: &Vector3<f64>, u: &Vector3<f64>) -> f64 {
        0.5 * u.dot(&(a * u)) - c.dot(u)
    }

    /// 20 000 points spread evenly over the sphere (Fibonacci's spiral).
    fn lowest_on_a_lattice(a: &Matrix3<f64>, c: &Vector3<f64>) -> f64 {
        let points = (0..20_000).map(|i| {
            let z = 1.0 - (2.0 * f64::from(i) + 1.0) / 20_000.0;
            let (s, r) = (2.399_963_229_728_653 * f64::from(i), (1.0 - z * z).sqrt());
            Vector3::new(r * s.cos(), r * s.sin(), z)
        });
        points.map(|u| cost(a, c, &u)).fold(f64::INFINITY, f64::min)
    }

    proptest! {
        #[test]
        fn no_direction_is_better(
            f in proptest::array::uniform9(-1.0..1.0f64), c in proptest::array::uniform3(-1.0..1.0f64),
        ) {
            let factor = Matrix3::from_row_slice(&f);
            let (a, c) = (factor * factor.transpose(), Vector3::from(c));
            let found = minimum_on_sphere(&a, &c);
            prop_assume!(found.is_ok());
            let found = found.unwrap();
            prop_assert!((found.unit.norm() - 1.0).abs() < 1e-15);
            prop_assert!((found.cost - cost(&a, &c, &found.unit)).abs() < 1e-14);
            // Stationary: the gradient is along u.
            let gradient = a * found.unit - c;
            prop_assert!(gradient.cross(&found.unit).norm() < 1e-12);
            let lattice = lowest_on_a_lattice(&a, &c);
            prop_assert!(found.cost <= lattice + 1e-12);
            prop_assert!(lattice - found.cost < 1e-2);
        }
    }

    /// One axis alone is a straight line, which a step solves; of three it leaves a fifth of the way at most.
    #[test]
    fn newton_s_step_comes_near_the_root() {
        let information = Matrix3::from_diagonal(&Vector3::new(1.0, 2.0, 4.0));
        let alone = Secular::new(&information, &Vector3::new(0.5, 0.0, 0.0));
        assert!((alone.newton_step(0.2) - 0.5).abs() < 1e-15);
        let secular = Secular::new(&information, &Vector3::new(0.5, 1.0, 2.0));
        let root = secular.right_root();
        assert!(secular.value(root).abs() < 1e-14, "{root}");
        for begin in [0.5, 0.6, 0.7] {
            let next = secular.newton_step(begin);
            assert!((root - next).abs() < 0.2 * (root - begin), "{begin}: {next} of {root}");
        }
    }

    /// Nothing known along the weakest axis: up and down are equal and both are told.
    #[test]
    fn hard_case_has_two_equal_minima() {
        let a = Matrix3::from_diagonal(&Vector3::new(4.0, 9.0, 1.0));
        let found = minimum_on_sphere(&a, &Vector3::new(1.5, 4.0, 0.0)).unwrap();
        let expected = Vector3::new(0.5, 0.5, 0.5_f64.sqrt());
        assert!((found.unit.abs() - expected).norm() < 1e-15, "{found:?}");
        assert_eq!(found.cost_gap, Some(0.0));
    }

    #[test]
    fn next_minimum_is_the_lattice_s() {
        // Slightly favoured upwards: the other minimum is the mirror image, which costs 2·0.1·u_z more or so.
        let a = Matrix3::from_diagonal(&Vector3::new(4.0, 9.0, 1.0));
        let found = minimum_on_sphere(&a, &Vector3::new(1.5, 4.0, 0.01)).unwrap();
        let gap = found.cost_gap.unwrap();
        assert!(found.unit.z > 0.7 && (gap - 0.02 * found.unit.z).abs() < 1e-4, "{found:?}");
    }

    #[test]
    fn open_directions_are_refused() {
        let c = Vector3::new(1.0, 0.0, 0.0);
        let flat = Matrix3::from_diagonal(&Vector3::new(0.0, 1.0, 0.0));
        assert_eq!(minimum_on_sphere(&flat, &c), Err(AttitudeError::Unobservable));
        let zero = minimum_on_sphere(&Matrix3::identity(), &Vector3::zeros());
        assert_eq!(zero, Err(AttitudeError::Unobservable));
        let nan = minimum_on_sphere(&Matrix3::identity(), &Vector3::repeat(f64::NAN));
        assert!(matches!(nan, Err(AttitudeError::NotFinite { .. })));
    }
}
