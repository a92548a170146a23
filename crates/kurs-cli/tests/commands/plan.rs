//! `kurs plan` from file to files.
#![allow(clippy::unwrap_used)]

use std::fs;
use std::path::Path;
use std::process::Output;

use assert_cmd::Command;
use serde_json::Value;

const ROOF: &str = r#"
[[antenna]]
name = "bow"
position_m = [0.0, 0.0, 0.0]
[[antenna]]
name = "port"
position_m = [-1.5, -0.6, 0.0]
[[antenna]]
name = "starboard"
position_m = [-1.5, 0.6, 0.0]
[plan]
step_s = 1800.0
"#;

/// Runs the command on a file with this text; the outputs go to `folder/out`.
fn plan(folder: &Path, text: &str, options: &[&str]) -> Output {
    let file = folder.join("array.toml");
    fs::write(&file, text).unwrap();
    let mut command = Command::new(env!("CARGO_BIN_EXE_kurs"));
    command.arg("plan").arg(&file).arg("--out").arg(folder.join("out")).args(options);
    command.output().unwrap()
}

fn json(folder: &Path) -> Value {
    serde_json::from_str(&fs::read_to_string(folder.join("out/plan.json")).unwrap()).unwrap()
}

#[test]
fn a_roof_is_planned_for_a_day() {
    let folder = tempfile::tempdir().unwrap();
    let output = plan(folder.path(), ROOF, &[]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let text = String::from_utf8_lossy(&output.stdout);
    for expected in ["nominal", "does not matter", "one plane", "starboard", "optimal"] {
        assert!(text.contains(expected), "{expected}: {text}");
    }

    let plan = json(folder.path());
    let epochs = plan["epochs"].as_array().unwrap();
    assert_eq!(epochs.len(), 49);
    for epoch in epochs {
        // 1.5 m and 3 mm: some tenths of a degree.
        let heading = epoch["heading_sd_deg"].as_f64().unwrap();
        assert!((0.02..0.4).contains(&heading), "{heading}");
        assert!(epoch["roll_sd_deg"].as_f64().unwrap() > heading);
        let rate = epoch["success_rate"].as_f64().unwrap();
        assert!((0.0..=1.0).contains(&rate));
    }
    // The short side across is weak: roll.
    let axis = plan["improvement"]["weakest_axis_body"][0].as_f64().unwrap();
    assert!(axis.abs() > 0.9, "{axis}");
    let total = plan["improvement"]["total_deg"].as_f64().unwrap();
    assert!(plan["improvement"]["added"]["total_deg"].as_f64().unwrap() < total);
    assert!(plan["improvement"]["moved"]["total_deg"].as_f64().unwrap() < total);
    let whole = plan["array_constrained_success_rate"].as_f64().unwrap();
    assert!((0.5..=1.0).contains(&whole), "{whole}");
    let best = &plan["choices"][3];
    assert_eq!(best["criterion"], "trace_of_covariance");
    assert_eq!(best["gap"], 0.0);
    assert_eq!(best["baselines"].as_array().unwrap().len(), 2);
    assert!(best["error_relative_to_all_antennas"].as_f64().unwrap() >= 1.0);
    assert!(plan["choices"][0]["refused"].as_str().unwrap().contains("one plane"));

    let page = fs::read_to_string(folder.path().join("out/plan.html")).unwrap();
    assert!(page.contains("plot-2") && !page.contains("<script src="));
}

#[test]
fn two_antennas_have_no_roll_and_nothing_to_choose() {
    let folder = tempfile::tempdir().unwrap();
    let parts = ROOF.split("[[antenna]]").collect::<Vec<_>>();
    let text = format!("[[antenna]]{}[[antenna]]{}[plan]\nstep_s = 7200.0\n", parts[1], parts[2]);
    let output = plan(folder.path(), &text, &["--for", "6h"]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let plan = json(folder.path());
    assert_eq!(plan["epochs"].as_array().unwrap().len(), 4);
    assert!(plan["epochs"][0]["heading_sd_deg"].as_f64().unwrap() > 0.0);
    assert!(plan["epochs"][0]["roll_sd_deg"].is_null());
    assert!(plan["choices"][3]["refused"].as_str().unwrap().contains("one line"));
}

/// A line that rises on the body: the roll that nobody sees is in the heading. Of a mast nothing is told.
#[test]
fn a_rising_line_is_as_certain_as_the_unseen_roll_lets_it_be() {
    let folder = tempfile::tempdir().unwrap();
    let line = |place: &str| {
        let antenna =
            |name: &str, at: &str| format!("[[antenna]]\nname = \"{name}\"\nposition_m = [{at}]\n");
        let text = antenna("a", "0.0, 0.0, 0.0") + &antenna("b", place);
        let output =
            plan(folder.path(), &(text + "[solve]\nroll_sd_deg = 3.0\n"), &["--for", "1h"]);
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let told = String::from_utf8_lossy(&output.stdout).into_owned();
        assert!(told.contains("not seen") && !told.contains("NaN"), "{told}");
        json(folder.path())["epochs"][0].clone()
    };
    // One metre forward and 0.2 m up: a fifth of the roll.
    let heading = line("1.0, 0.0, -0.2")["heading_sd_deg"].as_f64().unwrap();
    assert!((0.6..0.75).contains(&heading), "{heading}");
    let mast = line("0.0, 0.0, -1.0");
    assert!(mast["heading_sd_deg"].is_null() && mast["pitch_sd_deg"].is_null(), "{mast}");
}

/// The configuration of `kurs solve` is an array file too; `[plan]` goes first.
#[test]
fn a_solve_configuration_is_planned() {
    let folder = tempfile::tempdir().unwrap();
    let solve = ROOF.replace("name", "obs = [\"x.rnx\"]\nname").replace("[plan]", "")
        + "[solve]\nbands = [\"G1\"]\nelevation_mask_deg = 25.0\nconstraint = \"array\"\n\
           code_sd_m = 0.6\n[[point]]\nname = \"p\"\nposition_m = [1.0, 0.0, 0.0]\n";
    let solve = solve.replace("step_s = 1800.0\n", "");
    let text = |folder: &Path, more: &str| {
        let output = plan(folder, &format!("{solve}{more}"), &["--for", "2h"]);
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8_lossy(&output.stdout).into_owned()
    };
    let inherited = text(folder.path(), "");
    assert!(inherited.contains("mask 25°") && inherited.contains("code 0.6 m"), "{inherited}");
    let satellites = json(folder.path())["epochs"][0]["satellites"].as_u64().unwrap();
    let own = text(folder.path(), "[plan]\nelevation_mask_deg = 5.0\n");
    assert!(own.contains("mask 5°") && own.contains("code 0.6 m"), "{own}");
    assert!(json(folder.path())["epochs"][0]["satellites"].as_u64().unwrap() > satellites);
}

/// Place, bands, noise, heading and time of a working configuration are those of its observations;
/// what nothing tells is called assumed, and the end of the ephemerides is told.
#[test]
fn a_working_configuration_is_planned_by_its_observations() {
    let folder = tempfile::tempdir().unwrap();
    let antennas = ROOF.split("[plan]").next().unwrap().replace("[[antenna]]", "[[body.antenna]]");
    let scenario = format!(
        "seed = 5\nstart = \"2024-03-10T12:00:00\"\nduration_s = 60.0\ninterval_s = 1.0\n\
         signals = [\"G1C\", \"G2W\", \"E1C\", \"E5Q\"]\n[sky]\nsystems = [\"G\", \"E\"]\n\
         [noise]\nlaw = \"mixed\"\ncode_sd_m = 0.5\nphase_sd_cycles = 0.012\n\
         [[body]]\nname = \"body\"\n[body.motion]\nkind = \"static\"\n\
         place = {{ latitude_deg = -33.0, longitude_deg = 18.0, height_m = 40.0 }}\n\
         heading_deg = 250.0\npitch_deg = 12.0\nroll_deg = -7.0\n{antennas}"
    );
    fs::write(folder.path().join("scenario.toml"), scenario).unwrap();
    let kurs = |arguments: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_kurs"));
        let output = command.current_dir(folder.path()).args(arguments).output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        String::from_utf8(output.stdout).unwrap()
    };
    kurs(&["simulate", "scenario.toml", "--out", "."]);
    let text = kurs(&["plan", "kurs.toml", "--for", "12h", "--out", "out"]);
    let plan = json(folder.path());
    let basis =
        |key: &str| (plan["basis"][key]["value"].clone(), plan["basis"][key]["from"].clone());
    let near = |key: &str, expected: f64, tolerance: f64| {
        let (value, from) = basis(key);
        assert_eq!(from, "the observations", "{key}");
        assert!((value.as_f64().unwrap() - expected).abs() < tolerance, "{key}: {value}");
    };
    near("latitude_deg", -33.0, 1e-3);
    near("longitude_deg", 18.0, 1e-3);
    near("heading_deg", 250.0, 1.0);
    near("pitch_deg", 12.0, 1.0);
    near("roll_deg", -7.0, 1.0);
    near("code_sd_m", 0.5, 0.15);
    // Cycles of 0.19 to 0.25 m.
    near("phase_sd_m", 0.012 * 0.22, 0.0003);
    assert_eq!(basis("bands"), ("G1 G2 E1 E5".into(), "the observations".into()));
    // The simulated array is exact: as near to zero as a plan takes.
    assert_eq!(basis("length_sd_m"), (1e-6.into(), "[solve]".into()));
    assert!(plan["epochs"][0]["time_gpst"].as_str().unwrap().starts_with("2024-03-10T12:00:00"));
    let notes = plan["notes"].to_string();
    assert!(notes.contains("ephemerides of GPS end") && text.contains("shorter --for"), "{notes}");

    // `[plan]` of the same file goes first, and `kurs solve` leaves it alone.
    let configuration = fs::read_to_string(folder.path().join("kurs.toml")).unwrap();
    fs::write(folder.path().join("kurs.toml"), configuration + "[plan]\nheading_deg = 90.0\n")
        .unwrap();
    kurs(&["plan", "kurs.toml", "--for", "1h", "--out", "out"]);
    let plan = json(folder.path());
    assert_eq!(plan["basis"]["heading_deg"]["from"], "[plan]");
    assert_eq!(plan["basis"]["latitude_deg"]["from"], "the observations");
    assert_eq!(plan["notes"].as_array().unwrap().len(), 0, "{}", plan["notes"]);
    kurs(&["solve", "kurs.toml", "--quiet", "--out", "out"]);

    fs::remove_file(folder.path().join("port.rnx")).unwrap();
    kurs(&["plan", "kurs.toml", "--for", "1h", "--out", "out"]);
    let notes = json(folder.path())["notes"].to_string();
    assert!(notes.contains("port.rnx is not there") && notes.contains("is assumed"), "{notes}");
}

#[test]
fn wrong_files_are_usage_errors_that_name_the_key() {
    let one = "[[antenna]]\nname = \"a\"\nposition_m = [0.0, 0.0, 0.0]\n";
    let with = |more: &str| format!("{ROOF}{more}\n");
    let weight = |rover: &str, weight: &str| {
        with(&format!("[[baseline]]\nbetween = [\"bow\", \"{rover}\"]\nweight = {weight}"))
    };
    let mask = |from: &str, to: &str, elevation: &str| {
        with(&format!("[[mask]]\nfrom_deg = {from}\nto_deg = {to}\nelevation_deg = {elevation}"))
    };
    for (text, expected) in [
        (one.to_owned(), "1 antenna"),
        (
            format!("{one}{}", one.replace("\"a\"", "\"b\"")),
            "antennas `a` and `b` are 0.0000 m apart",
        ),
        (ROOF.replace("step_s", "step"), "did you mean `step_s`"),
        (ROOF.replacen("position_m = [-1.5, -0.6, 0.0]", "", 1), "`port` has no `position_m`"),
        (ROOF.replace("1800.0", "nan"), "array.toml: plan.step_s is NaN"),
        (with("[solve]\nbandz = [\"G1\"]"), "unknown key `bandz`, did you mean `bands`"),
        (with(r#"bands = ["G1", "G1"]"#), "plan.bands: G1 is given twice"),
        (ROOF.replace("-1.5", "inf"), "not a finite number"),
        (with(r#"criterion = "best""#), "unknown variant `best`"),
        (ROOF.replace("\"port\"", "\"bow\""), "two antennas are named `bow`"),
        (
            ROOF.replace("-1.5, -0.6", "-1e9, -0.6"),
            "antennas `bow` and `port` are 1000000000 m apart",
        ),
        (with(r#"bands = ["J1"]"#), "none of J1: give navigation files with --nav"),
        (mask("0.0", "1e9", "30.0"), "mask.to_deg is 1000000000, expected -360 to 360"),
        (mask("nan", "10.0", "30.0"), "mask.from_deg is NaN"),
        (mask("0.0", "10.0", "-50.0"), "mask.elevation_deg is -50, expected 0 to 90"),
        (with(r#"bands = ["X9"]"#), "plan.bands"),
        (weight("mast", "1.0"), "`mast`"),
        (weight("bow", "1.0"), "named twice"),
        (weight("port", "-1.0"), "weight -1"),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let output = plan(folder.path(), &text, &[]);
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{message}");
        assert!(message.contains(expected), "{expected}: {message}");
        assert!(!folder.path().join("out").exists(), "nothing is written");
    }
}

/// A file that is no navigation file is input that cannot be used.
#[test]
fn a_wrong_navigation_file_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("brdc.rnx");
    fs::write(&file, "not a navigation file\n").unwrap();
    let output = plan(folder.path(), ROOF, &["--nav", file.to_str().unwrap()]);
    assert_eq!(output.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&output.stderr).contains("brdc.rnx"));
}
