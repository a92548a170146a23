//! What a user with a rotating arm would have recorded: observations of the antenna at its end, as
//! [`Simulation`] makes them for any antenna, and samples of the accelerometers.

use kurs::ephemeris::NavigationData;
use kurs::frames::{Geodetic, Vector};
use kurs::observation::AntennaEpoch;
use kurs::signal::SPEED_OF_LIGHT_MPS;
use kurs::time::GpsTime;
use nalgebra::{Matrix3, Vector3};

use crate::motion::RecordedPose;
use crate::noise::Noise;
use crate::rotating_arm::{ArmScenario, ArmTruth};
use crate::scenario::{
    Antenna, Atmosphere, Body, Law, MotionPlan, Multipath, NoiseLaw, Output, Place, RandomSlips,
    ReceiverClocks, Scenario, Sky,
};
use crate::scenario_error::ScenarioError;
use crate::simulation::{Attachments, SimulatedEpoch, Simulation};

/// The antenna's way is given to the simulation at this interval; the cubic between is good to
/// 1 µm and 0.2 mm/s on an arm of 1 m and 1 Hz.
const TRUTH_STEP_S: f64 = 0.002;
/// The way begins a little before the first epoch, whose receiver clock may be late.
const LEAD_SAMPLES: usize = 5;
/// User of the seed besides those of [`Simulation`].
const ACCELEROMETERS: u64 = 500;

/// What the accelerometers make of the truth: y = M a + b + noise, a along their own axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AccelerometerErrors {
    /// Their axes, forward, right, down, from those of the body.
    pub mount_from_body: Matrix3<f64>,
    /// M.
    pub matrix: Matrix3<f64>,
    /// b, m/s².
    pub bias_mps2: Vector3<f64>,
    /// 1 σ of a sample.
    pub sd_mps2: f64,
}

/// What is recorded.
#[derive(Debug, Clone, PartialEq)]
pub struct ArmRecordingPlan {
    /// The motion; its phase is the arm's angle at the first epoch.
    pub arm: ArmScenario,
    /// First epoch on the GPS scale, `2024-03-10T12:00:00`.
    pub start: String,
    /// How long.
    pub duration_s: f64,
    /// Time between GNSS epochs.
    pub gnss_interval_s: f64,
    /// Time between samples of the accelerometers.
    pub sample_interval_s: f64,
    /// Signals of the receiver, RINEX codes with the letter of the system.
    pub signals: Vec<String>,
    /// Pseudorange noise, 1 σ.
    pub pseudorange_sd_m: f64,
    /// Range rate noise, 1 σ.
    pub range_rate_sd_mps: f64,
    /// Of the accelerometers.
    pub accelerometers: AccelerometerErrors,
    /// Of every random number.
    pub seed: u64,
}

/// A recording in the making.
#[derive(Debug, Clone)]
pub struct ArmRecording {
    plan: ArmRecordingPlan,
    simulation: Simulation,
    truths: Vec<ArmTruth>,
    made: SimulatedEpoch,
}

/// A sample of the accelerometers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AccelerometerSample {
    /// True time, from the start of the recording.
    pub time_s: f64,
    /// Reading, along their own axes.
    pub reading_mps2: Vector3<f64>,
}

impl ArmRecording {
    /// Prepares a recording.
    ///
    /// # Errors
    ///
    /// [`ScenarioError`] names what cannot be.
    pub fn new(plan: ArmRecordingPlan) -> Result<Self, ScenarioError> {
        check("sample_interval_s", plan.sample_interval_s)?;
        check("duration_s", plan.duration_s)?;
        let samples = count(plan.duration_s, TRUTH_STEP_S) + 2 * LEAD_SAMPLES;
        let lead_s = LEAD_SAMPLES as f64 * TRUTH_STEP_S;
        let truths = plan.arm.run_from(-lead_s, TRUTH_STEP_S, samples);
        let poses = truths.iter().enumerate();
        let poses = poses.map(|(k, truth)| pose(k as f64 * TRUTH_STEP_S - lead_s, truth)).collect();
        let attachments = Attachments { navigation: None, recorded: vec![Some(poses)] };
        let simulation = Simulation::new(scenario(&plan), &attachments)?;
        Ok(Self { plan, simulation, truths, made: SimulatedEpoch::default() })
    }

    /// Time tag of the first epoch.
    #[must_use]
    pub const fn start(&self) -> GpsTime {
        self.simulation.start()
    }

    /// The broadcast ephemerides that belong to the observations.
    #[must_use]
    pub const fn navigation(&self) -> &NavigationData {
        self.simulation.navigation()
    }

    /// Signals of the receiver.
    #[must_use]
    pub fn signals(&self) -> &[String] {
        &self.plan.signals
    }

    /// Makes the next epoch of the receiver; `false` at the end.
    pub fn next_epoch(&mut self, epoch: &mut AntennaEpoch) -> bool {
        if !self.simulation.next_epoch(&mut self.made) {
            return false;
        }
        let observed = self.made.bodies[0].observed.antennas[0].take();
        *epoch = observed.unwrap_or_default();
        true
    }

    /// Error of the receiver clock at the last epoch: its tag minus true time.
    #[must_use]
    pub fn clock_s(&self) -> f64 {
        self.made.bodies.first().and_then(|body| body.truth.clocks_s.first()).map_or(0.0, |c| *c)
    }

    /// The truth nearest to a time from the start.
    #[must_use]
    pub fn truth(&self, time_s: f64) -> &ArmTruth {
        let nearest = (time_s / TRUTH_STEP_S).round().max(-(LEAD_SAMPLES as f64));
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // not negative
        let index = (nearest + LEAD_SAMPLES as f64) as usize;
        &self.truths[index.min(self.truths.len() - 1)]
    }

    /// Every sample of the accelerometers.
    #[must_use]
    pub fn samples(&self) -> Vec<AccelerometerSample> {
        let mut noise = Noise::stream(self.plan.seed, ACCELEROMETERS);
        let errors = &self.plan.accelerometers;
        let mount_from_bfs = errors.mount_from_body * kurs::fusion::arm::nhe::frd_from_bfs();
        let step_s = self.plan.sample_interval_s;
        let truths = self.plan.arm.run_from(0.0, step_s, count(self.plan.duration_s, step_s));
        truths
            .iter()
            .enumerate()
            .map(|(k, truth)| {
                let time_s = k as f64 * step_s;
                let felt_mps2 = mount_from_bfs * truth.specific_force_mps2;
                let noise_mps2 = noise.normal3(errors.sd_mps2);
                let reading_mps2 = errors.matrix * felt_mps2 + errors.bias_mps2 + noise_mps2;
                AccelerometerSample { time_s, reading_mps2 }
            })
            .collect()
    }
}

/// Between a tenth of a millisecond and an hour.
fn check(key: &str, value_s: f64) -> Result<(), ScenarioError> {
    let problem = || ScenarioError::new(key, format!("{value_s} must be between 0.0001 and 3600"));
    (1e-4..=3600.0).contains(&value_s).then_some(()).ok_or_else(problem)
}

/// How many samples from zero to the end, both included.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // checked by the simulation
fn count(duration_s: f64, interval_s: f64) -> usize {
    (duration_s / interval_s + 1e-6).floor() as usize + 1
}

fn place(at: &Geodetic) -> Place {
    Place {
        latitude_deg: at.latitude_rad.to_degrees(),
        longitude_deg: at.longitude_rad.to_degrees(),
        height_m: at.height_m,
    }
}

/// The antenna as the origin of a body that turns like the true one.
fn pose(time_s: f64, truth: &ArmTruth) -> RecordedPose {
    let antenna = Geodetic::from_ecef(Vector::from_xyz(truth.antenna_m));
    // The paper counts roll and pitch the other way round.
    let [roll, pitch, heading] = truth.angles_rad.map(f64::to_degrees).into();
    RecordedPose { time_s, place: place(&antenna), angles_deg: [heading, -pitch, -roll] }
}

fn scenario(plan: &ArmRecordingPlan) -> Scenario {
    const L1_WAVELENGTH_M: f64 = SPEED_OF_LIGHT_MPS / 1_575.42e6;
    let antenna = Antenna {
        name: "ARM".to_owned(),
        position_m: [0.0; 3],
        signals: None,
        tag_offset_s: 0.0,
        turned_deg: 0.0,
        mask_deg: Vec::new(),
    };
    let systems = plan.signals.iter().filter_map(|signal| signal.get(..1)).map(str::to_owned);
    let mut systems: Vec<String> = systems.collect();
    systems.dedup();
    Scenario {
        seed: plan.seed,
        start: plan.start.clone(),
        duration_s: plan.duration_s,
        interval_s: plan.gnss_interval_s,
        signals: plan.signals.clone(),
        array_sd_m: 0.0,
        sky: Sky { systems, ..Sky::default() },
        clock: ReceiverClocks::default(),
        noise: NoiseLaw {
            law: Law::Flat,
            code_sd_m: plan.pseudorange_sd_m,
            doppler_sd_hz: plan.range_rate_sd_mps / L1_WAVELENGTH_M,
            ..NoiseLaw::default()
        },
        multipath: Multipath::default(),
        // A quiet night: what receivers assume without broadcast parameters.
        atmosphere: Atmosphere { ionosphere_zenith_m: 1.5, ..Atmosphere::default() },
        slips: RandomSlips::default(),
        body: vec![Body {
            name: "arm".to_owned(),
            motion: MotionPlan::Recorded { file: "the way of the antenna".to_owned() },
            antenna: vec![antenna],
            imu: None,
        }],
        station: None,
        outage: Vec::new(),
        interference: Vec::new(),
        slip: Vec::new(),
        bias: Vec::new(),
        wall: Vec::new(),
        canopy: Vec::new(),
        output: Output::default(),
    }
}
