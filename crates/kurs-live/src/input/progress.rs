//! Whether bytes come over a connection, and epochs in them.

use std::time::{Duration, Instant};

/// A connection that brings nothing for so long is taken for dead.
const DATA_TIMEOUT: Duration = Duration::from_secs(30);
/// Bytes without any epoch for so long are those of a decoder that is stuck or of a wrong baud
/// rate.
const EPOCH_TIMEOUT: Duration = Duration::from_secs(30);

/// Whether bytes come, and epochs.
pub(super) struct Progress {
    epochs: u64,
    since: Instant,
    last_bytes: Instant,
}

impl Progress {
    pub(super) fn new(epochs: u64) -> Self {
        let now = Instant::now();
        Self { epochs, since: now, last_bytes: now }
    }

    pub(super) fn note_bytes(&mut self, now: Instant) {
        self.last_bytes = now;
    }

    /// When the connection is taken for dead, unless bytes come.
    pub(super) fn silent_at(&self) -> Instant {
        self.last_bytes + DATA_TIMEOUT
    }

    /// What is wrong, in words.
    pub(super) fn trouble(&mut self, epochs: u64, now: Instant) -> Option<String> {
        if epochs != self.epochs {
            (self.epochs, self.since) = (epochs, now);
        }
        if now >= self.silent_at() {
            return Some(format!("nothing came for {} s", DATA_TIMEOUT.as_secs()));
        }
        let is_stuck = now - self.since > EPOCH_TIMEOUT;
        is_stuck.then(|| format!("bytes come, but no epoch for {} s", EPOCH_TIMEOUT.as_secs()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_without_epochs_are_noticed() {
        let mut progress = Progress::new(3);
        let began = progress.since;
        let mut trouble = |epochs: u64, now: Instant| {
            progress.note_bytes(now);
            progress.trouble(epochs, now)
        };
        assert_eq!(trouble(3, began + EPOCH_TIMEOUT), None);
        assert_eq!(trouble(4, began + 2 * EPOCH_TIMEOUT), None);
        assert_eq!(trouble(4, began + 3 * EPOCH_TIMEOUT), None);
        let told = trouble(4, began + 3 * EPOCH_TIMEOUT + Duration::from_millis(1));
        assert_eq!(told.unwrap(), "bytes come, but no epoch for 30 s");
    }

    /// However often something else is to be done meanwhile.
    #[test]
    fn a_connection_that_says_nothing_is_silent_after_its_time() {
        let mut progress = Progress::new(0);
        let began = progress.last_bytes;
        for seconds in [10, 20, 29] {
            assert_eq!(progress.trouble(0, began + Duration::from_secs(seconds)), None);
        }
        assert_eq!(progress.silent_at(), began + DATA_TIMEOUT);
        let told = progress.trouble(0, began + DATA_TIMEOUT);
        assert_eq!(told.unwrap(), "nothing came for 30 s");
    }
}
