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
use crate::read_summary::ReadSummary;
use crate::rinex::fields::{columns, decimal, label, text};
use crate::source::{ReadError, Source};

/// What the first line of the file says.
#[derive(Debug, Clone, Copy)]
struct Version {
    /// 2, 3 or 4.
    major: u8,
    /// RINEX 2: the system of all records without a system letter.
    system: System,
}

/// Reads the first line that is not empty.
fn first_line(source: &mut Source) -> Result<Version, ReadError> {
    while source.advance()? && source.line().trim_ascii().is_empty() {}
    let line = source.line();
    let major = decimal(columns(line, 0..9))
        .and_then(|version| [2, 3, 4].into_iter().find(|m| version.floor() == f64::from(*m)))
        .ok_or_else(|| {
            let found = text(line, 0..9);
            source.bad_line(format!("version {found:?}, expected RINEX of version 2, 3 or 4"))
        })?;
    // RINEX 2.12 has one type of file for all systems, and names the system as RINEX 3 does.
    let system = match (line.get(20), line.get(40)) {
        (Some(b'G'), _) => System::Glonass,
        (Some(b'H'), _) => System::Sbas,
        (Some(b'L'), _) => System::Galileo,
        (Some(b'J'), _) | (_, Some(b'Q')) => System::Qzss,
        (_, Some(letter)) => System::from_letter(*letter).unwrap_or(System::Gps),
        _ => System::Gps,
    };
    Ok(Version { major, system })
}

/// Reads a whole file.
pub(crate) fn read(
    source: &mut Source,
    data: &mut NavigationData,
    summary: &mut ReadSummary,
) -> Result<(), ReadError> {
    let mut version = first_line(source)?;
    header::read(source, version, data, summary)?;
    let mut record = Record::default();
    while source.advance()? {
        let line = source.line();
        if line.iter().all(u8::is_ascii_whitespace) {
            continue;
        }
        let number = source.line_number();
        if line.trim_ascii() == b"END OF FILE" {
            continue;
        }
        if label(line) == b"RINEX VERSION / TYPE" {
            finish(&mut record, data, summary);
            summary.damage.note(number, "a second header: files were joined here");
            source.hold_line();
            version = first_line(source)?;
            header::read(source, version, data, summary)?;
        } else if line[0] == b'>' {
            finish(&mut record, data, summary);
            record.begin_frame(line, number);
        } else if record.is_frame_without_lines() || !record.is_continued_by(line, version) {
            if !record.is_frame_without_lines() {
                finish(&mut record, data, summary);
            }
            record.begin(line, number, version);
        } else {
            record.continue_with(line, number);
        }
    }
    finish(&mut record, data, summary);
    Ok(())
}

/// Takes a record that is complete, and leaves an empty one.
fn finish(record: &mut Record, data: &mut NavigationData, summary: &mut ReadSummary) {
    let mut record = core::mem::take(record);
    let taken = match record.kind {
        Kind::None => return,
        Kind::Ephemeris => record.ephemeris(&mut summary.damage),
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
