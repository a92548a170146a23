//! Whether an epoch is fixed: one list of checks, each a statistic with its probability against one level.
//!
//! Two things may go wrong, and each has its own budget.
//!
//! * *Wrong integers accepted*: of the fixes a share of [`Settings::max_wrong_fix_rate`] may be wrong. The
//!   likelihood of the other integers (`likelihood.rs`) is held against it.
//! * *Right integers refused*: all other checks ask whether what was found is what right integers of the known
//!   array would leave. Each refuses a right epoch with the probability [`FALSE_ALARM`].
//!
//! The list, in its order; the first check that fails gives the row its reason:
//!
//! | of | holds if | reason | statistic from |
//! |---|---|---|---|
//! | session | the best integers of the recent epochs fit what is known | of the constraint: `residuals`, `length`, `geometry` | `session_fit.rs` |
//! | session | the mean shape of the array is the known one | `geometry` | `array_misfit.rs` |
//! | positions | satellites do not contradict each other, where nothing is known of the array | `residuals` | `locate.rs` |
//! | integers | right ones would make the baselines certain to 0.3 m | `weak_model` | `float_solution/conditional.rs` |
//! | integers | all others are improbable | `ratio`; `success_rate` of weak models | `likelihood.rs` |
//! | integers | they are so even if the geometry is wrong, until it has proven itself | `unproven` | `search.rs` |
//! | integers | they close around triangles of antennas | `closure` | `search.rs` |
//! | integers | the phases fit | `residuals` | `float_solution/conditional.rs` |
//! | integers | code and phases fit with what is known | of the constraint | `search.rs` |
//! | baselines | each has its length | `length` | `estimator.rs` |
//! | baselines | together they have the known shape | `geometry` | `orientation.rs` |
//! | attitude | there is one, and one only | `two_minima` and others of `orientation.rs` | |
//! | attitude | the body can tilt so | `tilt` | |
//! | prediction | it does not refute the fix | `residuals` | `predicted_attitude.rs` |
//! | witness | epochs before do not contradict | `contradiction` | `witness.rs` |
//! | witness | one agrees, or the model is strong | `unproven` | `witness.rs` |
//!
//! Those of baselines, attitude and prediction are made of sure integers, those of the witness where all others hold.
//!
//! Noise levels are known with some degrees of freedom only, so sums of squares are judged by Fisher's
//! distribution instead of χ² ([`Scale`]), for all checks alike.
//!
//! [`Settings::max_wrong_fix_rate`]: super::Settings::max_wrong_fix_rate

use crate::chi_square::fisher_tail;
use crate::float_solution::{Conditional, Fit};
use crate::solution::{AttitudeEstimate, Check, Outcome, PredictionRole, Reason};

use super::orientation::Orientation;
use super::search::Found;
use super::settings::{Constraint, Settings};
use super::witness::Testimony;

/// A hundredth of the share of epochs that any user notices as missing, one in a thousand, for each of ten
/// checks: with ten times as many alarms single epochs get lost, with a tenth arrays wrong by some
/// centimetres get through a few rows more.
const FALSE_ALARM: f64 = 1e-5;
/// Baselines that stay less certain than this, although the integers are known, have a geometry so poor that
/// other integers fit as well, m.
const MAX_FIXED_SD_M: f64 = 0.3;
/// A model that was expected to be right less often than this is too weak to blame the rivals.
const MIN_SUCCESS: f64 = 0.5;

/// Satellites that contradict each other by this many times the noise of code, at every antenna, and of which no few
/// are at fault, are not those they say: on none of the wrong paths of a street does the code come to all antennas so
/// late.
const CONTRADICTORY_RMS: f64 = 10.0;

/// Degrees of freedom behind the noise level by which an epoch is judged.
#[derive(Debug, Clone, Copy)]
pub(super) struct Scale {
    pub(super) degrees_of_freedom: f64,
}

impl Scale {
    /// Probability of a sum of normalised squares as large as this or larger.
    pub(super) fn probability(self, sum: f64, degrees_of_freedom: usize) -> f64 {
        fisher_tail(sum, degrees_of_freedom as f64, self.degrees_of_freedom)
    }
}

/// The checks that an epoch went through, in their order.
#[derive(Debug, Clone, Default)]
pub(super) struct Checks(pub(super) Vec<Check>);

impl Checks {
    /// What becomes of the epoch: the first check that fails decides. Where phases were lost just now, they
    /// are the reason that integers are not sure.
    pub(super) fn outcome(
        &self,
        attitude: Result<AttitudeEstimate, Reason>,
        began_anew: bool,
    ) -> Outcome {
        let failed = self.0.iter().find(|check| check.fails()).map(|check| check.reason);
        match (failed, attitude) {
            (None, Ok(attitude)) => Outcome::Fixed { attitude },
            (Some(Reason::Ratio | Reason::SuccessRate), attitude) if began_anew => {
                Outcome::Float { attitude: attitude.ok(), reason: Some(Reason::Slip) }
            }
            (Some(reason), attitude) if is_unsure(reason) => {
                Outcome::Float { attitude: attitude.ok(), reason: Some(reason) }
            }
            (Some(reason), attitude) => Outcome::Inconsistent { attitude: attitude.ok(), reason },
            (None, Err(reason)) => Outcome::Inconsistent { attitude: None, reason },
        }
    }

    /// Whether none fails.
    pub(super) fn hold(&self) -> bool {
        self.0.iter().all(|check| !check.fails())
    }

    /// Whether one of this reason fails.
    pub(super) fn fail_by(&self, reason: Reason) -> bool {
        self.0.iter().any(|check| check.reason == reason && check.fails())
    }

    fn judge(&mut self, reason: Reason, fit: Fit, scale: Scale) {
        self.0.push(Check {
            reason,
            statistic: fit.sum,
            degrees_of_freedom: fit.degrees_of_freedom,
            p_value: scale.probability(fit.sum, fit.degrees_of_freedom),
            level: FALSE_ALARM,
        });
    }

    /// A check without a distribution: it holds or not.
    fn demand(&mut self, reason: Reason, statistic: f64, holds: bool) {
        let p_value = if holds { 1.0 } else { 0.0 };
        self.0.push(Check {
            reason,
            statistic,
            degrees_of_freedom: 0,
            p_value,
            level: FALSE_ALARM,
        });
    }

    /// The integers of an epoch: whether others are improbable, also if the geometry is wrong as long as it has not
    /// proven itself, and whether these fit at all.
    pub(super) fn of_integers(
        found: &Found,
        conditional: &Conditional,
        misfit: Fit,
        known: Known,
        settings: &Settings,
        rate: f64,
    ) -> Self {
        let mut checks = Self::default();
        let certain_m = conditional.covariance_m2.diagonal().max().sqrt();
        checks.demand(Reason::WeakModel, certain_m, certain_m <= MAX_FIXED_SD_M);
        let weak = found.success_rate < MIN_SUCCESS;
        checks.0.push(Check {
            reason: if weak { Reason::SuccessRate } else { Reason::Ratio },
            statistic: found.ratio,
            degrees_of_freedom: 0,
            p_value: 1.0 / (1.0 + found.rivals),
            level: 1.0 / (1.0 + rate),
        });
        checks.0.push(Check {
            reason: Reason::Unproven,
            statistic: found.doubt,
            degrees_of_freedom: 0,
            p_value: 1.0 / (1.0 + found.doubt),
            level: 1.0 / (1.0 + rate),
        });
        checks.demand(Reason::Closure, 0.0, found.closes);
        let phases = Scale { degrees_of_freedom: known.phase };
        checks.judge(Reason::Residuals, conditional.phase_fit, phases);
        checks.judge(misfit_reason(settings), misfit, known.all());
        checks
    }

    /// The fixed baselines against the known array: their lengths, their shape, the attitude.
    pub(super) fn of_orientation(
        &mut self,
        lengths: &[Fit],
        orientation: &Orientation,
        scale: Scale,
        settings: &Settings,
    ) {
        for length in lengths {
            self.judge(Reason::Length, *length, scale);
        }
        if let Some(geometry) = orientation.geometry {
            self.judge(Reason::Geometry, geometry, scale);
        }
        match &orientation.attitude {
            Err(reason) => self.demand(*reason, 0.0, false),
            Ok(attitude) => {
                let angles_rad = [attitude.pitch_rad, attitude.roll_rad].into_iter().flatten();
                let tilt_rad = angles_rad.map(f64::abs).fold(0.0, f64::max);
                self.demand(Reason::Tilt, tilt_rad, tilt_rad <= settings.max_tilt_rad);
            }
        }
    }

    /// Whether the positions of the antennas leave the satellites their credit, where nothing else proves integers that
    /// fit.
    pub(super) fn of_positions(&mut self, contradiction: f64, settings: &Settings) {
        if settings.constraint == Constraint::None {
            self.demand(Reason::Residuals, contradiction, contradiction < CONTRADICTORY_RMS);
        }
    }

    /// The recent epochs together: how well their best integers fit, and the mean shape of the array. If one of
    /// them tells that what is known of the array is wrong, no epoch is to be believed.
    pub(super) fn of_session(
        (fit, fit_p_value): (Fit, f64),
        (shape, shape_p_value): (Fit, f64),
        shape_level: f64,
        settings: &Settings,
    ) -> Self {
        let check = |reason, fit: Fit, p_value, level| Check {
            reason,
            statistic: fit.sum,
            degrees_of_freedom: fit.degrees_of_freedom,
            p_value,
            level,
        };
        Self(vec![
            check(misfit_reason(settings), fit, fit_p_value, FALSE_ALARM),
            check(Reason::Geometry, shape, shape_p_value, shape_level),
        ])
    }

    /// Whether the accepted integers of the epochs before agree.
    pub(super) fn of_witness(&mut self, testimony: Testimony, is_strong: bool) {
        self.demand(Reason::Contradiction, 0.0, testimony != Testimony::Contradicts);
        let proven = is_strong || testimony == Testimony::Agrees;
        self.demand(Reason::Unproven, 0.0, proven);
    }

    /// An attitude that was predicted from outside.
    pub(super) fn of_prediction(&mut self, role: PredictionRole) {
        self.demand(Reason::Residuals, 0.0, role != PredictionRole::Refused);
    }
}

/// Degrees of freedom with which the session's levels are known.
#[derive(Debug, Clone, Copy)]
pub(super) struct Known {
    pub(super) code: f64,
    pub(super) phase: f64,
}

impl Known {
    /// Of a sum of squares of both kinds.
    fn all(self) -> Scale {
        Scale { degrees_of_freedom: self.code.min(self.phase) }
    }
}

/// What to blame where integers do not fit: what they were constrained by.
fn misfit_reason(settings: &Settings) -> Reason {
    match settings.constraint {
        Constraint::None => Reason::Residuals,
        Constraint::Length => Reason::Length,
        Constraint::Array if settings.antennas == 2 => Reason::Length,
        Constraint::Array => Reason::Geometry,
    }
}

/// Whether an epoch that fails for this reason is not sure, rather than contradicting what is known.
fn is_unsure(reason: Reason) -> bool {
    matches!(
        reason,
        Reason::WeakModel
            | Reason::Ratio
            | Reason::SuccessRate
            | Reason::Unproven
            | Reason::Slip
            | Reason::Budget
            | Reason::NoPhase
    )
}

#[cfg(test)]
mod tests;
