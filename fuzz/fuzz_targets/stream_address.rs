//! Any text as the address of a stream or an output: what is read is written so that it is read again.
#![no_main]

use kurs_live::Address;

libfuzzer_sys::fuzz_target!(|text: &str| {
    match text.parse::<Address>() {
        Ok(address) => {
            let written = address.to_string();
            let again: Address = written.parse().unwrap_or_else(|error| panic!("{text:?}: {error}"));
            assert_eq!(again.to_string(), written, "{text:?}");
        }
        Err(error) => assert!(!error.what.is_empty()),
    }
});
