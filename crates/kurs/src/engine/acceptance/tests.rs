//! Every check opened and shut, and what becomes of an epoch that fails it.

use nalgebra::{DMatrix, DVector, Matrix3};

use super::*;

const SURE: Known = Known { code: 1e9, phase: 1e9 };
const RATE: f64 = 1e-3;

fn fit(sum: f64, degrees_of_freedom: usize) -> Fit {
    Fit { sum, degrees_of_freedom }
}

/// Integers that nothing is wrong with.
fn right() -> (Found, Conditional) {
    let found = Found {
        integers: vec![3.0; 8],
        misfit: fit(8.0, 8),
        is_without_geometry: false,
        doubt: 0.0,
        ratio: 40.0,
        rivals: 1e-9,
        success_rate: 0.999,
        closes: true,
    };
    let conditional = Conditional {
        correction_m: DVector::zeros(3),
        covariance_m2: DMatrix::identity(3, 3) * 1e-6,
        phase_fit: fit(5.0, 5),
        residual_rms_m: 0.002,
    };
    (found, conditional)
}

fn settings(constraint: Constraint, antennas: usize) -> Settings {
    Settings { constraint, antennas, ..Settings::default() }
}

/// The reasons of the checks that fail after a change of what is right.
fn failed(change: impl Fn(&mut Found, &mut Conditional, &mut Fit)) -> Vec<Reason> {
    let ((mut found, mut conditional), mut misfit) = (right(), fit(8.0, 8));
    change(&mut found, &mut conditional, &mut misfit);
    let settings = settings(Constraint::Array, 3);
    let checks = Checks::of_integers(&found, &conditional, misfit, SURE, &settings, RATE);
    assert_eq!(checks.0.len(), 6);
    checks.0.iter().filter(|check| check.fails()).map(|check| check.reason).collect()
}

fn attitude(pitch: f64, roll: f64) -> AttitudeEstimate {
    AttitudeEstimate {
        heading_rad: Some(1.0),
        pitch_rad: Some(pitch),
        roll_rad: Some(roll),
        covariance_rad2: Matrix3::identity() * 1e-6,
        installation_rad2: Matrix3::zeros(),
        ned_from_body: None,
        line_elevation_rad: None,
    }
}

fn orientation(geometry: Option<Fit>, attitude: Result<AttitudeEstimate, Reason>) -> Orientation {
    Orientation { attitude, geometry, misfit: None }
}

/// Fisher's distribution: its 95 % point for 10 and 20 degrees of freedom is 2.3479, that of χ² with 10 18.307.
#[test]
fn sums_are_judged_by_what_is_known_of_the_noise() {
    let known = Scale { degrees_of_freedom: 20.0 };
    assert!((known.probability(23.479, 10) - 0.05).abs() < 1e-5);
    let sure = Scale { degrees_of_freedom: 1e9 };
    assert!((sure.probability(18.307, 10) - 0.05).abs() < 1e-5);
    assert_eq!(Known { code: 7.0, phase: 50.0 }.all().degrees_of_freedom, 7.0);
}

#[test]
fn right_integers_pass() {
    assert_eq!(failed(|_, _, _| {}), []);
}

#[test]
fn other_integers_have_to_be_improbable() {
    assert_eq!(failed(|found, _, _| found.rivals = 0.99 * RATE), []);
    assert_eq!(failed(|found, _, _| found.rivals = 1.01 * RATE), [Reason::Ratio]);
    let weak = |found: &mut Found, rate: f64| (found.rivals, found.success_rate) = (1.0, rate);
    assert_eq!(failed(|found, _, _| weak(found, 0.51)), [Reason::Ratio]);
    assert_eq!(failed(|found, _, _| weak(found, MIN_SUCCESS)), [Reason::Ratio]);
    assert_eq!(failed(|found, _, _| weak(found, 0.49)), [Reason::SuccessRate]);
    assert_eq!(failed(|found, _, _| found.rivals = f64::NAN), [Reason::Ratio]);
}

#[test]
fn doubt_in_the_geometry_counts_like_rivals() {
    assert_eq!(failed(|found, _, _| found.doubt = 0.99 * RATE), []);
    assert_eq!(failed(|found, _, _| found.doubt = 1.01 * RATE), [Reason::Unproven]);
}

#[test]
fn each_check_of_the_integers_shuts() {
    // 0.3 m in the least certain coordinate.
    let sd = |conditional: &mut Conditional, m: f64| conditional.covariance_m2[(2, 2)] = m * m;
    assert_eq!(failed(|_, conditional, _| sd(conditional, 0.299)), []);
    assert_eq!(failed(|_, conditional, _| sd(conditional, MAX_FIXED_SD_M)), []);
    assert_eq!(failed(|_, conditional, _| sd(conditional, 0.301)), [Reason::WeakModel]);
    assert_eq!(failed(|found, _, _| found.closes = false), [Reason::Closure]);
    // χ² with 5 and 8 degrees of freedom exceeds 30.86 and 37.33 once in 100 000 times.
    assert_eq!(failed(|_, conditional, _| conditional.phase_fit.sum = 30.8), []);
    assert_eq!(failed(|_, conditional, _| conditional.phase_fit.sum = 30.9), [Reason::Residuals]);
    assert_eq!(failed(|_, _, misfit| misfit.sum = 37.3), []);
    assert_eq!(failed(|_, _, misfit| misfit.sum = 37.4), [Reason::Geometry]);
    assert_eq!(failed(|_, _, misfit| misfit.sum = f64::NAN), [Reason::Geometry], "no number");
}

/// A level that is hardly known refuses nothing that may be its own fault.
#[test]
fn a_young_session_is_lenient() {
    let (found, conditional) = right();
    let young = Known { code: 4.0, phase: 4.0 };
    let settings = settings(Constraint::Array, 3);
    let judge = |known| {
        let misfit = fit(60.0, 8);
        let conditional = Conditional { phase_fit: fit(60.0, 5), ..conditional.clone() };
        Checks::of_integers(&found, &conditional, misfit, known, &settings, RATE).hold()
    };
    assert_eq!((judge(young), judge(SURE)), (true, false));
    // Of phases and code it counts which is known less.
    assert!(!judge(Known { code: 4.0, ..SURE }), "the phases by themselves");
}

#[test]
fn what_integers_were_constrained_by_is_to_blame() {
    let blamed = |constraint, antennas| misfit_reason(&settings(constraint, antennas));
    assert_eq!(blamed(Constraint::None, 3), Reason::Residuals);
    assert_eq!(blamed(Constraint::Length, 3), Reason::Length);
    assert_eq!(blamed(Constraint::Array, 2), Reason::Length);
    assert_eq!(blamed(Constraint::Array, 3), Reason::Geometry);
}

#[test]
fn baselines_have_to_fit_the_array() {
    let scale = Scale { degrees_of_freedom: 1e9 };
    let judge = |lengths: &[Fit], orientation: Orientation| {
        let mut checks = Checks::default();
        let settings = Settings { max_tilt_rad: 0.5, ..Settings::default() };
        checks.of_orientation(lengths, &orientation, scale, &settings);
        let reasons = checks.0.iter().filter(|check| check.fails()).map(|check| check.reason);
        (checks.0.len(), reasons.collect::<Vec<_>>())
    };
    let level = || Ok(attitude(0.0, 0.0));
    // 4.4172 sigma, once in 100 000 times.
    let lengths = |sigmas: f64| [fit(1.0, 1), fit(sigmas * sigmas, 1)];
    assert_eq!(judge(&lengths(4.41), orientation(None, level())), (3, vec![]));
    assert_eq!(judge(&lengths(4.42), orientation(None, level())), (3, vec![Reason::Length]));
    // Three degrees of freedom: 25.90.
    assert_eq!(judge(&[], orientation(Some(fit(25.8, 3)), level())), (2, vec![]));
    let bent = orientation(Some(fit(26.0, 3)), level());
    assert_eq!(judge(&[], bent), (2, vec![Reason::Geometry]));
    for (pitch, roll, holds) in
        [(0.5, -0.49, true), (0.51, 0.0, false), (0.0, -0.51, false), (-0.51, 0.1, false)]
    {
        let (_, reasons) = judge(&[], orientation(None, Ok(attitude(pitch, roll))));
        assert_eq!(reasons, if holds { vec![] } else { vec![Reason::Tilt] }, "{pitch} {roll}");
    }
    let two = orientation(None, Err(Reason::TwoMinima));
    assert_eq!(judge(&[], two), (1, vec![Reason::TwoMinima]));
}

#[test]
fn the_session_has_its_say() {
    let of_session = |fit_p: f64, shape_p: f64| {
        let settings = settings(Constraint::Length, 2);
        let (one, other) = ((fit(90.0, 30), fit_p), (fit(40.0, 3), shape_p));
        let checks = Checks::of_session(one, other, 1e-3, &settings);
        let [first, second] = [0, 1].map(|k| (checks.0[k].reason, checks.0[k].fails()));
        assert_eq!((checks.0[0].statistic, checks.0[1].degrees_of_freedom), (90.0, 3));
        (first, second)
    };
    let (length, geometry) = (Reason::Length, Reason::Geometry);
    assert_eq!(of_session(1.1e-5, 1.1e-3), ((length, false), (geometry, false)));
    assert_eq!(of_session(0.9e-5, 1.1e-3), ((length, true), (geometry, false)));
    assert_eq!(of_session(1.1e-5, 0.9e-3), ((length, false), (geometry, true)));
}

#[test]
fn witnesses_contradict_and_prove() {
    let failed = |testimony, is_strong| {
        let mut checks = Checks::default();
        checks.of_witness(testimony, is_strong);
        let failed = checks.0.iter().find(|check| check.fails());
        failed.map(|check| check.reason)
    };
    assert_eq!(failed(Testimony::Agrees, false), None);
    assert_eq!(failed(Testimony::Agrees, true), None);
    assert_eq!(failed(Testimony::Silent, true), None);
    assert_eq!(failed(Testimony::Silent, false), Some(Reason::Unproven));
    assert_eq!(failed(Testimony::Contradicts, true), Some(Reason::Contradiction));
    assert_eq!(failed(Testimony::Contradicts, false), Some(Reason::Contradiction));
}

#[test]
fn a_prediction_refuses() {
    let holds = |role| {
        let mut checks = Checks::default();
        checks.of_prediction(role);
        assert_eq!(checks.0[0].reason, Reason::Residuals);
        checks.hold()
    };
    assert!(holds(PredictionRole::Agreed) && holds(PredictionRole::Decided));
    assert!(!holds(PredictionRole::Refused));
}

/// A list in which these checks fail, in this order, between others that hold.
fn failing(reasons: &[Reason]) -> Checks {
    let mut checks = Checks::default();
    checks.demand(Reason::Tilt, 0.0, true);
    reasons.iter().for_each(|reason| checks.demand(*reason, 0.0, false));
    checks.demand(Reason::Closure, 0.0, true);
    checks
}

#[test]
fn the_first_check_that_fails_decides() {
    let found = attitude(0.1, 0.2);
    let outcome = |reasons: &[Reason]| failing(reasons).outcome(Ok(found), false);
    assert_eq!(outcome(&[]), Outcome::Fixed { attitude: found });
    assert!(failing(&[]).hold() && !failing(&[Reason::Tilt]).hold());
    let unsure = [
        Reason::WeakModel,
        Reason::Ratio,
        Reason::SuccessRate,
        Reason::Unproven,
        Reason::Slip,
        Reason::Budget,
        Reason::NoPhase,
    ];
    for reason in Reason::ALL {
        let expected = if unsure.contains(&reason) {
            Outcome::Float { attitude: Some(found), reason: Some(reason) }
        } else {
            Outcome::Inconsistent { attitude: Some(found), reason }
        };
        assert_eq!(outcome(&[reason]), expected);
        assert_eq!(outcome(&[reason, Reason::Ratio, Reason::Tilt]), expected, "the first one");
    }
}

/// Where the carried ambiguities began anew, it is the slips that integers are not sure for.
#[test]
fn slips_are_to_blame_where_all_began_anew() {
    let reason = |reason, began_anew| {
        let outcome = failing(&[reason]).outcome(Ok(attitude(0.0, 0.0)), began_anew);
        (outcome.status(), outcome.reason())
    };
    use crate::solution::Status;
    for unsure in [Reason::Ratio, Reason::SuccessRate] {
        assert_eq!(reason(unsure, true), (Status::Float, Some(Reason::Slip)));
        assert_eq!(reason(unsure, false), (Status::Float, Some(unsure)));
    }
    assert_eq!(reason(Reason::Length, true), (Status::Inconsistent, Some(Reason::Length)));
    assert_eq!(reason(Reason::WeakModel, true), (Status::Float, Some(Reason::WeakModel)));
}

#[test]
fn nothing_is_fixed_without_an_attitude() {
    let without = Checks::default().outcome(Err(Reason::TwoMinima), false);
    assert_eq!(without, Outcome::Inconsistent { attitude: None, reason: Reason::TwoMinima });
}
