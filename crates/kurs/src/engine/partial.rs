//! Integers of an epoch without the phases that may spoil those of all others.
//!
//! A constellation with a bias, or phases that unlike receivers measure differently, leave no integers
//! that fit. Which of them it is nobody tells: each suspect is left out in turn, and the surest
//! integers of the rest count. Each trial may go wrong, so each is allowed its share of the rate only.

use std::collections::BTreeSet;
use std::ops::Range;

use super::fix::{Fixer, Outcome, Verdict};
use super::locate::CommonFrame;
use super::settings::Settings;
use crate::difference::{self, Link};
use crate::float_solution::FloatSolution;
use crate::signal::System;

/// Part of an epoch whose integers are accepted.
#[derive(Debug)]
pub(super) struct Part {
    pub(super) links: Vec<Link>,
    pub(super) groups: Vec<Range<usize>>,
    pub(super) float: FloatSolution,
    pub(super) outcome: Outcome,
    rivals: f64,
}

/// What may spoil an epoch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Suspect {
    /// Phases that unlike receivers may have an unknown bias for; their code is good.
    Unlike,
    /// All of a system.
    System(System),
}

/// Whom to suspect of spoiling the integers of these links, after this verdict.
pub(super) fn suspects(
    verdict: Verdict,
    links: &[Link],
    is_unlike: impl Fn(&Link) -> bool,
) -> Vec<Suspect> {
    let mut suspects = Vec::new();
    if verdict != Verdict::Fixed && links.iter().any(is_unlike) {
        suspects.push(Suspect::Unlike);
    }
    if verdict.is_spoilt() {
        let systems: BTreeSet<System> = links.iter().map(|l| l.satellite.system).collect();
        // What is left of one system alone is nothing.
        if systems.len() > 1 {
            suspects.extend(systems.into_iter().map(Suspect::System));
        }
    }
    suspects
}

impl Fixer {
    /// Integers of the epoch alone without one of the suspects; `is_unlike` names the links of
    /// [`Suspect::Unlike`].
    pub(super) fn fix_without_one(
        &mut self,
        suspects: &[Suspect],
        links: &[Link],
        is_unlike: impl Fn(&Link) -> bool,
        frame: &CommonFrame,
        settings: &Settings,
    ) -> Option<Part> {
        let rate = settings.max_wrong_fix_rate / suspects.len() as f64;
        let rest = |suspect: Suspect| -> Vec<Link> {
            let without = |link: &Link| match suspect {
                Suspect::Unlike if is_unlike(link) => Some(Link { phase_m: None, ..*link }),
                Suspect::System(spoilt) if link.satellite.system == spoilt => None,
                _ => Some(*link),
            };
            links.iter().filter_map(without).collect()
        };
        suspects
            .iter()
            .filter_map(|suspect| self.fix_part(rest(*suspect), frame, settings, rate))
            .min_by(|a, b| a.rivals.total_cmp(&b.rivals))
    }

    fn fix_part(
        &mut self,
        mut links: Vec<Link>,
        frame: &CommonFrame,
        settings: &Settings,
        rate: f64,
    ) -> Option<Part> {
        let groups = difference::group(&mut links);
        let rovers: Vec<usize> = frame.rovers().collect();
        let noise = self.noise();
        let float =
            FloatSolution::solve(&links, &groups, frame.reference, &rovers, |_| noise).ok()?;
        let outcome = self.fix(&float, &links, frame, settings, rate);
        let rivals = outcome.best.as_ref()?.1;
        let fixed = outcome.verdict == Verdict::Fixed;
        fixed.then_some(Part { links, groups, float, outcome, rivals })
    }
}
