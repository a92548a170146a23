//! Simulated coordinates of a turning body, as tables and as NMEA logs.

use std::fmt::Write as _;

use kurs::frames::{Attitude, Body, Ecef, Geodetic, Vector};
use kurs::time::GpsTime;
use nalgebra::{Matrix3, Vector3};
use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use rand_xoshiro::Xoshiro256PlusPlus;

/// A square of 0.8 m.
pub(crate) const SQUARE: [[f64; 3]; 4] =
    [[0.0, 0.0, 0.0], [0.8, 0.0, 0.0], [0.0, 0.8, 0.0], [0.8, 0.8, 0.0]];
/// An acute triangle of about 0.8 m.
pub(crate) const TRIANGLE: [[f64; 3]; 3] = [[0.0, 0.0, 0.0], [0.8, 0.1, 0.0], [0.3, 0.8, 0.05]];
pub(crate) const SD_NED_M: [f64; 3] = [0.01, 0.01, 0.02];
const DISPLACED_EVERY: usize = 50;
const DISPLACED_BY_M: f64 = 0.3;
const INTERVAL_S: f64 = 0.1;

/// Coordinates of some antennas and what they were made from.
pub(crate) struct Simulation {
    /// The antennas in body axes.
    pub(crate) array: Vec<[f64; 3]>,
    /// Antennas that are there at each epoch, with their coordinates.
    pub(crate) epochs: Vec<Vec<(usize, Vector<Ecef>)>>,
    /// The truth of each epoch.
    pub(crate) truths: Vec<Truth>,
}

/// What was put in.
pub(crate) struct Truth {
    pub(crate) attitude: Attitude,
    /// The antenna that is displaced.
    pub(crate) displaced: Option<usize>,
    /// Whether all antennas are there.
    pub(crate) is_whole: bool,
}

/// A turning body: one epoch in fifty has a displaced antenna; of four antennas the last is missing
/// a third of the time.
pub(crate) fn simulate(array: &[[f64; 3]], epochs: usize, seed: u64) -> Simulation {
    let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
    let here = Geodetic::from_degrees(55.75, 37.62, 200.0);
    let (origin, ecef_from_ned) = (here.to_ecef(), here.ecef_from_ned());
    let mut simulation =
        Simulation { array: array.to_vec(), epochs: Vec::new(), truths: Vec::new() };
    for epoch in 0..epochs {
        let after_s = INTERVAL_S * epoch as f64;
        let attitude = Attitude {
            heading_rad: (0.05 * after_s).rem_euclid(core::f64::consts::TAU),
            pitch_rad: 0.2 * (after_s / 7.0).sin(),
            roll_rad: 0.15 * (after_s / 5.0).sin(),
        };
        let is_whole = array.len() < 4 || epoch % 3 != 0;
        let present = if is_whole { array.len() } else { array.len() - 1 };
        let displaced = (epoch % DISPLACED_EVERY == 7).then(|| random.random_range(0..present));
        let places = (0..present).map(|antenna| {
            let mut normals =
                || -> Vector3<f64> { Vector3::from_fn(|_, _| StandardNormal.sample(&mut random)) };
            let mut error = normals().component_mul(&Vector3::from(SD_NED_M));
            if displaced == Some(antenna) {
                error += DISPLACED_BY_M * normals().normalize();
            }
            let body = Vector::<Body>::from_xyz(Vector3::from(array[antenna]));
            let ned = attitude.ned_from_body() * body + Vector::from_xyz(error);
            (antenna, origin + ecef_from_ned * ned)
        });
        simulation.epochs.push(places.collect());
        simulation.truths.push(Truth { attitude, displaced, is_whole });
    }
    simulation
}

impl Simulation {
    /// The configuration, with or without the places of the antennas on the body.
    pub(crate) fn configuration(&self, with_positions: bool) -> String {
        let mut text = String::new();
        for (antenna, position) in self.array.iter().enumerate() {
            writeln!(text, "[[antenna]]\nname = \"A{antenna}\"").unwrap();
            if with_positions {
                writeln!(text, "position_m = {position:?}").unwrap();
            }
        }
        text
    }

    /// One table of all antennas.
    pub(crate) fn table(&self) -> String {
        let [north, east, down] = SD_NED_M;
        let mut text =
            "gps_week,tow_s,name,x_m,y_m,z_m,sd_north_m,sd_east_m,sd_down_m\n".to_owned();
        for (epoch, places) in self.epochs.iter().enumerate() {
            let tow_s = INTERVAL_S * epoch as f64;
            for (antenna, place) in places {
                let p = place.xyz();
                writeln!(
                    text,
                    "2300,{tow_s:.1},A{antenna},{:.4},{:.4},{:.4},{north},{east},{down}",
                    p.x, p.y, p.z
                )
                .unwrap();
            }
        }
        text
    }

    /// The log of one antenna, its sentences from `start` (UTC) on; GGA, RMC, and GST where
    /// `states_sd`.
    pub(crate) fn nmea(&self, antenna: usize, start: GpsTime, states_sd: bool) -> String {
        let mut text = String::new();
        for (epoch, places) in self.epochs.iter().enumerate() {
            let Some((_, place)) = places.iter().find(|(present, _)| *present == antenna) else {
                continue;
            };
            let utc = (start + INTERVAL_S * epoch as f64).utc();
            let clock = format!("{:02}{:02}{:05.2}", utc.hour, utc.minute, utc.second);
            let date = format!("{:02}{:02}{:02}", utc.day, utc.month, utc.year % 100);
            let at = Geodetic::from_ecef(*place);
            let (latitude, longitude) =
                (at.latitude_rad.to_degrees(), at.longitude_rad.to_degrees());
            let minutes = |degrees: f64| 60.0 * degrees.fract();
            let latitude = format!("{:02.0}{:010.7}", latitude.floor(), minutes(latitude));
            let longitude = format!("{:03.0}{:010.7}", longitude.floor(), minutes(longitude));
            sentence(
                &mut text,
                &format!(
                    "GNGGA,{clock},{latitude},N,{longitude},E,4,18,0.6,{:.4},M,14.0,M,1.0,0001",
                    at.height_m - 14.0
                ),
            );
            let [north, east, down] = SD_NED_M;
            if states_sd {
                sentence(&mut text, &format!("GNGST,{clock},0.02,,,,{north},{east},{down}"));
            }
            sentence(
                &mut text,
                &format!("GNRMC,{clock},A,{latitude},N,{longitude},E,0.0,0.0,{date},,,R"),
            );
        }
        text
    }
}

/// Adds a sentence with its checksum.
pub(crate) fn sentence(text: &mut String, body: &str) {
    let checksum = body.bytes().fold(0, |sum, byte| sum ^ byte);
    write!(text, "${body}*{checksum:02X}\r\n").unwrap();
}

/// The smallest covariance that any unbiased attitude can have (Cramér and Rao), rad², body axes:
/// `(Σ [p − p̄]×ᵀ Qᵀ W Q [p − p̄]×)⁻¹`.
pub(crate) fn bound(array: &[[f64; 3]], attitude: &Attitude) -> Matrix3<f64> {
    let positions: Vec<Vector3<f64>> = array.iter().map(|p| Vector3::from(*p)).collect();
    let centroid = positions.iter().sum::<Vector3<f64>>() / positions.len() as f64;
    let weight = Matrix3::from_diagonal(&Vector3::from(SD_NED_M).map(|sd| 1.0 / (sd * sd)));
    let rotation = attitude.ned_from_body().matrix();
    let information: Matrix3<f64> = positions
        .iter()
        .map(|p| rotation * (p - centroid).cross_matrix())
        .map(|lever| lever.transpose() * weight * lever)
        .sum();
    information.try_inverse().unwrap()
}
