//! A simulation solved by the engine and laid against what is true: what the consistency tests and
//! the experiments share.
#![allow(dead_code)] // every user needs a part

pub(crate) mod figures;
pub(crate) mod sky;

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;

use kurs::array::AntennaArray;
use kurs::engine::{Ambiguities, Constraint, Engine, Settings};
use kurs::float_solution::recursive::Motion;
use kurs::frames::{Vector, enu_from_ned};
use kurs::signal::{Satellite, Signal};
use kurs::sky::NoiseModel;
use kurs::solution::{EpochSolution, IntegerSum};
use kurs_sim::scenario::{Law, Scenario};
use kurs_sim::simulation::{Attachments, BodyTruth, SimulatedEpoch, Simulation};
use nalgebra::{Matrix3, Vector3};

/// A ready scenario of the project.
pub(crate) fn ready(name: &str) -> Scenario {
    let text = match name {
        "roof-static" => include_str!("../../../../../scenarios/roof-static.toml"),
        "car" => include_str!("../../../../../scenarios/car.toml"),
        "ship" => include_str!("../../../../../scenarios/ship.toml"),
        "uav" => include_str!("../../../../../scenarios/uav.toml"),
        "urban" => include_str!("../../../../../scenarios/urban.toml"),
        "few-satellites" => include_str!("../../../../../scenarios/few-satellites.toml"),
        "leo" => include_str!("../../../../../scenarios/leo.toml"),
        "two-bodies" => include_str!("../../../../../scenarios/two-bodies.toml"),
        "edge" => include_str!("../../../../../scenarios/edge.toml"),
        "canopy" => include_str!("../../../../../scenarios/canopy.toml"),
        "canopy-array" => include_str!("../../../../../scenarios/canopy-array.toml"),
        "street" => include_str!("../../../../../scenarios/street.toml"),
        other => panic!("no scenario {other}"),
    };
    toml::from_str(text).unwrap()
}

/// A ready scenario with other random numbers and at another hour of the day.
pub(crate) fn session(name: &str, seed: u64) -> Scenario {
    let mut scenario = ready(name);
    scenario.seed += 1000 * seed;
    scenario.start = format!("2024-03-10T{:02}:00:00", (12 + 5 * seed) % 24);
    scenario
}

/// White noise whose law the engine's weights know: `NOISE` below.
pub(crate) fn with_known_noise(scenario: &mut Scenario) {
    (scenario.multipath.code_sd_m, scenario.multipath.phase_sd_m) = (0.0, 0.0);
    (scenario.noise.law, scenario.noise.code_sd_m) = (Law::Mixed, NOISE.code_zenith_m);
    // The same in cycles of every carrier: near enough to the same in metres for L1, E1 and B1.
    scenario.noise.phase_sd_cycles = NOISE.phase_zenith_m / 0.190_293_672_798_364_9;
    scenario.signals = ["G1C", "E1C"].map(str::to_owned).to_vec();
    scenario.sky.systems = ["G", "E"].map(str::to_owned).to_vec();
    scenario.noise.cn0_zenith_dbhz = 70.0;
}

/// What the engine is told of the noise.
pub(crate) const NOISE: NoiseModel = NoiseModel {
    code_zenith_m: 0.3,
    phase_zenith_m: 0.002,
    full_cn0_dbhz: 45.0,
    channel_sd_m: 0.0,
};

/// Settings for the first body of a scenario, with what is known of its noise.
pub(crate) fn settings(scenario: &Scenario, constraint: Constraint) -> Settings {
    let antennas = &scenario.body[0].antenna;
    let places = antennas.iter().map(|a| Vector::from_xyz(Vector3::from(a.position_m))).collect();
    Settings {
        antennas: antennas.len(),
        array: Some(AntennaArray::new(places).unwrap()),
        constraint,
        array_sd_m: scenario.array_sd_m,
        noise: NOISE,
        residuals: true,
        ..Settings::default()
    }
}

/// Settings of `kurs solve` for the first body of a scenario, told nothing of its noise.
pub(crate) fn as_told(scenario: &Scenario, constraint: Constraint) -> Settings {
    Settings { noise: Settings::default().noise, ..settings(scenario, constraint) }
}

/// Settings with ambiguities that are carried from epoch to epoch.
pub(crate) fn continuous(settings: Settings) -> Settings {
    Settings { ambiguities: Ambiguities::Continuous(Motion::Free), ..settings }
}

/// Solves the first body of a scenario; `take` gets every epoch.
pub(crate) fn solve(
    scenario: Scenario,
    settings: Settings,
    mut take: impl FnMut(&BodyTruth, &EpochSolution, Integers),
) {
    solve_each(scenario, [settings], |_, truth, row, integers| take(truth, row, integers));
}

/// Solves the same observations with each of several settings; `take` gets their numbers too.
pub(crate) fn solve_each(
    scenario: Scenario,
    settings: impl IntoIterator<Item = Settings>,
    mut take: impl FnMut(usize, &BodyTruth, &EpochSolution, Integers),
) {
    let mut simulation = Simulation::new(scenario, &Attachments::default()).unwrap();
    let engine = |settings| Engine::new(settings, simulation.navigation().clone()).unwrap();
    let mut engines: Vec<Engine> = settings.into_iter().map(engine).collect();
    let mut cycles = TrueCycles::of(simulation.scenario());
    let mut epoch = SimulatedEpoch::default();
    while simulation.next_epoch(&mut epoch) {
        cycles.take(&epoch);
        let body = &epoch.bodies[0];
        for (k, engine) in engines.iter_mut().enumerate() {
            let row = engine.push(&body.observed);
            take(k, &body.truth, &row, cycles.judge(sums(&row)));
        }
    }
}

/// Does jobs on all processors; their results in the order of the jobs.
pub(crate) fn in_parallel<J: Sync, T: Send>(jobs: &[J], work: impl Fn(&J) -> T + Sync) -> Vec<T> {
    let next = AtomicUsize::new(0);
    let worker = || {
        let mut done = Vec::new();
        loop {
            let index = next.fetch_add(1, Ordering::Relaxed);
            let Some(job) = jobs.get(index) else { return done };
            done.push((index, work(job)));
        }
    };
    let workers = thread::available_parallelism().map_or(1, usize::from);
    let mut done: Vec<(usize, T)> = thread::scope(|scope| {
        let threads: Vec<_> = (0..workers).map(|_| scope.spawn(worker)).collect();
        threads.into_iter().flat_map(|thread| thread.join().unwrap()).collect()
    });
    done.sort_by_key(|(index, _)| *index);
    done.into_iter().map(|(_, result)| result).collect()
}

/// The best integers of an epoch against the true ones.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Integers {
    /// No integers were found.
    None,
    /// All of them are true.
    Right,
    /// At least one is not.
    Wrong,
}

/// The true whole cycles of every phase of the first body.
pub(crate) struct TrueCycles {
    names: Vec<String>,
    cycles: BTreeMap<(usize, Satellite, Signal), i64>,
}

impl TrueCycles {
    /// None yet.
    pub(crate) fn of(scenario: &Scenario) -> Self {
        let names = scenario.body[0].antenna.iter().map(|a| a.name.clone()).collect();
        Self { names, cycles: BTreeMap::new() }
    }

    /// Takes in what was drawn or changed at an epoch.
    pub(crate) fn take(&mut self, epoch: &SimulatedEpoch) {
        for change in &epoch.changes {
            if let Some(antenna) = self.names.iter().position(|name| *name == change.antenna) {
                self.cycles.insert((antenna, change.satellite, change.signal), change.cycles);
            }
        }
    }

    /// The estimated integers against these.
    pub(crate) fn judge(&self, sums: &[IntegerSum]) -> Integers {
        let is_true = |sum: &IntegerSum| {
            let of_link = |(antenna, satellite, signal, sign): &(usize, Satellite, Signal, i64)| {
                sign * self.cycles[&(*antenna, *satellite, *signal)]
            };
            sum.links.iter().map(of_link).sum::<i64>() == sum.cycles
        };
        match (sums.is_empty(), sums.iter().all(is_true)) {
            (true, _) => Integers::None,
            (false, true) => Integers::Right,
            (false, false) => Integers::Wrong,
        }
    }
}

/// The integers of a row; none where they were not wanted or not found.
pub(crate) fn sums(row: &EpochSolution) -> &[IntegerSum] {
    row.signals.as_ref().map_or(&[], |signals| &signals.integers)
}

/// Errors of heading, pitch and roll, rad, where all three are known.
pub(crate) fn angle_errors(truth: &BodyTruth, row: &EpochSolution) -> Option<Vector3<f64>> {
    let [heading, pitch, roll] = known_angle_errors(truth, row);
    Some(Vector3::new(heading?, pitch?, roll?))
}

/// Errors of those of heading, pitch and roll, rad, that are known.
pub(crate) fn known_angle_errors(truth: &BodyTruth, row: &EpochSolution) -> [Option<f64>; 3] {
    let Some(attitude) = row.attitude() else { return [None; 3] };
    let about_the_circle = |error_rad: f64| error_rad.sin().atan2(error_rad.cos());
    [
        attitude.heading_rad.map(|rad| about_the_circle(rad - truth.attitude.heading_rad)),
        attitude.pitch_rad.map(|rad| rad - truth.attitude.pitch_rad),
        attitude.roll_rad.map(|rad| rad - truth.attitude.roll_rad),
    ]
}

/// Error of baseline `k`, east-north-up, m.
pub(crate) fn baseline_error(
    truth: &BodyTruth,
    row: &EpochSolution,
    k: usize,
) -> Option<Vector3<f64>> {
    let wanted = enu_from_ned() * *truth.baselines_m.get(k)?;
    Some((row.baselines.get(k)?.baseline_m - wanted).xyz())
}

/// `eᵀ Q⁻¹ e`: as many on average as there are errors, where `Q` is honest.
pub(crate) fn normalised_square(error: &Vector3<f64>, covariance: &Matrix3<f64>) -> f64 {
    error.dot(&(covariance.try_inverse().unwrap() * error))
}

/// What a run of a scenario came to.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Tally {
    /// Epochs.
    pub(crate) epochs: usize,
    /// Fixed ones.
    pub(crate) fixed: usize,
    /// Fixed with at least one wrong integer.
    pub(crate) wrong: usize,
    /// Sums of squared errors of heading, pitch, roll over the fixed epochs, rad².
    pub(crate) squares: Vector3<f64>,
    /// Sum of normalised squares of the three angles.
    pub(crate) normalised: f64,
}

impl Tally {
    /// Takes an epoch in.
    pub(crate) fn add(&mut self, truth: &BodyTruth, row: &EpochSolution, integers: Integers) {
        self.epochs += 1;
        if !row.is_fixed() {
            return;
        }
        self.fixed += 1;
        self.wrong += usize::from(integers != Integers::Right);
        if let (Some(error), Some(attitude)) = (angle_errors(truth, row), row.attitude()) {
            self.squares += error.component_mul(&error);
            self.normalised += normalised_square(&error, &attitude.covariance_rad2);
        }
    }

    /// Root mean square errors of heading, pitch and roll, degrees.
    pub(crate) fn rms_deg(&self) -> Vector3<f64> {
        self.squares.map(|sum| (sum / self.fixed.max(1) as f64).sqrt().to_degrees())
    }
}
