//! Real recordings, end to end: what `kurs solve` makes of them, against their truth.
//!
//! Reads the folder named by `KURS_DATA` (default `../shared/data` beside the workspace); where it
//! is absent every test says `skipped` and passes.

#![allow(clippy::print_stdout)] // measured figures, and what was skipped

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use assert_cmd::Command;
use kurs::array::AntennaArray;
use kurs::engine::{Constraint, Engine, Settings};
use kurs::ephemeris::NavigationData;
use kurs::frames::Vector;
use kurs::observation::{AntennaEpoch, ArrayEpoch};
use kurs::point;
use kurs::signal::System;
use kurs::sky::{Horizon, View};
use kurs_formats::session::SessionReader;
use kurs_formats::source::Source;
use nalgebra::Vector3;

type Row = BTreeMap<String, String>;

/// The folder of recordings, if it is there.
fn data() -> Option<PathBuf> {
    crate::outside::recording("matrtklib_static")?.parent().map(Path::to_path_buf)
}

/// A recording of two antennas.
struct Recording {
    base: &'static str,
    rover: &'static str,
    navigation: &'static str,
    /// Baseline east, north, up, m.
    truth_m: [f64; 3],
    /// ECEF of the base antenna, m, where it is known.
    base_ecef_m: Option<[f64; 3]>,
}

const MATRTKLIB: Recording = Recording {
    base: "matrtklib_static/base.obs",
    rover: "matrtklib_static/rover.obs",
    navigation: "matrtklib_static/base.nav",
    truth_m: [-0.2235, -0.9645, 0.009],
    base_ecef_m: Some([-3_817_681.096_5, 3_562_839.457_8, 3_650_159.129_3]),
};
const UPC: Recording = Recording {
    base: "upc2011/UPC10770.11o",
    rover: "upc2011/UPC20770.11o",
    navigation: "upc2011/brdc0770.11n",
    truth_m: [-27.4088, -26.2188, -0.0403],
    base_ecef_m: Some([4_789_013.007_7, 176_610.155_5, 4_195_034.809_1]),
};
const GEONET: Recording = Recording {
    base: "geonet2005/07590920.05o",
    rover: "geonet2005/30400920.05o",
    navigation: "geonet2005/30400920.05n",
    truth_m: [953.6729, -3196.1390, 4.6514],
    base_ecef_m: None,
};

/// Rows of the two tables of one run.
struct Solved {
    attitude: Vec<Row>,
    baselines: Vec<Row>,
}

fn solve(data: &Path, recording: &Recording, length_m: Option<f64>, settings: &[&str]) -> Solved {
    let out = tempfile::tempdir().expect("a temporary folder");
    let file = |name: &str| data.join(name).display().to_string();
    let place = |x: f64| length_m.map_or(String::new(), |_| format!("@{x},0,0"));
    let mut command = Command::cargo_bin("kurs").expect("the program");
    command.args(["solve", "--quiet", "--require-fix", "0", "--nav", &file(recording.navigation)]);
    command.args(["--antenna", &format!("A={}{}", file(recording.base), place(0.0))]);
    let rover = format!("B={}{}", file(recording.rover), place(length_m.unwrap_or(0.0)));
    command.args(["--antenna", &rover]).arg("--out").arg(out.path());
    for setting in settings {
        command.args(["--set", setting]);
    }
    command.assert().success();
    Solved {
        attitude: table(&out.path().join("attitude.csv")),
        baselines: table(&out.path().join("baselines.csv")),
    }
}

fn table(path: &Path) -> Vec<Row> {
    let mut reader = csv::Reader::from_path(path).expect("a table");
    reader.deserialize().collect::<Result<_, _>>().expect("rows with the columns of the header")
}

fn number(row: &Row, column: &str) -> f64 {
    row[column].parse().unwrap_or(f64::NAN)
}

impl Solved {
    fn fixed(&self) -> impl Iterator<Item = &Row> {
        self.baselines.iter().filter(|row| row["status"] == "fixed")
    }

    fn fix_rate(&self) -> f64 {
        self.fixed().count() as f64 / self.attitude.len() as f64
    }

    /// Fixed rows off by more than 5 cm and 5 standard deviations in a component.
    fn wrong(&self, truth_m: &[f64; 3]) -> usize {
        let components = [("east_m", "sd_east_m"), ("north_m", "sd_north_m"), ("up_m", "sd_up_m")];
        let wrong = |row: &&Row| {
            components.iter().zip(truth_m).any(|((value, sd), truth)| {
                (number(row, value) - truth).abs() > (5.0 * number(row, sd)).max(0.05)
            })
        };
        self.fixed().filter(wrong).count()
    }

    fn mean(&self, column: &str) -> f64 {
        self.fixed().map(|row| number(row, column)).sum::<f64>() / self.fixed().count() as f64
    }

    fn spread(&self, column: &str) -> f64 {
        let mean = self.mean(column);
        let squares: f64 = self.fixed().map(|row| (number(row, column) - mean).powi(2)).sum();
        (squares / self.fixed().count() as f64).sqrt()
    }
}

#[test]
fn two_receivers_a_metre_apart_without_constraint() {
    let Some(data) = data() else { return };
    // Length scatter of RTKLIB 2.4.3 on the same bytes (`rnx2rtkp`, each epoch alone), m.
    for (bands, least, rtklib_m) in [
        ("bands=[G1]", 0.99, 0.001_106),
        ("bands=[G1,G2]", 0.995, 0.001_312),
        ("bands=[G1,E1,C2]", 0.995, 0.000_611),
        ("bands=[G1,G2,E1,E5,C2,C7]", 0.995, 0.000_566),
    ] {
        let solved = solve(&data, &MATRTKLIB, None, &["elevation_mask_deg=15", bands]);
        assert_eq!(solved.attitude.len(), 301);
        assert!(solved.fix_rate() >= least, "{bands}: {}", solved.fix_rate());
        assert_eq!(solved.wrong(&MATRTKLIB.truth_m), 0, "{bands}");
        let [east, north, up] = MATRTKLIB.truth_m;
        let horizontal_m = (solved.mean("east_m") - east).hypot(solved.mean("north_m") - north);
        assert!(horizontal_m < 0.006, "{bands}: {horizontal_m}");
        assert!((solved.mean("up_m") - up).abs() < 0.010, "{bands}: {}", solved.mean("up_m"));
        assert!(
            solved.spread("length_m") < 1.1 * rtklib_m,
            "{bands}: {}",
            solved.spread("length_m")
        );
    }
}

#[test]
fn roofs_38_m_apart_on_two_bands() {
    let Some(data) = data() else { return };
    let solved = solve(&data, &UPC, None, &["elevation_mask_deg=15", "bands=[G1,G2]"]);
    assert_eq!(solved.attitude.len(), 1800);
    assert!(solved.fix_rate() >= 0.995, "{}", solved.fix_rate());
    assert_eq!(solved.wrong(&UPC.truth_m), 0);
    for (column, truth) in ["east_m", "north_m", "up_m"].into_iter().zip(UPC.truth_m) {
        assert!((solved.mean(column) - truth).abs() < 0.003, "{column}: {}", solved.mean(column));
    }
}

#[test]
fn network_stations_3_km_apart() {
    let Some(data) = data() else { return };
    let solved = solve(&data, &GEONET, None, &["elevation_mask_deg=15", "bands=[G1,G2]"]);
    let six = |row: &&Row| number(row, "satellites") >= 6.0;
    let strong = solved.attitude.iter().filter(six).count();
    let fixed = solved.attitude.iter().filter(six).filter(|row| row["status"] == "fixed").count();
    assert!(strong >= 100, "{strong}");
    assert!(fixed as f64 >= 0.99 * strong as f64, "{fixed} of {strong}");
    assert_eq!(solved.wrong(&GEONET.truth_m), 0);
}

#[test]
fn one_band_with_the_length_known() {
    let Some(data) = data() else { return };
    for (recording, length_m, sd_m, least) in
        [(&UPC, 37.93, 0.01, 0.97), (&MATRTKLIB, 0.990, 0.002, 0.995)]
    {
        let sd = format!("array_sd_m={sd_m}");
        let settings = ["constraint=length", "elevation_mask_deg=15", "bands=[G1]", &sd];
        let solved = solve(&data, recording, Some(length_m), &settings);
        assert!(solved.fix_rate() >= least, "{}: {}", recording.base, solved.fix_rate());
        assert_eq!(solved.wrong(&recording.truth_m), 0, "{}", recording.base);
        // One band alone is unproven until the second epoch agrees.
        assert_eq!(solved.attitude[1]["status"], "fixed", "{}: second epoch", recording.base);
    }
}

/// Ambiguities carried from epoch to epoch, one band, nothing known of the geometry.
#[test]
fn continuous_ambiguities_are_right_after_the_first_minute() {
    let Some(data) = data() else { return };
    for (recording, bands, motion) in [
        (&UPC, "bands=[G1]", "motion=free"),
        (&MATRTKLIB, "bands=[G1]", "motion=free"),
        (&GEONET, "bands=[G1,G2]", "motion=free"),
        (&UPC, "bands=[G1]", "motion=static"),
    ] {
        let settings = ["ambiguity=continuous", "elevation_mask_deg=15", bands, motion];
        let solved = solve(&data, recording, None, &settings);
        let start_s = number(&solved.attitude[0], "tow_s");
        let later = solved.attitude.iter().filter(|row| number(row, "tow_s") - start_s > 60.0);
        let not_fixed = later.filter(|row| row["status"] != "fixed").count();
        assert_eq!(not_fixed, 0, "{} {bands} {motion}", recording.base);
        assert_eq!(solved.wrong(&recording.truth_m), 0, "{} {bands}", recording.base);
    }
}

/// Every GLONASS satellite has a wavelength of its own.
#[test]
fn glonass_alone() {
    let Some(data) = data() else { return };
    for (length_m, constraint) in [(Some(0.990), "constraint=length"), (None, "constraint=none")] {
        for ambiguity in ["ambiguity=instantaneous", "ambiguity=continuous"] {
            let settings = [constraint, ambiguity, "elevation_mask_deg=15", "bands=[R1,R2]"];
            let solved = solve(&data, &MATRTKLIB, length_m, &settings);
            let rate = solved.fix_rate();
            assert!(rate >= 0.95, "{constraint} {ambiguity}: {rate}");
            assert_eq!(solved.wrong(&MATRTKLIB.truth_m), 0, "{constraint} {ambiguity}");
        }
    }
}

/// Weak sky: nothing is promised of the fix rate, but a fix must be right.
#[test]
fn one_band_without_constraint_fixes_nothing_wrong() {
    let Some(data) = data() else { return };
    for (recording, bands) in
        [(&UPC, "bands=[G1]"), (&MATRTKLIB, "bands=[E1]"), (&MATRTKLIB, "bands=[C2]")]
    {
        let solved = solve(&data, recording, None, &["elevation_mask_deg=15", bands]);
        assert_eq!(solved.wrong(&recording.truth_m), 0, "{} {bands}", recording.base);
    }
}

#[test]
fn positions_and_static_velocity() {
    let Some(data) = data() else { return };
    for (recording, bands) in [
        (&MATRTKLIB, None),
        (&MATRTKLIB, Some("bands=[C2]")),
        (&MATRTKLIB, Some("bands=[E1]")),
        (&UPC, None),
    ] {
        let Some([x, y, z]) = recording.base_ecef_m else { continue };
        let truth = kurs::frames::Vector::new(x, y, z);
        let here = kurs::frames::Geodetic::from_ecef(truth);
        let solved = solve(&data, recording, None, bands.as_slice());
        let errors: Vec<[f64; 2]> = solved
            .attitude
            .iter()
            .map(|row| {
                let found = kurs::frames::Geodetic::from_degrees(
                    number(row, "latitude_deg"),
                    number(row, "longitude_deg"),
                    number(row, "height_m"),
                );
                let ned = (here.ned_from_ecef() * (found.to_ecef() - truth)).xyz();
                [ned.x.hypot(ned.y), ned.z]
            })
            .collect();
        let rms = |i: usize| {
            (errors.iter().map(|e| e[i] * e[i]).sum::<f64>() / errors.len() as f64).sqrt()
        };
        assert!(rms(0) <= 2.5, "{} {bands:?}: horizontal {}", recording.base, rms(0));
        assert!(rms(1) <= 6.0, "{} {bands:?}: vertical {}", recording.base, rms(1));
        println!(
            "{} {bands:?}: horizontal {:.2} m, vertical {:.2} m",
            recording.base,
            rms(0),
            rms(1)
        );
        let speeds: Vec<f64> = solved
            .attitude
            .iter()
            .filter(|row| !row["vel_north_mps"].is_empty())
            .map(|row| {
                number(row, "vel_north_mps")
                    .hypot(number(row, "vel_east_mps"))
                    .hypot(number(row, "vel_down_mps"))
            })
            .collect();
        if !speeds.is_empty() {
            let rms = (speeds.iter().map(|v| v * v).sum::<f64>() / speeds.len() as f64).sqrt();
            println!("{} {bands:?}: speed {rms:.4} m/s", recording.base);
            assert!(rms <= 0.05, "{} {bands:?}: {rms}", recording.base);
        }
    }
}

/// Six GPS satellites, one band, length known to 2 mm: few epochs can be fixed, none wrongly.
#[test]
fn only_the_six_highest_satellites() {
    let Some(data) = data() else { return };
    let mut navigation = NavigationData::default();
    let mut source = Source::open(data.join(MATRTKLIB.navigation)).unwrap();
    kurs_formats::navigation::read(&mut source, &mut navigation).unwrap();
    let ends = vec![Vector::new(0.0, 0.0, 0.0), Vector::new(0.990, 0.0, 0.0)];
    let settings = Settings {
        antennas: 2,
        array: Some(AntennaArray::new(ends).unwrap()),
        bands: Some(vec!["G1".parse().unwrap()]),
        elevation_mask_rad: 10f64.to_radians(),
        constraint: Constraint::Length,
        ..Settings::default()
    };
    let mut engine = Engine::new(settings, navigation.clone()).unwrap();
    let open = |file| SessionReader::open(&[data.join(file)]).unwrap();
    let (mut base, mut rover) = (open(MATRTKLIB.base), open(MATRTKLIB.rover));
    let mut epoch =
        ArrayEpoch { antennas: vec![Some(AntennaEpoch::default()); 2], ..ArrayEpoch::default() };
    let (mut epochs, mut fixed, mut wrong) = (0, 0, 0);
    let [x, y, z] = MATRTKLIB.base_ecef_m.unwrap();
    let horizon = Horizon::at(Vector::new(x, y, z));
    loop {
        let [first, second] = &mut epoch.antennas[..] else { unreachable!() };
        let (first, second) = (first.as_mut().unwrap(), second.as_mut().unwrap());
        if !base.next_epoch(first).unwrap() || !rover.next_epoch(second).unwrap() {
            break;
        }
        epoch.time = first.time;
        // Both receivers have the same epochs.
        assert!((first.time - second.time).abs() < 0.01);
        let mut tracked = Vec::new();
        point::track(first, &navigation, |system| system == System::Gps, &mut tracked);
        let elevation_rad = |t: &point::Tracked| {
            horizon
                .direction(View::new(&t.state, Vector::new(x, y, z)).line_of_sight)
                .elevation_rad()
        };
        tracked.sort_by(|a, b| elevation_rad(b).total_cmp(&elevation_rad(a)));
        let six: Vec<_> = tracked.iter().take(6).map(|t| t.satellite).collect();
        for antenna in epoch.antennas.iter_mut().flatten() {
            antenna.observations.retain(|o| six.contains(&o.satellite));
        }
        let row = engine.push(&epoch);
        epochs += 1;
        if row.is_fixed() {
            fixed += 1;
            let error = row.baselines[0].baseline_m.xyz() - Vector3::from(MATRTKLIB.truth_m);
            wrong += usize::from(error.amax() > 0.05);
        }
    }
    println!("six satellites: {fixed} of {epochs} fixed, {wrong} wrong");
    assert_eq!((epochs, wrong), (301, 0));
    assert!(f64::from(fixed) >= 0.6 * f64::from(epochs), "{fixed} of {epochs}");
}
