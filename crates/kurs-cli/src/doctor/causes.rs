//! What spoils the fixes of observations that are there: a system, an antenna, reflections, too few
//! satellites, too little strength.

use std::collections::BTreeSet;

use kurs::engine::{Ambiguities, Constraint};
use kurs::signal::{Band, System};
use kurs::solution::{LeftOut, Reason, SignalResidual, Status};

use super::patient::{Finding, MANY, MENDED, Patient};
use super::reasons;
use super::sample::Sample;
use super::shape::PROVEN;
use super::trials::Trials;
use super::usage::UsageRow;

/// Ratio of residuals below which phases fit better.
const BETTER_FIT: f64 = 0.7;
/// Residuals this many times larger than the noise model says are reflections or worse.
const NOISY: f64 = 4.0;
/// Ratio of an antenna's residuals to those of the others from which on it is worse.
const WORSE_THAN_OTHERS: f64 = 2.5;
/// Share of an antenna's signals behind something above which none is left to spare.
const MANY_HIDDEN: f64 = 0.1;
/// Fewer satellites than this are few, even with the geometry known.
const FEW_SATELLITES: usize = 5;

/// Which residual of a signal.
type ResidualOf = fn(&SignalResidual) -> Option<f64>;

impl Patient<'_> {
    /// A constellation that spoils the others: left out by the engine already, or better left out.
    pub(super) fn system(&self, trials: &Trials) -> Option<Finding> {
        let systems = trials.without_system.iter().map(|(system, _)| *system);
        let most = systems
            .map(|system| (system, trials.configured.share_without(LeftOut::System(system))))
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
        // Where the geometry is wrong, fewer satellites are fixed wrongly more easily, some of the
        // time: then the phases fit no better than all of them do without geometry.
        let fits = share > PROVEN || residual_m < BETTER_FIT * trials.free.residual_m();
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
            cause: format!("the phases of {system} do not fit the others"),
            evidence,
            advice: format!(
                "leave its bands out of `bands`; mixed receivers may have biases for {system}"
            ),
        }
    }

    /// A band that the engine leaves out, or satellites at one antenna.
    pub(super) fn band_or_links(&self, trials: &Trials, sample: &Sample) -> Option<Finding> {
        let configured = &trials.configured;
        let bands = sample.shared_bands().into_iter();
        let shares = bands.map(|band| (band, configured.share_without(LeftOut::Band(band))));
        let most = shares.max_by(|a, b| a.1.total_cmp(&b.1));
        if let Some((band, share)) = most.filter(|(_, share)| *share > MENDED) {
            return Some(Finding {
                code: "bad_band",
                cause: format!("the phases of band {band} do not fit the others"),
                evidence: format!("{:.1} % of the epochs are fixed without it only", 100.0 * share),
                advice:
                    "leave it out of `bands`; look for interference, and at the firmware of the \
                         receivers"
                        .into(),
            });
        }
        let antennas = 0..self.names.len();
        let shares = antennas.map(|antenna| (antenna, configured.share_without_link(antenna)));
        let (antenna, share) = shares.max_by(|a, b| a.1.total_cmp(&b.1))?;
        (share > MENDED).then(|| Finding {
            code: "bad_view",
            cause: format!("something near antenna {} bends single signals", self.names[antenna]),
            evidence: format!(
                "{:.1} % of the epochs are fixed only without the phases of one satellite there",
                100.0 * share
            ),
            advice: "free its view of the sky: edges and metal near an antenna delay phases by \
                     centimetres"
                .into(),
        })
    }

    /// Something that stands before the sky of an antenna.
    pub(super) fn obstacles(&self) -> Option<Finding> {
        let shares =
            (0..self.names.len()).map(|antenna| (antenna, self.views.share_hidden(antenna)));
        let (antenna, share) = shares.max_by(|a, b| a.1.total_cmp(&b.1))?;
        let name = &self.names[antenna];
        let hidden = self.views.hidden(self.names);
        let first = hidden.iter().find(|row| row.antenna == *name)?;
        (share > MANY_HIDDEN).then(|| Finding {
            code: "obstacles",
            cause: format!("something stands before the sky of antenna {name}"),
            evidence: format!(
                "{:.0} % of its signals are too weak beside those of the others, most often {}",
                100.0 * share,
                first.sentence()
            ),
            advice: "free its view; `kurs solve --report` shows its sky".into(),
        })
    }

    /// An antenna that has observations and no part in the solution.
    pub(super) fn idle_antenna(&self, trials: &Trials) -> Option<Finding> {
        let ((antenna, reason), count) = trials.configured.most_idle()?;
        let of = trials.configured.rows.len();
        (count as f64 > MANY * of as f64).then(|| Finding {
            code: "idle_antenna",
            cause: format!("antenna {} has no part in the solution", self.names[antenna]),
            evidence: format!(
                "in {count} of {of} epochs: {} (`{reason}`)",
                reasons::meaning(reason.word())
            ),
            advice: reasons::advice(reason.word()).into(),
        })
    }

    /// An antenna that spoils the others.
    pub(super) fn antenna(&self, trials: &Trials) -> Option<Finding> {
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

    /// Residuals as reflections make them; `rms` takes them to the zenith. Those against a wrong
    /// shape tell nothing.
    pub(super) fn noise(&self, trials: &Trials, is_misshapen: bool) -> Option<Finding> {
        let configured = if is_misshapen { &[][..] } else { &trials.configured.rows };
        let rms = |of: ResidualOf, antenna: Option<usize>| {
            let rows = configured.iter().chain(&trials.free.rows);
            let residuals = rows.flat_map(|row| row.residuals());
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

    /// Too few satellites, in epochs that lack nothing else.
    pub(super) fn satellites(&self, trials: &Trials) -> Option<Finding> {
        let lacks_other = |reason: Option<Reason>| {
            matches!(
                reason,
                Some(
                    Reason::FewAntennas
                        | Reason::NoEphemeris
                        | Reason::TimeMismatch
                        | Reason::BadInput
                )
            )
        };
        let rows = trials.configured.rows.iter().filter(|row| !lacks_other(row.reason()));
        let mut shared: Vec<usize> = rows.map(|row| row.shared_satellites).collect();
        shared.sort_unstable();
        let median = *shared.get(shared.len() / 2)?;
        let mask_deg = self.settings.elevation_mask_rad.to_degrees();
        let too_few = trials.configured.share_of_reason("few_satellites");
        (median < FEW_SATELLITES || too_few > MANY).then(|| Finding {
            code: "few_satellites",
            cause: "few satellites are shared by the antennas".into(),
            evidence: format!(
                "{median} in the median epoch, above {mask_deg:.0}°; too few in {:.0} % of the epochs",
                100.0 * too_few
            ),
            advice: "lower `elevation_mask_deg`, use every system, free the antennas' view".into(),
        })
    }

    /// Nothing is wrong, there is just too little of it.
    pub(super) fn strength(&self, trials: &Trials) -> Option<Finding> {
        let unsure: f64 = ["ratio", "weak_model", "success_rate", "unproven"]
            .iter()
            .map(|word| trials.configured.share_of_reason(word))
            .sum();
        if unsure < MANY {
            return None;
        }
        let mut advice = Vec::new();
        if self.settings.constraint == Constraint::None {
            advice.push(match self.array {
                Some(_) => "leave `constraint` out: known geometry is worth a band",
                None => "give the antennas' positions: known geometry is worth a band",
            });
        }
        if self.settings.ambiguities == Ambiguities::Instantaneous {
            advice.push("set `ambiguity = \"continuous\"`, which gathers strength over time");
        }
        advice.push("use receivers with more bands and systems");
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

    /// Bands that two antennas have and that are not wanted.
    pub(super) fn unused_bands(&self, sample: &Sample) -> Option<Finding> {
        let (used, unused): (BTreeSet<Band>, BTreeSet<Band>) =
            sample.shared_bands().into_iter().partition(|band| self.settings.wants(*band));
        if unused.is_empty() {
            return None;
        }
        let listed = |bands: &BTreeSet<Band>| {
            bands.iter().map(Band::to_string).collect::<Vec<_>>().join(" ")
        };
        Some(Finding {
            code: "unused_bands",
            cause: format!("{} stand beside unused", listed(&unused)),
            evidence: format!("two antennas have them; `bands` wants {}", listed(&used)),
            advice: "leave `bands` out to use every shared band".into(),
        })
    }
}

/// Phases that cannot be integers.
pub(super) fn phases(signals: &[UsageRow]) -> Option<Finding> {
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
