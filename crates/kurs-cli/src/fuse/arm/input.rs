//! Where `kurs fuse` takes its measurements from: files, or a simulated arm.

use std::collections::VecDeque;
use std::path::Path;

use anyhow::bail;
use kurs::ephemeris::NavigationData;
use kurs::fusion::arm::RotatingArm;
use kurs::fusion::arm::ranging::Measured;
use kurs::fusion::arm::session::{ArmSample, from_forward_right_down};
use kurs::observation::AntennaEpoch;
use kurs_formats::session::SessionReader;
use kurs_formats::source::Source;
use kurs_sim::arm_recording::ArmRecording;
use nalgebra::{Matrix3, Vector3};

use super::config::{AccelerometerConfig, Config, NavConfig};
use crate::failure::UsageError;
use crate::fuse::calibration::Calibration;
use crate::fuse::gravity_check;
use crate::sensor_log::{Backwards, SensorReader};
use crate::summary::Damage;

/// A sample with its time, seconds of the week of the first epoch, in the order of the source.
pub(super) type TimedSample = (f64, ArmSample);

/// Everything that goes into the filter.
pub(super) struct Input {
    pub(super) navigation: NavigationData,
    samples: Samples,
    epochs: Epochs,
    damage: Vec<Damage>,
}

enum Epochs {
    Files(Box<SessionReader>),
    Simulated(Box<ArmRecording>),
}

/// The accelerometers, read ahead of their time, first of all to look at the unit.
struct Samples {
    ahead: VecDeque<TimedSample>,
    /// The rest of the log; `None` for a simulation, which is all ahead.
    log: Option<Log>,
}

struct Log {
    reader: SensorReader,
    correction: Correction,
    time_offset_s: f64,
    arm_angle_sd_rad: f64,
}

/// From a reading to the specific force in the body axes of the filter.
struct Correction {
    calibration: Calibration,
    body_from_mount: Matrix3<f64>,
    range_mps2: f64,
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
        let samples = Samples::open(folder, config)?;
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
            samples: Samples {
                ahead: samples.iter().map(|s| sample(s.time_s, &s.reading_mps2)).collect(),
                log: None,
            },
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

    /// The next sample of the accelerometers, unless it is later than this.
    pub(super) fn next_sample_before(&mut self, time_s: f64) -> Option<TimedSample> {
        self.samples.read_ahead(1);
        self.samples.ahead.pop_front_if(|(at_s, _)| *at_s <= time_s)
    }

    /// Refuses accelerometers whose size is not that of gravity and the arm's centripetal
    /// acceleration.
    pub(super) fn refuse_other_units(&mut self, arm: &RotatingArm) -> anyhow::Result<()> {
        self.samples.read_ahead(gravity_check::SAMPLES);
        let samples = self.samples.ahead.iter().take(gravity_check::SAMPLES);
        let turning_mps2 = arm.speed_mps() * core::f64::consts::TAU * arm.rate_hz;
        gravity_check::refuse_other_units(
            samples.filter_map(|(_, sample)| Some(sample.specific_force_mps2?.norm())).collect(),
            turning_mps2.hypot(gravity_check::AT_REST_MPS2),
        )
    }

    /// What could not be used, so far.
    pub(super) fn damage(&self) -> Vec<Damage> {
        let mut damage = self.damage.clone();
        if let Epochs::Files(reader) = &self.epochs {
            damage.extend(reader.damage().into_iter().map(|d| Damage::new(d.file, &d.damage)));
        }
        let of_log = self.samples.log.iter().flat_map(|log| log.reader.damage());
        damage.extend(of_log.cloned());
        damage
    }
}

impl Samples {
    fn open(folder: &Path, config: &Config) -> anyhow::Result<Self> {
        let AccelerometerConfig { file, time_offset_s, arm_angle_sd_deg, .. } =
            &config.accelerometer;
        let Some(file) = file else {
            return Err(UsageError("accelerometer.file: no accelerometer log".into()).into());
        };
        let path = folder.join(file);
        let reader = SensorReader::open(&path, Backwards::Kept)?;
        if !reader.has_accelerometer() {
            bail!("{}: no accelerometer columns (ax_mps2, ay_mps2, az_mps2)", path.display());
        }
        let log = Log {
            reader,
            correction: Correction::new(folder, config)?,
            time_offset_s: *time_offset_s,
            arm_angle_sd_rad: arm_angle_sd_deg.to_radians(),
        };
        Ok(Self { ahead: VecDeque::new(), log: Some(log) })
    }

    /// Reads ahead until `count` samples wait, as far as there are any.
    fn read_ahead(&mut self, count: usize) {
        let Some(log) = &mut self.log else { return };
        let missing = count.saturating_sub(self.ahead.len());
        self.ahead.extend(log.by_ref().take(missing));
    }
}

impl Iterator for Log {
    type Item = TimedSample;

    fn next(&mut self) -> Option<TimedSample> {
        let row = self.reader.next()?;
        let measured = |value| Measured { value, sd: self.arm_angle_sd_rad };
        let sample = ArmSample {
            specific_force_mps2: self.correction.apply(&row.accelerometer?),
            arm_angle_rad: row.arm_angle.map(measured),
        };
        Some((row.time_s + self.time_offset_s, sample))
    }
}

impl Correction {
    fn new(folder: &Path, config: &Config) -> anyhow::Result<Self> {
        let file = config.accelerometer.calibration.as_ref();
        let calibration = file.map(|file| Calibration::read(&folder.join(file))).transpose()?;
        let body_from_mount = config.body_from_mount();
        let range_mps2 = config.accelerometer.range_mps2;
        Ok(Self { calibration: calibration.unwrap_or_default(), body_from_mount, range_mps2 })
    }

    /// The force, turned into the body's axes; `None` for a reading at the end of the range.
    fn apply(&self, reading_mps2: &Vector3<f64>) -> Option<Vector3<f64>> {
        if reading_mps2.amax() >= self.range_mps2 {
            return None;
        }
        let in_mount = self.calibration.force(reading_mps2);
        Some(from_forward_right_down(&(self.body_from_mount * in_mount)))
    }
}
