//! Whether the filter's covariance is honest: truth drawn from its own process model.

use core::ops::Range;

use kurs::frames::EARTH_RATE_RADPS;
use kurs::fusion::arm::RotatingArm;
use kurs::fusion::arm::attitude_form::Carried;
use kurs::fusion::arm::filter::{ArmEpoch, ArmFilter, ArmFilterSettings};
use kurs::fusion::arm::layout::{
    ACCELERATION, ATTITUDE, CLOCK, CLOCK_RATE, Layout, PAPER_STATES, POSITION, RATE, VELOCITY,
};
use kurs::fusion::arm::model::ArmEnd;
use kurs::fusion::arm::process_noise::{Densities, ProcessNoise};
use kurs::fusion::earth::local_level::LocalLevel;
use kurs_sim::noise::Noise;
use kurs_sim::rotating_arm::{ArmScenario, ArmSensors, Course, TurnShape};
use nalgebra::{DMatrix, DVector, Matrix2, Matrix3, Vector2, Vector3};

use super::campaign::{InitialErrors, STEP_S, motion_of, ranging, start, visible_satellites};

const JERK: f64 = 1.0;
const TURNING: f64 = 3e-4;
const CLOCK_DENSITY: f64 = 0.01;

/// Errors at the start small enough for the linear theory: 0.05 rad of tilt, 0.1 rad of heading.
const WELL_KNOWN: InitialErrors = InitialErrors { tilt: 2.9, heading: 5.7, rate: 1.7 };

/// Averages over one run or many.
#[derive(Debug, Default, Clone, Copy)]
struct Means {
    attitude_nees: f64,
    motion_nees: f64,
    gnss_nis: f64,
    accelerometer_nis: f64,
}

/// White noise through two and three integrators over one step, by Cholesky's factors.
struct ProcessDraw {
    twice: Matrix2<f64>,
    thrice: Matrix3<f64>,
}

impl ProcessDraw {
    fn new() -> Self {
        let t = STEP_S;
        let twice = Matrix2::new(t.powi(3) / 3.0, t * t / 2.0, t * t / 2.0, t);
        let thrice = Matrix3::new(
            t.powi(5) / 20.0,
            t.powi(4) / 8.0,
            t.powi(3) / 6.0,
            t.powi(4) / 8.0,
            t.powi(3) / 3.0,
            t * t / 2.0,
            t.powi(3) / 6.0,
            t * t / 2.0,
            t,
        );
        Self { twice: twice.cholesky().unwrap().l(), thrice: thrice.cholesky().unwrap().l() }
    }

    /// Moves the true state on by a step.
    fn advance(&self, x: &mut [f64], noise: &mut Noise) {
        let mut pair = |density: f64| {
            self.twice * Vector2::new(noise.normal(1.0), noise.normal(1.0)) * density.sqrt()
        };
        let clock = pair(CLOCK_DENSITY);
        let turns = [pair(TURNING), pair(TURNING), pair(TURNING)];
        x[CLOCK] += STEP_S * x[CLOCK_RATE] + clock.x;
        x[CLOCK_RATE] += clock.y;
        for (axis, turn) in turns.iter().enumerate() {
            let w = self.thrice * noise.normal3(JERK.sqrt());
            let acceleration = x[ACCELERATION.start + axis];
            x[POSITION.start + axis] +=
                STEP_S * x[VELOCITY.start + axis] + STEP_S * STEP_S / 2.0 * acceleration + w.x;
            x[VELOCITY.start + axis] += STEP_S * acceleration + w.y;
            x[ACCELERATION.start + axis] += w.z;
            x[ATTITUDE.start + axis] += STEP_S * x[RATE.start + axis] + turn.x;
            x[RATE.start + axis] += turn.y;
        }
    }
}

fn nees(x: &[f64], truth: &[f64], covariance: &DMatrix<f64>, states: &[Range<usize>]) -> f64 {
    let indices: Vec<usize> = states.iter().cloned().flatten().collect();
    let error = DVector::from_iterator(indices.len(), indices.iter().map(|i| x[*i] - truth[*i]));
    let block = covariance.select_rows(&indices).select_columns(&indices);
    error.dot(&block.cholesky().unwrap().solve(&error))
}

fn run(seed: u64, duration_s: f64) -> Means {
    let mut noise = Noise::seeded(seed);
    let scenario = ArmScenario::reference(Course::Uniform { speed_mps: 20.0 }, TurnShape::Smooth);
    let begin = scenario.run(STEP_S, 1)[0];
    let satellites = visible_satellites(&begin);
    let (layout, arm) = (Layout::new(false, false, false, 0), RotatingArm::new(1.0, 1.0));
    let mut truth = vec![0.0; PAPER_STATES];
    truth[POSITION].copy_from_slice(begin.position_m.as_slice());
    truth[VELOCITY].copy_from_slice(begin.velocity_mps.as_slice());
    truth[ATTITUDE].copy_from_slice(begin.angles_rad.as_slice());

    let start = start(&begin, &WELL_KNOWN, &mut noise);
    let densities = Densities { jerk: JERK, turning: TURNING, clock: CLOCK_DENSITY };
    let settings = ArmFilterSettings {
        process_noise: ProcessNoise::Continuous(densities),
        ..ArmFilterSettings::new(arm)
    };
    let mut filter = ArmFilter::new(settings, &start);
    let (draw, mut sums, mut epochs) = (ProcessDraw::new(), Means::default(), 0.0);
    let (mut gnss_used, mut accelerometer_used) = (0, 0);
    for step in 1..=(duration_s / STEP_S).round() as usize {
        let time_s = step as f64 * STEP_S;
        draw.advance(&mut truth, &mut noise);
        let here = LocalLevel::at(&Vector3::from_column_slice(&truth[POSITION]));
        let motion = Carried::Euler.decode(&truth, &layout, &here).motion;
        let end = ArmEnd::new(&motion, &arm.at_angle(arm.angle_rad(time_s)));
        let mut ranges = Vec::new();
        if step % 10 == 0 {
            for (number, motions) in &satellites {
                let (satellite, sensors) = (&motions[step / 10], ArmSensors::reference());
                let motion = motion_of(satellite);
                let range_m = end.pseudorange(&motion).value;
                let rate_mps = end.range_rate(&motion).value;
                let range_m = range_m + noise.normal(sensors.pseudorange_sd_m);
                let rate_mps = rate_mps + noise.normal(sensors.range_rate_sd_mps);
                ranges.push(ranging(*number, satellite, range_m, rate_mps));
            }
        }
        let force = end.specific_force(&here, EARTH_RATE_RADPS).map(|axis| axis.value);
        let epoch = ArmEpoch {
            time_s,
            specific_force_mps2: Some(Vector3::from(force) + noise.normal3(0.01)),
            satellites: &ranges,
            arm_angle_rad: None,
        };
        let health = filter.push(&epoch).unwrap();
        sums.gnss_nis += health.gnss.nis;
        sums.accelerometer_nis += health.accelerometer.nis;
        gnss_used += health.gnss.used;
        accelerometer_used += health.accelerometer.used;
        if step % 10 == 0 && time_s > 2.0 {
            let (x, p) = (filter.state(), filter.covariance());
            sums.attitude_nees += nees(x, &truth, p, &[ATTITUDE]);
            sums.motion_nees += nees(x, &truth, p, &[POSITION, VELOCITY]);
            epochs += 1.0;
        }
    }
    Means {
        attitude_nees: sums.attitude_nees / epochs,
        motion_nees: sums.motion_nees / epochs,
        gnss_nis: sums.gnss_nis / f64::from(u32::try_from(gnss_used).unwrap()),
        accelerometer_nis: sums.accelerometer_nis
            / f64::from(u32::try_from(accelerometer_used).unwrap()),
    }
}

/// Acceptance bands of the reference for 100 seeds.
#[test]
fn covariance_and_innovations_are_consistent() {
    let runs: Vec<Means> = (0..100).map(|seed| run(seed, 16.0)).collect();
    let mean = |part: fn(&Means) -> f64| runs.iter().map(part).sum::<f64>() / 100.0;
    let attitude = mean(|run| run.attitude_nees);
    let motion = mean(|run| run.motion_nees);
    let gnss = mean(|run| run.gnss_nis);
    let accelerometer = mean(|run| run.accelerometer_nis);
    println!("NEES {attitude:.3} of 3, {motion:.3} of 6; NIS {gnss:.4}, {accelerometer:.4} of 1");
    assert!((2.7..=3.3).contains(&attitude), "{attitude}");
    assert!((5.3..=6.7).contains(&motion), "{motion}");
    assert!((0.98..=1.03).contains(&gnss), "{gnss}");
    assert!((0.98..=1.02).contains(&accelerometer), "{accelerometer}");
}
