//! A scenario at work: epoch by epoch the truth and what the receivers report.

use kurs::ephemeris::{Ephemeris, NavigationData};
use kurs::frames::{Attitude, Body, Ecef, Geodetic, Ned, Vector};
use kurs::observation::{AntennaEpoch, ArrayEpoch};
use kurs::signal::{SPEED_OF_LIGHT_MPS, Satellite, Signal};
use kurs::time::{Calendar, GpsTime};
use nalgebra::Vector3;

use crate::check;
use crate::disturbance::Disturbances;
use crate::imu::ImuRecording;
use crate::motion::{Motion, Pose, RecordedPose};
use crate::noise::Noise;
use crate::nominal_orbits;
use crate::propagation::broadcast_ionosphere;
use crate::receivable::{self, Receivable};
use crate::receiver::{AmbiguityChange, Receiver, ReceiverPlan, Reception};
use crate::rotating_arm::Clock;
use crate::satellite_track::SatelliteTrack;
use crate::scenario::{Canopy, ReceiverClocks, Scenario};
pub use crate::scenario_error::ScenarioError;
use crate::wall::Wall;

/// A millisecond of clock error.
const MILLISECOND_M: f64 = SPEED_OF_LIGHT_MPS * 1e-3;

/// Users of the seed; receivers follow.
const ORBITS: u64 = 0;
const ERRORS: u64 = 1;
const CLOCKS: u64 = 2;
const MOTIONS: u64 = 3;
const SURVEYS: u64 = 4;
const IMUS: u64 = 600;
const RECEIVERS: u64 = 1000;

/// What a scenario file refers to, read by the caller.
#[derive(Debug, Clone, Default)]
pub struct Attachments {
    /// The navigation file of `sky.navigation`.
    pub navigation: Option<NavigationData>,
    /// For every body the table of its recorded motion.
    pub recorded: Vec<Option<Vec<RecordedPose>>>,
}

/// A scenario at work.
#[derive(Debug, Clone)]
pub struct Simulation {
    scenario: Scenario,
    start: GpsTime,
    navigation: NavigationData,
    tracks: Vec<SatelliteTrack>,
    ephemerides: Vec<Option<Ephemeris>>,
    disturbances: Disturbances,
    walls: Vec<Wall>,
    bodies: Vec<MovingBody>,
    station: Option<MovingBody>,
    clocks: Vec<Clock>,
    clock_noise: Noise,
    epochs: usize,
    next: usize,
}

/// A body with its receivers.
#[derive(Debug, Clone)]
struct MovingBody {
    motion: Motion,
    receivers: Vec<Receiver>,
}

/// The true state of a body, at the instant when its first antenna measured.
#[derive(Debug, Clone, PartialEq)]
pub struct BodyTruth {
    /// Time tag of the first antenna.
    pub time: GpsTime,
    /// Origin of the body axes.
    pub position_m: Vector<Ecef>,
    /// Against the Earth.
    pub velocity_mps: Vector<Ned>,
    /// Against the local level axes at the origin.
    pub attitude: Attitude,
    /// From the first antenna to every other one, north-east-down.
    pub baselines_m: Vec<Vector<Ned>>,
    /// Clock error of every receiver: time tag minus GPST.
    pub clocks_s: Vec<f64>,
}

/// One body at one epoch.
#[derive(Debug, Clone, PartialEq)]
pub struct BodyEpoch {
    /// What is.
    pub truth: BodyTruth,
    /// What its receivers report.
    pub observed: ArrayEpoch,
}

/// Everything at one epoch; the buffers are reused.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct SimulatedEpoch {
    /// In the order of the scenario.
    pub bodies: Vec<BodyEpoch>,
    /// The fixed antenna, where there is one.
    pub station: Option<AntennaEpoch>,
    /// Whole cycles that were drawn or changed at this epoch.
    pub changes: Vec<AmbiguityChange>,
}

impl Simulation {
    /// Checks a scenario and prepares it.
    ///
    /// # Errors
    ///
    /// [`ScenarioError`] names the key, what was found and what was expected.
    pub fn new(scenario: Scenario, attachments: &Attachments) -> Result<Self, ScenarioError> {
        let start = start_time(&scenario.start)?;
        let epochs = count_epochs(&scenario)?;
        check::check(&scenario)?;
        let navigation = match &attachments.navigation {
            Some(navigation) => navigation.clone(),
            None => built_in_orbits(&scenario, start)?,
        };
        let mut tracks = tracks(&scenario, &navigation, start);
        let store = &navigation.ephemerides;
        if !tracks.iter_mut().any(|track| track.advance(store, 0.0).is_some()) {
            let name = scenario.sky.navigation.as_deref().unwrap_or_default();
            let problem = format!("{name:?}, expected a file with records for {}", scenario.start);
            return Err(ScenarioError::new("sky.navigation", problem));
        }
        let satellites: Vec<Satellite> = tracks.iter().map(|track| track.satellite).collect();
        let receivable = Receivable::new(&scenario, &satellites)?;
        let disturbances = Disturbances::new(&scenario, &receivable)?;
        let mut simulation = Self {
            tracks,
            ephemerides: Vec::new(),
            bodies: Vec::with_capacity(scenario.body.len()),
            station: None,
            clocks: Vec::new(),
            clock_noise: Noise::stream(scenario.seed, CLOCKS),
            next: 0,
            walls: scenario.wall.iter().map(Wall::new).collect(),
            scenario,
            start,
            navigation,
            disturbances,
            epochs,
        };
        simulation.make_bodies(&attachments.recorded)?;
        simulation.make_station()?;
        simulation.keep_highest();
        Ok(simulation)
    }

    /// The scenario.
    #[must_use]
    pub const fn scenario(&self) -> &Scenario {
        &self.scenario
    }

    /// The broadcast ephemerides that belong to the observations.
    #[must_use]
    pub const fn navigation(&self) -> &NavigationData {
        &self.navigation
    }

    /// Time tag of the first epoch.
    #[must_use]
    pub const fn start(&self) -> GpsTime {
        self.start
    }

    /// How many epochs there are.
    #[must_use]
    pub const fn epochs(&self) -> usize {
        self.epochs
    }

    /// The readings of the inertial sensor of a body, if it has one.
    #[must_use]
    pub fn imu(&self, body: usize) -> Option<ImuRecording> {
        let plan = self.scenario.body.get(body)?.imu.as_ref()?;
        let noise = Noise::stream(self.scenario.seed, IMUS + body as u64);
        let motion = &self.bodies.get(body)?.motion;
        Some(ImuRecording::new(plan, motion, self.scenario.duration_s, noise))
    }

    /// Makes the next epoch; `false` at the end of the scenario.
    pub fn next_epoch(&mut self, epoch: &mut SimulatedEpoch) -> bool {
        if self.next == self.epochs {
            return false;
        }
        let grid_s = self.next as f64 * self.scenario.interval_s;
        self.advance_satellites(grid_s);
        self.advance_clocks();
        epoch.changes.clear();
        let surroundings = Surroundings {
            scenario: &self.scenario,
            disturbances: &self.disturbances,
            walls: &self.walls,
            origin_m: self.bodies[0].motion.pose(0.0).position_m,
            start: self.start,
            clocks: &self.clocks,
            tracks: &self.tracks,
            ephemerides: &self.ephemerides,
        };
        epoch.bodies.resize_with(self.bodies.len(), BodyEpoch::default);
        for (body, made) in self.bodies.iter_mut().zip(&mut epoch.bodies) {
            body.live(grid_s, &surroundings, made, &mut epoch.changes);
        }
        epoch.station = self.station.as_mut().map(|station| {
            let mut made = BodyEpoch::default();
            station.live(grid_s, &surroundings, &mut made, &mut epoch.changes);
            made.observed.antennas.pop().flatten().unwrap_or_default()
        });
        self.next += 1;
        true
    }

    fn make_bodies(&mut self, recorded: &[Option<Vec<RecordedPose>>]) -> Result<(), ScenarioError> {
        let seed = self.scenario.seed;
        let mut motion_noise = Noise::stream(seed, MOTIONS);
        let mut survey_noise = Noise::stream(seed, SURVEYS);
        let mut receivers_made = 0;
        for (index, body) in self.scenario.body.iter().enumerate() {
            let table = recorded.get(index).and_then(Option::as_deref);
            let motion = Motion::new(&body.motion, table, &mut motion_noise)
                .map_err(|problem| ScenarioError::new("body.motion", problem))?;
            let mut receivers = Vec::with_capacity(body.antenna.len());
            for antenna in &body.antenna {
                if receivers.is_empty() || !self.scenario.clock.common {
                    self.clocks.push(first_clock(&self.scenario.clock, &mut self.clock_noise));
                }
                let surveyed_m = Vector::<Body>::from_xyz(Vector3::from(antenna.position_m));
                let survey_error_m = survey_noise.normal3(self.scenario.array_sd_m);
                let plan = ReceiverPlan {
                    name: &antenna.name,
                    position_m: surveyed_m - Vector::from_xyz(survey_error_m),
                    tag_offset_s: antenna.tag_offset_s,
                    turned_deg: antenna.turned_deg,
                    mask_deg: &antenna.mask_deg,
                    canopies: canopies(&antenna.name, &self.scenario),
                    signals: signals(antenna.signals.as_ref(), &self.scenario)?,
                    clock: self.clocks.len() - 1,
                    phase_bias: self.scenario.clock.phase_bias,
                };
                let noise = Noise::stream(seed, RECEIVERS + receivers_made);
                receivers.push(Receiver::new(plan, &self.tracks, noise));
                receivers_made += 1;
            }
            self.bodies.push(MovingBody { motion, receivers });
        }
        Ok(())
    }

    fn make_station(&mut self) -> Result<(), ScenarioError> {
        let Some(station) = &self.scenario.station else { return Ok(()) };
        self.clocks.push(first_clock(&self.scenario.clock, &mut self.clock_noise));
        let plan = ReceiverPlan {
            name: &station.name,
            position_m: Vector::new(0.0, 0.0, 0.0),
            tag_offset_s: 0.0,
            turned_deg: 0.0,
            mask_deg: &[],
            canopies: canopies(&station.name, &self.scenario),
            signals: signals(station.signals.as_ref(), &self.scenario)?,
            clock: self.clocks.len() - 1,
            phase_bias: self.scenario.clock.phase_bias,
        };
        let noise = Noise::stream(self.scenario.seed, RECEIVERS - 1);
        let position_m = station.place.geodetic().to_ecef();
        let attitude = Attitude { heading_rad: 0.0, pitch_rad: 0.0, roll_rad: 0.0 };
        self.station = Some(MovingBody {
            motion: Motion::Static(Pose { position_m, attitude }),
            receivers: vec![Receiver::new(plan, &self.tracks, noise)],
        });
        Ok(())
    }

    /// Leaves the highest satellites at the start, where only so many are wanted.
    fn keep_highest(&mut self) {
        let Some(most) = self.scenario.sky.max_satellites else { return };
        self.advance_satellites(0.0);
        let here_m = self.bodies[0].motion.pose(0.0).position_m;
        let up = -Geodetic::from_ecef(here_m).ecef_from_ned().matrix().column(2).into_owned();
        let height = |track: &SatelliteTrack| {
            let sender = track.at(0.0)?;
            Some((sender.position_m - here_m.xyz()).normalize().dot(&up))
        };
        let mut heights: Vec<f64> = self.tracks.iter().filter_map(height).collect();
        heights.sort_by(|a, b| b.total_cmp(a));
        let lowest = heights.get(most.saturating_sub(1)).copied().unwrap_or(f64::NEG_INFINITY);
        let kept: Vec<bool> =
            self.tracks.iter().map(|t| height(t).is_some_and(|h| h >= lowest)).collect();
        for receiver in
            self.bodies.iter_mut().chain(&mut self.station).flat_map(|b| &mut b.receivers)
        {
            receiver.keep(&kept);
        }
        let mut keep = kept.iter();
        self.tracks.retain(|_| *keep.next().unwrap_or(&false));
    }

    fn advance_satellites(&mut self, grid_s: f64) {
        let store = &self.navigation.ephemerides;
        self.ephemerides.clear();
        self.ephemerides
            .extend(self.tracks.iter_mut().map(|track| track.advance(store, grid_s).copied()));
    }

    fn advance_clocks(&mut self) {
        if self.next == 0 {
            return;
        }
        for clock in &mut self.clocks {
            clock.advance(self.scenario.interval_s, &mut self.clock_noise);
            if self.scenario.clock.millisecond_jumps && clock.bias_m.abs() > MILLISECOND_M / 2.0 {
                clock.bias_m -= MILLISECOND_M.copysign(clock.bias_m);
            }
        }
    }
}

/// What all receivers share at an epoch.
struct Surroundings<'a> {
    scenario: &'a Scenario,
    disturbances: &'a Disturbances,
    walls: &'a [Wall],
    /// Where the first body is at the start: to this place walls refer.
    origin_m: Vector<Ecef>,
    start: GpsTime,
    clocks: &'a [Clock],
    tracks: &'a [SatelliteTrack],
    ephemerides: &'a [Option<Ephemeris>],
}

impl MovingBody {
    /// The body's truth at an epoch, and what its receivers report.
    fn live(
        &mut self,
        grid_s: f64,
        surroundings: &Surroundings<'_>,
        made: &mut BodyEpoch,
        changes: &mut Vec<AmbiguityChange>,
    ) {
        made.observed.antennas.resize_with(self.receivers.len(), || Some(AntennaEpoch::default()));
        made.truth.clocks_s.clear();
        let to_local = Geodetic::from_ecef(surroundings.origin_m).ned_from_ecef();
        for (index, receiver) in self.receivers.iter_mut().enumerate() {
            let clock = surroundings.clocks[receiver.clock];
            let clock_s = clock.bias_m / SPEED_OF_LIGHT_MPS;
            let tag_s = grid_s + receiver.tag_offset_s;
            let time_s = tag_s - clock_s;
            let pose = self.motion.pose(time_s);
            let ecef_from_body = pose.ecef_from_body();
            let tag = surroundings.start + tag_s;
            let position_m = pose.position_m + ecef_from_body * receiver.lever_arm_m;
            let reception = Reception {
                tag_s,
                tag,
                time_s,
                clock,
                position_m,
                local_m: (to_local * (position_m - surroundings.origin_m)).xyz(),
                walls: surroundings.walls,
                velocity_mps: self.motion.velocity_mps(receiver.lever_arm_m, time_s),
                ecef_from_body: ecef_from_body.matrix(),
                scenario: surroundings.scenario,
                disturbances: surroundings.disturbances,
            };
            let epoch = made.observed.antennas[index].get_or_insert_with(AntennaEpoch::default);
            let (tracks, ephemerides) = (surroundings.tracks, surroundings.ephemerides);
            receiver.observe(&reception, tracks, ephemerides, epoch, changes);
            made.truth.clocks_s.push(clock_s);
            if index == 0 {
                made.observed.time = tag;
                made.truth.time = tag;
                self.motion.tell(time_s, &pose, &mut made.truth);
            }
        }
        made.truth.tell_baselines(&self.receivers);
    }
}

impl Motion {
    fn tell(&self, time_s: f64, pose: &Pose, truth: &mut BodyTruth) {
        let origin = Vector::new(0.0, 0.0, 0.0);
        let ned_from_ecef = Geodetic::from_ecef(pose.position_m).ned_from_ecef();
        truth.position_m = pose.position_m;
        truth.velocity_mps = ned_from_ecef * self.velocity_mps(origin, time_s);
        truth.attitude = pose.attitude;
    }
}

impl BodyTruth {
    fn tell_baselines(&mut self, receivers: &[Receiver]) {
        let ned_from_body = self.attitude.ned_from_body();
        self.baselines_m.clear();
        let Some((first, others)) = receivers.split_first() else { return };
        let from_first = |r: &Receiver| ned_from_body * (r.lever_arm_m - first.lever_arm_m);
        self.baselines_m.extend(others.iter().map(from_first));
    }
}

impl Default for BodyEpoch {
    fn default() -> Self {
        Self {
            truth: BodyTruth {
                time: GpsTime::default(),
                position_m: Vector::new(0.0, 0.0, 0.0),
                velocity_mps: Vector::new(0.0, 0.0, 0.0),
                attitude: Attitude { heading_rad: 0.0, pitch_rad: 0.0, roll_rad: 0.0 },
                baselines_m: Vec::new(),
                clocks_s: Vec::new(),
            },
            observed: ArrayEpoch::default(),
        }
    }
}

fn first_clock(clocks: &ReceiverClocks, noise: &mut Noise) -> Clock {
    Clock {
        bias_m: noise.normal(clocks.bias_sd_s * SPEED_OF_LIGHT_MPS),
        rate_mps: noise.normal(clocks.drift_sd * SPEED_OF_LIGHT_MPS),
        density: (clocks.wander * SPEED_OF_LIGHT_MPS).powi(2),
    }
}

fn built_in_orbits(scenario: &Scenario, start: GpsTime) -> Result<NavigationData, ScenarioError> {
    let names = scenario.sky.systems.iter();
    let systems: Vec<_> = names
        .map(|name| receivable::system("sky.systems", name))
        .collect::<Result<_, ScenarioError>>()?;
    let mut noise = Noise::stream(scenario.seed, ORBITS);
    let mut data = nominal_orbits::navigation(&systems, start, scenario.duration_s, &mut noise)
        .map_err(|error| ScenarioError::new("sky.systems", error.to_string()))?;
    data.ionosphere.gps = Some(broadcast_ionosphere(scenario.atmosphere.ionosphere_zenith_m));
    Ok(data)
}

/// Every satellite of the navigation data, with its true errors.
fn tracks(scenario: &Scenario, navigation: &NavigationData, start: GpsTime) -> Vec<SatelliteTrack> {
    let store = &navigation.ephemerides;
    let mut satellites: Vec<Satellite> = store.iter().map(Ephemeris::satellite).collect();
    satellites.dedup();
    let mut noise = Noise::stream(scenario.seed, ERRORS);
    let track = |satellite| {
        let mut track = SatelliteTrack::new(satellite, store, start);
        track.orbit_error_m = noise.normal3(scenario.sky.orbit_error_sd_m);
        track.clock_error_s = noise.normal(scenario.sky.clock_error_sd_m) / SPEED_OF_LIGHT_MPS;
        track
    };
    satellites.into_iter().map(track).collect()
}

fn signals(own: Option<&Vec<String>>, scenario: &Scenario) -> Result<Vec<Signal>, ScenarioError> {
    let names = own.unwrap_or(&scenario.signals);
    receivable::parse_all("signals", names)
}

/// What an antenna stands under.
fn canopies(antenna: &str, scenario: &Scenario) -> Vec<Canopy> {
    let is_under = |canopy: &&Canopy| {
        canopy.antennas.is_empty() || canopy.antennas.iter().any(|name| name == antenna)
    };
    scenario.canopy.iter().filter(is_under).cloned().collect()
}

/// `2024-03-10T12:00:00`, on the GPS scale.
fn start_time(text: &str) -> Result<GpsTime, ScenarioError> {
    let expected = || {
        ScenarioError::new("start", format!("{text:?}, expected a time like 2024-03-10T12:00:00"))
    };
    let (date, time) = text.split_once(['T', ' ']).ok_or_else(expected)?;
    let mut parts = date.split('-').chain(time.split(':'));
    let mut part = || parts.next().and_then(|word| word.parse::<u16>().ok()).ok_or_else(expected);
    let (year, month, day, hour, minute) = (part()?, part()?, part()?, part()?, part()?);
    let second = parts.next().and_then(|word| word.parse().ok()).ok_or_else(expected)?;
    let small = |value: u16| u8::try_from(value).map_err(|_| expected());
    let calendar = Calendar {
        year: i32::from(year),
        month: small(month)?,
        day: small(day)?,
        hour: small(hour)?,
        minute: small(minute)?,
        second,
    };
    GpsTime::from_calendar(calendar).ok_or_else(expected)
}

#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // checked
fn count_epochs(scenario: &Scenario) -> Result<usize, ScenarioError> {
    const MOST: f64 = 1e8;
    const SHORTEST_S: f64 = 1e-3;
    const LONGEST_S: f64 = 1e5;
    let Scenario { duration_s, interval_s, .. } = scenario;
    if !(SHORTEST_S..=LONGEST_S).contains(interval_s) {
        let problem = format!("{interval_s}, expected from {SHORTEST_S} to {LONGEST_S}");
        return Err(ScenarioError::new("interval_s", problem));
    }
    if *duration_s < 0.0 {
        let problem = format!("{duration_s}, expected at least 0, which is one epoch");
        return Err(ScenarioError::new("duration_s", problem));
    }
    let count = (duration_s / interval_s + 1e-6).floor() + 1.0;
    if !(1.0..=MOST).contains(&count) {
        let problem = format!("{duration_s} with {count} epochs, expected 1 to {MOST} epochs");
        return Err(ScenarioError::new("duration_s", problem));
    }
    Ok(count as usize)
}
