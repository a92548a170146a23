//! Points of trajectories: closed forms with their statuses, least squares with its covariance.

use kurs::frames::{Ecef, Rotation, Vector};
use kurs::trajectory::closed_form::{Preference, Refusal, Roots, common_perpendicular};
use kurs::trajectory::least_squares;
use kurs::trajectory::measurement::{Measurement, Quantity};
use kurs::trajectory::minimal_set::MinimalSet;
use kurs::trajectory::problem::Problem;
use kurs::trajectory::station::{Station, direction_from_angles};
use nalgebra::Matrix3;
use serde_json::Value;

use crate::case::{Outcome, matrix3, number, numbers, vector3};

/// Compares one case. Position errors are given relative to the position, whose share of the
/// tolerance is 1e-9; the other share is 1e-6 of its standard deviation.
pub(crate) fn check(case: &Value, outcome: &mut Outcome) -> Result<(), String> {
    let stations = stations(case)?;
    let measurements = measurements(case)?;
    let problem = Problem::new(&stations, &measurements).map_err(|error| error.to_string())?;
    let prior = Vector::from_xyz(vector3(&case["prior_r"])?);
    let expected_least_squares = &case["lsq"];
    let sigma_m = match &expected_least_squares["K"] {
        Value::Null => 0.0,
        covariance => matrix3(covariance)?.trace().sqrt(),
    };

    let set = MinimalSet::find(&problem).next().ok_or("no closed form was recognised")?;
    let named = case["set"].as_str() == Some(set.name(&problem));
    outcome.expect("the set is the one of the case", named);
    let found = set.roots(&problem);
    check_closed_form(&case["closed_form"], &found, prior, sigma_m, outcome)?;
    check_midpoint(&case["closed_form"], &problem, sigma_m, outcome)?;

    if expected_least_squares["converged"].as_bool() == Some(true) {
        let start = match found {
            Ok(roots) => {
                roots.choose(&Preference::Prior(prior)).map_err(|e| e.to_string())?.position_m
            }
            Err(_) => prior,
        };
        let estimate = least_squares::refine(&problem, start).map_err(|e| e.to_string())?;
        let expected = Vector::from_xyz(vector3(&expected_least_squares["r"])?);
        compare("least squares", estimate.position_m, expected, sigma_m, outcome);
        let covariance: Matrix3<f64> = matrix3(&expected_least_squares["K"])?;
        let error = (estimate.covariance_m2 - covariance).amax() / covariance.amax();
        outcome.compare("K", error, 1e-7);
        outcome.expect("at most five iterations", found.is_err() || estimate.iterations <= 5);
    }
    Ok(())
}

fn check_closed_form(
    expected: &Value,
    found: &Result<Roots, Refusal>,
    prior: Vector<Ecef>,
    sigma_m: f64,
    outcome: &mut Outcome,
) -> Result<(), String> {
    let status = found.as_ref().map_or_else(Refusal::status, |_| "ok");
    let accepted: Vec<&str> = match expected["accept_status"].as_array() {
        Some(list) => list.iter().filter_map(Value::as_str).collect(),
        None => expected["status"].as_str().into_iter().collect(),
    };
    if !accepted.contains(&status) {
        outcome.failures.push(format!("status {status}, expected {accepted:?}"));
    }
    let (Ok(roots), Some("ok")) = (found, expected["status"].as_str()) else { return Ok(()) };
    let choice = roots.choose(&Preference::Prior(prior)).map_err(|error| error.to_string())?;
    let position = Vector::from_xyz(vector3(&expected["r"])?);
    compare("closed form", choice.position_m, position, sigma_m, outcome);
    if let (Some(other), false) = (choice.other_m, expected["other_root_r"].is_null()) {
        let expected_other = Vector::from_xyz(vector3(&expected["other_root_r"])?);
        compare("other root", other, expected_other, sigma_m, outcome);
    }
    Ok(())
}

/// Two directions: the middle of the common perpendicular, where the case has one.
fn check_midpoint(
    expected: &Value,
    problem: &Problem,
    sigma_m: f64,
    outcome: &mut Outcome,
) -> Result<(), String> {
    let angles = problem.measurements().iter().map(|m| m.quantity).eq([
        Quantity::Azimuth,
        Quantity::Elevation,
        Quantity::Azimuth,
        Quantity::Elevation,
    ]);
    if expected["midpoint_r"].is_null() || !angles {
        return Ok(());
    }
    let value = |index: usize| problem.measurements()[index].value;
    let stations = [&problem.stations()[0], &problem.stations()[1]];
    let directions = [0, 2].map(|first| direction_from_angles(value(first), value(first + 1)));
    let middle = common_perpendicular(stations, directions).map_err(|error| error.to_string())?;
    let expected = Vector::from_xyz(vector3(&expected["midpoint_r"])?);
    compare("midpoint", middle.first_m, expected, sigma_m, outcome);
    Ok(())
}

fn compare(
    what: &str,
    found: Vector<Ecef>,
    expected: Vector<Ecef>,
    sigma_m: f64,
    outcome: &mut Outcome,
) {
    let length = expected.norm();
    outcome.compare(what, (found - expected).norm() / length, 1e-9 + 1e-6 * sigma_m / length);
}

/// The two angle stations, then the four beacons.
fn stations(case: &Value) -> Result<Vec<Station>, String> {
    let with_axes = |station: &Value| {
        let position = Vector::from_xyz(vector3(&station["b"])?);
        let phi = matrix3(&station["Phi"])?;
        // Columns of Φ: north, up, east; ours: north, east, down
        let (north, up, east) = (phi.column(0), phi.column(1), phi.column(2));
        let axes = Matrix3::from_columns(&[north.into_owned(), east.into_owned(), -up]);
        Ok::<_, String>(Station::with_axes(position, &Rotation::from_matrix(axes)))
    };
    let beacon = |place: &Value| {
        let axes = Rotation::from_matrix(Matrix3::identity());
        Ok::<_, String>(Station::with_axes(Vector::from_xyz(vector3(place)?), &axes))
    };
    let list = |key: &str| case[key].as_array().ok_or(format!("no list `{key}`"));
    let mut stations: Vec<Station> =
        list("stations")?.iter().map(with_axes).collect::<Result<_, _>>()?;
    if stations.len() != 2 {
        return Err("two stations were expected".to_owned());
    }
    for place in list("beacons")? {
        stations.push(beacon(place)?);
    }
    Ok(stations)
}

/// The measurements of the set named in the case.
fn measurements(case: &Value) -> Result<Vec<Measurement>, String> {
    use Quantity::{Azimuth, CosineEast, CosineNorth, Elevation, Range, RangeDifference};
    let difference = RangeDifference { reference: 2 };
    let kinds: &[(usize, Quantity)] = match case["set"].as_str() {
        Some("A4") => &[(0, Azimuth), (0, Elevation), (1, Azimuth), (1, Elevation)],
        Some("A3a") => &[(0, Azimuth), (0, Elevation), (1, Azimuth)],
        Some("A3g") => &[(0, Azimuth), (0, Elevation), (1, Elevation)],
        Some("DC4") => &[(0, CosineNorth), (0, CosineEast), (1, CosineNorth), (1, CosineEast)],
        Some("RAE") => &[(0, Range), (0, Azimuth), (0, Elevation)],
        Some("R3") => &[(2, Range), (3, Range), (4, Range)],
        Some("RD3") => &[(3, difference), (4, difference), (5, difference)],
        other => return Err(format!("unknown set {other:?}")),
    };
    let values = numbers(&case["y"])?;
    let sigmas = match &case["sigma"] {
        Value::Array(_) => numbers(&case["sigma"])?,
        one => vec![number(one)?; kinds.len()],
    };
    if values.len() != kinds.len() || sigmas.len() != kinds.len() {
        return Err("as many values and sigmas as the set has were expected".to_owned());
    }
    let all = kinds.iter().zip(values).zip(sigmas);
    Ok(all
        .map(|((&(station, quantity), value), sigma)| Measurement {
            station,
            quantity,
            value,
            sigma,
        })
        .collect())
}
