//! The recording `matrtklib_static` of `../shared/data` (or `KURS_DATA`).

use std::path::{Path, PathBuf};

/// Its folder; says so where it is absent.
pub(crate) fn folder() -> Option<PathBuf> {
    let data = std::env::var_os("KURS_DATA")
        .map_or(Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data"), PathBuf::from);
    let folder = data.join("matrtklib_static");
    if folder.is_dir() {
        return Some(folder);
    }
    println!("skipped: no recordings in {}", data.display());
    None
}
