//! What a result depends on, as one text: two runs with the same one have the same rows.

use std::fmt::Write as _;
use std::fs::File;
use std::hash::{DefaultHasher, Hasher};
use std::io::Read;
use std::path::Path;

use super::config::Loaded;

/// The keys in force, the program's version, the part of the session, and size and content of every input.
pub(super) fn of(loaded: &Loaded) -> String {
    let mut text =
        format!("{}\n{}\n{:?}\n", env!("CARGO_PKG_VERSION"), loaded.text(), loaded.window);
    for path in loaded.input_files() {
        // What cannot be read is named by those who need it.
        let (size, content) = hashed(&path).unwrap_or_default();
        // A `String` takes everything.
        let _ = writeln!(text, "{size} {content:016x}");
    }
    text
}

fn hashed(path: &Path) -> std::io::Result<(u64, u64)> {
    let mut file = File::open(path)?;
    let mut hasher = DefaultHasher::new();
    let mut piece = vec![0; 1 << 18];
    let mut size = 0;
    loop {
        let count = file.read(&mut piece)?;
        if count == 0 {
            return Ok((size, hasher.finish()));
        }
        hasher.write(&piece[..count]);
        size += count as u64;
    }
}
