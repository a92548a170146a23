//! Where an epoch of RTCM 3 ends: with the message that says that no other one follows (DF393), if
//! the sender is found to set this bit as it should; else where a later epoch begins.
//!
//! Some programs do not set it. So a stream is trusted after an epoch in which the last message,
//! and no other one, had it clear, and never again after a message that came behind the last one.

/// What the bits of one stream have shown so far.
#[derive(Debug, Default)]
pub(crate) struct PromptEnd {
    trust: Trust,
    /// Whether the last message of the epoch so far says that more follow, and whether all before
    /// it did.
    more_follow: bool,
    is_consistent: bool,
}

#[derive(Debug, Default, Clone, Copy, PartialEq, Eq)]
enum Trust {
    #[default]
    Untested,
    Trusted,
    Lost,
}

impl PromptEnd {
    /// The first message of an epoch has come: judges the epoch before.
    pub(crate) fn begin(&mut self, more_follow: bool) {
        if self.trust == Trust::Untested && self.is_consistent && !self.more_follow {
            self.trust = Trust::Trusted;
        }
        (self.more_follow, self.is_consistent) = (more_follow, true);
    }

    /// A further message of the epoch has come.
    pub(crate) fn go_on(&mut self, more_follow: bool) {
        self.is_consistent &= self.more_follow;
        self.more_follow = more_follow;
    }

    /// A message has come behind the one that was the last.
    pub(crate) fn came_behind(&mut self) {
        self.trust = Trust::Lost;
    }

    /// Whether the epoch is complete.
    pub(crate) fn is_complete(&self) -> bool {
        self.trust == Trust::Trusted && !self.more_follow
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Whether each epoch is complete with its last message.
    fn complete(epochs: &[&[bool]]) -> Vec<bool> {
        let mut end = PromptEnd::default();
        let mut complete = Vec::new();
        for epoch in epochs {
            end.begin(epoch[0]);
            epoch[1..].iter().for_each(|more| end.go_on(*more));
            complete.push(end.is_complete());
        }
        complete
    }

    #[test]
    fn a_sender_is_trusted_after_one_epoch_that_ends_as_it_says() {
        assert_eq!(
            complete(&[&[true, false], &[true, true], &[true, false]]),
            [false, false, true]
        );
        assert_eq!(complete(&[&[false], &[false]]), [false, true]);
    }

    #[test]
    fn a_bit_that_is_clear_too_early_or_never_ends_nothing() {
        assert_eq!(complete(&[&[false, false], &[false, false]]), [false, false]);
        assert_eq!(complete(&[&[false, true, false], &[false, true, false]]), [false, false]);
        assert_eq!(complete(&[&[true, true], &[true, true]]), [false, false]);
    }

    #[test]
    fn a_message_behind_the_last_one_takes_the_trust_away_for_good() {
        let mut end = PromptEnd::default();
        end.begin(false);
        end.begin(false);
        assert!(end.is_complete());
        end.came_behind();
        end.begin(false);
        end.begin(false);
        assert!(!end.is_complete());
    }
}
