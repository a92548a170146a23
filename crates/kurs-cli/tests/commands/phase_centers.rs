//! A baseline between unlike antennas moves by the tabulated offsets of their phase centres, turned
//! with the body: through the whole of `kurs solve`, on a recording.
#![allow(clippy::unwrap_used, clippy::print_stdout)] // a test

use std::fs;
use std::path::Path;

use assert_cmd::Command;

/// An ANTEX file with two antennas; the values are offsets north, east, up in mm.
fn antex(antennas: &[(&str, [f64; 3])]) -> String {
    let mut text = String::new();
    let mut line = |content: &str, label: &str| text += &format!("{content:<60}{label}\n");
    line("     1.4            M", "ANTEX VERSION / SYST");
    line("A", "PCV TYPE / REFANT");
    line("", "END OF HEADER");
    for (name, [north, east, up]) in antennas {
        line("", "START OF ANTENNA");
        line(name, "TYPE / SERIAL NO");
        line("     0.0", "DAZI");
        line("     0.0  90.0  45.0", "ZEN1 / ZEN2 / DZEN");
        line("     1", "# OF FREQUENCIES");
        for band in ["G01", "G02"] {
            line(&format!("   {band}"), "START OF FREQUENCY");
            line(&format!("{north:10.2}{east:10.2}{up:10.2}"), "NORTH / EAST / UP");
            line("   NOAZI    0.00    0.00    0.00", "");
            line(&format!("   {band}"), "END OF FREQUENCY");
        }
        line("", "END OF ANTENNA");
    }
    text
}

/// Solves with these further keys of the two antennas: exit status, what was said.
fn solve(folder: &Path, out: &Path, keys: [&str; 2], antex: bool) -> (i32, String) {
    let antenna = |name: &str, file: &str, keys: &str| {
        let path = folder.join(file);
        format!("[[antenna]]\nname = \"{name}\"\nobs = [\"{}\"]\n{keys}\n", path.display())
    };
    let mut config = antenna("A", "base.obs", keys[0]) + &antenna("B", "rover.obs", keys[1]);
    config += &format!("[nav]\nfiles = [\"{}\"]\n", folder.join("base.nav").display());
    if antex {
        config += "[antex]\nfiles = [\"a.atx\"]\n";
    }
    fs::write(out.join("c.toml"), config).unwrap();
    let output = Command::cargo_bin("kurs")
        .unwrap()
        .current_dir(out)
        .args(["solve", "c.toml", "--quiet", "--set", "bands=[G1,G2,E1]", "--out", "out"])
        .output()
        .unwrap();
    (output.status.code().unwrap(), String::from_utf8_lossy(&output.stderr).into_owned())
}

/// Mean of columns over the fixed rows but the first ten.
fn means<const N: usize>(out: &Path, table: &str, columns: [&str; N]) -> [f64; N] {
    let text = fs::read_to_string(out.join("out").join(table)).unwrap();
    let header: Vec<&str> = text.lines().next().unwrap().split(',').collect();
    let place = |name: &str| header.iter().position(|column| *column == name).unwrap();
    let rows = text.lines().skip(11).map(|line| line.split(',').collect::<Vec<_>>());
    let fixed: Vec<_> = rows.filter(|row| row[place("status")] == "fixed").collect();
    assert!(fixed.len() > 280, "{} fixed", fixed.len());
    columns.map(|column| {
        let sum: f64 = fixed.iter().map(|row| row[place(column)].parse::<f64>().unwrap()).sum();
        sum / fixed.len() as f64
    })
}

#[test]
fn a_baseline_between_unlike_antennas_moves_by_the_tabulated_offsets() {
    let Some(folder) = crate::outside::recording("matrtklib_static") else { return };
    let out = tempfile::tempdir().unwrap();
    let out = out.path();
    let types =
        [("CHOKE           NONE", [0.0, 0.0, 90.0]), ("PATCH           NONE", [3.0, 5.0, 50.0])];
    fs::write(out.join("a.atx"), antex(&types)).unwrap();
    let columns = ["east_m", "north_m", "up_m"];

    assert_eq!(solve(&folder, out, ["", ""], false), (0, String::new()));
    let phase_centers_m = means(out, "baselines.csv", columns);
    let keys = [
        "antenna_type = \"CHOKE\"",
        "antenna_type = \"PATCH NONE\"\nantenna_orientation_deg = 90.0",
    ];
    assert_eq!(solve(&folder, out, keys, true), (0, String::new()));
    let reference_points_m = means(out, "baselines.csv", columns);
    let [heading_deg, pitch_deg] = means(out, "attitude.csv", ["heading_deg", "pitch_deg"]);

    // North mark to the right: north 3 mm is 3 mm right, east 5 mm is 5 mm backward. In body axes
    // (forward, right, up) B's phase centre is at (−5, 3, 50) mm and A's at (0, 0, 90) mm.
    let [forward, right, up] = [-0.005, 0.003, 0.050 - 0.090];
    // Without places of the antennas the body is the baseline: its heading and pitch, no roll.
    let (sh, ch) = heading_deg.to_radians().sin_cos();
    let (sp, cp) = pitch_deg.to_radians().sin_cos();
    let ahead = forward * cp - up * sp;
    let offset_m = [ahead * sh + right * ch, ahead * ch - right * sh, forward * sp + up * cp];
    for axis in 0..3 {
        let moved_m = reference_points_m[axis] - phase_centers_m[axis];
        println!("{} moved {:.4} m, tabulated {:.4} m", columns[axis], moved_m, -offset_m[axis]);
        assert!((moved_m + offset_m[axis]).abs() < 2e-4, "{moved_m} {}", -offset_m[axis]);
    }
    // To the eye: up by 40 mm, and some millimetres to the side.
    assert!((reference_points_m[2] - phase_centers_m[2] - 0.040).abs() < 0.001);
}

/// Which calibration serves (here that without the radome), and for which bands.
#[test]
fn what_serves_is_told() {
    let Some(folder) = crate::outside::recording("matrtklib_static") else { return };
    let out = tempfile::tempdir().unwrap();
    let out = out.path();
    fs::write(out.join("a.atx"), antex(&[("CHOKE           NONE", [0.0; 3])])).unwrap();
    solve(&folder, out, ["", "antenna_type = \"CHOKE SCIS\""], true);
    let output = Command::cargo_bin("kurs")
        .unwrap()
        .current_dir(out)
        .args(["solve", "c.toml", "--set", "bands=[G1]", "--out", "out"])
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    let expected =
        "note: antenna B: calibration of \"CHOKE           NONE\", bands G1 G2; other bands";
    assert!(said.contains(expected), "{said}");
}

#[test]
fn wrong_keys_are_named() {
    let Some(folder) = crate::outside::recording("matrtklib_static") else { return };
    let out = tempfile::tempdir().unwrap();
    let out = out.path();
    // A number that is too wide for its columns makes a band unusable.
    let types = [("CHOKE           NONE", [0.0; 3]), ("BROKEN          NONE", [1e9; 3])];
    fs::write(out.join("a.atx"), antex(&types)).unwrap();
    for (key, antex, expected) in [
        ("antenna_type = \"CHOKE\"", false, "give `[antex] files`"),
        ("antenna_type = \"BROKEN\"", true, "no usable band"),
        ("antenna_type = \"CHOQUE\"", true, "the nearest is \"CHOKE"),
        ("antenna_orientation_deg = 10.0", true, "without `antenna_type`"),
        ("antenna_type = \"CHOKE\"\nantenna_orientation_deg = 1000.0", true, "-360 to 360"),
        ("antenna_typ = \"CHOKE\"", true, "did you mean `antenna_type`"),
    ] {
        let (status, said) = solve(&folder, out, ["", key], antex);
        assert_eq!(status, 2, "{said}");
        assert!(said.contains(expected), "{said}");
        assert!(!out.join("out").exists());
    }
}
