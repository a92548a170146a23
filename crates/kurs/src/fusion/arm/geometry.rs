//! The rotating arm: where antenna and accelerometers are on the body at an instant, in the body
//! axes of the rotating-frame paper (forward, up, right; see [`super::nhe`]).

use core::f64::consts::TAU;

use nalgebra::{Matrix3, Vector3};

/// How the accelerometer triad is carried by the arm.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Triad {
    /// Held parallel to the body axes while the arm turns, as the paper assumes.
    #[default]
    HeldParallel,
    /// Fixed on the arm: turns with it about the arm's axis, parallel to the body at angle zero.
    TurnsWithArm,
}

/// A uniformly turning arm with the antenna's phase centre and the accelerometers at its end.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RotatingArm {
    /// R.
    pub radius_m: f64,
    /// f, turns a second.
    pub rate_hz: f64,
    /// θ₀, the arm's angle at time zero.
    pub phase_rad: f64,
    /// ρ₀: centre of rotation in body axes.
    pub centre_m: Vector3<f64>,
    /// Body axes from the arm's axes, in which it turns from x towards y; identity in the paper:
    /// from forward towards up.
    pub body_from_arm: Matrix3<f64>,
    /// How the accelerometers are carried.
    pub triad: Triad,
}

/// Position, velocity and acceleration of the arm's end relative to the body, in body axes, and
/// their derivatives by the arm's angle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ArmMotion {
    /// ρ.
    pub position_m: Vector3<f64>,
    /// ρ̇.
    pub velocity_mps: Vector3<f64>,
    /// ρ̈.
    pub acceleration_mps2: Vector3<f64>,
    /// ∂ρ/∂θ.
    pub position_by_angle: Vector3<f64>,
    /// ∂ρ̇/∂θ.
    pub velocity_by_angle: Vector3<f64>,
    /// ∂ρ̈/∂θ.
    pub acceleration_by_angle: Vector3<f64>,
    /// Triad axes from body axes.
    pub triad_from_body: Matrix3<f64>,
    /// Axis about which the triad turns as the arm does, in triad axes; zero if it is held.
    pub triad_axis: Vector3<f64>,
}

impl RotatingArm {
    /// The arm of the paper: centre of rotation in the body's origin, plane forward-up.
    #[must_use]
    pub fn new(radius_m: f64, rate_hz: f64) -> Self {
        Self {
            radius_m,
            rate_hz,
            phase_rad: 0.0,
            centre_m: Vector3::zeros(),
            body_from_arm: Matrix3::identity(),
            triad: Triad::HeldParallel,
        }
    }

    /// θ = 2πft + θ₀, reduced to one turn so that it stays precise over days.
    #[must_use]
    pub fn angle_rad(&self, time_s: f64) -> f64 {
        let turns = self.rate_hz * time_s;
        // What rounding took from the product is added again once the whole turns are gone.
        let rounded_off = self.rate_hz.mul_add(time_s, -turns);
        TAU * (turns.fract() + rounded_off) + self.phase_rad
    }

    /// Speed of the arm's end, 2πfR.
    #[must_use]
    pub fn speed_mps(&self) -> f64 {
        TAU * self.rate_hz * self.radius_m
    }

    /// The motion of the arm's end at an angle.
    #[must_use]
    pub fn at_angle(&self, angle_rad: f64) -> ArmMotion {
        let (sin, cos) = angle_rad.sin_cos();
        let rate = TAU * self.rate_hz;
        let radial = self.body_from_arm * Vector3::new(cos, sin, 0.0) * self.radius_m;
        let tangent = self.body_from_arm * Vector3::new(-sin, cos, 0.0) * self.radius_m;
        let (triad_from_body, triad_axis) = match self.triad {
            Triad::HeldParallel => (Matrix3::identity(), Vector3::zeros()),
            Triad::TurnsWithArm => {
                let axis = self.body_from_arm * Vector3::z();
                let turn = nalgebra::Rotation3::new(axis * angle_rad);
                (turn.matrix().transpose(), axis)
            }
        };
        ArmMotion {
            position_m: self.centre_m + radial,
            velocity_mps: tangent * rate,
            acceleration_mps2: -radial * (rate * rate),
            position_by_angle: tangent,
            velocity_by_angle: -radial * rate,
            acceleration_by_angle: -tangent * (rate * rate),
            triad_from_body,
            triad_axis,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn derivatives_agree_with_differences() {
        let arm = RotatingArm {
            phase_rad: 0.3,
            centre_m: Vector3::new(0.1, -0.2, 0.4),
            body_from_arm: *nalgebra::Rotation3::from_euler_angles(0.2, -0.4, 1.0).matrix(),
            ..RotatingArm::new(0.7, 1.3)
        };
        let (angle, step) = (0.9, 1e-5);
        let at = arm.at_angle(angle);
        let (after, before) = (arm.at_angle(angle + step), arm.at_angle(angle - step));
        let by_angle = (after.position_m - before.position_m) / (2.0 * step);
        assert!((by_angle - at.position_by_angle).norm() < 1e-9);
        assert!((by_angle * TAU * arm.rate_hz - at.velocity_mps).norm() < 1e-8);
        let by_angle = (after.velocity_mps - before.velocity_mps) / (2.0 * step);
        assert!((by_angle - at.velocity_by_angle).norm() < 1e-8);
        assert!((by_angle * TAU * arm.rate_hz - at.acceleration_mps2).norm() < 1e-7);
        let by_angle = (after.acceleration_mps2 - before.acceleration_mps2) / (2.0 * step);
        assert!((by_angle - at.acceleration_by_angle).norm() < 1e-7);
    }

    #[test]
    fn angle_stays_precise_over_a_day() {
        let arm = RotatingArm::new(1.0, 1.0);
        assert_eq!(arm.angle_rad(86_400.0), 0.0);
        assert!((arm.angle_rad(86_400.25) - TAU / 4.0).abs() < 1e-10);
        // 0.1 as a double is 5.55e-18 too large: 300 000 turns and 1.665e-11 in 3e6 s.
        let arm = RotatingArm::new(1.0, 0.1);
        assert!((arm.angle_rad(3e6) - TAU * 1.665_334_536_9e-11).abs() < 1e-18);
    }
}
