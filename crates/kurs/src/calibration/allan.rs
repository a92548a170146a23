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
    /// 1 σ of the mean of the record as the bias, by the noise and by what the bias wanders.
    pub mean_sd: f64,
}

/// √(2 ln 2 / π): flicker noise to its flat Allan deviation.
const FLICKER: f64 = 0.664;
/// White noise is where σ √τ changes by less than this share from one averaging time to the doubled
/// one, and by less than chance: a filter behind which a tenth of the noise is missing still adds 5 %.
const LEVEL: f64 = 0.05;
/// A deviation this many of its standard deviations above that of white noise is not chance.
const CHANCE_SIGMAS: f64 = 2.0;

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

/// Noise density where the slope is −1/2, bias instability from the lowest point, and how well the
/// mean of a record of `length_s` is the bias; `None` for fewer than three points.
#[must_use]
pub fn summary(points: &[AllanPoint], length_s: f64) -> Option<AllanSummary> {
    if points.len() < 3 {
        return None;
    }
    let noise_density = noise_density(points);
    let lowest = points.iter().min_by(|a, b| a.deviation.total_cmp(&b.deviation))?;
    let longest = points.last()?;
    // White noise alone: N/√T of the mean, N/√τ at the longest averaging time
    let by_noise = noise_density / length_s.sqrt();
    let by_chance =
        noise_density / longest.tau_s.sqrt() * (1.0 + CHANCE_SIGMAS * longest.relative_sd);
    let wanders = longest.deviation > by_chance;
    Some(AllanSummary {
        noise_density,
        bias_instability: lowest.deviation / FLICKER,
        bias_tau_s: lowest.tau_s,
        mean_sd: if wanders { by_noise.hypot(longest.deviation) } else { by_noise },
    })
}

/// σ √τ where the slope has become −1/2: the points before lack the noise that a low-pass filter takes,
/// or have that of coarse steps; without any, the point nearest to one second.
fn noise_density(points: &[AllanPoint]) -> f64 {
    let density = |point: &AllanPoint| point.deviation * point.tau_s.sqrt();
    let is_level = |pair: &[AllanPoint]| {
        let allowed = LEVEL + CHANCE_SIGMAS * pair[1].relative_sd;
        (density(&pair[1]) / density(&pair[0])).ln().abs() <= allowed
    };
    let level = points.windows(3).find(|three| is_level(&three[..2]) && is_level(&three[1..]));
    if let Some(three) = level {
        return (density(&three[1]) + density(&three[2])) / 2.0;
    }
    let from_second = |point: &AllanPoint| point.tau_s.ln().abs();
    let nearest = points.iter().min_by(|a, b| from_second(a).total_cmp(&from_second(b)));
    nearest.map_or(0.0, density)
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
        let summary = summary(&points, 1000.0).unwrap();
        let density = sd * step_s.sqrt();
        assert!((summary.noise_density / density - 1.0).abs() < 0.02);
        assert!((summary.mean_sd / (density / 1000f64.sqrt()) - 1.0).abs() < 0.02);

        // The same behind a low-pass filter of 0.1 s has lost its fast part, and no density.
        let mut low = 5.0;
        let filtered = samples.iter().map(|sample| {
            low += (sample - low) * 0.1;
            low
        });
        let points = deviation(&filtered.collect::<Vec<_>>(), step_s);
        let filtered = super::summary(&points, 1000.0).unwrap();
        let ratio = filtered.noise_density / density;
        assert!((ratio - 1.0).abs() < 0.1, "{ratio}");

        // A bias that wanders is no better known than it wanders.
        let (mut bias, mut walk) = (0.0, Vec::new());
        for sample in &samples {
            let unit: f64 = StandardNormal.sample(&mut generator);
            bias += 1e-3 * unit;
            walk.push(sample + bias);
        }
        let points = deviation(&walk, step_s);
        let longest = points.last().unwrap().deviation;
        let wandering = super::summary(&points, 1000.0).unwrap();
        assert!(wandering.mean_sd >= longest && longest > 3.0 * summary.mean_sd);
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
        assert_eq!(summary(&deviation(&[1.0; 10], 1.0), 10.0), None);
    }
}
