//! The sky over the antenna: which satellites stood where, which of them were observed, and how
//! strong their signals were.

use std::collections::{BTreeMap, BTreeSet};

use kurs::ephemeris::NavigationData;
use kurs::frames::{Ecef, Geodetic, Vector};
use kurs::observation::AntennaEpoch;
use kurs::point::{self, PointSettings};
use kurs::signal::{Satellite, System};
use kurs::sky::{Horizon, NoiseModel, View};
use kurs::time::GpsTime;
use serde::Serialize;

/// Least time between two looks at the sky, s.
const STEP_S: f64 = 60.0;
/// Width of a ring of the sky.
const RING_DEG: f64 = 15.0;
const RINGS: usize = 6;
/// Travel time of a signal from a satellite.
const TRAVEL_S: f64 = 0.075;
/// Noise for the position; only its weights count here.
const NOISE: NoiseModel = NoiseModel {
    code_zenith_m: 0.3,
    phase_zenith_m: 0.003,
    full_cn0_dbhz: 45.0,
    channel_sd_m: 0.0,
};

/// Where satellites were, seen from the antenna.
#[derive(Debug, Serialize)]
pub(super) struct SkyReport {
    /// Antenna: mean of the positions by code, else that in the file.
    pub(super) latitude_deg: f64,
    pub(super) longitude_deg: f64,
    pub(super) height_m: f64,
    /// Distance of the position in the file from the first one by code, m.
    pub(super) stated_off_m: Option<f64>,
    /// Looks at the sky, at least a minute apart.
    pub(super) looks: usize,
    pub(super) rings: Vec<Ring>,
    pub(super) satellites: Vec<Track>,
    /// Systems that were observed and of which there is no ephemeris.
    pub(super) without_ephemeris: Vec<String>,
}

/// A ring of the sky between two elevations.
#[derive(Debug, Clone, Default, Serialize)]
pub(super) struct Ring {
    pub(super) from_deg: f64,
    pub(super) to_deg: f64,
    /// Satellites that stood there, over all looks, of the systems that were observed.
    pub(super) in_view: u64,
    /// Those of them that were observed.
    pub(super) observed: u64,
    /// Mean strength of the observed ones' strongest signals.
    pub(super) mean_cn0_dbhz: Option<f64>,
    #[serde(skip)]
    cn0_sum: f64,
    #[serde(skip)]
    cn0_count: u64,
}

/// One satellite's way over the sky.
#[derive(Debug, Serialize)]
pub(super) struct Track {
    pub(super) satellite: String,
    pub(super) points: Vec<Point>,
}

/// A place on the way.
#[derive(Debug, Serialize)]
pub(super) struct Point {
    pub(super) time_gpst: String,
    pub(super) azimuth_deg: f64,
    pub(super) elevation_deg: f64,
    pub(super) observed: bool,
    pub(super) cn0_dbhz: Option<f64>,
}

/// Looks at the sky now and then.
#[derive(Debug)]
pub(super) struct SkyWatch<'a> {
    navigation: &'a NavigationData,
    looks: Vec<Look>,
    positions_m: Vec<Vector<Ecef>>,
}

/// What was observed at one time.
#[derive(Debug)]
struct Look {
    time: GpsTime,
    /// The antenna then, by code.
    position_m: Option<Vector<Ecef>>,
    /// Observed satellites, each with its strongest signal.
    observed: BTreeMap<Satellite, Option<f64>>,
}

impl<'a> SkyWatch<'a> {
    pub(super) const fn new(navigation: &'a NavigationData) -> Self {
        Self { navigation, looks: Vec::new(), positions_m: Vec::new() }
    }

    /// Takes in an epoch, if the last look was long enough ago.
    pub(super) fn add(&mut self, epoch: &AntennaEpoch) {
        let recent = self.looks.last().is_some_and(|look| epoch.time - look.time < STEP_S);
        if recent || self.navigation.ephemerides.is_empty() {
            return;
        }
        let mut observed = BTreeMap::new();
        for o in &epoch.observations {
            let strongest: &mut Option<f64> = observed.entry(o.satellite).or_default();
            if let Some(cn0) = o.cn0_dbhz {
                *strongest = Some(strongest.map_or(cn0, |known| known.max(cn0)));
            }
        }
        let position_m = self.position_m(epoch);
        self.positions_m.extend(position_m);
        self.looks.push(Look { time: epoch.time, position_m, observed });
    }

    fn position_m(&self, epoch: &AntennaEpoch) -> Option<Vector<Ecef>> {
        let settings = PointSettings { elevation_mask_rad: 10f64.to_radians(), noise: NOISE };
        let mut tracked = Vec::new();
        point::track(epoch, self.navigation, |_| true, &mut tracked);
        let solution = point::solve(&tracked, self.navigation, epoch.time, &settings).ok()?;
        Some(solution.position_m)
    }

    /// The sky, if there is a position (that of the file where there is none by code), and any
    /// ephemeris of the observed systems at these times.
    pub(super) fn report(self, stated_m: Option<Vector<Ecef>>) -> Option<SkyReport> {
        let by_code_m = mean(&self.positions_m);
        let antenna_m = by_code_m.or(stated_m)?;
        let observed: BTreeSet<Satellite> =
            self.looks.iter().flat_map(|look| look.observed.keys().copied()).collect();
        let systems: BTreeSet<System> = observed.iter().map(|s| s.system).collect();
        let known = self.known_satellites(&systems);
        let mut rings: Vec<Ring> = (0..RINGS).map(Ring::number).collect();
        let mut tracks: BTreeMap<Satellite, Vec<Point>> = BTreeMap::new();
        for look in &self.looks {
            let horizon = Horizon::at(look.position_m.unwrap_or(antenna_m));
            for &satellite in &known {
                if let Some(point) = self.point(look, satellite, &horizon) {
                    rings[ring_of(point.elevation_deg)].add(&point);
                    tracks.entry(satellite).or_default().push(point);
                }
            }
        }
        if tracks.is_empty() {
            return None;
        }
        let covered: BTreeSet<System> = tracks.keys().map(|satellite| satellite.system).collect();
        let geodetic = Geodetic::from_ecef(antenna_m);
        Some(SkyReport {
            latitude_deg: geodetic.latitude_rad.to_degrees(),
            longitude_deg: geodetic.longitude_rad.to_degrees(),
            height_m: geodetic.height_m,
            stated_off_m: self.positions_m.first().zip(stated_m).map(|(a, b)| (*a - b).norm()),
            looks: self.looks.len(),
            rings: rings.into_iter().map(Ring::with_mean).collect(),
            satellites: tracks
                .into_iter()
                .map(|(satellite, points)| Track { satellite: satellite.to_string(), points })
                .collect(),
            without_ephemeris: systems.difference(&covered).map(ToString::to_string).collect(),
        })
    }

    /// Satellites of these systems with an ephemeris.
    fn known_satellites(&self, systems: &BTreeSet<System>) -> BTreeSet<Satellite> {
        let store = &self.navigation.ephemerides;
        let precise = store.precise().iter().map(|(satellite, _)| satellite);
        let broadcast = store.iter().map(|record| record.satellite());
        precise.chain(broadcast).filter(|s| systems.contains(&s.system)).collect()
    }

    /// Where the satellite stands in this look; `None` below the horizon and without ephemeris.
    fn point(&self, look: &Look, satellite: Satellite, horizon: &Horizon) -> Option<Point> {
        let state = self.navigation.ephemerides.state(satellite, look.time + -TRAVEL_S).ok()?;
        let view = View::new(&state, horizon.geodetic.to_ecef());
        let direction = horizon.direction(view.line_of_sight);
        if direction.sin_elevation() < 0.0 {
            return None;
        }
        let observed = look.observed.get(&satellite);
        Some(Point {
            time_gpst: look.time.to_string(),
            azimuth_deg: direction.azimuth_rad().to_degrees().rem_euclid(360.0),
            elevation_deg: direction.elevation_rad().to_degrees(),
            observed: observed.is_some(),
            cn0_dbhz: observed.copied().flatten(),
        })
    }
}

impl Ring {
    fn number(index: usize) -> Self {
        let from_deg = RING_DEG * index as f64;
        Self { from_deg, to_deg: from_deg + RING_DEG, ..Self::default() }
    }

    fn add(&mut self, point: &Point) {
        self.in_view += 1;
        self.observed += u64::from(point.observed);
        if let Some(cn0) = point.cn0_dbhz {
            self.cn0_sum += cn0;
            self.cn0_count += 1;
        }
    }

    fn with_mean(self) -> Self {
        let mean = (self.cn0_count > 0).then(|| self.cn0_sum / self.cn0_count as f64);
        Self { mean_cn0_dbhz: mean, ..self }
    }
}

fn ring_of(elevation_deg: f64) -> usize {
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // clamped
    let ring = (elevation_deg / RING_DEG).clamp(0.0, (RINGS - 1) as f64) as usize;
    ring
}

fn mean(positions_m: &[Vector<Ecef>]) -> Option<Vector<Ecef>> {
    let (first, others) = positions_m.split_first()?;
    let sum = others.iter().fold(*first, |sum, position| sum + *position);
    Some(sum * (1.0 / positions_m.len() as f64))
}
