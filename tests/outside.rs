//! What tests take from outside the project: recordings, vectors of many digits, programs of others.
//!
//! A test that lacks them passes and says so on standard error, past the runner's capture of its output:
//! it must not look like one that has tested something. `KURS_REQUIRE_DATA=1` makes absent recordings and
//! vectors a failure.
#![allow(dead_code)] // each test program uses a part

use std::io::Write as _;
use std::path::{Path, PathBuf};

/// A file or folder of the recordings: below `KURS_DATA`, or `../shared/data` beside the workspace.
pub(crate) fn recording(name: &str) -> Option<PathBuf> {
    below("KURS_DATA", "data", "recordings", name)
}

/// The folder of the vectors: `KURS_VECTORS`, or `../shared/vectors` beside the workspace.
pub(crate) fn vectors() -> Option<PathBuf> {
    below("KURS_VECTORS", "vectors", "vectors", "")
}

fn below(variable: &str, default: &str, what: &str, name: &str) -> Option<PathBuf> {
    let shared = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared");
    let path = std::env::var_os(variable).map_or(shared.join(default), PathBuf::from).join(name);
    if path.exists() {
        return Some(path);
    }
    let why = format!("no {what} (no {})", path.display());
    assert!(std::env::var_os("KURS_REQUIRE_DATA").is_none_or(|v| v != "1"), "{why}");
    skipped(&why);
    None
}

/// Says that the running test tests nothing, and why.
pub(crate) fn skipped(why: &str) {
    let thread = std::thread::current();
    let test = thread.name().unwrap_or("a test");
    // The runner captures what the print macros write, not what is written to the stream itself.
    let _ = writeln!(std::io::stderr(), "skipped: {why}: {test}");
}
