//! The quaternion form over the top: the nose goes through the vertical twice, where roll and heading
//! have no meaning of their own.

use kurs::fusion::arm::attitude_form::AttitudeForm::Quaternion;
use kurs::fusion::arm::filter::{ArmEpoch, ArmFilter};
use kurs::fusion::arm::layout::ATTITUDE;
use kurs_sim::noise::Noise;
use kurs_sim::rotating_arm::{ArmScenario, ArmSensors, Clock, Course, TurnShape};
use nalgebra::{Matrix3, Rotation3};

use super::campaign::{Candidate, STEP_S, USUAL, corrected, ranging, start, visible_satellites};

/// 9°/s: pitch 90° after 8.9 s, −90° after 28.9 s; with the turn of the heading in between.
fn looping() -> ArmScenario {
    let uniform = Course::Uniform { speed_mps: 20.0 };
    let pitch_rate_radps = 9f64.to_radians();
    ArmScenario { pitch_rate_radps, ..ArmScenario::reference(uniform, TurnShape::Smooth) }
}

#[test]
fn the_nose_goes_over_the_top() {
    let truths = looping().run(STEP_S, 4001);
    let steepest = truths.iter().map(|t| t.angles_rad.y.sin()).fold(0.0, f64::max);
    assert!(steepest > 1.0 - 1e-6);
    let satellites = visible_satellites(&truths[0]);
    let sensors = ArmSensors::reference();
    for states_20 in [false, true] {
        let turning = if states_20 { 1.0 } else { 0.1 };
        let Candidate::Corrected(settings) = corrected(30.0, turning, states_20, Quaternion) else {
            unreachable!("corrected() makes corrected filters")
        };
        let (mut worst_deg, mut squares, mut nees, mut epochs) = (0.0f64, 0.0, 0.0, 0.0);
        for seed in 0..4 {
            let mut noise = Noise::seeded(seed);
            let mut clock = Clock { bias_m: 0.0, rate_mps: 0.0, density: 0.01 };
            let first = start(&truths[0], &USUAL, &mut noise);
            let mut filter = ArmFilter::new(settings.as_ref().clone(), &first);
            for (step, truth) in truths.iter().enumerate().skip(1) {
                clock.advance(STEP_S, &mut noise);
                let force = sensors.specific_force(truth, &mut noise);
                let mut ranges = Vec::new();
                if step % 10 == 0 {
                    let (antenna_m, velocity) = (truth.antenna_m, truth.antenna_velocity_mps);
                    ranges.extend(satellites.iter().map(|(number, motions)| {
                        let satellite = &motions[step / 10];
                        let r = sensors.range(&antenna_m, &velocity, satellite, &clock, &mut noise);
                        ranging(*number, satellite, r.pseudorange_m, r.range_rate_mps)
                    }));
                }
                let epoch = ArmEpoch {
                    time_s: step as f64 * STEP_S,
                    specific_force_mps2: Some(force),
                    satellites: &ranges,
                    arm_angle_rad: None,
                };
                let health = filter.push(&epoch).unwrap();
                assert_eq!(health.gnss.rejected + health.accelerometer.rejected, 0, "{step}");
                // Settled, and not in the fast turn of the heading, whose lag is another test's.
                if step < 500 || (1950..2600).contains(&step) || step % 10 != 0 {
                    continue;
                }
                let found: Matrix3<f64> = filter.motion().ecef_from_body;
                let between = truth.ecef_from_body.transpose() * found;
                let error = Rotation3::from_matrix_unchecked(between).scaled_axis();
                let covariance = filter.covariance();
                let block = covariance.fixed_view::<3, 3>(ATTITUDE.start, ATTITUDE.start);
                nees += error.dot(&(block.into_owned().try_inverse().unwrap() * error));
                worst_deg = worst_deg.max(error.norm().to_degrees());
                squares += error.norm_squared();
                epochs += 1.0;
            }
        }
        let rms_deg = f64::sqrt(squares / epochs).to_degrees();
        // Level flight has 0.72° and 0.90° of heading, 0.67° and 0.81° of tilt on each axis.
        assert!(rms_deg < 1.6 && worst_deg < 5.0, "{states_20}: {rms_deg}, worst {worst_deg}");
        // Tuned for manoeuvres the filter claims too little in steady motion, never too much.
        assert!(nees / epochs < 3.0, "{states_20}: {}", nees / epochs);
    }
}
