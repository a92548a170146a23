//! How noisy this session is: a level for code and one for phase on every band, learnt from residuals.
//!
//! A-priori standard deviations fit no receiver: between a survey antenna on a roof and a patch under
//! trees lies a factor of ten. Sigmas too small make every fix look inconsistent, sigmas too large make
//! every fix look unsure.
//!
//! *Code* residuals of the float solution need no integers: they teach from the first epoch on. *Phase*
//! residuals need integers, and integers that were chosen because they fit have residuals that are too
//! small. So only epochs whose model is so strong that nothing was chosen teach the phase level
//! ([`NoiseLevels::learn_phase`]). Until then it is tied to that of the code – reflections spoil both – and
//! known with the few degrees of freedom of [`PHASE_PRIOR`], over which the likelihood of the integers is
//! integrated (`likelihood.rs`).
//!
//! Multipath hardly changes from one epoch to the next, so an epoch counts as far as it is independent
//! of the one before.

use std::collections::BTreeMap;

use crate::difference::Link;
use crate::float_solution::recursive::CORRELATION_S;
use crate::float_solution::{Fit, FloatSolution};
use crate::link_noise;
use crate::signal::Band;
use crate::time::GpsTime;

/// Degrees of freedom that the a-priori level of the code counts for.
const CODE_PRIOR: f64 = 4.0;
/// Degrees of freedom that the tie between the levels of phase and code counts for: between receivers
/// and skies the ratio of the two varies by a factor of two (sd), as a χ² of three degrees does.
const PHASE_PRIOR: f64 = 3.0;
/// Degrees of freedom that the level of all bands counts for on each band.
const BAND_PRIOR: f64 = 10.0;
/// Degrees of freedom after which old epochs are forgotten: multipath changes over minutes.
const MEMORY: f64 = 1000.0;
/// No session is better than this share of the a-priori standard deviation.
const MIN_SCALE: f64 = 0.2;
/// One epoch moves a level by no more than this many times its expected residuals.
const MAX_EPOCH: f64 = 25.0;
/// While the code's level is known with less than this, an epoch's own residuals enter its weights.
const YOUNG: f64 = 30.0;

/// Squares in units of the a-priori variances, and the degrees of freedom they stand for.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct Squares {
    sum: f64,
    degrees_of_freedom: f64,
}

impl Squares {
    /// The variance factor with a prior of `degrees_of_freedom` around `factor`.
    fn factor(self, prior_factor: f64, degrees_of_freedom: f64) -> f64 {
        let sum = self.sum + prior_factor * degrees_of_freedom;
        (sum / (self.degrees_of_freedom + degrees_of_freedom)).max(MIN_SCALE * MIN_SCALE)
    }

    /// Takes the squares of one epoch in; `current` is the factor known so far.
    fn learn(&mut self, epoch: Self, current: f64) {
        let keep = (1.0 - epoch.degrees_of_freedom / MEMORY).max(0.5);
        let sum = epoch.sum.min(MAX_EPOCH * epoch.degrees_of_freedom * current);
        self.sum = self.sum * keep + sum;
        self.degrees_of_freedom = self.degrees_of_freedom * keep + epoch.degrees_of_freedom;
    }
}

/// One kind of observation.
#[derive(Debug, Clone, Default)]
struct Kind {
    all: Squares,
    bands: BTreeMap<Band, Squares>,
}

impl Kind {
    fn factor(&self, band: Band, overall: f64) -> f64 {
        self.bands.get(&band).map_or(overall, |squares| squares.factor(overall, BAND_PRIOR))
    }
}

/// The levels of the session.
#[derive(Debug, Clone, Default)]
pub(super) struct NoiseLevels {
    code: Kind,
    phase: Kind,
    last: Option<GpsTime>,
    /// Of the epoch, beside those before.
    weight: f64,
}

impl NoiseLevels {
    /// Begins the epoch at `time`: how much it counts beside those before, as the mean of a
    /// Gauss–Markov process demands.
    pub(super) fn begin(&mut self, time: GpsTime) {
        let elapsed_s = self.last.map_or(f64::INFINITY, |last| time - last);
        self.last = Some(time);
        self.weight = (elapsed_s / (2.0 * CORRELATION_S)).clamp(0.0, 1.0);
    }

    /// How much of an independent epoch this one is.
    pub(super) fn weight(&self) -> f64 {
        self.weight
    }

    fn code_factor(&self) -> f64 {
        self.code.all.factor(1.0, CODE_PRIOR)
    }

    /// Without a better knowledge phases are as much noisier than expected as the code is.
    fn phase_factor(&self) -> f64 {
        self.phase.all.factor(self.code_factor().max(1.0), PHASE_PRIOR)
    }

    /// Degrees of freedom with which the code's level is known.
    pub(super) fn code_degrees_of_freedom(&self) -> f64 {
        self.code.all.degrees_of_freedom + CODE_PRIOR
    }

    /// Degrees of freedom with which the phases' level is known.
    pub(super) fn phase_degrees_of_freedom(&self) -> f64 {
        self.phase.all.degrees_of_freedom + PHASE_PRIOR
    }

    /// Whether an epoch's own code residuals have to enter its weights.
    pub(super) fn is_young(&self) -> bool {
        self.code.all.degrees_of_freedom < YOUNG
    }

    /// Scales the a-priori variances of an epoch's links.
    pub(super) fn apply(&self, links: &mut [Link]) {
        let (code, phase) = (self.code_factor(), self.phase_factor());
        for of_band in links.chunk_by_mut(|a, b| a.signal.band == b.signal.band) {
            let band = of_band[0].signal.band;
            let (code, phase) = (self.code.factor(band, code), self.phase.factor(band, phase));
            for link in of_band {
                link.variances.code_m2 *= code;
                link.variances.phase_m2 *= phase;
            }
        }
    }

    /// Learns from the code residuals of an epoch whose links were scaled by [`apply`](Self::apply).
    pub(super) fn learn_code(&mut self, float: &FloatSolution, links: &[Link]) {
        let fits: Vec<_> = float.code_fits().map(|(first, fit)| (links[first], fit)).collect();
        let overall = self.code_factor();
        learn(&mut self.code, &fits, float.code_fit.degrees_of_freedom, overall, self.weight, |link| {
            link_noise::expected_square(link.bands, link_noise::COMMON_CODE)
        });
    }

    /// Learns from the phase residuals that integers leave which nothing else could have been.
    pub(super) fn learn_phase(&mut self, fits: &[(Link, Fit)], degrees_of_freedom: usize) {
        let overall = self.phase_factor();
        learn(&mut self.phase, fits, degrees_of_freedom, overall, self.weight, |link| {
            link_noise::expected_square(link.bands, link_noise::COMMON_PHASE)
        });
    }
}

/// `fits`: of each group a link, the weighted sum of its residuals and its double differences, which have
/// `degrees_of_freedom` together.
fn learn(
    kind: &mut Kind,
    fits: &[(Link, Fit)],
    degrees_of_freedom: usize,
    overall: f64,
    weight: f64,
    expected: impl Fn(&Link) -> f64,
) {
    let rows: usize = fits.iter().map(|(_, fit)| fit.degrees_of_freedom).sum();
    if rows == 0 {
        return;
    }
    // The unknowns take their share of every group.
    let share = weight * degrees_of_freedom as f64 / rows as f64;
    let mut epoch = Squares::default();
    for (link, fit) in fits {
        let band = link.signal.band;
        let applied = kind.factor(band, overall);
        let own = Squares {
            sum: weight * fit.sum * applied / expected(link),
            degrees_of_freedom: share * fit.degrees_of_freedom as f64,
        };
        epoch.sum += own.sum;
        epoch.degrees_of_freedom += own.degrees_of_freedom;
        kind.bands.entry(band).or_default().learn(own, applied);
    }
    kind.all.learn(epoch, overall);
}
