//! The inertial sensor of `kurs fuse`: its table in the configuration, and its log, calibrated and
//! turned into the axes of the body.

use std::collections::VecDeque;
use std::path::{Path, PathBuf};

use anyhow::bail;
use kurs::array::MAX_SEPARATION_M;
use kurs::frames::Vector;
use kurs::fusion::attitude::session::ImuSample;
use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

use super::calibration::Calibration;
use super::{attitude, gravity_check};
use crate::config_file::check_range;
use crate::failure::UsageError;
use crate::sensor_log::{Backwards, SensorReader, SensorRow};
use crate::summary::{Damage, damaged};

/// The filter takes the error of a mounting for a small turn.
const MAX_MOUNTING_SD_DEG: f64 = 10.0;
/// No body with antennas is turned on and off faster, rad/s²: racing drones reach 1000 °/s in 50 ms.
const MAX_ANGULAR_ACCELERATION: f64 = 20_000.0 * core::f64::consts::PI / 180.0;
/// Nor does one sample of a sensor leave its neighbours by so many times what is usual, unless it is wrong.
const MAX_DEPARTURE: f64 = 20.0;
/// How fast the usual departure follows the samples.
const DEPARTURE_SHARE: f64 = 0.05;

/// The table `[imu]`.
#[derive(Debug, Clone, Deserialize, Serialize)]
#[serde(deny_unknown_fields, default)]
pub(crate) struct ImuConfig {
    /// CSV log; `time_s` is the GPS second of week.
    #[serde(skip_serializing_if = "is_empty")]
    pub(super) file: PathBuf,
    /// `kurs live`: where such lines come from.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) stream: Option<String>,
    /// `kurs live`: or a log that is read as fast as the antennas have epochs.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) log: Option<PathBuf>,
    /// `kurs live`: the header of lines that come without one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) columns: Option<String>,
    /// `kurs live`: rows at least so often.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) interval_s: Option<f64>,
    /// Result of `kurs calibrate`.
    pub(super) calibration: Option<PathBuf>,
    /// Added to the times of the log.
    pub(super) time_offset_s: f64,
    /// Body axes.
    pub(super) position_m: [f64; 3],
    /// Heading, pitch, roll of the sensor against the body.
    pub(super) mounting_deg: [f64; 3],
    /// Of the constant error of that on each axis, 1-sigma; 0: exact.
    pub(super) mounting_sd_deg: f64,
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
            stream: None,
            log: None,
            columns: None,
            interval_s: None,
            calibration: None,
            time_offset_s: 0.0,
            position_m: [0.0; 3],
            mounting_deg: [0.0; 3],
            mounting_sd_deg: 0.0,
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
        let of_live = [
            ("stream", self.stream.is_some()),
            ("log", self.log.is_some()),
            ("columns", self.columns.is_some()),
            ("interval_s", self.interval_s.is_some()),
        ];
        if let Some((key, _)) = of_live.iter().find(|(_, is_given)| *is_given) {
            return Err(UsageError(format!("imu.{key} is for `kurs live`")));
        }
        self.check_values()
    }

    /// Refuses values that cannot be meant, wherever the samples come from.
    pub(crate) fn check_values(&self) -> Result<(), UsageError> {
        let force_walk = self.accelerometer_bias_walk_mps2_per_sqrt_h;
        let force_noise = self.accelerometer_noise_mps2_per_sqrt_hz;
        for (key, value, range) in [
            ("gyro_noise_deg_per_sqrt_h", self.gyro_noise_deg_per_sqrt_h, 1e-6..=1e4),
            ("gyro_bias_sd_degph", self.gyro_bias_sd_degph, 1e-6..=1e6),
            ("gyro_bias_walk_degph_per_sqrt_h", self.gyro_bias_walk_degph_per_sqrt_h, 0.0..=1e6),
            ("gyro_range_degps", self.gyro_range_degps, 1e-6..=f64::INFINITY),
            ("accelerometer_noise_mps2_per_sqrt_hz", force_noise, 1e-9..=10.0),
            ("accelerometer_bias_sd_mps2", self.accelerometer_bias_sd_mps2, 1e-9..=100.0),
            ("accelerometer_bias_walk_mps2_per_sqrt_h", force_walk, 0.0..=100.0),
            ("accelerometer_range_mps2", self.accelerometer_range_mps2, 1e-6..=f64::INFINITY),
            ("mounting_sd_deg", self.mounting_sd_deg, 0.0..=MAX_MOUNTING_SD_DEG),
            ("time_offset_s", self.time_offset_s, -1e10..=1e10),
        ] {
            check_range(&format!("imu.{key}"), value, range)?;
        }
        for metres in self.position_m {
            check_range("imu.position_m", metres, -MAX_SEPARATION_M..=MAX_SEPARATION_M)?;
        }
        self.mounting_deg
            .into_iter()
            .try_for_each(|angle| check_range("imu.mounting_deg", angle, -360.0..=360.0))
    }
}

fn is_empty(path: &Path) -> bool {
    path.as_os_str().is_empty()
}

/// How the sensor sits in the body, and what its readings mean.
#[derive(Debug, Clone)]
pub(crate) struct Mounted {
    calibration: Calibration,
    body_from_imu: Matrix3<f64>,
    time_offset_s: f64,
    /// Readings at or beyond these are saturated.
    rate_range_radps: f64,
    force_range_mps2: f64,
}

/// The log of the sensor, calibrated and turned into the axes of the body.
pub(super) struct Sensor {
    reader: SensorReader,
    /// Read ahead of their time, first of all to look at the unit.
    ahead: VecDeque<SensorRow>,
    /// The one that was used last.
    before: Option<SensorRow>,
    /// Mean square of how far a rate is from the nearer one of its neighbours, rad²/s².
    departure_square: Option<f64>,
    mounted: Mounted,
}

impl Mounted {
    /// As the table says; paths are relative to `folder`.
    pub(crate) fn new(folder: &Path, config: &ImuConfig) -> anyhow::Result<Self> {
        let file = config.calibration.as_ref();
        let calibration = file.map(|file| Calibration::read(&folder.join(file))).transpose()?;
        Ok(Self {
            calibration: calibration.unwrap_or_default(),
            body_from_imu: config.body_from_imu(),
            time_offset_s: config.time_offset_s,
            rate_range_radps: config.gyro_range_degps.to_radians(),
            force_range_mps2: config.accelerometer_range_mps2,
        })
    }

    /// Whether a bias from a rest is taken off the rates.
    pub(crate) const fn has_gyro_bias(&self) -> bool {
        self.calibration.gyro_bias_radps.is_some()
    }

    /// The sample of a row, with its time.
    pub(crate) fn sample(&self, row: &SensorRow) -> (f64, ImuSample) {
        let in_body = |v: Vector3<f64>| Vector::from_xyz(self.body_from_imu * v);
        let inside = |reading: &Vector3<f64>, range: f64| reading.amax() < range;
        let rate = row.gyro.filter(|reading| inside(reading, self.rate_range_radps));
        let force = row.accelerometer.filter(|reading| inside(reading, self.force_range_mps2));
        let sample = ImuSample {
            rate_radps: rate.map(|reading| in_body(self.calibration.rate(&reading))),
            specific_force_mps2: force.map(|reading| in_body(self.calibration.force(&reading))),
            saturated: rate.is_none() || force.is_none() != row.accelerometer.is_none(),
        };
        (row.time_s + self.time_offset_s, sample)
    }
}

impl Sensor {
    pub(super) fn open(folder: &Path, config: &ImuConfig) -> anyhow::Result<Self> {
        let mounted = Mounted::new(folder, config)?;
        let path = folder.join(&config.file);
        let mut reader = SensorReader::open(&path, Backwards::Kept)?;
        if !reader.has_gyro() {
            bail!("{}: no gyro columns (gx_radps, gy_radps, gz_radps)", path.display());
        }
        let ahead: VecDeque<SensorRow> = reader.by_ref().take(gravity_check::SAMPLES).collect();
        if ahead.is_empty() {
            bail!("{}: no usable row{}", path.display(), damaged(reader.damage()));
        }
        if reader.has_accelerometer() {
            let norms = ahead.iter().filter_map(|row| Some(row.accelerometer?.norm()));
            gravity_check::refuse_other_units(norms.collect(), gravity_check::AT_REST_MPS2)?;
        }
        Ok(Self { reader, ahead, before: None, departure_square: None, mounted })
    }

    /// Whether a bias from a rest is taken off the rates.
    pub(super) const fn has_gyro_bias(&self) -> bool {
        self.mounted.has_gyro_bias()
    }

    /// Whether the log has accelerometers.
    pub(super) const fn has_accelerometer(&self) -> bool {
        self.reader.has_accelerometer()
    }

    /// What was left out so far.
    pub(super) fn damage(&self) -> &[Damage] {
        self.reader.damage()
    }

    fn read_row(&mut self) -> Option<SensorRow> {
        self.ahead.pop_front().or_else(|| self.reader.next())
    }

    /// Whether a rate is none: no body turns so from the sample before it and back to the one after it.
    fn is_glitch(&mut self, row: &SensorRow) -> bool {
        if self.ahead.is_empty() {
            self.ahead.extend(self.reader.next());
        }
        let (Some(before), Some(after)) = (self.before, self.ahead.front()) else { return false };
        let steps_s = [row.time_s - before.time_s, after.time_s - row.time_s];
        let (Some(from), Some(rate), Some(to)) = (before.gyro, row.gyro, after.gyro) else {
            return false;
        };
        if steps_s.iter().any(|step_s| *step_s <= 0.0) {
            return false;
        }
        let departure = (rate - from).norm().min((rate - to).norm());
        let square = departure * departure;
        let usual_square = *self.departure_square.get_or_insert(square);
        self.departure_square = Some(usual_square + DEPARTURE_SHARE * (square - usual_square));
        departure > MAX_ANGULAR_ACCELERATION * steps_s[0].max(steps_s[1])
            && departure > MAX_DEPARTURE * usual_square.sqrt()
    }
}

impl Iterator for Sensor {
    type Item = (f64, ImuSample);

    /// The next sample with its time, s.
    fn next(&mut self) -> Option<(f64, ImuSample)> {
        loop {
            let row = self.read_row()?;
            if self.is_glitch(&row) {
                let rate_degps = row.gyro.map_or(0.0, |rate| rate.norm().to_degrees());
                let text = format!("{rate_degps:.0} °/s in one sample alone is no turn of a body");
                self.reader.note(row.line, text);
                continue;
            }
            self.before = Some(row);
            return Some(self.mounted.sample(&row));
        }
    }
}
