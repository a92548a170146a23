//! What a result depends on, as one text: two runs with the same one have the same rows.

use std::fmt::Write as _;
use std::fs::File;
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

/// Size and fingerprint of a file's content.
fn hashed(path: &Path) -> std::io::Result<(u64, u64)> {
    let mut file = File::open(path)?;
    let mut fingerprint = Fingerprint::default();
    let mut piece = vec![0; 1 << 18];
    let (mut size, mut filled) = (0, 0);
    loop {
        let count = file.read(&mut piece[filled..])?;
        (size, filled) = (size + count as u64, filled + count);
        // Whole words but for the end, however the system cuts what it reads.
        let whole = if count == 0 { filled } else { filled / WORD * WORD };
        fingerprint.add(&piece[..whole]);
        piece.copy_within(whole..filled, 0);
        filled -= whole;
        if count == 0 {
            return Ok((size, fingerprint.0));
        }
    }
}

const WORD: usize = size_of::<u64>();

/// Tells contents apart that nobody has made alike on purpose: each word goes in by `h ← rotate(h ⊕ w) · K`, which no two
/// words do in the same way.
#[derive(Debug, Default)]
struct Fingerprint(u64);

impl Fingerprint {
    fn add(&mut self, bytes: &[u8]) {
        // 2⁶⁴ over the golden ratio, odd
        const K: u64 = 0x9e37_79b9_7f4a_7c15;
        let (words, rest) = bytes.as_chunks::<WORD>();
        let mut end = [0; WORD];
        end[..rest.len()].copy_from_slice(rest);
        for word in words.iter().chain((!rest.is_empty()).then_some(&end)) {
            self.0 = (self.0 ^ u64::from_le_bytes(*word)).rotate_left(29).wrapping_mul(K);
        }
    }
}
