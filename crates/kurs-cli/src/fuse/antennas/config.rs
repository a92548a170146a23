//! The configuration of `kurs fuse` for antennas and an inertial sensor.

use std::path::{Path, PathBuf};

use kurs::frames::{Geodetic, Vector};
use kurs::fusion::attitude::filter::InertialSettings;
use kurs::fusion::attitude::session::AttitudeSessionSettings;
use kurs::fusion::kalman::Gate;
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use crate::config_file::check_range;
use crate::failure::UsageError;
use crate::fuse::imu::ImuConfig;

/// One degree an hour, in rad/s.
const DEGREES_PER_HOUR: f64 = core::f64::consts::PI / 180.0 / 3600.0;
/// √h in √s.
const SQRT_HOUR: f64 = 60.0;
/// Rate of the Earth, °/h, some of which is in a gyro bias from a rest.
const EARTH_RATE_DEGPH: f64 = 15.04;

/// `kurs fuse CONFIG.toml` with `[antennas]` and `[imu]`.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Config {
    pub(super) antennas: AntennasConfig,
    pub(super) imu: ImuConfig,
    #[serde(default)]
    pub(super) filter: FilterConfig,
    #[serde(default)]
    pub(super) output: OutputConfig,
}

#[derive(Debug, Clone, Deserialize, Serialize)]
#[serde(deny_unknown_fields, default)]
pub(crate) struct AntennasConfig {
    /// `attitude.csv` of `kurs solve` or `kurs orient`.
    #[serde(skip_serializing_if = "Option::is_none")]
    attitude: Option<PathBuf>,
    /// Or the configuration of `kurs solve`: the epochs are solved here, with what the filter
    /// predicts.
    #[serde(skip_serializing_if = "Option::is_none")]
    solve: Option<PathBuf>,
    /// Whether attitudes from real-valued ambiguities are used too.
    pub(super) use_float: bool,
    /// 1-sigma of the velocities on each axis; 0 leaves them out.
    pub(super) velocity_sd_mps: f64,
    /// The point whose velocity stands in the file, body axes.
    pub(super) velocity_point_m: [f64; 3],
    /// Over how long the attitudes' errors are alike.
    pub(super) correlation_s: f64,
    /// Where the body is, if the file does not say it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) latitude_deg: Option<f64>,
    pub(super) height_m: f64,
}

impl Default for AntennasConfig {
    fn default() -> Self {
        Self {
            attitude: None,
            solve: None,
            use_float: true,
            velocity_sd_mps: 0.1,
            velocity_point_m: [0.0; 3],
            correlation_s: 1.0,
            latitude_deg: None,
            height_m: 0.0,
        }
    }
}

#[derive(Debug, Clone, Deserialize, Serialize)]
#[serde(deny_unknown_fields, default)]
pub(crate) struct FilterConfig {
    pub(crate) gate_sigmas: f64,
    /// Input that comes later than other input by up to this is put in its place.
    pub(crate) order_window_s: f64,
    /// 1-sigma of roll or pitch at the start where the antennas do not give it.
    pub(crate) first_angle_sd_deg: f64,
    /// Whether `smoothed.csv` is written.
    pub(crate) smooth: bool,
}

#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct OutputConfig {
    /// Rows at least so often; by default as often as the antennas have them.
    pub(super) interval_s: Option<f64>,
}

impl Default for FilterConfig {
    fn default() -> Self {
        Self { gate_sigmas: 5.0, order_window_s: 0.2, first_angle_sd_deg: 5.0, smooth: true }
    }
}

/// Where the antennas' rows come from.
pub(super) enum RowsFrom<'a> {
    /// A table of attitudes.
    Attitudes(&'a Path),
    /// A configuration of `kurs solve`.
    Observations(&'a Path),
}

impl AntennasConfig {
    /// The file that is given, whichever it is.
    pub(super) fn file(&self) -> Result<&Path, UsageError> {
        self.rows_from().map(|from| match from {
            RowsFrom::Attitudes(file) | RowsFrom::Observations(file) => file,
        })
    }

    /// The one file that is given.
    pub(super) fn rows_from(&self) -> Result<RowsFrom<'_>, UsageError> {
        match (&self.attitude, &self.solve) {
            (Some(file), None) => Ok(RowsFrom::Attitudes(file)),
            (None, Some(file)) => Ok(RowsFrom::Observations(file)),
            (found, _) => {
                let found = if found.is_some() { "both" } else { "none" };
                Err(UsageError(format!(
                    "antennas: {found} of `attitude` and `solve` found, expected one: attitude.csv of \
                     kurs solve, or its configuration"
                )))
            }
        }
    }
}

/// The session that these tables describe; `gyro_calibrated`: a bias from a rest is taken off the
/// rates.
pub(crate) fn session(
    antennas: &AntennasConfig,
    imu: &ImuConfig,
    filter: &FilterConfig,
    gyro_calibrated: bool,
) -> AttitudeSessionSettings {
    let earth_degph = if gyro_calibrated { EARTH_RATE_DEGPH } else { 0.0 };
    let bias_walk = imu.gyro_bias_walk_degph_per_sqrt_h * DEGREES_PER_HOUR / SQRT_HOUR;
    let point_m = Vector3::from(antennas.velocity_point_m);
    let place = |latitude_deg| Geodetic::from_degrees(latitude_deg, 0.0, antennas.height_m);
    AttitudeSessionSettings {
        inertial: InertialSettings {
            gyro_noise: imu.gyro_noise_deg_per_sqrt_h.to_radians() / SQRT_HOUR,
            gyro_bias_sd_radps: imu.gyro_bias_sd_degph.hypot(earth_degph) * DEGREES_PER_HOUR,
            gyro_bias_walk: bias_walk,
            accelerometer_noise: imu.accelerometer_noise_mps2_per_sqrt_hz,
            accelerometer_bias_sd_mps2: imu.accelerometer_bias_sd_mps2,
            accelerometer_bias_walk: imu.accelerometer_bias_walk_mps2_per_sqrt_h / SQRT_HOUR,
            mounting_sd_rad: imu.mounting_sd_deg.to_radians(),
            unknown_acceleration: 1.0,
            gate: Gate::Innovation { sigmas: filter.gate_sigmas },
        },
        use_float: antennas.use_float,
        velocity_sd_mps: (antennas.velocity_sd_mps > 0.0).then_some(antennas.velocity_sd_mps),
        lever_arm_m: Vector::from_xyz(point_m - Vector3::from(imu.position_m)),
        correlation_s: antennas.correlation_s,
        first_angle_sd_rad: filter.first_angle_sd_deg.to_radians(),
        place: antennas.latitude_deg.map(place),
        order_window_s: filter.order_window_s,
        smooth: filter.smooth,
    }
}

impl Config {
    /// The session that the configuration describes; `gyro_calibrated`: a bias from a rest is taken
    /// off the rates.
    pub(super) fn session(&self, gyro_calibrated: bool) -> AttitudeSessionSettings {
        session(&self.antennas, &self.imu, &self.filter, gyro_calibrated)
    }

    /// Refuses values that cannot be meant.
    pub(super) fn check(&self) -> Result<(), UsageError> {
        self.antennas.rows_from()?;
        self.imu.check()?;
        check(&self.antennas, &self.filter, ("output.interval_s", self.output.interval_s))
    }
}

/// Refuses values that cannot be meant; the interval of the rows has a key of its own.
pub(crate) fn check(
    antennas: &AntennasConfig,
    filter: &FilterConfig,
    (interval_key, interval_s): (&str, Option<f64>),
) -> Result<(), UsageError> {
    let positive = [
        ("filter.gate_sigmas", filter.gate_sigmas),
        ("filter.first_angle_sd_deg", filter.first_angle_sd_deg),
    ];
    if let Some((key, value)) = positive.iter().find(|(_, v)| v.is_nan() || *v <= 0.0) {
        return Err(UsageError(format!("{key}: {value} found, more than 0 expected")));
    }
    check_range(interval_key, interval_s.unwrap_or(1.0), 1e-3..=86_400.0)?;
    let not_negative = [
        ("antennas.velocity_sd_mps", antennas.velocity_sd_mps),
        ("antennas.correlation_s", antennas.correlation_s),
        ("filter.order_window_s", filter.order_window_s),
    ];
    if let Some((key, value)) = not_negative.iter().find(|(_, v)| v.is_nan() || *v < 0.0) {
        return Err(UsageError(format!("{key}: {value} found, 0 or more expected")));
    }
    if !antennas.velocity_point_m.iter().all(|x| x.is_finite()) {
        return Err(UsageError("antennas.velocity_point_m: finite numbers expected".into()));
    }
    match antennas.latitude_deg {
        Some(found) if !(-90.0..=90.0).contains(&found) => {
            let text = format!("antennas.latitude_deg: {found} found, -90 to 90 expected");
            Err(UsageError(text))
        }
        _ => Ok(()),
    }
}
