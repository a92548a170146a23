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
//! ([`Slowness`]).

use std::collections::BTreeMap;

use crate::difference::Link;
use crate::float_solution::Fit;
use crate::float_solution::recursive::CORRELATION_S;
use crate::link_noise::{Common, expected_square};
use crate::signal::{Band, Satellite};
use crate::time::GpsTime;

/// Degrees of freedom that the a-priori level of the code counts for.
const CODE_PRIOR: f64 = 4.0;
/// Degrees of freedom that the tie between the levels of phase and code counts for: between receivers
/// and skies the variance ratio of the two varies by a factor of 1.6 (1 sigma), as a χ² of eight degrees does.
const PHASE_PRIOR: f64 = 8.0;
/// Degrees of freedom that the level of the session counts for beside one epoch's own residuals: as many as between
/// skies, which is what a passing reflection makes of one (beyond three sigmas are 1.5 % of the fixes of five bands in a
/// valley, 2.1 % without it: `bench/real_skies.py --only shadow`).
const EPOCH_PRIOR: f64 = 8.0;
/// Degrees of freedom that the level of all bands counts for on each band.
const BAND_PRIOR: f64 = 10.0;
/// Share that the bands of a satellite have in common before anything is known, and at least: the epochs that
/// matter are those of an edge or a strong reflection, in which nearly all is common, and the mean over
/// quiet ones hides them (with the session's mean alone 4.6 % of the fixes of five bands in a valley were beyond three
/// sigmas, with this 2.0 %: `bench/real_skies.py --only shadow`).
const MIN_COMMON: f64 = 0.5;
/// That share counts as from so many squares.
const COMMON_PRIOR: f64 = 30.0;
/// Degrees of freedom after which old epochs are forgotten: multipath changes over minutes.
const MEMORY: f64 = 1000.0;
/// No session is better than this share of the a-priori standard deviation.
const MIN_SCALE: f64 = 0.2;
/// "All noise changes slowly" counts as much as so many squares.
const SLOW_PRIOR: f64 = 100.0;
/// A residual teaches no more than one of 2.7 standard deviations would: outliers are no matter of the level.
pub(super) const MAX_SQUARE: f64 = 2.7 * 2.7;
/// Of what most residuals say: one teaches no more than one of 1.5 standard deviations would, so that the level bears reflections of a
/// third of the satellites, `MOST_MEAN/1.5²`. With 2.7 it grows without end from an eighth on.
const MOST_SQUARE: f64 = 1.5 * 1.5;
/// What this leaves of the squares of normal noise, `E min(z², k²) = 2Φ(k) − 1 − 2k φ(k) + 2k²(1 − Φ(k))` (Huber's proposal 2: Huber
/// and Ronchetti, *Robust Statistics*, section 6.4).
const MOST_MEAN: f64 = 0.778;
/// Share of common errors that baselines leave at least, so that nothing is divided by zero.
const MIN_LEFT: f64 = 0.2;
/// Beside fixes with so many times the degrees of freedom of [`PHASE_PRIOR`] that prior hardly counts.
const KNOWN: f64 = 10.0;
/// While the code's level is known with less than this, an epoch's own residuals enter its weights.
const YOUNG: f64 = 30.0;

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
        let keep = (1.0 - epoch.degrees_of_freedom / MEMORY).max(0.5);
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

/// Share `s` of the noise variance that changes slowly, in the time `τ` of a Gauss–Markov process; the rest is
/// white. It is the correlation of the residuals `z` of a link in successive epochs,
///
/// `E z_t z_{t−1} / E z² = s e^{−Δt/τ}`.
///
/// Squares of residuals `kΔt` apart then correlate by `s² e^{−2kΔt/τ}`, so that one epoch of a long series counts
/// as
///
/// `1 / (1 + 2 Σ_k s² e^{−2kΔt/τ}) ≈ 1 / (1 + s² τ/Δt)`
///
/// independent ones.
#[derive(Debug, Clone, Default)]
struct Slowness {
    /// Of the last epoch, sorted.
    last: Vec<(LinkKey, f64)>,
    last_time: Option<GpsTime>,
    products: f64,
    squares: f64,
}

/// In the order in which links stand, but for the codes of a band.
type LinkKey = (Band, Satellite, usize, u8);

impl Slowness {
    /// `s`
    fn share(&self) -> f64 {
        ((self.products + SLOW_PRIOR) / (self.squares + SLOW_PRIOR)).clamp(0.0, 1.0)
    }

    /// How much of an independent epoch one is that comes so long after the one before.
    fn weight(&self, elapsed_s: f64) -> f64 {
        let share = self.share();
        1.0 / (1.0 + share * share * CORRELATION_S / elapsed_s.max(1e-3))
    }

    /// Compares the residuals of an epoch with those of the one before.
    fn learn(&mut self, links: &[Link], residuals: &[(usize, f64)], time: GpsTime) {
        let key = |link: usize| {
            let Link { antenna, satellite, signal, .. } = links[link];
            (signal.band, satellite, antenna, signal.attribute)
        };
        let limit = MAX_SQUARE.sqrt();
        let mut now: Vec<(LinkKey, f64)> =
            residuals.iter().map(|(link, z)| (key(*link), z.clamp(-limit, limit))).collect();
        now.sort_by_key(|(key, _)| *key);
        let elapsed_s = self.last_time.map_or(f64::INFINITY, |last| time - last);
        let (mut products, mut squares) = (0.0, 0.0);
        if elapsed_s > 0.0 && elapsed_s < CORRELATION_S {
            let mut last = self.last.iter().peekable();
            for (key, z) in &now {
                while last.next_if(|(old, _)| old < key).is_some() {}
                let Some((_, before)) = last.next_if(|(old, _)| old == key) else { continue };
                products += z * before;
                squares += 0.5 * (z * z + before * before);
            }
            products *= (elapsed_s / CORRELATION_S).exp();
        }
        let keep = (1.0 - squares / MEMORY).max(0.5);
        self.products = self.products * keep + products;
        self.squares = self.squares * keep + squares;
        (self.last, self.last_time) = (now, Some(time));
    }
}

/// Sums that tell the share `κ` of the variance that the `B` bands of a satellite have in common. With the
/// normalised residuals `z_b` of one satellite at one antenna,
///
/// `E (Σ z_b)² / Σ z_b² = 1 + κ (B − 1)`.
///
/// The baselines take up a part of what is common, so the left side counts over the share that they leave.
#[derive(Debug, Clone, Copy, Default)]
struct CommonShare {
    /// `Σ ((Σ z_b)² / left − Σ z_b²)` and `Σ (B − 1) Σ z_b²`.
    together: f64,
    apart: f64,
}

impl CommonShare {
    fn kappa(self) -> f64 {
        let share = (self.together + MIN_COMMON * COMMON_PRIOR) / (self.apart + COMMON_PRIOR);
        share.clamp(MIN_COMMON, 1.0)
    }

    fn learn(&mut self, epoch: Self) {
        let keep = (1.0 - epoch.apart / MEMORY).max(0.5);
        self.together = self.together * keep + epoch.together;
        self.apart = self.apart * keep + epoch.apart;
    }
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
        residuals.teach(&mut self.code, overall, time, elapsed_s);
    }

    /// Learns from the phase residuals that integers leave which nothing else could have been.
    pub(super) fn learn_phase(&mut self, residuals: &Residuals) {
        let overall = self.phase_factor();
        let (time, elapsed_s) = (self.time(), self.elapsed_s);
        residuals.teach(&mut self.phase, overall, time, elapsed_s);
    }
}

/// Factor on the covariance of an epoch's baselines: what its own residuals say of the noise, beside
/// [`EPOCH_PRIOR`]. It only grows: residuals that happen to be small hide errors of the baselines no less.
pub(super) fn epoch_factor(
    links: &[Link],
    residuals: &[(usize, f64)],
    degrees_of_freedom: usize,
    baseline_unknowns: usize,
) -> f64 {
    let redundancies = &[];
    let epoch = Residuals { links, residuals, redundancies, degrees_of_freedom, baseline_unknowns };
    let fit = epoch.of_satellites();
    let degrees_of_freedom = EPOCH_PRIOR + fit.degrees_of_freedom as f64;
    ((EPOCH_PRIOR + fit.sum) / degrees_of_freedom).max(1.0)
}

/// Residuals of an epoch's links.
pub(super) struct Residuals<'a> {
    pub(super) links: &'a [Link],
    /// Normalised to a mean square of 1 over all links, in the order of the links.
    pub(super) residuals: &'a [(usize, f64)],
    /// Of each group the index of its first link and its share of the degrees of freedom: a band with few satellites
    /// has next to none, as its few errors are taken up by the terms of its receivers and satellites and by the baselines.
    pub(super) redundancies: &'a [(usize, f64)],
    /// Of all residuals together.
    pub(super) degrees_of_freedom: usize,
    pub(super) baseline_unknowns: usize,
}

impl Residuals<'_> {
    /// Teaches a kind of observation whose level of all bands is `overall`: of each band the squares that its residuals
    /// have, over those that they would have at the level in force.
    fn teach(&self, kind: &mut Kind, overall: f64, time: GpsTime, elapsed_s: f64) {
        kind.slowness.learn(self.links, self.residuals, time);
        let weight = kind.slowness.weight(elapsed_s);
        let kappa = kind.common.kappa();
        let expected = |link: &Link| expected_square(link.bands, kappa);
        // ê²/σ² = z² f/n
        let shown = self.degrees_of_freedom as f64 / self.residuals.len().max(1) as f64;
        let most_level = kind.most.factor(1.0, CODE_PRIOR);
        let (mut epoch, mut most) = (Squares::default(), Squares::default());
        let band_of = |residual: &(usize, f64)| self.links[residual.0].signal.band;
        for of_band in self.residuals.chunk_by(|a, b| band_of(a) == band_of(b)) {
            let band = band_of(&of_band[0]);
            let applied = kind.factor(band, overall);
            let mut own = Squares { degrees_of_freedom: weight * self.redundancy(band), sum: 0.0 };
            for (link, z) in of_band {
                let of_one = applied * shown / expected(&self.links[*link]);
                own.sum += weight * of_one * z.powi(2).min(MAX_SQUARE);
                let bounded = (of_one * z.powi(2)).min(MOST_SQUARE * most_level);
                most.sum += weight * bounded / MOST_MEAN;
            }
            most.degrees_of_freedom += own.degrees_of_freedom;
            epoch.sum += own.sum;
            epoch.degrees_of_freedom += own.degrees_of_freedom;
            kind.bands.entry(band).or_default().learn(own);
        }
        kind.all.learn(epoch);
        kind.most.learn(most);
        kind.common.learn(self.common(weight));
    }

    /// Degrees of freedom of a band.
    fn redundancy(&self, band: Band) -> f64 {
        let is_own = |(first, _): &&(usize, f64)| self.links[*first].signal.band == band;
        self.redundancies.iter().filter(is_own).map(|(_, redundancy)| redundancy).sum()
    }

    /// What the bands of each satellite have in common, of an epoch that counts with this weight.
    fn common(&self, weight: f64) -> CommonShare {
        let satellites = self.by_satellite();
        let left = self.left(satellites.len());
        let mut share = CommonShare::default();
        for Together { bands, sum, squares, .. } in satellites.into_iter().filter(|s| s.bands > 1) {
            share.together += weight * (sum * sum / left - squares);
            share.apart += weight * (bands - 1) as f64 * squares;
        }
        share
    }

    /// How well the satellites at each antenna fit, all bands of one together: `Σ (Σ z_b)²/B`, as a sum of squares
    /// of unit variance.
    fn of_satellites(&self) -> Fit {
        let satellites = self.by_satellite();
        let count = satellites.len();
        let hidden = self.hidden();
        let free = count as f64 * (1.0 - hidden.by_levels) - self.baseline_unknowns as f64;
        let sum: f64 = satellites.iter().map(|s| s.sum * s.sum / s.bands as f64).sum();
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
        // at most as many as there are satellites
        let degrees_of_freedom = free.max(0.0).round() as usize;
        let mean = sum / (count.max(1) as f64 * self.left(count));
        Fit { sum: mean * degrees_of_freedom as f64, degrees_of_freedom }
    }

    /// Shares of the errors that no residual shows.
    fn hidden(&self) -> Hidden {
        let links = self.residuals.len().max(1) as f64;
        let hidden = self.residuals.len().saturating_sub(self.degrees_of_freedom) as f64;
        Hidden { all: hidden / links, by_levels: (hidden - self.baseline_unknowns as f64) / links }
    }

    /// What residuals show of a satellite's common error, as a share of what they show of one link's: a residual of
    /// one link is a share of its error, of the common ones a smaller one, as the same unknowns stand against
    /// fewer errors.
    fn left(&self, satellites: usize) -> f64 {
        let hidden = self.hidden();
        let of_common = self.baseline_unknowns as f64 / satellites.max(1) as f64;
        let left = (1.0 - hidden.by_levels - of_common) / (1.0 - hidden.all).max(1e-3);
        left.max(MIN_LEFT)
    }

    /// Sums over the bands of each satellite at each antenna.
    fn by_satellite(&self) -> Vec<Together> {
        let limit = MAX_SQUARE.sqrt();
        let mut found: Vec<Together> = Vec::with_capacity(self.residuals.len());
        let mut next = 0;
        for (link, z) in self.residuals {
            let Link { antenna, satellite, .. } = self.links[*link];
            let (key, z) = ((antenna, satellite), z.clamp(-limit, limit));
            // Bands have their satellites in the same order.
            let place = match found.get(next) {
                Some(one) if one.key == key => next,
                _ => found.iter().position(|one| one.key == key).unwrap_or_else(|| {
                    found.push(Together { key, bands: 0, sum: 0.0, squares: 0.0 });
                    found.len() - 1
                }),
            };
            next = place + 1;
            let one = &mut found[place];
            *one = Together {
                key,
                bands: one.bands + 1,
                sum: one.sum + z,
                squares: one.squares + z * z,
            };
        }
        found
    }
}

/// The residuals of one satellite at one antenna.
#[derive(Debug, Clone, Copy)]
struct Together {
    key: (usize, Satellite),
    bands: usize,
    sum: f64,
    squares: f64,
}

/// Shares of the errors of links that the unknowns take up: all of them, and those that are no baselines.
#[derive(Debug, Clone, Copy)]
struct Hidden {
    all: f64,
    by_levels: f64,
}
