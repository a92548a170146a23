//! What a prediction of the attitude does for the integers, laid against the simulator's own: a reduced run
//! of the example `predicted_integers`.
#![allow(clippy::unwrap_used, clippy::print_stdout)]

use crate::predicting::{Case, Fault, JOLT_S, Judged, OUTAGE_ENDS_S, solve};
use crate::solving;
use kurs::engine::{Constraint, Engine, PredictedAttitude};
use kurs::frames::{Attitude, Rotation};
use kurs::solution::{PredictionRole, Reason, Status};
use kurs_sim::simulation::{Attachments, SimulatedEpoch, Simulation};
use nalgebra::Matrix3;

/// So many epochs in a row must contradict the filter before it begins anew.
const LOCKED_OUT_EPOCHS: f64 = 20.0;
const INTERVAL_S: f64 = 0.5;

fn epochs(case: Case, fault: Fault, seeds: core::ops::Range<u64>) -> Vec<[Judged; 2]> {
    seeds.flat_map(|seed| solve(case.scenario(seed), fault)).collect()
}

fn count(epochs: &[[Judged; 2]], way: usize, which: fn(&Judged) -> bool) -> usize {
    epochs.iter().filter(|epoch| which(&epoch[way])).count()
}

/// Two antennas and few satellites: many more epochs are fixed, none wrong, none refused.
#[test]
fn a_prediction_fixes_what_is_too_weak_alone() {
    for (case, factor, share) in
        [(Case::SixSatellites, 1.5, 0.2), (Case::SevenSatellites, 1.1, 0.55)]
    {
        let epochs = epochs(case, Fault::None, 0..3);
        let fixed = [0, 1].map(|way| count(&epochs, way, Judged::is_fixed));
        println!("{}: {fixed:?} of {}", case.name(), epochs.len());
        assert!(fixed[1] as f64 > factor * fixed[0] as f64, "{fixed:?}");
        assert!(fixed[1] as f64 > share * epochs.len() as f64, "{fixed:?}");
        assert_eq!(count(&epochs, 1, Judged::is_wrong), 0);
        assert_eq!(count(&epochs, 1, Judged::is_refused), 0);
    }
}

/// Ten seconds without satellites, then few of them: nearly all epochs are fixed, wherever code determines the
/// baselines at all, some of them at once.
#[test]
fn the_first_epoch_after_an_outage_is_fixed() {
    let mut returns = 0;
    for seed in 0..4 {
        let epochs = solve(Case::Outage.scenario(seed), Fault::None);
        let back = epochs.iter().find(|epoch| epoch[1].time_s > OUTAGE_ENDS_S).unwrap();
        // Where integers are found but two attitudes go with them, none is picked: not counted here.
        let float = |epoch: &&[Judged; 2]| {
            (OUTAGE_ENDS_S..OUTAGE_ENDS_S + 20.0).contains(&epoch[1].time_s)
                && epoch[1].status == Status::Float
        };
        let floats = epochs.iter().filter(float).count();
        returns += usize::from(back[1].is_fixed());
        assert!(floats <= 5, "seed {seed}: {floats} not fixed");
        assert_eq!(count(&epochs, 1, Judged::is_wrong), 0);
    }
    assert!(returns >= 1, "{returns} of 4");
}

/// A prediction that is wrong refuses right fixes, but makes no wrong ones.
#[test]
fn a_wrong_prediction_makes_no_wrong_fix() {
    for fault in [Fault::GyroBias(0.5), Fault::Heading(20.0), Fault::Heading(-7.0)] {
        for case in [Case::SixSatellites, Case::SevenSatellites, Case::Outage] {
            let epochs = epochs(case, fault, 0..2);
            assert_eq!(count(&epochs, 1, Judged::is_wrong), 0, "{case:?} {fault:?}");
        }
    }
}

/// Predictions that are no attitudes say nothing; one that is endlessly sure refuses, and no more.
#[test]
fn what_is_no_prediction_changes_nothing() {
    let scenario = Case::Outage.scenario(0);
    let settings = solving::settings(&scenario, Constraint::Array);
    let mut simulation = Simulation::new(scenario, &Attachments::default()).unwrap();
    let navigation = simulation.navigation().clone();
    let mut epoch = SimulatedEpoch::default();
    assert!(simulation.next_epoch(&mut epoch));
    let observed = &epoch.bodies[0].observed;
    let solved = |ned_from_body: Matrix3<f64>, covariance_rad2: Matrix3<f64>| {
        let mut engine = Engine::new(settings.clone(), navigation.clone()).unwrap();
        let ned_from_body = Rotation::from_matrix(ned_from_body);
        let predicted = PredictedAttitude { ned_from_body, covariance_rad2, may_decide: true };
        engine.push_predicted(observed, Some(&predicted))
    };
    let alone = Engine::new(settings.clone(), navigation.clone()).unwrap().push(observed);
    // The first epoch of a weak model: nothing confirms it yet.
    assert_eq!((alone.status(), alone.reason()), (Status::Float, Some(Reason::Unproven)));
    let usual = Matrix3::identity() * 1e-4;
    for (matrix, covariance) in [
        (Matrix3::repeat(f64::NAN), usual),
        (Matrix3::zeros(), usual),
        (Matrix3::identity(), Matrix3::repeat(f64::NAN)),
        (Matrix3::identity(), Matrix3::identity() * f64::INFINITY),
        (Matrix3::identity(), Matrix3::identity() * 1e300),
        (Matrix3::identity(), Matrix3::identity()),
        (Matrix3::identity(), -usual),
    ] {
        assert_eq!(solved(matrix, covariance), alone, "{matrix} {covariance}");
    }
    let truth = epoch.bodies[0].truth.attitude;
    let away = Attitude { heading_rad: truth.heading_rad + 0.5, ..truth }.ned_from_body().matrix();
    for covariance in [Matrix3::zeros(), usual] {
        let refused = solved(away, covariance);
        assert_eq!(refused.prediction(), Some(PredictionRole::Refused));
        assert_eq!(
            (refused.status(), refused.reason()),
            (Status::Inconsistent, Some(Reason::Residuals))
        );
    }
    let right = solved(truth.ned_from_body().matrix(), usual);
    assert_eq!(right.prediction(), Some(PredictionRole::Agreed));
    assert_eq!(right.attitude(), alone.attitude(), "the prediction is not in the attitude");
}

/// A filter that has gone wrong does not lock right fixes out for long.
#[test]
fn right_fixes_return_after_the_filter_was_wrong() {
    let epochs = solve(Case::Outage.scenario(1), Fault::GyroJolt(1.0));
    let between = |from_s: f64, to_s: f64| -> Vec<[Judged; 2]> {
        epochs.iter().filter(|e| (from_s..to_s).contains(&e[1].time_s)).copied().collect()
    };
    let during = between(JOLT_S.start, JOLT_S.end);
    assert!(count(&during, 1, Judged::is_refused) > 5, "the filter noticed nothing");
    let after = between(JOLT_S.end + (LOCKED_OUT_EPOCHS + 2.0) * INTERVAL_S, OUTAGE_ENDS_S - 10.0);
    assert_eq!(count(&after, 1, Judged::is_fixed), after.len());
    assert_eq!(count(&epochs, 1, Judged::is_wrong), 0);
}
