//! Attitude from coordinates that receivers give themselves, without any observation.
//!
//! * `xᵢ`: coordinates of antenna `i`, each with its own standard deviation; `aᵢ`: its place on the body.
//! * Rotation and place of the body minimise `Σ (xᵢ − x − R aᵢ)ᵀ Wᵢ (xᵢ − x − R aᵢ)`.
//! * An antenna whose distances to the others contradict the known ones is left out.
//!
//! ```text
//! $ cargo run -p kurs --example 04_attitude_from_coordinates
//! heading 30.1° ± 0.3°, pitch 2.2° ± 0.6°, roll -1.2° ± 0.9°
//! ```
#![allow(clippy::print_stdout)]

use std::error::Error;

use kurs::orientation::{AntennaFix, Method, Orienter, OrienterSettings, PositionEpoch};
use kurs::{AntennaArray, Attitude, Geodetic, GpsTime, Outcome, Vector};

pub(crate) fn main() -> Result<(), Box<dyn Error>> {
    let array = AntennaArray::new(vec![
        Vector::new(0.0, 0.0, 0.0),
        Vector::new(4.0, 0.0, 0.0),
        Vector::new(0.0, 2.0, 0.0),
        Vector::new(4.0, 2.0, 0.0),
    ])?;
    let (heading_rad, pitch_rad, roll_rad) =
        (30f64.to_radians(), 2f64.to_radians(), -1f64.to_radians());
    let truth = Attitude { heading_rad, pitch_rad, roll_rad };
    let place = Geodetic::from_degrees(60.0, 30.0, 20.0);

    // Coordinates with errors of a centimetre or two: north, east, down.
    let errors_m = [
        [0.008, -0.004, 0.011],
        [-0.006, 0.009, -0.013],
        [0.003, 0.007, 0.016],
        [-0.005, -0.01, -0.009],
    ];
    let measured = array.positions_m().iter().zip(errors_m).map(|(arm_m, [north, east, down])| {
        let off_m = truth.ned_from_body() * *arm_m + Vector::new(north, east, down);
        Some(AntennaFix {
            position_m: place.to_ecef() + place.ecef_from_ned() * off_m,
            sd_ned_m: [0.01, 0.01, 0.02],
            doubt: None,
        })
    });
    let time = GpsTime::from_week_tow(2320, 0.0).ok_or("no such time")?;
    let epoch = PositionEpoch { time, antennas: measured.collect() };

    let orienter = Orienter::new(OrienterSettings {
        array,
        array_sd_m: 0.002,
        sd_scale: 1.0,
        method: Method::Weighted,
        max_tilt_rad: core::f64::consts::FRAC_PI_2,
        roll_sd_rad: 5f64.to_radians(),
        max_angle_sd_rad: 5f64.to_radians(),
        points_m: Vec::new(),
    })?;
    let row = orienter.push(&epoch, &mut orienter.memory());
    let Outcome::Fixed { attitude } = &row.outcome else {
        return Err(format!("{}: {:?}", row.status(), row.reason()).into());
    };
    let text = ["heading", "pitch", "roll"].iter().zip(attitude.angles_rad()).enumerate();
    let text = text.map(|(k, (name, angle))| {
        let angle_deg = angle.unwrap_or(f64::NAN).to_degrees();
        let sd_deg = attitude.covariance_rad2[(k, k)].sqrt().to_degrees();
        format!("{name} {angle_deg:.1}° ± {sd_deg:.1}°")
    });
    println!("{}", text.collect::<Vec<_>>().join(", "));
    Ok(())
}
