//! A module may use only modules declared above it in `lib.rs`.

use std::{fs, path::Path};

/// All Rust source of a module: one file, or a folder with `mod.rs`.
fn source(path: &Path) -> String {
    if !path.is_dir() {
        return fs::read_to_string(path).expect("module file");
    }
    let entries = fs::read_dir(path).expect("module folder");
    entries.map(|entry| source(&entry.expect("folder entry").path())).collect()
}

#[test]
fn modules_use_only_modules_above_them() {
    let src = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let lib = fs::read_to_string(src.join("lib.rs")).expect("lib.rs");
    let order: Vec<&str> = lib
        .lines()
        .filter_map(|line| line.trim_start_matches("pub ").strip_prefix("mod ")?.strip_suffix(';'))
        .collect();
    assert!(order.len() >= 5, "lib.rs lists its modules as `pub mod name;`");

    for (position, module) in order.iter().enumerate() {
        let file = src.join(format!("{module}.rs"));
        let text = source(&if file.exists() { file } else { src.join(module) });
        for below in &order[position + 1..] {
            for separator in ["::", ";", "}", ",", " "] {
                let path = format!("crate::{below}{separator}");
                assert!(!text.contains(&path), "{module} uses {below}, which stands below it");
            }
        }
    }
}
