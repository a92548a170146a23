//! The program under test.

use std::process::{Command, Output};

/// What a run with these arguments comes to.
pub(crate) fn kurs(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_kurs")).args(arguments).output().unwrap()
}

/// A run that succeeds.
pub(crate) fn run(arguments: &[&str]) -> Output {
    let output = kurs(arguments);
    assert!(output.status.success(), "{}", text(&output.stderr));
    output
}

/// What it printed.
pub(crate) fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}
