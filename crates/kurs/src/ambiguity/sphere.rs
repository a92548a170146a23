//! The point nearest to a given one, in the metric of a covariance, when its length is known.
//!
//! ```text
//! c(b̌) = min over b of  (b̌ − b)ᵀ Q⁻¹ (b̌ − b) + (|b| − l)² / σ²
//! ```
//!
//! With `r = |b|` and a multiplier `μ` for `|b|² = r²` the minimum over `b` and `r` is, in the
//! eigenbasis of `Q` (variances `qᵢ`, components `uᵢ` of `b̌`),
//!
//! ```text
//! g(μ) = μ (Σ uᵢ² / (1 + μ qᵢ) − l² / (1 − μ σ²)),    −1/q_max <= μ < 1/σ²
//! ```
//!
//! Each `g(μ)` is a lower bound of `c`, and the largest is equal to it: `g` is concave, and where
//! its slope vanishes `bᵢ = uᵢ / (1 + μ qᵢ)` has the length `r = l / (1 − μ σ²)` (Moré & Sorensen
//! 1983, *Computing a trust region step*; the length there is hard, `σ = 0`).

use nalgebra::{Matrix3, Vector3};

use super::AmbiguityError;

/// Newton steps on the secular equation; they converge from one side, in three to six steps.
const MAX_STEPS: usize = 40;
/// Relative size of a step after which the equation is solved to rounding.
const SMALL_STEP: f64 = 1e-13;

/// A length known to a standard deviation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Length {
    /// `l > 0`, metres.
    pub length_m: f64,
    /// `σ >= 0`, metres; zero for an exact length.
    pub sd_m: f64,
}

impl Length {
    /// Checks that both numbers make sense.
    pub(super) fn check(&self) -> Result<(), AmbiguityError> {
        if !(self.length_m > 0.0 && self.length_m.is_finite()) {
            return Err(AmbiguityError::OutOfRange { what: "the length", value: self.length_m });
        }
        if !(self.sd_m >= 0.0 && self.sd_m.is_finite()) {
            let what = "the standard deviation of the length";
            return Err(AmbiguityError::OutOfRange { what, value: self.sd_m });
        }
        Ok(())
    }
}

/// The sphere seen in the metric of a covariance: one eigenvalue problem for any number of points.
#[derive(Debug, Clone, PartialEq)]
pub struct SphereMetric {
    /// Rows: the principal axes of `Q`, largest variance first.
    axes: Matrix3<f64>,
    /// `qᵢ`, falling, m².
    variances_m2: Vector3<f64>,
    length_m: f64,
    length_variance_m2: f64,
}

/// A multiplier for one point, near or at the root of the secular equation.
struct Multiplier {
    /// Components of the point along the principal axes, m.
    components_m: Vector3<f64>,
    /// `1 + μ qᵢ`.
    stretches: Vector3<f64>,
    /// `μ`, 1/m².
    mu: f64,
    /// `1 − μ σ²`.
    length_stretch: f64,
}

impl SphereMetric {
    /// Prepares the sphere of `length` for points of `covariance_m2`.
    ///
    /// # Errors
    ///
    /// [`AmbiguityError::NotPositiveDefinite`], and `OutOfRange` for an impossible length.
    pub fn new(covariance_m2: &Matrix3<f64>, length: Length) -> Result<Self, AmbiguityError> {
        length.check()?;
        let eigen = covariance_m2.symmetric_eigen();
        let mut order = [0, 1, 2];
        order.sort_by(|&i, &j| eigen.eigenvalues[j].total_cmp(&eigen.eigenvalues[i]));
        let variances_m2 = Vector3::from_fn(|i, _| eigen.eigenvalues[order[i]]);
        for (index, &variance) in variances_m2.iter().enumerate() {
            if !(variance > 0.0 && variance.is_finite()) {
                return Err(AmbiguityError::NotPositiveDefinite { index, variance });
            }
        }
        let axes = Matrix3::from_fn(|i, j| eigen.eigenvectors[(j, order[i])]);
        Ok(Self {
            axes,
            variances_m2,
            length_m: length.length_m,
            length_variance_m2: length.sd_m * length.sd_m,
        })
    }

    /// `c(b̌)`, no unit.
    #[must_use]
    pub fn cost(&self, point_m: &Vector3<f64>) -> f64 {
        self.cost_and_multiplier(point_m).0
    }

    /// `c(b̌)` and the multiplier `μ` at which it was found.
    pub(super) fn cost_and_multiplier(&self, point_m: &Vector3<f64>) -> (f64, f64) {
        let found = self.multiplier(point_m);
        (self.dual(&found), found.mu)
    }

    /// A lower bound of `c(b̌)` and its multiplier `μ`, from few steps that begin at `start_mu`:
    /// the multiplier of a neighbouring point in a metric that is not narrower.
    pub(super) fn lower_bound(&self, point_m: &Vector3<f64>, start_mu: f64) -> (f64, f64) {
        const FEW: usize = 2;
        let found = self.improved(self.axes * point_m, start_mu + 1.0 / self.variances_m2[0], FEW);
        (self.dual(&found), found.mu)
    }

    /// `g(μ)`.
    fn dual(&self, at: &Multiplier) -> f64 {
        let mut squares = 0.0;
        for i in 0..3 {
            if at.components_m[i] != 0.0 {
                squares += at.components_m[i].powi(2) / at.stretches[i];
            }
        }
        (at.mu * (squares - self.length_m.powi(2) / at.length_stretch)).max(0.0)
    }

    /// The minimiser `b`, m; one of two if the point lies in the plane of symmetry between them.
    #[must_use]
    pub fn nearest(&self, point_m: &Vector3<f64>) -> Vector3<f64> {
        let found = self.multiplier(point_m);
        let radius_m = self.length_m / found.length_stretch;
        let mut along_axes = Vector3::<f64>::zeros();
        for i in (0..3).rev() {
            along_axes[i] = if found.components_m[i] != 0.0 {
                found.components_m[i] / found.stretches[i]
            } else if found.stretches[i] <= 0.0 {
                // The hard case: what is missing in length goes along the widest axis.
                (radius_m.powi(2) - along_axes.norm_squared()).max(0.0).sqrt()
            } else {
                0.0
            };
        }
        self.axes.tr_mul(&along_axes)
    }

    /// The root of the secular equation.
    fn multiplier(&self, point_m: &Vector3<f64>) -> Multiplier {
        let components_m = self.axes * point_m;
        self.improved(components_m, self.below_root(&components_m), MAX_STEPS)
    }

    /// A `δ` below the root. One component alone has `|uᵢ| / (1 + μ qᵢ) = l / (1 − μ σ²)` at
    /// `μ = (|uᵢ| − l) / (l qᵢ + |uᵢ| σ²)`; all three together are longer there.
    fn below_root(&self, u: &Vector3<f64>) -> f64 {
        let (q, l, length_variance) = (&self.variances_m2, self.length_m, self.length_variance_m2);
        let mut delta = u[0].abs() * (length_variance + q[0])
            / (q[0] * (l * q[0] + u[0].abs() * length_variance));
        for i in 1..3 {
            let alone = (u[i].abs() - l) / (l * q[i] + u[i].abs() * length_variance);
            delta = delta.max(alone + 1.0 / q[0]);
        }
        delta
    }

    /// Newton's method for `1/r(μ) = (1 − μ σ²)/l`, where `r(μ)² = Σ uᵢ² / (1 + μ qᵢ)²`.
    ///
    /// The difference of both sides is concave and grows with `μ`: every step ends below the root,
    /// and from there they stay below it. The unknown is `δ = μ + 1/q_max >= 0`, which keeps its
    /// digits next to the pole.
    fn improved(&self, u: Vector3<f64>, start: f64, max_steps: usize) -> Multiplier {
        let q = &self.variances_m2;
        let (l, length_variance) = (self.length_m, self.length_variance_m2);
        // 1 + μ qᵢ = (1 − qᵢ/q_max) + δ qᵢ,   1 − μ σ² = (1 + σ²/q_max) − δ σ²
        let at_pole = q.map(|variance| 1.0 - variance / q[0]);
        let length_at_pole = 1.0 + length_variance / q[0];
        let mut delta = start;
        for _ in 0..max_steps {
            let (mut r_squared, mut slope) = (0.0, 0.0);
            for i in 0..3 {
                if u[i] != 0.0 {
                    let stretch = at_pole[i] + delta * q[i];
                    let b = u[i] / stretch;
                    r_squared += b * b;
                    slope += b * b * q[i] / stretch;
                }
            }
            let r = r_squared.sqrt();
            // ψ = 1/r − (1 − μσ²)/l,   ψ' = Σ uᵢ² qᵢ / (1 + μqᵢ)³ / r³ + σ²/l
            let value = 1.0 / r - (length_at_pole - delta * length_variance) / l;
            let step = -value / (slope / (r_squared * r) + length_variance / l);
            // The root; or a point at the center, from where every direction is as good.
            if step.is_nan() || step.abs() <= SMALL_STEP * delta {
                break;
            }
            delta = if step > 0.0 { delta + step } else { (delta + step).max(self.below_root(&u)) };
            // The hard case: no root, the pole is the largest that there is.
            if step < 0.0 && delta == 0.0 {
                break;
            }
        }
        Multiplier {
            components_m: u,
            stretches: at_pole + q * delta,
            mu: delta - 1.0 / q[0],
            length_stretch: length_at_pole - delta * length_variance,
        }
    }
}

#[cfg(test)]
mod tests {
    use rand::RngExt;

    use super::super::problems::{normal, seeded};
    use super::*;

    fn objective(q: &Matrix3<f64>, length: Length, point: &Vector3<f64>, b: &Vector3<f64>) -> f64 {
        let e = point - b;
        let deviation = (b.norm() - length.length_m) / length.sd_m;
        e.dot(&(q.try_inverse().unwrap() * e)) + deviation * deviation
    }

    fn random_matrix(random: &mut rand_xoshiro::Xoshiro256PlusPlus) -> Matrix3<f64> {
        let root = Matrix3::from_fn(|_, _| normal(random));
        root * root.transpose() + Matrix3::identity() * 1e-2
    }

    /// The least objective over a fine grid of directions; for each the best length is known.
    fn by_grid(q: &Matrix3<f64>, length: Length, point: &Vector3<f64>) -> f64 {
        let mut best = f64::INFINITY;
        let weight = q.try_inverse().unwrap();
        let inverse_variance = length.sd_m.powi(-2);
        for i in 0..400 {
            let cosine = -1.0 + (f64::from(i) + 0.5) / 200.0;
            let sine = (1.0_f64 - cosine * cosine).sqrt();
            for j in 0..800 {
                let angle = f64::from(j) * std::f64::consts::TAU / 800.0;
                let v = Vector3::new(sine * angle.cos(), sine * angle.sin(), cosine);
                // d/dr: r (vᵀWv + 1/σ²) = vᵀWb̌ + l/σ²
                let r = (v.dot(&(weight * point)) + length.length_m * inverse_variance)
                    / (v.dot(&(weight * v)) + inverse_variance);
                if r > 0.0 {
                    best = best.min(objective(q, length, point, &(v * r)));
                }
            }
        }
        best
    }

    #[test]
    fn minimum_agrees_with_a_grid() {
        let mut random = seeded(20);
        for case in 0..60 {
            let q = random_matrix(&mut random);
            let length = Length {
                length_m: random.random_range(0.3..3.0),
                sd_m: [0.02, 0.3, 2.0][case % 3],
            };
            let point = Vector3::from_fn(|_, _| 2.0 * normal(&mut random));
            let metric = SphereMetric::new(&q, length).unwrap();
            let (cost, b) = (metric.cost(&point), metric.nearest(&point));
            let reached = objective(&q, length, &point, &b);
            assert!((cost - reached).abs() < 1e-9 * (1.0 + cost), "case {case}: {cost} {reached}");
            let grid = by_grid(&q, length, &point);
            assert!(cost <= grid * (1.0 + 1e-12), "case {case}: {cost} {grid}");
            assert!(grid < cost + 0.02 * (1.0 + cost), "case {case}: {cost} {grid}");
        }
    }

    #[test]
    fn limits_of_the_standard_deviation() {
        let mut random = seeded(21);
        for _ in 0..100 {
            let q = random_matrix(&mut random);
            let point = Vector3::from_fn(|_, _| normal(&mut random));
            let with = |sd_m| SphereMetric::new(&q, Length { length_m: 1.2, sd_m }).unwrap();
            let hard = with(0.0);
            assert!((hard.nearest(&point).norm() - 1.2).abs() < 1e-12);
            assert!((hard.cost(&point) - with(1e-9).cost(&point)).abs() < 1e-6 * hard.cost(&point));
            assert!(with(1e6).cost(&point) < 1e-10);
            assert!((with(1e6).nearest(&point) - point).norm() < 1e-5);
            let mut last = f64::INFINITY;
            for sd_m in [0.0, 1e-3, 1e-2, 0.1, 1.0, 10.0] {
                let cost = with(sd_m).cost(&point);
                assert!(cost <= last, "softer never costs more");
                last = cost;
            }
        }
    }

    #[test]
    fn the_hard_case_has_two_minima_of_one_cost() {
        let q = Matrix3::from_diagonal(&Vector3::new(4.0, 1.0, 0.5));
        for (sd_m, point) in [
            (0.0, [0.0, 0.3, 0.1]),
            (0.1, [0.0, 0.3, 0.1]),
            (0.1, [0.0; 3]),
            (0.1, [1e-30, 0.3, 0.1]),
        ] {
            let length = Length { length_m: 1.0, sd_m };
            let metric = SphereMetric::new(&q, length).unwrap();
            let point = Vector3::from(point);
            let b = metric.nearest(&point);
            // μ = −1/4: bᵢ = uᵢ / (1 − qᵢ/4), |b| = 1 / (1 + σ²/4)
            let radius = 1.0 / (1.0 + sd_m * sd_m / 4.0);
            assert!((b.norm() - radius).abs() < 1e-12, "{b}");
            assert!((b.y - point.y / 0.75).abs() < 1e-12);
            assert!((b.z - point.z / 0.875).abs() < 1e-12);
            let near = SphereMetric::new(&q, Length { sd_m: sd_m.max(1e-9), ..length }).unwrap();
            let reached = objective(
                &q,
                Length { sd_m: sd_m.max(1e-9), ..length },
                &point,
                &near.nearest(&point),
            );
            assert!(
                (metric.cost(&point) - reached).abs() < 1e-6,
                "{} {reached}",
                metric.cost(&point)
            );
        }
    }

    #[test]
    fn impossible_spheres_are_refused() {
        let unit = Matrix3::identity();
        for length in [
            Length { length_m: 0.0, sd_m: 0.0 },
            Length { length_m: f64::NAN, sd_m: 0.0 },
            Length { length_m: 1.0, sd_m: -1.0 },
            Length { length_m: 1.0, sd_m: f64::INFINITY },
        ] {
            assert!(matches!(
                SphereMetric::new(&unit, length),
                Err(AmbiguityError::OutOfRange { .. })
            ));
        }
        let flat = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, 0.0));
        let found = SphereMetric::new(&flat, Length { length_m: 1.0, sd_m: 0.0 });
        assert_eq!(found, Err(AmbiguityError::NotPositiveDefinite { index: 2, variance: 0.0 }));
    }
}
