//! Are the observations there: of every antenna, at the same instants, with ephemerides, in common
//! bands, and of antennas that are different ones?

use std::collections::{BTreeMap, BTreeSet};

use kurs::observation::AntennaEpoch;
use kurs::signal::Band;
use kurs::time::GpsTime;

use super::WELL;
use super::patient::{Finding, MANY, Patient};
use super::sample::Sample;
use super::trials::Trials;
use crate::summary::Damage;

impl Patient<'_> {
    /// Antennas that are not there together.
    pub(super) fn times(&self, sample: &Sample, trials: &Trials) -> Option<Finding> {
        let present = |antenna: usize| {
            let there = sample.epochs.iter().filter(|e| e.antennas[antenna].is_some());
            there.count() as f64 / sample.epochs.len() as f64
        };
        let apart = trials.configured.share_apart();
        if apart > MANY {
            return Some(self.unsynchronised(sample, apart));
        }
        if trials.configured.share_of_reason("few_antennas") < MANY {
            return None;
        }
        if take_turns(sample) {
            return Some(self.unsynchronised(sample, 1.0));
        }
        let shares: Vec<String> = (0..self.names.len())
            .map(|a| format!("{} {:.0} %", self.names[a], 100.0 * present(a)))
            .collect();
        Some(Finding {
            code: "missing_antenna",
            cause: "the antennas are not observed at the same time".into(),
            evidence: format!("epochs of each antenna: {}; {}", shares.join(", "), sample.spans),
            advice: "give files of the same hours for every antenna; look for a receiver that fell silent".into(),
        })
    }

    /// Receivers that sample at different instants.
    fn unsynchronised(&self, sample: &Sample, share: f64) -> Finding {
        let tags = |antenna: usize| {
            let epochs = sample.epochs.iter().filter_map(move |e| e.antennas[antenna].as_ref());
            epochs.map(|e| e.time)
        };
        let within_second = |time: GpsTime| time.tow_s().rem_euclid(1.0);
        let offsets: Vec<String> = (0..self.names.len())
            .filter_map(|a| {
                Some(format!("{} at {:.3} s", self.names[a], within_second(tags(a).next()?)))
            })
            .collect();
        Finding {
            code: "unsynchronised",
            cause: "the receivers do not sample at the same instants".into(),
            evidence: format!(
                "{:.0} % of the epochs; first tags within the second: {}",
                100.0 * share,
                offsets.join(", ")
            ),
            advice:
                "set all receivers to the same rate, aligned to GPS time; heading needs samples \
                     within 10 ms of each other"
                    .into(),
        }
    }

    /// Navigation data of another day, or none for the satellites in view.
    pub(super) fn ephemerides(&self, sample: &Sample, trials: &Trials) -> Option<Finding> {
        let share = trials.configured.share_of_reason("no_ephemeris");
        if share < MANY {
            return None;
        }
        let times = || self.navigation.ephemerides.iter().map(|e| e.reference_time());
        let (first, last) = (times().min()?, times().max()?);
        let (from, to) = (sample.epochs.first()?.time, sample.epochs.last()?.time);
        Some(Finding {
            code: "navigation_day",
            cause: "the navigation data are not of the time of the observations".into(),
            evidence: format!("ephemerides from {first} to {last}, observations from {from} to {to}"),
            advice: "give the navigation file of the same day (and the neighbouring one around midnight)"
                .into(),
        })
    }

    /// Wanted bands that no two antennas have.
    pub(super) fn bands(&self, sample: &Sample) -> Option<Finding> {
        let of_antenna = |antenna: usize| -> BTreeSet<Band> {
            let epochs = sample.epochs.iter().filter_map(|e| e.antennas[antenna].as_ref());
            epochs.flat_map(|e| e.observations.iter().map(|o| o.signal.band)).collect()
        };
        let have: Vec<BTreeSet<Band>> = (0..self.names.len()).map(of_antenna).collect();
        let shared = |band: &Band| have.iter().filter(|bands| bands.contains(band)).count() >= 2;
        if have.iter().flatten().any(|band| self.settings.wants(*band) && shared(band)) {
            return None;
        }
        let listed = self.names.iter().zip(&have).map(|(name, bands)| {
            let bands: Vec<String> = bands.iter().map(Band::to_string).collect();
            format!("{name}: {}", bands.join(" "))
        });
        Some(Finding {
            code: "no_common_band",
            cause: "no two antennas share a wanted band".into(),
            evidence: listed.collect::<Vec<_>>().join("; "),
            advice: "set `bands` to bands that every antenna has".into(),
        })
    }
}

/// Two antennas that are one: nothing else can be said then.
pub(super) fn one_recording(names: &[String], sample: &Sample) -> Option<Finding> {
    let ((first, second), epochs) = sample.copies.first()?;
    let (first, second) = (&names[first], &names[second]);
    Some(Finding {
        code: "one_recording",
        cause: sample.copies.text(names)?,
        evidence: format!("code and phase of every common signal are equal in {epochs} epochs"),
        advice: format!("give {first} and {second} files of two receivers on two antennas"),
    })
}

/// Times in which no antenna has an epoch.
pub(super) fn gaps(sample: &Sample) -> Option<Finding> {
    let (missing, epochs) = (sample.session.missing(), sample.session.epochs());
    let share = missing as f64 / epochs.max(1) as f64;
    (share > 1.0 - WELL).then(|| Finding {
        code: "gaps",
        cause: format!("no antenna has any observations in {:.0} % of the session", 100.0 * share),
        evidence: format!(
            "{missing} of {epochs} epochs are missing at the interval of {:.3} s; {}",
            sample.session.interval_s().unwrap_or(0.0),
            sample.spans
        ),
        advice: "look for files that are missing, and for a logger that pauses".into(),
    })
}

/// Damage in the files.
pub(super) fn broken_files(damage: &[Damage]) -> Option<Finding> {
    let first = damage.first()?;
    Some(Finding {
        code: "damage",
        cause: format!("{} places in the files cannot be read", damage.len()),
        evidence: format!("first: {}:{}: {}", first.file, first.line, first.what),
        advice: "copy or convert the files again; what surrounds the damage is used".into(),
    })
}

/// Whether some antennas have epochs just where others have none, and the other way round.
fn take_turns(sample: &Sample) -> bool {
    let mut sets: BTreeMap<Vec<bool>, usize> = BTreeMap::new();
    for epoch in &sample.epochs {
        *sets.entry(epoch.antennas.iter().map(Option::is_some).collect()).or_default() += 1;
    }
    let often = |count: usize| count as f64 > MANY * sample.epochs.len() as f64;
    let frequent: Vec<&Vec<bool>> =
        sets.iter().filter(|(_, count)| often(**count)).map(|(set, _)| set).collect();
    let disjoint = |a: &[bool], b: &[bool]| a.iter().zip(b).all(|(one, other)| !(*one && *other));
    frequent.iter().any(|a| frequent.iter().any(|b| disjoint(a, b))) && overlap(sample)
}

/// Whether the antennas' spans overlap.
fn overlap(sample: &Sample) -> bool {
    let antennas = sample.epochs.first().map_or(0, |e| e.antennas.len());
    let span = |antenna: usize| {
        let times = sample
            .epochs
            .iter()
            .filter_map(|e| e.antennas[antenna].as_ref().map(|a: &AntennaEpoch| a.time));
        Some((times.clone().next()?, times.max()?))
    };
    let spans: Vec<_> = (0..antennas).filter_map(span).collect();
    let latest_start = spans.iter().map(|s| s.0).max();
    let earliest_end = spans.iter().map(|s| s.1).min();
    latest_start < earliest_end
}
