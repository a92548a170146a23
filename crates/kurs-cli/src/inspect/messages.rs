//! The messages of a log: how many of each kind, how often, and what is read from them.

use kurs_formats::logs::{Census, Role};
use serde::Serialize;

/// One kind of message.
#[derive(Debug, Serialize)]
pub(super) struct MessageReport {
    pub(super) message: String,
    pub(super) count: u64,
    /// Messages a second, over the time of the observations.
    pub(super) rate_hz: Option<f64>,
    /// What is read from it.
    pub(super) read: &'static str,
}

/// All kinds; the log has observations over `duration_s`, if over any time.
pub(super) fn messages(census: &Census, duration_s: Option<f64>) -> Vec<MessageReport> {
    let report = |(kind, count): (&_, &u64)| {
        let kind: &kurs_formats::logs::MessageKind = kind;
        MessageReport {
            message: kind.to_string(),
            count: *count,
            rate_hz: duration_s.map(|duration_s| *count as f64 / duration_s),
            read: match kind.role() {
                Role::Observations => "observations",
                Role::UnreadObservations(_) => "not read: observations",
                Role::Navigation => "navigation data",
                Role::Place => "place",
                Role::Interference => "interference",
                Role::Other => "not read",
            },
        }
    };
    census.messages.iter().map(report).collect()
}
