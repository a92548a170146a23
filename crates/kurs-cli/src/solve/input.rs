//! What `solve`, `survey` and `doctor` read: navigation data, and the observations of all antennas.

use std::path::PathBuf;

use anyhow::bail;
use kurs::ephemeris::{Ephemeris, NavigationData};
use kurs::time::GpsTime;
use kurs_formats::content::Content;
use kurs_formats::logs::LogOptions;
use kurs_formats::source::{Source, can_be_read_again};

use super::config::Loaded;
use super::phase_centers::{self, PhaseCenters};
use super::streams::{AntennaFiles, Streams};
use crate::failure::UsageError;
use crate::summary::Damage;

/// What a user can do where there is no ephemeris.
pub(crate) const SOURCES_OF_EPHEMERIDES: &str = "give --nav FILE, or let the receiver send RXM-SFRBX (UBX), \
    1019, 1042, 1045 or 1046, 1020 (RTCM 3), or GPSNav, GALNav, BDSNav, GLONav (SBF)";

/// Files opened, navigation data read.
pub(crate) struct Input {
    pub(crate) navigation: NavigationData,
    pub(crate) streams: Streams,
    /// Of the antennas whose type is given.
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

/// Navigation data of all files, the logs among the observation files too; what was damaged in them.
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
    for (index, path) in files.iter().enumerate() {
        let mut source = Source::open(path)?;
        let near = loaded.approximate_time();
        let summary = kurs_formats::navigation::read_near(&mut source, near, &mut navigation)?;
        // What is no message in an observation log is found again with the observations.
        let framing = if index < given_count { summary.framing.listed() } else { &[] };
        let entries = framing.iter().chain(summary.damage.listed());
        damage.extend(entries.map(|d| Damage::new(path.display().to_string(), d)));
    }
    if navigation.ephemerides.is_empty() && !received {
        bail!("no usable ephemeris in {}: {SOURCES_OF_EPHEMERIDES}", names(&files));
    }
    Ok((navigation, damage))
}

fn names(files: &[PathBuf]) -> String {
    files.iter().map(|file| file.display().to_string()).collect::<Vec<_>>().join(", ")
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
