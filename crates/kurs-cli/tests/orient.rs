//! `kurs orient` on simulated coordinates: honest, finds displaced antennas, estimates the array.
#![allow(clippy::unwrap_used)]

use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use assert_cmd::Command;
use kurs::frames::{Attitude, Geodetic, Vector};
use nalgebra::{Matrix3, Vector3};
use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use rand_xoshiro::Xoshiro256PlusPlus;

/// A square of 0.8 m.
const CORNERS: [[f64; 3]; 4] = [[0.0, 0.0, 0.0], [0.8, 0.0, 0.0], [0.0, 0.8, 0.0], [0.8, 0.8, 0.0]];
const SD_NED_M: [f64; 3] = [0.01, 0.01, 0.02];
const DISPLACED_EVERY: usize = 50;
const DISPLACED_BY_M: f64 = 0.3;

const STATUS: usize = 3;
const ANTENNAS: usize = 5;
const ANGLES: usize = 8;

/// What was put in.
struct Truth {
    attitude: Attitude,
    is_displaced: bool,
}

/// Coordinates of a turning body: one epoch in fifty has a displaced antenna; of four antennas the
/// last is missing a third of the time.
fn simulate(antennas: usize, epochs: usize, seed: u64) -> (String, Vec<Truth>) {
    let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
    let here = Geodetic::from_degrees(55.75, 37.62, 200.0);
    let mut text = "gps_week,tow_s,name,x_m,y_m,z_m,sd_north_m,sd_east_m,sd_down_m\n".to_owned();
    let mut truths = Vec::new();
    for epoch in 0..epochs {
        let tow_s = 0.1 * epoch as f64;
        let attitude = Attitude {
            heading_rad: (0.05 * tow_s).rem_euclid(core::f64::consts::TAU),
            pitch_rad: 0.2 * (tow_s / 7.0).sin(),
            roll_rad: 0.15 * (tow_s / 5.0).sin(),
        };
        let present = if antennas == 4 && epoch % 3 == 0 { 3 } else { antennas };
        let displaced = (epoch % DISPLACED_EVERY == 7).then(|| random.random_range(0..present));
        for antenna in 0..present {
            let body = Vector::from_xyz(Vector3::from(CORNERS[antenna]));
            let mut normals =
                || -> Vector3<f64> { Vector3::from_fn(|_, _| StandardNormal.sample(&mut random)) };
            let mut error = normals().component_mul(&Vector3::from(SD_NED_M));
            if displaced == Some(antenna) {
                error += DISPLACED_BY_M * normals().normalize();
            }
            let ned = attitude.ned_from_body() * body + Vector::from_xyz(error);
            let p = (here.to_ecef() + here.ecef_from_ned() * ned).xyz();
            let [north, east, down] = SD_NED_M;
            writeln!(
                text,
                "2300,{tow_s:.1},A{antenna},{:.4},{:.4},{:.4},{north},{east},{down}",
                p.x, p.y, p.z
            )
            .unwrap();
        }
        truths.push(Truth { attitude, is_displaced: displaced.is_some() });
    }
    (text, truths)
}

fn configuration(antennas: usize, with_positions: bool) -> String {
    (0..antennas).fold(String::new(), |mut text, antenna| {
        writeln!(text, "[[antenna]]\nname = \"A{antenna}\"").unwrap();
        if with_positions {
            writeln!(text, "position_m = {:?}", CORNERS[antenna]).unwrap();
        }
        text
    })
}

fn kurs(folder: &Path, arguments: &[&str]) -> assert_cmd::assert::Assert {
    Command::cargo_bin("kurs").unwrap().current_dir(folder).args(arguments).assert()
}

/// Runs the command in `folder` and gives the rows of `attitude.csv`.
fn orient(folder: &Path, config: &str, positions: &str) -> Vec<csv::StringRecord> {
    fs::write(folder.join("config.toml"), config).unwrap();
    fs::write(folder.join("positions.csv"), positions).unwrap();
    kurs(folder, &["orient", "config.toml", "positions.csv", "--quiet"]).success();
    let mut reader = csv::Reader::from_path(folder.join("kurs-out/attitude.csv")).unwrap();
    let columns = reader.headers().unwrap();
    let places = [(STATUS, "status"), (ANTENNAS, "antennas"), (ANGLES, "heading_deg")];
    assert!(places.iter().all(|(place, name)| &columns[*place] == *name), "{columns:?}");
    reader.records().map(Result::unwrap).collect()
}

fn number(row: &csv::StringRecord, column: usize) -> f64 {
    row[column].parse().unwrap()
}

fn is_fixed(row: &csv::StringRecord) -> bool {
    &row[STATUS] == "fixed"
}

/// Error of the angles and their stated covariance, degrees.
fn error_and_covariance(row: &csv::StringRecord, truth: &Attitude) -> (Vector3<f64>, Matrix3<f64>) {
    let wanted = Vector3::new(truth.heading_rad, truth.pitch_rad, truth.roll_rad);
    let error = Vector3::from_fn(|i, _| {
        let difference = number(row, ANGLES + i) - wanted[i].to_degrees();
        (difference + 180.0).rem_euclid(360.0) - 180.0
    });
    let [h, p, r] = [3, 4, 5].map(|i| number(row, ANGLES + i).powi(2));
    let [hp, hr, pr] = [6, 7, 8].map(|i| number(row, ANGLES + i));
    (error, Matrix3::new(h, hp, hr, hp, p, pr, hr, pr, r))
}

#[test]
fn four_antennas_are_honest_and_find_the_displaced_one() {
    let folder = tempfile::tempdir().unwrap();
    let (positions, truths) = simulate(4, 6000, 1);
    let rows = orient(folder.path(), &configuration(4, true), &positions);
    assert_eq!(rows.len(), truths.len());

    let (mut nees, mut squares, mut variances, mut count) = (0.0, 0.0, 0.0, 0.0);
    let (mut displaced, mut missed) = (0, 0);
    for (epoch, (row, truth)) in rows.iter().zip(&truths).enumerate() {
        if truth.is_displaced {
            // With three antennas the undetectable share is another test's.
            let is_whole = epoch % 3 != 0;
            displaced += usize::from(is_whole);
            missed += usize::from(is_whole && is_fixed(row) && number(row, ANTENNAS) > 3.5);
        } else if is_fixed(row) {
            let (error, covariance) = error_and_covariance(row, &truth.attitude);
            nees += error.dot(&(covariance.try_inverse().unwrap() * error));
            squares += error.norm_squared();
            variances += covariance.trace();
            count += 1.0;
        }
    }
    // χ² of 3 for each epoch: 99.9 % band ±3.29 √(6/n)
    assert!((nees / count - 3.0).abs() < 3.29 * (6.0_f64 / count).sqrt(), "{}", nees / count);
    let ratio = (squares / variances).sqrt();
    assert!((ratio - 1.0).abs() < 0.05, "rms is {ratio} of the bound");
    assert!(displaced >= 70 && missed * 100 <= displaced, "{missed} of {displaced} missed");
    assert!(count >= 0.999 * (6000.0 - 120.0), "{count} epochs without displacement are fixed");
}

/// Across the plane of three antennas a displacement looks like a tilt: about three in a hundred pass
/// (`docs/reference/orient.md`).
#[test]
fn three_antennas_refuse_what_shows() {
    let folder = tempfile::tempdir().unwrap();
    let (positions, truths) = simulate(3, 6000, 2);
    let rows = orient(folder.path(), &configuration(3, true), &positions);
    let displaced = rows.iter().zip(&truths).filter(|(_, truth)| truth.is_displaced);
    let passed = displaced.filter(|(row, _)| is_fixed(row)).count();
    assert!(passed <= 12, "{passed} of 120 pass");
}

#[test]
fn the_array_is_estimated_from_the_data() {
    let folder = tempfile::tempdir().unwrap();
    let (positions, truths) = simulate(4, 6000, 3);
    let rows = orient(folder.path(), &configuration(4, false), &positions);
    let text = fs::read_to_string(folder.path().join("kurs-out/array.toml")).unwrap();
    let array: toml::Table = text.parse().unwrap();
    for (antenna, corner) in array["antenna"].as_array().unwrap().iter().zip(CORNERS) {
        for (found, wanted) in antenna["position_m"].as_array().unwrap().iter().zip(corner) {
            let error = found.as_float().unwrap() - wanted;
            assert!(error.abs() < 0.002, "{antenna} is {error} m off");
        }
    }
    let whole =
        rows.iter().zip(&truths).filter(|(row, truth)| is_fixed(row) && !truth.is_displaced);
    let squares: Vec<f64> = whole
        .map(|(row, truth)| error_and_covariance(row, &truth.attitude).0.norm_squared())
        .collect();
    assert!(squares.len() > 5800, "{} rows", squares.len());
    let rms_deg = (squares.iter().sum::<f64>() / squares.len() as f64).sqrt();
    assert!((1.0..3.5).contains(&rms_deg), "{rms_deg}");
}

#[test]
fn the_published_method_wants_an_acute_triangle() {
    let folder = tempfile::tempdir().unwrap();
    let (positions, _) = simulate(3, 50, 4);
    fs::write(folder.path().join("config.toml"), configuration(3, true)).unwrap();
    fs::write(folder.path().join("positions.csv"), positions).unwrap();
    let arguments = ["orient", "config.toml", "positions.csv", "--method", "three-point"];
    let run = kurs(folder.path(), &arguments).code(2);
    let message = String::from_utf8_lossy(&run.get_output().stderr).into_owned();
    assert!(message.contains("not acute") && message.contains("weighted"), "{message}");
}

#[test]
fn wrong_input_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| fs::write(folder.path().join(name), text).unwrap();
    write("good.csv", &simulate(3, 20, 5).0);
    write("empty.csv", "");
    write("header.csv", "time,name\n1,A0\n");
    let array = configuration(3, true);
    write("three.toml", &array);
    write("some.toml", &array.replacen("position_m = [0.0, 0.0, 0.0]", "", 1));
    write("unknown.toml", &format!("{array}[orient]\nmatch_window = 1.0\n"));
    for (config, positions, code, word) in [
        ("three.toml", "empty.csv", 1, "empty"),
        ("three.toml", "header.csv", 1, "gps_week"),
        ("three.toml", "absent.csv", 1, "absent.csv"),
        ("some.toml", "good.csv", 2, "2 of 3 antennas"),
        ("unknown.toml", "good.csv", 2, "match_window_s"),
    ] {
        let run = kurs(folder.path(), &["orient", config, positions]).code(code);
        let message = String::from_utf8_lossy(&run.get_output().stderr).into_owned();
        assert!(message.contains(word), "{config} {positions}: {message}");
        assert!(!folder.path().join("kurs-out/attitude.csv").exists());
    }
}
