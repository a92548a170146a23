//! The inertial sensor of `kurs fuse`: its table in the configuration, and its log, calibrated and turned
//! into the axes of the body.

use std::collections::VecDeque;
use std::path::{Path, PathBuf};

use anyhow::bail;
use kurs::frames::Vector;
use kurs::fusion::attitude::session::ImuSample;
use nalgebra::{Matrix3, Vector3};
use serde::Deserialize;

use super::calibration::Calibration;
use super::{attitude, gravity_check};
use crate::failure::UsageError;
use crate::sensor_log::{Backwards, SensorReader, SensorRow};
use crate::summary::Damage;

/// The table `[imu]`.
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

impl ImuConfig {
    /// Body axes from those of the sensor.
    fn body_from_imu(&self) -> Matrix3<f64> {
        attitude(self.mounting_deg).ned_from_body().matrix()
    }

    /// Refuses values that cannot be meant.
    pub(super) fn check(&self) -> Result<(), UsageError> {
        if self.file.as_os_str().is_empty() {
            return Err(UsageError("imu.file: no log of the inertial sensor".into()));
        }
        let force_noise = self.accelerometer_noise_mps2_per_sqrt_hz;
        let positive = [
            ("gyro_noise_deg_per_sqrt_h", self.gyro_noise_deg_per_sqrt_h),
            ("gyro_bias_sd_degph", self.gyro_bias_sd_degph),
            ("gyro_range_degps", self.gyro_range_degps),
            ("accelerometer_noise_mps2_per_sqrt_hz", force_noise),
            ("accelerometer_bias_sd_mps2", self.accelerometer_bias_sd_mps2),
            ("accelerometer_range_mps2", self.accelerometer_range_mps2),
        ];
        if let Some((key, value)) = positive.iter().find(|(_, v)| v.is_nan() || *v <= 0.0) {
            return Err(UsageError(format!("imu.{key}: {value} found, more than 0 expected")));
        }
        let force_walk = self.accelerometer_bias_walk_mps2_per_sqrt_h;
        let not_negative = [
            ("gyro_bias_walk_degph_per_sqrt_h", self.gyro_bias_walk_degph_per_sqrt_h),
            ("accelerometer_bias_walk_mps2_per_sqrt_h", force_walk),
        ];
        if let Some((key, value)) = not_negative.iter().find(|(_, v)| v.is_nan() || *v < 0.0) {
            return Err(UsageError(format!("imu.{key}: {value} found, 0 or more expected")));
        }
        let vectors = [
            ("position_m", self.position_m),
            ("mounting_deg", self.mounting_deg),
            ("time_offset_s", [self.time_offset_s; 3]),
        ];
        match vectors.iter().find(|(_, v)| !v.iter().all(|x| x.is_finite())) {
            Some((key, _)) => Err(UsageError(format!("imu.{key}: finite numbers expected"))),
            None => Ok(()),
        }
    }
}

/// The log of the sensor, calibrated and turned into the axes of the body.
pub(super) struct Sensor {
    reader: SensorReader,
    /// Read ahead of their time, first of all to look at the unit.
    ahead: VecDeque<SensorRow>,
    calibration: Calibration,
    body_from_imu: Matrix3<f64>,
    time_offset_s: f64,
    /// Readings at or beyond these are saturated.
    rate_range_radps: f64,
    force_range_mps2: f64,
}

impl Sensor {
    pub(super) fn open(folder: &Path, config: &ImuConfig) -> anyhow::Result<Self> {
        let file = config.calibration.as_ref();
        let calibration = file.map(|file| Calibration::read(&folder.join(file))).transpose()?;
        let path = folder.join(&config.file);
        let mut reader = SensorReader::open(&path, Backwards::Kept)?;
        if !reader.has_gyro() {
            bail!("{}: no gyro columns (gx_radps, gy_radps, gz_radps)", path.display());
        }
        let ahead: VecDeque<SensorRow> = reader.by_ref().take(gravity_check::SAMPLES).collect();
        if ahead.is_empty() {
            bail!("{}: no usable row", path.display());
        }
        if reader.has_accelerometer() {
            let norms = ahead.iter().filter_map(|row| Some(row.accelerometer?.norm()));
            gravity_check::refuse_other_units(norms.collect(), gravity_check::AT_REST_MPS2)?;
        }
        Ok(Self {
            reader,
            ahead,
            calibration: calibration.unwrap_or_default(),
            body_from_imu: config.body_from_imu(),
            time_offset_s: config.time_offset_s,
            rate_range_radps: config.gyro_range_degps.to_radians(),
            force_range_mps2: config.accelerometer_range_mps2,
        })
    }

    /// Whether a bias from a rest is taken off the rates.
    pub(super) const fn has_gyro_bias(&self) -> bool {
        self.calibration.gyro_bias_radps.is_some()
    }

    /// Whether the log has accelerometers.
    pub(super) const fn has_accelerometer(&self) -> bool {
        self.reader.has_accelerometer()
    }

    /// What was left out so far.
    pub(super) fn damage(&self) -> &[Damage] {
        self.reader.damage()
    }

    /// The next sample, unless it is later than this.
    pub(super) fn next_before(&mut self, time_s: f64) -> Option<(f64, ImuSample)> {
        let next = self.peek().filter(|(at_s, _)| *at_s <= time_s)?;
        self.ahead.pop_front();
        Some(next)
    }

    /// The next sample, which stays the next.
    pub(super) fn peek(&mut self) -> Option<(f64, ImuSample)> {
        if self.ahead.is_empty() {
            self.ahead.extend(self.reader.next());
        }
        let row = self.ahead.front()?;
        let in_body = |v: Vector3<f64>| Vector::from_xyz(self.body_from_imu * v);
        let inside = |reading: &Vector3<f64>, range: f64| reading.amax() < range;
        let rate = row.gyro.filter(|reading| inside(reading, self.rate_range_radps));
        let force = row.accelerometer.filter(|reading| inside(reading, self.force_range_mps2));
        let sample = ImuSample {
            rate_radps: rate.map(|reading| in_body(self.calibration.rate(&reading))),
            specific_force_mps2: force.map(|reading| in_body(self.calibration.force(&reading))),
            saturated: rate.is_none() || force.is_none() != row.accelerometer.is_none(),
        };
        Some((row.time_s + self.time_offset_s, sample))
    }
}
