//! The weighted attitude problem and its solution by Newton's method on the rotations.
//!
//! Whatever was measured, its weighted squares are a quadratic function of the nine entries of the
//! rotation matrix `Q` (Rapoport, equation 9, in information form, which needs no inverse):
//!
//! ```text
//! F(Q) = ½ qᵀ G q − hᵀ q,     q = vec Q (column after column)
//! ```
//!
//! Where every antenna sees the same satellites, `G = R ⊗ N` and `h = vec X`: the normal matrix `N`
//! of a baseline and the weighted spread `R` of the antennas, 3×3 each, say everything.

use nalgebra::{Matrix3, Rotation3, SMatrix, SVector, UnitQuaternion, Vector3};

use super::AttitudeError;
use super::small::{Factored, outer, product, transposed_product};
use super::wahba::any_nearest_rotation;
use crate::frames::skew;

/// `G` of the general form.
pub type Matrix9 = SMatrix<f64, 9, 9>;

/// Newton steps after which the method is stopped; from Wahba's solution it needs four.
const MAX_ITERATIONS: usize = 60;
/// A full Newton step below this is the last: what is left is its square.
const LAST_STEP_RAD: f64 = 1e-9;
/// What may be left after the last step, foreseen from the last two.
const ROUNDING_RAD: f64 = 1e-14;
/// No step turns further.
const MAX_STEP_RAD: f64 = 1.0;
/// The correction of the information is of the second order, not another information.
const MIN_UNBIASED_SHARE: f64 = 0.75;
/// Share of the largest eigenvalue below which the smallest counts as zero.
const SINGULAR_RATIO: f64 = 1e-12;

/// A quadratic cost on the rotations. It is half a sum of weighted squares without its constant:
/// with true weights, twice a cost difference is a difference of χ².
#[derive(Debug, Clone, PartialEq)]
pub enum AttitudeProblem {
    /// `F(Q) = ½ tr(Qᵀ N Q R) − tr(Xᵀ Q)`.
    Separable {
        /// `N`, outside frame: information of one baseline, per m² (symmetric, ⪰ 0).
        normal: Matrix3<f64>,
        /// `R = l C lᵀ`, body frame: weighted spread of the antennas, m² (symmetric, ⪰ 0).
        spread: Matrix3<f64>,
        /// `X = b C lᵀ`, outside frame × body frame.
        cross: Matrix3<f64>,
    },
    /// `F(Q) = ½ qᵀ G q − hᵀ q`.
    General {
        /// `G` (symmetric, ⪰ 0); `G[(3a + i, 3b + j)]` joins `Q[(i, a)]` and `Q[(j, b)]`.
        information: Box<Matrix9>,
        /// `h` as a matrix, `h = vec` of it.
        linear: Matrix3<f64>,
    },
}

/// A local minimum of an [`AttitudeProblem`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Minimum {
    /// `Q`: outside frame from body frame.
    pub rotation: Matrix3<f64>,
    /// `F(Q)`.
    pub cost: f64,
    /// Gauss–Newton matrix of a rotation vector `θ` in body axes, `Q exp[θ]×`, per rad². Its
    /// inverse is the covariance when the weights are inverse variances.
    pub information: Matrix3<f64>,
    /// Newton steps taken.
    pub iterations: usize,
}

impl Minimum {
    /// Covariance of the rotation vector in body axes, rad²: the inverse of the information.
    ///
    /// # Errors
    ///
    /// [`AttitudeError::Unobservable`] if the information is singular.
    pub fn covariance(&self) -> Result<Matrix3<f64>, AttitudeError> {
        Ok(Factored::new(&self.information).ok_or(AttitudeError::Unobservable)?.inverse())
    }
}

/// Value and derivatives of `F(Q exp[θ]×)` at `θ = 0`.
pub(super) struct Expansion {
    cost: f64,
    gradient: Vector3<f64>,
    information: Matrix3<f64>,
    /// Gauss–Newton matrix plus the curvature of the rotations.
    hessian: Matrix3<f64>,
}

impl AttitudeProblem {
    /// The problem of `k` baselines that share one normal matrix: `normal` `N` (per m²), `moments`
    /// `b` (3×k), `body` the baselines `l` (m), and the weight `C` between baselines (k×k).
    pub(super) fn separable(
        normal: Matrix3<f64>,
        moments: &[Vector3<f64>],
        body: &[Vector3<f64>],
        weight: impl Fn(usize, usize) -> f64,
    ) -> Self {
        let (mut spread, mut cross) = (Matrix3::zeros(), Matrix3::zeros());
        for j in 0..body.len() {
            // (l C)ⱼ and (b C)ⱼ
            let (mut weighted_l, mut weighted_b) = (Vector3::zeros(), Vector3::zeros());
            for i in 0..body.len() {
                weighted_l += weight(i, j) * body[i];
                weighted_b += weight(i, j) * moments[i];
            }
            spread += outer(&weighted_l, &body[j]);
            cross += outer(&weighted_b, &body[j]);
        }
        Self::Separable { normal, spread, cross }
    }

    /// Refuses what [`AttitudeProblem::check_numbers`] refuses, and antennas or satellites on a line.
    pub(super) fn check(&self) -> Result<(), AttitudeError> {
        self.check_numbers()?;
        // A line has one principal moment, a plane two: λ₁λ₂ + λ₁λ₃ + λ₂λ₃ tells them apart.
        for moments in [self.spread(), self.normal()] {
            let scaled = moments / moments.trace();
            let pairs = 0.5 * (1.0 - scaled.norm_squared());
            if pairs.is_nan() || pairs < SINGULAR_RATIO {
                return Err(AttitudeError::Unobservable);
            }
        }
        Ok(())
    }

    /// Refuses numbers that are not finite, and matrices that are not symmetric or not ⪰ 0.
    pub(super) fn check_numbers(&self) -> Result<(), AttitudeError> {
        match self {
            Self::Separable { normal, spread, cross } => {
                if cross.iter().any(|c| !c.is_finite()) {
                    return Err(AttitudeError::NotFinite { what: "right-hand side" });
                }
                check_semidefinite("normal matrix", normal)?;
                check_semidefinite("weighted spread of the antennas", spread)?;
            }
            Self::General { information, linear } => {
                if linear.iter().any(|c| !c.is_finite()) {
                    return Err(AttitudeError::NotFinite { what: "right-hand side" });
                }
                check_semidefinite("information matrix", information)?;
            }
        }
        Ok(())
    }

    /// `F(Q)`.
    #[must_use]
    pub fn cost(&self, rotation: &Matrix3<f64>) -> f64 {
        match self {
            Self::Separable { normal, spread, cross } => {
                0.5 * (normal * rotation * spread).dot(rotation) - cross.dot(rotation)
            }
            Self::General { information, linear } => {
                let q = vec_of(rotation);
                0.5 * q.dot(&(**information * q)) - linear.dot(rotation)
            }
        }
    }

    /// Spread `R` of the antennas, body frame; for the general form its like, the traces of the
    /// blocks of `G`.
    pub(super) fn spread(&self) -> Matrix3<f64> {
        match self {
            Self::Separable { spread, .. } => *spread,
            Self::General { information, .. } => {
                Matrix3::from_fn(|a, b| information.fixed_view::<3, 3>(3 * a, 3 * b).trace())
            }
        }
    }

    /// Normal matrix `N`, outside frame; for the general form its like, the sum of the diagonal
    /// blocks of `G`.
    pub(super) fn normal(&self) -> Matrix3<f64> {
        match self {
            Self::Separable { normal, .. } => *normal,
            Self::General { information, .. } => {
                (0..3).map(|a| information.fixed_view::<3, 3>(3 * a, 3 * a).into_owned()).sum()
            }
        }
    }

    /// `T = tr(M) I − M`, `M` the symmetric part of `Qᵀ ∂F/∂Q`: what the rotations take from the
    /// curvature of the cost.
    pub(super) fn curvature(&self, rotation: &Matrix3<f64>) -> Matrix3<f64> {
        let here = self.expand(rotation);
        here.information - here.hessian
    }

    /// Whether `G ⪰ λ S ⊗ I` for this `λ > 0`, where `S` is [`AttitudeProblem::spread`].
    pub(super) fn exceeds(&self, lambda: f64, spread: &Matrix3<f64>) -> bool {
        match self {
            // R ⊗ N ⪰ λ R ⊗ I
            Self::Separable { normal, .. } => {
                is_positive_definite(normal - lambda * Matrix3::identity())
            }
            Self::General { information, .. } => {
                let bound = lambda * spread.kronecker(&Matrix3::identity());
                let lift = 1e-13 * information.trace() * Matrix9::identity();
                is_positive_definite(**information - bound + lift)
            }
        }
    }

    /// Wahba's solution for the unconstrained minimum: where every method starts.
    ///
    /// For `G = R ⊗ N` it is the rotation nearest to `N⁻¹X = L* C lᵀ`. A singular `N` is inverted on
    /// its range.
    ///
    /// # Errors
    ///
    /// [`AttitudeError::Unobservable`].
    pub fn wahba_start(&self) -> Result<Matrix3<f64>, AttitudeError> {
        let target = match self {
            Self::Separable { normal, cross, .. } => solve_on_range3(normal, cross),
            // Q̂ = G⁺h, weighted by the spread of the antennas
            Self::General { information, linear } => {
                solve_on_range9(information, linear) * self.spread()
            }
        };
        any_nearest_rotation(&target)
    }

    /// The minimum that Newton's method reaches from Wahba's solution: nearly always the global one;
    /// [`super::uniqueness`] proves it or looks further.
    ///
    /// # Errors
    ///
    /// [`AttitudeError::Unobservable`] for collinear antennas and for satellites that leave a turn
    /// undetermined; input errors as in [`AttitudeError`].
    pub fn minimum_from_wahba(&self) -> Result<Minimum, AttitudeError> {
        self.check()?;
        self.minimum_from(self.wahba_start()?)
    }

    /// The local minimum that Newton's method reaches from `start`.
    ///
    /// Damped: where the Hessian is not positive definite its smallest eigenvalue is lifted, and a
    /// step that does not descend is shortened.
    ///
    /// # Errors
    ///
    /// [`AttitudeError::Unobservable`] where the minimum is not a point, and
    /// [`AttitudeError::NoConvergence`].
    pub fn minimum_from(&self, start: Matrix3<f64>) -> Result<Minimum, AttitudeError> {
        let (mut rotation, mut here) = (start, self.expand(&start));
        let mut before_rad = f64::INFINITY;
        for iterations in 1..=MAX_ITERATIONS {
            let (step, is_newton) = damped_step(&here)?;
            (rotation, here) = self.descend(&rotation, &here, &step);
            let step_rad = step.norm();
            // |θₖ₊₁| ≈ c |θₖ|² with c = |θₖ| / |θₖ₋₁|²
            let left_rad = step_rad * (step_rad / before_rad).powi(2);
            let is_last =
                step_rad < LAST_STEP_RAD || (before_rad.is_finite() && left_rad < ROUNDING_RAD);
            if is_newton && is_last {
                check_definite(&here.information)?;
                let Expansion { cost, information, .. } = here;
                return Ok(Minimum { rotation, cost, information, iterations });
            }
            before_rad = if is_newton { step_rad } else { f64::INFINITY };
        }
        Err(AttitudeError::NoConvergence { iterations: MAX_ITERATIONS })
    }

    /// The information at a minimum with its bias of second order taken off, per rad².
    ///
    /// The curvature `K` of the cost changes with the attitude, and at an estimate, errors with the
    /// covariance `P` away from the truth, it is larger than at the truth by `½ ∂²K[P]` on average:
    /// one per cent of the normalised squared error where the errors are two degrees. The mean
    /// over `θ = ±√3 × the columns of P^½` shows this difference once more (Julier and Uhlmann
    /// 1997), so
    ///
    /// ```text
    /// I = 2 K(Q) − ⅙ Σ K(Q exp[θ]×)
    /// ```
    ///
    /// Where errors are so large that the second order says nothing, the Gauss–Newton matrix stays.
    #[must_use]
    pub fn unbiased_information(&self, minimum: &Minimum) -> Matrix3<f64> {
        let gauss_newton = minimum.information;
        let at_minimum = self.expand(&minimum.rotation).hessian;
        let Some(covariance) = Factored::new(&at_minimum).map(|factored| factored.inverse()) else {
            return gauss_newton;
        };
        let Some(root) = covariance.cholesky() else { return gauss_newton };
        let mut unbiased = 2.0 * at_minimum;
        for column in root.l().column_iter() {
            for side in [3.0_f64.sqrt(), -3.0_f64.sqrt()] {
                let aside = product(&minimum.rotation, &exponential(&(side * column)));
                unbiased -= self.expand(&aside).hessian / 6.0;
            }
        }
        let is_small = is_positive_definite(unbiased - MIN_UNBIASED_SHARE * gauss_newton)
            && is_positive_definite(gauss_newton / MIN_UNBIASED_SHARE - unbiased);
        if is_small { unbiased } else { gauss_newton }
    }

    /// One damped Newton step from `rotation`, and its length in rad.
    ///
    /// # Errors
    ///
    /// [`AttitudeError::Unobservable`] where no step is determined.
    pub fn newton_step(
        &self,
        rotation: &Matrix3<f64>,
    ) -> Result<(Matrix3<f64>, f64), AttitudeError> {
        let here = self.expand(rotation);
        let (step, _) = damped_step(&here)?;
        Ok((self.descend(rotation, &here, &step).0, step.norm()))
    }

    /// `Q exp[θ]×` with `step` shortened until the cost does not rise.
    fn descend(
        &self,
        rotation: &Matrix3<f64>,
        here: &Expansion,
        step: &Vector3<f64>,
    ) -> (Matrix3<f64>, Expansion) {
        let norm = step.norm();
        let mut scale = if norm > MAX_STEP_RAD { MAX_STEP_RAD / norm } else { 1.0 };
        loop {
            let next = product(rotation, &exponential(&(scale * step)));
            let there = self.expand(&next);
            let rounding = 1e-13 * (here.cost.abs() + there.cost.abs());
            if there.cost <= here.cost + rounding || scale * norm < 1e-6 || there.cost.is_nan() {
                return (next, there);
            }
            scale *= 0.5;
        }
    }

    /// Value, gradient, Gauss–Newton matrix and Hessian at `Q`.
    pub(super) fn expand(&self, rotation: &Matrix3<f64>) -> Expansion {
        let (slope, linear, information) = match self {
            Self::Separable { normal, spread, cross } => {
                let normal_q = product(normal, rotation);
                // I = mix(QᵀNQ, R)
                let information = mix(&transposed_product(rotation, &normal_q), spread);
                (product(&normal_q, spread) - cross, cross, information)
            }
            Self::General { information, linear } => {
                let q = vec_of(rotation);
                let slope = **information * q - vec_of(linear);
                let tangent = tangent_of(rotation);
                // I = TᵀGT,  T = ∂q/∂θ
                (matrix_of(&slope), linear, tangent.transpose() * (**information * tangent))
            }
        };
        // A = −Qᵀ ∂F/∂Q;  ∇ = −vex(A − Aᵀ);  K = I + tr(Aₛ) 1 − Aₛ
        let a = -transposed_product(rotation, &slope);
        let symmetric = 0.5 * (a + a.transpose());
        let information = 0.5 * (information + information.transpose());
        Expansion {
            cost: 0.5 * (slope - linear).dot(rotation),
            gradient: -vex_of_difference(&a),
            information,
            hessian: information + symmetric.trace() * Matrix3::identity() - symmetric,
        }
    }
}

/// Newton's step `K θ = −∇`, or, where `K` is not positive definite, a step of descent. Says which.
fn damped_step(here: &Expansion) -> Result<(Vector3<f64>, bool), AttitudeError> {
    if let Some(factored) = Factored::new(&here.hessian) {
        return Ok((factored.solve(&-here.gradient), true));
    }
    if here.hessian.iter().any(|c| !c.is_finite()) {
        return Err(AttitudeError::NotFinite { what: "problem" });
    }
    let eigen = here.hessian.symmetric_eigen();
    let largest = eigen.eigenvalues.amax();
    if largest == 0.0 {
        return Err(AttitudeError::Unobservable);
    }
    let lowest = eigen.eigenvalues.imin();
    if eigen.eigenvalues[lowest] > -SINGULAR_RATIO * largest {
        return Err(AttitudeError::Unobservable);
    }
    // Along the lowest eigenvector the cost bends down: go at least this far that way.
    let mut step = Vector3::zeros();
    for (axis, value) in eigen.eigenvectors.column_iter().zip(eigen.eigenvalues.iter()) {
        let slope = axis.dot(&here.gradient);
        step -= axis * (slope / value.abs().max(1e-3 * largest));
    }
    let down = eigen.eigenvectors.column(lowest).into_owned();
    let along = down.dot(&step);
    if along.abs() < 0.1 {
        step += down * (0.1_f64.copysign(along) - along);
    }
    Ok((step, false))
}

/// Rotation matrix of a rotation vector: `exp[θ]× = cos θ I + sin θ/θ [θ]× + (1 − cos θ)/θ² θθᵀ`.
#[must_use]
pub fn exponential(theta: &Vector3<f64>) -> Matrix3<f64> {
    let angle2 = theta.norm_squared();
    let (s, c) = if angle2 < 1e-8 {
        // sin θ/θ = 1 − θ²/6 + …, (1 − cos θ)/θ² = ½ − θ²/24 + …
        (1.0 - angle2 / 6.0, 0.5 - angle2 / 24.0)
    } else {
        let angle = angle2.sqrt();
        let (half_sin, half_cos) = (0.5 * angle).sin_cos();
        (2.0 * half_sin * half_cos / angle, 2.0 * half_sin * half_sin / angle2)
    };
    Matrix3::from_diagonal_element(1.0 - c * angle2) + s * skew(theta) + c * outer(theta, theta)
}

/// Rotation vector of a rotation matrix, `‖θ‖ ≤ π`: the inverse of [`exponential`].
#[must_use]
pub fn logarithm(rotation: &Matrix3<f64>) -> Vector3<f64> {
    // By the quaternion, which keeps its digits at half a turn.
    UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(*rotation)).scaled_axis()
}

/// `mix(X, Y) = adj(X + Y) − adj X − adj Y` for symmetric matrices: the matrix for which
/// `X[s]×Y + Y[s]×X = [mix(X, Y) s]×`, and `θᵀ mix(X, Y) θ = tr(X[θ]×Y[θ]×ᵀ)`.
pub(super) fn mix(x: &Matrix3<f64>, y: &Matrix3<f64>) -> Matrix3<f64> {
    let entry = |i: usize, j: usize| {
        let (a, b) = ((i + 1) % 3, (i + 2) % 3);
        let (c, d) = ((j + 1) % 3, (j + 2) % 3);
        x[(a, c)] * y[(b, d)] + x[(b, d)] * y[(a, c)]
            - x[(a, d)] * y[(b, c)]
            - x[(b, c)] * y[(a, d)]
    };
    let (xx, yy, zz) = (entry(0, 0), entry(1, 1), entry(2, 2));
    let (xy, xz, yz) = (entry(0, 1), entry(0, 2), entry(1, 2));
    Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz)
}

/// `vex(A − Aᵀ)`: the vector whose antisymmetric matrix is `A − Aᵀ`.
pub(super) fn vex_of_difference(a: &Matrix3<f64>) -> Vector3<f64> {
    Vector3::new(a[(2, 1)] - a[(1, 2)], a[(0, 2)] - a[(2, 0)], a[(1, 0)] - a[(0, 1)])
}

/// Columns of `Q` one after the other.
pub(super) fn vec_of(matrix: &Matrix3<f64>) -> SVector<f64, 9> {
    SVector::from_column_slice(matrix.as_slice())
}

/// The other way round.
pub(super) fn matrix_of(vector: &SVector<f64, 9>) -> Matrix3<f64> {
    Matrix3::from_column_slice(vector.as_slice())
}

/// `∂ vec(Q exp[θ]×) / ∂θ`: column `i` is `vec(Q [eᵢ]×)`.
pub(super) fn tangent_of(rotation: &Matrix3<f64>) -> SMatrix<f64, 9, 3> {
    let columns =
        [Vector3::x(), Vector3::y(), Vector3::z()].map(|e| vec_of(&(rotation * skew(&e))));
    SMatrix::from_columns(&columns)
}

/// `N⁻¹ B`; a singular `N` is inverted on its range.
fn solve_on_range3(normal: &Matrix3<f64>, right: &Matrix3<f64>) -> Matrix3<f64> {
    // A pivot far below the largest shows a singular matrix as well as an eigenvalue.
    if let Some(factored) = Factored::new(normal)
        && factored.pivots.min() > 1e-10 * factored.pivots.max()
    {
        return factored.solve_columns(right);
    }
    let eigen = normal.symmetric_eigen();
    let floor = SINGULAR_RATIO * eigen.eigenvalues.amax();
    let inverse = eigen.eigenvalues.map(|value| if value > floor { 1.0 / value } else { 0.0 });
    eigen.eigenvectors * Matrix3::from_diagonal(&inverse) * eigen.eigenvectors.transpose() * right
}

/// `G⁺ h`, both as matrices.
fn solve_on_range9(information: &Matrix9, linear: &Matrix3<f64>) -> Matrix3<f64> {
    let right = vec_of(linear);
    if let Some(cholesky) = information.cholesky() {
        let pivots = cholesky.l_dirty().diagonal();
        if pivots.min() > 1e-5 * pivots.max() {
            return matrix_of(&cholesky.solve(&right));
        }
    }
    let eigen = information.symmetric_eigen();
    let floor = SINGULAR_RATIO * eigen.eigenvalues.amax();
    let inverse = eigen.eigenvalues.map(|value| if value > floor { 1.0 / value } else { 0.0 });
    let coordinates = eigen.eigenvectors.transpose() * right;
    matrix_of(&(eigen.eigenvectors * coordinates.component_mul(&inverse)))
}

/// Finite, symmetric and ⪰ 0, to rounding.
fn check_semidefinite<const D: usize>(
    what: &'static str,
    matrix: &SMatrix<f64, D, D>,
) -> Result<(), AttitudeError> {
    if matrix.iter().any(|c| !c.is_finite()) {
        return Err(AttitudeError::NotFinite { what });
    }
    let largest = matrix.amax();
    let asymmetry = (matrix - matrix.transpose()).amax();
    if asymmetry > 1e-9 * largest {
        return Err(AttitudeError::NotSymmetric { what, difference: asymmetry });
    }
    // M + ε I ≻ 0: fast, and exact enough to tell rounding from a negative weight.
    let lifted = matrix + SMatrix::<f64, D, D>::identity() * (1e-9 * largest);
    if largest > 0.0 && !is_positive_definite(lifted) {
        return Err(AttitudeError::Indefinite { what });
    }
    Ok(())
}

/// Whether `L D Lᵀ` of a symmetric matrix, computed in place, has only positive pivots.
pub(super) fn is_positive_definite<const D: usize>(mut matrix: SMatrix<f64, D, D>) -> bool {
    for pivot in 0..D {
        let d = matrix[(pivot, pivot)];
        if d <= 0.0 || d.is_nan() {
            return false;
        }
        for j in pivot + 1..D {
            let factor = matrix[(j, pivot)] / d;
            for i in j..D {
                matrix[(i, j)] -= factor * matrix[(i, pivot)];
            }
        }
    }
    true
}

/// Every turn is determined: the information matrix is definite by a margin above rounding.
fn check_definite(information: &Matrix3<f64>) -> Result<(), AttitudeError> {
    let lowered = information - SINGULAR_RATIO * information.trace() * Matrix3::identity();
    Factored::new(&lowered).map(|_| ()).ok_or(AttitudeError::Unobservable)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn matrix() -> impl Strategy<Value = Matrix3<f64>> {
        proptest::array::uniform9(-1.0..1.0f64).prop_map(|c| Matrix3::from_row_slice(&c))
    }

    fn rotation() -> impl Strategy<Value = Matrix3<f64>> {
        proptest::array::uniform3(-2.0..2.0f64).prop_map(|c| exponential(&Vector3::from(c)))
    }

    /// One problem in its short and in its general form.
    fn both_forms(n: Matrix3<f64>, r: Matrix3<f64>, x: Matrix3<f64>) -> [AttitudeProblem; 2] {
        let (normal, spread) = (n * n.transpose(), r * r.transpose());
        let information = Box::new(spread.kronecker(&normal));
        [
            AttitudeProblem::Separable { normal, spread, cross: x },
            AttitudeProblem::General { information, linear: x },
        ]
    }

    proptest! {
        #[test]
        fn derivatives_against_central_differences(
            n in matrix(), r in matrix(), x in matrix(), q in rotation(),
        ) {
            for problem in both_forms(n, r, x) {
                let here = problem.expand(&q);
                prop_assert!((here.cost - problem.cost(&q)).abs() < 1e-12);
                let moved = |theta: Vector3<f64>| problem.cost(&(q * exponential(&theta)));
                let (h, e) = (1e-4, [Vector3::x(), Vector3::y(), Vector3::z()]);
                for i in 0..3 {
                    let slope = (moved(h * e[i]) - moved(-h * e[i])) / (2.0 * h);
                    prop_assert!((slope - here.gradient[i]).abs() < 1e-6);
                    for j in 0..3 {
                        let bend = moved(h * (e[i] + e[j])) - moved(h * (e[i] - e[j]))
                            - moved(h * (e[j] - e[i])) + moved(-h * (e[i] + e[j]));
                        prop_assert!((bend / (4.0 * h * h) - here.hessian[(i, j)]).abs() < 1e-5);
                    }
                }
            }
        }

        #[test]
        fn both_forms_have_one_minimum(n in matrix(), r in matrix(), x in matrix()) {
            let [short, general] = both_forms(n, r, x).map(|problem| problem.global_minimum(1e-3));
            let (Ok(short), Ok(general)) = (short, general) else { return Ok(()) };
            let scale = short.minimum.cost.abs() + 1.0;
            prop_assert!((short.minimum.cost - general.minimum.cost).abs() < 1e-9 * scale);
        }

        #[test]
        fn logarithm_undoes_the_exponential(c in proptest::array::uniform3(-1.8..1.8f64)) {
            let theta = Vector3::from(c);
            prop_assert!((logarithm(&exponential(&theta)) - theta).norm() < 1e-14);
            // Half a turn, either way round.
            let half = core::f64::consts::PI * theta.normalize();
            let found = logarithm(&exponential(&half));
            prop_assert!((found - half).norm().min((found + half).norm()) < 1e-14);
        }
    }

    #[test]
    fn wrong_weights_are_refused() {
        let good = Matrix3::identity();
        let refusal = |normal, spread| {
            AttitudeProblem::Separable { normal, spread, cross: good }.minimum().unwrap_err()
        };
        let indefinite = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, -0.1));
        assert!(matches!(refusal(indefinite, good), AttitudeError::Indefinite { .. }));
        let lopsided = Matrix3::new(1.0, 0.1, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0);
        assert!(matches!(refusal(lopsided, good), AttitudeError::NotSymmetric { .. }));
        let nan = Matrix3::repeat(f64::NAN);
        assert!(matches!(refusal(good, nan), AttitudeError::NotFinite { .. }));
        assert_eq!(refusal(good, Matrix3::zeros()), AttitudeError::Unobservable);
        let line = Vector3::z() * Vector3::z().transpose();
        assert_eq!(refusal(good, line), AttitudeError::Unobservable);
    }

    /// A turn that costs nothing is open, whatever the scale of the weights.
    #[test]
    fn open_turns_are_refused_at_any_scale() {
        for scale in [1e-9, 1.0, 1e9] {
            let diagonal =
                |c: f64| Matrix3::from_diagonal(&Vector3::new(scale, 2.0 * scale, c * scale));
            let at = |hessian: Matrix3<f64>| Expansion {
                cost: 0.0,
                gradient: scale * Vector3::new(0.1, 0.2, 0.0),
                information: hessian,
                hessian,
            };
            assert_eq!(damped_step(&at(diagonal(0.0))), Err(AttitudeError::Unobservable));
            let (step, is_newton) = damped_step(&at(diagonal(-1.0))).unwrap();
            assert!(!is_newton && step.z.abs() >= 0.1, "{step}");
            let (step, is_newton) = damped_step(&at(diagonal(1.0))).unwrap();
            assert!(is_newton && (step + Vector3::new(0.1, 0.1, 0.0)).norm() < 1e-14, "{step}");

            assert_eq!(check_definite(&diagonal(1e-13)), Err(AttitudeError::Unobservable));
            assert_eq!(check_definite(&diagonal(1e-9)), Ok(()));

            // N⁻¹ on the two axes that N has
            let (wanted, flat) =
                (Matrix3::new(1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 0.0, 0.0, 0.0), diagonal(0.0));
            assert!((solve_on_range3(&flat, &(flat * wanted)) - wanted).norm() < 1e-14, "{scale}");
        }
    }

    /// From a maximum, where the gradient vanishes, the way down is found.
    #[test]
    fn a_maximum_does_not_hold_the_iteration() {
        let cross = Matrix3::from_diagonal(&Vector3::new(3.0, 2.0, 1.0));
        let eye = Matrix3::identity();
        let problem = AttitudeProblem::Separable { normal: eye, spread: eye, cross };
        let upside_down = Matrix3::from_diagonal(&Vector3::new(-1.0, -1.0, 1.0));
        let minimum = problem.minimum_from(upside_down).unwrap();
        assert!((minimum.rotation - eye).norm() < 1e-12, "{minimum:?}");
    }
}
