//! What the service knows of itself: counts, latencies, and whether all is well.

mod latency;
mod line_load;
mod metrics;
mod stream;

use std::sync::atomic::{AtomicI64, AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Mutex};
use std::time::Instant;

use kurs::solution::{EpochSolution, Status as RowStatus};

use crate::lock::lock;
use crate::peer::RelativeRow;
use crate::setup::Times;
use crate::trouble::Trouble;
use latency::Histogram;
pub(crate) use stream::{Brings, StreamStatus, StreamView};

/// One output.
#[derive(Debug)]
pub(crate) struct OutputStatus {
    /// With the way to its readers.
    pub(crate) way: Trouble,
    /// With the age of its messages.
    pub(crate) age: Trouble,
}

/// Everything together.
#[derive(Debug)]
pub(crate) struct Status {
    outputs: Mutex<Vec<Arc<OutputStatus>>>,
    streams: Mutex<Vec<Arc<StreamStatus>>>,
    rows: [AtomicU64; RowStatus::ALL.len()],
    satellites: AtomicU64,
    last_row_ms: AtomicI64,
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
    /// How much older than the last row the station's epoch in it is, s: the bits of an `f64`, NaN
    /// without one.
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
        lock(&self.outputs).push(Arc::clone(&output));
        output
    }

    /// All streams that are shown, in their order.
    pub(crate) fn set_streams(&self, streams: Vec<Arc<StreamStatus>>) {
        *lock(&self.streams) = streams;
    }

    pub(crate) fn note_relative(&self, rows: Vec<RelativeRow>) {
        *lock(&self.relative) = rows;
    }

    /// The other bodies at the last row.
    pub(crate) fn relative(&self) -> Vec<RelativeRow> {
        lock(&self.relative).clone()
    }

    pub(crate) fn note_station(&self, age_s: Option<f64>) {
        self.station_age_s.store(age_s.unwrap_or(f64::NAN).to_bits(), Relaxed);
    }

    /// A row leaves.
    pub(crate) fn note_row(&self, row: &EpochSolution, times: &Times) {
        self.in_to_out.add(times.row_out - times.last_byte);
        self.first_to_out.add(times.row_out - times.first_byte);
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
        lock(&self.streams).clone()
    }

    /// What is wrong, a line each; nothing if all is well.
    pub(crate) fn troubles(&self) -> Vec<String> {
        let mut streams = self.streams();
        streams.retain(|stream| !stream.is_peer());
        let of_streams = streams.iter().filter_map(|stream| {
            stream.trouble().map(|trouble| format!("{} {trouble}", stream.name()))
        });
        let mut troubles: Vec<String> = of_streams.collect();
        let longest_s = streams.iter().map(|stream| stream.interval_s()).fold(0.0, f64::max);
        if self.row_age_s() > stream::silent_after_s(longest_s) {
            troubles.push(format!("no row for {:.1} s", self.row_age_s()));
        }
        let outputs = lock(&self.outputs);
        troubles.extend(
            outputs.iter().flat_map(|output| [&output.way, &output.age]).filter_map(Trouble::text),
        );
        troubles
    }
}
