//! `kurs fuse` for antennas with an inertial sensor, from end to end: `kurs simulate` makes a car
//! with both and an outage of ten seconds, `kurs solve` its attitudes, `kurs fuse` joins them.
#![allow(clippy::unwrap_used)]

use std::fs;
use std::path::Path;
use std::process::Output;

use crate::program::{edit, kurs, run, text};

/// Without the reflections of the built-in scenario: errors of the fixes are independent.
const SCENARIO: &str = r#"
seed = 4
start = "2024-03-10T12:00:00"
duration_s = 100.0
interval_s = 0.2
signals = ["G1C", "G2W", "E1C", "E5Q"]

[sky]
systems = ["G", "E"]

[[body]]
name = "car"

[body.motion]
kind = "car"
place = { latitude_deg = 55.75, longitude_deg = 37.62, height_m = 200.0 }
waypoints_m = [[0, 0], [0, 150], [120, 150], [120, 40], [220, 40], [260, 180], [60, 320], [-140, 260]]
speed_mps = 11.0
wait_s = 10.0
turn_radius_m = 14.0

[[body.antenna]]
name = "A0"
position_m = [0.0, 0.0, 0.0]

[[body.antenna]]
name = "A1"
position_m = [1.2, 0.0, -0.030]

[[body.antenna]]
name = "A2"
position_m = [0.1, 0.8, 0.0]

[body.imu]
position_m = [-0.5, 0.1, 0.4]
mounting_deg = [2.0, -1.0, 180.0]
gyro_bias_degph = [10.0, -8.0, 6.0]
gyro_noise_deg_per_sqrt_h = 0.1
accelerometer_bias_mps2 = [0.02, -0.03, 0.01]

[[outage]]
from_s = 60.1
to_s = 70.1
"#;

const OUTAGE_S: core::ops::Range<f64> = 60.1..70.1;

/// Simulates and solves; the folder then holds `fuse.toml`.
fn simulated(folder: &Path, scenario: &str) {
    let file = folder.join("scenario.toml");
    fs::write(&file, scenario).unwrap();
    let out = folder.to_str().unwrap();
    run(&["simulate", file.to_str().unwrap(), "--out", out, "-q"]);
    let (config, solved) = (folder.join("kurs.toml"), folder.join("solved"));
    run(&["solve", config.to_str().unwrap(), "--out", solved.to_str().unwrap()]);
}

/// Fuses with this configuration; the output goes to `folder/fused`.
fn fuse(folder: &Path, config: &str) -> Output {
    let (path, out, truth) =
        (folder.join("changed.toml"), folder.join("fused"), folder.join("truth.csv"));
    fs::write(&path, config).unwrap();
    let [path, out, truth] = [&path, &out, &truth].map(|path| path.to_str().unwrap());
    kurs(&["fuse", path, "--out", out, "--truth", truth])
}

fn fuse_well(folder: &Path, config: &str) -> Output {
    let output = fuse(folder, config);
    assert!(output.status.success(), "{}", text(&output.stderr));
    output
}

/// As `kurs simulate` wrote it, for errors that are independent.
fn config(folder: &Path) -> String {
    let written = fs::read_to_string(folder.join("fuse.toml")).unwrap();
    written.replace("[imu]", "correlation_s = 0.0\n\n[imu]")
}

fn summary(folder: &Path) -> serde_json::Value {
    let file = fs::read_to_string(folder.join("fused/summary.json")).unwrap();
    serde_json::from_str(&file).unwrap()
}

/// A table: seconds since the first row, then the named columns; empty fields as NaN.
fn table(path: &Path, names: &[&str]) -> Vec<Vec<f64>> {
    table_of(path, "tow_s", names)
}

fn table_of(path: &Path, time: &str, names: &[&str]) -> Vec<Vec<f64>> {
    let file = fs::read_to_string(path).unwrap();
    let mut lines = file.lines();
    let header: Vec<&str> = lines.next().unwrap().split(',').collect();
    let place = |name: &str| header.iter().position(|h| *h == name).unwrap();
    let (time, places) = (place(time), names.iter().map(|n| place(n)).collect::<Vec<_>>());
    let rows = lines.map(|line| line.split(',').collect::<Vec<_>>());
    rows.map(|fields| {
        let value = |k: usize| fields[k].parse().unwrap_or(f64::NAN);
        let first = vec![value(time) - 43_200.0];
        first.into_iter().chain(places.iter().map(|k| value(*k))).collect()
    })
    .collect()
}

/// Time, error and standard deviation of one angle in every row.
fn errors(folder: &Path, file: &str, angle: &str) -> Vec<[f64; 3]> {
    let truth = table(&folder.join("truth.csv"), &[&format!("{angle}_deg")]);
    let names = [format!("{angle}_deg"), format!("{angle}_sd_deg")];
    let found = table(&folder.join(file), &[&names[0], &names[1]]);
    let known = |row: &Vec<f64>| {
        let wanted = truth.iter().find(|t| (t[0] - row[0]).abs() < 0.01)?;
        let error = (row[1] - wanted[1] + 180.0).rem_euclid(360.0) - 180.0;
        Some([row[0], error, row[2]])
    };
    found.iter().filter_map(known).collect()
}

fn rms(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0u32), |(sum, n), v| (sum + v * v, n + 1));
    (sum / f64::from(count)).sqrt()
}

/// Reference for a gyro of 10°/h and 0.1°/√h: 95 % of headings within 0.15° after ten seconds.
#[test]
fn an_outage_is_coasted_through_and_smoothed() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    simulated(folder, SCENARIO);
    let told = text(&fuse_well(folder, &config(folder)).stdout);
    assert!(told.contains("0 rejected; longest time without one 10.0 s"), "{told}");

    let summary = summary(folder);
    assert_eq!((&summary["fixed"], &summary["float"]), (&451.into(), &50.into()));
    for angle in ["heading", "pitch", "roll"] {
        let filtered = errors(folder, "fused/attitude.csv", angle);
        assert_eq!(filtered.len(), 501);
        // Never far beyond what is claimed, in the outage or out of it, nor by a jump at its end.
        let worst = filtered.iter().map(|[_, e, sd]| (e / sd).abs()).fold(0.0, f64::max);
        assert!(worst < 5.0, "{angle}: {worst} σ");
        let normalised = summary["truth"][format!("{angle}_normalised")].as_f64().unwrap();
        // Neighbouring rows share their error, so the mean of 450 is that of a few.
        assert!((0.1..3.0).contains(&normalised), "{angle}: {normalised}");
        let inside = |rows: &[[f64; 3]]| {
            rms(rows.iter().filter(|row| OUTAGE_S.contains(&row[0])).map(|row| row[1]))
        };
        assert!(inside(&filtered) < 0.05, "{angle}: {}", inside(&filtered));
        let smoothed = errors(folder, "fused/smoothed.csv", angle);
        assert_eq!(smoothed.len(), 501);
        let all = |rows: &[[f64; 3]]| rms(rows.iter().map(|row| row[1]));
        assert!(all(&smoothed) < all(&filtered), "{angle}");
        let sd = |rows: &[[f64; 3]]| rows.iter().find(|row| row[0] > 65.0).unwrap()[2];
        assert!(sd(&smoothed) < 0.7 * sd(&filtered), "{angle}");
    }
    // Position while the antennas have one; the sensor gives none.
    let rows = table(&folder.join("fused/attitude.csv"), &["latitude_deg", "vel_north_mps"]);
    assert!(rows.iter().all(|row| row[1].is_nan() == OUTAGE_S.contains(&row[0])));
}

/// The epochs solved by `kurs fuse` itself: after an outage with few satellites back it fixes those
/// that `kurs solve` cannot, and the rest is as good as before.
#[test]
fn the_prediction_helps_the_integers() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let galileo = (1..=24).map(|n| format!("\"E{n:02}\", "));
    let a_third = (1..=24).step_by(3).map(|n| format!("\"G{n:02}\", "));
    let gone: String = galileo.chain(a_third).collect();
    let scenario = SCENARIO.replace(r#""G1C", "G2W", "E1C", "E5Q""#, r#""G1C", "E1C""#)
        + &format!("[[outage]]\nfrom_s = 70.1\nto_s = 90.1\nsatellites = [{gone}]\n");
    simulated(folder, &scenario);
    let given = config(folder);
    fuse_well(folder, &given);
    let before = summary(folder);
    let chain = given.replace("attitude = \"solved/attitude.csv\"", "solve = \"kurs.toml\"");
    let told = text(&fuse_well(folder, &chain).stdout);
    assert!(told.contains("the prediction decided on the integers of"), "{told}");
    let after = summary(folder);
    let number = |summary: &serde_json::Value, key: &str| summary[key].as_u64().unwrap();
    assert_eq!(number(&before, "epochs"), number(&after, "epochs"));
    let decided = number(&after["filter"], "fixed_by_prediction");
    assert!(decided >= 50, "{decided}");
    assert!(number(&after, "fixed") >= number(&before, "fixed") + 50);
    assert_eq!(after["filter"]["refused_by_prediction"], 0);
    let health = fs::read_to_string(folder.join("fused/health.csv")).unwrap();
    let rows = health.lines().filter(|line| line.contains(",decided,")).count() as u64;
    assert_eq!(rows, decided);
    for angle in ["heading", "pitch", "roll"] {
        let errors = errors(folder, "fused/attitude.csv", angle);
        let worst = errors.iter().map(|[_, e, sd]| (e / sd).abs()).fold(0.0, f64::max);
        assert!(worst < 5.0, "{angle}: {worst} σ");
    }
    // The first epoch after the outage, and all after it.
    let rows = fs::read_to_string(folder.join("fused/attitude.csv")).unwrap();
    let back: Vec<&str> = rows.lines().skip(1 + 351).collect();
    let fixed = back.iter().filter(|row| row.contains(",fixed,")).count();
    assert!(back[0].contains(",fixed,"), "{}", back[0]);
    assert!(20 * fixed >= 19 * back.len(), "{fixed} of {}", back.len());
}

/// Two antennas have no roll, and an attitude only once a second: the sensor has the rest.
#[test]
fn two_antennas_and_more_rows_than_theirs() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let start = SCENARIO.find("[[body.antenna]]\nname = \"A2\"").unwrap();
    let end = SCENARIO.find("[body.imu]").unwrap();
    let two = format!("{}{}", &SCENARIO[..start], &SCENARIO[end..]);
    simulated(folder, &two.replace("interval_s = 0.2", "interval_s = 1.0"));
    let more = config(folder) + "[output]\ninterval_s = 0.05\n";
    fuse_well(folder, &more);
    let rows = table(&folder.join("fused/attitude.csv"), &["heading_deg", "roll_deg"]);
    assert_eq!(rows.len(), 2001);
    assert!(rows.iter().all(|row| row[1].is_finite() && row[2].is_finite()));
    for angle in ["heading", "roll"] {
        let settled = errors(folder, "fused/attitude.csv", angle);
        let error = rms(settled.iter().filter(|row| row[0] > 40.0).map(|row| row[1]));
        assert!(error < 0.3, "{angle}: {error}");
    }
}

/// A wrong fix is refused, and the row says so; rows and samples that are no numbers, out of order
/// or saturated are named and survived; so is a pause of the sensor.
#[test]
fn damage_is_named_and_survived() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    simulated(folder, SCENARIO);
    edit(&folder.join("solved/attitude.csv"), |k, line| {
        let mut fields: Vec<String> = line.split(',').map(str::to_owned).collect();
        match k {
            // Heading is column 8, the quaternion the last four: without it the angles count.
            150 => {
                let heading: f64 = fields[8].parse().unwrap();
                fields[8] = format!("{:.5}", heading + 5.0);
                fields[31..].iter_mut().for_each(String::clear);
                Some(fields.join(","))
            }
            160 => {
                fields[9] = "nan".to_owned();
                Some(fields.join(","))
            }
            // An angle of which nothing is known but itself, and a place beyond the pole.
            165 | 170 => {
                fields[11] = if k == 165 { String::new() } else { "0.00000".to_owned() };
                Some(fields.join(","))
            }
            175 => Some(line.replace(",55.7", ",5575.")),
            _ => Some(line.to_owned()),
        }
    });
    let log = folder.join("imu.csv");
    let rows: Vec<String> = fs::read_to_string(&log).unwrap().lines().map(str::to_owned).collect();
    edit(&log, |k, line| {
        let time = line.split(',').next().unwrap_or_default();
        match k {
            1 => Some(format!("{line}\n{line}")),
            2500 => Some(format!("{time},500.0,0,0,0,0,9.8")),
            2600 => Some(format!("{time},5e8,0,0,0,0,9.8")),
            3000 => Some(format!("{time},nan,0,0,0,0,9.8")),
            3010 => Some(format!("{time},broken")),
            // 50 ms late, put back in its place; then 3 s late, refused.
            3100 => Some(rows[3105].clone()),
            3105 => Some(rows[3100].clone()),
            3500 => Some(rows[3200].clone()),
            3600..3610 => Some(format!("{time},2000.0,0,0,0,0,9.8")),
            // Two seconds without samples.
            4000..4200 => None,
            _ => Some(line.to_owned()),
        }
    });
    let output = fuse_well(folder, &config(folder));
    let told = text(&output.stdout);
    assert!(told.contains("2.0 s without samples were bridged"), "{told}");
    let summary = summary(folder);
    let filter = &summary["filter"];
    assert_eq!((&filter["saturated"], &filter["too_late"]), (&10.into(), &1.into()));
    assert_eq!(filter["repeated"], 1);
    assert!(told.contains("left out: 1 with the time of the one before"), "{told}");
    assert_eq!(filter["attitudes_rejected"], 1);
    let damage = summary["damage"].as_array().unwrap();
    let named = |line: u64, what: &str| {
        damage.iter().any(|d| d["line"] == line && d["what"].as_str().unwrap().contains(what))
    };
    assert!(named(161, "pitch_deg: `nan` found"), "{damage:?}");
    let no_sd = "found, a standard deviation above 0 expected";
    assert!(named(166, &format!("heading_sd_deg: `` {no_sd}")), "{damage:?}");
    assert!(named(171, &format!("heading_sd_deg: `0.00000` {no_sd}")), "{damage:?}");
    assert!(named(176, "found, -90 to 90 expected"), "{damage:?}");
    // The first sample stands twice.
    assert!(named(2502, "500 °/s in one sample alone is no turn of a body"), "{damage:?}");
    assert!(named(2602, "5e8 is no reading of a sensor, 20000 or less expected"), "{damage:?}");
    assert!(named(3002, "`nan` is not a number"), "{damage:?}");
    assert!(named(3012, "column 5 is missing"), "{damage:?}");
    let attitude = fs::read_to_string(folder.join("fused/attitude.csv")).unwrap();
    let refused = attitude.lines().nth(150).unwrap();
    assert!(refused.contains(",float,residuals,"), "{refused}");
    let heading = errors(folder, "fused/attitude.csv", "heading");
    let worst = heading.iter().map(|[_, e, sd]| (e / sd).abs()).fold(0.0, f64::max);
    assert!(worst < 5.0, "{worst} σ");
    // Three more seconds without samples, and a box that leans: its velocities are others.
    edit(&log, |k, line| (!(5000..5300).contains(&k)).then(|| line.to_owned()));
    let leaning = config(folder).replace("[2.0, -1.0, 180.0]", "[2.0, 7.0, 180.0]");
    let told = text(&fuse_well(folder, &leaning).stdout);
    assert!(told.contains("5.0 s without samples were bridged, 5 % of the run: nothing"), "{told}");
    assert!(told.contains("many velocities were rejected: are unit, mounting"), "{told}");
    // By as much as is said of it: the filter finds it.
    let leaning = config(folder).replace("[2.0, -1.0, 180.0]", "[2.0, 2.0, 180.0]");
    let known = leaning.replace("[imu]", "[imu]\nmounting_sd_deg = 3.0");
    fuse_well(folder, &known);
    let normalised = self::summary(folder)["truth"]["pitch_normalised"].as_f64().unwrap();
    assert!(normalised < 3.0, "{normalised}");
}

#[test]
fn what_cannot_be_is_refused_in_words() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    simulated(folder, &SCENARIO.replace("duration_s = 100.0", "duration_s = 12.0"));
    let good = config(folder);
    for (from, to, status, expected) in [
        (
            "[antennas]",
            "[antenna]",
            2,
            "one of [arm], [antennas] with [imu], [tilt] with [imu] must stand",
        ),
        ("file = \"imu.csv\"", "", 2, "imu.file: no log of the inertial sensor"),
        ("position_m = [-0.5", "positon_m = [-0.5", 2, "did you mean `position_m`?"),
        ("gyro_range_degps = 2000.0", "gyro_range_degps = 0.0", 2, "imu.gyro_range_degps is 0"),
        ("position_m = [-0.5", "position_m = [1e300", 2, "imu.position_m is 1000"),
        (
            "[imu]",
            "[output]\ninterval_s = 1e-9\n[imu]",
            2,
            "output.interval_s is 0.000000001, expected 0.001 to 86400",
        ),
        (
            "accelerometer_noise_mps2_per_sqrt_hz = ",
            "accelerometer_noise_mps2_per_sqrt_hz = 1e300 # ",
            2,
            "expected 0.000000001 to 10",
        ),
        ("attitude.csv", "baselines.csv", 1, "attitude.csv of kurs solve is expected"),
        ("attitude.csv", "nothing.csv", 1, "nothing.csv: cannot be read"),
        (
            "attitude = \"solved/attitude.csv\"",
            "",
            2,
            "antennas: none of `attitude` and `solve` found, expected one",
        ),
        ("correlation_s", "solve = \"kurs.toml\"\ncorrelation_s", 2, "antennas: both of"),
        ("attitude = \"solved/attitude.csv\"", "solve = \"imu.csv\"", 2, "imu.csv:1"),
        ("attitude = \"solved/attitude.csv\"", "solve = \"no.toml\"", 2, "no.toml: cannot be read"),
        ("correlation_s = 0.0", "latitude_deg = 95.0", 2, "antennas.latitude_deg: 95 found"),
    ] {
        let output = fuse(folder, &good.replace(from, to));
        let told = text(&output.stderr);
        assert!(told.contains(expected), "{told}");
        assert_eq!(output.status.code(), Some(status), "{told}");
    }
    let output = fuse(folder, &good.replace("[imu]", "[imu]\ntime_offset_s = 86400.0"));
    let told = text(&output.stderr);
    assert!(
        told.contains(
            "(129600.0 to 129612.0 s) and the antennas (43200.0 to 43212.0 s) have no time"
        ),
        "{told}"
    );
    assert_eq!(output.status.code(), Some(1), "{told}");
    let solved = folder.join("solved/attitude.csv");
    let rows = fs::read_to_string(&solved).unwrap();
    fs::write(&solved, rows.replacen("pitch_sd_deg", "pitch_sigma", 1)).unwrap();
    let told = text(&fuse(folder, &good).stderr);
    assert!(told.contains("attitude.csv:1: no column `pitch_sd_deg`"), "{told}");
    // The first sample comes after the only attitude, and is the mean since then.
    fs::write(&solved, rows.split_inclusive('\n').take(2).collect::<String>()).unwrap();
    let told = text(&fuse_well(folder, &good).stdout);
    assert!(told.contains("1 rows: 1 with a fix"), "{told}");
    fs::write(&solved, rows).unwrap();
    // Accelerometers in g under the header of m/s².
    edit(&folder.join("imu.csv"), |k, line| {
        let fields: Vec<&str> = line.split(',').collect();
        let in_g = |text: &str| format!("{:.7}", text.parse::<f64>().unwrap() / 9.806_65);
        let [x, y, z] = if k == 0 { return Some(line.to_owned()) } else { [4, 5, 6] };
        Some(
            [&fields[..4], &[&in_g(fields[x]), &in_g(fields[y]), &in_g(fields[z])]]
                .concat()
                .join(","),
        )
    });
    let output = fuse(folder, &good);
    let told = text(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{told}");
    assert!(told.contains("the unit is probably g, name it in the header"), "{told}");
}

/// Pitch and roll of a ship from its sensor alone: the complementary filter is better than what the
/// accelerometers show in the swell, with and without smoothing.
#[test]
fn the_tilt_of_the_sensor_alone() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let start = SCENARIO.find("kind = \"car\"").unwrap();
    let end = SCENARIO.find("[[body.antenna]]").unwrap();
    let ship = "kind = \"ship\"\nplace = { latitude_deg = 55.75, longitude_deg = 37.62, height_m = 0.0 }\n\
        heading_deg = 70.0\nspeed_mps = 6.0\nperiod_s = 5.0\nroll_rms_deg = 4.0\npitch_rms_deg = 1.0\n\
        yaw_rms_deg = 1.0\nheave_rms_m = 0.4\n\n";
    let scenario = format!("{}{ship}{}", &SCENARIO[..start], &SCENARIO[end..])
        .replace("position_m = [-0.5, 0.1, 0.4]", "position_m = [-0.5, 0.1, 6.0]");
    let file = folder.join("scenario.toml");
    fs::write(&file, scenario).unwrap();
    run(&["simulate", file.to_str().unwrap(), "--out", folder.to_str().unwrap(), "-q"]);
    let config = folder.join("tilt.toml");
    let out = folder.join("tilt");
    let fused = |keys: &str| {
        let imu = "[imu]\nfile = \"imu.csv\"\nmounting_deg = [2.0, -1.0, 180.0]\n";
        fs::write(&config, format!("[tilt]\n{keys}\n{imu}")).unwrap();
        kurs(&["fuse", config.to_str().unwrap(), "--out", out.to_str().unwrap()])
    };
    let output = fused("gyro_share = 0.998\nintegral_gain = 0.001");
    assert!(output.status.success(), "{}", text(&output.stderr));
    let truth = table_of(&folder.join("truth.csv"), "tow_s", &["roll_deg"]);
    let columns = ["roll_deg", "accelerometer_roll_deg", "smoothed_roll_deg"];
    let found = table_of(&out.join("tilt.csv"), "time_s", &columns);
    let mut squares = [0.0; 3];
    for wanted in truth.iter().filter(|row| row[0] > 30.0 && row[0] < 99.0) {
        let row = found
            .iter()
            .min_by(|a, b| (a[0] - wanted[0]).abs().total_cmp(&(b[0] - wanted[0]).abs()));
        let row = row.unwrap();
        (0..3).for_each(|k| squares[k] += (row[k + 1] - wanted[1]).powi(2));
    }
    assert!(4.0 * squares[0] < squares[1] && 4.0 * squares[0] < squares[2], "{squares:?}");

    let output = fused("gyro_share = 1.5");
    assert_eq!(output.status.code(), Some(2));
    assert!(text(&output.stderr).contains("tilt.gyro_share: 1.5 found, 0 to below 1 expected"));
}

/// A resting body upside down, whose accelerometers show now 179.4°, now −179.4°; then a minute without
/// samples, the first of which after it has a rate that nobody may stretch over the minute.
#[test]
fn a_tilt_upside_down_and_after_a_pause() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let mut log = "time_s,gx_degps,gy_degps,gz_degps,ax_mps2,ay_mps2,az_mps2\n".to_owned();
    for k in 0..1000 {
        let time_s = f64::from(k) * 0.01 + if k < 500 { 0.0 } else { 60.0 };
        let (rate, across) = (if k == 500 { 2.0 } else { 0.0 }, [0.1, -0.1][k as usize % 2]);
        log += &format!("{time_s:.2},{rate},0,0,0,{across},9.81\n");
    }
    fs::write(folder.join("imu.csv"), log).unwrap();
    let (config, out) = (folder.join("tilt.toml"), folder.join("tilt"));
    fs::write(&config, "[tilt]\n[imu]\nfile = \"imu.csv\"\n").unwrap();
    let output = run(&["fuse", config.to_str().unwrap(), "--out", out.to_str().unwrap()]);
    let told = text(&output.stderr);
    assert!(told.contains("pauses of the samples: 1, 60.0 s in all"), "{told}");
    let rows = table_of(&out.join("tilt.csv"), "time_s", &["roll_deg", "smoothed_roll_deg"]);
    assert_eq!(rows.len(), 999);
    assert!(rows.iter().all(|row| row[1].abs() > 179.0 && row[2].abs() > 179.0));
}
