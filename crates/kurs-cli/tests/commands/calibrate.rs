//! `kurs calibrate` from end to end: logs of a simulated sensor, what it finds in them, and what it
//! says where it can find nothing.
#![allow(clippy::unwrap_used)]

use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use crate::program::{run, text};

use kurs_sim::noise::Noise;
use nalgebra::{Matrix3, Vector3};
use serde::Deserialize;

const G: f64 = 9.81;
const STEP_S: f64 = 0.02;
/// Of a sample, m/s².
const NOISE_MPS2: f64 = 0.02;
/// Samples of a rest: the thousand of the reference.
const REST: usize = 1000;
/// Samples of a turn to the next pose.
const TURN: usize = 100;

#[derive(Deserialize)]
struct Calibration {
    accelerometer: Option<Accelerometer>,
    gyro: Option<Gyro>,
}

#[derive(Deserialize)]
struct Accelerometer {
    matrix: [[f64; 3]; 3],
    bias_mps2: [f64; 3],
    matrix_sd: [[f64; 3]; 3],
    bias_sd_mps2: [f64; 3],
}

#[derive(Deserialize)]
struct Gyro {
    bias_radps: [f64; 3],
    bias_sd_radps: [f64; 3],
    noise_radps_per_sqrt_hz: [f64; 3],
}

fn truth() -> (Matrix3<f64>, Vector3<f64>) {
    let m = Matrix3::new(1.003, 0.002, -0.001, 0.0, 0.998, 0.003, 0.0, 0.0, 1.001);
    (m, Vector3::new(0.05, -0.08, 0.12))
}

fn six_directions() -> Vec<Vector3<f64>> {
    let axes = [Vector3::x(), Vector3::y(), Vector3::z()];
    axes.iter().flat_map(|axis| [*axis, -axis]).collect()
}

/// Evenly over the sphere (golden angle).
fn directions(count: u32) -> Vec<Vector3<f64>> {
    let golden = core::f64::consts::PI * (3.0 - 5f64.sqrt());
    (0..count)
        .map(|k| {
            let z = 1.0 - (2.0 * f64::from(k) + 1.0) / f64::from(count);
            let (sin, cos) = (golden * f64::from(k)).sin_cos();
            Vector3::new((1.0 - z * z).sqrt() * cos, (1.0 - z * z).sqrt() * sin, z)
        })
        .collect()
}

/// A log that rests in every direction and shakes from one to the next; `scale` turns m/s² into the
/// unit of the log.
fn log(directions: &[Vector3<f64>], seed: u64, scale: f64, noise_mps2: f64) -> String {
    let (m, b) = truth();
    let mut noise = Noise::seeded(seed);
    let mut text = String::from("time_s,ax_mps2,ay_mps2,az_mps2\n");
    let mut time_s = 0.0;
    for (k, direction) in directions.iter().enumerate() {
        let next = directions.get(k + 1).unwrap_or(direction);
        for sample in 0..REST + TURN {
            let part = sample.saturating_sub(REST) as f64 / TURN as f64;
            let shaking = if sample < REST { noise_mps2 } else { 1.0 };
            // Antipodes: straight through zero is no turn, but no rest either.
            let felt = (direction * (1.0 - part) + next * part) * G;
            let reading = (m * felt + b + noise.normal3(shaking)) * scale;
            writeln!(text, "{time_s:.2},{:.7},{:.7},{:.7}", reading.x, reading.y, reading.z)
                .unwrap();
            time_s += STEP_S;
        }
    }
    text
}

fn write(folder: &Path, name: &str, text: &str) -> PathBuf {
    let path = folder.join(name);
    fs::write(&path, text).unwrap();
    path
}

fn calibrate(folder: &Path, method: &str, files: &[PathBuf], more: &[&str]) -> Output {
    let out = folder.join("out");
    let mut command = Command::new(env!("CARGO_BIN_EXE_kurs"));
    command.args(["calibrate", method]).args(files).args(["--out", out.to_str().unwrap()]);
    command.args(more).output().unwrap()
}

fn found(folder: &Path, output: &Output) -> Calibration {
    assert!(output.status.success(), "{}", text(&output.stderr));
    toml::from_str(&fs::read_to_string(folder.join("out/calibration.toml")).unwrap()).unwrap()
}

/// Root mean square errors of scale, misalignment and bias; every error within 4.5 of its stated
/// standard deviations (each one in 150 000).
fn errors(found: &Accelerometer) -> [f64; 3] {
    let (m, b) = truth();
    let mut squares = [0.0; 3];
    for i in 0..3 {
        for j in 0..3 {
            let error = found.matrix[i][j] - m[(i, j)];
            squares[usize::from(i != j)] += error * error;
            assert!(error.abs() <= 4.5 * found.matrix_sd[i][j] + 1e-12, "{i} {j}: {error}");
        }
        let error = found.bias_mps2[i] - b[i];
        squares[2] += error * error;
        assert!(error.abs() <= 4.5 * found.bias_sd_mps2[i], "{i}: {error}");
    }
    [squares[0] / 3.0, squares[1] / 6.0, squares[2] / 3.0].map(f64::sqrt)
}

/// Reference with exact poses: 45 ppm, 0.046 mrad, 0.25 mm/s² over many logs; this is one.
#[test]
fn six_positions() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let log = [write(folder, "log.csv", &log(&six_directions(), 1, 1.0, NOISE_MPS2))];
    let output = calibrate(folder, "six-position", &log, &["--gravity", "9.81"]);
    let exact = found(folder, &output).accelerometer.unwrap();
    let [scale, misalignment, bias] = errors(&exact);
    assert!(scale < 2.0 * 45e-6 && misalignment < 2.0 * 0.046e-3 && bias < 2.0 * 0.25e-3);
    assert!((exact.matrix_sd[0][0] / 45e-6 - 1.0).abs() < 0.1, "{}", exact.matrix_sd[0][0]);

    let report = fs::read_to_string(folder.join("out/report.html")).unwrap();
    assert!(report.contains("<h2>Residuals</h2>") && report.contains("plot-1"));
    let residuals = fs::read_to_string(folder.join("out/residuals.csv")).unwrap();
    assert_eq!(residuals.lines().count(), 7);

    // A tenth of a degree of levelling cannot be seen in the data, but stated it dominates.
    let more = ["--gravity", "9.81", "--levelling-deg", "0.1"];
    let levelled = found(folder, &calibrate(folder, "six-position", &log, &more));
    let levelled = levelled.accelerometer.unwrap();
    assert!((levelled.matrix_sd[0][1] / 1.24e-3 - 1.0).abs() < 0.05);
    assert!((levelled.bias_sd_mps2[0] / 5.7e-3 - 1.0).abs() < 0.05);
}

#[test]
fn many_poses() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let log = [write(folder, "log.csv", &log(&directions(24), 2, 1.0, NOISE_MPS2))];
    let output = calibrate(folder, "multi-pose", &log, &["--gravity", "9.81"]);
    let [scale, _, bias] = errors(&found(folder, &output).accelerometer.unwrap());
    assert!(scale < 2.0 * 61e-6 && bias < 2.0 * 0.25e-3, "{scale} {bias}");
    assert!(text(&output.stdout).contains("24 resting poses"));
}

/// Bias 20 °/h on one axis, noise 0.3 °/√h.
#[test]
fn a_resting_gyro() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let per_hour = 1f64.to_radians() / 3600.0;
    let density = 0.3f64.to_radians() / 60.0;
    let (bias, mut noise) = (Vector3::new(20.0, -5.0, 1.0) * per_hour, Noise::seeded(3));
    let mut log = String::from("time_s,gx_degps,gy_degps,gz_degps\n");
    for k in 0..60_000 {
        let rate = (bias + noise.normal3(density / 0.01f64.sqrt())).map(f64::to_degrees);
        writeln!(log, "{:.2},{:.8},{:.8},{:.8}", f64::from(k) * 0.01, rate.x, rate.y, rate.z)
            .unwrap();
    }
    let log = [write(folder, "gyro.csv", &log)];
    let gyro = found(folder, &calibrate(folder, "gyro-bias", &log, &[])).gyro.unwrap();
    for axis in 0..3 {
        let error = gyro.bias_radps[axis] - bias[axis];
        assert!(error.abs() < 4.5 * gyro.bias_sd_radps[axis], "{axis}: {error}");
        assert!((gyro.bias_sd_radps[axis] / (density / 600f64.sqrt()) - 1.0).abs() < 0.02);
        assert!((gyro.noise_radps_per_sqrt_hz[axis] / density - 1.0).abs() < 0.02);
    }
    assert!(
        fs::read_to_string(folder.join("out/report.html")).unwrap().contains("Allan deviation")
    );
    assert!(fs::read_to_string(folder.join("out/allan.csv")).unwrap().starts_with("tau_s,"));
}

/// Two poses tilted by a third of a degree: told with their numbers, and in the sigmas. A pose between
/// the axes is refused, and what an older run left is gone.
#[test]
fn poses_that_are_not_level_are_told() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let turned = |deg: f64| {
        let (sin, cos) = deg.to_radians().sin_cos();
        Vector3::new(cos, sin, 0.0)
    };
    let mut tilted = six_directions();
    (tilted[0], tilted[1]) = (turned(0.35), -turned(-0.35));
    let file = [write(folder, "tilted.csv", &log(&tilted, 1, 1.0, NOISE_MPS2))];
    let output = calibrate(folder, "six-position", &file, &["--gravity", "9.81"]);
    errors(&found(folder, &output).accelerometer.unwrap());
    let told = text(&output.stdout);
    assert!(told.contains("by the data the poses are levelled to 0.20° (1 sigma)"), "{told}");
    assert!(told.contains("x up and x down (poses 1, 2) agree least"), "{told}");

    let between = [six_directions(), vec![turned(45.0)]].concat();
    let file = [write(folder, "between.csv", &log(&between, 1, 1.0, NOISE_MPS2))];
    let output = calibrate(folder, "six-position", &file, &["--gravity", "9.81"]);
    assert_eq!(output.status.code(), Some(1));
    assert!(text(&output.stderr).contains("pose 7 is 4"), "{}", text(&output.stderr));
    assert!(!folder.join("out/calibration.toml").exists());
}

/// No noise at all is no perfect gyro.
#[test]
fn a_gyro_that_never_changes_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let rows = (0..3000).map(|k| format!("{:.2},0,0,0\n", f64::from(k) * 0.01));
    let log = "time_s,gx_radps,gy_radps,gz_radps\n".to_owned() + &rows.collect::<String>();
    let log = [write(folder.path(), "constant.csv", &log)];
    let output = calibrate(folder.path(), "gyro-bias", &log, &[]);
    let told = text(&output.stderr);
    assert!(told.contains("no axis changes all through the rest"), "{told}");
}

/// What to do, in words.
#[test]
fn problems_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let refused = |method: &str, files: &[PathBuf], expected: &str| {
        let output = calibrate(folder, method, files, &["--gravity", "9.81"]);
        assert_eq!(output.status.code(), Some(1));
        let told = text(&output.stderr);
        assert!(told.contains(expected), "{told}");
    };
    let six = six_directions();
    let missing = write(folder, "missing.csv", &log(&six[..5], 4, 1.0, NOISE_MPS2));
    refused("six-position", &[missing], "poses are missing: z down; turn the sensor");
    let unit = write(folder, "unit.csv", &log(&six, 5, 1.0 / 9.806_65, NOISE_MPS2));
    refused("six-position", &[unit], "the unit is probably g; name it in the header");
    let few = write(folder, "few.csv", &log(&directions(6), 6, 1.0, NOISE_MPS2));
    refused("multi-pose", &[few], "6 resting poses, at least 9 are needed");
    let one_sided: Vec<Vector3<f64>> = directions(120).into_iter().take(12).collect();
    let alike = write(folder, "alike.csv", &log(&one_sided, 7, 1.0, NOISE_MPS2));
    refused("multi-pose", &[alike], "the poses are too much alike");
    // A file for every pose; one was taken on a shaking table.
    let shaken: Vec<PathBuf> = six
        .iter()
        .enumerate()
        .map(|(k, direction)| {
            let noise = if k == 2 { 0.4 } else { NOISE_MPS2 };
            write(folder, &format!("{k}.csv"), &log(&[*direction], 8, 1.0, noise))
        })
        .collect();
    refused("six-position", &shaken, "motion in pose 3");
    // Milliseconds in the column of seconds; a sensor that never rests; an impossible reading.
    let good = log(&six, 9, 1.0, NOISE_MPS2);
    let change = |name: &str, change: &dyn Fn(usize, Vec<f64>) -> Vec<f64>| {
        let rows = good.lines().skip(1).enumerate().map(|(k, line)| {
            let row = change(k, line.split(',').map(|field| field.parse().unwrap()).collect());
            row.iter().map(f64::to_string).collect::<Vec<_>>().join(",")
        });
        let header = good.lines().take(1).map(str::to_owned);
        write(folder, name, &(header.chain(rows).collect::<Vec<_>>().join("\n") + "\n"))
    };
    let short = change("short.csv", &|_, row| [&[row[0] / 1e6], &row[1..]].concat());
    refused("six-position", &[short], "is `time_s` in seconds?");
    let huge =
        change("huge.csv", &|k, row| if k == 7 { vec![row[0], 1e300, 0.0, 0.0] } else { row });
    let output = calibrate(folder, "six-position", &[huge], &["--gravity", "9.81"]);
    assert!(text(&output.stderr).contains("huge.csv:9: 1e300 is no reading of a sensor"));
    // 50 samples a second, counted from 1970 in other units.
    for (unit, name) in [(1e9, "nanoseconds"), (1e6, "microseconds"), (1e3, "milliseconds")] {
        let ticks = change("ticks.csv", &|_, row| {
            [&[((1_718_496_000.0 + row[0]) * unit).round()], &row[1..]].concat()
        });
        refused("six-position", &[ticks], &format!("`time_s` looks like {name}"));
    }
    let slow = change("slow.csv", &|_, row| [&[row[0] * 1e9], &row[1..]].concat());
    refused("multi-pose", &[slow], "`time_s` looks like nanoseconds, multiply it by 1e-9");
    // Too short a rest for the noise: nothing is written, and no NaN.
    let mut rest = String::from("time_s,gx_radps,gy_radps,gz_radps\n");
    (0..30).for_each(|k| writeln!(rest, "{},{},0.001,0.002", f64::from(k) * 0.1, k % 3).unwrap());
    let rest = write(folder, "rest.csv", &rest.replace(",0,", ",0.001,"));
    let output = calibrate(folder, "gyro-bias", &[rest], &[]);
    assert_eq!(output.status.code(), Some(1), "{}", text(&output.stdout));
    assert!(!text(&output.stdout).contains("NaN"));
    // Counts of a converter in place of rad/s.
    let mut counts = String::from("time_s,gx_radps,gy_radps,gz_radps\n");
    (0..500).for_each(|k| {
        writeln!(counts, "{},{},-3,{}", f64::from(k) * 0.01, 40 + k % 3, k % 2).unwrap()
    });
    let counts = write(folder, "counts.csv", &counts);
    let output = calibrate(folder, "gyro-bias", &[counts], &[]);
    assert_eq!(output.status.code(), Some(1), "{}", text(&output.stdout));
    assert!(
        text(&output.stderr).contains("rad/s at rest, sensors have less than 1 rad/s: raw counts")
    );
    // One recording twice; rows of which none is left; rows in no order.
    let [one, same] = ["one.csv", "same.csv"].map(|name| write(folder, name, &good));
    refused("six-position", &[one, same], "same.csv hold the same samples");
    let nothing = change("nothing.csv", &|_, row| [&row[..1], &[f64::NAN; 3]].concat());
    let expected = format!("no usable row\n{} damaged places, first: ", good.lines().count() - 1);
    refused("six-position", std::slice::from_ref(&nothing), &expected);
    refused("six-position", &[nothing], "nothing.csv:2: `NaN` is not a number");
    let turned = good.lines().skip(1).collect::<Vec<_>>();
    let (first, second) = turned.split_at(turned.len() / 2);
    let mixed = first.iter().zip(second).flat_map(|(a, b)| [*a, *b]);
    let mixed: Vec<&str> = good.lines().take(1).chain(mixed).collect();
    let mixed = write(folder, "mixed.csv", &mixed.join("\n"));
    refused("six-position", &[mixed], "rows in the order of `time_s` are expected");
    let words = write(folder, "words.csv", "time_s,x,y,z\n0,1,2,3\n");
    refused("six-position", &[words], "no sensor columns; expected ax_mps2");
}

/// Wrong local gravity: no data can tell it from a common scale error, so it is named where it is
/// nowhere found, where it contradicts the latitude, and where all three scales point to it; not
/// stated at all, it is in the uncertainty.
#[test]
fn a_wrong_gravity_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let file = [write(folder, "log.csv", &log(&six_directions(), 1, 1.0, NOISE_MPS2))];
    let told = |more: &[&str]| {
        let output = calibrate(folder, "six-position", &file, more);
        let calibration = found(folder, &output).accelerometer.unwrap();
        (text(&output.stderr) + &text(&output.stdout), calibration)
    };
    let (quiet, _) = told(&["--gravity", "9.81"]);
    assert!(!quiet.contains("right?") && !quiet.contains("wrong local gravity"), "{quiet}");
    let (words, _) = told(&["--gravity", "9.2"]);
    assert!(words.contains("9.2 m/s² is found nowhere on the Earth"), "{words}");
    assert!(words.contains("scale factors are off by +6.7"), "{words}");
    assert!(words.contains("is the local gravity right? 9.81"), "{words}");
    let (words, _) = told(&["--gravity", "9.81", "--latitude-deg", "10"]);
    assert!(words.contains("wrong local gravity?"), "{words}");
    assert!(words.contains("9.7819 m/s² is normal at that latitude"), "{words}");
    let (words, unstated) = told(&[]);
    assert!(words.contains("the local gravity is not stated"), "{words}");
    // Truth 9.81, taken 9.806 ± 0.018: within the stated sigmas all the same.
    errors(&unstated);
    assert!((unstated.matrix_sd[0][0] / (0.018 / 9.806) - 1.0).abs() < 0.02);
    let output = calibrate(folder, "six-position", &file, &["--gravity", "nan"]);
    assert_eq!(output.status.code(), Some(2));
    assert!(text(&output.stderr).contains("--gravity: NaN found"));
}

/// A pause, times that go back, rows that are no numbers: named, and the rest is used. An axis at
/// the end of its range is named.
#[test]
fn damage_in_the_log_is_named_and_survived() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let good = log(&six_directions(), 1, 1.0, NOISE_MPS2);
    let rows: Vec<&str> = good.lines().collect();
    let mut damaged = String::new();
    for (k, line) in rows.iter().enumerate() {
        let time = line.split(',').next().unwrap();
        match k {
            100 => writeln!(damaged, "{time},nan,0,0").unwrap(),
            110 => writeln!(damaged, "{time},1.0").unwrap(),
            120 => writeln!(damaged, "{}", rows[50]).unwrap(),
            200..300 => {}
            _ => writeln!(damaged, "{line}").unwrap(),
        }
    }
    let file = [write(folder, "damaged.csv", &damaged)];
    let output = calibrate(folder, "six-position", &file, &["--gravity", "9.81"]);
    errors(&found(folder, &output).accelerometer.unwrap());
    let told = text(&output.stderr);
    assert!(told.contains("damaged.csv:101: `nan` is not a number"), "{told}");
    assert!(told.contains("damaged.csv:111: column 3 is missing"), "{told}");
    assert!(told.contains("damaged.csv:121: time goes back from 2.36 s to 0.98 s"), "{told}");
    assert!(told.contains("samples are missing in 1 places, 2.02 s in the longest"), "{told}");

    let clipped: String = good
        .lines()
        .map(|line| {
            let clip = |field: &str| match field.parse::<f64>() {
                Ok(value) if value > 9.0 && !line.starts_with(field) => "9.0".to_owned(),
                _ => field.to_owned(),
            };
            line.split(',').map(clip).collect::<Vec<_>>().join(",") + "\n"
        })
        .collect();
    let file = [write(folder, "clipped.csv", &clipped)];
    let output = calibrate(folder, "six-position", &file, &["--gravity", "9.81"]);
    let told = text(&output.stderr);
    assert!(
        told.contains("axis x reads exactly 9.0000 m/s² all through pose 1: saturated"),
        "{told}"
    );
    let told = text(&output.stdout);
    let pair = "agree least with the others: tilted, moved, or an axis saturated?";
    assert!(told.contains(pair), "{told}");
    let nothing = [write(folder, "empty.csv", "time_s,ax_mps2,ay_mps2,az_mps2\n")];
    let output = calibrate(folder, "six-position", &nothing, &[]);
    assert_eq!(output.status.code(), Some(1));
    assert!(text(&output.stderr).contains("empty.csv: no usable row"));
}

/// The whole way: a box simulated in six poses is calibrated, and the arm that carries the same
/// accelerometers loses its tilt error with that calibration.
#[test]
fn a_calibration_improves_the_fusion() {
    let examples = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples");
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let poses = folder.join("poses");
    let scenario = examples.join("calibrate/six-poses.toml");
    run(&["simulate", scenario.to_str().unwrap(), "--out", poses.to_str().unwrap(), "-q"]);
    let file = [poses.join("imu.csv")];
    let at = ["--latitude-deg", "55.75", "--height-m", "200"];
    let output = calibrate(folder, "six-position", &file, &at);
    let calibration = found(folder, &output).accelerometer.unwrap();
    assert!((calibration.bias_mps2[1] + 0.5).abs() < 0.005, "{:?}", calibration.bias_mps2);
    assert!((calibration.matrix[1][2] - 0.003).abs() < 2e-4, "{:?}", calibration.matrix);

    let config = fs::read_to_string(examples.join("fuse/rotating-arm.toml")).unwrap()
        + "matrix = [[1.01, 0.002, 0.0], [0.0, 0.985, 0.003], [0.001, 0.0, 1.008]]\n\
           bias_mps2 = [0.3, -0.5, 0.4]\n";
    let config = config.replace("\"manoeuvring\"", "\"calm\"");
    let key = "sd_mps2 = 0.01\ncalibration = \"out/calibration.toml\"";
    let tilt_deg = |config: &str| {
        let (path, out) = (folder.join("fuse.toml"), folder.join("fused"));
        fs::write(&path, config).unwrap();
        run(&["fuse", path.to_str().unwrap(), "--out", out.to_str().unwrap()]);
        let summary = fs::read_to_string(out.join("summary.json")).unwrap();
        let summary: serde_json::Value = serde_json::from_str(&summary).unwrap();
        let rms = |key: &str| summary["truth"][key].as_f64().unwrap();
        rms("pitch_rms_deg").max(rms("roll_rms_deg"))
    };
    let (raw, calibrated) = (tilt_deg(&config), tilt_deg(&config.replace("sd_mps2 = 0.01", key)));
    assert!(raw > 1.0 && calibrated < 0.5, "{raw} {calibrated}");
}
