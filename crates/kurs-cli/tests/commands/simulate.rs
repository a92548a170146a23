//! `kurs simulate` from scenario to files, and `kurs solve --truth` on them.
#![allow(clippy::unwrap_used, clippy::print_stdout)] // tests

use std::fs;
use std::path::Path;
use std::process::{Command as Foreign, Output};

use assert_cmd::Command;
use kurs::observation::AntennaEpoch;
use kurs_formats::observations::ObservationSource;

const SCENARIO: &str = r#"
start = "2024-03-10T12:00:00"
duration_s = 30.0
interval_s = 1.0
signals = ["G1C", "G2W", "R1C", "E1C", "E5Q"]
[sky]
systems = ["G", "R", "E"]
[slips]
per_hour = 60.0
flagged_share = 0.5
[output]
formats = ["crinex.gz", "crinex", "rinex.gz", "rinex"]
[[outage]]
from_s = 10.0
to_s = 14.0
satellites = ["G05", "E03"]
[[body]]
name = "boat"
[body.motion]
kind = "ship"
place = { latitude_deg = 59.9, longitude_deg = 29.7, height_m = 10.0 }
heading_deg = 280.0
speed_mps = 6.0
period_s = 8.0
roll_rms_deg = 5.0
pitch_rms_deg = 2.0
[[body.antenna]]
name = "bow"
position_m = [2.0, 0.0, 0.0]
[[body.antenna]]
name = "port"
position_m = [0.0, -0.8, 0.0]
[[body.antenna]]
name = "starboard"
position_m = [0.0, 0.8, 0.0]
"#;

fn kurs(arguments: &[&Path]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_kurs")).args(arguments).output().unwrap()
}

fn simulated(text: &str) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let scenario = folder.path().join("scenario.toml");
    fs::write(&scenario, text).unwrap();
    let output = kurs(&["simulate".as_ref(), &scenario, "--out".as_ref(), folder.path()]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    folder
}

fn epochs(path: &Path) -> Vec<AntennaEpoch> {
    let mut source = ObservationSource::open(path).unwrap();
    let (mut all, mut epoch) = (Vec::new(), AntennaEpoch::default());
    while source.next_epoch(&mut epoch).unwrap() {
        all.push(epoch.clone());
    }
    assert_eq!(source.damage(), [], "{}", path.display());
    all
}

#[test]
fn all_formats_hold_the_same_observations() {
    let folder = simulated(SCENARIO);
    let plain = epochs(&folder.path().join("bow.rnx"));
    assert_eq!(plain.len(), 31);
    for ending in ["rnx.gz", "crx", "crx.gz"] {
        assert_eq!(epochs(&folder.path().join(format!("bow.{ending}"))), plain, "{ending}");
    }
    let nav = fs::read_to_string(folder.path().join("nav.rnx")).unwrap();
    assert!(nav.lines().any(|l| l.starts_with("GPSA") && l.contains("5.0069")), "{nav:.400}");
}

/// The tool that defines the compact form gives back the very text of the plain file.
#[test]
fn the_foreign_expander_gives_the_plain_text() {
    let folder = simulated(SCENARIO);
    let script = "import sys, hatanaka\n\
        sys.stdout.buffer.write(hatanaka.crx2rnx(open(sys.argv[1], 'rb').read()))";
    let compact = folder.path().join("bow.crx");
    let output = Foreign::new("python3").args(["-c", script]).arg(&compact).output();
    let Some(output) = output.ok().filter(|output| output.status.success()) else {
        crate::outside::lacking("python3 has no package hatanaka");
        return;
    };
    let lines = |text: &str| text.lines().map(|l| l.trim_end().to_owned()).collect::<Vec<_>>();
    let plain = fs::read_to_string(folder.path().join("bow.rnx")).unwrap();
    assert_eq!(lines(&String::from_utf8(output.stdout).unwrap()), lines(&plain));
}

/// Integers are compared with `ambiguities.csv`, through slips and outages.
#[test]
fn the_solution_is_laid_against_the_true_integers() {
    let folder = simulated(SCENARIO);
    let path = |name: &str| folder.path().join(name);
    let solve = |truth: &Path| {
        let output = kurs(&[
            "solve".as_ref(),
            &path("kurs.toml"),
            "--truth".as_ref(),
            truth,
            "--out".as_ref(),
            &path("out"),
        ]);
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8(output.stdout).unwrap()
    };
    let value = |text: &str, name: &str| -> u64 {
        let line = text.lines().find(|line| line.starts_with(name)).unwrap();
        line[name.len()..].trim().parse().unwrap()
    };
    let right = solve(&path("truth.csv"));
    assert_eq!(value(&right, "wrong (any integer)"), 0, "{right}");

    // One whole cycle more in the table, and every fix that rests on that phase is wrong.
    let table = fs::read_to_string(path("ambiguities.csv")).unwrap();
    let mut spoilt = csv::Writer::from_path(path("spoilt.csv")).unwrap();
    let mut reader = csv::Reader::from_reader(table.as_bytes());
    spoilt.write_record(reader.headers().unwrap()).unwrap();
    for record in reader.records() {
        let mut fields: Vec<String> = record.unwrap().iter().map(str::to_owned).collect();
        if fields[2] == "port" && fields[4] == "G1C" {
            let spoil: i64 = fields[3][1..].parse().unwrap();
            fields[5] = (fields[5].parse::<i64>().unwrap() + spoil).to_string();
        }
        spoilt.write_record(&fields).unwrap();
    }
    drop(spoilt);
    fs::rename(path("spoilt.csv"), path("ambiguities.csv")).unwrap();
    let wrong = solve(&path("truth.csv"));
    assert!(value(&wrong, "wrong (any integer)") >= 20, "{wrong}");
}

/// Two runs of one scenario write the same bytes, whatever the format.
#[test]
fn the_same_scenario_writes_the_same_files() {
    let text = SCENARIO.replace("formats = [", "formats = [\"ubx\", \"rtcm3\", \"sbf\", ");
    let [one, other] = [simulated(&text), simulated(&text)];
    let mut names: Vec<_> =
        fs::read_dir(one.path()).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    names.sort();
    // Three antennas in seven formats; scenario, nav, truth, ambiguities, kurs.toml.
    assert_eq!(names.len(), 3 * 7 + 5, "{names:?}");
    for name in names {
        let [a, b] = [&one, &other].map(|folder| fs::read(folder.path().join(&name)).unwrap());
        assert!(!a.is_empty() && a == b, "{} differs", name.display());
    }
    let another = simulated(&format!("seed = 7\n{text}"));
    let read = |folder: &tempfile::TempDir| fs::read(folder.path().join("bow.rnx")).unwrap();
    assert!(read(&one) != read(&another));
}

/// Rows of a table with the names of its columns.
fn table(path: &Path) -> Vec<std::collections::HashMap<String, String>> {
    csv::Reader::from_path(path).unwrap().deserialize().map(Result::unwrap).collect()
}

/// Files of a second body, the station, an antenna that falls silent; `kurs.toml` ready to use.
#[test]
fn bodies_stations_and_silent_antennas_have_their_files() {
    let mut text = SCENARIO.replace("satellites = [\"G05\", \"E03\"]", "antennas = [\"port\"]");
    text += r#"
[[body]]
name = "dinghy"
motion = { kind = "static", place = { latitude_deg = 59.9, longitude_deg = 29.701, height_m = 9.0 }, heading_deg = 10.0 }
antenna = [{ name = "D0", position_m = [0, 0, 0] }, { name = "D1", position_m = [1, 0, 0] }]
[station]
name = "pier"
place = { latitude_deg = 59.9, longitude_deg = 29.7, height_m = 12.0 }
"#;
    let folder = simulated(&text);
    let path = |name: &str| folder.path().join(name);
    // Four seconds of silence of one of the antennas.
    assert_eq!(epochs(&path("port.rnx")).len(), 31 - 4);
    for name in ["bow.rnx", "starboard.rnx", "D0.rnx", "D1.rnx", "pier.rnx"] {
        assert_eq!(epochs(&path(name)).len(), 31, "{name}");
    }
    let truth = table(&path("truth.csv"));
    assert_eq!(truth.len(), 31);
    for column in [
        "gps_week",
        "tow_s",
        "heading_deg",
        "pitch_deg",
        "roll_deg",
        "latitude_deg",
        "longitude_deg",
        "height_m",
        "vel_north_mps",
        "vel_east_mps",
        "vel_down_mps",
        "port_east_m",
        "port_north_m",
        "port_up_m",
        "starboard_up_m",
        "bow_clock_s",
        "port_clock_s",
    ] {
        assert!(truth.iter().all(|row| row[column].parse::<f64>().is_ok()), "{column}");
    }
    let dinghy = table(&path("truth-dinghy.csv"));
    let [east, north] =
        ["D1_east_m", "D1_north_m"].map(|name| dinghy[0][name].parse::<f64>().unwrap());
    assert!((east - 10f64.to_radians().sin()).abs() < 1e-5, "{east}");
    assert!((north - 10f64.to_radians().cos()).abs() < 1e-5, "{north}");

    let explained = kurs(&["solve".as_ref(), &path("kurs.toml"), "--explain".as_ref()]).stdout;
    let explained = String::from_utf8(explained).unwrap();
    assert!(explained.contains("solve.constraint = \"array\""), "{explained}");
    for (name, rows) in [("kurs.toml", 31), ("kurs-dinghy.toml", 31)] {
        let toml = fs::read_to_string(path(name)).unwrap();
        assert!(toml.contains("[station]\nobs = [\"pier.crx.gz\"]"), "{toml}");
        let out = path("solved");
        let output = kurs(&["solve".as_ref(), &path(name), "--out".as_ref(), &out]);
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let solved = table(&out.join("attitude.csv"));
        assert_eq!(solved.len(), rows, "{name}");
        let fixed = solved.iter().filter(|row| row["status"] == "fixed").count();
        assert!(fixed >= 25, "{name}: {fixed} fixed");
    }
}

/// Orbits from a navigation file and a motion from a table, by names relative to the scenario.
#[test]
fn a_navigation_file_and_a_recorded_motion_are_used() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    fs::copy(simulated(SCENARIO).path().join("nav.rnx"), path("brdc.rnx")).unwrap();
    let mut rows =
        "time_s,latitude_deg,longitude_deg,height_m,heading_deg,pitch_deg,roll_deg\n".to_owned();
    for k in 0..=10 {
        let latitude_deg = 48.2 + 1e-5 * f64::from(k);
        rows += &format!("{k},{latitude_deg:.5},16.2,200,{},{},1\n", 3 * k, -k);
    }
    fs::write(path("way.csv"), &rows).unwrap();
    let scenario = |start: &str| {
        format!(
            "start = \"{start}\"\nduration_s = 10\ninterval_s = 1\n[sky]\nnavigation = \"brdc.rnx\"\n\
             [[body]]\nname = \"b\"\nmotion = {{ kind = \"recorded\", file = \"way.csv\" }}\n\
             antenna = [{{ name = \"A0\", position_m = [0, 0, 0] }}, {{ name = \"A1\", position_m = [1, 0, 0] }}]\n"
        )
    };
    let run = |text: &str| {
        fs::write(path("s.toml"), text).unwrap();
        kurs(&["simulate".as_ref(), &path("s.toml"), "--out".as_ref(), &path("out")])
    };
    let output = run(&scenario("2024-03-10T12:00:00"));
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    for (k, row) in table(&path("out/truth.csv")).iter().enumerate() {
        let near = |name: &str, wanted: f64, within: f64| {
            let found: f64 = row[name].parse().unwrap();
            assert!((found - wanted).abs() < within, "{name} in row {k}: {found}, {wanted}");
        };
        // The receiver's clock is off by up to half a millisecond: 3°/s, 1.1 m/s.
        near("heading_deg", 3.0 * k as f64, 2e-3);
        near("pitch_deg", -(k as f64), 2e-3);
        near("latitude_deg", 48.2 + 1e-5 * k as f64, 1e-8);
    }
    let output =
        kurs(&["solve".as_ref(), &path("out/kurs.toml"), "--out".as_ref(), &path("solved")]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let fixed =
        table(&path("solved/attitude.csv")).iter().filter(|r| r["status"] == "fixed").count();
    assert_eq!(fixed, 11);

    // What is wrong with either file is said with its name.
    let refusal = |output: Output| {
        assert_eq!(output.status.code(), Some(2), "{output:?}");
        String::from_utf8(output.stderr).unwrap()
    };
    let error = refusal(run(&scenario("2001-01-01T00:00:00")));
    for word in ["s.toml", "sky.navigation", "brdc.rnx", "expected a file with records for 2001"] {
        assert!(error.contains(word), "{error}");
    }
    for (row, instead, named) in [
        ("4,", "x,", &["way.csv", "line: 6"][..]),
        ("5,48.20005,", "5,98,", &["way.csv", "row 6", "latitude_deg: 98", "from -90 to 90"]),
        ("5,48.20005,", "5,nan,", &["way.csv", "row 6", "latitude_deg: NaN", "from -90 to 90"]),
        ("6,", "5,", &["way.csv", "row 7", "time_s 5", "later"]),
        ("pitch_deg", "pitch", &["way.csv", "pitch"]),
    ] {
        let at =
            rows.find(&format!("\n{row}")).map_or_else(|| rows.find(row).unwrap(), |at| at + 1);
        let spoilt = format!("{}{instead}{}", &rows[..at], &rows[at + row.len()..]);
        fs::write(path("way.csv"), spoilt).unwrap();
        let output = run(&scenario("2024-03-10T12:00:00"));
        assert!(!output.status.success());
        let error = String::from_utf8(output.stderr).unwrap();
        for word in named {
            assert!(error.contains(word), "{instead}: {error}");
        }
    }
}

/// Wrong usage: status 2, with file, key, what was found and what was expected.
#[test]
fn a_wrong_scenario_is_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let scenario = folder.path().join("s.toml");
    fs::write(&scenario, SCENARIO.replace("per_hour = 60.0", "per_hour = -60.0")).unwrap();
    let out = folder.path().join("out");
    let output = kurs(&["simulate".as_ref(), &scenario, "--out".as_ref(), &out]);
    assert_eq!(output.status.code(), Some(2));
    let error = String::from_utf8(output.stderr).unwrap();
    assert!(error.contains("s.toml: slips.per_hour: -60, expected from 0 to"), "{error}");
    assert!(!out.exists(), "nothing is written");

    fs::write(&scenario, SCENARIO).unwrap();
    for (port, expected) in
        [("65535", "of which 65535 is the last"), ("0", "0 is not in 1..=65535")]
    {
        let output = kurs(&["simulate".as_ref(), &scenario, "--stream".as_ref(), port.as_ref()]);
        let error = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{error}");
        assert!(error.contains(expected), "{error}");
    }
}

/// Logs leave out the signals that they have no number for, and say so.
#[test]
fn signals_that_a_log_cannot_hold_are_told() {
    let folder = tempfile::tempdir().unwrap();
    let scenario = folder.path().join("s.toml");
    fs::write(&scenario, SCENARIO.replace("\"crinex.gz\",", "\"ubx\",")).unwrap();
    let output = kurs(&["simulate".as_ref(), &scenario, "--out".as_ref(), folder.path()]);
    let told = String::from_utf8(output.stderr).unwrap();
    assert!(told.contains("bow.ubx: the format has no G2W: left out"), "{told}");
    let of_log = epochs(&folder.path().join("bow.ubx"));
    let of_file = epochs(&folder.path().join("bow.rnx"));
    for (log, file) in of_log.iter().zip(&of_file) {
        let left = file.observations.iter().filter(|o| o.signal.to_string() != "G2W").count();
        assert_eq!(log.observations.len(), left);
    }
    assert_eq!(of_log.len(), of_file.len());
}
