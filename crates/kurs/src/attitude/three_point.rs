//! Three measured points A, B, C: the published closed form (equations 18 to 28 of
//! `docs/papers/004-three-antennas.md`).
//!
//! The points are taken for the ends of the legs `d, e, f` of a right-angled corner at `O′`. With
//! `S = 1/d² + 1/e² + 1/f²` and the orthocentre `H = (A/d² + B/e² + C/f²) / S` of the triangle,
//!
//! ```text
//! d² = (B−A)·(C−A),   e² = (A−B)·(C−B),   f² = (A−C)·(B−C)
//! O′ = H − n / √S,    n = (B−A)×(C−A) / ‖·‖
//! M  = [(A−O′)/d, (B−O′)/e, (C−O′)/f]
//! ```
//!
//! This is the regular version: the published one divides by a quantity that vanishes when the
//! plane of the triangle is parallel to an axis, and picks `O′` by a sign that need not hold; here
//! det M = +1 decides. The legs are real only if the triangle is acute, and near a right angle the
//! method magnifies noise tenfold: [`super::coordinates`] has neither weakness.

use nalgebra::{Matrix3, Vector3};

use super::AttitudeError;

/// A leg² below this share of the sides² counts as a right angle.
const RIGHT_ANGLE: f64 = 1e-9;

/// The corner of three points.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Corner {
    /// `O′`.
    pub origin: Vector3<f64>,
    /// `M`: unit vectors from `O′` to A, B and C as columns; a rotation if the points are exact.
    pub axes: Matrix3<f64>,
    /// `d², e², f²`.
    pub squared_legs: [f64; 3],
}

/// `d², e², f²` of the points A, B, C; all are positive exactly if the triangle is acute.
#[must_use]
pub fn squared_legs([a, b, c]: &[Vector3<f64>; 3]) -> [f64; 3] {
    [(b - a).dot(&(c - a)), (a - b).dot(&(c - b)), (a - c).dot(&(b - c))]
}

/// The corner of an acute triangle.
///
/// # Errors
///
/// [`AttitudeError::NotAcute`] for right and obtuse triangles, [`AttitudeError::NotFinite`].
pub fn corner(points: &[Vector3<f64>; 3]) -> Result<Corner, AttitudeError> {
    if points.iter().any(|point| point.iter().any(|c| !c.is_finite())) {
        return Err(AttitudeError::NotFinite { what: "point" });
    }
    let squared_legs = squared_legs(points);
    let longest = squared_legs.iter().fold(0.0_f64, |longest, leg| longest.max(leg.abs()));
    let shortest = squared_legs.iter().fold(f64::INFINITY, |shortest, leg| shortest.min(*leg));
    if shortest.is_nan() || shortest <= RIGHT_ANGLE * longest {
        return Err(AttitudeError::NotAcute { squared_legs_m2: squared_legs });
    }
    // Relative to A, so that distant origins cost no digits.
    let [a, b, c] = *points;
    let (ab, ac) = (b - a, c - a);
    let [d2, e2, f2] = squared_legs;
    let s = 1.0 / d2 + 1.0 / e2 + 1.0 / f2;
    let orthocentre = (ab / e2 + ac / f2) / s;
    let normal = ab.cross(&ac).normalize();
    let from_a = orthocentre - normal / s.sqrt();
    let axes = Matrix3::from_columns(&[
        -from_a / d2.sqrt(),
        (ab - from_a) / e2.sqrt(),
        (ac - from_a) / f2.sqrt(),
    ]);
    Ok(Corner { origin: a + from_a, axes, squared_legs })
}

/// Attitude by the published method: `Q = M Mᵦᵀ` with the corners of the measured points and of the
/// same points in body axes.
///
/// # Errors
///
/// As [`corner`], for either triangle.
pub fn attitude(
    body: &[Vector3<f64>; 3],
    measured: &[Vector3<f64>; 3],
) -> Result<Matrix3<f64>, AttitudeError> {
    Ok(corner(measured)?.axes * corner(body)?.axes.transpose())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::attitude::weighted::exponential;
    use proptest::prelude::*;

    /// `O′` as published (equations 23 to 26, with the ½ and the first equation of 18): both
    /// roots of the quadratic; `None` where the plane of the triangle is parallel to the y axis.
    fn published_origins(points: &[Vector3<f64>; 3]) -> Option<[Vector3<f64>; 2]> {
        let [a, b, c] = *points;
        let [d2, e2, f2] = squared_legs(points);
        let (row1, row3) = (a - b, b - c);
        let c1 = 0.5 * (e2 - d2 + a.norm_squared() - b.norm_squared());
        let c3 = 0.5 * (f2 - e2 + b.norm_squared() - c.norm_squared());
        let q = row1.x * row3.z - row3.x * row1.z;
        if q.abs() < 1e-3 {
            return None;
        }
        // x₀ = k₁ y + b₁,  z₀ = k₂ y + b₂
        let k1 = (row1.z * row3.y - row1.y * row3.z) / q;
        let b1 = (row3.z * c1 - row1.z * c3) / q;
        let k2 = (row1.y * row3.x - row1.x * row3.y) / q;
        let b2 = (row1.x * c3 - row3.x * c1) / q;
        // A y² − 2 B y + C = 0
        let qa = 1.0 + k1 * k1 + k2 * k2;
        let qb = k1 * (a.x - b1) + k2 * (a.z - b2) + a.y;
        let qc = (b1 - a.x).powi(2) + (b2 - a.z).powi(2) + a.y * a.y - d2;
        let root = (qb * qb - qa * qc).sqrt();
        Some([1.0, -1.0].map(|sign| {
            let y = (qb + sign * root) / qa;
            Vector3::new(k1 * y + b1, y, k2 * y + b2)
        }))
    }

    fn triangles() -> impl Strategy<Value = [Vector3<f64>; 3]> {
        proptest::array::uniform9(-1.0..1.0f64)
            .prop_map(|c| [0, 3, 6].map(|start| Vector3::new(c[start], c[start + 1], c[start + 2])))
    }

    proptest! {
        #[test]
        fn regular_form_is_one_of_the_published_roots(points in triangles()) {
            let Ok(found) = corner(&points) else { return Ok(()) };
            prop_assume!(found.squared_legs.iter().all(|leg| *leg > 0.05));
            prop_assert!((found.axes.transpose() * found.axes - Matrix3::identity()).norm() < 1e-12);
            prop_assert!((found.axes.determinant() - 1.0).abs() < 1e-12);
            if let Some(roots) = published_origins(&points) {
                let nearest = roots.map(|root| (root - found.origin).norm());
                prop_assert!(nearest[0].min(nearest[1]) < 1e-8, "{nearest:?}");
                prop_assert!(nearest[0].max(nearest[1]) > 1e-2, "the other root is a mirror image");
            }
        }

        #[test]
        fn exact_points_give_the_rotation(points in triangles(), v in proptest::array::uniform3(-3.0..3.0f64)) {
            let q = exponential(&Vector3::from(v));
            let moved = points.map(|point| q * point + Vector3::new(10.0, -20.0, 30.0));
            let legs = squared_legs(&points);
            match attitude(&points, &moved) {
                Ok(found) if legs.iter().all(|leg| *leg > 0.01) => {
                    prop_assert!((found - q).norm() < 1e-10);
                }
                Ok(_) => {}
                Err(AttitudeError::NotAcute { .. }) => prop_assert!(legs.iter().any(|leg| *leg < 1e-6)),
                Err(other) => prop_assert!(false, "{other}"),
            }
        }
    }

    #[test]
    fn right_and_obtuse_triangles_are_refused() {
        let right = [Vector3::zeros(), Vector3::x(), Vector3::y()];
        let obtuse = [Vector3::zeros(), Vector3::x(), Vector3::new(-0.2, 1.0, 0.0)];
        for points in [right, obtuse] {
            let error = corner(&points).unwrap_err();
            assert!(matches!(error, AttitudeError::NotAcute { .. }));
            assert!(error.to_string().contains("weighted method"), "{error}");
        }
        let same = [Vector3::x(); 3];
        assert!(matches!(corner(&same), Err(AttitudeError::NotAcute { .. })));
    }
}
