//! The program under test.

use std::fmt::Write as _;
use std::fs;
use std::path::Path;
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

/// Keeps or changes the lines of a file.
pub(crate) fn edit(path: &Path, mut change: impl FnMut(usize, &str) -> Option<String>) {
    let before = fs::read_to_string(path).unwrap();
    let mut after = String::new();
    for line in before.lines().enumerate().filter_map(|(k, line)| change(k, line)) {
        writeln!(after, "{line}").unwrap();
    }
    fs::write(path, after).unwrap();
}
