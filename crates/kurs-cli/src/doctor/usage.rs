//! What was used of every satellite, band and antenna, and why the rest was not.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;

use kurs::engine::Settings;
use kurs::ephemeris::NavigationData;
use kurs::observation::{AntennaEpoch, Observation};
use kurs::point;
use kurs::signal::{Satellite, Signal};
use kurs::sky::{Horizon, View};
use kurs::solution::EpochSolution;
use serde::Serialize;

use super::sample::Sample;
use super::trials::Trial;

/// Counts of one signal at one antenna.
#[derive(Debug, Clone, Serialize)]
pub(super) struct UsageRow {
    pub(super) antenna: String,
    pub(super) satellite: String,
    pub(super) signal: String,
    /// Epochs in which it was observed.
    pub(super) observed: usize,
    /// Epochs in which its code took part.
    pub(super) code: usize,
    /// Epochs in which its phase took part.
    pub(super) phase: usize,
    /// Why it did not, where the reason is known.
    pub(super) refused: BTreeMap<&'static str, usize>,
}

type Key = (usize, Satellite, Signal);

/// Goes through the sample beside what the solution used.
pub(super) fn usage(
    sample: &Sample,
    configured: &Trial,
    navigation: &NavigationData,
    settings: &Settings,
    names: &[String],
) -> Vec<UsageRow> {
    let mut rows: BTreeMap<Key, UsageRow> = BTreeMap::new();
    for (epoch, solution) in sample.judged().zip(&configured.rows) {
        let used: BTreeMap<Key, (bool, bool)> = solution
            .signals
            .iter()
            .flat_map(|signals| &signals.residuals)
            .map(|r| {
                let key = (r.antenna, r.satellite, r.signal);
                (key, (r.code_m.is_some(), r.phase_m.is_some()))
            })
            .collect();
        for (antenna, observed) in epoch.antennas.iter().enumerate() {
            let Some(observed) = observed else { continue };
            let low = below_mask(observed, solution, navigation, settings);
            for o in &observed.observations {
                let key = (antenna, o.satellite, o.signal);
                let row = rows.entry(key).or_insert_with(|| UsageRow {
                    antenna: names[antenna].clone(),
                    satellite: o.satellite.to_string(),
                    signal: o.signal.to_string(),
                    observed: 0,
                    code: 0,
                    phase: 0,
                    refused: BTreeMap::new(),
                });
                row.observed += 1;
                let used = used.get(&key);
                let (code, phase) = used.copied().unwrap_or_default();
                row.code += usize::from(code);
                row.phase += usize::from(phase);
                let why = if !settings.wants(o.signal.band) {
                    Some("band not wanted")
                } else if used.is_some() {
                    without_phase(o)
                } else if low.contains(&o.satellite) {
                    Some("below the mask")
                } else if navigation.ephemerides.select(o.satellite, epoch.time).is_none() {
                    Some("no ephemeris")
                } else {
                    Some("no other antenna has it")
                };
                if let Some(why) = why {
                    *row.refused.entry(why).or_default() += 1;
                }
            }
        }
    }
    rows.into_values().collect()
}

/// Why only the code of a signal has a part.
fn without_phase(o: &Observation) -> Option<&'static str> {
    match (o.phase_cycles, o.lock.half_cycle_unresolved()) {
        (None, _) => Some("no phase"),
        (_, true) => Some("half cycle open"),
        _ => None,
    }
}

/// Satellites of one antenna below the elevation mask.
fn below_mask(
    observed: &AntennaEpoch,
    solution: &EpochSolution,
    navigation: &NavigationData,
    settings: &Settings,
) -> BTreeSet<Satellite> {
    let Some(position) = &solution.position else { return BTreeSet::new() };
    let horizon = Horizon::at(position.position_m);
    let lowest_rad = horizon.lowest_elevation_rad(settings.elevation_mask_rad);
    let mut tracked = Vec::new();
    point::track(observed, navigation, |system| settings.wants_system(system), &mut tracked);
    let elevation_rad = |t: &point::Tracked| {
        let view = View::new(&t.state, position.position_m);
        horizon.direction(view.line_of_sight).elevation_rad()
    };
    tracked.iter().filter(|t| elevation_rad(t) < lowest_rad).map(|t| t.satellite).collect()
}

/// Sums by antenna and signal for the terminal, or every satellite with `all`.
pub(super) fn text(rows: &[UsageRow], names: &[String], all: bool) -> String {
    let mut sums: BTreeMap<(usize, String), UsageRow> = BTreeMap::new();
    for row in rows {
        let place = names.iter().position(|name| *name == row.antenna).unwrap_or(0);
        let detail =
            if all { format!("{} {}", row.signal, row.satellite) } else { row.signal.clone() };
        let sum = sums.entry((place, detail)).or_insert_with(|| UsageRow {
            observed: 0,
            code: 0,
            phase: 0,
            refused: BTreeMap::new(),
            ..row.clone()
        });
        sum.observed += row.observed;
        sum.code += row.code;
        sum.phase += row.phase;
        for (why, count) in &row.refused {
            *sum.refused.entry(why).or_default() += count;
        }
    }
    let mut table = comfy_table::Table::new();
    table.load_preset(comfy_table::presets::NOTHING);
    table.set_header([
        "antenna",
        "signal",
        "observed",
        "code used",
        "phase used",
        "not used because",
    ]);
    for ((_, detail), sum) in &sums {
        let mut why = String::new();
        for (word, count) in &sum.refused {
            let comma = if why.is_empty() { "" } else { ", " };
            let _ = write!(why, "{comma}{word} {count}");
        }
        table.add_row([
            sum.antenna.clone(),
            detail.clone(),
            sum.observed.to_string(),
            sum.code.to_string(),
            sum.phase.to_string(),
            why,
        ]);
    }
    format!("\n{table}\n")
}
