//! Heights of the geoid, m, at the places (latitude and longitude in degrees) on standard input,
//! line by line: `tests-referees/geoid_grid.py` compares them with other programs.
#![allow(clippy::print_stdout)] // an example

use std::io::BufRead as _;

use kurs::frames::Geodetic;
use kurs_formats::geoid::geoid_height_m;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    for line in std::io::stdin().lock().lines() {
        let line = line?;
        let (latitude, longitude) = line.split_once(' ').ok_or("two numbers are expected")?;
        let place = Geodetic::from_degrees(latitude.parse()?, longitude.parse()?, 0.0);
        println!("{:.3}", geoid_height_m(&place));
    }
    Ok(())
}
