//! Ephemerides in receiver logs: written, read back, and read by `convbin` of RTKLIB.
#![allow(clippy::unwrap_used, clippy::print_stdout)] // a test

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;

use kurs::ephemeris::{Ephemeris, NavigationData};
use kurs::frames::Vector;
use kurs::observation::{AntennaEpoch, Lock, Observation};
use kurs::signal::{Satellite, Signal, System};
use kurs::time::GpsTime;
use kurs_formats::navigation;
use kurs_formats::rtcm::Rtcm3Writer;
use kurs_formats::source::Source;
use kurs_formats::ubx::UbxWriter;

/// Broadcast ephemerides of every system around 2023-03-12 12:00, one for each satellite.
fn broadcast() -> Option<NavigationData> {
    let default = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data");
    let data = std::env::var_os("KURS_DATA").map_or(default, PathBuf::from);
    let file = data.join("formats/BRD400DLR_S_20230710000_01D_MN.rnx.gz");
    let Ok(mut source) = Source::open(file) else {
        println!("skipped: no recordings in {}", data.display());
        return None;
    };
    let mut all = NavigationData::default();
    navigation::read(&mut source, &mut all).unwrap();
    let mut nearest: BTreeMap<Satellite, Ephemeris> = BTreeMap::new();
    let away = |e: &Ephemeris| (e.reference_time() - noon()).abs();
    for e in all
        .ephemerides
        .iter()
        .filter(|e| e.interval_of_use_s().contains(&(noon() - e.reference_time())))
    {
        let is_fnav = matches!(e, Ephemeris::Kepler(k) if k.elements().message == kurs::ephemeris::Message::GalileoFnav);
        let known = nearest.get(&e.satellite());
        if !is_fnav && known.is_none_or(|known| away(known) > away(e)) {
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

fn logs(data: &NavigationData) -> [(&'static str, Vec<u8>); 2] {
    let mut ubx = UbxWriter::new(Vec::new(), data);
    let mut rtcm = Rtcm3Writer::new(Vec::new(), 1, Vector::new(3.8e6, 6e5, 5e6), data);
    for second in 0..3 {
        let epoch = epoch(data, noon() + f64::from(second));
        ubx.write(&epoch).unwrap();
        rtcm.write(&epoch).unwrap();
    }
    [("ubx", ubx.finish()), ("rtcm3", rtcm.finish())]
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
        // Galileo's I/NAV drift has steps of 2⁻⁴⁶ s/s.
        assert!(
            apart_m < 0.01 && clocks_apart_m < 0.01,
            "{log} {}: {apart_m} {clocks_apart_m}",
            e.satellite()
        );
        assert_eq!(e.is_usable(), wanted.is_usable(), "{log} {}", e.satellite());
        // RINEX 3.04 has no accuracy of GLONASS.
        let no_accuracy = log == "convbin" && e.satellite().system == System::Glonass;
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
        println!("{format}: {:?}", compare(&found, &data, format));

        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("navigation");
        std::fs::create_dir_all(&folder).unwrap();
        let (log, output) = (folder.join(format!("log.{format}")), folder.join("nav.rnx"));
        std::fs::write(&log, &bytes).unwrap();
        let _ = std::fs::remove_file(&output);
        let run = Command::new("convbin")
            .args(["-r", format, "-v", "3.04", "-tr", "2023/03/12", "12:00:00", "-n"])
            .args([&output, &log])
            .output();
        if let Err(error) = run {
            println!("skipped: convbin: {error}");
            continue;
        }
        let mut theirs = NavigationData::default();
        navigation::read(&mut Source::open(&output).unwrap(), &mut theirs).unwrap();
        println!("convbin of {format}: {:?}", compare(&theirs, &data, "convbin"));
    }
}
