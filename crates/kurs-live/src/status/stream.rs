//! What is known of one stream: what came, when, and what is wrong with it.

use std::collections::BTreeMap;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicI64, AtomicU64, Ordering::Relaxed};
use std::time::Instant;

use kurs::observation::AntennaEpoch;
use kurs::observation::interference::{Interference, Jamming, Spoofing};
use kurs::signal::Band;
use kurs::time::GpsTime;

use super::line_load::LineLoad;
use crate::band_level::BandLevel;
use crate::lock::lock;
use crate::trouble::Trouble;

/// A stream is silent after this many of its intervals without an epoch …
const SILENT_INTERVALS: f64 = 3.0;
/// … but not before so many seconds, so that one scheduling hiccup at 100 Hz raises no alarm.
const MIN_SILENT_S: f64 = 0.5;
/// While its interval is not known, and before its first epoch, s.
const UNKNOWN_SILENT_S: f64 = 5.0;
/// Epochs are missing if the next one comes later than this many intervals.
const GAP_INTERVALS: f64 = 1.5;
/// Times between epochs from here on are not the interval of a receiver, s.
const MAX_INTERVAL_S: f64 = 100.0;
/// A line that carries more than this has no room for a longer epoch.
const HIGH_LOAD: f64 = 0.9;
/// An antenna is late when so many of its epochs in a row miss their rows: single ones are hiccups
/// of a network.
const LATE_IN_A_ROW: u32 = 5;
/// A stream that is older by the system's clock is a recording, or the clock is wrong, s.
const MAX_AGE_S: f64 = 1000.0;

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
    /// Bits a second of a serial line; 0 for other streams.
    baud: u64,
    began: Instant,
    bytes: AtomicU64,
    load: Mutex<LineLoad>,
    epochs: AtomicU64,
    damaged: AtomicU64,
    errors: AtomicU64,
    connections: AtomicU64,
    pub(crate) late: AtomicU64,
    pub(crate) strays: AtomicU64,
    connected: AtomicBool,
    ended: AtomicBool,
    /// When the last epoch came, ms after `began` (−1: none), and its time tag, ns.
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
    /// Errors as the log has them.
    errors_told: Trouble,
    lateness: Mutex<Lateness>,
    /// With the place of a station.
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
            bytes: AtomicU64::default(),
            load: Mutex::default(),
            epochs: AtomicU64::default(),
            damaged: AtomicU64::default(),
            errors: AtomicU64::default(),
            connections: AtomicU64::default(),
            late: AtomicU64::default(),
            strays: AtomicU64::default(),
            connected: AtomicBool::default(),
            ended: AtomicBool::default(),
            last_ms: AtomicI64::new(-1),
            last_time_ns: AtomicI64::default(),
            interval_ns: AtomicI64::default(),
            gaps: AtomicU64::default(),
            gaps_ns: AtomicU64::default(),
            bands: Mutex::default(),
            interference: Mutex::default(),
            age_ns: AtomicI64::new(i64::MAX),
            last_error: Mutex::default(),
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
        let mut load = lock(&self.load);
        let was_high = load.share > HIGH_LOAD;
        if let Some(share) = load.add(now_s, count as u64, self.baud)
            && share > HIGH_LOAD
            && !was_high
        {
            let (baud, percent) = (self.baud, (100.0 * share).round());
            tracing::warn!(stream = self.name, "{baud} baud carry {percent} % of what they can");
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
        self.note_bands(epoch);
        *lock(&self.interference) = epoch.interference;
    }

    fn note_bands(&self, epoch: &AntennaEpoch) {
        let mut sums: BTreeMap<Band, (f64, u32)> = BTreeMap::new();
        for observation in &epoch.observations {
            let Some(cn0_dbhz) = observation.cn0_dbhz else { continue };
            let (sum, count) = sums.entry(observation.signal.band).or_default();
            (*sum, *count) = (*sum + cn0_dbhz, *count + 1);
        }
        let mut levels = lock(&self.bands);
        let before = core::mem::take(&mut *levels);
        let after = sums.into_iter().map(|(band, (sum, count))| {
            let cn0_dbhz = sum / f64::from(count);
            (band, BandLevel::after(before.get(&band), band, cn0_dbhz, epoch.time))
        });
        *levels = after.collect();
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
        let age_s = self.age_ns.load(Relaxed) as f64 * 1e-9;
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
            interval_s: self.interval_s(),
            age_s: (age_s.abs() < MAX_AGE_S).then_some(age_s),
            baud: (self.baud > 0).then_some(self.baud),
            line_load: (self.baud > 0).then(|| lock(&self.load).share),
            last_error: lock(&self.last_error).clone(),
            bands: lock(&self.bands).values().copied().collect(),
            interference: *lock(&self.interference),
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

    /// Whether it is that of another body.
    pub(super) fn is_peer(&self) -> bool {
        self.brings == Brings::Peer
    }

    /// Shortest time between two epochs, s; 0 while it is not known.
    pub(super) fn interval_s(&self) -> f64 {
        self.interval_ns.load(Relaxed) as f64 * 1e-9
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
        what.clone_into(&mut lock(&self.last_error));
    }

    /// An epoch came so much later than those of the others that it missed its row, or in time
    /// (`None`).
    pub(crate) fn note_lateness(&self, late_s: Option<f64>) {
        let mut lateness = lock(&self.lateness);
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

    /// Why the stream does not bring what it should, in words; `None` if it does.
    pub(crate) fn trouble(&self) -> Option<String> {
        let error = lock(&self.last_error);
        if self.ended.load(Relaxed) {
            let why = if error.is_empty() { String::new() } else { format!(": {error}") };
            return Some(format!("has ended{why}"));
        }
        let last_ms = self.last_ms.load(Relaxed);
        let silent_s = (self.now_ms() - last_ms.max(0)) as f64 * 1e-3;
        if silent_s <= silent_after_s(self.interval_s()) {
            let lateness = lock(&self.lateness);
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

/// How long a stream with this interval (0: not known) may say nothing, s.
pub(super) fn silent_after_s(interval_s: f64) -> f64 {
    match interval_s > 0.0 {
        true => (SILENT_INTERVALS * interval_s).max(MIN_SILENT_S),
        false => UNKNOWN_SILENT_S,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    fn epoch(second: f64) -> AntennaEpoch {
        AntennaEpoch { time: GpsTime::default() + (1e9 + second), ..AntennaEpoch::default() }
    }

    /// A stream with an interval of 0.1 s is silent after half a second, one without any epoch
    /// after five.
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

    /// Single late epochs are nothing; a stretch of them is named with how late they are, until one
    /// is in time.
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
}
