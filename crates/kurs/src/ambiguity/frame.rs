//! The orthonormal axes nearest to three or two given vectors, in the metric of a covariance.
//!
//! ```text
//! c(f̌) = min over orthonormal f₁ … f_r of  (f̌ − f)ᵀ Q⁻¹ (f̌ − f),     f = (f₁; …; f_r),  r = 2, 3
//! ```
//!
//! There is no closed form, but a lower bound for every symmetric matrix `M` of multipliers with
//! `A = Q⁻¹ + M ⊗ I ≻ 0`, one for each of the conditions `fᵢ · fⱼ = δᵢⱼ`:
//!
//! ```text
//! g(M) = min over f of (f̌ − f)ᵀ Q⁻¹ (f̌ − f) + Σ Mᵢⱼ (fᵢ · fⱼ − δᵢⱼ),     f(M) = A⁻¹ Q⁻¹ f̌
//! ```
//!
//! `g` is concave with the slopes `fᵢ · fⱼ − δᵢⱼ`, so Newton's method climbs it. At its top `f(M)`
//! is orthonormal, and the bound is the cost, unless the top lies on the edge `det A = 0`: then
//! (and for the handedness of three axes) the cost comes from the attitude problem itself.

use nalgebra::{Cholesky, Const, Matrix3, SMatrix, SVector, Vector3};

use super::AmbiguityError;
use crate::attitude::{AttitudeProblem, wahba::nearest_rotation, weighted::Matrix9};

/// Newton steps without a start.
const MAX_STEPS: usize = 30;
/// Newton steps from the multipliers of the branch above.
const FEW_STEPS: usize = 1;
/// A gain of the bound below this, relative to it, is rounding.
const SMALL_GAIN: f64 = 1e-11;
/// A step is halved so often before it is given up: next to the edge `det A = 0` it may be far too
/// long.
const MAX_HALVINGS: usize = 30;
/// Bound and cost that agree to this are the global minimum.
const CERTIFIED: f64 = 1e-6;

/// `r` orthonormal axes with `P = 3r` components and `S = r (r + 1) / 2` conditions, seen in the
/// metric of a covariance.
#[derive(Debug, Clone, PartialEq)]
pub struct FrameMetric<const P: usize, const S: usize> {
    /// `Q⁻¹`.
    weight: SMatrix<f64, P, P>,
}

/// The orthonormal axes of least cost.
#[derive(Debug, Clone, PartialEq)]
pub struct Nearest<const P: usize> {
    /// `f`, right-handed if there are three.
    pub axes: SVector<f64, P>,
    /// `c(f̌)`.
    pub cost: f64,
    /// Whether the bound proves it; else all rotations were searched.
    pub is_certified: bool,
}

/// The bound and its derivatives at one `M`.
struct Dual<const P: usize, const S: usize> {
    /// `A`, factored.
    factor: Cholesky<f64, Const<P>>,
    /// `f(M)`.
    axes: SVector<f64, P>,
    /// `fᵢ · fⱼ − δᵢⱼ`, twice for `i < j`.
    slopes: SVector<f64, S>,
    value: f64,
}

impl<const P: usize, const S: usize> FrameMetric<P, S> {
    /// Prepares the metric of `covariance` (no unit: axes have length one).
    ///
    /// # Errors
    ///
    /// [`AmbiguityError::NotPositiveDefinite`].
    pub fn new(covariance: &SMatrix<f64, P, P>) -> Result<Self, AmbiguityError> {
        let Some(factor) = covariance.cholesky() else {
            let variance = covariance.diagonal().min();
            return Err(AmbiguityError::NotPositiveDefinite { index: 0, variance });
        };
        Ok(Self { weight: factor.inverse() })
    }

    /// A lower bound of `c(f̌)` and its multipliers (`M₁₁, M₁₂, …, M_rr`), from few steps that begin
    /// at `start`, or from many without one.
    #[must_use]
    pub fn bound(
        &self,
        vectors: &SVector<f64, P>,
        start: Option<SVector<f64, S>>,
    ) -> (f64, SVector<f64, S>) {
        match start {
            Some(start) => self.bound_after(vectors, start, FEW_STEPS),
            None => self.bound_after(vectors, SVector::zeros(), MAX_STEPS),
        }
    }

    /// As [`bound`](Self::bound), from many steps that begin at `start`.
    pub(super) fn tight_bound(
        &self,
        vectors: &SVector<f64, P>,
        start: SVector<f64, S>,
    ) -> (f64, SVector<f64, S>) {
        self.bound_after(vectors, start, MAX_STEPS)
    }

    fn bound_after(
        &self,
        vectors: &SVector<f64, P>,
        start: SVector<f64, S>,
        max_steps: usize,
    ) -> (f64, SVector<f64, S>) {
        let (found, multipliers) = self.climb(vectors, start, max_steps);
        (found.map_or(0.0, |dual| dual.value.max(0.0)), multipliers)
    }

    /// The orthonormal axes of least cost.
    ///
    /// # Errors
    ///
    /// [`AmbiguityError::NoAttitude`] if no minimum is found.
    pub fn nearest(
        &self,
        vectors: &SVector<f64, P>,
        start: SVector<f64, S>,
    ) -> Result<Nearest<P>, AmbiguityError> {
        let (dual, _) = self.climb(vectors, start, MAX_STEPS);
        let (bound, near) = dual.map_or((0.0, *vectors), |dual| (dual.value, dual.axes));
        let problem = self.attitude_problem(vectors);
        let rotation = nearest_rotation(&columns(&near)).map_err(|_| AmbiguityError::NoAttitude)?;
        let minimum =
            problem.minimum_from(rotation.rotation).map_err(|_| AmbiguityError::NoAttitude)?;
        let (axes, cost) = self.cost_of(vectors, &minimum.rotation);
        if cost <= bound + CERTIFIED * (1.0 + cost) || problem.is_certified(&minimum, 0.0) {
            return Ok(Nearest { axes, cost, is_certified: true });
        }
        let elsewhere = problem.search(minimum).minimum;
        let (other_axes, other_cost) = self.cost_of(vectors, &elsewhere.rotation);
        let (axes, cost) = if other_cost < cost { (other_axes, other_cost) } else { (axes, cost) };
        Ok(Nearest { axes, cost, is_certified: false })
    }

    /// Newton's method on `g`, as far as it climbs; no dual if `A` is not positive definite.
    fn climb(
        &self,
        vectors: &SVector<f64, P>,
        start: SVector<f64, S>,
        max_steps: usize,
    ) -> (Option<Dual<P, S>>, SVector<f64, S>) {
        let mut multipliers = start;
        let weighted = self.weight * vectors;
        let dual = |multipliers: SVector<f64, S>| self.dual(vectors, &weighted, &multipliers);
        let Some(mut here) = dual(multipliers) else { return (None, multipliers) };
        for _ in 0..max_steps {
            let Some(mut step) = here.newton_step() else { break };
            // Twice what the step can gain: nothing at the top.
            if here.slopes.dot(&step) <= SMALL_GAIN * (1.0 + here.value.abs()) {
                break;
            }
            let mut next = None;
            for _ in 0..MAX_HALVINGS {
                let there = dual(multipliers + step);
                next = there.filter(|there| there.value > here.value);
                if next.is_some() {
                    break;
                }
                step *= 0.5;
            }
            let Some(there) = next else { break };
            multipliers += step;
            here = there;
        }
        (Some(here), multipliers)
    }

    /// `weighted` is `Q⁻¹ f̌`.
    fn dual(
        &self,
        vectors: &SVector<f64, P>,
        weighted: &SVector<f64, P>,
        multipliers: &SVector<f64, S>,
    ) -> Option<Dual<P, S>> {
        // A = Q⁻¹ + M ⊗ I
        let mut a = self.weight;
        for (s, (i, j)) in conditions::<P>().enumerate() {
            for axis in 0..3 {
                a[(3 * i + axis, 3 * j + axis)] += multipliers[s];
                if i != j {
                    a[(3 * j + axis, 3 * i + axis)] += multipliers[s];
                }
            }
        }
        let factor = a.cholesky()?;
        let axes = factor.solve(weighted);
        // (f̌ − f)ᵀ Q⁻¹ (f̌ − f) = (f̌ − f)ᵀ (M ⊗ I) f, as A f = Q⁻¹ f̌
        let residual = vectors - axes;
        let mut value = 0.0;
        let mut slopes = SVector::<f64, S>::zeros();
        let axis = |vector: &SVector<f64, P>, i: usize| vector.fixed_rows::<3>(3 * i).into_owned();
        for (s, (i, j)) in conditions::<P>().enumerate() {
            let (f_i, f_j) = (axis(&axes, i), axis(&axes, j));
            let product = f_i.dot(&f_j);
            let mut misfit = axis(&residual, i).dot(&f_j);
            if i == j {
                slopes[s] = product - 1.0;
            } else {
                slopes[s] = 2.0 * product;
                misfit += axis(&residual, j).dot(&f_i);
            }
            value += multipliers[s] * (misfit + slopes[s]);
        }
        value.is_finite().then_some(Dual { factor, axes, slopes, value })
    }

    /// The cost of the frame as an attitude problem: `f̌ᵢ` measures the image of the `i`-th unit vector.
    fn attitude_problem(&self, vectors: &SVector<f64, P>) -> AttitudeProblem {
        let mut information = Box::new(Matrix9::zeros());
        information.view_mut((0, 0), (P, P)).copy_from(&self.weight);
        let linear = columns(&(self.weight * vectors));
        AttitudeProblem::General { information, linear }
    }

    /// The axes of a rotation and `(f̌ − f)ᵀ Q⁻¹ (f̌ − f)`.
    fn cost_of(
        &self,
        vectors: &SVector<f64, P>,
        rotation: &Matrix3<f64>,
    ) -> (SVector<f64, P>, f64) {
        let axes = SVector::<f64, P>::from_fn(|row, _| rotation[(row % 3, row / 3)]);
        let residual = vectors - axes;
        (axes, residual.dot(&(self.weight * residual)))
    }
}

impl<const P: usize, const S: usize> Dual<P, S> {
    /// Newton's step towards the top: `2 Vᵀ A⁻¹ V ΔM = slopes`, column `s` of `V` the derivative of
    /// `(M ⊗ I) f` with respect to condition `s`.
    fn newton_step(&self) -> Option<SVector<f64, S>> {
        let mut v = SMatrix::<f64, P, S>::zeros();
        for (s, (i, j)) in conditions::<P>().enumerate() {
            for axis in 0..3 {
                v[(3 * i + axis, s)] = self.axes[3 * j + axis];
                v[(3 * j + axis, s)] = self.axes[3 * i + axis];
            }
        }
        // A⁻¹ = L⁻ᵀ L⁻¹
        self.factor.l_dirty().solve_lower_triangular_unchecked_mut(&mut v);
        let hessian = 2.0 * v.transpose() * v;
        Some(hessian.cholesky()?.solve(&self.slopes))
    }
}

/// The pairs `i <= j` of axes, one condition each.
fn conditions<const P: usize>() -> impl Iterator<Item = (usize, usize)> {
    (0..P / 3).flat_map(|i| (i..P / 3).map(move |j| (i, j)))
}

/// Stacked vectors as the columns of a matrix; zero where there is no third one.
fn columns<const P: usize>(stacked: &SVector<f64, P>) -> Matrix3<f64> {
    Matrix3::from_fn(|row, column| if 3 * column < P { stacked[3 * column + row] } else { 0.0 })
}

/// Right-handed axes from two or three.
#[must_use]
pub fn completed<const P: usize>(axes: &SVector<f64, P>) -> Matrix3<f64> {
    let mut matrix = columns(axes);
    if P == 6 {
        let third: Vector3<f64> = matrix.column(0).cross(&matrix.column(1));
        matrix.set_column(2, &third);
    }
    matrix
}

#[cfg(test)]
mod tests {
    use super::super::problems::{normal, seeded};
    use super::*;

    fn random_rotation(random: &mut rand_xoshiro::Xoshiro256PlusPlus) -> Matrix3<f64> {
        nearest_rotation(&Matrix3::from_fn(|_, _| normal(random))).unwrap().rotation
    }

    fn check<const P: usize, const S: usize>(seed: u64, noise: f64, least_certified: usize) {
        let mut random = seeded(seed);
        let mut certified = 0;
        for case in 0..100 {
            let root = SMatrix::<f64, P, P>::from_fn(|_, _| normal(&mut random));
            let q = root * root.transpose() + SMatrix::<f64, P, P>::identity() * 0.1;
            let metric = FrameMetric::<P, S>::new(&q).unwrap();
            let truth = random_rotation(&mut random);
            let vectors = SVector::<f64, P>::from_fn(|row, _| {
                truth[(row % 3, row / 3)] + noise * normal(&mut random)
            });
            let (bound, multipliers) = metric.bound(&vectors, None);
            let Nearest { axes, cost, .. } = metric.nearest(&vectors, multipliers).unwrap();
            let rotation = completed(&axes);
            assert!((rotation.transpose() * rotation - Matrix3::identity()).amax() < 1e-12);
            assert!(rotation.determinant() > 0.0);
            assert!(bound <= cost + 1e-9 * (1.0 + cost), "case {case}: {bound} {cost}");
            certified += usize::from(cost - bound < 1e-6 * (1.0 + cost));
            // No other rotation is better, neither near nor far.
            for trial in 0..300 {
                let mix = if trial % 2 == 0 { 0.05 } else { 3.0 };
                let perturbed = rotation + Matrix3::from_fn(|_, _| mix * normal(&mut random));
                let other = nearest_rotation(&perturbed).unwrap().rotation;
                assert!(metric.cost_of(&vectors, &other).1 >= cost - 1e-9, "case {case}");
            }
            // Few steps from elsewhere still give a bound.
            let start = multipliers + SVector::from_fn(|_, _| 0.01 * normal(&mut random));
            assert!(metric.bound(&vectors, Some(start)).0 <= cost + 1e-9 * (1.0 + cost));
        }
        assert!(certified > least_certified, "{certified}");
    }

    #[test]
    fn two_axes_near_and_far() {
        check::<6, 3>(40, 0.05, 95);
        check::<6, 3>(41, 0.3, 50);
    }

    #[test]
    fn three_axes_near_and_far() {
        check::<9, 6>(42, 0.05, 80);
        check::<9, 6>(43, 0.3, 10);
    }
}
