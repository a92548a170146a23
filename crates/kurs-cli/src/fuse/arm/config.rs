//! The configuration of `kurs fuse`.

use std::path::{Path, PathBuf};

use kurs::fusion::arm::attitude_form::AttitudeForm;
use kurs::fusion::arm::filter::{ArmFilterSettings, Drift};
use kurs::fusion::arm::nhe::{Angles, frd_from_bfs};
use kurs::fusion::arm::process_noise::{Densities, ProcessNoise, Tuning};
use kurs::fusion::arm::reception::ReceptionSettings;
use kurs::fusion::arm::session::SessionSettings;
use kurs::fusion::arm::{RotatingArm, Triad};
use kurs::fusion::kalman::Gate;
use kurs::signal::System;
use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

use crate::failure::UsageError;
use crate::fuse::attitude;
use crate::pipe;

/// `kurs fuse CONFIG.toml`: either `[nav]` with the files of `[receiver]` and `[accelerometer]`, or
/// `[simulate]`.
#[derive(Debug, Clone, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Config {
    pub(super) arm: ArmConfig,
    #[serde(default)]
    pub(super) receiver: ReceiverConfig,
    #[serde(default)]
    pub(super) accelerometer: AccelerometerConfig,
    #[serde(default)]
    pub(super) filter: FilterConfig,
    #[serde(default)]
    pub(super) start: StartConfig,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) nav: Option<NavConfig>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) simulate: Option<SimulateConfig>,
}

#[derive(Debug, Clone, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub(super) struct ArmConfig {
    pub(super) radius_m: f64,
    /// Turns a second, from forward towards up.
    pub(super) rate_hz: f64,
    /// Angle at second of week zero.
    #[serde(default)]
    pub(super) phase_deg: f64,
    /// 1-sigma of that angle; above zero the filter estimates a correction.
    #[serde(default)]
    pub(super) phase_sd_deg: f64,
    /// How fast the correction wanders, degrees in √s.
    #[serde(default)]
    pub(super) phase_drift_deg: f64,
    /// Centre of rotation, body axes.
    #[serde(default)]
    pub(super) centre_m: [f64; 3],
    /// Heading, pitch, roll of the arm and its accelerometers against the body.
    #[serde(default)]
    pub(super) mounting_deg: [f64; 3],
    /// Whether the accelerometers turn with the arm instead of being held parallel.
    #[serde(default)]
    pub(super) accelerometers_turn: bool,
}

#[derive(Debug, Clone, Deserialize, Serialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct ReceiverConfig {
    /// Observation files in time order.
    pub(super) obs: Vec<PathBuf>,
    /// Letter of the one system that is used: the filter has one clock.
    pub(super) system: char,
    pub(super) elevation_mask_deg: f64,
    pub(super) pseudorange_sd_m: f64,
    pub(super) range_rate_sd_mps: f64,
    /// 0: carrier phases are not used.
    pub(super) phase_sd_m: f64,
}

#[derive(Debug, Clone, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub(super) struct NavConfig {
    pub(super) files: Vec<PathBuf>,
}

#[derive(Debug, Clone, Deserialize, Serialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct AccelerometerConfig {
    /// CSV log; `time_s` is the GPS second of week.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) file: Option<PathBuf>,
    /// Result of `kurs calibrate`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) calibration: Option<PathBuf>,
    /// Added to the times of the log.
    pub(super) time_offset_s: f64,
    pub(super) sd_mps2: f64,
    /// Readings at or beyond it are saturated.
    pub(super) range_mps2: f64,
    /// Above zero biases are states of the filter.
    pub(super) bias_sd_mps2: f64,
    /// Standard deviation of the column `arm_deg`.
    pub(super) arm_angle_sd_deg: f64,
}

#[derive(Debug, Clone, Deserialize, Serialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct FilterConfig {
    pub(super) tuning: String,
    /// 17, or 20 with angular accelerations.
    pub(super) states: u8,
    pub(super) attitude: AttitudeWord,
    pub(super) gate_sigmas: f64,
    /// Equation (15) of the paper; harmful.
    pub(super) adaptive: bool,
    /// Whether the variance of linearisation is added to the measurements'.
    pub(super) second_order: bool,
    /// Spectral densities instead of those of the tuning.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) jerk_m2_per_s5: Option<f64>,
    /// With 17 states in rad²/s³, with 20 in rad²/s⁵.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) turning_density: Option<f64>,
    /// Measurements that come later than others by up to this are put in their place.
    pub(super) order_window_s: f64,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum AttitudeWord {
    Euler,
    Quaternion,
}

#[derive(Debug, Clone, Deserialize, Serialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct StartConfig {
    pub(super) heading_deg: f64,
    pub(super) pitch_deg: f64,
    pub(super) roll_deg: f64,
    pub(super) heading_sd_deg: f64,
    pub(super) tilt_sd_deg: f64,
    pub(super) rate_sd_degps: f64,
}

#[derive(Debug, Clone, Deserialize, Serialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct SimulateConfig {
    pub(super) seed: u64,
    /// First epoch on the GPS scale.
    pub(super) start: String,
    pub(super) duration_s: f64,
    pub(super) gnss_interval_s: f64,
    pub(super) sample_interval_s: f64,
    pub(super) course: CourseWord,
    pub(super) speed_mps: f64,
    /// Before and after the turn by 30° that begins at 20 s.
    pub(super) heading_deg: f64,
    pub(super) pitch_deg: f64,
    pub(super) roll_deg: f64,
    /// The accelerometers read matrix × truth + bias + noise of `accelerometer.sd_mps2`.
    pub(super) matrix: [[f64; 3]; 3],
    pub(super) bias_mps2: [f64; 3],
}

/// What the body does in a simulation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum CourseWord {
    /// It stands.
    Standing,
    /// Straight at a constant speed whatever the heading.
    Uniform,
    /// Its velocity follows the heading.
    Along,
}

impl Default for ReceiverConfig {
    fn default() -> Self {
        Self {
            obs: Vec::new(),
            system: 'G',
            elevation_mask_deg: 10.0,
            pseudorange_sd_m: 3.0,
            range_rate_sd_mps: 0.1,
            phase_sd_m: 0.0,
        }
    }
}

impl Default for AccelerometerConfig {
    fn default() -> Self {
        Self {
            file: None,
            calibration: None,
            time_offset_s: 0.0,
            sd_mps2: 0.01,
            range_mps2: f64::INFINITY,
            bias_sd_mps2: 0.0,
            arm_angle_sd_deg: 0.1,
        }
    }
}

impl Default for FilterConfig {
    fn default() -> Self {
        Self {
            tuning: Tuning::default().word().to_owned(),
            states: 17,
            attitude: AttitudeWord::Quaternion,
            gate_sigmas: 5.0,
            adaptive: false,
            second_order: true,
            jerk_m2_per_s5: None,
            turning_density: None,
            order_window_s: 0.2,
        }
    }
}

impl Default for StartConfig {
    fn default() -> Self {
        Self {
            heading_deg: 0.0,
            pitch_deg: 0.0,
            roll_deg: 0.0,
            heading_sd_deg: 30.0,
            tilt_sd_deg: 5.0,
            rate_sd_degps: 2.0,
        }
    }
}

impl Default for SimulateConfig {
    fn default() -> Self {
        Self {
            seed: 0,
            start: "2026-03-10T00:00:00".to_owned(),
            duration_s: 40.0,
            gnss_interval_s: 0.1,
            sample_interval_s: 0.01,
            course: CourseWord::Uniform,
            speed_mps: 20.0,
            heading_deg: 30.0,
            pitch_deg: 0.0,
            roll_deg: 0.0,
            matrix: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            bias_mps2: [0.0; 3],
        }
    }
}

impl Config {
    /// The configuration itself and every file that it names.
    pub(super) fn inputs(&self, configuration: &Path) -> Vec<PathBuf> {
        let folder = pipe::folder_of(configuration);
        let navigation = self.nav.iter().flat_map(|nav| &nav.files);
        let named = self.receiver.obs.iter().chain(navigation).chain(&self.accelerometer.file);
        [configuration.to_owned()].into_iter().chain(named.map(|file| folder.join(file))).collect()
    }

    /// The session that the configuration describes.
    pub(super) fn session(&self) -> Result<SessionSettings, UsageError> {
        self.check()?;
        let (receiver, start) = (&self.receiver, &self.start);
        let letter = u8::try_from(receiver.system).unwrap_or_default();
        let system = System::from_letter(letter).ok_or_else(|| {
            let found = receiver.system;
            UsageError(format!("receiver.system: `{found}` found, G, R, E, C or J expected"))
        })?;
        Ok(SessionSettings {
            filter: self.filter_settings()?,
            reception: ReceptionSettings {
                elevation_mask_rad: receiver.elevation_mask_deg.to_radians(),
                pseudorange_sd_m: receiver.pseudorange_sd_m,
                range_rate_sd_mps: receiver.range_rate_sd_mps,
                phase_sd_m: (receiver.phase_sd_m > 0.0).then_some(receiver.phase_sd_m),
            },
            system,
            angles: Angles::from_attitude(&attitude([
                start.heading_deg,
                start.pitch_deg,
                start.roll_deg,
            ])),
            tilt_sd_rad: start.tilt_sd_deg.to_radians(),
            heading_sd_rad: start.heading_sd_deg.to_radians(),
            rate_sd_radps: start.rate_sd_degps.to_radians(),
            order_window_s: self.filter.order_window_s,
        })
    }

    fn filter_settings(&self) -> Result<ArmFilterSettings, UsageError> {
        /// Satellites whose phases are carried at once.
        const AMBIGUITY_SLOTS: usize = 16;
        /// A bias moves by 1 mm/s² in a minute.
        const BIAS_DENSITY: f64 = 1e-6 / 60.0;
        let (arm, filter, accelerometer) = (&self.arm, &self.filter, &self.accelerometer);
        let known = Tuning::ALL.iter().find(|tuning| tuning.word() == filter.tuning);
        let tuning = known.ok_or_else(|| {
            let words: Vec<&str> = Tuning::ALL.iter().map(|tuning| tuning.word()).collect();
            let found = &filter.tuning;
            UsageError(format!("filter.tuning: `{found}` found, {} expected", words.join(", ")))
        })?;
        let angular_acceleration = filter.states == 20;
        let densities = tuning.densities(angular_acceleration);
        let drift =
            |initial_sd: f64, density| (initial_sd > 0.0).then_some(Drift { initial_sd, density });
        let drift_rad = arm.phase_drift_deg.to_radians();
        Ok(ArmFilterSettings {
            form: match filter.attitude {
                AttitudeWord::Euler => AttitudeForm::Euler,
                AttitudeWord::Quaternion => AttitudeForm::Quaternion,
            },
            angular_acceleration,
            process_noise: ProcessNoise::Continuous(Densities {
                jerk: filter.jerk_m2_per_s5.unwrap_or(densities.jerk),
                turning: filter.turning_density.unwrap_or(densities.turning),
                ..densities
            }),
            adaptive: filter.adaptive,
            second_order: filter.second_order,
            gate: Gate::Innovation { sigmas: filter.gate_sigmas },
            accelerometer_sd_mps2: accelerometer.sd_mps2,
            bias: drift(accelerometer.bias_sd_mps2, BIAS_DENSITY),
            arm_angle: drift(arm.phase_sd_deg.to_radians(), drift_rad * drift_rad),
            ambiguity_slots: if self.receiver.phase_sd_m > 0.0 { AMBIGUITY_SLOTS } else { 0 },
            ..ArmFilterSettings::new(self.arm())
        })
    }

    fn arm(&self) -> RotatingArm {
        let bfs_from_frd = frd_from_bfs().transpose();
        let arm = &self.arm;
        RotatingArm {
            phase_rad: arm.phase_deg.to_radians(),
            centre_m: bfs_from_frd * Vector3::from(arm.centre_m),
            body_from_arm: bfs_from_frd * self.body_from_mount() * frd_from_bfs(),
            triad: if arm.accelerometers_turn { Triad::TurnsWithArm } else { Triad::HeldParallel },
            ..RotatingArm::new(arm.radius_m, arm.rate_hz)
        }
    }

    /// Body axes from those of the arm's housing, both forward, right, down.
    pub(super) fn body_from_mount(&self) -> Matrix3<f64> {
        attitude(self.arm.mounting_deg).ned_from_body().matrix()
    }

    fn check(&self) -> Result<(), UsageError> {
        let (filter, start, accelerometer) = (&self.filter, &self.start, &self.accelerometer);
        let positive = [
            ("arm.radius_m", self.arm.radius_m),
            ("filter.gate_sigmas", filter.gate_sigmas),
            ("filter.jerk_m2_per_s5", filter.jerk_m2_per_s5.unwrap_or(1.0)),
            ("filter.turning_density", filter.turning_density.unwrap_or(1.0)),
            ("accelerometer.sd_mps2", accelerometer.sd_mps2),
            ("accelerometer.range_mps2", accelerometer.range_mps2),
            ("accelerometer.arm_angle_sd_deg", accelerometer.arm_angle_sd_deg),
            ("receiver.pseudorange_sd_m", self.receiver.pseudorange_sd_m),
            ("receiver.range_rate_sd_mps", self.receiver.range_rate_sd_mps),
            ("start.heading_sd_deg", start.heading_sd_deg),
            ("start.tilt_sd_deg", start.tilt_sd_deg),
            ("start.rate_sd_degps", start.rate_sd_degps),
        ];
        if let Some((key, value)) = positive.iter().find(|(_, v)| v.is_nan() || *v <= 0.0) {
            return Err(UsageError(format!("{key}: {value} found, more than 0 expected")));
        }
        let not_negative = [
            ("filter.order_window_s", filter.order_window_s),
            ("receiver.phase_sd_m", self.receiver.phase_sd_m),
            ("accelerometer.bias_sd_mps2", accelerometer.bias_sd_mps2),
            ("arm.phase_sd_deg", self.arm.phase_sd_deg),
            ("arm.phase_drift_deg", self.arm.phase_drift_deg),
        ];
        if let Some((key, value)) = not_negative.iter().find(|(_, v)| v.is_nan() || *v < 0.0) {
            return Err(UsageError(format!("{key}: {value} found, 0 or more expected")));
        }
        // An arm that does not turn does not show the attitude.
        if !(0.01..=100.0).contains(&self.arm.rate_hz.abs()) {
            let found = self.arm.rate_hz;
            let text = format!("arm.rate_hz: {found} found, 0.01 to 100 turns a second expected");
            return Err(UsageError(format!("{text}, either way round")));
        }
        match filter.states {
            17 | 20 => Ok(()),
            found => Err(UsageError(format!("filter.states: {found} found, 17 or 20 expected"))),
        }
    }
}
