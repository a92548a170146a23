//! The thread that solves: epochs of all antennas in, in whatever order they come, rows out.

use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::atomic::Ordering::Relaxed;
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError};
use std::time::{Duration, Instant, SystemTime};

use kurs::differential::Differential;
use kurs::ephemeris::{AsReceived, NavigationData};
use kurs::observation::matcher::Matcher;
use kurs::observation::{AntennaEpoch, ArrayEpoch};
use kurs::solution::EpochSolution;
use kurs::time::GpsTime;
use kurs::turn_rate::TurnRate;
use tokio::sync::watch;

use crate::decoder::{Arrival, Decoded, Permits};
use crate::input::{Event, STATION};
use crate::output::{Message, Sink};
use crate::service::{Finish, Gga, Times};
use crate::state::StateFiles;
use crate::status::{Status, StreamStatus};

/// A consumer drops an attitude that is older than this (ArduPilot: 300 ms to 400 ms); counted from the
/// first byte of the epoch.
const EXPIRES: Duration = Duration::from_millis(300);
/// The thread wakes up at least so often, to tell that it lives.
const HEARTBEAT: Duration = Duration::from_millis(500);
/// What was received is kept on disk so often.
const SAVE_INTERVAL: Duration = Duration::from_secs(60);

/// See the module.
pub(crate) struct Estimator {
    pub(crate) engine: Differential,
    pub(crate) turn_rate: TurnRate,
    pub(crate) finish: Finish,
    pub(crate) matcher: Matcher,
    pub(crate) received: AsReceived,
    pub(crate) antennas: Vec<Antenna>,
    pub(crate) station: StationEpochs,
    /// Everything received, for a new engine and for the next start.
    pub(crate) navigation: NavigationData,
    pub(crate) status: Arc<Status>,
    pub(crate) sinks: Vec<Sink>,
    pub(crate) rows: SyncSender<EpochSolution>,
    pub(crate) gga: (watch::Sender<Option<String>>, Gga),
    pub(crate) known_time: watch::Sender<Option<GpsTime>>,
    pub(crate) state: Option<StateFiles>,
    pub(crate) saved: Instant,
    pub(crate) began: Instant,
    /// Inputs that have not ended.
    pub(crate) inputs: usize,
    pub(crate) once: bool,
    pub(crate) heartbeat: Arc<std::sync::atomic::AtomicU64>,
}

/// What is kept of one antenna.
pub(crate) struct Antenna {
    pub(crate) permits: Arc<Permits>,
    pub(crate) status: Arc<StreamStatus>,
    /// Epochs that were given by its decoder and are not done with.
    pub(crate) out: usize,
    pub(crate) arrivals: VecDeque<(GpsTime, Arrival)>,
}

/// The station's epochs: those that a row may still want.
pub(crate) struct StationEpochs {
    permits: Arc<Permits>,
    waiting: VecDeque<AntennaEpoch>,
}

impl Estimator {
    /// Runs until it is told to stop, or (once) all inputs have ended.
    pub(crate) fn run(mut self, events: &Receiver<Event>) {
        loop {
            self.heartbeat.fetch_add(1, Relaxed);
            let due_s = self.matcher.due_at_s().map_or(f64::INFINITY, |due_s| due_s - self.now_s());
            let wait = Duration::from_secs_f64(due_s.clamp(0.0, HEARTBEAT.as_secs_f64()));
            match events.recv_timeout(wait) {
                Ok(Event::Epoch { antenna: STATION, decoded }) => self.take_station(*decoded),
                Ok(Event::Epoch { antenna, decoded }) => self.take(antenna, *decoded),
                Ok(Event::Left { antenna: STATION }) | Err(RecvTimeoutError::Timeout) => {}
                Ok(Event::Left { antenna }) => self.matcher.leave(antenna),
                Ok(Event::InputEnded) => {
                    self.inputs -= 1;
                    if self.once && self.inputs == 0 {
                        break;
                    }
                }
                Ok(Event::Reload(new)) => self.replace(*new),
                Ok(Event::Stop) | Err(RecvTimeoutError::Disconnected) => break,
            }
            while let Some(epoch) = self.matcher.poll(self.now_s()) {
                self.solve(epoch);
            }
            self.return_permits();
            self.save(SAVE_INTERVAL);
        }
        while let Some(epoch) = self.matcher.flush(self.now_s()) {
            self.solve(epoch);
        }
        self.save(Duration::ZERO);
    }

    fn now_s(&self) -> f64 {
        self.began.elapsed().as_secs_f64()
    }

    fn take(&mut self, antenna: usize, decoded: Decoded) {
        let Decoded { epoch, news, arrival } = decoded;
        self.received.hold(antenna, epoch.time, news);
        let of = &mut self.antennas[antenna];
        of.out += 1;
        of.arrivals.push_back((epoch.time, arrival));
        if let Some(complete) = self.matcher.push(antenna, epoch, self.now_s()) {
            self.solve(complete);
        }
    }

    fn take_station(&mut self, decoded: Decoded) {
        /// A station that is ahead of all antennas must not gather.
        const MAX_WAITING: usize = 64;
        let number = self.antennas.len();
        self.received.hold(number, decoded.epoch.time, decoded.news);
        let waiting = &mut self.station.waiting;
        if waiting.len() == MAX_WAITING {
            waiting.pop_front();
        }
        waiting.push_back(decoded.epoch);
        self.station.permits.release(1);
    }

    fn solve(&mut self, mut epoch: ArrayEpoch) {
        epoch.station = self.station.at(epoch.time, self.matcher.window_s());
        for news in self.received.release(&epoch) {
            self.engine.insert(&news);
            self.navigation.update(&news);
        }
        let mut row = self.engine.push(&epoch, None);
        (self.finish)(&epoch, &mut row);
        let times = self.times(&epoch);
        self.send(row, times);
    }

    /// When the bytes of the epoch came.
    fn times(&mut self, epoch: &ArrayEpoch) -> Times {
        let mut arrivals: Vec<Arrival> = Vec::new();
        for (of, antenna) in self.antennas.iter_mut().zip(&epoch.antennas) {
            let Some(antenna) = antenna else { continue };
            while let Some((time, arrival)) =
                of.arrivals.pop_front_if(|(time, _)| *time <= antenna.time)
            {
                if time == antenna.time {
                    arrivals.push(arrival);
                }
            }
        }
        let now = Arrival::now();
        Times {
            first_byte: arrivals.iter().map(|a| a.first_byte).min().unwrap_or(now.first_byte),
            last_byte: arrivals.iter().map(|a| a.last_byte).max().unwrap_or(now.last_byte),
            last_byte_utc: arrivals
                .iter()
                .map(|a| a.last_byte_utc)
                .max()
                .unwrap_or(now.last_byte_utc),
            row_out: Instant::now(),
            row_out_utc: SystemTime::now(),
        }
    }

    fn send(&mut self, row: EpochSolution, times: Times) {
        self.status.note_row(&row);
        self.status.in_to_out.add(times.row_out - times.last_byte);
        self.status.first_to_out.add(times.row_out - times.first_byte);
        let _ = self.known_time.send_replace(Some(row.time));
        if let Some(gga) = (self.gga.1)(&row) {
            let _ = self.gga.0.send_replace(Some(gga));
        }
        // Of every row, though an output may not have every row.
        let rates = self.turn_rate.push(&row);
        let expires = (!self.once).then(|| times.first_byte + EXPIRES);
        for sink in &mut self.sinks {
            let Some(bytes) = sink.encode(&row, &rates, &times) else { continue };
            if expires.is_some_and(|expires| Instant::now() > expires) {
                self.status.expired.fetch_add(1, Relaxed);
                continue;
            }
            sink.send(Message { bytes: bytes.into(), expires });
        }
        if let Some(state) = &mut self.state {
            state.note(&row);
        }
        // A run over files waits for the disk; a live one goes on.
        let unwritten = match self.once {
            true => self.rows.send(row).is_err(),
            false => matches!(self.rows.try_send(row), Err(TrySendError::Full(_))),
        };
        self.status.unwritten.fetch_add(u64::from(unwritten), Relaxed);
    }

    /// Decoders may go on as far as their epochs are done with.
    fn return_permits(&mut self) {
        for (number, antenna) in self.antennas.iter_mut().enumerate() {
            let waiting = self.matcher.waiting(number);
            antenna.permits.release(antenna.out - waiting);
            antenna.out = waiting;
            antenna.status.late.store(self.matcher.late(number), Relaxed);
            antenna.status.strays.store(self.matcher.strays(number), Relaxed);
            // Of epochs that were dropped.
            while antenna.arrivals.len() > waiting + 1 {
                antenna.arrivals.pop_front();
            }
        }
    }

    fn save(&mut self, interval: Duration) {
        let Some(state) = &mut self.state else { return };
        if self.saved.elapsed() >= interval {
            self.saved = Instant::now();
            state.save(&self.navigation);
        }
    }

    fn replace(&mut self, new: crate::service::NewEngine) {
        match (new.make)(self.navigation.clone()) {
            Ok(engine) => {
                self.engine = engine;
                tracing::info!("the configuration was read again");
            }
            Err(what) => tracing::error!("the configuration was read again, but refused: {what}"),
        }
    }
}

impl StationEpochs {
    /// None yet.
    pub(crate) fn new(permits: Arc<Permits>) -> Self {
        Self { permits, waiting: VecDeque::new() }
    }

    /// The station's epoch of the same time; older ones are forgotten.
    fn at(&mut self, time: GpsTime, window_s: f64) -> Option<AntennaEpoch> {
        while self.waiting.pop_front_if(|epoch| epoch.time - time <= -window_s).is_some() {}
        self.waiting.pop_front_if(|epoch| epoch.time - time < window_s)
    }
}
