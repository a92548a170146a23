//! The integers of an epoch: searched, weighed, and checked by themselves.

use std::cell::OnceCell;
use std::ops::Range;

use nalgebra::DVector;

use crate::ambiguity::success_rate::bootstrapped_success_rate;
use crate::baseline::Baselines;
use crate::difference::Link;
use crate::float_solution::{Conditional, Fit, FloatSolution};
use crate::solution::Reason;
use crate::time::GpsTime;

use super::acceptance::{Checks, Known};
use super::code_free::code_is_useless;
use super::locate::CommonFrame;
use super::residuals;
use super::search::{Found, Problem, Searches};
use super::settings::{Constraint, Settings};

/// Models that are right more often than this choose no integers by chance: a tenth of the strictest rate
/// that is usual.
const STRONG_MODEL: f64 = 1.0 - 1e-4;

/// Double differences of an epoch and its float solution.
#[derive(Debug)]
pub(super) struct Epoch {
    /// As the memory counts it ([`Direction`](super::Direction)).
    pub(super) time: GpsTime,
    pub(super) frame: CommonFrame,
    pub(super) links: Vec<Link>,
    pub(super) groups: Vec<Range<usize>>,
    pub(super) float: FloatSolution,
    /// How the code fits before its outliers lost weight.
    pub(super) code_fit: Fit,
    /// So many phases slipped that nothing is left of what earlier epochs knew.
    pub(super) began_anew: bool,
}

impl Epoch {
    /// Its integers in this float solution, with a geometry that nobody doubts.
    pub(super) fn problem<'a>(
        &'a self,
        float: &'a FloatSolution,
        settings: &'a Settings,
        known: Known,
    ) -> Problem<'a> {
        Problem {
            float,
            links: &self.links,
            frame: &self.frame,
            settings,
            rate: settings.max_wrong_fix_rate,
            known,
            doubt: 0.0,
            begins_free: false,
            is_code_useless: code_is_useless(self.code_fit),
        }
    }
}

/// What came of the search for the integers of an epoch.
#[derive(Debug)]
pub(super) struct Fix {
    pub(super) found: Result<Found, Reason>,
    pub(super) conditional: Option<Conditional>,
    /// What the integers leave of the epoch's phases, and of its code beyond what code alone leaves: χ² with
    /// a degree of freedom for each ambiguity if they are right.
    pub(super) misfit: Fit,
    /// Of the integers by themselves; none where there are no integers.
    pub(super) checks: Checks,
    /// What the model promised.
    pub(super) success_rate: Option<f64>,
    /// [`Searches::is_strong_without_constraint`].
    pub(super) is_strong_without_constraint: bool,
    /// [`phase_residuals`](Self::phase_residuals), once somebody has asked for them.
    residuals: OnceCell<Vec<(usize, f64)>>,
}

impl Fix {
    /// Nothing to be fixed.
    pub(super) fn none(reason: Reason) -> Self {
        Self {
            found: Err(reason),
            conditional: None,
            misfit: Fit::default(),
            checks: Checks::default(),
            success_rate: None,
            is_strong_without_constraint: false,
            residuals: OnceCell::new(),
        }
    }

    /// Whether the integers are accepted, by themselves.
    pub(super) fn is_accepted(&self) -> bool {
        self.conditional.is_some() && self.checks.hold()
    }

    /// Whether the integers are sure, even if they contradict something: other ones are improbable.
    pub(super) fn is_sure(&self) -> bool {
        let unsure = [Reason::WeakModel, Reason::SuccessRate, Reason::Ratio];
        self.conditional.is_some() && !unsure.into_iter().any(|reason| self.checks.fail_by(reason))
    }

    /// Whether the integers are sure if the geometry is right, which it has not proven yet.
    pub(super) fn waits_for_proof(&self) -> bool {
        self.is_sure() && self.checks.fail_by(Reason::Unproven)
    }

    /// Whether the model is so strong that the integers were not chosen by chance.
    pub(super) fn is_strong(&self) -> bool {
        self.success_rate.is_some_and(|rate| rate > STRONG_MODEL)
    }

    /// Probability of all other integers over that of the best.
    pub(super) fn rivals(&self) -> f64 {
        self.found.as_ref().map_or(f64::INFINITY, |found| found.rivals)
    }

    /// How the phases fit with the integers.
    pub(super) fn phase_fit(&self) -> Fit {
        self.conditional.as_ref().map_or(Fit::default(), |conditional| conditional.phase_fit)
    }

    /// Baselines with the integers if these are sure, of the float solution otherwise; and the corrections
    /// to the approximate ones, m.
    pub(super) fn baselines(&self, epoch: &Epoch) -> (Baselines, DVector<f64>) {
        let float = &epoch.float;
        let (correction_m, covariance_m2) = match &self.conditional {
            Some(fixed) if self.is_sure() => (&fixed.correction_m, &fixed.covariance_m2),
            _ => (&float.correction_m, &float.covariance_m2),
        };
        let baselines = Baselines {
            reference: float.reference,
            rovers: float.rovers.clone(),
            vectors_m: epoch.frame.approximate() + correction_m,
            covariance_m2: covariance_m2.clone(),
        };
        (baselines, correction_m.clone())
    }

    /// Normalised residuals of the phases of its epoch.
    pub(super) fn phase_residuals(&self, epoch: &Epoch) -> &[(usize, f64)] {
        let (Ok(found), Some(fixed)) = (&self.found, &self.conditional) else { return &[] };
        let Epoch { float, links, .. } = epoch;
        self.residuals
            .get_or_init(|| float.phase_residuals(links, &found.integers, &fixed.correction_m))
    }

    /// Factor on the covariance of the baselines: what the residuals of the epoch's phases say of the noise.
    pub(super) fn epoch_factor(&self, epoch: &Epoch) -> f64 {
        let Some(fixed) = self.conditional.as_ref().filter(|_| self.is_sure()) else { return 1.0 };
        let (links, residuals) = (&epoch.links, self.phase_residuals(epoch));
        let degrees_of_freedom = fixed.phase_fit.degrees_of_freedom;
        residuals::epoch_factor(links, residuals, degrees_of_freedom, fixed.correction_m.len())
    }
}

impl Searches {
    /// Searches the integers of an epoch under the constraint in force, and checks them.
    pub(super) fn fix(&mut self, problem: &Problem) -> Fix {
        if problem.float.ambiguities_cycles.is_empty() {
            return Fix::none(Reason::NoPhase);
        }
        let fix = match self.find(problem) {
            Ok(found) => Fix::of(found, problem),
            Err(reason) => {
                let success_rate = self.predicted_success(problem.settings.constraint);
                Fix { success_rate, ..Fix::none(reason) }
            }
        };
        Fix { is_strong_without_constraint: self.is_strong_without_constraint(), ..fix }
    }

    /// What the model of the last search promised, for one that came to no end.
    fn predicted_success(&self, constraint: Constraint) -> Option<f64> {
        let variances = self.decorrelation(constraint).conditional_variances();
        (!variances.is_empty()).then(|| bootstrapped_success_rate(variances))
    }
}

impl Fix {
    /// Checks what a search has found.
    pub(super) fn of(found: Found, problem: &Problem) -> Self {
        let Some(conditional) = problem.float.conditional(&found.integers) else {
            return Self::none(Reason::WeakModel);
        };
        let Problem { known, settings, rate, .. } = *problem;
        let misfit = Fit {
            sum: problem.float.squares_left(&conditional),
            degrees_of_freedom: found.integers.len(),
        };
        let checks = Checks::of_integers(&found, &conditional, misfit, known, settings, rate);
        Self {
            misfit,
            success_rate: Some(found.success_rate),
            conditional: Some(conditional),
            found: Ok(found),
            checks,
            is_strong_without_constraint: false,
            residuals: OnceCell::new(),
        }
    }
}
