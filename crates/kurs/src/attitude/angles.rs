//! From covariances of turns to those of heading, pitch and roll, and the attitude of one body
//! relative to another.

use nalgebra::Matrix3;

use crate::frames::{Attitude, Body, Ned, Rotation};
use crate::solution::AttitudeEstimate;

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

/// The small rotation `θ` in body axes that small changes of heading, pitch and roll are: the inverse of
/// [`angles_from_rotation_vector`], finite at every attitude.
///
/// ```text
/// θx = roll′ − heading′ sin p
/// θy = pitch′ cos r + heading′ cos p sin r
/// θz = heading′ cos p cos r − pitch′ sin r
/// ```
#[must_use]
pub fn rotation_vector_from_angles(attitude: &Attitude) -> Matrix3<f64> {
    let (sin_roll, cos_roll) = attitude.roll_rad.sin_cos();
    let (sin_pitch, cos_pitch) = attitude.pitch_rad.sin_cos();
    Matrix3::new(
        -sin_pitch,
        0.0,
        1.0,
        cos_pitch * sin_roll,
        cos_roll,
        0.0,
        cos_pitch * cos_roll,
        -sin_roll,
        0.0,
    )
}

/// Covariance of `(heading, pitch, roll)`, rad², from that of the rotation vector in body axes.
#[must_use]
pub fn angle_covariance(attitude: &Attitude, covariance_body_rad2: &Matrix3<f64>) -> Matrix3<f64> {
    let jacobian = angles_from_rotation_vector(attitude);
    jacobian * covariance_body_rad2 * jacobian.transpose()
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
            installation_rad2: Matrix3::zeros(),
            ned_from_body: Some(ned_from_body),
            line_elevation_rad: None,
        }
    }

    /// The attitude where the part `installation_body_rad2` of its covariance comes
    /// from the survey of the antennas ([`super::installation`]).
    #[must_use]
    pub fn with_installation(mut self, installation_body_rad2: &Matrix3<f64>) -> Self {
        if let Some(ned_from_body) = &self.ned_from_body {
            let angles = Attitude::from_ned_from_body(ned_from_body);
            self.installation_rad2 = angle_covariance(&angles, installation_body_rad2);
        }
        self
    }

    /// Covariance of the rotation vector in body axes, rad²; zero where not all angles are known.
    #[must_use]
    pub fn turn_covariance_rad2(&self) -> Matrix3<f64> {
        let of = |ned_from_body: &Rotation<Ned, Body>| {
            let turn = rotation_vector_from_angles(&Attitude::from_ned_from_body(ned_from_body));
            turn * self.covariance_rad2 * turn.transpose()
        };
        self.ned_from_body.as_ref().map_or_else(Matrix3::zeros, of)
    }

    /// Heading, pitch and roll, where they are known.
    #[must_use]
    pub const fn angles_rad(&self) -> [Option<f64>; 3] {
        [self.heading_rad, self.pitch_rad, self.roll_rad]
    }

    /// Covariance of heading, pitch, roll without the part that the survey of the antennas causes,
    /// rad²: what differs from epoch to epoch.
    #[must_use]
    pub fn noise_rad2(&self) -> Matrix3<f64> {
        self.covariance_rad2 - self.installation_rad2
    }

    /// The attitude without angles whose standard deviation is above `max_sd_rad`.
    #[must_use]
    pub fn certain_to(mut self, max_sd_rad: f64) -> Self {
        let angles = [&mut self.heading_rad, &mut self.pitch_rad, &mut self.roll_rad];
        for (k, angle) in angles.into_iter().enumerate() {
            let is_certain = self.covariance_rad2[(k, k)] <= max_sd_rad * max_sd_rad;
            *angle = angle.filter(|_| is_certain);
        }
        let is_whole = self.angles_rad().iter().all(Option::is_some);
        self.ned_from_body = self.ned_from_body.filter(|_| is_whole);
        self
    }
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
    use nalgebra::Vector3;
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
            let back = rotation_vector_from_angles(&attitude) * jacobian;
            prop_assert!((back - Matrix3::identity()).norm() < 1e-9);
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

    /// An angle less certain than the limit is no number, and without it there is no whole attitude.
    #[test]
    fn uncertain_angles_are_left_out() {
        let level = Attitude { heading_rad: 1.0, pitch_rad: 0.0, roll_rad: 0.0 }.ned_from_body();
        // Body axes: roll about x, pitch about y, heading about z.
        let covariance = Matrix3::from_diagonal(&Vector3::new(9e-4, 1e-4, 4e-4));
        let all = AttitudeEstimate::full(level, &covariance);
        assert_eq!(all.certain_to(0.0301), all);
        let some = all.certain_to(0.0299);
        assert!((some.heading_rad.unwrap() - 1.0).abs() < 1e-12);
        assert_eq!((some.pitch_rad, some.roll_rad, some.ned_from_body), (Some(0.0), None, None));
        assert_eq!(all.certain_to(0.005).angles_rad(), [None; 3]);
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
