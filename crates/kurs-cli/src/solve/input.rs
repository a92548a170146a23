//! What `solve`, `survey` and `doctor` read: navigation data, and the observations of all antennas.

use std::collections::BTreeMap;

use anyhow::bail;
use kurs::differential::StationUse;
use kurs::ephemeris::{Ephemeris, NavigationData};
use kurs::observation::ArrayEpoch;
use kurs::time::GpsTime;
use kurs_formats::content::Content;
use kurs_formats::logs::LogOptions;
use kurs_formats::source::{Source, can_be_read_again};

use super::config::{AntennaTable, Loaded};
use super::damaged;
use super::phase_centers::{self, PhaseCenters};
use super::streams::{AntennaFiles, Streams};
use crate::failure::UsageError;
use crate::pipe::named;
use crate::session_span::SessionSpan;
use crate::summary::Damage;
use crate::window::Window;

/// What a user can do where there is no ephemeris.
pub(crate) const SOURCES_OF_EPHEMERIDES: &str = "give --nav FILE, or let the receiver send RXM-SFRBX (UBX), \
    1019, 1042, 1045 or 1046, 1020 (RTCM 3), or GPSNav, GALNav, BDSNav, GLONav (SBF)";

/// Files opened, navigation data read.
pub(crate) struct Input {
    pub(crate) navigation: NavigationData,
    pub(crate) streams: Streams,
    /// Phase centres of the antennas whose type is given.
    pub(crate) phase_centers: PhaseCenters,
    /// What was damaged in the navigation and ANTEX files.
    pub(crate) damage: Vec<Damage>,
}

impl Input {
    /// Opens everything that the configuration names.
    pub(crate) fn open(loaded: &Loaded) -> anyhow::Result<Self> {
        let (mut navigation, mut damage) = read_navigation(loaded)?;
        let phase_centers = phase_centers::read(loaded, &mut damage)?;
        let streams = streams(loaded, &navigation)?;
        if streams.antennas_with_epochs() == 0 {
            bail!("{}", no_epoch(loaded, &streams));
        }
        // As received, the channels of logs come with their epochs.
        for (number, channel) in streams.glonass_channels() {
            navigation.ephemerides.insert_glonass_channel(number, channel);
        }
        Ok(Self { navigation, streams, phase_centers, damage })
    }
}

/// The observations of all antennas and of the station, from their begin.
pub(super) fn streams(loaded: &Loaded, navigation: &NavigationData) -> anyhow::Result<Streams> {
    let options = LogOptions {
        approximate_time: loaded.approximate_time(),
        navigation_time: middle_time(navigation),
        as_received: loaded.config.nav.as_received,
        ..LogOptions::default()
    };
    let antennas = observation_files(loaded, &options);
    Streams::open(antennas, station_files(loaded, &options), loaded.window)
}

/// Why there is nothing to solve.
fn no_epoch(loaded: &Loaded, streams: &Streams) -> String {
    match whole_session(loaded).filter(|whole| whole.antennas_with_epochs() > 0) {
        Some(whole) => {
            let options = loaded.window.options();
            format!("{options} leaves no epoch of the observation files: {}", whole.spans())
        }
        None => {
            let damage = damage_by_antenna(loaded, streams);
            format!("no epoch in any observation file ({}){damage}", streams.spans())
        }
    }
}

/// Why one antenna is alone.
pub(crate) fn one_antenna(loaded: &Loaded, streams: &Streams) -> String {
    let whole = whole_session(loaded).map_or_else(String::new, |whole| {
        format!("; without {}: {}", loaded.window.options(), whole.spans())
    });
    let damage = damage_by_antenna(loaded, streams);
    format!("only one antenna has observations: {}{whole}{damage}", streams.spans())
}

/// All files read to their ends, also outside the window; `None` where they have been read so
/// already, or cannot be read again.
fn whole_session(loaded: &Loaded) -> Option<Streams> {
    if loaded.window.is_everything() || !loaded.input_files().iter().all(can_be_read_again) {
        return None;
    }
    let mut loaded = loaded.clone();
    loaded.window = Window::default();
    let (navigation, _) = read_navigation(&loaded).ok()?;
    let mut streams = streams(&loaded, &navigation).ok()?;
    let mut epoch = ArrayEpoch::default();
    while streams.next(&mut epoch).ok()? {}
    Some(streams)
}

/// How much of each antenna's files could not be read and where first, a line each.
fn damage_by_antenna(loaded: &Loaded, streams: &Streams) -> String {
    let damage: Vec<Damage> =
        streams.damage().into_iter().map(|d| Damage::new(d.file, &d.damage)).collect();
    let of_antenna = |antenna: &AntennaTable| {
        let files: Vec<String> = antenna.obs.iter().map(|path| named(&loaded.path(path))).collect();
        let own: Vec<&Damage> = damage.iter().filter(|d| files.contains(&d.file)).collect();
        let first = own.first()?;
        Some(format!("\n{}: {} damaged places, first: {first}", antenna.name, own.len()))
    };
    loaded.config.antenna.iter().filter_map(of_antenna).collect()
}

/// Epochs whose dates cannot be right; `spans`: the times of each antenna's epochs.
pub(crate) fn misdated<'a>(
    loaded: &Loaded,
    spans: impl IntoIterator<Item = &'a SessionSpan>,
) -> Vec<Damage> {
    let of_antenna = |(antenna, span): (&AntennaTable, &SessionSpan)| {
        let files: Vec<String> = antenna.obs.iter().map(|path| named(&loaded.path(path))).collect();
        Some(Damage::at(files.join(", "), 1, span.misdated()?))
    };
    loaded.config.antenna.iter().zip(spans).filter_map(of_antenna).collect()
}

/// What is wrong with the place of the station, as far as the coordinates relative to it show.
pub(crate) fn station_trouble(loaded: &Loaded, station: StationUse) -> Option<Damage> {
    let StationUse { epochs, used, apart, offset_m } = station;
    let what = if apart > 0 {
        format!(
            "station.position_ecef_m: coordinates relative to it are {offset_m:.0} m from where the antennas' own code \
             puts them, in {apart} of {epochs} epochs, which keep their own"
        )
    } else if used == 0 && epochs > 0 {
        format!(
            "station: none of its {epochs} epochs gave coordinates; is position_ecef_m where it stands, \
             and does it see the antennas' satellites?"
        )
    } else {
        return None;
    };
    let files = loaded.config.station.iter().flat_map(|station| &station.obs);
    let files: Vec<String> = files.map(|path| named(&loaded.path(path))).collect();
    Some(Damage::at(files.join(", "), 1, what))
}

/// Navigation data of all files, logs of observations included, and the damage in them.
fn read_navigation(loaded: &Loaded) -> anyhow::Result<(NavigationData, Vec<Damage>)> {
    let mut navigation = NavigationData::default();
    let mut damage = Vec::new();
    let given = loaded.config.nav.files.iter().map(|file| loaded.path(file));
    let (mut files, given_count) = (given.collect::<Vec<_>>(), loaded.config.nav.files.len());
    let mut received = false;
    for file in loaded.config.antenna.iter().flat_map(|antenna| &antenna.obs) {
        let path = loaded.path(file);
        // What is read here is gone from a pipe.
        if !files.contains(&path) && can_be_read_again(&path) && Content::of_file(&path)?.is_log() {
            received |= loaded.config.nav.as_received;
            if !loaded.config.nav.as_received {
                files.push(path);
            }
        }
    }
    if files.is_empty() && !received {
        let expected = "no navigation file: give `[nav] files` or --nav FILE";
        return Err(UsageError(expected.into()).into());
    }
    let mut read_past: BTreeMap<String, usize> = BTreeMap::new();
    for (index, path) in files.iter().enumerate() {
        let mut source = Source::open(path)?;
        let near = loaded.approximate_time();
        let summary = kurs_formats::navigation::read_near(&mut source, near, &mut navigation)?;
        // Damage in an observation log is found again with the observations.
        let framing = if index < given_count { summary.framing.listed() } else { &[] };
        let entries = framing.iter().chain(summary.damage.listed());
        damage.extend(entries.map(|d| Damage::new(path.display().to_string(), d)));
        for (kind, count) in summary.read_past {
            *read_past.entry(kind).or_default() += count;
        }
    }
    if navigation.ephemerides.is_empty() && !received {
        let files: Vec<String> = files.iter().map(|file| named(file)).collect();
        bail!(
            "no usable ephemeris in {}: {SOURCES_OF_EPHEMERIDES}{}{}",
            files.join(", "),
            passed(&read_past),
            damaged(&damage)
        );
    }
    Ok((navigation, damage))
}

/// The kinds of records of which no ephemeris is made, as a line of its own; nothing without any.
fn passed(read_past: &BTreeMap<String, usize>) -> String {
    let kinds: Vec<String> =
        read_past.iter().map(|(kind, count)| format!("{kind} {count}")).collect();
    if kinds.is_empty() {
        return String::new();
    }
    format!("\nrecords of kinds that are not used: {}", kinds.join(", "))
}

/// The middle of the times of all ephemerides: one that is stale does not move it.
pub(crate) fn middle_time(navigation: &NavigationData) -> Option<GpsTime> {
    let store = &navigation.ephemerides;
    let nodes = store.precise().iter().flat_map(|(_, nodes)| nodes.iter().map(|node| node.time));
    let mut times: Vec<GpsTime> =
        store.iter().map(Ephemeris::reference_time).chain(nodes).collect();
    times.sort_unstable();
    times.get(times.len() / 2).copied()
}

fn observation_files(loaded: &Loaded, options: &LogOptions) -> Vec<AntennaFiles> {
    let antennas = loaded.config.antenna.iter();
    antennas
        .map(|a| AntennaFiles {
            name: a.name.clone(),
            files: a.obs.iter().map(|path| loaded.path(path)).collect(),
            options: LogOptions {
                protocol: a.protocol,
                station: a.station_id,
                antenna: a.antenna_id,
                ..*options
            },
        })
        .collect()
}

fn station_files(loaded: &Loaded, options: &LogOptions) -> Option<AntennaFiles> {
    let station = loaded.config.station.as_ref()?;
    Some(AntennaFiles {
        name: "station".into(),
        files: station.obs.iter().map(|path| loaded.path(path)).collect(),
        options: LogOptions {
            protocol: station.protocol,
            station: station.station_id,
            antenna: station.antenna_id,
            ..*options
        },
    })
}

pub(crate) fn antenna_names(loaded: &Loaded) -> Vec<String> {
    loaded.config.antenna.iter().map(|a| a.name.clone()).collect()
}
