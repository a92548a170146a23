//! Reading speed of receiver logs, whole files, one core: logs of about 100 MB with 97 signals in
//! an epoch, written to the folder for temporary files and removed again.
//!
//! `cargo run --release -p kurs-formats --example log_speed`
//!
//! Each log is read five times, each time by a process of its own; the best and the median time and
//! the peak memory of the process are printed. Reading the bytes alone is the first line.
#![allow(clippy::print_stdout, clippy::unwrap_used)]

use std::fs::File;
use std::io::{self, BufWriter, Read, Write};
use std::path::Path;
use std::process::Command;
use std::time::Instant;

use kurs::ephemeris::{Ephemeris, GlonassElements, GlonassEphemeris, NavigationData};
use kurs::frames::Vector;
use kurs::observation::{AntennaEpoch, Lock, Observation};
use kurs::signal::{Satellite, Signal, System};
use kurs::time::GpsTime;
use kurs_formats::observations::ObservationSource;
use kurs_formats::rtcm::Rtcm3Writer;
use kurs_formats::sbf::SbfWriter;
use kurs_formats::ubx::UbxWriter;

const RUNS: usize = 5;
const MEGABYTES: f64 = 100.0;
/// Between epochs, s.
const INTERVAL_S: f64 = 0.1;
/// Systems with how many satellites, from number 1, and their signals, which all protocols know.
const SKY: [(System, u8, &[&str]); 4] = [
    (System::Gps, 11, &["G1C", "G2L", "G5Q"]),
    (System::Glonass, 8, &["R1C", "R2C"]),
    (System::Galileo, 10, &["E1C", "E7Q"]),
    (System::BeiDou, 14, &["C2I", "C5P"]),
];
/// Epochs between slips of one signal.
const SLIP_EPOCHS: u32 = 1000;

fn main() {
    let arguments: Vec<String> = std::env::args().collect();
    if let [_, what, path] = arguments.as_slice() {
        return run_one(what, Path::new(path));
    }
    println!(
        "{:<12}{:>8}{:>10}{:>12}{:>14}{:>10}{:>14}",
        "log", "MB", "best MB/s", "median MB/s", "best ns/obs", "peak MB", "observations"
    );
    let folder = std::env::temp_dir();
    for (name, write) in [
        ("ubx", write_ubx as fn(BufWriter<File>, u32) -> io::Result<u64>),
        ("rtcm3", write_rtcm),
        ("sbf", write_sbf),
    ] {
        let path = folder.join(format!("kurs-log-speed-{}.{name}", std::process::id()));
        let trial = write(BufWriter::new(File::create(&path).unwrap()), 100).unwrap();
        assert!(trial > 0);
        let trial_mb = std::fs::metadata(&path).unwrap().len() as f64 / 1e6;
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // some ten thousand
        let epochs = (100.0 * MEGABYTES / trial_mb) as u32;
        let written = write(BufWriter::new(File::create(&path).unwrap()), epochs).unwrap();
        if name == "ubx" {
            report("the bytes", "bytes", &path, None);
        }
        report(name, "log", &path, Some(written));
        std::fs::remove_file(&path).unwrap();
    }
}

/// Measures the runs of one kind and prints their line; every observation has to come back.
fn report(title: &str, what: &str, path: &Path, written: Option<u64>) {
    let megabytes = std::fs::metadata(path).unwrap().len() as f64 / 1e6;
    let mut runs: Vec<[f64; 3]> = (0..RUNS).map(|_| measure(what, path)).collect();
    runs.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let [best_s, peak_mb, count] = runs[0];
    if let Some(written) = written {
        assert_eq!(count, written as f64, "observations of {title}");
    }
    println!(
        "{title:<12}{megabytes:>8.1}{:>10.0}{:>12.0}{:>14.1}{peak_mb:>10.1}{count:>14.0}",
        megabytes / best_s,
        megabytes / runs[RUNS / 2][0],
        best_s * 1e9 / count,
    );
}

/// Seconds, peak megabytes and observations of one run in a process of its own.
fn measure(what: &str, path: &Path) -> [f64; 3] {
    let program = std::env::current_exe().unwrap();
    let output = Command::new(program).arg(what).arg(path).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    let mut numbers = text.split_whitespace().map(|number| number.parse().unwrap());
    std::array::from_fn(|_| numbers.next().unwrap_or(f64::NAN))
}

fn run_one(what: &str, path: &Path) {
    let start = Instant::now();
    let count = if what == "bytes" { read_bytes(path) } else { read_log(path) };
    let seconds = start.elapsed().as_secs_f64();
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let peak = status.lines().find_map(|line| line.strip_prefix("VmHWM:")).unwrap_or("nan");
    let peak_kb: f64 = peak.trim().trim_end_matches(" kB").parse().unwrap_or(f64::NAN);
    println!("{seconds} {} {count}", peak_kb * 1024.0 / 1e6);
}

/// Length of a file that is read in pieces of the size that the readers take.
fn read_bytes(path: &Path) -> u64 {
    let mut buffer = vec![0; kurs_formats::source::Source::BUFFER_SIZE];
    let (mut file, mut length) = (File::open(path).unwrap(), 0);
    loop {
        match file.read(&mut buffer).unwrap() {
            0 => return length,
            count => length += count as u64,
        }
    }
}

fn read_log(path: &Path) -> u64 {
    let mut source = ObservationSource::open(path).unwrap();
    let mut epoch = AntennaEpoch::default();
    let mut count = 0;
    while source.next_epoch(&mut epoch).unwrap() {
        count += epoch.observations.len() as u64;
    }
    assert_eq!(source.damage(), []);
    count
}

fn write_ubx(output: BufWriter<File>, epochs: u32) -> io::Result<u64> {
    let mut writer = UbxWriter::new(output, &navigation());
    let count = each_epoch(epochs, |epoch| writer.write(epoch))?;
    writer.finish().flush()?;
    Ok(count)
}

fn write_rtcm(output: BufWriter<File>, epochs: u32) -> io::Result<u64> {
    let place_m = Vector::new(4e6, 3e5, 4.9e6);
    let mut writer = Rtcm3Writer::new(output, 9, place_m, &navigation());
    let count = each_epoch(epochs, |epoch| writer.write(epoch))?;
    writer.finish().flush()?;
    Ok(count)
}

fn write_sbf(output: BufWriter<File>, epochs: u32) -> io::Result<u64> {
    let mut writer = SbfWriter::new(output, &navigation());
    let count = each_epoch(epochs, |epoch| writer.write(&[epoch]))?;
    writer.finish().flush()?;
    Ok(count)
}

/// Gives epochs of moving satellites away, and counts their observations.
fn each_epoch(
    epochs: u32,
    mut write: impl FnMut(&AntennaEpoch) -> io::Result<()>,
) -> io::Result<u64> {
    let mut count = 0;
    let mut epoch = AntennaEpoch::default();
    for number in 0..epochs {
        let elapsed_s = INTERVAL_S * f64::from(number);
        epoch.time = start() + elapsed_s;
        epoch.observations.clear();
        for (satellite, signal) in signals() {
            let index = u32::from(satellite.number);
            let rate_mps = 50.0 * f64::from(index) - 300.0;
            // There and back again within an hour.
            let moved_s = (elapsed_s % 3600.0).min(3600.0 - elapsed_s % 3600.0);
            let range_m = 22e6 + 1e5 * f64::from(index) + rate_mps * moved_s;
            let wavelength_m = signal.band.wavelength_m(Some(channel(satellite))).unwrap();
            let slips = (number + 17 * index).is_multiple_of(SLIP_EPOCHS);
            epoch.observations.push(Observation {
                satellite,
                signal,
                pseudorange_m: Some(range_m),
                phase_cycles: Some(range_m / wavelength_m + 1234.0),
                doppler_hz: Some(-rate_mps / wavelength_m),
                cn0_dbhz: Some(f64::from(35 + index)),
                lock: Lock(if slips { Lock::SLIP } else { 0 }),
            });
        }
        count += epoch.observations.len() as u64;
        write(&epoch)?;
    }
    Ok(count)
}

fn signals() -> impl Iterator<Item = (Satellite, Signal)> {
    SKY.iter().flat_map(|(system, satellites, signals)| {
        (1..=*satellites).flat_map(move |number| {
            let satellite = Satellite::new(*system, number);
            signals.iter().map(move |name| (satellite, name.parse().unwrap()))
        })
    })
}

fn start() -> GpsTime {
    GpsTime::from_week_tow(2300, 3600.0).unwrap()
}

/// Channel of a GLONASS satellite.
fn channel(satellite: Satellite) -> i8 {
    satellite.number.cast_signed() - 4
}

/// The channels of the GLONASS satellites, from which RTCM 3 gets its date too.
fn navigation() -> NavigationData {
    // A quarter of an hour of UTC, as GLONASS messages have it.
    let reference_time = start() + f64::from(start().leap_seconds());
    let mut data = NavigationData::default();
    for (satellite, _) in signals().filter(|(_, signal)| signal.to_string() == "R1C") {
        let elements = GlonassElements {
            satellite,
            reference_time,
            transmission_time: reference_time,
            clock_bias_s: 0.0,
            clock_drift: 0.0,
            position_m: Vector::new(2.5e7, 0.0, 0.0),
            velocity_mps: Vector::new(0.0, 3e3, 0.0),
            acceleration_mps2: Vector::new(0.0, 0.0, 0.0),
            channel: channel(satellite),
            l2_delay_s: None,
            health: 0,
            accuracy_m: 5.0,
        };
        data.ephemerides.insert(Ephemeris::Glonass(GlonassEphemeris::new(elements).unwrap()));
    }
    data
}
