//! `kurs.selection`, `kurs.calibration` and `kurs.trajectory`: arrays in and out.

use kurs::array::AntennaArray;
use kurs::calibration::sensor_model::{CalibrationProblem, Pose, SensorModel};
use kurs::calibration::{
    allan, gyro_bias as of_rest, multi_pose as of_poses, six_position as of_six, static_intervals,
};
use kurs::frames::Vector;
use kurs::selection::{Baselines, Criterion, Graph, select as choose};
use kurs::trajectory::least_squares;
use kurs::trajectory::measurement::{Measurement, Quantity};
use kurs::trajectory::problem::Problem;
use kurs::trajectory::station::Station;
use nalgebra::{Matrix3, Vector3};
use numpy::{PyArray1, PyArray2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::arrays::{self, Numbers, Stack};
use crate::errors::{self, NoSolution};

fn unsolved(error: impl std::fmt::Display) -> PyErr {
    NoSolution::new_err(error.to_string())
}

/// Refuses a time between samples that cannot be.
fn check_step(step_s: f64) -> PyResult<()> {
    if step_s > 0.0 && step_s.is_finite() {
        return Ok(());
    }
    Err(PyValueError::new_err(format!("step_s is {step_s}, expected a number above zero")))
}

fn matrix<'py>(py: Python<'py>, of: &Matrix3<f64>) -> Bound<'py, PyArray2<f64>> {
    let rows: Vec<Vec<f64>> = of.row_iter().map(|row| row.iter().copied().collect()).collect();
    PyArray2::from_vec2(py, &rows).unwrap_or_else(|_| PyArray2::zeros(py, [3, 3], false))
}

fn vector<'py>(py: Python<'py>, of: &Vector3<f64>) -> Bound<'py, PyArray1<f64>> {
    PyArray1::from_slice(py, of.as_slice())
}

/// The best baselines (pairs of antennas) of an array of positions_m (n, 3), body axes: pairs, criterion, bound.
///
/// `graph`: "tree" (connects all antennas), "general" (leaves none out), "all". `criterion`: "baseline_condition",
/// "information_condition", "smallest_information", "trace_of_covariance".
#[pyfunction]
#[pyo3(signature = (positions_m, *, graph="tree", criterion="trace_of_covariance", seed=1))]
#[allow(clippy::type_complexity)] // pairs and two numbers
pub(crate) fn select(
    py: Python<'_>,
    positions_m: Numbers<'_>,
    graph: &str,
    criterion: &str,
    seed: u64,
) -> PyResult<(Vec<(usize, usize)>, f64, f64)> {
    let graph = match graph {
        "tree" => Graph::SpanningTree,
        "general" => Graph::General,
        "all" => Graph::AllPairs,
        other => {
            let text = format!("graph is {other:?}, expected \"tree\", \"general\" or \"all\"");
            return Err(PyValueError::new_err(text));
        }
    };
    let criterion = match criterion {
        "baseline_condition" => Criterion::BaselineCondition,
        "information_condition" => Criterion::InformationCondition,
        "smallest_information" => Criterion::SmallestInformation,
        "trace_of_covariance" => Criterion::TraceOfCovariance,
        other => {
            let text = format!(
                "criterion is {other:?}, expected \"baseline_condition\", \"information_condition\", \
                 \"smallest_information\" or \"trace_of_covariance\""
            );
            return Err(PyValueError::new_err(text));
        }
    };
    let positions = Stack::of_points(&positions_m, "positions_m")?.alone("positions_m")?.points(0);
    let array = AntennaArray::new(positions.into_iter().map(Vector::from_xyz).collect());
    let baselines = Baselines::of(&array.map_err(unsolved)?).map_err(unsolved)?;
    let chosen = py.detach(|| choose(&baselines, graph, criterion, &mut seeded(seed)));
    let chosen = chosen.map_err(unsolved)?;
    Ok((chosen.pairs, chosen.value, chosen.bound))
}

fn seeded(seed: u64) -> rand_xoshiro::Xoshiro256PlusPlus {
    rand::SeedableRng::seed_from_u64(seed)
}

/// Poses of the rests, each the mean of its samples.
fn poses(samples_mps2: &Numbers<'_>, sd_mps2: f64, samples: usize) -> PyResult<Vec<Pose>> {
    let means = Stack::of_points(samples_mps2, "poses_mps2")?.alone("poses_mps2")?.points(0);
    let pose = |mean_mps2| Pose { mean_mps2, sample_sd_mps2: sd_mps2, samples };
    Ok(means.into_iter().map(pose).collect())
}

fn model(
    py: Python<'_>,
    found: Result<SensorModel, CalibrationProblem>,
) -> PyResult<Bound<'_, PyDict>> {
    let found = found.map_err(unsolved)?;
    let named = PyDict::new(py);
    named.set_item("matrix", matrix(py, &found.matrix))?;
    named.set_item("bias_mps2", vector(py, &found.bias_mps2))?;
    named.set_item("matrix_sd", matrix(py, &found.matrix_sd))?;
    named.set_item("bias_sd_mps2", vector(py, &found.bias_sd_mps2))?;
    Ok(named)
}

/// Accelerometer model y = matrix a + bias from mean readings poses_mps2 (k, 3) at rest, sensor axes, in any poses.
///
/// `sample_sd_mps2`: noise of one sample; `samples`: how many are in each mean.
#[pyfunction]
#[pyo3(signature = (poses_mps2, gravity_mps2, *, sample_sd_mps2=0.01, samples=100))]
pub(crate) fn multi_pose<'py>(
    py: Python<'py>,
    poses_mps2: Numbers<'py>,
    gravity_mps2: f64,
    sample_sd_mps2: f64,
    samples: usize,
) -> PyResult<Bound<'py, PyDict>> {
    model(py, of_poses::calibrate(&poses(&poses_mps2, sample_sd_mps2, samples)?, gravity_mps2))
}

/// Accelerometer model y = matrix a + bias from mean readings poses_mps2 (k ≥ 6, 3), each axis once up, once down.
///
/// `levelling_deg`: how well the box was levelled, 1 sigma.
#[pyfunction]
#[pyo3(signature = (poses_mps2, gravity_mps2, *, levelling_deg=0.0, sample_sd_mps2=0.01, samples=100))]
pub(crate) fn six_position<'py>(
    py: Python<'py>,
    poses_mps2: Numbers<'py>,
    gravity_mps2: f64,
    levelling_deg: f64,
    sample_sd_mps2: f64,
    samples: usize,
) -> PyResult<Bound<'py, PyDict>> {
    let poses = poses(&poses_mps2, sample_sd_mps2, samples)?;
    model(py, of_six::calibrate(&poses, gravity_mps2, levelling_deg.to_radians()))
}

/// Rests in samples_mps2 (n, 3): list of (first, behind the last), mean readings (k, 3); `step_s` between samples.
#[pyfunction]
#[allow(clippy::type_complexity)] // ranges and an array
pub(crate) fn rests<'py>(
    py: Python<'py>,
    samples_mps2: Numbers<'py>,
    step_s: f64,
) -> PyResult<(Vec<(usize, usize)>, Bound<'py, PyAny>)> {
    let samples = Stack::of_points(&samples_mps2, "samples_mps2")?.alone("samples_mps2")?.points(0);
    check_step(step_s)?;
    let settings = static_intervals::RestSettings::for_step(step_s);
    let found = py.detach(|| static_intervals::find(&samples, &settings));
    let means: Vec<f64> = found
        .iter()
        .flat_map(|rest| <[f64; 3]>::from(static_intervals::pose(&samples[rest.clone()]).mean_mps2))
        .collect();
    let means = arrays::shaped(py, means, Some(found.len()), &[3])?.into_any();
    Ok((found.into_iter().map(|rest| (rest.start, rest.end)).collect(), means))
}

/// Bias (3,) and its standard deviation (3,), rad/s, of a gyro from samples_radps (n, 3) at rest, sensor axes.
#[pyfunction]
#[allow(clippy::type_complexity)] // two arrays
pub(crate) fn gyro_bias<'py>(
    py: Python<'py>,
    samples_radps: Numbers<'py>,
) -> PyResult<(Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<f64>>)> {
    let samples =
        Stack::of_points(&samples_radps, "samples_radps")?.alone("samples_radps")?.points(0);
    let found = of_rest::calibrate(&samples).map_err(unsolved)?;
    Ok((vector(py, &found.bias_radps), vector(py, &found.sd_radps)))
}

/// Allan deviation of samples (n,) every step_s: averaging times (k,), s, deviations (k,), relative 1 sigma (k,).
#[pyfunction]
#[allow(clippy::type_complexity)] // three arrays
pub(crate) fn allan_deviation<'py>(
    py: Python<'py>,
    samples: Numbers<'py>,
    step_s: f64,
) -> PyResult<(Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<f64>>)> {
    let samples = Stack::new(&samples, 1, "samples")?.alone("samples")?;
    check_step(step_s)?;
    let points = py.detach(|| allan::deviation(samples.at(0), step_s));
    let column =
        |of: fn(&allan::AllanPoint) -> f64| PyArray1::from_vec(py, points.iter().map(of).collect());
    Ok((column(|p| p.tau_s), column(|p| p.deviation), column(|p| p.relative_sd)))
}

/// The columns of measurements as they come.
type Plain = (usize, String, Option<usize>);

/// Position (3,), m, covariance (3, 3), m², cost and method from measurements of stations_m (s, 3), ECEF.
///
/// `kinds` (m): (station, quantity, reference or None); quantity is "azimuth", "elevation" (rad), "range",
/// "range_difference" (m), "cosine_north", "cosine_east". values (m,) and sigmas (m,); give values (N, m) for N
/// positions at once: positions (N, 3), covariances (N, 3, 3), costs (N,), NaN where there is none. `axes` (s, 3, 3):
/// rotations ecef_from_local of the stations, whose columns are north, east and down in ECEF axes; by default those of
/// the ellipsoid.
#[pyfunction]
#[pyo3(signature = (stations_m, kinds, values, sigmas, *, prior_m=None, axes=None))]
#[allow(clippy::type_complexity, clippy::too_many_arguments)] // three arrays of columns
pub(crate) fn locate<'py>(
    py: Python<'py>,
    stations_m: Numbers<'py>,
    kinds: Vec<Plain>,
    values: Numbers<'py>,
    sigmas: Numbers<'py>,
    prior_m: Option<[f64; 3]>,
    axes: Option<Numbers<'py>>,
) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyAny>, Bound<'py, PyAny>)> {
    let places = Stack::of_points(&stations_m, "stations_m")?.alone("stations_m")?.points(0);
    let axes = axes.as_ref().map(|axes| Stack::of_square(axes, 3, "axes")).transpose()?;
    if let Some(axes) = &axes {
        if axes.count() != Some(places.len()) {
            let found: Vec<usize> = axes.count().into_iter().chain([3, 3]).collect();
            let expected = format!("({}, 3, 3), a rotation for each station", places.len());
            return Err(errors::of_shape("axes", &found, &expected));
        }
        axes.check_rotations("axes")?;
    }
    if let Some(prior_m) = prior_m.filter(|prior| prior.iter().any(|c| !c.is_finite())) {
        let text = format!("prior_m is {prior_m:?}, expected finite numbers");
        return Err(PyValueError::new_err(text));
    }
    let station = |(index, place): (usize, Vector3<f64>)| match &axes {
        Some(axes) => {
            let rotation = kurs::frames::Rotation::from_matrix(axes.matrix3(index));
            Station::with_axes(Vector::from_xyz(place), &rotation)
        }
        None => Station::at_ecef(Vector::from_xyz(place)),
    };
    let stations: Vec<Station> = places.into_iter().enumerate().map(station).collect();
    for (station, _, reference) in &kinds {
        for number in reference.iter().chain([station]) {
            if *number >= stations.len() {
                let text = format!("kinds has station {number}, expected below {}", stations.len());
                return Err(PyValueError::new_err(text));
            }
        }
    }
    let quantities: Vec<(usize, Quantity)> = kinds.iter().map(quantity).collect::<PyResult<_>>()?;
    let (values, sigmas) = (Stack::new(&values, 1, "values")?, Stack::new(&sigmas, 1, "sigmas")?);
    for (what, stack) in [("values", &values), ("sigmas", &sigmas)] {
        if stack.shape() != [kinds.len()] {
            let expected = format!("{} numbers, one for each of `kinds`", kinds.len());
            return Err(errors::of_shape(what, stack.shape(), &expected));
        }
    }
    sigmas.check("sigmas", "a number above zero", |sigma| sigma > 0.0 && sigma.is_finite())?;
    let problems = arrays::count(&[("values", &values), ("sigmas", &sigmas)])?;
    let count = problems.count;
    let prior = prior_m.map(|[x, y, z]| Vector::new(x, y, z));
    let solve = |problem: usize| -> Result<least_squares::Estimate, String> {
        let numbers = values.at(problem).iter().zip(sigmas.at(problem));
        let measurements: Vec<Measurement> = quantities
            .iter()
            .zip(numbers)
            .map(|((station, quantity), (value, sigma))| Measurement {
                station: *station,
                quantity: *quantity,
                value: *value,
                sigma: *sigma,
            })
            .collect();
        let problem = Problem::new(&stations, &measurements).map_err(|error| error.to_string())?;
        least_squares::solve(&problem, prior).map_err(|error| error.to_string())
    };
    let found = arrays::solve_all(py, problems, || (), |(), problem| solve(problem))?;
    if let (None, [Err(error)]) = (count, found.as_slice()) {
        return Err(unsolved(error));
    }
    let (mut positions, mut covariances, mut costs) = (Vec::new(), Vec::new(), Vec::new());
    for estimate in &found {
        let found = estimate.as_ref().ok();
        let nothing = Matrix3::from_element(f64::NAN);
        let position = found.map_or([f64::NAN; 3], |e| e.position_m.xyz().into());
        positions.extend(position);
        covariances.extend(found.map_or(nothing, |e| e.covariance_m2).iter().copied());
        costs.push(found.map_or(f64::NAN, |e| e.cost));
    }
    Ok((
        arrays::shaped(py, positions, count, &[3])?.into_any(),
        arrays::shaped(py, covariances, count, &[3, 3])?.into_any(),
        arrays::numbers(py, costs, count)?,
    ))
}

fn quantity((station, word, reference): &Plain) -> PyResult<(usize, Quantity)> {
    let quantity = match (word.as_str(), reference) {
        ("azimuth", None) => Quantity::Azimuth,
        ("elevation", None) => Quantity::Elevation,
        ("range", None) => Quantity::Range,
        ("range_difference", Some(reference)) => {
            Quantity::RangeDifference { reference: *reference }
        }
        ("cosine_north", None) => Quantity::CosineNorth,
        ("cosine_east", None) => Quantity::CosineEast,
        _ => {
            let text = format!(
                "quantity {word:?} with reference {reference:?}: expected \"azimuth\", \"elevation\", \"range\", \
                 \"cosine_north\", \"cosine_east\" without, or \"range_difference\" with a reference station"
            );
            return Err(PyValueError::new_err(text));
        }
    };
    Ok((*station, quantity))
}
