//! TRIAD (Black 1964): the attitude from two vectors, of which the first is met exactly.

use nalgebra::{Matrix3, Vector3};

use super::AttitudeError;

/// Sine of the angle between the two vectors below which they are one line.
const COLLINEAR_SINE: f64 = 1e-9;

/// `Q` with `Q b₁` along `m₁` and `Q b₂` in the half plane of `m₁` and `m₂`.
///
/// # Errors
///
/// [`AttitudeError::NotFinite`]; [`AttitudeError::Unobservable`] for zero or collinear vectors.
pub fn triad(
    body: [&Vector3<f64>; 2],
    measured: [&Vector3<f64>; 2],
) -> Result<Matrix3<f64>, AttitudeError> {
    Ok(axes(measured)? * axes(body)?.transpose())
}

/// Right-handed axes: the first vector, the normal of both, and the third.
fn axes([first, second]: [&Vector3<f64>; 2]) -> Result<Matrix3<f64>, AttitudeError> {
    let normal = first.cross(second);
    let (scale, across) = (first.norm() * second.norm(), normal.norm());
    if !scale.is_finite() {
        return Err(AttitudeError::NotFinite { what: "vector" });
    }
    if across <= COLLINEAR_SINE * scale {
        return Err(AttitudeError::Unobservable);
    }
    let (x, y) = (first / first.norm(), normal / across);
    Ok(Matrix3::from_columns(&[x, y, x.cross(&y)]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::attitude::weighted::exponential;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn exact_vectors_give_the_rotation(
            v in proptest::array::uniform3(-3.0..3.0f64),
            a in proptest::array::uniform3(-1.0..1.0f64), b in proptest::array::uniform3(-1.0..1.0f64),
        ) {
            let (a, b) = (Vector3::from(a), Vector3::from(b));
            prop_assume!(a.cross(&b).norm() > 1e-3);
            let q = exponential(&Vector3::from(v));
            let found = triad([&a, &b], [&(q * a), &(q * b)]).unwrap();
            prop_assert!((found - q).norm() < 1e-11);
            // The second vector may turn about the first one's plane without changing anything.
            let bent = triad([&a, &b], [&(q * a), &(q * (b + 0.3 * a))]).unwrap();
            prop_assert!((bent - q).norm() < 1e-11);
        }
    }

    #[test]
    fn lines_are_refused() {
        let (x, y) = (Vector3::x(), Vector3::y());
        assert_eq!(triad([&x, &x], [&x, &y]), Err(AttitudeError::Unobservable));
        assert_eq!(triad([&x, &y], [&x, &Vector3::zeros()]), Err(AttitudeError::Unobservable));
        let nan = triad([&x, &y], [&x, &Vector3::repeat(f64::NAN)]);
        assert!(matches!(nan, Err(AttitudeError::NotFinite { .. })));
    }
}
