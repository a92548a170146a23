//! Where `kurs fuse` takes its measurements from: files, or a simulated arm.

use std::path::Path;

use anyhow::{Context, bail};
use kurs::ephemeris::NavigationData;
use kurs::fusion::arm_session::{ArmSample, from_forward_right_down};
use kurs::fusion::ranging::Measured;
use kurs::observation::AntennaEpoch;
use kurs_formats::session::SessionReader;
use kurs_formats::source::Source;
use kurs_sim::arm_recording::ArmRecording;
use nalgebra::{Matrix3, Vector3};
use serde::Deserialize;

use super::config::{AccelerometerConfig, Config, NavConfig};
use crate::config_file;
use crate::failure::UsageError;
use crate::sensor_log::{Backwards, SensorLog};
use crate::summary::Damage;

/// A sample with its time, seconds of the week of the first epoch, in the order of the source.
pub(super) type TimedSample = (f64, ArmSample);

/// Everything that goes into the filter.
pub(super) struct Input {
    pub(super) navigation: NavigationData,
    pub(super) samples: Vec<TimedSample>,
    epochs: Epochs,
    damage: Vec<Damage>,
}

enum Epochs {
    Files(Box<SessionReader>),
    Simulated(Box<ArmRecording>),
}

/// The part of `calibration.toml` that is used: y = M a + b, as `kurs calibrate` writes it.
#[derive(Debug, Deserialize)]
struct CalibrationFile {
    accelerometer: Option<AccelerometerCalibration>,
}

#[derive(Debug, Deserialize)]
struct AccelerometerCalibration {
    matrix: [[f64; 3]; 3],
    bias_mps2: [f64; 3],
}

/// From a reading to the specific force in the body axes of the filter.
struct Correction {
    inverse: Matrix3<f64>,
    bias_mps2: Vector3<f64>,
    body_from_mount: Matrix3<f64>,
}

impl Input {
    /// Opens the files that the configuration in `folder` names.
    pub(super) fn open(folder: &Path, config: &Config, nav: &NavConfig) -> anyhow::Result<Self> {
        let mut damage = Vec::new();
        let mut navigation = NavigationData::default();
        for file in &nav.files {
            let path = folder.join(file);
            let mut source = Source::open(&path)?;
            let summary = kurs_formats::navigation::read(&mut source, &mut navigation)?;
            let listed = summary.damage.listed().iter();
            damage.extend(listed.map(|d| Damage::new(path.display().to_string(), d)));
        }
        if navigation.ephemerides.is_empty() {
            bail!("no usable ephemeris in the navigation files");
        }
        if config.receiver.obs.is_empty() {
            return Err(UsageError("receiver.obs: no observation file".into()).into());
        }
        let reader = SessionReader::open(config.receiver.obs.iter().map(|file| folder.join(file)))?;
        let samples = read_samples(folder, config, &mut damage)?;
        Ok(Self { navigation, samples, epochs: Epochs::Files(Box::new(reader)), damage })
    }

    /// The measurements of a simulated arm, as the files of it would give them.
    pub(super) fn simulated(
        folder: &Path,
        config: &Config,
        recording: ArmRecording,
    ) -> anyhow::Result<Self> {
        let correction = Correction::new(folder, config)?;
        let first_s = recording.start().tow_s();
        let sample = |time_s: f64, reading_mps2: &Vector3<f64>| {
            let specific_force_mps2 = correction.apply(reading_mps2);
            (first_s + time_s, ArmSample { specific_force_mps2, arm_angle_rad: None })
        };
        let samples = recording.samples();
        Ok(Self {
            navigation: recording.navigation().clone(),
            samples: samples.iter().map(|s| sample(s.time_s, &s.reading_mps2)).collect(),
            epochs: Epochs::Simulated(Box::new(recording)),
            damage: Vec::new(),
        })
    }

    /// Reads the next GNSS epoch; `false` at the end.
    pub(super) fn next_epoch(&mut self, epoch: &mut AntennaEpoch) -> anyhow::Result<bool> {
        match &mut self.epochs {
            Epochs::Files(reader) => Ok(reader.next_epoch(epoch)?),
            Epochs::Simulated(recording) => Ok(recording.next_epoch(epoch)),
        }
    }

    /// What could not be used, so far.
    pub(super) fn damage(&self) -> Vec<Damage> {
        let mut damage = self.damage.clone();
        if let Epochs::Files(reader) = &self.epochs {
            damage.extend(reader.damage().into_iter().map(|d| Damage::new(d.file, &d.damage)));
        }
        damage
    }
}

fn read_samples(
    folder: &Path,
    config: &Config,
    damage: &mut Vec<Damage>,
) -> anyhow::Result<Vec<TimedSample>> {
    let AccelerometerConfig { file, time_offset_s, arm_angle_sd_deg, .. } = &config.accelerometer;
    let Some(file) = file else {
        return Err(UsageError("accelerometer.file: no accelerometer log".into()).into());
    };
    let path = folder.join(file);
    let mut log = SensorLog::read(&path, Backwards::Kept)?;
    if log.accelerometer.is_empty() {
        bail!("{}: no accelerometer columns (ax_mps2, ay_mps2, az_mps2)", path.display());
    }
    damage.append(&mut log.damage);
    let correction = Correction::new(folder, config)?;
    let sd = arm_angle_sd_deg.to_radians();
    let samples = log.accelerometer.iter().zip(&log.time_s).enumerate();
    Ok(samples
        .map(|(k, (reading_mps2, time_s))| {
            let measured = |value: &f64| Measured { value: *value, sd };
            let sample = ArmSample {
                specific_force_mps2: correction.apply(reading_mps2),
                arm_angle_rad: log.arm_angle.get(k).map(measured),
            };
            (time_s + time_offset_s, sample)
        })
        .collect())
}

impl Correction {
    fn new(folder: &Path, config: &Config) -> anyhow::Result<Self> {
        let body_from_mount = config.body_from_mount();
        let Some(file) = &config.accelerometer.calibration else {
            let (inverse, bias_mps2) = (Matrix3::identity(), Vector3::zeros());
            return Ok(Self { inverse, bias_mps2, body_from_mount });
        };
        let path = folder.join(file);
        let read: CalibrationFile = config_file::read(&path)?;
        let Some(found) = read.accelerometer else {
            bail!("{}: no table [accelerometer]", path.display());
        };
        let matrix = Matrix3::from_fn(|row, column| found.matrix[row][column]);
        let inverse = matrix
            .try_inverse()
            .with_context(|| format!("{}: accelerometer.matrix has no inverse", path.display()))?;
        Ok(Self { inverse, bias_mps2: found.bias_mps2.into(), body_from_mount })
    }

    /// a = M⁻¹ (y − b), turned into the body's axes.
    fn apply(&self, reading_mps2: &Vector3<f64>) -> Vector3<f64> {
        let in_mount = self.inverse * (reading_mps2 - self.bias_mps2);
        from_forward_right_down(&(self.body_from_mount * in_mount))
    }
}
