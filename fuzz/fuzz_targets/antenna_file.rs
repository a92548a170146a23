//! Any bytes as antenna calibrations (ANTEX), packed or not.
#![no_main]

#[path = "../../crates/kurs-formats/tests/files/checks/mod.rs"]
mod checks;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| checks::antenna_file(bytes));
