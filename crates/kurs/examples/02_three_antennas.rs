//! Heading, pitch and roll of a body with three antennas, with their covariance.
//!
//! * `A = [a₁ a₂]`: baselines in body axes (forward, right, down), known; `B = R A`: in local level axes, measured.
//! * The rotation `R` minimises `‖vec(B − R A)‖²` in the metric of the measured baselines' covariance, which is never
//!   diagonal: both of them begin at the same antenna.
//! * The known array is in the search for the whole cycles too: only integers that belong to a rotation count.
//!
//! ```text
//! $ cargo run -p kurs --example 02_three_antennas
//! found  heading  40.0°  pitch   3.0°  roll  -8.0°
//! true   heading  40.0°  pitch   3.0°  roll  -8.0°
//! sd             0.17°         0.35°        0.40°
//! ```
#![allow(clippy::print_stdout)]

#[path = "data/recording.rs"]
mod recording;
#[path = "data/world.rs"]
mod world;

use std::error::Error;

use kurs::{AntennaArray, Attitude, Constraint, Engine, Outcome, Settings};

pub(crate) fn main() -> Result<(), Box<dyn Error>> {
    let (heading_rad, pitch_rad, roll_rad) =
        (40f64.to_radians(), 3f64.to_radians(), -8f64.to_radians());
    let truth = Attitude { heading_rad, pitch_rad, roll_rad };
    let antennas_m = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.8, 0.0]];
    let body = world::Motion::at_rest(truth, &antennas_m);
    let mut world = world::World::new()?;

    let settings = Settings {
        antennas: 3,
        array: Some(AntennaArray::new(body.antennas_m.clone())?),
        constraint: Constraint::Array,
        ..Settings::default()
    };
    let mut engine = Engine::new(settings, world.navigation.clone())?;
    let row = engine.push(&world.epoch(&body, 0.0));
    let Outcome::Fixed { attitude } = &row.outcome else {
        return Err(format!("{}: {:?}", row.status(), row.reason()).into());
    };
    let print = |what: &str, [heading, pitch, roll]: [f64; 3]| {
        println!("{what}  heading {heading:5.1}°  pitch {pitch:5.1}°  roll {roll:5.1}°");
    };
    let found = attitude.angles_rad().map(|angle| angle.unwrap_or(f64::NAN).to_degrees());
    print("found", found);
    print("true ", [heading_rad, pitch_rad, roll_rad].map(f64::to_degrees));
    let [heading, pitch, roll] =
        [0, 1, 2].map(|k| attitude.covariance_rad2[(k, k)].sqrt().to_degrees());
    println!("sd             {heading:.2}°         {pitch:.2}°        {roll:.2}°");
    Ok(())
}
