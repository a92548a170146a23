//! The exceptions, with the words of the command line.

use kurs_cli::embedded::Failure;
use pyo3::exceptions::{PyException, PyValueError};
use pyo3::{PyErr, PyResult, create_exception};

create_exception!(
    kurs,
    Error,
    PyException,
    "What Kurs could not do, in the words of the command line."
);
create_exception!(
    kurs,
    UsageError,
    Error,
    "Wrong usage or configuration: exit status 2 of the command line."
);
create_exception!(
    kurs,
    InputError,
    Error,
    "Input that could not be used: exit status 1 of the command line."
);
create_exception!(
    kurs,
    NoSolution,
    Error,
    "Numbers that leave the answer open, such as antennas on one line."
);

/// The exception of a command that failed.
pub(crate) fn of_command(failure: Failure) -> PyErr {
    match failure {
        Failure::Usage(text) => UsageError::new_err(text),
        Failure::Input(text) => InputError::new_err(text),
    }
}

/// The exception of an array that has the wrong shape.
pub(crate) fn of_shape(what: &str, found: &[usize], expected: &str) -> PyErr {
    PyValueError::new_err(format!("{what} has the shape {found:?}, expected {expected}"))
}

/// Refuses a number that cannot be.
pub(crate) fn check(what: &str, found: f64, can_be: bool, expected: &str) -> PyResult<()> {
    if can_be {
        return Ok(());
    }
    Err(PyValueError::new_err(format!("{what} is {found}, expected {expected}")))
}

/// Refuses a standard deviation that cannot be.
pub(crate) fn check_sd(what: &str, found: f64) -> PyResult<()> {
    check(what, found, found >= 0.0 && found.is_finite(), "0 or more")
}
