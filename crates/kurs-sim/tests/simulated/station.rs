//! Coordinates relative to a fixed station: a car with four antennas, 900 m from it, and the attitude
//! that the coordinates alone give (the chain of `docs/papers/004-three-antennas.md`) beside that of the array.
#![allow(clippy::unwrap_used, clippy::print_stdout)] // a test

use std::collections::VecDeque;

use crate::solving::{self, angle_errors, ready, settings};
use kurs::differential::Differential;
use kurs::engine::{Constraint, Engine, Settings};
use kurs::frames::{Ecef, Vector};
use kurs::orientation::{self, AntennaFix, Method, Orienter, PositionEpoch};
use kurs::solution::PositionOrigin;
use kurs_sim::scenario::{MotionPlan, Place, Scenario, Station};
use kurs_sim::simulation::{Attachments, SimulatedEpoch, Simulation};

/// Root of the mean square.
fn rms(values: &[f64]) -> f64 {
    (values.iter().map(|v| v * v).sum::<f64>() / values.len() as f64).sqrt()
}

/// The car, and the place of a station 900 m from it.
fn car_near_a_station(interval_s: f64, duration_s: f64) -> (Scenario, Place) {
    let mut scenario: Scenario = ready("car");
    (scenario.interval_s, scenario.duration_s) = (interval_s, duration_s);
    let place = Place { latitude_deg: 55.758, longitude_deg: 37.62, height_m: 215.0 };
    scenario.station = Some(Station { name: "BASE".into(), place, signals: None });
    (scenario, place)
}

#[test]
fn coordinates_of_a_car_near_a_station() {
    let (scenario, place) = car_near_a_station(1.0, 120.0);
    let known = settings(&scenario, Constraint::Array);
    let array = known.array.clone().unwrap();
    let mut simulation = Simulation::new(scenario, &Attachments::default()).unwrap();
    let station_m = place.geodetic().to_ecef();
    let engine = Engine::new(known, simulation.navigation().clone()).unwrap();
    let mut engine = Differential::new(engine, Some(station_m)).unwrap();
    let by_coordinates = Orienter::new(orientation::OrienterSettings {
        array: array.clone(),
        array_sd_m: 0.002,
        sd_scale: 1.0,
        method: Method::Weighted,
        max_tilt_rad: core::f64::consts::PI,
        roll_sd_rad: 0.1,
        max_angle_sd_rad: core::f64::consts::PI,
        points_m: Vec::new(),
    })
    .unwrap();
    let mut memory = by_coordinates.memory();

    let (mut by_code, mut by_phase, mut normalised) = (Vec::new(), Vec::new(), 0.0);
    let (mut own_headings, mut chain_headings) = (Vec::new(), Vec::new());
    let mut epochs = 0;
    let mut simulated = SimulatedEpoch::default();
    while simulation.next_epoch(&mut simulated) {
        epochs += 1;
        let body = &mut simulated.bodies[0];
        body.observed.station = simulated.station.take();
        let truth = &body.truth;
        let horizon = kurs::sky::Horizon::at(truth.position_m);
        let ecef_from_body = horizon.ned_from_ecef().inverse() * truth.attitude.ned_from_body();
        let row = engine.push(&body.observed, None);

        assert_eq!(row.by_code.len(), 4);
        let mut fixes = vec![None; 4];
        for place in &row.by_code {
            let true_m = truth.position_m + ecef_from_body * array.positions_m()[place.index];
            let found_m = place.geodetic.to_ecef();
            by_code.push((found_m - true_m).norm());
            let sd = |axis: usize| place.covariance_m2[(axis, axis)].sqrt();
            fixes[place.index] = Some(AntennaFix {
                position_m: found_m,
                sd_ned_m: [sd(0), sd(1), sd(2)],
                doubt: None,
            });
        }
        let epoch = PositionEpoch { time: row.time, antennas: fixes };
        let chain = by_coordinates.push(&epoch, &mut memory);
        chain_headings.extend(angle_errors(truth, &chain).map(|e| e.x.to_degrees()));
        if row.is_fixed() {
            own_headings.extend(angle_errors(truth, &row).map(|e| e.x.to_degrees()));
        }
        let position = row.position.unwrap();
        if position.covariance_m2.trace().sqrt() < 0.1 {
            let error_ned = horizon.ned_from_ecef() * (position.position_m - truth.position_m);
            by_phase.push(error_ned.norm());
            normalised += solving::normalised_square(&error_ned.xyz(), &position.covariance_m2);
        }
    }
    let (code_m, phase_m) = (rms(&by_code), rms(&by_phase));
    let consistency = normalised / by_phase.len() as f64;
    println!(
        "by code {code_m:.2} m, by phase {phase_m:.4} m in {} of {epochs} epochs, (error/σ)² of 3: \
         {consistency:.2}; heading of the coordinates {:.1}°, of the array {:.3}°",
        by_phase.len(),
        rms(&chain_headings),
        rms(&own_headings)
    );
    assert!(code_m <= 1.0, "{code_m}");
    assert!(by_phase.len() as f64 >= 0.95 * f64::from(epochs), "{} of {epochs}", by_phase.len());
    assert!(phase_m <= 0.02, "{phase_m}");
    assert!(rms(&own_headings) < 0.1 * rms(&chain_headings));
}

/// The station's epochs come 1.5 s or 6 s late: carried to the row they give coordinates by phase, or by code.
#[test]
fn an_older_epoch_of_the_station_is_carried_to_the_row() {
    for (lag, is_young) in [(3, true), (12, false)] {
        let (scenario, place) = car_near_a_station(0.5, 40.0);
        let known = settings(&scenario, Constraint::Array);
        let mut simulation = Simulation::new(scenario, &Attachments::default()).unwrap();
        let engine = Engine::new(known, simulation.navigation().clone()).unwrap();
        let mut engine = Differential::new(engine, Some(place.geodetic().to_ecef())).unwrap();
        let (mut late, mut by_phase, mut by_code) = (VecDeque::new(), Vec::new(), Vec::new());
        let (mut normalised, mut epochs) = (0.0, 0);
        let mut simulated = SimulatedEpoch::default();
        while simulation.next_epoch(&mut simulated) {
            let body = &mut simulated.bodies[0];
            late.push_back(simulated.station.take());
            if late.len() <= lag {
                continue;
            }
            epochs += 1;
            body.observed.station = late.pop_front().unwrap();
            let position = engine.push(&body.observed, None).position.unwrap();
            let horizon = kurs::sky::Horizon::at(body.truth.position_m);
            let error_ned = horizon.ned_from_ecef() * (position.position_m - body.truth.position_m);
            match position.origin {
                PositionOrigin::StationPhase => {
                    by_phase.push(error_ned.norm());
                    normalised +=
                        solving::normalised_square(&error_ned.xyz(), &position.covariance_m2);
                }
                PositionOrigin::StationCode => by_code.push(error_ned.norm()),
                PositionOrigin::Alone => panic!("a row without the station"),
            }
        }
        println!(
            "{} s late: by phase {:.4} m in {} of {epochs} epochs, by code {:.2} m",
            0.5 * lag as f64,
            rms(&by_phase),
            by_phase.len(),
            rms(&by_code)
        );
        if is_young {
            assert!(by_phase.len() >= 9 * epochs / 10, "{} of {epochs}", by_phase.len());
            assert!(rms(&by_phase) <= 0.03, "{}", rms(&by_phase));
            // Of three for errors as large as stated.
            assert!(normalised / by_phase.len() as f64 <= 4.0, "{normalised}");
        } else {
            assert_eq!((by_phase.len(), by_code.len()), (0, epochs));
            assert!(rms(&by_code) <= 1.0, "{}", rms(&by_code));
        }
    }
}

/// A rolling ship whose antennas are 25 m above its origin: the attitude's errors are in the covariance of the origin
/// and of a point ahead of it, and the velocity is the origin's, not the mast's.
#[test]
fn the_origin_far_below_the_antennas() {
    let mut scenario: Scenario = ready("ship");
    (scenario.interval_s, scenario.duration_s) = (1.0, 300.0);
    let MotionPlan::Ship { place, .. } = scenario.body[0].motion else { panic!("a ship") };
    scenario.station = Some(Station { name: "BASE".into(), place, signals: None });
    scenario.body[0].antenna.iter_mut().for_each(|antenna| antenna.position_m[2] -= 25.0);
    let known = Settings {
        points_m: vec![Vector::new(30.0, 0.0, 0.0)],
        ..settings(&scenario, Constraint::Array)
    };
    let antenna_m = known.array.as_ref().unwrap().positions_m()[0];
    let mut simulation = Simulation::new(scenario, &Attachments::default()).unwrap();
    let engine = Engine::new(known, simulation.navigation().clone()).unwrap();
    let mut engine = Differential::new(engine, Some(place.geodetic().to_ecef())).unwrap();
    let (mut origins, mut ahead, mut mast_mps, mut origin_mps) = (vec![], vec![], vec![], vec![]);
    let mut before: Option<(Vector<Ecef>, Vector<Ecef>)> = None;
    let mut simulated = SimulatedEpoch::default();
    while simulation.next_epoch(&mut simulated) {
        let body = &mut simulated.bodies[0];
        body.observed.station = simulated.station.take();
        let truth = &body.truth;
        let row = engine.push(&body.observed, None);
        let ecef_from_ned = kurs::sky::Horizon::at(truth.position_m).ned_from_ecef().inverse();
        let ecef_from_body = ecef_from_ned * truth.attitude.ned_from_body();
        let mast_m = truth.position_m + ecef_from_body * antenna_m;
        let turn_mps =
            before.replace((truth.position_m, mast_m)).map(|(origin_m, mast_before_m)| {
                (mast_m - mast_before_m) - (truth.position_m - origin_m)
            });
        let position = row.position.unwrap();
        if !row.is_fixed() || position.origin != PositionOrigin::StationPhase {
            continue;
        }
        let in_ned = |off: Vector<Ecef>| (ecef_from_ned.inverse() * off).xyz();
        let off = in_ned(position.position_m - truth.position_m);
        origins.push(solving::normalised_square(&off, &position.covariance_m2));
        let point_m = truth.position_m + ecef_from_body * Vector::new(30.0, 0.0, 0.0);
        let off = in_ned(row.points[0].geodetic.to_ecef() - point_m);
        ahead.push(solving::normalised_square(&off, &row.points[0].covariance_m2));
        if let Some(turn_mps) = turn_mps {
            mast_mps.push(turn_mps.norm());
            origin_mps.push((position.velocity_mps.unwrap() - truth.velocity_mps).norm());
        }
    }
    let mean = |squares: &[f64]| squares.iter().sum::<f64>() / (3 * squares.len()) as f64;
    let (origin, ahead) = (mean(&origins), mean(&ahead));
    let (origin_mps, mast_mps) = (rms(&origin_mps), rms(&mast_mps));
    println!(
        "{} epochs: (error/σ)² of the origin {origin:.2}, ahead {ahead:.2}; velocity off by {origin_mps:.2} m/s, \
         the mast moves against the origin with {mast_mps:.2} m/s",
        origins.len()
    );
    assert!(origins.len() >= 280, "{}", origins.len());
    assert!((0.3..1.5).contains(&origin) && (0.3..1.5).contains(&ahead), "{origin} {ahead}");
    assert!(origin_mps < 0.5 * mast_mps, "{origin_mps} {mast_mps}");
}

/// A station that stands a kilometre from where it is said to: rows keep the antennas' own coordinates.
#[test]
fn a_station_in_the_wrong_place_moves_nobody() {
    let (scenario, place) = car_near_a_station(1.0, 20.0);
    let known = settings(&scenario, Constraint::Array);
    let mut simulation = Simulation::new(scenario, &Attachments::default()).unwrap();
    let engine = Engine::new(known, simulation.navigation().clone()).unwrap();
    let told_m = place.geodetic().to_ecef() + Vector::new(1000.0, 0.0, 0.0);
    let mut engine = Differential::new(engine, Some(told_m)).unwrap();
    let mut simulated = SimulatedEpoch::default();
    let mut epochs = 0;
    while simulation.next_epoch(&mut simulated) {
        epochs += 1;
        let body = &mut simulated.bodies[0];
        body.observed.station = simulated.station.take();
        let row = engine.push(&body.observed, None);
        let position = row.position.unwrap();
        assert_eq!((position.origin, row.by_code.len()), (PositionOrigin::Alone, 0));
        assert!((position.position_m - body.truth.position_m).norm() < 20.0);
    }
    let station = engine.station_use();
    assert_eq!((station.epochs, station.used, station.apart), (epochs, 0, epochs));
    assert!((station.offset_m - 1000.0).abs() < 20.0, "{}", station.offset_m);
}
