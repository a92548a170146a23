//! Writes measurements as a message: one segment for each station and kind of path.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use kurs::time::GpsTime;

use super::{Observable, TrackingRecord};

/// The two forms of the standard.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Form {
    /// `KEYWORD = value` lines.
    Kvn,
    /// Elements.
    Xml,
}

/// What is the same for all records of a segment: station, reference, object, and the path length.
type SegmentKey<'a> = (&'a str, Option<&'a str>, &'a str, bool);

/// The text of a message (503.0-B-2) with these records; times in UTC to the microsecond, angles in
/// degrees, ranges in kilometres.
#[must_use]
pub fn write(records: &[TrackingRecord], originator: &str, created: GpsTime, form: Form) -> String {
    let mut segments: BTreeMap<SegmentKey, Vec<&TrackingRecord>> = BTreeMap::new();
    for record in records {
        let one_way = record.observable == Observable::OneWayRange;
        let key = (&*record.station, record.reference.as_deref(), &*record.object, one_way);
        segments.entry(key).or_default().push(record);
    }
    let mut message = Message { text: String::new(), form };
    message.header(originator, created);
    for (key, mut records) in segments {
        records.sort_by_key(|record| (record.time, record.observable));
        message.segment(key, &records);
    }
    message.footer();
    message.text
}

struct Message {
    text: String,
    form: Form,
}

impl Message {
    fn header(&mut self, originator: &str, created: GpsTime) {
        let created = created.utc().iso(3);
        match self.form {
            Form::Kvn => {
                self.raw("CCSDS_TDM_VERS = 2.0");
                self.raw(&format!("CREATION_DATE = {created}"));
                self.raw(&format!("ORIGINATOR = {originator}"));
            }
            Form::Xml => {
                self.raw("<?xml version=\"1.0\" encoding=\"UTF-8\"?>");
                self.raw("<tdm id=\"CCSDS_TDM_VERS\" version=\"2.0\">");
                self.raw(&format!(
                    "<header><CREATION_DATE>{created}</CREATION_DATE><ORIGINATOR>{}</ORIGINATOR></header>",
                    escaped(originator)
                ));
                self.raw("<body>");
            }
        }
    }

    fn footer(&mut self) {
        if self.form == Form::Xml {
            self.raw("</body>\n</tdm>");
        }
    }

    fn segment(&mut self, key: SegmentKey, records: &[&TrackingRecord]) {
        let (station, reference, object, one_way) = key;
        self.marks("<segment>\n<metadata>", "\nMETA_START");
        self.pair("TIME_SYSTEM", "UTC");
        self.pair("PARTICIPANT_1", station);
        self.pair("PARTICIPANT_2", object);
        if let Some(reference) = reference {
            self.pair("PARTICIPANT_3", reference);
            self.pair("MODE", "SINGLE_DIFF");
            self.pair("PATH_1", "2,3");
            self.pair("PATH_2", "2,1");
        } else {
            self.pair("MODE", "SEQUENTIAL");
            self.pair("PATH", if one_way { "2,1" } else { "1,2,1" });
        }
        self.pair("RANGE_UNITS", "km");
        self.pair("ANGLE_TYPE", "AZEL");
        self.marks("</metadata>\n<data>", "META_STOP\nDATA_START");
        for record in records {
            self.record(record);
        }
        self.marks("</data>\n</segment>", "DATA_STOP");
    }

    fn record(&mut self, record: &TrackingRecord) {
        let time = record.time.utc().iso(6);
        let (keyword, value) = match record.observable {
            Observable::Azimuth => ("ANGLE_1", record.value.to_degrees()),
            Observable::Elevation => ("ANGLE_2", record.value.to_degrees()),
            _ => ("RANGE", record.value * 1e-3),
        };
        // The shortest text that reads back as the same number.
        match self.form {
            Form::Kvn => self.raw(&format!("{keyword} = {time} {value}")),
            Form::Xml => self.raw(&format!(
                "<observation><EPOCH>{time}</EPOCH><{keyword}>{value}</{keyword}></observation>"
            )),
        }
    }

    fn pair(&mut self, keyword: &str, value: &str) {
        match self.form {
            Form::Kvn => self.raw(&format!("{keyword} = {value}")),
            Form::Xml => self.raw(&format!("<{keyword}>{}</{keyword}>", escaped(value))),
        }
    }

    fn marks(&mut self, xml: &str, kvn: &str) {
        self.raw(if self.form == Form::Xml { xml } else { kvn });
    }

    fn raw(&mut self, line: &str) {
        // Writing to a String does not fail.
        let _ = writeln!(self.text, "{line}");
    }
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}
