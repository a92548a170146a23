//! What must hold for any bytes given to a reader; shared by the mutation tests and the fuzz
//! targets.
#![allow(unreachable_pub)] // the fuzz targets are another crate

use std::collections::BTreeSet;
use std::io::Cursor;

use kurs::observation::AntennaEpoch;
use kurs_formats::observations::ObservationSource;

/// Reads any bytes as an observation file; panics if what comes out makes no sense.
pub fn observation_file(bytes: &[u8]) {
    let Ok(mut source) = ObservationSource::new(Cursor::new(bytes.to_vec()), "any") else { return };
    let lines = bytes.split(|byte| *byte == b'\n').count() as u64;
    let packed = bytes.starts_with(&[0x1f, 0x8b]);
    let mut epoch = AntennaEpoch::default();
    let mut last = None;
    let mut epochs = 0;
    while source.next_epoch(&mut epoch).expect("no operating system in between") {
        epochs += 1;
        assert!(packed || epochs <= lines, "more epochs than lines");
        assert!(last < Some(epoch.time), "{} is not later", epoch.time);
        last = Some(epoch.time);
        check_epoch(&epoch);
    }
    assert!(!source.next_epoch(&mut epoch).expect("still none"), "an epoch behind the end");
    for damage in source.damage() {
        assert!(packed || (1..=lines).contains(&damage.line), "{damage:?} of {lines} lines");
        assert!(!damage.what.is_empty());
    }
}

fn check_epoch(epoch: &AntennaEpoch) {
    assert!(epoch.clock_offset_s.is_none_or(f64::is_finite));
    let mut seen = BTreeSet::new();
    for o in &epoch.observations {
        assert!((1..=99).contains(&o.satellite.number), "{o:?}");
        assert_eq!(o.satellite.system, o.signal.band.system);
        assert!(o.signal.attribute.is_ascii_uppercase(), "{o:?}");
        assert!(seen.insert((o.satellite, o.signal)), "{o:?} twice");
        let numbers = [o.pseudorange_m, o.phase_cycles, o.doppler_hz, o.cn0_dbhz];
        assert!(numbers.iter().any(Option::is_some), "nothing in {o:?}");
        let sane = |number: &f64| number.is_finite() && *number != 0.0 && number.abs() < 1e10;
        assert!(numbers.iter().flatten().all(sane), "{o:?}");
        assert!(o.lock.0 <= 11, "{o:?}");
    }
}
