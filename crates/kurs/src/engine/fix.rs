//! The integers of an epoch: searched, then accepted or not.

use std::ops::Range;

use nalgebra::DVector;

use crate::baseline::Baselines;
use crate::difference::Link;
use crate::float_solution::{Conditional, Fit, FloatSolution, NoFloat};
use crate::link_noise;
use crate::solution::Reason;
use crate::time::GpsTime;

use super::locate::CommonFrame;
use super::likelihood::Known;
use super::noise_levels::NoiseLevels;
use super::search::{Found, Problem, Searches};
use super::settings::Settings;

/// Outliers of the code hide each other; after two rounds hardly any is left.
const MAX_REWEIGHTINGS: usize = 2;
/// Integers that beat all others by this ratio teach the phase noise, even while the noise level is
/// too uncertain to accept them.
const CLEAR_RATIO: f64 = 3.0;
/// Models that are right more often than this choose no integers by chance.
const STRONG_MODEL: f64 = 0.9999;
/// Baselines that stay less certain than this, although the integers are known, have a geometry so
/// poor that other integers fit as well, m.
const MAX_FIXED_SD_M: f64 = 0.3;
/// A fix whose phase residuals are this many times larger than their weights say is no fix.
const MAX_UNIT_WEIGHT: f64 = 4.0;
/// A model that was expected to be right less often than this is too weak to blame the rivals.
const MIN_SUCCESS: f64 = 0.5;
/// A length that is off by more than this many standard deviations breaks the known geometry.
const MAX_LENGTH_SD: f64 = 5.0;

/// What becomes of the best integers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Verdict {
    /// Accepted.
    Fixed,
    /// Not sure: the float solution stands.
    Float(Reason),
    /// Sure, but against what is known: refused.
    Refused(Reason),
}

impl Verdict {
    /// Whether the integers are sure, so that the baselines may be laid against the known array.
    pub(super) fn is_sure(self) -> bool {
        matches!(self, Self::Fixed | Self::Refused(Reason::Length))
    }

    /// Whether one system may have spoilt integers that the model is strong enough for.
    pub(super) fn is_spoilt(self) -> bool {
        matches!(
            self,
            Self::Float(Reason::Ratio | Reason::Budget | Reason::Slip)
                | Self::Refused(Reason::Residuals)
        )
    }

    /// The same where too many cycle slips at once left the epoch alone: that is why it is not sure.
    pub(super) fn after_many_slips(self) -> Self {
        match self {
            Self::Float(Reason::Ratio | Reason::SuccessRate | Reason::Budget) => {
                Self::Float(Reason::Slip)
            }
            other => other,
        }
    }
}

/// Baselines of the epoch with what is known of their integers.
#[derive(Debug)]
pub(super) struct Outcome {
    pub(super) verdict: Verdict,
    pub(super) success_rate: Option<f64>,
    pub(super) ratio: Option<f64>,
    pub(super) residual_rms_m: Option<f64>,
    pub(super) baselines: Baselines,
    /// Corrections to the approximate baselines that `baselines` holds, m.
    pub(super) correction_m: DVector<f64>,
    /// The integers that `correction_m` follows from, accepted or refused; `None` for a float
    /// solution.
    pub(super) integers: Option<Vec<f64>>,
    /// The best integers of the search, and the probability of all others over theirs.
    pub(super) best: Option<(Vec<f64>, f64)>,
    /// How the phases fit with them, and whether they stand clear of all others.
    pub(super) phase_fit: Fit,
    is_clear: bool,
}

/// The searches, and the noise of the session.
#[derive(Debug, Default)]
pub(super) struct Fixer {
    pub(super) searches: Searches,
    pub(super) levels: NoiseLevels,
    pub(super) time: GpsTime,
    /// The last trial without code found nothing; until then none is worth its time.
    pub(super) no_trial_without_code_until: GpsTime,
}

impl Fixer {
    /// Begins the epoch at `time`.
    pub(super) fn begin(&mut self, time: GpsTime) {
        self.levels.begin(time);
        self.time = time;
    }

    /// Float solution with the noise level of the session, which learns from its code residuals.
    pub(super) fn float(
        &mut self,
        links: &mut [Link],
        groups: &[Range<usize>],
        frame: &CommonFrame,
    ) -> Result<FloatSolution, NoFloat> {
        let rovers: Vec<usize> = frame.rovers().collect();
        let mut float = FloatSolution::solve(links, groups, frame.reference, &rovers)?;
        for _ in 0..MAX_REWEIGHTINGS {
            let squares = float.code_squares(links);
            if !link_noise::weigh_code_outliers(links, &squares) {
                break;
            }
            float = FloatSolution::solve(links, groups, frame.reference, &rovers)?;
        }
        Ok(float)
    }

    /// Searches the integers of the epoch under the constraint in force, and judges them: of its fixes
    /// a share of `rate` may be wrong.
    pub(super) fn fix(
        &mut self,
        float: &FloatSolution,
        links: &[Link],
        frame: &CommonFrame,
        settings: &Settings,
        rate: f64,
    ) -> Outcome {
        let mut outcome = Outcome::float(float, frame);
        if float.ambiguities_cycles.is_empty() {
            return outcome;
        }
        let problem = self.problem(float, links, frame, settings, rate);
        match self.searches.find(&problem) {
            Ok(found) => outcome.judge(&found, &problem),
            Err(reason) => {
                outcome.verdict = Verdict::Float(reason);
                outcome.success_rate = self.searches.predicted_success(settings.constraint);
            }
        }
        outcome
    }

    /// The epoch with the noise of the session.
    pub(super) fn problem<'a>(
        &self,
        float: &'a FloatSolution,
        links: &'a [Link],
        frame: &'a CommonFrame,
        settings: &'a Settings,
        rate: f64,
    ) -> Problem<'a> {
        let known = Known {
            code: self.levels.code_degrees_of_freedom(),
            phase: self.levels.phase_degrees_of_freedom(),
        };
        Problem { float, links, frame, settings, rate, known }
    }

    /// The noise level of the phases learns from what became of the epoch. (The test of the residuals
    /// may have refused it just because the level is not known yet.)
    pub(super) fn learn_from(&mut self, outcome: &Outcome, float: &FloatSolution, links: &[Link]) {
        let strong = outcome.success_rate.is_some_and(|rate| rate > STRONG_MODEL);
        if !outcome.is_clear || !strong {
            return;
        }
        let Some((integers, _)) = &outcome.best else { return };
        let fits: Vec<_> = float
            .phase_fits(integers, &outcome.correction_m)
            .map(|(first, fit)| (links[first], fit))
            .collect();
        self.levels.learn_phase(&fits, outcome.phase_fit.degrees_of_freedom);
    }
}

impl Outcome {
    /// The float solution, as long as nothing better is known.
    pub(super) fn float(float: &FloatSolution, frame: &CommonFrame) -> Self {
        Self {
            verdict: Verdict::Float(Reason::NoPhase),
            success_rate: None,
            ratio: None,
            residual_rms_m: None,
            baselines: Baselines {
                reference: float.reference,
                rovers: float.rovers.clone(),
                vectors_m: frame.approximate() + &float.correction_m,
                covariance_m2: float.covariance_m2.clone(),
            },
            correction_m: float.correction_m.clone(),
            integers: None,
            best: None,
            phase_fit: Fit::default(),
            is_clear: false,
        }
    }

    /// Probability of all other integers over that of the best.
    pub(super) fn rivals(&self) -> f64 {
        self.best.as_ref().map_or(f64::INFINITY, |(_, rivals)| *rivals)
    }

    /// Accepts the integers if the others are improbable enough and all checks hold.
    pub(super) fn judge(&mut self, found: &Found, problem: &Problem) {
        let Problem { float, frame, settings, rate, .. } = *problem;
        self.success_rate = Some(found.success_rate);
        self.ratio = Some(found.ratio);
        self.best = Some((found.integers.clone(), found.rivals));
        let Some(conditional) = float.conditional(&found.integers) else {
            self.verdict = Verdict::Float(Reason::WeakModel);
            return;
        };
        self.residual_rms_m = Some(conditional.residual_rms_m);
        if conditional.covariance_m2.diagonal().max().sqrt() > MAX_FIXED_SD_M {
            self.verdict = Verdict::Float(Reason::WeakModel);
            return;
        }
        self.phase_fit = conditional.phase_fit;
        self.is_clear = found.rivals <= rate || found.ratio >= CLEAR_RATIO;
        self.correction_m = conditional.correction_m.clone();
        if found.rivals > rate {
            let weak = found.success_rate < MIN_SUCCESS;
            self.verdict = Verdict::Float(if weak { Reason::SuccessRate } else { Reason::Ratio });
            return;
        }
        self.baselines.vectors_m = frame.approximate() + &conditional.correction_m;
        self.verdict = if !found.close {
            Verdict::Refused(Reason::Closure)
        } else if conditional.phase_fit.unit_weight() > MAX_UNIT_WEIGHT {
            Verdict::Refused(Reason::Residuals)
        } else if self.breaks_length(&conditional, settings) {
            Verdict::Refused(Reason::Length)
        } else {
            Verdict::Fixed
        };
        self.baselines.covariance_m2 = conditional.covariance_m2;
        self.correction_m = conditional.correction_m;
        self.integers = Some(found.integers.clone());
    }

    /// Whether a baseline does not have the length that the known array gives it.
    fn breaks_length(&self, conditional: &Conditional, settings: &Settings) -> bool {
        let Some(array) = &settings.array else { return false };
        let positions_m = array.positions_m();
        let reference = positions_m[self.baselines.reference];
        self.baselines.rovers.iter().enumerate().any(|(block, rover)| {
            let known_m = (positions_m[*rover] - reference).norm();
            let (found_m, _) = self.baselines.length_m(block);
            let along = self.baselines.vector_m(block).direction().xyz();
            let q = conditional.covariance_m2.fixed_view::<3, 3>(3 * block, 3 * block);
            let variance_m2 =
                (along.transpose() * q * along)[0] + 2.0 * settings.array_sd_m.powi(2);
            (found_m - known_m).abs() > MAX_LENGTH_SD * variance_m2.sqrt()
        })
    }
}
