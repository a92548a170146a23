//! Time of a whole epoch, from observations to attitude, one core:
//! `cargo run --release -p kurs-sim --example epoch_cost [SCENARIO.toml] [EPOCHS] [SATELLITES ANTENNAS SIGNALS]`.
//!
//! Prints the median, the 99th percentile and the worst over the epochs of a scenario (by default the car with
//! its four antennas and two bands, under a sky of 30 satellites) for each constraint. The time of an
//! epoch is the least of five runs: what else the machine does falls out. For the smallest model of use:
//! `epoch_cost scenarios/car.toml 1000 12 2 G1C,E1C`.
#![expect(clippy::print_stdout, reason = "the times are for reading")]

use std::time::Instant;

use kurs::array::AntennaArray;
use kurs::engine::{Constraint, Engine, Settings};
use kurs::frames::Vector;
use kurs::observation::ArrayEpoch;
use kurs_sim::scenario::Scenario;
use kurs_sim::simulation::{Attachments, SimulatedEpoch, Simulation};
use nalgebra::Vector3;

/// As the program `kurs` has it.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

/// The highest so many of all systems are seen, down to the horizon, if no other number is given.
const SATELLITES: usize = 30;
const RUNS: usize = 5;

fn main() {
    let mut arguments = std::env::args().skip(1);
    let file = arguments.next().unwrap_or_else(|| "scenarios/car.toml".into());
    let count = arguments.next().and_then(|text| text.parse().ok()).unwrap_or(1000);
    let text = std::fs::read_to_string(&file).expect("the scenario can be read");
    let mut scenario: Scenario = toml::from_str(&text).expect("a scenario");
    scenario.sky.systems = ["G", "R", "E", "C"].map(str::to_owned).to_vec();
    let satellites = arguments.next().and_then(|text| text.parse().ok());
    scenario.sky.max_satellites = satellites.or(Some(SATELLITES));
    if let Some(count) = arguments.next().and_then(|text| text.parse().ok()) {
        scenario.body[0].antenna.truncate(count);
    }
    if let Some(signals) = arguments.next() {
        scenario.signals = signals.split(',').map(str::to_owned).collect();
        scenario.sky.systems = scenario.signals.iter().map(|s| s[..1].to_owned()).collect();
    }
    let antennas = &scenario.body[0].antenna;
    let places = antennas.iter().map(|a| Vector::from_xyz(Vector3::from(a.position_m))).collect();
    let array = AntennaArray::new(places).expect("an array");

    let mut simulation = Simulation::new(scenario, &Attachments::default())
        .expect("a scenario that can be simulated");
    let navigation = simulation.navigation().clone();
    let mut epochs: Vec<ArrayEpoch> = Vec::new();
    let mut simulated = SimulatedEpoch::default();
    while epochs.len() < count && simulation.next_epoch(&mut simulated) {
        epochs.push(simulated.bodies[0].observed.clone());
    }

    for constraint in [Constraint::None, Constraint::Length, Constraint::Array] {
        let settings = Settings {
            antennas: array.len(),
            array: Some(array.clone()),
            constraint,
            elevation_mask_rad: 0.0,
            ..Settings::default()
        };
        let mut times_ms = vec![f64::INFINITY; epochs.len()];
        let (mut fixed, mut ambiguities, mut satellites) = (0, 0, 0);
        for _ in 0..RUNS {
            let mut engine =
                Engine::new(settings.clone(), navigation.clone()).expect("settings that work");
            (fixed, ambiguities, satellites) = (0, 0, 0);
            for (epoch, time_ms) in epochs.iter().zip(&mut times_ms) {
                let start = Instant::now();
                let row = engine.push(epoch);
                *time_ms = time_ms.min(1e3 * start.elapsed().as_secs_f64());
                fixed += usize::from(row.is_fixed());
                ambiguities += row.integers.as_ref().map_or(0, |integers| integers.ambiguities);
                satellites += row.satellites;
            }
        }
        times_ms.sort_by(f64::total_cmp);
        let quantile = |share: usize| times_ms[times_ms.len() * share / 100];
        println!(
            "{constraint:?}: {} epochs, {:.1} satellites, {:.1} ambiguities, {:.2} % fixed, p50 {:.3} ms, p99 {:.3} ms, worst {:.3} ms",
            times_ms.len(),
            satellites as f64 / times_ms.len() as f64,
            ambiguities as f64 / times_ms.len() as f64,
            100.0 * fixed as f64 / times_ms.len() as f64,
            quantile(50),
            quantile(99),
            times_ms[times_ms.len() - 1],
        );
    }
}
