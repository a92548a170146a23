//! From the trials to findings, the most telling first. A consequence of a finding is not listed.

use kurs::solution::Status;

use super::patient::{Finding, MANY, Patient};
use super::reasons;
use super::sample::Sample;
use super::trials::Trials;
use super::usage::UsageRow;
use super::{WELL, causes, presence, shape};
use crate::integers::Integers;
use crate::summary::Damage;

/// Everything that is to be said.
pub(super) fn findings(
    patient: &Patient<'_>,
    sample: &Sample,
    trials: &Trials,
    signals: &[UsageRow],
    integers: &Integers,
    damage: &[Damage],
) -> Vec<Finding> {
    let mut all: Vec<Finding> = shape::turned(trials).into_iter().collect();
    all.extend(patient.interference(sample));
    all.extend(patient.rates(sample));
    // The others may be fixed well without a receiver that samples apart.
    let is_apart = trials.configured.share_apart() > MANY;
    if fixed_of_session(sample, trials) < WELL || is_apart {
        add_causes(&mut all, patient, sample, trials, signals, integers);
    }
    if !all.iter().any(|finding| finding.code == "no_common_band") {
        all.extend(presence::unobserved_bands(sample, patient.settings.bands.as_deref()));
    }
    all.extend(presence::broken_files(damage));
    all
}

/// Adds why little is fixed, or why an antenna has no part.
fn add_causes(
    all: &mut Vec<Finding>,
    patient: &Patient<'_>,
    sample: &Sample,
    trials: &Trials,
    signals: &[UsageRow],
    integers: &Integers,
) {
    let times = patient.times(sample, trials);
    all.extend(times);
    all.extend(presence::gaps(sample));
    all.extend(patient.ephemerides(sample, trials));
    let bands = patient.bands(sample);
    let has_bands = bands.is_none();
    all.extend(bands);
    let shape = shape::wrong(patient, sample, trials);
    let is_misshapen = shape.is_some();
    // Antennas at each other's places turn the body too: that follows.
    if is_misshapen {
        all.retain(|finding| finding.code != "mirrored_array");
    }
    all.extend(shape);
    // A wrong shape spoils the integers, and with them what follows from them.
    if !is_misshapen {
        all.extend(patient.system(trials));
        all.extend(patient.band_or_links(trials, sample));
    }
    all.extend(patient.obstacles());
    // Without the antenna that states spoofing no statement is left: that follows.
    if !all.iter().any(|finding| finding.code == "spoofing") {
        all.extend(patient.antenna(trials));
    }
    all.extend(causes::phases(signals));
    all.extend(patient.noise(trials, is_misshapen));
    if has_bands {
        all.extend(patient.satellites(trials));
    }
    // An antenna without a part in the rows is a consequence wherever something else is found.
    if all.is_empty() {
        all.extend(patient.idle_antenna(trials));
    }
    if all.is_empty() {
        all.extend(patient.strength(trials));
    }
    if all.is_empty() {
        all.extend(unexplained(sample, trials, integers));
    }
    if has_bands {
        all.extend(patient.unused_bands(sample));
    }
}

/// Share of the session's epochs that are fixed, gaps included.
pub(super) fn fixed_of_session(sample: &Sample, trials: &Trials) -> f64 {
    let epochs = sample.attendance.session().epochs();
    sample.solvable() as f64 / epochs.max(1) as f64 * trials.configured.share(Status::Fixed)
}

/// By the most frequent reason alone.
fn unexplained(sample: &Sample, trials: &Trials, integers: &Integers) -> Option<Finding> {
    let (of, alone) = (sample.judged().count(), sample.of() - sample.solvable());
    let reasons = trials.configured.reasons();
    let most = reasons.iter().max_by_key(|(_, count)| **count);
    let in_session =
        most.map_or(0.0, |(_, count)| *count as f64 / of as f64 * sample.solvable() as f64);
    if alone as f64 > in_session {
        let evidence = format!("one antenna is alone in {alone} of {} epochs", sample.of());
        return Some(reasons::unexplained("few_antennas", evidence));
    }
    let (word, count) = most?;
    let mut evidence = format!("`{word}` in {count} of {of} epochs, and no trial fixes more");
    if let Some(check) = integers.sentence_of(word) {
        evidence = format!("{evidence}; {check}");
    }
    Some(reasons::unexplained(word, evidence))
}
