//! `kurs.ambiguity`: integers from real-valued ambiguities.

use kurs::ambiguity::array_constrained::ArrayConstrained;
use kurs::ambiguity::decorrelate::Decorrelation;
use kurs::ambiguity::length_constrained::LengthConstrained;
use kurs::ambiguity::search::{DEFAULT_HORIZON, IntegerLeastSquares};
use kurs::ambiguity::sphere::Length;
use kurs::ambiguity::success_rate::bootstrapped_success_rate;
use kurs::ambiguity::{AmbiguityError, MixedFloat};
use nalgebra::{DMatrix, DVector, Vector3};
use numpy::{PyArray1, PyArrayDyn, PyReadonlyArray1, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::arrays::{self, Numbers, Problems, Stack};
use crate::errors::{self, NoSolution};

/// The candidates of one problem.
#[derive(Debug, Clone, Default)]
struct Found {
    /// Candidate after candidate.
    integers: Vec<i64>,
    costs: Vec<f64>,
    /// Components of the baselines, candidate after candidate.
    baselines_m: Vec<f64>,
    proven_to: f64,
    success_rate: f64,
}

/// Integer vectors of least cost, cheapest first; with a leading dimension for N problems.
///
/// Where fewer than `count` lie within the horizon the others have the cost NaN and zeros as integers. An
/// attribute makes its array anew each time.
#[pyclass(frozen, module = "kurs.ambiguity")]
#[derive(Debug)]
pub(crate) struct Candidates {
    found: Vec<Found>,
    shapes: Shapes,
    errors: Vec<(usize, String)>,
}

/// [`Candidates`] in a pickle: shapes, integers, all other numbers in rows, the errors.
type Parts<'py> = (
    (Option<usize>, usize, usize, usize),
    Bound<'py, PyArray1<i64>>,
    Bound<'py, PyArray1<f64>>,
    Vec<(usize, String)>,
);

/// Shapes of a search.
#[derive(Debug, Clone, Copy)]
struct Shapes {
    /// `None`: one without a leading dimension.
    problems: Option<usize>,
    /// Of each problem.
    count: usize,
    ambiguities: usize,
    /// 0: there are none.
    baselines: usize,
}

/// Numbers in the candidates of all problems: 2 GB.
const MAX_NUMBERS: usize = 1 << 28;

impl Shapes {
    /// Integers of one problem.
    fn integers(&self) -> usize {
        self.count * self.ambiguities
    }

    /// Components of the baselines of one problem.
    fn components(&self) -> usize {
        self.count * self.baselines * 3
    }

    /// Memory that cannot be had ends the interpreter.
    fn check(&self) -> PyResult<()> {
        let problems = self.problems.unwrap_or(1).max(1);
        let most = MAX_NUMBERS / problems / (self.ambiguities + 3 * self.baselines + 1);
        if self.count <= most {
            return Ok(());
        }
        let (count, ambiguities) = (self.count, self.ambiguities);
        Err(PyValueError::new_err(format!(
            "count is {count}, expected at most {most} for {problems} problem(s) of {ambiguities} ambiguities"
        )))
    }
}

impl Candidates {
    fn solve<M>(
        py: Python<'_>,
        shapes: Shapes,
        memory: impl Fn() -> M + Sync + Send,
        solve: impl Fn(&mut M, usize) -> Result<Found, AmbiguityError> + Sync + Send,
    ) -> PyResult<Self> {
        shapes.check()?;
        let results = arrays::solve_all(py, Problems::long(shapes.problems), memory, solve)?;
        let mut errors = Vec::new();
        let found = results.into_iter().enumerate().map(|(problem, result)| {
            let mut found = result.unwrap_or_else(|error| {
                errors.push((problem, error.to_string()));
                Found { proven_to: f64::NAN, success_rate: f64::NAN, ..Found::default() }
            });
            found.integers.resize(shapes.integers(), 0);
            found.costs.resize(shapes.count, f64::NAN);
            found.baselines_m.resize(shapes.components(), f64::NAN);
            found
        });
        let found = found.collect();
        match errors.first() {
            Some((_, error)) if shapes.problems.is_none() => {
                Err(NoSolution::new_err(error.clone()))
            }
            _ => Ok(Self { found, shapes, errors }),
        }
    }

    fn plain<'py>(
        &self,
        py: Python<'py>,
        of: impl Fn(&Found) -> f64,
    ) -> PyResult<Bound<'py, PyAny>> {
        arrays::numbers(py, self.found.iter().map(of).collect(), self.shapes.problems)
    }
}

#[pymethods]
impl Candidates {
    /// Whole cycles, (count, n) or (N, count, n), in the order of the float ambiguities.
    #[getter]
    fn integers<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<i64>>> {
        let all = self.found.iter().flat_map(|f| f.integers.iter().copied()).collect();
        let Shapes { problems, count, ambiguities, .. } = self.shapes;
        arrays::shaped(py, all, problems, &[count, ambiguities])
    }

    /// Cost of each, without unit, (count,) or (N, count): the squared distance where there is no constraint.
    #[getter]
    fn costs<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        let all = self.found.iter().flat_map(|f| f.costs.iter().copied()).collect();
        arrays::shaped(py, all, self.shapes.problems, &[self.shapes.count])
    }

    /// Baselines of each in the axes of b, metres, (count, k, 3) or (N, count, k, 3); k = 0 without a constraint.
    #[getter]
    fn baselines_m<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        let all = self.found.iter().flat_map(|f| f.baselines_m.iter().copied()).collect();
        let Shapes { problems, count, baselines, .. } = self.shapes;
        arrays::shaped(py, all, problems, &[count, baselines, 3])
    }

    /// Proven: every integer vector that is not listed costs at least this; a number or (N,).
    #[getter]
    fn proven_to<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.plain(py, |f| f.proven_to)
    }

    /// Success rate of bootstrapping without the constraint; a number or (N,).
    #[getter]
    fn success_rate<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.plain(py, |f| f.success_rate)
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

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, Parts<'py>)> {
        let Shapes { problems, count, ambiguities, baselines } = self.shapes;
        let integers = self.found.iter().flat_map(|f| f.integers.iter().copied()).collect();
        let reals = self.found.iter().flat_map(|f| {
            let of_all = [f.proven_to, f.success_rate];
            f.costs.iter().chain(&f.baselines_m).copied().chain(of_all)
        });
        let reals = PyArray1::from_vec(py, reals.collect());
        let integers = PyArray1::from_vec(py, integers);
        let shapes = (problems, count, ambiguities, baselines);
        let rebuild = py.import("kurs._native")?.getattr("candidates_of_parts")?;
        Ok((rebuild, (shapes, integers, reals, self.errors.clone())))
    }

    fn __repr__(&self) -> String {
        match (self.shapes.problems, self.found.as_slice()) {
            (None, [one]) => {
                format!("Candidates(costs={:?}, proven_to={})", one.costs, one.proven_to)
            }
            (_, many) => {
                format!("Candidates({} problems, {} errors)", many.len(), self.errors.len())
            }
        }
    }
}

/// Candidates out of a pickle.
#[pyfunction]
pub(crate) fn candidates_of_parts(
    shapes: (Option<usize>, usize, usize, usize),
    integers: PyReadonlyArray1<'_, i64>,
    reals: PyReadonlyArray1<'_, f64>,
    errors: Vec<(usize, String)>,
) -> PyResult<Candidates> {
    let (problems, count, ambiguities, baselines) = shapes;
    let shapes = Shapes { problems, count, ambiguities, baselines };
    let (integers, reals) = (integers.as_slice()?, reals.as_slice()?);
    let of_reals = count + shapes.components();
    let found = (0..problems.unwrap_or(1)).map(|problem| {
        let row = &reals[problem * (of_reals + 2)..][..of_reals + 2];
        Found {
            integers: integers[problem * shapes.integers()..][..shapes.integers()].to_vec(),
            costs: row[..count].to_vec(),
            baselines_m: row[count..of_reals].to_vec(),
            proven_to: row[of_reals],
            success_rate: row[of_reals + 1],
        }
    });
    Ok(Candidates { found: found.collect(), shapes, errors })
}

/// The `count` integer vectors nearest to `a` (n,), cycles, in the metric of `Q` (n, n), cycles².
///
/// Integer least squares by LAMBDA; costs are squared distances. Vectors farther than the nearest by more than
/// `horizon` are not looked for. Give (N, n) and (N, n, n) for N problems at once.
#[pyfunction(name = "lambda_")]
#[pyo3(signature = (a, Q, *, count=2, horizon=f64::INFINITY))]
#[allow(non_snake_case)]
pub(crate) fn lambda(
    py: Python<'_>,
    a: Numbers<'_>,
    Q: Numbers<'_>,
    count: usize,
    horizon: f64,
) -> PyResult<Candidates> {
    let a = Stack::new(&a, 1, "a")?;
    let n = a.shape()[0];
    let covariance = Stack::of_symmetric(&Q, n, "Q")?;
    let problems = arrays::count(&[("a", &a), ("Q", &covariance)])?;
    check_horizon(horizon)?;
    covariance.check_definite("Q", &problems)?;
    let shapes = Shapes { problems: problems.count, count, ambiguities: n, baselines: 0 };
    let memory = || {
        let mut search = IntegerLeastSquares::default();
        search.horizon = horizon;
        search
    };
    Candidates::solve(py, shapes, memory, |search, problem| {
        let found = search.solve(a.at(problem), &covariance.matrix(problem), count)?;
        let (integers, costs): (Vec<_>, Vec<_>) =
            found.into_iter().map(|c| (c.integers, c.squared_distance)).unzip();
        Ok(Found {
            integers: integers.concat(),
            costs,
            baselines_m: Vec::new(),
            proven_to: search.proven_to(),
            success_rate: rate(search.decorrelation()),
        })
    })
}

fn check_horizon(horizon: f64) -> PyResult<()> {
    errors::check("horizon", horizon, horizon >= 0.0, "0 or more")
}

fn rate(decorrelation: &Decorrelation) -> f64 {
    bootstrapped_success_rate(decorrelation.conditional_variances())
}

/// A float solution as it comes.
struct Joint<'a> {
    a: Stack<'a>,
    a_covariance: Stack<'a>,
    b: Stack<'a>,
    b_covariance: Stack<'a>,
    cross: Stack<'a>,
    problems: Option<usize>,
}

impl<'a> Joint<'a> {
    /// With as many `baselines`, each `of` one thing; `body` of the array is of as many problems.
    fn new(
        [a, q_a, b, q_b, q_ab]: [&'a Numbers<'_>; 5],
        (baselines, of): (usize, &str),
        body: Option<&Stack<'_>>,
    ) -> PyResult<Self> {
        let (a, b) = (Stack::new(a, 1, "a")?, Stack::new(b, 1, "b")?);
        let b = b.with_rows(3 * baselines, of, "b")?;
        let (n, reals) = (a.shape()[0], b.shape()[0]);
        let a_covariance = Stack::of_symmetric(q_a, n, "Q_a")?;
        let b_covariance = Stack::of_symmetric(q_b, reals, "Q_b")?;
        let cross = Stack::new(q_ab, 2, "Q_ab")?;
        if cross.shape() != [n, reals] {
            let expected = format!("{n} rows (ambiguities) and {reals} columns (components of b)");
            return Err(errors::of_shape("Q_ab", cross.shape(), &expected));
        }
        let mut given = vec![
            ("a", &a),
            ("Q_a", &a_covariance),
            ("b", &b),
            ("Q_b", &b_covariance),
            ("Q_ab", &cross),
        ];
        given.extend(body.map(|body| ("body", body)));
        let problems = arrays::count(&given)?;
        a_covariance.check_definite("Q_a", &problems)?;
        let problems = problems.count;
        Ok(Self { a, a_covariance, b, b_covariance, cross, problems })
    }

    fn at(&self, problem: usize) -> Result<MixedFloat, AmbiguityError> {
        MixedFloat::of_joint(
            DVector::from_column_slice(self.a.at(problem)),
            self.a_covariance.matrix(problem),
            DVector::from_column_slice(self.b.at(problem)),
            self.b_covariance.matrix(problem),
            self.cross.matrix(problem).transpose(),
        )
    }

    fn shapes(&self, count: usize) -> Shapes {
        let baselines = self.b.shape()[0] / 3;
        Shapes { problems: self.problems, count, ambiguities: self.a.shape()[0], baselines }
    }
}

/// The `count` integer vectors of least cost where the baseline b (3,), metres, has a known length.
///
/// a (n,), cycles; Q_a (n, n), Q_b (3, 3), Q_ab (n, 3): their joint covariance, cycles and metres. Give a leading
/// dimension for N problems at once. Vectors that cost more than the best by `horizon` are not looked for.
#[pyfunction]
#[pyo3(signature = (a, Q_a, b, Q_b, Q_ab, length_m, length_sd_m=0.0, *, count=2, horizon=DEFAULT_HORIZON))]
#[allow(non_snake_case, clippy::too_many_arguments)] // as the literature has them
pub(crate) fn length_constrained(
    py: Python<'_>,
    a: Numbers<'_>,
    Q_a: Numbers<'_>,
    b: Numbers<'_>,
    Q_b: Numbers<'_>,
    Q_ab: Numbers<'_>,
    length_m: f64,
    length_sd_m: f64,
    count: usize,
    horizon: f64,
) -> PyResult<Candidates> {
    let float = Joint::new([&a, &Q_a, &b, &Q_b, &Q_ab], (1, "the components of a baseline"), None)?;
    let is_length = length_m > 0.0 && length_m.is_finite();
    errors::check("length_m", length_m, is_length, "a number above zero")?;
    errors::check_sd("length_sd_m", length_sd_m)?;
    check_horizon(horizon)?;
    let length = Length { length_m, sd_m: length_sd_m };
    let memory = || {
        let mut search = LengthConstrained::default();
        search.horizon = horizon;
        search
    };
    Candidates::solve(py, float.shapes(count), memory, |search, problem| {
        let found = search.solve(&float.at(problem)?, length, count)?;
        Ok(Found {
            integers: found.iter().flat_map(|c| c.integers.iter().copied()).collect(),
            costs: found.iter().map(|c| c.cost).collect(),
            baselines_m: found.iter().flat_map(|c| <[f64; 3]>::from(c.baseline_m)).collect(),
            proven_to: search.proven_to(),
            success_rate: rate(search.decorrelation()),
        })
    })
}

/// The `count` integer vectors of least cost where the array body (k, 3), metres, is known.
///
/// body: baselines from the first antenna in body axes. b (3k,): the same measured, in local axes, baseline after
/// baseline; a (n,): their ambiguities, `ambiguities_of[j]` of them for baseline j. Q_a (n, n), Q_b (3k, 3k), Q_ab
/// (n, 3k): joint covariance, cycles and metres. `array_sd_m`: of an antenna's place. A leading dimension for N
/// problems.
#[pyfunction]
#[pyo3(signature = (a, Q_a, b, Q_b, Q_ab, body, ambiguities_of, array_sd_m=0.0, *, count=2, horizon=DEFAULT_HORIZON))]
#[allow(non_snake_case, clippy::too_many_arguments)] // as the literature has them
pub(crate) fn array_constrained(
    py: Python<'_>,
    a: Numbers<'_>,
    Q_a: Numbers<'_>,
    b: Numbers<'_>,
    Q_b: Numbers<'_>,
    Q_ab: Numbers<'_>,
    body: Numbers<'_>,
    ambiguities_of: Vec<usize>,
    array_sd_m: f64,
    count: usize,
    horizon: f64,
) -> PyResult<Candidates> {
    let body = Stack::of_points(&body, "body")?;
    let baselines = body.shape()[0];
    let of = "the components of the baselines of body";
    let float = Joint::new([&a, &Q_a, &b, &Q_b, &Q_ab], (baselines, of), Some(&body))?;
    check_ambiguities_of(&ambiguities_of, baselines, float.a.shape()[0])?;
    errors::check_sd("array_sd_m", array_sd_m)?;
    check_horizon(horizon)?;
    let memory = || {
        let mut search = ArrayConstrained::default();
        search.horizon = horizon;
        search
    };
    Candidates::solve(py, float.shapes(count), memory, |search, problem| {
        let (float, body) = (float.at(problem)?, body.points(problem));
        let found = search.solve(float, &ambiguities_of, &body, array_sd_m, count)?;
        let components = |b: &Vector3<f64>| <[f64; 3]>::from(*b);
        Ok(Found {
            integers: found.iter().flat_map(|c| c.integers.iter().copied()).collect(),
            costs: found.iter().map(|c| c.cost).collect(),
            baselines_m: found.iter().flat_map(|c| &c.baselines_m).flat_map(components).collect(),
            proven_to: search.proven_to(),
            success_rate: rate(search.decorrelation()),
        })
    })
}

/// Refuses ambiguities that are not those of the baselines.
fn check_ambiguities_of(of: &[usize], baselines: usize, ambiguities: usize) -> PyResult<()> {
    if of.len() != baselines {
        return Err(PyValueError::new_err(format!(
            "ambiguities_of has {} numbers, expected {baselines}, one for each baseline of body",
            of.len()
        )));
    }
    let sum = of.iter().try_fold(0_usize, |sum, number| sum.checked_add(*number));
    if sum != Some(ambiguities) {
        let text = format!("ambiguities_of is {of:?}, expected a sum of {ambiguities}, those of a");
        return Err(PyValueError::new_err(text));
    }
    Ok(())
}

/// Probability that integer bootstrapping finds the right integers for covariance Q (n, n), cycles².
///
/// After decorrelation: a close lower bound for integer least squares. Give (N, n, n) for N problems at once: NaN
/// where Q is not positive definite, which is NoSolution for one.
#[pyfunction]
#[allow(non_snake_case)]
pub(crate) fn success_rate<'py>(py: Python<'py>, Q: Numbers<'py>) -> PyResult<Bound<'py, PyAny>> {
    let n = *Q.shape().last().unwrap_or(&0);
    let covariance = Stack::of_symmetric(&Q, n, "Q")?;
    let problems = arrays::count(&[("Q", &covariance)])?;
    let of = |decorrelation: &mut Decorrelation, problem: usize| {
        let matrix: DMatrix<f64> = covariance.matrix(problem);
        decorrelation.compute(&matrix).map(|()| rate(decorrelation))
    };
    let rates = arrays::solve_all(py, problems, Decorrelation::default, of)?;
    let count = problems.count;
    if let (None, [Err(error)]) = (count, rates.as_slice()) {
        return Err(NoSolution::new_err(error.to_string()));
    }
    arrays::numbers(py, rates.into_iter().map(|rate| rate.unwrap_or(f64::NAN)).collect(), count)
}
