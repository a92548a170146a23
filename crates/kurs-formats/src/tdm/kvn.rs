//! The text form: `KEYWORD = value` lines between section marks.

use super::segment::Metadata;
use super::{TdmError, TrackingData};

#[derive(Debug, Clone, Copy, PartialEq)]
enum Section {
    /// Before the first segment.
    Header,
    Metadata,
    /// After metadata, before their data.
    BeforeData,
    Data,
    BetweenSegments,
}

const HEADER: [&str; 4] = ["CCSDS_TDM_VERS", "CREATION_DATE", "ORIGINATOR", "MESSAGE_ID"];

/// Reads a message in KVN.
pub(super) fn read(text: &str) -> Result<TrackingData, TdmError> {
    let mut data = TrackingData::default();
    let mut metadata = Metadata::default();
    let mut section = Section::Header;
    let mut version_seen = false;
    let mut last_line = 0;
    // Of the current segment: its first record, and what in it cannot be used.
    let (mut segments, mut first, mut unusable) = (0, 0, None);
    for (line, content) in (1..).zip(text.lines()) {
        let content = content.trim();
        last_line = line;
        if content.is_empty() || content == "COMMENT" || content.starts_with("COMMENT ") {
            continue;
        }
        let Some((keyword, value)) = content.split_once('=') else {
            section = next_section(section, content, line)?;
            match section {
                Section::Metadata => {
                    metadata = Metadata::default();
                    (segments, first) = (segments + 1, data.records.len());
                }
                Section::BetweenSegments => data.end_segment(first, unusable.take()),
                _ => {}
            }
            continue;
        };
        let (keyword, value) = (keyword.trim(), value.trim());
        let no_value = || TdmError::new(line, keyword, "no value after `=`");
        if !version_seen && keyword != "CCSDS_TDM_VERS" {
            let what = format!("must come first, found {keyword}");
            return Err(TdmError::new(line, "CCSDS_TDM_VERS", what));
        }
        version_seen = true;
        match section {
            Section::Header if value.is_empty() => return Err(no_value()),
            Section::Header if HEADER.contains(&keyword) => {}
            Section::Header => {
                return Err(TdmError::new(line, keyword, "not a header keyword"));
            }
            Section::Metadata | Section::Data if unusable.is_some() => {}
            Section::Metadata | Section::Data if value.is_empty() => unusable = Some(no_value()),
            Section::Metadata => unusable = metadata.set(keyword, value, line).err(),
            Section::Data => {
                let taken = match value.split_once(char::is_whitespace) {
                    Some((time_tag, number)) => {
                        metadata.record(keyword, time_tag, number.trim(), line, &mut data)
                    }
                    None => {
                        let what = format!("`{value}` found, expected a time tag and a number");
                        Err(TdmError::new(line, keyword, what))
                    }
                };
                unusable = taken.err();
            }
            Section::BeforeData | Section::BetweenSegments => {
                return Err(TdmError::new(line, keyword, "outside of metadata and data"));
            }
        }
    }
    match section {
        Section::BetweenSegments => data.checked(segments),
        Section::Header => Err(TdmError::new(last_line, "META_START", "missing: no segment")),
        Section::Metadata => Err(TdmError::new(last_line, "META_STOP", "missing at the end")),
        Section::BeforeData => Err(TdmError::new(last_line, "DATA_START", "missing at the end")),
        Section::Data => Err(TdmError::new(last_line, "DATA_STOP", "missing at the end")),
    }
}

/// The section after a mark on a line by itself.
fn next_section(section: Section, mark: &str, line: usize) -> Result<Section, TdmError> {
    match (section, mark) {
        (Section::Header | Section::BetweenSegments, "META_START") => Ok(Section::Metadata),
        (Section::Metadata, "META_STOP") => Ok(Section::BeforeData),
        (Section::BeforeData, "DATA_START") => Ok(Section::Data),
        (Section::Data, "DATA_STOP") => Ok(Section::BetweenSegments),
        (_, "META_START" | "META_STOP" | "DATA_START" | "DATA_STOP") => {
            Err(TdmError::new(line, mark, "out of order"))
        }
        _ => {
            let keyword = mark.split_whitespace().next().unwrap_or(mark);
            Err(TdmError::new(line, keyword, "expected `KEYWORD = value`"))
        }
    }
}
