//! An observation file, epoch by epoch.

use std::collections::BTreeMap;
use std::path::Path;

use kurs::ephemeris::NavigationData;
use kurs::observation::AntennaEpoch;
use kurs::signal::Signal;
use kurs_formats::content::Content;
use kurs_formats::damage::DamageLog;
use kurs_formats::logs::{Census, LogOptions, LogPart};
use kurs_formats::observations::ObservationSource;
use kurs_formats::rinex::observation::{Event, ObservationHeader};
use kurs_formats::source::ReadError;
use serde::Serialize;

use super::arcs::Jumps;
use super::gathered::{Gathered, SignalCount};
use super::messages::{MessageReport, messages};
use super::oddities::oddities;
use super::sky::{SkyReport, SkyWatch};
use super::timeline::TimeReport;
use super::{DamageReport, Known};
use crate::solve::input::SOURCES_OF_EPHEMERIDES;

/// What is in an observation file.
#[derive(Debug, Serialize)]
pub(super) struct ObservationReport {
    pub(super) file: String,
    /// The station or antenna of a log that has several.
    pub(super) part: Option<String>,
    pub(super) format: String,
    /// Approximate position of the header; place of the station of an RTCM 3 log.
    pub(super) stated_position_ecef_m: Option<[f64; 3]>,
    /// `None` for a log.
    pub(super) header: Option<HeaderReport>,
    pub(super) time: TimeReport,
    /// Messages of a log, listed with its first station or antenna.
    pub(super) messages: Vec<MessageReport>,
    /// Number of satellites of each system.
    pub(super) satellites: BTreeMap<String, usize>,
    pub(super) signals: Vec<SignalReport>,
    pub(super) geometry_free: Vec<JumpReport>,
    pub(super) events: EventReport,
    pub(super) sky: Option<SkyReport>,
    pub(super) oddities: Vec<String>,
    pub(super) damage: DamageReport,
}

/// The header, as far as it is of use to a human.
#[derive(Debug, Serialize)]
pub(super) struct HeaderReport {
    pub(super) marker: String,
    pub(super) receiver: String,
    pub(super) antenna: String,
    pub(super) interval_s: Option<f64>,
}

/// One signal over all satellites.
#[derive(Debug, Serialize)]
pub(super) struct SignalReport {
    pub(super) signal: String,
    pub(super) satellites: usize,
    pub(super) pseudoranges: u64,
    pub(super) phases: u64,
    pub(super) dopplers: u64,
    pub(super) cn0_dbhz: Option<Strength>,
    /// Phases with loss-of-lock bit 0, the first one of an arc included.
    pub(super) lock_lost: u64,
    /// Those of them that continue an arc of phases: cycle slips that the receiver tells of.
    pub(super) slips: u64,
    /// Phases that may be off by half a cycle.
    pub(super) half_cycles: u64,
}

/// Carrier-to-noise density ratio, dB-Hz.
#[derive(Debug, Serialize)]
pub(super) struct Strength {
    pub(super) least: f64,
    pub(super) mean: f64,
    pub(super) most: f64,
}

/// Jumps of the difference of two phases of one satellite.
#[derive(Debug, Serialize)]
pub(super) struct JumpReport {
    pub(super) signals: [String; 2],
    pub(super) steps: u64,
    pub(super) jumps: u64,
    pub(super) unannounced: u64,
}

/// What happened between the observations.
#[derive(Debug, Default, Serialize)]
pub(super) struct EventReport {
    pub(super) count: u64,
    pub(super) listed: Vec<EventLine>,
}

/// One event.
#[derive(Debug, Serialize)]
pub(super) struct EventLine {
    pub(super) line: u64,
    pub(super) time: Option<String>,
    pub(super) what: String,
}

/// Reads the file, of a log of several stations or antennas the one that is named.
pub(super) fn inspect(
    file: &Path,
    content: &Content,
    part: Option<LogPart>,
    census: Option<&Census>,
    Known { navigation, options, window, log_damage }: &Known,
) -> Result<ObservationReport, ReadError> {
    let chosen = part.map(LogPart::options).unwrap_or_default();
    let options = LogOptions {
        protocol: chosen.protocol,
        station: chosen.station,
        antenna: chosen.antenna,
        ..*options
    };
    let mut source = ObservationSource::open_with(file, &options)?;
    let mut gathered = Gathered::default();
    let mut sky = SkyWatch::new(navigation);
    let mut epoch = AntennaEpoch::default();
    while source.next_epoch(&mut epoch)? {
        if !window.contains(epoch.time) {
            continue;
        }
        gathered.add(&epoch, |satellite| {
            let told = || source.glonass_channels().get(&satellite.number).copied();
            navigation.ephemerides.glonass_channel(satellite).or_else(told)
        });
        sky.add(&epoch);
    }
    let stated_m = source.stated_position_m();
    let sky = sky.report(stated_m);
    let header = source.header();
    let damage = damage_report(&source, census.and_then(|_| log_damage.get(file)));
    Ok(ObservationReport {
        file: source.name().to_owned(),
        part: part.map(|part| part.to_string()),
        format: format_of(content, &source),
        stated_position_ecef_m: stated_m.map(|position_m| position_m.xyz().into()),
        header: header.map(HeaderReport::new),
        time: gathered.timeline.report(source.is_dated()),
        messages: census
            .map_or_else(Vec::new, |census| messages(census, gathered.timeline.duration_s())),
        satellites: gathered.satellites_by_system(),
        signals: signal_reports(&gathered),
        geometry_free: jump_reports(&gathered),
        events: events(&source),
        oddities: all_oddities(&source, &gathered, sky.as_ref(), navigation),
        sky,
        damage,
    })
}

/// What is odd about the observations, and what is missing beside them.
fn all_oddities(
    source: &ObservationSource,
    gathered: &Gathered,
    sky: Option<&SkyReport>,
    navigation: &NavigationData,
) -> Vec<String> {
    let header = source.header();
    let mut oddities = oddities(header, gathered, sky);
    if sky.is_none() && !navigation.ephemerides.is_empty() {
        oddities.push("no sky: the navigation data are of other satellites or times".into());
    } else if header.is_none() && navigation.ephemerides.is_empty() {
        oddities
            .push(format!("no ephemerides in the log: for an attitude {SOURCES_OF_EPHEMERIDES}"));
    }
    if !source.is_dated() {
        oddities.push("the week is not known: give --date or --nav".into());
    }
    oddities
}

/// The damage of a file, with that of the ephemerides in it.
fn damage_report(source: &ObservationSource, of_ephemerides: Option<&DamageLog>) -> DamageReport {
    let (mut damage, mut count) = (source.damage().to_vec(), source.damage_count());
    if let Some(of_ephemerides) = of_ephemerides {
        damage.extend_from_slice(of_ephemerides.listed());
        damage.sort_by_key(|damage| damage.line);
        count += of_ephemerides.total();
    }
    let unit = if source.header().is_none() { "byte" } else { "line" };
    DamageReport { unit, ..DamageReport::new(&damage, count) }
}

fn format_of(content: &Content, source: &ObservationSource) -> String {
    let version = source.header().map(|header| header.version).unwrap_or_default();
    match (content, source) {
        (_, ObservationSource::Log(log)) => log.protocol().to_string(),
        (Content::CompactRinex, _) => format!("RINEX {version} observations, compact"),
        _ => format!("RINEX {version} observations"),
    }
}

fn events(source: &ObservationSource) -> EventReport {
    let Some(log) = source.events() else { return EventReport::default() };
    let line = |event: &Event| EventLine {
        line: event.line,
        time: event.time.map(|time| time.to_string()),
        what: event.kind.to_string(),
    };
    EventReport { count: log.total(), listed: log.listed().iter().map(line).collect() }
}

impl HeaderReport {
    fn new(header: &ObservationHeader) -> Self {
        let joined = |parts: [&str; 2]| parts.join(" ").trim().to_owned();
        Self {
            marker: joined([&header.marker_name, &header.marker_number]),
            receiver: joined([&header.receiver_type, &header.receiver_version]),
            antenna: header.antenna_type.clone(),
            interval_s: header.interval_s,
        }
    }
}

fn signal_reports(gathered: &Gathered) -> Vec<SignalReport> {
    let report = |(signal, count): (&Signal, &SignalCount)| SignalReport {
        signal: signal.to_string(),
        satellites: count.satellites,
        pseudoranges: count.pseudoranges,
        phases: count.phases,
        dopplers: count.dopplers,
        cn0_dbhz: count.strength_range.map(|(least, most)| Strength {
            least,
            mean: count.strength_sum / count.strengths as f64,
            most,
        }),
        lock_lost: count.lock_lost,
        slips: count.slips,
        half_cycles: count.half_cycles,
    };
    gathered.signals.iter().map(report).collect()
}

fn jump_reports(gathered: &Gathered) -> Vec<JumpReport> {
    let report = |((a, b), jumps): (&(Signal, Signal), &Jumps)| JumpReport {
        signals: [a.to_string(), b.to_string()],
        steps: jumps.steps,
        jumps: jumps.jumps,
        unannounced: jumps.unannounced,
    };
    gathered.arcs.jumps.iter().map(report).collect()
}
