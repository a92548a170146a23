//! What happened: times without heading, streams that failed, interference, marks. Each has a
//! beginning and, once it is over, a length.

use std::collections::{BTreeMap, VecDeque};
use std::time::{SystemTime, UNIX_EPOCH};

use kurs::solution::EpochSolution;
use serde_json::{Value, json};

use super::history::seconds;

/// Events that are kept.
const MAX_EVENTS: usize = 200;
/// Heading is missing where the next one comes later than this many intervals.
const GAP_INTERVALS: f64 = 1.5;
/// The word for rows that did not come.
const NO_ROWS: &str = "no_rows";

/// What kind of event it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Kind {
    /// No heading; the text is the reason of most of its rows.
    Gap,
    /// A stream does not bring what it should.
    Stream,
    /// Foreign signals.
    Interference,
    /// Someone marked this time.
    Mark,
}

impl Kind {
    const fn word(self) -> &'static str {
        match self {
            Self::Gap => "gap",
            Self::Stream => "stream",
            Self::Interference => "interference",
            Self::Mark => "mark",
        }
    }
}

#[derive(Debug, Clone)]
struct Event {
    number: u64,
    kind: Kind,
    text: String,
    /// Seconds of Unix time.
    began_s: f64,
    /// `None` while it goes on.
    length_s: Option<f64>,
}

/// See the module.
#[derive(Debug, Default)]
pub(super) struct Events {
    list: VecDeque<Event>,
    count: u64,
    has_news: bool,
    heading: Heading,
    /// Troubles that go on: their subject, and the number of the event.
    open: BTreeMap<(Kind, String), u64>,
}

/// What is remembered of the rows.
#[derive(Debug, Default)]
struct Heading {
    last_s: Option<f64>,
    last_fixed_s: Option<f64>,
    interval_s: Option<f64>,
    gap: Option<Gap>,
}

#[derive(Debug)]
struct Gap {
    event: u64,
    began_s: f64,
    reasons: BTreeMap<&'static str, u64>,
}

impl Gap {
    fn main_reason(&self) -> &'static str {
        let most = self.reasons.iter().max_by_key(|(_, count)| **count);
        most.map_or(NO_ROWS, |(reason, _)| reason)
    }
}

impl Events {
    fn begin(&mut self, kind: Kind, text: String, length_s: Option<f64>) -> u64 {
        let since_epoch = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        let began_s = since_epoch.as_secs_f64() - length_s.unwrap_or(0.0);
        self.count += 1;
        self.has_news = true;
        self.list.push_back(Event { number: self.count, kind, text, began_s, length_s });
        if self.list.len() > MAX_EVENTS {
            self.list.pop_front();
        }
        self.count
    }

    fn end(&mut self, number: u64, text: Option<String>, length_s: Option<f64>) {
        self.has_news = true;
        let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        if let Some(event) = self.list.iter_mut().find(|event| event.number == number) {
            event.length_s = Some(length_s.unwrap_or(now.as_secs_f64() - event.began_s));
            event.text = text.unwrap_or_else(|| core::mem::take(&mut event.text));
        }
    }

    /// Takes a row: heading goes, is missing, comes back.
    pub(super) fn note_row(&mut self, row: &EpochSolution) {
        let now_s = seconds(row.time);
        let heading = &mut self.heading;
        let since_s = heading.last_s.map(|last_s| now_s - last_s).filter(|since_s| *since_s > 0.0);
        heading.interval_s = [heading.interval_s, since_s].into_iter().flatten().reduce(f64::min);
        heading.last_s = Some(now_s);
        if !row.is_fixed() {
            let reason = row.reason().map_or("", |reason| reason.word());
            let began_s = heading.last_fixed_s.unwrap_or(now_s);
            if let Some(gap) = &mut heading.gap {
                *gap.reasons.entry(reason).or_default() += 1;
            } else {
                let event = self.begin(Kind::Gap, reason.to_owned(), None);
                let reasons = BTreeMap::from([(reason, 1)]);
                self.heading.gap = Some(Gap { event, began_s, reasons });
            }
            return;
        }
        let last_fixed_s = heading.last_fixed_s.replace(now_s);
        let interval_s = heading.interval_s.unwrap_or(f64::INFINITY);
        if let Some(gap) = heading.gap.take() {
            self.end(gap.event, Some(gap.main_reason().to_owned()), Some(now_s - gap.began_s));
        } else if let Some(missing_s) = last_fixed_s.map(|last_s| now_s - last_s)
            && missing_s > GAP_INTERVALS * interval_s
        {
            self.begin(Kind::Gap, NO_ROWS.to_owned(), Some(missing_s));
        }
    }

    /// Takes what is wrong now with each subject; what is no longer wrong has ended.
    pub(super) fn note_troubles(&mut self, now: &BTreeMap<(Kind, String), String>) {
        let over: Vec<_> =
            self.open.keys().filter(|key| !now.contains_key(*key)).cloned().collect();
        for number in over.iter().filter_map(|key| self.open.remove(key)).collect::<Vec<_>>() {
            self.end(number, None, None);
        }
        for (key, text) in now {
            if !self.open.contains_key(key) {
                let number = self.begin(key.0, format!("{} {text}", key.1), None);
                self.open.insert(key.clone(), number);
            }
        }
    }

    /// Someone marks this time.
    pub(super) fn mark(&mut self, text: String) {
        self.begin(Kind::Mark, text, Some(0.0));
    }

    /// The list, newest first, if it has changed since it was taken last.
    pub(super) fn take_news(&mut self) -> Option<Value> {
        core::mem::take(&mut self.has_news).then(|| {
            let event = |event: &Event| {
                json!({
                    "number": event.number,
                    "kind": event.kind.word(),
                    "text": event.text,
                    "began_ms": (event.began_s * 1e3).round(),
                    "length_s": event.length_s.map(|s| (s * 1e3).round() / 1e3),
                })
            };
            self.list.iter().rev().map(event).collect::<Vec<_>>().into()
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use kurs::solution::{AttitudeEstimate, Outcome, Reason};
    use kurs::time::GpsTime;
    use nalgebra::Matrix3;

    fn row(second: f64, reason: Option<Reason>) -> EpochSolution {
        let time = GpsTime::from_week_tow(2300, 1000.0 + second).unwrap();
        let mut row = EpochSolution::lost(time, reason.unwrap_or(Reason::Slip));
        if reason.is_none() {
            let zero = Matrix3::zeros();
            let attitude = AttitudeEstimate {
                heading_rad: Some(0.0),
                pitch_rad: None,
                roll_rad: None,
                covariance_rad2: zero,
                installation_rad2: zero,
                ned_from_body: None,
                line_elevation_rad: None,
            };
            row.outcome = Outcome::Fixed { attitude };
        }
        row
    }

    /// Two seconds until the first heading, one lost for 0.3 s, rows missing for 5 s.
    #[test]
    fn every_time_without_heading_has_its_length_and_reason() {
        let mut events = Events::default();
        let (slip, ratio) = (Some(Reason::Slip), Some(Reason::Ratio));
        for (second, reason) in [
            (0.0, Some(Reason::NoEphemeris)),
            (1.0, Some(Reason::NoEphemeris)),
            (2.0, None),
            (2.1, None),
            (2.2, slip),
            (2.3, ratio),
            (2.35, ratio),
            (2.4, None),
            (7.4, None),
            (7.5, slip),
        ] {
            events.note_row(&row(second, reason));
        }
        let list = events.take_news().unwrap();
        let told: Vec<(String, Option<f64>)> = list
            .as_array()
            .unwrap()
            .iter()
            .map(|event| (event["text"].as_str().unwrap().to_owned(), event["length_s"].as_f64()))
            .collect();
        let wanted = [
            ("slip", None),
            ("no_rows", Some(5.0)),
            ("ratio", Some(0.3)),
            ("no_ephemeris", Some(2.0)),
        ];
        let wanted = wanted.map(|(text, length_s)| (text.to_owned(), length_s));
        assert_eq!(told, wanted);
        assert_eq!(events.take_news(), None);
    }

    #[test]
    fn a_trouble_is_one_event_however_its_words_change() {
        let mut events = Events::default();
        let key = (Kind::Stream, "A1".to_owned());
        let trouble = |text: &str| BTreeMap::from([(key.clone(), text.to_owned())]);
        events.note_troubles(&trouble("no epoch for 1.0 s"));
        events.note_troubles(&trouble("no epoch for 2.0 s"));
        events.mark("engine on".into());
        events.note_troubles(&BTreeMap::new());
        let list = events.take_news().unwrap();
        assert_eq!(list.as_array().unwrap().len(), 2);
        assert_eq!((&list[0]["kind"], &list[0]["text"]), (&json!("mark"), &json!("engine on")));
        assert_eq!(list[1]["text"], "A1 no epoch for 1.0 s");
        assert!(list[1]["length_s"].as_f64().unwrap() < 1.0);
    }

    #[test]
    fn the_list_is_bounded() {
        let mut events = Events::default();
        (0..1000).for_each(|number| events.mark(number.to_string()));
        let list = events.take_news().unwrap();
        assert_eq!(list.as_array().unwrap().len(), MAX_EVENTS);
        assert_eq!(list[0]["text"], "999");
    }
}
