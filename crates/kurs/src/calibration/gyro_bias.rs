//! Bias of a gyro from a rest.

use nalgebra::Vector3;

use super::sensor_model::CalibrationProblem;

/// Mean rate at rest and how sure it is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GyroBias {
    /// Bias, with the Earth's rate still in it, rad/s.
    pub bias_radps: Vector3<f64>,
    /// 1 σ by the white noise of the samples, rad/s.
    pub sd_radps: Vector3<f64>,
}

/// Mean of the samples of a rest (rad/s), at least two.
///
/// # Errors
///
/// [`CalibrationProblem`] for fewer samples or one that is not a number.
pub fn calibrate(samples_radps: &[Vector3<f64>]) -> Result<GyroBias, CalibrationProblem> {
    let n = samples_radps.len();
    if n < 2 {
        return Err(CalibrationProblem::TooFewPoses { found: n, needed: 2 });
    }
    let bias_radps = samples_radps.iter().sum::<Vector3<f64>>() / n as f64;
    if !bias_radps.iter().all(|value| value.is_finite()) {
        return Err(CalibrationProblem::NotFinite);
    }
    let squares: Vector3<f64> =
        samples_radps.iter().map(|s| (s - bias_radps).component_mul(&(s - bias_radps))).sum();
    let sd_radps = squares.map(|square| (square / (n as f64 * (n as f64 - 1.0))).sqrt());
    Ok(GyroBias { bias_radps, sd_radps })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mean_and_its_standard_deviation() {
        let samples = [1.0, 3.0, 1.0, 3.0].map(|x| Vector3::new(x, -x, 0.5));
        let found = calibrate(&samples).unwrap();
        assert_eq!(found.bias_radps, Vector3::new(2.0, -2.0, 0.5));
        assert!((found.sd_radps.x - (4f64 / 12.0).sqrt()).abs() < 1e-15);
        assert_eq!(found.sd_radps.z, 0.0);
        assert!(calibrate(&samples[..1]).is_err());
        let bad = [samples[0], Vector3::repeat(f64::NAN)];
        assert_eq!(calibrate(&bad), Err(CalibrationProblem::NotFinite));
    }
}
