//! Any bytes as all that an NTRIP caster sends.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    if let Ok(body) = kurs_live::body_of_answer(bytes) {
        assert!(body.len() <= bytes.len());
    }
});
