//! How well the best integers of a session fit, accepted or not.
//!
//! The cost of right integers in the float solution's own metric is χ² with a degree of freedom for each
//! ambiguity and each constrained coordinate, and that of the best ones is no larger. If a length is wrong
//! none of the candidates is right, and the cheapest one costs what chance makes the nearest of many lattice points
//! cost. One epoch says little of that; the sum over independent epochs says it all.

use crate::chi_square::fisher_tail;
use crate::float_solution::Fit;
use crate::float_solution::recursive::FADING_S;
use crate::time::GpsTime;

/// An epoch counts for no more than this many times its degrees of freedom: one wild epoch is no proof.
const MAX_EXCESS: f64 = 16.0;
/// Cap on the degrees of freedom of the code's level: its tails are heavier than Gaussian.
const MAX_KNOWN: f64 = 60.0;

/// Odds of a wrong length or place in a configuration, before anything was seen: half of the usual rate of wrong fixes,
/// so that a session of which nothing speaks against its geometry loses few of them (`… --example predicted_integers`).
const PRIOR_DOUBT: f64 = 5e-4;
/// Mean square that a wrong geometry gives the cheapest candidate, about.
const WRONG_MEAN: f64 = 2.0;
/// A mean square that speaks for neither: with a wrong geometry a sum of squares `q` of `f` degrees of freedom is
/// `2^{−f/2} e^{q/4}` times as probable as with the right one, which is 1 for `q = 2 ln 2 · f`.
const NEUTRAL_MEAN: f64 = 2.0 * core::f64::consts::LN_2;
/// Upper bound of these odds where epochs fit badly: so large that told lengths which are 5 cm wrong are refused, so
/// small that a right one under trees keeps most of its fixes
/// (`cargo run --release -p kurs-sim --example real_skies -- 10 told`, `… --example wrong_fixes -- 1800 canopy`).
const MAX_DOUBT: f64 = 0.1;
/// With noise of more than this many times the variance that earlier epochs were judged by, they say nothing of the
/// geometry.
const GROWN: f64 = 1.25;
/// Below this doubt the geometry is out of the question, unless the fit gets bad.
const MIN_DOUBT: f64 = 1e-7;

/// Sums over the recent epochs.
#[derive(Debug, Clone, Default)]
pub(super) struct SessionFit {
    sum: f64,
    degrees_of_freedom: f64,
    /// Log₁₀ odds for the known geometry: an independent epoch with mean square 1 adds one.
    evidence: f64,
    time: Option<GpsTime>,
    /// Least noise of the phases by which the first of them was judged.
    least_noise: f64,
}

/// What an epoch says of the known geometry.
#[derive(Debug, Clone, Copy)]
pub(super) enum Geometry {
    /// So it fits.
    Fits(Fit),
    /// In a weak model some integers always fit: only that none do says something.
    OnlyAgainst(Fit),
}

fn mean_square(fit: Fit) -> f64 {
    fit.sum / (fit.degrees_of_freedom as f64).max(1.0)
}

impl SessionFit {
    /// Begins anew if the least noise of the phases, a factor on their variances, turns out to be larger than was
    /// thought.
    pub(super) fn hear_of_noise(&mut self, least_noise: f64) {
        if least_noise > GROWN * self.least_noise {
            *self = Self { least_noise, ..Self::default() };
        }
    }

    /// Takes in the cost of an epoch's best integers, which is `weight` of an independent one, and what it says of the
    /// known `geometry`; where it only speaks against that, a good fit is no evidence for it.
    pub(super) fn take(&mut self, fit: Fit, geometry: Geometry, weight: f64, time: GpsTime) {
        let elapsed_s = self.time.map_or(0.0, |before| (time - before).max(0.0));
        self.time = Some(time);
        let keep = (-elapsed_s / FADING_S).exp();
        let degrees_of_freedom = fit.degrees_of_freedom as f64;
        self.sum = self.sum * keep + weight * fit.sum.min(MAX_EXCESS * degrees_of_freedom);
        self.degrees_of_freedom = self.degrees_of_freedom * keep + weight * degrees_of_freedom;
        let mean = match geometry {
            Geometry::Fits(fit) => mean_square(fit).min(WRONG_MEAN),
            Geometry::OnlyAgainst(fit) => mean_square(fit).clamp(NEUTRAL_MEAN, WRONG_MEAN),
        };
        self.evidence =
            self.evidence * keep + weight * (NEUTRAL_MEAN - mean) / (NEUTRAL_MEAN - 1.0);
    }

    /// Odds of a wrong geometry; those that reflections raise too have their bound.
    pub(super) fn doubt(&self) -> f64 {
        let doubt = (PRIOR_DOUBT * 10f64.powf(-self.evidence)).min(MAX_DOUBT);
        if doubt < MIN_DOUBT { 0.0 } else { doubt }
    }

    /// The sum, and its probability if the integers of these epochs are right and the code's level is known
    /// with `known` degrees of freedom.
    pub(super) fn judge(&self, known: f64) -> (Fit, f64) {
        let p_value = fisher_tail(self.sum, self.degrees_of_freedom, known.min(MAX_KNOWN));
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // some thousands
        let degrees_of_freedom = self.degrees_of_freedom.round() as usize;
        (Fit { sum: self.sum, degrees_of_freedom }, p_value)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The odds after so many independent epochs, a second apart, of ten degrees of freedom each.
    fn after(epochs: u8, mean: f64) -> f64 {
        let mut session = SessionFit::default();
        for second in 0..epochs {
            let time = GpsTime::default() + f64::from(second);
            let fit = Fit { sum: 10.0 * mean, degrees_of_freedom: 10 };
            session.take(fit, Geometry::Fits(fit), 1.0, time);
        }
        session.doubt()
    }

    #[test]
    fn epochs_that_fit_end_the_doubt() {
        assert!((after(0, 1.0) - PRIOR_DOUBT).abs() < 1e-12);
        // The first of three has faded by 2/300.
        assert!((after(3, 1.0) / (PRIOR_DOUBT * 10f64.powf(-2.99)) - 1.0).abs() < 0.02);
        assert!(after(6, 1.0) == 0.0);
    }

    /// What did not fit by less noise than there is says nothing.
    #[test]
    fn more_noise_begins_anew() {
        let fit = Fit { sum: 40.0, degrees_of_freedom: 10 };
        let mut session = SessionFit::default();
        let p_values = [1.0, 1.05, 4.0].map(|least_noise| {
            session.hear_of_noise(least_noise);
            session.take(fit, Geometry::Fits(fit), 1.0, GpsTime::default());
            session.judge(MAX_KNOWN).1
        });
        assert!(p_values[1] < 0.1 * p_values[0] && p_values[2] == p_values[0]);
    }

    #[test]
    fn epochs_that_do_not_fit_raise_it() {
        assert!((after(5, NEUTRAL_MEAN) / PRIOR_DOUBT - 1.0).abs() < 1e-9);
        assert!((after(5, 2.0) - MAX_DOUBT).abs() < 1e-12);
        // One wild epoch is no proof.
        let of_one = PRIOR_DOUBT * 10f64.powf((WRONG_MEAN - NEUTRAL_MEAN) / (NEUTRAL_MEAN - 1.0));
        assert!((after(1, 1e9) / of_one - 1.0).abs() < 1e-9 && of_one < 0.2 * MAX_DOUBT);
    }
}
