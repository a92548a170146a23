//! Numpy arrays as they come: one problem, or many with a leading dimension.

use std::borrow::Cow;
use std::ops::Deref;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{self, RecvTimeoutError};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use nalgebra::{DMatrix, Matrix3, Vector3};
use numpy::{
    AllowTypeChange, PyArray1, PyArrayDyn, PyArrayLikeDyn, PyArrayMethods, PyReadonlyArrayDyn,
    PyUntypedArray, PyUntypedArrayMethods,
};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::{PyAny, PyList, PyTuple};
use rayon::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::errors;

/// Problems that one thread solves before another may take some over.
const MIN_PROBLEMS: usize = 32;
/// One problem of so many numbers takes longer than it takes to give the interpreter's lock away.
const DETACHED_NUMBERS: usize = 1000;
/// How often Python may look whether Ctrl-C was pressed.
const BETWEEN_LOOKS: Duration = Duration::from_millis(50);

/// Difference between a covariance and its transpose, relative to its largest element, that passes as rounding.
const SYMMETRY: f64 = 1e-6;
/// Of `RᵀR − I`: what rounding to five digits leaves.
const ORTHOGONALITY: f64 = 1e-4;

/// Whatever numpy makes an array of real numbers of.
#[derive(Debug)]
pub(crate) struct Numbers<'py> {
    array: PyReadonlyArrayDyn<'py, f64>,
    /// What is there in place of numbers; then the array is empty.
    refused: Option<&'static str>,
}

impl<'py> Numbers<'py> {
    fn refused(py: Python<'py>, found: &'static str) -> Self {
        Self { array: PyArrayDyn::zeros(py, vec![0], false).readonly(), refused: Some(found) }
    }
}

impl<'py> Deref for Numbers<'py> {
    type Target = PyReadonlyArrayDyn<'py, f64>;

    fn deref(&self) -> &Self::Target {
        &self.array
    }
}

impl<'a, 'py> FromPyObject<'a, 'py> for Numbers<'py> {
    type Error = PyErr;

    fn extract(given: Borrowed<'a, 'py, PyAny>) -> PyResult<Self> {
        let py = given.py();
        if has_masked(&given)? {
            return Ok(Self::refused(py, "masked values"));
        }
        if let Ok(array) = given.cast::<PyArrayDyn<f64>>() {
            return Ok(Self { array: array.readonly(), refused: None });
        }
        let array = py.import("numpy")?.call_method1("asarray", (given,))?;
        let kind: char = array.getattr("dtype")?.getattr("kind")?.extract()?;
        let numbers: PyArrayLikeDyn<'py, f64, AllowTypeChange> = match kind {
            'b' | 'i' | 'u' | 'f' => array.extract()?,
            'c' => return Ok(Self::refused(py, "complex numbers")),
            'M' | 'm' => return Ok(Self::refused(py, "instants or times")),
            _ => given.extract()?,
        };
        Ok(Self { array: numbers.readonly(), refused: None })
    }
}

/// Whether something masked is in an array, or in an array of a list.
fn has_masked(given: &Bound<'_, PyAny>) -> PyResult<bool> {
    let masked = given.py().import("numpy.ma")?;
    let is_masked = |array: &Bound<'_, PyAny>| -> PyResult<bool> {
        masked.call_method1("is_masked", (array,))?.extract()
    };
    if given.is_instance_of::<PyList>() || given.is_instance_of::<PyTuple>() {
        for item in given.try_iter()? {
            let item = item?;
            if item.cast::<PyUntypedArray>().is_ok() && is_masked(&item)? {
                return Ok(true);
            }
        }
        return Ok(false);
    }
    is_masked(given)
}

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
    pub(crate) fn new(array: &'a Numbers<'_>, dimensions: usize, what: &str) -> PyResult<Self> {
        if let Some(found) = array.refused {
            let text = format!("{what} has {found}, expected real numbers, NaN for a missing one");
            return Err(PyValueError::new_err(text));
        }
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
    pub(crate) fn of_points(array: &'a Numbers<'_>, what: &str) -> PyResult<Self> {
        let stack = Self::new(array, 2, what)?;
        if stack.shape[1] == 3 {
            Ok(stack)
        } else {
            Err(errors::of_shape(what, array.shape(), "three columns"))
        }
    }

    /// As [`Stack::new`] of square matrices with `rows`.
    pub(crate) fn of_square(array: &'a Numbers<'_>, rows: usize, what: &str) -> PyResult<Self> {
        let stack = Self::new(array, 2, what)?;
        if stack.shape == [rows, rows] {
            Ok(stack)
        } else {
            Err(errors::of_shape(what, array.shape(), &format!("{rows} rows and columns")))
        }
    }

    /// As [`Stack::of_square`] of covariances: symmetric but for rounding, which is taken away.
    pub(crate) fn of_symmetric(array: &'a Numbers<'_>, rows: usize, what: &str) -> PyResult<Self> {
        let mut stack = Self::of_square(array, rows, what)?;
        let size = rows * rows;
        for problem in 0..stack.count.unwrap_or(1) {
            let numbers = stack.at(problem);
            let mut pairs = (0..rows).flat_map(|row| (0..row).map(move |column| (row, column)));
            if pairs
                .all(|(row, column)| numbers[row * rows + column] == numbers[column * rows + row])
            {
                continue;
            }
            let matrix = stack.matrix(problem);
            let transposed = matrix.transpose();
            let differences = &matrix - &transposed;
            let (row, column) = differences.iamax_full();
            // Not for NaN, of which it is no question whether there is a solution.
            if differences[(row, column)].abs() > SYMMETRY * matrix.amax() {
                let of = stack.count.map_or_else(String::new, |_| format!(" of problem {problem}"));
                return Err(PyValueError::new_err(format!(
                    "{what}{of} is not symmetric: {} in row {row}, column {column}, {} in row {column}, column {row}",
                    matrix[(row, column)],
                    matrix[(column, row)],
                )));
            }
            let mean = 0.5 * (matrix + transposed);
            stack.numbers.to_mut()[problem * size..][..size].copy_from_slice(mean.as_slice());
        }
        Ok(stack)
    }

    /// Refuses another number of rows.
    pub(crate) fn with_rows(self, rows: usize, of: &str, what: &str) -> PyResult<Self> {
        if self.shape.first() == Some(&rows) {
            return Ok(self);
        }
        let expected = if self.shape.len() == 1 { "numbers" } else { "rows" };
        Err(errors::of_shape(what, self.shape, &format!("{rows} {expected}, {of}")))
    }

    /// Refuses numbers that are the same for all problems and cannot be.
    pub(crate) fn check(
        &self,
        what: &str,
        expected: &str,
        can_be: impl Fn(f64) -> bool,
    ) -> PyResult<()> {
        let wrong = self.numbers.iter().position(|number| !can_be(*number));
        match wrong.filter(|_| self.count.is_none()) {
            Some(place) => {
                errors::check(&format!("{what}[{place}]"), self.numbers[place], false, expected)
            }
            None => Ok(()),
        }
    }

    /// Refuses a covariance that is the same for many problems and none of them.
    pub(crate) fn check_definite(&self, what: &str, problems: &Problems) -> PyResult<()> {
        let is_shared = self.count.is_none() && problems.count.is_some();
        if is_shared && self.matrix(0).cholesky().is_none() {
            let text = format!("{what} is not positive definite, and the same for all problems");
            return Err(PyValueError::new_err(text));
        }
        Ok(())
    }

    /// Refuses matrices (3, 3) that are no rotations.
    pub(crate) fn check_rotations(&self, what: &str) -> PyResult<()> {
        for problem in 0..self.count.unwrap_or(1) {
            let matrix = self.matrix3(problem);
            let excess = (matrix.transpose() * matrix - Matrix3::identity()).norm();
            // Also for NaN.
            if !(excess < ORTHOGONALITY && matrix.determinant() > 0.0) {
                let text = format!("{what} {problem} is no rotation: {matrix}");
                return Err(PyValueError::new_err(text));
            }
        }
        Ok(())
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

    /// `None`: the same for all.
    pub(crate) const fn count(&self) -> Option<usize> {
        self.count
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

/// How many problems there are, and of which size.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Problems {
    /// `None`: one without a leading dimension.
    pub(crate) count: Option<usize>,
    /// Numbers that one problem is given by.
    numbers: usize,
}

impl Problems {
    /// Of one number each.
    pub(crate) const fn small(count: Option<usize>) -> Self {
        Self { count, numbers: 1 }
    }

    /// Of which one may take long.
    pub(crate) const fn long(count: Option<usize>) -> Self {
        Self { count, numbers: usize::MAX }
    }
}

/// The problems that the arguments are of.
pub(crate) fn count(stacks: &[(&str, &Stack<'_>)]) -> PyResult<Problems> {
    let mut known: Option<(&str, usize)> = None;
    for (what, stack) in stacks {
        let Some(count) = stack.count else { continue };
        match known {
            Some((first, other)) if other != count => {
                let text = format!("{what} is of {count} problems, {first} of {other}");
                return Err(PyValueError::new_err(text));
            }
            _ => known = Some((what, count)),
        }
    }
    let numbers = stacks.iter().map(|(_, stack)| stack.shape.iter().product::<usize>()).sum();
    Ok(Problems { count: known.map(|(_, count)| count), numbers })
}

/// Solves all problems, many of them in parallel, and without the interpreter's lock; `memory` is made once for a
/// thread. Of many Ctrl-C leaves the rest.
pub(crate) fn solve_all<M, T: Send>(
    py: Python<'_>,
    problems: Problems,
    memory: impl Fn() -> M + Sync + Send,
    solve: impl Fn(&mut M, usize) -> T + Sync + Send,
) -> PyResult<Vec<T>> {
    let Some(count) = problems.count else {
        let one = || vec![solve(&mut memory(), 0)];
        return Ok(if problems.numbers < DETACHED_NUMBERS { one() } else { py.detach(one) });
    };
    let found = interruptible(py, |is_interrupted| {
        let solve = |memory: &mut M, problem| {
            (!is_interrupted.load(Ordering::Relaxed)).then(|| solve(memory, problem))
        };
        let problems = (0..count).into_par_iter().with_min_len(MIN_PROBLEMS);
        problems.map_init(&memory, solve).collect::<Option<Vec<T>>>()
    });
    Ok(found?.unwrap_or_default())
}

/// Runs work on the threads of this process, without the interpreter's lock, and tells it of Ctrl-C.
fn interruptible<T: Send>(
    py: Python<'_>,
    work: impl FnOnce(&AtomicBool) -> Option<T> + Send,
) -> PyResult<Option<T>> {
    let is_interrupted = &AtomicBool::new(false);
    py.detach(|| {
        let Some(pool) = pool() else { return Ok(work(is_interrupted)) };
        let (sender, receiver) = mpsc::channel();
        pool.in_place_scope(|scope| {
            scope.spawn(move |_| {
                // The receiver waits for it.
                let _ = sender.send(work(is_interrupted));
            });
            let mut signal = Ok(());
            loop {
                match receiver.recv_timeout(BETWEEN_LOOKS) {
                    Ok(found) => return signal.map(|()| found),
                    // The panic of the work goes on behind this scope.
                    Err(RecvTimeoutError::Disconnected) => return signal.map(|()| None),
                    Err(RecvTimeoutError::Timeout) if signal.is_ok() => {
                        signal = Python::attach(|py| py.check_signals());
                        is_interrupted.store(signal.is_err(), Ordering::Relaxed);
                    }
                    Err(RecvTimeoutError::Timeout) => {}
                }
            }
        })
    })
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
