//! What the receivers themselves state about foreign signals.

use kurs::observation::interference::{Interference, Jamming, Spoofing};

use super::patient::{Finding, Patient};
use super::sample::Sample;

impl Patient<'_> {
    /// Stated spoofing, and stated jamming, with the share of each antenna's epochs.
    pub(super) fn interference(&self, sample: &Sample) -> Vec<Finding> {
        let spoofing = self.stated(sample, |of| of.spoofing == Spoofing::Stated);
        let jamming = self.stated(sample, |of| of.jamming >= Jamming::Warning);
        let finding = |code, cause: &'static str, advice: &'static str| {
            move |evidence| Finding { code, cause: cause.into(), evidence, advice: advice.into() }
        };
        let spoofed = finding(
            "spoofing",
            "a receiver states that satellites are imitated",
            "move away from the source; `use_interference_flags = false` if the receiver is known to be wrong",
        );
        let jammed = finding(
            "jamming",
            "a receiver states that foreign signals disturb it",
            "look for transmitters, chargers and cables near the antenna that is named",
        );
        spoofing.map(spoofed).into_iter().chain(jamming.map(jammed)).collect()
    }

    /// In words, which antennas state it and how often; `None` if none does.
    fn stated(&self, sample: &Sample, is_stated: impl Fn(&Interference) -> bool) -> Option<String> {
        let shares = self.names.iter().enumerate().filter_map(|(antenna, name)| {
            let epochs = sample.epochs.iter().filter_map(|epoch| epoch.antennas[antenna].as_ref());
            let (all, stated) = epochs.fold((0, 0), |(all, stated), epoch| {
                (all + 1, stated + u32::from(is_stated(&epoch.interference)))
            });
            let percent = 100.0 * f64::from(stated) / f64::from(all);
            (stated > 0).then(|| format!("{name} in {percent:.0} % of its epochs"))
        });
        let shares: Vec<String> = shares.collect();
        (!shares.is_empty()).then(|| shares.join(", "))
    }
}
