//! Receiver logs against `convbin` of RTKLIB: the same observations, or a reason why not.
#![allow(clippy::unwrap_used, clippy::print_stdout)] // a test

use std::collections::BTreeMap;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::Command;

use kurs::observation::{AntennaEpoch, Lock, Observation};
use kurs::signal::{Satellite, Signal};
use kurs::time::GpsTime;
use kurs_formats::observations::ObservationSource;
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
                let slip = u8::from(index == second);
                let half = if second < 2 && index == 4 { Lock::HALF_CYCLE } else { 0 };
                Observation {
                    satellite: satellite.parse().unwrap(),
                    signal: signal.parse().unwrap(),
                    pseudorange_m: Some(21e6 + 1e5 * f64::from(index) + 0.125 * f64::from(second)),
                    phase_cycles: Some(1.1e8 - 12_345.75 * f64::from(index)),
                    doppler_hz: Some(-1234.5 + 100.0 * f64::from(index)),
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

#[test]
fn a_written_ubx_log_reads_the_same() {
    let epochs = written_epochs();
    let mut writer = UbxWriter::new(Vec::new(), BTreeMap::from([(7, -4)]));
    epochs.iter().for_each(|epoch| writer.write(epoch).unwrap());
    let bytes = writer.finish();
    assert_eq!(read_all(bytes.clone()), (epochs.clone(), 0));

    // A log that was cut, and one with noise in it, keep every other epoch.
    assert_eq!(read_all(bytes[..bytes.len() - 3].to_vec()), (epochs[..8].to_vec(), 1));
    let length = bytes.len() / 9;
    let mut noisy = bytes.clone();
    noisy[3 * length + 40] ^= 4;
    noisy.splice(5 * length..5 * length, [0xb5, 0x62, 2, 0x15, 0xff]);
    let (read, damage) = read_all(noisy);
    assert_eq!(damage, 2);
    let times: Vec<_> = read.iter().map(|e| e.time).collect();
    let kept: Vec<_> = epochs.iter().map(|e| e.time).filter(|t| *t != epochs[3].time).collect();
    assert_eq!(times, kept);
}
