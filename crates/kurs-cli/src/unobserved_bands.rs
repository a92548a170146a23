//! Bands that the configuration names and that no antenna observes: the user wants to know of them.

use std::collections::BTreeSet;

use kurs::observation::ArrayEpoch;
use kurs::signal::Band;

/// See the module; fed epoch by epoch.
#[derive(Debug, Default)]
pub(crate) struct UnobservedBands {
    wanted: Vec<Band>,
    /// Those of the wanted bands that no epoch has had so far.
    unobserved: Vec<Band>,
    /// Looked at only as long as a band is missing.
    observed: BTreeSet<Band>,
}

impl UnobservedBands {
    /// For `bands` of the configuration; without it every band is welcome and none is missed.
    pub(crate) fn of(bands: Option<&[Band]>) -> Self {
        let wanted = bands.unwrap_or_default().to_vec();
        Self { unobserved: wanted.clone(), wanted, observed: BTreeSet::new() }
    }

    /// Takes an epoch in.
    pub(crate) fn add(&mut self, epoch: &ArrayEpoch) {
        if self.unobserved.is_empty() {
            return;
        }
        let observations = epoch.antennas.iter().flatten().flat_map(|a| &a.observations);
        self.observed.extend(observations.map(|o| o.signal.band));
        self.unobserved.retain(|band| !self.observed.contains(band));
    }

    /// What is missing, in words; `None` where nothing is.
    pub(crate) fn sentence(&self) -> Option<String> {
        let words = || format!("no antenna observes {}", listed(&self.unobserved));
        (!self.unobserved.is_empty()).then(words)
    }

    /// What is observed in place of the wanted bands, where none of them is.
    pub(crate) fn nothing_left(&self) -> Option<String> {
        let sentence = self.sentence().filter(|_| self.unobserved.len() == self.wanted.len())?;
        Some(format!(
            "{sentence}, and `bands` wants no other; observed: {}",
            listed(&self.observed)
        ))
    }

    /// The names of the missing bands.
    pub(crate) fn names(&self) -> Vec<String> {
        self.unobserved.iter().map(Band::to_string).collect()
    }
}

fn listed<'a>(bands: impl IntoIterator<Item = &'a Band>) -> String {
    bands.into_iter().map(Band::to_string).collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use kurs::observation::{AntennaEpoch, Lock, Observation};
    use kurs::signal::{Satellite, System};

    fn epoch(signal: &str) -> ArrayEpoch {
        let observation = Observation {
            satellite: Satellite::new(System::Gps, 1),
            signal: signal.parse().unwrap(),
            pseudorange_m: Some(2.2e7),
            phase_cycles: None,
            doppler_hz: None,
            cn0_dbhz: None,
            lock: Lock::default(),
        };
        let antenna = AntennaEpoch { observations: vec![observation], ..AntennaEpoch::default() };
        ArrayEpoch { antennas: vec![None, Some(antenna)], ..ArrayEpoch::default() }
    }

    #[test]
    fn wanted_bands_are_missed_and_others_are_not() {
        let bands = ["G1", "G2", "I5"].map(|name| name.parse().unwrap());
        let mut wanted = UnobservedBands::of(Some(&bands));
        wanted.add(&epoch("G5Q"));
        assert_eq!(
            wanted.nothing_left().unwrap(),
            "no antenna observes G1 G2 I5, and `bands` wants no other; observed: G5"
        );
        wanted.add(&epoch("G1C"));
        wanted.add(&epoch("G2W"));
        assert_eq!(wanted.sentence().unwrap(), "no antenna observes I5");
        assert_eq!(wanted.nothing_left(), None);
        let mut all = UnobservedBands::of(None);
        all.add(&epoch("G1C"));
        assert_eq!((all.sentence(), all.nothing_left()), (None, None));
    }
}
