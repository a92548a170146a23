//! What five seconds of measurements say about the attitude: rank and Cramér-Rao bound of the six
//! angles and rates, without process noise, over the reference geometry.

use kurs::frames::EARTH_RATE_RADPS;
use kurs::fusion::arm::RotatingArm;
use kurs::fusion::arm::as_published::model as published_model;
use kurs::fusion::arm::attitude_form::Carried;
use kurs::fusion::arm::gradient::Prediction;
use kurs::fusion::arm::layout::{ACCELERATION, ATTITUDE, Layout, PAPER_STATES, POSITION, VELOCITY};
use kurs::fusion::arm::model::ArmEnd;
use kurs::fusion::earth::local_level::LocalLevel;
use kurs_sim::rotating_arm::{ArmScenario, Course, TurnShape};
use nalgebra::{DMatrix, DVector, Matrix6, Vector6};

use super::campaign::{ACCELERATED, STEP_S, motion_of, visible_satellites};

const OTHERS: usize = 11;

#[derive(Clone, Copy, PartialEq)]
enum Model {
    Published,
    Corrected,
}

/// Information about the angles and rates at the start, the other states unknown.
fn attitude_information(model: Model, course: Course) -> Matrix6<f64> {
    let scenario = ArmScenario::reference(course, TurnShape::Smooth);
    let run = scenario.run(STEP_S, 501);
    let satellites = visible_satellites(&run[0]);
    let (layout, arm) = (Layout::new(false, false, false, 0), RotatingArm::new(1.0, 1.0));
    let mut information = DMatrix::<f64>::zeros(PAPER_STATES, PAPER_STATES);
    for (step, truth) in run.iter().enumerate() {
        let time_s = step as f64 * STEP_S;
        let mut x = vec![0.0; PAPER_STATES];
        x[POSITION].copy_from_slice(truth.position_m.as_slice());
        x[VELOCITY].copy_from_slice(truth.velocity_mps.as_slice());
        x[ACCELERATION].copy_from_slice(truth.acceleration_mps2.as_slice());
        x[ATTITUDE].copy_from_slice(truth.angles_rad.as_slice());
        let here = LocalLevel::at(&truth.position_m);
        let decoded = Carried::Euler.decode(&x, &layout, &here);
        let on_arm = arm.at_angle(arm.angle_rad(time_s));
        let end = ArmEnd::new(&decoded.motion, &on_arm);
        let phi = transition_from_start(time_s);
        let mut add = |prediction: &Prediction, sd: f64| {
            let mut row = DVector::zeros(PAPER_STATES);
            decoded.write_row(&prediction.gradient, &layout, row.as_mut_slice());
            let row = phi.tr_mul(&row) / sd;
            information.ger(1.0, &row, &row, 1.0);
        };
        if step % 10 == 0 {
            for (_, motions) in &satellites {
                let satellite = motion_of(&motions[step / 10]);
                let (range, rate) = match model {
                    Model::Corrected => (end.pseudorange(&satellite), end.range_rate(&satellite)),
                    Model::Published => (
                        published_model::pseudorange(&decoded.motion, &satellite),
                        published_model::range_rate(&decoded.motion, &satellite),
                    ),
                };
                add(&range, 10f64.sqrt());
                add(&rate, 0.1);
            }
        }
        let forces = match model {
            Model::Corrected => end.specific_force(&here, EARTH_RATE_RADPS),
            Model::Published => published_model::specific_force(&decoded.motion, &on_arm),
        };
        forces.iter().for_each(|force| add(force, 0.01));
    }
    // I_yy − I_yx I_xx⁻¹ I_xy
    let others = information.view((0, 0), (OTHERS, OTHERS)).into_owned();
    let cross = information.view((0, OTHERS), (OTHERS, 6)).into_owned();
    let own = information.view((OTHERS, OTHERS), (6, 6)).into_owned();
    let reduced = own - cross.transpose() * others.cholesky().unwrap().solve(&cross);
    reduced.fixed_view::<6, 6>(0, 0).into_owned()
}

/// Exact transition from the start to a time.
fn transition_from_start(time_s: f64) -> DMatrix<f64> {
    let mut phi = DMatrix::identity(PAPER_STATES, PAPER_STATES);
    for axis in 0..3 {
        phi[(axis, 4 + axis)] = time_s;
        phi[(axis, 8 + axis)] = time_s * time_s / 2.0;
        phi[(4 + axis, 8 + axis)] = time_s;
        phi[(11 + axis, 14 + axis)] = time_s;
    }
    phi[(3, 7)] = time_s;
    phi
}

/// Prior standard deviations: 180° for the angles, 100°/s for their rates.
fn prior() -> Matrix6<f64> {
    let degrees = Vector6::new(180.0, 180.0, 180.0, 100.0, 100.0, 100.0);
    Matrix6::from_diagonal(&degrees.map(f64::to_radians))
}

/// Directions in which the measurements say more than the prior.
fn rank(information: &Matrix6<f64>) -> usize {
    let scaled = prior() * information * prior();
    scaled.symmetric_eigenvalues().iter().filter(|value| **value > 1.0).count()
}

fn bounds_deg(information: &Matrix6<f64>) -> Vector6<f64> {
    let prior_information = (prior() * prior()).try_inverse().unwrap();
    let covariance = (information + prior_information).try_inverse().unwrap();
    covariance.diagonal().map(|variance| variance.sqrt().to_degrees())
}

#[test]
fn the_published_model_knows_nothing_of_the_attitude_in_uniform_motion() {
    let uniform = Course::Uniform { speed_mps: 50.0 };
    let information = attitude_information(Model::Published, uniform);
    assert_eq!(rank(&information), 0);
    assert!(information.amax() < 1e-6, "{information}");
}

/// With acceleration only the turn about it stays unknown, in angle and rate. The reference's bounds
/// of 62°, 169°, 11° and 33, 89, 5.7°/s fix the direction of its acceleration.
#[test]
fn the_published_model_knows_all_but_the_turn_about_the_acceleration() {
    let information = attitude_information(Model::Published, ACCELERATED);
    assert_eq!(rank(&information), 4);
    let bounds = bounds_deg(&information);
    for (found, reference) in bounds.iter().zip([62.0, 169.0, 11.0, 33.0, 89.0, 5.7]) {
        assert!((found / reference - 1.0).abs() < 0.05, "{bounds}");
    }
}

/// Reference: heading 0.103° ± 2 %, roll 0.032°, pitch 0.034°, uniform or standing.
#[test]
fn the_corrected_model_observes_all_six() {
    for course in [Course::Uniform { speed_mps: 50.0 }, Course::Standing] {
        let information = attitude_information(Model::Corrected, course);
        assert_eq!(rank(&information), 6);
        let bounds = bounds_deg(&information);
        let (roll, pitch, heading) = (bounds[0], bounds[1], bounds[2]);
        assert!((heading / 0.103 - 1.0).abs() < 0.02, "heading {heading}");
        assert!((roll - 0.032).abs() < 0.001 && (pitch - 0.034).abs() < 0.001, "{roll} {pitch}");
    }
}
