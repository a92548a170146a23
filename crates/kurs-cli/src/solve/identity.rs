//! What a result depends on, as one text: two runs with the same one have the same files.

use std::collections::BTreeSet;
use std::fmt::Write as _;

use kurs_formats::fingerprint::Fingerprint;

use super::Format;
use super::config::Loaded;

/// The keys in force, the program's version, the part of the session, the formats in whatever order, and size and
/// content of every input; those that were read already are `known`, by name.
pub(super) fn of(loaded: &Loaded, formats: &[Format], known: &[(String, Fingerprint)]) -> String {
    let (version, formats) = (env!("CARGO_PKG_VERSION"), formats.iter().collect::<BTreeSet<_>>());
    let mut text = format!("{version}\n{}\n{:?}\n{formats:?}\n", loaded.text(), loaded.window);
    for path in loaded.input_files() {
        let found = known.iter().find(|(name, _)| path.as_os_str() == name.as_str());
        // What cannot be read is named by those who need it.
        let read = || Fingerprint::of_file(&path).unwrap_or_default();
        let Fingerprint { size, hash } = found.map_or_else(read, |(_, fingerprint)| *fingerprint);
        // A `String` takes everything.
        let _ = writeln!(text, "{size} {hash:016x}");
    }
    text
}
