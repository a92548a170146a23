//! Integers of an epoch without the phases that may spoil those of all others.
//!
//! A constellation with a bias, phases that unlike receivers measure differently, or code full of
//! reflections leave no integers that fit. Which of them it is nobody tells: each suspect is left out in
//! turn, and the surest integers of the rest count. Each trial may go wrong, so each is allowed its
//! share of the rate only.

use std::collections::BTreeSet;
use std::ops::Range;

use super::code_free;
use super::fix::{Fixer, Outcome, Verdict};
use super::locate::CommonFrame;
use super::settings::{Constraint, Settings};
use crate::chi_square::chi_square_tail;
use crate::difference::{self, Link};
use crate::float_solution::{Fit, FloatSolution};
use crate::signal::System;
use crate::solution::LeftOut;

/// A trial without code takes long; after one that found nothing, the next seconds have none.
const PAUSE_AFTER_FAILURE_S: f64 = 10.0;

/// A fix whose phases fit worse than this probability is doubted,
const BAD_FIT: f64 = 1e-4;
/// if those of a part of the epoch fit better than this.
const GOOD_FIT: f64 = 1e-2;

/// Part of an epoch whose integers are accepted.
#[derive(Debug)]
pub(super) struct Part {
    pub(super) left_out: LeftOut,
    pub(super) links: Vec<Link>,
    pub(super) groups: Vec<Range<usize>>,
    pub(super) float: FloatSolution,
    pub(super) outcome: Outcome,
}

/// Whether the phases of a part fit well, and those of the whole badly even if the noise is what the
/// part says: a level that is not known yet makes both look bad.
fn fits_better(part: &Fit, whole: &Fit) -> bool {
    let level = part.unit_weight().powi(2).max(1.0);
    plausibility(part, 1.0) >= GOOD_FIT && plausibility(whole, level) < BAD_FIT
}

/// Probability of phases that fit as badly as these or worse, with noise of so many times the variance.
fn plausibility(fit: &Fit, level: f64) -> f64 {
    if fit.degrees_of_freedom == 0 { 1.0 } else { chi_square_tail(fit.sum / level, fit.degrees_of_freedom) }
}

impl Fixer {
    /// Integers of the epoch alone without one of the suspects, where those of the `whole` epoch are
    /// not accepted, or its phases fit so badly that a part which fits is to be believed rather.
    /// `is_unlike` names the links of [`LeftOut::UnlikePhases`].
    pub(super) fn fix_without_a_suspect(
        &mut self,
        whole: &Outcome,
        float: &FloatSolution,
        links: &[Link],
        is_unlike: impl Fn(&Link) -> bool,
        frame: &CommonFrame,
        settings: &Settings,
    ) -> Option<Part> {
        let suspects = self.suspects(whole, float, links, &is_unlike, settings);
        let rate = settings.max_wrong_fix_rate / suspects.len() as f64;
        let rest = |suspect: LeftOut| -> Vec<Link> {
            let without = |link: &Link| match suspect {
                LeftOut::UnlikePhases if is_unlike(link) => Some(Link { phase_m: None, ..*link }),
                LeftOut::System(spoilt) if link.satellite.system == spoilt => None,
                _ => Some(*link),
            };
            links.iter().filter_map(without).collect()
        };
        let mut fixed: Vec<Part> = Vec::new();
        for suspect in suspects {
            let part = self.fix_part(rest(suspect), suspect, frame, settings, rate);
            if suspect == LeftOut::Code && part.is_none() {
                self.no_trial_without_code_until = self.time + PAUSE_AFTER_FAILURE_S;
            }
            fixed.extend(part);
        }
        if whole.verdict == Verdict::Fixed {
            fixed.retain(|part| fits_better(&part.outcome.phase_fit, &whole.phase_fit));
        }
        fixed.into_iter().min_by(|a, b| a.outcome.rivals().total_cmp(&b.outcome.rivals()))
    }

    fn suspects(
        &self,
        whole: &Outcome,
        float: &FloatSolution,
        links: &[Link],
        is_unlike: impl Fn(&Link) -> bool,
        settings: &Settings,
    ) -> Vec<LeftOut> {
        let mut suspects = Vec::new();
        let is_fixed = whole.verdict == Verdict::Fixed;
        if is_fixed && plausibility(&whole.phase_fit, 1.0) >= BAD_FIT {
            return suspects;
        }
        let geometry_is_known = settings.constraint != Constraint::None;
        let may_try = self.time >= self.no_trial_without_code_until;
        if geometry_is_known && may_try && code_free::code_is_useless(float) {
            suspects.push(LeftOut::Code);
        }
        if links.iter().any(is_unlike) {
            suspects.push(LeftOut::UnlikePhases);
        }
        let systems: BTreeSet<System> = links.iter().map(|l| l.satellite.system).collect();
        // What is left of one system alone is nothing.
        if (is_fixed || whole.verdict.is_spoilt()) && systems.len() > 1 {
            suspects.extend(systems.into_iter().map(LeftOut::System));
        }
        suspects
    }

    fn fix_part(
        &mut self,
        mut links: Vec<Link>,
        left_out: LeftOut,
        frame: &CommonFrame,
        settings: &Settings,
        rate: f64,
    ) -> Option<Part> {
        let groups = difference::group(&mut links);
        let rovers: Vec<usize> = frame.rovers().collect();
        let float = FloatSolution::solve(&links, &groups, frame.reference, &rovers).ok()?;
        let float = if left_out == LeftOut::Code { float.without_code() } else { float };
        let outcome = self.fix(&float, &links, frame, settings, rate);
        let fixed = outcome.verdict == Verdict::Fixed;
        fixed.then_some(Part { left_out, links, groups, float, outcome })
    }
}
