//! How well the best integers of a session fit, accepted or not.
//!
//! The cost of right integers in the float solution's own metric is χ² with a degree of freedom for each
//! ambiguity and each constrained coordinate, and that of the best ones is no larger. If a length is wrong
//! none of the candidates is right, and the cheapest one costs what chance makes the nearest of many lattice points
//! cost. One epoch says little of that; the sum over independent epochs says it all.

use crate::chi_square::fisher_tail;
use crate::float_solution::Fit;
use crate::time::GpsTime;

/// Time in which the past fades to 1/e, s: as the ambiguities of `float_solution::recursive`.
const FADING_S: f64 = 300.0;
/// An epoch counts for no more than this many times its degrees of freedom: one wild epoch is no proof.
const MAX_EXCESS: f64 = 16.0;
/// Degrees of freedom of the code's level, over which it is not trusted: its tails are not Gaussian.
const MAX_KNOWN: f64 = 60.0;

/// Probability that a configuration has a wrong length or place, before anything was seen: one in a hundred.
const PRIOR_DOUBT: f64 = 1e-2;
/// Below this doubt the geometry is out of the question, unless the fit gets bad.
const MIN_DOUBT: f64 = 1e-7;

/// Sums over the recent epochs.
#[derive(Debug, Clone, Default)]
pub(super) struct SessionFit {
    sum: f64,
    degrees_of_freedom: f64,
    /// Independent epochs.
    epochs: f64,
    time: Option<GpsTime>,
}

impl SessionFit {
    /// Takes in the cost of an epoch's best integers, which is `weight` of an independent one.
    pub(super) fn take(&mut self, fit: Fit, weight: f64, time: GpsTime) {
        let elapsed_s = self.time.map_or(0.0, |before| (time - before).max(0.0));
        self.time = Some(time);
        let keep = (-elapsed_s / FADING_S).exp();
        let degrees_of_freedom = fit.degrees_of_freedom as f64;
        self.sum = self.sum * keep + weight * fit.sum.min(MAX_EXCESS * degrees_of_freedom);
        self.degrees_of_freedom = self.degrees_of_freedom * keep + weight * degrees_of_freedom;
        self.epochs = self.epochs * keep + weight;
    }

    /// Probability that the known geometry is wrong: each independent epoch whose integers fit leaves a tenth
    /// of it, as wrong geometry makes the cheapest candidate cost about twice its degrees of freedom.
    pub(super) fn doubt(&self) -> f64 {
        let excess =
            (self.sum - self.degrees_of_freedom) / (2.0 * self.degrees_of_freedom).max(1.0).sqrt();
        let evidence = (self.epochs - excess.max(0.0)).max(0.0);
        let doubt = PRIOR_DOUBT * 10f64.powf(-evidence);
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
