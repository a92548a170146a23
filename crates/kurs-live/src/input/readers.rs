//! What reads the bytes of a connection: a decoder for every antenna, or what reads lines; each in
//! a thread of its own.

use std::sync::{Arc, mpsc::Sender};
use std::time::{Instant, SystemTime};

use kurs::fusion::attitude::session::ImuSample;
use kurs_formats::logs::LogOptions;
use tokio::sync::mpsc;
use tokio::task::JoinHandle;

use super::running::Running;
use super::{Event, Observer};
use crate::address::Address;
use crate::decoder::{self, Chunk, Decoding, Pace};
use crate::imu::{self, SampleLines};
use crate::intake::Intake;
use crate::lines::{self, Lines};
use crate::lock::lock;
use crate::peer::PeerLine;
use crate::record::gps_time;
use crate::status::StreamStatus;

/// Pieces that may wait for a reader before the connection is no longer read.
const MAX_CHUNKS: usize = 64;

/// The thread that reads, and how the bytes come to it.
pub(super) struct Reader {
    pub(super) chunks: mpsc::Sender<Chunk>,
    pub(super) task: JoinHandle<()>,
}

impl Reader {
    fn start(read: impl FnOnce(mpsc::Receiver<Chunk>) + Send + 'static) -> Self {
        let (chunks, receiver) = mpsc::channel(MAX_CHUNKS);
        Self { chunks, task: tokio::task::spawn_blocking(move || read(receiver)) }
    }
}

impl Running {
    /// A reader of the lines, or a decoder for every antenna of the stream.
    pub(super) fn start_readers(&self, is_marked: bool) -> Vec<Reader> {
        let pace = self.pace(is_marked);
        if let Some(lines) = &self.input.lines {
            return vec![self.start_line_reader(lines, pace)];
        }
        let antennas = self.input.antennas.iter().zip(&self.intakes);
        antennas
            .map(|((observer, name, options), intake)| {
                self.start_decoder(*observer, name, options, intake.clone(), pace.clone())
            })
            .collect()
    }

    /// How a log without time marks is played, unless it is read as fast as possible.
    fn pace(&self, is_marked: bool) -> Option<(Arc<Pace>, f64)> {
        match self.input.address {
            Address::File { speed, .. } if speed > 0.0 && !is_marked => {
                Some((Arc::clone(&self.shared.pace), speed))
            }
            _ => None,
        }
    }

    fn start_decoder(
        &self,
        observer: Observer,
        name: &str,
        options: &LogOptions,
        intake: Intake,
        pace: Option<(Arc<Pace>, f64)>,
    ) -> Reader {
        let told = *lock(&self.told_date);
        let near = told.or(*lock(&self.shared.known.time)).or(options.approximate_time);
        let near = near.unwrap_or_else(|| gps_time(SystemTime::now()));
        let decoding = Decoding {
            name: format!("{name} ({})", self.input.address),
            options: LogOptions { approximate_time: Some(near), ..*options },
            intake,
            told_date: Arc::clone(&self.told_date),
            pace,
        };
        let events = self.shared.events.clone();
        let give = move |decoded| events.send(Event::Epoch(observer, Box::new(decoded))).is_ok();
        Reader::start(move |chunks| decoder::decode(&decoding, chunks, give))
    }

    fn start_line_reader(&self, lines: &Lines, pace: Option<(Arc<Pace>, f64)>) -> Reader {
        let (intake, events) = (self.intakes[0].clone(), self.shared.events.clone());
        match (lines, &self.shared.read_samples) {
            (Lines::Peer(number, _), _) => {
                let number = *number;
                Reader::start(move |chunks| read_peer(number, chunks, &intake.status, &events))
            }
            (Lines::Imu, Some(read)) => {
                let is_unpaced = self.input.address.is_unpaced_file();
                let max_ahead = if is_unpaced { imu::MAX_AHEAD } else { usize::MAX };
                let reader = SampleReader { lines: read(), intake, pace, max_ahead, events };
                Reader::start(move |chunks| reader.read(chunks))
            }
            (Lines::Imu, None) => Reader::start(drop),
        }
    }
}

/// What reads the lines of the inertial sensor.
struct SampleReader {
    lines: Box<dyn SampleLines>,
    intake: Intake,
    pace: Option<(Arc<Pace>, f64)>,
    /// Samples that may wait for the engine.
    max_ahead: usize,
    events: Sender<Event>,
}

impl SampleReader {
    /// Samples until the connection ends.
    fn read(mut self, chunks: mpsc::Receiver<Chunk>) {
        lines::read(chunks, |line, chunk| {
            let read = line.ok_or_else(|| "no line of text".to_owned());
            match read.and_then(|line| self.lines.sample(line)) {
                Ok(None) => true,
                Ok(Some((tow_s, sample))) => self.give(tow_s, sample, chunk),
                Err(what) => {
                    self.intake.status.note_bad_line(&what);
                    true
                }
            }
        });
    }

    /// Whether it was taken.
    fn give(&self, tow_s: f64, sample: ImuSample, chunk: &Chunk) -> bool {
        if let Some((pace, speed)) = &self.pace {
            pace.wait_for_tow(tow_s, *speed);
        }
        self.intake.status.note_line(gps_time(chunk.utc).nearest_with_tow(tow_s));
        self.intake.permits.acquire(self.max_ahead);
        let arrived = if self.pace.is_some() { Instant::now() } else { chunk.arrived };
        self.events.send(Event::Sample(tow_s, Box::new(sample), arrived)).is_ok()
    }
}

/// Rows of another body until its connection ends.
fn read_peer(
    number: usize,
    chunks: mpsc::Receiver<Chunk>,
    status: &StreamStatus,
    events: &Sender<Event>,
) {
    lines::read(chunks, |line, chunk| {
        match line.ok_or_else(|| "no line of text".to_owned()).and_then(PeerLine::read) {
            Ok(line) => {
                status.note_line(Some(line.state.time));
                events.send(Event::PeerLine(number, Box::new(line), chunk.arrived)).is_ok()
            }
            Err(what) => {
                status.note_bad_line(&what);
                true
            }
        }
    });
}
