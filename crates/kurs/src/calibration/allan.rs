//! Allan deviation of a resting sensor: how its noise averages, and where averaging stops to help.

/// One point of the curve.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AllanPoint {
    /// Averaging time.
    pub tau_s: f64,
    /// Allan deviation, unit of the samples.
    pub deviation: f64,
    /// Relative 1 σ of the deviation.
    pub relative_sd: f64,
}

/// What the curve says about the sensor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AllanSummary {
    /// White noise: deviation at one second, unit·√s (for a gyro the angle random walk).
    pub noise_density: f64,
    /// Bias instability: the lowest deviation over 0.664.
    pub bias_instability: f64,
    /// Averaging time of the lowest deviation.
    pub bias_tau_s: f64,
}

/// √(2 ln 2 / π): flicker noise to its flat Allan deviation.
const FLICKER: f64 = 0.664;

/// The overlapping Allan deviation at averaging times of 1, 2, 4, … samples, up to a ninth of the
/// record.
///
/// σ²(m τ₀) = Σ (θ_{k+2m} − 2 θ_{k+m} + θ_k)² / (2 (mτ₀)² (N − 2m)), θ the running integral.
#[must_use]
pub fn deviation(samples: &[f64], step_s: f64) -> Vec<AllanPoint> {
    let mut integral = Vec::with_capacity(samples.len() + 1);
    integral.push(0.0);
    // The mean is taken out first so that the integral stays small.
    let mean = samples.iter().sum::<f64>() / samples.len().max(1) as f64;
    for sample in samples {
        integral.push(integral[integral.len() - 1] + (sample - mean) * step_s);
    }
    let mut points = Vec::new();
    let mut m = 1;
    while samples.len() / m >= 9 {
        let tau_s = m as f64 * step_s;
        let terms = integral.len() - 2 * m;
        let sum: f64 = (0..terms)
            .map(|k| (integral[k + 2 * m] - 2.0 * integral[k + m] + integral[k]).powi(2))
            .sum();
        let variance = sum / (2.0 * tau_s * tau_s * terms as f64);
        let clusters = samples.len() as f64 / m as f64;
        let relative_sd = 1.0 / (2.0 * (clusters - 1.0)).sqrt();
        points.push(AllanPoint { tau_s, deviation: variance.sqrt(), relative_sd });
        m *= 2;
    }
    points
}

/// Noise density from the first points (slope −1/2) and bias instability from the lowest one;
/// `None` for fewer than three points.
#[must_use]
pub fn summary(points: &[AllanPoint]) -> Option<AllanSummary> {
    if points.len() < 3 {
        return None;
    }
    let densities = points[..3].iter().map(|point| point.deviation * point.tau_s.sqrt());
    let noise_density = densities.sum::<f64>() / 3.0;
    let lowest = points.iter().min_by(|a, b| a.deviation.total_cmp(&b.deviation))?;
    Some(AllanSummary {
        noise_density,
        bias_instability: lowest.deviation / FLICKER,
        bias_tau_s: lowest.tau_s,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};
    use rand_xoshiro::Xoshiro256PlusPlus;

    /// White noise σ at interval τ₀ has σ √(τ₀/τ) everywhere.
    #[test]
    fn white_noise_falls_with_the_square_root() {
        let mut generator = Xoshiro256PlusPlus::seed_from_u64(11);
        let (step_s, sd): (f64, f64) = (0.01, 0.3);
        let samples: Vec<f64> = (0..100_000)
            .map(|_| {
                let unit: f64 = StandardNormal.sample(&mut generator);
                5.0 + sd * unit
            })
            .collect();
        let points = deviation(&samples, step_s);
        for point in &points {
            let expected = sd * (step_s / point.tau_s).sqrt();
            let ratio = point.deviation / expected;
            assert!((ratio - 1.0).abs() < 4.0 * point.relative_sd, "{point:?} {ratio}");
        }
        let summary = summary(&points).unwrap();
        assert!((summary.noise_density / (sd * step_s.sqrt()) - 1.0).abs() < 0.02);
    }

    /// A drift of slope r has r τ / √2.
    #[test]
    fn drift_rises_in_proportion() {
        let samples: Vec<f64> = (0..1000).map(|k| 2e-3 * f64::from(k)).collect();
        for point in deviation(&samples, 1.0) {
            assert!((point.deviation / (2e-3 * point.tau_s / 2f64.sqrt()) - 1.0).abs() < 1e-9);
        }
    }

    #[test]
    fn too_short_a_record_says_nothing() {
        assert!(deviation(&[], 1.0).is_empty());
        assert_eq!(summary(&deviation(&[1.0; 10], 1.0)), None);
    }
}
