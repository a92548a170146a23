//! What the receivers themselves state about foreign signals.

use super::patient::{Finding, Patient};
use super::sample::Sample;
use crate::stated_interference::{JAMMED, SPOOFED, StatedInterference};

impl Patient<'_> {
    /// Stated spoofing, and stated jamming, with the share of each antenna's epochs.
    pub(super) fn interference(&self, sample: &Sample) -> Vec<Finding> {
        let stated = StatedInterference::of(&sample.epochs);
        let finding = |code, cause: &'static str, advice: &'static str| {
            move |evidence| Finding { code, cause: cause.into(), evidence, advice: advice.into() }
        };
        let spoofed = finding(
            "spoofing",
            SPOOFED,
            "move away from the source; `use_interference_flags = false` if the receiver is known to be wrong",
        );
        let jammed = finding(
            "jamming",
            JAMMED,
            "look for transmitters, chargers and cables near the antenna that is named",
        );
        let spoofed = stated.spoofed(self.names).map(spoofed);
        spoofed.into_iter().chain(stated.jammed(self.names).map(jammed)).collect()
    }
}
