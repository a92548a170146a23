//! Wahba's problem: the rotation that carries known directions onto measured ones best.
//!
//! Minimise `Σ wᵣ ‖Q lᵣ − Lᵣ‖²` over rotations `Q`, that is, maximise `tr(Qᵀ M)` with
//! `M = Σ wᵣ Lᵣ lᵣᵀ`. Solved by the characteristic equation (Markley 1993) where the answer stands clear of
//! all others, else by the singular value decomposition (Markley 1988; Rapoport, equation 14, whose
//! solution lacks the condition det = +1 and is a reflection on flat arrays), and by Davenport's
//! q-method as the independent second way.

use nalgebra::{Matrix3, Matrix4, Vector3};

use super::AttitudeError;
use super::small::{Factored, outer, product, transposed_product};

/// Sweeps of the Jacobi method after which it is stopped; it needs four to six.
const MAX_SWEEPS: usize = 30;
/// `σ₂ + d σ₃` below this share of `σ₁` leaves a turn undetermined.
const UNIQUE_RATIO: f64 = 1e-12;
/// `ζ` above this share of `λ³` has the characteristic equation well conditioned: it is 8/27 for three
/// equal singular values, a quarter for two.
const CLEAR_RATIO: f64 = 0.02;
/// Newton steps for `λ` from its bound; it takes three to six.
const MAX_NEWTON_STEPS: usize = 12;

/// The rotation nearest to a matrix, in the sense of the largest `tr(Qᵀ M)`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NearestRotation {
    /// `Q`, orthogonal with determinant +1.
    pub rotation: Matrix3<f64>,
    /// `σ₁ ≥ σ₂ ≥ |d σ₃|`: singular values of `M`, the last with the sign `d` of `det M`.
    pub singular_values: Vector3<f64>,
}

impl NearestRotation {
    /// Whether no other rotation is as near: `σ₂ + d σ₃ > 0`, by a margin above rounding.
    #[must_use]
    pub fn is_unique(&self) -> bool {
        let [first, second, third] = self.singular_values.into();
        second + third > UNIQUE_RATIO * first
    }
}

/// Attitude from `n ≥ 2` pairs of vectors: `Q` that minimises `Σ wᵣ ‖Q lᵣ − Lᵣ‖²`.
///
/// `body` are the `lᵣ`, `measured` the `Lᵣ` in the outside frame, `weights` the `wᵣ ≥ 0`.
///
/// # Errors
///
/// Slices of different length, fewer than two vectors, numbers that are not finite, a negative
/// weight, and vectors that all lie on one line ([`AttitudeError::Unobservable`]).
pub fn solve(
    body: &[Vector3<f64>],
    measured: &[Vector3<f64>],
    weights: &[f64],
) -> Result<Matrix3<f64>, AttitudeError> {
    let profile = attitude_profile(body, measured, weights)?;
    if let Some(rotation) = clear_rotation(&profile) {
        return Ok(rotation);
    }
    let nearest = nearest_rotation(&profile)?;
    if nearest.is_unique() { Ok(nearest.rotation) } else { Err(AttitudeError::Unobservable) }
}

/// `M = Σ wᵣ Lᵣ lᵣᵀ`, the transpose of what the literature calls the attitude profile matrix `B`.
///
/// # Errors
///
/// As [`solve`], but for the line.
pub fn attitude_profile(
    body: &[Vector3<f64>],
    measured: &[Vector3<f64>],
    weights: &[f64],
) -> Result<Matrix3<f64>, AttitudeError> {
    for found in [measured.len(), weights.len()] {
        if found != body.len() {
            return Err(AttitudeError::Shape { what: "vectors", expected: body.len(), found });
        }
    }
    if body.len() < 2 {
        return Err(AttitudeError::TooFewVectors { found: body.len() });
    }
    if let Some(weight) = weights.iter().copied().find(|w| w.is_nan() || *w < 0.0) {
        return Err(AttitudeError::NotPositive { what: "weight", value: weight });
    }
    let mut profile = Matrix3::zeros();
    for ((l, measured_l), weight) in body.iter().zip(measured).zip(weights) {
        profile += *weight * outer(measured_l, l);
    }
    Ok(profile)
}

/// The rotation `Q` with the largest `tr(Qᵀ M)`, from the largest root of the characteristic equation
/// (F. L. Markley, *Attitude determination using vector observations: a fast optimal matrix
/// algorithm*, J. Astronautical Sciences 41, 1993); `None` unless it stands clear of all others.
///
/// ```text
/// (λ² − ‖M‖²)² − 8 λ det M − 4 ‖cof M‖² = 0,    κ = (λ² − ‖M‖²) / 2,    ζ = κ λ − det M
/// Q = ((κ + ‖M‖²) M + λ cof M − M Mᵀ M) / ζ
/// ```
///
/// `λ = σ₁ + σ₂ + d σ₃` and `ζ = (σ₁ + σ₂)(σ₂ + d σ₃)(d σ₃ + σ₁)`, so a large `ζ` is a clear answer. One
/// Newton step on the rotations takes away what rounding the equation leaves.
#[must_use]
pub fn clear_rotation(matrix: &Matrix3<f64>) -> Option<Matrix3<f64>> {
    let scale = 1.0 / matrix.amax();
    let m = matrix * scale;
    let (a, b, c) = (m.column(0), m.column(1), m.column(2));
    let cofactors = Matrix3::from_columns(&[b.cross(&c), c.cross(&a), a.cross(&b)]);
    let determinant = a.dot(&cofactors.column(0));
    let (squares, cofactor_squares) = (m.norm_squared(), cofactors.norm_squared());
    // σ₁ + σ₂ + σ₃ ≤ √3 ‖M‖, from where Newton's method falls to the largest root.
    let mut lambda = (3.0 * squares).sqrt();
    for _ in 0..MAX_NEWTON_STEPS {
        let excess = lambda * lambda - squares;
        let value = excess * excess - 8.0 * lambda * determinant - 4.0 * cofactor_squares;
        let step = value / (4.0 * lambda * excess - 8.0 * determinant);
        lambda -= step;
        if step.abs() <= 1e-12 * lambda {
            break;
        }
    }
    let kappa = 0.5 * (lambda * lambda - squares);
    let zeta = kappa * lambda - determinant;
    let is_clear = zeta > CLEAR_RATIO * lambda.powi(3);
    if !is_clear {
        return None;
    }
    let cubed = product(&m, &transposed_product(&m, &m));
    let near = ((kappa + squares) * m + lambda * cofactors - cubed) / zeta;
    // S = sym(Qᵀ M),  θ = (tr(S) I − S)⁻¹ vex(Qᵀ M − Mᵀ Q)
    let inner = transposed_product(&near, &m);
    let mut hessian = -0.5 * (inner + inner.transpose());
    let trace = inner.trace();
    (0..3).for_each(|i| hessian[(i, i)] += trace);
    let gradient = Vector3::new(
        inner[(2, 1)] - inner[(1, 2)],
        inner[(0, 2)] - inner[(2, 0)],
        inner[(1, 0)] - inner[(0, 1)],
    );
    let turn = Factored::new(&hessian)?.solve(&gradient);
    let turned = near + product(&near, &turn.cross_matrix());
    // Q (3 I − Qᵀ Q) / 2 is orthogonal to the square of how far Q was from it.
    let rest = 1.5 * Matrix3::identity() - 0.5 * transposed_product(&turned, &turned);
    Some(product(&turned, &rest))
}

/// A rotation `Q` with the largest `tr(Qᵀ M)`, by the faster way if that is open.
///
/// # Errors
///
/// As [`nearest_rotation`].
pub fn any_nearest_rotation(matrix: &Matrix3<f64>) -> Result<Matrix3<f64>, AttitudeError> {
    match clear_rotation(matrix) {
        Some(rotation) => Ok(rotation),
        None => Ok(nearest_rotation(matrix)?.rotation),
    }
}

/// The rotation `Q` with the largest `tr(Qᵀ M)`.
///
/// With `M = U Σ Vᵀ` it is `Q = U diag(1, 1, d) Vᵀ`, `d = det(U Vᵀ)`. Both triads are made
/// right-handed from their first two columns, which puts `d` where it belongs and needs no third
/// singular vector: flat arrays, whose `σ₃` is zero, are no special case.
///
/// # Errors
///
/// [`AttitudeError::NotFinite`], and [`AttitudeError::Unobservable`] for a matrix of rank one or
/// zero.
pub fn nearest_rotation(matrix: &Matrix3<f64>) -> Result<NearestRotation, AttitudeError> {
    let largest = matrix.amax();
    if !largest.is_finite() || matrix.iter().any(|c| c.is_nan()) {
        return Err(AttitudeError::NotFinite { what: "attitude profile matrix" });
    }
    if largest == 0.0 {
        return Err(AttitudeError::Unobservable);
    }
    let (columns, v) = orthogonal_columns(&(matrix / largest));
    let [first, second] = two_longest(&columns);
    let sigma = [columns.column(first).norm(), columns.column(second).norm()];
    if sigma[1] <= f64::EPSILON * sigma[0] {
        return Err(AttitudeError::Unobservable);
    }
    let u1 = columns.column(first) / sigma[0];
    let u2 = columns.column(second) / sigma[1];
    let (v1, v2) = (v.column(first).into_owned(), v.column(second).into_owned());
    let u3 = u1.cross(&u2);
    let v3 = v1.cross(&v2);
    let rotation = outer(&u1, &v1) + outer(&u2, &v2) + outer(&u3, &v3);
    let signed_third = u3.dot(&(matrix * v3));
    Ok(NearestRotation {
        rotation,
        singular_values: Vector3::new(sigma[0] * largest, sigma[1] * largest, signed_third),
    })
}

/// One-sided Jacobi method (Hestenes 1958): `M V` with orthogonal columns, and `V`.
///
/// Keeps the relative accuracy of small singular values, which `MᵀM` would lose.
fn orthogonal_columns(matrix: &Matrix3<f64>) -> (Matrix3<f64>, Matrix3<f64>) {
    let mut columns = *matrix;
    let mut v = Matrix3::identity();
    for _ in 0..MAX_SWEEPS {
        let mut turned = false;
        for (i, j) in [(0, 1), (0, 2), (1, 2)] {
            let (a, b) = (columns.column(i).norm_squared(), columns.column(j).norm_squared());
            let product = columns.column(i).dot(&columns.column(j));
            if product * product <= f64::EPSILON * f64::EPSILON * a * b {
                continue;
            }
            turned = true;
            // cot 2φ = (b − a) / 2 aᵢ·aⱼ, smaller root t = tan φ
            let zeta = (b - a) / (2.0 * product);
            let t = zeta.signum() / (zeta.abs() + (1.0 + zeta * zeta).sqrt());
            let c = 1.0 / (1.0 + t * t).sqrt();
            turn_columns(&mut columns, i, j, c, c * t);
            turn_columns(&mut v, i, j, c, c * t);
        }
        if !turned {
            break;
        }
    }
    (columns, v)
}

/// Columns `i, j` ← `c xᵢ − s xⱼ`, `s xᵢ + c xⱼ`.
fn turn_columns(matrix: &mut Matrix3<f64>, i: usize, j: usize, c: f64, s: f64) {
    for row in 0..3 {
        let (x, y) = (matrix[(row, i)], matrix[(row, j)]);
        matrix[(row, i)] = c * x - s * y;
        matrix[(row, j)] = s * x + c * y;
    }
}

/// Indices of the longest and the second longest column.
fn two_longest(columns: &Matrix3<f64>) -> [usize; 2] {
    let mut order = [0, 1, 2];
    order.sort_by(|a, b| {
        columns.column(*b).norm_squared().total_cmp(&columns.column(*a).norm_squared())
    });
    [order[0], order[1]]
}

/// Davenport's q-method: the quaternion `w, x, y, z` (`w ≥ 0`) of the rotation with the largest
/// `tr(Qᵀ M)`, the eigenvector of the largest eigenvalue of `K(Mᵀ)`.
///
/// # Errors
///
/// [`AttitudeError::NotFinite`], and [`AttitudeError::Unobservable`] where the largest eigenvalue
/// is double.
pub fn davenport_quaternion(matrix: &Matrix3<f64>) -> Result<[f64; 4], AttitudeError> {
    if matrix.iter().any(|c| !c.is_finite()) {
        return Err(AttitudeError::NotFinite { what: "attitude profile matrix" });
    }
    let b = matrix.transpose();
    // K = [[tr B, zᵀ], [z, B + Bᵀ − tr(B) I]],  z = (B₂₃ − B₃₂, B₃₁ − B₁₃, B₁₂ − B₂₁)
    let z = Vector3::new(b[(1, 2)] - b[(2, 1)], b[(2, 0)] - b[(0, 2)], b[(0, 1)] - b[(1, 0)]);
    let mut k = Matrix4::zeros();
    k[(0, 0)] = b.trace();
    k.fixed_view_mut::<3, 1>(1, 0).copy_from(&z);
    k.fixed_view_mut::<1, 3>(0, 1).copy_from(&z.transpose());
    let s = b + b.transpose() - b.trace() * Matrix3::identity();
    k.fixed_view_mut::<3, 3>(1, 1).copy_from(&s);

    let eigen = k.symmetric_eigen();
    let mut order = [0, 1, 2, 3];
    order.sort_by(|i, j| eigen.eigenvalues[*j].total_cmp(&eigen.eigenvalues[*i]));
    let (largest, next) = (eigen.eigenvalues[order[0]], eigen.eigenvalues[order[1]]);
    // λ₁ − λ₂ = 2 (σ₂ + d σ₃)
    if largest - next <= 2.0 * UNIQUE_RATIO * largest.abs() {
        return Err(AttitudeError::Unobservable);
    }
    let q = eigen.eigenvectors.column(order[0]).into_owned();
    Ok(if q[0] < 0.0 { -q } else { q }.into())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frames::{Body, Ned, Rotation};
    use proptest::prelude::*;

    fn matrices() -> impl Strategy<Value = Matrix3<f64>> {
        proptest::array::uniform9(-1.0..1.0f64).prop_map(|c| Matrix3::from_row_slice(&c))
    }

    /// Only ratios of the singular values decide whether there is one attitude.
    #[test]
    fn the_scale_of_the_weights_does_not_matter() {
        let matrix = Matrix3::new(3.0, 0.1, 0.0, 0.0, 2.0, 0.2, 0.0, 0.0, 1.0);
        let expected = davenport_quaternion(&matrix).unwrap();
        for scale in [1e-9, 1e-3, 1e6] {
            let found = davenport_quaternion(&(matrix * scale)).unwrap();
            for (found, expected) in found.iter().zip(&expected) {
                assert!((found - expected).abs() < 1e-13, "{scale}");
            }
        }
        let line = Matrix3::from_diagonal(&Vector3::new(3.0, 0.0, 0.0));
        for scale in [1e-9, 1e9] {
            let found = davenport_quaternion(&(line * scale));
            assert_eq!(found, Err(AttitudeError::Unobservable), "{scale}");
        }
    }

    /// Flat arrays give rank two: the answer must be a rotation, never a reflection.
    #[test]
    fn flat_array_gives_no_reflection() {
        let body = [Vector3::new(1.0, 0.0, 0.0), Vector3::new(0.0, 1.0, 0.0)];
        let turned = [Vector3::new(0.0, 0.0, 1.0), Vector3::new(0.0, 1.0, 0.0)];
        let nearest = solve(&body, &turned, &[1.0, 1.0]).unwrap();
        let expected = Matrix3::new(0.0, 0.0, -1.0, 0.0, 1.0, 0.0, 1.0, 0.0, 0.0);
        assert!((nearest - expected).norm() < 1e-15, "{nearest:?}");
    }

    #[test]
    fn wrong_input_is_refused() {
        let x = Vector3::x();
        let line = [x, x * 2.0, x * -1.0];
        assert_eq!(solve(&line, &line, &[1.0; 3]), Err(AttitudeError::Unobservable));
        assert_eq!(solve(&[x], &[x], &[1.0]), Err(AttitudeError::TooFewVectors { found: 1 }));
        assert!(matches!(solve(&line, &line[..2], &[1.0; 3]), Err(AttitudeError::Shape { .. })));
        let weights = [1.0, f64::NAN, 1.0];
        assert!(matches!(solve(&line, &line, &weights), Err(AttitudeError::NotPositive { .. })));
        let nan = Matrix3::repeat(f64::NAN);
        assert!(matches!(nearest_rotation(&nan), Err(AttitudeError::NotFinite { .. })));
        assert_eq!(nearest_rotation(&Matrix3::zeros()), Err(AttitudeError::Unobservable));
    }

    proptest! {
        #[test]
        fn the_characteristic_equation_agrees(m in matrices(), power in -30..30_i32) {
            let nearest = nearest_rotation(&m).unwrap();
            let scaled = m * 10.0_f64.powi(power);
            if let Some(clear) = clear_rotation(&scaled) {
                prop_assert!((clear - nearest.rotation).norm() < 1e-13);
                prop_assert!((clear.determinant() - 1.0).abs() < 1e-14);
            } else {
                let [s1, s2, s3] = nearest.singular_values.into();
                let zeta = (s1 + s2) * (s2 + s3) * (s3 + s1);
                prop_assert!(zeta < 1.01 * CLEAR_RATIO * (s1 + s2 + s3).powi(3));
            }
        }

        /// The two methods share no step.
        #[test]
        fn svd_and_davenport_agree(m in matrices()) {
            let nearest = nearest_rotation(&m).unwrap();
            prop_assert!((nearest.rotation.determinant() - 1.0).abs() < 1e-14);
            let [s1, s2, s3] = nearest.singular_values.into();
            prop_assert!((s1 * s2 * s3 - m.determinant()).abs() < 1e-14);
            prop_assume!(s2 + s3 > 1e-3);
            let q = davenport_quaternion(&m).unwrap();
            let davenport = Rotation::<Ned, Body>::from_quaternion(q).matrix();
            prop_assert!((nearest.rotation - davenport).norm() < 1e-11);
            prop_assert!(((m.transpose() * davenport).trace() - (s1 + s2 + s3)).abs() < 1e-13);
        }

        #[test]
        fn no_input_panics(c in proptest::array::uniform9(proptest::num::f64::ANY)) {
            let m = Matrix3::from_row_slice(&c);
            if let Ok(nearest) = nearest_rotation(&m) {
                prop_assert!((nearest.rotation.determinant() - 1.0).abs() < 1e-12);
            }
            if let Some(clear) = clear_rotation(&m) {
                prop_assert!((clear.determinant() - 1.0).abs() < 1e-12);
            }
            let _ = davenport_quaternion(&m);
        }
    }
}
