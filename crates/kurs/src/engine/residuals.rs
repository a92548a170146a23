//! Residuals of an epoch's links, and what they say of each satellite: the errors that its bands have in common.

use crate::difference::Link;
use crate::float_solution::Fit;
use crate::signal::{Band, Satellite};

use super::noise_levels::{MAX_SQUARE, kept};

/// Degrees of freedom that the level of the session counts for beside one epoch's own residuals: as many as between
/// skies, which is what a passing reflection makes of one (beyond three sigmas are 1.5 % of the fixes of five bands in
/// a valley, 2.1 % without it: `bench/real_skies.py --only shadow`).
const EPOCH_PRIOR: f64 = 8.0;
/// Share that the bands of a satellite have in common before anything is known, and at least: the epochs that
/// matter are those of an edge or a strong reflection, in which nearly all is common, and the mean over
/// quiet ones hides them (with the session's mean alone 4.6 % of the fixes of five bands in a valley were beyond three
/// sigmas, with this 2.0 %: `bench/real_skies.py --only shadow`).
const MIN_COMMON: f64 = 0.5;
/// That share counts as from so many squares.
const COMMON_PRIOR: f64 = 30.0;
/// Share of common errors that baselines leave at least, so that nothing is divided by zero.
const MIN_LEFT: f64 = 0.2;

/// Residuals of an epoch's links.
pub(super) struct Residuals<'a> {
    pub(super) links: &'a [Link],
    /// Normalised to a mean square of 1 over all links, in the order of the links.
    pub(super) residuals: &'a [(usize, f64)],
    /// Of each group the index of its first link and its share of the degrees of freedom: a band with few satellites
    /// has next to none, as its few errors are taken up by the terms of its receivers and satellites and by the
    /// baselines.
    pub(super) redundancies: &'a [(usize, f64)],
    /// Of all residuals together.
    pub(super) degrees_of_freedom: usize,
    pub(super) baseline_unknowns: usize,
}

impl Residuals<'_> {
    /// Degrees of freedom of a band.
    pub(super) fn redundancy(&self, band: Band) -> f64 {
        let is_own = |(first, _): &&(usize, f64)| self.links[*first].signal.band == band;
        self.redundancies.iter().filter(is_own).map(|(_, redundancy)| redundancy).sum()
    }

    /// What the bands of each satellite have in common, of an epoch that counts with this weight.
    pub(super) fn common(&self, weight: f64) -> CommonShare {
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

/// Sums that tell the share `κ` of the variance that the `B` bands of a satellite have in common. With the
/// normalised residuals `z_b` of one satellite at one antenna,
///
/// `E (Σ z_b)² / Σ z_b² = 1 + κ (B − 1)`.
///
/// The baselines take up a part of what is common, so the left side counts over the share that they leave.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct CommonShare {
    /// `Σ ((Σ z_b)² / left − Σ z_b²)` and `Σ (B − 1) Σ z_b²`.
    together: f64,
    apart: f64,
}

impl CommonShare {
    pub(super) fn kappa(self) -> f64 {
        let share = (self.together + MIN_COMMON * COMMON_PRIOR) / (self.apart + COMMON_PRIOR);
        share.clamp(MIN_COMMON, 1.0)
    }

    pub(super) fn learn(&mut self, epoch: Self) {
        let keep = kept(epoch.apart);
        self.together = self.together * keep + epoch.together;
        self.apart = self.apart * keep + epoch.apart;
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
