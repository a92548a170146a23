//! Runs of epochs spread over the whole session, few enough to be solved many times.

use std::collections::{BTreeMap, BTreeSet};

use kurs::observation::ArrayEpoch;
use kurs::signal::Band;

use super::attendance::Attendance;
use super::patient::MANY;
use crate::copies::Copies;
use crate::solve::streams::Streams;

/// Multiples of it, less their whole parts, fill the interval from 0 to 1 evenly, and so do those
/// of every second, fifth or tenth multiple: a sample by it is in step with no receiver.
const GOLDEN_RATIO: f64 = 1.618_033_988_749_895;
/// Consecutive epochs that are taken together: an isolated fix of a weak model is unproven until
/// one beside it agrees. The first of a run, which one before it would have proven in the session,
/// is not judged. Half and twice as many tell the share of a weak session worse.
const RUN: u64 = 8;

/// The sample, and what was seen of the rest.
pub(crate) struct Sample {
    /// Taken from the epochs that two or more antennas have; from all epochs where there are none.
    pub(crate) epochs: Vec<ArrayEpoch>,
    /// Which of these are there for the epochs behind them alone.
    is_lead: Vec<bool>,
    /// Taken from the epochs that only one antenna has.
    pub(super) alone: Vec<ArrayEpoch>,
    /// Times of all epochs, and who has them.
    pub(crate) attendance: Attendance,
    /// Antennas with the same observations.
    pub(crate) copies: Copies,
    /// Time spans of the antennas, in words.
    pub(crate) spans: String,
}

impl Sample {
    /// Spreads `max_epochs` at most over the session.
    pub(crate) fn take(streams: &mut Streams, max_epochs: usize) -> anyhow::Result<Self> {
        let (mut together, mut alone) = (Spread::of(max_epochs), Spread::of(max_epochs));
        let (mut attendance, mut copies) = (Attendance::default(), Copies::default());
        let mut epoch = ArrayEpoch::default();
        while streams.next(&mut epoch)? {
            attendance.add(&epoch);
            copies.add(&epoch);
            let has_several = epoch.antennas.iter().flatten().count() >= 2;
            if has_several { &mut together } else { &mut alone }.add(&epoch);
        }
        let of_all = if together.kept.is_empty() { &alone } else { &together };
        let (epochs, is_lead) = (of_all.epochs(), of_all.leads());
        let (alone, spans) = (alone.epochs(), streams.spans());
        Ok(Self { epochs, is_lead, alone, attendance, copies, spans })
    }

    /// The epochs whose rows say how the session would be solved.
    pub(super) fn judged(&self) -> impl Iterator<Item = &ArrayEpoch> {
        self.rows_judged(&self.epochs)
    }

    /// Of what there is for every epoch, that of the judged ones.
    pub(super) fn rows_judged<T>(
        &self,
        rows: impl IntoIterator<Item = T>,
    ) -> impl Iterator<Item = T> {
        rows.into_iter().zip(&self.is_lead).filter(|(_, is_lead)| !**is_lead).map(|(row, _)| row)
    }

    /// Epochs of the session.
    pub(super) fn of(&self) -> u64 {
        self.attendance.session().rows()
    }

    /// Epochs that the sample stands for.
    pub(super) fn solvable(&self) -> u64 {
        match self.attendance.together() {
            0 => self.of(),
            together => together,
        }
    }

    /// How many epochs it has, and of how many, in words.
    pub(super) fn size(&self) -> String {
        let (sampled, solvable, of) = (self.judged().count(), self.solvable(), self.of());
        if solvable == of {
            format!("{sampled} of {of} epochs")
        } else {
            format!("{sampled} of the {solvable} epochs that two antennas have ({of} in all)")
        }
    }

    /// Bands that two antennas have in many of the epochs.
    pub(crate) fn shared_bands(&self) -> BTreeSet<Band> {
        let mut counts: BTreeMap<(usize, Band), usize> = BTreeMap::new();
        for (antenna, epoch) in self.epochs.iter().flat_map(|e| e.antennas.iter().enumerate()) {
            let observed = epoch.iter().flat_map(|e| &e.observations);
            let bands: BTreeSet<Band> = observed.map(|o| o.signal.band).collect();
            for band in bands {
                *counts.entry((antenna, band)).or_default() += 1;
            }
        }
        let many = |count: usize| count as f64 > MANY * self.epochs.len() as f64;
        let frequent = counts.iter().filter(|(_, count)| many(**count));
        let mut antennas: BTreeMap<Band, usize> = BTreeMap::new();
        for ((_, band), _) in frequent {
            *antennas.entry(*band).or_default() += 1;
        }
        antennas.into_iter().filter(|(_, count)| *count >= 2).map(|(band, _)| band).collect()
    }
}

/// Some of the epochs that it is given, in runs spread evenly.
struct Spread {
    max_epochs: usize,
    given: u64,
    share: f64,
    /// With their numbers.
    kept: Vec<(u64, ArrayEpoch)>,
}

impl Spread {
    fn of(max_epochs: usize) -> Self {
        Self { max_epochs, given: 0, share: 1.0, kept: Vec::new() }
    }

    /// Keeps every epoch at first, and half the share whenever there are more than enough.
    fn add(&mut self, epoch: &ArrayEpoch) {
        let number = self.given;
        self.given += 1;
        if self.kept.len() == self.max_epochs && is_within(number, self.share) {
            self.share /= 2.0;
            let share = self.share;
            self.kept.retain(|(number, _)| is_within(*number, share));
        }
        if self.kept.len() < self.max_epochs && is_within(number, self.share) {
            self.kept.push((number, epoch.clone()));
        }
    }

    fn epochs(&self) -> Vec<ArrayEpoch> {
        self.kept.iter().map(|(_, epoch)| epoch.clone()).collect()
    }

    /// Which of the epochs do not have their neighbour before them; none where nothing is left out.
    fn leads(&self) -> Vec<bool> {
        let mut next = None;
        let mut is_lead = |number: u64| next.replace(number + 1) != Some(number);
        self.kept.iter().map(|(number, _)| is_lead(*number) && self.share < 1.0).collect()
    }
}

/// Whether the run of an epoch is among those that make up a share of all.
fn is_within(number: u64, share: f64) -> bool {
    ((number / RUN) as f64 * GOLDEN_RATIO).fract() < share
}

#[cfg(test)]
mod tests {
    use super::*;
    use kurs::time::GpsTime;

    #[test]
    fn a_sample_is_in_step_with_no_rate() {
        let mut spread = Spread::of(80);
        let time = |tick: u32| GpsTime::default() + f64::from(tick);
        (0..3000).for_each(|tick| {
            spread.add(&ArrayEpoch { time: time(tick), ..ArrayEpoch::default() });
        });
        let epochs = spread.epochs();
        assert!((40..=80).contains(&epochs.len()), "{}", epochs.len());
        for every in [2, 4, 5, 10, 16] {
            let of_slower = (0..3000).step_by(every).map(time);
            let common = of_slower.filter(|time| epochs.iter().any(|e| e.time == *time)).count();
            let expected = epochs.len() as f64 / every as f64;
            assert!((common as f64 - expected).abs() < 2.5, "every {every}: {common}, {expected}");
        }
    }

    #[test]
    fn the_first_of_a_run_leads_unless_nothing_is_left_out() {
        let of = |epochs: u32| {
            let mut spread = Spread::of(80);
            (0..epochs).for_each(|_| spread.add(&ArrayEpoch::default()));
            spread
        };
        assert_eq!(of(80).leads(), vec![false; 80]);
        let spread = of(3000);
        let expected = spread.kept.iter().map(|(number, _)| number % RUN == 0);
        assert_eq!(spread.leads(), expected.collect::<Vec<_>>());
    }
}
