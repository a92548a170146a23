//! Any line of another body: what is read of it gives numbers, whatever it says.
#![no_main]

use kurs_live::{RelativeSettings, body_state, relative};

libfuzzer_sys::fuzz_target!(|line: &str| {
    match body_state(line) {
        Ok(state) => {
            let settings = RelativeSettings { unseen_sd_rad: 0.09, max_angle_sd_rad: 0.09 };
            for later_s in [0.0, 0.5, -60.0] {
                let time = state.time + later_s;
                if let Some(seen) = relative(&state, &state, time, settings) {
                    assert!(
                        seen.angles_rad.iter().flatten().all(|angle| angle.is_finite()),
                        "{line}"
                    );
                }
            }
        }
        Err(what) => assert!(!what.is_empty()),
    }
});
