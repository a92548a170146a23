//! The heading of two antennas on a body, from one epoch of what their receivers measured.
//!
//! * `b`: vector from the first antenna to the second, its length is known to a few millimetres.
//! * Between the antennas (single difference) the satellites' clocks and the atmosphere cancel, between satellites
//!   (double difference) the receivers' clocks: `λ Φ = −(u − u₀)·b + λ N + e` with whole numbers `N`.
//! * With `N` found, `b` is known to millimetres; heading is `atan2(b_east, b_north)`.
//!
//! ```text
//! $ cargo run -p kurs --example 01_first_heading
//! heading 193.2° ± 0.4°, pitch 0.4° ± 0.5°, from 15 satellites
//! ```
#![allow(clippy::print_stdout)]

#[path = "data/recording.rs"]
mod recording;

use std::error::Error;

use kurs::{AntennaArray, Constraint, Engine, Outcome, Settings, Vector};

pub(crate) fn main() -> Result<(), Box<dyn Error>> {
    let navigation = recording::navigation(&recording::orbits()?)?;
    let ends = vec![Vector::new(0.0, 0.0, 0.0), Vector::new(recording::LENGTH_M, 0.0, 0.0)];
    let settings = Settings {
        antennas: 2,
        array: Some(AntennaArray::new(ends)?),
        constraint: Constraint::Length,
        array_sd_m: 0.005,
        bands: Some(vec!["G1".parse()?, "E1".parse()?]),
        ..Settings::default()
    };
    let mut engine = Engine::new(settings, navigation)?;

    let row = engine.push(&recording::epochs()?[0]);
    let Outcome::Fixed { attitude } = &row.outcome else {
        return Err(format!("{}: {:?}", row.status(), row.reason()).into());
    };
    let sd_deg = |k: usize| attitude.covariance_rad2[(k, k)].sqrt().to_degrees();
    let (heading, pitch) =
        (attitude.heading_rad.ok_or("no heading")?, attitude.pitch_rad.ok_or("no pitch")?);
    println!(
        "heading {:.1}° ± {:.1}°, pitch {:.1}° ± {:.1}°, from {} satellites",
        heading.to_degrees(),
        sd_deg(0),
        pitch.to_degrees(),
        sd_deg(1),
        row.satellites
    );
    Ok(())
}
