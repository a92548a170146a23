//! The messages of ROS 2 of some rows, a line each: type, its hash, bytes of CDR, line for
//! rosbridge. `tests/profiles/check.py` reads both forms and compares them.
#![allow(clippy::print_stdout)] // an example

use std::fmt::Write as _;

use kurs::frames::{Attitude, Geodetic, Vector};
use kurs::solution::{
    AttitudeEstimate, EpochSolution, Outcome, PositionEstimate, PositionOrigin, Reason,
};
use kurs::time::GpsTime;
use kurs_formats::ros;
use nalgebra::Matrix3;

/// Heading, pitch, roll, degrees.
const ANGLES: [[f64; 3]; 4] =
    [[0.0, 5.0, 8.0], [90.0, -6.0, 10.0], [200.0, 4.0, -12.0], [359.9, -3.0, -7.0]];

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let time = GpsTime::from_week_tow(2305, 43_200.2).ok_or("no such time")?;
    let lost = EpochSolution::lost(time, Reason::NoEphemeris);
    for row in ANGLES.map(|angles| row(time, angles)).iter().chain([&lost]) {
        for message in ros::messages(row, false) {
            let mut bytes = String::new();
            for byte in message.cdr() {
                write!(bytes, "{byte:02x}")?;
            }
            let (kind, hash) = (message.topic.kind, message.topic.type_hash);
            print!("{kind}\t{hash}\t{bytes}\t{}", message.rosbridge());
        }
    }
    Ok(())
}

fn row(time: GpsTime, angles_deg: [f64; 3]) -> EpochSolution {
    let [heading_rad, pitch_rad, roll_rad] = angles_deg.map(f64::to_radians);
    let angles = Attitude { heading_rad, pitch_rad, roll_rad };
    let covariance = Matrix3::new(4e-6, 1e-6, 0.0, 1e-6, 9e-6, 2e-6, 0.0, 2e-6, 1.6e-5);
    let geodetic = Geodetic::from_degrees(-43.1, 131.9, 30.0);
    let mut row = EpochSolution::lost(time, Reason::Ratio);
    row.outcome =
        Outcome::Fixed { attitude: AttitudeEstimate::full(angles.ned_from_body(), &covariance) };
    row.satellites = 14;
    row.position = Some(PositionEstimate {
        antenna: None,
        geodetic,
        position_m: geodetic.to_ecef(),
        covariance_m2: Matrix3::new(4.0, 1.5, 0.5, 1.5, 5.0, 0.2, 0.5, 0.2, 9.0),
        velocity_mps: Some(Vector::new(3.0, 2.0, 0.1)),
        clock_m: None,
        hdop: Some(0.876),
        origin: PositionOrigin::StationPhase,
    });
    row
}
