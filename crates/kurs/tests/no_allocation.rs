//! The filters allocate nothing per update once they run, and an epoch of two antennas little: counted by the allocator
//! itself.
#![allow(unsafe_code)] // an allocator cannot be written without
#![allow(clippy::unwrap_used)]

#[path = "../examples/data/recording.rs"]
mod recording;
#[path = "../examples/data/world.rs"]
mod world;

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use kurs::frames::{Attitude, Geodetic, Vector};
use kurs::fusion::arm::RotatingArm;
use kurs::fusion::arm::attitude_form::AttitudeForm;
use kurs::fusion::arm::filter::{ArmEpoch, ArmFilter, ArmFilterSettings, Drift, Start};
use kurs::fusion::arm::nhe::Angles;
use kurs::fusion::arm::ranging::{Measured, Ranging, SatelliteMotion};
use kurs::fusion::attitude::filter::{
    AttitudeFilter, InertialSample, InertialSettings, MeasuredAttitude, MeasuredVelocity,
};
use kurs::fusion::kalman::Gate;
use kurs::signal::{Satellite, System as Constellation};
use nalgebra::{Matrix3, Vector3};

thread_local! {
    /// Allocations of this thread.
    static COUNT: Cell<usize> = const { Cell::new(0) };
}

struct Counting;

// SAFETY: every call is passed on unchanged to the system's allocator.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        COUNT.with(|count| count.set(count.get() + 1));
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        unsafe { System.dealloc(pointer, layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        COUNT.with(|count| count.set(count.get() + 1));
        unsafe { System.realloc(pointer, layout, size) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Allocations of a piece of work.
fn allocations(work: impl FnOnce()) -> usize {
    let before = COUNT.with(Cell::get);
    work();
    COUNT.with(Cell::get) - before
}

fn place() -> Geodetic {
    Geodetic::from_degrees(55.75, 37.62, 200.0)
}

fn start() -> Start {
    Start {
        time_s: 0.0,
        position_m: place().to_ecef().xyz(),
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

/// Nine satellites around the zenith of the place, at rest.
fn satellites() -> Vec<Ranging> {
    let here = place().to_ecef().xyz();
    (1u8..=9)
        .map(|number| {
            let (sin, cos) = (f64::from(number) * 0.7).sin_cos();
            let aside = Vector3::new(cos, sin, 0.3 * cos) * 1.5e7;
            let position_m = here * 4.0 + aside;
            let range_m = (position_m - here).norm();
            Ranging {
                satellite: Satellite { system: Constellation::Gps, number },
                motion: SatelliteMotion { position_m, velocity_mps: Vector3::zeros() },
                pseudorange_m: Some(Measured { value: range_m, sd: 3.0 }),
                range_rate_mps: Some(Measured { value: 0.0, sd: 0.1 }),
                phase_m: Some(Measured { value: range_m, sd: 0.003 }),
                slipped: false,
            }
        })
        .collect()
}

/// Accelerometers at 100 Hz, satellites and the arm's angle at 10 Hz.
fn push(filter: &mut ArmFilter, arm: &RotatingArm, satellites: &[Ranging], step: u32) {
    let time_s = f64::from(step) * 0.01;
    let angle = arm.angle_rad(time_s);
    let force = arm.at_angle(angle).acceleration_mps2 + Vector3::new(0.0, 9.81, 0.0);
    let with_all = step.is_multiple_of(10);
    let epoch = ArmEpoch {
        time_s,
        specific_force_mps2: Some(force),
        satellites: if with_all { satellites } else { &[] },
        arm_angle_rad: with_all.then_some(Measured { value: angle, sd: 0.01 }),
    };
    filter.push(&epoch).unwrap();
}

#[test]
fn no_update_of_the_arm_filter_allocates() {
    let satellites = satellites();
    let arm = RotatingArm::new(1.0, 1.0);
    let drift = Drift { initial_sd: 0.01, density: 1e-8 };
    for form in [AttitudeForm::Euler, AttitudeForm::Quaternion] {
        for (states_20, everything) in [(false, false), (true, false), (true, true)] {
            let settings = ArmFilterSettings {
                form,
                angular_acceleration: states_20,
                adaptive: everything,
                bias: everything.then_some(drift),
                arm_angle: everything.then_some(drift),
                ambiguity_slots: if everything { 12 } else { 0 },
                ..ArmFilterSettings::new(arm)
            };
            let mut filter = ArmFilter::new(settings, &start());
            (1..=200).for_each(|step| push(&mut filter, &arm, &satellites, step));
            let count = allocations(|| {
                (201..=1200).for_each(|step| push(&mut filter, &arm, &satellites, step));
            });
            assert_eq!(count, 0, "{form:?}, {} states", filter.state().len());
        }
    }
}

#[test]
fn no_sample_and_no_fix_of_the_attitude_filter_allocates() {
    let settings = InertialSettings {
        gyro_noise: 3e-5,
        gyro_bias_sd_radps: 5e-5,
        gyro_bias_walk: 1e-7,
        accelerometer_noise: 1e-3,
        accelerometer_bias_sd_mps2: 0.02,
        accelerometer_bias_walk: 1e-5,
        mounting_sd_rad: 0.0,
        unknown_acceleration: 1.0,
        gate: Gate::Innovation { sigmas: 5.0 },
    };
    let level = Attitude { heading_rad: 0.7, pitch_rad: 0.0, roll_rad: 0.0 };
    let attitude = MeasuredAttitude {
        ned_from_body: level.ned_from_body(),
        covariance: Matrix3::identity() * 1e-6,
    };
    let velocity = MeasuredVelocity {
        velocity_mps: Vector::new(0.0, 0.0, 0.0),
        covariance: Matrix3::identity() * 1e-4,
    };
    let mut filter = AttitudeFilter::new(settings, 0.0, &place(), &attitude, &velocity);
    let mut run = |steps: core::ops::RangeInclusive<u32>| {
        for step in steps {
            let sample = InertialSample {
                time_s: f64::from(step) * 0.01,
                rate_radps: Vector::new(0.0, 0.0, 0.0),
                specific_force_mps2: Some(Vector::new(0.0, 0.0, -9.81)),
            };
            filter.integrate(&sample).unwrap();
            if step % 10 == 0 {
                assert_eq!(filter.correct(Some(&attitude), Some(&velocity)).attitude.used, 3);
            }
        }
    };
    run(1..=100);
    assert_eq!(allocations(|| run(101..=1100)), 0);
}

/// Two antennas, each epoch by itself. What is left, 443, are the matrices of its double differences, what the searches
/// hand on, and the row.
#[test]
fn an_epoch_allocates_little() {
    let attitude = Attitude { heading_rad: 1.0, pitch_rad: 0.05, roll_rad: -0.03 };
    let body = world::Motion::at_rest(attitude, &[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]);
    let mut world = world::World::new().unwrap();
    let settings = kurs::Settings { antennas: 2, ..kurs::Settings::default() };
    let mut engine = kurs::Engine::new(settings, world.navigation.clone()).unwrap();
    let counts = (0..20).map(|k| {
        let epoch = world.epoch(&body, f64::from(k));
        allocations(|| assert!(engine.push(&epoch).is_fixed(), "epoch {k}"))
    });
    let most = counts.skip(10).max().unwrap();
    assert!(most <= 480, "{most} allocations");
}
