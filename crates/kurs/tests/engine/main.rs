//! The engine as its users see it: recorded epochs, epochs made by a measurement equation of their own, and
//! epochs that nobody would measure.
#![allow(clippy::unwrap_used, clippy::print_stdout, clippy::duplicate_mod)] // a test; each example stands alone

mod acceptance;
mod float_solution;
mod frozen;
mod left_out;
mod properties;
mod recorded;
#[path = "../../examples/data/recording.rs"]
mod recording;
mod rows;
mod sequences;
mod velocity;
mod whole_row;
#[path = "../../examples/data/world.rs"]
mod world;

use kurs::{AntennaArray, Attitude, Constraint, Engine, EpochSolution, Settings};
use world::{Motion, World};

/// A triangle of a metre.
const TRIANGLE_M: [[f64; 3]; 3] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.2, 0.9, 0.0]];
/// A rectangle.
const RECTANGLE_M: [[f64; 3]; 4] =
    [[0.0, 0.0, 0.0], [1.5, 0.0, 0.0], [0.0, 1.0, 0.0], [1.5, 1.0, -0.3]];

/// Angles in degrees.
fn degrees(heading: f64, pitch: f64, roll: f64) -> Attitude {
    let [heading_rad, pitch_rad, roll_rad] = [heading, pitch, roll].map(f64::to_radians);
    Attitude { heading_rad, pitch_rad, roll_rad }
}

/// What an engine is told of a body: its antennas, with the whole array as constraint.
fn told(body: &Motion) -> Settings {
    Settings {
        antennas: body.antennas_m.len(),
        array: Some(AntennaArray::new(body.antennas_m.clone()).unwrap()),
        constraint: Constraint::Array,
        ..Settings::default()
    }
}

/// An engine for this world.
fn engine(settings: Settings, world: &World) -> Engine {
    Engine::new(settings, world.navigation.clone()).unwrap()
}

/// Rows of so many epochs, a second apart.
fn rows(engine: &mut Engine, world: &mut World, body: &Motion, epochs: u32) -> Vec<EpochSolution> {
    (0..epochs).map(|k| engine.push(&world.epoch(body, f64::from(k)))).collect()
}

/// Heading, pitch and roll less the true ones, the short way round, in standard deviations.
fn errors_in_sigmas(row: &EpochSolution, truth: &Attitude) -> [Option<f64>; 3] {
    let attitude = row.attitude().unwrap();
    let truth = [truth.heading_rad, truth.pitch_rad, truth.roll_rad];
    core::array::from_fn(|k| {
        let error = attitude.angles_rad()[k]? - truth[k];
        let error = (error + core::f64::consts::PI).rem_euclid(core::f64::consts::TAU)
            - core::f64::consts::PI;
        Some(error / attitude.covariance_rad2[(k, k)].sqrt())
    })
}
