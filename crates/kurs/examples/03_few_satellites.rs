//! What the known array is worth when few satellites are in view: eight of GPS and Galileo, one band.
//!
//! Without geometry each baseline has three unknowns and as many whole numbers as double differences; the integers
//! of one epoch are then a guess. The array leaves three unknowns for all baselines together, so that the
//! same phases decide between the integers.
//!
//! ```text
//! $ cargo run -p kurs --example 03_few_satellites
//! nothing known:    fixed in  0 of 20 epochs
//! array known:      fixed in 14 of 20 epochs
//! ```
#![allow(clippy::print_stdout)]

#[path = "data/recording.rs"]
mod recording;
#[path = "data/world.rs"]
mod world;

use std::error::Error;

use kurs::{AntennaArray, Attitude, Constraint, Engine, Settings};

/// Epochs of the comparison, a second apart.
const EPOCHS: u32 = 20;
/// Satellites in view.
const SATELLITES: usize = 8;

pub(crate) fn main() -> Result<(), Box<dyn Error>> {
    let free = fixes(Constraint::None)?;
    let known = fixes(Constraint::Array)?;
    println!("nothing known:    fixed in {free:2} of {EPOCHS} epochs");
    println!("array known:      fixed in {known:2} of {EPOCHS} epochs");
    if known <= free { Err("the array is of no use".into()) } else { Ok(()) }
}

/// How many epochs are fixed with this much known of the geometry.
fn fixes(constraint: Constraint) -> Result<usize, Box<dyn Error>> {
    let attitude = Attitude { heading_rad: 1.0, pitch_rad: 0.05, roll_rad: -0.05 };
    let antennas_m = [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 1.5, 0.0], [2.0, 1.5, 0.0]];
    let body = world::Motion::at_rest(attitude, &antennas_m);
    let mut world = world::World::new()?;
    let settings = Settings {
        antennas: antennas_m.len(),
        array: Some(AntennaArray::new(body.antennas_m.clone())?),
        constraint,
        ..Settings::default()
    };
    let mut engine = Engine::new(settings, world.navigation.clone())?;
    let mut fixed = 0;
    for second in 0..EPOCHS {
        let mut epoch = world.epoch(&body, f64::from(second));
        for antenna in epoch.antennas.iter_mut().flatten() {
            // One signal of each satellite, of the two systems in turn.
            antenna.observations.sort_by_key(|o| (o.satellite.number % 7, o.satellite));
            antenna.observations.truncate(SATELLITES);
        }
        fixed += usize::from(engine.push(&epoch).is_fixed());
    }
    Ok(fixed)
}
