//! A gyro on a swinging body: truth and samples.

use core::f64::consts::TAU;

use kurs::frames::{Attitude, Body, EARTH_RATE_RADPS, Ned, Rotation, Vector};
use nalgebra::{Rotation3, Vector3};

use crate::noise::Noise;

/// A body that swings in all three angles.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Swing {
    /// Largest excursion of heading, pitch, roll.
    pub amplitude_rad: Vector3<f64>,
    /// Period of each.
    pub period_s: Vector3<f64>,
    /// For the Earth's rate.
    pub latitude_rad: f64,
}

/// Errors of a gyro.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GyroErrors {
    /// Constant bias, rad/s.
    pub bias_radps: Vector3<f64>,
    /// Noise density, rad/√s.
    pub noise: f64,
}

impl Swing {
    /// A vehicle: 60° of heading, 5° of pitch and roll.
    #[must_use]
    pub fn vehicle() -> Self {
        Self {
            amplitude_rad: Vector3::new(60f64, 5.0, 5.0).map(f64::to_radians),
            period_s: Vector3::new(20.0, 7.0, 5.0),
            latitude_rad: 55.75f64.to_radians(),
        }
    }

    /// True attitude.
    #[must_use]
    pub fn attitude(&self, time_s: f64) -> Attitude {
        let angle = |k: usize| self.amplitude_rad[k] * (TAU * time_s / self.period_s[k]).sin();
        Attitude { heading_rad: angle(0), pitch_rad: angle(1), roll_rad: angle(2) }
    }

    /// True rotation.
    #[must_use]
    pub fn ned_from_body(&self, time_s: f64) -> Rotation<Ned, Body> {
        self.attitude(time_s).ned_from_body()
    }

    /// Mean rate that a gyro shows over a step, from the attitudes at its ends and the turning of
    /// the Earth between.
    pub fn gyro(
        &self,
        time_s: f64,
        step_s: f64,
        errors: &GyroErrors,
        noise: &mut Noise,
    ) -> Vector<Body> {
        let (before, after) = (self.ned_from_body(time_s - step_s), self.ned_from_body(time_s));
        let (sin, cos) = self.latitude_rad.sin_cos();
        let earth_turn = Vector3::new(cos, 0.0, -sin) * (EARTH_RATE_RADPS * step_s);
        let earth = Rotation3::new(earth_turn).into_inner();
        let turned = before.matrix().transpose() * earth * after.matrix();
        let turn = Rotation3::from_matrix_unchecked(turned).scaled_axis();
        let noise = noise.normal3(errors.noise / step_s.sqrt());
        Vector::from_xyz(turn / step_s + errors.bias_radps + noise)
    }
}
