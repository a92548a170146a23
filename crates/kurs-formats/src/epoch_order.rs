//! Epochs in increasing order of time, whatever a file does.
//!
//! An epoch that is not later than the one before is skipped. A damaged date far in the future must
//! not make everything behind it look late: an epoch that jumps ahead is held until the next one is
//! read, and it is the one skipped if the next one is earlier.

use kurs::observation::AntennaEpoch;
use kurs::time::GpsTime;

use crate::damage::DamageLog;
use crate::pending_slips::PendingSlips;
use crate::source::ReadError;

/// A step this many times the shortest one is a jump, to be confirmed by the next epoch.
pub(crate) const JUMP_STEPS: f64 = 10.0;
/// Epochs in a row, each later than the one before but earlier than what was given out, that show
/// a clock set back: a single damaged date is alone.
const SET_BACK: u32 = 3;

/// Epochs as they stand in a file, in whatever order.
pub(crate) trait RawEpochs {
    /// Reads the next epoch into `epoch` and gives its place (line or byte); `None` at the end.
    fn next(&mut self, epoch: &mut AntennaEpoch) -> Result<Option<u64>, ReadError>;

    /// Slips to be marked in coming epochs.
    fn slips(&mut self) -> &mut PendingSlips;

    /// Where skipped epochs are noted.
    fn damage(&mut self) -> &mut DamageLog;
}

/// Epochs with increasing times: one that is not later than the epoch before is skipped; one that
/// jumps far ahead is skipped if the next one is earlier.
#[derive(Debug)]
pub(crate) struct Ordered<E> {
    pub(crate) raw: E,
    /// Place of the epoch that was given out last.
    pub(crate) place: u64,
    order: EpochOrder,
}

impl<E: RawEpochs> Ordered<E> {
    pub(crate) fn new(raw: E) -> Self {
        Self { raw, place: 0, order: EpochOrder::default() }
    }

    /// For a stream, whose first epochs come out without waiting for confirmation.
    pub(crate) fn prompt(raw: E) -> Self {
        let order = EpochOrder { is_prompt: true, ..EpochOrder::default() };
        Self { order, ..Self::new(raw) }
    }

    /// For a stream whose receiver alone can correct its clock: where the clock is set back, epochs
    /// come out at their earlier times once several have confirmed it.
    pub(crate) const fn follow_clock_set_back(&mut self) {
        self.order.follows_set_back = true;
    }

    /// Reads the next epoch into `epoch`; `false` (and no observations) at the end.
    pub(crate) fn next_epoch(&mut self, epoch: &mut AntennaEpoch) -> Result<bool, ReadError> {
        let Some(mut place) = self.next_later(epoch)? else {
            epoch.observations.clear();
            return Ok(false);
        };
        if self.order.jumps(epoch.time) {
            place = self.confirm(epoch, place)?;
        }
        self.place = place;
        self.order.give_out(epoch.time);
        Ok(true)
    }

    /// The next epoch that is later than all before, with its place.
    fn next_later(&mut self, epoch: &mut AntennaEpoch) -> Result<Option<u64>, ReadError> {
        loop {
            let place = match self.order.take_next(epoch) {
                Some(place) => place,
                None => match self.raw.next(epoch)? {
                    Some(place) => place,
                    None => return Ok(None),
                },
            };
            if self.order.is_later(epoch.time) || self.order.is_set_back(epoch.time) {
                return Ok(Some(place));
            }
            note_late(&mut self.raw, epoch, place);
        }
    }

    /// Keeps an epoch that jumps ahead only if the one behind it is not earlier; gives the place of
    /// the one that is kept.
    fn confirm(&mut self, epoch: &mut AntennaEpoch, mut place: u64) -> Result<u64, ReadError> {
        loop {
            let Some(next_place) = self.raw.next(self.order.next_mut())? else { return Ok(place) };
            let next_time = self.order.next_mut().time;
            if next_time > epoch.time {
                self.order.hold_next(next_place);
                return Ok(place);
            }
            let next_is_right = next_time < epoch.time && self.order.is_later(next_time);
            if !next_is_right {
                note_late(&mut self.raw, self.order.next_mut(), next_place);
                continue;
            }
            core::mem::swap(self.order.next_mut(), epoch);
            let skipped = self.order.next_mut();
            self.raw.damage().note_with(place, || {
                format!("epoch {} lies ahead of the next one, skipped", skipped.time).into()
            });
            self.raw.slips().keep_from(skipped);
            self.raw.slips().apply(epoch, false);
            place = next_place;
            if !self.order.jumps(epoch.time) {
                return Ok(place);
            }
        }
    }
}

fn note_late(raw: &mut impl RawEpochs, epoch: &AntennaEpoch, place: u64) {
    raw.slips().keep_from(epoch);
    raw.damage().note_with(place, || {
        format!("epoch {} is not later than the one before, skipped", epoch.time).into()
    });
}

/// What was given out so far, and the epoch behind a jump.
#[derive(Debug, Default)]
struct EpochOrder {
    last: Option<GpsTime>,
    shortest_step_s: Option<f64>,
    /// Place of the epoch in `next`, if there is one.
    next_place: Option<u64>,
    next: AntennaEpoch,
    /// A jump is one only where the interval is known.
    is_prompt: bool,
    /// Time may be set back.
    follows_set_back: bool,
    /// The last epoch that was not later, and how many went on from each other until it.
    earlier: Option<(GpsTime, u32)>,
}

impl EpochOrder {
    /// Whether the time is behind everything that was given out.
    fn is_later(&self, time: GpsTime) -> bool {
        self.last.is_none_or(|last| time > last)
    }

    /// Whether an epoch that is not later confirms that time was set back; what was given out
    /// before does not bind then.
    fn is_set_back(&mut self, time: GpsTime) -> bool {
        let step_s = self.shortest_step_s.unwrap_or(f64::INFINITY);
        let goes_on = |before: GpsTime| time > before && time - before <= JUMP_STEPS * step_s;
        let count = match self.earlier {
            Some((before, count)) if goes_on(before) => count + 1,
            _ => 1,
        };
        self.earlier = Some((time, count));
        let is_set_back = self.follows_set_back && count >= SET_BACK;
        if is_set_back {
            self.last = None;
        }
        is_set_back
    }

    /// Whether the time is so far ahead that the next epoch must confirm it.
    fn jumps(&self, time: GpsTime) -> bool {
        let (Some(last), Some(step_s)) = (self.last, self.shortest_step_s) else {
            return !self.is_prompt;
        };
        time - last > JUMP_STEPS * step_s
    }

    /// Takes note of an epoch that is given out.
    fn give_out(&mut self, time: GpsTime) {
        self.earlier = None;
        if let Some(last) = self.last.replace(time) {
            let step_s = time - last;
            self.shortest_step_s = Some(self.shortest_step_s.map_or(step_s, |s| s.min(step_s)));
        }
    }

    /// The buffer for the epoch behind a jump.
    const fn next_mut(&mut self) -> &mut AntennaEpoch {
        &mut self.next
    }

    /// The epoch in the buffer, read at `place`, comes next.
    const fn hold_next(&mut self, place: u64) {
        self.next_place = Some(place);
    }

    /// Exchanges the held epoch with `epoch`; `None` if none is held.
    const fn take_next(&mut self, epoch: &mut AntennaEpoch) -> Option<u64> {
        let place = self.next_place.take();
        if place.is_some() {
            core::mem::swap(&mut self.next, epoch);
        }
        place
    }
}
