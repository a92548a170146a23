//! Simulated observations solved by the engine: the two share no measurement equation, so signs and
//! conventions that agree here agree for good. Also: the same seed gives the same observations.
#![allow(clippy::unwrap_used, clippy::print_stdout)] // a test

use kurs::array::AntennaArray;
use kurs::engine::{Constraint, Engine, Settings};
use kurs::frames::Vector;
use kurs::sky::NoiseModel;
use kurs::solution::Status;
use kurs_sim::scenario::Scenario;
use kurs_sim::simulation::{Attachments, SimulatedEpoch, Simulation};
use nalgebra::Vector3;

const CAR: &str = include_str!("../../../../scenarios/car.toml");

fn car(seed: u64) -> Simulation {
    let mut scenario: Scenario = toml::from_str(CAR).unwrap();
    (scenario.seed, scenario.interval_s) = (seed, 1.0);
    // White noise of the engine's own law: no reflections, C/N0 full everywhere.
    (scenario.multipath.code_sd_m, scenario.multipath.phase_sd_m) = (0.0, 0.0);
    scenario.noise.cn0_zenith_dbhz = 65.0;
    Simulation::new(scenario, &Attachments::default()).unwrap()
}

#[test]
fn the_same_seed_gives_the_same_observations() {
    let (mut one, mut same, mut other) = (car(5), car(5), car(6));
    let mut epochs = [(); 3].map(|()| SimulatedEpoch::default());
    for _ in 0..5 {
        assert!(one.next_epoch(&mut epochs[0]) && same.next_epoch(&mut epochs[1]));
        assert!(other.next_epoch(&mut epochs[2]));
        assert_eq!(epochs[0], epochs[1]);
        assert_ne!(epochs[0], epochs[2]);
    }
}

/// Four simulations at once, each in a thread of its own, give the same bits as one alone.
#[test]
fn threads_do_not_change_observations() {
    let run = || {
        let (mut simulation, mut epoch) = (car(5), SimulatedEpoch::default());
        let epochs =
            core::iter::from_fn(|| simulation.next_epoch(&mut epoch).then(|| epoch.clone()));
        epochs.take(20).collect::<Vec<_>>()
    };
    let alone = run();
    std::thread::scope(|scope| {
        let threads: Vec<_> = (0..4).map(|_| scope.spawn(run)).collect();
        for thread in threads {
            assert_eq!(thread.join().unwrap(), alone);
        }
    });
}

/// Every epoch of the car is fixed, none is wrong, and the errors of the angles are as large as
/// the covariance says: mean NEES of three angles over 151 epochs, 99.9 % band 3 ± 0.66.
#[test]
fn the_car_is_solved_with_honest_sigmas() {
    let mut simulation = car(5);
    let antennas = &simulation.scenario().body[0].antenna;
    let places = antennas.iter().map(|a| Vector::from_xyz(Vector3::from(a.position_m))).collect();
    let settings = Settings {
        antennas: antennas.len(),
        array: Some(AntennaArray::new(places).unwrap()),
        array_sd_m: 0.0, // the simulated antennas are where they should be
        constraint: Constraint::None,
        noise: NoiseModel {
            code_zenith_m: 0.3,
            phase_zenith_m: 0.002,
            full_cn0_dbhz: 45.0,
            channel_sd_m: 0.0,
        },
        ..Settings::default()
    };
    let mut engine = Engine::new(settings, simulation.navigation().clone()).unwrap();
    let mut epoch = SimulatedEpoch::default();
    let (mut epochs, mut nees) = (0.0, 0.0);
    while simulation.next_epoch(&mut epoch) {
        let body = &epoch.bodies[0];
        let row = engine.push(&body.observed);
        assert_eq!(row.status(), Status::Fixed, "{}: {:?}", row.time, row.reason());
        let attitude = row.attitude().unwrap();
        let ned_from_body = attitude.ned_from_body.unwrap();
        let turn = ned_from_body.matrix() - body.truth.attitude.ned_from_body().matrix();
        assert!(turn.norm() < 0.05, "{}: {}", row.time, turn.norm());
        let truth = &body.truth.attitude;
        let heading = attitude.heading_rad.unwrap() - truth.heading_rad;
        let error = Vector3::new(
            heading.sin().atan2(heading.cos()),
            attitude.pitch_rad.unwrap() - truth.pitch_rad,
            attitude.roll_rad.unwrap() - truth.roll_rad,
        );
        let information = attitude.covariance_rad2.try_inverse().unwrap();
        nees += error.dot(&(information * error));
        epochs += 1.0;
    }
    let mean = nees / epochs;
    println!("{epochs} epochs, mean NEES {mean:.3} of 3");
    // The noise of these bands is independent; what bands may have in common makes the sigmas larger.
    assert!((1.5..3.66).contains(&mean), "{mean}");
}
