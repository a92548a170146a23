//! Any bytes as a table (CSV) and as a log (NMEA) of antenna coordinates, packed or not.
#![no_main]

#[path = "../../crates/kurs-formats/tests/files/checks/mod.rs"]
mod checks;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| checks::position_file(bytes));
