//! Navigation data of any format: the format is found by content, not by name.

use std::collections::BTreeMap;

use kurs::ephemeris::NavigationData;
use kurs::signal::System;

use crate::content::Content;
use crate::damage::DamageLog;
use crate::rinex;
use crate::source::{ReadError, Source};
use crate::sp3;

/// What was found in a file.
#[derive(Debug, Clone, Default)]
pub struct ReadSummary {
    /// Ephemerides taken (SP3: nodes), per system.
    pub records: BTreeMap<System, usize>,
    /// Records read past on purpose, per system letter and message (`"G CNAV"`).
    pub read_past: BTreeMap<String, usize>,
    /// What could not be used.
    pub damage: DamageLog,
}

/// Reads a navigation file and adds what it holds to `data`: RINEX navigation 2, 3 and 4, and
/// SP3 a to d.
///
/// A damaged record is noted in the summary and loses no other one.
///
/// # Errors
///
/// [`ReadError`] if reading fails or the content is something else.
pub fn read(source: &mut Source, data: &mut NavigationData) -> Result<ReadSummary, ReadError> {
    let content = Content::of(source.start(Content::ENOUGH)?);
    let mut summary = ReadSummary::default();
    match content {
        Content::RinexNavigation => rinex::navigation::read(source, data, &mut summary)?,
        Content::Sp3 => sp3::read(source, &mut data.ephemerides, &mut summary)?,
        other => return Err(source.wrong_content(other.to_string(), EXPECTED)),
    }
    if let Some(reason) = source.broken_off() {
        summary.damage.note(source.line_number(), reason.to_owned());
    }
    Ok(summary)
}

const EXPECTED: &str = "a navigation file (RINEX 2, 3 or 4) or precise orbits (SP3)";
