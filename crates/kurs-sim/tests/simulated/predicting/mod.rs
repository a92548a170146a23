//! Antennas with a gyro, solved with the attitude that the filter predicts and without: what the test and
//! the experiment share.
#![allow(dead_code)] // every user needs a part

use kurs::engine::{Constraint, Engine, PredictedAttitude, Settings};
use kurs::ephemeris::NavigationData;
use kurs::frames::{Rotation, Vector};
use kurs::fusion::attitude::filter::InertialSettings;
use kurs::fusion::attitude::session::{AttitudeSession, AttitudeSessionSettings, ImuSample};
use kurs::fusion::kalman::Gate;
use kurs::observation::ArrayEpoch;
use kurs::solution::{EpochSolution, PredictionRole, Status};
use kurs_sim::imu::ImuReading;
use kurs_sim::scenario::{Imu, Outage, Scenario};
use kurs_sim::simulation::{Attachments, SimulatedEpoch, Simulation};
use nalgebra::{Rotation3, Vector3};

use crate::solving::{self, Integers, TrueCycles};

/// End of the ten seconds without satellites, between two epochs.
pub(crate) const OUTAGE_ENDS_S: f64 = 70.1;
/// When a gyro that errs for a time does so.
pub(crate) const JOLT_S: core::ops::Range<f64> = 30.0..40.0;
/// One degree an hour, in rad/s.
const DEGREE_PER_HOUR: f64 = core::f64::consts::PI / 180.0 / 3600.0;

/// Scenarios whose epochs are often too weak to be fixed alone.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Case {
    /// Two antennas a metre apart, GPS L1 of six satellites.
    SixSatellites,
    /// Two antennas a metre apart, GPS L1 of seven satellites.
    SevenSatellites,
    /// The car between houses, four antennas, L1 and E1, reflections.
    Urban,
    /// A car with three antennas, GPS and Galileo on L1, that loses all satellites from 60 s to 70 s and
    /// has two thirds of those of GPS back for 20 s.
    Outage,
}

impl Case {
    pub(crate) const ALL: [Self; 4] =
        [Self::SixSatellites, Self::SevenSatellites, Self::Urban, Self::Outage];

    pub(crate) const fn name(self) -> &'static str {
        match self {
            Self::SixSatellites => "two antennas, six satellites, G1",
            Self::SevenSatellites => "two antennas, seven satellites, G1",
            Self::Urban => "urban, G1 and E1",
            Self::Outage => "three antennas, outage, G1 and E1",
        }
    }

    /// The scenario with a gyro of 10°/h and 0.1°/√h.
    pub(crate) fn scenario(self, seed: u64) -> Scenario {
        let (name, systems): (_, &[&str]) = match self {
            Self::SixSatellites | Self::SevenSatellites => ("few-satellites", &["G"]),
            Self::Urban => ("urban", &["G", "E"]),
            Self::Outage => ("car", &["G", "E"]),
        };
        let mut scenario = solving::ready(name);
        scenario.seed += 1000 * seed;
        scenario.start = format!("2024-03-10T{:02}:00:00", (12 + 5 * seed) % 24);
        scenario.interval_s = 0.5;
        scenario.sky.systems = systems.iter().map(|s| (*s).to_owned()).collect();
        scenario.signals = systems.iter().map(|s| format!("{s}1C")).collect();
        scenario.body[0].imu = Some(Imu {
            gyro_bias_degph: [10.0, -8.0, 6.0],
            gyro_noise_deg_per_sqrt_h: 0.1,
            accelerometer_bias_mps2: [0.02, -0.03, 0.01],
            ..Imu::default()
        });
        match self {
            Self::SixSatellites => scenario.sky.max_satellites = Some(6),
            Self::SevenSatellites => scenario.sky.max_satellites = Some(7),
            Self::Urban => {}
            Self::Outage => {
                scenario.body[0].antenna.truncate(3);
                let gone = (1..=24).map(|n| format!("E{n:02}"));
                let a_third = (1..=24).step_by(3).map(|n| format!("G{n:02}"));
                scenario.outage = vec![
                    outage(OUTAGE_ENDS_S - 10.0, OUTAGE_ENDS_S, Vec::new()),
                    outage(OUTAGE_ENDS_S, OUTAGE_ENDS_S + 20.0, gone.chain(a_third).collect()),
                ];
            }
        }
        scenario
    }
}

fn outage(from_s: f64, to_s: f64, satellites: Vec<String>) -> Outage {
    Outage { from_s, to_s, antennas: Vec::new(), satellites, bands: Vec::new() }
}

/// What is wrong with the predictions on purpose.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Fault {
    /// Nothing.
    None,
    /// The gyro shows so much more than the body turns about the vertical, °/s.
    GyroBias(f64),
    /// The gyro shows so much more about the vertical, °/s, from [`JOLT_S`] on.
    GyroJolt(f64),
    /// The predicted heading is off by so much, degrees, and trusted from the first epoch on.
    Heading(f64),
}

/// One epoch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Judged {
    /// From the start.
    pub(crate) time_s: f64,
    pub(crate) status: Status,
    pub(crate) integers: Integers,
    pub(crate) prediction: Option<PredictionRole>,
}

impl Judged {
    fn new(time_s: f64, row: &EpochSolution, cycles: &TrueCycles) -> Self {
        Self {
            time_s,
            status: row.status(),
            integers: cycles.judge(solving::sums(row)),
            prediction: row.prediction(),
        }
    }

    pub(crate) fn is_decided(&self) -> bool {
        self.is_fixed() && self.prediction == Some(PredictionRole::Decided)
    }

    pub(crate) fn is_refused(&self) -> bool {
        self.prediction == Some(PredictionRole::Refused)
    }

    /// Whether code determines the baselines.
    pub(crate) fn is_solved(&self) -> bool {
        self.status != Status::Lost
    }

    pub(crate) fn is_fixed(&self) -> bool {
        self.status == Status::Fixed
    }

    pub(crate) fn is_wrong(&self) -> bool {
        self.is_fixed() && self.integers != Integers::Right
    }
}

/// Every epoch without a prediction and with it, for the same observations.
pub(crate) fn solve(scenario: Scenario, fault: Fault) -> Vec<[Judged; 2]> {
    let constraint =
        if scenario.body[0].antenna.len() == 2 { Constraint::Length } else { Constraint::Array };
    let settings = solving::settings(&scenario, constraint);
    let mut simulation = Simulation::new(scenario, &Attachments::default()).unwrap();
    let navigation = simulation.navigation().clone();
    let mut alone = Engine::new(settings.clone(), navigation.clone()).unwrap();
    let mut chain = Chain::new(settings, navigation, &simulation, fault);
    let mut cycles = TrueCycles::of(simulation.scenario());
    let mut epoch = SimulatedEpoch::default();
    let mut judged = Vec::with_capacity(simulation.epochs());
    let start = simulation.start();
    while simulation.next_epoch(&mut epoch) {
        cycles.take(&epoch);
        let observed = &epoch.bodies[0].observed;
        let rows = [alone.push(observed), chain.push(observed)];
        judged.push(rows.map(|row| Judged::new(row.time - start, &row, &cycles)));
    }
    judged
}

/// Engine, filter and sensor.
struct Chain {
    engine: Engine,
    session: AttitudeSession,
    samples: core::iter::Peekable<std::vec::IntoIter<(f64, ImuSample)>>,
    fault: Fault,
}

impl Chain {
    fn new(
        settings: Settings,
        navigation: NavigationData,
        simulation: &Simulation,
        fault: Fault,
    ) -> Self {
        let bias_degps = |time_s: f64| match fault {
            Fault::GyroBias(degps) => degps,
            Fault::GyroJolt(degps) if JOLT_S.contains(&time_s) => degps,
            _ => 0.0,
        };
        let start_s = simulation.start().tow_s();
        let sample = |reading: ImuReading| {
            let bias_radps = Vector3::z() * bias_degps(reading.time_s).to_radians();
            let sample = ImuSample {
                rate_radps: Some(Vector::from_xyz(reading.rate_radps + bias_radps)),
                specific_force_mps2: Some(Vector::from_xyz(reading.specific_force_mps2)),
                saturated: false,
            };
            (start_s + reading.time_s, sample)
        };
        let samples: Vec<_> = simulation.imu(0).unwrap().map(sample).collect();
        Self {
            engine: Engine::new(settings, navigation).unwrap(),
            session: AttitudeSession::new(session_settings()),
            samples: samples.into_iter().peekable(),
            fault,
        }
    }

    /// The row of the engine, as the filter gets it.
    fn push(&mut self, epoch: &ArrayEpoch) -> EpochSolution {
        let time_s = self.session.seconds(epoch.time);
        while let Some((at_s, sample)) = self.samples.next_if(|(at_s, _)| *at_s <= time_s) {
            self.session.push_sample(at_s, sample).unwrap();
            while self.session.next_row().is_some() {}
        }
        let predicted = self.session.predict(epoch.time, self.samples.peek().copied());
        let predicted = predicted.map(|predicted| self.spoilt(predicted));
        let row = self.engine.push_predicted(epoch, predicted.as_ref());
        self.session.push_row(row.clone()).unwrap();
        row
    }

    fn spoilt(&self, predicted: PredictedAttitude) -> PredictedAttitude {
        let Fault::Heading(off_deg) = self.fault else { return predicted };
        let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), off_deg.to_radians());
        let matrix = turn.into_inner() * predicted.ned_from_body.matrix();
        PredictedAttitude {
            ned_from_body: Rotation::from_matrix(matrix),
            may_decide: true,
            ..predicted
        }
    }
}

/// As of `kurs fuse`.
fn session_settings() -> AttitudeSessionSettings {
    AttitudeSessionSettings {
        inertial: InertialSettings {
            gyro_noise: 0.1f64.to_radians() / 60.0,
            gyro_bias_sd_radps: 10.0 * DEGREE_PER_HOUR,
            gyro_bias_walk: DEGREE_PER_HOUR / 60.0,
            accelerometer_noise: 0.002,
            accelerometer_bias_sd_mps2: 0.05,
            accelerometer_bias_walk: 0.01 / 60.0,
            mounting_sd_rad: 0.0,
            unknown_acceleration: 1.0,
            gate: Gate::Innovation { sigmas: 5.0 },
        },
        use_float: true,
        velocity_sd_mps: Some(0.1),
        lever_arm_m: Vector::new(0.0, 0.0, 0.0),
        correlation_s: 1.0,
        first_angle_sd_rad: 5f64.to_radians(),
        place: None,
        order_window_s: 0.2,
        smooth: false,
    }
}
