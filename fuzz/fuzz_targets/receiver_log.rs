//! Any bytes as the messages of a receiver log (UBX, RTCM 3, SBF), with good checksums.
#![no_main]

#[path = "../../crates/kurs-formats/tests/files/checks/mod.rs"]
mod checks;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| checks::receiver_log(bytes));
