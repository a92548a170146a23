//! Whether the numbers of a scenario can be.

use core::fmt;

use crate::motion::RecordedPose;
use crate::scenario::{Antenna, Canopy, Imu, MotionPlan, Place, Scenario, Sky, Wall};
use crate::scenario_error::ScenarioError;

/// Letters of the systems that have built-in orbits.
const BUILT_IN_SYSTEMS: [&str; 5] = ["G", "R", "E", "C", "J"];
/// The navigation file has this name.
const NAVIGATION_NAME: &str = "nav";
/// Times beyond are in no scenario.
const MAX_S: f64 = 1e9;
/// Turns further round than this say nothing new.
const MAX_DEG: f64 = 720.0;

/// What a number may be: values beyond would be none of a receiver, or break the columns of RINEX.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Allowed {
    Within(f64, f64),
    /// Above zero, and at most this.
    AboveZero(f64),
}

const ANGLE: Allowed = within(MAX_DEG);
const ELEVATION: Allowed = within(90.0);
const HEIGHT: Allowed = Allowed::Within(-12_000.0, 1e7);

/// On either side of zero.
const fn within(most: f64) -> Allowed {
    Allowed::Within(-most, most)
}

/// From zero.
const fn up_to(most: f64) -> Allowed {
    Allowed::Within(0.0, most)
}

impl Allowed {
    fn holds(self, value: f64) -> bool {
        match self {
            Self::Within(low, high) => (low..=high).contains(&value),
            Self::AboveZero(high) => value > 0.0 && value <= high,
        }
    }
}

impl fmt::Display for Allowed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Within(low, high) => write!(f, "from {low} to {high}"),
            Self::AboveZero(high) => write!(f, "above 0, at most {high}"),
        }
    }
}

/// Refuses a scenario with a number that cannot be, or a list that must not be empty.
///
/// # Errors
///
/// [`ScenarioError`] with the key, what was found, and what was expected.
pub(crate) fn check(scenario: &Scenario) -> Result<(), ScenarioError> {
    let mut numbers = of_surroundings(scenario);
    for body in &scenario.body {
        of_motion(&body.motion, &mut numbers);
        for antenna in &body.antenna {
            of_antenna(antenna, scenario.interval_s, &mut numbers);
        }
        if let Some(imu) = &body.imu {
            of_imu(imu, &mut numbers);
        }
    }
    if let Some(station) = &scenario.station {
        of_place("station.place", &station.place, &mut numbers);
    }
    of_disturbances(scenario, &mut numbers);
    check_numbers(&numbers)?;
    check_names(scenario)?;
    check_lists(scenario)
}

/// Refuses a row of a recorded motion with a number that cannot be.
pub(crate) fn check_pose(pose: &RecordedPose) -> Result<(), ScenarioError> {
    let [heading, pitch, roll] = pose.angles_deg;
    let Place { latitude_deg, longitude_deg, height_m } = pose.place;
    let numbers = [
        ("time_s", pose.time_s, within(MAX_S)),
        ("latitude_deg", latitude_deg, ELEVATION),
        ("longitude_deg", longitude_deg, ANGLE),
        ("height_m", height_m, HEIGHT),
        ("heading_deg", heading, ANGLE),
        ("pitch_deg", pitch, ELEVATION),
        ("roll_deg", roll, ANGLE),
    ];
    check_numbers(&numbers.map(|(key, value, allowed)| (key.to_owned(), value, allowed)))
}

fn check_numbers(numbers: &[(String, f64, Allowed)]) -> Result<(), ScenarioError> {
    match numbers.iter().find(|(_, value, allowed)| !allowed.holds(*value)) {
        Some((key, value, allowed)) => {
            Err(ScenarioError::new(key, format!("{value}, expected {allowed}")))
        }
        None => Ok(()),
    }
}

type Numbers = Vec<(String, f64, Allowed)>;

fn of_surroundings(scenario: &Scenario) -> Numbers {
    let Scenario { noise, multipath, atmosphere, clock, sky, slips, .. } = scenario;
    let numbers = [
        ("array_sd_m", scenario.array_sd_m, up_to(10.0)),
        ("noise.code_sd_m", noise.code_sd_m, up_to(1e3)),
        ("noise.phase_sd_cycles", noise.phase_sd_cycles, up_to(1e3)),
        ("noise.doppler_sd_hz", noise.doppler_sd_hz, up_to(1e4)),
        ("noise.cn0_zenith_dbhz", noise.cn0_zenith_dbhz, up_to(99.0)),
        ("noise.gain_sd_db", noise.gain_sd_db, up_to(99.0)),
        ("noise.tracking_dbhz", noise.tracking_dbhz, up_to(99.0)),
        ("multipath.code_sd_m", multipath.code_sd_m, up_to(1e3)),
        ("multipath.phase_sd_m", multipath.phase_sd_m, up_to(1e3)),
        ("multipath.correlation_s", multipath.correlation_s, Allowed::AboveZero(1e9)),
        ("multipath.common_share", multipath.common_share, up_to(1.0)),
        ("atmosphere.ionosphere_zenith_m", atmosphere.ionosphere_zenith_m, up_to(1e3)),
        ("atmosphere.troposphere_zenith_m", atmosphere.troposphere_zenith_m, up_to(1e2)),
        ("clock.bias_sd_s", clock.bias_sd_s, up_to(0.1)),
        ("clock.drift_sd", clock.drift_sd, up_to(1e-3)),
        ("clock.wander", clock.wander, up_to(1e-3)),
        ("sky.elevation_mask_deg", sky.elevation_mask_deg, ELEVATION),
        ("sky.orbit_error_sd_m", sky.orbit_error_sd_m, up_to(1e6)),
        ("sky.clock_error_sd_m", sky.clock_error_sd_m, up_to(1e6)),
        ("slips.per_hour", slips.per_hour, up_to(1e6)),
        ("slips.flagged_share", slips.flagged_share, up_to(1.0)),
    ];
    let mut numbers =
        numbers.map(|(key, value, allowed)| (key.to_owned(), value, allowed)).to_vec();
    of_obstacles("sky.horizon_deg", &sky.horizon_deg, &mut numbers);
    scenario.wall.iter().for_each(|wall| of_wall(wall, &mut numbers));
    scenario.canopy.iter().for_each(|canopy| of_canopy(canopy, &mut numbers));
    numbers
}

fn of_wall(wall: &Wall, numbers: &mut Numbers) {
    let mut add = |key: &str, value: f64, allowed: Allowed| {
        numbers.push((format!("wall.{key}"), value, allowed));
    };
    wall.from_m.iter().for_each(|value| add("from_m", *value, within(1e6)));
    wall.to_m.iter().for_each(|value| add("to_m", *value, within(1e6)));
    add("height_m", wall.height_m, within(1e4));
    add("reflection", wall.reflection, up_to(1.0));
}

fn of_canopy(canopy: &Canopy, numbers: &mut Numbers) {
    of_obstacles("canopy.sky_deg", &canopy.sky_deg, numbers);
    for (key, value, allowed) in [
        ("loss_db", canopy.loss_db, up_to(99.0)),
        ("loss_sd_db", canopy.loss_sd_db, up_to(99.0)),
        ("loss_correlation_s", canopy.loss_correlation_s, Allowed::AboveZero(1e9)),
        ("late_m_per_db", canopy.late_m_per_db, up_to(1.0)),
        ("scattered_share", canopy.scattered_share, up_to(1.0)),
        ("scatter_correlation_s", canopy.scatter_correlation_s, Allowed::AboveZero(1e9)),
        ("code_tails_per_hour", canopy.code_tails_per_hour, up_to(1e6)),
    ] {
        numbers.push((format!("canopy.{key}"), value, allowed));
    }
}

fn of_obstacles(key: &str, obstacles_deg: &[[f64; 3]], numbers: &mut Numbers) {
    for [from, to, elevation] in obstacles_deg {
        for (value, allowed) in [(*from, ANGLE), (*to, ANGLE), (*elevation, ELEVATION)] {
            numbers.push((key.to_owned(), value, allowed));
        }
    }
}

fn of_place(key: &str, place: &Place, numbers: &mut Numbers) {
    for (part, value, allowed) in [
        ("latitude_deg", place.latitude_deg, ELEVATION),
        ("longitude_deg", place.longitude_deg, ANGLE),
        ("height_m", place.height_m, HEIGHT),
    ] {
        numbers.push((format!("{key}.{part}"), value, allowed));
    }
}

fn of_imu(imu: &Imu, numbers: &mut Numbers) {
    let mut add = |key: &str, values: &[f64], allowed: Allowed| {
        numbers.extend(values.iter().map(|value| (format!("body.imu.{key}"), *value, allowed)));
    };
    add("interval_s", &[imu.interval_s], Allowed::Within(1e-4, 10.0));
    add("position_m", &imu.position_m, within(1e4));
    add("mounting_deg", &imu.mounting_deg, ANGLE);
    add("gyro_bias_degph", &imu.gyro_bias_degph, within(1e9));
    add("gyro_noise_deg_per_sqrt_h", &[imu.gyro_noise_deg_per_sqrt_h], up_to(1e6));
    add("gyro_matrix", imu.gyro_matrix.as_flattened(), within(1e3));
    add("gyro_range_degps", &[imu.gyro_range_degps], Allowed::AboveZero(1e6));
    add("accelerometer_bias_mps2", &imu.accelerometer_bias_mps2, within(1e4));
    let noise = imu.accelerometer_noise_mps2_per_sqrt_hz;
    add("accelerometer_noise_mps2_per_sqrt_hz", &[noise], up_to(1e4));
    add("accelerometer_matrix", imu.accelerometer_matrix.as_flattened(), within(1e3));
    add("accelerometer_range_mps2", &[imu.accelerometer_range_mps2], Allowed::AboveZero(1e6));
}

fn of_antenna(antenna: &Antenna, interval_s: f64, numbers: &mut Numbers) {
    let half_s = interval_s / 2.0;
    for value in antenna.position_m {
        numbers.push(("body.antenna.position_m".to_owned(), value, within(1e4)));
    }
    let offset = within(half_s);
    numbers.push(("body.antenna.tag_offset_s".to_owned(), antenna.tag_offset_s, offset));
    numbers.push(("body.antenna.turned_deg".to_owned(), antenna.turned_deg, ANGLE));
    of_obstacles("body.antenna.mask_deg", &antenna.mask_deg, numbers);
}

fn of_motion(motion: &MotionPlan, numbers: &mut Numbers) {
    let mut add = |key: &str, value: f64, allowed: Allowed| {
        numbers.push((format!("body.motion.{key}"), value, allowed));
    };
    let (place, key) = match motion {
        MotionPlan::Static { place, heading_deg, pitch_deg, roll_deg } => {
            add("heading_deg", *heading_deg, ANGLE);
            add("pitch_deg", *pitch_deg, ELEVATION);
            add("roll_deg", *roll_deg, ANGLE);
            (place, "body.motion.place")
        }
        MotionPlan::Car {
            place,
            waypoints_m,
            speed_mps,
            wait_s,
            acceleration_mps2,
            turn_radius_m,
            lean_deg_per_mps2,
        } => {
            let coordinates = waypoints_m.iter().flatten();
            coordinates.for_each(|c| add("waypoints_m", *c, within(1e6)));
            add("speed_mps", *speed_mps, Allowed::AboveZero(1e3));
            add("wait_s", *wait_s, up_to(1e9));
            add("acceleration_mps2", *acceleration_mps2, Allowed::AboveZero(1e3));
            add("turn_radius_m", *turn_radius_m, Allowed::AboveZero(1e6));
            add("lean_deg_per_mps2", *lean_deg_per_mps2, within(90.0));
            (place, "body.motion.place")
        }
        MotionPlan::Ship {
            place,
            heading_deg,
            speed_mps,
            period_s,
            roll_rms_deg,
            pitch_rms_deg,
            yaw_rms_deg,
            heave_rms_m,
        } => {
            add("heading_deg", *heading_deg, ANGLE);
            add("speed_mps", *speed_mps, within(1e3));
            add("period_s", *period_s, Allowed::AboveZero(1e6));
            add("roll_rms_deg", *roll_rms_deg, up_to(40.0));
            add("pitch_rms_deg", *pitch_rms_deg, up_to(20.0));
            add("yaw_rms_deg", *yaw_rms_deg, up_to(90.0));
            add("heave_rms_m", *heave_rms_m, up_to(1e3));
            (place, "body.motion.place")
        }
        MotionPlan::Uav { place, radius_m, speed_mps, tilt_deg, max_rate_degps } => {
            add("radius_m", *radius_m, Allowed::AboveZero(1e6));
            add("speed_mps", *speed_mps, within(1e3));
            add("tilt_deg", *tilt_deg, Allowed::Within(0.1, 89.0));
            add("max_rate_degps", *max_rate_degps, Allowed::AboveZero(1e4));
            (place, "body.motion.place")
        }
        MotionPlan::Orbit {
            altitude_m,
            inclination_deg,
            node_deg,
            latitude_argument_deg,
            yaw_deg,
            pitch_deg,
            roll_deg,
        } => {
            add("altitude_m", *altitude_m, Allowed::Within(1e5, 1e7));
            add("inclination_deg", *inclination_deg, up_to(180.0));
            for (key, value) in [
                ("node_deg", node_deg),
                ("latitude_argument_deg", latitude_argument_deg),
                ("yaw_deg", yaw_deg),
                ("roll_deg", roll_deg),
            ] {
                add(key, *value, ANGLE);
            }
            add("pitch_deg", *pitch_deg, ELEVATION);
            return;
        }
        MotionPlan::Recorded { .. } => return,
    };
    of_place(key, place, numbers);
}

fn of_disturbances(scenario: &Scenario, numbers: &mut Numbers) {
    let mut add = |key: &str, value: f64, allowed: Allowed| {
        numbers.push((key.to_owned(), value, allowed));
    };
    let last_s = scenario.duration_s;
    let end = |from_s: f64| Allowed::Within(from_s, MAX_S);
    for outage in &scenario.outage {
        add("outage.from_s", outage.from_s, within(MAX_S));
        add("outage.to_s", outage.to_s, end(outage.from_s));
    }
    for interference in &scenario.interference {
        add("interference.from_s", interference.from_s, within(MAX_S));
        add("interference.to_s", interference.to_s, end(interference.from_s));
        add("interference.cn0_drop_db", interference.cn0_drop_db, up_to(99.0));
    }
    for slip in &scenario.slip {
        // At the first epoch there is no phase yet that could slip.
        add("slip.time_s", slip.time_s, Allowed::AboveZero(last_s));
        add("slip.cycles", f64::from(slip.cycles), within(1e6));
    }
    for bias in &scenario.bias {
        add("bias.code_m", bias.code_m, within(1e6));
        add("bias.phase_cycles", bias.phase_cycles, within(1e6));
        add("bias.code_m_per_channel", bias.code_m_per_channel, within(1e5));
        add("bias.phase_cycles_per_channel", bias.phase_cycles_per_channel, within(1e5));
    }
}

fn check_lists(scenario: &Scenario) -> Result<(), ScenarioError> {
    let sky = &scenario.sky;
    if sky.max_satellites == Some(0) {
        return Err(ScenarioError::new("sky.max_satellites", "0, expected at least 1"));
    }
    if sky.navigation.is_some() && sky.systems != Sky::default().systems {
        let problem = "given beside sky.navigation, expected one of the two: of a file all systems \
                       are used whose signals are tracked";
        return Err(ScenarioError::new("sky.systems", problem));
    }
    if let Some(name) = sky.systems.iter().find(|s| !BUILT_IN_SYSTEMS.contains(&s.as_str())) {
        let known = BUILT_IN_SYSTEMS.join(", ");
        return Err(ScenarioError::new(
            "sky.systems",
            format!("{name:?}, expected some of {known}"),
        ));
    }
    if let Some(wall) = scenario.wall.iter().find(|wall| wall.from_m == wall.to_m) {
        let problem = format!("{:?}, expected another place than wall.from_m", wall.to_m);
        return Err(ScenarioError::new("wall.to_m", problem));
    }
    distinct("sky.systems", &sky.systems)?;
    distinct("signals", &scenario.signals)?;
    for antenna in scenario.body.iter().flat_map(|body| &body.antenna) {
        antenna.signals.as_ref().map_or(Ok(()), |own| distinct("body.antenna.signals", own))?;
    }
    let station = scenario.station.as_ref().and_then(|station| station.signals.as_ref());
    station.map_or(Ok(()), |own| distinct("station.signals", own))?;
    distinct("output.formats", &scenario.output.formats)
}

/// Refuses a list that is empty or says something twice.
fn distinct<T: PartialEq + fmt::Debug>(key: &str, list: &[T]) -> Result<(), ScenarioError> {
    if list.is_empty() {
        return Err(ScenarioError::new(key, "[], expected at least one"));
    }
    let twice = |k: &usize| list[..*k].contains(&list[*k]);
    match (1..list.len()).find(twice) {
        Some(k) => Err(ScenarioError::new(key, format!("{:?} twice, expected once", list[k]))),
        None => Ok(()),
    }
}

/// Names of antennas and bodies become names of files and must differ.
fn check_names(scenario: &Scenario) -> Result<(), ScenarioError> {
    if scenario.body.is_empty() {
        return Err(ScenarioError::new("body", "[], expected at least one"));
    }
    let bodies = scenario.body.iter().map(|body| ("body.name", body.name.as_str()));
    file_names(bodies)?;
    if let Some(body) = scenario.body.iter().find(|body| body.antenna.is_empty()) {
        let problem = format!("[] of {:?}, expected at least one", body.name);
        return Err(ScenarioError::new("body.antenna", problem));
    }
    let antennas = scenario.body.iter().flat_map(|body| &body.antenna);
    let antennas = antennas.map(|antenna| ("body.antenna.name", antenna.name.as_str()));
    let station = scenario.station.iter().map(|station| ("station.name", station.name.as_str()));
    file_names(antennas.chain(station))
}

fn file_names<'a>(names: impl Iterator<Item = (&'a str, &'a str)>) -> Result<(), ScenarioError> {
    let mut known: Vec<&str> = Vec::new();
    for (key, name) in names {
        let is_file_name = !name.is_empty()
            && name.bytes().all(|b| b.is_ascii_alphanumeric() || matches!(b, b'-' | b'_'));
        let wanted = if !is_file_name {
            "only A-Z a-z 0-9 - _"
        } else if name.eq_ignore_ascii_case(NAVIGATION_NAME) {
            "another name: this is that of the navigation file"
        } else if known.iter().any(|other| other.eq_ignore_ascii_case(name)) {
            "a name that is given once (capital or not)"
        } else {
            known.push(name);
            continue;
        };
        return Err(ScenarioError::new(key, format!("{name:?}, expected {wanted}")));
    }
    Ok(())
}
