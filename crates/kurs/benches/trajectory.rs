//! Speed of trajectory points on one core: `cargo bench -p kurs --bench trajectory`.
//!
//! Every item is one point from four angles (or three ranges), with all of its trigonometry.
#![allow(clippy::print_stdout, clippy::unwrap_used)]

use divan::counter::ItemsCount;
use divan::{Bencher, black_box};
use kurs::frames::{Ecef, Geodetic, Vector};
use kurs::trajectory::accuracy::error_free;
use kurs::trajectory::least_squares::solve;
use kurs::trajectory::measurement::{Measurement, Quantity};
use kurs::trajectory::minimal_set::MinimalSet;
use kurs::trajectory::problem::Problem;
use kurs::trajectory::station::Station;

const POINTS: usize = 1000;

fn main() {
    divan::main();
}

fn stations() -> [Station; 3] {
    [(65.508_851_757, 41.386_914_958, 150.0), (64.5, 40.5, 100.0), (65.2, 38.0, 900.0)].map(
        |(latitude, longitude, height)| {
            Station::at(&Geodetic::from_degrees(latitude, longitude, height))
        },
    )
}

/// Measurements of a thousand points, each with an error of half a standard deviation and more.
fn points(kinds: &[(usize, Quantity, f64)]) -> Vec<Vec<Measurement>> {
    let stations = stations();
    let object = |k: usize| -> Vector<Ecef> {
        let along = k as f64 / POINTS as f64;
        Geodetic::from_degrees(64.5, 36.0 + 4.0 * along, 50e3 - 45e3 * along).to_ecef()
    };
    let blank: Vec<Measurement> = kinds
        .iter()
        .map(|&(station, quantity, sigma)| Measurement { station, quantity, value: 0.0, sigma })
        .collect();
    (0..POINTS)
        .map(|k| {
            let mut measured = error_free(&Problem::new(&stations, &blank).unwrap(), object(k));
            for (index, measurement) in measured.iter_mut().enumerate() {
                measurement.value += measurement.sigma * ((7 * k + 3 * index) as f64).sin();
            }
            measured
        })
        .collect()
}

const SIGMA_RAD: f64 = 4.85e-5;
const FOUR_ANGLES: [(usize, Quantity, f64); 4] = [
    (0, Quantity::Azimuth, SIGMA_RAD),
    (0, Quantity::Elevation, SIGMA_RAD),
    (1, Quantity::Azimuth, SIGMA_RAD),
    (1, Quantity::Elevation, SIGMA_RAD),
];
const THREE_ANGLES: [(usize, Quantity, f64); 3] = [FOUR_ANGLES[0], FOUR_ANGLES[1], FOUR_ANGLES[3]];
const THREE_RANGES: [(usize, Quantity, f64); 3] =
    [(0, Quantity::Range, 5.0), (1, Quantity::Range, 5.0), (2, Quantity::Range, 5.0)];

#[divan::bench(args = ["A4", "A3g", "R3"])]
fn closed_form(bencher: Bencher, set: &str) {
    let kinds: &[_] = match set {
        "A4" => &FOUR_ANGLES,
        "A3g" => &THREE_ANGLES,
        _ => &THREE_RANGES,
    };
    let (stations, points) = (stations(), points(kinds));
    bencher.counter(ItemsCount::new(POINTS)).bench(|| {
        for measurements in &points {
            let problem = Problem::new(&stations, black_box(measurements)).unwrap();
            let set = MinimalSet::find(&problem).next().unwrap();
            black_box(set.roots(&problem).unwrap());
        }
    });
}

#[divan::bench]
fn least_squares_of_four_angles(bencher: Bencher) {
    let (stations, points) = (stations(), points(&FOUR_ANGLES));
    bencher.counter(ItemsCount::new(POINTS)).bench(|| {
        for measurements in &points {
            let problem = Problem::new(&stations, black_box(measurements)).unwrap();
            black_box(solve(&problem, None).unwrap());
        }
    });
}
