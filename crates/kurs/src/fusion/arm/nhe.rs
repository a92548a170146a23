//! The axes and angles of the rotating-frame paper, and their way to those of Kurs.
//!
//! Local axes NHE: north, up ("height"), east. Body axes BFS: forward (roll axis), up (heading
//! axis), right (pitch axis). Both are right-handed, but all three angles turn left-handed about
//! their axes: heading is the compass heading, **pitch above zero is nose down and roll above zero
//! is right side up**, opposite to [`Attitude`]. The paper's matrix is kept; [`Angles::attitude`]
//! and [`Angles::from_attitude`] convert.

use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};

use crate::frames::Attitude;

/// Roll, pitch, heading of the paper, rad.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Angles {
    /// Right side up positive.
    pub roll_rad: f64,
    /// Nose down positive.
    pub pitch_rad: f64,
    /// Clockwise from north.
    pub heading_rad: f64,
}

/// Forward-right-down components from forward-up-right ones; also north-east-down from
/// north-up-east.
#[must_use]
pub const fn frd_from_bfs() -> Matrix3<f64> {
    Matrix3::new(1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, -1.0, 0.0)
}

impl Angles {
    /// T_BN, equation (40): NHE components from BFS components, T₃(h) T₂(p) T₁(r).
    #[must_use]
    pub fn nhe_from_body(&self) -> Matrix3<f64> {
        let (sr, cr) = self.roll_rad.sin_cos();
        let (sp, cp) = self.pitch_rad.sin_cos();
        let (sh, ch) = self.heading_rad.sin_cos();
        Matrix3::new(
            ch * cp,
            ch * sp * cr + sh * sr,
            ch * sp * sr - sh * cr,
            -sp,
            cp * cr,
            cp * sr,
            sh * cp,
            sh * sp * cr - ch * sr,
            sh * sp * sr + ch * cr,
        )
    }

    /// The angles of a rotation; at pitch ±90° roll is set to zero.
    #[must_use]
    pub fn from_nhe_from_body(m: &Matrix3<f64>) -> Self {
        let pitch_rad = (-m[(1, 0)]).clamp(-1.0, 1.0).asin();
        if m[(1, 0)].abs() > 1.0 - 1e-12 {
            // Only h ∓ r can be told apart: the third column is (∓sin(h ∓ r), 0, cos(h ∓ r)).
            return Self { roll_rad: 0.0, pitch_rad, heading_rad: (-m[(0, 2)]).atan2(m[(2, 2)]) };
        }
        Self {
            roll_rad: m[(1, 2)].atan2(m[(1, 1)]),
            pitch_rad,
            heading_rad: m[(2, 0)].atan2(m[(0, 0)]),
        }
    }

    /// The rotation from body axes to level ones as a quaternion.
    #[must_use]
    pub fn quaternion(&self) -> UnitQuaternion<f64> {
        let rotation = Rotation3::from_matrix_unchecked(self.nhe_from_body());
        UnitQuaternion::from_rotation_matrix(&rotation)
    }

    /// Heading, pitch and roll as Kurs reports them.
    #[must_use]
    pub fn attitude(&self) -> Attitude {
        Attitude {
            heading_rad: self.heading_rad.rem_euclid(core::f64::consts::TAU),
            pitch_rad: -self.pitch_rad,
            roll_rad: -self.roll_rad,
        }
    }

    /// From heading, pitch and roll as Kurs reports them.
    #[must_use]
    pub const fn from_attitude(attitude: &Attitude) -> Self {
        Self {
            roll_rad: -attitude.roll_rad,
            pitch_rad: -attitude.pitch_rad,
            heading_rad: attitude.heading_rad,
        }
    }

    /// E with ω = E (ṙ, ṗ, ḣ): angular velocity of the body relative to NHE, in body axes; also
    /// the small rotation in body axes that small changes of the angles make.
    #[must_use]
    pub fn rate_matrix(&self) -> Matrix3<f64> {
        let (sr, cr) = self.roll_rad.sin_cos();
        let (sp, cp) = self.pitch_rad.sin_cos();
        // ω = −(ṙ − ḣ sp, −ṗ sr + ḣ cr cp, ṗ cr + ḣ sr cp)
        -Matrix3::new(1.0, 0.0, -sp, 0.0, -sr, cr * cp, 0.0, cr, sr * cp)
    }

    /// Body rate and angular acceleration of given rates and second derivatives of the angles, with
    /// their derivatives.
    #[must_use]
    pub fn rotation(&self, rates: &Vector3<f64>, accelerations: &Vector3<f64>) -> EulerRotation {
        let (sr, cr) = self.roll_rad.sin_cos();
        let (sp, cp) = self.pitch_rad.sin_cos();
        let [r1, p1, h1] = [rates.x, rates.y, rates.z];
        let [r2, p2, h2] = [accelerations.x, accelerations.y, accelerations.z];
        let rate_matrix = self.rate_matrix();
        // ω̇ = −( r̈ − ḧ sp − ḣṗ cp,
        //        −p̈ sr − ṗṙ cr + ḧ cr cp − ḣṙ sr cp − ḣṗ cr sp,
        //         p̈ cr − ṗṙ sr + ḧ sr cp + ḣṙ cr cp − ḣṗ sr sp )
        let acceleration = -Vector3::new(
            r2 - h2 * sp - h1 * p1 * cp,
            -p2 * sr - p1 * r1 * cr + h2 * cr * cp - h1 * r1 * sr * cp - h1 * p1 * cr * sp,
            p2 * cr - p1 * r1 * sr + h2 * sr * cp + h1 * r1 * cr * cp - h1 * p1 * sr * sp,
        );
        let rate_by_angles = -Matrix3::from_columns(&[
            Vector3::new(0.0, -p1 * cr - h1 * sr * cp, -p1 * sr + h1 * cr * cp),
            Vector3::new(-h1 * cp, -h1 * cr * sp, -h1 * sr * sp),
            Vector3::zeros(),
        ]);
        let acceleration_by_angles = -Matrix3::from_columns(&[
            Vector3::new(
                0.0,
                -p2 * cr + p1 * r1 * sr - h2 * sr * cp - h1 * r1 * cr * cp + h1 * p1 * sr * sp,
                -p2 * sr - p1 * r1 * cr + h2 * cr * cp - h1 * r1 * sr * cp - h1 * p1 * cr * sp,
            ),
            Vector3::new(
                -h2 * cp + h1 * p1 * sp,
                -h2 * cr * sp + h1 * r1 * sr * sp - h1 * p1 * cr * cp,
                -h2 * sr * sp - h1 * r1 * cr * sp - h1 * p1 * sr * cp,
            ),
            Vector3::zeros(),
        ]);
        let acceleration_by_rates = -Matrix3::from_columns(&[
            Vector3::new(0.0, -p1 * cr - h1 * sr * cp, -p1 * sr + h1 * cr * cp),
            Vector3::new(-h1 * cp, -r1 * cr - h1 * cr * sp, -r1 * sr - h1 * sr * sp),
            Vector3::new(-p1 * cp, -r1 * sr * cp - p1 * cr * sp, r1 * cr * cp - p1 * sr * sp),
        ]);
        EulerRotation {
            rate_matrix,
            rate_radps: rate_matrix * rates,
            acceleration_radps2: acceleration,
            rate_by_angles,
            acceleration_by_angles,
            acceleration_by_rates,
        }
    }
}

/// Body rate ω and angular acceleration ω̇ in body axes, with their derivatives by the angles, their
/// rates and (both times [`EulerRotation::rate_matrix`]) the next derivative up.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EulerRotation {
    /// E: ∂φ/∂(r,p,h) = ∂ω/∂(ṙ,ṗ,ḣ) = ∂ω̇/∂(r̈,p̈,ḧ).
    pub rate_matrix: Matrix3<f64>,
    /// ω.
    pub rate_radps: Vector3<f64>,
    /// ω̇.
    pub acceleration_radps2: Vector3<f64>,
    /// ∂ω/∂(r,p,h).
    pub rate_by_angles: Matrix3<f64>,
    /// ∂ω̇/∂(r,p,h).
    pub acceleration_by_angles: Matrix3<f64>,
    /// ∂ω̇/∂(ṙ,ṗ,ḣ).
    pub acceleration_by_rates: Matrix3<f64>,
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn angles(v: &Vector3<f64>) -> Angles {
        Angles { roll_rad: v.x, pitch_rad: v.y, heading_rad: v.z }
    }

    fn triple(limit: f64) -> impl Strategy<Value = Vector3<f64>> {
        (-limit..limit, -limit..limit, -limit..limit).prop_map(|(x, y, z)| Vector3::new(x, y, z))
    }

    /// Central difference of a vector function along each axis of its argument.
    fn differences(
        f: impl Fn(&Vector3<f64>) -> Vector3<f64>,
        at: &Vector3<f64>,
        step: f64,
    ) -> Matrix3<f64> {
        Matrix3::from_columns(&[0, 1, 2].map(|axis| {
            let mut h = Vector3::zeros();
            h[axis] = step;
            (f(&(at + h)) - f(&(at - h))) / (2.0 * step)
        }))
    }

    proptest! {
        #[test]
        fn angles_return_from_their_matrix(
            r in -3.1..3.1f64, p in -1.57..1.57f64, h in -3.1..3.1f64,
        ) {
            let there = Angles { roll_rad: r, pitch_rad: p, heading_rad: h };
            let back = Angles::from_nhe_from_body(&there.nhe_from_body());
            prop_assert!((back.nhe_from_body() - there.nhe_from_body()).norm() < 1e-12);
            prop_assert!((there.nhe_from_body().determinant() - 1.0).abs() < 1e-12);
        }

        /// The paper's rotation and the one of `Attitude` are the same, seen in other axes.
        #[test]
        fn agrees_with_ned_from_body(v in triple(1.5)) {
            let turn = frd_from_bfs();
            let ned_from_frd = turn * angles(&v).nhe_from_body() * turn.transpose();
            let expected = angles(&v).attitude().ned_from_body().matrix();
            prop_assert!((ned_from_frd - expected).norm() < 1e-12);
            let again = Angles::from_attitude(&angles(&v).attitude());
            prop_assert!((again.nhe_from_body() - angles(&v).nhe_from_body()).norm() < 1e-12);
        }

        /// C(t)ᵀ Ċ(t) = [ω×], by difference of the matrix along a straight line of the angles.
        #[test]
        fn body_rate_is_the_turning_of_the_matrix(v in triple(1.4), rates in triple(2.0)) {
            let step = 1e-5;
            let c = |t: f64| angles(&(v + rates * t)).nhe_from_body();
            let skew = c(0.0).transpose() * (c(step) - c(-step)) / (2.0 * step);
            let omega = angles(&v).rotation(&rates, &Vector3::zeros()).rate_radps;
            prop_assert!((skew - omega.cross_matrix()).norm() < 1e-8);
        }

        #[test]
        fn derivatives_agree_with_differences(
            v in triple(1.4), rates in triple(2.0), accelerations in triple(2.0),
        ) {
            let at = angles(&v).rotation(&rates, &accelerations);
            let rate = |a: &Vector3<f64>| angles(a).rotation(&rates, &accelerations).rate_radps;
            let acceleration_of = |a: &Vector3<f64>, b: &Vector3<f64>| {
                angles(a).rotation(b, &accelerations).acceleration_radps2
            };
            let step = 1e-5;
            prop_assert!((differences(rate, &v, step) - at.rate_by_angles).norm() < 1e-8);
            let by_angles = differences(|a| acceleration_of(a, &rates), &v, step);
            prop_assert!((by_angles - at.acceleration_by_angles).norm() < 1e-8);
            let by_rates = differences(|b| acceleration_of(&v, b), &rates, step);
            prop_assert!((by_rates - at.acceleration_by_rates).norm() < 1e-8);
            // ω̇ is the time derivative of ω when angles and rates move along.
            let moved = |t: f64| {
                let moved = v + rates * t + accelerations * (t * t / 2.0);
                angles(&moved).rotation(&(rates + accelerations * t), &accelerations).rate_radps
            };
            let by_time = (moved(step) - moved(-step)) / (2.0 * step);
            prop_assert!((by_time - at.acceleration_radps2).norm() < 1e-8);
        }
    }

    #[test]
    fn straight_up_has_a_heading() {
        let up =
            Angles { roll_rad: 0.0, pitch_rad: -core::f64::consts::FRAC_PI_2, heading_rad: 0.4 };
        let back = Angles::from_nhe_from_body(&up.nhe_from_body());
        assert!((back.heading_rad - 0.4).abs() < 1e-9, "{back:?}");
        assert!((back.nhe_from_body() - up.nhe_from_body()).norm() < 1e-9);
    }
}
