//! The line that begins an epoch or an event.

use kurs::time::{Calendar, GpsTime};

use super::header::{TimeSystem, Version};
use crate::rinex::fields::{columns, decimal, integer, small_integer};

/// What follows the line (the epoch flag).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum EpochFlag {
    /// 0: observations.
    Observations,
    /// 1: observations after a power failure.
    AfterPowerFailure,
    /// 2: the antenna starts to move; header records may follow.
    MovingAntenna,
    /// 3: a new site is occupied; header records follow.
    NewSite,
    /// 4: header records follow.
    HeaderRecords,
    /// 5: an external event; the time is that of the event.
    ExternalEvent,
    /// 6: cycle slips in the format of observations.
    CycleSlips,
}

/// The line that begins an epoch or an event.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct EpochLine {
    /// On the GPS scale; events may be without.
    pub(super) time: Option<GpsTime>,
    pub(super) flag: EpochFlag,
    /// Satellites or records that follow, as the file counts them.
    pub(super) count: usize,
    pub(super) clock_offset_s: Option<f64>,
}

impl EpochFlag {
    /// Whether the observations of an epoch follow.
    pub(super) const fn has_observations(self) -> bool {
        matches!(self, Self::Observations | Self::AfterPowerFailure)
    }
}

impl EpochLine {
    /// Reads the line; `None` if it is anything else, or damaged.
    pub(super) fn parse(line: &[u8], version: Version, scale: TimeSystem) -> Option<Self> {
        if version.major < 3 { Self::parse_2(line, scale) } else { Self::parse_3(line, scale) }
    }

    /// `1X,I2.2,4(1X,I2),F11.7,2X,I1,I3,12(A1,I2),F12.9`
    fn parse_2(line: &[u8], scale: TimeSystem) -> Option<Self> {
        const DATE: [usize; 5] = [0, 3, 6, 9, 12];
        let blank = |at: usize| line.get(at).is_none_or(|byte| *byte == b' ');
        if !DATE.iter().all(|at| blank(*at)) || !blank(26) || !blank(27) || line.len() < 29 {
            return None;
        }
        let date = || {
            let part = |index: usize| small_integer(&line[DATE[index] + 1..DATE[index] + 3]);
            let year = i32::from(part(0)?);
            Some(Calendar {
                year: if year < 80 { 2000 + year } else { 1900 + year },
                month: part(1)?,
                day: part(2)?,
                hour: part(3)?,
                minute: part(4)?,
                second: decimal(&line[15..26])?,
            })
        };
        let clock_offset_s = decimal(columns(line, 68..80));
        Self::checked(line, 0..26, date(), scale, 28, 29..32, clock_offset_s)
    }

    /// `A1,1X,I4,4(1X,I2.2),F11.7,2X,I1,I3,6X,F15.12`
    fn parse_3(line: &[u8], scale: TimeSystem) -> Option<Self> {
        if line.first() != Some(&b'>') || line.len() < 32 {
            return None;
        }
        let date = || {
            let part = |at: usize| small_integer(&line[at..at + 2]);
            Some(Calendar {
                year: integer(&line[2..6])?,
                month: part(7)?,
                day: part(10)?,
                hour: part(13)?,
                minute: part(16)?,
                second: decimal(&line[18..29])?,
            })
        };
        let clock_offset_s = decimal(columns(line, 41..56));
        Self::checked(line, 1..29, date(), scale, 31, 32..35, clock_offset_s)
    }

    fn checked(
        line: &[u8],
        date_columns: core::ops::Range<usize>,
        date: Option<Calendar>,
        scale: TimeSystem,
        flag_column: usize,
        count_columns: core::ops::Range<usize>,
        clock_offset_s: Option<f64>,
    ) -> Option<Self> {
        let flag = match line.get(flag_column)? {
            b'0' | b' ' => EpochFlag::Observations,
            b'1' => EpochFlag::AfterPowerFailure,
            b'2' => EpochFlag::MovingAntenna,
            b'3' => EpochFlag::NewSite,
            b'4' => EpochFlag::HeaderRecords,
            b'5' => EpochFlag::ExternalEvent,
            b'6' => EpochFlag::CycleSlips,
            _ => return None,
        };
        let count = integer_or_blank(columns(line, count_columns))?;
        let time = date.and_then(|date| scale.instant(date));
        let no_date = columns(line, date_columns).trim_ascii().is_empty();
        if time.is_none() && (flag.has_observations() || !no_date) {
            return None;
        }
        Some(Self { time, flag, count, clock_offset_s })
    }
}

fn integer_or_blank(field: &[u8]) -> Option<usize> {
    if field.trim_ascii().is_empty() {
        return Some(0);
    }
    integer(field).and_then(|count| usize::try_from(count).ok())
}
