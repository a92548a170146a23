//! The epochs of several antennas, matched in time: one [`ArrayEpoch`] for every instant that any
//! antenna has.
//!
//! A matcher has no clock. One made by [`Matcher::new`] waits for every antenna, as files are read;
//! one with a deadline ([`Matcher::with_deadline`]) lets an instant go without the antennas that are
//! late, by the time that its caller passes in.

use std::collections::VecDeque;

use super::{AntennaEpoch, ArrayEpoch};
use crate::time::GpsTime;

/// Epochs less than this apart, s, belong together while no antenna has shown two of them: the interval
/// of the fastest receivers, 100 Hz, which is also the most that the engine uses together.
const UNKNOWN_WINDOW_S: f64 = 0.010;
/// Shorter times between two epochs are steps of a clock (whole milliseconds) and no interval, s:
/// receivers give 100 epochs a second at most.
const MIN_INTERVAL_S: f64 = 0.005;
/// The usual deadline is half an interval but no more than this, s: consumers of an attitude use it
/// within 0.1 s to 0.3 s.
const MAX_USUAL_DEADLINE_S: f64 = 0.1;
/// An instant this much later than the one before, s, is doubted where few antennas show it: no
/// receiver pauses and comes back so far apart from the others.
const MIN_DOUBTED_STEP_S: f64 = 3.0;
/// How long, s by the caller's clock, a doubted instant is kept, and how long after its last epoch an
/// antenna still counts as present: two epochs of the slowest usual receivers, 1 Hz.
const PATIENCE_S: f64 = 2.0;

/// Joins the epochs of several antennas into those of the array.
///
/// An instant is the earliest waiting epoch and those of other antennas less than half an interval
/// after it, where the interval is the shortest time between two epochs of one antenna so far.
#[derive(Debug, Clone)]
pub struct Matcher {
    queues: Vec<Queue>,
    deadline: Option<Deadline>,
    /// Shortest time between two epochs of one antenna so far, s; infinite before there were two.
    interval_s: f64,
    last: Option<Instant>,
}

/// When an instant goes without those who are late.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Deadline {
    /// Half an interval after the first antenna's epoch came, at most 0.1 s.
    HalfInterval,
    /// This many seconds after the first antenna's epoch came.
    Seconds(f64),
}

/// One antenna.
#[derive(Debug, Clone, Default)]
struct Queue {
    waiting: VecDeque<Waiting>,
    has_left: bool,
    /// Time tag of the last epoch that went into an instant.
    taken: Option<GpsTime>,
    /// Shortest time between two of them, s.
    interval_s: Option<f64>,
    /// Time tag and arrival of the last epoch that came at all.
    newest: Option<(GpsTime, f64)>,
    late: u64,
    strays: u64,
}

#[derive(Debug, Clone)]
struct Waiting {
    epoch: AntennaEpoch,
    arrived_s: f64,
}

/// The last instant that went out.
#[derive(Debug, Clone)]
struct Instant {
    earliest: GpsTime,
    latest: GpsTime,
    window_s: f64,
    /// Which antennas are in it.
    has: Vec<bool>,
    left_s: f64,
}

impl Matcher {
    /// A matcher that waits for every antenna that has not left ([`Matcher::leave`]).
    #[must_use]
    pub fn new(antennas: usize) -> Self {
        Self {
            queues: vec![Queue::default(); antennas],
            deadline: None,
            interval_s: f64::INFINITY,
            last: None,
        }
    }

    /// A matcher that waits no longer than the deadline.
    #[must_use]
    pub const fn with_deadline(mut self, deadline: Deadline) -> Self {
        self.deadline = Some(deadline);
        self
    }

    /// Takes an epoch that came at `now_s` (s, by any clock that does not step) and gives the instant
    /// that it completes, if it does; [`Matcher::poll`] then gives further ones.
    ///
    /// An epoch whose instant has gone out already, or that is not later than the instant before or
    /// than the epoch before of the same antenna, is dropped and counted ([`Matcher::late`]).
    ///
    /// # Panics
    ///
    /// If there is no such antenna.
    pub fn push(&mut self, antenna: usize, epoch: AntennaEpoch, now_s: f64) -> Option<ArrayEpoch> {
        let time = epoch.time;
        self.queues[antenna].newest = Some((time, now_s));
        self.queues[antenna].has_left = false;
        if self.is_late(antenna, time) {
            self.queues[antenna].late += 1;
            if self.clock_stepped_back(time, now_s) {
                self.begin_anew();
            }
        } else {
            self.queues[antenna].waiting.push_back(Waiting { epoch, arrived_s: now_s });
        }
        self.poll(now_s)
    }

    /// The next instant that is complete, or whose deadline has passed at `now_s`.
    pub fn poll(&mut self, now_s: f64) -> Option<ArrayEpoch> {
        loop {
            let earliest = self.earliest()?;
            self.learn_intervals();
            let window_s = self.window_s();
            let is_due = self.due_s(earliest, window_s).is_some_and(|due_s| now_s >= due_s);
            if !is_due && self.awaits_anyone(earliest, window_s) {
                return None;
            }
            match self.judge_step(earliest, now_s) {
                Step::Believed => return Some(self.take(earliest, window_s, now_s)),
                Step::Undecided => return None,
                Step::Stray => self.drop_strays(earliest),
            }
        }
    }

    /// Gives the next instant without waiting for anyone; `None` when nothing waits.
    pub fn flush(&mut self, now_s: f64) -> Option<ArrayEpoch> {
        let earliest = self.earliest()?;
        self.learn_intervals();
        Some(self.take(earliest, self.window_s(), now_s))
    }

    /// The antenna's epochs have ended: nobody waits for it until one comes again.
    ///
    /// # Panics
    ///
    /// If there is no such antenna.
    pub fn leave(&mut self, antenna: usize) {
        self.queues[antenna].has_left = true;
    }

    /// When [`Matcher::poll`] may give something though nothing comes, s; `None` if never.
    #[must_use]
    pub fn due_at_s(&self) -> Option<f64> {
        let earliest = self.earliest()?;
        let due_s = self.due_s(earliest, self.window_s())?;
        Some(if self.is_step(earliest) {
            due_s.max(self.arrival_s(earliest)? + PATIENCE_S)
        } else {
            due_s
        })
    }

    /// Shortest time between two epochs of one antenna so far, s; `None` before there were two.
    #[must_use]
    pub fn interval_s(&self) -> Option<f64> {
        Some(self.interval_s).filter(|s| s.is_finite())
    }

    /// Epochs less than this apart belong to one instant, s.
    #[must_use]
    pub fn window_s(&self) -> f64 {
        self.interval_s().map_or(UNKNOWN_WINDOW_S, |interval_s| 0.5 * interval_s)
    }

    /// Number of epochs of an antenna that wait to be matched.
    ///
    /// # Panics
    ///
    /// If there is no such antenna.
    #[must_use]
    pub fn waiting(&self, antenna: usize) -> usize {
        self.queues[antenna].waiting.len()
    }

    /// How many epochs of an antenna were dropped because their instant had gone out.
    ///
    /// # Panics
    ///
    /// If there is no such antenna.
    #[must_use]
    pub fn late(&self, antenna: usize) -> u64 {
        self.queues[antenna].late
    }

    /// How many epochs of an antenna were dropped because their time is far from that of the others.
    ///
    /// # Panics
    ///
    /// If there is no such antenna.
    #[must_use]
    pub fn strays(&self, antenna: usize) -> u64 {
        self.queues[antenna].strays
    }

    fn earliest(&self) -> Option<GpsTime> {
        self.queues.iter().filter_map(Queue::head_time).min()
    }

    /// Tells of a time between two epochs of one antenna that the caller has seen ahead, s: before the fastest receiver
    /// has shown two epochs here, a slower one's interval, or a gap, would join what does not belong together.
    pub fn expect_interval(&mut self, interval_s: f64) {
        if interval_s >= MIN_INTERVAL_S {
            self.interval_s = self.interval_s.min(interval_s);
        }
    }

    fn learn_intervals(&mut self) {
        for antenna in 0..self.queues.len() {
            let queue = &self.queues[antenna];
            if let (Some(head), Some(taken)) = (queue.head_time(), queue.taken) {
                self.expect_interval(head - taken);
            }
        }
    }

    /// When the instant goes, whoever is missing.
    fn due_s(&self, earliest: GpsTime, window_s: f64) -> Option<f64> {
        let deadline_s = match self.deadline? {
            Deadline::Seconds(seconds) => seconds,
            Deadline::HalfInterval if self.interval_s.is_finite() => {
                window_s.min(MAX_USUAL_DEADLINE_S)
            }
            Deadline::HalfInterval => MAX_USUAL_DEADLINE_S,
        };
        let members = self.queues.iter().filter_map(|queue| queue.waiting.front());
        let members = members.filter(|waiting| waiting.epoch.time - earliest < window_s);
        members.map(|waiting| waiting.arrived_s + deadline_s).reduce(f64::min)
    }

    /// Whether an antenna may still have an epoch that belongs to the instant.
    fn awaits_anyone(&self, earliest: GpsTime, window_s: f64) -> bool {
        self.queues.iter().any(|queue| {
            // A slower receiver is not waited for between its epochs.
            let next = queue.taken.zip(queue.interval_s).map(|(taken, s)| taken + s);
            let has_none_then =
                self.deadline.is_some() && next.is_some_and(|next| next - earliest >= window_s);
            queue.waiting.is_empty() && !queue.has_left && !has_none_then
        })
    }

    /// The instant has gone out without it, or it is not later than what went out, or than the one before.
    fn is_late(&self, antenna: usize, time: GpsTime) -> bool {
        let queue = &self.queues[antenna];
        let before = queue.waiting.back().map(|waiting| waiting.epoch.time).or(queue.taken);
        before.is_some_and(|before| time <= before)
            || self.last.as_ref().is_some_and(|last| {
                time <= last.latest || !last.has[antenna] && time - last.earliest < last.window_s
            })
    }

    fn take(&mut self, earliest: GpsTime, window_s: f64, now_s: f64) -> ArrayEpoch {
        let mut antennas = Vec::with_capacity(self.queues.len());
        for queue in &mut self.queues {
            let belongs = |waiting: &Waiting| waiting.epoch.time - earliest < window_s;
            let Some(waiting) = queue.waiting.pop_front_if(|waiting| belongs(waiting)) else {
                antennas.push(None);
                continue;
            };
            let time = waiting.epoch.time;
            if let Some(taken) = queue.taken.replace(time) {
                let since_s = time - taken;
                if since_s >= MIN_INTERVAL_S {
                    queue.interval_s = Some(queue.interval_s.map_or(since_s, |s| s.min(since_s)));
                }
            }
            antennas.push(Some(waiting.epoch));
        }
        let has = antennas.iter().map(Option::is_some).collect();
        let latest = antennas.iter().flatten().map(|epoch| epoch.time).fold(earliest, GpsTime::max);
        for queue in &mut self.queues {
            // Of an antenna with a tag ahead of its time: its right epoch has no instant any more.
            while queue.waiting.pop_front_if(|waiting| waiting.epoch.time <= latest).is_some() {
                queue.late += 1;
            }
        }
        self.last = Some(Instant { earliest, latest, window_s, has, left_s: now_s });
        let time = antennas.iter().flatten().next().map_or(earliest, |epoch| epoch.time);
        ArrayEpoch { time, antennas, station: None }
    }
}

/// What is thought of an instant far behind the last one.
enum Step {
    Believed,
    Undecided,
    Stray,
}

/// Steps of time: a receiver that loses its date must not take the others along.
impl Matcher {
    /// Whether an instant is so much later than the last one that it may be an error.
    fn is_step(&self, earliest: GpsTime) -> bool {
        let longest_s = MIN_DOUBTED_STEP_S.max(3.0 * self.window_s());
        self.deadline.is_some()
            && self.last.as_ref().is_some_and(|last| earliest - last.earliest > longest_s)
    }

    fn judge_step(&self, earliest: GpsTime, now_s: f64) -> Step {
        let (true, Some(last)) = (self.is_step(earliest), &self.last) else {
            return Step::Believed;
        };
        if self.is_of_majority(earliest, now_s) {
            return Step::Believed;
        }
        match self.arrival_s(earliest) {
            Some(arrived_s) if now_s - arrived_s < PATIENCE_S => Step::Undecided,
            // Others went on in the meantime.
            Some(arrived_s) if last.left_s > arrived_s => Step::Stray,
            _ => Step::Believed,
        }
    }

    /// Whether more than half of the antennas that are there are at this time.
    fn is_of_majority(&self, time: GpsTime, now_s: f64) -> bool {
        let present: Vec<GpsTime> = self
            .queues
            .iter()
            .filter_map(|queue| queue.newest)
            .filter(|(_, arrived_s)| now_s - arrived_s < PATIENCE_S)
            .map(|(newest, _)| newest)
            .collect();
        let near = present.iter().filter(|t| (**t - time).abs() <= MIN_DOUBTED_STEP_S).count();
        2 * near > present.len()
    }

    fn clock_stepped_back(&self, time: GpsTime, now_s: f64) -> bool {
        self.deadline.is_some()
            && self.last.as_ref().is_some_and(|last| last.earliest - time > MIN_DOUBTED_STEP_S)
            && self.is_of_majority(time, now_s)
    }

    /// Time was set back: what went out before, and what waits, does not bind any more.
    fn begin_anew(&mut self) {
        self.last = None;
        for queue in &mut self.queues {
            queue.taken = None;
            queue.strays += queue.waiting.len() as u64;
            queue.waiting.clear();
        }
    }

    fn drop_strays(&mut self, earliest: GpsTime) {
        for queue in &mut self.queues {
            if queue.waiting.pop_front_if(|waiting| waiting.epoch.time == earliest).is_some() {
                queue.strays += 1;
            }
        }
    }

    fn arrival_s(&self, earliest: GpsTime) -> Option<f64> {
        let heads = self.queues.iter().filter_map(|queue| queue.waiting.front());
        heads.filter(|w| w.epoch.time == earliest).map(|w| w.arrived_s).reduce(f64::min)
    }
}

impl Queue {
    fn head_time(&self) -> Option<GpsTime> {
        self.waiting.front().map(|waiting| waiting.epoch.time)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn at(tow_s: f64) -> GpsTime {
        GpsTime::from_week_tow(2300, tow_s).unwrap()
    }

    fn epoch(tow_s: f64) -> AntennaEpoch {
        AntennaEpoch { time: at(tow_s), ..AntennaEpoch::default() }
    }

    /// Seconds of week of every antenna in an instant, after its own.
    type Tows = (f64, Vec<Option<f64>>);

    fn tows(epoch: &ArrayEpoch) -> Tows {
        let antennas = epoch.antennas.iter();
        let tow_s = |time: GpsTime| (time.tow_s() * 1e6).round() * 1e-6;
        (tow_s(epoch.time), antennas.map(|a| a.as_ref().map(|a| tow_s(a.time))).collect())
    }

    fn all(tow_s: f64, antennas: usize) -> Tows {
        (tow_s, vec![Some(tow_s); antennas])
    }

    fn push(matcher: &mut Matcher, antenna: usize, tow_s: f64, now_s: f64) -> Option<Tows> {
        matcher.push(antenna, epoch(tow_s), now_s).map(|instant| tows(&instant))
    }

    fn poll(matcher: &mut Matcher, now_s: f64) -> Option<Tows> {
        matcher.poll(now_s).map(|instant| tows(&instant))
    }

    /// Two antennas with a deadline of 0.1 s that have shown an interval of 1 s, up to 11 s.
    fn running(antennas: usize) -> Matcher {
        let mut matcher = Matcher::new(antennas).with_deadline(Deadline::Seconds(0.1));
        for tow_s in [10.0, 11.0] {
            for antenna in 0..antennas {
                let found = push(&mut matcher, antenna, tow_s, tow_s);
                assert_eq!(found, (antenna + 1 == antennas).then(|| all(tow_s, antennas)));
            }
        }
        matcher
    }

    #[test]
    fn an_instant_has_what_is_less_than_half_an_interval_apart() {
        let mut matcher = Matcher::new(2);
        assert_eq!(matcher.interval_s(), None);
        // Until two epochs are known: less than ten milliseconds.
        assert_eq!(push(&mut matcher, 0, 0.01, 0.0), None);
        assert_eq!(push(&mut matcher, 1, 0.0, 0.0), Some((0.0, vec![None, Some(0.0)])));
        assert_eq!(push(&mut matcher, 1, 0.019, 0.0), Some((0.01, vec![Some(0.01), Some(0.019)])));
        let mut matcher = Matcher::new(2);
        for tow_s in [1.25, 2.0] {
            push(&mut matcher, 0, tow_s, 0.0);
            assert_eq!(push(&mut matcher, 1, tow_s, 0.0), Some(all(tow_s, 2)));
        }
        assert_eq!((matcher.interval_s(), matcher.window_s()), (Some(0.75), 0.375));
        assert_eq!(push(&mut matcher, 0, 2.75, 0.0), None);
        assert_eq!(push(&mut matcher, 1, 2.625, 0.0), Some((2.75, vec![Some(2.75), Some(2.625)])));
        matcher.interval_s = 0.75;
        // 0.375 s is half of it.
        assert_eq!(push(&mut matcher, 0, 3.0, 0.0), None);
        assert_eq!(push(&mut matcher, 1, 3.375, 0.0), Some((3.0, vec![Some(3.0), None])));
        assert_eq!(poll(&mut matcher, 0.0), None);
        assert_eq!(matcher.waiting(1), 1);
        assert_eq!(push(&mut matcher, 0, 4.0, 0.0), Some((3.375, vec![None, Some(3.375)])));
    }

    #[test]
    fn everyone_is_waited_for_who_has_not_left() {
        let mut matcher = Matcher::new(3);
        assert_eq!(push(&mut matcher, 0, 1.0, 0.0), None);
        assert_eq!(push(&mut matcher, 1, 1.0, 0.0), None);
        assert_eq!((poll(&mut matcher, 1e9), matcher.due_at_s()), (None, None));
        matcher.leave(2);
        assert_eq!(poll(&mut matcher, 1e9), Some((1.0, vec![Some(1.0), Some(1.0), None])));
        assert_eq!(push(&mut matcher, 2, 2.0, 0.0), None);
        assert_eq!(push(&mut matcher, 0, 2.0, 0.0), None);
        assert_eq!(push(&mut matcher, 1, 2.0, 0.0), Some(all(2.0, 3)));
        assert_eq!(push(&mut matcher, 0, 3.0, 0.0), None);
        assert_eq!(
            push(&mut matcher, 1, 3.0, 0.0),
            None,
            "an antenna that came back is waited for"
        );
    }

    /// Without a clock nobody is taken for slow: a reader may only not have read on yet.
    #[test]
    fn a_slower_antenna_is_waited_for_where_there_is_no_deadline() {
        let mut matcher = Matcher::new(2);
        for tow_s in [0.0, 2.0] {
            assert_eq!(push(&mut matcher, 0, tow_s, 0.0), None);
            assert_eq!(push(&mut matcher, 1, tow_s, 0.0), Some(all(tow_s, 2)));
        }
        assert_eq!(push(&mut matcher, 0, 2.5, 0.0), None);
        assert_eq!(push(&mut matcher, 1, 4.0, 0.0), Some((2.5, vec![Some(2.5), None])));
    }

    #[test]
    fn a_slower_antenna_is_not_waited_for_between_its_epochs() {
        let mut matcher = Matcher::new(2).with_deadline(Deadline::Seconds(0.1));
        assert_eq!(push(&mut matcher, 1, 0.0, 0.0), None);
        assert_eq!(push(&mut matcher, 0, 0.0, 0.0), Some(all(0.0, 2)));
        for (tow_s, next) in [(0.25, None), (0.5, None), (0.75, None)] {
            assert_eq!(push(&mut matcher, 0, tow_s, tow_s), next);
            // Its interval is not known yet.
            assert!(poll(&mut matcher, tow_s + 0.1).is_some());
        }
        assert_eq!(push(&mut matcher, 1, 1.0, 1.0), None);
        assert_eq!(push(&mut matcher, 0, 1.0, 1.0), Some(all(1.0, 2)));
        let alone = Some((1.25, vec![Some(1.25), None]));
        assert_eq!(push(&mut matcher, 0, 1.25, 1.25), alone);
        assert!(push(&mut matcher, 0, 1.5, 1.5).is_some());
        assert!(push(&mut matcher, 0, 1.75, 1.75).is_some());
        assert_eq!(push(&mut matcher, 0, 2.0, 2.0), None, "now it is waited for");
        assert_eq!(push(&mut matcher, 1, 2.0, 2.0), Some(all(2.0, 2)));
    }

    #[test]
    fn the_deadline_counts_from_the_first_epoch_of_the_instant() {
        let mut matcher = running(3);
        assert_eq!(push(&mut matcher, 1, 12.0, 12.0), None);
        assert_eq!(push(&mut matcher, 0, 12.01, 12.05), None);
        assert_eq!(matcher.due_at_s(), Some(12.1));
        assert_eq!(poll(&mut matcher, 12.099), None);
        let without = Some((12.01, vec![Some(12.01), Some(12.0), None]));
        assert_eq!(poll(&mut matcher, 12.1), without);
        assert_eq!(matcher.due_at_s(), None);
    }

    #[test]
    fn the_usual_deadline_is_half_an_interval_and_at_most_a_tenth_of_a_second() {
        for (interval_s, deadline_s) in [(1.0, 0.1), (0.1, 0.05)] {
            let mut matcher = Matcher::new(2).with_deadline(Deadline::HalfInterval);
            for tow_s in [interval_s, 2.0 * interval_s] {
                push(&mut matcher, 0, tow_s, 0.0);
                push(&mut matcher, 1, tow_s, 0.0);
            }
            push(&mut matcher, 0, 3.0 * interval_s, 5.0);
            let due_s = matcher.due_at_s().unwrap() - 5.0;
            assert!((due_s - deadline_s).abs() < 1e-6, "{due_s}");
        }
    }

    #[test]
    fn before_an_interval_is_known_the_usual_deadline_is_a_tenth_of_a_second() {
        let mut matcher = Matcher::new(2).with_deadline(Deadline::HalfInterval);
        assert_eq!(push(&mut matcher, 0, 1.0, 5.0), None);
        assert_eq!(matcher.due_at_s(), Some(5.0 + MAX_USUAL_DEADLINE_S));
    }

    #[test]
    fn the_deadline_does_not_count_from_an_epoch_of_the_next_instant() {
        let mut matcher = Matcher::new(2).with_deadline(Deadline::Seconds(0.1));
        for tow_s in [1.25, 2.0] {
            push(&mut matcher, 0, tow_s, tow_s);
            push(&mut matcher, 1, tow_s, tow_s);
        }
        // Half an interval, 0.375 s, is another instant.
        assert_eq!(push(&mut matcher, 1, 3.375, 3.0), None);
        assert_eq!(push(&mut matcher, 0, 3.0, 3.05), Some((3.0, vec![Some(3.0), None])));
        assert_eq!(push(&mut matcher, 0, 4.5, 3.06), Some((3.375, vec![None, Some(3.375)])));

        let mut matcher = Matcher::new(3).with_deadline(Deadline::Seconds(0.1));
        matcher.interval_s = 0.75;
        assert_eq!(push(&mut matcher, 1, 3.375, 3.0), None);
        assert_eq!(push(&mut matcher, 0, 3.0, 3.05), None);
        assert_eq!(matcher.due_at_s(), Some(3.05 + 0.1));
    }

    #[test]
    fn who_comes_when_the_instant_is_gone_is_late_and_on_time_again_afterwards() {
        let mut matcher = running(2);
        assert_eq!(push(&mut matcher, 0, 12.0, 12.0), None);
        assert!(poll(&mut matcher, 12.1).is_some());
        // Within half an interval behind 12 s: it belongs to the instant that has gone.
        assert_eq!(push(&mut matcher, 1, 12.25, 12.2), None);
        assert_eq!((matcher.late(0), matcher.late(1), matcher.waiting(1)), (0, 1, 0));
        // The other one has its next epoch half a second later.
        assert_eq!(push(&mut matcher, 1, 12.5, 12.5), Some((12.5, vec![None, Some(12.5)])));
        assert_eq!(matcher.late(1), 1);
    }

    #[test]
    fn an_epoch_that_is_not_later_than_the_one_before_is_dropped() {
        let mut matcher = running(2);
        assert_eq!(push(&mut matcher, 0, 11.0, 11.5), None);
        assert_eq!(push(&mut matcher, 0, 12.0, 12.0), None);
        assert_eq!(push(&mut matcher, 0, 12.0, 12.0), None);
        assert_eq!((matcher.late(0), matcher.waiting(0)), (2, 1));
        assert_eq!(push(&mut matcher, 1, 12.0, 12.0), Some(all(12.0, 2)));
    }

    #[test]
    fn a_step_of_a_clock_is_no_interval() {
        let mut matcher = running(2);
        push(&mut matcher, 0, 12.0, 12.0);
        push(&mut matcher, 1, 12.0, 12.0);
        push(&mut matcher, 0, 12.001, 12.0);
        push(&mut matcher, 1, 12.001, 12.0);
        assert_eq!(matcher.interval_s(), Some(1.0));
    }

    #[test]
    fn what_waits_at_the_end_is_given_without_waiting() {
        let mut matcher = running(2);
        push(&mut matcher, 0, 12.0, 12.0);
        push(&mut matcher, 0, 13.0, 12.0);
        let flushed = |matcher: &mut Matcher| matcher.flush(12.0).map(|instant| tows(&instant));
        assert_eq!(flushed(&mut matcher), Some((12.0, vec![Some(12.0), None])));
        assert_eq!(flushed(&mut matcher), Some((13.0, vec![Some(13.0), None])));
        assert_eq!(flushed(&mut matcher), None);
    }

    #[test]
    fn one_antenna_that_loses_its_date_does_not_take_the_others_along() {
        let mut matcher = running(3);
        assert_eq!(push(&mut matcher, 2, 500.0, 12.0), None);
        // The deadline is past, and nobody else has anything.
        assert_eq!(matcher.due_at_s(), Some(12.0 + PATIENCE_S));
        assert_eq!(poll(&mut matcher, 12.2), None);
        assert_eq!(push(&mut matcher, 0, 12.0, 12.3), None);
        assert_eq!(
            push(&mut matcher, 1, 12.0, 12.3),
            Some((12.0, vec![Some(12.0), Some(12.0), None]))
        );
        assert_eq!(poll(&mut matcher, 13.999), None);
        assert_eq!((matcher.waiting(2), matcher.strays(2)), (1, 0));
        assert_eq!(poll(&mut matcher, 14.0), None);
        assert_eq!((matcher.waiting(2), matcher.strays(2), matcher.strays(0)), (0, 1, 0));
        assert_eq!(push(&mut matcher, 2, 14.0, 14.1), None);
        assert_eq!(push(&mut matcher, 0, 14.0, 14.1), None);
        assert_eq!(push(&mut matcher, 1, 14.0, 14.1), Some(all(14.0, 3)));
    }

    #[test]
    fn a_gap_of_all_antennas_is_believed_as_soon_as_most_of_them_are_back() {
        let mut matcher = running(3);
        assert_eq!(push(&mut matcher, 0, 14.5, 12.0), None);
        assert_eq!(push(&mut matcher, 1, 14.5, 12.0), None);
        assert_eq!(poll(&mut matcher, 12.1), Some((14.5, vec![Some(14.5), Some(14.5), None])));
    }

    /// Nobody else is there any more, so nobody contradicts; or nobody went on in the meantime.
    #[test]
    fn a_single_antenna_is_believed_when_the_others_are_silent() {
        let mut matcher = running(2);
        assert_eq!(push(&mut matcher, 0, 60.0, 60.0), None);
        assert_eq!(poll(&mut matcher, 60.1), Some((60.0, vec![Some(60.0), None])));

        let mut matcher = running(2);
        assert_eq!(push(&mut matcher, 0, 60.0, 11.5), None);
        assert_eq!(poll(&mut matcher, 12.0), None, "the other one was there half a second ago");
        assert_eq!(poll(&mut matcher, 13.5), Some((60.0, vec![Some(60.0), None])));
    }

    /// What went out when the doubted epoch came does not contradict it, and who is silent for two seconds is not
    /// there.
    #[test]
    fn the_patience_with_a_doubted_instant_ends_after_two_seconds() {
        let mut matcher = running(2);
        assert_eq!(push(&mut matcher, 0, 60.0, 11.0), None);
        assert_eq!(poll(&mut matcher, 11.0 + PATIENCE_S), Some((60.0, vec![Some(60.0), None])));

        let mut matcher = Matcher::new(2).with_deadline(Deadline::Seconds(0.0));
        for tow_s in [10.0, 11.0] {
            assert!(push(&mut matcher, 1, tow_s, tow_s).is_some());
        }
        let alone = Some((60.0, vec![Some(60.0), None]));
        assert_eq!(push(&mut matcher, 0, 60.0, 11.0 + PATIENCE_S), alone);
    }

    /// Three seconds, or three half intervals, are no step.
    #[test]
    fn a_short_gap_is_not_doubted() {
        let mut matcher = running(3);
        assert_eq!(push(&mut matcher, 0, 14.0, 12.0), None);
        assert_eq!(matcher.due_at_s(), Some(12.1));
        assert_eq!(poll(&mut matcher, 12.1), Some((14.0, vec![Some(14.0), None, None])));

        let mut slow = Matcher::new(2).with_deadline(Deadline::Seconds(0.1));
        for tow_s in [30.0, 60.0] {
            push(&mut slow, 0, tow_s, tow_s);
            push(&mut slow, 1, tow_s, tow_s);
        }
        assert_eq!(push(&mut slow, 0, 90.0, 60.5), None);
        assert_eq!(poll(&mut slow, 60.6), Some((90.0, vec![Some(90.0), None])));
    }

    #[test]
    fn most_antennas_may_set_the_time_back() {
        let mut matcher = running(3);
        assert_eq!(push(&mut matcher, 2, 12.0, 11.95), None);
        assert_eq!(push(&mut matcher, 0, 2.0, 12.0), None);
        assert_eq!((matcher.late(0), matcher.strays(2)), (1, 0));
        assert_eq!(push(&mut matcher, 1, 2.0, 12.0), None);
        assert_eq!((matcher.late(1), matcher.strays(2)), (1, 1));
        assert_eq!(push(&mut matcher, 0, 3.0, 13.0), None);
        assert_eq!(push(&mut matcher, 1, 3.0, 13.0), None);
        assert_eq!(push(&mut matcher, 2, 3.0, 13.0), Some(all(3.0, 3)));
    }

    /// A little behind is late; without a deadline nothing sets the time back.
    #[test]
    fn few_seconds_back_or_a_file_do_not_set_the_time_back() {
        let mut matcher = running(1);
        assert_eq!(push(&mut matcher, 0, 8.0, 12.0), None);
        assert_eq!(push(&mut matcher, 0, 9.0, 12.0), None);
        assert_eq!(matcher.late(0), 2);
        let mut file = Matcher::new(1);
        assert!(push(&mut file, 0, 100.0, 0.0).is_some());
        assert_eq!(push(&mut file, 0, 1.0, 0.0), None);
        assert_eq!(push(&mut file, 0, 2.0, 0.0), None);
        assert_eq!(file.late(0), 2);
        assert!(push(&mut file, 0, 1000.0, 0.0).is_some(), "a gap of a file is believed at once");
    }

    proptest! {
        /// Whatever the delays within the deadline are, the instants are those of the files.
        #[test]
        fn delays_within_the_deadline_change_nothing(
            gaps in prop::collection::vec(prop::array::uniform3(prop::bool::weighted(0.9)), 1..38),
            offsets_ms in prop::array::uniform3(0u32..8),
            delays_ms in prop::collection::vec(prop::array::uniform3(0u32..90), 40),
        ) {
            // The interval is shown first.
            let has = [&[[true; 3]; 2][..], &gaps].concat();
            let epochs = |antenna: usize| has.iter().enumerate().filter(move |(_, has)| has[antenna]);
            let tow_s = |number: usize, antenna: usize| {
                100.0 + 0.2 * number as f64 + 1e-3 * f64::from(offsets_ms[antenna])
            };
            let mut file = Matcher::new(3);
            let mut readers: Vec<_> = (0..3).map(|antenna| epochs(antenna).map(|(n, _)| n)).collect();
            let mut next_of_files = || {
                for (antenna, reader) in readers.iter_mut().enumerate() {
                    if file.waiting(antenna) > 0 {
                        continue;
                    }
                    let Some(n) = reader.next() else {
                        file.leave(antenna);
                        continue;
                    };
                    let found = push(&mut file, antenna, tow_s(n, antenna), 0.0);
                    if found.is_some() {
                        return found;
                    }
                }
                poll(&mut file, 0.0)
            };
            let of_files: Vec<Tows> = core::iter::from_fn(&mut next_of_files).collect();

            let mut arrivals: Vec<(f64, usize, f64)> = (0..3)
                .flat_map(|antenna| epochs(antenna).map(move |(n, _)| (n, antenna)))
                .map(|(n, antenna)| {
                    let delay_s = 1e-3 * f64::from(delays_ms[n][antenna]);
                    (0.2 * n as f64 + delay_s, antenna, tow_s(n, antenna))
                })
                .collect();
            arrivals.sort_by(|a, b| a.0.total_cmp(&b.0));
            let mut live = Matcher::new(3).with_deadline(Deadline::Seconds(0.095));
            let mut of_streams = Vec::new();
            for (now_s, antenna, tow_s) in arrivals {
                while let Some(instant) = poll(&mut live, now_s) {
                    of_streams.push(instant);
                }
                of_streams.extend(push(&mut live, antenna, tow_s, now_s));
            }
            while let Some(instant) = live.flush(1e9) {
                of_streams.push(tows(&instant));
            }
            prop_assert_eq!(of_files, of_streams);
            prop_assert_eq!((0..3).map(|antenna| live.late(antenna) + live.strays(antenna)).sum::<u64>(), 0);
        }

        /// Nothing is lost without being counted, whatever comes, and instants are in order but where
        /// the time was set back.
        #[test]
        fn every_epoch_is_given_dropped_or_waits(
            pushes in prop::collection::vec((0usize..3, 0u32..2000, 0u32..300), 0..200),
        ) {
            let mut matcher = Matcher::new(3).with_deadline(Deadline::HalfInterval);
            let (mut now_s, mut given) = (0.0, [0; 3]);
            let mut came = [0; 3];
            let mut count = |instant: ArrayEpoch| {
                for (antenna, epoch) in instant.antennas.iter().enumerate() {
                    given[antenna] += u64::from(epoch.is_some());
                }
            };
            for (antenna, tenth_s, after_ms) in pushes {
                now_s += 1e-3 * f64::from(after_ms);
                came[antenna] += 1;
                matcher.push(antenna, epoch(0.1 * f64::from(tenth_s)), now_s).into_iter().for_each(&mut count);
                while let Some(instant) = matcher.poll(now_s) {
                    count(instant);
                }
            }
            for antenna in 0..3 {
                let dropped = matcher.late(antenna) + matcher.strays(antenna);
                prop_assert_eq!(came[antenna], given[antenna] + dropped + matcher.waiting(antenna) as u64);
            }
        }
    }
}
