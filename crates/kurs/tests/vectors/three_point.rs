//! Kind `three_point`: the published closed form, TRIAD and the weighted fit.

use kurs::attitude::{AttitudeError, coordinates, three_point, triad, wahba};
use kurs::frames::{Body, Ned, Rotation};
use nalgebra::{DVector, Vector3};
use serde_json::Value;

use crate::attitude::rows;
use crate::case::{Outcome, matrix3, number, numbers, vector3};

pub(crate) fn three_point(case: &Value, outcome: &mut Outcome) -> Result<(), String> {
    let (input, expected) = (&case["input"], &case["expected"]);
    let (body, measured) = (triangle(&input["body"])?, triangle(&input["measured"])?);
    let weights = numbers(&input["weights"])?;
    // Points far from the origin have lost digits before they come here.
    let distance = measured.iter().map(|point| point.norm()).fold(1.0, f64::max);
    let tolerance = if distance > 1e5 { 1e-8 } else { 1e-10 };

    published(&body, &measured, expected, tolerance, outcome)?;

    let [a, b, c] = body;
    let [ma, mb, mc] = measured;
    let found = triad::triad([&(b - a), &(c - a)], [&(mb - ma), &(mc - ma)])
        .map_err(|error| format!("triad: {error}"))?;
    let wanted = matrix3(&expected["Q_triad_AB_AC"])?;
    outcome.compare("Q_triad_AB_AC", (found - wanted).norm(), tolerance);

    let fit =
        coordinates::fit(&body, &measured, &weights).map_err(|error| format!("fit: {error}"))?;
    let wanted = matrix3(&expected["Q_wahba"])?;
    outcome.compare("Q_wahba", (fit.rotation - wanted).norm(), tolerance);
    let wanted = vector3(&expected["t_wahba"])?;
    outcome.compare("t_wahba", (fit.origin_m - wanted).norm() / distance, tolerance);
    let wanted = number(&expected["rms_residual"])?;
    outcome.compare("rms_residual", (fit.residual_rms_m - wanted).abs() / distance, tolerance);

    let wanted = numbers(&expected["quat_wxyz"])?;
    let by_matrix = Rotation::<Ned, Body>::from_matrix(fit.rotation).quaternion();
    let centred = |points: &[Vector3<f64>; 3]| -> Vec<Vector3<f64>> {
        let total: f64 = weights.iter().sum();
        let sum: Vector3<f64> = points.iter().zip(&weights).map(|(p, w)| p * *w).sum();
        points.iter().map(|point| point - sum / total).collect()
    };
    let by_davenport = wahba::attitude_profile(&centred(&body), &centred(&measured), &weights)
        .and_then(|profile| wahba::davenport_quaternion(&profile))
        .map_err(|error| format!("davenport: {error}"))?;
    for (name, found) in [("quat_wxyz", by_matrix), ("quat_wxyz (Davenport)", by_davenport)] {
        outcome.compare(name, quaternion_distance(&found, &wanted), tolerance);
    }
    Ok(())
}

/// Legs, corner and attitude of the published method, and its refusals.
fn published(
    body: &[Vector3<f64>; 3],
    measured: &[Vector3<f64>; 3],
    expected: &Value,
    tolerance: f64,
    outcome: &mut Outcome,
) -> Result<(), String> {
    let legs = three_point::squared_legs(measured);
    for (name, found) in ["d2", "e2", "f2"].into_iter().zip(legs) {
        let wanted = number(&expected[name])?;
        let scale = legs.iter().fold(wanted.abs(), |scale, leg| scale.max(leg.abs()));
        outcome.compare(name, (found - wanted).abs() / scale, tolerance);
    }
    let corner = three_point::corner(measured);
    let is_acute = expected["acute"].as_bool().ok_or("acute: true or false was expected")?;
    match &corner {
        Ok(corner) => {
            outcome.expect("obtuse measured triangle is refused", is_acute);
            let (size, wanted) = (corner.origin.norm(), vector3(&expected["O_prime"])?);
            outcome.compare("O_prime", (corner.origin - wanted).norm() / size.max(1.0), tolerance);
            let wanted = matrix3(&expected["M_columns"])?;
            outcome.compare("M_columns", (corner.axes - wanted).norm(), tolerance);
        }
        Err(error) => outcome.expect(&format!("acute triangle is taken ({error})"), !is_acute),
    }
    match three_point::attitude(body, measured) {
        Ok(found) if expected["Q_from_M"].is_null() => {
            outcome.expect(&format!("refused, not {found:?}"), false);
        }
        Ok(found) => {
            let wanted = matrix3(&expected["Q_from_M"])?;
            outcome.compare("Q_from_M", (found - wanted).norm(), tolerance);
        }
        Err(error) => {
            let is_refusal = matches!(error, AttitudeError::NotAcute { .. });
            let is_right = is_refusal && expected["Q_from_M"].is_null();
            outcome.expect(&format!("Q_from_M is found ({error})"), is_right);
        }
    }
    Ok(())
}

/// Distance of unit quaternions up to their common sign: at `w = 0` both signs are the same.
fn quaternion_distance(found: &[f64; 4], wanted: &[f64]) -> f64 {
    let (found, wanted) = (DVector::from_row_slice(found), DVector::from_row_slice(wanted));
    (&found - &wanted).norm().min((&found + &wanted).norm())
}

fn triangle(value: &Value) -> Result<[Vector3<f64>; 3], String> {
    rows(value)?.try_into().map_err(|_| "three points were expected".to_owned())
}
