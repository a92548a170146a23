//! Exponential smoothing of one value; of an angle that may pass half a turn smooth the parts of its
//! direction.

/// s ← α x + (1 − α) s.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ExponentialSmoothing {
    alpha: f64,
    value: Option<f64>,
}

impl ExponentialSmoothing {
    /// With 0 < α ≤ 1; `None` otherwise.
    #[must_use]
    pub fn new(alpha: f64) -> Option<Self> {
        (alpha > 0.0 && alpha <= 1.0).then_some(Self { alpha, value: None })
    }

    /// Takes a value and gives the smoothed one; the first passes as it is, one that is not a number
    /// is left out.
    pub fn update(&mut self, value: f64) -> Option<f64> {
        if value.is_finite() {
            let before = self.value.unwrap_or(value);
            self.value = Some(self.alpha * value + (1.0 - self.alpha) * before);
        }
        self.value
    }

    /// Variance of the output over that of white input, α/(2 − α).
    #[must_use]
    pub fn variance_ratio(&self) -> f64 {
        self.alpha / (2.0 - self.alpha)
    }

    /// Lag behind a ramp, (1 − α)/α samples.
    #[must_use]
    pub fn lag_samples(&self) -> f64 {
        (1.0 - self.alpha) / self.alpha
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};
    use rand_xoshiro::Xoshiro256PlusPlus;

    /// Variance within 5 % and lag of a ramp, for the values of the reference.
    #[test]
    fn variance_and_lag_follow_their_formulas() {
        for alpha in [0.02, 0.1, 0.3] {
            let mut generator = Xoshiro256PlusPlus::seed_from_u64(3);
            let mut smoothing = ExponentialSmoothing::new(alpha).unwrap();
            let (mut sum, mut count) = (0.0, 0.0);
            for k in 0..400_000 {
                let value: f64 = StandardNormal.sample(&mut generator);
                let smoothed = smoothing.update(value).unwrap();
                if k > 1000 {
                    sum += smoothed * smoothed;
                    count += 1.0;
                }
            }
            assert!((sum / count / smoothing.variance_ratio() - 1.0).abs() < 0.05, "{alpha}");

            let mut ramp = ExponentialSmoothing::new(alpha).unwrap();
            let last = (0..5000).map(|k| ramp.update(f64::from(k)).unwrap()).last().unwrap();
            assert!((4999.0 - last - ramp.lag_samples()).abs() < 1e-6);
        }
    }

    #[test]
    fn limits() {
        assert!(ExponentialSmoothing::new(0.0).is_none());
        assert!(ExponentialSmoothing::new(f64::NAN).is_none());
        let mut smoothing = ExponentialSmoothing::new(0.5).unwrap();
        assert_eq!(smoothing.update(f64::NAN), None);
        assert_eq!(smoothing.update(2.0), Some(2.0));
        assert_eq!(smoothing.update(f64::INFINITY), Some(2.0));
    }
}
