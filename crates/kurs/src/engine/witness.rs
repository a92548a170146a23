//! Memory as a witness: within an arc without a slip the whole cycles of a phase are one constant, so the integers
//! of two accepted epochs must agree.
//!
//! An epoch's integers say the whole cycles `N` of its links up to a number for each receiver and each satellite.
//! Two epochs agree if every double difference of `N − N′` over the links whose arcs go on is zero. An epoch that
//! agrees with an accepted one before is proven by it. An epoch that does not contradicts it, and neither
//! is believed until the next accepted epoch sides with one of them – unless all but the links of one
//! satellite at one antenna agree: then that phase slipped unseen. An epoch whose model is weak, and that nothing
//! confirms yet, is not believed alone.
//!
//! The memory never helps to find integers (no fix-and-hold): it only speaks for or against those that an
//! epoch found by itself.

use std::ops::Range;

use crate::cycle_slip::Continuity;
use crate::difference::{Link, loops};
use crate::signal::{Satellite, Signal};

/// Double differences that two epochs must have in common to testify to each other: three determine a
/// baseline, the others are free to disagree.
const MIN_COMMON: usize = 4;

/// Independent epochs that must have agreed before others learn from the integers: ten seconds of them.
const MIN_AGREEMENTS: f64 = 0.2;

/// The whole cycles of one link in an accepted epoch.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Held {
    signal: Signal,
    satellite: Satellite,
    antenna: usize,
    arc: u32,
    cycles: f64,
}

impl Held {
    fn key(&self) -> (Signal, Satellite, usize) {
        (self.signal, self.satellite, self.antenna)
    }
}

/// What the epochs before say of the integers of this one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Testimony {
    /// Nothing: too few arcs go on.
    Silent,
    /// They are the same.
    Agrees,
    /// They are others.
    Contradicts,
}

/// The accepted integers of the arcs that go on.
#[derive(Debug, Clone, Default)]
pub(super) struct Witness {
    /// Sorted by key.
    held: Vec<Held>,
    /// Independent epochs that agreed with `held`.
    agreements: f64,
    /// Integers that contradicted it last.
    challenger: Vec<Held>,
}

/// An epoch's integers as whole cycles of its links.
#[derive(Debug, Clone, Copy)]
pub(super) struct Claim<'a> {
    pub(super) links: &'a [Link],
    pub(super) groups: &'a [Range<usize>],
    /// As `FloatSolution::whole_cycles`.
    pub(super) cycles: &'a [Option<f64>],
    /// Numbers of the links' arcs.
    pub(super) arcs: &'a [u32],
}

impl Claim<'_> {
    /// What each link says, as far as it does.
    fn said(&self) -> impl Iterator<Item = Option<Held>> {
        self.links.iter().zip(self.cycles).zip(self.arcs).map(|((link, cycles), arc)| {
            let Link { signal, satellite, antenna, .. } = *link;
            Some(Held { signal, satellite, antenna, arc: *arc, cycles: (*cycles)? })
        })
    }

    fn held(&self) -> Vec<Held> {
        let mut held: Vec<Held> = self.said().flatten().collect();
        held.sort_by_key(Held::key);
        held
    }

    /// Departures `N − N′` of each link from what is held of its arc.
    fn departures(&self, held: &[Held]) -> Vec<Option<f64>> {
        // The links of an epoch and what is held of them stand nearly in the same order.
        let mut likely = 0;
        let mut departure = |now: Held| {
            let found = match held.get(likely) {
                Some(before) if before.key() == now.key() => likely,
                _ => held.binary_search_by_key(&now.key(), Held::key).ok()?,
            };
            likely = found + 1;
            (held[found].arc == now.arc).then(|| now.cycles - held[found].cycles)
        };
        self.said().map(|said| departure(said?)).collect()
    }

    /// Double differences of the departures in common, and how many are not zero, without the links of
    /// one satellite at one antenna.
    fn compare(
        &self,
        departures: &[Option<f64>],
        without: Option<(usize, Satellite)>,
    ) -> (usize, usize) {
        let (mut common, mut different) = (0, 0);
        let mut values = Vec::with_capacity(self.links.len());
        for group in self.groups {
            let of_group = self.links[group.clone()].iter().zip(&departures[group.clone()]);
            values.clear();
            values.extend(
                of_group
                    .filter(|(link, _)| without != Some((link.antenna, link.satellite)))
                    .filter_map(|(l, departure)| Some((l.antenna, l.satellite, (*departure)?))),
            );
            let (all, open) = loops(&values);
            (common, different) = (common + all, different + open);
        }
        (common, different)
    }

    fn testimony(&self, held: &[Held]) -> (Testimony, bool) {
        let departures = self.departures(held);
        let (common, different) = self.compare(&departures, None);
        if common < MIN_COMMON {
            return (Testimony::Silent, false);
        }
        if different == 0 {
            return (Testimony::Agrees, false);
        }
        let mut suspects: Vec<(usize, Satellite)> = self
            .links
            .iter()
            .zip(&departures)
            .filter(|(_, departure)| departure.is_some())
            .map(|(link, _)| (link.antenna, link.satellite))
            .collect();
        suspects.sort_unstable();
        suspects.dedup();
        let is_one_slip = suspects.iter().any(|suspect| {
            let (common, different) = self.compare(&departures, Some(*suspect));
            different == 0 && common >= MIN_COMMON
        });
        (Testimony::Contradicts, is_one_slip)
    }
}

impl Witness {
    /// Whole cycles of a link, if enough independent epochs agreed on them: the epoch itself has not chosen
    /// them.
    pub(super) fn proven(&self, link: &Link, continuity: &Continuity) -> Option<f64> {
        if self.agreements < MIN_AGREEMENTS {
            return None;
        }
        let key = (link.signal, link.satellite, link.antenna);
        let held = &self.held[self.held.binary_search_by_key(&key, Held::key).ok()?];
        let arc = continuity.number(link.antenna, link.satellite, link.signal);
        (held.arc == arc).then_some(held.cycles)
    }

    /// Hears the accepted integers of an epoch that is `weight` of an independent one, and takes them in.
    pub(super) fn hear(&mut self, claim: &Claim, weight: f64) -> Testimony {
        let (testimony, is_one_slip) = claim.testimony(&self.held);
        let now = claim.held();
        match testimony {
            Testimony::Agrees => {
                self.agreements += weight;
                self.accept(now);
                Testimony::Agrees
            }
            Testimony::Silent => {
                self.agreements = 0.0;
                self.accept(now);
                Testimony::Silent
            }
            // The others determine the baselines, and the phase fits to them with its new cycles.
            Testimony::Contradicts if is_one_slip => {
                self.accept(now);
                Testimony::Agrees
            }
            Testimony::Contradicts => {
                let (with_challenger, _) = claim.testimony(&self.challenger);
                self.agreements = 0.0;
                if with_challenger == Testimony::Agrees {
                    self.accept(now);
                    return Testimony::Agrees;
                }
                self.challenger = now;
                Testimony::Contradicts
            }
        }
    }

    fn accept(&mut self, now: Vec<Held>) {
        self.held = now;
        self.challenger.clear();
    }
}
