//! Many seeded runs of a rotating-arm filter over the reference scenario, and what they come to.

use kurs::fusion::arm::RotatingArm;
use kurs::fusion::arm::as_published::filter::PublishedFilter;
use kurs::fusion::arm::attitude_form::AttitudeForm;
use kurs::fusion::arm::filter::{ArmEpoch, ArmFilter, ArmFilterSettings, Health, Start};
use kurs::fusion::arm::layout::{
    ACCELERATION, ATTITUDE, CLOCK, CLOCK_RATE, PAPER_STATES, POSITION, RATE, VELOCITY,
};
use kurs::fusion::arm::nhe::Angles;
use kurs::fusion::arm::process_noise::{Densities, ProcessNoise};
use kurs::fusion::arm::ranging::{Measured, Ranging, SatelliteMotion};
use kurs::fusion::earth::local_level::LocalLevel;
use kurs::fusion::kalman::Gate;
use kurs::signal::{Satellite, System};
use kurs_sim::noise::Noise;
use kurs_sim::rotating_arm::{
    ArmScenario, ArmSensors, ArmTruth, Clock, Course, TURN_LASTS_S, TURN_STARTS_S, TurnShape,
};
use kurs_sim::walker::{SatelliteTruth, Walker, elevation_rad};
use nalgebra::Vector3;

pub(crate) const STEP_S: f64 = 0.01;
const STEPS: usize = 4000;
/// GNSS at every tenth accelerometer sample.
const GNSS_EVERY: usize = 10;
const TURN_ENDS_S: f64 = TURN_STARTS_S + TURN_LASTS_S;

/// Which filter is run.
#[derive(Debug, Clone)]
pub(crate) enum Candidate {
    Corrected(Box<ArmFilterSettings>),
    /// As published, fed with its own model of the world.
    PublishedOwnWorld(Gate),
    /// As published, fed with what the sensors really measure.
    PublishedRealWorld(Gate),
}

#[derive(Debug, Clone)]
pub(crate) struct Campaign {
    pub(crate) candidate: Candidate,
    pub(crate) course: Course,
    pub(crate) shape: TurnShape,
    pub(crate) initial: InitialErrors,
}

/// Standard deviations of the errors at the start, degrees and degrees a second.
#[derive(Debug, Clone, Copy)]
pub(crate) struct InitialErrors {
    pub(crate) tilt: f64,
    pub(crate) heading: f64,
    pub(crate) rate: f64,
}

/// The reference's start.
pub(crate) const USUAL: InitialErrors = InitialErrors { tilt: 5.0, heading: 10.0, rate: 2.0 };
/// With a poorly known heading.
pub(crate) const COARSE: InitialErrors = InitialErrors { heading: 30.0, ..USUAL };
/// With well-known rates, for a filter that cannot observe all of them.
pub(crate) const STEADY: InitialErrors = InitialErrors { rate: 0.1, ..USUAL };

/// 110° off the heading of 30°. The reference does not give the direction, but its Cramér-Rao bounds
/// do: in (roll, pitch, heading) the turn about an acceleration Δ off the heading is (cos Δ / cos p,
/// sin Δ, tan p cos Δ), which nothing observes, so that the bounds are to each other as these. They
/// are 62°, 169°, 11°: Δ is 70° or 110° to either side (`observability.rs`).
pub(crate) const ACCELERATED: Course = Course::Accelerated {
    acceleration_mps2: 5.0,
    azimuth_rad: 140.0 * core::f64::consts::PI / 180.0,
};

/// What the runs of a campaign come to; degrees, s, m, m/s, %.
#[derive(Debug, Clone, Default)]
pub(crate) struct Summary {
    pub(crate) lost_percent: f64,
    pub(crate) heading_steady: f64,
    pub(crate) tilt_steady: f64,
    pub(crate) heading_manoeuvre: f64,
    pub(crate) peak_p95: f64,
    pub(crate) lag_s: f64,
    pub(crate) convergence_p95_s: f64,
    pub(crate) position_m: f64,
    pub(crate) velocity_mps: f64,
    pub(crate) rejected_percent: f64,
    /// Mean estimated heading at every GNSS epoch, the first after a tenth of a second.
    #[allow(dead_code)] // only in the figure
    pub(crate) mean_heading: Vec<f64>,
}

/// The corrected filter of the reference by its densities.
pub(crate) fn corrected(jerk: f64, turning: f64, states_20: bool, form: AttitudeForm) -> Candidate {
    let settings = ArmFilterSettings {
        form,
        angular_acceleration: states_20,
        process_noise: ProcessNoise::Continuous(Densities { jerk, turning, clock: 0.01 }),
        ..ArmFilterSettings::new(RotatingArm::new(1.0, 1.0))
    };
    Candidate::Corrected(Box::new(settings))
}

/// Errors of one run at every GNSS epoch.
#[derive(Debug, Default)]
struct Trace {
    heading_deg: Vec<f64>,
    tilt_deg: Vec<[f64; 2]>,
    position_m: Vec<f64>,
    velocity_mps: Vec<f64>,
    measured: usize,
    rejected: usize,
}

impl Campaign {
    pub(crate) fn new(candidate: Candidate, course: Course) -> Self {
        let own_world = matches!(candidate, Candidate::PublishedOwnWorld(_));
        let shape = if own_world { TurnShape::Ramp } else { TurnShape::Smooth };
        Self { candidate, course, shape, initial: USUAL }
    }

    pub(crate) fn run(&self, seeds: core::ops::Range<u64>) -> Summary {
        let scenario = ArmScenario::reference(self.course, self.shape);
        let truths = scenario.run(STEP_S, STEPS + 1);
        let satellites = visible_satellites(&truths[0]);
        let traces: Vec<Trace> =
            seeds.map(|seed| self.one_run(seed, &truths, &satellites)).collect();
        summarise(&traces, &truths)
    }

    fn one_run(
        &self,
        seed: u64,
        truths: &[ArmTruth],
        satellites: &[(usize, Vec<SatelliteTruth>)],
    ) -> Trace {
        let mut noise = Noise::seeded(seed);
        let sensors = ArmSensors::reference();
        let mut clock = Clock { bias_m: 0.0, rate_mps: 0.0, density: 0.01 };
        let start = start(&truths[0], &self.initial, &mut noise);
        let mut filter = Filter::new(&self.candidate, &start);
        let mut trace = Trace::default();
        for (step, truth) in truths.iter().enumerate().skip(1) {
            let time_s = step as f64 * STEP_S;
            clock.advance(STEP_S, &mut noise);
            let mut force = sensors.specific_force(truth, &mut noise);
            let mut antenna = (truth.antenna_m, truth.antenna_velocity_mps);
            if let Candidate::PublishedOwnWorld(_) = self.candidate {
                force = own_world_force(truth, time_s) + noise.normal3(0.01);
                antenna = (truth.position_m, truth.velocity_mps);
            }
            let mut ranges = Vec::new();
            if step % GNSS_EVERY == 0 {
                for (number, motions) in satellites {
                    let satellite = &motions[step / GNSS_EVERY];
                    let range =
                        sensors.range(&antenna.0, &antenna.1, satellite, &clock, &mut noise);
                    let phase_m = Measured { value: range.phase_m, sd: sensors.phase_sd_m };
                    let (range_m, rate_mps) = (range.pseudorange_m, range.range_rate_mps);
                    let of_satellite = ranging(*number, satellite, range_m, rate_mps);
                    ranges.push(Ranging { phase_m: Some(phase_m), ..of_satellite });
                }
            }
            let (measured, rejected) = filter.push(time_s, &ranges, force);
            trace.measured += measured;
            trace.rejected += rejected;
            if step % GNSS_EVERY == 0 {
                trace.add(&filter, truth);
            }
        }
        trace
    }
}

/// True state plus errors of the stated standard deviations.
pub(crate) fn start(truth: &ArmTruth, initial: &InitialErrors, noise: &mut Noise) -> Start {
    let [tilt_sd_rad, heading_sd_rad, rate_sd_radps] =
        [initial.tilt, initial.heading, initial.rate].map(f64::to_radians);
    Start {
        time_s: 0.0,
        position_m: truth.position_m + noise.normal3(5.0),
        position_sd_m: 5.0,
        clock_m: noise.normal(10.0),
        clock_sd_m: 10.0,
        velocity_mps: truth.velocity_mps + noise.normal3(0.5),
        velocity_sd_mps: 0.5,
        clock_rate_mps: noise.normal(0.5),
        clock_rate_sd_mps: 0.5,
        acceleration_mps2: truth.acceleration_mps2 + noise.normal3(0.3),
        acceleration_sd_mps2: 0.3,
        angles: Angles {
            roll_rad: truth.angles_rad.x + noise.normal(tilt_sd_rad),
            pitch_rad: truth.angles_rad.y + noise.normal(tilt_sd_rad),
            heading_rad: truth.angles_rad.z + noise.normal(heading_sd_rad),
        },
        tilt_sd_rad,
        heading_sd_rad,
        angle_rates_radps: noise.normal3(rate_sd_radps),
        rate_sd_radps,
        angular_acceleration_sd_radps2: 0.5,
    }
}

/// Pseudorange and range rate of one satellite, with the noise of the reference.
pub(crate) fn ranging(
    number: usize,
    satellite: &SatelliteTruth,
    range_m: f64,
    rate_mps: f64,
) -> Ranging {
    Ranging {
        satellite: Satellite { system: System::Gps, number: u8::try_from(number + 1).unwrap() },
        motion: motion_of(satellite),
        pseudorange_m: Some(Measured { value: range_m, sd: 10f64.sqrt() }),
        range_rate_mps: Some(Measured { value: rate_mps, sd: 0.1 }),
        phase_m: None,
        slipped: false,
    }
}

pub(crate) fn motion_of(satellite: &SatelliteTruth) -> SatelliteMotion {
    let SatelliteTruth { position_m, velocity_mps } = *satellite;
    SatelliteMotion { position_m, velocity_mps }
}

/// One of the two filters behind the same calls.
enum Filter {
    Corrected(ArmFilter),
    Published(PublishedFilter),
}

impl Filter {
    fn new(candidate: &Candidate, start: &Start) -> Self {
        match candidate {
            Candidate::Corrected(settings) => {
                Self::Corrected(ArmFilter::new(settings.as_ref().clone(), start))
            }
            Candidate::PublishedOwnWorld(gate) | Candidate::PublishedRealWorld(gate) => {
                let (state, sd) = seventeen_states(start);
                let arm = RotatingArm::new(1.0, 1.0);
                let mut filter = PublishedFilter::new(arm, 0.0, state, &sd, STEP_S);
                filter.gate = *gate;
                Self::Published(filter)
            }
        }
    }

    /// Takes the measurements; returns how many there were and how many were rejected.
    fn push(&mut self, time_s: f64, satellites: &[Ranging], force: Vector3<f64>) -> (usize, usize) {
        match self {
            Self::Corrected(filter) => {
                let epoch = ArmEpoch {
                    time_s,
                    specific_force_mps2: Some(force),
                    satellites,
                    arm_angle_rad: None,
                };
                let Health { gnss, accelerometer, .. } = filter.push(&epoch).unwrap();
                let rejected = gnss.rejected + accelerometer.rejected;
                (gnss.used + accelerometer.used + rejected, rejected)
            }
            Self::Published(filter) => {
                filter.predict(STEP_S);
                filter.update(satellites, &force);
                let outcomes = filter.batch().outcomes();
                (outcomes.len(), outcomes.iter().filter(|outcome| !outcome.accepted).count())
            }
        }
    }

    fn state(&self) -> &[f64] {
        match self {
            Self::Corrected(filter) => filter.state(),
            Self::Published(filter) => filter.state(),
        }
    }

    fn angles(&self) -> Angles {
        match self {
            Self::Corrected(filter) => filter.angles(),
            Self::Published(filter) => {
                let x = &filter.state()[ATTITUDE];
                Angles { roll_rad: x[0], pitch_rad: x[1], heading_rad: x[2] }
            }
        }
    }
}

impl Trace {
    fn add(&mut self, filter: &Filter, truth: &ArmTruth) {
        let angles = filter.angles();
        let error = |found: f64, truth: f64| {
            let error = (found - truth).to_degrees();
            error - 360.0 * (error / 360.0).round()
        };
        let x = filter.state();
        let three = |block: core::ops::Range<usize>| Vector3::from_column_slice(&x[block]);
        self.heading_deg.push(error(angles.heading_rad, truth.angles_rad.z));
        self.tilt_deg.push([
            error(angles.roll_rad, truth.angles_rad.x),
            error(angles.pitch_rad, truth.angles_rad.y),
        ]);
        self.position_m.push((three(POSITION) - truth.position_m).norm());
        self.velocity_mps.push((three(VELOCITY) - truth.velocity_mps).norm());
    }

    /// Heading off by more than 20° anywhere after 30 s.
    fn is_lost(&self) -> bool {
        self.heading_deg[window(30.0, 40.0)]
            .iter()
            .any(|error| error.is_nan() || error.abs() > 20.0)
    }

    /// Time from which the heading stays within 2° for half a second.
    fn convergence_s(&self) -> f64 {
        let held = 5;
        let inside = |errors: &[f64]| errors.iter().all(|error| error.abs() < 2.0);
        let first = self.heading_deg.windows(held).position(inside);
        first.map_or(f64::INFINITY, |k| (k + 1) as f64 * STEP_S * GNSS_EVERY as f64)
    }
}

/// Satellites above 10° at the start, with their motion at every GNSS epoch.
pub(crate) fn visible_satellites(truth: &ArmTruth) -> Vec<(usize, Vec<SatelliteTruth>)> {
    let walker = Walker::rotating_arm_reference();
    let epochs: Vec<Vec<SatelliteTruth>> =
        (0..=STEPS / GNSS_EVERY).map(|k| walker.at((k * GNSS_EVERY) as f64 * STEP_S)).collect();
    let up = LocalLevel::at(&truth.position_m).up;
    let above = |number: &usize| {
        let satellite = &epochs[0][*number];
        elevation_rad(&truth.position_m, &up, &satellite.position_m) > 10f64.to_radians()
    };
    (0..epochs[0].len())
        .filter(above)
        .map(|number| (number, epochs.iter().map(|epoch| epoch[number]).collect()))
        .collect()
}

/// n = Cᵀ a + ρ̈: the accelerometers as the paper imagines them.
fn own_world_force(truth: &ArmTruth, time_s: f64) -> Vector3<f64> {
    let arm = RotatingArm::new(1.0, 1.0);
    truth.ecef_from_body.transpose() * truth.acceleration_mps2
        + arm.at_angle(arm.angle_rad(time_s)).acceleration_mps2
}

fn seventeen_states(start: &Start) -> ([f64; PAPER_STATES], [f64; PAPER_STATES]) {
    let (mut x, mut sd) = ([0.0; PAPER_STATES], [0.0; PAPER_STATES]);
    let angles = start.angles;
    x[POSITION].copy_from_slice(start.position_m.as_slice());
    x[CLOCK] = start.clock_m;
    x[VELOCITY].copy_from_slice(start.velocity_mps.as_slice());
    x[CLOCK_RATE] = start.clock_rate_mps;
    x[ACCELERATION].copy_from_slice(start.acceleration_mps2.as_slice());
    x[ATTITUDE].copy_from_slice(&[angles.roll_rad, angles.pitch_rad, angles.heading_rad]);
    x[RATE].copy_from_slice(start.angle_rates_radps.as_slice());
    sd[POSITION].fill(start.position_sd_m);
    sd[CLOCK] = start.clock_sd_m;
    sd[VELOCITY].fill(start.velocity_sd_mps);
    sd[CLOCK_RATE] = start.clock_rate_sd_mps;
    sd[ACCELERATION].fill(start.acceleration_sd_mps2);
    sd[ATTITUDE].copy_from_slice(&[start.tilt_sd_rad, start.tilt_sd_rad, start.heading_sd_rad]);
    sd[RATE].fill(start.rate_sd_radps);
    (x, sd)
}

/// GNSS epochs from a time up to another; the first epoch is at 0.1 s.
fn window(from_s: f64, to_s: f64) -> core::ops::Range<usize> {
    let index = |time_s: f64| (time_s / (STEP_S * GNSS_EVERY as f64)).round() as usize - 1;
    index(from_s)..index(to_s)
}

fn summarise(all: &[Trace], truths: &[ArmTruth]) -> Summary {
    let kept: Vec<&Trace> = all.iter().filter(|trace| !trace.is_lost()).collect();
    let lost = all.len() - kept.len();
    let steady = window(10.0, TURN_STARTS_S);
    let turn = window(TURN_STARTS_S, TURN_ENDS_S);
    let late = window(10.0, 40.0);
    let heading = |range: &core::ops::Range<usize>| {
        rms(kept.iter().flat_map(|trace| trace.heading_deg[range.clone()].iter().copied()))
    };
    let tilt =
        kept.iter().flat_map(|trace| trace.tilt_deg[steady.clone()].iter().flatten().copied());
    let peak = |trace: &&Trace| {
        trace.heading_deg[turn.clone()].iter().fold(0.0, |worst: f64, e| worst.max(e.abs()))
    };
    let measured: usize = all.iter().map(|trace| trace.measured).sum();
    let rejected: usize = all.iter().map(|trace| trace.rejected).sum();
    let truth: Vec<f64> =
        truths.iter().step_by(GNSS_EVERY).skip(1).map(|t| t.angles_rad.z.to_degrees()).collect();
    let mean_heading: Vec<f64> = (0..truth.len())
        .map(|k| {
            let sum: f64 = kept.iter().map(|trace| trace.heading_deg[k]).sum();
            truth[k] + sum / kept.len() as f64
        })
        .collect();
    Summary {
        lost_percent: 100.0 * lost as f64 / all.len() as f64,
        heading_steady: heading(&steady),
        tilt_steady: rms(tilt),
        heading_manoeuvre: heading(&turn),
        peak_p95: percentile_95(kept.iter().map(peak).collect()),
        lag_s: lag_s(&mean_heading),
        convergence_p95_s: percentile_95(all.iter().map(Trace::convergence_s).collect()),
        position_m: rms(kept.iter().flat_map(|t| t.position_m[late.clone()].iter().copied())),
        velocity_mps: rms(kept.iter().flat_map(|t| t.velocity_mps[late.clone()].iter().copied())),
        rejected_percent: 100.0 * rejected as f64 / measured as f64,
        mean_heading,
    }
}

/// Shift of the true heading that fits the mean estimate best, in steps of 5 ms.
fn lag_s(mean_heading: &[f64]) -> f64 {
    let scenario = ArmScenario::reference(Course::Standing, TurnShape::Smooth);
    let misfit = |shift_s: f64| -> f64 {
        let range = window(TURN_STARTS_S - 1.0, TURN_ENDS_S + 1.5);
        range
            .map(|k| {
                let time_s = (k + 1) as f64 * STEP_S * GNSS_EVERY as f64;
                let truth = scenario.heading_at_rad(time_s - shift_s).to_degrees();
                (mean_heading[k] - truth).powi(2)
            })
            .sum()
    };
    let shifts = (-40..=300).map(|k| f64::from(k) * 0.005);
    shifts.min_by(|a, b| misfit(*a).total_cmp(&misfit(*b))).unwrap()
}

fn rms(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0), |(sum, count), v| (sum + v * v, count + 1));
    (sum / f64::from(count)).sqrt()
}

fn percentile_95(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len().saturating_sub(1) * 95 / 100).copied().unwrap_or(f64::NAN)
}
