//! Dates of a log whose sentences tell times of day.
//!
//! Days are counted over midnight from the first sentence on. A date that stands with day number
//! `n` says that day 0 was `n` days before it, and is a vote for that day. Sentences that follow
//! each other within a minute are of one stretch, and all of a stretch have one day 0: the one with
//! most votes. So a receiver that states a wrong date for a while is found out, and a pause of days
//! is obeyed.

use std::collections::BTreeMap;

use kurs::time::{Calendar, GpsTime};

use super::Date;
use crate::damage::DamageLog;

pub(super) const DAY_S: f64 = 86_400.0;
/// A step of the time of day by more than this goes over midnight.
const HALF_DAY_S: f64 = 43_200.0;
/// The time of day goes on by no more within a stretch, and
const MAX_STEP_S: f64 = 60.0;
/// back by no more: sentences of one epoch come in any order.
const MAX_STEP_BACK_S: f64 = 2.0;

/// Days, counted from the first sentence, and what is said of their dates.
#[derive(Debug, Default)]
pub(super) struct Dates {
    /// Time of day and day number of the last sentence.
    last: Option<(f64, i32)>,
    /// For each day 0 that a sentence of this stretch stands for: votes, and line of the first one.
    votes: BTreeMap<i64, (u64, u64)>,
    /// The same of sentences that say themselves that they do not hold.
    void: Option<i64>,
    /// Day 0 of the stretch before.
    day_zero: Option<i64>,
}

impl Dates {
    /// Takes the time of day of a sentence; its day number, and whether it begins a new stretch.
    pub(super) fn step(&mut self, day_s: f64) -> (i32, bool) {
        let Some((last_s, day)) = self.last else {
            self.last = Some((day_s, 0));
            return (0, false);
        };
        let step_s = day_s - last_s;
        let (day, step_s) = if step_s < -HALF_DAY_S {
            (day + 1, step_s + DAY_S)
        } else if step_s > HALF_DAY_S {
            (day - 1, step_s - DAY_S)
        } else {
            (day, step_s)
        };
        self.last = Some((day_s, day));
        (day, !(-MAX_STEP_BACK_S..=MAX_STEP_S).contains(&step_s))
    }

    /// A date stood with this day number on a line; `holds` by the sentence's own word.
    pub(super) fn vote(
        &mut self,
        date: Date,
        day: i32,
        holds: bool,
        line: u64,
    ) -> Result<(), String> {
        let day_zero = days(date)? - i64::from(day);
        if holds {
            self.votes.entry(day_zero).or_insert((0, line)).0 += 1;
        } else {
            self.void.get_or_insert(day_zero);
        }
        Ok(())
    }

    /// Whether any sentence of this stretch has a date.
    pub(super) fn has_votes(&self) -> bool {
        !self.votes.is_empty()
    }

    /// Ends the stretch: its day 0, by its own dates or those before it. What was outvoted is
    /// damage.
    pub(super) fn end_stretch(&mut self, damage: &mut DamageLog) -> Option<i64> {
        let votes = core::mem::take(&mut self.votes);
        // Among equals the first one said.
        let best = votes.iter().max_by_key(|(_, (count, line))| (*count, u64::MAX - *line));
        if let Some((best, _)) = best {
            self.day_zero = Some(*best);
            for (other, (count, line)) in votes.iter().filter(|(other, _)| *other != best) {
                damage.note(
                    *line,
                    format!(
                        "{count} sentences date the log {} days off the others, passed over",
                        other - best
                    ),
                );
            }
        }
        self.day_zero
    }

    /// Day 0 by a date from outside that belongs to this day number, or by a sentence that does not
    /// hold, where no sentence of the whole log has a date.
    pub(super) fn assumed(&self, first: Option<(Date, i32)>) -> Option<i64> {
        let given = first.and_then(|(date, day)| Some(days(date).ok()? - i64::from(day)));
        given.or(self.void)
    }
}

/// The instant of a time of day (UTC).
pub(super) fn instant(day_zero: i64, day: i32, day_s: f64) -> Option<GpsTime> {
    // The calendar is that of UTC: its days are counted without leap seconds.
    #[allow(clippy::cast_precision_loss)]
    let noon = GpsTime::default() + DAY_S * (day_zero + i64::from(day)) as f64 + HALF_DAY_S;
    let Calendar { year, month, day, .. } = noon.calendar();
    let midnight = Calendar { year, month, day, hour: 0, minute: 0, second: 0.0 };
    Some(GpsTime::from_utc(midnight)? + day_s)
}

/// Days from the beginning of GPS time.
fn days((year, month, day): Date) -> Result<i64, String> {
    let noon = Calendar { year, month, day, hour: 12, minute: 0, second: 0.0 };
    let noon = GpsTime::from_calendar(noon)
        .ok_or_else(|| format!("{year}-{month:02}-{day:02} is no date since 1980"))?;
    // Some ten thousand days.
    #[allow(clippy::cast_possible_truncation)]
    Ok(((noon - GpsTime::default()) / DAY_S).floor() as i64)
}
