//! Bytes of one connection to epochs of one antenna, in a thread of its own: a new decoder for
//! every connection, so that nothing of a broken one can stick.

use std::collections::VecDeque;
use std::io::{self, Read};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant, SystemTime};

use kurs::ephemeris::NavigationData;
use kurs::frames::{Ecef, Vector};
use kurs::observation::AntennaEpoch;
use kurs::time::GpsTime;
use kurs_formats::logs::{LogOptions, LogReader};
use kurs_formats::source::Source;
use tokio::sync::mpsc;

use crate::intake::Intake;
use crate::lock::lock;
use crate::record::gps_time;

/// Epochs of an antenna that may wait for the others; a receiver that is this far ahead waits.
const MAX_AHEAD: usize = 16;

/// Bytes as they came in.
#[derive(Debug, Clone)]
pub(crate) struct Chunk {
    pub(crate) bytes: Arc<[u8]>,
    pub(crate) arrived: Instant,
    pub(crate) utc: SystemTime,
}

/// When the bytes of an epoch came in.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Arrival {
    pub(crate) first_byte: Instant,
    pub(crate) last_byte: Instant,
    pub(crate) last_byte_utc: SystemTime,
}

/// What a decoder tells.
#[derive(Debug)]
pub(crate) struct Decoded {
    pub(crate) epoch: AntennaEpoch,
    pub(crate) news: NavigationData,
    pub(crate) arrival: Arrival,
    /// Where a station in the stream says that it is.
    pub(crate) place_m: Option<Vector<Ecef>>,
}

/// Plays a log that has no time marks at the pace of its epochs; one for all streams, so that they
/// stay together.
#[derive(Debug, Default)]
pub(crate) struct Pace {
    start: Mutex<Option<(Instant, GpsTime)>>,
}

impl Pace {
    fn wait(&self, time: GpsTime, speed: f64) {
        let mut start = lock(&self.start);
        let (began, first) = *start.get_or_insert((Instant::now(), time));
        drop(start);
        Self::sleep(began, (time - first) / speed);
    }

    /// For a log that has no week: it begins with the first epoch of another one.
    pub(crate) fn wait_for_tow(&self, tow_s: f64, speed: f64) {
        const LOOK_AGAIN: Duration = Duration::from_millis(10);
        let start = || *lock(&self.start);
        let (began, first) = loop {
            match start() {
                Some(start) => break start,
                None => std::thread::sleep(LOOK_AGAIN),
            }
        };
        if let Some(time) = first.nearest_with_tow(tow_s) {
            Self::sleep(began, (time - first) / speed);
        }
    }

    fn sleep(began: Instant, due_s: f64) {
        let left_s = due_s - began.elapsed().as_secs_f64();
        if left_s > 0.0 {
            std::thread::sleep(Duration::from_secs_f64(left_s));
        }
    }
}

/// What a decoder needs to know.
pub(crate) struct Decoding {
    pub(crate) name: String,
    pub(crate) options: LogOptions,
    pub(crate) intake: Intake,
    /// Where the next decoder finds the date that ephemerides told.
    pub(crate) told_date: Arc<Mutex<Option<GpsTime>>>,
    /// Pace and speed of a log without time marks.
    pub(crate) pace: Option<(Arc<Pace>, f64)>,
}

/// Decodes until the chunks end, or nothing takes the epochs any more.
pub(crate) fn decode(
    decoding: &Decoding,
    chunks: mpsc::Receiver<Chunk>,
    mut give: impl FnMut(Decoded) -> bool,
) {
    let status = &decoding.intake.status;
    let arrivals = Arrivals::default();
    let reader =
        ChunkReader { chunks, current: Arc::from([]), at: 0, read: 0, arrivals: arrivals.clone() };
    let result = Source::new(reader, decoding.name.clone())
        .and_then(|source| LogReader::of_stream(source, &decoding.options));
    let mut reader = match result {
        Ok(reader) => reader,
        Err(error) => {
            if arrivals.any() {
                status.note_error(&error.to_string());
            }
            return;
        }
    };
    let mut damaged = 0;
    loop {
        let mut epoch = AntennaEpoch::default();
        let more = reader.next_epoch(&mut epoch);
        if reader.damage_count() > damaged {
            let what = reader.damage().last().map_or("", |damage| damage.what.as_ref());
            tracing::debug!(stream = decoding.name, what, "damaged");
            status.note_damage(reader.damage_count() - damaged);
            damaged = reader.damage_count();
        }
        match more {
            Ok(true) => {}
            Ok(false) => return,
            Err(error) => {
                if let Some(date) = reader.told_date() {
                    *lock(&decoding.told_date) = Some(date);
                }
                return status.note_error(&error.to_string());
            }
        }
        if let Some((pace, speed)) = &decoding.pace {
            pace.wait(epoch.time, *speed);
        }
        let paced = decoding.pace.is_some();
        let arrival = if paced { Arrival::now() } else { arrivals.of_epoch(reader.begun_at()) };
        status.note_epoch(&epoch);
        status.note_age(gps_time(arrival.last_byte_utc) - epoch.time);
        decoding.intake.permits.acquire(MAX_AHEAD);
        let news = reader.take_news();
        let place_m = reader.place_m();
        if !give(Decoded { epoch, news, arrival, place_m }) {
            return;
        }
    }
}

impl Arrival {
    pub(crate) fn now() -> Self {
        let now = Instant::now();
        Self { first_byte: now, last_byte: now, last_byte_utc: SystemTime::now() }
    }
}

/// Where the chunks end in the stream, and when they came.
#[derive(Debug, Clone, Default)]
struct Arrivals(Arc<Mutex<VecDeque<(u64, Instant, SystemTime)>>>);

impl Arrivals {
    fn any(&self) -> bool {
        !lock(&self.0).is_empty()
    }

    fn add(&self, end: u64, chunk: &Chunk) {
        let mut list = lock(&self.0);
        // Bytes that make no epoch must not gather.
        const MAX_CHUNKS: usize = 4096;
        if list.len() >= MAX_CHUNKS {
            list.pop_front();
        }
        list.push_back((end, chunk.arrived, chunk.utc));
    }

    /// When the epoch came whose first message begins at this offset, and whose last byte is the
    /// last that was read.
    fn of_epoch(&self, begun_at: u64) -> Arrival {
        let mut list = lock(&self.0);
        while list.len() > 1 && list.front().is_some_and(|(end, ..)| *end <= begun_at) {
            list.pop_front();
        }
        match (list.front(), list.back()) {
            (Some((_, first_byte, _)), Some((_, last_byte, utc))) => {
                Arrival { first_byte: *first_byte, last_byte: *last_byte, last_byte_utc: *utc }
            }
            _ => Arrival::now(),
        }
    }
}

/// The chunks as one stream; reading waits for the next one.
struct ChunkReader {
    chunks: mpsc::Receiver<Chunk>,
    current: Arc<[u8]>,
    at: usize,
    read: u64,
    arrivals: Arrivals,
}

impl Read for ChunkReader {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        while self.at == self.current.len() {
            let Some(chunk) = self.chunks.blocking_recv() else { return Ok(0) };
            self.read += chunk.bytes.len() as u64;
            self.arrivals.add(self.read, &chunk);
            (self.current, self.at) = (chunk.bytes, 0);
        }
        let count = (&self.current[self.at..]).read(out)?;
        self.at += count;
        Ok(count)
    }
}
