//! The thread that solves: epochs of all antennas in, in whatever order they come, rows out.

use std::collections::VecDeque;
use std::ops::ControlFlow;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::time::{Duration, Instant, SystemTime};

use kurs::differential::Differential;
use kurs::ephemeris::{AsReceived, NavigationData};
use kurs::frames::{Ecef, Vector};
use kurs::observation::ArrayEpoch;
use kurs::observation::matcher::Matcher;
use kurs::solution::EpochSolution;
use kurs::time::GpsTime;

use crate::decoder::{Arrival, Decoded};
use crate::imu::Carrier;
use crate::input::{Event, Observer};
use crate::intake::Intake;
use crate::outlets::Outlets;
use crate::setup::{Finish, MakeEngine, Times};
use crate::state::StateFiles;
use crate::station_epochs::StationEpochs;
use crate::station_place::StationPlace;
use crate::status::Status;

/// The thread wakes up at least so often, to tell that it lives.
const HEARTBEAT: Duration = Duration::from_millis(500);
/// Tags of receivers with one clock are equal to better than this, ns.
const ONE_CLOCK_NS: u64 = 1000;

/// See the module.
pub(crate) struct Solver {
    pub(crate) engine: Differential,
    /// The inertial sensor's part.
    pub(crate) carrier: Option<Carrier>,
    pub(crate) finish: Finish,
    pub(crate) matcher: Matcher,
    /// Epochs that are complete, but for the station's.
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
    pub(crate) outlets: Outlets,
    pub(crate) state: Option<StateFiles>,
    pub(crate) began: Instant,
    /// Inputs that have not ended.
    pub(crate) inputs: usize,
    /// Ends with the last input.
    pub(crate) once: bool,
    pub(crate) heartbeat: Arc<AtomicU64>,
}

/// What is kept of one antenna.
pub(crate) struct Antenna {
    intake: Intake,
    /// Epochs that were given by its decoder and are not done with.
    out: usize,
    arrivals: VecDeque<(GpsTime, Arrival)>,
}

impl Antenna {
    /// Nothing came from it yet.
    pub(crate) const fn new(intake: Intake) -> Self {
        Self { intake, out: 0, arrivals: VecDeque::new() }
    }
}

impl Solver {
    /// Runs until it is told to stop, or (once) all inputs have ended.
    pub(crate) fn run(mut self, events: &Receiver<Event>) {
        loop {
            self.heartbeat.fetch_add(1, Relaxed);
            let going_on = match events.recv_timeout(self.patience()) {
                Ok(event) => self.take(event),
                Err(RecvTimeoutError::Timeout) => ControlFlow::Continue(()),
                Err(RecvTimeoutError::Disconnected) => ControlFlow::Break(()),
            };
            if going_on.is_break() {
                return self.finish();
            }
            self.join();
            self.solve_ready();
            self.send_carried();
            self.outlets.send_relative(Instant::now());
            self.return_permits();
            self.state.iter_mut().for_each(|state| state.save(&self.navigation));
        }
    }

    /// How long it may wait for an event: until something is to be done without one.
    fn patience(&self) -> Duration {
        let due_s = self.matcher.due_at_s().map_or(f64::INFINITY, |due_s| due_s - self.now_s());
        let patience = Duration::from_secs_f64(due_s.clamp(0.0, HEARTBEAT.as_secs_f64()));
        let has_complete = !self.complete.is_empty();
        let carrier_due = self.carrier.as_ref().and_then(|carrier| carrier.due(has_complete));
        let now = Instant::now();
        let others = carrier_due.into_iter().chain(self.outlets.due());
        others.map(|due| due.saturating_duration_since(now)).fold(patience, Duration::min)
    }

    fn now_s(&self) -> f64 {
        self.began.elapsed().as_secs_f64()
    }

    fn take(&mut self, event: Event) -> ControlFlow<()> {
        match event {
            Event::Epoch(Observer::Antenna(antenna), decoded) => self.take_epoch(antenna, *decoded),
            Event::Epoch(Observer::Station, decoded) => self.take_station(*decoded),
            Event::Left(Observer::Antenna(antenna)) => self.matcher.leave(antenna),
            Event::Left(Observer::Station) => {
                self.station.leave();
                self.station_place.leave();
            }
            Event::Sample(tow_s, sample, arrived) => {
                if let Some(carrier) = &mut self.carrier {
                    carrier.push_sample(tow_s, *sample, arrived);
                }
            }
            Event::ImuLeft => self.carrier.iter_mut().for_each(Carrier::leave),
            Event::PeerLine(number, line, arrived) => {
                self.outlets.take_peer(number, *line, arrived);
            }
            Event::InputEnded => {
                self.inputs -= 1;
                if self.once && self.inputs == 0 {
                    return ControlFlow::Break(());
                }
            }
            Event::Reload(new) => self.replace(&new),
            Event::Stop => return ControlFlow::Break(()),
        }
        ControlFlow::Continue(())
    }

    fn take_epoch(&mut self, antenna: usize, decoded: Decoded) {
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

    /// An epoch is late by its age against the newest one, and by the time since that one came.
    fn note_lateness(&mut self, antenna: usize, time: GpsTime, is_late: bool) {
        /// Older "newest" epochs are forgotten, in case a clock was set back.
        const FORGOTTEN: Duration = Duration::from_secs(5);
        let late_s = self
            .newest
            .filter(|_| is_late)
            .map(|(newest, at)| ((newest - time) + at.elapsed().as_secs_f64()).max(0.0));
        self.antennas[antenna].intake.status.note_lateness(late_s);
        let is_newest =
            self.newest.is_none_or(|(newest, at)| time > newest || at.elapsed() > FORGOTTEN);
        if is_newest && !is_late {
            self.newest = Some((time, Instant::now()));
        }
    }

    fn take_station(&mut self, decoded: Decoded) {
        let number = self.antennas.len();
        self.received.hold(number, decoded.epoch.time, decoded.news);
        if let Some(place_m) = self.station_place.take(decoded.place_m) {
            // The waiting epochs were observed at another place.
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

    /// Joins what came to epochs of the array, as far as no antenna is worth waiting for.
    fn join(&mut self) {
        while let Some(epoch) = self.matcher.poll(self.now_s()) {
            self.complete(epoch);
        }
    }

    fn complete(&mut self, epoch: ArrayEpoch) {
        if let Some(carrier) = &mut self.carrier {
            carrier.note_epoch(epoch.time, self.matcher.interval_s());
        }
        self.complete.push_back(epoch);
    }

    /// Solves the epochs that need not wait for the station or the inertial sensor.
    fn solve_ready(&mut self) {
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
    }

    fn solve(&mut self, mut epoch: ArrayEpoch) {
        self.add_station(&mut epoch);
        self.check_clocks(&epoch);
        self.learn(&epoch);
        let mut row = match &mut self.carrier {
            None => self.engine.push(&epoch, None),
            Some(carrier) => carrier.solve(&epoch, &mut self.engine),
        };
        (self.finish)(&epoch, &mut row);
        let times = self.times(&epoch);
        self.outlets.see(&epoch, &row);
        match &mut self.carrier {
            None => self.send(row, &times),
            Some(carrier) => {
                carrier.take(row, times);
                self.send_carried();
            }
        }
    }

    /// Puts the station's epoch beside those of the antennas, if its place is known.
    fn add_station(&mut self, epoch: &mut ArrayEpoch) {
        let observed = self.station.at(epoch.time, self.matcher.window_s());
        epoch.station = observed.filter(|_| self.station_place.is_known());
        self.status.note_station(station_age_s(epoch));
    }

    /// Gives the engine the navigation data that came before the epoch.
    fn learn(&mut self, epoch: &ArrayEpoch) {
        for news in self.received.release(epoch) {
            self.engine.insert(&news);
            self.navigation.update(&news);
            self.state.iter_mut().for_each(|state| state.note_news(&news));
        }
    }

    /// Sends the rows that the filter is done with.
    fn send_carried(&mut self) {
        while let Some((row, times)) = self.carrier.as_mut().and_then(Carrier::next_row) {
            self.send(row, &times);
        }
    }

    fn send(&mut self, row: EpochSolution, times: &Times) {
        self.state.iter_mut().for_each(|state| state.note(&row));
        self.outlets.send(row, times);
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
        let utc = arrivals.iter().map(|a| a.last_byte_utc);
        Times {
            first_byte: arrivals.iter().map(|a| a.first_byte).min().unwrap_or(now.first_byte),
            last_byte: arrivals.iter().map(|a| a.last_byte).max().unwrap_or(now.last_byte),
            last_byte_utc: utc.max().unwrap_or(now.last_byte_utc),
            row_out: Instant::now(),
            row_out_utc: SystemTime::now(),
            station_age_s: station_age_s(epoch),
        }
    }

    /// Decoders may go on as far as their epochs are done with.
    fn return_permits(&mut self) {
        for (number, antenna) in self.antennas.iter_mut().enumerate() {
            let of_complete = self.complete.iter().filter(|e| e.antennas[number].is_some()).count();
            let waiting = self.matcher.waiting(number) + of_complete;
            antenna.intake.permits.release(antenna.out - waiting);
            antenna.out = waiting;
            let status = &antenna.intake.status;
            status.late.store(self.matcher.late(number), Relaxed);
            status.strays.store(self.matcher.strays(number), Relaxed);
            // Those of epochs that were dropped.
            while antenna.arrivals.len() > waiting + 1 {
                antenna.arrivals.pop_front();
            }
        }
    }

    fn replace(&mut self, make_engine: &MakeEngine) {
        match make_engine(self.navigation.clone()) {
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

    /// Solves and sends what is left, without waiting for anything.
    fn finish(mut self) {
        while let Some(epoch) = self.matcher.flush(self.now_s()) {
            self.complete(epoch);
        }
        while let Some(epoch) = self.complete.pop_front() {
            self.solve(epoch);
        }
        self.carrier.iter_mut().for_each(Carrier::finish);
        self.send_carried();
        self.outlets.finish();
        if let Some(state) = self.state {
            state.finish(self.navigation);
        }
    }
}

/// How much older than the epoch the station's in it is, s.
fn station_age_s(epoch: &ArrayEpoch) -> Option<f64> {
    epoch.station.as_ref().map(|station| epoch.time - station.time)
}
