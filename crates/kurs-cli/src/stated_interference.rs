//! What the receivers of a session state about foreign signals, counted.

use kurs::observation::ArrayEpoch;
use kurs::observation::interference::{Interference, Jamming, Spoofing};

/// What a statement of spoofing means.
pub(crate) const SPOOFED: &str = "a receiver states that satellites are imitated";
/// What a statement of jamming means.
pub(crate) const JAMMED: &str = "a receiver states that foreign signals disturb it";

/// See the module; in the order of the antennas.
#[derive(Debug, Clone, Default)]
pub(crate) struct StatedInterference(Vec<Counts>);

/// Epochs of an antenna.
#[derive(Debug, Clone, Copy, Default)]
struct Counts {
    all: u32,
    spoofed: u32,
    jammed: u32,
}

impl StatedInterference {
    /// Counts what the receivers state in these epochs.
    pub(crate) fn of(epochs: &[ArrayEpoch]) -> Self {
        let mut counted = Self::default();
        epochs.iter().for_each(|epoch| counted.add(epoch));
        counted
    }

    /// Takes an epoch in.
    pub(crate) fn add(&mut self, epoch: &ArrayEpoch) {
        self.0.resize(epoch.antennas.len().max(self.0.len()), Counts::default());
        for (counts, antenna) in self.0.iter_mut().zip(&epoch.antennas) {
            let Some(Interference { spoofing, jamming, .. }) =
                antenna.as_ref().map(|antenna| antenna.interference)
            else {
                continue;
            };
            counts.all += 1;
            counts.spoofed += u32::from(spoofing == Spoofing::Stated);
            counts.jammed += u32::from(jamming >= Jamming::Warning);
        }
    }

    /// Which antennas state spoofing and how often, in words; `None` if none does.
    pub(crate) fn spoofed(&self, names: &[String]) -> Option<String> {
        self.shares(names, |counts| counts.spoofed)
    }

    /// Which antennas state jamming and how often, in words; `None` if none does.
    pub(crate) fn jammed(&self, names: &[String]) -> Option<String> {
        self.shares(names, |counts| counts.jammed)
    }

    /// Both, as sentences.
    pub(crate) fn sentences(&self, names: &[String]) -> Vec<String> {
        let sentence = |meaning: &str, shares: Option<String>| {
            let shares = shares?;
            let (first, rest) = meaning.split_at(1);
            Some(format!("{}{rest}: {shares}.", first.to_uppercase()))
        };
        let both = [sentence(SPOOFED, self.spoofed(names)), sentence(JAMMED, self.jammed(names))];
        both.into_iter().flatten().collect()
    }

    fn shares(&self, names: &[String], stated: impl Fn(&Counts) -> u32) -> Option<String> {
        let stating = names.iter().zip(&self.0).filter(|(_, counts)| stated(counts) > 0);
        let words = stating.map(|(name, counts)| {
            let percent = 100.0 * f64::from(stated(counts)) / f64::from(counts.all);
            format!("{name} in {percent:.0} % of its epochs")
        });
        let words: Vec<String> = words.collect();
        (!words.is_empty()).then(|| words.join(", "))
    }
}
