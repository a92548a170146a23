//! Simulated UBX and RTCM 3 logs, solved by themselves: the attitude is that of the RINEX files.
#![allow(clippy::unwrap_used, clippy::print_stdout)] // a test

use std::fs;
use std::path::Path;

use assert_cmd::Command;

/// Two antennas at rest, a minute, all systems, clocks that are off by less than a millisecond.
const SCENARIO: &str = r#"
seed = 5
start = "2024-03-10T12:00:00"
duration_s = 60.0
interval_s = 1.0
signals = ["G1C", "G2L", "E1C", "E5Q", "C2I", "R1C", "J1C"]

[output]
formats = ["rinex", "ubx", "rtcm3"]

[sky]
systems = ["G", "R", "E", "C", "J"]

[[body]]
name = "roof"
motion = { kind = "static", place = { latitude_deg = 52.0, longitude_deg = 13.0, height_m = 100.0 }, heading_deg = 40.0, pitch_deg = 3.0 }
[[body.antenna]]
name = "A0"
position_m = [0.0, 0.0, 0.0]
[[body.antenna]]
name = "A1"
position_m = [1.2, 0.0, 0.0]
"#;

fn kurs(arguments: &[&str]) {
    Command::cargo_bin("kurs").unwrap().args(arguments).assert().success();
}

/// Status, heading and pitch of every row.
fn rows(folder: &Path) -> Vec<(String, f64, f64)> {
    let text = fs::read_to_string(folder.join("attitude.csv")).unwrap();
    let mut reader = csv::Reader::from_reader(text.as_bytes());
    let names = reader.headers().unwrap().clone();
    let column = |name: &str| names.iter().position(|n| n == name).unwrap();
    let [status, heading, pitch] = ["status", "heading_deg", "pitch_deg"].map(column);
    let number = |text: &str| text.parse().unwrap_or(f64::NAN);
    let rows = reader.records().map(Result::unwrap);
    rows.map(|r| (r[status].to_owned(), number(&r[heading]), number(&r[pitch]))).collect()
}

#[test]
fn logs_alone_give_the_attitude_of_the_rinex_files() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).display().to_string();
    fs::write(path("scenario.toml"), SCENARIO).unwrap();
    kurs(&["simulate", &path("scenario.toml"), "--out", &path("simulated"), "--quiet"]);
    kurs(&["solve", &path("simulated/kurs.toml"), "--out", &path("rinex"), "--quiet"]);
    let wanted = rows(&folder.path().join("rinex"));
    assert_eq!(wanted.len(), 61);
    assert!(wanted.iter().filter(|row| row.0 == "fixed").count() > 55, "{wanted:?}");
    for format in ["ubx", "rtcm3"] {
        let antenna = |name: &str, place: &str| {
            format!("{name}={}@{place}", path(&format!("simulated/{name}.{format}")))
        };
        let antennas = [antenna("A0", "0,0,0"), antenna("A1", "1.2,0,0")];
        let flags = ["--antenna", &antennas[0], "--antenna", &antennas[1]];
        let out = path(format);
        kurs(&[&["solve"][..], &flags, &["--out", &out, "--quiet"]].concat());
        let found = rows(Path::new(&out));
        assert_eq!(found.len(), wanted.len());
        let mut worst_deg = 0f64;
        for (a, b) in wanted.iter().zip(&found) {
            assert_eq!(a.0, b.0, "{format} {a:?} {b:?}");
            worst_deg = worst_deg.max((a.1 - b.1).abs()).max((a.2 - b.2).abs());
        }
        println!("{format}: angles within {worst_deg:.4}° of those from RINEX");
        // C/N0 in whole dB-Hz (UBX) changes weights; half a millimetre on 1.2 m is 0.024°.
        assert!(worst_deg < 0.03, "{format} {worst_deg}");
    }
}
