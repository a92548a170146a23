//! The array measured by its own antennas: fixed baselines of many epochs become positions in body
//! axes.
//!
//! The shape comes from [`geometry`]; how well it is known, from the distances
//! between the antennas, which do not change as the body turns. Multipath makes the errors of
//! neighbouring epochs alike, so `n` epochs count for fewer independent ones:
//!
//! `n_eff = n / (1 + 2 Σ ρₖ)`,   `ρₖ` the autocorrelation of the distances at lag `k`,
//!
//! summed as long as pairs `ρₖ + ρₖ₊₁` are positive (Geyer 1992, *Practical Markov chain Monte
//! Carlo*, Statistical Science 7, 473-483).

use super::geometry::{self, EstimatedGeometry, GeometryError};
use super::{AntennaFix, PositionEpoch};
use crate::frames::{Body, Vector};
use crate::solution::EpochSolution;

/// Distances that are looked at for the autocorrelation, spread evenly.
const MAX_DISTANCES: usize = 5000;

/// Fixed epochs, as far as they have come in.
#[derive(Debug, Clone, Default)]
pub struct Survey {
    antennas: usize,
    epochs: Vec<PositionEpoch>,
}

/// Antenna positions with what they rest on.
#[derive(Debug, Clone, PartialEq)]
pub struct SurveyedArray {
    /// Positions in body axes, m: the first antenna is the origin, x goes through the second, the
    /// next one off that line is in the x–y plane, z is down.
    pub positions_m: Vec<Vector<Body>>,
    /// Root mean square of one epoch about that, for each axis, m.
    pub scatter_m: Vec<[f64; 3]>,
    /// Epochs with fixed baselines to all antennas.
    pub fixes: usize,
    /// For how many independent ones they count.
    pub independent: f64,
}

impl Survey {
    /// A survey of so many antennas.
    #[must_use]
    pub fn new(antennas: usize) -> Self {
        Self { antennas, epochs: Vec::new() }
    }

    /// Takes the baselines of a fixed epoch; others are passed over.
    pub fn add(&mut self, row: &EpochSolution) {
        let Some(position) = row.position.filter(|_| row.is_fixed()) else { return };
        let ecef_from_enu =
            (crate::frames::enu_from_ned() * position.geodetic.ned_from_ecef()).inverse();
        let mut antennas = vec![None; self.antennas];
        let unknown_sd = [0.0; 3];
        for baseline in &row.baselines {
            antennas[baseline.base] = Some(AntennaFix {
                position_m: position.position_m,
                sd_ned_m: unknown_sd,
                doubt: None,
            });
            antennas[baseline.rover] = Some(AntennaFix {
                position_m: position.position_m + ecef_from_enu * baseline.baseline_m,
                sd_ned_m: unknown_sd,
                doubt: None,
            });
        }
        self.epochs.push(PositionEpoch { time: row.time, antennas });
    }

    /// The array.
    ///
    /// # Errors
    ///
    /// [`GeometryError`] when two antennas have too few epochs together.
    pub fn array(&self) -> Result<SurveyedArray, GeometryError> {
        let EstimatedGeometry { positions_m, spread_m, .. } =
            geometry::estimate(&self.epochs, self.antennas)?;
        let complete = |epoch: &&PositionEpoch| epoch.antennas.iter().all(Option::is_some);
        let fixes = self.epochs.iter().filter(complete).count();
        let shares = self.pairs().map(|(first, second)| {
            let distances = self.distances_m(first, second);
            independent(&distances) / distances.len() as f64
        });
        let share = shares.fold(1.0, f64::min);
        Ok(SurveyedArray {
            positions_m,
            scatter_m: if self.antennas == 2 { self.scatter_of_line() } else { spread_m },
            fixes,
            independent: share * fixes as f64,
        })
    }

    fn pairs(&self) -> impl Iterator<Item = (usize, usize)> {
        (0..self.antennas).flat_map(|first| (first + 1..self.antennas).map(move |s| (first, s)))
    }

    fn distances_m(&self, first: usize, second: usize) -> Vec<f64> {
        let pairs = self.epochs.iter().filter_map(|epoch| {
            let pair: (AntennaFix, AntennaFix) = (epoch.antennas[first]?, epoch.antennas[second]?);
            Some(pair)
        });
        pairs.map(|(a, b)| (a.position_m - b.position_m).norm()).collect()
    }

    /// Two antennas have one distance, along x.
    fn scatter_of_line(&self) -> Vec<[f64; 3]> {
        let distances = self.distances_m(0, 1);
        let (_, variance) = mean_and_variance(&distances);
        vec![[0.0; 3], [variance.sqrt(), 0.0, 0.0]]
    }
}

impl SurveyedArray {
    /// Standard deviation of each coordinate, m: the scatter over the root of the independent
    /// epochs. What is wrong in the same way all the time does not show in it.
    #[must_use]
    pub fn sd_m(&self) -> Vec<[f64; 3]> {
        let root = self.independent.max(1.0).sqrt();
        self.scatter_m.iter().map(|scatter| scatter.map(|axis| axis / root)).collect()
    }
}

/// For how many independent values these count, in the order of time.
fn independent(values: &[f64]) -> f64 {
    let step = values.len().div_ceil(MAX_DISTANCES).max(1);
    let sample: Vec<f64> = values.iter().step_by(step).copied().collect();
    let (mean, variance) = mean_and_variance(&sample);
    if variance <= 0.0 {
        return values.len() as f64;
    }
    let n = sample.len();
    let correlation = |lag: usize| {
        let products = sample.iter().zip(&sample[lag..]);
        let sum: f64 = products.map(|(a, b)| (a - mean) * (b - mean)).sum();
        sum / (n as f64 * variance)
    };
    let mut time = 1.0;
    for lag in (1..n.saturating_sub(1)).step_by(2) {
        let pair = correlation(lag) + correlation(lag + 1);
        if pair <= 0.0 {
            break;
        }
        time += 2.0 * pair;
    }
    n as f64 / time
}

fn mean_and_variance(values: &[f64]) -> (f64, f64) {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    (mean, values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_distr::StandardNormal;
    use rand_xoshiro::Xoshiro256PlusPlus;

    /// An autoregressive series `xₖ = φ xₖ₋₁ + e` has `n_eff = n (1 − φ) / (1 + φ)`.
    #[test]
    fn correlated_values_count_for_fewer() {
        let mut random = Xoshiro256PlusPlus::seed_from_u64(3);
        for (phi, expected) in [(0.0, 5000.0), (0.5, 5000.0 / 3.0), (0.9, 5000.0 / 19.0)] {
            let mut value = 0.0;
            let series: Vec<f64> = (0..5000)
                .map(|_| {
                    let step: f64 = random.sample(StandardNormal);
                    value = phi * value + step;
                    value
                })
                .collect();
            let found = independent(&series);
            assert!((found / expected - 1.0).abs() < 0.25, "{phi}: {found} {expected}");
        }
    }
}
