//! What goes wrong over and over is reported when it begins, when something else goes wrong, in
//! slow reminders while it lasts, and when it is over.

use std::sync::{Mutex, MutexGuard};
use std::time::{Duration, Instant};

use crate::lock::lock;

/// What lasts, or comes back, is reported again after this time.
const REMINDER: Duration = Duration::from_secs(600);

/// What may be wrong with one thing.
#[derive(Debug)]
pub(crate) struct Trouble {
    subject: String,
    state: Mutex<State>,
}

#[derive(Debug, Default)]
struct State {
    now: Option<String>,
    /// What was told last, and when.
    told: Option<(String, Instant)>,
    /// It was told that something is wrong, and not yet that it is over.
    is_open: bool,
}

impl Trouble {
    /// Nothing is wrong yet with this.
    pub(crate) fn new(subject: String) -> Self {
        Self { subject, state: Mutex::default() }
    }

    /// This is wrong now.
    pub(crate) fn note(&self, what: &str) {
        if self.state().begin(what, Instant::now()) {
            tracing::warn!("{} {what}", self.subject);
        }
    }

    /// It is over.
    pub(crate) fn end(&self) {
        if self.state().end() {
            tracing::info!("{} is well again", self.subject);
        }
    }

    /// What is wrong now, in words.
    pub(crate) fn text(&self) -> Option<String> {
        self.state().now.as_ref().map(|what| format!("{} {what}", self.subject))
    }

    /// The same without its subject.
    pub(crate) fn what(&self) -> Option<String> {
        self.state().now.clone()
    }

    fn state(&self) -> MutexGuard<'_, State> {
        lock(&self.state)
    }
}

impl State {
    /// Whether it is to be told.
    fn begin(&mut self, what: &str, now: Instant) -> bool {
        self.now = Some(what.to_owned());
        let is_known = |(told, at): &(String, Instant)| told == what && now - *at < REMINDER;
        if self.told.as_ref().is_some_and(is_known) {
            return false;
        }
        self.told = Some((what.to_owned(), now));
        self.is_open = true;
        true
    }

    /// Whether it is to be told.
    fn end(&mut self) -> bool {
        self.now = None;
        core::mem::take(&mut self.is_open)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_lasts_is_told_once_and_slowly_again() {
        let (mut state, now) = (State::default(), Instant::now());
        let after = |seconds: u64| now + Duration::from_secs(seconds);
        assert!(!state.end(), "nothing was wrong");
        assert!(state.begin("is absent", now));
        assert!(!state.begin("is absent", after(1)));
        assert!(state.begin("is in use", after(2)), "another one");
        assert!(state.end());
        assert!(!state.begin("is in use", after(3)), "one that comes and goes is told once");
        assert!(!state.end());
        assert!(state.begin("is in use", after(602)), "the reminder");
        assert!(state.end() && state.now.is_none());
    }
}
