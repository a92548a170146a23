//! One case: reading its numbers, and collecting what the comparison shows.

#![allow(dead_code)] // until every kind of the list in main.rs has its check

use nalgebra::{DMatrix, Matrix3, Vector3};
use serde_json::Value;

/// What the comparisons of one case showed.
#[derive(Debug, Default)]
pub(crate) struct Outcome {
    /// Largest error compared so far, whatever its tolerance.
    pub(crate) worst: f64,
    /// One line per quantity that is off.
    pub(crate) failures: Vec<String>,
}

impl Outcome {
    /// Takes the error of one quantity; not a number is a failure too.
    pub(crate) fn compare(&mut self, what: &str, error: f64, tolerance: f64) {
        self.worst = self.worst.max(error);
        if error.is_nan() || error > tolerance {
            self.failures.push(format!("{what} off by {error:.3e} (allowed {tolerance:.0e})"));
        }
    }

    /// Takes a statement that must hold.
    pub(crate) fn expect(&mut self, what: &str, holds: bool) {
        if !holds {
            self.failures.push(format!("not so: {what}"));
        }
    }
}

/// A number.
pub(crate) fn number(value: &Value) -> Result<f64, String> {
    value.as_f64().ok_or_else(|| format!("a number was expected, found {value}"))
}

/// A list of numbers.
pub(crate) fn numbers(value: &Value) -> Result<Vec<f64>, String> {
    list(value)?.iter().map(number).collect()
}

/// A matrix as a list of rows of equal length.
pub(crate) fn matrix(value: &Value) -> Result<DMatrix<f64>, String> {
    let rows: Vec<Vec<f64>> = list(value)?.iter().map(numbers).collect::<Result<_, _>>()?;
    let width = rows.first().map_or(0, Vec::len);
    if rows.iter().any(|row| row.len() != width) {
        return Err("rows of unequal length".to_owned());
    }
    Ok(DMatrix::from_row_iterator(rows.len(), width, rows.into_iter().flatten()))
}

/// A 3×3 matrix as three rows.
pub(crate) fn matrix3(value: &Value) -> Result<Matrix3<f64>, String> {
    let rows = matrix(value)?;
    if rows.shape() != (3, 3) {
        return Err(format!("a 3×3 matrix was expected, found {:?}", rows.shape()));
    }
    Ok(rows.fixed_view::<3, 3>(0, 0).into_owned())
}

/// Three numbers.
pub(crate) fn vector3(value: &Value) -> Result<Vector3<f64>, String> {
    match numbers(value)?.as_slice() {
        [x, y, z] => Ok(Vector3::new(*x, *y, *z)),
        other => Err(format!("three numbers were expected, found {}", other.len())),
    }
}

fn list(value: &Value) -> Result<&Vec<Value>, String> {
    value.as_array().ok_or_else(|| format!("a list was expected, found {value}"))
}
