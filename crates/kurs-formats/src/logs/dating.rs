//! The week in which a log of RTCM 3 messages begins.
//!
//! Observations tell the time of the week only. Every ephemeris with a week of its own says how
//! many weeks the log is away from where its clock began here, and the majority counts: a receiver
//! may send an ephemeris that it has kept for years.

use std::collections::BTreeMap;

use kurs::time::{GpsTime, WEEK_S};

use super::frames::{Frame, Protocol};
use crate::rtcm::clock::{self, Day};
use crate::rtcm::{self, ObservationHeader};
use crate::sbf::block::Block;
use crate::ubx::rawx;

/// Where a week of ten bits is all that is known, it is taken from the 1024 weeks around this one
/// (2024-03-03): from 2014-05-11 to 2033-12-25.
pub(crate) const MIDDLE_WEEK_NS: i64 = 2304 * 604_800_000_000_000;
/// Weeks after which ten bits begin anew.
const TEN_BITS: i64 = 1024;
/// Voices of one week that are enough, if others have less than half as many.
const ENOUGH: u32 = 6;
/// Told times that wait for the first observation.
const WAITING_MAX: usize = 1000;

/// How a time was told.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Told {
    /// With its week.
    Whole,
    /// With the last ten bits of its week.
    TenBits,
}

/// What is known of a log's date.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Begin {
    /// The first observation whose message has a time of the week; of the first one of any where
    /// none has.
    pub(crate) time: GpsTime,
    /// Whether the log has a system whose messages tell the time of the week.
    pub(crate) is_weekly: bool,
}

/// Collects what the messages of a log tell.
#[derive(Debug, Clone)]
pub(crate) struct Dating {
    /// A time within ten years.
    near: GpsTime,
    /// The clock of the log, in a week of its own: first and last time.
    clock: Option<(GpsTime, GpsTime)>,
    is_weekly: bool,
    waiting: Vec<(GpsTime, Told)>,
    whole: BTreeMap<i64, u32>,
    ten_bits: BTreeMap<i64, u32>,
}

impl Dating {
    /// `near` is a time within ten years of the log; without one it is taken to be between 2014 and
    /// 2033.
    pub(crate) fn new(near: Option<GpsTime>) -> Self {
        Self {
            near: near.unwrap_or(GpsTime::from_nanoseconds(MIDDLE_WEEK_NS)),
            clock: None,
            is_weekly: false,
            waiting: Vec::new(),
            whole: BTreeMap::new(),
            ten_bits: BTreeMap::new(),
        }
    }

    /// Takes in a message of any protocol.
    pub(crate) fn take(&mut self, frame: &Frame<'_>) {
        match frame.protocol {
            Protocol::Ubx if frame.body[..2] == rawx::RXM_RAWX => {
                rawx::time(&frame.body[4..])
                    .into_iter()
                    .for_each(|time| self.told(time, Told::Whole));
            }
            Protocol::Ubx => {}
            Protocol::Sbf => {
                let time = Block::of(frame.body).time();
                time.into_iter().for_each(|time| self.told(time, Told::Whole));
            }
            Protocol::Rtcm3 => {
                if let Some(header) = ObservationHeader::read(frame.body) {
                    self.observed(&header);
                } else if let Some(Ok(received)) =
                    rtcm::ephemeris::read(rtcm::number(frame.body), frame.body, self.near)
                {
                    let how = if received.is_dated { Told::Whole } else { Told::TenBits };
                    self.told(received.ephemeris.reference_time(), how);
                }
            }
        }
    }

    /// Moves the clock on.
    fn observed(&mut self, header: &ObservationHeader) {
        let is_weekly = clock::is_weekly(header);
        if self.is_weekly && !is_weekly {
            return;
        }
        let begins = self.clock.is_none() || (is_weekly && !self.is_weekly);
        let near = self.clock.map_or(self.near, |(_, last)| last);
        let Some(time) = clock::resolve(header, near, Day::Stated) else { return };
        self.is_weekly |= is_weekly;
        self.clock = match self.clock {
            Some((first, _)) if !begins => Some((first, time)),
            _ => Some((time, time)),
        };
        if self.is_weekly {
            core::mem::take(&mut self.waiting)
                .into_iter()
                .for_each(|(told, how)| self.vote(told, how));
        }
    }

    fn told(&mut self, time: GpsTime, how: Told) {
        if self.is_weekly {
            self.vote(time, how);
        } else if self.waiting.len() < WAITING_MAX {
            self.waiting.push((time, how));
        }
    }

    /// Counts how many weeks the clock must be put ahead.
    fn vote(&mut self, told: GpsTime, how: Told) {
        let now = self.clock.map_or(self.near, |(_, last)| last);
        #[allow(clippy::cast_possible_truncation)] // some thousands
        let weeks = ((told - now) / WEEK_S).round() as i64;
        let votes = if how == Told::Whole { &mut self.whole } else { &mut self.ten_bits };
        *votes.entry(weeks).or_default() += 1;
    }

    /// Whether more messages would not change the answer.
    pub(crate) fn is_settled(&self) -> bool {
        let total: u32 = self.whole.values().chain(self.ten_bits.values()).sum();
        let most = self.voices().max().map_or(0, |(count, _)| count);
        self.is_weekly && most >= ENOUGH && total - most < most / 2
    }

    /// Where the log begins (without observations some days around it); `None` if nothing in it
    /// tells the week.
    pub(crate) fn begin(mut self) -> Option<Begin> {
        core::mem::take(&mut self.waiting).into_iter().for_each(|(told, how)| self.vote(told, how));
        let first = self.clock.map_or(self.near, |(first, _)| first);
        let time = first + self.weeks()? as f64 * WEEK_S;
        Some(Begin { time, is_weekly: self.is_weekly })
    }

    /// The first observation if `date` is within three days of it.
    pub(crate) fn begin_near(&self, date: GpsTime) -> Option<Begin> {
        let (first, _) = self.clock?;
        let time = date.nearest_with_tow(first.tow_s())?;
        Some(Begin { time, is_weekly: self.is_weekly })
    }

    /// Votes for putting the clock ahead, by the number of weeks. Ten bits support every whole week
    /// that ends with them, and stand for themselves where there is none.
    fn voices(&self) -> impl Iterator<Item = (u32, i64)> {
        let supported = |weeks: i64| {
            let same = |(other, _): &(&i64, &u32)| (weeks - **other).rem_euclid(TEN_BITS) == 0;
            self.ten_bits.iter().filter(same).map(|(_, count)| *count).sum::<u32>()
        };
        let whole =
            self.whole.iter().map(move |(weeks, count)| (count + supported(*weeks), *weeks));
        whole.chain(self.ten_bits.iter().map(|(weeks, count)| (*count, *weeks)))
    }

    /// What most say; of several the latest, because what is stale is old.
    fn weeks(&self) -> Option<i64> {
        self.voices().max().map(|(_, weeks)| weeks)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use kurs::signal::System;

    /// A GPS message of Monday noon.
    const NOON: ObservationHeader = ObservationHeader {
        system: System::Gps,
        station: 0,
        epoch_time: 129_600_000,
        more_follows: false,
    };

    fn at(week: i32) -> GpsTime {
        GpsTime::from_week_tow(week, 129_600.0).unwrap()
    }

    /// The week in which a log begins that tells these weeks before and behind its observations.
    fn week(before: &[(i32, Told)], behind: &[(i32, Told)]) -> Option<i64> {
        let mut dating = Dating::new(None);
        before.iter().for_each(|(week, how)| dating.told(at(*week) + 7200.0, *how));
        dating.observed(&NOON);
        behind.iter().for_each(|(week, how)| dating.told(at(*week) + -7200.0, *how));
        dating.begin().map(|begin| begin.time.week())
    }

    #[test]
    fn the_majority_tells_the_week() {
        use Told::{TenBits, Whole};
        assert_eq!(week(&[], &[]), None);
        assert_eq!(week(&[(2100, Whole)], &[(2300, Whole), (2300, Whole)]), Some(2300));
        assert_eq!(week(&[(2100, Whole), (2300, Whole)], &[]), Some(2300), "the stale one is old");
        // Ten bits outvote one whole week, and support one.
        assert_eq!(week(&[(2100, Whole)], &[(2300, TenBits), (2300, TenBits)]), Some(2300));
        assert_eq!(week(&[(1276, Whole), (2400, Whole)], &[(2300, TenBits)]), Some(1276));
        assert_eq!(week(&[(2310, TenBits)], &[]), Some(2310));
    }

    #[test]
    fn a_clear_majority_is_enough() {
        let mut dating = Dating::new(None);
        dating.observed(&NOON);
        dating.told(at(2100), Told::Whole);
        for _ in 0..5 {
            dating.told(at(2300), Told::TenBits);
            assert!(!dating.is_settled());
        }
        dating.told(at(2300), Told::TenBits);
        assert!(dating.is_settled());
    }
}
