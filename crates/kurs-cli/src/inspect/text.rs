//! The reports as text for the terminal.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use comfy_table::{CellAlignment, Table, presets};

use super::antennas::AntennaReport;
use super::messages::MessageReport;
use super::navigation::NavigationReport;
use super::observations::{ObservationReport, SignalReport, Strength};
use super::sky::SkyReport;
use super::timeline::TimeReport;
use super::{DamageReport, Report};

/// Lines of a list before it is cut short; the JSON has all of them.
const LINES_MAX: usize = 10;

/// All reports, one after the other.
pub(super) fn of(reports: &[Report]) -> String {
    let texts = reports.iter().filter_map(|report| match report {
        Report::Observations(report) => Some(observations(report)),
        Report::Navigation(report) => Some(navigation(report)),
        Report::Antennas(report) => Some(antennas(report)),
        Report::Unusable { .. } => None, // told on standard error
    });
    texts.collect::<Vec<_>>().join("\n")
}

fn observations(report: &ObservationReport) -> String {
    let part = report.part.as_ref().map_or(String::new(), |part| format!(", {part}"));
    let mut text = format!("{}{part}: {}\n", report.file, report.format);
    if let (None, Some(place)) = (&report.header, report.stated_position_ecef_m) {
        line(
            &mut text,
            "place",
            &format!("{:.4}, {:.4}, {:.4} m ECEF", place[0], place[1], place[2]),
        );
    }
    if let Some(header) = &report.header {
        let named = [
            ("marker", &header.marker),
            ("receiver", &header.receiver),
            ("antenna", &header.antenna),
        ];
        for (name, value) in named.into_iter().filter(|(_, value)| !value.is_empty()) {
            line(&mut text, name, value);
        }
    }
    time(&mut text, &report.time);
    let satellites: Vec<String> =
        report.satellites.iter().map(|(system, count)| format!("{count} {system}")).collect();
    line(&mut text, "satellites", &satellites.join(", "));
    let events = report.events.listed.iter().map(|event| {
        let time = event.time.as_deref().unwrap_or("no time");
        format!("{time}: {} (line {})", event.what, event.line)
    });
    list(&mut text, "events", events, report.events.count);
    text += &messages(&report.messages);
    text += &signals(&report.signals);
    text += &jumps(report);
    if let Some(sky) = &report.sky {
        text += &sky_text(sky);
    }
    closing(&mut text, &report.oddities, &report.damage);
    text
}

fn time(text: &mut String, time: &TimeReport) {
    let (Some(first), Some(last)) = (&time.first, &time.last) else {
        return line(text, "epochs", "none");
    };
    let interval = time.interval_s.map_or(String::new(), |s| format!(", every {s} s"));
    let week = if time.is_dated { "" } else { " of an unknown week" };
    line(text, "epochs", &format!("{}{interval}, {first} to {last} GPST{week}", time.epochs));
    let gaps = &time.gaps;
    if gaps.count > 0 {
        let told = format!(
            "{} ({} epochs missing, longest {} s)",
            gaps.count, gaps.missing_epochs, gaps.longest_s
        );
        line(text, "gaps", &told);
        let listed = gaps.listed.iter().map(|gap| format!("{} to {}", gap.from, gap.to));
        list(text, "", listed, gaps.count);
    }
}

/// The kinds of messages in a log.
fn messages(messages: &[MessageReport]) -> String {
    if messages.is_empty() {
        return String::new();
    }
    let rows = messages.iter().map(|m| {
        let rate = m.rate_hz.map_or(String::new(), |hz| format!("{hz:.2}"));
        vec![m.message.clone(), m.count.to_string(), rate, m.read.to_owned()]
    });
    table(&["message", "count", "a second", "read as"], rows)
}

fn signals(signals: &[SignalReport]) -> String {
    let rows = signals.iter().map(|s| {
        let strength = |pick: fn(&Strength) -> f64| {
            s.cn0_dbhz.as_ref().map_or(String::new(), |strength| format!("{:.1}", pick(strength)))
        };
        vec![
            s.signal.clone(),
            s.satellites.to_string(),
            s.pseudoranges.to_string(),
            s.phases.to_string(),
            s.dopplers.to_string(),
            strength(|cn0| cn0.least),
            strength(|cn0| cn0.mean),
            strength(|cn0| cn0.most),
            s.slips.to_string(),
            s.lock_lost.to_string(),
            s.half_cycles.to_string(),
        ]
    });
    let header = [
        "signal",
        "satellites",
        "code",
        "phase",
        "Doppler",
        "C/N0 min",
        "C/N0 mean",
        "C/N0 max",
        "slips",
        "lock lost",
        "half cycles",
    ];
    table(&header, rows)
}

/// Pairs of signals whose phases jump against each other.
fn jumps(report: &ObservationReport) -> String {
    if report.geometry_free.is_empty() {
        return String::new();
    }
    let rows = report.geometry_free.iter().map(|pair| {
        vec![
            pair.signals.join(" - "),
            pair.steps.to_string(),
            pair.jumps.to_string(),
            pair.unannounced.to_string(),
        ]
    });
    table(&["phases", "steps", "jumps", "not announced"], rows)
}

fn sky_text(sky: &SkyReport) -> String {
    let mut text = String::new();
    let place = format!(
        "{:.6} deg, {:.6} deg, {:.1} m (mean over {} looks at the sky)",
        sky.latitude_deg, sky.longitude_deg, sky.height_m, sky.looks
    );
    line(&mut text, "position", &place);
    if !sky.without_ephemeris.is_empty() {
        line(&mut text, "no ephemeris", &sky.without_ephemeris.join(", "));
    }
    let rows = sky.rings.iter().rev().map(|ring| {
        let share = 100.0 * ring.observed as f64 / ring.in_view.max(1) as f64;
        vec![
            format!("{:.0} - {:.0}", ring.from_deg, ring.to_deg),
            ring.in_view.to_string(),
            ring.observed.to_string(),
            if ring.in_view > 0 { format!("{share:.1}") } else { String::new() },
            ring.mean_cn0_dbhz.map_or(String::new(), |cn0| format!("{cn0:.1}")),
        ]
    });
    text += &table(&["elevation deg", "in view", "observed", "%", "C/N0 mean"], rows);
    text + &plot(sky)
}

/// The sky as a picture of characters: north is up, east is right, the horizon is the rim. A system
/// letter: observed there; `.`: in view and not observed.
fn plot(sky: &SkyReport) -> String {
    const ROWS: usize = 23;
    const COLUMNS: usize = 47;
    let mut canvas = vec![[b' '; COLUMNS]; ROWS];
    let cell = |azimuth_deg: f64, elevation_deg: f64| {
        let (sin, cos) = azimuth_deg.to_radians().sin_cos();
        let radius = (1.0 - elevation_deg / 90.0).clamp(0.0, 1.0);
        let index = |share: f64, count: usize| {
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // 0 to count − 1
            let index = (0.5 * (1.0 + share) * (count - 1) as f64).round() as usize;
            index
        };
        (index(-radius * cos, ROWS), index(radius * sin, COLUMNS))
    };
    for track in &sky.satellites {
        let letter = track.satellite.as_bytes().first().copied().unwrap_or(b'?');
        for point in &track.points {
            let (row, column) = cell(point.azimuth_deg, point.elevation_deg);
            let mark = &mut canvas[row][column];
            if point.observed {
                *mark = letter;
            } else if *mark == b' ' {
                *mark = b'.';
            }
        }
    }
    for (azimuth_deg, letter) in [(0.0, b'N'), (90.0, b'E'), (180.0, b'S'), (270.0, b'W')] {
        let (row, column) = cell(azimuth_deg, 0.0);
        canvas[row][column] = letter;
    }
    let rows = canvas.iter().map(|row| String::from_utf8_lossy(row).trim_end().to_owned());
    rows.fold(String::new(), |text, row| text + "  " + &row + "\n")
}

fn navigation(report: &NavigationReport) -> String {
    let mut text = format!("{}: {}\n", report.file, report.format);
    let pairs = |read: &BTreeMap<String, usize>| {
        read.iter().map(|(name, count)| format!("{count} {name}")).collect::<Vec<_>>().join(", ")
    };
    for (name, value) in [
        ("read past", pairs(&report.read_past)),
        ("ionosphere", report.ionosphere.join(", ")),
        ("UTC from", report.utc.join(", ")),
        ("leap seconds", report.leap_seconds.map_or(String::new(), |s| s.to_string())),
    ] {
        if !value.is_empty() {
            line(&mut text, name, &value);
        }
    }
    let rows = report.systems.iter().map(|system| {
        vec![
            system.system.clone(),
            system.satellites.to_string(),
            system.records.to_string(),
            system.unusable.to_string(),
            system.first.clone(),
            system.last.clone(),
        ]
    });
    let header = ["system", "satellites", "records", "unusable", "first GPST", "last GPST"];
    text += &table(&header, rows);
    closing(&mut text, &report.oddities, &report.damage);
    text
}

fn antennas(report: &AntennaReport) -> String {
    let mut text = format!("{}: ANTEX, {} antenna types\n", report.file, report.types.len());
    let shown = report.types.iter().take(LINES_MAX);
    let rows = shown.flat_map(|antenna| {
        antenna.bands.iter().enumerate().map(|(index, center)| {
            let name = if index == 0 { antenna.name.clone() } else { String::new() };
            let millimetres = center.offset_m.map(|m| format!("{:.2}", 1e3 * m));
            let [north, east, up] = millimetres;
            vec![name, center.band.clone(), north, east, up]
        })
    });
    text += &table(&["antenna", "band", "north mm", "east mm", "up mm"], rows);
    if let more @ 1.. = report.types.len().saturating_sub(LINES_MAX) {
        let _ = writeln!(text, "  … and {more} more");
    }
    closing(&mut text, &[], &report.damage);
    text
}

/// Oddities and damage.
fn closing(text: &mut String, oddities: &[String], damage: &DamageReport) {
    list(text, "oddities", oddities.iter().cloned(), oddities.len() as u64);
    let places =
        damage.listed.iter().map(|place| format!("{} {}: {}", damage.unit, place.at, place.what));
    list(text, "damage", places, damage.count);
}

fn line(text: &mut String, name: &str, value: &str) {
    let _ = writeln!(text, "  {name:<12} {value}");
}

/// The first of some entries under a name, and how many more there are.
fn list(text: &mut String, name: &str, entries: impl Iterator<Item = String>, count: u64) {
    for (index, entry) in entries.take(LINES_MAX).enumerate() {
        line(text, if index == 0 { name } else { "" }, &entry);
    }
    if let more @ 1.. = count.saturating_sub(LINES_MAX as u64) {
        line(text, "", &format!("… and {more} more"));
    }
}

/// A table whose first column is text and whose others are numbers.
fn table(header: &[&str], rows: impl Iterator<Item = Vec<String>>) -> String {
    let mut table = Table::new();
    table.load_preset(presets::UTF8_FULL_CONDENSED).set_header(header);
    table.add_rows(rows);
    for column in table.column_iter_mut().skip(1) {
        column.set_cell_alignment(CellAlignment::Right);
    }
    format!("{table}\n")
}
