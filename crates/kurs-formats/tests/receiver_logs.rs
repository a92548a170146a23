//! Receiver logs against `convbin` of RTKLIB: the same observations, or a reason why not.
#![allow(clippy::unwrap_used, clippy::print_stdout)] // a test

use std::collections::BTreeMap;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::Command;

use kurs::ephemeris::{Ephemeris, GlonassElements, GlonassEphemeris, NavigationData};
use kurs::frames::Vector;
use kurs::observation::{AntennaEpoch, Lock, Observation};
use kurs::signal::{Satellite, Signal};
use kurs::time::GpsTime;
use kurs_formats::logs::LogOptions;
use kurs_formats::observations::ObservationSource;
use kurs_formats::rtcm::Rtcm3Writer;
use kurs_formats::source::Source;
use kurs_formats::ubx::UbxWriter;

/// The observations of each signal in the order of time.
type Signals = BTreeMap<(Satellite, Signal), BTreeMap<GpsTime, Observation>>;

/// All observations of a file without damage, but for what stands before its first message.
fn signals(path: &Path) -> Signals {
    let mut source = ObservationSource::open(path).unwrap();
    let mut all = Signals::new();
    let mut epoch = AntennaEpoch::default();
    while source.next_epoch(&mut epoch).unwrap() {
        for o in &epoch.observations {
            all.entry((o.satellite, o.signal)).or_default().insert(epoch.time, *o);
        }
    }
    assert!(source.damage().iter().all(|d| d.line == 0), "{:?}", source.damage());
    all
}

/// What `convbin` makes of a log; `None` where the program is missing.
fn convbin(log: &Path, format: &str, folder: &Path) -> Option<Signals> {
    let output = folder.join("convbin.rnx");
    let run = Command::new("convbin")
        .args(["-r", format, "-v", "3.04", "-od", "-os", "-f", "7", "-o"])
        .args([&output, log])
        .output();
    match run {
        Ok(_) => Some(signals(&output)),
        Err(error) => {
            println!("skipped: convbin: {error}");
            None
        }
    }
}

/// The recording of a u-blox F9T, unpacked; `None` where there are no recordings.
fn f9t_log(folder: &Path) -> Option<PathBuf> {
    let default = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data");
    let data = std::env::var_os("KURS_DATA").map_or(default, PathBuf::from);
    let Ok(packed) = std::fs::File::open(data.join("formats/F9T-L2-5min.ubx.gz")) else {
        println!("skipped: no recordings in {}", data.display());
        return None;
    };
    let mut bytes = Vec::new();
    flate2::read::GzDecoder::new(packed).read_to_end(&mut bytes).unwrap();
    let log = folder.join("f9t.ubx");
    std::fs::write(&log, bytes).unwrap();
    Some(log)
}

fn folder(name: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    std::fs::create_dir_all(&folder).unwrap();
    folder
}

/// Differences of `convbin`, all of them: it has no BeiDou B1C; it drops phases whose stated
/// deviation is above 0.02 cycles; it marks the first phase of every signal as slipped, and a slip
/// in an epoch whose phase it drops is marked later; it misses slips where a signal was away for
/// longer than its new lock time, if that is not shorter than the old one.
#[test]
fn u_blox_log_as_convbin() {
    let folder = folder("f9t-convbin");
    let Some(log) = f9t_log(&folder) else { return };
    let Some(theirs) = convbin(&log, "ubx", &folder) else { return };
    let ours = signals(&log);
    let without = ours.keys().filter(|key| !theirs.contains_key(key));
    assert!(without.clone().all(|(_, signal)| signal.to_string() == "C1P"));
    assert_eq!(without.count(), 10);
    let mut phases = [0, 0];
    let mut missed = 0;
    for (key, theirs) in &theirs {
        let ours = &ours[key];
        assert_eq!(ours.len(), theirs.len(), "{key:?}");
        let mut slipped = false;
        let mut first = true;
        for ((time, a), b) in ours.iter().zip(theirs.values()) {
            let about = format!("{time} {} {}", a.satellite, a.signal);
            let near = |a: Option<f64>, b: Option<f64>, quantity: &str| match (a, b) {
                (Some(a), Some(b)) => {
                    assert!((a - b).abs() <= 5.1e-4, "{about} {quantity} {a} {b}")
                }
                _ => assert_eq!(a, b, "{about} {quantity}"),
            };
            near(a.pseudorange_m, b.pseudorange_m, "pseudorange");
            near(a.doppler_hz, b.doppler_hz, "Doppler");
            near(a.cn0_dbhz, b.cn0_dbhz, "C/N0");
            slipped |= a.lock.slipped();
            phases[0] += u32::from(a.phase_cycles.is_some());
            if b.phase_cycles.is_some() {
                phases[1] += 1;
                near(a.phase_cycles, b.phase_cycles, "phase");
                let half = |o: &Observation| o.lock.half_cycle_unresolved();
                assert_eq!(half(a), half(b), "{about} half cycle");
                assert!(slipped || first || !b.lock.slipped(), "{about} slip");
                missed += u32::from(slipped && !b.lock.slipped());
                (slipped, first) = (false, false);
            }
        }
    }
    // 896 phases have a stated deviation of six or more units of 0.004 cycles.
    assert_eq!((phases, missed), ([10_360, 9_464], 2));
}

/// The same recording where there is no `convbin`.
#[test]
fn u_blox_log() {
    let Some(log) = f9t_log(&folder("f9t")) else { return };
    let all = signals(&log);
    let observations = || all.values().flat_map(BTreeMap::values);
    let count = |what: fn(&Observation) -> bool| observations().filter(|o| what(o)).count();
    assert_eq!(observations().count(), 13_412);
    assert_eq!(count(|o| o.phase_cycles.is_some()), 12_669);
    assert_eq!(count(|o| o.lock.half_cycle_unresolved()), 63);
    assert_eq!(count(|o| o.lock.slipped()), 40);
    let first = GpsTime::from_week_tow(2379, 163_891.001).unwrap();
    let g01 = all[&("G01".parse().unwrap(), "G1C".parse().unwrap())][&first];
    assert!((g01.phase_cycles.unwrap() - 112_252_116.071).abs() < 5e-4);
    assert!((g01.pseudorange_m.unwrap() - 21_360_867.696).abs() < 5e-4);
    assert!((g01.doppler_hz.unwrap() - 804.339).abs() < 5e-4);
    assert_eq!(g01.cn0_dbhz, Some(47.0));
}

/// Every signal that u-blox has a number for, with and without a phase, slipped, half-cycle.
fn written_epochs() -> Vec<AntennaEpoch> {
    let names = [
        "G05 G1C", "G05 G2L", "G06 G5Q", "E11 E1C", "E11 E7Q", "C03 C2I", "C30 C2I", "C30 C5P",
        "R07 R1C", "R07 R2C", "J02 J1C", "S33 S1C",
    ];
    let epoch = |second: u32| AntennaEpoch {
        time: GpsTime::from_week_tow(2300, 604_795.0 + 0.5 * f64::from(second)).unwrap(),
        observations: names
            .iter()
            .zip(0u32..)
            .map(|(name, index)| {
                let (satellite, signal) = name.split_once(' ').unwrap();
                let satellite: Satellite = satellite.parse().unwrap();
                let range_m = 21e6 + 1e5 * f64::from(satellite.number) + 3.25 * f64::from(index);
                let signal: Signal = signal.parse().unwrap();
                let wavelength_m = signal.band.wavelength_m(Some(-4)).unwrap();
                let rate_mps = 12.5 * f64::from(satellite.number) - 300.0;
                let slip = u8::from(index == second);
                let half = if second < 2 && index == 4 { Lock::HALF_CYCLE } else { 0 };
                Observation {
                    satellite,
                    signal,
                    pseudorange_m: Some(range_m + 0.125 * f64::from(second)),
                    phase_cycles: Some(1.1e8 - 12_345.75 * f64::from(index)),
                    // A number that UBX can have, in 32 bits.
                    doppler_hz: Some((-1024.0 * rate_mps / wavelength_m).round() / 1024.0),
                    cn0_dbhz: Some(f64::from(30 + index)),
                    lock: Lock(slip | half),
                }
            })
            .collect(),
        ..AntennaEpoch::default()
    };
    (0..9).map(epoch).collect()
}

fn read_all(bytes: Vec<u8>) -> (Vec<AntennaEpoch>, usize) {
    let mut source = ObservationSource::new(std::io::Cursor::new(bytes), "log").unwrap();
    let mut epochs = Vec::new();
    let mut epoch = AntennaEpoch::default();
    while source.next_epoch(&mut epoch).unwrap() {
        epochs.push(epoch.clone());
    }
    (epochs, source.damage().len())
}

/// Channel −4 of the GLONASS satellite of [`written_epochs`].
fn navigation() -> NavigationData {
    let reference_time = GpsTime::from_week_tow(2301, 18.0).unwrap();
    let elements = GlonassElements {
        satellite: "R07".parse().unwrap(),
        reference_time,
        transmission_time: reference_time,
        clock_bias_s: 0.0,
        clock_drift: 0.0,
        position_m: Vector::new(2.5e7, 0.0, 0.0),
        velocity_mps: Vector::new(0.0, 3e3, 0.0),
        acceleration_mps2: Vector::new(0.0, 0.0, 0.0),
        channel: -4,
        l2_delay_s: None,
        health: 0,
        accuracy_m: 5.0,
    };
    let mut data = NavigationData::default();
    data.ephemerides.insert(Ephemeris::Glonass(GlonassEphemeris::new(elements).unwrap()));
    data
}

#[test]
fn a_written_ubx_log_reads_the_same() {
    let epochs = written_epochs();
    let mut writer = UbxWriter::new(Vec::new(), &navigation());
    epochs.iter().for_each(|epoch| writer.write(epoch).unwrap());
    let bytes = writer.finish();
    assert_eq!(read_all(bytes.clone()), (epochs.clone(), 0));

    // A log that was cut, and one with noise in it, keep every other epoch.
    assert_eq!(read_all(bytes[..bytes.len() - 3].to_vec()), (epochs[..8].to_vec(), 1));
    let length = 16 + 32 * epochs[0].observations.len() + 8;
    let bytes = bytes[bytes.len() - 9 * length..].to_vec();
    let mut noisy = bytes.clone();
    noisy[3 * length + 40] ^= 4;
    noisy.splice(5 * length..5 * length, [0xb5, 0x62, 2, 0x15, 0xff]);
    let (read, damage) = read_all(noisy);
    // The first message of this part is one with a string of GLONASS.
    assert_eq!(damage, 3);
    let times: Vec<_> = read.iter().map(|e| e.time).collect();
    let kept: Vec<_> = epochs
        .iter()
        .map(|e| e.time)
        .filter(|t| ![epochs[0].time, epochs[3].time].contains(t))
        .collect();
    assert_eq!(times, kept);
}

/// What MSM 7 keeps: 0.3 mm of a range, 0.1 mm of a phase, 0.05 mm/s of a rate, 1/32 dB-Hz.
#[test]
fn a_written_rtcm_log_reads_the_same() {
    let mut epochs = written_epochs();
    // B1I on a satellite without a Doppler, and one without a phase.
    epochs[2].observations[5].doppler_hz = None;
    epochs[3].observations[0].phase_cycles = None;
    let mut writer = Rtcm3Writer::new(Vec::new(), 9, Vector::new(4e6, 3e5, 4.9e6), &navigation());
    epochs.iter().for_each(|epoch| writer.write(epoch).unwrap());
    let bytes = writer.finish();
    let (read, damage) = read_all(bytes.clone());
    assert_eq!((read.len(), damage), (9, 0));
    let mut whole_cycles = BTreeMap::new();
    for (epoch, read) in epochs.iter().zip(&read) {
        assert_eq!(epoch.time, read.time);
        let mut wanted = epoch.observations.clone();
        wanted.sort_by_key(|o| (o.satellite, o.signal));
        let mut read = read.observations.clone();
        read.sort_by_key(|o| (o.satellite, o.signal));
        assert_eq!(wanted.len(), read.len());
        for (a, b) in wanted.iter().zip(&read) {
            assert_eq!((a.satellite, a.signal), (b.satellite, b.signal));
            assert_eq!(a.lock.0 * u8::from(a.phase_cycles.is_some()), b.lock.0, "{a:?} {b:?}");
            let near = |a: Option<f64>, b: Option<f64>, within: f64| match (a, b) {
                (Some(a), Some(b)) => assert!((a - b).abs() <= within, "{a} {b}"),
                _ => assert_eq!(a.is_some(), b.is_some()),
            };
            near(a.pseudorange_m, b.pseudorange_m, 3e-4);
            near(a.doppler_hz, b.doppler_hz, 3e-4);
            near(a.cn0_dbhz, b.cn0_dbhz, 1.0 / 32.0);
            if let (Some(a_cycles), Some(b_cycles)) = (a.phase_cycles, b.phase_cycles) {
                let apart = a_cycles - b_cycles;
                assert!((apart - apart.round()).abs() < 5e-4, "{a:?} {b:?}");
                let before = whole_cycles.insert((a.satellite, a.signal), apart.round());
                assert!(before.is_none_or(|before| before == apart.round()));
            } else {
                assert_eq!(a.phase_cycles.is_some(), b.phase_cycles.is_some());
            }
        }
    }

    // Without the first messages nothing tells the week; a time of the day before does.
    let name = |bytes: &[u8], options: &LogOptions| {
        let source = Source::new(std::io::Cursor::new(bytes.to_vec()), "log").unwrap();
        ObservationSource::from_source_with(source, options)
    };
    let dateless: Vec<u8> =
        frames(&bytes).filter(|f| number(f) != 1020).flatten().copied().collect();
    let error = name(&dateless, &LogOptions::default()).unwrap_err().to_string();
    assert!(error.contains("approximate_time"), "{error}");
    let approximate_time = Some(epochs[0].time + -86_400.0);
    let mut source =
        name(&dateless, &LogOptions { approximate_time, ..LogOptions::default() }).unwrap();
    let mut epoch = AntennaEpoch::default();
    assert!(source.next_epoch(&mut epoch).unwrap());
    assert_eq!(epoch.time, epochs[0].time);
}

/// The messages of an undamaged RTCM 3 log.
fn frames(bytes: &[u8]) -> impl Iterator<Item = &[u8]> {
    let mut rest = bytes;
    std::iter::from_fn(move || {
        let length = usize::from(u16::from_be_bytes([*rest.get(1)?, rest[2]])) + 6;
        let (frame, behind) = rest.split_at(length);
        rest = behind;
        Some(frame)
    })
}

fn number(frame: &[u8]) -> u16 {
    u16::from_be_bytes([frame[3], frame[4]]) >> 4
}

#[test]
fn one_of_several_stations_must_be_chosen() {
    let epochs = written_epochs();
    let place = Vector::new(4e6, 3e5, 4.9e6);
    let mut writers =
        [7, 8].map(|station| Rtcm3Writer::new(Vec::new(), station, place, &navigation()));
    for epoch in &epochs {
        writers.iter_mut().for_each(|writer| writer.write(epoch).unwrap());
    }
    let [a, b] = writers.map(Rtcm3Writer::finish);
    // Epoch by epoch, as a caster mixes them.
    let mut mixed: Vec<(usize, &[u8])> = Vec::new();
    for log in [&a, &b] {
        let mut epoch = 0;
        for frame in frames(log) {
            epoch += usize::from(number(frame) == 1077);
            mixed.push((epoch, frame));
        }
    }
    mixed.sort_by_key(|(epoch, _)| *epoch);
    let bytes: Vec<u8> = mixed.into_iter().flat_map(|(_, frame)| frame).copied().collect();
    let open = |station| {
        let source = Source::new(std::io::Cursor::new(bytes.clone()), "log").unwrap();
        let options = LogOptions { station, ..LogOptions::default() };
        ObservationSource::from_source_with(source, &options).unwrap()
    };
    let mut epoch = AntennaEpoch::default();
    let error = open(None).next_epoch(&mut epoch).unwrap_err().to_string();
    assert!(error.contains("stations 7 and 8") && error.contains("station_id"), "{error}");
    let mut source = open(Some(8));
    let mut count = 0;
    while source.next_epoch(&mut epoch).unwrap() {
        count += 1;
        assert_eq!(epoch.observations.len(), epochs[0].observations.len());
    }
    assert_eq!((count, source.damage_count()), (9, 0));
}
