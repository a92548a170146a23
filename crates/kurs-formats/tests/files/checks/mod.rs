//! What must hold for any bytes given to a reader; shared by the mutation tests and the fuzz
//! targets.
#![allow(unreachable_pub)] // the fuzz targets are another crate

use std::collections::BTreeSet;
use std::io::Cursor;

use kurs::ephemeris::NavigationData;
use kurs::observation::AntennaEpoch;
use kurs_formats::damage::DamageLog;
use kurs_formats::observations::ObservationSource;
use kurs_formats::positions::{PositionFix, csv, nmea};
use kurs_formats::source::{ReadError, Source};
use kurs_formats::{antex, navigation, tdm};

/// Reads any bytes as an observation file; panics if what comes out makes no sense.
pub fn observation_file(bytes: &[u8]) {
    let Ok(mut source) = ObservationSource::new(Cursor::new(bytes.to_vec()), "any") else { return };
    let is_log = matches!(source, ObservationSource::Log(_));
    let (lines, first) = match is_log {
        true => (bytes.len() as u64, 0),
        false => (bytes.split(|byte| *byte == b'\n').count() as u64, 1),
    };
    let packed = bytes.starts_with(&[0x1f, 0x8b]);
    let mut epoch = AntennaEpoch::default();
    let mut last = None;
    let mut epochs = 0;
    loop {
        match source.next_epoch(&mut epoch) {
            Ok(false) => break,
            Ok(true) => epochs += 1,
            // A log of several stations.
            Err(ReadError::WrongContent { .. }) if is_log => return,
            // Files of two versions or two forms in one.
            Err(ReadError::Line { what, .. })
                if what.starts_with("a second header of")
                    || what.starts_with("a compact file begins") =>
            {
                return;
            }
            Err(error) => panic!("no operating system in between: {error}"),
        }
        assert!(packed || epochs <= lines, "more epochs than lines");
        assert!(last < Some(epoch.time), "{} is not later", epoch.time);
        last = Some(epoch.time);
        check_epoch(&epoch);
    }
    assert!(!source.next_epoch(&mut epoch).expect("still none"), "an epoch behind the end");
    for damage in source.damage() {
        assert!(packed || (first..=lines).contains(&damage.line), "{damage:?} of {lines} lines");
        assert!(!damage.what.is_empty());
    }
}

/// Reads any bytes as a receiver log whose messages have good checksums, whatever is in them.
pub fn receiver_log(bytes: &[u8]) {
    let sealed = sealed(bytes);
    observation_file(&sealed);
    navigation_file(&sealed);
}

/// Sets the checksum of everything that begins like a message.
fn sealed(bytes: &[u8]) -> Vec<u8> {
    let mut sealed = bytes.to_vec();
    let mut at = 0;
    while at < sealed.len() {
        let rest = &mut sealed[at..];
        let length = match *rest {
            [0xb5, 0x62, _, _, low, high, ..] => 8 + usize::from(u16::from_le_bytes([low, high])),
            [0xd3, high, low, ..] if high < 4 => 6 + usize::from(u16::from_be_bytes([high, low])),
            [b'$', b'@', _, _, _, _, low, high, ..] => {
                usize::from(u16::from_le_bytes([low, high])) & !3
            }
            _ => 0,
        };
        match rest.get_mut(..length) {
            Some([0xb5, _, body @ .., a, b]) => {
                (*a, *b) = body.iter().fold((0, 0), |(a, b): (u8, u8), byte| {
                    let a = a.wrapping_add(*byte);
                    (a, b.wrapping_add(a))
                });
            }
            Some([b'$', _, low, high, body @ ..]) => {
                if let [_, _, length, ..] = body {
                    *length &= !3;
                }
                let bits = body.iter().flat_map(|byte| (0..8).rev().map(move |i| byte >> i & 1));
                let crc = bits.fold(0u16, |crc, bit| {
                    let carry = crc >> 15 ^ u16::from(bit);
                    crc << 1 ^ if carry & 1 == 1 { 0x1021 } else { 0 }
                });
                [*low, *high] = crc.to_le_bytes();
            }
            Some(message @ [0xd3, ..]) => {
                let (body, checksum) = message.split_at_mut(length - 3);
                let crc = body.iter().flat_map(|byte| (0..8).rev().map(move |i| byte >> i & 1));
                let crc = crc.fold(0u32, |crc, bit| {
                    let carry = crc >> 23 ^ u32::from(bit);
                    (crc << 1 ^ if carry & 1 == 1 { 0x86_4cfb } else { 0 }) & 0xff_ffff
                });
                checksum.copy_from_slice(&crc.to_be_bytes()[1..]);
            }
            _ => {}
        }
        at += length.max(1);
    }
    sealed
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

/// Reads any bytes as navigation data; panics if a record cannot be evaluated.
pub fn navigation_file(bytes: &[u8]) {
    let Ok(mut source) = Source::new(Cursor::new(bytes.to_vec()), "any") else { return };
    let mut data = NavigationData::default();
    let Ok(summary) = navigation::read(&mut source, &mut data) else { return };
    let records: usize = summary.records.values().sum();
    assert!(data.ephemerides.len() <= records, "more records than were counted");
    for record in data.ephemerides.iter() {
        let time = record.reference_time() + 1234.5;
        let state = record.state(time).expect("near the reference time");
        assert!(state.position_m.is_finite() && state.velocity_mps.is_finite(), "{record:?}");
        assert!(state.clock_s.abs() < 2.0 && state.sigma_m >= 0.0, "{record:?}");
    }
    for (satellite, nodes) in data.ephemerides.precise().iter() {
        assert!(nodes.windows(2).all(|pair| pair[0].time < pair[1].time), "{satellite}");
        if let Some(state) = data.ephemerides.precise().state(satellite, nodes[0].time + 1.0) {
            assert!(state.position_m.is_finite() && state.clock_s.is_finite(), "{satellite}");
        }
    }
}

/// Reads any bytes as antenna calibrations.
pub fn antenna_file(bytes: &[u8]) {
    let Ok(mut source) = Source::new(Cursor::new(bytes.to_vec()), "any") else { return };
    let Ok((antennas, _)) = antex::read(&mut source) else { return };
    let Some(antenna) = antennas.find("TESTANT_A") else { return };
    for band in antenna.bands() {
        let correction_m = antenna.correction_m(band, 1.0, 0.5).expect("a calibrated band");
        assert!(correction_m.abs() < 40.0, "{correction_m} m");
    }
}

/// Reads any bytes as antenna coordinates, in a table and in a log.
pub fn position_file(bytes: &[u8]) {
    let names = ["A0".to_owned(), "A1".to_owned()];
    let mut damage = DamageLog::default();
    let check = |fix: PositionFix| {
        assert!(fix.antenna < names.len(), "{fix:?}");
        assert!(fix.position_m.is_finite() && fix.position_m.norm() < 1e8, "{fix:?}");
        assert!(fix.sd_ned_m.is_none_or(|sd| sd.iter().all(|s| s.is_finite() && *s >= 0.0)));
    };
    let source = || Source::new(Cursor::new(bytes.to_vec()), "any").ok();
    // An error is one of the outcomes; what counts is what was given out before it.
    let _ = source().map(|mut source| csv::read(&mut source, &names, &mut damage, check));
    for accept_no_checksum in [false, true] {
        let options = nmea::NmeaOptions { date: Some((2024, 5, 1)), accept_no_checksum };
        let _ = source().map(|mut source| nmea::read(&mut source, 1, options, &mut damage, check));
    }
}

/// Reads any text as a tracking data message.
pub fn track_file(bytes: &[u8]) {
    let Ok(text) = std::str::from_utf8(bytes) else { return };
    let _ = tdm::looks_like(text);
    let Ok(data) = tdm::read(text) else { return };
    for record in &data.records {
        assert!(record.value.is_finite(), "{record:?}");
    }
}
