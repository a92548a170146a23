//! Any text as a tracking data message (CCSDS TDM).
#![no_main]

#[path = "../../crates/kurs-formats/tests/files/checks/mod.rs"]
mod checks;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| checks::track_file(bytes));
