//! Any bytes as an observation file: RINEX 2 to 4, compact or not, packed or not.
#![no_main]

#[path = "../../crates/kurs-formats/tests/files/checks/mod.rs"]
mod checks;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| checks::observation_file(bytes));
