//! What a scalar measurement depends on: the motion of the body, and the derivative by it.

use nalgebra::{Matrix3, Vector3};

use crate::fusion::earth::local_level::{LevelDerivative, LocalLevel};

/// Motion of the body's centre of rotation and of its axes; ECEF, body axes of the paper
/// ([`super::nhe`]).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Motion {
    /// r.
    pub position_m: Vector3<f64>,
    /// Δ.
    pub clock_m: f64,
    /// v.
    pub velocity_mps: Vector3<f64>,
    /// Δ̇.
    pub clock_rate_mps: f64,
    /// a.
    pub acceleration_mps2: Vector3<f64>,
    /// C.
    pub ecef_from_body: Matrix3<f64>,
    /// ω, of the body relative to the level axes, in body axes.
    pub rate_radps: Vector3<f64>,
    /// ω̇, likewise.
    pub angular_acceleration_radps2: Vector3<f64>,
}

/// Derivative of one scalar by each block of the [`Motion`]; the attitude as a rotation vector φ in
/// body axes, C ← C exp\[φ×\].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gradient {
    /// By r.
    pub position: Vector3<f64>,
    /// By Δ.
    pub clock: f64,
    /// By v.
    pub velocity: Vector3<f64>,
    /// By Δ̇.
    pub clock_rate: f64,
    /// By a.
    pub acceleration: Vector3<f64>,
    /// By φ.
    pub attitude: Vector3<f64>,
    /// By ω.
    pub rate: Vector3<f64>,
    /// By ω̇.
    pub angular_acceleration: Vector3<f64>,
    /// By the arm's angle θ.
    pub arm_angle: f64,
}

/// What a measurement should read, and how that depends on the motion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Prediction {
    /// Expected value, in the measurement's unit.
    pub value: f64,
    /// Its derivative.
    pub gradient: Gradient,
}

impl Gradient {
    /// Independent of everything.
    pub const ZERO: Self = Self {
        position: Vector3::new(0.0, 0.0, 0.0),
        clock: 0.0,
        velocity: Vector3::new(0.0, 0.0, 0.0),
        clock_rate: 0.0,
        acceleration: Vector3::new(0.0, 0.0, 0.0),
        attitude: Vector3::new(0.0, 0.0, 0.0),
        rate: Vector3::new(0.0, 0.0, 0.0),
        angular_acceleration: Vector3::new(0.0, 0.0, 0.0),
        arm_angle: 0.0,
    };

    /// Adds to the position part that the level axes, and the body with them, turn as the point
    /// moves: ∂/∂r += Ψᵀ C ∂/∂φ.
    pub fn turn_level(&mut self, ecef_from_body: &Matrix3<f64>, level: &LevelDerivative) {
        self.position += level.turning.transpose() * (ecef_from_body * self.attitude);
    }

    /// Adds to the position part of the accelerometer along body axis `axis` that gravity turns and
    /// grows as the point moves: the axis senses γ (Cᵀû), and ∂(γû)/∂r = −γ [û×] Ψ + û ∇γᵀ.
    pub fn turn_gravity(
        &mut self,
        axis: &Vector3<f64>,
        ecef_from_body: &Matrix3<f64>,
        here: &LocalLevel,
        level: &LevelDerivative,
    ) {
        let axis_ecef = ecef_from_body * axis;
        let turned = level.turning.transpose() * (here.up.cross(&axis_ecef) * here.gravity_mps2);
        self.position += turned + level.gravity_gradient * here.up.dot(&axis_ecef);
    }
}
