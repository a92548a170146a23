//! Tables of the commands as columns.

use std::collections::BTreeSet;

use kurs_cli::embedded::Column;
use numpy::PyArray1;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};

use crate::errors::InputError;

/// An array; of words, their codes (−1: none) and the words; of times, int64 behind the word for them.
fn into_python(column: Column, py: Python<'_>) -> PyResult<Bound<'_, PyAny>> {
    Ok(match column {
        Column::Reals(values) => PyArray1::from_vec(py, values).into_any(),
        Column::Integers(values) => PyArray1::from_vec(py, values).into_any(),
        Column::Times(values) => {
            PyArray1::from_vec(py, values).call_method1("view", ("datetime64[ns]",))?
        }
        Column::Words { codes, words, .. } => {
            let codes = PyArray1::from_vec(py, codes).into_any();
            PyTuple::new(py, [codes, words.into_pyobject(py)?])?.into_any()
        }
    })
}

/// Columns of a CSV file that a command wrote, by their names.
#[pyfunction]
pub(crate) fn read_table<'py>(py: Python<'py>, path: &str) -> PyResult<Bound<'py, PyDict>> {
    let columns = py.detach(|| read(path)).map_err(InputError::new_err)?;
    let named = PyDict::new(py);
    for (name, column) in columns {
        named.set_item(name, into_python(column, py)?)?;
    }
    Ok(named)
}

fn read(path: &str) -> Result<Vec<(String, Column)>, String> {
    let mut words = BTreeSet::new();
    // A column that turns out to hold words is read as such.
    loop {
        match read_with(path, &words)? {
            Ok(columns) => return Ok(columns),
            Err(name) => words.insert(name),
        };
    }
}

/// The columns, or the name of one that does not hold numbers.
fn read_with(
    path: &str,
    words: &BTreeSet<String>,
) -> Result<Result<Vec<(String, Column)>, String>, String> {
    let told = |error: csv::Error| format!("{path}: {error}");
    let mut reader = csv::Reader::from_path(path).map_err(told)?;
    let named = |name: &str| {
        let column = if words.contains(name) { Column::words() } else { Column::named(name) };
        (name.to_owned(), column)
    };
    let mut columns: Vec<_> = reader.headers().map_err(told)?.iter().map(named).collect();
    let mut row = csv::StringRecord::new();
    while reader.read_record(&mut row).map_err(told)? {
        for ((name, column), field) in columns.iter_mut().zip(&row) {
            if column.push(field).is_none() {
                return Ok(Err(name.clone()));
            }
        }
    }
    Ok(Ok(columns))
}
