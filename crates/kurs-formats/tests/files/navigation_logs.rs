//! Ephemerides in receiver logs: written, read back, and read by `convbin` of RTKLIB.
#![allow(clippy::unwrap_used, clippy::print_stdout)] // a test

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::process::Command;

use kurs::ephemeris::{Ephemeris, GlonassElements, GlonassEphemeris, Message, NavigationData};
use kurs::frames::Vector;
use kurs::observation::{AntennaEpoch, Lock, Observation};
use kurs::signal::{Satellite, Signal, System};
use kurs::time::GpsTime;
use kurs_formats::navigation;
use kurs_formats::rtcm::Rtcm3Writer;
use kurs_formats::sbf::SbfWriter;
use kurs_formats::source::Source;
use kurs_formats::ubx::UbxWriter;

/// Broadcast ephemerides of every system around 2023-03-12 12:00, one for each satellite.
fn broadcast() -> Option<NavigationData> {
    broadcast_of(|e| !is_fnav(e))
}

fn is_fnav(e: &Ephemeris) -> bool {
    matches!(e, Ephemeris::Kepler(k) if k.elements().message == Message::GalileoFnav)
}

/// Those of the wanted messages.
fn broadcast_of(wanted: impl Fn(&Ephemeris) -> bool) -> Option<NavigationData> {
    let file = crate::outside::recording("formats/BRD400DLR_S_20230710000_01D_MN.rnx.gz")?;
    let mut source = Source::open(file).unwrap();
    let mut all = NavigationData::default();
    navigation::read(&mut source, &mut all).unwrap();
    let mut nearest: BTreeMap<Satellite, Ephemeris> = BTreeMap::new();
    let away = |e: &Ephemeris| (e.reference_time() - noon()).abs();
    for e in all
        .ephemerides
        .iter()
        .filter(|e| e.interval_of_use_s().contains(&(noon() - e.reference_time())))
    {
        let known = nearest.get(&e.satellite());
        if wanted(e) && known.is_none_or(|known| away(known) > away(e)) {
            nearest.insert(e.satellite(), *e);
        }
    }
    let mut data = NavigationData::default();
    for e in nearest.into_values() {
        data.ephemerides.insert(e);
    }
    Some(data)
}

fn noon() -> GpsTime {
    GpsTime::from_week_tow(2253, 43_200.0).unwrap()
}

/// An epoch with one signal of each satellite, so that a log has a time.
fn epoch(data: &NavigationData, time: GpsTime) -> AntennaEpoch {
    let observation = |e: &Ephemeris| {
        let system = e.satellite().system;
        let digit = if system == System::BeiDou { 2 } else { 1 };
        let attribute = if system == System::BeiDou { b'I' } else { b'C' };
        Observation {
            satellite: e.satellite(),
            signal: Signal::new(system, digit, attribute),
            pseudorange_m: Some(2.2e7),
            phase_cycles: Some(1.15e8),
            doppler_hz: Some(100.0),
            cn0_dbhz: Some(45.0),
            lock: Lock(0),
        }
    };
    let observations = data.ephemerides.iter().map(observation).collect();
    AntennaEpoch { time, observations, ..AntennaEpoch::default() }
}

/// Numbers of the blocks with decoded messages.
const DECODED: [u16; 5] = [5891, 4095, 4002, 4081, 4004];

/// An SBF log has every ephemeris twice: decoded, and as the pages that it comes from. It is given
/// with both, and with one of them only.
fn logs(data: &NavigationData) -> [(&'static str, Vec<u8>); 5] {
    let mut ubx = UbxWriter::new(Vec::new(), data);
    let mut rtcm = Rtcm3Writer::new(Vec::new(), 1, Vector::new(3.8e6, 6e5, 5e6), data);
    let mut sbf = SbfWriter::new(Vec::new(), data);
    for second in 0..3 {
        let epoch = epoch(data, noon() + f64::from(second));
        ubx.write(&epoch).unwrap();
        rtcm.write(&epoch).unwrap();
        sbf.write(&[&epoch]).unwrap();
    }
    let sbf = sbf.finish();
    let [decoded, pages]: [Vec<&[u8]>; 2] = [true, false].map(|decoded| {
        let blocks = sbf_blocks(&sbf).into_iter();
        blocks.filter(|(number, _)| DECODED.contains(number) == decoded).map(|(_, b)| b).collect()
    });
    [
        ("ubx", ubx.finish()),
        ("rtcm3", rtcm.finish()),
        ("sbf pages", pages.concat()),
        ("sbf decoded", decoded.concat()),
        ("sbf", sbf.clone()),
    ]
}

/// Number and bytes of each block.
fn sbf_blocks(log: &[u8]) -> Vec<(u16, &[u8])> {
    let mut rest = log;
    std::iter::from_fn(move || {
        let u16_at = |at: usize| Some(u16::from_le_bytes([*rest.get(at)?, rest[at + 1]]));
        let number = u16_at(4)? & 0x1fff;
        let (block, behind) = rest.split_at(usize::from(u16_at(6)?));
        rest = behind;
        Some((number, block))
    })
    .collect()
}

/// Counts per system of ephemerides whose orbit and clock agree with those of `data`.
fn compare(found: &NavigationData, data: &NavigationData, log: &str) -> BTreeMap<System, usize> {
    let mut counts = BTreeMap::new();
    for e in found.ephemerides.iter() {
        let same = |other: &&Ephemeris| other.satellite() == e.satellite();
        let wanted = data.ephemerides.iter().find(same).unwrap();
        assert_eq!(e.reference_time(), wanted.reference_time(), "{log} {}", e.satellite());
        let time = e.reference_time() + 600.0;
        let [a, b] = [e, wanted].map(|e| e.state(time).unwrap());
        let apart_m = (a.position_m - b.position_m).norm();
        let clocks_apart_m = (a.clock_s - b.clock_s).abs() * 299_792_458.0;
        // `convbin` takes velocities of GLONASS in SBF times 1000 in single precision: 6·10⁻⁵ m/s.
        let is_rounded = log == "convbin sbf decoded" || log == "convbin sbf";
        let is_rounded = is_rounded && e.satellite().system == System::Glonass;
        // Galileo's I/NAV drift has steps of 2⁻⁴⁶ s/s.
        assert!(
            apart_m < if is_rounded { 0.1 } else { 0.01 } && clocks_apart_m < 0.01,
            "{log} {}: {apart_m} {clocks_apart_m}",
            e.satellite()
        );
        // `convbin` does not read the health of GPS in SBF.
        let no_health = log.starts_with("convbin sbf") && e.satellite().system == System::Gps;
        assert!(no_health || e.is_usable() == wanted.is_usable(), "{log} {}", e.satellite());
        // RINEX 3.04 has no accuracy of GLONASS.
        let no_accuracy = log.starts_with("convbin") && e.satellite().system == System::Glonass;
        assert!(
            no_accuracy || (a.sigma_m - b.sigma_m).abs() <= 0.35 * b.sigma_m + 0.01,
            "{log} {}: {} {}",
            e.satellite(),
            a.sigma_m,
            b.sigma_m
        );
        *counts.entry(e.satellite().system).or_default() += 1;
    }
    counts
}

#[test]
fn ephemerides_of_a_log_are_those_that_were_written() {
    let Some(data) = broadcast() else { return };
    let mut wanted: BTreeMap<System, usize> = BTreeMap::new();
    data.ephemerides.iter().for_each(|e| *wanted.entry(e.satellite().system).or_default() += 1);
    println!("{wanted:?}");
    for (format, bytes) in logs(&data) {
        let mut found = NavigationData::default();
        let mut source = Source::new(std::io::Cursor::new(bytes.clone()), "log").unwrap();
        let summary = navigation::read(&mut source, &mut found).unwrap();
        assert_eq!(summary.damage.listed(), [], "{format}");
        let counts = compare(&found, &data, format);
        println!("{format}: {counts:?}");
        if format.starts_with("sbf") {
            assert_eq!(counts, wanted, "{format}");
        }

        let Some(theirs) = convbin(&bytes, format) else { continue };
        println!(
            "convbin of {format}: {:?}",
            compare(&theirs, &data, &format!("convbin {format}"))
        );
    }
}

/// A log that begins in the midst of the subframes: the date stands behind them, in the first
/// epoch.
#[test]
fn subframes_before_the_first_epoch_have_its_date() {
    let Some(data) = broadcast() else { return };
    let log = &logs(&data)[0].1;
    let [epochs, subframes] = [0x15, 0x13].map(|id| {
        let of_id = ubx_messages(log).into_iter().filter(|message| message[3] == id);
        of_id.collect::<Vec<_>>().concat()
    });
    let mut found = NavigationData::default();
    let bytes = std::io::Cursor::new([subframes, epochs].concat());
    let summary = navigation::read(&mut Source::new(bytes, "log").unwrap(), &mut found).unwrap();
    assert_eq!(summary.damage.listed(), []);
    let counts = compare(&found, &data, "ubx");
    assert!(counts.contains_key(&System::Glonass), "its strings do not tell the day: {counts:?}");
}

/// The messages of a UBX log.
fn ubx_messages(log: &[u8]) -> Vec<&[u8]> {
    let mut rest = log;
    std::iter::from_fn(move || {
        let length = u16::from_le_bytes([*rest.get(4)?, rest[5]]);
        let (message, behind) = rest.split_at(8 + usize::from(length));
        rest = behind;
        Some(message)
    })
    .collect()
}

/// F/NAV: message 1045, pages of E5a in UBX and SBF, decoded blocks.
#[test]
fn galileo_fnav_in_logs() {
    let Some(all) = broadcast_of(is_fnav) else { return };
    let mut data = NavigationData::default();
    all.ephemerides.iter().filter(|e| is_fnav(e)).for_each(|e| data.ephemerides.insert(*e));
    let wanted = BTreeMap::from([(System::Galileo, data.ephemerides.len())]);
    assert!(data.ephemerides.len() > 15, "{wanted:?}");
    for (format, bytes) in logs(&data) {
        let mut found = NavigationData::default();
        let mut source = Source::new(std::io::Cursor::new(bytes), "log").unwrap();
        let summary = navigation::read(&mut source, &mut found).unwrap();
        assert_eq!(summary.damage.listed(), [], "{format}");
        assert_eq!(compare(&found, &data, format), wanted, "{format}");
        assert!(found.ephemerides.iter().all(is_fnav), "{format}");
    }
}

/// The messages of GLONASS count the reference time in quarters of an hour.
#[test]
fn what_a_message_has_no_room_for_is_told() {
    let reference_time = noon() + 18.0;
    let elements = |number, late_s| GlonassElements {
        satellite: Satellite::new(System::Glonass, number),
        reference_time: reference_time + late_s,
        transmission_time: reference_time,
        clock_bias_s: 0.0,
        clock_drift: 0.0,
        position_m: Vector::new(2.5e7, 0.0, 0.0),
        velocity_mps: Vector::new(0.0, 3000.0, 0.0),
        acceleration_mps2: Vector::new(0.0, 0.0, 0.0),
        channel: 1,
        l2_delay_s: None,
        health: 0,
        accuracy_m: 5.0,
    };
    let mut data = NavigationData::default();
    for (number, late_s) in [(1, 0.0), (2, 60.0)] {
        let ephemeris = GlonassEphemeris::new(elements(number, late_s)).unwrap();
        data.ephemerides.insert(Ephemeris::Glonass(ephemeris));
    }
    let epoch = epoch(&data, noon());
    let mut ubx = UbxWriter::new(Vec::new(), &data);
    let mut rtcm = Rtcm3Writer::new(Vec::new(), 1, Vector::new(3.8e6, 6e5, 5e6), &data);
    let mut sbf = SbfWriter::new(Vec::new(), &data);
    ubx.write(&epoch).unwrap();
    rtcm.write(&epoch).unwrap();
    sbf.write(&[&epoch]).unwrap();
    let r02 = BTreeSet::from([Satellite::new(System::Glonass, 2)]);
    assert_eq!([ubx.left_out(), rtcm.left_out()], [&r02; 2]);
    // The block of SBF counts minutes.
    assert_eq!(sbf.left_out(), &BTreeSet::new());
}

/// What `convbin` makes of a log, but for what it is known to do wrong.
fn convbin(bytes: &[u8], format: &str) -> Option<NavigationData> {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("navigation");
    std::fs::create_dir_all(&folder).unwrap();
    let (log, output) = (folder.join(format.replace(' ', "-")), folder.join("nav.rnx"));
    std::fs::write(&log, bytes).unwrap();
    let _ = std::fs::remove_file(&output);
    let run = Command::new("convbin")
        .args(["-r", format.split(' ').next().unwrap(), "-v", "3.04", "-tr", "2023/03/12"])
        .args([Path::new("12:00:00"), Path::new("-n"), &output, &log])
        .output();
    if let Err(error) = run {
        crate::outside::lacking(&format!("convbin: {error}"));
        return None;
    }
    let mut all = NavigationData::default();
    navigation::read(&mut Source::open(&output).unwrap(), &mut all).unwrap();
    // Of the pages of Galileo in SBF it takes the second part six bits late.
    let is_wrong = |e: &&Ephemeris| {
        format.starts_with("sbf")
            && format != "sbf decoded"
            && e.satellite().system == System::Galileo
    };
    let mut theirs = NavigationData::default();
    all.ephemerides.iter().filter(|e| !is_wrong(e)).for_each(|e| theirs.ephemerides.insert(*e));
    Some(theirs)
}
