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
        println!("skipped: python3 has no package hatanaka");
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
