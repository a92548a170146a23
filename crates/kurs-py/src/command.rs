//! The commands, called inside the process.

use std::sync::mpsc::{self, RecvTimeoutError};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use kurs_cli::embedded;
use pyo3::exceptions::{PyKeyboardInterrupt, PyValueError};
use pyo3::prelude::*;

use crate::errors;

/// How often Python may look whether Ctrl-C was pressed.
const BETWEEN_LOOKS: Duration = Duration::from_millis(50);

/// The version of the program.
#[pyfunction]
pub(crate) const fn version() -> &'static str {
    env!("CARGO_PKG_VERSION")
}

/// Runs the program with these arguments, of which the first is its name; gives its exit status.
#[pyfunction]
pub(crate) fn run(py: Python<'_>, arguments: Vec<String>) -> u8 {
    py.detach(|| kurs_cli::run(arguments))
}

/// Runs a command whose errors are exceptions; gives its exit status, 0 or 3. Ctrl-C ends it at the next epoch, in
/// whichever thread it runs, by KeyboardInterrupt.
#[pyfunction]
pub(crate) fn call(py: Python<'_>, arguments: Vec<String>) -> PyResult<u8> {
    let (sender, receiver) = mpsc::channel();
    let command = std::thread::spawn(move || sender.send(embedded::call(arguments)));
    let receiver = Mutex::new(receiver);
    let mut interrupted = None;
    let result = loop {
        let next = py.detach(|| {
            receiver.lock().unwrap_or_else(PoisonError::into_inner).recv_timeout(BETWEEN_LOOKS)
        });
        match next {
            Ok(result) => break Some(result),
            Err(RecvTimeoutError::Disconnected) => break None,
            Err(RecvTimeoutError::Timeout) => {}
        }
        if let (None, Err(signal)) = (&interrupted, py.check_signals()) {
            embedded::ask_to_end(true);
            interrupted = Some(signal);
        }
    };
    // One that panicked has left its message.
    let _ = command.join();
    match (interrupted, result) {
        (Some(signal), _) => {
            embedded::ask_to_end(false);
            Err(signal)
        }
        // Asked by the main thread, whose command was interrupted.
        (None, Some(Ok(embedded::INTERRUPTED))) => Err(of_main_thread()),
        (None, Some(result)) => result.map_err(errors::of_command),
        (None, None) => Err(errors::Error::new_err("the command stopped by an error of its own")),
    }
}

fn of_main_thread() -> PyErr {
    PyKeyboardInterrupt::new_err("interrupted by Ctrl-C in the main thread, the result ends there")
}

/// TOML text of a JSON object, in which nulls are left out.
#[pyfunction]
pub(crate) fn toml_of_json(json: &str) -> PyResult<String> {
    let wrong = |error: &dyn std::fmt::Display| PyValueError::new_err(error.to_string());
    let value: serde_json::Value = serde_json::from_str(json).map_err(|error| wrong(&error))?;
    toml::to_string(&without_nulls(value)).map_err(|error| wrong(&error))
}

fn without_nulls(value: serde_json::Value) -> serde_json::Value {
    use serde_json::Value;
    match value {
        Value::Object(fields) => {
            let there = fields.into_iter().filter(|(_, value)| !value.is_null());
            Value::Object(there.map(|(key, value)| (key, without_nulls(value))).collect())
        }
        Value::Array(items) => Value::Array(items.into_iter().map(without_nulls).collect()),
        other => other,
    }
}
