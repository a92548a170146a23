//! How noisy this session really is: one scale for code and one for phase, learnt from the
//! residuals.
//!
//! A-priori standard deviations fit no receiver: between a survey antenna on a roof and a patch
//! under trees lies a factor of ten. Sigmas too small make every fix look inconsistent, sigmas too
//! large make every fix look unsure. The code residuals of the float solution need no integers, so
//! the code's scale is known from the first epoch on; the phase's scale comes from
//! integers that stand clear of all others.

use crate::float_solution::Fit;

/// Degrees of freedom that the a-priori level counts for.
const PRIOR_FREEDOM: f64 = 4.0;
/// Degrees of freedom after which old epochs are forgotten: code multipath changes over minutes.
const MEMORY_FREEDOM: f64 = 1000.0;
/// No session is better than this share of the a-priori standard deviation.
const LEAST_SCALE: f64 = 0.2;
/// One epoch moves the scale by no more than this many times its expected residuals.
const MAX_EPOCH: f64 = 25.0;

/// Variance factor of one kind of observation, against the a-priori variances.
#[derive(Debug, Clone, Copy)]
pub(super) struct NoiseScale {
    /// Weighted squares, with a-priori weights.
    sum: f64,
    /// Degrees of freedom they stand for.
    freedom: f64,
}

impl Default for NoiseScale {
    fn default() -> Self {
        Self { sum: PRIOR_FREEDOM, freedom: PRIOR_FREEDOM }
    }
}

impl NoiseScale {
    /// The variance factor.
    pub(super) fn variance_factor(&self) -> f64 {
        (self.sum / self.freedom).max(LEAST_SCALE * LEAST_SCALE)
    }

    /// Degrees of freedom behind the factor.
    pub(super) fn freedom(&self) -> f64 {
        self.freedom
    }

    /// Learns from the residuals of one epoch that were weighted with `applied` times the a-priori
    /// variances.
    pub(super) fn learn(&mut self, fit: Fit, applied: f64) {
        let freedom = fit.freedom as f64;
        let keep = (1.0 - freedom / MEMORY_FREEDOM).max(0.5);
        let sum = (fit.sum * applied).min(MAX_EPOCH * freedom * self.variance_factor());
        self.sum = self.sum * keep + sum;
        self.freedom = self.freedom * keep + freedom;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn follows_the_residuals_and_forgets() {
        let mut scale = NoiseScale::default();
        assert_eq!(scale.variance_factor(), 1.0);
        for _ in 0..200 {
            scale.learn(Fit { sum: 2.0, freedom: 8 }, 1.0);
        }
        assert!((scale.variance_factor() - 0.25).abs() < 0.01);
        for _ in 0..1000 {
            // The same residuals, now weighted with four times the a-priori variance.
            scale.learn(Fit { sum: 8.0, freedom: 8 }, 4.0);
        }
        assert!((scale.variance_factor() - 4.0).abs() < 0.05);
        assert!(scale.freedom() <= MEMORY_FREEDOM * 1.01);
    }

    #[test]
    fn one_wild_epoch_does_not_blind_it() {
        let mut scale = NoiseScale::default();
        for _ in 0..100 {
            scale.learn(Fit { sum: 8.0, freedom: 8 }, 1.0);
        }
        scale.learn(Fit { sum: 1e9, freedom: 8 }, 1.0);
        assert!(scale.variance_factor() < 1.5);
    }
}
