//! Receiver logs against `convbin` of RTKLIB: the same observations, or a reason why not.
#![allow(clippy::unwrap_used, clippy::print_stdout)] // a test

use std::collections::BTreeMap;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::Command;

use kurs::ephemeris::{Ephemeris, GlonassElements, GlonassEphemeris, NavigationData};
use kurs::frames::Vector;
use kurs::observation::{AntennaEpoch, Lock, Observation};
use kurs::signal::{SPEED_OF_LIGHT_MPS, Satellite, Signal};
use kurs::time::GpsTime;
use kurs_formats::logs::{LogOptions, LogReader};
use kurs_formats::observations::ObservationSource;
use kurs_formats::rtcm::Rtcm3Writer;
use kurs_formats::sbf::SbfWriter;
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
            crate::outside::lacking(&format!("convbin: {error}"));
            None
        }
    }
}

/// The recording of a u-blox F9T, unpacked; `None` where there are no recordings.
fn f9t_log(folder: &Path) -> Option<PathBuf> {
    let packed =
        std::fs::File::open(crate::outside::recording("formats/F9T-L2-5min.ubx.gz")?).unwrap();
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

/// Signals that all protocols have a number for.
const COMMON: [&str; 12] = [
    "G05 G1C", "G05 G2L", "G06 G5Q", "E11 E1C", "E11 E7Q", "C03 C2I", "C30 C2I", "C30 C5P",
    "R07 R1C", "R07 R2C", "J02 J1C", "S33 S1C",
];

/// Each signal slipped once and off by half a cycle or not.
fn written_epochs(names: &[&str], interval_s: f64) -> Vec<AntennaEpoch> {
    let epoch = |number: u32| AntennaEpoch {
        time: GpsTime::from_week_tow(2300, 604_795.0).unwrap() + interval_s * f64::from(number),
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
                let slip = u8::from(index == number);
                let half = if number < 2 && index == 4 { Lock::HALF_CYCLE } else { 0 };
                Observation {
                    satellite,
                    signal,
                    pseudorange_m: Some(range_m + 0.125 * f64::from(number)),
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
    let epochs = written_epochs(&COMMON, 0.5);
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

/// Resolution of a protocol.
struct Within {
    range_m: f64,
    doppler_hz: f64,
    cn0_dbhz: f64,
}

/// The epochs that were read are those that were written, but for whole cycles, the same ones of a
/// phase in all epochs.
fn assert_same(epochs: &[AntennaEpoch], read: &[AntennaEpoch], within: &Within) {
    assert_eq!(epochs.len(), read.len());
    let mut whole_cycles = BTreeMap::new();
    for (epoch, read) in epochs.iter().zip(read) {
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
            near(a.pseudorange_m, b.pseudorange_m, within.range_m);
            near(a.doppler_hz, b.doppler_hz, within.doppler_hz);
            near(a.cn0_dbhz, b.cn0_dbhz, within.cn0_dbhz);
            if let (Some(a_cycles), Some(b_cycles)) = (a.phase_cycles, b.phase_cycles) {
                let apart = a_cycles - b_cycles;
                assert!((apart - apart.round()).abs() < 6e-4, "{a:?} {b:?}");
                let before = whole_cycles.insert((a.satellite, a.signal), apart.round());
                assert!(before.is_none_or(|before| before == apart.round()));
            } else {
                assert_eq!(a.phase_cycles.is_some(), b.phase_cycles.is_some());
            }
        }
    }
}

/// Signals of Septentrio that u-blox has none of: P codes, whose strengths have no offset, numbers
/// from 32 on, Galileo E6 and AltBOC, GLONASS P and L3.
const SEPTENTRIO: [&str; 14] = [
    "G05 G1W", "G05 G2W", "G05 G1L", "E11 E6C", "E11 E8Q", "E36 E5Q", "C62 C1P", "C62 C7D",
    "R07 R2P", "R07 R3Q", "J02 J1Z", "J02 J5P", "I03 I5A", "S58 S5I",
];

/// What SBF keeps: half a millimetre of a range, half a thousandth of a cycle, 10⁻⁴ Hz, 1/8 dB-Hz.
const SBF_WITHIN: Within = Within { range_m: 5.1e-4, doppler_hz: 1.1e-4, cn0_dbhz: 0.1251 };

/// Epochs with what may be missing.
fn sbf_epochs() -> Vec<AntennaEpoch> {
    let mut epochs = written_epochs(&[&COMMON[..], &SEPTENTRIO].concat(), 1.0);
    epochs[2].observations[4].doppler_hz = None;
    epochs[3].observations[0].phase_cycles = None;
    epochs[3].observations[12].phase_cycles = None;
    epochs[4].observations[1].cn0_dbhz = None;
    epochs
}

#[test]
fn a_written_sbf_log_reads_the_same() {
    let mut epochs = sbf_epochs();
    // Then the second signal cannot be told by its difference to the first.
    epochs[2].observations[3].doppler_hz = None;
    epochs[4].observations[3].pseudorange_m = None;
    epochs[4].observations[3].phase_cycles = None;
    let mut writer = SbfWriter::new(Vec::new(), &navigation());
    epochs.iter().for_each(|epoch| writer.write(&[epoch]).unwrap());
    let bytes = writer.finish();
    let (read, damage) = read_all(bytes.clone());
    assert_eq!(damage, 0);
    assert_same(&epochs, &read, &SBF_WITHIN);

    // Text and other protocols in between are no damage; noise is, and so is a cut block.
    let blocks = sbf_blocks(&bytes);
    let first = blocks.iter().position(|block| sbf_number(block) == 4027).unwrap();
    let mut noisy = Vec::new();
    for (index, block) in blocks.iter().enumerate() {
        match index.checked_sub(first) {
            Some(1) => noisy.extend(b"$GPGGA,,*56\r\n$R: setSBFOutput\r\n"),
            Some(3) => noisy.extend(b"$@\0\0\xbb\x0f\x10\x00"),
            _ => {}
        }
        noisy.extend(*block);
    }
    let end = noisy.len() - 5;
    let (read, damage) = read_all(noisy[..end].to_vec());
    assert_eq!((read.len(), damage), (8, 2));
    assert_same(&epochs[..8], &read, &SBF_WITHIN);
}

/// The blocks of an undamaged SBF log.
fn sbf_blocks(bytes: &[u8]) -> Vec<&[u8]> {
    let mut rest = bytes;
    std::iter::from_fn(move || {
        let length = usize::from(u16::from_le_bytes([*rest.get(6)?, rest[7]]));
        let (block, behind) = rest.split_at(length);
        rest = behind;
        Some(block)
    })
    .collect()
}

fn sbf_number(block: &[u8]) -> u16 {
    u16::from_le_bytes([block[4], block[5]]) & 0x1fff
}

/// All three antennas of one log; which one is meant must be said.
#[test]
fn one_of_several_antennas_must_be_chosen() {
    let main = sbf_epochs();
    let shifted = |metres: f64, without: usize| -> Vec<AntennaEpoch> {
        let mut epochs = main.clone();
        for o in epochs.iter_mut().flat_map(|epoch| &mut epoch.observations) {
            o.pseudorange_m = o.pseudorange_m.map(|range_m| range_m + metres);
            o.phase_cycles = o.phase_cycles.map(|cycles| cycles + metres);
        }
        for epoch in &mut epochs {
            epoch.observations.remove(without);
        }
        epochs
    };
    let (aux1, aux2) = (shifted(0.25, 3), shifted(-1.5, 8));
    let mut writer = SbfWriter::new(Vec::new(), &navigation());
    for ((main, aux1), aux2) in main.iter().zip(&aux1).zip(&aux2) {
        writer.write(&[main, aux1, aux2]).unwrap();
    }
    let bytes = writer.finish();
    let open = |antenna: Option<&str>| {
        let source = Source::new(std::io::Cursor::new(bytes.clone()), "log").unwrap();
        let antenna = antenna.map(|name| name.parse().unwrap());
        let options = LogOptions { antenna, ..LogOptions::default() };
        ObservationSource::from_source_with(source, &options).unwrap()
    };
    for (name, wanted) in [("main", &main), ("aux1", &aux1), ("aux2", &aux2)] {
        let (mut source, mut read) = (open(Some(name)), Vec::new());
        let mut epoch = AntennaEpoch::default();
        while source.next_epoch(&mut epoch).unwrap() {
            read.push(epoch.clone());
        }
        assert_eq!(source.damage_count(), 0);
        assert_same(wanted, &read, &SBF_WITHIN);
    }
    let mut epoch = AntennaEpoch::default();
    let error = open(None).next_epoch(&mut epoch).unwrap_err().to_string();
    assert!(error.contains("antennas main and aux1") && error.contains("antenna_id"), "{error}");
    let error = open(Some("aux3")).next_epoch(&mut epoch).unwrap_err().to_string();
    assert!(error.contains("main and aux1 and aux2, none of antenna aux3"), "{error}");
    let names = LogOptions { station: Some(3), ..LogOptions::default() };
    let source = Source::new(std::io::Cursor::new(bytes.clone()), "log").unwrap();
    let error = ObservationSource::from_source_with(source, &names).unwrap_err().to_string();
    assert!(error.contains("station_id"), "{error}");
}

/// Differences of `convbin`, all of them: it knows no QZSS satellites, no E36, C62 and S58, and
/// keeps one signal of some bands only; strengths are 250 times too small; it marks the first phase
/// of every signal as slipped. It takes for values what stands for none (reference guide, 4.2.1):
/// −2²³ units of a phase in a sub-block of type 1; 255 units of a strength, of whose 73.75 dB-Hz
/// eight bits are left, 9.75.
#[test]
fn sbf_log_as_convbin() {
    const NOT_THERE: [&str; 10] = [
        "G05 G1L", "E11 E6C", "E36 E5Q", "C30 C5P", "C62 C1P", "C62 C7D", "J02 J1C", "J02 J1Z",
        "J02 J5P", "S58 S5I",
    ];
    let folder = folder("sbf-convbin");
    let log = folder.join("log.sbf");
    let epochs = sbf_epochs();
    let mut writer = SbfWriter::new(Vec::new(), &navigation());
    epochs.iter().for_each(|epoch| writer.write(&[epoch]).unwrap());
    std::fs::write(&log, writer.finish()).unwrap();
    let Some(theirs) = convbin(&log, "sbf", &folder) else { return };
    let ours = signals(&log);
    for (satellite, signal) in ours.keys().filter(|key| !theirs.contains_key(key)) {
        let name = format!("{satellite} {signal}");
        assert!(NOT_THERE.contains(&name.as_str()), "{name}");
    }
    let (mut compared, mut none) = ([0; 2], [0; 2]);
    for (key, theirs) in &theirs {
        let ours = &ours[key];
        assert_eq!(ours.len(), theirs.len(), "{key:?}");
        let mut first = true;
        for ((time, a), b) in ours.iter().zip(theirs.values()) {
            let about = format!("{time} {} {}", a.satellite, a.signal);
            let near = |a: Option<f64>, b: Option<f64>, within: f64, quantity: &str| match (a, b) {
                (Some(a), Some(b)) => {
                    assert!((a - b).abs() <= within, "{about} {quantity} {a} {b}")
                }
                _ => assert_eq!(a, b, "{about} {quantity}"),
            };
            near(a.pseudorange_m, b.pseudorange_m, 5.1e-4, "pseudorange");
            if let (None, Some(cycles)) = (a.phase_cycles, b.phase_cycles) {
                let frequency_hz = a.signal.band.frequency_hz(Some(-4)).unwrap();
                let range_cycles = a.pseudorange_m.unwrap() * frequency_hz / SPEED_OF_LIGHT_MPS;
                near(Some(range_cycles - 8388.608), Some(cycles), 5.1e-4, "no phase");
                none[0] += 1;
            } else {
                near(a.phase_cycles, b.phase_cycles, 5.1e-4, "phase");
            }
            // They keep 32 bits of it.
            near(a.doppler_hz, b.doppler_hz, 6e-4, "Doppler");
            let strength_dbhz = b.cn0_dbhz.map(|cn0| 250.0 * cn0);
            if a.cn0_dbhz.is_none() {
                near(Some(9.75), strength_dbhz, 1e-9, "no C/N0");
                none[1] += 1;
            } else {
                near(a.cn0_dbhz, strength_dbhz, 0.126, "C/N0");
            }
            compared[0] += 1;
            if a.phase_cycles.is_some() {
                compared[1] += 1;
                let slipped = first || a.lock.slipped();
                assert_eq!(slipped, b.lock.slipped(), "{about} slip");
                let half = |o: &Observation| o.lock.half_cycle_unresolved();
                assert_eq!(half(a), half(b), "{about} half cycle");
                first = false;
            }
        }
    }
    assert_eq!((compared, none), ([144, 142], [1, 1]));
}

/// What MSM 7 keeps: 0.3 mm of a range, 0.1 mm of a phase, 0.05 mm/s of a rate, 1/32 dB-Hz.
#[test]
fn a_written_rtcm_log_reads_the_same() {
    let mut epochs = written_epochs(&COMMON, 0.5);
    // B1I on a satellite without a Doppler, and one without a phase.
    epochs[2].observations[5].doppler_hz = None;
    epochs[3].observations[0].phase_cycles = None;
    let mut writer = Rtcm3Writer::new(Vec::new(), 9, Vector::new(4e6, 3e5, 4.9e6), &navigation());
    epochs.iter().for_each(|epoch| writer.write(epoch).unwrap());
    let bytes = writer.finish();
    let (read, damage) = read_all(bytes.clone());
    assert_eq!((read.len(), damage), (9, 0));
    let within = Within { range_m: 3e-4, doppler_hz: 3e-4, cn0_dbhz: 1.0 / 32.0 };
    assert_same(&epochs, &read, &within);

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
    let epochs = written_epochs(&COMMON, 0.5);
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

/// Epochs and the number of ephemerides that came before each, of a log read as received.
fn as_received(reader: &mut LogReader) -> Vec<(AntennaEpoch, usize)> {
    let mut epochs = Vec::new();
    let mut epoch = AntennaEpoch::default();
    while reader.next_epoch(&mut epoch).unwrap() {
        epochs.push((epoch.clone(), reader.take_news().ephemerides.len()));
    }
    epochs
}

/// A log without navigation data, whose receiver gets them before its fifth epoch: as a file and as
/// a stream that brings one byte after the other.
#[test]
fn as_received_an_ephemeris_comes_with_the_epoch_that_follows_it() {
    let epochs = written_epochs(&COMMON, 0.5);
    let place = Vector::new(4e6, 3e5, 4.9e6);
    let (none, all) = (NavigationData::default(), navigation());
    let ubx = |epochs: &[AntennaEpoch], data: &NavigationData| {
        let mut writer = UbxWriter::new(Vec::new(), data);
        epochs.iter().for_each(|epoch| writer.write(epoch).unwrap());
        writer.finish()
    };
    let rtcm = |epochs: &[AntennaEpoch], data: &NavigationData| {
        let mut writer = Rtcm3Writer::new(Vec::new(), 9, place, data);
        epochs.iter().for_each(|epoch| writer.write(epoch).unwrap());
        writer.finish()
    };
    let sbf = |epochs: &[AntennaEpoch], data: &NavigationData| {
        let mut writer = SbfWriter::new(Vec::new(), data);
        epochs.iter().for_each(|epoch| writer.write(&[epoch]).unwrap());
        writer.finish()
    };
    type Write<'a> = &'a dyn Fn(&[AntennaEpoch], &NavigationData) -> Vec<u8>;
    // The writer of UBX puts them behind the epoch, the others before it.
    let writers: [(&str, Write<'_>, usize); 3] =
        [("UBX", &ubx, 5), ("RTCM 3", &rtcm, 4), ("SBF", &sbf, 4)];
    for (format, write, follows) in writers {
        let bytes = [write(&epochs[..4], &none), write(&epochs[4..], &all)].concat();
        let options = LogOptions {
            approximate_time: Some(epochs[0].time + 3600.0),
            as_received: true,
            ..LogOptions::default()
        };
        let file = Source::new(std::io::Cursor::new(bytes.clone()), "log").unwrap();
        let Ok(ObservationSource::Log(mut file)) =
            ObservationSource::from_source_with(file, &options)
        else {
            panic!("a log");
        };
        let of_file = as_received(&mut file);
        let counts: Vec<usize> = of_file.iter().map(|(_, count)| *count).collect();
        let wanted: Vec<usize> = (0..9).map(|number| usize::from(number == follows)).collect();
        assert_eq!(counts, wanted, "{format}");

        let text = b"$GNGGA,,,*56\r\n";
        let stream = OneByOne(text.iter().chain(&bytes).copied().collect::<Vec<u8>>().into());
        let stream = Source::new(stream, "stream").unwrap();
        let mut stream = LogReader::of_stream(stream, &options).unwrap();
        assert_eq!(as_received(&mut stream), of_file);
    }
}

/// A stream in the smallest pieces.
struct OneByOne(std::collections::VecDeque<u8>);

impl Read for OneByOne {
    fn read(&mut self, out: &mut [u8]) -> std::io::Result<usize> {
        let (Some(first), Some(byte)) = (out.first_mut(), self.0.pop_front()) else { return Ok(0) };
        *first = byte;
        Ok(1)
    }
}

#[test]
fn a_stream_without_observations_says_what_it_should_have() {
    let source = Source::new(std::io::Cursor::new(b"$GNGGA,,,*56\r\n".to_vec()), "port").unwrap();
    let error = LogReader::of_stream(source, &LogOptions::default()).unwrap_err().to_string();
    assert!(error.starts_with("port: found no observations") && error.contains("MSM"), "{error}");
}

/// The last message of an epoch ends it, without the first one of the next.
#[test]
fn a_stream_of_rtcm_gives_an_epoch_as_soon_as_it_is_there() {
    let epochs = written_epochs(&COMMON, 0.5);
    let mut writer = Rtcm3Writer::new(Vec::new(), 9, Vector::new(4e6, 3e5, 4.9e6), &navigation());
    let mut ends = Vec::new();
    for epoch in &epochs {
        writer.write(epoch).unwrap();
    }
    let bytes = writer.finish();
    let mut at = 0;
    for frame in frames(&bytes) {
        at += frame.len();
        // MSM: the bit behind 12 + 12 + 30 others says that no other message of the epoch follows.
        if (1071..1140).contains(&number(frame)) && frame[3 + 6] & 0b10 == 0 {
            ends.push(at);
        }
    }
    assert_eq!(ends.len(), epochs.len());
    // The sender is trusted after the first epoch.
    let options = LogOptions {
        approximate_time: Some(epochs[0].time),
        as_received: true,
        ..LogOptions::default()
    };
    for (end, count) in [(0, 1), (1, 2), (2, 3), (7, 8)] {
        let cut = bytes[..ends[end]].to_vec();
        // A reader that comes to the end gives what it has: so another message is begun.
        let stalled = Stalled(std::io::Cursor::new(cut));
        let mut reader =
            LogReader::of_stream(Source::new(stalled, "stream").unwrap(), &options).unwrap();
        let mut epoch = AntennaEpoch::default();
        let given = core::iter::from_fn(|| reader.next_epoch(&mut epoch).ok()).count();
        assert_eq!(given, if end == 0 { 0 } else { count }, "after {}", end + 1);
    }
}

/// A stream that breaks off where a live one would only wait.
struct Stalled(std::io::Cursor<Vec<u8>>);

impl Read for Stalled {
    fn read(&mut self, out: &mut [u8]) -> std::io::Result<usize> {
        match self.0.read(out)? {
            0 => Err(std::io::ErrorKind::WouldBlock.into()),
            count => Ok(count),
        }
    }
}

/// Ephemerides of four satellites, which tell the date.
fn four_of_glonass() -> NavigationData {
    let mut data = NavigationData::default();
    for ephemeris in navigation().ephemerides.iter() {
        let Ephemeris::Glonass(glonass) = ephemeris else { continue };
        for number in 1..5 {
            let satellite = Satellite { number, ..glonass.elements().satellite };
            let elements = GlonassElements { satellite, ..*glonass.elements() };
            data.ephemerides.insert(Ephemeris::Glonass(GlonassEphemeris::new(elements).unwrap()));
        }
    }
    data
}

/// A stream begun with a date that is years off ends, and says which week it is of.
#[test]
fn ephemerides_tell_that_the_week_is_wrong() {
    let epochs = written_epochs(&COMMON, 0.5);
    let data = four_of_glonass();
    let place = Vector::new(4e6, 3e5, 4.9e6);
    let mut without = Rtcm3Writer::new(Vec::new(), 9, place, &NavigationData::default());
    epochs[..4].iter().for_each(|epoch| without.write(epoch).unwrap());
    let mut with = Rtcm3Writer::new(Vec::new(), 9, place, &data);
    epochs[4..].iter().for_each(|epoch| with.write(epoch).unwrap());
    let bytes = [without.finish(), with.finish()].concat();
    let year_s = 52.0 * 604_800.0;
    for (off_s, given) in [(year_s, 4), (0.0, 9)] {
        let options =
            LogOptions { approximate_time: Some(epochs[0].time + off_s), ..LogOptions::default() };
        let source = Source::new(std::io::Cursor::new(bytes.clone()), "stream").unwrap();
        let mut reader = LogReader::of_stream(source, &options).unwrap();
        let mut epoch = AntennaEpoch::default();
        let mut count = 0;
        let outcome = loop {
            match reader.next_epoch(&mut epoch) {
                Ok(true) => count += 1,
                Ok(false) => break String::new(),
                Err(error) => break error.to_string(),
            }
        };
        assert_eq!(count, given, "{outcome}");
        let told = reader.told_date().map(|date| (date - epochs[0].time).abs() < 86_400.0);
        assert_eq!(told, (off_s > 0.0).then_some(true));
        assert_eq!(outcome.contains("ephemerides of 2024-"), off_s > 0.0, "{outcome}");
    }
}

/// Ephemerides before the first observation set a date right that is a week old: nothing has to be
/// begun anew.
#[test]
fn ephemerides_before_the_first_observation_set_the_week_right() {
    let epochs = written_epochs(&COMMON, 0.5);
    let place = Vector::new(4e6, 3e5, 4.9e6);
    let mut writer = Rtcm3Writer::new(Vec::new(), 9, place, &four_of_glonass());
    epochs.iter().for_each(|epoch| writer.write(epoch).unwrap());
    let sent = writer.finish();
    let week_old =
        LogOptions { approximate_time: Some(epochs[0].time + -604_800.0), ..LogOptions::default() };
    let source = Source::new(std::io::Cursor::new(sent), "stream").unwrap();
    let mut reader = LogReader::of_stream(source, &week_old).unwrap();
    let mut epoch = AntennaEpoch::default();
    assert!(reader.next_epoch(&mut epoch).unwrap());
    assert!((epoch.time - epochs[0].time).abs() < 1e-6, "{}", epoch.time);
}

/// A receiver sets its clock back by a minute: of a stream its epochs come out again from the third
/// one on, of a file none does. A single epoch of an earlier time is skipped by both.
#[test]
fn a_stream_follows_a_clock_that_is_set_back() {
    let epochs = written_epochs(&COMMON, 0.5);
    let early = |number: usize| AntennaEpoch {
        time: epochs[number].time + -60.0,
        ..epochs[number].clone()
    };
    let mut all: Vec<AntennaEpoch> = epochs[..4].to_vec();
    all.push(early(0));
    all.extend_from_slice(&epochs[4..6]);
    all.extend((0..6).map(early));
    let mut writer = UbxWriter::new(Vec::new(), &NavigationData::default());
    all.iter().for_each(|epoch| writer.write(epoch).unwrap());
    let bytes = writer.finish();
    let source = || Source::new(std::io::Cursor::new(bytes.clone()), "stream").unwrap();
    let times = |reader: &mut LogReader| {
        let mut epoch = AntennaEpoch::default();
        let mut times = Vec::new();
        while reader.next_epoch(&mut epoch).unwrap() {
            times.push(((epoch.time - epochs[0].time) * 2.0).round() / 2.0);
        }
        times
    };
    let before: Vec<f64> = (0..6).map(|number| 0.5 * f64::from(number)).collect();
    let behind: Vec<f64> = (2..6).map(|number| 0.5 * f64::from(number) - 60.0).collect();
    let mut stream = LogReader::of_stream(source(), &LogOptions::default()).unwrap();
    assert_eq!(times(&mut stream), [before.clone(), behind].concat());
    let options = LogOptions { as_received: true, ..LogOptions::default() };
    let Ok(ObservationSource::Log(mut file)) =
        ObservationSource::from_source_with(source(), &options)
    else {
        panic!("a log");
    };
    assert_eq!(times(&mut file), before);
}

/// CRC-24Q by its polynomial, behind a message whose bits were changed.
fn resealed(mut frame: Vec<u8>) -> Vec<u8> {
    frame.truncate(frame.len() - 3);
    let mut remainder = 0u32;
    for byte in &frame {
        remainder ^= u32::from(*byte) << 16;
        for _ in 0..8 {
            remainder <<= 1;
            remainder ^= if remainder & 0x100_0000 == 0 { 0 } else { 0x186_4cfb };
        }
    }
    frame.extend(&remainder.to_be_bytes()[1..]);
    frame
}

/// The message with other bits in its epoch time, which stands behind 24 bits of the message.
fn at_time(frame: &[u8], change: impl Fn(u64) -> u64) -> Vec<u8> {
    let mut frame = frame.to_vec();
    let word = u64::from_be_bytes(frame[3..11].try_into().unwrap());
    let (rest, time) = (word & !(0x3fff_ffff << 10), word >> 10 & 0x3fff_ffff);
    frame[3..11].copy_from_slice(&(rest | (change(time) & 0x3fff_ffff) << 10).to_be_bytes());
    resealed(frame)
}

/// The log of [`written_epochs`], its messages, its epochs.
fn rtcm_log() -> (Vec<Vec<u8>>, Vec<AntennaEpoch>) {
    let epochs = written_epochs(&COMMON, 1.0);
    let mut writer = Rtcm3Writer::new(Vec::new(), 9, Vector::new(4e6, 3e5, 4.9e6), &navigation());
    epochs.iter().for_each(|epoch| writer.write(epoch).unwrap());
    let bytes = writer.finish();
    (frames(&bytes).map(<[u8]>::to_vec).collect(), read_all(bytes).0)
}

fn damage_of(bytes: Vec<u8>) -> Vec<String> {
    let mut source = ObservationSource::new(std::io::Cursor::new(bytes), "log").unwrap();
    while source.next_epoch(&mut AntennaEpoch::default()).unwrap() {}
    source.damage().iter().map(|damage| damage.what.to_string()).collect()
}

/// GLONASS with a day of the week ahead or behind, SBAS with the time of the day, first or last in
/// their epochs: the other systems know the day.
#[test]
fn days_that_contradict_the_other_systems_are_not_believed() {
    const GLONASS: u16 = 1087;
    const SBAS: u16 = 1107;
    let (messages, wanted) = rtcm_log();
    for day in [0, 2, 5, 6] {
        for glonass_first in [false, true] {
            let mut changed: Vec<Vec<u8>> = Vec::new();
            for message in &messages {
                let wrong = match number(message) {
                    GLONASS => at_time(message, |time| time & 0x7ff_ffff | day << 27),
                    SBAS => at_time(message, |time| time % 86_400_000),
                    _ => message.clone(),
                };
                let place = match number(message) {
                    GLONASS if glonass_first => {
                        changed.iter().rposition(|m| number(m) == 1077).unwrap()
                    }
                    _ => changed.len(),
                };
                changed.insert(place, wrong);
            }
            let bytes = changed.concat();
            let (read, _) = read_all(bytes.clone());
            assert_eq!(read.len(), wanted.len(), "day {day}");
            for (found, wanted) in read.iter().zip(&wanted) {
                assert_eq!(found.time, wanted.time);
                let of = |epoch: &AntennaEpoch| {
                    let mut all = epoch.observations.clone();
                    all.sort_by_key(|o| (o.satellite, o.signal));
                    all
                };
                assert_eq!(of(found), of(wanted));
            }
            let damage = damage_of(bytes);
            assert!(damage.iter().all(|what| what.contains("another day")), "{damage:?}");
            assert!((1..=2).contains(&damage.len()), "{damage:?}");
        }
    }
}

/// A message from an hour ago or ahead, in the midst of an epoch, between two, at both ends.
#[test]
fn one_stray_message_costs_nothing() {
    let (messages, wanted) = rtcm_log();
    let gps: Vec<usize> = (0..messages.len()).filter(|i| number(&messages[*i]) == 1077).collect();
    let ahead_or_back = [3_600_000, 604_800_000 - 3_600_000];
    for ahead_ms in ahead_or_back {
        let stray = at_time(&messages[gps[3]], |time| (time + ahead_ms) % 604_800_000);
        for place in [gps[0], gps[0] + 1, gps[4], gps[4] + 2, gps[8] + 1, messages.len()] {
            let mut mixed = messages.clone();
            mixed.insert(place, stray.clone());
            let (read, damage) = read_all(mixed.concat());
            let at = |epochs: &[AntennaEpoch]| -> Vec<(GpsTime, usize)> {
                epochs.iter().map(|epoch| (epoch.time, epoch.observations.len())).collect()
            };
            let (found, wanted) = (at(&read), at(&wanted));
            let kept: Vec<_> = found.iter().filter(|epoch| wanted.contains(epoch)).collect();
            assert_eq!(kept.len(), wanted.len(), "{ahead_ms} at {place}: {found:?}");
            // Only at the ends of the log can it be an epoch of its own.
            assert!(damage == 1 || found.len() == wanted.len() + 1, "{ahead_ms} at {place}");
        }
    }
}

/// An ephemeris that a receiver has kept for four years comes first.
#[test]
fn the_week_is_that_of_most_ephemerides() {
    let ephemeris = |number: u8, weeks_ago: f64| {
        let reference_time = GpsTime::from_week_tow(2301, 18.0).unwrap() + -604_800.0 * weeks_ago;
        let mut data = NavigationData::default();
        let known = navigation();
        let Some(Ephemeris::Glonass(r07)) = known.ephemerides.iter().next() else { panic!() };
        let satellite = Satellite { number, ..r07.elements().satellite };
        let elements = GlonassElements {
            satellite,
            reference_time,
            transmission_time: reference_time,
            ..*r07.elements()
        };
        data.ephemerides.insert(Ephemeris::Glonass(GlonassEphemeris::new(elements).unwrap()));
        let mut writer = Rtcm3Writer::new(Vec::new(), 9, Vector::new(4e6, 3e5, 4.9e6), &data);
        writer.write(&AntennaEpoch { time: reference_time, ..AntennaEpoch::default() }).unwrap();
        let bytes = writer.finish();
        frames(&bytes).find(|frame| self::number(frame) == 1020).unwrap().to_vec()
    };
    let (messages, wanted) = rtcm_log();
    let without = messages.into_iter().filter(|message| number(message) != 1020);
    let bytes: Vec<u8> = [ephemeris(8, 208.0), ephemeris(9, 0.0)]
        .into_iter()
        .chain(without)
        .chain([ephemeris(7, 0.0)])
        .flatten()
        .collect();
    let (read, _) = read_all(bytes.clone());
    let times = |epochs: &[AntennaEpoch]| epochs.iter().map(|e| e.time).collect::<Vec<_>>();
    assert_eq!(times(&read), times(&wanted));
    let mut data = NavigationData::default();
    let mut source = Source::new(std::io::Cursor::new(bytes), "log").unwrap();
    let summary = kurs_formats::navigation::read(&mut source, &mut data).unwrap();
    assert_eq!(data.ephemerides.len(), 3);
    let damage = summary.damage.listed();
    assert!(
        damage.len() == 1 && damage[0].what.starts_with("R08: ephemeris of 2020"),
        "{damage:?}"
    );
}

/// A log whose first whole message is of another protocol than its observations, and one with
/// observations of two.
#[test]
fn the_protocol_with_the_observations_counts() {
    const ACK: [u8; 10] = [0xb5, 0x62, 0x05, 0x01, 0x02, 0x00, 0x06, 0x01, 0x0f, 0x38];
    let epochs = written_epochs(&COMMON, 1.0);
    let (rtcm, wanted) = rtcm_log();
    let place = rtcm.iter().find(|message| number(message) == 1006).unwrap().clone();
    let mut writer = UbxWriter::new(Vec::new(), &navigation());
    epochs.iter().for_each(|epoch| writer.write(epoch).unwrap());
    let ubx = writer.finish();

    let behind_place = [b"$GNGGA,,,*56\r\n".to_vec(), place, ubx.clone()].concat();
    let mut source =
        ObservationSource::new(std::io::Cursor::new(behind_place.clone()), "log").unwrap();
    let mut epoch = AntennaEpoch::default();
    assert!(source.next_epoch(&mut epoch).unwrap());
    assert_eq!(epoch.time, epochs[0].time);
    assert_eq!(source.stated_position_m(), Some(Vector::new(4e6, 3e5, 4.9e6)));
    assert_eq!(read_all(behind_place), (read_all(ubx.clone()).0, 0));

    let behind_ack = [ACK.to_vec(), rtcm.concat()].concat();
    assert_eq!(read_all(behind_ack), (wanted.clone(), 0));

    let both = [rtcm.concat(), ubx.clone()].concat();
    let open = |protocol: Option<&str>| {
        let source = Source::new(std::io::Cursor::new(both.clone()), "log").unwrap();
        let protocol = protocol.map(|name| name.parse().unwrap());
        let options = LogOptions { protocol, ..LogOptions::default() };
        ObservationSource::from_source_with(source, &options).unwrap()
    };
    let mut source = open(None);
    let error = loop {
        match source.next_epoch(&mut epoch) {
            Ok(more) => assert!(more, "no error"),
            Err(error) => break error.to_string(),
        }
    };
    assert!(error.contains("u-blox") && error.contains("`protocol`"), "{error}");
    // A station chooses its protocol, wherever the other one's messages are.
    let source = Source::new(std::io::Cursor::new([ubx, rtcm.concat()].concat()), "log").unwrap();
    let options = LogOptions { station: Some(9), ..LogOptions::default() };
    let mut source = ObservationSource::from_source_with(source, &options).unwrap();
    assert!(source.next_epoch(&mut epoch).unwrap());
    assert_eq!(epoch, wanted[0]);
    for name in ["ubx", "rtcm3"] {
        let mut source = open(Some(name));
        let mut count = 0;
        while source.next_epoch(&mut epoch).unwrap() {
            count += 1;
        }
        assert_eq!((count, source.damage_count()), (9, 0), "{name}");
    }
}

/// Observations that are not read are counted: MSM 3, and the raw data of older receivers.
#[test]
fn what_is_not_read_is_named_and_counted() {
    let (messages, _) = rtcm_log();
    let as_msm_3 = |message: &Vec<u8>| match number(message) {
        1077 => {
            let mut frame = message.clone();
            let number = 1073u16 << 4 | u16::from(frame[4] & 0xf);
            frame[3..5].copy_from_slice(&number.to_be_bytes());
            resealed(frame)
        }
        _ => message.clone(),
    };
    let damage = damage_of(messages.iter().flat_map(as_msm_3).collect());
    assert!(
        damage.len() == 1 && damage[0].starts_with("9 messages 1073 are not read:"),
        "{damage:?}"
    );

    let raw = [0x02, 0x10, 0x00, 0x00, 0x12, 0x38];
    let log = [&[0xb5, 0x62][..], &raw].concat();
    let damage = damage_of([log.clone(), log].concat());
    assert!(damage[0].starts_with("2 messages RXM-RAW are not read:"), "{damage:?}");
}
