//! Any text as the configuration of `kurs solve` and `kurs live`: an engine, or what is wrong, in words.
#![no_main]

use std::path::PathBuf;
use std::sync::LazyLock;

use kurs_cli::embedded::EmbeddedEngine;

/// The file of this process, in memory where the system has such a place.
static FILE: LazyLock<PathBuf> = LazyLock::new(|| {
    let memory = PathBuf::from("/dev/shm");
    let folder = if memory.is_dir() { memory } else { std::env::temp_dir() };
    folder.join(format!("kurs-fuzz-{}.toml", std::process::id()))
});

libfuzzer_sys::fuzz_target!(|text: &str| {
    std::fs::write(&*FILE, text).expect("a file that can be written");
    match EmbeddedEngine::open(&FILE, &[], Some(0.5)) {
        Ok(engine) => assert!(engine.sources().count() > 1),
        Err(error) => assert!(!error.to_string().is_empty()),
    }
});
