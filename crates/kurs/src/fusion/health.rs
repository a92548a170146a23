//! How a filter fares: what it used and refused, why it stopped, what its user should know of.

use super::kalman::UpdateOutcome;

/// The filter does not predict over longer gaps: the attitude is lost by then.
pub const LONGEST_GAP_S: f64 = 10.0;
/// So many epochs in a row of which the filter refuses most: it must be wrong itself.
pub(super) const LOCKED_OUT_EPOCHS: usize = 20;

/// How the measurements of one kind fared.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Tally {
    /// Passed the gate.
    pub used: usize,
    /// Did not.
    pub rejected: usize,
    /// Normalised innovation squared, summed over the used ones: expected value `used`.
    pub nis: f64,
}

/// Why the filter could not take an epoch; it stays as it was.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum FilterError {
    /// Not later than what was already absorbed.
    #[error("time goes back from {from_s} s to {to_s} s")]
    TimeGoesBack {
        /// Time of the filter.
        from_s: f64,
        /// Time of the epoch.
        to_s: f64,
    },
    /// A gap that cannot be bridged: start anew.
    #[error("gap of {gap_s} s, longer than {LONGEST_GAP_S} s")]
    Gap {
        /// Length.
        gap_s: f64,
    },
    /// The state is no longer a number: start anew.
    #[error("the filter diverged")]
    Diverged,
}

/// Something that a user should know of.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum Event {
    /// The filter began.
    #[error("filter started")]
    Started,
    /// The filter could not go on and begins anew.
    #[error("filter stopped: {0}")]
    Stopped(FilterError),
    /// The filter refused nearly everything for so long that it must be wrong.
    #[error("filter stopped: it rejected most measurements of {LOCKED_OUT_EPOCHS} epochs in a row")]
    LockedOut,
    /// The receiver set its clock.
    #[error("receiver clock jumped by {jump_m:.0} m")]
    ClockJump {
        /// By how much, times c.
        jump_m: f64,
    },
}

impl Tally {
    pub(super) fn add(&mut self, later: &Self) {
        self.used += later.used;
        self.rejected += later.rejected;
        self.nis += later.nis;
    }

    pub(super) fn of(outcomes: &[UpdateOutcome]) -> Self {
        let used = outcomes.iter().filter(|outcome| outcome.accepted).count();
        let nis = outcomes.iter().map(|outcome| outcome.normalised_square).sum();
        Self { used, rejected: outcomes.len() - used, nis }
    }
}
