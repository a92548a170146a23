//! How many accelerometer samples a second the rotating-arm filter absorbs on one core.
//!
//! `cargo run --release -p kurs-sim --example arm_filter_speed`
#![allow(clippy::print_stdout)]

use std::time::Instant;

use kurs::frames::Geodetic;
use kurs::fusion::arm::RotatingArm;
use kurs::fusion::arm::attitude_form::AttitudeForm;
use kurs::fusion::arm::filter::{ArmEpoch, ArmFilter, ArmFilterSettings, Start};
use kurs::fusion::arm::nhe::Angles;
use nalgebra::Vector3;

const UPDATES: u32 = 400_000;

fn main() {
    for (form, states_20) in [
        (AttitudeForm::Euler, false),
        (AttitudeForm::Euler, true),
        (AttitudeForm::Quaternion, false),
        (AttitudeForm::Quaternion, true),
    ] {
        let arm = RotatingArm::new(1.0, 1.0);
        let settings = ArmFilterSettings {
            form,
            angular_acceleration: states_20,
            ..ArmFilterSettings::new(arm)
        };
        let mut filter = ArmFilter::new(settings, &start());
        let began = Instant::now();
        for step in 1..=UPDATES {
            let time_s = f64::from(step) * 1e-3;
            let force = arm.at_angle(arm.angle_rad(time_s)).acceleration_mps2
                + Vector3::new(0.0, 9.81, 0.0);
            let epoch = ArmEpoch {
                time_s,
                specific_force_mps2: Some(force),
                satellites: &[],
                arm_angle_rad: None,
            };
            if let Err(error) = filter.push(&epoch) {
                println!("stopped: {error}");
                break;
            }
        }
        let per_s = f64::from(UPDATES) / began.elapsed().as_secs_f64();
        println!("{form:?}, {} states: {per_s:.0} updates/s", filter.state().len());
    }
}

fn start() -> Start {
    Start {
        time_s: 0.0,
        position_m: Geodetic::from_degrees(55.75, 37.62, 200.0).to_ecef().xyz(),
        position_sd_m: 5.0,
        clock_m: 0.0,
        clock_sd_m: 10.0,
        velocity_mps: Vector3::zeros(),
        velocity_sd_mps: 0.5,
        clock_rate_mps: 0.0,
        clock_rate_sd_mps: 0.5,
        acceleration_mps2: Vector3::zeros(),
        acceleration_sd_mps2: 0.3,
        angles: Angles::default(),
        tilt_sd_rad: 0.1,
        heading_sd_rad: 0.2,
        angle_rates_radps: Vector3::zeros(),
        rate_sd_radps: 0.03,
        angular_acceleration_sd_radps2: 0.5,
    }
}
