//! Gyros and accelerometers on a body of a scenario: what they would read along its true motion.

use kurs::frames::{Body, EARTH_RATE_RADPS, Geodetic, Vector};
use kurs::fusion::earth::gravity::normal_gravity_mps2;
use nalgebra::{Matrix3, Rotation3, Vector3};

use crate::motion::{Motion, Pose};
use crate::noise::Noise;
use crate::scenario::Imu;

const DEGREES_PER_HOUR: f64 = core::f64::consts::PI / 180.0 / 3600.0;
/// One degree in √h, in rad/√s.
const DEGREES_PER_SQRT_HOUR: f64 = core::f64::consts::PI / 180.0 / 60.0;

/// A reading: mean over the step that ends at its time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImuReading {
    /// From the start of the scenario.
    pub time_s: f64,
    /// Angular rate against inertial space along the sensor's axes, rad/s.
    pub rate_radps: Vector3<f64>,
    /// Along the sensor's axes, m/s².
    pub specific_force_mps2: Vector3<f64>,
}

/// The readings of one sensor in the making.
#[derive(Debug, Clone)]
pub struct ImuRecording {
    plan: Imu,
    motion: Motion,
    noise: Noise,
    body_from_imu: Matrix3<f64>,
    made: usize,
    count: usize,
}

impl ImuRecording {
    pub(crate) fn new(plan: &Imu, motion: &Motion, duration_s: f64, noise: Noise) -> Self {
        let body_from_imu = crate::motion::attitude_of(plan.mounting_deg).ned_from_body().matrix();
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // both were checked
        let count = (duration_s / plan.interval_s + 1e-6).floor() as usize;
        Self { plan: plan.clone(), motion: motion.clone(), noise, body_from_imu, made: 0, count }
    }

    /// Mean rate of the body against inertial space over a step, in body axes.
    ///
    /// exp\[ω Δt ×\] = Cᵀ(t₀) R₃(Ω Δt) C(t₁), C from body to Earth
    fn mean_rate(before: &Pose, after: &Pose, step_s: f64) -> Vector3<f64> {
        let earth = Rotation3::from_axis_angle(&Vector3::z_axis(), EARTH_RATE_RADPS * step_s);
        let (from, to) = (before.ecef_from_body().matrix(), after.ecef_from_body().matrix());
        let turn = from.transpose() * earth.into_inner() * to;
        Rotation3::from_matrix_unchecked(turn).scaled_axis() / step_s
    }

    /// Mean specific force over a step, in the body axes half-way.
    ///
    /// f = Cᵀ(Δv/Δt + 2 Ω×v + γ û)
    fn mean_force(&self, from_s: f64, step_s: f64) -> Vector3<f64> {
        let lever_arm_m: Vector<Body> = Vector::from_xyz(Vector3::from(self.plan.position_m));
        let velocity = |time_s| self.motion.velocity_mps(lever_arm_m, time_s).xyz();
        let (before, after) = (velocity(from_s), velocity(from_s + step_s));
        let half_way = self.motion.pose(from_s + step_s / 2.0);
        let here = Geodetic::from_ecef(half_way.point_m(lever_arm_m));
        let up = -here.ecef_from_ned().matrix().column(2).into_owned();
        let gravity = up * normal_gravity_mps2(here.latitude_rad, here.height_m);
        let earth = Vector3::new(0.0, 0.0, EARTH_RATE_RADPS);
        let felt = (after - before) / step_s + earth.cross(&(before + after)) + gravity;
        half_way.ecef_from_body().matrix().tr_mul(&felt)
    }
}

impl Iterator for ImuRecording {
    type Item = ImuReading;

    fn next(&mut self) -> Option<ImuReading> {
        if self.made == self.count {
            return None;
        }
        let Imu { interval_s: step_s, .. } = self.plan;
        let from_s = self.made as f64 * step_s;
        self.made += 1;
        let time_s = self.made as f64 * step_s;
        let (before, after) = (self.motion.pose(from_s), self.motion.pose(time_s));
        let rate = self.body_from_imu.tr_mul(&Self::mean_rate(&before, &after, step_s));
        let force = self.body_from_imu.tr_mul(&self.mean_force(from_s, step_s));

        // y = M a + b + noise, at most the range
        let plan = &self.plan;
        let matrix = |rows: [[f64; 3]; 3]| Matrix3::from_fn(|row, column| rows[row][column]);
        let gyro_noise = plan.gyro_noise_deg_per_sqrt_h * DEGREES_PER_SQRT_HOUR / step_s.sqrt();
        let force_noise = plan.accelerometer_noise_mps2_per_sqrt_hz / step_s.sqrt();
        let rate_radps = matrix(plan.gyro_matrix) * rate
            + Vector3::from(plan.gyro_bias_degph) * DEGREES_PER_HOUR
            + self.noise.normal3(gyro_noise);
        let specific_force_mps2 = matrix(plan.accelerometer_matrix) * force
            + Vector3::from(plan.accelerometer_bias_mps2)
            + self.noise.normal3(force_noise);
        let rate_range = plan.gyro_range_degps.to_radians();
        let force_range = plan.accelerometer_range_mps2;
        Some(ImuReading {
            time_s,
            rate_radps: rate_radps.map(|r| r.clamp(-rate_range, rate_range)),
            specific_force_mps2: specific_force_mps2.map(|f| f.clamp(-force_range, force_range)),
        })
    }
}
