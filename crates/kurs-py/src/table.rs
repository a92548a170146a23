//! Tables of the commands as columns.

use std::collections::{BTreeMap, BTreeSet};

use numpy::PyArray1;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};

use crate::errors::InputError;

/// Columns that hold whole numbers in every row.
const WHOLE: [&str; 4] = ["gps_week", "antennas", "satellites", "ambiguities"];
/// Columns that hold words, the empty one for "none".
const WORDS: [&str; 6] = ["status", "reason", "base", "rover", "name", "session"];
/// Columns that hold instants.
const TIMES: [&str; 2] = ["time_gpst", "time_utc"];

/// A column in the making.
enum Column {
    Reals(Vec<f64>),
    Integers(Vec<i64>),
    /// Nanoseconds since 1970 on the scale of the column.
    Times(Vec<i64>),
    Words {
        codes: Vec<i32>,
        words: BTreeMap<String, i32>,
        order: Vec<String>,
    },
}

impl Column {
    fn named(name: &str) -> Self {
        match name {
            _ if WHOLE.contains(&name) => Self::Integers(Vec::new()),
            _ if TIMES.contains(&name) => Self::Times(Vec::new()),
            _ if WORDS.contains(&name) => Self::words(),
            _ => Self::Reals(Vec::new()),
        }
    }

    fn words() -> Self {
        Self::Words { codes: Vec::new(), words: BTreeMap::new(), order: Vec::new() }
    }

    /// Takes a field in; `None` if it does not belong into such a column.
    fn push(&mut self, field: &str) -> Option<()> {
        match self {
            Self::Reals(values) if field.is_empty() => values.push(f64::NAN),
            Self::Reals(values) => values.push(field.parse().ok()?),
            Self::Integers(values) => values.push(field.parse().ok()?),
            Self::Times(values) => values.push(nanoseconds(field)?),
            Self::Words { codes, .. } if field.is_empty() => codes.push(-1),
            Self::Words { codes, words, order } => {
                let code = match words.get(field) {
                    Some(code) => *code,
                    None => {
                        let code = i32::try_from(order.len()).ok()?;
                        words.insert(field.to_owned(), code);
                        order.push(field.to_owned());
                        code
                    }
                };
                codes.push(code);
            }
        }
        Some(())
    }

    /// An array; of words, their codes (−1: none) and the words; of times, int64 behind the word for them.
    fn into_python(self, py: Python<'_>) -> PyResult<Bound<'_, PyAny>> {
        Ok(match self {
            Self::Reals(values) => PyArray1::from_vec(py, values).into_any(),
            Self::Integers(values) => PyArray1::from_vec(py, values).into_any(),
            Self::Times(values) => {
                PyArray1::from_vec(py, values).call_method1("view", ("datetime64[ns]",))?
            }
            Self::Words { codes, order, .. } => PyTuple::new(
                py,
                [PyArray1::from_vec(py, codes).into_any(), order.into_pyobject(py)?],
            )?
            .into_any(),
        })
    }
}

/// `2024-06-24T08:20:00.5`, with or without a Z, as nanoseconds since 1970.
fn nanoseconds(text: &str) -> Option<i64> {
    let (date, time) = text.trim_end_matches('Z').split_once('T')?;
    let mut parts = date.split('-').map(str::parse::<i64>);
    let mut next = || parts.next()?.ok();
    let (year, month, day) = (next()?, next()?, next()?);
    let (clock, fraction) = time.split_once('.').unwrap_or((time, ""));
    let mut parts = clock.split(':').map(str::parse::<i64>);
    let mut next = || parts.next()?.ok();
    let seconds = next()? * 3600 + next()? * 60 + next()?;
    let fraction: i64 = format!("{fraction:0<9}").get(..9)?.parse().ok()?;
    // Days from March on, of which all but the last month of a year have a fixed place.
    let (year, month) = if month > 2 { (year, month - 3) } else { (year - 1, month + 9) };
    let days =
        365 * year + year / 4 - year / 100 + year / 400 + (153 * month + 2) / 5 + day - 719_469;
    Some((days * 86_400 + seconds) * 1_000_000_000 + fraction)
}

/// Columns of a CSV file that a command wrote, by their names.
#[pyfunction]
pub(crate) fn read_table<'py>(py: Python<'py>, path: &str) -> PyResult<Bound<'py, PyDict>> {
    let columns = py.detach(|| read(path)).map_err(InputError::new_err)?;
    let named = PyDict::new(py);
    for (name, column) in columns {
        named.set_item(name, column.into_python(py)?)?;
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
