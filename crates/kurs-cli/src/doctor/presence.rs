//! Are the observations there: of every antenna, at the same instants, with ephemerides, in common
//! bands, and of antennas that are different ones?

use std::collections::BTreeSet;

use kurs::signal::Band;
use kurs::time::GpsTime;

use super::WELL;
use super::patient::{Finding, MANY, Patient};
use super::sample::Sample;
use super::trials::Trials;
use crate::summary::Damage;
use crate::unobserved_bands::UnobservedBands;

impl Patient<'_> {
    /// Antennas that are not there together.
    pub(super) fn times(&self, sample: &Sample, trials: &Trials) -> Option<Finding> {
        let attendance = &sample.attendance;
        let apart = trials.configured.share_apart();
        if apart > MANY {
            return Some(self.unsynchronised(sample, apart));
        }
        if attendance.share_alone() < MANY {
            return None;
        }
        if attendance.take_turns() {
            return Some(self.unsynchronised(sample, 1.0));
        }
        let at_own_rate: Vec<f64> =
            (0..self.names.len()).map(|antenna| attendance.share_at_own_rate(antenna)).collect();
        // A slow receiver that has all of its epochs is told by its rate.
        let has_slow = attendance.different_rates(self.names).is_some();
        if has_slow && at_own_rate.iter().all(|share| *share > 1.0 - MANY) {
            return None;
        }
        let shares = self.names.iter().zip(&at_own_rate);
        let shares: Vec<String> =
            shares.map(|(name, share)| format!("{name} {:.0} %", 100.0 * share)).collect();
        Some(Finding {
            code: "missing_antenna",
            cause: "the antennas are not observed at the same time".into(),
            evidence: format!("epochs of each antenna: {}; {}", shares.join(", "), sample.spans),
            advice: "give files of the same hours for every antenna; look for a receiver that fell silent".into(),
        })
    }

    /// Receivers of different rates.
    pub(super) fn rates(&self, sample: &Sample) -> Option<Finding> {
        Some(Finding {
            code: "different_rates",
            cause: "the receivers observe at different rates".into(),
            evidence: sample.attendance.different_rates(self.names)?,
            advice: "set all receivers to the same rate, or take the epochs that they have in \
                     common with `--every SECONDS`"
                .into(),
        })
    }

    /// Receivers that sample at different instants.
    fn unsynchronised(&self, sample: &Sample, share: f64) -> Finding {
        let within_second = |time: GpsTime| time.tow_s().rem_euclid(1.0);
        let first = |antenna: usize| sample.attendance.of_antenna(antenna).first();
        let offsets: Vec<String> = (0..self.names.len())
            .filter_map(|a| Some(format!("{} at {:.3} s", self.names[a], within_second(first(a)?))))
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
            let sampled = sample.epochs.iter().chain(&sample.alone);
            let epochs = sampled.filter_map(|e| e.antennas[antenna].as_ref());
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

/// Wanted bands that no antenna has, beside others that are observed.
pub(super) fn unobserved_bands(sample: &Sample, bands: Option<&[Band]>) -> Option<Finding> {
    let mut unobserved = UnobservedBands::of(bands);
    sample.epochs.iter().chain(&sample.alone).for_each(|epoch| unobserved.add(epoch));
    Some(Finding {
        code: "unobserved_bands",
        cause: unobserved.sentence()?,
        evidence: "`bands` wants it, and the session does without".into(),
        advice: "take it out of `bands`, or let the receivers log it".into(),
    })
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
    let session = sample.attendance.session();
    let (missing, epochs) = (session.missing(), session.epochs());
    let share = missing as f64 / epochs.max(1) as f64;
    (share > 1.0 - WELL).then(|| Finding {
        code: "gaps",
        cause: format!("no antenna has any observations in {:.0} % of the session", 100.0 * share),
        evidence: format!(
            "{missing} of {epochs} epochs are missing at the interval of {:.3} s; {}",
            session.interval_s().unwrap_or(0.0),
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
