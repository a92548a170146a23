//! Compact observation files: equal to the plain ones, and what damage does to them.
#![allow(clippy::unwrap_used)] // a test

use std::path::Path;

use kurs::observation::{AntennaEpoch, Lock, Observation};
use kurs_formats::rinex::observation::ObservationReader;

fn text(name: &str) -> String {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../testdata/observation");
    std::fs::read_to_string(folder.join(name)).unwrap()
}

fn read(text: &str) -> (Vec<AntennaEpoch>, u64) {
    let input = std::io::Cursor::new(text.as_bytes().to_vec());
    let mut reader = ObservationReader::new(input, "test.crx").unwrap();
    let (mut epochs, mut epoch) = (Vec::new(), AntennaEpoch::default());
    while reader.next_epoch(&mut epoch).unwrap() {
        epochs.push(epoch.clone());
    }
    (epochs, reader.damage_count())
}

#[test]
fn compact_files_equal_plain_ones() {
    for (compact, plain, count) in [
        ("mixed_3.crx", "mixed_3.rnx", 12),
        ("mixed_2.crx", "mixed_2.obs", 10),
        ("events_3.crx", "events_3.rnx", 12),
    ] {
        let (epochs, damage) = read(&text(compact));
        assert_eq!((epochs.len(), damage), (count, 0), "{compact}");
        assert_eq!(epochs, read(&text(plain)).0, "{compact}");
    }
}

/// Files joined one behind the other, with other columns in the second; one that is not compact.
#[test]
fn joined_files_are_read_with_their_own_headers() {
    let first = text("mixed_3.crx");
    let second = text("events_3.crx").replace("> 2024 06 24", "> 2024 06 25");
    let (mut wanted, events) = (read(&first).0, read(&second).0);
    wanted.extend(events);
    let (epochs, damage) = read(&[first.as_str(), &second].concat());
    assert_eq!((epochs.len(), damage), (wanted.len(), 1));
    for (found, wanted) in epochs.iter().zip(&wanted) {
        assert_eq!(found.time, wanted.time);
        let same = |a: &Observation, b: &Observation| {
            (a.satellite, a.signal, a.phase_cycles) == (b.satellite, b.signal, b.phase_cycles)
        };
        assert!(found.observations.iter().zip(&wanted.observations).all(|(a, b)| same(a, b)));
    }

    let plain = text("mixed_3.rnx");
    let input = std::io::Cursor::new([plain, second].concat().into_bytes());
    let mut reader = ObservationReader::new(input, "test.rnx").unwrap();
    let mut epoch = AntennaEpoch::default();
    let read_all = core::iter::from_fn(|| match reader.next_epoch(&mut epoch) {
        Ok(false) => None,
        other => Some(other),
    });
    let error = read_all.filter_map(Result::err).next().unwrap().to_string();
    assert!(error.contains("a compact file begins in a plain one"), "{error}");
}

#[test]
fn clock_offsets_are_read() {
    let (epochs, _) = read(&text("mixed_3.crx"));
    let offsets: Vec<_> = epochs.iter().take(4).map(|epoch| epoch.clock_offset_s).collect();
    assert_eq!(offsets, [None, Some(-4.938_268e-6), Some(-3.703_701e-6), None]);
    let (epochs, _) = read(&text("mixed_2.crx"));
    assert_eq!(epochs[3].clock_offset_s, Some(4.5e-7));
}

/// `rnx2crx` 4.1.0 forgets the digits of an observation that is missing without writing `&` for
/// them: they must not come back with the observation.
#[test]
fn digits_end_with_their_observation() {
    let record = |content: &str, label: &str| format!("{content:<60}{label}\n");
    let text = [
        &record("1.0                 COMPACT RINEX FORMAT", "CRINEX VERS   / TYPE"),
        &record("RNX2CRX ver.4.1.0", "CRINEX PROG / DATE"),
        &record("     2.11           OBSERVATION DATA    G (GPS)", "RINEX VERSION / TYPE"),
        &record("     3    C1    L1    L2", "# / TYPES OF OBSERV"),
        &record("", "END OF HEADER"),
        "&99  1  2  0  0  0.0000000  0  1G 5\n\n",
        "3&22000000000 3&100000000000 3&100000000000  4151\n",
        "                 1\n\n0  0      5\n",
        "                 2\n\n0 3&100000000000 0     &&\n",
        "                 3\n\n0 0 0   15\n",
    ];
    let (epochs, damage) = read(&text.concat());
    let locks = |band: u8| {
        let phase = |o: &&Observation| o.signal.band.digit == band && o.phase_cycles.is_some();
        epochs.iter().map(|epoch| epoch.observations.iter().find(phase).map(|o| o.lock.0)).collect()
    };
    let [first, second]: [Vec<_>; 2] = [locks(1), locks(2)];
    assert_eq!(damage, 0);
    assert_eq!(first, [Some(1), None, Some(0), Some(1)]);
    assert_eq!(second, [Some(1), Some(1), Some(0), Some(0)]);
}

/// Everything that comes out of a damaged file is in the whole one.
fn nothing_false(epochs: &[AntennaEpoch], whole: &[AntennaEpoch]) -> Result<(), String> {
    let fits = |a: Option<f64>, b: Option<f64>| a.is_none() || a == b;
    for epoch in epochs {
        let Some(right) = whole.iter().find(|right| right.time == epoch.time) else {
            return Err(format!("no epoch at {}", epoch.time));
        };
        for o in &epoch.observations {
            let known = right.observations.iter().any(|r: &Observation| {
                (r.satellite, r.signal) == (o.satellite, o.signal)
                    && fits(o.pseudorange_m, r.pseudorange_m)
                    && fits(o.phase_cycles, r.phase_cycles)
                    && fits(o.doppler_hz, r.doppler_hz)
                    && fits(o.cn0_dbhz, r.cn0_dbhz)
            });
            if !known {
                return Err(format!("{o:?} at {}", epoch.time));
            }
        }
    }
    Ok(())
}

/// A line too few or too many costs what is left up to the next epoch in full, and nothing else.
#[test]
fn one_bad_line() {
    for name in ["mixed_3.crx", "mixed_2.crx"] {
        let text = text(name);
        let (whole, _) = read(&text);
        let lines: Vec<&str> = text.split_inclusive('\n').collect();
        let header = 1 + lines.iter().position(|line| line.contains("END OF HEADER")).unwrap();
        for index in header..lines.len() {
            let (before, after) = (lines[..index].concat(), lines[index + 1..].concat());
            for broken in [before.clone() + &after, before + "#?%$\n" + &after] {
                let (epochs, damage) = read(&broken);
                assert!(damage > 0, "{name}, line {}: nothing noticed", index + 1);
                assert!(epochs.len() + 4 >= whole.len(), "{name}, line {}", index + 1);
                if let Err(what) = nothing_false(&epochs, &whole) {
                    panic!("{name}, line {}: {what}", index + 1);
                }
            }
        }
    }
}

#[test]
fn cut_at_every_byte() {
    for name in ["mixed_3.crx", "mixed_2.crx"] {
        let text = text(name);
        let (whole, _) = read(&text);
        let header = text.find("END OF HEADER").unwrap() + 20;
        for end in header..text.len() {
            let (epochs, _) = read(&text[..end]);
            if let Err(what) = nothing_false(&epochs, &whole) {
                panic!("{name}, cut at {end}: {what}");
            }
        }
    }
}

/// A number that is lost ends the arc, and nobody has seen whether the phase slipped meanwhile.
#[test]
fn a_phase_that_was_lost_has_slipped_when_it_begins_anew() {
    let text = text("mixed_3.crx");
    let (whole, _) = read(&text);
    let (epochs, damage) = read(&text.replace("-453034 -2377854", "-453034 -23x7854"));
    assert_eq!((epochs.len(), damage), (whole.len(), 3));
    let expected = whole.into_iter().enumerate().map(|(index, mut epoch)| {
        let phase = &mut epoch.observations[0];
        match index {
            1..=3 => (phase.phase_cycles, phase.lock) = (None, Lock::default()),
            4 => phase.lock.0 |= Lock::SLIP,
            _ => {}
        }
        epoch
    });
    for (epoch, expected) in epochs.iter().zip(expected) {
        assert_eq!(*epoch, expected);
    }
}

/// Two lines for one satellite: whose is which, nobody can tell.
#[test]
fn a_satellite_twice_in_an_epoch_is_left_out() {
    let (epochs, damage) = read(&text("mixed_3.crx").replacen("G03G07G11", "G03G07G07", 1));
    assert!(damage > 0);
    for epoch in &epochs[..4] {
        let number = |o: &Observation| o.satellite.number;
        assert!(!epoch.observations.iter().any(|o| [7, 11].contains(&number(o))), "{}", epoch.time);
        assert!(epoch.observations.iter().any(|o| number(o) == 19));
    }
}
