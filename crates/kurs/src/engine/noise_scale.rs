//! How noisy this session really is: one scale for code and one for phase, learnt from the
//! residuals.
//!
//! A-priori standard deviations fit no receiver: between a survey antenna on a roof and a patch
//! under trees lies a factor of ten. Sigmas too small make every fix look inconsistent, sigmas too
//! large make every fix look unsure. The code residuals of the float solution need no integers, so
//! the code's scale is known from the first epoch on; the phase's scale comes from
//! integers that stand clear of all others. Multipath hardly changes from one epoch to the next, so
//! an epoch counts as far as it is independent of the one before.

use crate::float_solution::Fit;
use crate::float_solution::recursive::CORRELATION_S;
use crate::time::GpsTime;

/// Degrees of freedom that the a-priori level counts for.
const PRIOR_FREEDOM: f64 = 4.0;
/// Degrees of freedom after which old epochs are forgotten: code multipath changes over minutes.
const MEMORY_FREEDOM: f64 = 1000.0;
/// No session is better than this share of the a-priori standard deviation.
const MIN_SCALE: f64 = 0.2;
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
        (self.sum / self.freedom).max(MIN_SCALE * MIN_SCALE)
    }

    /// Degrees of freedom behind the factor.
    pub(super) fn freedom(&self) -> f64 {
        self.freedom
    }

    /// Learns from the residuals of one epoch that were weighted with `applied` times the a-priori
    /// variances and count as `weight` of an independent epoch.
    pub(super) fn learn(&mut self, fit: Fit, applied: f64, weight: f64) {
        let freedom = weight * fit.freedom as f64;
        let keep = (1.0 - freedom / MEMORY_FREEDOM).max(0.5);
        let sum = (weight * fit.sum * applied).min(MAX_EPOCH * freedom * self.variance_factor());
        self.sum = self.sum * keep + sum;
        self.freedom = self.freedom * keep + freedom;
    }

    /// The same from integers that were chosen, among several that were possible, because they fit:
    /// their residuals are smaller than the noise, so the factor does not fall below 1.
    pub(super) fn learn_from_chosen(&mut self, fit: Fit, applied: f64, weight: f64) {
        self.learn(fit, applied, weight);
        self.sum = self.sum.max(self.freedom);
    }
}

/// How much an epoch counts beside those before, as the mean of a Gauss–Markov process demands.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Independence {
    last: Option<GpsTime>,
}

impl Independence {
    /// The weight of the epoch at `time`: 1 for the first one.
    pub(super) fn weight(&mut self, time: GpsTime) -> f64 {
        let elapsed_s = self.last.map_or(f64::INFINITY, |last| time - last);
        self.last = Some(time);
        (elapsed_s / (2.0 * CORRELATION_S)).clamp(0.0, 1.0)
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
            scale.learn(Fit { sum: 2.0, freedom: 8 }, 1.0, 1.0);
        }
        assert!((scale.variance_factor() - 0.25).abs() < 0.01);
        for _ in 0..1000 {
            // The same residuals, now weighted with four times the a-priori variance.
            scale.learn(Fit { sum: 8.0, freedom: 8 }, 4.0, 1.0);
        }
        assert!((scale.variance_factor() - 4.0).abs() < 0.05);
        assert!(scale.freedom() <= MEMORY_FREEDOM * 1.01);
    }

    #[test]
    fn chosen_integers_fit_too_well() {
        let mut scale = NoiseScale::default();
        for _ in 0..200 {
            scale.learn_from_chosen(Fit { sum: 1.0, freedom: 4 }, 1.0, 1.0);
        }
        assert_eq!(scale.variance_factor(), 1.0);
        for _ in 0..200 {
            scale.learn_from_chosen(Fit { sum: 12.0, freedom: 4 }, 1.0, 1.0);
        }
        assert!(scale.variance_factor() > 1.5);
    }

    #[test]
    fn one_wild_epoch_does_not_blind_it() {
        let mut scale = NoiseScale::default();
        for _ in 0..100 {
            scale.learn(Fit { sum: 8.0, freedom: 8 }, 1.0, 1.0);
        }
        scale.learn(Fit { sum: 1e9, freedom: 8 }, 1.0, 1.0);
        assert!(scale.variance_factor() < 1.5);
    }
}
