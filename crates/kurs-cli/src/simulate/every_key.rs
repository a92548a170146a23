//! Every key of a scenario file: misspelt, of a wrong type, at and beyond its limits, and beside
//! keys that contradict it.
#![allow(clippy::unwrap_used)] // tests

use kurs_sim::scenario::Scenario;
use kurs_sim::simulation::{Attachments, Simulation};

use crate::config_file;

/// A scenario with every key outside `body.motion`.
const SCENARIO: &str = r#"
seed = 1
start = "2024-03-10T12:00:00"
duration_s = 2.0
interval_s = 1.0
signals = ["G1C", "G2W", "R1C", "C2I"]
array_sd_m = 0.001
[sky]
systems = ["G", "R", "E", "C"]
max_satellites = 20
elevation_mask_deg = 5.0
horizon_deg = [[0, 90, 10]]
orbit_error_sd_m = 0.5
clock_error_sd_m = 0.5
[clock]
common = true
bias_sd_s = 1e-4
drift_sd = 1e-7
wander = 1e-10
millisecond_jumps = true
phase_bias = true
[noise]
law = "flat"
code_sd_m = 0.3
phase_sd_cycles = 0.01
doppler_sd_hz = 0.1
cn0_zenith_dbhz = 50.0
gain_sd_db = 1.0
tracking_dbhz = 20.0
[multipath]
code_sd_m = 0.5
phase_sd_m = 0.001
correlation_s = 30.0
common_share = 0.5
[atmosphere]
ionosphere_zenith_m = 3.0
troposphere_zenith_m = 2.4
wind_up = true
[slips]
per_hour = 1.0
flagged_share = 0.5
[station]
name = "base"
signals = ["G1C"]
[station.place]
latitude_deg = 55.0
longitude_deg = 37.0
height_m = 150.0
[output]
formats = ["rinex", "crinex.gz"]
[[outage]]
from_s = 0.0
to_s = 1.0
antennas = ["A0"]
satellites = ["G05"]
bands = ["G2"]
[[interference]]
from_s = 0.0
to_s = 1.0
bands = ["G1"]
cn0_drop_db = 6.0
[[slip]]
time_s = 1.0
antenna = "A1"
satellite = "G05"
band = "G1"
cycles = 1
flagged = true
[[bias]]
antenna = "A0"
system = "C"
signal = "C2I"
orbit = "meo"
code_m = 1.0
phase_cycles = 0.25
[[bias]]
code_m_per_channel = 0.1
phase_cycles_per_channel = 0.1
[[bias]]
satellites = ["C19"]
code_m = 5.0
[[wall]]
from_m = [-5.0, 4.0]
to_m = [5.0, 4.0]
height_m = 3.0
reflection = 0.2
[[canopy]]
antennas = ["A1"]
sky_deg = [[0, 90, 60]]
loss_db = 6.0
loss_sd_db = 3.0
loss_correlation_s = 60.0
late_m_per_db = 0.004
scattered_share = 0.01
scatter_correlation_s = 5.0
code_tails_per_hour = 6.0
[[body]]
name = "car"
[[body.antenna]]
name = "A0"
position_m = [0.0, 0.0, 0.0]
signals = ["G2W", "C2I"]
tag_offset_s = 0.0004
turned_deg = 10.0
mask_deg = [[0, 90, 10]]
[[body.antenna]]
name = "A1"
position_m = [1.0, 0.0, 0.0]
[body.imu]
interval_s = 0.01
position_m = [0.1, 0.2, 0.3]
mounting_deg = [1.0, 2.0, 3.0]
gyro_bias_degph = [10.0, -5.0, 1.0]
gyro_noise_deg_per_sqrt_h = 0.1
gyro_matrix = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]
gyro_range_degps = 500.0
accelerometer_bias_mps2 = [0.1, 0.0, -0.1]
accelerometer_noise_mps2_per_sqrt_hz = 0.001
accelerometer_matrix = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]
accelerometer_range_mps2 = 100.0
[body.motion]
"#;

const PLACE: &str =
    "[body.motion.place]\nlatitude_deg = 55.0\nlongitude_deg = 37.0\nheight_m = 150.0\n";

/// Kinds of motion with all of their keys, but for the place.
const MOTIONS: [(&str, bool); 6] = [
    ("kind = \"static\"\nheading_deg = 1.0\npitch_deg = 2.0\nroll_deg = 3.0\n", true),
    (
        "kind = \"car\"\nwaypoints_m = [[0, 0], [0, 90]]\nspeed_mps = 9.0\nwait_s = 1.0\n\
         acceleration_mps2 = 2.0\nturn_radius_m = 9.0\nlean_deg_per_mps2 = 0.6\n",
        true,
    ),
    (
        "kind = \"ship\"\nheading_deg = 1.0\nspeed_mps = 5.0\nperiod_s = 9.0\nroll_rms_deg = 5.0\n\
         pitch_rms_deg = 2.0\nyaw_rms_deg = 1.0\nheave_rms_m = 1.0\n",
        true,
    ),
    (
        "kind = \"uav\"\nradius_m = 30.0\nspeed_mps = 9.0\ntilt_deg = 30.0\nmax_rate_degps = 90.0\n",
        true,
    ),
    (
        "kind = \"orbit\"\naltitude_m = 5e5\ninclination_deg = 98.0\nnode_deg = 10.0\n\
         latitude_argument_deg = 1.0\nyaw_deg = 1.0\npitch_deg = 1.0\nroll_deg = 1.0\n",
        false,
    ),
    ("kind = \"recorded\"\nfile = \"way.csv\"\n", false),
];

/// Smallest and largest number of each key; a smallest number in the second list is itself refused.
const NUMBERS: &[(&str, f64, f64)] = &[
    ("sky.elevation_mask_deg", -90.0, 90.0),
    ("sky.horizon_deg", -90.0, 90.0),
    ("sky.orbit_error_sd_m", 0.0, 1e6),
    ("sky.clock_error_sd_m", 0.0, 1e6),
    ("clock.bias_sd_s", 0.0, 0.1),
    ("clock.drift_sd", 0.0, 1e-3),
    ("clock.wander", 0.0, 1e-3),
    ("noise.code_sd_m", 0.0, 1e3),
    ("noise.phase_sd_cycles", 0.0, 1e3),
    ("noise.doppler_sd_hz", 0.0, 1e4),
    ("noise.cn0_zenith_dbhz", 0.0, 99.0),
    ("array_sd_m", 0.0, 10.0),
    ("noise.gain_sd_db", 0.0, 99.0),
    ("noise.tracking_dbhz", 0.0, 99.0),
    ("multipath.common_share", 0.0, 1.0),
    ("wall.from_m", -1e6, 1e6),
    ("wall.to_m", -1e6, 1e6),
    ("wall.height_m", -1e4, 1e4),
    ("wall.reflection", 0.0, 1.0),
    ("canopy.sky_deg", -90.0, 90.0),
    ("canopy.loss_db", 0.0, 99.0),
    ("canopy.loss_sd_db", 0.0, 99.0),
    ("canopy.late_m_per_db", 0.0, 1.0),
    ("canopy.scattered_share", 0.0, 1.0),
    ("canopy.code_tails_per_hour", 0.0, 1e6),
    ("multipath.code_sd_m", 0.0, 1e3),
    ("multipath.phase_sd_m", 0.0, 1e3),
    ("atmosphere.ionosphere_zenith_m", 0.0, 1e3),
    ("atmosphere.troposphere_zenith_m", 0.0, 1e2),
    ("slips.per_hour", 0.0, 1e6),
    ("slips.flagged_share", 0.0, 1.0),
    ("station.place.latitude_deg", -90.0, 90.0),
    ("station.place.longitude_deg", -720.0, 720.0),
    ("station.place.height_m", -12_000.0, 1e7),
    ("outage.from_s", -1e9, 1.0),
    ("outage.to_s", 0.0, 1e9),
    ("interference.from_s", -1e9, 1.0),
    ("interference.to_s", 0.0, 1e9),
    ("interference.cn0_drop_db", 0.0, 99.0),
    ("bias.code_m", -1e6, 1e6),
    ("bias.phase_cycles", -1e6, 1e6),
    ("bias.code_m_per_channel", -1e5, 1e5),
    ("bias.phase_cycles_per_channel", -1e5, 1e5),
    ("body.antenna.position_m", -1e4, 1e4),
    ("body.antenna.tag_offset_s", -0.5, 0.5),
    ("body.antenna.turned_deg", -720.0, 720.0),
    ("body.antenna.mask_deg", -90.0, 90.0),
    ("body.imu.interval_s", 1e-4, 10.0),
    ("body.imu.position_m", -1e4, 1e4),
    ("body.imu.mounting_deg", -720.0, 720.0),
    ("body.imu.gyro_bias_degph", -1e9, 1e9),
    ("body.imu.gyro_noise_deg_per_sqrt_h", 0.0, 1e6),
    ("body.imu.gyro_matrix", -1e3, 1e3),
    ("body.imu.accelerometer_bias_mps2", -1e4, 1e4),
    ("body.imu.accelerometer_noise_mps2_per_sqrt_hz", 0.0, 1e4),
    ("body.imu.accelerometer_matrix", -1e3, 1e3),
    ("body.motion.place.latitude_deg", -90.0, 90.0),
    ("body.motion.place.longitude_deg", -720.0, 720.0),
    ("body.motion.place.height_m", -12_000.0, 1e7),
    ("body.motion.heading_deg", -720.0, 720.0),
    ("body.motion.pitch_deg", -90.0, 90.0),
    ("body.motion.roll_deg", -720.0, 720.0),
    ("body.motion.waypoints_m", -1e6, 1e6),
    ("body.motion.wait_s", 0.0, 1e9),
    ("body.motion.lean_deg_per_mps2", -90.0, 90.0),
    ("body.motion.roll_rms_deg", 0.0, 40.0),
    ("body.motion.pitch_rms_deg", 0.0, 20.0),
    ("body.motion.yaw_rms_deg", 0.0, 90.0),
    ("body.motion.heave_rms_m", 0.0, 1e3),
    ("body.motion.tilt_deg", 0.1, 89.0),
    ("body.motion.altitude_m", 1e5, 1e7),
    ("body.motion.inclination_deg", 0.0, 180.0),
    ("body.motion.node_deg", -720.0, 720.0),
    ("body.motion.latitude_argument_deg", -720.0, 720.0),
    ("body.motion.yaw_deg", -720.0, 720.0),
    ("interval_s", 1e-3, 1e5),
    ("duration_s", 1.0, 1e4),
];
const ABOVE_ZERO: &[(&str, f64)] = &[
    ("multipath.correlation_s", 1e9),
    ("canopy.loss_correlation_s", 1e9),
    ("canopy.scatter_correlation_s", 1e9),
    ("slip.time_s", 2.0),
    ("body.imu.gyro_range_degps", 1e6),
    ("body.imu.accelerometer_range_mps2", 1e6),
    ("body.motion.acceleration_mps2", 1e3),
    ("body.motion.turn_radius_m", 1e6),
    ("body.motion.period_s", 1e6),
    ("body.motion.radius_m", 1e6),
    ("body.motion.max_rate_degps", 1e4),
];
/// Numbers without fraction: smallest and largest.
const WHOLE: &[(&str, i64, i64)] = &[
    ("seed", 0, i64::MAX),
    ("sky.max_satellites", 1, i64::MAX),
    ("slip.cycles", -1_000_000, 1_000_000),
];
const SWITCHES: &[&str] = &[
    "clock.common",
    "clock.millisecond_jumps",
    "clock.phase_bias",
    "atmosphere.wind_up",
    "slip.flagged",
];
/// Speeds have other limits for each kind of motion.
const SPEEDS: [(&str, f64, f64); 3] = [("car", 0.0, 1e3), ("ship", -1e3, 1e3), ("uav", -1e3, 1e3)];

/// Words and lists that are well written and cannot be, with what the error says of them.
const WORDS: &[(&str, &str, &[&str])] = &[
    ("start", "\"yesterday\"", &["yesterday", "2024-03-10T12:00:00"]),
    ("start", "\"2024-13-10T12:00:00\"", &["2024-13-10", "expected"]),
    ("start", "\"2024-02-30T12:00:00\"", &["2024-02-30", "expected"]),
    ("start", "\"2024-03-10T24:00:00\"", &["T24", "expected"]),
    ("start", "\"2024-03-10T12:00:nan\"", &["nan", "expected"]),
    ("start", "\"1979-03-10T12:00:00\"", &["1979", "expected"]),
    ("signals", "[]", &["[]", "at least one"]),
    ("signals", "[\"G1\"]", &["G1", "a signal such as G1C"]),
    ("signals", "[\"G1C\", \"G1C\"]", &["G1C", "twice", "expected once"]),
    ("signals", "[\"J1C\"]", &["J1C", "expected a signal of a system in the sky"]),
    ("sky.systems", "[]", &["[]", "at least one"]),
    ("sky.systems", "[\"X\"]", &["X", "G, R, E, C, J"]),
    ("sky.systems", "[\"S\"]", &["S", "G, R, E, C, J"]),
    ("sky.systems", "[\"G\", \"R\", \"C\", \"G\"]", &["G", "twice"]),
    ("noise.law", "\"flatt\"", &["flatt", "did you mean `flat`?"]),
    ("station.name", "\"\"", &["\"\"", "A-Z a-z 0-9 - _"]),
    ("station.name", "\"A0\"", &["A0", "given once"]),
    ("station.name", "\"nav\"", &["nav", "navigation file"]),
    ("station.signals", "[]", &["[]", "at least one"]),
    ("station.signals", "[\"G\"]", &["\"G\"", "a signal such as G1C"]),
    ("station.signals", "[\"J1C\"]", &["J1C", "expected a signal of a system in the sky"]),
    ("station.signals", "[\"G1C\", \"G1C\"]", &["G1C", "twice"]),
    ("output.formats", "[]", &["[]", "at least one"]),
    ("output.formats", "[\"rinexx\"]", &["rinexx", "did you mean `rinex`?"]),
    ("output.formats", "[\"rinex\", \"rinex\"]", &["twice"]),
    ("outage.antennas", "[\"A9\"]", &["A9", "A0, A1, base"]),
    ("outage.satellites", "[\"G5x\"]", &["G5x", "a satellite such as G05"]),
    ("outage.satellites", "[\"J01\"]", &["J01", "a satellite of the sky"]),
    ("outage.bands", "[\"7\"]", &["\"7\"", "a band such as G1"]),
    ("outage.bands", "[\"G5\"]", &["G5", "a band that an antenna tracks"]),
    ("interference.bands", "[\"1\"]", &["\"1\"", "a band such as G1"]),
    ("interference.bands", "[\"E5\"]", &["E5", "a band that an antenna tracks"]),
    ("slip.antenna", "\"A9\"", &["A9", "A0, A1, base"]),
    ("slip.antenna", "\"\"", &["\"\"", "A0, A1, base"]),
    ("slip.satellite", "\"5\"", &["\"5\"", "a satellite such as G05"]),
    ("slip.satellite", "\"G77\"", &["G77", "a satellite of the sky"]),
    ("slip.band", "\"L1\"", &["L1", "a band such as G1"]),
    ("slip.band", "\"G5\"", &["G5", "a band that an antenna tracks"]),
    ("slip.band", "\"R1\"", &["R1", "a band that A1 tracks of G05"]),
    ("bias.antenna", "\"A9\"", &["A9", "A0, A1, base"]),
    ("bias.satellites", "[\"G5x\"]", &["G5x", "a satellite such as G05"]),
    ("bias.satellites", "[\"J01\"]", &["J01", "a satellite of the sky"]),
    ("canopy.antennas", "[\"A9\"]", &["A9", "A0, A1, base"]),
    ("bias.system", "\"GPS\"", &["GPS", "G, R, E, C, J"]),
    ("bias.system", "\"J\"", &["\"J\"", "a system of the sky"]),
    ("bias.signal", "\"C2\"", &["C2", "a signal such as G1C"]),
    ("bias.signal", "\"G5Q\"", &["G5Q", "a signal that an antenna tracks"]),
    ("bias.signal", "\"G1C\"", &["G1C", "a signal of bias.system C"]),
    ("bias.orbit", "\"low\"", &["low", "geo", "igso", "meo"]),
    ("body.name", "\"../car\"", &["../car", "A-Z a-z 0-9 - _"]),
    ("body.antenna.name", "\"a 1\"", &["a 1", "A-Z a-z 0-9 - _"]),
    ("body.antenna.name", "\"a1\"", &["A1", "given once"]),
    ("body.antenna.signals", "[\"J1C\"]", &["J1C", "expected a signal of a system in the sky"]),
    ("body.antenna.signals", "[\"G1C\", \"G1C\"]", &["twice"]),
    ("body.motion.kind", "\"boat\"", &["boat", "`car`, `ship`"]),
    ("body.motion.waypoints_m", "[[0, 0]]", &["1 given", "at least 2"]),
    ("body.motion.file", "\"none.csv\"", &["\"none.csv\" was not read"]),
];

fn texts() -> Vec<String> {
    let place = |has_place: bool| if has_place { PLACE } else { "" };
    MOTIONS.map(|(motion, has_place)| format!("{SCENARIO}{motion}{}", place(has_place))).to_vec()
}

/// Reads and prepares a scenario; the error as the user sees it.
fn refused(text: &str) -> Option<String> {
    match config_file::parse::<Scenario>(text, "s.toml") {
        Err(error) => Some(error.to_string()),
        Ok(scenario) => {
            let error = Simulation::new(scenario, &Attachments::default()).err()?;
            // Recorded motions are read by the caller.
            let error = error.to_string();
            (!error.ends_with("\"way.csv\" was not read")).then_some(error)
        }
    }
}

/// `text` with one line replaced.
fn with_line(text: &str, number: usize, line: &str) -> String {
    let lines = text.lines().enumerate();
    lines.map(|(k, old)| format!("{}\n", if k == number { line } else { old })).collect()
}

/// A line `key = value`.
struct Assignment<'a> {
    /// From 0.
    number: usize,
    key: &'a str,
    /// With the tables it is in.
    path: String,
    value: &'a str,
}

impl Assignment<'_> {
    /// `text` with another value here.
    fn set(&self, text: &str, value: &str) -> String {
        with_line(text, self.number, &format!("{} = {value}", self.key))
    }

    /// The value with each of its numbers in turn replaced.
    fn with_numbers(&self, number: &str) -> Vec<String> {
        let mut all = Vec::new();
        let mut from = 0;
        while let Some(start) = self.value[from..].find(|c: char| c.is_ascii_digit() || c == '-') {
            let start = from + start;
            let rest = &self.value[start..];
            let length = rest.find([',', ']']).unwrap_or(rest.len());
            from = start + length;
            all.push(format!("{}{number}{}", &self.value[..start], &self.value[from..]));
        }
        all
    }
}

fn assignments(text: &str) -> Vec<Assignment<'_>> {
    let (mut all, mut table) = (Vec::new(), String::new());
    for (number, line) in text.lines().enumerate() {
        if let Some((key, value)) = line.split_once(" = ") {
            let path = format!("{table}{key}");
            all.push(Assignment { number, key, path, value });
        } else if line.starts_with('[') {
            table = format!("{}.", line.trim_matches(['[', ']']));
        }
    }
    all
}

/// Every text with every line in it for which `chosen` holds.
fn for_each(mut test: impl FnMut(&str, &Assignment<'_>)) {
    for text in texts() {
        for assignment in assignments(&text) {
            test(&text, &assignment);
        }
    }
}

/// The error of a value, which names the key.
fn error_of(text: &str, assignment: &Assignment<'_>, value: &str) -> String {
    let path = &assignment.path;
    let error = refused(&assignment.set(text, value));
    let error = error.unwrap_or_else(|| panic!("{path} = {value} was taken"));
    // For a line that cannot be read, its number comes first and the bare key behind it.
    let line = format!("s.toml:{}: ", assignment.number + 1);
    let is_named = error.starts_with(&format!("{path}: "))
        || (error.starts_with(&line) && error.contains(assignment.key))
        || error.contains(assignment.key);
    assert!(is_named, "{path} = {value}: {error}");
    error
}

#[test]
fn every_key_is_known() {
    for text in texts() {
        assert_eq!(refused(&text), None);
    }
}

/// No key is without a test below, and each is in the reference.
#[test]
fn every_key_has_limits_or_words() {
    let reference = include_str!("../../../../docs/reference/simulate.md");
    for_each(|_, Assignment { path, key, .. }| {
        let is_tested = NUMBERS.iter().any(|(known, ..)| known == path)
            || ABOVE_ZERO.iter().any(|(known, _)| known == path)
            || WHOLE.iter().any(|(known, ..)| known == path)
            || WORDS.iter().any(|(known, ..)| known == path)
            || SWITCHES.contains(&path.as_str())
            || path == "body.motion.speed_mps";
        assert!(is_tested, "{path}");
        assert!(reference.contains(key), "{path} is not in docs/reference/simulate.md");
    });
}

#[test]
fn a_misspelt_key_is_refused_with_its_line_and_the_nearest() {
    for_each(|text, Assignment { number, key, value, .. }| {
        let wrong = format!("{key}q");
        let error = refused(&with_line(text, *number, &format!("{wrong} = {value}"))).unwrap();
        let wanted = format!("s.toml:{}: unknown key `{wrong}`, did you mean `{key}`?", number + 1);
        assert_eq!(error, wanted);
    });
}

#[test]
fn a_wrong_type_is_refused_with_its_line_and_key() {
    for_each(|text, assignment| {
        for value in ["[{}]", "{ a = 1 }", "2024-03-10"] {
            let error = refused(&assignment.set(text, value)).unwrap();
            let place = format!("s.toml:{}: ", assignment.number + 1);
            let key = format!("`{}`", assignment.key);
            assert!(error.starts_with(&place) && error.contains(&key), "{value}: {error}");
            // For an enumeration serde says what it "wanted".
            let says_more = error.contains("expected") || error.contains("wanted");
            assert!(says_more, "{value}: {error}");
        }
    });
}

/// A number at its limits is taken; one beyond them, and NaN, is refused.
#[test]
fn numbers_have_limits() {
    for_each(|text, assignment| {
        let Assignment { path, .. } = assignment;
        let kind = text.split_once("kind = \"").unwrap().1.split('"').next().unwrap();
        let speed = SPEEDS.iter().find(|(of, ..)| path.ends_with("speed_mps") && *of == kind);
        let limits = NUMBERS.iter().find(|(known, ..)| known == path).or(speed);
        let above = ABOVE_ZERO.iter().find(|(known, _)| known == path);
        let (low, high) = match (limits, above) {
            (Some((_, low, high)), _) => (*low, *high),
            (None, Some((_, high))) => (0.0, *high),
            (None, None) => return,
        };
        let zero_is_refused = above.is_some() || speed.is_some_and(|(kind, ..)| *kind == "car");
        let little = (high - low) * 1e-3;
        let mut taken = vec![high];
        let mut wrong =
            vec![low - little, f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e300, -1e300];
        (if zero_is_refused { &mut wrong } else { &mut taken }).push(low);
        // Of a begin after its end the end is refused; the highest duration only takes long.
        if path != "duration_s" && !path.ends_with("from_s") {
            wrong.push(high + little);
        }
        // The last elements of obstacles are elevations, the others go further round.
        let is_mixed =
            ["sky.horizon_deg", "canopy.sky_deg", "body.antenna.mask_deg"].contains(&path.as_str());
        for number in taken {
            for value in assignment.with_numbers(&format!("{number:?}")) {
                let error = refused(&assignment.set(text, &value));
                assert_eq!(error, None, "{path} = {value}");
            }
        }
        for number in wrong {
            let all = assignment.with_numbers(&format!("{number:?}").replace("NaN", "nan"));
            for value in &all[if is_mixed { all.len() - 1 } else { 0 }..] {
                let error = error_of(text, assignment, value);
                assert!(error.contains(&number.to_string()), "{path} = {value}: {error}");
                assert!(error.contains("expected"), "{path} = {value}: {error}");
            }
        }
    });
}

#[test]
fn whole_numbers_have_limits() {
    for_each(|text, assignment| {
        let limits = WHOLE.iter().find(|(known, ..)| *known == assignment.path);
        let Some((path, low, high)) = limits else { return };
        for number in [*low, *high] {
            let error = refused(&assignment.set(text, &number.to_string()));
            assert_eq!(error, None, "{path} = {number}");
        }
        let beyond = [low.checked_sub(1), high.checked_add(1)].into_iter().flatten();
        let beyond = beyond.map(|number| number.to_string());
        for value in beyond.chain(["1.5", "nan", "inf", "true"].map(str::to_owned)) {
            let error = error_of(text, assignment, &value);
            assert!(error.contains("expected"), "{path} = {value}: {error}");
        }
    });
}

#[test]
fn words_that_cannot_be_are_refused_with_key_found_and_expected() {
    let mut tried = vec![false; WORDS.len()];
    for_each(|text, assignment| {
        for (k, (path, value, named)) in WORDS.iter().enumerate() {
            let of_motion = path.ends_with("waypoints_m") || path.ends_with("file");
            // The first antenna stands for all.
            let is_second = assignment.value == "\"A1\"" && assignment.key == "name";
            if *path != assignment.path || is_second || (tried[k] && !of_motion) {
                continue;
            }
            tried[k] = true;
            let error = error_of(text, assignment, value);
            for word in *named {
                assert!(error.contains(word), "{path} = {value}: {error}");
            }
        }
    });
    assert!(tried.iter().all(|tried| *tried), "{tried:?}");
}

/// What is possible by itself and not beside the rest.
#[test]
fn keys_that_contradict_each_other_are_refused() {
    let text = &texts()[0];
    for (found, instead, named) in [
        // Two bodies of one name would write the same files.
        (
            "[[body]]\nname = \"car\"",
            "[[body]]\nname = \"car\"\nmotion = { kind = \"orbit\", altitude_m = 5e5, \
             inclination_deg = 1.0, node_deg = 0.0 }\nantenna = [{ name = \"B0\", position_m = [0, 0, 0] }]\n\
             [[body]]\nname = \"car\"",
            &["body.name", "car", "given once"][..],
        ),
        ("orbit = \"meo\"", "orbit = \"geo\"\nsystem = \"G\"", &["duplicate", "system"]),
        (
            "system = \"C\"\nsignal = \"C2I\"",
            "system = \"G\"\nsignal = \"G1C\"",
            &["bias.orbit", "Meo", "none with another system than C"],
        ),
        (
            "code_m_per_channel = 0.1\n",
            "system = \"G\"\ncode_m_per_channel = 0.1\n",
            &["bias.code_m_per_channel", "0.1", "0 with another system than R"],
        ),
        (
            "phase_cycles_per_channel = 0.1\n",
            "signal = \"G1C\"\nphase_cycles_per_channel = 0.1\n",
            &["bias.code_m_per_channel", "0.1", "0 with another system than R"],
        ),
        (
            "max_satellites = 20",
            "navigation = \"brdc.rnx\"",
            &["sky.systems", "sky.navigation", "one of the two"],
        ),
        ("antenna = \"A1\"", "antenna = \"A0\"", &["slip.band", "G1", "that A0 tracks of G05"]),
        (
            "satellites = [\"C19\"]",
            "satellites = [\"C19\"]\nsignal = \"G1C\"",
            &["bias.satellites", "C19", "same system"],
        ),
        (
            "to_m = [5.0, 4.0]",
            "to_m = [-5.0, 4.0]",
            &["wall.to_m", "[-5.0, 4.0]", "another place than wall.from_m"],
        ),
        ("to_s = 1.0", "to_s = -0.5", &["outage.to_s", "-0.5", "from 0 to"]),
        (
            "tag_offset_s = 0.0004",
            "tag_offset_s = 0.6",
            &["body.antenna.tag_offset_s", "0.6", "0.5"],
        ),
        ("duration_s = 2.0", "duration_s = 0.5", &["slip.time_s", "1", "at most 0.5"]),
        (
            "duration_s = 2.0\ninterval_s = 1.0",
            "duration_s = 1e9\ninterval_s = 0.001",
            &["duration_s", "1000000000", "epochs", "expected 1 to"],
        ),
        ("duration_s = 2.0", "duration_s = -5", &["duration_s: -5, expected at least 0"]),
    ] {
        assert!(text.contains(found), "{found}");
        let error = refused(&text.replacen(found, instead, 1));
        let error = error.unwrap_or_else(|| panic!("{instead} was taken"));
        for word in named {
            assert!(error.contains(word), "{instead}: {error}");
        }
    }
}

#[test]
fn a_key_of_another_motion_and_a_missing_one_are_refused() {
    for (text, (motion, _)) in texts().iter().zip(MOTIONS) {
        let foreign = if motion.contains("ship") { "file = \"a\"" } else { "period_s = 9.0" };
        let error = refused(&text.replacen("kind = ", &format!("{foreign}\nkind = "), 1)).unwrap();
        let key = foreign.split(' ').next().unwrap();
        assert!(error.contains(&format!("key `{key}` does not belong to motion kind")), "{error}");
        // Whatever has no default is asked for, with the kind.
        let needed = motion.lines().nth(1).unwrap();
        let error = refused(&text.replacen(&format!("{needed}\n"), "", 1)).unwrap();
        let key = needed.split(' ').next().unwrap();
        assert!(error.contains(&format!("missing field `{key}` of motion kind")), "{error}");
    }
    for needed in [
        "start = \"2024-03-10T12:00:00\"\n",
        "duration_s = 2.0\n",
        "position_m = [1.0, 0.0, 0.0]\n",
    ] {
        let error = refused(&texts()[0].replacen(needed, "", 1)).unwrap();
        let key = needed.split(' ').next().unwrap();
        assert!(error.contains(&format!("missing field `{key}`")), "{error}");
    }
}
