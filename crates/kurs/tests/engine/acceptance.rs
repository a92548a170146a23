//! Every reason for which an epoch is not fixed, brought about and taken away again.

use kurs::engine::PredictedAttitude;
use kurs::solution::{Outcome, PredictionRole};
use kurs::{AntennaArray, Constraint, EpochSolution, Reason, Settings, Status, Vector};
use nalgebra::Matrix3;

use super::world::{Motion, World};
use super::{RECTANGLE_M, TRIANGLE_M, degrees, engine, rows, told};

/// A baseline of a metre.
const LINE_M: [[f64; 3]; 2] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]];

/// Rows of a world with these settings.
fn solved(body: &Motion, settings: Settings, epochs: u32) -> Vec<EpochSolution> {
    let mut world = World::new().unwrap();
    let mut engine = engine(settings, &world);
    rows(&mut engine, &mut world, body, epochs)
}

/// The array with one antenna moved by so much.
fn moved(body: &Motion, antenna: usize, by_m: [f64; 3]) -> Settings {
    let [x, y, z] = by_m;
    let mut places_m = body.antennas_m.clone();
    places_m[antenna] += Vector::new(x, y, z);
    Settings { array: Some(AntennaArray::new(places_m).unwrap()), ..told(body) }
}

fn count(rows: &[EpochSolution], status: Status, reason: Option<Reason>) -> usize {
    rows.iter().filter(|row| (row.status(), row.reason()) == (status, reason)).count()
}

#[test]
fn a_wrong_length_is_refused() {
    let body = Motion::at_rest(degrees(45.0, 2.0, 0.0), &LINE_M);
    let right = solved(&body, told(&body), 20);
    assert_eq!(count(&right, Status::Fixed, None), 20);
    for off_m in [0.04, -0.04, 0.3] {
        let wrong = solved(&body, moved(&body, 1, [off_m, 0.0, 0.0]), 20);
        assert_eq!(count(&wrong, Status::Fixed, None), 0, "{off_m}");
        let refused = |reason| count(&wrong, Status::Inconsistent, Some(reason));
        let refused = refused(Reason::Length) + refused(Reason::Geometry);
        assert!(refused >= 15, "{off_m}: {refused}");
    }
}

#[test]
fn a_wrong_array_is_refused() {
    let body = Motion::at_rest(degrees(45.0, 2.0, 3.0), &RECTANGLE_M);
    assert_eq!(count(&solved(&body, told(&body), 20), Status::Fixed, None), 20);
    for off_m in [[0.0, 0.06, 0.0], [0.0, 0.0, -0.08], [0.4, 0.0, 0.0]] {
        let wrong = solved(&body, moved(&body, 2, off_m), 20);
        assert_eq!(count(&wrong[5..], Status::Fixed, None), 0, "{off_m:?}");
        let refused = wrong.iter().filter(|row| row.status() == Status::Inconsistent).count();
        assert!(refused >= 15, "{off_m:?}: {refused}");
    }
}

#[test]
fn a_body_that_tilts_too_far_is_refused() {
    for (pitch, roll, is_refused) in [(24.0, 0.0, true), (0.0, -24.0, true), (16.0, -16.0, false)] {
        let body = Motion::at_rest(degrees(45.0, pitch, roll), &TRIANGLE_M);
        let settings = Settings { max_tilt_rad: 20f64.to_radians(), ..told(&body) };
        for row in solved(&body, settings, 3) {
            let expected = match is_refused {
                true => (Status::Inconsistent, Some(Reason::Tilt)),
                false => (Status::Fixed, None),
            };
            assert_eq!((row.status(), row.reason()), expected, "{pitch} {roll}");
            assert!(row.attitude().is_some(), "what is refused is told");
        }
    }
}

/// Five satellites of one band with nothing known: the integers of an epoch are a guess.
#[test]
fn a_weak_model_is_not_fixed() {
    let mut world = World::new().unwrap();
    let body = Motion::at_rest(degrees(45.0, 2.0, 0.0), &LINE_M);
    let settings = Settings { constraint: Constraint::None, ..told(&body) };
    let mut engine = engine(settings, &world);
    for second in 0..10 {
        let mut epoch = world.epoch(&body, f64::from(second));
        for observed in epoch.antennas.iter_mut().flatten() {
            observed.observations.retain(|o| o.satellite.system == kurs::System::Gps);
            observed.observations.truncate(5);
        }
        let row = engine.push(&epoch);
        assert_eq!(row.status(), Status::Float, "{:?}", row.outcome);
        let unsure = [Reason::WeakModel, Reason::SuccessRate, Reason::Ratio, Reason::Unproven];
        assert!(unsure.contains(&row.reason().unwrap()), "{:?}", row.reason());
    }
}

/// Every phase of one antenna off by another part of a cycle: no integers fit.
#[test]
fn phases_that_fit_no_integers_are_refused() {
    let mut world = World::new().unwrap();
    let body = Motion::at_rest(degrees(45.0, 2.0, 3.0), &TRIANGLE_M);
    let mut engine = engine(told(&body), &world);
    assert!(rows(&mut engine, &mut world, &body, 5)[4].is_fixed());
    for second in 5..15 {
        let mut epoch = world.epoch(&body, f64::from(second));
        for observation in &mut epoch.antennas[1].as_mut().unwrap().observations {
            let number = f64::from(observation.satellite.number);
            let part = 0.5 * (number * 0.618).fract();
            observation.phase_cycles = observation.phase_cycles.map(|phase| phase + part);
        }
        let row = engine.push(&epoch);
        assert!(!row.is_fixed(), "{second}");
    }
    assert!(engine.push(&world.epoch(&body, 16.0)).is_fixed(), "and is over");
}

/// A receiver that counts one cycle more from one epoch to the next, without saying so: right integers that
/// contradict those of the epochs before are not believed until they are confirmed.
#[test]
fn integers_that_contradict_those_before_are_refused() {
    let mut world = World::new().unwrap();
    let body = Motion::at_rest(degrees(45.0, 2.0, 3.0), &TRIANGLE_M);
    let mut engine = engine(told(&body), &world);
    let mut outcomes = Vec::new();
    for second in 0..12 {
        let mut epoch = world.epoch(&body, f64::from(second));
        for observed in epoch.antennas.iter_mut().flatten() {
            observed.observations.iter_mut().for_each(|o| o.doppler_hz = None);
        }
        if second >= 6 {
            // Two satellites at one antenna: of a single one it is plain who slipped.
            let observed = epoch.antennas[1].as_mut().unwrap();
            for observation in &mut observed.observations[..2] {
                observation.phase_cycles = observation.phase_cycles.map(|phase| phase + 1.0);
            }
        }
        let row = engine.push(&epoch);
        outcomes.push((row.status(), row.reason()));
    }
    let fixed = (Status::Fixed, None);
    assert_eq!(outcomes[..6], [fixed; 6]);
    assert_eq!(outcomes[6], (Status::Inconsistent, Some(Reason::Contradiction)));
    assert_eq!(outcomes[11], fixed, "{outcomes:?}");
}

/// A predicted attitude that is right agrees; one that is ten degrees off refuses; a single epoch that is not
/// sure is decided by it.
#[test]
fn a_predicted_attitude_agrees_refuses_and_decides() {
    let mut world = World::new().unwrap();
    let body = Motion::at_rest(degrees(45.0, 2.0, 3.0), &TRIANGLE_M);
    let predicted = |heading| PredictedAttitude {
        ned_from_body: degrees(heading, 2.0, 3.0).ned_from_body(),
        covariance_rad2: Matrix3::identity() * 1f64.to_radians().powi(2),
        may_decide: true,
    };
    let mut engine = engine(told(&body), &world);
    let right = engine.push_predicted(&world.epoch(&body, 0.0), Some(&predicted(45.5)));
    assert_eq!((right.is_fixed(), right.prediction()), (true, Some(PredictionRole::Agreed)));
    let wrong = engine.push_predicted(&world.epoch(&body, 1.0), Some(&predicted(65.0)));
    assert_eq!(wrong.prediction(), Some(PredictionRole::Refused));
    let Outcome::Inconsistent { attitude, reason: Reason::Residuals } = wrong.outcome else {
        panic!("{:?}", wrong.outcome);
    };
    assert!(attitude.is_some());
    let without = engine.push_predicted(&world.epoch(&body, 2.0), None);
    assert_eq!((without.is_fixed(), without.prediction()), (true, None));
}
