//! Epochs in increasing order of time, whatever a file does.
//!
//! An epoch that is not later than the one before is skipped. A damaged date far in the future must
//! not make everything behind it look late: an epoch that jumps ahead is held until the next one is
//! read, and it is the one skipped if the next one is earlier.

use kurs::observation::AntennaEpoch;
use kurs::time::GpsTime;

/// A step this many times the shortest one is a jump, to be confirmed by the next epoch.
const JUMP_STEPS: f64 = 10.0;

/// What was given out so far, and the epoch behind a jump.
#[derive(Debug, Default)]
pub(super) struct EpochOrder {
    last: Option<GpsTime>,
    shortest_step_s: Option<f64>,
    /// Line of the epoch in `next`, if there is one.
    next_line: Option<u64>,
    next: AntennaEpoch,
}

impl EpochOrder {
    /// Whether the time is behind everything that was given out.
    pub(super) fn is_later(&self, time: GpsTime) -> bool {
        self.last.is_none_or(|last| time > last)
    }

    /// Whether the time is so far ahead that the next epoch must confirm it.
    pub(super) fn jumps(&self, time: GpsTime) -> bool {
        let (Some(last), Some(step_s)) = (self.last, self.shortest_step_s) else { return true };
        time - last > JUMP_STEPS * step_s
    }

    /// Takes note of an epoch that is given out.
    pub(super) fn give_out(&mut self, time: GpsTime) {
        if let Some(last) = self.last.replace(time) {
            let step_s = time - last;
            self.shortest_step_s = Some(self.shortest_step_s.map_or(step_s, |s| s.min(step_s)));
        }
    }

    /// The buffer for the epoch behind a jump.
    pub(super) const fn next_mut(&mut self) -> &mut AntennaEpoch {
        &mut self.next
    }

    /// The epoch in the buffer, read at `line`, comes next.
    pub(super) const fn hold_next(&mut self, line: u64) {
        self.next_line = Some(line);
    }

    /// Exchanges the held epoch with `epoch`; `None` if none is held.
    pub(super) const fn take_next(&mut self, epoch: &mut AntennaEpoch) -> Option<u64> {
        let line = self.next_line.take();
        if line.is_some() {
            core::mem::swap(&mut self.next, epoch);
        }
        line
    }
}
