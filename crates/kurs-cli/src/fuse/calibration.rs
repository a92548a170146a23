//! `calibration.toml` as `kurs calibrate` writes it.

use std::path::Path;

use anyhow::{Context, bail};
use nalgebra::{Matrix3, Vector3};
use serde::Deserialize;

use crate::config_file;

/// From readings to what was felt.
#[derive(Debug, Clone, Copy)]
pub(super) struct Calibration {
    /// M⁻¹ of the accelerometers.
    inverse: Matrix3<f64>,
    bias_mps2: Vector3<f64>,
    /// Bias of the gyros, where they were calibrated.
    pub(super) gyro_bias_radps: Option<Vector3<f64>>,
}

/// The part of the file that is used: y = M a + b.
#[derive(Debug, Deserialize)]
struct File {
    accelerometer: Option<Accelerometer>,
    gyro: Option<Gyro>,
}

#[derive(Debug, Deserialize)]
struct Accelerometer {
    matrix: [[f64; 3]; 3],
    bias_mps2: [f64; 3],
}

#[derive(Debug, Deserialize)]
struct Gyro {
    bias_radps: [f64; 3],
}

impl Default for Calibration {
    /// A perfect sensor.
    fn default() -> Self {
        let (inverse, bias_mps2) = (Matrix3::identity(), Vector3::zeros());
        Self { inverse, bias_mps2, gyro_bias_radps: None }
    }
}

impl Calibration {
    /// Reads a file with at least one of the two tables.
    pub(super) fn read(path: &Path) -> anyhow::Result<Self> {
        let File { accelerometer, gyro } = config_file::read(path)?;
        let name = path.display();
        if accelerometer.is_none() && gyro.is_none() {
            bail!("{name}: no table [accelerometer] or [gyro]");
        }
        let mut calibration = Self::default();
        if let Some(found) = accelerometer {
            let matrix = Matrix3::from_fn(|row, column| found.matrix[row][column]);
            calibration.inverse = matrix
                .try_inverse()
                .filter(|inverse| inverse.iter().all(|value| value.is_finite()))
                .with_context(|| format!("{name}: accelerometer.matrix has no inverse"))?;
            calibration.bias_mps2 = found.bias_mps2.into();
        }
        calibration.gyro_bias_radps = gyro.map(|gyro| gyro.bias_radps.into());
        let biases = [Some(calibration.bias_mps2), calibration.gyro_bias_radps];
        if !biases.iter().flatten().flatten().all(|value| value.is_finite()) {
            bail!("{name}: a bias is not a number");
        }
        Ok(calibration)
    }

    /// a = M⁻¹ (y − b)
    pub(super) fn force(&self, reading_mps2: &Vector3<f64>) -> Vector3<f64> {
        self.inverse * (reading_mps2 - self.bias_mps2)
    }

    /// ω = y − b
    pub(super) fn rate(&self, reading_radps: &Vector3<f64>) -> Vector3<f64> {
        reading_radps - self.gyro_bias_radps.unwrap_or_default()
    }
}
