//! How long to wait before a connection is tried again: 1 s, then twice as long each time up to a
//! limit, with jitter, so that many clients that lost one caster do not come back at once; for
//! ever.

use std::hash::{BuildHasher, RandomState};
use std::time::Duration;

const FIRST_S: f64 = 1.0;
/// Casters ban those who ask too often.
const CASTER_MAX_S: f64 = 60.0;
/// A receiver or a client of one's own may come back at any moment, and nobody minds being asked.
const OWN_MAX_S: f64 = 2.0;
/// Waiting times are drawn between this part of the nominal one and all of it.
const MIN_PART: f64 = 0.5;
/// A connection that brought bytes for so long counts as good: the next failure is a new one.
pub(crate) const GOOD_AFTER: Duration = Duration::from_secs(10);

/// The waiting times of one stream.
#[derive(Debug)]
pub(crate) struct BackOff {
    next_s: f64,
    max_s: f64,
    random: RandomState,
    drawn: u64,
}

impl BackOff {
    /// For a caster.
    pub(crate) fn of_caster() -> Self {
        Self::up_to(CASTER_MAX_S)
    }

    /// For what belongs to the body.
    pub(crate) fn of_own() -> Self {
        Self::up_to(OWN_MAX_S)
    }

    fn up_to(max_s: f64) -> Self {
        Self { next_s: FIRST_S, max_s, random: RandomState::new(), drawn: 0 }
    }

    /// The next waiting time.
    pub(crate) fn next(&mut self) -> Duration {
        self.drawn += 1;
        // The top 53 bits of a hash are a number between 0 and 1.
        let part = (self.random.hash_one(self.drawn) >> 11) as f64 / (1u64 << 53) as f64;
        let wait_s = self.next_s * (MIN_PART + (1.0 - MIN_PART) * part);
        self.next_s = (2.0 * self.next_s).min(self.max_s);
        Duration::from_secs_f64(wait_s)
    }

    /// A connection was good.
    pub(crate) fn reset(&mut self) {
        self.next_s = FIRST_S;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn waits_grow_to_a_minute_and_begin_anew() {
        let mut back_off = BackOff::of_caster();
        for nominal_s in [1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 60.0, 60.0, 60.0] {
            let wait_s = back_off.next().as_secs_f64();
            assert!((0.5 * nominal_s..=nominal_s).contains(&wait_s), "{wait_s} of {nominal_s}");
        }
        back_off.reset();
        assert!(back_off.next().as_secs_f64() <= 1.0);
    }

    #[test]
    fn two_streams_do_not_wait_alike() {
        let waits = || {
            let mut back_off = BackOff::of_own();
            (0..5).map(|_| back_off.next()).collect::<Vec<_>>()
        };
        assert_ne!(waits(), waits());
    }
}
