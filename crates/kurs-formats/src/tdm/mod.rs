//! CCSDS Tracking Data Message (503.0-B-2), as text (KVN) and XML: angles of type AZEL, ranges and
//! range differences of ground stations. Everything else that the standard knows (Doppler,
//! frequencies, power, weather …) is read past and counted.
//!
//! Angles become radians, ranges metres, time tags GPST; corrections that the file says have not
//! been applied are added. Ranges come as the file has them: for a two-way path the standard leaves
//! to the partners whether that is the round trip or half of it. Time tags are not moved by the
//! light time.

mod epoch;
mod kvn;
mod segment;
mod write;
mod xml;

use std::collections::BTreeMap;

use kurs::time::GpsTime;

pub use epoch::TimeSystem;
pub use write::{Form, write};

/// What was measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Observable {
    /// Clockwise from north, rad.
    Azimuth,
    /// Above the horizon, rad.
    Elevation,
    /// Range over a one-way path, m.
    OneWayRange,
    /// Range over a path out and back, m: half of it or all of it, see the module's text.
    TwoWayRange,
    /// Range to the station minus range to the reference, m.
    RangeDifference,
}

/// One measurement.
#[derive(Debug, Clone, PartialEq)]
pub struct TrackingRecord {
    /// When.
    pub time: GpsTime,
    /// The participant that received the signal.
    pub station: String,
    /// The other participant of a range difference, whose range is subtracted.
    pub reference: Option<String>,
    /// The participant before the station on the path: the object.
    pub object: String,
    /// What was measured.
    pub observable: Observable,
    /// Its value: rad or m.
    pub value: f64,
    /// Line of the file, counted from 1; 0 for a record that was not read from a file.
    pub line: usize,
}

/// The measurements of a message, in the order of the file.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct TrackingData {
    /// The measurements.
    pub records: Vec<TrackingRecord>,
    /// How often each data keyword without a use here was met.
    pub read_past: BTreeMap<String, usize>,
    /// Why segments were left out, each as a whole, and where.
    pub left_out: Vec<TdmError>,
}

impl TrackingData {
    /// Ends a segment whose records begin at `first`: it is left out if something in it cannot be
    /// used.
    fn end_segment(&mut self, first: usize, unusable: Option<TdmError>) {
        if unusable.is_some() {
            self.records.truncate(first);
        }
        self.left_out.extend(unusable);
    }

    /// The data, unless no segment can be used.
    fn checked(self, segments: usize) -> Result<Self, TdmError> {
        match self.left_out.first() {
            Some(first) if self.left_out.len() == segments => Err(first.clone()),
            _ => Ok(self),
        }
    }
}

/// What is wrong with a message, and where.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("line {line}: {keyword}: {what}")]
pub struct TdmError {
    /// Counted from 1.
    pub line: usize,
    /// The keyword that is wrong or missing.
    pub keyword: String,
    /// What was found and what was expected.
    pub what: String,
}

impl TdmError {
    fn new(line: usize, keyword: &str, what: impl Into<String>) -> Self {
        Self { line, keyword: keyword.to_owned(), what: what.into() }
    }
}

/// Whether a text looks like a Tracking Data Message.
#[must_use]
pub fn looks_like(text: &str) -> bool {
    let start = text.trim_start_matches('\u{feff}').trim_start();
    let head: String = start.chars().take(2000).collect();
    head.contains("CCSDS_TDM_VERS") || (head.starts_with('<') && head.contains("<tdm"))
}

/// Reads a message; XML and KVN are told apart by the first character. A segment in which something
/// cannot be used is left out.
///
/// # Errors
///
/// [`TdmError`] with line and keyword, if the sections are not as they should be or no segment can
/// be used.
pub fn read(text: &str) -> Result<TrackingData, TdmError> {
    let text = text.trim_start_matches('\u{feff}');
    if text.trim_start().starts_with('<') { xml::read(text) } else { kvn::read(text) }
}

#[cfg(test)]
mod tests;
