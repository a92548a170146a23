//! Every key of a scenario file, misspelt, of a wrong type, and with values that cannot be.
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
signals = ["G1C", "G2W"]
[sky]
systems = ["G", "E"]
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
[multipath]
code_sd_m = 0.5
phase_sd_m = 0.001
correlation_s = 30.0
[atmosphere]
ionosphere_zenith_m = 3.0
troposphere_zenith_m = 2.4
wind_up = true
[slips]
per_hour = 1.0
flagged_share = 0.5
[station]
name = "base"
place = { latitude_deg = 55.0, longitude_deg = 37.0, height_m = 150.0 }
signals = ["G1C"]
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
antenna = "A0"
satellite = "G05"
band = "G1"
cycles = 1
flagged = true
[[bias]]
antenna = "A0"
system = "G"
signal = "G1C"
orbit = "meo"
code_m = 1.0
phase_cycles = 0.25
code_m_per_channel = 0.1
phase_cycles_per_channel = 0.1
[[body]]
name = "car"
[[body.antenna]]
name = "A0"
position_m = [0.0, 0.0, 0.0]
signals = ["G1C"]
tag_offset_s = 0.1
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

const PLACE: &str = "place = { latitude_deg = 55.0, longitude_deg = 37.0, height_m = 150.0 }\n";

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

fn texts() -> Vec<String> {
    let place = |has_place: bool| if has_place { PLACE } else { "" };
    MOTIONS.map(|(motion, has_place)| format!("{SCENARIO}{motion}{}", place(has_place))).to_vec()
}

/// Reads and prepares a scenario; the error as the user sees it.
fn refused(text: &str) -> Option<String> {
    match config_file::parse::<Scenario>(text, "s.toml") {
        Err(error) => Some(error.to_string()),
        Ok(scenario) => {
            Simulation::new(scenario, &Attachments::default()).err().map(|e| e.to_string())
        }
    }
}

/// `text` with one line replaced.
fn with_line(text: &str, number: usize, line: &str) -> String {
    let lines = text.lines().enumerate();
    lines.map(|(k, old)| format!("{}\n", if k == number { line } else { old })).collect()
}

/// Number, key and value of every line that has them.
fn assignments(text: &str) -> Vec<(usize, &str, &str)> {
    let lines = text.lines().enumerate();
    lines
        .filter_map(|(k, line)| line.split_once(" = ").map(|(key, value)| (k, key, value)))
        .collect()
}

#[test]
fn every_key_is_known() {
    for text in texts() {
        let error = refused(&text);
        let of_file = error.as_ref().is_some_and(|e| e.contains("way.csv was not read"));
        assert!(error.is_none() || of_file, "{error:?}");
    }
}

#[test]
fn a_misspelt_key_is_refused_with_its_line_and_the_nearest() {
    for text in texts() {
        for (number, key, value) in assignments(&text) {
            let wrong = format!("{key}q");
            let error = refused(&with_line(&text, number, &format!("{wrong} = {value}"))).unwrap();
            let wanted =
                format!("s.toml:{}: unknown key `{wrong}`, did you mean `{key}`?", number + 1);
            assert_eq!(error, wanted);
        }
    }
}

#[test]
fn a_wrong_type_is_refused_with_its_line_and_key() {
    for text in texts() {
        for (number, key, _) in assignments(&text) {
            let error = refused(&with_line(&text, number, &format!("{key} = [{{}}]"))).unwrap();
            let place = format!("s.toml:{}: ", number + 1);
            assert!(error.starts_with(&place) && error.contains(&format!("`{key}`")), "{error}");
        }
    }
}

/// Whole lines that are well written and cannot be, with what the error names.
#[test]
fn values_that_cannot_be_are_refused_with_key_found_and_expected() {
    let car = &texts()[1];
    for (key, value, named) in [
        ("start", "\"yesterday\"", &["start", "yesterday", "2024-03-10T12:00:00"][..]),
        ("start", "\"2024-13-10T12:00:00\"", &["start", "2024-13-10"]),
        ("duration_s", "-2.0", &["duration_s", "-2"]),
        ("interval_s", "0.0", &["interval_s", "0 must be above 0"]),
        ("interval_s", "nan", &["interval_s", "NaN"]),
        ("signals", "[]", &["signals", "at least one"]),
        ("signals", "[\"G1\"]", &["signals", "G1"]),
        ("systems", "[\"X\"]", &["sky.systems", "X", "G, R, E, C, J"]),
        ("systems", "[\"S\"]", &["sky.systems", "S", "G, R, E, C, J"]),
        ("max_satellites", "0", &["sky.max_satellites", "0", "at least 1"]),
        ("elevation_mask_deg", "95.0", &["sky.elevation_mask_deg", "95", "from -90 to 90"]),
        ("horizon_deg", "[[0, 90, inf]]", &["sky.horizon_deg", "inf"]),
        ("orbit_error_sd_m", "-1.0", &["sky.orbit_error_sd_m", "-1", "at least 0"]),
        ("clock_error_sd_m", "-1.0", &["sky.clock_error_sd_m", "-1", "at least 0"]),
        ("bias_sd_s", "-1.0", &["clock.bias_sd_s", "-1"]),
        ("drift_sd", "-1.0", &["clock.drift_sd", "-1"]),
        ("wander", "-1.0", &["clock.wander", "-1"]),
        ("law", "\"flatt\"", &["flatt", "law", "did you mean `flat`?"]),
        ("code_sd_m", "-0.3", &["noise.code_sd_m", "-0.3", "at least 0"]),
        ("phase_sd_cycles", "nan", &["noise.phase_sd_cycles", "NaN"]),
        ("doppler_sd_hz", "-1.0", &["noise.doppler_sd_hz", "-1"]),
        ("cn0_zenith_dbhz", "200.0", &["noise.cn0_zenith_dbhz", "200", "from 0 to 99"]),
        ("phase_sd_m", "-1.0", &["multipath.phase_sd_m", "-1"]),
        ("correlation_s", "0.0", &["multipath.correlation_s", "0", "above 0"]),
        ("ionosphere_zenith_m", "-1.0", &["atmosphere.ionosphere_zenith_m", "-1"]),
        ("troposphere_zenith_m", "-1.0", &["atmosphere.troposphere_zenith_m", "-1"]),
        ("per_hour", "-1.0", &["slips.per_hour", "-1"]),
        ("flagged_share", "1.5", &["slips.flagged_share", "1.5", "from 0 to 1"]),
        ("formats", "[]", &["output.formats", "at least one"]),
        ("formats", "[\"rinexx\"]", &["rinexx", "formats", "did you mean `rinex`?"]),
        ("to_s", "-1.0", &["outage.to_s", "-1", "from 0"]),
        ("antennas", "[\"A9\"]", &["outage.antennas", "A9", "A0, A1"]),
        ("satellites", "[\"G5x\"]", &["outage.satellites", "G5x"]),
        ("bands", "[\"7\"]", &["outage.bands", "7"]),
        ("cn0_drop_db", "-6.0", &["interference.cn0_drop_db", "-6"]),
        ("time_s", "inf", &["slip.time_s", "inf"]),
        ("antenna", "\"A9\"", &["slip.antenna", "A9", "A0, A1"]),
        ("satellite", "\"5\"", &["slip.satellite", "5"]),
        ("band", "\"L1\"", &["slip.band", "L1"]),
        ("cycles", "1.5", &["floating point", "cycles"]),
        ("system", "\"GPS\"", &["bias.system", "GPS"]),
        ("orbit", "\"low\"", &["low", "geo", "igso", "meo"]),
        ("code_m", "nan", &["bias.code_m", "NaN"]),
        ("phase_cycles", "inf", &["bias.phase_cycles", "inf"]),
        ("position_m", "[1e9, 0.0, 0.0]", &["body.antenna.position_m", "1000000000"]),
        ("tag_offset_s", "0.7", &["body.antenna.tag_offset_s", "0.7", "from -0.5 to 0.5"]),
        ("turned_deg", "inf", &["body.antenna.turned_deg", "inf"]),
        ("mask_deg", "[[0, 90, 100]]", &["body.antenna.mask_deg", "100"]),
        ("mounting_deg", "[0, 900, 0]", &["body.imu.mounting_deg", "900", "from -720 to 720"]),
        ("gyro_range_degps", "0.0", &["body.imu.gyro_range_degps", "0", "above 0"]),
        ("gyro_noise_deg_per_sqrt_h", "-1.0", &["body.imu.gyro_noise_deg_per_sqrt_h", "-1"]),
        ("accelerometer_matrix", "[[1, 0, 0], [0, nan, 0], [0, 0, 1]]", &["accelerometer_matrix"]),
        ("kind", "\"boat\"", &["boat", "kind", "`ship`"]),
        ("waypoints_m", "[[0, 0]]", &["waypoints_m", "1 given"]),
        ("speed_mps", "0.0", &["body.motion.speed_mps", "0", "above 0"]),
        ("wait_s", "-1.0", &["body.motion.wait_s", "-1"]),
        ("acceleration_mps2", "0.0", &["body.motion.acceleration_mps2", "above 0"]),
        ("turn_radius_m", "-9.0", &["body.motion.turn_radius_m", "-9"]),
        ("lean_deg_per_mps2", "inf", &["body.motion.lean_deg_per_mps2", "inf"]),
        (
            "place",
            "{ latitude_deg = 95.0, longitude_deg = 37.0, height_m = 150.0 }",
            &["station.place.latitude_deg", "95"],
        ),
    ] {
        let first = assignments(car).into_iter().find(|(_, found, _)| *found == key);
        let number = first.unwrap_or_else(|| panic!("{key}")).0;
        let error = refused(&with_line(car, number, &format!("{key} = {value}")));
        let error = error.unwrap_or_else(|| panic!("{key} = {value} was taken"));
        for word in named {
            assert!(error.contains(word), "{key} = {value}: {error}");
        }
    }
}

#[test]
fn a_key_of_another_motion_and_a_missing_one_are_refused() {
    let texts = texts();
    let error = refused(&format!("{}period_s = 9.0\n", texts[0])).unwrap();
    assert!(error.contains("key `period_s` does not belong to motion kind `static`"), "{error}");
    let error = refused(&texts[1].replace("speed_mps = 9.0\n", "")).unwrap();
    assert!(error.contains("missing field `speed_mps` of motion kind `car`"), "{error}");
}
