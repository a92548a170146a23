//! The configuration of `kurs fuse` for antennas and an inertial sensor.

use std::path::PathBuf;

use kurs::frames::{Geodetic, Vector};
use kurs::fusion::attitude_filter::InertialSettings;
use kurs::fusion::attitude_session::AttitudeSessionSettings;
use kurs::fusion::kalman::Gate;
use nalgebra::{Matrix3, Vector3};
use serde::Deserialize;

use crate::failure::UsageError;
use crate::fuse::attitude;

/// One degree an hour, in rad/s.
const DEGREES_PER_HOUR: f64 = core::f64::consts::PI / 180.0 / 3600.0;
/// √h in √s.
const SQRT_HOUR: f64 = 60.0;
/// What a gyro bias from a rest has of the Earth's rate in it, °/h.
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

#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct AntennasConfig {
    /// `attitude.csv` of `kurs solve` or `kurs orient`.
    pub(super) attitude: PathBuf,
    /// Whether attitudes from real-valued ambiguities are used too.
    #[serde(default = "yes")]
    pub(super) use_float: bool,
    /// 1-sigma of the velocities on each axis; 0 leaves them out.
    #[serde(default = "default_velocity_sd")]
    pub(super) velocity_sd_mps: f64,
    /// The point whose velocity stands in the file, body axes.
    #[serde(default)]
    pub(super) velocity_point_m: [f64; 3],
    /// Over how long the attitudes' errors are alike.
    #[serde(default = "default_correlation")]
    pub(super) correlation_s: f64,
    /// Where the body is, if the file does not say it.
    pub(super) latitude_deg: Option<f64>,
    #[serde(default)]
    pub(super) height_m: f64,
}

#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct ImuConfig {
    /// CSV log; `time_s` is the GPS second of week.
    pub(super) file: PathBuf,
    /// Result of `kurs calibrate`.
    pub(super) calibration: Option<PathBuf>,
    /// Added to the times of the log.
    pub(super) time_offset_s: f64,
    /// Body axes.
    pub(super) position_m: [f64; 3],
    /// Heading, pitch, roll of the sensor against the body.
    pub(super) mounting_deg: [f64; 3],
    pub(super) gyro_noise_deg_per_sqrt_h: f64,
    pub(super) gyro_bias_sd_degph: f64,
    pub(super) gyro_bias_walk_degph_per_sqrt_h: f64,
    pub(super) gyro_range_degps: f64,
    pub(super) accelerometer_noise_mps2_per_sqrt_hz: f64,
    pub(super) accelerometer_bias_sd_mps2: f64,
    pub(super) accelerometer_bias_walk_mps2_per_sqrt_h: f64,
    pub(super) accelerometer_range_mps2: f64,
}

#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct FilterConfig {
    pub(super) gate_sigmas: f64,
    /// Input that comes later than other input by up to this is put in its place.
    pub(super) order_window_s: f64,
    /// 1-sigma of roll or pitch at the start where the antennas do not give it.
    pub(super) first_angle_sd_deg: f64,
    /// Whether `smoothed.csv` is written.
    pub(super) smooth: bool,
}

#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct OutputConfig {
    /// Rows at least so often; by default as often as the antennas have them.
    pub(super) interval_s: Option<f64>,
}

impl Default for ImuConfig {
    fn default() -> Self {
        Self {
            file: PathBuf::new(),
            calibration: None,
            time_offset_s: 0.0,
            position_m: [0.0; 3],
            mounting_deg: [0.0; 3],
            gyro_noise_deg_per_sqrt_h: 0.1,
            gyro_bias_sd_degph: 10.0,
            gyro_bias_walk_degph_per_sqrt_h: 1.0,
            gyro_range_degps: f64::INFINITY,
            accelerometer_noise_mps2_per_sqrt_hz: 0.002,
            accelerometer_bias_sd_mps2: 0.05,
            accelerometer_bias_walk_mps2_per_sqrt_h: 0.01,
            accelerometer_range_mps2: f64::INFINITY,
        }
    }
}

impl Default for FilterConfig {
    fn default() -> Self {
        Self { gate_sigmas: 5.0, order_window_s: 0.2, first_angle_sd_deg: 5.0, smooth: true }
    }
}

impl Config {
    /// The session that the configuration describes; `gyro_calibrated`: a bias from a rest is taken
    /// off the rates.
    pub(super) fn session(
        &self,
        gyro_calibrated: bool,
    ) -> Result<AttitudeSessionSettings, UsageError> {
        self.check()?;
        let Self { antennas, imu, filter, .. } = self;
        let earth_degph = if gyro_calibrated { EARTH_RATE_DEGPH } else { 0.0 };
        let bias_walk = imu.gyro_bias_walk_degph_per_sqrt_h * DEGREES_PER_HOUR / SQRT_HOUR;
        let point_m = Vector3::from(antennas.velocity_point_m);
        let place = |latitude_deg| Geodetic::from_degrees(latitude_deg, 0.0, antennas.height_m);
        Ok(AttitudeSessionSettings {
            inertial: InertialSettings {
                gyro_noise: imu.gyro_noise_deg_per_sqrt_h.to_radians() / SQRT_HOUR,
                gyro_bias_sd_radps: imu.gyro_bias_sd_degph.hypot(earth_degph) * DEGREES_PER_HOUR,
                gyro_bias_walk: bias_walk,
                accelerometer_noise: imu.accelerometer_noise_mps2_per_sqrt_hz,
                accelerometer_bias_sd_mps2: imu.accelerometer_bias_sd_mps2,
                accelerometer_bias_walk: imu.accelerometer_bias_walk_mps2_per_sqrt_h / SQRT_HOUR,
                unknown_acceleration: 1.0,
                gate: Gate::Innovation { sigmas: filter.gate_sigmas },
            },
            use_float: antennas.use_float,
            velocity_sd_mps: (antennas.velocity_sd_mps > 0.0).then_some(antennas.velocity_sd_mps),
            lever_arm_m: Vector::from_xyz(point_m - Vector3::from(imu.position_m)),
            correlation_s: antennas.correlation_s,
            first_angle_sd_rad: filter.first_angle_sd_deg.to_radians(),
            place: antennas.latitude_deg.map(place),
            rate_range_radps: imu.gyro_range_degps.to_radians(),
            force_range_mps2: imu.accelerometer_range_mps2,
            order_window_s: filter.order_window_s,
            smooth: filter.smooth,
        })
    }

    /// Body axes from those of the sensor.
    pub(super) fn body_from_imu(&self) -> Matrix3<f64> {
        attitude(self.imu.mounting_deg).ned_from_body().matrix()
    }

    fn check(&self) -> Result<(), UsageError> {
        let Self { antennas, imu, filter, output } = self;
        if imu.file.as_os_str().is_empty() {
            return Err(UsageError("imu.file: no log of the inertial sensor".into()));
        }
        let positive = [
            ("filter.gate_sigmas", filter.gate_sigmas),
            ("filter.first_angle_sd_deg", filter.first_angle_sd_deg),
            ("imu.gyro_noise_deg_per_sqrt_h", imu.gyro_noise_deg_per_sqrt_h),
            ("imu.gyro_bias_sd_degph", imu.gyro_bias_sd_degph),
            ("imu.gyro_range_degps", imu.gyro_range_degps),
            ("imu.accelerometer_noise_mps2_per_sqrt_hz", imu.accelerometer_noise_mps2_per_sqrt_hz),
            ("imu.accelerometer_bias_sd_mps2", imu.accelerometer_bias_sd_mps2),
            ("imu.accelerometer_range_mps2", imu.accelerometer_range_mps2),
            ("output.interval_s", output.interval_s.unwrap_or(1.0)),
        ];
        if let Some((key, value)) = positive.iter().find(|(_, v)| v.is_nan() || *v <= 0.0) {
            return Err(UsageError(format!("{key}: {value} found, more than 0 expected")));
        }
        let walk = imu.accelerometer_bias_walk_mps2_per_sqrt_h;
        let not_negative = [
            ("antennas.velocity_sd_mps", antennas.velocity_sd_mps),
            ("antennas.correlation_s", antennas.correlation_s),
            ("imu.gyro_bias_walk_degph_per_sqrt_h", imu.gyro_bias_walk_degph_per_sqrt_h),
            ("imu.accelerometer_bias_walk_mps2_per_sqrt_h", walk),
            ("filter.order_window_s", filter.order_window_s),
        ];
        if let Some((key, value)) = not_negative.iter().find(|(_, v)| v.is_nan() || *v < 0.0) {
            return Err(UsageError(format!("{key}: {value} found, 0 or more expected")));
        }
        let vectors = [
            ("antennas.velocity_point_m", antennas.velocity_point_m),
            ("imu.position_m", imu.position_m),
            ("imu.mounting_deg", imu.mounting_deg),
            ("imu.time_offset_s", [imu.time_offset_s; 3]),
        ];
        if let Some((key, _)) = vectors.iter().find(|(_, v)| !v.iter().all(|x| x.is_finite())) {
            return Err(UsageError(format!("{key}: finite numbers expected")));
        }
        match antennas.latitude_deg {
            Some(found) if !(-90.0..=90.0).contains(&found) => {
                let text = format!("antennas.latitude_deg: {found} found, -90 to 90 expected");
                Err(UsageError(text))
            }
            _ => Ok(()),
        }
    }
}

const fn yes() -> bool {
    true
}

const fn default_velocity_sd() -> f64 {
    0.1
}

const fn default_correlation() -> f64 {
    1.0
}
