//! `kurs doctor` names the cause, and no consequence of it: faults put into simulated sessions,
//! each with its own seed. `kurs survey` finds the array that was simulated.
#![allow(clippy::unwrap_used)] // a test

use std::fs;
use std::path::{Path, PathBuf};

use assert_cmd::Command;
use kurs_formats::ubx;
use tempfile::TempDir;

const PLACES: [[f64; 3]; 4] =
    [[0.0, 0.0, 0.0], [0.9, 0.0, 0.0], [0.1, -0.5, 0.0], [-0.3, 0.65, -0.1]];

/// A session: what differs from a good one.
#[derive(Default)]
struct Fault {
    /// Keys of the scenario before its tables.
    keys: &'static str,
    /// In place of `interval_s = 1.0`.
    interval: &'static str,
    /// Tables of the scenario.
    tables: &'static str,
    /// Motion of the body in place of rest, with its keys.
    motion: &'static str,
    /// Keys of one antenna.
    antenna: (usize, &'static str),
    /// Replacements in kurs.toml.
    configuration: Vec<(String, String)>,
}

fn kurs() -> Command {
    Command::cargo_bin("kurs").unwrap()
}

/// Simulates a session into `directory` and returns its configuration.
fn session(directory: &Path, seed: u64, start: &str, fault: &Fault) -> PathBuf {
    let antennas: String = PLACES
        .iter()
        .enumerate()
        .map(|(i, place)| {
            let own = if fault.antenna.0 == i { fault.antenna.1 } else { "" };
            format!("\n[[body.antenna]]\nname = \"A{i}\"\nposition_m = {place:?}\n{own}\n")
        })
        .collect();
    let rest = "kind = \"static\"\nheading_deg = 70.0\npitch_deg = 3.0\nroll_deg = -2.0";
    let motion = if fault.motion.is_empty() { rest } else { fault.motion };
    let interval = if fault.interval.is_empty() { "interval_s = 1.0" } else { fault.interval };
    let scenario = format!(
        "seed = {seed}\nstart = \"{start}\"\nduration_s = 40.0\n{interval}\n{}\n\
         [sky]\nsystems = [\"G\", \"E\", \"C\"]\n{}\n\
         [[body]]\nname = \"body\"\n[body.motion]\n{motion}\n\
         place = {{ latitude_deg = 48.0, longitude_deg = 11.0, height_m = 500.0 }}\n{antennas}",
        fault.keys, fault.tables
    );
    fs::create_dir_all(directory).unwrap();
    let file = directory.join("scenario.toml");
    fs::write(&file, scenario).unwrap();
    kurs().arg("simulate").arg(&file).arg("--out").arg(directory).assert().success();
    let configuration = directory.join("kurs.toml");
    let mut text = fs::read_to_string(&configuration).unwrap();
    for (from, to) in &fault.configuration {
        assert!(text.contains(from), "{from} in\n{text}");
        text = text.replace(from, to);
    }
    fs::write(&configuration, text).unwrap();
    configuration
}

/// The codes of all findings, the most telling first.
fn findings(configuration: &Path) -> Vec<String> {
    let out = configuration.parent().unwrap().join("out");
    kurs().arg("doctor").arg(configuration).arg("--out").arg(&out).assert().success();
    let text = fs::read_to_string(out.join("doctor.json")).unwrap();
    let file: serde_json::Value = serde_json::from_str(&text).unwrap();
    let all = file["findings"].as_array().unwrap();
    all.iter().map(|finding| finding["code"].as_str().unwrap().to_owned()).collect()
}

const NOON: &str = "2024-03-10T12:00:00";

/// The codes of all findings; `kurs solve` ends with the first one.
fn of_session(folder: &Path, seed: u64, fault: &Fault) -> Vec<String> {
    let configuration = session(folder, seed, NOON, fault);
    let found = findings(&configuration);
    let text = fs::read_to_string(folder.join("out/doctor.json")).unwrap();
    let file: serde_json::Value = serde_json::from_str(&text).unwrap();
    let cause = file["findings"][0]["cause"].as_str().unwrap();
    let run =
        kurs().arg("solve").arg(&configuration).arg("--out").arg(folder.join("solved")).output();
    let said = String::from_utf8(run.unwrap().stdout).unwrap();
    assert!(said.lines().last().unwrap().contains(cause), "{cause}:\n{said}");
    found
}

/// One cause, and nothing that follows from it.
fn named(case: &str, seed: u64, fault: &Fault) {
    let folder = TempDir::new().unwrap();
    assert_eq!(of_session(folder.path(), seed, fault), [case]);
}

fn replaced(from: &str, to: &str) -> Vec<(String, String)> {
    vec![(from.into(), to.into())]
}

#[test]
fn a_good_session_has_no_findings() {
    let folder = TempDir::new().unwrap();
    let configuration = session(folder.path(), 100, NOON, &Fault::default());
    assert_eq!(findings(&configuration), Vec::<String>::new());
}

/// Its epochs are only sure of each other: those of a sample have to have their neighbours.
#[test]
fn a_weak_session_that_is_fixed_has_no_findings() {
    let folder = TempDir::new().unwrap();
    kurs().args(["simulate", "few-satellites", "--out"]).arg(folder.path()).assert().success();
    assert_eq!(findings(&folder.path().join("kurs.toml")), Vec::<String>::new());
}

#[test]
fn a_wrong_position() {
    let folder = TempDir::new().unwrap();
    let configuration = replaced("position_m = [0.9,", "position_m = [0.94,");
    let fault = Fault { configuration, ..Fault::default() };
    assert_eq!(of_session(folder.path(), 101, &fault), ["wrong_geometry"]);
    let text = fs::read_to_string(folder.path().join("out/doctor.json")).unwrap();
    let file: serde_json::Value = serde_json::from_str(&text).unwrap();
    let failed = file["checks"].as_array().unwrap();
    assert!(!failed.is_empty(), "{text}");
    for check in failed {
        assert!(check["failed"].as_u64() <= check["epochs"].as_u64(), "{check}");
        assert!(check["p_value"].as_f64() < check["level"].as_f64(), "{check}");
    }
}

#[test]
fn swapped_antennas() {
    let configuration = [("A1.rnx", "X.rnx"), ("A2.rnx", "A1.rnx"), ("X.rnx", "A2.rnx")]
        .map(|(from, to)| (from.into(), to.into()))
        .to_vec();
    named("swapped_antennas", 102, &Fault { configuration, ..Fault::default() });
}

#[test]
fn navigation_data_of_another_day() {
    let folder = TempDir::new().unwrap();
    let configuration = session(&folder.path().join("today"), 103, NOON, &Fault::default());
    let other = folder.path().join("other");
    session(&other, 103, "2024-03-13T12:00:00", &Fault::default());
    fs::copy(other.join("nav.rnx"), folder.path().join("today/nav.rnx")).unwrap();
    assert_eq!(findings(&configuration).first().map(String::as_str), Some("navigation_day"));
}

#[test]
fn receivers_that_sample_apart() {
    named("unsynchronised", 104, &Fault { antenna: (1, "tag_offset_s = 0.4"), ..Fault::default() });
}

#[test]
fn a_biased_constellation() {
    // Receiver A1 tracks the satellites of one kind of orbit with another part of a cycle.
    let tables =
        "[[bias]]\nantenna = \"A1\"\nsystem = \"C\"\norbit = \"meo\"\nphase_cycles = 0.4\n";
    let folder = TempDir::new().unwrap();
    let found = of_session(folder.path(), 105, &Fault { tables, ..Fault::default() });
    // The antenna, or the system at it: both lead there.
    let is_one_of_them = |code: &str| matches!(code, "bad_system" | "bad_antenna");
    assert!(found.iter().any(|code| is_one_of_them(code)), "{found:?}");
}

#[test]
fn reflections() {
    let tables = "[multipath]\ncode_sd_m = 4.0\nphase_sd_m = 0.03\ncorrelation_s = 20.0\n";
    named("multipath", 106, &Fault { tables, ..Fault::default() });
}

#[test]
fn no_common_band() {
    let keys = "signals = [\"G1C\", \"E1C\", \"C2I\"]";
    let configuration = replaced("[solve]\n", "[solve]\nbands = [\"G2\"]\n");
    named("no_common_band", 107, &Fault { keys, configuration, ..Fault::default() });
}

/// One of three wanted bands is a slip of the pen: the session is solved, and the band is told.
#[test]
fn a_band_that_no_antenna_observes() {
    let folder = TempDir::new().unwrap();
    let configuration = replaced("[solve]\n", "[solve]\nbands = [\"G1\", \"E1\", \"I5\"]\n");
    let configuration =
        session(folder.path(), 120, NOON, &Fault { configuration, ..Fault::default() });
    assert!(findings(&configuration).contains(&"unobserved_bands".to_owned()));
    let solve = |more: &[&str]| {
        let out = folder.path().join("solved");
        let run = kurs().arg("solve").arg(&configuration).args(more).arg("--out").arg(out).output();
        let run = run.unwrap();
        let summary = fs::read_to_string(folder.path().join("solved/summary.json")).unwrap();
        let summary: serde_json::Value = serde_json::from_str(&summary).unwrap();
        (run.status.code(), String::from_utf8([run.stdout, run.stderr].concat()).unwrap(), summary)
    };
    let (status, said, summary) = solve(&[]);
    assert_eq!(status, Some(0), "{said}");
    assert!(said.contains("no antenna observes I5, which `bands` wants\n"), "{said}");
    assert_eq!(summary["unobserved_bands"], serde_json::json!(["I5"]));
    let (status, said, _) = solve(&["--set", "bands=[\"I5\", \"C1\"]"]);
    assert_eq!(status, Some(1), "{said}");
    let expected = "error: no antenna observes I5 C1, and `bands` wants no other; observed: G1 ";
    assert!(said.contains(expected), "{said}");
    // Whoever names no band misses none.
    fs::write(
        &configuration,
        fs::read_to_string(&configuration).unwrap().replace("\nbands =", "\n# "),
    )
    .unwrap();
    let (_, said, summary) = solve(&[]);
    assert!(!said.contains("no antenna observes"), "{said}");
    assert!(summary.get("unobserved_bands").is_none());
}

/// What a receiver states about foreign signals (NAV-STATUS: spoofing; MON-RF: a band that is
/// jammed) in front of every epoch is the finding, and stands in the report.
#[test]
fn stated_interference() {
    let (mut spoofed, mut jammed) = ([0; 16], [0; 28]);
    spoofed[7] = 2 << 3;
    (jammed[1], jammed[4 + 1]) = (1, 2);
    let messages = [
        ("spoofing", ubx::frame([0x01, 0x03], &spoofed)),
        ("jamming", ubx::frame([0x0a, 0x38], &jammed)),
    ];
    for (code, message) in messages {
        let folder = TempDir::new().unwrap();
        let tables = "[output]\nformats = [\"ubx\"]\n";
        let configuration =
            session(folder.path(), 118, NOON, &Fault { tables, ..Fault::default() });
        let file = folder.path().join("A2.ubx");
        let log = fs::read(&file).unwrap();
        let mut with_statements = Vec::new();
        for (at, byte) in log.iter().enumerate() {
            if log[at..].starts_with(&[0xb5, 0x62, 0x02, 0x15]) {
                with_statements.extend_from_slice(&message);
            }
            with_statements.push(*byte);
        }
        fs::write(&file, with_statements).unwrap();
        assert_eq!(findings(&configuration), [code]);
        let out = folder.path().join("solved");
        let mut solve = kurs();
        solve.arg("solve").arg(&configuration).args(["--quiet", "--report", "--out"]).arg(&out);
        // Nothing is fixed where all rows are refused.
        solve.assert().code(if code == "spoofing" { 3 } else { 0 });
        let report = fs::read_to_string(out.join("report.html")).unwrap();
        let sentence = match code {
            "spoofing" => {
                "A receiver states that satellites are imitated: A2 in 100 % of its epochs."
            }
            _ => "A receiver states that foreign signals disturb it: A2 in 100 % of its epochs.",
        };
        assert!(report.contains(sentence));
    }
}

#[test]
fn a_silent_antenna() {
    let tables = "[[outage]]\nfrom_s = 10.0\nto_s = 40.0\nantennas = [\"A0\", \"A1\", \"A2\"]\n";
    named("missing_antenna", 108, &Fault { tables, ..Fault::default() });
}

/// A copy of an observation file with some of its epochs, by their numbers.
fn with_epochs(file: &Path, name: &str, keeps: impl Fn(usize) -> bool) -> String {
    let text = fs::read_to_string(file).unwrap();
    let (header, epochs) = text.split_once("\n>").unwrap();
    let kept = epochs.split("\n>").enumerate().filter(|(number, _)| keeps(*number));
    let lines = kept.map(|(_, epoch)| format!(">{}\n", epoch.trim_end()));
    let path = file.with_file_name(name);
    fs::write(&path, format!("{header}\n{}", lines.collect::<String>())).unwrap();
    path.display().to_string()
}

/// Every row that both antennas have is fixed, whichever epochs the slower one has; that it is
/// silent in the others is no fault of it.
#[test]
fn receivers_of_different_rates() {
    let folder = TempDir::new().unwrap();
    let fault = Fault { interval: "interval_s = 0.2", ..Fault::default() };
    session(folder.path(), 119, NOON, &fault);
    let [fast, slow, nav, out] =
        ["A0.rnx", "A1.rnx", "nav.rnx", "rates"].map(|n| folder.path().join(n));
    for (every, first, share, told) in [
        (2, 0, 101.0 / 201.0, "A1 observes at 2.5 Hz: A1 is in 50 % of the epochs"),
        (2, 1, 100.0 / 201.0, "A1 observes at 2.5 Hz: A1 is in 50 % of the epochs"),
        (5, 0, 41.0 / 201.0, "A1 observes at 1 Hz: A1 is in 20 % of the epochs"),
    ] {
        let thinned = with_epochs(&slow, "slow.rnx", |number| number % every == first);
        let antennas = [format!("A0={}@0,0,0", fast.display()), format!("A1={thinned}@0.9,0,0")];
        let run = |command: &str| {
            let mut kurs = kurs();
            kurs.arg(command).args(["--antenna", &antennas[0], "--antenna", &antennas[1]]);
            let assert = kurs.arg("--nav").arg(&nav).arg("--out").arg(&out).assert().success();
            String::from_utf8(assert.get_output().stdout.clone()).unwrap()
        };
        let said = run("doctor");
        let text = fs::read_to_string(out.join("doctor.json")).unwrap();
        let file: serde_json::Value = serde_json::from_str(&text).unwrap();
        let codes = file["findings"].as_array().unwrap().iter().map(|finding| &finding["code"]);
        assert_eq!(codes.collect::<Vec<_>>(), ["different_rates"], "{said}");
        assert!(said.contains(&format!("A0 observes at 5 Hz, {told}")), "{said}");
        let found = file["fixed_of_session"].as_f64().unwrap();
        assert!((found - share).abs() < 1e-9, "{found}, not {share}:\n{said}");
        let solved = run("solve");
        let last = solved.lines().last().unwrap();
        assert!(last.contains("the receivers observe at different rates (A0 observes"), "{last}");
    }
}

#[test]
fn a_mask_too_high() {
    let configuration = replaced("[solve]\n", "[solve]\nelevation_mask_deg = 68.0\n");
    named("few_satellites", 109, &Fault { configuration, ..Fault::default() });
}

#[test]
fn a_single_band_without_geometry() {
    let configuration = replaced("[solve]\n", "[solve]\nbands = [\"G1\"]\nconstraint = \"none\"\n");
    let tables = "[noise]\ncode_sd_m = 0.45\nphase_sd_cycles = 0.02\n";
    let folder = TempDir::new().unwrap();
    let found =
        of_session(folder.path(), 110, &Fault { tables, configuration, ..Fault::default() });
    assert_eq!(found, ["weak_model", "unused_bands"]);
}

/// Half of the sky is hidden and every system has one band: nothing is fixed without the array, and
/// the right lengths alone fix less than wrong ones do by chance.
#[test]
fn a_weak_sky_accuses_no_geometry() {
    let keys = "signals = [\"G1C\", \"E1C\", \"C2I\"]";
    let tables = "horizon_deg = [[0.0, 180.0, 40.0]]";
    let free = replaced("[solve]\n", "[solve]\nconstraint = \"none\"\n");
    for configuration in [Vec::new(), free] {
        let folder = TempDir::new().unwrap();
        let fault = Fault { keys, tables, configuration, ..Fault::default() };
        let found = of_session(folder.path(), 122, &fault);
        assert!(!found.contains(&"wrong_geometry".to_owned()), "{found:?}");
    }
}

/// Every place times these factors.
fn places_times(factors: [f64; 3]) -> Vec<(String, String)> {
    let text = |place: [f64; 3]| format!("position_m = {place:?}");
    let scaled = |place: [f64; 3]| [0, 1, 2].map(|k| place[k] * factors[k] + 0.0);
    PLACES[1..].iter().map(|place| (text(*place), text(scaled(*place)))).collect()
}

#[test]
fn positions_in_centimetres() {
    let configuration = places_times([100.0; 3]);
    named("wrong_unit", 112, &Fault { configuration, ..Fault::default() });
}

/// Four antennas that are not in one plane fit only as their mirror image; three are the mirror
/// image of themselves, upside down.
#[test]
fn right_and_left_exchanged() {
    let configuration = places_times([1.0, -1.0, 1.0]);
    named("mirrored_array", 113, &Fault { configuration, ..Fault::default() });
    let flat =
        "\n[[antenna]]\nname = \"A3\"\nobs = [\"A3.rnx\"]\nposition_m = [-0.3, 0.65, -0.1]\n";
    let mut configuration = places_times([1.0, -1.0, 1.0]);
    configuration[2] = (flat.into(), String::new());
    named("mirrored_array", 113, &Fault { configuration, ..Fault::default() });
}

#[test]
fn one_file_for_two_antennas() {
    let folder = TempDir::new().unwrap();
    let configuration = replaced("A1.rnx", "A0.rnx");
    let found = of_session(folder.path(), 114, &Fault { configuration, ..Fault::default() });
    assert_eq!(found, ["one_recording"]);
    // Without a configuration, and of the two alone: no row is what it cannot be.
    let file = |name: &str| folder.path().join(name).display().to_string();
    let (a, b) = (format!("A={}", file("A0.rnx")), format!("B={}@1,0,0", file("A0.rnx")));
    let a = format!("{a}@0,0,0");
    let files =
        ["--antenna", &a, "--antenna", &b, "--nav", &file("nav.rnx"), "--out", &file("two")];
    kurs().arg("doctor").args(files).assert().success();
    let text = fs::read_to_string(folder.path().join("two/doctor.json")).unwrap();
    assert!(text.contains("antennas A and B have the same observations"), "{text}");
    let surveyed = kurs().arg("survey").args(files).assert().code(1);
    let said = String::from_utf8_lossy(&surveyed.get_output().stderr).into_owned();
    assert!(said.contains("antennas A and B have the same observations"), "{said}");
    kurs().arg("solve").args(files).assert().code(3);
    let rows = fs::read_to_string(folder.path().join("two/attitude.csv")).unwrap();
    assert!(rows.lines().skip(1).all(|row| row.contains(",inconsistent,geometry,")), "{rows}");
}

/// Twenty of sixty seconds that no antenna has: all rows are fixed, the session is not.
#[test]
fn a_gap_of_all_antennas() {
    let folder = TempDir::new().unwrap();
    let antennas = r#"["A0", "A1", "A2", "A3"]"#;
    let tables = format!("[[outage]]\nfrom_s = 9.5\nto_s = 29.5\nantennas = {antennas}\n");
    let fault = Fault { tables: Box::leak(tables.into_boxed_str()), ..Fault::default() };
    assert_eq!(of_session(folder.path(), 115, &fault), ["gaps"]);
    let text = fs::read_to_string(folder.path().join("solved/summary.json")).unwrap();
    let summary: serde_json::Value = serde_json::from_str(&text).unwrap();
    let rows = summary["epochs"].as_f64().unwrap();
    assert_eq!(summary["fixed_of_capable"], 1.0);
    assert_eq!(summary["fixed_of_session"], rows / (rows + 20.0));
    let configuration = folder.path().join("kurs.toml");
    for (percent, code) in [("0", 0), ("45", 0), ("60", 3), ("101", 2)] {
        let run = kurs()
            .arg("solve")
            .arg(&configuration)
            .args(["--require-fix", percent, "--quiet"])
            .arg("--out")
            .arg(folder.path().join("solved"))
            .assert()
            .code(code);
        let said = String::from_utf8_lossy(&run.get_output().stderr).into_owned();
        assert_eq!(said.contains("60 % are required"), code == 3, "{said}");
    }
}

/// A car drives where its front points; a body at rest has no course.
#[test]
fn front_and_back_exchanged() {
    let folder = TempDir::new().unwrap();
    let resting = Fault { configuration: places_times([-1.0, -1.0, 1.0]), ..Fault::default() };
    let configuration = session(&folder.path().join("rest"), 116, NOON, &resting);
    assert_eq!(findings(&configuration), Vec::<String>::new());
    let motion = "kind = \"car\"\nwaypoints_m = [[0, 0], [0, 900]]\nspeed_mps = 10.0\nwait_s = 2.0";
    let configuration = session(folder.path(), 116, NOON, &Fault { motion, ..resting });
    assert_eq!(findings(&configuration), ["reversed_array"]);
}

/// Ten minutes would be better; forty seconds of white noise are good to millimetres too.
#[test]
fn survey_finds_the_array() {
    let folder = TempDir::new().unwrap();
    let configuration = session(folder.path(), 111, NOON, &Fault::default());
    let out = folder.path().join("out");
    kurs().arg("survey").arg(&configuration).arg("--out").arg(&out).assert().success();
    let text = fs::read_to_string(out.join("array.toml")).unwrap();
    let table: toml::Table = toml::from_str(&text).unwrap();
    for (antenna, place) in table["antenna"].as_array().unwrap().iter().zip(&PLACES) {
        let found = antenna["position_m"].as_array().unwrap();
        for (coordinate, expected) in found.iter().zip(place) {
            let error = coordinate.as_float().unwrap() - expected;
            assert!(error.abs() < 0.003, "{text}");
        }
    }
}
