//! How accurate an array will be, before anybody drills a hole: three antennas, the third one closer or farther.
//!
//! With the integers found, the baselines from the first antenna have the covariance `(I + 11ᵀ) ⊗ (N⁻¹ + s² I)`, where
//! `N` follows from the directions to the satellites and the noise of the phases alone, and `s` is how well the
//! antennas were surveyed. How often one epoch finds its integers follows from code and phases of one baseline.
//!
//! ```text
//! $ cargo run -p kurs --example 05_plan_an_array
//! integers of one baseline and epoch: 100.00 % right
//! width 0.3 m: heading 0.21°, pitch 0.39°, roll 1.12°
//! width 0.6 m: heading 0.19°, pitch 0.39°, roll 0.56°
//! width 1.2 m: heading 0.14°, pitch 0.39°, roll 0.28°
//! ```
#![allow(clippy::print_stdout)]

#[path = "data/recording.rs"]
mod recording;

use std::error::Error;

use kurs::engine::Settings;
use kurs::prediction::{Sight, attitude_accuracy, baseline_success_rate};
use kurs::sky::{Horizon, View};
use kurs::{AntennaArray, Attitude, Band, Geodetic, GpsTime, System, Vector};

pub(crate) fn main() -> Result<(), Box<dyn Error>> {
    let sights = sky(Geodetic::from_degrees(35.1347, 136.9776, 104.0), 15f64.to_radians())?;
    let rate = baseline_success_rate(&sights).ok_or("too few satellites")?;
    println!("integers of one baseline and epoch: {:.2} % right", 100.0 * rate);

    let level = Attitude { heading_rad: 0.0, pitch_rad: 0.0, roll_rad: 0.0 };
    for width_m in [0.3, 0.6, 1.2] {
        let array = AntennaArray::new(vec![
            Vector::new(0.0, 0.0, 0.0),
            Vector::new(1.0, 0.0, 0.0),
            Vector::new(0.5, width_m, 0.0),
        ])?;
        // The antennas are where the tape measure has them to 2 mm.
        let settings = Settings { antennas: 3, array: Some(array), ..Settings::default() };
        let accuracy = attitude_accuracy(&settings, &level, &sights).ok_or("too few satellites")?;
        let [heading_deg, pitch_deg, roll_deg] =
            [accuracy.heading_sd_rad, accuracy.pitch_sd_rad, accuracy.roll_sd_rad]
                .map(|sd_rad| sd_rad.map(f64::to_degrees).ok_or("antennas on one line"));
        println!(
            "width {width_m} m: heading {:.2}°, pitch {:.2}°, roll {:.2}°",
            heading_deg?, pitch_deg?, roll_deg?
        );
    }
    Ok(())
}

/// The satellites above the mask, on L1 and E1.
fn sky(place: Geodetic, mask_rad: f64) -> Result<Vec<Sight>, Box<dyn Error>> {
    let horizon = Horizon::at(place.to_ecef());
    let orbits = recording::orbits()?;
    let navigation = recording::navigation(&orbits)?;
    let time = GpsTime::from_week_tow(recording::WEEK, 116_400.0).ok_or("no such time")?;
    let mut sights = Vec::new();
    for elements in &orbits {
        let system = elements.satellite.system;
        let band = Band::new(if system == System::Gps { System::Gps } else { System::Galileo }, 1);
        let state = navigation.ephemerides.state(elements.satellite, time)?;
        let view = View::new(&state, place.to_ecef());
        let elevation_rad = horizon.direction(view.line_of_sight).elevation_rad();
        if elevation_rad > mask_rad {
            sights.push(Sight {
                satellite: elements.satellite,
                direction: horizon.ned_from_ecef() * view.line_of_sight,
                band,
                wavelength_m: band.wavelength_m(None).ok_or("a band without a frequency")?,
                code_sd_m: 0.3 / elevation_rad.sin(),
                phase_sd_m: 0.002 / elevation_rad.sin(),
            });
        }
    }
    Ok(sights)
}
