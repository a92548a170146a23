//! From the trials to findings, the most telling first. What follows from a finding is none itself.

use kurs::solution::Status;

use super::patient::{Finding, Patient};
use super::reasons;
use super::sample::Sample;
use super::trials::Trials;
use super::usage::UsageRow;
use super::{WELL, causes, presence, shape};
use crate::summary::Damage;

/// Everything that is to be said.
pub(super) fn findings(
    patient: &Patient<'_>,
    sample: &Sample,
    trials: &Trials,
    signals: &[UsageRow],
    damage: &[Damage],
) -> Vec<Finding> {
    let mut all: Vec<Finding> = shape::turned(trials).into_iter().collect();
    if fixed_of_session(sample, trials) < WELL {
        all.extend(patient.times(sample, trials));
        all.extend(presence::gaps(sample));
        all.extend(patient.ephemerides(sample, trials));
        all.extend(patient.bands(sample));
        let shape = shape::wrong(patient, sample, trials);
        let is_misshapen = shape.is_some();
        all.extend(shape);
        // A wrong shape spoils the integers, and with them what follows from them.
        if !is_misshapen {
            all.extend(patient.system(trials));
        }
        all.extend(patient.antenna(trials));
        all.extend(causes::phases(signals));
        all.extend(patient.noise(trials, is_misshapen));
        all.extend(patient.satellites(trials));
        if all.is_empty() {
            all.extend(patient.strength(trials));
        }
        if all.is_empty() {
            all.extend(unexplained(sample, trials));
        }
        all.extend(patient.unused_bands(sample));
    }
    all.extend(presence::broken_files(damage));
    all
}

/// Share of the session's epochs that are fixed, gaps included.
pub(super) fn fixed_of_session(sample: &Sample, trials: &Trials) -> f64 {
    let there = sample.session.epochs() - sample.session.missing();
    let share = there as f64 / sample.session.epochs().max(1) as f64;
    share * trials.configured.share(Status::Fixed)
}

/// By the most frequent reason alone.
fn unexplained(sample: &Sample, trials: &Trials) -> Option<Finding> {
    let reasons = trials.configured.reasons();
    let (word, count) = reasons.iter().max_by_key(|(_, count)| **count)?;
    let evidence =
        format!("`{word}` in {count} of {} epochs, and no trial fixes more", sample.epochs.len());
    Some(reasons::unexplained(word, evidence))
}
