//! The text form: `KEYWORD = value` lines between section marks.

use super::segment::Metadata;
use super::{TdmError, TrackingData};

#[derive(Debug, Clone, Copy, Default, PartialEq)]
enum Section {
    /// Before the first segment.
    #[default]
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
    let mut message = Message::default();
    let mut last_line = 0;
    for (line, content) in (1..).zip(text.lines()) {
        last_line = line;
        match content.trim() {
            "" | "COMMENT" => {}
            content if content.starts_with("COMMENT ") => {}
            content => match content.split_once('=') {
                None => message.take_mark(content, line)?,
                Some((keyword, value)) => message.take(keyword.trim(), value.trim(), line)?,
            },
        }
    }
    message.finish(last_line)
}

/// What was read so far.
#[derive(Default)]
struct Message {
    section: Section,
    version_seen: bool,
    metadata: Metadata,
    data: TrackingData,
    segments: usize,
    /// The first record of the current segment.
    first: usize,
    /// What in the current segment cannot be used.
    unusable: Option<TdmError>,
}

impl Message {
    /// A section mark on a line by itself.
    fn take_mark(&mut self, mark: &str, line: usize) -> Result<(), TdmError> {
        self.section = next_section(self.section, mark, line)?;
        match self.section {
            Section::Metadata => {
                self.metadata = Metadata::default();
                self.segments += 1;
                self.first = self.data.records.len();
            }
            Section::BetweenSegments => self.data.end_segment(self.first, self.unusable.take()),
            _ => {}
        }
        Ok(())
    }

    /// A line `KEYWORD = value`.
    fn take(&mut self, keyword: &str, value: &str, line: usize) -> Result<(), TdmError> {
        if !self.version_seen && keyword != "CCSDS_TDM_VERS" {
            let what = format!("must come first, found {keyword}");
            return Err(TdmError::new(line, "CCSDS_TDM_VERS", what));
        }
        self.version_seen = true;
        let error = |what: &str| TdmError::new(line, keyword, what);
        let no_value = || error("no value after `=`");
        match self.section {
            Section::Header if value.is_empty() => return Err(no_value()),
            Section::Header if HEADER.contains(&keyword) => {}
            Section::Header => return Err(error("not a header keyword")),
            Section::Metadata | Section::Data if self.unusable.is_some() => {}
            Section::Metadata | Section::Data if value.is_empty() => {
                self.unusable = Some(no_value());
            }
            Section::Metadata => self.unusable = self.metadata.set(keyword, value, line).err(),
            Section::Data => self.unusable = self.take_record(keyword, value, line).err(),
            Section::BeforeData | Section::BetweenSegments => {
                return Err(error("outside of metadata and data"));
            }
        }
        Ok(())
    }

    fn take_record(&mut self, keyword: &str, value: &str, line: usize) -> Result<(), TdmError> {
        let Some((time_tag, number)) = value.split_once(char::is_whitespace) else {
            let what = format!("`{value}` found, expected a time tag and a number");
            return Err(TdmError::new(line, keyword, what));
        };
        self.metadata.record(keyword, time_tag, number.trim(), line, &mut self.data)
    }

    /// The data, if the message ends behind a segment.
    fn finish(self, last_line: usize) -> Result<TrackingData, TdmError> {
        match self.section {
            Section::BetweenSegments => self.data.checked(self.segments),
            Section::Header => Err(TdmError::new(last_line, "META_START", "missing: no segment")),
            Section::Metadata => Err(TdmError::new(last_line, "META_STOP", "missing at the end")),
            Section::BeforeData => {
                Err(TdmError::new(last_line, "DATA_START", "missing at the end"))
            }
            Section::Data => Err(TdmError::new(last_line, "DATA_STOP", "missing at the end")),
        }
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
