//! Any bytes as navigation data: RINEX 2 to 4 or SP3, packed or not.
#![no_main]

#[path = "../../crates/kurs-formats/tests/files/checks/mod.rs"]
mod checks;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| checks::navigation_file(bytes));
