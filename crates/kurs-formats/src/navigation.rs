//! Navigation data of any format: the format is found by content, not by name.

use std::collections::BTreeMap;

use kurs::ephemeris::NavigationData;
use kurs::signal::System;

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
    if !source.advance()? {
        return Err(source.wrong_content("an empty file", EXPECTED));
    }
    let mut summary = ReadSummary::default();
    if let Some(version) = rinex::navigation::version_of(source.line()) {
        rinex::navigation::read(source, version, data, &mut summary)?;
    } else if sp3::is_first_line(source.line()) {
        sp3::read(source, &mut data.ephemerides, &mut summary)?;
    } else {
        return Err(source.wrong_content(appearance(source.line()), EXPECTED));
    }
    if let Some(reason) = source.broken_off() {
        summary.damage.note(source.line_number(), reason.to_owned());
    }
    Ok(summary)
}

const EXPECTED: &str = "a navigation file (RINEX 2, 3 or 4) or precise orbits (SP3)";

/// What a first line looks like, for the message.
fn appearance(line: &[u8]) -> String {
    let text = String::from_utf8_lossy(line);
    if text.contains("RINEX VERSION / TYPE") || text.contains("CRINEX VERS") {
        let kind = text.chars().skip(20).take(20).collect::<String>();
        return format!("a RINEX file of type {:?}", kind.trim());
    }
    let start: String = text.chars().take(40).collect();
    format!("a file that starts with {start:?}")
}
