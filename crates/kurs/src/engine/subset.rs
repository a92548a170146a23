//! Integers of an epoch without the observations that may spoil those of all others.
//!
//! A constellation with a bias, phases that mixed receivers measure differently, one satellite behind
//! something at one antenna, code full of reflections: each leaves no integers that fit. Which of them it is
//! nobody tells, so the suspects are left out in turn – those first that explain most of the misfit – and the
//! surest integers of the rest count. Each trial may go wrong, so each is allowed its share of the rate only.

use std::collections::BTreeSet;
use std::ops::Range;

use super::acceptance::Known;
use super::code_free;
use super::fix::{Epoch, Fix};
use super::search::{Problem, Searches};
use super::settings::{Constraint, Settings};
use crate::chi_square::fisher_tail;
use crate::difference::{self, Link};
use crate::float_solution::{Fit, FloatSolution};
use crate::signal::{Band, Satellite, System};
use crate::solution::{LeftOut, Reason};
use crate::time::GpsTime;

/// A trial without code takes long: after one that found nothing there is none for so long.
const PAUSE_AFTER_FAILURE_S: f64 = 10.0;
/// A fix whose phases fit worse than this probability is doubted if a part of the epoch has a [`GOOD_FIT`].
const BAD_FIT: f64 = 1e-3;
/// Phases of a part of an epoch that fit with more than this probability put a fix with a [`BAD_FIT`] in doubt.
const GOOD_FIT: f64 = 1e-2;
/// Links that are tried without: those that explain most of the misfit of the best integers.
const MAX_SUSPECT_LINKS: usize = 3;
/// A link whose residual is smaller than this is no suspect, standard deviations.
const MIN_SUSPECT_SIGMAS: f64 = 2.0;

/// Part of an epoch, with its integers.
#[derive(Debug)]
pub(super) struct Subset {
    pub(super) left_out: LeftOut,
    pub(super) links: Vec<Link>,
    pub(super) groups: Vec<Range<usize>>,
    pub(super) float: FloatSolution,
    pub(super) fix: Fix,
}

/// Looks for subsets, and remembers what was in vain.
#[derive(Debug, Clone, Default)]
pub(super) struct Subsets {
    /// The last trial without code found nothing; until then none is worth its time.
    no_trial_without_code_until: GpsTime,
}

/// What came of the trials without suspects.
#[derive(Debug)]
pub(super) struct Trials {
    /// The surest one that is accepted.
    pub(super) best: Option<Subset>,
    /// How the best integers fit without the phases of mixed receivers, if that was tried.
    pub(super) misfit_without_mixed: Option<Fit>,
}

/// An epoch whose integers are not accepted, or doubted.
pub(super) struct Doubted<'a> {
    pub(super) epoch: &'a Epoch,
    pub(super) fix: &'a Fix,
    pub(super) settings: &'a Settings,
    pub(super) known: Known,
    /// As [`Problem::doubt`].
    pub(super) doubt: f64,
    /// Names the links of [`LeftOut::MixedReceiverPhases`].
    pub(super) is_mixed: &'a dyn Fn(&Link) -> bool,
}

impl Doubted<'_> {
    /// Probability of phases that fit as badly as these or worse, with noise of so many times the variance.
    fn plausibility(&self, fit: Fit, level: f64) -> f64 {
        fisher_tail(fit.sum / level, fit.degrees_of_freedom as f64, self.known.phase)
    }

    fn fits_badly(&self) -> bool {
        self.plausibility(self.fix.phase_fit(), 1.0) < BAD_FIT
    }

    /// Whether the phases of a part fit well, and those of the whole badly even if the noise is what the
    /// part says: a level that is not known yet makes both look bad.
    fn is_better(&self, part: &Subset) -> bool {
        let (part, whole) = (part.fix.phase_fit(), self.fix.phase_fit());
        let level = part.unit_weight().powi(2).max(1.0);
        self.plausibility(part, 1.0) >= GOOD_FIT && self.plausibility(whole, level) < BAD_FIT
    }

    /// Whether one system or link may have spoilt integers that the model is strong enough for.
    fn may_be_spoilt(&self) -> bool {
        let unsure = |check: &&crate::solution::Check| check.fails();
        match (&self.fix.found, self.fix.checks.0.iter().find(unsure)) {
            (Err(reason), _) => *reason == Reason::Budget,
            // A weak model gets weaker without anything.
            (Ok(_), Some(check)) => {
                !matches!(check.reason, Reason::WeakModel | Reason::SuccessRate)
            }
            (Ok(_), None) => self.fits_badly(),
        }
    }

    /// Whether parts of the epoch are searched without the constraint first, as it adds little there: the search with
    /// all antennas takes most of the work, and comes to no end where something is spoilt. One length costs little.
    fn begins_free(&self) -> bool {
        self.epoch.float.rovers.len() > 1 && self.fix.is_strong_without_constraint
    }

    /// What may be at fault.
    fn suspects(&self, may_leave_code_out: bool) -> Vec<LeftOut> {
        let mut suspects = Vec::new();
        let Epoch { links, code_fit, .. } = self.epoch;
        if self.fix.is_accepted() && !self.fits_badly() {
            return suspects;
        }
        let geometry_is_known = self.settings.constraint != Constraint::None;
        if geometry_is_known && may_leave_code_out && code_free::code_is_useless(*code_fit) {
            suspects.push(LeftOut::Code);
        }
        if links.iter().any(|link| (self.is_mixed)(link)) {
            suspects.push(LeftOut::MixedReceiverPhases);
        }
        if !self.may_be_spoilt() {
            return suspects;
        }
        let systems: BTreeSet<System> = links.iter().map(|l| l.satellite.system).collect();
        // What is left of one system alone is nothing.
        if systems.len() > 1 {
            suspects.extend(systems.into_iter().map(LeftOut::System));
        }
        let bands: BTreeSet<Band> = links.iter().map(|l| l.signal.band).collect();
        if bands.len() > 2 {
            suspects.extend(bands.into_iter().map(LeftOut::Band));
        }
        suspects.extend(self.suspect_links());
        suspects
    }

    /// The links whose phases depart most from the best integers.
    fn suspect_links(&self) -> Vec<LeftOut> {
        let Epoch { links, float, .. } = self.epoch;
        let (Ok(found), Some(conditional)) = (&self.fix.found, &self.fix.conditional) else {
            return Vec::new();
        };
        let residuals = float.phase_residuals(links, &found.integers, &conditional.correction_m);
        let mut worst: Vec<(f64, usize, Satellite)> = Vec::new();
        for (link, z) in residuals {
            let square = z * z;
            let Link { antenna, satellite, .. } = links[link];
            match worst.iter_mut().find(|(_, a, s)| (*a, *s) == (antenna, satellite)) {
                Some((largest, ..)) => *largest = largest.max(square),
                None => worst.push((square, antenna, satellite)),
            }
        }
        worst.retain(|(square, ..)| *square > MIN_SUSPECT_SIGMAS * MIN_SUSPECT_SIGMAS);
        worst.sort_by(|a, b| b.0.total_cmp(&a.0));
        // Between two antennas nothing tells at which of them it is: leaving out either does the same.
        if float.rovers.len() == 1 {
            worst.retain(|(_, antenna, _)| *antenna == float.rovers[0]);
        }
        let first = worst.into_iter().take(MAX_SUSPECT_LINKS);
        first.map(|(_, antenna, satellite)| LeftOut::Link { antenna, satellite }).collect()
    }

    /// The links of the epoch without a suspect.
    fn without(&self, suspect: LeftOut) -> Vec<Link> {
        let less = |link: &Link| {
            let without_phase = Some(Link { phase_m: None, ..*link });
            match suspect {
                LeftOut::MixedReceiverPhases if (self.is_mixed)(link) => without_phase,
                LeftOut::Link { antenna, satellite }
                    if (link.antenna, link.satellite) == (antenna, satellite) =>
                {
                    without_phase
                }
                LeftOut::Band(band) if link.signal.band == band => without_phase,
                LeftOut::System(system) if link.satellite.system == system => None,
                _ => Some(*link),
            }
        };
        self.epoch.links.iter().filter_map(less).collect()
    }
}

impl Subsets {
    /// Integers of the epoch alone without one of the suspects, where those of the whole epoch are not accepted, or
    /// its phases fit so badly that a part which fits is more probable.
    pub(super) fn find(&mut self, searches: &mut Searches, doubted: &Doubted) -> Trials {
        let time = doubted.epoch.time;
        let suspects = doubted.suspects(time >= self.no_trial_without_code_until);
        let rate = doubted.settings.max_wrong_fix_rate / suspects.len() as f64;
        let mut fixed: Vec<Subset> = Vec::new();
        let mut misfit_without_mixed = None;
        for suspect in suspects {
            if searches.are_spent() {
                break;
            }
            let subset = fix_without(searches, doubted, suspect, rate);
            if suspect == LeftOut::MixedReceiverPhases {
                let found = subset.as_ref().and_then(|subset| subset.fix.found.as_ref().ok());
                misfit_without_mixed = found.map(|found| found.misfit);
            }
            let subset = subset.filter(|subset| subset.fix.is_accepted());
            if suspect == LeftOut::Code && subset.is_none() {
                self.no_trial_without_code_until = time + PAUSE_AFTER_FAILURE_S;
            }
            fixed.extend(subset);
        }
        if doubted.fix.is_accepted() {
            fixed.retain(|subset| doubted.is_better(subset));
        }
        let best = fixed.into_iter().min_by(|a, b| a.fix.rivals().total_cmp(&b.fix.rivals()));
        Trials { best, misfit_without_mixed }
    }
}

fn fix_without(
    searches: &mut Searches,
    doubted: &Doubted,
    left_out: LeftOut,
    rate: f64,
) -> Option<Subset> {
    let frame = &doubted.epoch.frame;
    let mut links = doubted.without(left_out);
    let groups = difference::group(&mut links);
    let rovers: Vec<usize> = frame.rovers().collect();
    let float = FloatSolution::solve(&links, &groups, frame.reference, &rovers).ok()?;
    let float = if left_out == LeftOut::Code { float.without_code() } else { float };
    let problem = Problem {
        links: &links,
        rate,
        doubt: doubted.doubt,
        // Without code nothing is found without the geometry.
        begins_free: doubted.begins_free() && !float.is_without_code(),
        ..doubted.epoch.problem(&float, doubted.settings, doubted.known)
    };
    let fix = searches.fix(&problem);
    Some(Subset { left_out, links, groups, float, fix })
}
