//! Reproducible noise: the same seed gives the same numbers, for ever, by a named generator.

use nalgebra::Vector3;
use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use rand_xoshiro::Xoshiro256PlusPlus;

/// Normally distributed numbers from xoshiro256++.
#[derive(Debug, Clone)]
pub struct Noise {
    generator: Xoshiro256PlusPlus,
}

impl Noise {
    /// A sequence of its own for every seed.
    #[must_use]
    pub fn seeded(seed: u64) -> Self {
        Self { generator: Xoshiro256PlusPlus::seed_from_u64(seed) }
    }

    /// One number with mean zero and a standard deviation.
    pub fn normal(&mut self, standard_deviation: f64) -> f64 {
        let unit: f64 = StandardNormal.sample(&mut self.generator);
        unit * standard_deviation
    }

    /// Three independent ones.
    pub fn normal3(&mut self, standard_deviation: f64) -> Vector3<f64> {
        Vector3::from_fn(|_, _| self.normal(standard_deviation))
    }

    /// One number evenly distributed between 0 and 1.
    pub fn uniform(&mut self) -> f64 {
        self.generator.random()
    }

    /// One number evenly distributed between two others.
    pub(crate) fn between(&mut self, [low, high]: [f64; 2]) -> f64 {
        low + (high - low) * self.uniform()
    }

    /// A sequence of its own for each of several users of one seed.
    #[must_use]
    pub fn stream(seed: u64, user: u64) -> Self {
        // Multiplication by an odd constant (2⁶⁴ over the golden ratio) sets neighbours apart.
        Self::seeded(seed ^ (user + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15))
    }
}

/// Coloured noise of mean zero and variance one, a first-order Gauss-Markov process.
#[derive(Debug, Clone, Copy)]
pub(crate) struct GaussMarkov {
    value: f64,
    /// When it had this value.
    time_s: f64,
}

impl Default for GaussMarkov {
    fn default() -> Self {
        Self { value: 0.0, time_s: f64::NEG_INFINITY }
    }
}

impl GaussMarkov {
    /// Moves on from the last value, however long ago (at first: for ever):
    /// x ← φ x + √(1 − φ²) w, φ = exp(−Δt / τ).
    pub(crate) fn advance(&mut self, time_s: f64, correlation_s: f64, noise: &mut Noise) -> f64 {
        let kept = ((self.time_s - time_s) / correlation_s).exp();
        self.time_s = time_s;
        self.value = kept * self.value + noise.normal((1.0 - kept * kept).sqrt());
        self.value
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn same_seed_same_numbers() {
        let (mut a, mut b, mut c) = (Noise::seeded(7), Noise::seeded(7), Noise::seeded(8));
        let first: Vec<f64> = (0..5).map(|_| a.normal(2.0)).collect();
        assert_eq!(first, (0..5).map(|_| b.normal(2.0)).collect::<Vec<_>>());
        assert_ne!(first[0], c.normal(2.0));
    }

    /// Mean and variance of 10 000 numbers inside their 99.9 % bands.
    #[test]
    fn normal_moments() {
        let mut noise = Noise::seeded(1);
        let values: Vec<f64> = (0..10_000).map(|_| noise.normal(3.0)).collect();
        let mean = values.iter().sum::<f64>() / 10_000.0;
        let variance = values.iter().map(|v| v * v).sum::<f64>() / 10_000.0;
        assert!(mean.abs() < 3.3 * 0.03, "{mean}");
        assert!((variance / 9.0 - 1.0).abs() < 3.3 * (2f64 / 10_000.0).sqrt(), "{variance}");
    }
}
