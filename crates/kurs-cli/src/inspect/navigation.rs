//! A navigation or orbit file: records by system, their times, ionosphere and time scales.

use std::collections::{BTreeMap, BTreeSet};

use kurs::ephemeris::{EphemerisStore, NavigationData};
use kurs::signal::{Satellite, System};
use kurs::time::GpsTime;
use kurs_formats::source::{ReadError, Source};
use serde::Serialize;

use super::DamageReport;

/// What is in a navigation file.
#[derive(Debug, Serialize)]
pub(super) struct NavigationReport {
    pub(super) file: String,
    pub(super) format: &'static str,
    pub(super) systems: Vec<SystemRecords>,
    /// Records read past on purpose, with their number.
    pub(super) read_past: BTreeMap<String, usize>,
    /// Broadcast ionosphere models.
    pub(super) ionosphere: Vec<&'static str>,
    /// Systems whose time is given against UTC.
    pub(super) utc: Vec<String>,
    /// GPST − UTC as the file says, s.
    pub(super) leap_seconds: Option<i32>,
    pub(super) oddities: Vec<String>,
    pub(super) damage: DamageReport,
}

/// The records of one system.
#[derive(Debug, Serialize)]
pub(super) struct SystemRecords {
    pub(super) system: String,
    /// Ephemerides, or nodes of precise orbits.
    pub(super) records: usize,
    pub(super) satellites: usize,
    /// First and last reference time, GPST.
    pub(super) first: String,
    pub(super) last: String,
    /// Ephemerides that say that the satellite must not be used; nodes without a clock.
    pub(super) unusable: usize,
}

#[derive(Debug, Default)]
struct Gathered {
    records: usize,
    unusable: usize,
    satellites: BTreeSet<Satellite>,
    span: Option<(GpsTime, GpsTime)>,
}

impl Gathered {
    fn add(&mut self, satellite: Satellite, time: GpsTime, usable: bool) {
        self.records += 1;
        self.unusable += usize::from(!usable);
        self.satellites.insert(satellite);
        self.span = Some(match self.span {
            Some((first, last)) => (first.min(time), last.max(time)),
            None => (time, time),
        });
    }
}

/// Reads the file.
pub(super) fn inspect(
    source: &mut Source,
    format: &'static str,
) -> Result<NavigationReport, ReadError> {
    let file = source.name().to_owned();
    let mut data = NavigationData::default();
    let summary = kurs_formats::navigation::read(source, &mut data)?;
    let models = [
        ("GPS (Klobuchar)", data.ionosphere.gps.is_some()),
        ("Galileo (NeQuick G)", data.ionosphere.galileo.is_some()),
        ("BeiDou (Klobuchar)", data.ionosphere.beidou.is_some()),
        ("QZSS (Klobuchar)", data.ionosphere.qzss.is_some()),
    ];
    let ionosphere = models.iter().filter(|(_, given)| *given).map(|(name, _)| *name);
    let utc: BTreeSet<System> = data.utc.iter().map(|parameters| parameters.system).collect();
    let damage = &summary.damage;
    Ok(NavigationReport {
        file,
        format,
        systems: systems(&data.ephemerides),
        read_past: summary.read_past,
        ionosphere: ionosphere.collect(),
        utc: utc.iter().map(ToString::to_string).collect(),
        leap_seconds: data.leap_seconds,
        oddities: oddities(&data),
        damage: DamageReport::new(damage.listed(), damage.total()),
    })
}

fn systems(store: &EphemerisStore) -> Vec<SystemRecords> {
    let mut systems: BTreeMap<System, Gathered> = BTreeMap::new();
    for record in store.iter() {
        let satellite = record.satellite();
        let gathered = systems.entry(satellite.system).or_default();
        gathered.add(satellite, record.reference_time(), record.is_usable());
    }
    for (satellite, nodes) in store.precise().iter() {
        let gathered = systems.entry(satellite.system).or_default();
        for node in nodes {
            gathered.add(satellite, node.time, node.clock_s.is_some());
        }
    }
    let report = |(system, gathered): (System, Gathered)| {
        let (first, last) = gathered.span?;
        Some(SystemRecords {
            system: system.to_string(),
            records: gathered.records,
            satellites: gathered.satellites.len(),
            first: first.to_string(),
            last: last.to_string(),
            unusable: gathered.unusable,
        })
    };
    systems.into_iter().filter_map(report).collect()
}

/// What a user should look at.
fn oddities(data: &NavigationData) -> Vec<String> {
    let mut oddities = Vec::new();
    if data.ephemerides.is_empty() {
        oddities.push("no ephemeris and no orbit that can be used".to_owned());
    }
    let times = data.ephemerides.iter().map(|record| record.reference_time());
    if let (Some(leap_seconds), Some(time)) = (data.leap_seconds, times.min()) {
        let known = time.leap_seconds();
        if leap_seconds != known {
            oddities.push(format!("{leap_seconds} leap seconds, there were {known} at that time"));
        }
    }
    oddities
}
