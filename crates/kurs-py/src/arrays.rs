//! Numpy arrays as they come: one problem, or many with a leading dimension.

use std::borrow::Cow;
use std::sync::{Arc, Mutex, PoisonError};

use nalgebra::{DMatrix, Matrix3, Vector3};
use numpy::{PyArray1, PyArrayDyn, PyArrayMethods, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyAny;
use rayon::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::errors;

/// Problems that one thread solves before another may take some over.
const MIN_PROBLEMS: usize = 32;

/// What a symmetric matrix may be off, relative to its variances: rounding of 32-bit numbers and of
/// products in them.
const ASYMMETRY: f64 = 1e-5;

/// An argument of one problem, or of each of many, in rows.
#[derive(Debug)]
pub(crate) struct Stack<'a> {
    numbers: Cow<'a, [f64]>,
    /// Of one problem.
    shape: &'a [usize],
    /// `None`: the same for all.
    count: Option<usize>,
}

impl<'a> Stack<'a> {
    /// Of an array with `dimensions`, or one more for the problems.
    pub(crate) fn new(
        array: &'a PyReadonlyArrayDyn<'_, f64>,
        dimensions: usize,
        what: &str,
    ) -> PyResult<Self> {
        let shape = array.shape();
        let (count, shape) = match shape.len().checked_sub(dimensions) {
            Some(0) => (None, shape),
            Some(1) => (Some(shape[0]), &shape[1..]),
            _ => {
                let expected = format!("{dimensions} dimensions, or one more for many problems");
                return Err(errors::of_shape(what, shape, &expected));
            }
        };
        // Also columns after columns are a slice.
        let rows = array.as_slice().ok().filter(|_| array.is_c_contiguous());
        let copied = || Cow::Owned(array.as_array().iter().copied().collect());
        let numbers = rows.map_or_else(copied, Cow::Borrowed);
        Ok(Self { numbers, shape, count })
    }

    /// As [`Stack::new`] of points: the last dimension is three.
    pub(crate) fn of_points(array: &'a PyReadonlyArrayDyn<'_, f64>, what: &str) -> PyResult<Self> {
        let stack = Self::new(array, 2, what)?;
        if stack.shape[1] == 3 {
            Ok(stack)
        } else {
            Err(errors::of_shape(what, array.shape(), "three columns"))
        }
    }

    /// As [`Stack::new`] of square matrices with `rows`.
    pub(crate) fn of_square(
        array: &'a PyReadonlyArrayDyn<'_, f64>,
        rows: usize,
        what: &str,
    ) -> PyResult<Self> {
        let stack = Self::new(array, 2, what)?;
        if stack.shape == [rows, rows] {
            Ok(stack)
        } else {
            Err(errors::of_shape(what, array.shape(), &format!("{rows} rows and columns")))
        }
    }

    /// As [`Stack::of_square`] of covariances: symmetric, as far as numbers of 32 bits can tell.
    pub(crate) fn of_covariance(
        array: &'a PyReadonlyArrayDyn<'_, f64>,
        rows: usize,
        what: &str,
    ) -> PyResult<Self> {
        let stack = Self::of_square(array, rows, what)?;
        for (problem, matrix) in stack.numbers.chunks_exact((rows * rows).max(1)).enumerate() {
            for (i, j) in (0..rows).flat_map(|i| (0..i).map(move |j| (i, j))) {
                let (below, above) = (matrix[i * rows + j], matrix[j * rows + i]);
                let scale = (matrix[i * rows + i] * matrix[j * rows + j]).abs().sqrt();
                if (below - above).abs() > ASYMMETRY * scale.max(below.abs()) {
                    let of =
                        stack.count.map_or(String::new(), |_| format!(" of problem {problem}"));
                    return Err(pyo3::exceptions::PyValueError::new_err(format!(
                        "{what}{of} is not symmetric: [{i}, {j}] is {below}, [{j}, {i}] is {above}"
                    )));
                }
            }
        }
        Ok(stack)
    }

    /// How many problems there are; `None`: one without a leading dimension.
    pub(crate) fn problems(&self) -> Option<usize> {
        self.count
    }

    /// Refuses many problems, for what solves one alone.
    pub(crate) fn alone(self, what: &str) -> PyResult<Self> {
        match self.count {
            None => Ok(self),
            Some(count) => {
                let shape: Vec<usize> = [&[count], self.shape].concat();
                let expected = format!("{} dimensions", self.shape.len());
                Err(errors::of_shape(what, &shape, &expected))
            }
        }
    }

    /// Of one problem.
    pub(crate) fn shape(&self) -> &[usize] {
        self.shape
    }

    /// The numbers of one problem.
    pub(crate) fn at(&self, problem: usize) -> &[f64] {
        if self.count.is_none() {
            return &self.numbers;
        }
        let size: usize = self.shape.iter().product();
        &self.numbers[problem * size..][..size]
    }

    /// The rows of one problem as points.
    pub(crate) fn points(&self, problem: usize) -> Vec<Vector3<f64>> {
        self.at(problem).chunks_exact(3).map(Vector3::from_column_slice).collect()
    }

    /// The 3 × 3 matrix of one problem.
    pub(crate) fn matrix3(&self, problem: usize) -> Matrix3<f64> {
        Matrix3::from_row_slice(self.at(problem))
    }

    /// The matrix of one problem.
    pub(crate) fn matrix(&self, problem: usize) -> DMatrix<f64> {
        DMatrix::from_row_slice(self.shape[0], self.shape[1], self.at(problem))
    }
}

/// How many problems the arguments are of; `None`: one.
pub(crate) fn count(stacks: &[(&str, &Stack<'_>)]) -> PyResult<Option<usize>> {
    let mut known: Option<(&str, usize)> = None;
    for (what, stack) in stacks {
        let Some(count) = stack.count else { continue };
        match known {
            Some((first, other)) if other != count => {
                let text = format!("{what} is of {count} problems, {first} of {other}");
                return Err(pyo3::exceptions::PyValueError::new_err(text));
            }
            _ => known = Some((what, count)),
        }
    }
    Ok(known.map(|(_, count)| count))
}

/// Solves all problems, many of them in parallel and without the interpreter's lock; `memory` is made once for a
/// thread.
pub(crate) fn solve_all<M, T: Send>(
    py: Python<'_>,
    count: Option<usize>,
    memory: impl Fn() -> M + Sync + Send,
    solve: impl Fn(&mut M, usize) -> T + Sync + Send,
) -> Vec<T> {
    match count {
        None => vec![py.detach(|| solve(&mut memory(), 0))],
        Some(count) => in_parallel(py, || {
            let problems = (0..count).into_par_iter().with_min_len(MIN_PROBLEMS);
            problems.map_init(&memory, |memory, problem| solve(memory, problem)).collect()
        }),
    }
}

/// Whether `RᵀR − I` is as small as `tolerance`, and R no reflection; not with NaN.
pub(crate) fn is_rotation(matrix: &Matrix3<f64>, tolerance: f64) -> bool {
    let excess = (matrix.transpose() * matrix - Matrix3::identity()).norm();
    excess < tolerance && matrix.determinant() > 0.0
}

/// Runs work on the threads of this process, without the interpreter's lock.
pub(crate) fn in_parallel<T: Send>(py: Python<'_>, work: impl FnOnce() -> T + Send) -> T {
    py.detach(|| match pool() {
        Some(pool) => pool.install(work),
        None => work(),
    })
}

/// The threads of this process: those of a process that forked are not there in its child.
fn pool() -> Option<Arc<ThreadPool>> {
    static POOL: Mutex<Option<(u32, Arc<ThreadPool>)>> = Mutex::new(None);
    let process = std::process::id();
    let mut pool = POOL.lock().unwrap_or_else(PoisonError::into_inner);
    if pool.as_ref().is_none_or(|(of, _)| *of != process) {
        let new = Arc::new(ThreadPoolBuilder::new().build().ok()?);
        // There is nobody to be told that the old one has ended.
        std::mem::forget(pool.replace((process, new)));
    }
    pool.as_ref().map(|(_, pool)| Arc::clone(pool))
}

/// An array with the leading dimension of the problems, if there are many, and `inner` for each.
pub(crate) fn shaped<'py, T: numpy::Element>(
    py: Python<'py>,
    numbers: Vec<T>,
    count: Option<usize>,
    inner: &[usize],
) -> PyResult<Bound<'py, PyArrayDyn<T>>> {
    let shape: Vec<usize> = count.into_iter().chain(inner.iter().copied()).collect();
    PyArray1::from_vec(py, numbers).reshape(shape)
}

/// A number for each problem: a plain one if there is one problem.
pub(crate) fn numbers<'py>(
    py: Python<'py>,
    mut values: Vec<f64>,
    count: Option<usize>,
) -> PyResult<Bound<'py, PyAny>> {
    match (count, values.pop()) {
        (None, Some(value)) => Ok(value.into_pyobject(py)?.into_any()),
        (_, last) => {
            values.extend(last);
            Ok(PyArray1::from_vec(py, values).into_any())
        }
    }
}
