//! Two antennas at rest under an undisturbed sky: nothing but distance, orbits and whole cycles, until
//! a test asks for more.

use std::collections::BTreeMap;

use kurs::ephemeris::{Ephemeris, SatelliteState};
use kurs::frames::{Geodetic, Vector};
use kurs::observation::{AntennaEpoch, Observation};
use kurs::signal::{SPEED_OF_LIGHT_MPS, Satellite, Signal};
use kurs_sim::scenario::{MotionPlan, Place, Scenario};
use kurs_sim::simulation::{Attachments, SimulatedEpoch, Simulation};
use nalgebra::Vector3;

/// Quantile of the normal distribution for a two-sided 99.9 %.
pub(crate) const SIGMAS: f64 = 3.29;

pub(crate) const PLACE: Place = Place { latitude_deg: 35.0, longitude_deg: 110.0, height_m: 150.0 };

const ROOF: &str = r#"
seed = 3
start = "2024-03-10T12:00:00"
duration_s = 4.0
interval_s = 1.0
[sky]
systems = ["G", "R", "E", "C", "J"]
[clock]
bias_sd_s = 0.0
drift_sd = 0.0
wander = 0.0
phase_bias = false
[noise]
law = "flat"
code_sd_m = 0.0
phase_sd_cycles = 0.0
doppler_sd_hz = 0.0
[atmosphere]
ionosphere_zenith_m = 0.0
troposphere_zenith_m = 0.0
wind_up = false
[[body]]
name = "roof"
[[body.antenna]]
name = "A0"
position_m = [0.0, 0.0, 0.0]
[[body.antenna]]
name = "A1"
position_m = [1.5, 0.0, 0.0]
[body.motion]
kind = "static"
place = { latitude_deg = 35.0, longitude_deg = 110.0, height_m = 150.0 }
heading_deg = 90.0
"#;

/// A scenario that was run.
pub(crate) struct Run {
    pub(crate) simulation: Simulation,
    pub(crate) epochs: Vec<SimulatedEpoch>,
}

/// What an effect adds to one observation.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Change {
    pub(crate) antenna: usize,
    pub(crate) epoch: usize,
    pub(crate) satellite: Satellite,
    pub(crate) signal: Signal,
    pub(crate) code_m: f64,
    pub(crate) phase_cycles: f64,
    pub(crate) doppler_hz: f64,
    pub(crate) cn0_db: f64,
    pub(crate) wavelength_m: f64,
    pub(crate) elevation_rad: f64,
}

/// The roof with changes.
pub(crate) fn roof(change: impl FnOnce(&mut Scenario)) -> Run {
    let mut scenario: Scenario = toml::from_str(ROOF).unwrap();
    change(&mut scenario);
    run(scenario, &Attachments::default())
}

/// The roof with another motion.
pub(crate) fn moving(motion: MotionPlan, change: impl FnOnce(&mut Scenario)) -> Run {
    roof(|scenario| {
        scenario.body[0].motion = motion;
        change(scenario);
    })
}

pub(crate) fn run(scenario: Scenario, attachments: &Attachments) -> Run {
    let mut simulation = Simulation::new(scenario, attachments).unwrap();
    let (mut epochs, mut epoch) = (Vec::new(), SimulatedEpoch::default());
    while simulation.next_epoch(&mut epoch) {
        epochs.push(epoch.clone());
    }
    Run { simulation, epochs }
}

impl Run {
    /// What an antenna of the first body reports.
    pub(crate) fn antenna(&self, epoch: usize, antenna: usize) -> &AntennaEpoch {
        self.epochs[epoch].bodies[0].observed.antennas[antenna].as_ref().unwrap()
    }

    /// Satellites that an antenna tracks, in order.
    pub(crate) fn satellites(&self, epoch: usize, antenna: usize) -> Vec<Satellite> {
        let observations = self.antenna(epoch, antenna).observations.iter();
        let mut all: Vec<Satellite> = observations.map(|o| o.satellite).collect();
        all.sort_unstable();
        all.dedup();
        all
    }

    /// The broadcast record in force at the start.
    pub(crate) fn record(&self, satellite: Satellite) -> &Ephemeris {
        self.simulation.navigation().ephemerides.select(satellite, self.simulation.start()).unwrap()
    }

    pub(crate) fn wavelength_m(&self, signal: Signal, satellite: Satellite) -> f64 {
        let channel = self.simulation.navigation().ephemerides.glonass_channel(satellite);
        signal.band.wavelength_m(channel).unwrap()
    }

    /// Azimuth and elevation from the first body at an epoch, by the satellite's place at that time.
    pub(crate) fn direction_rad(&self, epoch: usize, satellite: Satellite) -> (f64, f64) {
        let truth = &self.epochs[epoch].bodies[0].truth;
        let store = &self.simulation.navigation().ephemerides;
        let state: SatelliteState = store.state(satellite, truth.time).unwrap();
        let to_ned = Geodetic::from_ecef(truth.position_m).ned_from_ecef();
        let level = (to_ned * (state.position_m - truth.position_m)).direction().xyz();
        (level.y.atan2(level.x), (-level.z).asin())
    }

    /// This run less another one, for every observation that both have.
    pub(crate) fn less(&self, plain: &Self) -> Vec<Change> {
        let mut all = Vec::new();
        for epoch in 0..self.epochs.len().min(plain.epochs.len()) {
            for antenna in 0..self.epochs[epoch].bodies[0].observed.antennas.len() {
                let before = by_signal(plain.antenna(epoch, antenna));
                for (key, with) in by_signal(self.antenna(epoch, antenna)) {
                    let Some(without) = before.get(&key) else { continue };
                    let (satellite, signal) = key;
                    let number = |of: fn(&Observation) -> Option<f64>| {
                        of(&with).unwrap() - of(without).unwrap()
                    };
                    all.push(Change {
                        antenna,
                        epoch,
                        satellite,
                        signal,
                        code_m: number(|o| o.pseudorange_m),
                        phase_cycles: number(|o| o.phase_cycles),
                        doppler_hz: number(|o| o.doppler_hz),
                        cn0_db: number(|o| o.cn0_dbhz),
                        wavelength_m: self.wavelength_m(signal, satellite),
                        elevation_rad: self.direction_rad(epoch, satellite).1,
                    });
                }
            }
        }
        assert!(all.len() > 100, "only {} observations", all.len());
        all
    }
}

impl Change {
    /// What it adds to the distance by phase.
    pub(crate) fn phase_m(&self) -> f64 {
        self.phase_cycles * self.wavelength_m
    }

    /// Frequency of L1 against that of the signal.
    pub(crate) fn frequency_ratio(&self) -> f64 {
        1_575.42e6 / (SPEED_OF_LIGHT_MPS / self.wavelength_m)
    }
}

/// Observations by satellite and signal.
pub(crate) fn by_signal(epoch: &AntennaEpoch) -> BTreeMap<(Satellite, Signal), Observation> {
    epoch.observations.iter().map(|o| ((o.satellite, o.signal), *o)).collect()
}

pub(crate) fn signal(name: &str) -> Signal {
    name.parse().unwrap()
}

pub(crate) fn names(names: &[&str]) -> Vec<String> {
    names.iter().map(|name| (*name).to_owned()).collect()
}

pub(crate) fn rms(values: impl IntoIterator<Item = f64>) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    for value in values {
        (sum, count) = (sum + value * value, count + 1.0);
    }
    f64::sqrt(sum / f64::max(count, 1.0))
}

/// Whether the root mean square of `count` independent normal numbers is one of this standard deviation,
/// by the band of 99.9 %.
pub(crate) fn assert_sd(what: &str, found: f64, wanted: f64, count: usize) {
    let band = SIGMAS / (2.0 * count as f64).sqrt();
    assert!(
        (found / wanted - 1.0).abs() < band,
        "{what}: {found}, wanted {wanted} within {band:.3}"
    );
}

/// North, east and down of a point against the place of the roof.
pub(crate) fn level_m(position_m: Vector<kurs::frames::Ecef>) -> Vector3<f64> {
    let here = PLACE.geodetic();
    (here.ned_from_ecef() * (position_m - here.to_ecef())).xyz()
}
