//! What a file says happened between its observations.

use core::fmt;

use kurs::time::GpsTime;

use super::epoch_line::{EpochFlag, EpochLine};

/// An event record of an observation file.
///
/// Every event is treated alike: it is noted, and header records behind it are in force from there
/// on. None of them touches a phase: a receiver that lost lock says so in its digits.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Event {
    /// Line of the (decompressed) file, counted from 1.
    pub line: u64,
    /// When, if the record says so.
    pub time: Option<GpsTime>,
    /// What.
    pub kind: EventKind,
}

/// The meaning of an event record (epoch flags 1 to 6).
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum EventKind {
    /// 1: the receiver was without power before this epoch.
    PowerFailure,
    /// 2: the antenna starts to move.
    MovingAntenna,
    /// 3: a new site is occupied, the antenna stands still again.
    NewSite,
    /// 4: header records.
    HeaderRecords,
    /// 5: an external event at the receiver's input.
    ExternalEvent,
    /// 6: records of cycle slips.
    CycleSlips,
}

/// The events of one file: the first ones in full, all of them counted.
#[derive(Debug, Clone, Default)]
pub struct EventLog {
    listed: Vec<Event>,
    total: u64,
}

impl EventKind {
    const fn of(flag: EpochFlag) -> Option<Self> {
        Some(match flag {
            EpochFlag::Observations => return None,
            EpochFlag::AfterPowerFailure => Self::PowerFailure,
            EpochFlag::MovingAntenna => Self::MovingAntenna,
            EpochFlag::NewSite => Self::NewSite,
            EpochFlag::HeaderRecords => Self::HeaderRecords,
            EpochFlag::ExternalEvent => Self::ExternalEvent,
            EpochFlag::CycleSlips => Self::CycleSlips,
        })
    }
}

impl fmt::Display for EventKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::PowerFailure => "power failure",
            Self::MovingAntenna => "the antenna starts to move",
            Self::NewSite => "new site",
            Self::HeaderRecords => "new header records",
            Self::ExternalEvent => "external event",
            Self::CycleSlips => "cycle slip records",
        })
    }
}

impl EventLog {
    /// Events that are kept; a file with an event every millisecond must not fill the memory.
    pub const LISTED_MAX: usize = 1000;

    /// Notes the event that an epoch line at `line` begins, if it begins one.
    pub(super) fn note(&mut self, line: u64, epoch_line: &EpochLine) {
        let Some(kind) = EventKind::of(epoch_line.flag) else { return };
        self.total += 1;
        if self.listed.len() < Self::LISTED_MAX {
            self.listed.push(Event { line, time: epoch_line.time, kind });
        }
    }

    /// The first [`EventLog::LISTED_MAX`] events, in the order of the file.
    #[must_use]
    pub fn listed(&self) -> &[Event] {
        &self.listed
    }

    /// How many there were altogether.
    #[must_use]
    pub const fn total(&self) -> u64 {
        self.total
    }
}
