//! What the service knows of itself: counts, latencies, and whether all is well.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::sync::atomic::{AtomicBool, AtomicI64, AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use kurs::observation::AntennaEpoch;
use kurs::observation::interference::{Interference, Jamming, Spoofing};
use kurs::signal::Band;
use kurs::solution::{EpochSolution, Status as RowStatus};
use kurs::time::GpsTime;

use crate::band_level::BandLevel;
use crate::peer::RelativeRow;
use crate::trouble::Trouble;

/// A stream is silent after this many of its intervals without an epoch …
const SILENT_INTERVALS: f64 = 3.0;
/// … but not before so many seconds, so that one scheduling hiccup at 100 Hz is no alarm.
const MIN_SILENT_S: f64 = 0.5;
/// While its interval is not known, and before its first epoch, s.
const UNKNOWN_SILENT_S: f64 = 5.0;
/// Epochs are missing where the next one comes later than this many intervals.
const GAP_INTERVALS: f64 = 1.5;
/// Times between epochs from here on are no interval of a receiver, s.
const MAX_INTERVAL_S: f64 = 100.0;
/// Bits of a character on a serial line: start, eight, stop.
const BITS_A_BYTE: f64 = 10.0;
/// The load of a serial line is its mean over so long.
const LOAD_WINDOW_S: f64 = 10.0;
/// A line that carries more than this has no room for a longer epoch.
const HIGH_LOAD: f64 = 0.9;
/// An antenna is late when so many of its epochs in a row miss their rows: single ones are hiccups of a network.
const LATE_IN_A_ROW: u32 = 5;
/// A stream that is older by the system's clock is a recording, or the clock is wrong, s.
const MAX_AGE_S: f64 = 1000.0;

/// Upper bounds of the latency classes, ms.
const BOUNDS_MS: [f64; 16] = [
    0.5, 1.0, 2.0, 3.0, 5.0, 7.5, 10.0, 15.0, 20.0, 30.0, 50.0, 100.0, 200.0, 300.0, 1000.0,
    10_000.0,
];

/// Counts of latencies by class.
#[derive(Debug, Default)]
pub(crate) struct Histogram {
    classes: [AtomicU64; BOUNDS_MS.len()],
    count: AtomicU64,
    sum_us: AtomicU64,
}

impl Histogram {
    pub(crate) fn add(&self, latency: Duration) {
        let ms = latency.as_secs_f64() * 1e3;
        if let Some(class) = BOUNDS_MS.iter().position(|bound| ms <= *bound) {
            self.classes[class].fetch_add(1, Relaxed);
        }
        self.count.fetch_add(1, Relaxed);
        self.sum_us.fetch_add(u64::try_from(latency.as_micros()).unwrap_or(u64::MAX), Relaxed);
    }

    /// Bounds of the classes below which these shares are; `None` without any, or beyond the last class.
    pub(crate) fn quantiles_ms<const N: usize>(&self, shares: [f64; N]) -> [Option<f64>; N] {
        let count = self.count.load(Relaxed) as f64;
        shares.map(|share| {
            let mut below = 0;
            let classes = BOUNDS_MS.iter().zip(&self.classes).filter(|_| count > 0.0);
            classes.into_iter().find_map(|(bound, class)| {
                below += class.load(Relaxed);
                (below as f64 >= share * count).then_some(*bound)
            })
        })
    }

    fn write(&self, text: &mut String, name: &str, help: &str) {
        let _ = writeln!(text, "# HELP {name} {help}\n# TYPE {name} histogram");
        let mut below = 0;
        for (bound, class) in BOUNDS_MS.iter().zip(&self.classes) {
            below += class.load(Relaxed);
            let _ = writeln!(text, "{name}_bucket{{le=\"{}\"}} {below}", bound * 1e-3);
        }
        let count = self.count.load(Relaxed);
        let _ = writeln!(text, "{name}_bucket{{le=\"+Inf\"}} {count}");
        let _ = writeln!(text, "{name}_sum {}", self.sum_us.load(Relaxed) as f64 * 1e-6);
        let _ = writeln!(text, "{name}_count {count}");
    }
}

/// How much of a serial line is in use.
#[derive(Debug)]
struct Load {
    /// Begin of the window, s after the stream's.
    since_s: f64,
    /// In the window so far.
    bytes: u64,
    /// Of the window before.
    share: f64,
}

impl Load {
    /// The share of a line of so many bits a second, whenever a window is over.
    fn add(&mut self, now_s: f64, bytes: u64, baud: u64) -> Option<f64> {
        self.bytes += bytes;
        let length_s = now_s - self.since_s;
        if baud == 0 || length_s < LOAD_WINDOW_S {
            return None;
        }
        let share = self.bytes as f64 * BITS_A_BYTE / (baud as f64 * length_s);
        *self = Self { since_s: now_s, bytes: 0, share };
        Some(share)
    }
}

/// What is shown of a stream.
#[derive(Debug)]
pub(crate) struct StreamView {
    pub(crate) name: String,
    pub(crate) trouble: Option<String>,
    pub(crate) is_connected: bool,
    pub(crate) bytes: u64,
    pub(crate) epochs: u64,
    pub(crate) late: u64,
    pub(crate) strays: u64,
    pub(crate) damaged: u64,
    pub(crate) errors: u64,
    pub(crate) connections: u64,
    pub(crate) gaps: u64,
    pub(crate) gaps_s: f64,
    /// 0: unknown.
    pub(crate) interval_s: f64,
    /// From measurement to last byte; `None` where the clocks have nothing to do with each other.
    pub(crate) age_s: Option<f64>,
    pub(crate) baud: Option<u64>,
    pub(crate) line_load: Option<f64>,
    pub(crate) last_error: String,
    pub(crate) bands: Vec<BandLevel>,
    pub(crate) interference: Interference,
}

impl StreamView {
    /// What is wrong with its signals: subjects (a band, or empty for the receiver) and words.
    pub(crate) fn disturbances(&self) -> Vec<(String, String)> {
        let mut found = Vec::new();
        if self.interference.spoofing == Spoofing::Stated {
            found.push(("spoofing".to_owned(), "is stated by the receiver".to_owned()));
        }
        if self.interference.jamming >= Jamming::Warning {
            let text = format!("is stated by the receiver ({})", self.interference.jamming.word());
            found.push(("jamming".to_owned(), text));
        }
        for band in self.bands.iter().filter(|band| band.is_low()) {
            let text = format!("is {:.0} dB weaker than usual at this antenna", band.drop_db());
            found.push((band.band.to_string(), text));
        }
        found
    }
}

/// What a stream brings.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Brings {
    /// Epochs of an antenna or of the station.
    Epochs,
    /// Samples of the inertial sensor.
    Samples,
    /// Rows of another body, which may come and go.
    Peer,
}

/// One stream.
#[derive(Debug)]
pub(crate) struct StreamStatus {
    name: String,
    brings: Brings,
    /// Of a serial line, bits a second; 0 for others.
    baud: u64,
    began: Instant,
    bytes: AtomicU64,
    load: Mutex<Load>,
    epochs: AtomicU64,
    damaged: AtomicU64,
    errors: AtomicU64,
    connections: AtomicU64,
    pub(crate) late: AtomicU64,
    pub(crate) strays: AtomicU64,
    connected: AtomicBool,
    ended: AtomicBool,
    /// Of the last epoch: when it came, ms after `began` (−1: none), and its time tag, ns.
    last_ms: AtomicI64,
    last_time_ns: AtomicI64,
    /// Shortest time between two epochs, ns (0: unknown).
    interval_ns: AtomicI64,
    /// How often epochs were missing, and how long altogether, ns.
    gaps: AtomicU64,
    gaps_ns: AtomicU64,
    /// C/N0 of each band in the last epoch.
    bands: Mutex<BTreeMap<Band, BandLevel>>,
    /// What the receiver stated last.
    interference: Mutex<Interference>,
    /// From the measurement of the last epoch to its last byte, by the system's clock, ns.
    age_ns: AtomicI64,
    last_error: Mutex<String>,
    /// The same, as it is told in the log.
    errors_told: Trouble,
    lateness: Mutex<Lateness>,
    /// Of a station: where it is.
    place: Trouble,
}

/// Epochs that miss the deadline one after the other.
#[derive(Debug, Default)]
struct Lateness {
    in_a_row: u32,
    /// How much later than those of the others the last one came.
    late_s: f64,
}

impl Lateness {
    /// What is wrong, in words.
    fn text(&self) -> Option<String> {
        let Self { in_a_row, late_s } = self;
        (*in_a_row >= LATE_IN_A_ROW).then(|| {
            format!(
                "is late by {late_s:.1} s: its epochs miss `deadline_ms`, and rows go without it"
            )
        })
    }
}

impl StreamStatus {
    pub(crate) fn new(name: String, baud: Option<u32>) -> Self {
        Self {
            errors_told: Trouble::new(format!("stream {name}:")),
            lateness: Mutex::default(),
            place: Trouble::new(name.clone()),
            name,
            brings: Brings::Epochs,
            baud: baud.map_or(0, u64::from),
            began: Instant::now(),
            bytes: AtomicU64::new(0),
            load: Mutex::new(Load { since_s: 0.0, bytes: 0, share: 0.0 }),
            epochs: AtomicU64::new(0),
            damaged: AtomicU64::new(0),
            errors: AtomicU64::new(0),
            connections: AtomicU64::new(0),
            late: AtomicU64::new(0),
            strays: AtomicU64::new(0),
            connected: AtomicBool::new(false),
            ended: AtomicBool::new(false),
            last_ms: AtomicI64::new(-1),
            last_time_ns: AtomicI64::new(0),
            interval_ns: AtomicI64::new(0),
            gaps: AtomicU64::new(0),
            gaps_ns: AtomicU64::new(0),
            bands: Mutex::default(),
            interference: Mutex::default(),
            age_ns: AtomicI64::new(i64::MAX),
            last_error: Mutex::new(String::new()),
        }
    }

    pub(crate) const fn bringing(mut self, brings: Brings) -> Self {
        self.brings = brings;
        self
    }

    fn now_ms(&self) -> i64 {
        i64::try_from(self.began.elapsed().as_millis()).unwrap_or(i64::MAX)
    }

    pub(crate) fn note_bytes(&self, count: usize) {
        self.bytes.fetch_add(count as u64, Relaxed);
        let now_s = self.began.elapsed().as_secs_f64();
        let mut load = self.load.lock().unwrap_or_else(PoisonError::into_inner);
        let was_high = load.share > HIGH_LOAD;
        if let Some(share) = load.add(now_s, count as u64, self.baud)
            && share > HIGH_LOAD
            && !was_high
        {
            let percent = (100.0 * share).round();
            tracing::warn!(
                stream = self.name,
                "{} baud carry {percent} % of what they can",
                self.baud
            );
        }
    }

    /// A line with this time came.
    pub(crate) fn note_line(&self, time: Option<GpsTime>) {
        self.epochs.fetch_add(1, Relaxed);
        self.errors_told.end();
        self.last_ms.store(self.now_ms(), Relaxed);
        time.into_iter().for_each(|time| self.note_time(time));
    }

    pub(crate) fn note_epoch(&self, epoch: &AntennaEpoch) {
        self.note_line(Some(epoch.time));
        let mut of_bands: BTreeMap<Band, (f64, u32)> = BTreeMap::new();
        for observation in &epoch.observations {
            let Some(cn0_dbhz) = observation.cn0_dbhz else { continue };
            let (sum, count) = of_bands.entry(observation.signal.band).or_default();
            (*sum, *count) = (*sum + cn0_dbhz, *count + 1);
        }
        let mut levels = self.bands.lock().unwrap_or_else(PoisonError::into_inner);
        let before = core::mem::take(&mut *levels);
        *levels = of_bands
            .into_iter()
            .map(|(band, (sum, count))| {
                let cn0_dbhz = sum / f64::from(count);
                (band, BandLevel::after(before.get(&band), band, cn0_dbhz, epoch.time))
            })
            .collect();
        *self.interference.lock().unwrap_or_else(PoisonError::into_inner) = epoch.interference;
    }

    /// How long after its measurement the last byte of an epoch came.
    pub(crate) fn note_age(&self, age_s: f64) {
        #[allow(clippy::cast_possible_truncation)] // `as` saturates
        self.age_ns.store((age_s * 1e9) as i64, Relaxed);
    }

    pub(crate) fn name(&self) -> &str {
        &self.name
    }

    /// Everything that is shown of it.
    pub(crate) fn view(&self) -> StreamView {
        let lock =
            |text: &Mutex<String>| text.lock().unwrap_or_else(PoisonError::into_inner).clone();
        let age_s = self.age_ns.load(Relaxed) as f64 * 1e-9;
        let load = self.load.lock().unwrap_or_else(PoisonError::into_inner).share;
        StreamView {
            name: self.name.clone(),
            trouble: self.trouble(),
            is_connected: self.connected.load(Relaxed),
            bytes: self.bytes.load(Relaxed),
            epochs: self.epochs(),
            late: self.late.load(Relaxed),
            strays: self.strays.load(Relaxed),
            damaged: self.damaged.load(Relaxed),
            errors: self.errors.load(Relaxed),
            connections: self.connections.load(Relaxed),
            gaps: self.gaps.load(Relaxed),
            gaps_s: self.gaps_ns.load(Relaxed) as f64 * 1e-9,
            interval_s: self.interval_ns.load(Relaxed) as f64 * 1e-9,
            age_s: (age_s.abs() < MAX_AGE_S).then_some(age_s),
            baud: (self.baud > 0).then_some(self.baud),
            line_load: (self.baud > 0).then_some(load),
            last_error: lock(&self.last_error),
            bands: self
                .bands
                .lock()
                .unwrap_or_else(PoisonError::into_inner)
                .values()
                .copied()
                .collect(),
            interference: *self.interference.lock().unwrap_or_else(PoisonError::into_inner),
        }
    }

    fn note_time(&self, time: GpsTime) {
        let last_ns = self.last_time_ns.swap(time.as_nanoseconds(), Relaxed);
        let since_ns = time.as_nanoseconds() - last_ns;
        if last_ns == 0 || since_ns <= 0 {
            return;
        }
        let known_ns = self.interval_ns.load(Relaxed);
        if known_ns > 0 && since_ns as f64 > GAP_INTERVALS * known_ns as f64 {
            self.gaps.fetch_add(1, Relaxed);
            self.gaps_ns.fetch_add(since_ns.abs_diff(known_ns), Relaxed);
        }
        if since_ns as f64 * 1e-9 < MAX_INTERVAL_S && (known_ns == 0 || since_ns < known_ns) {
            self.interval_ns.store(since_ns, Relaxed);
        }
    }

    /// Number of epochs so far.
    pub(crate) fn epochs(&self) -> u64 {
        self.epochs.load(Relaxed)
    }

    pub(crate) fn note_damage(&self, count: u64) {
        self.damaged.fetch_add(count, Relaxed);
    }

    /// A line that could not be used; the first one of a stream is named.
    pub(crate) fn note_bad_line(&self, what: &str) {
        if self.damaged.fetch_add(1, Relaxed) == 0 {
            tracing::warn!(stream = self.name, "a line cannot be used: {what}");
        }
    }

    /// An error that ended a connection or kept one from being made.
    pub(crate) fn note_error(&self, what: &str) {
        self.errors.fetch_add(1, Relaxed);
        self.errors_told.note(what);
        what.clone_into(&mut self.last_error.lock().unwrap_or_else(PoisonError::into_inner));
    }

    /// An epoch came so much later than those of the others that it missed its row, or in time (`None`).
    pub(crate) fn note_lateness(&self, late_s: Option<f64>) {
        let mut lateness = self.lateness.lock().unwrap_or_else(PoisonError::into_inner);
        let was_told = lateness.in_a_row >= LATE_IN_A_ROW;
        *lateness = Lateness {
            in_a_row: late_s.map_or(0, |_| lateness.in_a_row.saturating_add(1)),
            late_s: late_s.unwrap_or_default(),
        };
        match (was_told, lateness.text()) {
            (false, Some(text)) => tracing::warn!(stream = self.name, "{} {text}", self.name),
            (true, None) => tracing::info!(stream = self.name, "{} is in time again", self.name),
            _ => {}
        }
    }

    /// Why the place of a station is not known.
    pub(crate) fn note_place(&self, trouble: Option<String>) {
        match trouble {
            Some(what) => self.place.note(&what),
            None => self.place.end(),
        }
    }

    pub(crate) fn note_connection(&self, connected: bool) {
        self.connections.fetch_add(u64::from(connected), Relaxed);
        self.connected.store(connected, Relaxed);
    }

    /// It has ended and is not expected to come again.
    pub(crate) fn note_end(&self) {
        self.ended.store(true, Relaxed);
    }

    /// The name as a label of a metric.
    fn label(&self) -> String {
        label(&self.name)
    }

    /// Why the stream does not bring what it should, in words; `None` if it does.
    pub(crate) fn trouble(&self) -> Option<String> {
        let error = self.last_error.lock().unwrap_or_else(PoisonError::into_inner);
        if self.ended.load(Relaxed) {
            let why = if error.is_empty() { String::new() } else { format!(": {error}") };
            return Some(format!("has ended{why}"));
        }
        let last_ms = self.last_ms.load(Relaxed);
        let silent_s = (self.now_ms() - last_ms.max(0)) as f64 * 1e-3;
        let interval_s = self.interval_ns.load(Relaxed) as f64 * 1e-9;
        let limit_s = match interval_s > 0.0 {
            true => (SILENT_INTERVALS * interval_s).max(MIN_SILENT_S),
            false => UNKNOWN_SILENT_S,
        };
        if silent_s <= limit_s {
            let lateness = self.lateness.lock().unwrap_or_else(PoisonError::into_inner);
            return lateness.text().or_else(|| self.place.what());
        }
        Some(match (self.connected.load(Relaxed), error.is_empty()) {
            (false, false) => format!("is not connected: {error}"),
            (false, true) => "is not connected".into(),
            (true, _) => {
                let awaited = match self.brings {
                    Brings::Epochs => "epoch",
                    Brings::Samples => "sample",
                    Brings::Peer => "row",
                };
                format!("is connected, but no {awaited} came for {silent_s:.1} s")
            }
        })
    }
}

fn label(name: &str) -> String {
    name.replace('\\', "\\\\").replace('"', "\\\"")
}

/// One output.
#[derive(Debug)]
pub(crate) struct OutputStatus {
    /// Of the way to its readers.
    pub(crate) way: Trouble,
    /// Of the age of its messages.
    pub(crate) age: Trouble,
}

/// Everything together.
#[derive(Debug)]
pub(crate) struct Status {
    outputs: Mutex<Vec<Arc<OutputStatus>>>,
    pub(crate) streams: Mutex<Vec<Arc<StreamStatus>>>,
    rows: [AtomicU64; RowStatus::ALL.len()],
    satellites: AtomicU64,
    last_row_ms: AtomicI64,
    /// Whether a row is overdue after the streams' own limits.
    began: Instant,
    pub(crate) in_to_out: Histogram,
    pub(crate) first_to_out: Histogram,
    /// Messages that no output got because they were too old.
    pub(crate) expired: AtomicU64,
    /// Datagrams that the system could not send.
    pub(crate) unsent: AtomicU64,
    /// Rows that a file could not take.
    pub(crate) unwritten: AtomicU64,
    pub(crate) clients: AtomicU64,
    pub(crate) clients_dropped: AtomicU64,
    /// Rows whose antennas have tags farther apart than one clock allows.
    pub(crate) clocks_apart: AtomicU64,
    /// How much older than the last row the station's epoch in it is, s: bits of a number, of none without one.
    station_age_s: AtomicU64,
    /// The other bodies at the last row.
    relative: Mutex<Vec<RelativeRow>>,
}

impl Status {
    pub(crate) fn new() -> Self {
        Self {
            outputs: Mutex::default(),
            streams: Mutex::new(Vec::new()),
            rows: Default::default(),
            satellites: AtomicU64::new(0),
            last_row_ms: AtomicI64::new(-1),
            began: Instant::now(),
            in_to_out: Histogram::default(),
            first_to_out: Histogram::default(),
            expired: AtomicU64::new(0),
            unsent: AtomicU64::new(0),
            unwritten: AtomicU64::new(0),
            clients: AtomicU64::new(0),
            clients_dropped: AtomicU64::new(0),
            clocks_apart: AtomicU64::new(0),
            station_age_s: AtomicU64::new(f64::NAN.to_bits()),
            relative: Mutex::default(),
        }
    }

    /// Another output, at this address.
    pub(crate) fn add_output(&self, address: &str) -> Arc<OutputStatus> {
        let trouble = || Trouble::new(format!("output {address}"));
        let output = Arc::new(OutputStatus { way: trouble(), age: trouble() });
        self.outputs.lock().unwrap_or_else(PoisonError::into_inner).push(Arc::clone(&output));
        output
    }

    pub(crate) fn note_relative(&self, rows: Vec<RelativeRow>) {
        *self.relative.lock().unwrap_or_else(PoisonError::into_inner) = rows;
    }

    /// The other bodies at the last row.
    pub(crate) fn relative(&self) -> Vec<RelativeRow> {
        self.relative.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    pub(crate) fn note_station(&self, age_s: Option<f64>) {
        self.station_age_s.store(age_s.unwrap_or(f64::NAN).to_bits(), Relaxed);
    }

    pub(crate) fn note_row(&self, row: &EpochSolution) {
        let number = RowStatus::ALL.iter().position(|status| *status == row.status());
        self.rows[number.unwrap_or(0)].fetch_add(1, Relaxed);
        self.satellites.store(row.satellites as u64, Relaxed);
        let now_ms = i64::try_from(self.began.elapsed().as_millis()).unwrap_or(i64::MAX);
        self.last_row_ms.store(now_ms, Relaxed);
    }

    fn row_age_s(&self) -> f64 {
        let last_s = self.last_row_ms.load(Relaxed).max(0) as f64 * 1e-3;
        self.began.elapsed().as_secs_f64() - last_s
    }

    /// Rows by the word for their status.
    pub(crate) fn row_counts(&self) -> [(&'static str, u64); RowStatus::ALL.len()] {
        core::array::from_fn(|k| (RowStatus::ALL[k].word(), self.rows[k].load(Relaxed)))
    }

    /// How much older than the last row the station's epoch in it is, s.
    pub(crate) fn station_age_s(&self) -> Option<f64> {
        Some(f64::from_bits(self.station_age_s.load(Relaxed))).filter(|age_s| age_s.is_finite())
    }

    pub(crate) fn streams(&self) -> Vec<Arc<StreamStatus>> {
        self.streams.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// What is wrong, a line each; nothing if all is well.
    pub(crate) fn troubles(&self) -> Vec<String> {
        let mut streams = self.streams();
        streams.retain(|stream| stream.brings != Brings::Peer);
        let of_streams = streams.iter().filter_map(|stream| {
            stream.trouble().map(|trouble| format!("{} {trouble}", stream.name))
        });
        let mut troubles: Vec<String> = of_streams.collect();
        let interval_s = streams.iter().map(|s| s.interval_ns.load(Relaxed) as f64 * 1e-9);
        let longest_s = interval_s.fold(0.0, f64::max);
        let limit_s = match longest_s > 0.0 {
            true => (SILENT_INTERVALS * longest_s).max(MIN_SILENT_S),
            false => UNKNOWN_SILENT_S,
        };
        if self.row_age_s() > limit_s {
            troubles.push(format!("no row for {:.1} s", self.row_age_s()));
        }
        let outputs = self.outputs.lock().unwrap_or_else(PoisonError::into_inner);
        troubles.extend(
            outputs.iter().flat_map(|output| [&output.way, &output.age]).filter_map(Trouble::text),
        );
        troubles
    }

    /// Prometheus text.
    pub(crate) fn metrics(&self) -> String {
        let mut text = String::new();
        let head = |text: &mut String, name: &str, kind: &str, help: &str| {
            let _ = writeln!(text, "# HELP {name} {help}\n# TYPE {name} {kind}");
        };
        head(&mut text, "kurs_rows_total", "counter", "Rows by status.");
        for (status, count) in self.row_counts() {
            let _ = writeln!(text, "kurs_rows_total{{status=\"{status}\"}} {count}");
        }
        let single: [(&str, &str, &str, f64); 8] = [
            (
                "kurs_satellites",
                "gauge",
                "Satellites of the last row.",
                self.satellites.load(Relaxed) as f64,
            ),
            ("kurs_row_age_seconds", "gauge", "Time since the last row.", self.row_age_s()),
            (
                "kurs_clients",
                "gauge",
                "Connected clients of the outputs.",
                self.clients.load(Relaxed) as f64,
            ),
            (
                "kurs_clients_dropped_total",
                "counter",
                "Clients that did not read.",
                self.clients_dropped.load(Relaxed) as f64,
            ),
            (
                "kurs_messages_expired_total",
                "counter",
                "Messages older than 300 ms, not sent.",
                self.expired.load(Relaxed) as f64,
            ),
            (
                "kurs_messages_unsent_total",
                "counter",
                "Datagrams that the system could not send.",
                self.unsent.load(Relaxed) as f64,
            ),
            (
                "kurs_rows_unwritten_total",
                "counter",
                "Rows that the files could not take.",
                self.unwritten.load(Relaxed) as f64,
            ),
            (
                "kurs_clocks_apart_total",
                "counter",
                "Rows whose tags differ though the antennas have one clock.",
                self.clocks_apart.load(Relaxed) as f64,
            ),
        ];
        for (name, kind, help, value) in single {
            head(&mut text, name, kind, help);
            let _ = writeln!(text, "{name} {value}");
        }
        if let Some(station_age_s) = self.station_age_s() {
            let name = "kurs_station_age_seconds";
            head(&mut text, name, "gauge", "Age of the station's epoch in the last row.");
            let _ = writeln!(text, "{name} {station_age_s:.3}");
        }
        let name = "kurs_peer_age_seconds";
        head(&mut text, name, "gauge", "Age of another body's attitude in the last row.");
        for row in self.relative() {
            if let [_, Some(age_s)] = row.ages_s {
                let _ = writeln!(text, "{name}{{peer=\"{}\"}} {age_s:.3}", label(&row.peer));
            }
        }
        let streams = self.streams();
        type Value = fn(&StreamStatus) -> f64;
        let of_streams: [(&str, &str, &str, Value); 14] = [
            ("kurs_stream_up", "gauge", "1: epochs come as they should.", |s| {
                f64::from(u8::from(s.trouble().is_none()))
            }),
            ("kurs_stream_bytes_total", "counter", "Bytes received.", |s| {
                s.bytes.load(Relaxed) as f64
            }),
            ("kurs_stream_epochs_total", "counter", "Epochs decoded.", |s| {
                s.epochs.load(Relaxed) as f64
            }),
            ("kurs_stream_late_total", "counter", "Epochs that missed the deadline.", |s| {
                s.late.load(Relaxed) as f64
            }),
            (
                "kurs_stream_strays_total",
                "counter",
                "Epochs far from the time of the others.",
                |s| s.strays.load(Relaxed) as f64,
            ),
            ("kurs_stream_damaged_total", "counter", "Pieces that could not be decoded.", |s| {
                s.damaged.load(Relaxed) as f64
            }),
            ("kurs_stream_errors_total", "counter", "Connections that failed or broke.", |s| {
                s.errors.load(Relaxed) as f64
            }),
            ("kurs_stream_connections_total", "counter", "Connections made.", |s| {
                s.connections.load(Relaxed) as f64
            }),
            ("kurs_stream_interval_seconds", "gauge", "Shortest time between two epochs.", |s| {
                s.interval_ns.load(Relaxed) as f64 * 1e-9
            }),
            ("kurs_stream_gaps_total", "counter", "How often epochs were missing.", |s| {
                s.gaps.load(Relaxed) as f64
            }),
            ("kurs_stream_gap_seconds_total", "counter", "How long altogether.", |s| {
                s.gaps_ns.load(Relaxed) as f64 * 1e-9
            }),
            (
                "kurs_stream_line_load",
                "gauge",
                "Share of a serial line that is in use, mean over ten seconds.",
                |s| s.load.lock().unwrap_or_else(PoisonError::into_inner).share,
            ),
            (
                "kurs_stream_jamming",
                "gauge",
                "What the receiver states: 0 nothing, 1 none, 2 warning, 3 critical.",
                |s| f64::from(s.view().interference.jamming as u8),
            ),
            (
                "kurs_stream_spoofing",
                "gauge",
                "What the receiver states: 0 nothing, 1 none, 2 spoofing.",
                |s| f64::from(s.view().interference.spoofing as u8),
            ),
        ];
        for (name, kind, help, value) in of_streams {
            head(&mut text, name, kind, help);
            for stream in &streams {
                let _ = writeln!(text, "{name}{{stream=\"{}\"}} {}", stream.label(), value(stream));
            }
        }
        let name = "kurs_stream_cn0_dbhz";
        head(&mut text, name, "gauge", "Mean C/N0 of a band in the last epoch.");
        for stream in &streams {
            for level in stream.view().bands {
                let labels = format!("stream=\"{}\",band=\"{}\"", stream.label(), level.band);
                let _ = writeln!(text, "{name}{{{labels}}} {:.2}", level.cn0_dbhz);
            }
        }
        let name = "kurs_stream_cn0_drop_db";
        head(&mut text, name, "gauge", "How much weaker a band is than usual at this antenna.");
        for stream in &streams {
            for level in stream.view().bands {
                let labels = format!("stream=\"{}\",band=\"{}\"", stream.label(), level.band);
                let _ = writeln!(text, "{name}{{{labels}}} {:.2}", level.drop_db());
            }
        }
        self.in_to_out.write(&mut text, "kurs_latency_seconds", "Last byte in to row out.");
        let help = "First byte of the epoch to row out.";
        self.first_to_out.write(&mut text, "kurs_epoch_latency_seconds", help);
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn latencies_are_counted_by_class() {
        let histogram = Histogram::default();
        for ms in [0.4, 0.5, 7.0, 20_000.0] {
            histogram.add(Duration::from_secs_f64(ms * 1e-3));
        }
        let mut text = String::new();
        histogram.write(&mut text, "x", "Help.");
        for line in [
            "# TYPE x histogram",
            "x_bucket{le=\"0.0005\"} 2",
            "x_bucket{le=\"0.005\"} 2",
            "x_bucket{le=\"0.0075\"} 3",
            "x_bucket{le=\"10\"} 3",
            "x_bucket{le=\"+Inf\"} 4",
            "x_sum 20.0079",
            "x_count 4",
        ] {
            assert!(text.lines().any(|found| found == line), "{line}: {text}");
        }
    }

    fn epoch(second: f64) -> AntennaEpoch {
        AntennaEpoch { time: GpsTime::default() + (1e9 + second), ..AntennaEpoch::default() }
    }

    /// A stream with an interval of 0.1 s is silent after half a second, one without any epoch after five.
    #[test]
    fn a_silent_stream_is_named_with_what_is_known_of_it() {
        let stream = |began_s: u64| {
            let mut status = StreamStatus::new("bow".into(), Some(38_400));
            status.began = Instant::now().checked_sub(Duration::from_secs(began_s)).unwrap();
            status
        };
        assert_eq!(stream(4).trouble(), None);
        assert_eq!(stream(6).trouble().unwrap(), "is not connected");
        let refused = stream(6);
        refused.note_error("nobody there");
        assert_eq!(refused.trouble().unwrap(), "is not connected: nobody there");

        let mut going = stream(1);
        going.note_connection(true);
        for tenth in 0..3 {
            going.note_epoch(&epoch(0.1 * f64::from(tenth)));
        }
        assert_eq!(going.trouble(), None);
        assert_eq!(going.epochs(), 3);
        going.began = Instant::now().checked_sub(Duration::from_secs(3)).unwrap();
        assert!(going.trouble().unwrap().starts_with("is connected, but no epoch came for 2."));
        going.note_end();
        assert_eq!(going.trouble().unwrap(), "has ended");
    }

    /// Single late epochs are nothing; a stretch of them is named with how late they are, until one is in time.
    #[test]
    fn an_antenna_that_is_always_late_is_named() {
        let status = StreamStatus::new("A1".into(), None);
        status.note_connection(true);
        for _ in 0..10 {
            (0..4).for_each(|_| status.note_lateness(Some(2.0)));
            status.note_lateness(None);
        }
        assert_eq!(status.trouble(), None);
        (0..5).for_each(|_| status.note_lateness(Some(2.04)));
        let told = status.trouble().unwrap();
        assert!(told.starts_with("is late by 2.0 s: its epochs miss"), "{told}");
        status.note_lateness(None);
        assert_eq!(status.trouble(), None);
    }

    /// 2400 bytes a second are 24 000 bits of 38 400.
    #[test]
    fn the_load_of_a_line_is_that_of_the_last_seconds() {
        let mut load = Load { since_s: 0.0, bytes: 0, share: 0.0 };
        assert_eq!(load.add(5.0, 12_000, 38_400), None);
        assert_eq!(load.add(10.0, 12_000, 38_400), Some(0.625));
        assert_eq!(load.add(15.0, 0, 38_400), None);
        assert_eq!(load.add(20.0, 0, 38_400), Some(0.0));
        assert_eq!(load.add(40.0, 1000, 0), None, "no serial line");
    }

    #[test]
    fn metrics_have_a_line_for_every_stream() {
        let status = Status::new();
        let stream = Arc::new(StreamStatus::new("a\"b".into(), None));
        stream.note_bytes(120);
        stream.note_damage(2);
        let signal = |name: &str, cn0_dbhz| kurs::observation::Observation {
            satellite: "G01".parse().unwrap(),
            signal: name.parse().unwrap(),
            pseudorange_m: None,
            phase_cycles: None,
            doppler_hz: None,
            cn0_dbhz,
            lock: kurs::observation::Lock::default(),
        };
        // Two of five epochs are missing.
        for second in [0.0, 1.0, 4.0] {
            let mut epoch = epoch(second);
            epoch.observations =
                vec![signal("G1C", Some(40.0)), signal("G1C", Some(45.0)), signal("G2L", None)];
            stream.note_epoch(&epoch);
        }
        status.note_station(Some(1.25));
        status.streams.lock().unwrap().push(stream);
        let text = status.metrics();
        for line in [
            "kurs_stream_bytes_total{stream=\"a\\\"b\"} 120",
            "kurs_stream_damaged_total{stream=\"a\\\"b\"} 2",
            "kurs_stream_line_load{stream=\"a\\\"b\"} 0",
            "kurs_rows_total{status=\"fixed\"} 0",
            "kurs_stream_gaps_total{stream=\"a\\\"b\"} 1",
            "kurs_stream_gap_seconds_total{stream=\"a\\\"b\"} 2",
            "kurs_stream_cn0_dbhz{stream=\"a\\\"b\",band=\"G1\"} 42.50",
            "kurs_station_age_seconds 1.250",
        ] {
            assert!(text.lines().any(|found| found == line), "{line}: {text}");
        }
    }
}
