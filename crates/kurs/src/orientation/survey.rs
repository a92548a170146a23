//! The array measured by its own antennas: fixed baselines of many epochs become positions in body
//! axes.
//!
//! The shape comes from [`geometry`]; how well it is known, from the coordinates that each epoch alone
//! has in its axes, which do not change as the body turns. Multipath makes the errors of
//! neighbouring epochs alike, so `n` epochs count for fewer independent ones:
//!
//! `n_eff = n / (1 + 2 Σ ρₖ)`,   `ρₖ` the autocorrelation of the coordinate at lag `k`,
//!
//! summed as long as pairs `ρₖ + ρₖ₊₁` are positive (Geyer 1992, *Practical Markov chain Monte
//! Carlo*, Statistical Science 7, 473-483). The mean of them has the variance `s² / (n_eff − 1)`, and what
//! it is off the reported position counts in full: on a line all of the distance from it.

use nalgebra::Vector3;

use super::geometry::{self, GeometryError};
use super::moved::{self, Moved};
use super::{AntennaFix, PositionEpoch};
use crate::frames::{Body, Vector};
use crate::solution::EpochSolution;

/// Values that are looked at for the autocorrelation, spread evenly.
const MAX_VALUES: usize = 5000;

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
    /// Standard deviation of each coordinate, m. What is wrong in the same way all the time does not
    /// show in it. Coordinates that the axes define have none.
    pub sd_m: Vec<[f64; 3]>,
    /// Epochs with fixed baselines to all antennas.
    pub fixes: usize,
    /// For how many independent ones they count, by the coordinate whose errors last longest.
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
        let estimate = geometry::estimate(&self.epochs, self.antennas)?;
        let complete = |epoch: &&PositionEpoch| epoch.antennas.iter().all(Option::is_some);
        let fixes = self.epochs.iter().filter(complete).count();
        let means: Vec<[Mean; 3]> =
            estimate.coordinates_m.iter().map(|c| mean_of_each(c)).collect();
        let scattered = means.iter().flatten().filter(|mean| mean.variance > 0.0);
        let share = scattered.map(|mean| mean.independent / mean.count).fold(1.0, f64::min);
        let sd_m = means.iter().zip(&estimate.positions_m).map(|(means, position)| {
            let position = position.xyz();
            [0, 1, 2].map(|axis| means[axis].sd_about(position[axis]))
        });
        Ok(SurveyedArray {
            sd_m: sd_m.collect(),
            scatter_m: estimate.scatter_m(),
            positions_m: estimate.positions_m,
            fixes,
            independent: share * fixes as f64,
        })
    }

    /// An antenna that was elsewhere in a part of the session, by the distances.
    #[must_use]
    pub fn moved(&self) -> Option<Moved> {
        moved::find(&self.epochs, self.antennas)
    }
}

/// The mean of values in the order of time.
struct Mean {
    value: f64,
    variance: f64,
    count: f64,
    independent: f64,
}

fn mean_of_each(coordinates: &[Vector3<f64>]) -> [Mean; 3] {
    [0, 1, 2].map(|axis| {
        let values: Vec<f64> = coordinates.iter().map(|epoch| epoch[axis]).collect();
        let (value, variance) = mean_and_variance(&values);
        Mean { value, variance, count: values.len() as f64, independent: independent(&values) }
    })
}

impl Mean {
    /// `√(s² / (n_eff − 1) + (mean − place)²)`
    fn sd_about(&self, place: f64) -> f64 {
        let variance = self.variance / (self.independent - 1.0).max(1.0);
        (variance + (self.value - place).powi(2)).sqrt()
    }
}

/// For how many independent values these count, in the order of time; equal ones are one.
pub(super) fn independent(values: &[f64]) -> f64 {
    let step = values.len().div_ceil(MAX_VALUES).max(1);
    let sample: Vec<f64> = values.iter().step_by(step).copied().collect();
    let (mean, variance) = mean_and_variance(&sample);
    if variance <= 0.0 {
        return 1.0;
    }
    let n = sample.len();
    let correlation = |lag: usize| {
        let products = sample.iter().zip(&sample[lag..]);
        let sum: f64 = products.map(|(a, b)| (a - mean) * (b - mean)).sum();
        sum / (n as f64 * variance)
    };
    // The mean of the sample takes its own variance, σ²/n_eff, out of every product: it is put back with what
    // the first pass finds.
    let independent = |of_mean: f64| {
        let mut time = 1.0;
        for lag in (1..n.saturating_sub(1)).step_by(2) {
            let pair = correlation(lag) + correlation(lag + 1) + 2.0 * of_mean;
            if pair <= 0.0 {
                break;
            }
            time += 2.0 * pair / (1.0 + of_mean);
        }
        n as f64 / time
    };
    independent(1.0 / (independent(0.0) - 1.0).max(1.0))
}

fn mean_and_variance(values: &[f64]) -> (f64, f64) {
    let n = values.len().max(1) as f64;
    let mean = values.iter().sum::<f64>() / n;
    (mean, values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_distr::StandardNormal;
    use rand_xoshiro::Xoshiro256PlusPlus;

    /// A body that turns in every direction, antennas as noisy in height as receivers are; in each run the errors
    /// are as large as their standard deviations say, and what the axes define is exact.
    #[test]
    fn standard_deviations_are_those_of_the_errors() {
        const RUNS: u64 = 40;
        let flat = [[0.0, 0.0, 0.0], [0.8, 0.0, 0.0], [0.1, -0.5, 0.0], [-0.2, 0.6, 0.0]];
        let spatial = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.2, 0.9, 0.0], [0.3, 0.3, -0.8]];
        for places in [&flat[..3], &flat, &spatial] {
            let mut squares = vec![Vector3::<f64>::zeros(); places.len()];
            for seed in 0..RUNS {
                let survey = noisy(places, 100, seed).array().unwrap();
                for (k, place) in places.iter().enumerate() {
                    let place = Vector3::from(*place);
                    let error = survey.positions_m[k].xyz() - place;
                    for axis in 0..3 {
                        if survey.sd_m[k][axis] == 0.0 {
                            assert!(error[axis].abs() < 1e-12, "{k} {axis}: {error}");
                        } else {
                            squares[k][axis] += (error[axis] / survey.sd_m[k][axis]).powi(2);
                        }
                    }
                }
            }
            let defined = squares.iter().flat_map(|s| s.iter()).filter(|s| **s == 0.0).count();
            assert_eq!(defined, 6);
            // Squares of one number have a mean of 1 ± √(2/40).
            for mean in squares.iter().flat_map(|s| s.iter()).map(|s| s / RUNS as f64) {
                assert!(mean == 0.0 || (0.4..1.9).contains(&mean), "{squares:?}");
            }
        }
    }

    /// Noise bends no line: what is not known across it is in the standard deviations.
    #[test]
    fn antennas_on_a_line_stay_on_it() {
        for seed in 0..10 {
            let line = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.5, 0.0, 0.0]];
            let survey = noisy(&line, 100, seed).array().unwrap();
            let third = survey.positions_m[2].xyz();
            assert!(third.y.abs() < 1e-12 && third.z.abs() < 1e-12, "{third}");
            let [along, across, down] = survey.sd_m[2];
            assert!((third.x - 2.5).abs() < 4.0 * along && along < 0.001, "{third} {along}");
            assert!((0.002..0.01).contains(&across) && across == down, "{across}");
        }
    }

    fn noisy(places: &[[f64; 3]], epochs: u32, seed: u64) -> Survey {
        let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
        let sd_ned_m = [0.002, 0.002, 0.004];
        let origin = crate::frames::Geodetic::from_degrees(48.0, 11.0, 500.0);
        let (origin_m, ecef_from_ned) = (origin.to_ecef(), origin.ecef_from_ned());
        let epoch = |k: u32| {
            let k = f64::from(k);
            let turn = Vector3::new((0.3 * k).sin(), 0.8 * (0.17 * k).cos(), 0.1 * k);
            let rotation = crate::attitude::weighted::exponential(&turn);
            let antennas = places.iter().map(|place| {
                let noise = sd_ned_m.map(|sd| sd * random.sample::<f64, _>(StandardNormal));
                let offset = rotation * Vector3::from(*place) + Vector3::from(noise);
                let position_m = origin_m + ecef_from_ned * Vector::from_xyz(offset);
                Some(AntennaFix { position_m, sd_ned_m, doubt: None })
            });
            let time = crate::time::GpsTime::from_nanoseconds(0) + k;
            PositionEpoch { time, antennas: antennas.collect() }
        };
        Survey { antennas: places.len(), epochs: (0..epochs).map(epoch).collect() }
    }

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
