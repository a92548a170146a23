//! From covariances of turns to those of heading, pitch and roll, and the attitude of one body
//! relative to another.

use nalgebra::{Matrix2, Matrix2x3, Matrix3, Vector3};

use crate::frames::{Attitude, Body, Ned, Rotation, Vector, wrap_heading};
use crate::solution::AttitudeEstimate;

/// An axis with less than this share of its length in the x–z plane of the body lies across it and
/// says nothing of the pitch.
const LATERAL: f64 = 0.1;
/// A direction this close to the vertical has no heading: cosine of its angle with the horizon.
const VERTICAL: f64 = 1e-6;

/// `∂(heading, pitch, roll) / ∂θ` for a small rotation `θ` in body axes.
///
/// ```text
/// roll′    = θx + tan p (θy sin r + θz cos r)
/// pitch′   = θy cos r − θz sin r
/// heading′ = (θy sin r + θz cos r) / cos p
/// ```
///
/// At pitch ±90° heading and roll have no variances of their own: the entries grow without limit.
#[must_use]
pub fn angles_from_rotation_vector(attitude: &Attitude) -> Matrix3<f64> {
    let (sin_roll, cos_roll) = attitude.roll_rad.sin_cos();
    let (sin_pitch, cos_pitch) = attitude.pitch_rad.sin_cos();
    let tan_pitch = sin_pitch / cos_pitch;
    Matrix3::new(
        0.0,
        sin_roll / cos_pitch,
        cos_roll / cos_pitch,
        0.0,
        cos_roll,
        -sin_roll,
        1.0,
        tan_pitch * sin_roll,
        tan_pitch * cos_roll,
    )
}

/// Covariance of `(heading, pitch, roll)`, rad², from that of the rotation vector in body axes.
#[must_use]
pub fn angle_covariance(attitude: &Attitude, covariance_body_rad2: &Matrix3<f64>) -> Matrix3<f64> {
    let jacobian = angles_from_rotation_vector(attitude);
    jacobian * covariance_body_rad2 * jacobian.transpose()
}

/// Heading and pitch of a body of which one axis is known.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HeadingPitch {
    /// Clockwise from true north, `0 ≤ heading_rad < 2π`.
    pub heading_rad: f64,
    /// Nose up positive; `None` for antennas abreast, which see roll instead.
    pub pitch_rad: Option<f64>,
    /// Covariance of heading and pitch, rad²; the entries of an absent pitch are zero.
    pub covariance_rad2: Matrix2<f64>,
}

/// Heading and pitch of a body that does not roll, whose `axis` (unit vector) points along
/// `direction` (unit vector, with its covariance in rad²).
///
/// From `u = Rz(heading) Ry(pitch) e`: `pitch = α − asin(u_d / ρ)` with `e = (ρ cos α, e_y, ρ sin α)`
/// (or the other branch of the arcsine, whichever is nearer to level), then
/// `heading = atan2(u_e, u_n) − atan2(e_y, cos p e_x + sin p e_z)`. For the forward axis this is the
/// heading and the pitch of the direction itself. `None` for a vertical direction.
#[must_use]
pub fn heading_pitch(
    axis: &Vector<Body>,
    direction: &Vector<Ned>,
    covariance_rad2: &Matrix3<f64>,
) -> Option<HeadingPitch> {
    let (e, u) = (axis.xyz(), direction.xyz());
    let share = e.x.hypot(e.z);
    let horizontal2 = u.x * u.x + u.y * u.y;
    if horizontal2.is_nan() || horizontal2 <= VERTICAL * VERTICAL {
        return None;
    }
    // ∂atan2(u_e, u_n)/∂u
    let azimuth_gradient = Vector3::new(-u.y, u.x, 0.0) / horizontal2;
    if share < LATERAL {
        let heading_rad = wrap_heading(u.y.atan2(u.x) - e.y.atan2(e.x));
        let variance = azimuth_gradient.dot(&(covariance_rad2 * azimuth_gradient));
        let covariance_rad2 = Matrix2::new(variance, 0.0, 0.0, 0.0);
        return Some(HeadingPitch { heading_rad, pitch_rad: None, covariance_rad2 });
    }
    let alpha = e.z.atan2(e.x);
    let rise = (u.z / share).clamp(-1.0, 1.0);
    let branches =
        [alpha - rise.asin(), alpha - core::f64::consts::PI + rise.asin()].map(wrap_half);
    let is_first = branches[0].abs() <= branches[1].abs();
    let pitch = if is_first { branches[0] } else { branches[1] };
    let (sin_pitch, cos_pitch) = pitch.sin_cos();
    let forward = cos_pitch * e.x + sin_pitch * e.z;
    let heading_rad = wrap_heading(u.y.atan2(u.x) - e.y.atan2(forward));

    // ∂p/∂u_d = ∓1 / √(ρ² − u_d²);  ∂atan2(e_y, x′)/∂p = −e_y u_d / (x′² + e_y²)
    let root = (share * share - u.z * u.z).max(0.0).sqrt();
    let pitch_gradient = Vector3::new(0.0, 0.0, if is_first { -1.0 } else { 1.0 } / root);
    let by_pitch = e.y * u.z / (forward * forward + e.y * e.y);
    let heading_gradient = azimuth_gradient + by_pitch * pitch_gradient;
    let jacobian =
        Matrix2x3::from_rows(&[heading_gradient.transpose(), pitch_gradient.transpose()]);
    Some(HeadingPitch {
        heading_rad,
        pitch_rad: Some(pitch),
        covariance_rad2: jacobian * covariance_rad2 * jacobian.transpose(),
    })
}

impl AttitudeEstimate {
    /// All three angles of a known attitude; the covariance is that of the rotation vector in body
    /// axes, rad².
    #[must_use]
    pub fn full(ned_from_body: Rotation<Ned, Body>, covariance_body_rad2: &Matrix3<f64>) -> Self {
        let angles = Attitude::from_ned_from_body(&ned_from_body);
        Self {
            heading_rad: Some(angles.heading_rad),
            pitch_rad: Some(angles.pitch_rad),
            roll_rad: Some(angles.roll_rad),
            covariance_rad2: angle_covariance(&angles, covariance_body_rad2),
            ned_from_body: Some(ned_from_body),
        }
    }

    /// Heading and pitch of a body that does not roll, from one of its axes as [`heading_pitch`].
    #[must_use]
    pub fn of_axis(
        axis: &Vector<Body>,
        direction: &Vector<Ned>,
        covariance_rad2: &Matrix3<f64>,
    ) -> Option<Self> {
        let angles = heading_pitch(axis, direction, covariance_rad2)?;
        let mut covariance_rad2 = Matrix3::zeros();
        covariance_rad2.fixed_view_mut::<2, 2>(0, 0).copy_from(&angles.covariance_rad2);
        Some(Self {
            heading_rad: Some(angles.heading_rad),
            pitch_rad: angles.pitch_rad,
            roll_rad: None,
            covariance_rad2,
            ned_from_body: None,
        })
    }
}

/// The same angle in `(−π, π]`.
fn wrap_half(angle_rad: f64) -> f64 {
    let wrapped = wrap_heading(angle_rad);
    if wrapped > core::f64::consts::PI { wrapped - core::f64::consts::TAU } else { wrapped }
}

/// Attitude of a second body as seen from a first one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RelativeOrientation {
    /// Components in the axes of the second body to components in those of the first.
    pub first_from_second: Rotation<Body, Body>,
    /// Covariance of the rotation vector in the axes of the second body, rad².
    pub covariance_rad2: Matrix3<f64>,
}

/// Relative orientation of two bodies whose attitudes have independent errors.
///
/// `R = R₁ᵀ R₂`; errors `R₁ exp[θ₁]×`, `R₂ exp[θ₂]×` give `R exp[θ₂ − Rᵀ θ₁]×`, hence
/// `P = P₂ + Rᵀ P₁ R`. The local level axes must be the same: bodies a distance `d` apart see theirs
/// tilted by `d` over the radius of the Earth (0.001° for 100 m).
#[must_use]
pub fn relative_orientation(
    (first, first_covariance_rad2): (&Rotation<Ned, Body>, &Matrix3<f64>),
    (second, second_covariance_rad2): (&Rotation<Ned, Body>, &Matrix3<f64>),
) -> RelativeOrientation {
    let first_from_second = first.inverse() * *second;
    let turned = first_from_second.inverse().turn_covariance(first_covariance_rad2);
    RelativeOrientation { first_from_second, covariance_rad2: second_covariance_rad2 + turned }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::attitude::weighted::exponential;
    use crate::frames::skew;
    use proptest::prelude::*;

    fn turned(attitude: &Attitude, theta: Vector3<f64>) -> Vector3<f64> {
        let matrix = attitude.ned_from_body().matrix() * exponential(&theta);
        let angles = Attitude::from_ned_from_body(&Rotation::from_matrix(matrix));
        Vector3::new(angles.heading_rad, angles.pitch_rad, angles.roll_rad)
    }

    proptest! {
        #[test]
        fn jacobian_against_central_differences(
            heading_rad in 0.5..5.5f64, pitch_rad in -1.2..1.2f64, roll_rad in -3.0..3.0f64,
        ) {
            let attitude = Attitude { heading_rad, pitch_rad, roll_rad };
            let jacobian = angles_from_rotation_vector(&attitude);
            for axis in 0..3 {
                let mut theta = Vector3::zeros();
                theta[axis] = 1e-5;
                let difference = (turned(&attitude, theta) - turned(&attitude, -theta)) / 2e-5;
                prop_assert!((difference - jacobian.column(axis)).norm() < 1e-7);
            }
        }

        #[test]
        fn axis_of_a_level_body(
            heading_rad in 0.0..6.2f64, pitch_rad in -0.9..0.9f64,
            x in 0.3..1.0f64, y in -0.5..0.5f64, z in -0.3..0.3f64, is_back in proptest::bool::ANY,
        ) {
            let sign = if is_back { -1.0 } else { 1.0 };
            let axis = Vector::<Body>::new(sign * x, y, z).direction();
            prop_assume!(axis.xyz().y.abs() < 0.7);
            // Beyond the vertical the same line belongs to the opposite heading.
            let forward = axis.xyz().x * pitch_rad.cos() + axis.xyz().z * pitch_rad.sin();
            prop_assume!(sign * forward > 0.1);
            let attitude = Attitude { heading_rad, pitch_rad, roll_rad: 0.0 };
            let direction = attitude.ned_from_body() * axis;
            let found = heading_pitch(&axis, &direction, &Matrix3::identity()).unwrap();
            prop_assert!(wrap_half(found.heading_rad - heading_rad).abs() < 1e-9);
            prop_assert!((found.pitch_rad.unwrap() - pitch_rad).abs() < 1e-9);
            // Covariance: central differences over turns of the direction.
            let mut expected = Matrix2::zeros();
            for across in [0, 1, 2] {
                let moved = |step: f64| {
                    let mut turn = Vector3::zeros();
                    turn[across] = step;
                    let turned = Vector::from_xyz(direction.xyz() + skew(&turn) * direction.xyz());
                    let angles = heading_pitch(&axis, &turned, &Matrix3::zeros()).unwrap();
                    nalgebra::Vector2::new(
                        wrap_half(angles.heading_rad - heading_rad),
                        angles.pitch_rad.unwrap() - pitch_rad,
                    )
                };
                let gradient = (moved(1e-5) - moved(-1e-5)) / 2e-5;
                expected += gradient * gradient.transpose();
            }
            // Turns with unit variance about all axes: P = [u]× [u]×ᵀ.
            let across = skew(&direction.xyz());
            let found = heading_pitch(&axis, &direction, &(across * across.transpose())).unwrap();
            prop_assert!((found.covariance_rad2 - expected).norm() < 1e-6 * expected.norm());
        }

        /// The formula for the relative error, against errors put in.
        #[test]
        fn relative_error(
            a in proptest::array::uniform3(-3.0..3.0f64), b in proptest::array::uniform3(-3.0..3.0f64),
            e in proptest::array::uniform3(-1e-5..1e-5f64), f in proptest::array::uniform3(-1e-5..1e-5f64),
        ) {
            let [r1, r2] = [a, b].map(|v| exponential(&Vector3::from(v)));
            let [t1, t2] = [e, f].map(Vector3::from);
            let exact = (r1 * exponential(&t1)).transpose() * r2 * exponential(&t2);
            let r = r1.transpose() * r2;
            let linear = r * exponential(&(t2 - r.transpose() * t1));
            prop_assert!((exact - linear).norm() < 1e-9);
        }
    }

    #[test]
    fn antennas_abreast_give_no_pitch() {
        let east = Vector::<Ned>::new(0.0, 1.0, 0.0);
        let right = Vector::<Body>::new(0.0, 1.0, 0.0);
        let found = heading_pitch(&right, &east, &(4e-6 * Matrix3::identity())).unwrap();
        assert_eq!(found.pitch_rad, None);
        assert!(found.heading_rad.abs() < 1e-15, "{found:?}");
        assert!((found.covariance_rad2[(0, 0)] - 4e-6).abs() < 1e-18);
        let up = Vector::<Ned>::new(0.0, 0.0, -1.0);
        assert_eq!(heading_pitch(&right, &up, &Matrix3::identity()), None);
    }

    #[test]
    fn covariances_of_two_bodies_add_in_the_axes_of_the_second() {
        let level = Attitude { heading_rad: 0.0, pitch_rad: 0.0, roll_rad: 0.0 }.ned_from_body();
        let east = Attitude {
            heading_rad: 0.5 * core::f64::consts::PI,
            ..Attitude { heading_rad: 0.0, pitch_rad: 0.0, roll_rad: 0.0 }
        }
        .ned_from_body();
        let first = Matrix3::from_diagonal(&Vector3::new(1.0, 4.0, 9.0));
        let relative = relative_orientation((&level, &first), (&east, &Matrix3::identity()));
        // The first body's roll axis (north) is the second's negative y axis.
        let expected = Matrix3::from_diagonal(&Vector3::new(5.0, 2.0, 10.0));
        assert!((relative.covariance_rad2 - expected).norm() < 1e-12);
    }
}
