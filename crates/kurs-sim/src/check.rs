//! Whether the numbers of a scenario can be.

use core::fmt;

use crate::scenario::{Antenna, Imu, MotionPlan, Place, Scenario};
use crate::simulation::ScenarioError;

/// Letters of the systems that have built-in orbits.
const BUILT_IN_SYSTEMS: [&str; 5] = ["G", "R", "E", "C", "J"];
/// Turns further round than this say nothing new.
const MOST_DEG: f64 = 720.0;

/// What a number may be.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Allowed {
    Finite,
    FromZero,
    AboveZero,
    Within(f64, f64),
}

const ANGLE: Allowed = Allowed::Within(-MOST_DEG, MOST_DEG);
const ELEVATION: Allowed = Allowed::Within(-90.0, 90.0);

impl Allowed {
    fn holds(self, value: f64) -> bool {
        value.is_finite()
            && match self {
                Self::Finite => true,
                Self::FromZero => value >= 0.0,
                Self::AboveZero => value > 0.0,
                Self::Within(low, high) => (low..=high).contains(&value),
            }
    }
}

impl fmt::Display for Allowed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Finite => f.write_str("a finite number"),
            Self::FromZero => f.write_str("at least 0"),
            Self::AboveZero => f.write_str("above 0"),
            Self::Within(low, high) => write!(f, "from {low} to {high}"),
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
    match numbers.iter().find(|(_, value, allowed)| !allowed.holds(*value)) {
        Some((key, value, allowed)) => {
            Err(ScenarioError::new(key, format!("{value}, expected {allowed}")))
        }
        None => check_lists(scenario),
    }
}

type Numbers = Vec<(String, f64, Allowed)>;

fn of_surroundings(scenario: &Scenario) -> Numbers {
    let Scenario { noise, multipath, atmosphere, clock, sky, slips, .. } = scenario;
    let numbers = [
        ("noise.code_sd_m", noise.code_sd_m, Allowed::FromZero),
        ("noise.phase_sd_cycles", noise.phase_sd_cycles, Allowed::FromZero),
        ("noise.doppler_sd_hz", noise.doppler_sd_hz, Allowed::FromZero),
        ("noise.cn0_zenith_dbhz", noise.cn0_zenith_dbhz, Allowed::Within(0.0, 99.0)),
        ("multipath.code_sd_m", multipath.code_sd_m, Allowed::FromZero),
        ("multipath.phase_sd_m", multipath.phase_sd_m, Allowed::FromZero),
        ("multipath.correlation_s", multipath.correlation_s, Allowed::AboveZero),
        ("atmosphere.ionosphere_zenith_m", atmosphere.ionosphere_zenith_m, Allowed::FromZero),
        ("atmosphere.troposphere_zenith_m", atmosphere.troposphere_zenith_m, Allowed::FromZero),
        ("clock.bias_sd_s", clock.bias_sd_s, Allowed::FromZero),
        ("clock.drift_sd", clock.drift_sd, Allowed::FromZero),
        ("clock.wander", clock.wander, Allowed::FromZero),
        ("sky.elevation_mask_deg", sky.elevation_mask_deg, ELEVATION),
        ("sky.orbit_error_sd_m", sky.orbit_error_sd_m, Allowed::FromZero),
        ("sky.clock_error_sd_m", sky.clock_error_sd_m, Allowed::FromZero),
        ("slips.per_hour", slips.per_hour, Allowed::FromZero),
        ("slips.flagged_share", slips.flagged_share, Allowed::Within(0.0, 1.0)),
    ];
    let mut numbers =
        numbers.map(|(key, value, allowed)| (key.to_owned(), value, allowed)).to_vec();
    of_obstacles("sky.horizon_deg", &sky.horizon_deg, &mut numbers);
    numbers
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
        ("height_m", place.height_m, Allowed::Within(-12_000.0, 1e7)),
    ] {
        numbers.push((format!("{key}.{part}"), value, allowed));
    }
}

fn of_imu(imu: &Imu, numbers: &mut Numbers) {
    let mut add = |key: &str, values: &[f64], allowed: Allowed| {
        numbers.extend(values.iter().map(|value| (format!("body.imu.{key}"), *value, allowed)));
    };
    add("interval_s", &[imu.interval_s], Allowed::Within(1e-4, 10.0));
    add("position_m", &imu.position_m, Allowed::Within(-1e4, 1e4));
    add("mounting_deg", &imu.mounting_deg, ANGLE);
    add("gyro_bias_degph", &imu.gyro_bias_degph, Allowed::Finite);
    add("gyro_noise_deg_per_sqrt_h", &[imu.gyro_noise_deg_per_sqrt_h], Allowed::FromZero);
    add("gyro_matrix", imu.gyro_matrix.as_flattened(), Allowed::Finite);
    add("gyro_range_degps", &[imu.gyro_range_degps], Allowed::AboveZero);
    add("accelerometer_bias_mps2", &imu.accelerometer_bias_mps2, Allowed::Finite);
    let noise = imu.accelerometer_noise_mps2_per_sqrt_hz;
    add("accelerometer_noise_mps2_per_sqrt_hz", &[noise], Allowed::FromZero);
    add("accelerometer_matrix", imu.accelerometer_matrix.as_flattened(), Allowed::Finite);
    add("accelerometer_range_mps2", &[imu.accelerometer_range_mps2], Allowed::AboveZero);
}

fn of_antenna(antenna: &Antenna, interval_s: f64, numbers: &mut Numbers) {
    let half_s = interval_s / 2.0;
    for value in antenna.position_m {
        numbers.push(("body.antenna.position_m".to_owned(), value, Allowed::Within(-1e4, 1e4)));
    }
    let offset = Allowed::Within(-half_s, half_s);
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
            coordinates.for_each(|c| add("waypoints_m", *c, Allowed::Within(-1e6, 1e6)));
            add("speed_mps", *speed_mps, Allowed::AboveZero);
            add("wait_s", *wait_s, Allowed::FromZero);
            add("acceleration_mps2", *acceleration_mps2, Allowed::AboveZero);
            add("turn_radius_m", *turn_radius_m, Allowed::AboveZero);
            add("lean_deg_per_mps2", *lean_deg_per_mps2, Allowed::Finite);
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
            add("speed_mps", *speed_mps, Allowed::Finite);
            add("period_s", *period_s, Allowed::AboveZero);
            add("roll_rms_deg", *roll_rms_deg, Allowed::Within(0.0, 40.0));
            add("pitch_rms_deg", *pitch_rms_deg, Allowed::Within(0.0, 20.0));
            add("yaw_rms_deg", *yaw_rms_deg, Allowed::Within(0.0, 90.0));
            add("heave_rms_m", *heave_rms_m, Allowed::FromZero);
            (place, "body.motion.place")
        }
        MotionPlan::Uav { place, radius_m, speed_mps, tilt_deg, max_rate_degps } => {
            add("radius_m", *radius_m, Allowed::AboveZero);
            add("speed_mps", *speed_mps, Allowed::Finite);
            add("tilt_deg", *tilt_deg, Allowed::Within(0.1, 89.0));
            add("max_rate_degps", *max_rate_degps, Allowed::AboveZero);
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
            add("inclination_deg", *inclination_deg, Allowed::Within(0.0, 180.0));
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
    let end = |from_s: f64| Allowed::Within(from_s, f64::MAX);
    for outage in &scenario.outage {
        add("outage.from_s", outage.from_s, Allowed::Finite);
        add("outage.to_s", outage.to_s, end(outage.from_s));
    }
    for interference in &scenario.interference {
        add("interference.from_s", interference.from_s, Allowed::Finite);
        add("interference.to_s", interference.to_s, end(interference.from_s));
        add("interference.cn0_drop_db", interference.cn0_drop_db, Allowed::FromZero);
    }
    for slip in &scenario.slip {
        add("slip.time_s", slip.time_s, Allowed::Finite);
    }
    for bias in &scenario.bias {
        add("bias.code_m", bias.code_m, Allowed::Finite);
        add("bias.phase_cycles", bias.phase_cycles, Allowed::Finite);
        add("bias.code_m_per_channel", bias.code_m_per_channel, Allowed::Finite);
        add("bias.phase_cycles_per_channel", bias.phase_cycles_per_channel, Allowed::Finite);
    }
}

fn check_lists(scenario: &Scenario) -> Result<(), ScenarioError> {
    let none = |key: &str| Err(ScenarioError::new(key, "none given, at least one is needed"));
    let own_signals = scenario.body.iter().flat_map(|body| &body.antenna);
    let own_signals = own_signals.filter_map(|antenna| antenna.signals.as_ref());
    if scenario.sky.max_satellites == Some(0) {
        return Err(ScenarioError::new("sky.max_satellites", "0, expected at least 1"));
    }
    if scenario.sky.systems.is_empty() {
        return none("sky.systems");
    }
    if let Some(name) =
        scenario.sky.systems.iter().find(|s| !BUILT_IN_SYSTEMS.contains(&s.as_str()))
    {
        let known = BUILT_IN_SYSTEMS.join(", ");
        return Err(ScenarioError::new(
            "sky.systems",
            format!("{name:?}, expected some of {known}"),
        ));
    }
    if scenario.signals.is_empty() {
        return none("signals");
    }
    if own_signals.into_iter().any(Vec::is_empty) {
        return none("body.antenna.signals");
    }
    if scenario.output.formats.is_empty() {
        return none("output.formats");
    }
    Ok(())
}
