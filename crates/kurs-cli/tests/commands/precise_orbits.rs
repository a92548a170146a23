//! `kurs solve` with precise orbits alone: the broadcast orbits of a recording, written as an SP3
//! file, give the same baselines as the broadcast file itself.
#![allow(clippy::unwrap_used, clippy::print_stdout)] // a test

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use assert_cmd::Command;
use kurs::ephemeris::{Ephemeris, NavigationData};
use kurs::signal::{SPEED_OF_LIGHT_MPS, Satellite};
use kurs::time::{Calendar, GpsTime};
use kurs_formats::navigation;
use kurs_formats::source::Source;

/// Nodes every five minutes, half an hour to both sides of the recording (08:20 to 08:25), of the
/// record of each satellite that is nearest to it.
fn sp3(navigation: &NavigationData) -> String {
    let calendar =
        |hour, minute| Calendar { year: 2024, month: 6, day: 24, hour, minute, second: 0.0 };
    let middle = GpsTime::from_calendar(calendar(8, 22)).unwrap();
    let mut records: BTreeMap<Satellite, &Ephemeris> = BTreeMap::new();
    for record in navigation.ephemerides.iter() {
        let away = |e: &Ephemeris| (e.reference_time() - middle).abs();
        let nearest = records.entry(record.satellite()).or_insert(record);
        if away(record) < away(nearest) {
            *nearest = record;
        }
    }
    let mut text = "#cP2024  6 24  7 50  0.00000000      13 ORBIT WGS84 FIT TEST\n".to_owned();
    text += "## 2320 114600.00000000   300.00000000 60485 0.3263888888889\n";
    text += "%c M  cc GPS ccc cccc cccc cccc cccc ccccc ccccc ccccc ccccc\n";
    for step in 0..13 {
        let time = GpsTime::from_calendar(calendar(7, 50)).unwrap() + 300.0 * f64::from(step);
        let c = time.calendar();
        let _ = writeln!(text, "*  2024  6 24 {:2} {:2} {:11.8}", c.hour, c.minute, c.second);
        for (satellite, record) in &records {
            let state = record.state(time).unwrap();
            // A precise clock leaves the periodic relativistic effect out: Δt_rel = −2 r·v / c².
            let relativistic_s = -2.0 * state.position_m.dot(&state.velocity_mps)
                / (SPEED_OF_LIGHT_MPS * SPEED_OF_LIGHT_MPS);
            let [x, y, z]: [f64; 3] = (state.position_m * 1e-3).xyz().into();
            let clock_us = 1e6 * (state.clock_s - relativistic_s);
            let _ = writeln!(text, "P{satellite}{x:14.6}{y:14.6}{z:14.6}{clock_us:14.6}");
        }
    }
    text + "EOF\n"
}

/// Number of fixed epochs, and the mean baseline.
fn solve(folder: &Path, navigation: &Path, out: &Path) -> (usize, [f64; 3]) {
    let antenna = |name: &str, file: &str| format!("{name}={}", folder.join(file).display());
    Command::cargo_bin("kurs")
        .unwrap()
        .args(["solve", "--antenna", &antenna("A", "base.obs")])
        .args(["--antenna", &antenna("B", "rover.obs"), "--nav"])
        .args([navigation, Path::new("--quiet"), Path::new("--out"), out])
        .assert()
        .success();
    let text = fs::read_to_string(out.join("baselines.csv")).unwrap();
    let place = |name: &str| text.lines().next().unwrap().split(',').position(|c| c == name);
    let columns = ["east_m", "north_m", "up_m"].map(|name| place(name).unwrap());
    let rows = text.lines().skip(1).map(|line| line.split(',').collect::<Vec<_>>());
    let fixed: Vec<_> = rows.filter(|row| row[place("status").unwrap()] == "fixed").collect();
    let mean = |column: usize| {
        let sum: f64 = fixed.iter().map(|row| row[column].parse::<f64>().unwrap()).sum();
        sum / fixed.len() as f64
    };
    (fixed.len(), columns.map(mean))
}

#[test]
fn precise_orbits_alone_give_the_same_baselines() {
    let Some(folder) = crate::outside::recording("matrtklib_static") else { return };
    let mut navigation = NavigationData::default();
    let broadcast = folder.join("base.nav");
    navigation::read(&mut Source::open(&broadcast).unwrap(), &mut navigation).unwrap();
    let out = tempfile::tempdir().unwrap();
    let precise = out.path().join("orbits.sp3");
    fs::write(&precise, sp3(&navigation)).unwrap();

    let (by_broadcast, broadcast_m) = solve(&folder, &broadcast, &out.path().join("broadcast"));
    let (by_precise, precise_m) = solve(&folder, &precise, &out.path().join("precise"));
    println!(
        "broadcast: {by_broadcast} fixed, {broadcast_m:?}; SP3: {by_precise} fixed, {precise_m:?}"
    );
    assert_eq!((by_broadcast, by_precise), (301, 301));
    for axis in 0..3 {
        assert!((broadcast_m[axis] - precise_m[axis]).abs() < 1e-3, "axis {axis}");
    }
}
