//! `kurs orient` on simulated coordinates: honest, finds displaced antennas, estimates the array.
//!
//! `cargo test --release -p kurs-cli --test commands orient -- --ignored --nocapture` measures
//! every figure on 100 000 epochs, the speed among them.
#![allow(clippy::unwrap_used, clippy::print_stdout)]

mod figures;
mod logs;
mod simulation;

use std::fs;
use std::path::Path;
use std::time::Instant;

use assert_cmd::Command;
use figures::{COLUMNS, Figures, is_fixed};
use kurs::frames::Attitude;
use kurs::time::{Calendar, GpsTime};
use simulation::{SQUARE, Simulation, TRIANGLE, simulate};

/// What an estimated antenna may be off, m.
const GEOMETRY_M: f64 = 0.002;

fn kurs(folder: &Path, arguments: &[&str]) -> assert_cmd::assert::Assert {
    Command::cargo_bin("kurs").unwrap().current_dir(folder).args(arguments).assert()
}

/// Writes a configuration and a table of coordinates.
fn write(folder: &Path, simulation: &Simulation, with_positions: bool) {
    fs::write(folder.join("config.toml"), simulation.configuration(with_positions)).unwrap();
    fs::write(folder.join("positions.csv"), simulation.table()).unwrap();
}

/// The rows of `attitude.csv`.
fn rows(folder: &Path) -> Vec<csv::StringRecord> {
    let mut reader = csv::Reader::from_path(folder.join("kurs-out/orient/attitude.csv")).unwrap();
    let columns = reader.headers().unwrap();
    assert!(COLUMNS.iter().all(|(place, name)| &columns[*place] == *name), "{columns:?}");
    reader.records().map(Result::unwrap).collect()
}

/// Runs the command on a table of these coordinates.
fn orient(folder: &Path, simulation: &Simulation, options: &[&str]) -> Vec<csv::StringRecord> {
    write(folder, simulation, true);
    let arguments = [&["orient", "config.toml", "positions.csv", "--quiet"], options].concat();
    kurs(folder, &arguments).success();
    rows(folder)
}

/// Runs the command without positions on the body; the largest error of an antenna, m.
fn estimate_geometry(folder: &Path, simulation: &Simulation) -> f64 {
    write(folder, simulation, false);
    kurs(folder, &["orient", "config.toml", "positions.csv", "--quiet"]).success();
    let text = fs::read_to_string(folder.join("kurs-out/orient/array.toml")).unwrap();
    let array: toml::Table = text.parse().unwrap();
    let found = array["antenna"].as_array().unwrap().iter();
    let components = found.zip(&simulation.array).flat_map(|(antenna, wanted)| {
        let found = antenna["position_m"].as_array().unwrap().clone();
        found.into_iter().zip(wanted).map(|(f, w)| (f.as_float().unwrap() - w).abs())
    });
    components.fold(0.0, f64::max)
}

#[test]
fn four_antennas_are_honest_and_find_the_displaced_one() {
    let folder = tempfile::tempdir().unwrap();
    let simulation = simulate(&SQUARE, 6000, 1);
    let figures = Figures::of(&orient(folder.path(), &simulation, &[]), &simulation);
    figures.check();
    assert!(figures.displaced >= 70 && figures.missed_share() <= 0.01, "{figures:?}");
}

/// Across the plane of three antennas a displacement looks like a tilt: some in a hundred pass
/// (`docs/reference/orient.md`).
#[test]
fn three_antennas_refuse_what_shows() {
    let folder = tempfile::tempdir().unwrap();
    let simulation = simulate(&SQUARE[..3], 6000, 2);
    let rows = orient(folder.path(), &simulation, &[]);
    let figures = Figures::of(&rows, &simulation);
    figures.check();
    let displaced = rows.iter().zip(&simulation.truths).filter(|(_, t)| t.displaced.is_some());
    let passed = displaced.filter(|(row, _)| is_fixed(row)).count();
    assert!(figures.displaced == 120 && passed <= 12, "{passed} of 120 pass");
}

#[test]
fn the_array_is_estimated_from_the_data() {
    let folder = tempfile::tempdir().unwrap();
    let simulation = simulate(&SQUARE, 6000, 3);
    let error_m = estimate_geometry(folder.path(), &simulation);
    assert!(error_m < GEOMETRY_M, "{error_m}");
    let figures = Figures::of(&rows(folder.path()), &simulation);
    assert!((figures.rms_over_bound - 1.0).abs() < 0.05, "{figures:?}");
}

/// A number of every row, by the name of its column; `None` for an empty field.
fn column(folder: &Path, name: &str) -> Vec<Option<f64>> {
    let mut reader = csv::Reader::from_path(folder.join("kurs-out/orient/attitude.csv")).unwrap();
    let place = reader.headers().unwrap().iter().position(|found| found == name).unwrap();
    reader.records().map(|row| row.unwrap()[place].parse().ok()).collect()
}

/// Two antennas nearly abreast of a body that pitches by up to 11°: heading and roll, as good as
/// they say, and nothing of the pitch.
#[test]
fn a_pair_across_the_body_gives_heading_and_roll() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let simulation = simulate(&[[0.0, 0.0, 0.0], [0.3, 1.2, 0.0]], 3000, 5);
    write(folder, &simulation, true);
    let config = simulation.configuration(true) + "[orient]\nroll_sd_deg = 10.0\n";
    fs::write(folder.join("config.toml"), config).unwrap();
    kurs(folder, &["orient", "config.toml", "positions.csv", "--quiet"]).success();
    for absent in ["pitch_deg", "pitch_sd_deg", "qw"] {
        assert!(column(folder, absent).iter().all(Option::is_none), "{absent}");
    }
    assert!(column(folder, "line_elevation_deg").iter().flatten().count() > 2900);
    for (name, truth) in [
        ("heading", (|t: &Attitude| t.heading_rad) as fn(&Attitude) -> f64),
        ("roll", |t: &Attitude| t.roll_rad),
    ] {
        let angles = column(folder, &format!("{name}_deg"));
        let sds = column(folder, &format!("{name}_sd_deg"));
        let rows = angles.iter().zip(&sds).zip(&simulation.truths);
        let squares: Vec<f64> = rows
            .filter_map(|((angle, sd), known)| {
                let error = (angle.as_ref()?.to_radians() - truth(&known.attitude)).sin();
                known.displaced.is_none().then(|| (error.to_degrees() / sd.unwrap()).powi(2))
            })
            .collect();
        let mean = squares.iter().sum::<f64>() / squares.len() as f64;
        assert!(squares.len() > 2800 && (0.5..1.5).contains(&mean), "{name}: {mean}");
    }
}

/// The survey adds its own variance, the same in all rows, and the summary says it apart.
#[test]
fn the_survey_of_the_array_is_in_the_standard_deviations() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let simulation = simulate(&SQUARE, 200, 6);
    let variance = |array_sd_m: f64| {
        write(folder, &simulation, true);
        let key = format!("[orient]\narray_sd_m = {array_sd_m}\n");
        fs::write(folder.join("config.toml"), simulation.configuration(true) + &key).unwrap();
        kurs(folder, &["orient", "config.toml", "positions.csv", "--quiet"]).success();
        let summary = fs::read_to_string(folder.join("kurs-out/orient/summary.json")).unwrap();
        let summary: serde_json::Value = serde_json::from_str(&summary).unwrap();
        let sds = column(folder, "heading_sd_deg");
        let squares: Vec<f64> = sds.iter().flatten().map(|sd| sd * sd).collect();
        let mean = squares.iter().sum::<f64>() / squares.len() as f64;
        (mean, summary["installation_sd_deg"]["heading"].as_f64().unwrap())
    };
    let (exact, nothing) = variance(0.0);
    let (surveyed, installation) = variance(0.01);
    assert_eq!(nothing, 0.0);
    let added = (surveyed - exact) / installation.powi(2);
    assert!((added - 1.0).abs() < 0.1, "{exact} {surveyed} {installation}");
    // 1 cm in each coordinate of the corners of a square of 0.8 m: σ / √(Σ r²), Σ r² = 2 · 0.8²; a
    // little more of three antennas.
    let expected = (0.01 / (0.8 * core::f64::consts::SQRT_2)).to_degrees();
    assert!((0.9..1.2).contains(&(installation / expected)), "{installation} {expected}");
}

/// The closed form loses to the weighted fit, and says by how much.
#[test]
fn the_published_three_point_method_is_honest_too() {
    let folder = tempfile::tempdir().unwrap();
    let simulation = simulate(&TRIANGLE, 6000, 4);
    let weighted = Figures::of(&orient(folder.path(), &simulation, &[]), &simulation);
    weighted.check();
    let published =
        Figures::of(&orient(folder.path(), &simulation, &["--method", "three-point"]), &simulation);
    assert!((published.nees - 3.0).abs() < 2.0 * published.nees_band(), "{published:?}");
    assert!((1.1..3.0).contains(&published.rms_over_bound), "{published:?}");
    assert!(published.rms_deg > weighted.rms_deg, "{published:?} {weighted:?}");
}

#[test]
fn the_published_method_wants_an_acute_triangle() {
    let folder = tempfile::tempdir().unwrap();
    write(folder.path(), &simulate(&SQUARE[..3], 50, 4), true);
    let arguments = ["orient", "config.toml", "positions.csv", "--method", "three-point"];
    let run = kurs(folder.path(), &arguments).code(2);
    let message = String::from_utf8_lossy(&run.get_output().stderr).into_owned();
    assert!(message.contains("not acute") && message.contains("weighted"), "{message}");
}

/// Half past 23 hours on New Year's Eve, so that the logs go over midnight.
fn eve() -> GpsTime {
    let eve = Calendar { year: 2023, month: 12, day: 31, hour: 23, minute: 58, second: 0.0 };
    GpsTime::from_utc(eve).unwrap()
}

/// One log for each antenna gives what the table gives, to the last digit of the sentences.
#[test]
fn nmea_logs_give_the_same_attitude_over_midnight() {
    let folder = tempfile::tempdir().unwrap();
    let simulation = simulate(&SQUARE, 3000, 5);
    let by_table = Figures::of(&orient(folder.path(), &simulation, &[]), &simulation);
    let names: Vec<String> = (0..4).map(|antenna| format!("A{antenna}.nmea")).collect();
    for (antenna, name) in names.iter().enumerate() {
        let log = simulation.nmea(antenna, eve(), true);
        fs::write(folder.path().join(name), log).unwrap();
    }
    let files: Vec<&str> = names.iter().map(String::as_str).collect();
    // The order of the files does not count where their names are those of the antennas.
    let files = [files[2], files[0], files[3], files[1]];
    kurs(folder.path(), &[&["orient", "config.toml", "--quiet"], &files[..]].concat()).success();
    let rows = rows(folder.path());
    let by_logs = Figures::of(&rows, &simulation);
    by_logs.check();
    assert!((by_logs.rms_deg / by_table.rms_deg - 1.0).abs() < 0.01, "{by_logs:?} {by_table:?}");
    // 18 leap seconds: midnight of GPS time comes first.
    assert_eq!(&rows[0][0], "2023-12-31T23:58:18.000");
    assert_eq!(&rows[2999][0], "2024-01-01T00:03:17.900");
}

/// A receiver that states no standard deviations, one with damage, one without a date.
#[test]
fn worn_nmea_logs_are_used_as_far_as_they_go() {
    let folder = tempfile::tempdir().unwrap();
    let simulation = simulate(&SQUARE, 600, 6);
    fs::write(folder.path().join("config.toml"), simulation.configuration(true)).unwrap();
    let mut logs: Vec<String> =
        (0..4).map(|antenna| simulation.nmea(antenna, eve(), false)).collect();
    // Cut in the middle of a sentence, and one digit wrong.
    logs[1] = logs[1][30..].to_owned();
    logs[2] = logs[2].replacen("E,4,18,0.6,", "E,4,18,0.7,", 1);
    let without_date = |log: &str| -> String {
        log.split_inclusive('\n').filter(|line| line.contains("GGA")).collect()
    };
    for (antenna, log) in logs.iter().enumerate() {
        fs::write(folder.path().join(format!("log{antenna}.txt")), log).unwrap();
    }
    let files = ["log0.txt", "log1.txt", "log2.txt", "log3.txt"];
    kurs(folder.path(), &[&["orient", "config.toml", "--quiet"], &files[..]].concat()).success();
    let first = rows(folder.path());
    let figures = Figures::of(&first, &simulation);
    assert!(figures.fixed as f64 >= 0.99 * figures.undisturbed as f64, "{figures:?}");
    assert!((figures.rms_over_bound - 1.0).abs() < 0.1, "{figures:?}");
    let summary = fs::read_to_string(folder.path().join("kurs-out/orient/summary.json")).unwrap();
    for expected in ["log1.txt", "log2.txt", "checksum"] {
        assert!(summary.contains(expected), "{expected}: {summary}");
    }

    for (antenna, log) in logs.iter().enumerate() {
        fs::write(folder.path().join(files[antenna]), without_date(log)).unwrap();
    }
    let undated = [&["orient", "config.toml", "--quiet"], &files[..]].concat();
    kurs(folder.path(), &undated).code(1);
    kurs(folder.path(), &[&undated[..], &["--date", "2023-12-31"]].concat()).success();
    assert_eq!(rows(folder.path()), first);
}

#[test]
fn wrong_input_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| fs::write(folder.path().join(name), text).unwrap();
    let simulation = simulate(&SQUARE[..3], 20, 5);
    write("good.csv", &simulation.table());
    write("empty.csv", "");
    write("header.csv", "time,name\n1,A0\n");
    let array = simulation.configuration(true);
    write("three.toml", &array);
    write("some.toml", &array.replacen("position_m = [0.0, 0.0, 0.0]", "", 1));
    write("unknown.toml", &format!("{array}[orient]\nmatch_window = 1.0\n"));
    write("vague.toml", &format!("{array}[orient]\nmax_angle_sd_deg = 1e99\n"));
    write("wide.toml", &format!("{array}[orient]\narray_sd_m = 1e6\n"));
    for (config, positions, code, word) in [
        ("three.toml", "empty.csv", 1, "empty"),
        ("three.toml", "header.csv", 1, "gps_week"),
        ("three.toml", "absent.csv", 1, "absent.csv"),
        ("some.toml", "good.csv", 2, "2 of 3 antennas"),
        ("unknown.toml", "good.csv", 2, "match_window_s"),
        ("vague.toml", "good.csv", 2, "expected 0.001 to 180"),
        ("wide.toml", "good.csv", 2, "orient.array_sd_m is 1000000, expected 0 to 10"),
    ] {
        let run = kurs(folder.path(), &["orient", config, positions]).code(code);
        let message = String::from_utf8_lossy(&run.get_output().stderr).into_owned();
        assert!(message.contains(word), "{config} {positions}: {message}");
        assert!(!folder.path().join("kurs-out/orient/attitude.csv").exists());
    }
}

/// All figures at full length; prints the table of `docs/experiments/attitude_methods.md`.
#[test]
#[ignore = "a minute; for the figures in the documentation"]
fn every_figure() {
    let folder = tempfile::tempdir().unwrap();
    let four = simulate(&SQUARE, 100_000, 11);
    write(folder.path(), &four, true);
    let begun = Instant::now();
    kurs(folder.path(), &["orient", "config.toml", "positions.csv", "--quiet"]).success();
    let epochs_per_s = 100_000.0 / begun.elapsed().as_secs_f64();
    let of_four = Figures::of(&rows(folder.path()), &four);
    let three = simulate(&SQUARE[..3], 100_000, 12);
    let of_three = Figures::of(&orient(folder.path(), &three, &[]), &three);
    let geometry_m = estimate_geometry(folder.path(), &four);

    println!("| figure | asked | measured |\n|---|---|---|");
    println!("| RMS over the Cramér–Rao bound | 0.95 to 1.05 | {:.4} |", of_four.rms_over_bound);
    println!("| mean NEES | 3 ± {:.3} | {:.3} |", of_four.nees_band(), of_four.nees);
    println!(
        "| four antennas: displaced epochs found and repaired or refused | ≥ 99 % | {:.2} % of {} |",
        100.0 * (1.0 - of_four.missed_share()),
        of_four.displaced
    );
    println!(
        "| three antennas: displaced epochs that pass | stated | {:.2} % of {} |",
        100.0 * of_three.missed_share(),
        of_three.displaced
    );
    // First-order covariances of errors of three degrees: a hundred thousand epochs see the
    // difference.
    println!(
        "| three antennas: mean NEES | 3 ± {:.3} | {:.3} |",
        of_three.nees_band(),
        of_three.nees
    );
    println!("| estimated geometry, largest error | ≤ 2 mm | {:.2} mm |", 1e3 * geometry_m);
    println!("| epochs per second, file to files | ≥ 100 000 | {epochs_per_s:.0} |");
    of_four.check();
    assert!(of_four.missed_share() <= 0.01 && geometry_m < GEOMETRY_M);
}
