//! RINEX navigation files 2.x, 3.x and 4.x.
//!
//! Source: RINEX 2.11 (tables A3 to A12), 3.05 and 4.02 (tables A5 to A36). A record ends where a
//! line begins that does not start with blanks, so that a damaged record never takes lines of the
//! next one, and records of unknown messages are read past.

mod header;
mod message;
mod record;

use kurs::ephemeris::NavigationData;
use kurs::signal::System;

use self::record::{Kind, Record};
use crate::navigation::ReadSummary;
use crate::source::{ReadError, Source};

/// What the first line of the file says.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Version {
    /// 2, 3 or 4.
    major: u8,
    /// RINEX 2: the system of all records without a system letter.
    system: System,
}

/// The version in the first line of a RINEX navigation file; `None` if it is none.
pub(crate) fn version_of(line: &[u8]) -> Option<Version> {
    let label = line.get(60..)?;
    if !label.starts_with(b"RINEX VERSION / TYPE") {
        return None;
    }
    let version = str::from_utf8(line.get(..9)?).ok()?.trim().parse::<f64>().ok()?;
    let major = [2, 3, 4].into_iter().find(|major| version.floor() == f64::from(*major))?;
    let system = match (major, line.get(20)?) {
        (2, b'G') => System::Glonass,
        (2, b'H') => System::Sbas,
        (2, b'E' | b'L') => System::Galileo,
        (_, b'N') => System::Gps,
        _ => return None,
    };
    Some(Version { major, system })
}

/// Reads what follows the first line.
pub(crate) fn read(
    source: &mut Source,
    version: Version,
    data: &mut NavigationData,
    summary: &mut ReadSummary,
) -> Result<(), ReadError> {
    header::read(source, data, summary)?;
    let mut record = Record::default();
    while source.advance()? {
        let line = source.line();
        if line.iter().all(u8::is_ascii_whitespace) {
            continue;
        }
        let number = source.line_number();
        if line[0] == b'>' {
            finish(&mut record, data, summary);
            record.begin_frame(line, number);
        } else if record.is_frame_without_lines() || !record::is_continuation(line, version) {
            if !record.is_frame_without_lines() {
                finish(&mut record, data, summary);
            }
            record.begin(line, number, version);
        } else {
            record.continue_with(line, version);
        }
    }
    finish(&mut record, data, summary);
    Ok(())
}

/// Takes a record that is complete, and leaves an empty one.
fn finish(record: &mut Record, data: &mut NavigationData, summary: &mut ReadSummary) {
    let record = core::mem::take(record);
    let taken = match record.kind {
        Kind::None => return,
        Kind::Ephemeris => record.ephemeris(),
        Kind::Ionosphere => record.store_ionosphere(&mut data.ionosphere).map(|()| None),
        Kind::TimeOffset => record.store_time_offset(data).map(|()| None),
        Kind::Other => Ok(None),
    };
    match taken {
        Ok(Some(ephemeris)) => {
            *summary.records.entry(ephemeris.satellite().system).or_default() += 1;
            data.ephemerides.insert(ephemeris);
        }
        Ok(None) if matches!(record.kind, Kind::Ephemeris | Kind::Other) => {
            *summary.read_past.entry(record.name()).or_default() += 1;
        }
        Ok(None) => {}
        Err(what) => summary.damage.note(record.line, what),
    }
}
