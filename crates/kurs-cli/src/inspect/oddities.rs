//! What a header says against its observations, or leaves unsaid.

use std::collections::BTreeSet;

use kurs::signal::{Signal, System};
use kurs_formats::rinex::observation::ObservationHeader;

use super::gathered::Gathered;
use super::sky::SkyReport;

/// Distance of the position in the file from that of the code observations that is odd, m.
const FAR_M: f64 = 200.0;

/// Each oddity in one sentence.
pub(super) fn oddities(
    header: Option<&ObservationHeader>,
    gathered: &Gathered,
    sky: Option<&SkyReport>,
) -> Vec<String> {
    let mut oddities = Vec::new();
    if gathered.timeline.span().is_none() {
        oddities.push("the file has no epoch".into());
    }
    if let Some(header) = header {
        times(header, gathered, &mut oddities);
        signals(header, gathered, &mut oddities);
        if header.approximate_position_m.is_none() {
            oddities.push("the header has no approximate position".into());
        }
    }
    if let Some(off_m) = sky.and_then(|sky| sky.stated_off_m).filter(|off_m| *off_m > FAR_M) {
        oddities.push(format!(
            "the position in the file is {off_m:.0} m from that of the observations"
        ));
    }
    if !gathered.without_channel.is_empty() {
        let names: Vec<String> = gathered.without_channel.iter().map(ToString::to_string).collect();
        oddities.push(format!(
            "the frequency of {} is not in the header (give navigation data)",
            names.join(" ")
        ));
    }
    if gathered.clock_offsets > 0 {
        oddities.push(format!(
            "{} epochs state a receiver clock offset that is not applied to the observations",
            gathered.clock_offsets
        ));
    }
    oddities
}

/// Interval, first and last epoch, leap seconds.
fn times(header: &ObservationHeader, gathered: &Gathered, oddities: &mut Vec<String>) {
    let Some((first, last)) = gathered.timeline.span() else { return };
    if let (Some(stated_s), Some(found_s)) = (header.interval_s, gathered.timeline.interval_s())
        && (stated_s - found_s).abs() > 0.0015
    {
        oddities.push(format!("the header says an interval of {stated_s} s, it is {found_s} s"));
    }
    for (what, stated, found) in
        [("first", header.first_epoch, first), ("last", header.last_epoch, last)]
    {
        if let Some(stated) = stated.filter(|stated| (*stated - found).abs() > 0.0015) {
            oddities.push(format!("the header says {stated} for the {what} epoch, it is {found}"));
        }
    }
    if let Some(stated) = header.leap_seconds.filter(|stated| *stated != first.leap_seconds()) {
        let known = first.leap_seconds();
        oddities.push(format!("the header says {stated} leap seconds, there were {known}"));
    }
}

/// Declared and never observed signals, scale factors, units.
fn signals(header: &ObservationHeader, gathered: &Gathered, oddities: &mut Vec<String>) {
    let observed: BTreeSet<Signal> = gathered.observed().collect();
    let seen: BTreeSet<System> = gathered.satellites.keys().map(|s| s.system).collect();
    if header.version.major >= 3 {
        let mut unused = Vec::new();
        for (system, codes) in &header.observation_types {
            if !seen.contains(system) {
                unused.push(format!("all of {system}"));
                continue;
            }
            let names: BTreeSet<String> = codes
                .iter()
                .map(ToString::to_string)
                .filter_map(|code| Some(format!("{}{}", system.letter(), code.get(1..)?)))
                .filter(|name| {
                    name.parse::<Signal>().is_ok_and(|signal| !observed.contains(&signal))
                })
                .collect();
            unused.extend(names);
        }
        if !unused.is_empty() {
            oddities.push(format!("declared and never observed: {}", unused.join(", ")));
        }
    }
    for scale in header.scale_factors.iter().filter(|scale| scale.factor != 1.0) {
        oddities.push(format!(
            "{} observations are multiplied by {} in the file (divided out)",
            scale.system, scale.factor
        ));
    }
    let shifted = header
        .phase_shifts
        .iter()
        .filter(|shift| shift.correction_cycles.is_some_and(|cycles| cycles != 0.0));
    let shifted: Vec<String> = shifted.map(|shift| shift.signal.to_string()).collect();
    if !shifted.is_empty() {
        oddities.push(format!("phases aligned by the writer: {}", shifted.join(", ")));
    }
    let unit = header.signal_strength_unit.as_str();
    if !matches!(unit, "" | "DBHZ" | "DB-HZ" | "dBHz" | "dbHz" | "dB-Hz") {
        oddities.push(format!("signal strengths are in {unit:?}, not in dB-Hz"));
    }
}
