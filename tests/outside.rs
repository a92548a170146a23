//! What tests take from outside the project: recordings, vectors of many digits, programs of others.
//!
//! A test that lacks them passes and says so on standard error, past the runner's capture of its output:
//! it must not look like one that has tested something. `KURS_REQUIRE_DATA=1` makes absent recordings and
//! vectors a failure, `KURS_REQUIRE_TOOLS=1` absent programs.
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
    skipped("KURS_REQUIRE_DATA", &format!("no {what} (no {})", path.display()));
    None
}

/// A program or package of others is lacking.
pub(crate) fn lacking(why: &str) {
    skipped("KURS_REQUIRE_TOOLS", why);
}

/// Says that the running test tests nothing, and why; fails if the variable forbids that.
fn skipped(variable: &str, why: &str) {
    assert!(std::env::var_os(variable).is_none_or(|value| value != "1"), "{why}");
    let thread = std::thread::current();
    let test = thread.name().unwrap_or("a test");
    // The runner captures what the print macros write, not what is written to the stream itself.
    let _ = writeln!(std::io::stderr(), "skipped: {why}: {test}");
}
