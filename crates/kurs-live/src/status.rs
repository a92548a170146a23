//! What the service knows of itself: counts, latencies, and whether all is well.

use std::fmt::Write as _;
use std::sync::atomic::{AtomicBool, AtomicI64, AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use kurs::solution::{EpochSolution, Status as RowStatus};
use kurs::time::GpsTime;

/// A stream is silent after this many of its intervals without an epoch …
const SILENT_INTERVALS: f64 = 3.0;
/// … but not before so many seconds, so that one scheduling hiccup at 100 Hz is no alarm.
const MIN_SILENT_S: f64 = 0.5;
/// While its interval is not known, and before its first epoch, s.
const UNKNOWN_SILENT_S: f64 = 5.0;
/// Bits of a character on a serial line: start, eight, stop.
const BITS_A_BYTE: f64 = 10.0;

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

/// One antenna's stream.
#[derive(Debug)]
pub(crate) struct StreamStatus {
    name: String,
    /// Of a serial line, bits a second; 0 for others.
    baud: u64,
    began: Instant,
    bytes: AtomicU64,
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
    last_error: Mutex<String>,
}

impl StreamStatus {
    pub(crate) fn new(name: String, baud: Option<u32>) -> Self {
        Self {
            name,
            baud: baud.map_or(0, u64::from),
            began: Instant::now(),
            bytes: AtomicU64::new(0),
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
            last_error: Mutex::new(String::new()),
        }
    }

    fn now_ms(&self) -> i64 {
        i64::try_from(self.began.elapsed().as_millis()).unwrap_or(i64::MAX)
    }

    pub(crate) fn note_bytes(&self, count: usize) {
        self.bytes.fetch_add(count as u64, Relaxed);
    }

    pub(crate) fn note_epoch(&self, time: GpsTime) {
        self.epochs.fetch_add(1, Relaxed);
        self.last_ms.store(self.now_ms(), Relaxed);
        let since = time.as_nanoseconds() - self.last_time_ns.swap(time.as_nanoseconds(), Relaxed);
        let known = self.interval_ns.load(Relaxed);
        if since > 0 && since < 100_000_000_000 && (known == 0 || since < known) {
            self.interval_ns.store(since, Relaxed);
        }
    }

    /// Number of epochs so far.
    pub(crate) fn epochs(&self) -> u64 {
        self.epochs.load(Relaxed)
    }

    pub(crate) fn note_damage(&self, count: u64) {
        self.damaged.fetch_add(count, Relaxed);
    }

    /// An error that ended a connection or kept one from being made.
    pub(crate) fn note_error(&self, what: &str) {
        self.errors.fetch_add(1, Relaxed);
        tracing::warn!(stream = self.name, "{what}");
        what.clone_into(&mut self.last_error.lock().unwrap_or_else(PoisonError::into_inner));
    }

    pub(crate) fn note_connection(&self, connected: bool) {
        self.connections.fetch_add(u64::from(connected), Relaxed);
        self.connected.store(connected, Relaxed);
    }

    /// It has ended and is not expected to come again.
    pub(crate) fn note_end(&self) {
        self.ended.store(true, Relaxed);
    }

    /// Why the stream does not bring what it should, in words; `None` if it does.
    fn trouble(&self) -> Option<String> {
        if self.ended.load(Relaxed) {
            return Some("has ended".into());
        }
        let last_ms = self.last_ms.load(Relaxed);
        let silent_s = (self.now_ms() - last_ms.max(0)) as f64 * 1e-3;
        let interval_s = self.interval_ns.load(Relaxed) as f64 * 1e-9;
        let limit_s = match interval_s > 0.0 {
            true => (SILENT_INTERVALS * interval_s).max(MIN_SILENT_S),
            false => UNKNOWN_SILENT_S,
        };
        if silent_s <= limit_s {
            return None;
        }
        let error = self.last_error.lock().unwrap_or_else(PoisonError::into_inner);
        Some(match (self.connected.load(Relaxed), error.is_empty()) {
            (false, false) => format!("is not connected: {error}"),
            (false, true) => "is not connected".into(),
            (true, _) => format!("is connected, but no epoch came for {silent_s:.1} s"),
        })
    }
}

/// Everything together.
#[derive(Debug)]
pub(crate) struct Status {
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
    /// Rows that a file could not take.
    pub(crate) unwritten: AtomicU64,
    pub(crate) clients: AtomicU64,
    pub(crate) clients_dropped: AtomicU64,
}

impl Status {
    pub(crate) fn new() -> Self {
        Self {
            streams: Mutex::new(Vec::new()),
            rows: Default::default(),
            satellites: AtomicU64::new(0),
            last_row_ms: AtomicI64::new(-1),
            began: Instant::now(),
            in_to_out: Histogram::default(),
            first_to_out: Histogram::default(),
            expired: AtomicU64::new(0),
            unwritten: AtomicU64::new(0),
            clients: AtomicU64::new(0),
            clients_dropped: AtomicU64::new(0),
        }
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

    fn streams(&self) -> Vec<Arc<StreamStatus>> {
        self.streams.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// What is wrong, a line each; nothing if all is well.
    pub(crate) fn troubles(&self) -> Vec<String> {
        let streams = self.streams();
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
        troubles
    }

    /// Prometheus text.
    pub(crate) fn metrics(&self) -> String {
        let mut text = String::new();
        let head = |text: &mut String, name: &str, kind: &str, help: &str| {
            let _ = writeln!(text, "# HELP {name} {help}\n# TYPE {name} {kind}");
        };
        head(&mut text, "kurs_rows_total", "counter", "Rows by status.");
        for (status, count) in RowStatus::ALL.iter().zip(&self.rows) {
            let count = count.load(Relaxed);
            let _ = writeln!(text, "kurs_rows_total{{status=\"{}\"}} {count}", status.word());
        }
        let single: [(&str, &str, &str, f64); 6] = [
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
                "kurs_rows_unwritten_total",
                "counter",
                "Rows that the files could not take.",
                self.unwritten.load(Relaxed) as f64,
            ),
        ];
        for (name, kind, help, value) in single {
            head(&mut text, name, kind, help);
            let _ = writeln!(text, "{name} {value}");
        }
        let streams = self.streams();
        type Value = fn(&StreamStatus) -> f64;
        let of_streams: [(&str, &str, &str, Value); 10] = [
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
            (
                "kurs_stream_line_load",
                "gauge",
                "Share of a serial line that is in use, mean since the start.",
                |s| {
                    let bits = s.bytes.load(Relaxed) as f64 * BITS_A_BYTE;
                    let carried = s.baud as f64 * s.began.elapsed().as_secs_f64();
                    if carried > 0.0 { bits / carried } else { 0.0 }
                },
            ),
        ];
        for (name, kind, help, value) in of_streams {
            head(&mut text, name, kind, help);
            for stream in &streams {
                let label = stream.name.replace('\\', "\\\\").replace('"', "\\\"");
                let _ = writeln!(text, "{name}{{stream=\"{label}\"}} {}", value(stream));
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
            going.note_epoch(GpsTime::default() + 1e9 + 0.1 * f64::from(tenth));
        }
        assert_eq!(going.trouble(), None);
        assert_eq!(going.epochs(), 3);
        going.began = Instant::now().checked_sub(Duration::from_secs(3)).unwrap();
        assert!(going.trouble().unwrap().starts_with("is connected, but no epoch came for 2."));
        going.note_end();
        assert_eq!(going.trouble().unwrap(), "has ended");
    }

    #[test]
    fn metrics_have_a_line_for_every_stream() {
        let status = Status::new();
        let stream = Arc::new(StreamStatus::new("a\"b".into(), None));
        stream.note_bytes(120);
        stream.note_damage(2);
        status.streams.lock().unwrap().push(stream);
        let text = status.metrics();
        for line in [
            "kurs_stream_bytes_total{stream=\"a\\\"b\"} 120",
            "kurs_stream_damaged_total{stream=\"a\\\"b\"} 2",
            "kurs_stream_line_load{stream=\"a\\\"b\"} 0",
            "kurs_rows_total{status=\"fixed\"} 0",
        ] {
            assert!(text.lines().any(|found| found == line), "{line}: {text}");
        }
    }
}
