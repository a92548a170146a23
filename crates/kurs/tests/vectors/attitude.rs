//! Kinds `phase`, `omega` and `phase_collinear`: attitude from phases and from stacked baselines.

use kurs::attitude::reduction::{BaselineWeight, PhaseNormal, SingleDifferences};
use kurs::attitude::{AttitudeError, AttitudeProblem, Uniqueness, joint, wahba};
use nalgebra::{DMatrix, DVector, Vector3};
use serde_json::Value;

use crate::case::{Outcome, matrix, matrix3, number, numbers, vector3};

/// Fair for plain doubles against 50 digits (reference of the format).
const TOLERANCE: f64 = 1e-10;

pub(crate) fn phase(case: &Value, outcome: &mut Outcome) -> Result<(), String> {
    let (input, expected) = (&case["input"], &case["expected"]);
    let (normal, body) = reduce(input)?;
    let wanted_normal = matrix3(&expected["N"])?;
    outcome.compare("N", (normal.normal - wanted_normal).norm() / wanted_normal.norm(), TOLERANCE);

    if !expected["L_star"].is_null() {
        let wanted = matrix(&expected["L_star"])?;
        let baselines = normal.baselines_m().ok_or("no L_star")?;
        let found = DMatrix::from_fn(3, body.len(), |i, j| baselines[j][i]);
        outcome.compare("L_star", (found - &wanted).norm() / wanted.norm(), TOLERANCE);
        let rotation = wahba::solve(&body, &baselines, &vec![1.0; body.len()])
            .map_err(|error| format!("wahba: {error}"))?;
        let wanted = matrix3(&expected["wahba_Q"])?;
        outcome.compare("wahba_Q", (rotation - wanted).norm(), TOLERANCE);
    }
    for (name, weight) in
        [("diag", BaselineWeight::Independent), ("full", BaselineWeight::SharedAntenna)]
    {
        let problem = normal.problem(&body, weight).map_err(|error| error.to_string())?;
        compare_minimum(&problem, name, expected, outcome)?;
    }

    let full_rotation = matrix3(&expected["full_Q"])?;
    let minimum = normal
        .problem(&body, BaselineWeight::SharedAntenna)
        .and_then(|problem| problem.minimum_from(full_rotation))
        .map_err(|error| error.to_string())?;
    let covariance = minimum.covariance().map_err(|error| error.to_string())?;
    for (name, found) in
        [("full_info_gn_body", minimum.information), ("full_cov_gn_body", covariance)]
    {
        let wanted = matrix3(&expected[name])?;
        outcome.compare(name, (found - wanted).norm() / wanted.norm(), TOLERANCE);
    }
    let wanted = DVector::from_vec(numbers(&expected["full_sd_clock_m"])?);
    let found = DVector::from_vec(normal.clocks_m(&minimum.rotation, &body));
    outcome.compare("full_sd_clock_m", (found - &wanted).norm() / wanted.norm(), TOLERANCE);
    Ok(())
}

pub(crate) fn omega(case: &Value, outcome: &mut Outcome) -> Result<(), String> {
    let (input, expected) = (&case["input"], &case["expected"]);
    let measured = DVector::from_vec(numbers(&input["z"])?);
    let problem = joint::problem(&columns(&input["body"])?, &measured, &matrix(&input["omega"])?)
        .map_err(|error| error.to_string())?;
    compare_minimum(&problem, "", expected, outcome)
}

pub(crate) fn phase_collinear(case: &Value, outcome: &mut Outcome) -> Result<(), String> {
    let (input, expected) = (&case["input"], &case["expected"]);
    let (normal, body) = reduce(input)?;
    let axis = vector3(&expected["body_axis"])?;
    for (name, weight) in
        [("diag", BaselineWeight::Independent), ("full", BaselineWeight::SharedAntenna)]
    {
        let problem = normal.problem(&body, weight).map_err(|error| error.to_string())?;
        let found = problem.direction(&axis).map_err(|error| format!("{name}: {error}"))?;
        let wanted = vector3(&expected[format!("{name}_direction")])?;
        outcome.compare(&format!("{name}_direction"), (found.unit - wanted).norm(), TOLERANCE);
        let refused = problem.global_minimum(0.0) == Err(AttitudeError::Unobservable);
        outcome.expect("a full attitude is refused for antennas on a line", refused);
    }
    Ok(())
}

/// The global minimum, its cost, and the gap to the next one; `name` is the prefix of the keys.
fn compare_minimum(
    problem: &AttitudeProblem,
    name: &str,
    expected: &Value,
    outcome: &mut Outcome,
) -> Result<(), String> {
    let key = |rest: &str| if name.is_empty() { rest.to_owned() } else { format!("{name}_{rest}") };
    let cost = number(&expected[key("cost_reduced")])?;
    let gap = expected[key("next_local_min_cost_gap")].as_f64();
    // Equal to the last bit that doubles can tell.
    let are_equal = gap.is_some_and(|gap| gap < 1e-12 * cost.abs());

    let global = problem.global_minimum(0.0).map_err(|error| format!("{name}: {error}"))?;
    let found = global.minimum;
    let wanted = matrix3(&expected[key("Q")])?;
    let mut error = (found.rotation - wanted).norm();
    if are_equal {
        let second = matrix3(&expected[key("second_Q")])?;
        error = error.min((found.rotation - second).norm());
        let is_reported = global.uniqueness.is_ambiguous(1e-9 * cost.abs());
        outcome.expect(&format!("{}: two_minima is reported", key("Q")), is_reported);
    }
    outcome.compare(&key("Q"), error, TOLERANCE);
    outcome.compare(&key("cost_reduced"), (found.cost - cost).abs() / cost.abs(), TOLERANCE);
    if let Some(gap) = gap {
        match problem.search(found).uniqueness {
            Uniqueness::SecondMinimum { cost_gap, .. } => {
                let error = (cost_gap - gap).abs() / cost.abs();
                outcome.compare(&key("next_local_min_cost_gap"), error, TOLERANCE);
            }
            other => outcome
                .expect(&format!("{}: the next minimum is found, not {other:?}", key("Q")), false),
        }
    }
    Ok(())
}

fn reduce(input: &Value) -> Result<(PhaseNormal, Vec<Vector3<f64>>), String> {
    let lines_of_sight = rows(&input["los"])?;
    let sigma_m = numbers(&input["sigma_sd_m"])?;
    let phases = matrix(&input["phi_sd_m"])?;
    let epoch = SingleDifferences {
        lines_of_sight: &lines_of_sight,
        sigma_m: &sigma_m,
        phases_m: phases.as_slice(),
    };
    Ok((epoch.reduce().map_err(|error| error.to_string())?, columns(&input["body"])?))
}

/// Rows of three numbers.
pub(crate) fn rows(value: &Value) -> Result<Vec<Vector3<f64>>, String> {
    value.as_array().ok_or("rows were expected")?.iter().map(vector3).collect()
}

/// Columns of a matrix of three rows.
fn columns(value: &Value) -> Result<Vec<Vector3<f64>>, String> {
    let matrix = matrix(value)?;
    if matrix.nrows() != 3 {
        return Err(format!("three rows were expected, found {}", matrix.nrows()));
    }
    Ok(matrix.column_iter().map(|column| Vector3::from_iterator(column.iter().copied())).collect())
}
