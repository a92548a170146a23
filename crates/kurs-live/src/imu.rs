//! The inertial sensor beside the antennas: its samples and the epochs in the order of their times,
//! as `kurs fuse` has them, as far as waiting for either is worth it.
//!
//! A sample goes to the filter when no epoch before it can come any more: soon after an epoch,
//! because the next one is an interval away; or when that is overdue. An epoch goes when the sample
//! after it is there, or late. Which of both waits for the other never changes a row, only when it
//! leaves.

use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::atomic::Ordering::Relaxed;
use std::time::{Duration, Instant, SystemTime};

use kurs::differential::Differential;
use kurs::fusion::attitude::feed::AttitudeFeed;
use kurs::fusion::attitude::session::{AttitudeSessionSettings, ImuSample};
use kurs::fusion::health::Event;
use kurs::observation::ArrayEpoch;
use kurs::observation::matcher::Deadline;
use kurs::solution::EpochSolution;
use kurs::time::GpsTime;

use crate::intake::Intake;
use crate::setup::Times;

/// Samples of a log that is read as fast as possible that may wait for the antennas: 4 s of 1000
/// Hz.
pub(crate) const MAX_AHEAD: usize = 4096;
/// Samples of a stream that may wait for the first epoch; more are let go.
const MAX_WAITING: usize = 65_536;
/// An epoch comes no earlier than this share of an interval before it is expected.
const EARLY: f64 = 0.25;
/// The next epoch is overdue when it is later than the latest ones by this factor, and the
/// deadline.
const LATER_THAN_USUAL: f64 = 1.5;
/// Share of the largest latency that is left after every epoch.
const REMEMBERED: f64 = 0.99;
/// The deadline of antennas is half an interval, at most this, s.
pub(crate) const MAX_USUAL_DEADLINE_S: f64 = 0.1;
/// An epoch this much before the last one, s, is not a late one: the time of the antennas was set
/// back.
const SET_BACK_S: f64 = 1.0;
/// A sample this much after the one before, s, is doubted until another one follows it.
const DOUBTED_STEP_S: f64 = 1.0;

/// Lines of a sensor to samples.
pub trait SampleLines: Send {
    /// GPS second of week and sample of a line; `None` for a header or a comment. The error says
    /// what is wrong with it.
    ///
    /// # Errors
    ///
    /// What is wrong, in words.
    fn sample(&mut self, line: &str) -> Result<Option<(f64, ImuSample)>, String>;
}

/// Makes what reads the lines of a new connection.
pub type ReadSamples = Arc<dyn Fn() -> Box<dyn SampleLines> + Send + Sync>;

/// The sensor as configured.
#[derive(Clone)]
pub struct Imu {
    /// The filter.
    pub session: AttitudeSessionSettings,
    /// Rows at least so often, s; `None`: as often as the antennas have them.
    pub interval_s: Option<f64>,
    /// Reads its lines.
    pub read: ReadSamples,
}

/// See the module.
pub(crate) struct Carrier {
    imu: Imu,
    feed: AttitudeFeed,
    deadline: Deadline,
    /// Its log is read as fast as possible, and waits for the antennas.
    is_unpaced: bool,
    intake: Intake,
    /// Samples that came and whose permits are not given back.
    out: usize,
    /// When samples came, for those that an epoch may still ask for.
    arrivals: VecDeque<(f64, Instant)>,
    /// A sample that is far after the one before.
    doubted: Option<(f64, ImuSample)>,
    last_tow_s: Option<f64>,
    /// Rows on their way through the filter.
    under_way: VecDeque<(GpsTime, Times)>,
    antennas_interval_s: Option<f64>,
    last_epoch: Option<GpsTime>,
    /// How many intervals after it the next epoch is expected.
    expected: f64,
    /// Largest recent delay of an epoch behind the sample of its time, s.
    latency_s: f64,
    /// The epoch that waits for the sample after it, and since when.
    awaiting: Option<(GpsTime, Instant)>,
    /// Its samples do not come, or come too late, and are not waited for.
    is_silent: bool,
    has_left: bool,
    /// How many samples had come too late when that was last reported.
    told_too_late: usize,
    /// Rows that the filter did not take.
    passed_by: VecDeque<EpochSolution>,
    last_sent: Option<GpsTime>,
}

impl Carrier {
    pub(crate) fn new(imu: Imu, deadline: Deadline, is_unpaced: bool, intake: Intake) -> Self {
        Self {
            feed: AttitudeFeed::new(imu.session.clone(), imu.interval_s),
            imu,
            deadline,
            is_unpaced,
            intake,
            out: 0,
            arrivals: VecDeque::new(),
            doubted: None,
            last_tow_s: None,
            under_way: VecDeque::new(),
            antennas_interval_s: None,
            last_epoch: None,
            expected: 1.0,
            latency_s: 0.0,
            awaiting: None,
            is_silent: false,
            has_left: false,
            told_too_late: 0,
            passed_by: VecDeque::new(),
            last_sent: None,
        }
    }

    /// Takes a sample; one far after the one before only with another one that follows it.
    pub(crate) fn push_sample(&mut self, tow_s: f64, sample: ImuSample, arrived: Instant) {
        self.out += 1;
        self.has_left = false;
        self.arrivals.push_back((tow_s, arrived));
        let is_far = |before_s: f64| tow_s - before_s > DOUBTED_STEP_S;
        if let Some((doubted_s, doubted)) = self.doubted.take() {
            // A sample is not confirmed if the next one is before it.
            if tow_s >= doubted_s {
                self.feed.push_sample(doubted_s, doubted);
                self.last_tow_s = Some(doubted_s);
            }
        }
        if self.last_tow_s.is_some_and(is_far) {
            self.doubted = Some((tow_s, sample));
            return;
        }
        self.last_tow_s = Some(tow_s);
        self.feed.push_sample(tow_s, sample);
        if let Some(last) = self.last_epoch
            && self.is_silent
            && self.feed.has_sample_after(last)
        {
            tracing::info!("the inertial sensor is there again");
            self.is_silent = false;
        }
    }

    /// The connection of the sensor has ended.
    pub(crate) fn leave(&mut self) {
        self.has_left = true;
        if let Some((tow_s, sample)) = self.doubted.take() {
            self.feed.push_sample(tow_s, sample);
        }
    }

    /// An epoch is complete, with the interval of the antennas as it is known by now.
    pub(crate) fn note_epoch(&mut self, time: GpsTime, interval_s: Option<f64>) {
        self.feed.learn_interval(interval_s);
        self.antennas_interval_s = interval_s;
        if let Some(arrived) = self.arrival_after(time) {
            let latency_s = arrived.elapsed().as_secs_f64();
            self.latency_s = latency_s.max(REMEMBERED * self.latency_s);
        }
    }

    /// Whether a complete epoch need not wait for the sample after it.
    pub(crate) fn is_ready(&mut self, time: GpsTime) -> bool {
        if self.has_left || self.is_silent || self.feed.has_sample_after(time) {
            self.awaiting = None;
            return true;
        }
        self.feed.pass(self.newest_sample(time).map_or(time, |newest| newest.min(time)));
        self.return_permits();
        let since = match self.awaiting {
            Some((awaited, since)) if awaited == time => since,
            _ => self.awaiting.insert((time, Instant::now())).1,
        };
        self.is_silent = !self.is_unpaced && since.elapsed() >= self.deadline();
        if self.is_silent {
            self.awaiting = None;
            let text = "no sample came in time: rows go on without the inertial sensor";
            self.intake.status.note_error(text);
        }
        self.is_silent
    }

    /// When [`Self::is_ready`] or, without a complete epoch, [`Self::advance`] may come to another
    /// result though nothing has arrived.
    pub(crate) fn due(&self, has_complete: bool) -> Option<Instant> {
        match self.awaiting {
            Some((_, since)) => (!self.is_unpaced).then(|| since + self.deadline()),
            None if has_complete => None,
            None => self.overdue_at(),
        }
    }

    /// Solves an epoch with what the filter predicts for it; the row is to be given to
    /// [`Self::take`].
    pub(crate) fn solve(&mut self, epoch: &ArrayEpoch, engine: &mut Differential) -> EpochSolution {
        if self.last_epoch.is_some_and(|last| last - epoch.time > SET_BACK_S) {
            tracing::warn!("the time of the antennas was set back: the filter begins anew");
            self.begin_anew();
        }
        self.feed.solve(epoch, engine)
    }

    fn begin_anew(&mut self) {
        self.feed = AttitudeFeed::new(self.imu.session.clone(), self.imu.interval_s);
        self.feed.learn_interval(self.antennas_interval_s);
    }

    /// Takes the row of an epoch.
    pub(crate) fn take(&mut self, row: EpochSolution, times: Times) {
        let time = row.time;
        (self.last_epoch, self.expected) = (Some(time), 1.0);
        self.under_way.push_back((time, times));
        if self.feed.push_row(row.clone()).is_err() {
            tracing::warn!(%time, "an epoch came after the filter had gone on: its row has the antennas alone");
            self.passed_by.push_back(row);
        }
        self.tell_too_late();
    }

    /// Goes on to where no epoch can come any more; only while no complete one waits.
    pub(crate) fn advance(&mut self) {
        while self.overdue_at().is_some_and(|at| at <= Instant::now()) {
            self.expected += 1.0;
        }
        if let Some(last) = self.last_epoch
            && let Some(newest) = self.newest_sample(last)
        {
            self.feed.pass(newest.min(self.next_epoch(last)));
            let forgotten = self.next_epoch(last) + -self.antennas_interval_s.unwrap_or(0.0);
            let is_forgotten =
                |tow_s: f64| last.nearest_with_tow(tow_s).is_none_or(|t| t < forgotten);
            while self.arrivals.pop_front_if(|(tow_s, _)| is_forgotten(*tow_s)).is_some() {}
        }
        while self.arrivals.len() > MAX_WAITING {
            self.arrivals.pop_front();
        }
        if !self.is_unpaced && self.feed.waiting_samples() > MAX_WAITING {
            self.begin_anew();
        }
        self.return_permits();
    }

    /// All that is left goes through the filter.
    pub(crate) fn finish(&mut self) {
        self.feed.take_rest();
        self.is_silent = true;
    }

    /// The next row with its times.
    pub(crate) fn next_row(&mut self) -> Option<(EpochSolution, Times)> {
        loop {
            // No sample comes that a row could wait for.
            let is_cut_off = self.is_silent || self.has_left;
            let carried = match is_cut_off && self.feed.waiting_samples() == 0 {
                true => self.feed.last_row(),
                false => self.feed.next_row(),
            };
            let row = match carried {
                Some(carried) => {
                    carried.events.iter().for_each(|(_, event)| tell(event));
                    carried.solution
                }
                None => self.passed_by.pop_front()?,
            };
            let times = self.times(row.time);
            // The antennas' own time may be set back, a row that was overtaken may not.
            let is_overtaken = self
                .last_sent
                .is_some_and(|last| row.time <= last && last - row.time <= SET_BACK_S);
            if !is_overtaken {
                self.last_sent = Some(row.time);
                return Some((row, times));
            }
        }
    }

    /// When the bytes of an epoch came, or for a row between epochs the sample after it.
    fn times(&mut self, time: GpsTime) -> Times {
        let now = (Instant::now(), SystemTime::now());
        if let Some(place) = self.under_way.iter().position(|(at, _)| *at == time) {
            let (_, times) = self.under_way[place];
            self.under_way.drain(..=place);
            return Times { row_out: now.0, row_out_utc: now.1, ..times };
        }
        let came = self.arrival_after(time).unwrap_or(now.0);
        Times {
            first_byte: came,
            last_byte: came,
            last_byte_utc: now.1 - (now.0 - came),
            row_out: now.0,
            row_out_utc: now.1,
            station_age_s: None,
        }
    }

    /// When the first sample came that is not before this time.
    fn arrival_after(&self, time: GpsTime) -> Option<Instant> {
        let is_after = |tow_s: f64| time.nearest_with_tow(tow_s).is_some_and(|t| t >= time);
        self.arrivals.iter().find(|(tow_s, _)| is_after(*tow_s)).map(|(_, arrived)| *arrived)
    }

    fn newest_sample(&self, near: GpsTime) -> Option<GpsTime> {
        near.nearest_with_tow(self.last_tow_s?)
    }

    /// No epoch comes before this.
    fn next_epoch(&self, last: GpsTime) -> GpsTime {
        last + self
            .antennas_interval_s
            .map_or(0.0, |interval_s| (self.expected - EARLY) * interval_s)
    }

    /// When the next epoch is no longer waited for.
    fn overdue_at(&self) -> Option<Instant> {
        if self.is_unpaced {
            return None;
        }
        self.antennas_interval_s?;
        let came = self.arrival_after(self.next_epoch(self.last_epoch?))?;
        Some(came + self.deadline() + Duration::from_secs_f64(LATER_THAN_USUAL * self.latency_s))
    }

    /// How long antennas, and the sensor, are waited for.
    fn deadline(&self) -> Duration {
        let half_s = self.antennas_interval_s.map_or(MAX_USUAL_DEADLINE_S, |s| 0.5 * s);
        Duration::from_secs_f64(match self.deadline {
            Deadline::Seconds(seconds) => seconds,
            Deadline::HalfInterval => half_s.min(MAX_USUAL_DEADLINE_S),
        })
    }

    fn tell_too_late(&mut self) {
        let too_late = self.feed.too_late();
        if too_late > 0 && self.told_too_late == 0 {
            let text = "samples come too late, or their time goes back: they are not used";
            self.intake.status.note_error(text);
        }
        self.told_too_late = too_late;
        self.intake.status.late.store(too_late as u64, Relaxed);
    }

    fn return_permits(&mut self) {
        let waiting = self.feed.waiting_samples() + usize::from(self.doubted.is_some());
        self.intake.permits.release(self.out.saturating_sub(waiting));
        self.out = waiting.min(self.out);
    }
}

fn tell(event: &Event) {
    match event {
        Event::Started => tracing::info!("{event}"),
        _ => tracing::warn!("{event}"),
    }
}
