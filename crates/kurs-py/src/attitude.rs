//! `kurs.attitude`: rotations from vectors, baselines and phases.

use std::collections::BTreeMap;
use std::f64::consts::PI;

use kurs::attitude::reduction::{BaselineWeight, SingleDifferences};
use kurs::attitude::{
    AttitudeError, AttitudeProblem, angles as of_angles, joint, three_point as published,
    wahba as closed_form,
};
use kurs::frames::{self, Body, Ned, Rotation};
use nalgebra::{DVector, Matrix3, Vector3};
use numpy::{PyArray1, PyArray2, PyArrayDyn, PyArrayMethods, PyReadonlyArray2};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::arrays::{self, Numbers, Problems, Stack};
use crate::errors::{self, NoSolution};

/// One rotation and what is known of it.
#[derive(Debug, Clone, Copy)]
struct Found {
    local_from_body: Matrix3<f64>,
    /// Of the rotation vector in body axes, rad².
    covariance_rad2: Matrix3<f64>,
    cost: f64,
    /// How much more the next local minimum costs.
    cost_gap: f64,
}

const UNKNOWN: f64 = f64::NAN;

impl Found {
    fn rotation(local_from_body: Matrix3<f64>) -> Self {
        let covariance_rad2 = Matrix3::from_element(UNKNOWN);
        Self { local_from_body, covariance_rad2, cost: UNKNOWN, cost_gap: UNKNOWN }
    }

    /// Numbers of [`Found::row`].
    const ROW: usize = 20;

    /// For [`Found::of_row`].
    fn row(&self) -> Vec<f64> {
        let matrices = self.local_from_body.iter().chain(&self.covariance_rad2);
        matrices.copied().chain([self.cost, self.cost_gap]).collect()
    }

    fn of_row(row: &[f64]) -> Self {
        Self {
            local_from_body: Matrix3::from_column_slice(&row[..9]),
            covariance_rad2: Matrix3::from_column_slice(&row[9..18]),
            cost: row[18],
            cost_gap: row[19],
        }
    }

    fn nothing() -> Self {
        Self::rotation(Matrix3::from_element(UNKNOWN))
    }

    /// The global minimum of a problem.
    fn minimum(problem: &AttitudeProblem) -> Result<Self, AttitudeError> {
        let global = problem.global_minimum(0.0)?;
        Ok(Self {
            local_from_body: global.minimum.rotation,
            covariance_rad2: global.minimum.covariance()?,
            cost: global.minimum.cost,
            cost_gap: global.uniqueness.cost_gap().unwrap_or(f64::INFINITY),
        })
    }

    fn angles(&self) -> frames::Attitude {
        frames::Attitude::from_ned_from_body(&Rotation::from_matrix(self.local_from_body))
    }

    /// Of heading (0), pitch (1) or roll (2); nothing is known of an angle that may be off by half a turn and more.
    fn angle_sd_rad(&self, angle: usize) -> f64 {
        let covariance = of_angles::angle_covariance(&self.angles(), &self.covariance_rad2);
        let sd_rad = covariance[(angle, angle)].sqrt();
        if sd_rad < PI { sd_rad } else { UNKNOWN }
    }
}

/// Rotation `local_from_body` (one, or N of them with a leading dimension); covariance in body axes, rad².
///
/// Angles are those of a body with forward-right-down axes in north-east-down ones. An attribute makes
/// its array anew each time.
#[pyclass(frozen, module = "kurs.attitude")]
#[derive(Debug)]
pub(crate) struct Attitude {
    found: Vec<Found>,
    /// `None`: one rotation without a leading dimension.
    count: Option<usize>,
    errors: Vec<(usize, String)>,
}

/// An [`Attitude`] in a pickle: matrices, covariances, costs and gaps in rows (n, 20), the number, the errors.
type Parts<'py> = (Bound<'py, PyArray2<f64>>, Option<usize>, Vec<(usize, String)>);

impl Attitude {
    /// Solves all problems. One that has no solution is an exception if it is alone, else NaN with its
    /// words in `errors`.
    fn solve(
        py: Python<'_>,
        problems: Problems,
        solve: impl Fn(usize) -> Result<Found, AttitudeError> + Sync + Send,
    ) -> PyResult<Self> {
        let words = |error: AttitudeError| error.to_string();
        Self::solve_in_words(py, problems, |problem| solve(problem).map_err(words))
    }

    /// As [`Attitude::solve`], of errors that are words already.
    fn solve_in_words(
        py: Python<'_>,
        problems: Problems,
        solve: impl Fn(usize) -> Result<Found, String> + Sync + Send,
    ) -> PyResult<Self> {
        let results = arrays::solve_all(py, problems, || (), |(), problem| solve(problem))?;
        let count = problems.count;
        let mut errors = Vec::new();
        let found = results.into_iter().enumerate().map(|(problem, result)| {
            result.unwrap_or_else(|error| {
                errors.push((problem, error));
                Found::nothing()
            })
        });
        let found = found.collect();
        match errors.first() {
            Some((_, error)) if count.is_none() => Err(NoSolution::new_err(error.clone())),
            _ => Ok(Self { found, count, errors }),
        }
    }

    fn matrices<'py>(
        &self,
        py: Python<'py>,
        of: impl Fn(&Found) -> Matrix3<f64>,
    ) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        let rows = self.found.iter().flat_map(|f| rows_of(&of(f))).collect();
        arrays::shaped(py, rows, self.count, &[3, 3])
    }

    fn degrees<'py>(
        &self,
        py: Python<'py>,
        of: impl Fn(&Found) -> f64,
    ) -> PyResult<Bound<'py, PyAny>> {
        let values = self.found.iter().map(|f| of(f).to_degrees()).collect();
        arrays::numbers(py, values, self.count)
    }

    fn plain<'py>(
        &self,
        py: Python<'py>,
        of: impl Fn(&Found) -> f64,
    ) -> PyResult<Bound<'py, PyAny>> {
        arrays::numbers(py, self.found.iter().map(of).collect(), self.count)
    }
}

/// Row after row, as numpy has it.
fn rows_of(matrix: &Matrix3<f64>) -> [f64; 9] {
    matrix.transpose().as_slice().try_into().unwrap_or([UNKNOWN; 9])
}

#[pymethods]
impl Attitude {
    /// `local_from_body`, (3, 3) or (N, 3, 3): multiplies columns of body components.
    #[getter]
    fn matrix<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        self.matrices(py, |f| f.local_from_body)
    }

    /// Unit quaternion of `local_from_body`, scalar first and not negative, (4,) or (N, 4).
    #[getter]
    fn quat_wxyz<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        let quaternion =
            |f: &Found| Rotation::<Ned, Body>::from_matrix(f.local_from_body).quaternion();
        arrays::shaped(py, self.found.iter().flat_map(quaternion).collect(), self.count, &[4])
    }

    /// Covariance of the rotation vector in body axes, rad², (3, 3) or (N, 3, 3); NaN where unknown.
    #[getter]
    fn cov<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        self.matrices(py, |f| f.covariance_rad2)
    }

    /// Heading, clockwise from north, 0 to 360 degrees.
    #[getter]
    fn heading_deg<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.degrees(py, |f| f.angles().heading_rad)
    }

    /// Pitch, nose up positive, degrees.
    #[getter]
    fn pitch_deg<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.degrees(py, |f| f.angles().pitch_rad)
    }

    /// Roll, right side down positive, degrees.
    #[getter]
    fn roll_deg<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.degrees(py, |f| f.angles().roll_rad)
    }

    /// Standard deviation of the heading, degrees; NaN where unknown, as near the vertical.
    #[getter]
    fn heading_sd_deg<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.degrees(py, |f| f.angle_sd_rad(0))
    }

    /// Standard deviation of the pitch, degrees; NaN where unknown.
    #[getter]
    fn pitch_sd_deg<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.degrees(py, |f| f.angle_sd_rad(1))
    }

    /// Standard deviation of the roll, degrees; NaN where unknown, as near the vertical.
    #[getter]
    fn roll_sd_deg<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.degrees(py, |f| f.angle_sd_rad(2))
    }

    /// Weighted squares at the minimum, halved and without their constant; NaN where unknown.
    #[getter]
    fn cost<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.plain(py, |f| f.cost)
    }

    /// How much more the next local minimum costs: inf if none is near, NaN where unknown.
    #[getter]
    fn cost_gap<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.plain(py, |f| f.cost_gap)
    }

    /// Why problems have no solution, by their index; of one problem always empty.
    #[getter]
    fn errors<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let errors = PyDict::new(py);
        for (problem, error) in &self.errors {
            errors.set_item(problem, error)?;
        }
        Ok(errors)
    }

    /// The same as `scipy.spatial.transform.Rotation`, which rotates body components into local ones; NaN where
    /// unknown.
    fn to_scipy<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let rotation = py.import("scipy.spatial.transform")?.getattr("Rotation")?;
        let is_known = |f: &Found| f.local_from_body.iter().all(|component| component.is_finite());
        let known = |f: &Found| if is_known(f) { f.local_from_body } else { Matrix3::identity() };
        let found = rotation.call_method1("from_matrix", (self.matrices(py, known)?,))?;
        // Scipy takes no matrix of NaN, but a rotation vector.
        let unknown: Vec<usize> =
            (0..self.found.len()).filter(|problem| !is_known(&self.found[*problem])).collect();
        if !unknown.is_empty() {
            let nothing =
                arrays::shaped(py, vec![UNKNOWN; 3 * unknown.len()], Some(unknown.len()), &[3])?;
            found.set_item(unknown, rotation.call_method1("from_rotvec", (nothing,))?)?;
        }
        Ok(found)
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, Parts<'py>)> {
        let rows = self.found.iter().flat_map(Found::row).collect();
        let rows = PyArray1::from_vec(py, rows).reshape([self.found.len(), Found::ROW])?;
        let rebuild = py.import("kurs._native")?.getattr("attitude_of_parts")?;
        Ok((rebuild, (rows, self.count, self.errors.clone())))
    }

    /// N, or an exception for one rotation without a leading dimension.
    fn __len__(&self) -> PyResult<usize> {
        let text = "this is one attitude without a length";
        self.count.ok_or_else(|| pyo3::exceptions::PyTypeError::new_err(text))
    }

    /// Whether there is any: one without a leading dimension is.
    fn __bool__(&self) -> bool {
        self.count != Some(0)
    }

    fn __repr__(&self) -> String {
        match (self.count, self.found.as_slice()) {
            (None, [one]) => {
                let angles = one.angles();
                let [heading, pitch, roll] =
                    [angles.heading_rad, angles.pitch_rad, angles.roll_rad].map(f64::to_degrees);
                format!(
                    "Attitude(heading_deg={heading:.5}, pitch_deg={pitch:.5}, roll_deg={roll:.5})"
                )
            }
            (_, many) => {
                format!("Attitude({} rotations, {} errors)", many.len(), self.errors.len())
            }
        }
    }
}

/// An attitude out of a pickle.
#[pyfunction]
pub(crate) fn attitude_of_parts(
    rows: PyReadonlyArray2<'_, f64>,
    count: Option<usize>,
    errors: Vec<(usize, String)>,
) -> PyResult<Attitude> {
    let found = rows.as_slice()?.chunks_exact(Found::ROW).map(Found::of_row).collect();
    Ok(Attitude { found, count, errors })
}

/// What there is as many of as of body.
const OF_BODY: &str = "one for each row of body";

/// Rows of body and local that belong together.
fn pairs<'a>(body: &'a Numbers<'_>, local: &'a Numbers<'_>) -> PyResult<(Stack<'a>, Stack<'a>)> {
    let body = Stack::of_points(body, "body")?;
    let local = Stack::of_points(local, "local")?.with_rows(body.shape()[0], OF_BODY, "local")?;
    Ok((body, local))
}

/// local_from_body that carries body (m, 3) onto local (m, 3) best, by Wahba's closed form.
///
/// Minimises the sum of `weights * |local - R body|²` over rotations R. Give (N, m, 3) for N problems at
/// once. Weights (m,) are relative, so there is no covariance. Raises NoSolution for vectors on one line.
#[pyfunction]
#[pyo3(signature = (body, local, weights=None))]
pub(crate) fn wahba(
    py: Python<'_>,
    body: Numbers<'_>,
    local: Numbers<'_>,
    weights: Option<Numbers<'_>>,
) -> PyResult<Attitude> {
    let (body, local) = pairs(&body, &local)?;
    let weights = weights.as_ref().map(|w| Stack::new(w, 1, "weights")).transpose()?;
    let weights = weights.map(|w| w.with_rows(body.shape()[0], OF_BODY, "weights")).transpose()?;
    if let Some(weights) = &weights {
        weights.check("weights", "0 or more", |weight| weight >= 0.0)?;
    }
    let equal = vec![1.0; body.shape()[0]];
    let mut given = vec![("body", &body), ("local", &local)];
    given.extend(weights.as_ref().map(|w| ("weights", w)));
    Attitude::solve(py, arrays::count(&given)?, |problem| {
        let weights = weights.as_ref().map_or(&equal[..], |w| w.at(problem));
        closed_form::solve(&body.points(problem), &local.points(problem), weights)
            .map(Found::rotation)
    })
}

/// local_from_body from baselines body (k, 3) and local (k, 3), metres, of one antenna to the others.
///
/// `cov_m2` (3, 3): covariance of one baseline in local axes. With `shared_antenna` the baselines share the
/// noise of their first antenna, as single differences do; without it each has errors of its own. Give
/// (N, k, 3) for N problems at once. The global minimum by Newton's method, with covariance.
#[pyfunction]
#[pyo3(signature = (body, local, cov_m2, *, shared_antenna=true))]
pub(crate) fn weighted(
    py: Python<'_>,
    body: Numbers<'_>,
    local: Numbers<'_>,
    cov_m2: Numbers<'_>,
    shared_antenna: bool,
) -> PyResult<Attitude> {
    let (body, local) = pairs(&body, &local)?;
    let covariance = Stack::of_symmetric(&cov_m2, 3, "cov_m2")?;
    let given = [("body", &body), ("local", &local), ("cov_m2", &covariance)];
    let problems = arrays::count(&given)?;
    covariance.check_definite("cov_m2", &problems)?;
    Attitude::solve(py, problems, |problem| {
        let (body, local) = (body.points(problem), local.points(problem));
        let covariance = covariance.matrix3(problem);
        Found::minimum(&AttitudeProblem::of_baselines(
            &body,
            &local,
            &covariance,
            weight(shared_antenna),
        )?)
    })
}

/// local_from_body from baselines body (k, 3) and local (k, 3), metres, with a full covariance (3k, 3k).
///
/// `cov_m2` is in local axes, baseline after baseline. Give (N, k, 3) for N problems at once. The global
/// minimum by Newton's method, with covariance; raises NoSolution for antennas on one line.
#[pyfunction]
pub(crate) fn general(
    py: Python<'_>,
    body: Numbers<'_>,
    local: Numbers<'_>,
    cov_m2: Numbers<'_>,
) -> PyResult<Attitude> {
    let (body, local) = pairs(&body, &local)?;
    let covariance = Stack::of_symmetric(&cov_m2, 3 * body.shape()[0], "cov_m2")?;
    let given = [("body", &body), ("local", &local), ("cov_m2", &covariance)];
    let problems = arrays::count(&given)?;
    covariance.check_definite("cov_m2", &problems)?;
    Attitude::solve(py, problems, |problem| {
        let weight = joint::weight_of(&covariance.matrix(problem))?;
        let measured = DVector::from_column_slice(local.at(problem));
        Found::minimum(&joint::problem(&body.points(problem), &measured, &weight)?)
    })
}

/// local_from_body from single-difference phases (k, r), metres, of baselines body (k, 3).
///
/// A phase is that of the baseline's antenna less that of the first one, its integers taken out: `-u·b` and a clock,
/// which is one for each baseline and all its bands, and is eliminated. `los` (s, 3): unit vectors u to the satellites
/// in local axes. `sigma_m` (r,): standard deviations, all satellites of the first band, then of the second, and so on.
/// Give a leading dimension for N problems at once. A flat array may fit as well from the other side: then `cost_gap`
/// is about 0, and either is given.
#[pyfunction]
#[pyo3(signature = (body, los, sigma_m, phases_m, *, shared_antenna=true))]
pub(crate) fn from_phases(
    py: Python<'_>,
    body: Numbers<'_>,
    los: Numbers<'_>,
    sigma_m: Numbers<'_>,
    phases_m: Numbers<'_>,
    shared_antenna: bool,
) -> PyResult<Attitude> {
    let (body, los) = (Stack::of_points(&body, "body")?, Stack::of_points(&los, "los")?);
    let sigma = Stack::new(&sigma_m, 1, "sigma_m")?;
    let phases = Stack::new(&phases_m, 2, "phases_m")?;
    let (satellites, rows) = (los.shape()[0], sigma.shape()[0]);
    if satellites == 0 || rows == 0 || !rows.is_multiple_of(satellites) {
        let expected = format!("{satellites} numbers for each band, one for each satellite of los");
        return Err(errors::of_shape("sigma_m", sigma.shape(), &expected));
    }
    sigma.check("sigma_m", "a number above zero", |sigma| sigma > 0.0)?;
    if phases.shape() != [body.shape()[0], rows] {
        let expected =
            format!("{} rows ({OF_BODY}) and {rows} columns (as sigma_m)", body.shape()[0]);
        return Err(errors::of_shape("phases_m", phases.shape(), &expected));
    }
    let given = [("body", &body), ("los", &los), ("sigma_m", &sigma), ("phases_m", &phases)];
    Attitude::solve(py, arrays::count(&given)?, |problem| {
        let differences = SingleDifferences {
            lines_of_sight: &los.points(problem),
            sigma_m: sigma.at(problem),
            phases_m: phases.at(problem),
        };
        let normal = differences.reduce()?;
        Found::minimum(&normal.problem(&body.points(problem), weight(shared_antenna))?)
    })
}

fn weight(shared_antenna: bool) -> BaselineWeight {
    if shared_antenna { BaselineWeight::SharedAntenna } else { BaselineWeight::Independent }
}

/// local_from_body from three points body (3, 3) and local (3, 3), a row each, by the published closed form.
///
/// The triangle must be acute (NoSolution otherwise). Give (N, 3, 3) for N problems at once. No covariance.
#[pyfunction]
pub(crate) fn three_point(
    py: Python<'_>,
    body: Numbers<'_>,
    local: Numbers<'_>,
) -> PyResult<Attitude> {
    let (body, local) =
        (Stack::of_square(&body, 3, "body")?, Stack::of_square(&local, 3, "local")?);
    let points = |stack: &Stack<'_>, problem| -> [Vector3<f64>; 3] {
        let rows = stack.matrix3(problem);
        [0, 1, 2].map(|row| rows.row(row).transpose())
    };
    let count = arrays::count(&[("body", &body), ("local", &local)])?;
    Attitude::solve(py, count, |problem| {
        published::attitude(&points(&body, problem), &points(&local, problem)).map(Found::rotation)
    })
}

/// Attitudes that [`relative`] joins with others.
struct Side<'a> {
    name: &'static str,
    attitude: &'a Attitude,
    errors: BTreeMap<usize, &'a str>,
}

impl<'a> Side<'a> {
    fn new(name: &'static str, attitude: &'a Attitude) -> Self {
        let errors = attitude.errors.iter().map(|(problem, error)| (*problem, error.as_str()));
        Self { name, attitude, errors: errors.collect() }
    }

    /// The rotation and its covariance, or why there is none.
    fn at(&self, problem: usize) -> Result<(Rotation<Ned, Body>, Matrix3<f64>), String> {
        if let Some(error) = self.errors.get(&problem) {
            return Err(format!("{}: {error}", self.name));
        }
        let found = self.attitude.found[if self.attitude.count.is_none() { 0 } else { problem }];
        Ok((Rotation::from_matrix(found.local_from_body), found.covariance_rad2))
    }
}

/// first_from_second: the attitude of a second body in the axes of a first one, both known in one local frame.
///
/// The covariance is in the axes of the second body; errors of the two are taken for independent. Of N
/// attitudes and N others, pair by pair; one stands for all of the other side. A pair with an attitude that has no
/// solution has its error.
#[pyfunction]
pub(crate) fn relative(
    py: Python<'_>,
    first: &Bound<'_, Attitude>,
    second: &Bound<'_, Attitude>,
) -> PyResult<Attitude> {
    let (first, second) = (first.get(), second.get());
    let count = match (first.count, second.count) {
        (Some(one), Some(other)) if one != other => {
            let text = format!("first is {one} attitudes, second is {other}");
            return Err(pyo3::exceptions::PyValueError::new_err(text));
        }
        (one, other) => one.or(other),
    };
    let (first, second) = (Side::new("first", first), Side::new("second", second));
    Attitude::solve_in_words(py, Problems::small(count), |problem| {
        let ((one, one_rad2), (other, other_rad2)) = (first.at(problem)?, second.at(problem)?);
        let found = of_angles::relative_orientation((&one, &one_rad2), (&other, &other_rad2));
        let rotation = Found::rotation(found.first_from_second.matrix());
        Ok(Found { covariance_rad2: found.covariance_rad2, ..rotation })
    })
}

/// Heading, pitch and roll of the rotation `matrix` (3, 3) = local_from_body, with `cov` (3, 3) in body axes, rad².
///
/// Give (N, 3, 3) for N rotations at once. Raises ValueError for a matrix that is no rotation.
#[pyfunction]
#[pyo3(signature = (matrix, cov=None))]
pub(crate) fn angles(
    py: Python<'_>,
    matrix: Numbers<'_>,
    cov: Option<Numbers<'_>>,
) -> PyResult<Attitude> {
    let matrices = Stack::of_square(&matrix, 3, "matrix")?;
    let covariance = cov.as_ref().map(|cov| Stack::of_symmetric(cov, 3, "cov")).transpose()?;
    let mut given = vec![("matrix", &matrices)];
    given.extend(covariance.as_ref().map(|cov| ("cov", cov)));
    let problems = arrays::count(&given)?;
    matrices.check_rotations("matrix")?;
    Attitude::solve(py, problems, |problem| {
        let rotation = Found::rotation(matrices.matrix3(problem));
        let covariance_rad2 =
            covariance.as_ref().map_or(rotation.covariance_rad2, |cov| cov.matrix3(problem));
        Ok(Found { covariance_rad2, ..rotation })
    })
}
