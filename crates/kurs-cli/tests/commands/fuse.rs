//! `kurs fuse` from end to end: a simulated arm, the files of one, and what damaged input does.
#![allow(clippy::unwrap_used)]

use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Output;

use crate::program::{edit, kurs, text};

fn example() -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples/fuse/rotating-arm.toml");
    fs::read_to_string(path).unwrap()
}

/// Runs `kurs fuse` on this configuration in `folder`; the output goes to `folder/out`.
fn fuse(folder: &Path, config: &str, more: &[&str]) -> Output {
    let path = folder.join("config.toml");
    fs::write(&path, config).unwrap();
    let out = folder.join("out");
    let mut arguments = vec!["fuse", path.to_str().unwrap(), "--out", out.to_str().unwrap()];
    arguments.extend(more);
    kurs(&arguments)
}

fn summary(folder: &Path) -> serde_json::Value {
    let file = fs::read_to_string(folder.join("out/summary.json")).unwrap();
    serde_json::from_str(&file).unwrap()
}

/// The columns of a table by name, empty fields as NaN.
fn columns(path: &Path, names: &[&str]) -> Vec<Vec<f64>> {
    let table = fs::read_to_string(path).unwrap();
    let mut lines = table.lines();
    let header: Vec<&str> = lines.next().unwrap().split(',').collect();
    let places: Vec<usize> =
        names.iter().map(|name| header.iter().position(|h| h == name).unwrap()).collect();
    let row = |line: &str| {
        let fields: Vec<&str> = line.split(',').collect();
        places.iter().map(|place| fields[*place].parse().unwrap_or(f64::NAN)).collect()
    };
    lines.map(row).collect()
}

/// Root mean square errors of heading, pitch, roll over the rows of a time window (seconds from
/// the first row).
fn errors_deg(folder: &Path, truth: &Path, from_s: f64, to_s: f64) -> [f64; 3] {
    let names = ["tow_s", "heading_deg", "pitch_deg", "roll_deg"];
    let (found, truth) =
        (columns(&folder.join("out/attitude.csv"), &names), columns(truth, &names));
    let (mut squares, mut count) = ([0.0; 3], 0.0);
    for row in &found {
        let since_s = row[0] - found[0][0];
        if since_s < from_s || since_s >= to_s || row[1].is_nan() {
            continue;
        }
        let wanted = truth.iter().find(|t| (t[0] - row[0]).abs() < 1e-3).unwrap();
        for (k, square) in squares.iter_mut().enumerate() {
            let error = (row[k + 1] - wanted[k + 1] + 180.0).rem_euclid(360.0) - 180.0;
            *square += error * error;
        }
        count += 1.0;
    }
    squares.map(|square| (square / count).sqrt())
}

/// Writes the inputs of the example (with `from` replaced by `to`) and returns their folder.
fn inputs(folder: &Path, from: &str, to: &str) -> PathBuf {
    let made = folder.join("made");
    let config = example().replace(from, to);
    let output = fuse(folder, &config, &["--write-inputs", made.to_str().unwrap()]);
    assert!(output.status.success(), "{}", text(&output.stderr));
    made
}

/// Fuses the files in `made`; the output goes to `folder/out`.
fn fuse_files(folder: &Path, made: &Path) -> Output {
    let (config, out) = (made.join("fuse.toml"), folder.join("out"));
    let truth = made.join("truth.csv");
    let [config, out, truth] = [&config, &out, &truth].map(|path| path.to_str().unwrap());
    kurs(&["fuse", config, "--out", out, "--truth", truth])
}

/// Bounds of the reference for the manoeuvring filter in uniform motion: steady heading 0.83°, tilt
/// 0.78°, 1.6° in the turn, over many runs; here one run, with half as much again.
#[test]
fn files_of_a_simulated_arm_give_its_attitude() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let made = inputs(folder, "", "");
    let output = fuse_files(folder, &made);
    assert!(output.status.success(), "{}", text(&output.stderr));
    let truth = made.join("truth.csv");
    let [heading, pitch, roll] = errors_deg(folder, &truth, 10.0, 20.0);
    assert!(
        heading < 1.5 * 0.83 && pitch < 1.5 * 0.78 && roll < 1.5 * 0.78,
        "{heading} {pitch} {roll}"
    );
    let [heading, ..] = errors_deg(folder, &truth, 20.0, 23.9);
    assert!(heading < 1.5 * 1.6, "{heading}");
    let summary = summary(folder);
    assert_eq!(summary["lost"], 0);
    assert_eq!(summary["float"], 401);
    assert_eq!(summary["filter"]["gnss"]["rejected"], 0);
    let normalised = summary["truth"]["heading_normalised"].as_f64().unwrap();
    assert!(normalised < 2.0, "{normalised}");
    let from_files = columns(&folder.join("out/attitude.csv"), &["heading_deg", "height_m"]);

    // The same measurements without files: RINEX and CSV only round them.
    let output = fuse(folder, &example(), &[]);
    assert!(output.status.success(), "{}", text(&output.stderr));
    let direct = columns(&folder.join("out/attitude.csv"), &["heading_deg", "height_m"]);
    assert_eq!(direct.len(), from_files.len());
    for (one, other) in direct.iter().zip(&from_files) {
        assert!((one[0] - other[0]).abs() < 0.05 && (one[1] - other[1]).abs() < 0.05);
    }
}

/// Every option that changes what is estimated or how the arm is built.
#[test]
fn options_of_arm_and_filter() {
    let arm = "rate_hz = 1.0";
    let filter = "tuning = \"manoeuvring\"";
    for (from, to, bound_deg) in [
        (filter, "tuning = \"balanced\"\nattitude = \"euler\"", 0.6),
        (filter, "tuning = \"calm\"", 0.6),
        (filter, "tuning = \"manoeuvring\"\nstates = 20\nattitude = \"quaternion\"", 1.6),
        (
            arm,
            "rate_hz = 1.0\nmounting_deg = [25.0, -10.0, 15.0]\ncentre_m = [0.4, -0.3, -0.5]",
            1.5,
        ),
        (arm, "rate_hz = 1.0\naccelerometers_turn = true", 1.3),
        (filter, "tuning = \"balanced\"\nadaptive = true", 0.6),
        (filter, "tuning = \"calm\"\nsecond_order = false", 0.6),
        (filter, "tuning = \"calm\"\njerk_m2_per_s5 = 1.0\nturning_density = 0.003", 0.6),
        ("sd_mps2 = 0.01", "sd_mps2 = 0.01\nbias_sd_mps2 = 0.02", 1.3),
        (arm, "rate_hz = 0.7\nphase_deg = 200.0", 1.5),
        ("range_rate_sd_mps = 0.1", "range_rate_sd_mps = 0.1\nphase_sd_m = 0.004", 1.3),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path();
        let config = example().replace(from, to);
        assert_ne!(config, example());
        let output = fuse(folder, &config, &[]);
        assert!(output.status.success(), "{}", text(&output.stderr));
        let [heading, pitch, roll] = errors_deg(folder, &folder.join("out/truth.csv"), 10.0, 20.0);
        let worst = heading.max(pitch).max(roll);
        assert!(worst < bound_deg, "{to}: {heading} {pitch} {roll}");
    }
}

/// An encoder measures the arm's angle, whose stated zero is 20° off: the filter finds the
/// correction. Without it that looks like 20° of pitch.
#[test]
fn the_angle_of_the_arm_is_an_input_of_its_own() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let made = inputs(folder, "", "");
    edit(&made.join("accelerometer.csv"), |k, line| {
        let first: f64 = line.split(',').next().unwrap_or_default().parse().unwrap_or(0.0);
        // One turn a second from second of week zero; 0.1° of noise by a saw-tooth.
        let noise_deg = 0.17 * ((k % 7) as f64 - 3.0) / 3.0;
        let angle_deg = 360.0 * first.fract() + noise_deg;
        Some(if k == 0 { format!("{line},arm_deg") } else { format!("{line},{angle_deg:.4}") })
    });
    let path = made.join("fuse.toml");
    let exact = fs::read_to_string(&path).unwrap();
    let off = exact.replace("phase_deg = 0.0", "phase_deg = 20.0");
    assert_ne!(exact, off);
    let truth = made.join("truth.csv");
    for (sd_deg, is_good) in [("30.0", true), ("0.0", false)] {
        let text_of = off.replace("phase_sd_deg = 0.0", &format!("phase_sd_deg = {sd_deg}"));
        fs::write(&path, text_of).unwrap();
        let output = fuse_files(folder, &made);
        assert!(output.status.success(), "{}", text(&output.stderr));
        let [heading, pitch, roll] = errors_deg(folder, &truth, 10.0, 20.0);
        assert_eq!(heading.max(roll) < 1.5 && pitch < 1.5, is_good, "{heading} {pitch} {roll}");
    }
}

/// A tenth of the scale and bias of a poor sensor; without its calibration the tilt is off by b/g.
#[test]
fn a_calibration_is_applied() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let errors = "matrix = [[1.01, 0.002, 0.0], [0.0, 0.985, 0.003], [0.001, 0.0, 1.008]]\n\
                  bias_mps2 = [0.3, -0.5, 0.4]\n";
    let config = example().replace("\"manoeuvring\"", "\"calm\"") + errors;
    let output = fuse(folder, &config, &[]);
    assert!(output.status.success(), "{}", text(&output.stderr));
    let truth = folder.join("out/truth.csv");
    let [_, pitch, roll] = errors_deg(folder, &truth, 10.0, 20.0);
    assert!(pitch.max(roll) > 1.0, "{pitch} {roll}");

    let calibration = errors.replace("matrix", "[accelerometer]\nmatrix");
    fs::write(folder.join("calibration.toml"), calibration).unwrap();
    let calibrated =
        config.replace("sd_mps2 = 0.01", "sd_mps2 = 0.01\ncalibration = \"calibration.toml\"");
    let output = fuse(folder, &calibrated, &[]);
    assert!(output.status.success(), "{}", text(&output.stderr));
    let [heading, pitch, roll] = errors_deg(folder, &truth, 10.0, 20.0);
    assert!(heading.max(pitch).max(roll) < 0.6, "{heading} {pitch} {roll}");
}

/// Rows that are no numbers, rows out of order (in and beyond the window), a pause, saturation.
#[test]
fn damage_in_the_accelerometer_log_is_named_and_survived() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let made = inputs(folder, "sd_mps2 = 0.01", "sd_mps2 = 0.01\nrange_mps2 = 80.0");
    let log = made.join("accelerometer.csv");
    let rows: Vec<String> = fs::read_to_string(&log).unwrap().lines().map(str::to_owned).collect();
    edit(&log, |k, line| {
        let time = line.split(',').next().unwrap_or_default();
        match k {
            1300 => Some(format!("{time},nan,0.0,0.0")),
            1310 => Some(format!("{time},broken")),
            // 50 ms late, put back in its place; then 3 s late, refused.
            1400 => Some(rows[1405].clone()),
            1405 => Some(rows[1400].clone()),
            1500 => Some(rows[1200].clone()),
            1600..1610 => Some(format!("{time},80.0,0.0,0.0")),
            1700..1900 => None,
            _ => Some(line.to_owned()),
        }
    });
    let output = fuse_files(folder, &made);
    assert!(output.status.success(), "{}", text(&output.stderr));
    let summary = summary(folder);
    let filter = &summary["filter"];
    assert_eq!((&filter["saturated"], &filter["too_late"]), (&10.into(), &1.into()));
    let damage = summary["damage"].as_array().unwrap();
    let named = |line: u64, what: &str| {
        damage.iter().any(|d| d["line"] == line && d["what"].as_str().unwrap().contains(what))
    };
    assert!(named(1301, "`nan` is not a number"), "{damage:?}");
    assert!(named(1311, "`broken` is not a number"), "{damage:?}");
    assert_eq!(damage.len(), 2);
    let [heading, ..] = errors_deg(folder, &made.join("truth.csv"), 30.0, 40.0);
    assert!(heading < 1.5, "{heading}");
}

/// A pause of both sensors that cannot be bridged: the filter says so and starts again.
#[test]
fn a_long_gap_starts_the_filter_anew() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let made = inputs(folder, "speed_mps = 20.0", "speed_mps = 20.0\nduration_s = 60.0");
    edit(&made.join("accelerometer.csv"), |k, line| {
        (!(2500..3800).contains(&k)).then(|| line.to_owned())
    });
    let mut inside = false;
    edit(&made.join("arm.rnx"), |_, line| {
        if let Some(epoch) = line.strip_prefix('>') {
            let second: f64 = epoch[17..28].trim().parse().unwrap();
            inside = (25.0..38.0).contains(&second) && epoch[14..17].trim() == "00";
        }
        (!inside).then(|| line.to_owned())
    });
    let output = fuse_files(folder, &made);
    assert!(output.status.success(), "{}", text(&output.stderr));
    let told = text(&output.stderr);
    assert!(told.contains("filter stopped: gap of 13."), "{told}");
    let [heading, ..] = errors_deg(folder, &made.join("truth.csv"), 45.0, 60.0);
    assert!(heading < 1.5, "{heading}");
}

/// Ten seconds each with three satellites, one and none: the filter goes on and finds back.
#[test]
fn few_satellites_are_used_as_they_are() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let made = inputs(folder, "speed_mps = 20.0", "speed_mps = 20.0\nduration_s = 60.0");
    let (mut seen, mut allowed) = (0, usize::MAX);
    edit(&made.join("arm.rnx"), |_, line| {
        if let Some(epoch) = line.strip_prefix('>') {
            let second: f64 = epoch[17..28].trim().parse().unwrap();
            seen = 0;
            allowed = match second {
                25.0..30.0 => 3,
                30.0..35.0 => 1,
                35.0..40.0 => 0,
                _ => usize::MAX,
            };
            if epoch[14..17].trim() != "00" {
                allowed = usize::MAX;
            }
            let count: usize = epoch[31..34].trim().parse().unwrap();
            return Some(format!(">{}{:3}", &epoch[..31], count.min(allowed)));
        }
        let is_satellite = line.len() > 20 && line.starts_with('G') && &line[1..3] != "  ";
        seen += usize::from(is_satellite);
        (!is_satellite || seen <= allowed).then(|| line.to_owned())
    });
    let output = fuse_files(folder, &made);
    assert!(output.status.success(), "{}", text(&output.stderr));
    let table = columns(&folder.join("out/attitude.csv"), &["satellites", "heading_deg"]);
    assert_eq!(table.len(), 601);
    for (satellites, from, to) in [(3.0, 260, 299), (1.0, 310, 349), (0.0, 360, 399)] {
        assert!(table[from..to].iter().all(|row| row[0] == satellites), "{satellites}");
    }
    assert!(table.iter().all(|row| row[1].is_finite()));
    let [heading, ..] = errors_deg(folder, &made.join("truth.csv"), 45.0, 60.0);
    assert!(heading < 1.5, "{heading}");
}

#[test]
fn a_truth_of_another_time_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let truth = folder.path().join("truth.csv");
    fs::write(&truth, "gps_week,tow_s,heading_deg,pitch_deg,roll_deg\n2000,0,0,0,0\n").unwrap();
    let truth = truth.to_str().unwrap();
    let more = ["--truth", truth, "--set", "simulate.duration_s=3"];
    let told = text(&fuse(folder.path(), &example(), &more).stdout);
    assert!(told.contains("against the truth: no row is of a time that it has"), "{told}");
}

#[test]
fn wrong_units_and_wrong_configurations_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let made = inputs(folder, "", "");
    let good = fs::read_to_string(made.join("accelerometer.csv")).unwrap();
    let scaled = |factor: f64, header: &str| {
        let mut log = header.to_owned() + "\n";
        for line in good.lines().skip(1) {
            let mut fields = line.split(',').map(|field| field.parse::<f64>().unwrap());
            let time_s = fields.next().unwrap();
            let values: Vec<String> = fields.map(|v| format!("{:.8}", v * factor)).collect();
            writeln!(log, "{time_s},{}", values.join(",")).unwrap();
        }
        fs::write(made.join("accelerometer.csv"), log).unwrap();
        fuse_files(folder, &made)
    };
    let output = scaled(1.0 / 9.806_65, "time_s,ax_mps2,ay_mps2,az_mps2");
    assert_eq!(output.status.code(), Some(1));
    let told = text(&output.stderr);
    assert!(told.contains("the unit is probably g, name it in the header"), "{told}");
    // Named in the header it is no error.
    let output = scaled(1.0 / 9.806_65, "time_s,ax_g,ay_g,az_g");
    assert!(output.status.success(), "{}", text(&output.stderr));

    for (from, to, expected) in [
        ("\"manoeuvring\"", "\"wild\"", "filter.tuning: `wild` found, manoeuvring, balanced, calm"),
        ("radius_m = 1.0", "radius_m = 0.0", "arm.radius_m: 0 found, more than 0 expected"),
        ("rate_hz = 1.0", "rate_hz = 0.0", "arm.rate_hz: 0 found, 0.01 to 100 turns a second"),
        ("radius_m = 1.0", "radius = 1.0", "unknown key `radius`, did you mean `radius_m`?"),
        ("[simulate]", "[other]", "unknown key `other`"),
        ("tuning", "states = 18\ntuning", "filter.states: 18 found, 17 or 20 expected"),
        ("speed_mps = 20.0", "duration_s = -1.0", "simulate.duration_s: -1 must be between"),
    ] {
        let output = fuse(folder, &example().replace(from, to), &[]);
        assert_eq!(output.status.code(), Some(2));
        let told = text(&output.stderr);
        assert!(told.contains(expected), "{told}");
    }
}
