//! Reading speed, whole files, one core, with the peers in the same run:
//!
//! ```text
//! cd tests-referees && cargo bench --bench reading
//! ```
//!
//! The files are made by repeating the epochs of a real one at later hours. Each reader runs in a
//! process of its own, three times; the best time and the peak memory are printed.

use std::fs;
use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

use kurs::observation::AntennaEpoch;
use kurs::time::{Calendar, GpsTime};
use kurs_formats::rinex::observation::ObservationReader;

/// 15 minutes of 1 Hz data, four systems.
const RECORDING: &str = "formats/GRAS00FRA_R_20223151700_15M_01S_MO.crx.gz";
const COPIES: u32 = 14;

fn main() {
    let arguments: Vec<String> = std::env::args().collect();
    if let [_, flag, reader, path] = arguments.as_slice()
        && flag == "--one"
    {
        return run_one(reader, Path::new(path));
    }
    let data = std::env::var_os("KURS_DATA").map_or_else(
        || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data"),
        PathBuf::from,
    );
    let recording = data.join(RECORDING);
    if !recording.exists() {
        println!("skipped: no recording {}", recording.display());
        return;
    }
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR"));
    let compact_text = unpack(&recording);
    let plain_text = expand(&recording, &folder);
    let compact = folder.join("long.crx");
    fs::write(&compact, repeat(&compact_text, COPIES)).expect("write");
    let text = repeat(&plain_text, COPIES);
    let plain = folder.join("long.rnx");
    fs::write(&plain, &text).expect("write");
    let packed = folder.join("long.rnx.gz");
    let mut encoder = flate2::write::GzEncoder::new(
        fs::File::create(&packed).expect("create"),
        flate2::Compression::new(6),
    );
    encoder.write_all(&text).expect("write");
    encoder.finish().expect("write");

    let megabytes = text.len() as f64 / 1e6;
    println!("{megabytes:.1} MB of RINEX 3 text; rates are for this text, however it is packed");
    println!("{:<26}{:>10}{:>10}{:>12}{:>16}", "reader", "best s", "MB/s", "peak MB", "values");
    for (title, reader, path) in [
        ("read the bytes", "bytes", &plain),
        ("kurs, RINEX 3", "kurs", &plain),
        ("rinex 0.24, RINEX 3", "rinex", &plain),
        ("kurs, CRINEX 3", "kurs", &compact),
        ("rinex 0.24, CRINEX 3", "rinex", &compact),
        ("inflate", "inflate", &packed),
        ("kurs, RINEX 3 gzip", "kurs", &packed),
    ] {
        let runs: Vec<[f64; 3]> = (0..3).map(|_| measure(reader, path)).collect();
        let best_s = runs.iter().map(|run| run[0]).fold(f64::INFINITY, f64::min);
        let [_, peak_mb, values] = runs[0];
        let rate = megabytes / best_s;
        println!("{title:<26}{best_s:>10.3}{rate:>10.0}{peak_mb:>12.1}{values:>16.0}");
    }
}

fn unpack(path: &Path) -> Vec<u8> {
    let mut text = Vec::new();
    flate2::read::MultiGzDecoder::new(fs::File::open(path).expect("open"))
        .read_to_end(&mut text)
        .expect("inflate");
    text
}

/// The recording as plain RINEX, by the tool of the format's author.
fn expand(path: &Path, folder: &Path) -> Vec<u8> {
    let copy = folder.join(path.file_name().expect("a file"));
    fs::copy(path, &copy).expect("copy");
    let script = "import sys, hatanaka; sys.stdout.buffer.write(hatanaka.decompress(open(sys.argv[1], 'rb').read()))";
    let output = Command::new("python3").args(["-c", script]).arg(&copy).output().expect("python3");
    assert!(
        output.status.success(),
        "pip install hatanaka: {:?}",
        String::from_utf8_lossy(&output.stderr)
    );
    output.stdout
}

/// Header, then the epochs `copies` times, each an hour later.
fn repeat(text: &[u8], copies: u32) -> Vec<u8> {
    let end = text.windows(13).position(|w| w == b"END OF HEADER").expect("a header");
    let body = end + text[end..].iter().position(|b| *b == b'\n').expect("a line") + 1;
    let mut out = text[..body].to_vec();
    for copy in 0..copies {
        for line in text[body..].split_inclusive(|byte| *byte == b'\n') {
            if line[0] == b'>' {
                let part = |range: std::ops::Range<usize>| {
                    String::from_utf8_lossy(&line[range]).trim().parse::<u8>().expect("a number")
                };
                let year = String::from_utf8_lossy(&line[2..6]).parse().expect("a year");
                let date = Calendar {
                    year,
                    month: part(7..9),
                    day: part(10..12),
                    hour: part(13..15),
                    minute: part(16..18),
                    second: 0.0,
                };
                let later =
                    GpsTime::from_calendar(date).expect("a date") + f64::from(copy) * 3600.0;
                let c = later.calendar();
                write!(
                    out,
                    "> {:04} {:02} {:02} {:02} {:02}",
                    c.year, c.month, c.day, c.hour, c.minute
                )
                .expect("write");
                out.extend_from_slice(&line[18..]);
            } else {
                out.extend_from_slice(line);
            }
        }
    }
    out
}

/// Seconds, peak megabytes and values of one run in a process of its own.
fn measure(reader: &str, path: &Path) -> [f64; 3] {
    let program = std::env::current_exe().expect("this program");
    let output = Command::new(program).arg("--one").arg(reader).arg(path).output().expect("run");
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    let mut numbers = text.split_whitespace().map(|number| number.parse().expect("a number"));
    std::array::from_fn(|_| numbers.next().unwrap_or(f64::NAN))
}

fn run_one(reader: &str, path: &Path) {
    let start = Instant::now();
    let values = match reader {
        "kurs" => kurs_values(path),
        "rinex" => rinex_values(path),
        "inflate" => unpacked_length(path),
        _ => fs::read(path).expect("read").len(),
    };
    let seconds = start.elapsed().as_secs_f64();
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    let peak = status.lines().find_map(|line| line.strip_prefix("VmHWM:")).unwrap_or("nan");
    let peak_kb: f64 = peak.trim().trim_end_matches(" kB").parse().unwrap_or(f64::NAN);
    println!("{seconds} {} {values}", peak_kb / 1024.0);
}

fn kurs_values(path: &Path) -> usize {
    let mut reader = ObservationReader::open(path).expect("open");
    let mut epoch = AntennaEpoch::default();
    let mut values = 0;
    while reader.next_epoch(&mut epoch).expect("read") {
        for o in &epoch.observations {
            values += usize::from(o.pseudorange_m.is_some())
                + usize::from(o.phase_cycles.is_some())
                + usize::from(o.doppler_hz.is_some())
                + usize::from(o.cn0_dbhz.is_some());
        }
    }
    assert_eq!(reader.damage(), []);
    values
}

fn rinex_values(path: &Path) -> usize {
    let rinex = rinex::prelude::Rinex::from_file(path).expect("rinex reads it");
    rinex.record.as_obs().expect("observations").values().map(|o| o.signals.len()).sum()
}

fn unpacked_length(path: &Path) -> usize {
    let mut decoder = flate2::read::MultiGzDecoder::new(fs::File::open(path).expect("open"));
    let (mut buffer, mut length) = (vec![0; 1 << 18], 0);
    loop {
        match decoder.read(&mut buffer).expect("inflate") {
            0 => return length,
            count => length += count,
        }
    }
}
