//! Lock times, as receivers count them, turned into slips.

use std::collections::BTreeMap;

use kurs::observation::Lock;
use kurs::signal::{Satellite, Signal};
use kurs::time::GpsTime;

/// How long a receiver says that it has followed a phase without a break: protocols round it down,
/// and from some time on they no longer tell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct LockTime {
    /// At least so long, s.
    pub(crate) least_s: f64,
    /// Less than this, s; infinite where the count has stopped.
    pub(crate) most_s: f64,
}

/// A lock shorter than this part of the time between two epochs began between them; not all of it,
/// because some receivers count in steps.
const COVERED: f64 = 0.9;

/// What is known of every signal from the last epoch that had it.
#[derive(Debug, Default)]
pub(crate) struct LockTimes {
    last: BTreeMap<(Satellite, Signal), Last>,
}

#[derive(Debug, Clone, Copy)]
struct Last {
    /// The last epoch that had the signal.
    seen: GpsTime,
    /// The last one with a lock time, and the least that it was, s.
    locked: Option<(GpsTime, f64)>,
    half_cycle_added: bool,
    /// It slipped and has had no phase since then.
    slip_pending: bool,
}

/// One signal of an epoch.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Tracked {
    pub(crate) satellite: Satellite,
    pub(crate) signal: Signal,
    pub(crate) time: GpsTime,
    /// `None` where the receiver does not tell.
    pub(crate) lock: Option<LockTime>,
    /// Receivers that resolve the half cycle late put it on the phase then.
    pub(crate) half_cycle_added: bool,
    pub(crate) has_phase: bool,
}

/// What the lock time of a signal tells.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Continuity {
    /// The phase goes on from the last epoch that had it.
    Continuous,
    /// The count began again in between, or half a cycle was put on or taken away.
    Slipped,
    /// The signal was in this epoch before.
    Repeated,
}

impl LockTimes {
    /// The loss-of-lock digit of a signal's phase, zero without a phase; `None` if the signal was
    /// in this epoch before. `half_cycle`: the phase may be off by half a cycle.
    pub(crate) fn digit(&mut self, now: &Tracked, half_cycle: bool) -> Option<Lock> {
        let slip = match self.update(now) {
            Continuity::Repeated => return None,
            Continuity::Slipped => Lock::SLIP,
            Continuity::Continuous => 0,
        };
        let half = if half_cycle { Lock::HALF_CYCLE } else { 0 };
        Some(Lock(if now.has_phase { slip | half } else { 0 }))
    }

    /// Compares with the last epoch of this signal. The phase slipped if the lock is of no
    /// duration, certainly shorter than before, or certainly shorter than the time in between. A
    /// slip stays until the signal has a phase. Without a lock time a phase counts as
    /// continuous.
    fn update(&mut self, now: &Tracked) -> Continuity {
        let Tracked { time, half_cycle_added, .. } = *now;
        let last = self.last.entry((now.satellite, now.signal)).or_insert(Last {
            seen: GpsTime::from_nanoseconds(i64::MIN),
            locked: None,
            half_cycle_added,
            slip_pending: false,
        });
        if last.seen == time {
            return Continuity::Repeated;
        }
        last.seen = time;
        let Some(LockTime { least_s, most_s }) = now.lock else { return Continuity::Continuous };
        let just_begun = least_s <= 0.0;
        let is_shorter = last.locked.is_some_and(|(locked, least_s)| {
            most_s <= least_s || most_s < COVERED * (time - locked)
        });
        let half_cycle_moved = last.half_cycle_added != half_cycle_added;
        let slipped = last.slip_pending || just_begun || is_shorter || half_cycle_moved;
        *last = Last {
            seen: time,
            locked: Some((time, least_s)),
            half_cycle_added,
            slip_pending: slipped && !now.has_phase,
        };
        if slipped { Continuity::Slipped } else { Continuity::Continuous }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use kurs::signal::System;

    #[test]
    fn slips_are_what_the_count_proves() {
        let (satellite, signal) =
            (Satellite::new(System::Gps, 5), Signal::new(System::Gps, 1, b'C'));
        let mut locks = LockTimes::default();
        let mut at = |time_s: f64,
                      least_s: f64,
                      most_s: f64,
                      half_cycle_added: bool,
                      lost_phase: bool| {
            let time = GpsTime::from_week_tow(2300, time_s).unwrap();
            let lock = (least_s >= 0.0).then_some(LockTime { least_s, most_s });
            let has_phase = !lost_phase;
            locks.update(&Tracked { satellite, signal, time, lock, half_cycle_added, has_phase })
        };
        use Continuity::{Continuous, Repeated, Slipped};
        assert_eq!(at(0.0, 12.0, 12.1, false, false), Continuous, "the first epoch of a file");
        assert_eq!(at(1.0, 13.0, 13.1, false, false), Continuous);
        assert_eq!(at(1.0, 13.0, 13.1, false, false), Repeated);
        assert_eq!(at(2.0, 0.4, 0.5, false, false), Slipped, "less than before");
        assert_eq!(at(3.0, 1.4, 1.5, true, false), Slipped, "half a cycle was added");
        assert_eq!(at(4.0, 2.4, 2.5, true, false), Continuous);
        assert_eq!(
            at(34.0, 20.0, 20.1, true, false),
            Slipped,
            "more than before, less than the gap"
        );
        assert_eq!(at(35.0, 16.0, 32.0, true, false), Continuous, "a rounded count proves nothing");
        assert_eq!(at(36.0, 64.0, f64::INFINITY, true, false), Continuous);
        assert_eq!(
            at(136.0, 64.0, f64::INFINITY, true, false),
            Continuous,
            "the count has stopped"
        );
        assert_eq!(at(137.0, 0.0, 0.1, true, true), Slipped);
        assert_eq!(at(138.0, 1.0, 1.1, true, false), Slipped, "the first phase since then");
        assert_eq!(at(139.0, 2.0, 2.1, true, false), Continuous);
        assert_eq!(at(140.0, -1.0, 0.0, true, true), Continuous, "nothing is said");
        assert_eq!(at(140.0, -1.0, 0.0, true, true), Repeated);
        assert_eq!(at(141.0, 4.0, 4.1, true, false), Continuous, "the lock was not lost");
        assert_eq!(at(142.0, -1.0, 0.0, true, true), Continuous);
        assert_eq!(at(144.0, 1.0, 1.1, true, false), Slipped, "shorter than the time since 141 s");
    }
}
