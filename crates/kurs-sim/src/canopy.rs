//! Leaves and branches between an antenna and a satellite.

use core::f64::consts::{FRAC_1_SQRT_2, TAU};

use nalgebra::Complex;

use crate::noise::{GaussMarkov, Noise};
use crate::scenario;

/// Code errors under leaves, in standard deviations of the code, and how long each lasts: what
/// recordings under trees show (5 to 30 times, for 10 to 100 s).
const CODE_TAIL: [f64; 2] = [5.0, 30.0];
const CODE_TAIL_S: [f64; 2] = [10.0, 100.0];

/// The leaves on the way of one satellite to one antenna.
///
/// The straight signal is weaker by a loss that changes as branches pass, and late, as wet leaves slow
/// it down; beside it comes a share of the lost power scattered, with a Rayleigh amplitude (Loo 1985, with
/// a Gaussian loss in dB that is never below zero). All is alike on all bands of the satellite.
#[derive(Debug, Clone, Default)]
pub(crate) struct Leaves {
    loss: GaussMarkov,
    scattered: [GaussMarkov; 2],
    tail: Option<CodeTail>,
}

/// A pseudorange that is far off for a while.
#[derive(Debug, Clone, Copy)]
struct CodeTail {
    until_s: f64,
    /// In standard deviations of the code.
    size: f64,
}

/// What the leaves do at an epoch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Shade {
    /// Amplitude of the straight signal.
    straight: f64,
    /// How late it is.
    late_m: f64,
    pub(crate) scattered: Complex<f64>,
    /// How late the code is, in its standard deviations.
    pub(crate) code_tail: f64,
}

impl Shade {
    /// What is left of a straight signal of this wavelength.
    pub(crate) fn straight(&self, wavelength_m: f64) -> Complex<f64> {
        Complex::from_polar(self.straight, -TAU * self.late_m / wavelength_m)
    }
}

impl Leaves {
    /// The shade at a later epoch of a canopy.
    pub(crate) fn shade(
        &mut self,
        plan: &scenario::Canopy,
        tag_s: f64,
        interval_s: f64,
        noise: &mut Noise,
    ) -> Shade {
        let loss_sds = self.loss.advance(tag_s, plan.loss_correlation_s, noise);
        let loss_db = (plan.loss_db + plan.loss_sd_db * loss_sds).max(0.0);
        let [re, im] = self
            .scattered
            .each_mut()
            .map(|part| part.advance(tag_s, plan.scatter_correlation_s, noise));
        let straight = 10f64.powf(-loss_db / 20.0);
        let rms = (plan.scattered_share * (1.0 - straight * straight)).sqrt();
        Shade {
            straight,
            late_m: plan.late_m_per_db * loss_db,
            scattered: Complex::new(re, im) * (rms * FRAC_1_SQRT_2),
            code_tail: self.code_tail(plan, tag_s, interval_s, noise),
        }
    }

    fn code_tail(
        &mut self,
        plan: &scenario::Canopy,
        tag_s: f64,
        interval_s: f64,
        noise: &mut Noise,
    ) -> f64 {
        self.tail = self.tail.filter(|tail| tag_s < tail.until_s);
        let per_epoch = plan.code_tails_per_hour * interval_s / 3600.0;
        if self.tail.is_none() && per_epoch > 0.0 && noise.uniform() < per_epoch {
            let sign = if noise.uniform() < 0.5 { -1.0 } else { 1.0 };
            let size = sign * noise.between(CODE_TAIL);
            self.tail = Some(CodeTail { until_s: tag_s + noise.between(CODE_TAIL_S), size });
        }
        self.tail.map_or(0.0, |tail| tail.size)
    }
}
