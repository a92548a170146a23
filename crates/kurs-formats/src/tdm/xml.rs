//! The XML form: the same keywords as elements.

use roxmltree::{Document, Node};

use super::segment::Metadata;
use super::{TdmError, TrackingData};

/// Reads a message in XML.
pub(super) fn read(text: &str) -> Result<TrackingData, TdmError> {
    let document = Document::parse(text).map_err(|error| {
        let line = usize::try_from(error.pos().row).unwrap_or(0);
        TdmError::new(line, "xml", error.to_string())
    })?;
    let mut data = TrackingData::default();
    let mut segments =
        document.descendants().filter(|node| node.has_tag_name("segment")).peekable();
    if segments.peek().is_none() {
        return Err(TdmError::new(1, "segment", "missing: no segment"));
    }
    let mut count = 0;
    for segment in segments {
        let first = data.records.len();
        let unusable = read_segment(&segment, &mut data).err();
        data.end_segment(first, unusable);
        count += 1;
    }
    data.checked(count)
}

fn read_segment(segment: &Node, data: &mut TrackingData) -> Result<(), TdmError> {
    let child = |name: &str| {
        segment
            .children()
            .find(|node| node.has_tag_name(name))
            .ok_or_else(|| TdmError::new(line_of(segment), name, "missing in a segment"))
    };
    let mut metadata = Metadata::default();
    for element in elements(&child("metadata")?) {
        metadata.set(element.tag_name().name(), text_of(&element), line_of(&element))?;
    }
    for observation in elements(&child("data")?) {
        read_observation(&observation, &metadata, data)?;
    }
    Ok(())
}

/// `<observation><EPOCH>…</EPOCH><RANGE>…</RANGE></observation>`
fn read_observation(
    observation: &Node,
    metadata: &Metadata,
    data: &mut TrackingData,
) -> Result<(), TdmError> {
    let line = line_of(observation);
    if !observation.has_tag_name("observation") {
        let name = observation.tag_name().name();
        return Err(TdmError::new(line, name, "expected an observation"));
    }
    let epoch = elements(observation).find(|node| node.has_tag_name("EPOCH"));
    let epoch = epoch.ok_or_else(|| TdmError::new(line, "EPOCH", "missing in an observation"))?;
    for value in elements(observation).filter(|node| !node.has_tag_name("EPOCH")) {
        let keyword = value.tag_name().name();
        metadata.record(keyword, text_of(&epoch), text_of(&value), line_of(&value), data)?;
    }
    Ok(())
}

/// Child elements other than comments.
fn elements<'a, 'input>(node: &Node<'a, 'input>) -> impl Iterator<Item = Node<'a, 'input>> {
    node.children().filter(|child| child.is_element() && !child.has_tag_name("COMMENT"))
}

fn text_of<'a>(node: &Node<'a, '_>) -> &'a str {
    node.text().unwrap_or_default().trim()
}

fn line_of(node: &Node) -> usize {
    let position = node.document().text_pos_at(node.range().start);
    usize::try_from(position.row).unwrap_or(0)
}
