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
use crate::link_noise::{COMMON_CODE, COMMON_PHASE, expected_square};
use crate::signal::Band;
use crate::time::GpsTime;

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
const MAX_SQUARE: f64 = 2.7 * 2.7;
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

    /// Takes the squares of one epoch in.
    fn learn(&mut self, epoch: Self) {
        let keep = (1.0 - epoch.degrees_of_freedom / MEMORY).max(0.5);
        self.sum = self.sum * keep + epoch.sum;
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

    /// Learns from the code residuals of an epoch whose links were scaled by [`apply`](Self::apply): normalised
    /// squares of links, which have `degrees_of_freedom` together.
    pub(super) fn learn_code(
        &mut self,
        links: &[Link],
        squares: &[(usize, f64)],
        degrees_of_freedom: usize,
    ) {
        let overall = self.code_factor();
        let expected = |link: &Link| expected_square(link.bands, COMMON_CODE);
        let epoch = Residuals { links, squares, degrees_of_freedom, weight: self.weight };
        epoch.teach(&mut self.code, overall, expected);
    }

    /// Learns from the phase residuals that integers leave which nothing else could have been.
    pub(super) fn learn_phase(
        &mut self,
        links: &[Link],
        squares: &[(usize, f64)],
        degrees_of_freedom: usize,
    ) {
        let overall = self.phase_factor();
        let expected = |link: &Link| expected_square(link.bands, COMMON_PHASE);
        let epoch = Residuals { links, squares, degrees_of_freedom, weight: self.weight };
        epoch.teach(&mut self.phase, overall, expected);
    }
}

/// Normalised squares of an epoch's links.
struct Residuals<'a> {
    links: &'a [Link],
    squares: &'a [(usize, f64)],
    degrees_of_freedom: usize,
    weight: f64,
}

impl Residuals<'_> {
    /// Teaches a kind of observation whose level of all bands is `overall`.
    fn teach(&self, kind: &mut Kind, overall: f64, expected: impl Fn(&Link) -> f64) {
        // The unknowns take their share of every link.
        let share = self.weight * self.degrees_of_freedom as f64 / self.squares.len().max(1) as f64;
        let mut epoch = Squares::default();
        let band_of = |square: &(usize, f64)| self.links[square.0].signal.band;
        for of_band in self.squares.chunk_by(|a, b| band_of(a) == band_of(b)) {
            let band = band_of(&of_band[0]);
            let applied = kind.factor(band, overall);
            let mut own = Squares::default();
            for (link, square) in of_band {
                own.sum += share * applied * square.min(MAX_SQUARE) / expected(&self.links[*link]);
                own.degrees_of_freedom += share;
            }
            epoch.sum += own.sum;
            epoch.degrees_of_freedom += own.degrees_of_freedom;
            kind.bands.entry(band).or_default().learn(own);
        }
        kind.all.learn(epoch);
    }
}
