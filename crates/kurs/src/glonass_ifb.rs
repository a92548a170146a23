//! GLONASS phases of mixed receivers: a bias that grows with the frequency channel, learnt from the
//! epochs that are fixed.
//!
//! Where the baseline is known, the difference of two satellites' phases (rover less reference) is
//! whole cycles, noise and `β (kᵢ − kⱼ)`. Its direction on the circle of one wavelength needs no
//! integers, so all pairs of all epochs add up:
//!
//! ```text
//! P_Δ = Σ exp(2πi dᵢⱼ/λ) over pairs with kᵢ − kⱼ = Δ,     S(β) = Re Σ_Δ P_Δ exp(−2πi β Δ/λ)
//! ```
//!
//! `β̂` is the top of `S` between −λ/2 and λ/2 (receivers differ by some centimetres: Wanninger 2012,
//! *Carrier-phase inter-frequency biases of GLONASS receivers*, J. Geodesy 86). Until it is known,
//! receivers count as alike, and an epoch that is not fixed so is tried again without the phases of
//! GLONASS.
//!
//! What is carried from epoch to epoch must not change: there the phases of receivers that have shown to be mixed are
//! left out until their bias is known, and then come with the first value that is.

use core::f64::consts::TAU;
use std::collections::BTreeMap;

use nalgebra::{Complex, DVector, Vector3};

use crate::difference::Link;
use crate::signal::{Band, Satellite, System};
use crate::sky::NoiseModel;

/// Channels are −7 to 6.
const MAX_STEPS: usize = 14;
/// Fixed epochs before an estimate is believed.
const MIN_EPOCHS: f64 = 5.0;
/// Share of the pairs' lengths that must point the same way: phases that scatter by 1.2 rad, 35 mm, as baselines do
/// where the satellites of the other systems stand badly (`e^{−σ²/2}`).
const MIN_AGREEMENT: f64 = 0.5;
/// The top of another β must stay below this share of the highest.
const MAX_RIVAL: f64 = 0.7;
/// A top within this distance of the highest is the same one, m.
const SAME_TOP_M: f64 = 0.03;
/// Steps of β that are looked at, m.
const STEP_M: f64 = 0.001;
/// Share of the past that an epoch forgets: biases change slowly, with temperature.
const FORGETTING: f64 = 0.005;
/// Pairs share satellites and epochs their reflections: this many count as one.
const PAIRS_FOR_ONE: f64 = 50.0;
/// So many epochs in a row that fit without GLONASS alone show that receivers are mixed.
const EPOCHS_WITHOUT: usize = 5;
/// No estimate is better than this, m.
const MIN_SD_M: f64 = 0.0003;

/// The biases of all pairs of receivers.
#[derive(Debug, Clone, Default)]
pub(crate) struct GlonassIfb {
    /// By reference antenna, rover and band.
    of: BTreeMap<(usize, usize, Band), Estimate>,
    /// The phases of GLONASS in this epoch as they were observed.
    observed: Vec<Observed>,
    reference: usize,
    /// Where phases are carried on: how many epochs in a row fitted without GLONASS alone, and the biases that are
    /// taken out.
    without: usize,
    carried: BTreeMap<(usize, usize, Band), (f64, f64)>,
}

/// A phase before any correction.
#[derive(Debug, Clone, Copy)]
struct Observed {
    antenna: usize,
    satellite: Satellite,
    band: Band,
    channel: i8,
    phase_m: f64,
    wavelength_m: f64,
    gradient: Vector3<f64>,
}

/// What is known of one bias.
#[derive(Debug, Clone, Copy)]
struct Estimate {
    /// `P_Δ`.
    sums: [Complex<f64>; MAX_STEPS],
    /// Pairs in each.
    pairs: [f64; MAX_STEPS],
    epochs: f64,
    /// `β̂` and its standard deviation, m for each step of the channel, once they are believed.
    known: Option<(f64, f64)>,
}

impl GlonassIfb {
    /// Takes known biases out of the phases; unknown ones stay. Where phases `are_carried` from epoch to epoch see the
    /// module.
    ///
    /// Nothing is done where GLONASS is alone: no other system could tell a bias.
    pub(crate) fn apply(
        &mut self,
        links: &mut [Link],
        reference: usize,
        are_carried: bool,
        noise: &NoiseModel,
        channel: impl Fn(Satellite) -> Option<i8>,
    ) {
        self.observed.clear();
        self.reference = reference;
        let is_glonass = |link: &Link| link.satellite.system == System::Glonass;
        if links.iter().all(|link| is_glonass(link) || link.phase_m.is_none()) {
            return;
        }
        for link in links.iter_mut().filter(|link| is_glonass(link)) {
            let (Some(phase_m), Some(channel)) = (link.phase_m, channel(link.satellite)) else {
                continue;
            };
            let band = link.signal.band;
            self.observed.push(Observed {
                antenna: link.antenna,
                satellite: link.satellite,
                band,
                channel,
                phase_m,
                wavelength_m: link.wavelength_m,
                gradient: link.gradient,
            });
            if link.antenna == reference {
                continue;
            }
            if let Some((bias_m, sd_m)) = self.applied(link.antenna, band, are_carried) {
                link.phase_m = Some(phase_m - bias_m * f64::from(channel));
                let remaining = NoiseModel { channel_sd_m: sd_m, ..*noise };
                link.common_sd_cycles = remaining.common_cycles(link.wavelength_m);
            } else if are_carried && self.is_mixed() {
                link.phase_m = None;
            }
        }
    }

    /// The bias that is taken out of a phase, and its standard deviation.
    fn applied(&mut self, antenna: usize, band: Band, are_carried: bool) -> Option<(f64, f64)> {
        let known = self.known(antenna, band);
        if !are_carried {
            return known;
        }
        let known = known.filter(|_| self.is_mixed())?;
        Some(*self.carried.entry((self.reference, antenna, band)).or_insert(known))
    }

    /// Whether receivers have shown to be unlike, where phases are carried on.
    fn is_mixed(&self) -> bool {
        self.without >= EPOCHS_WITHOUT
    }

    /// Hears whether an epoch fits without the phases of GLONASS alone.
    pub(crate) fn hear(&mut self, fits_without_alone: bool) {
        if fits_without_alone {
            self.without += 1;
        } else if !self.is_mixed() {
            self.without = 0;
        }
    }

    fn known(&self, antenna: usize, band: Band) -> Option<(f64, f64)> {
        self.of.get(&(self.reference, antenna, band)).and_then(|bias| bias.known)
    }

    /// Whether the phase of this link may have a bias that is not taken out.
    pub(crate) fn is_unknown(&self, link: &Link, are_carried: bool) -> bool {
        let key = (self.reference, link.antenna, link.signal.band);
        let is_out = match are_carried {
            true => self.carried.contains_key(&key),
            false => self.known(link.antenna, link.signal.band).is_some(),
        };
        let of_link = |o: &Observed| {
            (o.antenna, o.satellite, o.band) == (link.antenna, link.satellite, link.signal.band)
        };
        link.antenna != self.reference && !is_out && self.observed.iter().any(of_link)
    }

    /// Learns from a fixed epoch: corrections to the approximate baselines of `rovers`, m.
    pub(crate) fn learn(&mut self, rovers: &[usize], correction_m: &DVector<f64>) {
        for (block, rover) in rovers.iter().enumerate() {
            let correction_m: Vector3<f64> = correction_m.fixed_rows::<3>(3 * block).into();
            let of_reference = self.observed.iter().filter(|o| o.antenna == self.reference);
            // Rover less reference, less the baseline.
            let differences: Vec<(Observed, f64)> = of_reference
                .filter_map(|base| {
                    let same = |o: &&Observed| {
                        (o.antenna, o.satellite, o.band) == (*rover, base.satellite, base.band)
                    };
                    let end = self.observed.iter().find(same)?;
                    Some((*end, end.phase_m - base.phase_m - end.gradient.dot(&correction_m)))
                })
                .collect();
            for of_band in differences.chunk_by(|a, b| a.0.band == b.0.band) {
                let key = (self.reference, *rover, of_band[0].0.band);
                self.of.entry(key).or_default().learn(of_band);
            }
        }
    }
}

impl Default for Estimate {
    fn default() -> Self {
        Self {
            sums: [Complex::new(0.0, 0.0); MAX_STEPS],
            pairs: [0.0; MAX_STEPS],
            epochs: 0.0,
            known: None,
        }
    }
}

impl Estimate {
    /// Adds the pairs of one epoch.
    fn learn(&mut self, differences: &[(Observed, f64)]) {
        let keep = 1.0 - FORGETTING;
        self.sums.iter_mut().for_each(|sum| *sum *= keep);
        self.pairs.iter_mut().for_each(|pairs| *pairs *= keep);
        self.epochs = self.epochs * keep + 1.0;
        for (i, (first, first_m)) in differences.iter().enumerate() {
            for (second, second_m) in &differences[..i] {
                let steps = first.channel.abs_diff(second.channel).into();
                let sign = f64::from((first.channel - second.channel).signum());
                if (1..MAX_STEPS).contains(&steps) {
                    let cycles = sign * (first_m - second_m) / first.wavelength_m;
                    self.sums[steps] += Complex::from_polar(1.0, TAU * cycles);
                    self.pairs[steps] += 1.0;
                }
            }
        }
        let wavelength_m = differences[0].0.wavelength_m;
        self.known = self.believed(wavelength_m);
    }

    /// `S(β)`.
    fn agreement(&self, bias_m: f64, wavelength_m: f64) -> f64 {
        let turned = |(steps, sum): (usize, &Complex<f64>)| {
            (sum * Complex::from_polar(1.0, -TAU * bias_m * steps as f64 / wavelength_m)).re
        };
        self.sums.iter().enumerate().map(turned).sum()
    }

    /// The top of `S`, if it is high and alone.
    fn believed(&self, wavelength_m: f64) -> Option<(f64, f64)> {
        let all: f64 = self.pairs.iter().sum();
        if self.epochs < MIN_EPOCHS || all == 0.0 {
            return None;
        }
        let height = |bias_m: f64| self.agreement(bias_m, wavelength_m);
        let count = (wavelength_m / STEP_M).ceil();
        let grid: Vec<(f64, f64)> =
            core::iter::successors(Some(0.0), |n| (n + 1.0 < count).then_some(n + 1.0))
                .map(|number| (number / count - 0.5) * wavelength_m)
                .map(|bias_m| (bias_m, height(bias_m)))
                .collect();
        let &(coarse_m, top) = grid.iter().max_by(|a, b| a.1.total_cmp(&b.1))?;
        // β and β + λ are the same.
        let apart_m = |bias_m: f64| {
            let off = (bias_m - coarse_m).rem_euclid(wavelength_m);
            off.min(wavelength_m - off)
        };
        let others = grid.iter().filter(|(bias_m, _)| apart_m(*bias_m) > SAME_TOP_M);
        let rival = others.map(|(_, height)| *height).fold(0.0, f64::max);
        if top < MIN_AGREEMENT * all || rival > MAX_RIVAL * top {
            return None;
        }
        // The parabola through the top and its neighbours.
        let (left, right) = (height(coarse_m - STEP_M), height(coarse_m + STEP_M));
        let bend = left - 2.0 * top + right;
        let bias_m = coarse_m + 0.5 * STEP_M * (left - right) / bend.min(-f64::MIN_POSITIVE);
        // Pairs scatter by −2 ln(S/n) rad².
        let slope_squares: f64 = self
            .pairs
            .iter()
            .enumerate()
            .map(|(steps, pairs)| pairs * (TAU * steps as f64 / wavelength_m).powi(2))
            .sum();
        let scatter = -2.0 * (top / all).min(1.0).ln();
        let sd_m = (PAIRS_FOR_ONE * scatter / slope_squares).sqrt().max(MIN_SD_M);
        Some((bias_m, sd_m))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_distr::StandardNormal;
    use rand_xoshiro::Xoshiro256PlusPlus;

    const WAVELENGTH_M: f64 = 0.187;

    /// Phases of satellites on `channels` with a bias for each step, whole cycles and 2 mm of noise.
    fn estimate(channels: &[i8], bias_m: f64, epochs: usize) -> Option<(f64, f64)> {
        let mut random = Xoshiro256PlusPlus::seed_from_u64(4);
        let mut estimate = Estimate::default();
        for _ in 0..epochs {
            let differences: Vec<(Observed, f64)> = channels
                .iter()
                .map(|&channel| {
                    let observed = Observed {
                        antenna: 1,
                        satellite: Satellite::new(System::Glonass, 1),
                        band: Band::new(System::Glonass, 1),
                        channel,
                        phase_m: 0.0,
                        wavelength_m: WAVELENGTH_M,
                        gradient: Vector3::zeros(),
                    };
                    let whole = f64::from(random.random_range(-3..=3)) * WAVELENGTH_M;
                    let noise: f64 = random.sample(StandardNormal);
                    (observed, 0.04 + whole + bias_m * f64::from(channel) + 0.002 * noise)
                })
                .collect();
            estimate.learn(&differences);
        }
        estimate.known
    }

    #[test]
    fn a_bias_is_found_whatever_the_cycles() {
        for expected_m in [-0.05, -0.013, 0.0, 0.028, 0.05] {
            let (bias_m, sd_m) = estimate(&[-7, -4, 0, 1, 5, 6], expected_m, 20).unwrap();
            assert!((bias_m - expected_m).abs() < 3.0 * sd_m, "{expected_m}: {bias_m} {sd_m}");
            assert!(sd_m < 0.001, "{sd_m}");
        }
    }

    /// Channels two apart cannot tell β from β + λ/2, and one channel tells nothing.
    #[test]
    fn what_cannot_be_told_is_not_believed() {
        assert_eq!(estimate(&[-4, -2, 0, 2], 0.02, 20), None);
        assert_eq!(estimate(&[3, 3, 3], 0.02, 20), None);
        assert_eq!(estimate(&[-7, -4, 0, 1, 5, 6], 0.02, 3), None);
    }
}
