//! The thread that solves: epochs of all antennas in, in whatever order they come, rows out.

use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::atomic::Ordering::Relaxed;
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError};
use std::time::{Duration, Instant, SystemTime};

use kurs::differential::Differential;
use kurs::ephemeris::{AsReceived, NavigationData};
use kurs::frames::{Ecef, Vector};
use kurs::observation::matcher::Matcher;
use kurs::observation::{AntennaEpoch, ArrayEpoch};
use kurs::solution::EpochSolution;
use kurs::time::GpsTime;
use kurs::turn_rate::TurnRate;
use tokio::sync::watch;

use crate::decoder::{Arrival, Decoded, Permits};
use crate::imu::Carrier;
use crate::input::{Event, STATION};
use crate::output::{Message, Sink};
use crate::page::Hub;
use crate::peer::Peers;
use crate::service::{Finish, ForFiles, Gga, Times};
use crate::state::StateFiles;
use crate::station_place::StationPlace;
use crate::status::{Status, StreamStatus};

/// A consumer drops an attitude that is older than this (ArduPilot: 300 ms to 400 ms); counted from the
/// first byte of the epoch.
pub(crate) const EXPIRES: Duration = Duration::from_millis(300);
/// The thread wakes up at least so often, to tell that it lives.
const HEARTBEAT: Duration = Duration::from_millis(500);
/// Tags of receivers with one clock are equal to better than this, ns.
const ONE_CLOCK_NS: u64 = 1000;

/// See the module.
pub(crate) struct Estimator {
    pub(crate) engine: Differential,
    /// The inertial sensor's part.
    pub(crate) carrier: Option<Carrier>,
    pub(crate) peers: Option<Peers>,
    pub(crate) turn_rate: TurnRate,
    pub(crate) finish: Finish,
    pub(crate) matcher: Matcher,
    /// Complete, but for the station's epoch.
    pub(crate) complete: VecDeque<ArrayEpoch>,
    /// The newest epoch of any antenna, and when it was there.
    pub(crate) newest: Option<(GpsTime, Instant)>,
    pub(crate) received: AsReceived,
    pub(crate) antennas: Vec<Antenna>,
    pub(crate) station: StationEpochs,
    pub(crate) station_place: StationPlace,
    /// All antennas have one clock.
    pub(crate) common_clock: bool,
    /// Everything received, for a new engine and for the next start.
    pub(crate) navigation: NavigationData,
    pub(crate) status: Arc<Status>,
    pub(crate) sinks: Vec<Sink>,
    pub(crate) page: Option<Arc<Hub>>,
    pub(crate) rows: SyncSender<ForFiles>,
    pub(crate) gga: (watch::Sender<Option<String>>, Gga),
    pub(crate) known_time: watch::Sender<Option<GpsTime>>,
    pub(crate) state: Option<StateFiles>,
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
    /// An older epoch serves until it is this old, s.
    max_age_s: f64,
    /// Rows wait for it: all logs are read as fast as possible.
    is_awaited: bool,
    has_left: bool,
}

impl Estimator {
    /// Runs until it is told to stop, or (once) all inputs have ended.
    pub(crate) fn run(mut self, events: &Receiver<Event>) {
        loop {
            self.heartbeat.fetch_add(1, Relaxed);
            let due_s = self.matcher.due_at_s().map_or(f64::INFINITY, |due_s| due_s - self.now_s());
            let wait = Duration::from_secs_f64(due_s.clamp(0.0, HEARTBEAT.as_secs_f64()));
            let carrier_due =
                self.carrier.as_ref().and_then(|carrier| carrier.due(!self.complete.is_empty()));
            let wait = carrier_due
                .map_or(wait, |due| wait.min(due.saturating_duration_since(Instant::now())));
            let peers_due = self.peers.as_ref().and_then(Peers::due);
            let wait = peers_due
                .map_or(wait, |due| wait.min(due.saturating_duration_since(Instant::now())));
            match events.recv_timeout(wait) {
                Ok(Event::Epoch { antenna: STATION, decoded }) => self.take_station(*decoded),
                Ok(Event::Epoch { antenna, decoded }) => self.take(antenna, *decoded),
                Ok(Event::Left { antenna: STATION }) => {
                    self.station.has_left = true;
                    self.station_place.leave();
                }
                Err(RecvTimeoutError::Timeout) => {}
                Ok(Event::Left { antenna }) => self.matcher.leave(antenna),
                Ok(Event::Sample(tow_s, sample, arrived)) => {
                    if let Some(carrier) = &mut self.carrier {
                        carrier.push_sample(tow_s, *sample, arrived);
                    }
                }
                Ok(Event::ImuLeft) => self.carrier.iter_mut().for_each(Carrier::leave),
                Ok(Event::PeerLine(number, line, arrived)) => {
                    if let Some(peers) = &mut self.peers {
                        peers.push(number, *line, arrived);
                    }
                }
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
                self.complete(epoch);
            }
            let window_s = self.matcher.window_s();
            while let Some(epoch) = self.complete.pop_front_if(|epoch| {
                let carrier = self.carrier.as_mut();
                self.station.is_ready(epoch.time, window_s)
                    && carrier.is_none_or(|carrier| carrier.is_ready(epoch.time))
            }) {
                self.solve(epoch);
            }
            if self.complete.is_empty() {
                self.carrier.iter_mut().for_each(Carrier::advance);
            }
            self.send_carried();
            self.send_relative(Instant::now());
            self.return_permits();
            self.state.iter_mut().for_each(|state| state.save(&self.navigation));
        }
        while let Some(epoch) = self.matcher.flush(self.now_s()) {
            self.complete(epoch);
        }
        while let Some(epoch) = self.complete.pop_front() {
            self.solve(epoch);
        }
        self.carrier.iter_mut().for_each(Carrier::finish);
        self.send_carried();
        while let Some(due) = self.peers.as_ref().and_then(Peers::due) {
            self.send_relative(due);
        }
        if let Some(state) = self.state {
            state.finish(self.navigation);
        }
    }

    fn now_s(&self) -> f64 {
        self.began.elapsed().as_secs_f64()
    }

    fn take(&mut self, antenna: usize, decoded: Decoded) {
        let Decoded { epoch, news, arrival, .. } = decoded;
        self.received.hold(antenna, epoch.time, news);
        let of = &mut self.antennas[antenna];
        of.out += 1;
        of.arrivals.push_back((epoch.time, arrival));
        let (time, late) = (epoch.time, self.matcher.late(antenna));
        let complete = self.matcher.push(antenna, epoch, self.now_s());
        self.note_lateness(antenna, time, self.matcher.late(antenna) > late);
        complete.into_iter().for_each(|epoch| self.complete(epoch));
    }

    /// An epoch is late by what it is older than the newest one, and by the time that has passed since that.
    fn note_lateness(&mut self, antenna: usize, time: GpsTime, is_late: bool) {
        /// Of what was newest before that, nothing may be left, as behind a clock that was set back.
        const FORGOTTEN: Duration = Duration::from_secs(5);
        let late_s = self
            .newest
            .filter(|_| is_late)
            .map(|(newest, at)| ((newest - time) + at.elapsed().as_secs_f64()).max(0.0));
        self.antennas[antenna].status.note_lateness(late_s);
        let is_newest =
            self.newest.is_none_or(|(newest, at)| time > newest || at.elapsed() > FORGOTTEN);
        if is_newest && !is_late {
            self.newest = Some((time, Instant::now()));
        }
    }

    fn complete(&mut self, epoch: ArrayEpoch) {
        if let Some(carrier) = &mut self.carrier {
            carrier.note_epoch(epoch.time, self.matcher.interval_s());
        }
        self.complete.push_back(epoch);
    }

    fn take_station(&mut self, decoded: Decoded) {
        let number = self.antennas.len();
        self.received.hold(number, decoded.epoch.time, decoded.news);
        if let Some(place_m) = self.station_place.take(decoded.place_m) {
            // What waits was observed at another place.
            self.station.forget();
            self.put_station(place_m);
        }
        self.station.take(decoded.epoch);
    }

    fn put_station(&mut self, place_m: Vector<Ecef>) {
        if let Err(error) = self.engine.put_station(place_m) {
            tracing::error!("the station cannot be used: {error}");
        }
    }

    fn solve(&mut self, mut epoch: ArrayEpoch) {
        let observed = self.station.at(epoch.time, self.matcher.window_s());
        epoch.station = observed.filter(|_| self.station_place.is_known());
        let station_age_s = epoch.station.as_ref().map(|station| epoch.time - station.time);
        self.status.note_station(station_age_s);
        self.check_clocks(&epoch);
        for news in self.received.release(&epoch) {
            self.engine.insert(&news);
            self.navigation.update(&news);
            self.state.iter_mut().for_each(|state| state.note_news(&news));
        }
        let mut row = match &mut self.carrier {
            None => self.engine.push(&epoch, None),
            Some(carrier) => carrier.solve(&epoch, &mut self.engine),
        };
        (self.finish)(&epoch, &mut row);
        let times = Times { station_age_s, ..self.times(&epoch) };
        if let Some(page) = &self.page {
            page.see(&epoch, &row);
        }
        match &mut self.carrier {
            None => self.send(row, times),
            Some(carrier) => {
                carrier.take(row, times);
                self.send_carried();
            }
        }
    }

    /// Rows that the filter is done with.
    fn send_carried(&mut self) {
        while let Some((row, times)) = self.carrier.as_mut().and_then(Carrier::next_row) {
            self.send(row, times);
        }
    }

    /// Reports tags that one clock cannot have given.
    fn check_clocks(&self, epoch: &ArrayEpoch) {
        let tags_ns = epoch.antennas.iter().flatten().map(|antenna| antenna.time.as_nanoseconds());
        let (first_ns, last_ns) = (tags_ns.clone().min(), tags_ns.max());
        let spread_ns = first_ns.zip(last_ns).map_or(0, |(first, last)| last.abs_diff(first));
        if self.common_clock && spread_ns > ONE_CLOCK_NS {
            let count = self.status.clocks_apart.fetch_add(1, Relaxed);
            if count == 0 {
                let apart_us = spread_ns as f64 * 1e-3;
                tracing::warn!(%epoch.time, apart_us, "tags differ though the antennas have one clock");
            }
        }
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
            station_age_s: None,
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
                sink.note_expired();
                continue;
            }
            sink.send(Message { bytes: bytes.into(), expires });
        }
        if let Some(page) = &self.page {
            page.note(&row, &rates, &times);
        }
        if let Some(peers) = &mut self.peers {
            peers.push_own(&row, &rates, expires);
        }
        if let Some(state) = &mut self.state {
            state.note(&row);
        }
        self.write(ForFiles::Row(Box::new(row)));
    }

    /// The other bodies at rows that need not wait for them any longer.
    fn send_relative(&mut self, now: Instant) {
        while let Some(rows) = self.peers.as_mut().and_then(|peers| peers.next_rows(now)) {
            self.status.note_relative(rows.clone());
            self.write(ForFiles::Relative(rows));
        }
    }

    /// A run over files waits for the disk; a live one goes on.
    fn write(&self, rows: ForFiles) {
        let unwritten = match self.once {
            true => self.rows.send(rows).is_err(),
            false => matches!(self.rows.try_send(rows), Err(TrySendError::Full(_))),
        };
        self.status.unwritten.fetch_add(u64::from(unwritten), Relaxed);
    }

    /// Decoders may go on as far as their epochs are done with.
    fn return_permits(&mut self) {
        for (number, antenna) in self.antennas.iter_mut().enumerate() {
            let of_complete = self.complete.iter().filter(|e| e.antennas[number].is_some()).count();
            let waiting = self.matcher.waiting(number) + of_complete;
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

    fn replace(&mut self, new: crate::service::NewEngine) {
        match (new.make)(self.navigation.clone()) {
            Ok(engine) => {
                self.engine = engine;
                if let Some(place_m) = self.station_place.replace(self.engine.station_m()) {
                    self.put_station(place_m);
                }
                tracing::info!("the configuration was read again");
            }
            Err(what) => tracing::error!("the configuration was read again, but refused: {what}"),
        }
    }
}

impl StationEpochs {
    /// None yet.
    pub(crate) fn new(permits: Arc<Permits>, max_age_s: f64, is_awaited: bool) -> Self {
        let waiting = VecDeque::new();
        Self { permits, waiting, max_age_s, is_awaited, has_left: false }
    }

    fn take(&mut self, epoch: AntennaEpoch) {
        /// A station that is ahead of all antennas must not gather.
        const MAX_WAITING: usize = 64;
        self.has_left = false;
        self.waiting.push_back(epoch);
        if !self.is_awaited {
            self.permits.release(1);
            if self.waiting.len() > MAX_WAITING {
                self.waiting.pop_front();
            }
        }
    }

    /// None of those that wait serves any more.
    fn forget(&mut self) {
        if self.is_awaited {
            self.permits.release(self.waiting.len());
        }
        self.waiting.clear();
    }

    /// Whether a row of this time need not wait.
    fn is_ready(&self, time: GpsTime, window_s: f64) -> bool {
        let is_there = self.waiting.back().is_some_and(|newest| newest.time - time > -window_s);
        !self.is_awaited || self.has_left || is_there
    }

    /// The station's epoch of this time, or the newest before; still older ones are forgotten.
    fn at(&mut self, time: GpsTime, window_s: f64) -> Option<AntennaEpoch> {
        while self.waiting.get(1).is_some_and(|next| next.time - time < window_s) {
            self.waiting.pop_front();
            if self.is_awaited {
                self.permits.release(1);
            }
        }
        let serves = |epoch: &&AntennaEpoch| {
            let age_s = time - epoch.time;
            age_s > -window_s && (age_s < window_s || age_s <= self.max_age_s)
        };
        self.waiting.front().filter(serves).cloned()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_station_serves_until_it_is_too_old() {
        let at = |second: f64| GpsTime::default() + (1e9 + second);
        let mut station = StationEpochs::new(Arc::default(), 2.5, false);
        let mut age_s = |new: Option<f64>, row: f64| {
            let new =
                new.map(|second| AntennaEpoch { time: at(second), ..AntennaEpoch::default() });
            station.waiting.extend(new);
            station.at(at(row), 0.025).map(|epoch| at(row) - epoch.time)
        };
        assert_eq!(age_s(None, 0.0), None);
        assert_eq!(age_s(Some(5.0), 4.95), None, "of the future");
        assert_eq!(age_s(None, 5.0), Some(0.0));
        assert_eq!(age_s(None, 5.5), Some(0.5));
        assert_eq!(age_s(Some(6.0), 7.5), Some(1.5));
        assert_eq!(age_s(None, 8.5), Some(2.5));
        assert_eq!(age_s(None, 8.55), None, "too old");
        assert_eq!(age_s(Some(7.0), 8.55), Some(1.55));
    }
}
