//! Attitude from the antennas carried through an outage of ten seconds by a gyro of 10°/h with
//! 0.1°/√h of noise.
#![allow(clippy::unwrap_used, clippy::print_stdout)]

use kurs::frames::{Attitude, Geodetic, Rotation, Vector};
use kurs::fusion::attitude::filter::{
    AttitudeFilter, InertialSample, InertialSettings, MeasuredAttitude, MeasuredVelocity,
};
use kurs::fusion::attitude::smoother::Recorder;
use kurs::fusion::kalman::Gate;
use kurs_sim::inertial::{GyroErrors, Swing};
use kurs_sim::noise::Noise;
use nalgebra::{Matrix3, Rotation3, Vector3};

const STEP_S: f64 = 0.01;
const OUTAGE_STARTS_S: f64 = 60.0;
const OUTAGE_ENDS_S: f64 = 70.0;
const END_S: f64 = 90.0;
const SEEDS: u64 = 100;

/// Standard deviations of a fixed attitude: rotation about forward, right, down.
fn fix_sd_rad() -> Vector3<f64> {
    Vector3::new(0.2, 0.2, 0.1).map(f64::to_radians)
}

/// What one run shows.
#[derive(Default)]
struct Run {
    /// At the end of the outage.
    heading_error_deg: f64,
    nees: f64,
    /// Change by the first fix after it, over the standard deviation before.
    jump_sigmas: f64,
    rejected: usize,
    filtered_deg: Vec<f64>,
    smoothed_deg: Vec<f64>,
}

fn run(seed: u64) -> Run {
    let mut noise = Noise::seeded(seed);
    let swing = Swing::vehicle();
    let degrees_an_hour = 1f64.to_radians() / 3600.0;
    let errors = GyroErrors {
        bias_radps: noise.normal3(10.0 * degrees_an_hour),
        noise: 0.1f64.to_radians() / 60.0,
    };
    let settings = InertialSettings {
        gyro_noise: errors.noise,
        gyro_bias_sd_radps: 10.0 * degrees_an_hour,
        gyro_bias_walk: 1e-9,
        accelerometer_noise: 1e-3,
        accelerometer_bias_sd_mps2: 0.02,
        accelerometer_bias_walk: 1e-5,
        mounting_sd_rad: 0.0,
        unknown_acceleration: 1.0,
        gate: Gate::Innovation { sigmas: 5.0 },
    };
    let fix = |time_s: f64, noise: &mut Noise| {
        let error = fix_sd_rad().map(|sd| noise.normal(sd));
        let truth = swing.ned_from_body(time_s).matrix();
        MeasuredAttitude {
            ned_from_body: Rotation::from_matrix(truth * Rotation3::new(error).into_inner()),
            covariance: Matrix3::from_diagonal(&fix_sd_rad().map(|sd| sd * sd)),
        }
    };
    let still = MeasuredVelocity {
        velocity_mps: Vector::new(0.0, 0.0, 0.0),
        covariance: Matrix3::identity() * 0.01,
    };
    let place = Geodetic::from_degrees(55.75, 37.62, 200.0);
    let first = fix(0.0, &mut noise);
    let mut filter = AttitudeFilter::new(settings, 0.0, &place, &first, &still);
    let mut recorder = Recorder::default();
    let mut run = Run::default();
    for step in 1..=9000u32 {
        let time_s = f64::from(step) * STEP_S;
        let sample = InertialSample {
            time_s,
            rate_radps: swing.gyro(time_s, STEP_S, &errors, &mut noise),
            specific_force_mps2: None,
        };
        filter.integrate(&sample).unwrap();
        if step % 100 != 0 {
            continue;
        }
        let outage = time_s > OUTAGE_STARTS_S && time_s < OUTAGE_ENDS_S;
        let before = filter.clone();
        let measured = (!outage).then(|| fix(time_s, &mut noise));
        let corrected = recorder.around(&mut filter, |f| f.correct(measured.as_ref(), None));
        run.rejected += corrected.attitude.rejected;
        if (time_s - OUTAGE_ENDS_S).abs() < STEP_S / 2.0 {
            let error = attitude_error(&before.ned_from_body(), &swing.ned_from_body(time_s));
            let covariance = before.attitude_covariance();
            run.nees = error.dot(&(covariance.try_inverse().unwrap() * error));
            run.heading_error_deg = heading_error_deg(&before.ned_from_body(), &swing, time_s);
            let jump = attitude_error(&filter.ned_from_body(), &before.ned_from_body());
            run.jump_sigmas = jump.z.abs() / covariance[(2, 2)].sqrt();
        }
        if outage {
            run.filtered_deg.push(heading_error_deg(&filter.ned_from_body(), &swing, time_s));
        }
    }
    assert!((filter.time_s() - END_S).abs() < 1e-9);
    for smoothed in recorder.smooth() {
        if smoothed.time_s > OUTAGE_STARTS_S + 0.5 && smoothed.time_s < OUTAGE_ENDS_S - 0.5 {
            let matrix = smoothed.nominal.attitude.to_rotation_matrix().into_inner();
            let found = Rotation::from_matrix(matrix);
            run.smoothed_deg.push(heading_error_deg(&found, &swing, smoothed.time_s));
        }
    }
    run
}

type NedFromBody = Rotation<kurs::frames::Ned, kurs::frames::Body>;

/// Rotation vector in body axes from `truth` to `found`.
fn attitude_error(found: &NedFromBody, truth: &NedFromBody) -> Vector3<f64> {
    let between = truth.matrix().transpose() * found.matrix();
    Rotation3::from_matrix_unchecked(between).scaled_axis()
}

fn heading_error_deg(found: &NedFromBody, swing: &Swing, time_s: f64) -> f64 {
    let found = Attitude::from_ned_from_body(found).heading_rad;
    let error = (found - swing.attitude(time_s).heading_rad).to_degrees();
    error - 360.0 * (error / 360.0).round()
}

fn rms(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0u32), |(sum, n), v| (sum + v * v, n + 1));
    (sum / f64::from(count)).sqrt()
}

#[test]
fn ten_seconds_without_antennas() {
    let runs: Vec<Run> = (0..SEEDS).map(run).collect();
    let mut errors: Vec<f64> = runs.iter().map(|run| run.heading_error_deg.abs()).collect();
    errors.sort_by(f64::total_cmp);
    let p95 = errors[94];
    let nees = runs.iter().map(|run| run.nees).sum::<f64>() / SEEDS as f64;
    let worst_jump = runs.iter().map(|run| run.jump_sigmas).fold(0.0, f64::max);
    let filtered = rms(runs.iter().flat_map(|run| run.filtered_deg.iter().copied()));
    let smoothed = rms(runs.iter().flat_map(|run| run.smoothed_deg.iter().copied()));
    println!(
        "heading after 10 s: p95 {p95:.4}°, NEES {nees:.2} of 3, largest jump {worst_jump:.2} σ, \
         rms in the outage {filtered:.4}° filtered, {smoothed:.4}° smoothed"
    );
    assert!(p95 <= 0.15, "{p95}");
    // 99.9 % of the mean of 100 values of χ² with 3 degrees of freedom.
    assert!((nees - 3.0).abs() < 3.3 * (6f64 / 100.0).sqrt(), "{nees}");
    assert!(worst_jump <= 3.0, "{worst_jump}");
    assert_eq!(runs.iter().map(|run| run.rejected).sum::<usize>(), 0);
    assert!(smoothed <= 0.5 * filtered, "{smoothed} {filtered}");
}
