//! What a result depends on, as one text: two runs with the same one have the same rows.

use std::fmt::Write as _;
use std::fs::File;
use std::hash::Hasher;
use std::io::{BufRead, BufReader};
use std::path::Path;

use twox_hash::XxHash3_64;

use super::config::Loaded;

/// Bytes of a file that are read at once.
const PIECE: usize = 1 << 16;

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

/// Size and hash of a file's content: contents are told apart that nobody has made alike on purpose.
fn hashed(path: &Path) -> std::io::Result<(u64, u64)> {
    let mut file = BufReader::with_capacity(PIECE, File::open(path)?);
    let (mut size, mut hash) = (0, XxHash3_64::new());
    loop {
        let piece = file.fill_buf()?;
        if piece.is_empty() {
            return Ok((size, hash.finish()));
        }
        hash.write(piece);
        let count = piece.len();
        size += count as u64;
        file.consume(count);
    }
}
