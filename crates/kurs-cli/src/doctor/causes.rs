//! From the trials to causes, the most telling first.

use std::collections::{BTreeMap, BTreeSet};

use kurs::antenna_calibration::MountedAntenna;
use kurs::array::AntennaArray;
use kurs::engine::{Constraint, Settings};
use kurs::ephemeris::NavigationData;
use kurs::observation::AntennaEpoch;
use kurs::signal::{Band, System};
use kurs::solution::{SignalResidual, Status};
use kurs::time::GpsTime;
use serde::Serialize;

use super::geometry::{self, Distance};
use super::sample::Sample;
use super::trials::{self, Trials};
use super::usage::UsageRow;
use crate::summary::Damage;

/// A share of the epochs that makes something a cause.
const MANY: f64 = 0.2;
/// A trial with this many more of the epochs fixed mends something.
const MENDED: f64 = 0.3;
/// A session with this share fixed needs no doctor.
const WELL: f64 = 0.98;
/// Phases that fit better by this factor.
const BETTER_FIT: f64 = 0.7;
/// Residuals this many times larger than the noise model says are reflections or worse.
const NOISY: f64 = 4.0;
/// An antenna whose residuals are this many times larger than those of the others.
const WORSE_THAN_OTHERS: f64 = 2.5;
/// Fewer satellites than this are few, even with the geometry known.
const FEW_SATELLITES: usize = 5;

/// Which residual of a signal.
type ResidualOf = fn(&SignalResidual) -> Option<f64>;

/// One cause.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub(super) struct Finding {
    /// One word for programs.
    pub(super) code: &'static str,
    /// In words.
    pub(super) cause: String,
    /// What shows it.
    pub(super) evidence: String,
    /// What to change.
    pub(super) advice: String,
}

/// What is known beforehand.
pub(super) struct Patient<'a> {
    pub(super) names: &'a [String],
    pub(super) settings: &'a Settings,
    pub(super) array: Option<&'a AntennaArray>,
    pub(super) navigation: &'a NavigationData,
    pub(super) mounts: &'a [Option<MountedAntenna>],
}

/// All causes found.
pub(super) fn findings(
    patient: &Patient<'_>,
    sample: &Sample,
    trials: &Trials,
    signals: &[UsageRow],
    damage: &[Damage],
) -> Vec<Finding> {
    let ill = trials.configured.share(Status::Fixed) < WELL;
    let mut all = Vec::new();
    if ill {
        all.extend(patient.times(sample, trials));
        all.extend(patient.ephemerides(sample, trials));
        all.extend(patient.bands(sample));
        all.extend(patient.system(trials));
        all.extend(patient.geometry(sample, trials));
        all.extend(patient.antenna(trials));
        all.extend(phases(signals));
        all.extend(patient.noise(trials));
        all.extend(patient.satellites(trials));
        all.extend(patient.strength(sample, trials, all.is_empty()));
    }
    all.extend(broken_files(damage));
    all
}

impl Patient<'_> {
    /// Antennas that are not there together.
    fn times(&self, sample: &Sample, trials: &Trials) -> Option<Finding> {
        let present = |antenna: usize| {
            let there = sample.epochs.iter().filter(|e| e.antennas[antenna].is_some());
            there.count() as f64 / sample.epochs.len() as f64
        };
        let apart = trials.configured.share_of_reason("time_mismatch");
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
    fn ephemerides(&self, sample: &Sample, trials: &Trials) -> Option<Finding> {
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
    fn bands(&self, sample: &Sample) -> Option<Finding> {
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

    /// Swapped or misplaced antennas.
    fn geometry(&self, sample: &Sample, trials: &Trials) -> Option<Finding> {
        let array = self.array?;
        let sd_m = self.settings.array_sd_m;
        let distances = if trials.free.share(Status::Fixed) > MANY {
            geometry::distances(&trials.free, array)
        } else {
            geometry::scanned(self, sample, array)
        };
        let wrong: Vec<&Distance> = distances.iter().filter(|d| d.is_wrong(sd_m)).collect();
        if wrong.is_empty() {
            return None;
        }
        let name = |antenna: usize| &self.names[antenna];
        let listed: Vec<String> = wrong
            .iter()
            .map(|d| {
                let (first, second) = (name(d.first), name(d.second));
                format!("{first}-{second} {:.3} m, configured {:.3} m", d.found_m, d.known_m)
            })
            .collect();
        let evidence = format!("distances in the data: {}", listed.join("; "));
        if let Some(order) = geometry::swapped(&distances, array, sd_m) {
            let moved: Vec<String> = (0..order.len())
                .filter(|i| order[*i] != *i)
                .map(|i| format!("the data of {} fit the place of {}", name(i), name(order[i])))
                .collect();
            return Some(Finding {
                code: "swapped_antennas",
                cause: "antennas are swapped".into(),
                evidence: format!("{}; {evidence}", moved.join(", ")),
                advice: "exchange the `obs` files or the `position_m` of these antennas".into(),
            });
        }
        let cause = match geometry::misplaced(&distances, array.len(), sd_m) {
            Some(antenna) => format!("the position of antenna {} is wrong", name(antenna)),
            None => "the configured geometry is wrong".into(),
        };
        Some(Finding {
            code: "wrong_geometry",
            cause,
            evidence,
            advice: "measure again, or take the positions of `kurs survey`".into(),
        })
    }

    /// A constellation that spoils the others: left out by the engine already, or better left out.
    fn system(&self, trials: &Trials) -> Option<Finding> {
        let systems = trials.without_system.iter().map(|(system, _)| *system);
        let most = systems
            .map(|system| (system, trials.configured.share_without(system)))
            .max_by(|a, b| a.1.total_cmp(&b.1));
        if let Some((system, share)) = most.filter(|(_, share)| *share > MENDED) {
            let evidence =
                format!("{:.1} % of the epochs are fixed without it only", 100.0 * share);
            return Some(Self::bad_system(system, evidence));
        }
        let before = trials.configured.share(Status::Fixed);
        let (system, share, residual_m) = trials
            .without_system
            .iter()
            .map(|(system, trial)| (*system, trial.share(Status::Fixed), trial.residual_m()))
            .max_by(|a, b| a.1.total_cmp(&b.1))?;
        // Where the geometry is wrong, fewer satellites are fixed wrongly more easily: then the phases
        // fit no better than all of them do without geometry.
        let fits = residual_m < BETTER_FIT * trials.free.residual_m();
        let evidence = format!(
            "with it {:.1} % of the epochs are fixed, without it {:.1} %",
            100.0 * before,
            100.0 * share
        );
        (share - before > MENDED && fits).then(|| Self::bad_system(system, evidence))
    }

    fn bad_system(system: System, evidence: String) -> Finding {
        Finding {
            code: "bad_system",
            cause: format!("the phases of {} do not fit the others", words(system)),
            evidence,
            advice: format!(
                "leave its bands out of `bands`; unlike receivers may have biases for {}",
                words(system)
            ),
        }
    }

    /// An antenna that spoils the others.
    fn antenna(&self, trials: &Trials) -> Option<Finding> {
        let before = trials.free.share(Status::Fixed);
        let (antenna, share) = trials
            .without_antenna
            .iter()
            .map(|(antenna, trial)| (*antenna, trial.share(Status::Fixed)))
            .max_by(|a, b| a.1.total_cmp(&b.1))?;
        (share - before > MENDED).then(|| Finding {
            code: "bad_antenna",
            cause: format!("antenna {} spoils the fix", self.names[antenna]),
            evidence: format!(
                "without it {:.1} % of the epochs are fixed, with it {:.1} %",
                100.0 * share,
                100.0 * before
            ),
            advice: "look at its cable, its view of the sky, and its receiver's signals".into(),
        })
    }

    /// Residuals as reflections make them; `rms` takes them to the zenith.
    fn noise(&self, trials: &Trials) -> Option<Finding> {
        let rms = |of: ResidualOf, antenna: Option<usize>| {
            let rows = trials.configured.rows.iter().chain(&trials.free.rows);
            let residuals = rows.flat_map(|row| &row.residuals);
            let chosen = residuals.filter(|r| antenna.is_none_or(|a| r.antenna == a));
            let at_zenith = chosen.filter_map(|r| Some(of(r)? * r.elevation_rad.sin()));
            let (sum, count) = at_zenith.fold((0.0, 0.0), |(s, n), r| (s + r * r, n + 1.0));
            (sum / f64::max(count, 1.0)).sqrt()
        };
        let noise = &self.settings.noise;
        let kinds: [(&str, ResidualOf, f64); 2] = [
            ("code", |r| r.code_m, noise.code_zenith_m),
            ("phase", |r| r.phase_m, noise.phase_zenith_m),
        ];
        kinds.into_iter().find_map(|(kind, of, expected_m)| {
            let per_antenna: Vec<f64> =
                (0..self.names.len()).map(|antenna| rms(of, Some(antenna))).collect();
            let (worst, largest) =
                per_antenna.iter().copied().enumerate().max_by(|a, b| a.1.total_cmp(&b.1))?;
            let others = per_antenna.iter().enumerate().filter(|(antenna, _)| *antenna != worst);
            let next = others.map(|(_, r)| *r).fold(0.0, f64::max);
            let one = self.names.len() > 2 && largest > WORSE_THAN_OTHERS * next;
            let all = rms(of, None);
            if all < NOISY * expected_m && !(one && largest > NOISY * expected_m) {
                return None;
            }
            let listed: Vec<String> = self
                .names
                .iter()
                .zip(&per_antenna)
                .map(|(name, r)| format!("{name} {r:.3} m"))
                .collect();
            let place = if one { format!(" at antenna {}", self.names[worst]) } else { String::new() };
            Some(Finding {
                code: "multipath",
                cause: format!("large {kind} residuals{place}, as reflections make them"),
                evidence: format!(
                    "root mean square {} (a quiet place: {expected_m:.4} m at the zenith)",
                    listed.join(", ")
                ),
                advice: "move the antenna away from walls and metal, raise `elevation_mask_deg`, or use \
                         more bands"
                    .into(),
            })
        })
    }

    /// Too few satellites.
    fn satellites(&self, trials: &Trials) -> Option<Finding> {
        let rows = &trials.configured.rows;
        let mut shared: Vec<usize> = rows.iter().map(|row| row.shared_satellites).collect();
        shared.sort_unstable();
        let median = *shared.get(shared.len() / 2)?;
        let mask_deg = self.settings.elevation_mask_rad.to_degrees();
        (median < FEW_SATELLITES).then(|| Finding {
            code: "few_satellites",
            cause: "few satellites are shared by the antennas".into(),
            evidence: format!("{median} in the median epoch, above {mask_deg:.0}°"),
            advice: "lower `elevation_mask_deg`, use every system, free the antennas' view".into(),
        })
    }

    /// Nothing is wrong, there is just too little of it.
    fn strength(&self, sample: &Sample, trials: &Trials, nothing_else: bool) -> Option<Finding> {
        let unsure: f64 = ["ratio", "weak_model", "success_rate"]
            .iter()
            .map(|word| trials.configured.share_of_reason(word))
            .sum();
        if !nothing_else || unsure < MANY {
            return None;
        }
        let used = trials::bands(sample, self.settings).len();
        let every = trials::bands(sample, &Settings { bands: None, ..self.settings.clone() }).len();
        let mut advice = Vec::new();
        if every > used {
            advice.push(format!("use all {every} bands that the files have (now {used})"));
        }
        if self.settings.constraint == Constraint::None {
            advice.push("give the antennas' positions: known geometry is worth a band".to_owned());
        }
        advice
            .push("set `ambiguity = \"continuous\"`, which gathers strength over time".to_owned());
        Some(Finding {
            code: "weak_model",
            cause: "the observations are too weak to be sure of the integers".into(),
            evidence: format!(
                "{:.0} % of the epochs have rivals that are almost as good",
                100.0 * unsure
            ),
            advice: advice.join("; "),
        })
    }
}

/// Phases that cannot be integers.
fn phases(signals: &[UsageRow]) -> Option<Finding> {
    let count = |word: &str| -> usize {
        signals.iter().map(|row| row.refused.get(word).copied().unwrap_or(0)).sum()
    };
    let observed: usize = signals.iter().map(|row| row.code).sum();
    let share = |word: &str| count(word) as f64 / observed.max(1) as f64;
    let (half, none) = (share("half cycle open"), share("no phase"));
    (half.max(none) > MANY).then(|| {
        let (what, advice) = if half > none {
            (
                "half cycles are not resolved",
                "wait until the receiver has decoded the data of each satellite",
            )
        } else {
            ("carrier phases are missing", "let the receiver log carrier phase (RINEX type L)")
        };
        Finding {
            code: if half > none { "half_cycles" } else { "no_phase" },
            cause: what.into(),
            evidence: format!("{:.0} % of the signals", 100.0 * half.max(none)),
            advice: advice.into(),
        }
    })
}

/// Damage in the files.
fn broken_files(damage: &[Damage]) -> Option<Finding> {
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

pub(super) fn words(system: System) -> &'static str {
    match system {
        System::Gps => "GPS",
        System::Galileo => "Galileo",
        System::BeiDou => "BeiDou",
        System::Glonass => "GLONASS",
        System::Qzss => "QZSS",
        System::NavIc => "NavIC",
        System::Sbas => "SBAS",
    }
}
