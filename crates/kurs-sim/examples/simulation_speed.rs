//! How much faster than time the simulator runs, on one core and in memory: four antennas, about
//! thirty satellites on two bands, 10 Hz, multipath, wind-up and slips on.
//!
//! `cargo run --release -p kurs-sim --example simulation_speed`
#![allow(clippy::print_stdout, clippy::unwrap_used)]

use std::time::Instant;

use kurs_sim::scenario::Scenario;
use kurs_sim::simulation::{Attachments, SimulatedEpoch, Simulation};

const RUNS: usize = 7;

fn main() {
    let mut factors: Vec<f64> = (0..RUNS).map(|_| run()).collect();
    factors.sort_by(f64::total_cmp);
    println!("{:.0} times real time (median of {RUNS}; {factors:.0?})", factors[RUNS / 2]);
}

fn run() -> f64 {
    let mut scenario: Scenario =
        toml::from_str(include_str!("../../../scenarios/car.toml")).unwrap();
    scenario.signals =
        ["G1C", "G2W", "R1C", "R2C", "E1C", "E5Q", "C2I", "C7I"].map(Into::into).to_vec();
    scenario.sky.systems = ["G", "R", "E", "C"].map(Into::into).to_vec();
    scenario.sky.max_satellites = Some(30);
    scenario.sky.elevation_mask_deg = 0.0;
    (scenario.slips.per_hour, scenario.slips.flagged_share) = (1.0, 0.5);
    let duration_s = scenario.duration_s;
    let mut simulation = Simulation::new(scenario, &Attachments::default()).unwrap();
    let mut epoch = SimulatedEpoch::default();
    let (mut observations, mut epochs) = (0, 0);
    let start = Instant::now();
    while simulation.next_epoch(&mut epoch) {
        epochs += 1;
        let antennas = epoch.bodies[0].observed.antennas.iter().flatten();
        observations += antennas.map(|antenna| antenna.observations.len()).sum::<usize>();
    }
    let wall_s = start.elapsed().as_secs_f64();
    println!("{} observations an epoch, {wall_s:.2} s for {duration_s} s", observations / epochs);
    duration_s / wall_s
}
