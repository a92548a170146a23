//! One recording under two names: antennas with equal observations, whose baseline is zero.

use std::collections::BTreeMap;

use kurs::observation::{AntennaEpoch, ArrayEpoch, Observation};

/// Difference of equal values, rounded differently: observation files have three decimals.
const ROUNDING: f64 = 0.0021;
/// Equal signals that two receivers never have by chance: the noise of a code is decimetres.
const MIN_SIGNALS: usize = 4;
/// Share of the common epochs that makes a copy.
const MIN_SHARE: f64 = 0.5;

/// Which antennas have the same observations, and how often.
#[derive(Debug, Default)]
pub(crate) struct Copies {
    pairs: BTreeMap<(usize, usize), Count>,
}

#[derive(Debug, Clone, Copy, Default)]
struct Count {
    common: u64,
    equal: u64,
}

impl Copies {
    /// Takes the observations of an epoch in; tells whether all its antennas are one recording.
    pub(crate) fn add(&mut self, epoch: &ArrayEpoch) -> bool {
        let present: Vec<(usize, &AntennaEpoch)> =
            epoch.antennas.iter().enumerate().filter_map(|(i, a)| Some((i, a.as_ref()?))).collect();
        let mut all = present.len() >= 2;
        for (k, (second, b)) in present.iter().enumerate() {
            for (first, a) in &present[..k] {
                let count = self.pairs.entry((*first, *second)).or_default();
                let equal = are_equal(a, b);
                count.common += 1;
                count.equal += u64::from(equal);
                all &= equal;
            }
        }
        all
    }

    /// The first pair of antennas that are one, and the number of equal epochs.
    pub(crate) fn first(&self) -> Option<((usize, usize), u64)> {
        let often = |count: &Count| count.equal as f64 > MIN_SHARE * count.common as f64;
        let mut copies = self.pairs.iter().filter(|(_, count)| often(count));
        copies.next().map(|(pair, count)| (*pair, count.equal))
    }

    /// What is wrong, in words.
    pub(crate) fn text(&self, names: &[String]) -> Option<String> {
        let ((first, second), _) = self.first()?;
        Some(format!(
            "antennas {} and {} have the same observations: their baseline is zero and has no heading",
            names[first], names[second]
        ))
    }
}

/// Whether two epochs hold the same observations, as far as they hold the same signals.
fn are_equal(a: &AntennaEpoch, b: &AntennaEpoch) -> bool {
    let mut common = 0;
    for (place, one) in a.observations.iter().enumerate() {
        let is_same = |o: &&Observation| o.satellite == one.satellite && o.signal == one.signal;
        let beside = b.observations.get(place).filter(is_same);
        let Some(other) = beside.or_else(|| b.observations.iter().find(is_same)) else { continue };
        let equal = |x: Option<f64>, y: Option<f64>| match (x, y) {
            (Some(x), Some(y)) => Some((x - y).abs() < ROUNDING),
            _ => None,
        };
        let code = equal(one.pseudorange_m, other.pseudorange_m);
        let phase = equal(one.phase_cycles, other.phase_cycles);
        if code == Some(false) || phase == Some(false) {
            return false;
        }
        common += usize::from(code.is_some());
    }
    common >= MIN_SIGNALS
}

#[cfg(test)]
mod tests {
    use super::*;
    use kurs::observation::Lock;
    use kurs::signal::{Satellite, System};

    fn antenna(satellites: u8, code_m: impl Fn(u8) -> f64) -> AntennaEpoch {
        let observation = |number| Observation {
            satellite: Satellite::new(System::Gps, number),
            signal: "G1C".parse().unwrap(),
            pseudorange_m: Some(code_m(number)),
            phase_cycles: Some(1.1e8 + f64::from(number)),
            doppler_hz: None,
            cn0_dbhz: None,
            lock: Lock::default(),
        };
        let observations = (1..=satellites).map(observation).collect();
        AntennaEpoch { observations, ..AntennaEpoch::default() }
    }

    fn text(others: [AntennaEpoch; 2]) -> Option<String> {
        let mut copies = Copies::default();
        let [one, two] = others.map(Some);
        let epoch = ArrayEpoch { antennas: vec![one, None, two], ..ArrayEpoch::default() };
        let all = copies.add(&epoch);
        assert_eq!(all, copies.first().is_some());
        copies.text(&["A", "B", "C"].map(str::to_owned))
    }

    #[test]
    fn equal_to_the_last_digit_is_one_recording() {
        let code = |number| 2e7 + 1e5 * f64::from(number);
        // The other file has fewer satellites and rounds.
        let said = text([antenna(9, code), antenna(6, |n| code(n) + 0.001)]).unwrap();
        assert!(said.contains("antennas A and C have the same observations"), "{said}");
        assert_eq!(
            text([antenna(9, code), antenna(9, |n| code(n) + 0.1 * f64::from(n % 2))]),
            None
        );
        assert_eq!(text([antenna(3, code), antenna(3, code)]), None, "too few to tell");
    }
}
