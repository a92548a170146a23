//! How noisy this session is: a level for code and one for phase on every band, learnt from residuals.
//!
//! A-priori standard deviations fit no receiver: between a survey antenna on a roof and a patch under
//! trees lies a factor of ten. Sigmas too small make every fix look inconsistent, sigmas too large make
//! every fix look unsure.
//!
//! *Code* residuals of the float solution need no integers: they teach from the first epoch on. *Phase*
//! residuals need integers, and integers that were chosen because they fit have residuals that are too
//! small. So only epochs whose model is so strong that nothing was chosen teach the phase level
//! ([`NoiseLevels::learn_phase`]). Until then it is that of most of the code – reflections spoil both – or, if
//! that is more, what the changes of the phases from epoch to epoch show (`phase_changes.rs`), and is known with
//! the few degrees of freedom of [`PHASE_PRIOR`], over which the likelihood of the integers is integrated
//! (`likelihood.rs`).
//!
//! Multipath hardly changes from one epoch to the next, so an epoch counts as far as it is independent
//! of the one before. How much of the noise is of that slow kind the residuals of successive epochs tell
//! ([`Slowness`], `slowness.rs`).

use std::collections::BTreeMap;

use crate::difference::Link;
use crate::float_solution::recursive::CORRELATION_S;
use crate::link_noise::{Common, expected_square};
use crate::signal::Band;
use crate::time::GpsTime;

use super::residuals::{CommonShare, Residuals};
use super::slowness::Slowness;

/// Degrees of freedom that the a-priori level of the code counts for.
const CODE_PRIOR: f64 = 4.0;
/// Degrees of freedom that the tie between the levels of phase and code counts for: between receivers
/// and skies the variance ratio of the two varies by a factor of 1.6 (1 sigma), as a χ² of eight degrees does.
const PHASE_PRIOR: f64 = 8.0;
/// Degrees of freedom that the level of all bands counts for on each band.
const BAND_PRIOR: f64 = 10.0;
/// Degrees of freedom after which old epochs are forgotten: multipath changes over minutes.
const MEMORY: f64 = 1000.0;
/// No session is better than this share of the a-priori standard deviation.
const MIN_SCALE: f64 = 0.2;
/// A residual teaches no more than one of 2.7 standard deviations would: outliers are no matter of the level.
pub(super) const MAX_SQUARE: f64 = 2.7 * 2.7;
/// For the level of most residuals: one teaches no more than one of 1.5 standard deviations would, so that the level
/// holds with reflections of a third of the satellites, `MOST_MEAN/1.5²`; with 2.7 it would grow without end from an
/// eighth on.
const MOST_SQUARE: f64 = 1.5 * 1.5;
/// What this leaves of the squares of normal noise, `E min(z², k²) = 2Φ(k) − 1 − 2k φ(k) + 2k²(1 − Φ(k))` (Huber's
/// proposal 2: Huber and Ronchetti, *Robust Statistics*, section 6.4).
const MOST_MEAN: f64 = 0.778;
/// Beside fixes with so many times the degrees of freedom of [`PHASE_PRIOR`] that prior hardly counts.
const KNOWN: f64 = 10.0;
/// While the code's level is known with less than this, an epoch's own residuals enter its weights.
const YOUNG: f64 = 30.0;

/// Share of what old epochs have taught that remains beside so many new squares.
pub(super) fn kept(news: f64) -> f64 {
    (1.0 - news / MEMORY).max(0.5)
}

/// Squares in units of the a-priori variances, and the degrees of freedom they stand for.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Squares {
    pub(super) sum: f64,
    pub(super) degrees_of_freedom: f64,
}

impl Squares {
    /// The variance factor with a prior of `degrees_of_freedom` around `factor`.
    fn factor(self, prior_factor: f64, degrees_of_freedom: f64) -> f64 {
        let sum = self.sum + prior_factor * degrees_of_freedom;
        (sum / (self.degrees_of_freedom + degrees_of_freedom)).max(MIN_SCALE * MIN_SCALE)
    }

    /// Two standard deviations `√(2/f)` of the mean square below what it is beside [`PHASE_PRIOR`]: the greater of two
    /// levels shall not be the greater one by chance.
    fn least(self) -> f64 {
        let degrees_of_freedom = self.degrees_of_freedom + PHASE_PRIOR;
        self.factor(1.0, PHASE_PRIOR) * (1.0 - 2.0 * (2.0 / degrees_of_freedom).sqrt())
    }

    /// Takes the squares of one epoch in.
    fn learn(&mut self, epoch: Self) {
        let keep = kept(epoch.degrees_of_freedom);
        self.sum = self.sum * keep + epoch.sum;
        self.degrees_of_freedom = self.degrees_of_freedom * keep + epoch.degrees_of_freedom;
    }
}

/// One kind of observation.
#[derive(Debug, Clone, Default)]
struct Kind {
    all: Squares,
    /// What most residuals say, whatever the outliers do.
    most: Squares,
    bands: BTreeMap<Band, Squares>,
    common: CommonShare,
    slowness: Slowness,
}

impl Kind {
    fn factor(&self, band: Band, overall: f64) -> f64 {
        self.bands.get(&band).map_or(overall, |squares| squares.factor(overall, BAND_PRIOR))
    }

    /// Learns from the residuals of an epoch, the level of all bands being `overall`: of each band the squares that its
    /// residuals have, over those that they would have at the level in force.
    fn learn(&mut self, of_epoch: &Residuals, overall: f64, time: GpsTime, elapsed_s: f64) {
        let Residuals { links, residuals, .. } = *of_epoch;
        self.slowness.learn(links, residuals, time);
        let weight = self.slowness.weight(elapsed_s);
        let kappa = self.common.kappa();
        let expected = |link: &Link| expected_square(link.bands, kappa);
        // ê²/σ² = z² f/n
        let shown = of_epoch.degrees_of_freedom as f64 / residuals.len().max(1) as f64;
        let most_level = self.most.factor(1.0, CODE_PRIOR);
        let (mut epoch, mut most) = (Squares::default(), Squares::default());
        let band_of = |residual: &(usize, f64)| links[residual.0].signal.band;
        for of_band in residuals.chunk_by(|a, b| band_of(a) == band_of(b)) {
            let band = band_of(&of_band[0]);
            let applied = self.factor(band, overall);
            let mut own =
                Squares { degrees_of_freedom: weight * of_epoch.redundancy(band), sum: 0.0 };
            for (link, z) in of_band {
                let of_one = applied * shown / expected(&links[*link]);
                own.sum += weight * of_one * z.powi(2).min(MAX_SQUARE);
                let bounded = (of_one * z.powi(2)).min(MOST_SQUARE * most_level);
                most.sum += weight * bounded / MOST_MEAN;
            }
            most.degrees_of_freedom += own.degrees_of_freedom;
            epoch.sum += own.sum;
            epoch.degrees_of_freedom += own.degrees_of_freedom;
            self.bands.entry(band).or_default().learn(own);
        }
        self.all.learn(epoch);
        self.most.learn(most);
        self.common.learn(of_epoch.common(weight));
    }
}

/// The levels of the session.
#[derive(Debug, Clone, Default)]
pub(super) struct NoiseLevels {
    code: Kind,
    phase: Kind,
    /// Of the phases' changes from epoch to epoch.
    changes: Squares,
    /// Of the epoch, and what has passed since the one before.
    time: Option<GpsTime>,
    elapsed_s: f64,
}

impl NoiseLevels {
    /// Begins the epoch at `time`.
    pub(super) fn begin(&mut self, time: GpsTime) {
        self.elapsed_s = self.time.map_or(f64::INFINITY, |last| (time - last).max(0.0));
        self.time = Some(time);
    }

    /// Of the epoch that has begun.
    pub(super) fn time(&self) -> GpsTime {
        self.time.unwrap_or_default()
    }

    /// Share of the variance of the phases' noise that changes slowly.
    pub(super) fn slow_share(&self) -> f64 {
        self.phase.slowness.share()
    }

    /// How much of an independent epoch the squares of this one are, of code and phases.
    pub(super) fn weight_of_squares(&self) -> f64 {
        let weight = |kind: &Kind| kind.slowness.weight(self.elapsed_s);
        weight(&self.code).min(weight(&self.phase))
    }

    /// How much of an independent epoch this one is if all noise changes slowly, as the mean of a
    /// Gauss–Markov process demands.
    pub(super) fn weight(&self) -> f64 {
        (self.elapsed_s / (2.0 * CORRELATION_S)).min(1.0)
    }

    fn code_factor(&self) -> f64 {
        self.code.all.factor(1.0, CODE_PRIOR)
    }

    /// Until learnt, phases are as much noisier than assumed as most of the code, or as their changes show.
    fn phase_factor(&self) -> f64 {
        let code = self.code_factor().min(self.code.most.factor(1.0, CODE_PRIOR));
        self.phase.all.factor(code.max(self.least_phase_factor()), PHASE_PRIOR)
    }

    /// What the changes of the phases show, whatever the integers and the geometry are; 1 or more.
    pub(super) fn least_phase_factor(&self) -> f64 {
        self.changes.least().max(1.0)
    }

    /// Whether the changes of the phases still say something: fixes have not taught their level.
    pub(super) fn want_changes(&self) -> bool {
        self.phase.all.degrees_of_freedom < KNOWN * PHASE_PRIOR
    }

    /// Learns from what the changes of the phases leave, in units of the a-priori variances.
    pub(super) fn learn_changes(&mut self, changes: Squares) {
        self.changes.learn(changes);
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

    /// Shares of the variances that the bands of a satellite have in common.
    pub(super) fn common(&self) -> Common {
        Common { code: self.code.common.kappa(), phase: self.phase.common.kappa() }
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
    pub(super) fn learn_code(&mut self, residuals: &Residuals) {
        let overall = self.code_factor();
        let (time, elapsed_s) = (self.time(), self.elapsed_s);
        self.code.learn(residuals, overall, time, elapsed_s);
    }

    /// Learns from the phase residuals that integers leave which nothing else could have been.
    pub(super) fn learn_phase(&mut self, residuals: &Residuals) {
        let overall = self.phase_factor();
        let (time, elapsed_s) = (self.time(), self.elapsed_s);
        self.phase.learn(residuals, overall, time, elapsed_s);
    }
}
