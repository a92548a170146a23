//! Navigation data of any format: the format is found by content, not by name.

use kurs::ephemeris::NavigationData;
use kurs::time::GpsTime;

use crate::content::Content;
pub use crate::read_summary::ReadSummary;
use crate::source::{ReadError, Source};
use crate::sp3;
use crate::{logs, rinex};

/// Reads a navigation file and adds what it holds to `data`: RINEX navigation 2, 3 and 4, SP3 a to
/// d, and the navigation messages in receiver logs.
///
/// A damaged record is noted in the summary and loses no other one.
///
/// # Errors
///
/// [`ReadError`] if reading fails or the content is something else.
pub fn read(source: &mut Source, data: &mut NavigationData) -> Result<ReadSummary, ReadError> {
    read_near(source, None, data)
}

/// As [`read`], of logs whose weeks are cut to ten bits: `near` is a time within ten years of it;
/// without one it is taken to be between 2014 and 2033.
///
/// # Errors
///
/// As [`read`].
pub fn read_near(
    source: &mut Source,
    near: Option<GpsTime>,
    data: &mut NavigationData,
) -> Result<ReadSummary, ReadError> {
    let content = Content::of(source.start(Content::ENOUGH)?);
    let near = near.or_else(|| logs::file_date::of_name(source.name()));
    let mut summary = ReadSummary::default();
    match content {
        Content::RinexNavigation => rinex::navigation::read(source, data, &mut summary)?,
        Content::Sp3 => sp3::read(source, &mut data.ephemerides, &mut summary)?,
        // Their damage has a byte offset, and is complete.
        Content::Ubx | Content::Rtcm3 | Content::Sbf => {
            logs::navigation::read(source, near, data, &mut summary)?;
            return Ok(summary);
        }
        other => return Err(source.wrong_content(other.to_string(), EXPECTED)),
    }
    if let Some(reason) = source.take_broken_off() {
        summary.damage.note(source.line_number(), reason);
    }
    Ok(summary)
}

const EXPECTED: &str = "a navigation file (RINEX 2, 3 or 4), precise orbits (SP3) or a receiver \
    log (UBX, RTCM 3, SBF)";
