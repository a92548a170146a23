//! `kurs inspect` as a user runs it: what is in the small files of the project.
#![allow(clippy::unwrap_used)] // a test

use std::fs;
use std::path::{Path, PathBuf};

use assert_cmd::Command;
use kurs::ephemeris::NavigationData;
use kurs::frames::Vector;
use kurs::observation::{AntennaEpoch, Lock, Observation};
use kurs::time::GpsTime;
use kurs_formats::rtcm::Rtcm3Writer;
use kurs_formats::ubx::UbxWriter;
use serde_json::Value;

fn file(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../testdata").join(name)
}

/// Exit status, standard output and standard error.
fn inspect(arguments: &[&str]) -> (i32, String, String) {
    let output =
        Command::cargo_bin("kurs").unwrap().arg("inspect").args(arguments).output().unwrap();
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    let said = text(&output.stderr);
    assert!(!said.contains("panicked"), "{said}");
    (output.status.code().unwrap(), text(&output.stdout), said)
}

fn json(arguments: &[&str]) -> Vec<Value> {
    let arguments: Vec<&str> = ["--json"].iter().chain(arguments).copied().collect();
    let (status, printed, said) = inspect(&arguments);
    assert_eq!(status, 0, "{said}");
    serde_json::from_str(&printed).unwrap()
}

#[test]
fn an_observation_file_in_numbers() {
    let path = file("observation/events_3.rnx");
    let reports = json(&[path.to_str().unwrap()]);
    let report = &reports[0];
    assert_eq!(report["content"], "observations");
    assert_eq!(report["format"], "RINEX 3.05 observations");
    assert_eq!(report["header"]["marker"], "TEST");
    let time = &report["time"];
    assert_eq!((&time["epochs"], &time["interval_s"]), (&12.into(), &1.0.into()));
    assert_eq!(time["first"], "2024-06-24T08:59:55.000");
    assert_eq!(time["last"], "2024-06-24T09:00:06.000");
    assert_eq!(time["gaps"]["count"], 0);
    assert_eq!(report["satellites"]["GPS"], 6);

    let g1c = &report["signals"][0];
    assert_eq!(g1c["signal"], "G1C");
    // grep -c '^G' counts 68 lines; G30 has no phase at 09:00:01.
    assert_eq!((&g1c["pseudoranges"], &g1c["phases"]), (&68.into(), &67.into()));
    // G03 by its slip record, G22 and G19 by their digits.
    assert_eq!(g1c["slips"], 3);

    let events = &report["events"];
    assert_eq!(events["count"], 2);
    assert_eq!(events["listed"][0]["what"], "cycle slip records");
    assert_eq!(events["listed"][0]["time"], "2024-06-24T08:59:57.500");
    assert_eq!(events["listed"][1]["what"], "new header records");
    assert_eq!(report["sky"], Value::Null);
}

#[test]
fn gaps_events_and_damage_are_told() {
    let folder = tempfile::tempdir().unwrap();
    let mut text = String::new();
    for (content, label) in [
        ("     3.05           OBSERVATION DATA    M", "RINEX VERSION / TYPE"),
        ("G    2 C1C L1C", "SYS / # / OBS TYPES"),
        ("    30.000", "INTERVAL"),
        ("  2024     6    24     8     0    0.0000000     GPS", "TIME OF FIRST OBS"),
        ("", "END OF HEADER"),
    ] {
        text += &format!("{content:<60}{label}\n");
    }
    for second in [0, 1, 2, 3, 13, 14, 14, 15] {
        text += &format!("> 2024 06 24 08 00 {second:02}.0000000  0  1\n");
        text += "G05  22000000.000   115600000.000 7\n";
        if second == 3 {
            text += ">                              5  0\n";
            text += "> 2024 06 24 08 00 03.5000000  2  0\n";
        }
        if second == 15 {
            text += "not a satellite\n";
        }
    }
    let path = folder.path().join("a.obs");
    fs::write(&path, text).unwrap();
    let report = &json(&[path.to_str().unwrap()])[0];
    let gaps = &report["time"]["gaps"];
    assert_eq!((&gaps["count"], &gaps["missing_epochs"]), (&1.into(), &9.into()));
    assert_eq!(gaps["listed"][0]["from"], "2024-06-24T08:00:03.000");
    let events = &report["events"]["listed"];
    assert_eq!(events[0]["what"], "external event");
    assert_eq!(events[0]["time"], Value::Null);
    assert_eq!(events[1]["what"], "the antenna starts to move");
    let damage = report["damage"].to_string();
    assert!(damage.contains("is not later than the one before, skipped"), "{damage}");
    assert!(damage.contains("not the line of a satellite"), "{damage}");
    let oddities = report["oddities"].to_string();
    assert!(oddities.contains("the header says an interval of 30 s, it is 1 s"), "{oddities}");
    assert!(oddities.contains("no approximate position"), "{oddities}");

    let (status, printed, _) = inspect(&[path.to_str().unwrap()]);
    assert_eq!(status, 0);
    for expected in ["1 (9 epochs missing, longest 10 s)", "external event", "damage"] {
        assert!(printed.contains(expected), "{expected}: {printed}");
    }
}

#[test]
fn navigation_orbits_and_antennas() {
    let paths =
        ["navigation/mixed_3.rnx", "navigation/precise.sp3", "antenna/invented.atx"].map(file);
    let paths = paths.each_ref().map(|path| path.to_str().unwrap());
    let reports = json(&paths);
    assert_eq!(reports[0]["content"], "navigation");
    assert!(reports[0]["systems"].as_array().unwrap().len() > 1);
    assert_eq!(reports[1]["format"], "SP3 orbits");
    assert_eq!(reports[1]["systems"][0]["records"], 2);
    assert_eq!(reports[2]["content"], "antennas");
    assert_eq!(
        reports[2]["types"][0]["bands"][0]["offset_m"],
        serde_json::json!([0.001, -0.002, 0.06])
    );
    let (status, printed, _) = inspect(&paths);
    assert_eq!(status, 0);
    assert!(printed.contains("TESTANT_A"), "{printed}");
}

/// An unusable file is named, the others are reported, and the exit status tells.
#[test]
fn unusable_files_are_named() {
    let good = file("observation/mixed_3.rnx");
    let text = file("observation/README.md");
    for (bad, expected) in [("absent.obs", "absent.obs: "), (text.to_str().unwrap(), "found text")]
    {
        let (status, printed, said) = inspect(&[bad, good.to_str().unwrap()]);
        assert_eq!(status, 1);
        assert!(said.contains(expected), "{said}");
        assert!(printed.contains("mixed_3.rnx: RINEX 3.05 observations"), "{printed}");
    }
    assert_eq!(inspect(&[]).0, 2);
}

/// What can be read only once is copied: it is read for the sky first.
#[cfg(unix)]
#[test]
fn a_pipe_is_inspected_like_a_file() {
    let output = Command::cargo_bin("kurs")
        .unwrap()
        .args(["inspect", "/dev/stdin"])
        .write_stdin(fs::read(file("observation/mixed_3.rnx")).unwrap())
        .output()
        .unwrap();
    let printed = String::from_utf8_lossy(&output.stdout);
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    assert!(printed.contains("RINEX 3.05 observations"), "{printed}");
}

#[test]
fn json_goes_to_a_file_and_never_over_an_input() {
    let folder = tempfile::tempdir().unwrap();
    let input = folder.path().join("a.obs");
    fs::copy(file("observation/mixed_3.rnx"), &input).unwrap();
    let output = folder.path().join("a.json");
    let flag = format!("--json={}", output.display());
    let (status, printed, _) = inspect(&[&flag, input.to_str().unwrap()]);
    assert_eq!(status, 0);
    assert!(printed.contains("a.obs"));
    let reports: Vec<Value> = serde_json::from_str(&fs::read_to_string(&output).unwrap()).unwrap();
    assert_eq!(reports.len(), 1);

    let before = fs::read(&input).unwrap();
    let (status, _, said) =
        inspect(&[&format!("--json={}", input.display()), input.to_str().unwrap()]);
    assert_eq!(status, 2);
    assert!(said.contains("one of the inputs"), "{said}");
    assert_eq!(fs::read(&input).unwrap(), before);
}

/// The sky of a recording: what stood high was observed.
#[test]
fn sky_of_a_recording() {
    let Some(folder) = crate::outside::recording("upc2011") else { return };
    let [obs, nav] = ["UPC10770.11o", "brdc0770.11n"].map(|name| folder.join(name));
    let report = &json(&[obs.to_str().unwrap(), &format!("--nav={}", nav.display())])[0];
    let sky = &report["sky"];
    assert!((sky["latitude_deg"].as_f64().unwrap() - 41.3889).abs() < 1e-3);
    assert_eq!(sky["looks"], 30);
    for ring in &sky["rings"].as_array().unwrap()[1..] {
        assert_eq!(ring["in_view"], ring["observed"], "{ring}");
    }
    let first = &sky["satellites"][0]["points"][0];
    assert!((0.0..360.0).contains(&first["azimuth_deg"].as_f64().unwrap()));
    assert_eq!(report["geometry_free"][0]["jumps"], 0);
}

/// An RTCM 3 log of five seconds whose messages tell no week; its first epoch.
fn base_log(observed: &str) -> (Vec<u8>, GpsTime) {
    let first = GpsTime::from_week_tow(2300, 2.5 * 86_400.0).unwrap();
    let none = NavigationData::default();
    let mut writer = Rtcm3Writer::new(Vec::new(), 5, Vector::new(4e6, 3e5, 4.9e6), &none);
    for second in 0..5 {
        let observation = Observation {
            satellite: "G05".parse().unwrap(),
            signal: observed.parse().unwrap(),
            pseudorange_m: Some(22e6),
            phase_cycles: Some(1e8),
            doppler_hz: None,
            cn0_dbhz: Some(45.0),
            lock: Lock::default(),
        };
        let time = first + f64::from(second);
        let observations = vec![observation];
        writer.write(&AntennaEpoch { time, observations, ..AntennaEpoch::default() }).unwrap();
    }
    (writer.finish(), first)
}

/// Without ephemerides a log is inspected all the same: its week is unknown, or that of `--date`,
/// of a navigation file beside it, or of its name. Messages are counted.
#[test]
fn a_log_without_ephemerides() {
    let folder = tempfile::tempdir().unwrap();
    let (log, _) = base_log("G1C");
    let path = folder.path().join("base.rtcm3").display().to_string();
    fs::write(&path, &log).unwrap();
    let report = &json(&[&path])[0];
    assert_eq!(report["time"]["is_dated"], false);
    assert_eq!(report["time"]["first"], "Tuesday 12:00:00.000");
    assert_eq!(report["time"]["epochs"], 5);
    let messages = report["messages"].as_array().unwrap();
    let told: Vec<(&str, u64, f64, &str)> = messages
        .iter()
        .map(|m| {
            let text = |key: &str| m[key].as_str().unwrap();
            let rate = m["rate_hz"].as_f64().unwrap();
            (text("message"), m["count"].as_u64().unwrap(), rate, text("read"))
        })
        .collect();
    assert_eq!(told, [("1006", 1, 0.2, "place"), ("1077", 5, 1.0, "observations")]);
    let oddities = report["oddities"].to_string();
    assert!(oddities.contains("RXM-SFRBX") && oddities.contains("1019"), "{oddities}");
    assert!(oddities.contains("--date"), "{oddities}");
    let (_, printed, _) = inspect(&[&path]);
    assert!(printed.contains("GPST of an unknown week"), "{printed}");

    let dated = json(&[&path, "--date", "2024-02-06"]);
    assert_eq!(dated[0]["time"]["first"], "2024-02-06T12:00:00.000");
    let (status, _, said) = inspect(&[&path, "--date", "2024-02-30"]);
    assert!(status == 2 && said.contains("YYYY-MM-DD"), "{said}");
    // Records of 2020-06-25, a Thursday.
    let navigation = file("navigation/mixed_3.rnx").display().to_string();
    let beside = json(&[&path, &navigation]);
    assert_eq!(beside[0]["time"]["first"], "2020-06-23T12:00:00.000");
    let named = folder.path().join("base_20240208.rtcm3").display().to_string();
    fs::write(&named, &log).unwrap();
    assert_eq!(json(&[&named])[0]["time"]["first"], "2024-02-06T12:00:00.000");
}

/// Two protocols with observations in one log: each has its report, the messages stand once.
#[test]
fn a_log_with_observations_of_two_protocols() {
    let folder = tempfile::tempdir().unwrap();
    let (mut log, first) = base_log("G1C");
    let mut ubx = UbxWriter::new(Vec::new(), &NavigationData::default());
    ubx.write(&AntennaEpoch { time: first, ..AntennaEpoch::default() }).unwrap();
    log.extend(ubx.finish());
    // Ahead of them a minute of sentences, more than is looked at to judge a file by its start.
    log.splice(0..0, b"$GNGGA,,,,,,0,00,99.99,,,,,,*56\r\n".repeat(3000));
    let path = folder.path().join("both.log").display().to_string();
    fs::write(&path, log).unwrap();
    let reports = json(&[&path]);
    let parts: Vec<&str> = reports.iter().map(|r| r["part"].as_str().unwrap()).collect();
    assert_eq!(parts, ["the receiver's own messages", "station 5"]);
    assert_eq!(reports[0]["time"]["epochs"], 1);
    assert_eq!(reports[1]["time"]["epochs"], 5);
    // The week is in the other protocol.
    assert_eq!(reports[1]["time"]["first"], "2024-02-06T12:00:00.000");
    let counts = [0, 1].map(|i: usize| reports[i]["messages"].as_array().unwrap().len());
    assert_eq!(counts, [3, 0]);
}
