//! Cycle slips that are known before the observations that they concern.

use std::collections::BTreeSet;

use kurs::observation::{AntennaEpoch, Lock};
use kurs::signal::{Satellite, Signal};

/// Slips to be marked in coming epochs.
///
/// They come from slip records, and from observations whose loss-of-lock digit was seen or lost in
/// something that is not given out: a skipped epoch, a damaged field. A slip stays until the
/// satellite and signal have a phase again.
#[derive(Debug, Default)]
pub(crate) struct PendingSlips {
    signals: BTreeSet<(Satellite, Signal)>,
    all: bool,
    power_failure: bool,
}

impl PendingSlips {
    /// The next phase of this satellite and signal has slipped.
    pub(crate) fn mark(&mut self, satellite: Satellite, signal: Signal) {
        self.signals.insert((satellite, signal));
    }

    /// Observations were lost and with them their digits: any phase may have slipped.
    pub(crate) const fn mark_all(&mut self) {
        self.all = true;
    }

    /// Keeps the slips of an epoch that is skipped.
    pub(crate) fn keep_from(&mut self, skipped: &AntennaEpoch) {
        self.power_failure |= skipped.power_failure;
        let slipped = skipped.observations.iter().filter(|o| o.lock.slipped());
        self.signals.extend(slipped.map(|o| (o.satellite, o.signal)));
    }

    /// Whether all phases of the epoch that begins here may have slipped.
    pub(crate) fn take_all(&mut self) -> bool {
        core::mem::take(&mut self.all)
    }

    /// Marks what is pending in an epoch; `all` from before it was read.
    pub(crate) fn apply(&mut self, epoch: &mut AntennaEpoch, all: bool) {
        epoch.power_failure |= core::mem::take(&mut self.power_failure);
        if !all && self.signals.is_empty() {
            return;
        }
        for observation in epoch.observations.iter_mut().filter(|o| o.phase_cycles.is_some()) {
            let pending = self.signals.remove(&(observation.satellite, observation.signal));
            if all || pending {
                observation.lock.0 |= Lock::SLIP;
            }
        }
    }
}
