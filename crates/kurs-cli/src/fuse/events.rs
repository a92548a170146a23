//! Events in a run of a filter: printed at once, and kept for the summary.

use kurs::fusion::health::Event;

/// The events of a run, each with its time.
#[derive(Debug, Default)]
pub(super) struct EventLog(Vec<String>);

impl EventLog {
    /// Takes the events of a row in, and prints them; the start of a filter is not worth a line.
    pub(super) fn tell(&mut self, events: &[(f64, Event)]) {
        for (time_s, event) in events {
            let text = format!("{time_s:.3} s: {event}");
            if !matches!(event, Event::Started) {
                eprintln!("{text}");
            }
            self.0.push(text);
        }
    }

    /// For the summary.
    pub(super) fn texts(&self) -> &[String] {
        &self.0
    }
}

/// The events of a row in one field of a table.
pub(super) fn in_one_field(events: &[(f64, Event)]) -> String {
    let events: Vec<String> = events.iter().map(|(_, event)| event.to_string()).collect();
    events.join("; ")
}

/// Lines for the terminal: how many samples were of no use, and why.
pub(super) fn left_out<const N: usize>(
    counts: [(&'static str, usize); N],
) -> impl Iterator<Item = String> {
    counts
        .into_iter()
        .filter(|(_, count)| *count > 0)
        .map(|(what, count)| format!("left out: {count} {what}"))
}
