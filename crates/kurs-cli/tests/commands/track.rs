//! `kurs track` from end to end: simulated measurements in three formats, a message written by
//! another program, and what it says about broken input.
#![allow(clippy::print_stdout, clippy::unwrap_used)]

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

fn workspace() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

fn kurs(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_kurs")).arg("track").args(arguments).output().unwrap()
}

fn example(name: &str) -> PathBuf {
    workspace().join("examples/track").join(name)
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// Runs the radar example on this file and returns its trajectory table.
fn track_file(folder: &Path, file: &Path) -> String {
    let config = fs::read_to_string(example("radar.toml")).unwrap();
    let file = file.canonicalize().unwrap();
    let config = config.replace("measurements.tdm", &file.display().to_string());
    let config_path = folder.join("from-file.toml");
    fs::write(&config_path, config).unwrap();
    let out = folder.join("from-file");
    let output = kurs(&[config_path.to_str().unwrap(), "--out", out.to_str().unwrap()]);
    assert!(output.status.success(), "{}", text(&output.stderr));
    fs::read_to_string(out.join("trajectory.csv")).unwrap()
}

/// Positions of two tables agree to this many metres.
fn assert_same_path(one: &str, other: &str, tolerance_m: f64) {
    let positions = |table: &str| -> Vec<[f64; 3]> {
        let rows = table.lines().skip(1).map(|line| line.split(',').collect::<Vec<_>>());
        rows.map(|row| [10, 11, 12].map(|column: usize| row[column].parse().unwrap())).collect()
    };
    let (one, other) = (positions(one), positions(other));
    assert_eq!(one.len(), other.len());
    assert!(one.len() > 10);
    for (a, b) in one.iter().zip(&other) {
        for axis in 0..3 {
            assert!((a[axis] - b[axis]).abs() <= tolerance_m, "{a:?} {b:?}");
        }
    }
}

#[test]
fn three_formats_give_one_path_near_the_truth() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("made");
    let config = example("radar.toml");
    let output =
        kurs(&[config.to_str().unwrap(), "--simulate", "--report", "--out", out.to_str().unwrap()]);
    assert!(output.status.success(), "{}", text(&output.stderr));
    let printed = text(&output.stdout);
    assert!(printed.contains("41 points: 41 ok"), "{printed}");
    let rms = printed.split("RMS ").nth(1).unwrap().split(' ').next().unwrap();
    assert!(rms.parse::<f64>().unwrap() < 10.0, "{printed}");

    let direct = fs::read_to_string(out.join("trajectory.csv")).unwrap();
    for name in ["measurements.csv", "measurements.tdm", "measurements.xml"] {
        assert_same_path(&direct, &track_file(folder.path(), &out.join(name)), 0.001);
    }
    let report = fs::read_to_string(out.join("report.html")).unwrap();
    for heading in ["Track", "Height", "Standard deviation along the path", "Residuals by station"]
    {
        assert!(report.contains(heading), "{heading}");
    }
    let kml = fs::read_to_string(out.join("path.kml")).unwrap();
    let on_map = |line: &&str| line.starts_with('3') || line.starts_with('4');
    assert_eq!(kml.lines().filter(on_map).count(), 41);
    let map: serde_json::Value =
        serde_json::from_str(&fs::read_to_string(out.join("path.geojson")).unwrap()).unwrap();
    assert_eq!(map["features"][0]["geometry"]["coordinates"].as_array().unwrap().len(), 41);
}

/// `testdata/track` was written by ccsds-ndm 3.1.1 (`foreign_tdm.py`): the records of the radar
/// example and a Doppler record.
#[test]
fn a_message_of_another_program_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let one = track_file(folder.path(), &workspace().join("testdata/track/foreign.tdm"));
    let other = track_file(folder.path(), &workspace().join("testdata/track/foreign.xml"));
    assert_same_path(&one, &other, 0.0);
}

/// The other program reads ours, both forms, and we read what it writes then.
#[test]
fn another_program_reads_ours() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    let config = example("radar.toml");
    assert!(kurs(&[config.to_str().unwrap(), "--simulate", "--out", out]).status.success());
    let direct = fs::read_to_string(folder.path().join("trajectory.csv")).unwrap();
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/foreign_tdm.py");
    for ours in ["measurements.tdm", "measurements.xml"] {
        let ours = folder.path().join(ours);
        let run = Command::new("python3").arg(&script).arg(ours).arg(out).output();
        let Ok(run) = run else {
            crate::outside::lacking("no python3");
            return;
        };
        if run.status.code() == Some(77) {
            crate::outside::lacking("the Python package ccsds-ndm is not installed");
            return;
        }
        assert!(run.status.success(), "{}", text(&run.stderr));
        assert_eq!(text(&run.stdout).trim(), "206", "41 points of five measurements, a Doppler");
        for theirs in ["foreign.tdm", "foreign.xml"] {
            let path = track_file(folder.path(), &folder.path().join(theirs));
            assert_same_path(&direct, &path, 0.001);
        }
    }
}

/// A reduced run of figure 4: modelled standard deviations of the exactly determined sets within
/// 4.5 % of (2) at 4000 draws (four standard deviations of the modelling itself, 375 comparisons).
#[test]
fn monte_carlo_follows_least_squares() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    let config = example("figure4.toml");
    let output =
        kurs(&[config.to_str().unwrap(), "--simulate", "--monte-carlo", "4000", "--out", out]);
    assert!(output.status.success(), "{}", text(&output.stderr));
    let table = fs::read_to_string(folder.path().join("monte_carlo.csv")).unwrap();
    let mut compared = 0;
    for row in table.lines().skip(1).map(|line| line.split(',').collect::<Vec<_>>()) {
        if ["A3a", "A3g", "RAE", "R3", "RD3"].contains(&row[0]) {
            for axis in 0..3 {
                let number = |column: usize| row[column].parse::<f64>().unwrap();
                let ratio = number(11 + axis) / number(5 + axis);
                assert!((ratio - 1.0).abs() < 0.045, "{row:?}");
                compared += 1;
            }
        }
    }
    assert_eq!(compared, 5 * 25 * 3);
}

/// A message with a segment more, of angles that cannot be used: the path is that of the others,
/// and a note names the segment.
#[test]
fn an_unusable_segment_is_left_out_with_a_note() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).display().to_string();
    let radar = example("radar.toml").display().to_string();
    let made = kurs(&[&radar, "--simulate", "--out", folder.path().to_str().unwrap()]);
    assert!(made.status.success(), "{}", text(&made.stderr));
    let tdm = fs::read_to_string(path("measurements.tdm")).unwrap();
    let station = tdm.lines().find_map(|line| line.strip_prefix("PARTICIPANT_1 = ")).unwrap();
    let stars = format!(
        "META_START\nTIME_SYSTEM = UTC\nPARTICIPANT_1 = {station}\nPARTICIPANT_2 = STAR\n\
         MODE = SEQUENTIAL\nPATH = 2,1\nANGLE_TYPE = RADEC\nMETA_STOP\nDATA_START\n\
         ANGLE_1 = 2024-01-01T00:00:00 10.0\nDATA_STOP\n"
    );
    let solve = |tdm: &str, out: &str| {
        fs::write(path("measurements.tdm"), tdm).unwrap();
        fs::write(path("a.toml"), fs::read_to_string(&radar).unwrap()).unwrap();
        let output = kurs(&[&path("a.toml"), "--out", &path(out)]);
        (fs::read_to_string(folder.path().join(out).join("trajectory.csv")), text(&output.stderr))
    };
    let (wanted, said) = solve(&tdm, "whole");
    assert!(!said.contains("left out"), "{said}");
    let (found, said) = solve(&(tdm.clone() + &stars), "more");
    assert!(said.contains("a segment is left out") && said.contains("RADEC"), "{said}");
    assert_eq!(found.unwrap(), wanted.unwrap());
}

#[test]
fn broken_input_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let refuse = |change: &dyn Fn(String) -> String, measurements: &str, code: i32| {
        let config = change(fs::read_to_string(example("radar.toml")).unwrap());
        fs::write(folder.path().join("a.toml"), config).unwrap();
        fs::write(folder.path().join("measurements.tdm"), measurements).unwrap();
        let (path, out) = (folder.path().join("a.toml"), folder.path().join("out"));
        let output = kurs(&[path.to_str().unwrap(), "--out", out.to_str().unwrap()]);
        assert_eq!(output.status.code(), Some(code), "{}", text(&output.stderr));
        text(&output.stderr)
    };
    let same = |config: String| config;
    let csv = "time_s,station,azimuth_deg,elevation_deg\n0.0,S1,10.0,20.0\n1.0,S9,10.0,20.0\n";
    assert!(refuse(&same, csv, 1).contains("line 3: no station is called `S9`"));
    let csv = "time_s,station,azimuth_deg\n0.0,S1,north\n";
    assert!(refuse(&same, csv, 1).contains("line 2: azimuth_deg: `north` is not a number"));
    let csv = "time_s,station,azimut_deg\n0.0,S1,10.0\n";
    assert!(refuse(&same, csv, 1).contains("unknown column `azimut_deg`"));
    let tdm =
        "CCSDS_TDM_VERS = 2.0\nMETA_START\nTIME_SYSTEM = NEVER\nMETA_STOP\nDATA_START\nDATA_STOP\n";
    assert!(refuse(&same, tdm, 1).contains("line 3: TIME_SYSTEM: `NEVER` found"));
    let typo = |config: String| config.replace("range_sd_m", "range_sdm");
    assert!(refuse(&typo, csv, 2).contains("did you mean `range_sd_m`?"));
    let twice = |config: String| config.replace("\"S2\"", "\"S1\"");
    assert!(refuse(&twice, csv, 2).contains("two stations are called `S1`"));
}

#[test]
fn keys_that_no_measurement_has_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    let radar = example("radar.toml").display().to_string();
    for (set, said) in [
        ("same_time_s=-1", "track.same_time_s is -1, expected 0 to 60"),
        ("same_time_s=1e9", "track.same_time_s is 1000000000, expected 0 to 60"),
        ("outlier_probability=2", "track.outlier_probability is 2, expected 0 to 1"),
        ("outlier_probability=nan", "track.outlier_probability is NaN, expected 0 to 1"),
        ("range_difference_correlation=2", "track.range_difference_correlation is 2, expected"),
        ("jerk_mps2_per_sqrt_s=1e300", "track.jerk_mps2_per_sqrt_s is 1"),
        ("heights_m=[5,1]", "track.heights_m: the higher height is 1, expected 5 to"),
        ("start_utc=\"x\"", "track.start_utc is `x`, expected such as 2026-01-01T00:00:00"),
        ("prior={position_ecef_m=[nan,0,0]}", "track.prior: the height of position_ecef_m is NaN"),
        ("refraction.scale_height_m=0", "refraction.scale_height_m is 0, expected 1000 to"),
        ("simulate.interval_s=1e-6", "simulate.interval_s is 0.000001, expected 0.002 to"),
        ("simulate.interval_s=0", "simulate.interval_s is 0, expected 0.002 to"),
    ] {
        let output = kurs(&[&radar, "--simulate", "--set", set, "--out", out]);
        let said_so = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{set}: {said_so}");
        assert!(said_so.contains(said) && said_so.contains("radar.toml"), "{set}: {said_so}");
    }
    let config = fs::read_to_string(example("radar.toml")).unwrap();
    let changed = folder.path().join("a.toml");
    for (from, to, said) in [
        ("= 65.5", "= 165.5", "station `S1`: latitude_deg is 165.5, expected -90 to 90"),
        ("= 65.5", "= nan", "station `S1`: latitude_deg is NaN"),
        ("= 150.0", "= 1e9", "station `S1`: height_m is 1000000000, expected -10000 to 100000"),
        ("range_sd_m = 5.0", "range_sd_m = 0.0", "station `S2`: range_sd_m is 0, expected"),
        ("range_sd_m = 5.0", "range_sd_m = inf", "station `S2`: range_sd_m is inf, expected"),
        ("azimuth_bias_sd_deg = 0.1", "azimuth_bias_sd_deg = -1.0", "azimuth_bias_sd_deg is -1"),
        ("time_s = 0.0", "time_s = -1e11", "simulate.waypoint: time_s is -100000000000"),
    ] {
        fs::write(&changed, config.replacen(from, to, 1)).unwrap();
        let output = kurs(&[changed.to_str().unwrap(), "--simulate", "--out", out]);
        let said_so = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{to}: {said_so}");
        assert!(said_so.contains(said), "{to}: {said_so}");
    }
}

#[test]
fn rows_that_no_station_measures_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let config = fs::read_to_string(example("radar.toml")).unwrap();
    let path = folder.path().join("a.toml");
    fs::write(&path, config.replace("\"smooth\"", "\"points\"")).unwrap();
    let refuse = |csv: &str, said: &str| {
        fs::write(folder.path().join("measurements.tdm"), csv).unwrap();
        let out = folder.path().join("out");
        let output = kurs(&[path.to_str().unwrap(), "--out", out.to_str().unwrap()]);
        let said_so = text(&output.stderr);
        assert_eq!(output.status.code(), Some(1), "{csv}: {said_so}");
        assert!(said_so.contains(said), "{csv}: {said_so}");
    };
    let row = |header: &str, row: &str| format!("time_s,station,{header}\n{row}\n");
    for time in ["1e11", "1e300", "-1e11", "inf"] {
        let said = "line 2: time_s is ";
        refuse(&row("azimuth_deg", &format!("{time},S1,10")), said);
    }
    refuse(&row("elevation_deg", "0,S1,100"), "line 2: elevation 100 deg, expected -90 to 90");
    refuse(&row("range_m", "0,S2,-50000"), "line 2: range -50000 m, expected 0 to");
    refuse(&row("cosine_north,cosine_north_sd", "0,S2,1.1,0.01"), "line 2: cosine_north 1.1");
    refuse(
        "time_s,time_utc,station,range_m\n0,2026-01-01T00:00:00,S2,5e4\n",
        "line 1: 2 of the columns time_utc, time_gpst, time_s found, one expected",
    );
    refuse(&row("range_m", "0,S2,5e4"), "error: every point is lost, the first one because: ");
    // Noise beyond the zenith is none of the row's faults.
    let zenith = row("azimuth_deg,elevation_deg,range_m", "0,S2,10,90.01,5e4");
    refuse(&zenith, "the geometry does not determine the position");
}

/// Two stations with angles, one with a range: a flight along a meridian, a row a second; `wrong` is
/// added to the range at a time.
fn flight(seconds: u32, wrong: impl Fn(u32) -> f64) -> (String, String) {
    let folder = tempfile::tempdir().unwrap();
    let config = format!(
        "[[station]]\nname = \"A\"\nlatitude_deg = 54.9\nlongitude_deg = 36.5\nheight_m = 100\n\
         azimuth_sd_deg = 0.01\nelevation_sd_deg = 0.01\nrange_sd_m = 3\n\
         [[station]]\nname = \"B\"\nlatitude_deg = 55.3\nlongitude_deg = 37.2\nheight_m = 150\n\
         azimuth_sd_deg = 0.01\nelevation_sd_deg = 0.01\nrange_sd_m = 3\n\
         [track]\nfiles = [\"m.csv\"]\nmodel = \"smooth\"\njerk_mps2_per_sqrt_s = 0.3\n\
         [simulate]\nseed = 3\nmeasure = [\"A azimuth\", \"A elevation\", \"B azimuth\", \
         \"B elevation\", \"B range\"]\n\
         [[simulate.waypoint]]\ntime_s = 0\nlatitude_deg = 55\nlongitude_deg = 37\nheight_m = 8000\n\
         [[simulate.waypoint]]\ntime_s = {seconds}\nlatitude_deg = {}\nlongitude_deg = 37\n\
         height_m = 8000\n",
        55.0 + 0.002 * f64::from(seconds)
    );
    let path = folder.path().join("c.toml");
    fs::write(&path, &config).unwrap();
    let made =
        kurs(&[path.to_str().unwrap(), "--simulate", "--out", folder.path().to_str().unwrap()]);
    assert!(made.status.success(), "{}", text(&made.stderr));
    let table = fs::read_to_string(folder.path().join("measurements.csv")).unwrap();
    let rows = table.lines().enumerate().map(|(k, row)| {
        let mut fields: Vec<String> = row.split(',').map(str::to_owned).collect();
        if let (1.., Ok(range)) = (k, fields[5].parse::<f64>()) {
            let second = u32::try_from((k - 1) / 5).unwrap();
            fields[5] = (range + wrong(second)).to_string();
        }
        fields.join(",") + "\n"
    });
    (config, rows.collect())
}

/// Runs on these measurements; the folder, what was printed and what was said beside it.
fn solve(config: &str, measurements: &str) -> (tempfile::TempDir, String, String) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("c.toml");
    fs::write(&path, config).unwrap();
    fs::write(folder.path().join("m.csv"), measurements).unwrap();
    let out = folder.path().join("out");
    let output = kurs(&[path.to_str().unwrap(), "--out", out.to_str().unwrap()]);
    (folder, text(&output.stdout), text(&output.stderr))
}

/// A range that is 300 m off from the 60th second on is left out by name, the healthy angles stay, and
/// the points say how likely their residuals are.
#[test]
fn a_wrong_station_is_named_and_the_healthy_ones_are_kept() {
    let (config, measurements) = flight(120, |second| if second > 60 { 300.0 } else { 0.0 });
    let (folder, printed, said) = solve(&config, &measurements);
    assert!(
        said.contains("station `B`, range: 60 of 121 measurements are left out (50 %)"),
        "{said}"
    );
    assert!(!said.contains("`A`"), "{said}");
    assert!(printed.contains("121 points: 12") && printed.contains(" 0 lost"), "{printed}");
    let table = fs::read_to_string(folder.path().join("out/trajectory.csv")).unwrap();
    let likelihoods =
        table.lines().skip(1).map(|row| row.split(',').nth(6).unwrap().parse::<f64>());
    let likelihoods: Vec<f64> = likelihoods.map(Result::unwrap).collect();
    let mean = likelihoods.iter().sum::<f64>() / likelihoods.len() as f64;
    assert!((mean - 0.5).abs() < 0.15, "{mean}");
}

/// Standard deviations of a third of the noise: nothing is thrown out, no point is `ok`. An instant of
/// one wrong measurement leaves a row.
#[test]
fn what_the_smoother_does_not_believe_is_told() {
    let (config, measurements) = flight(120, |_| 0.0);
    let small = config.replace("_sd_deg = 0.01", "_sd_deg = 0.003").replace("sd_m = 3", "sd_m = 1");
    let (_, printed, said) = solve(&small, &measurements);
    assert!(
        printed.contains("121 points: 0 ok, 0 ambiguous, 121 inconsistent, 0 lost"),
        "{printed}"
    );
    assert!(printed.contains("the residuals are 3.") && said.is_empty(), "{printed}{said}");

    let alone = measurements.clone() + "2026-01-01T00:01:00.5,B,,,,99000,,,\n";
    let (folder, printed, _) = solve(&config, &alone);
    assert!(printed.contains("122 points: ") && printed.contains(" 1 lost"), "{printed}");
    let table = fs::read_to_string(folder.path().join("out/trajectory.csv")).unwrap();
    assert!(table.contains(",lost,all 1 measurements of this time are left out,1,1,"), "{table}");
}

/// Each row twice gives the covariance of once.
#[test]
fn repeated_measurements_count_once() {
    let (config, measurements) = flight(20, |_| 0.0);
    let (header, rows) = measurements.split_once('\n').unwrap();
    let (once, ..) = solve(&config, &measurements);
    let (twice, _, said) = solve(&config, &format!("{header}\n{rows}{rows}"));
    assert!(said.contains("105 of 210 measurements are exact repeats"), "{said}");
    let table = |folder: &tempfile::TempDir| {
        fs::read_to_string(folder.path().join("out/trajectory.csv")).unwrap()
    };
    assert_eq!(table(&once), table(&twice));
}

#[test]
fn results_of_an_older_run_are_gone_when_new_input_is_refused() {
    let (config, measurements) = flight(20, |_| 0.0);
    let (folder, ..) = solve(&config, &measurements);
    assert!(folder.path().join("out/trajectory.csv").exists());
    fs::write(folder.path().join("m.csv"), "time_s,station,azimuth_deg\n0,A,xx\n").unwrap();
    let (config, out) = (folder.path().join("c.toml"), folder.path().join("out"));
    let output = kurs(&[config.to_str().unwrap(), "--out", out.to_str().unwrap()]);
    assert_eq!(output.status.code(), Some(1));
    assert!(!folder.path().join("out/trajectory.csv").exists());
}

/// A path from 179.9° east to 179.9° west is 11 km long, not round the Earth.
#[test]
fn a_simulated_path_crosses_the_date_line() {
    let (config, _) = flight(20, |_| 0.0);
    let config = config
        .replace("longitude_deg = 36.5", "longitude_deg = 179.5")
        .replace("longitude_deg = 37.2", "longitude_deg = -179.5")
        .replacen("longitude_deg = 37\n", "longitude_deg = 179.9\n", 1)
        .replacen("longitude_deg = 37\n", "longitude_deg = -179.9\n", 1);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("c.toml");
    fs::write(&path, config).unwrap();
    let out = folder.path().to_str().unwrap();
    let output = kurs(&[path.to_str().unwrap(), "--simulate", "--out", out]);
    assert!(output.status.success(), "{}", text(&output.stderr));
    let truth = fs::read_to_string(folder.path().join("truth.csv")).unwrap();
    for row in truth.lines().skip(1) {
        let longitude_deg: f64 = row.split(',').nth(2).unwrap().parse().unwrap();
        assert!(longitude_deg.abs() > 179.8, "{row}");
    }
}

#[test]
fn one_draw_tells_no_interval() {
    let folder = tempfile::tempdir().unwrap();
    let config = example("figure4.toml").display().to_string();
    let out = folder.path().to_str().unwrap();
    let output = kurs(&[&config, "--simulate", "--monte-carlo", "1", "--out", out]);
    let printed = text(&output.stdout);
    assert!(output.status.success(), "{}", text(&output.stderr));
    assert!(printed.contains("95 % interval of one unknown: too few draws"), "{printed}");
    assert!(!printed.contains("inf") && !printed.contains("NaN"), "{printed}");
}
