//! Was an antenna elsewhere in a part of the session? The distances between antennas tell.
//!
//! Each distance is taken as medians of blocks of equal length. A move is the split of the blocks with the
//! largest `|m₂ − m₁| √(n₁ n₂ / n)` of the means before and behind it, and is believed where
//!
//! `z = |m₂ − m₁| / (s √((1/n₁ + 1/n₂) n/n_eff))`
//!
//! is above ten, or six of nearly white noise, with the scatter `s` within the two parts and the number of independent
//! blocks among `n` as in [`super::survey`], *and* most of the step is there at once: reflections
//! wander as far within minutes, but not from one block to the next.

use super::geometry::median;
use super::survey::independent;
use super::{AntennaFix, PositionEpoch};
use crate::time::GpsTime;

/// Blocks of a session.
const BLOCKS: usize = 64;
/// Epochs of the shortest block.
const MIN_BLOCK: usize = 3;
/// Fewer blocks tell nothing.
const MIN_BLOCKS: usize = 20;
/// The shortest part before or behind a move, as a share of the session.
const MIN_PART: f64 = 1.0 / 8.0;
/// Blocks on either side of a step that must differ.
const NEAR: usize = 4;
/// How much of the step they must show.
const NEAR_SHARE: f64 = 0.7;
/// Standard deviations of a step. Of simulated distances without one, 240 to 3000 epochs, about 1 session in 800
/// has more where they wander for up to a tenth of the session, 1 in 80 where they wander for twice
/// the session.
const MIN_STEP_SD: f64 = 10.0;
/// The same where at least [`MIN_WHITE`] blocks are independent: counted in the same simulation. A step as large
/// as one deviation of one epoch, half-way through 240 of them, has about seven.
const MIN_WHITE_STEP_SD: f64 = 6.0;
/// Independent blocks of nearly white noise.
const MIN_WHITE: f64 = 0.6 * BLOCKS as f64;

/// An antenna that did not stay in its place.
#[derive(Debug, Clone, PartialEq)]
pub struct Moved {
    /// Antennas that have a part in all changed distances: one, or both of the only distance.
    pub antennas: Vec<usize>,
    /// The last epoch before the move and the first one behind it.
    pub between: [GpsTime; 2],
    /// Distances that changed, the most certain first.
    pub distances: Vec<ChangedDistance>,
}

/// The distance of two antennas before and behind a move.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ChangedDistance {
    /// Index of the first antenna.
    pub first: usize,
    /// Index of the second antenna.
    pub second: usize,
    /// Before, m.
    pub before_m: f64,
    /// Behind, m.
    pub after_m: f64,
    /// How many standard deviations the step has.
    pub step_sd: f64,
}

/// The move that the distances show; `None` where they stay.
pub(super) fn find(epochs: &[PositionEpoch], antennas: usize) -> Option<Moved> {
    let pairs = (0..antennas).flat_map(|first| (first + 1..antennas).map(move |s| (first, s)));
    let steps = pairs.filter_map(|(first, second)| step(epochs, first, second));
    let mut steps: Vec<(ChangedDistance, [GpsTime; 2])> = steps.collect();
    steps.sort_by(|(a, _), (b, _)| b.step_sd.total_cmp(&a.step_sd));
    let (_, between) = *steps.first()?;
    let distances: Vec<ChangedDistance> = steps.into_iter().map(|(step, _)| step).collect();
    let has_part =
        |antenna: &usize| distances.iter().all(|step| [step.first, step.second].contains(antenna));
    Some(Moved { antennas: (0..antennas).filter(has_part).collect(), between, distances })
}

/// The step of one distance, if there is any.
fn step(
    epochs: &[PositionEpoch],
    first: usize,
    second: usize,
) -> Option<(ChangedDistance, [GpsTime; 2])> {
    let distance = |epoch: &PositionEpoch| {
        let (a, b): (AntennaFix, AntennaFix) = (epoch.antennas[first]?, epoch.antennas[second]?);
        Some((epoch.time, (a.position_m - b.position_m).norm()))
    };
    let (times, distances_m): (Vec<GpsTime>, Vec<f64>) = epochs.iter().filter_map(distance).unzip();
    let count = BLOCKS.min(distances_m.len() / MIN_BLOCK);
    if count < MIN_BLOCKS {
        return None;
    }
    let begin = |block: usize| block * distances_m.len() / count;
    let blocks_m: Vec<f64> =
        (0..count).map(|k| median(distances_m[begin(k)..begin(k + 1)].to_vec())).collect();

    let split = largest_step(&blocks_m);
    let (before, after) = blocks_m.split_at(split);
    let (before_m, after_m) = (mean(before), mean(after));
    let within = before.iter().map(|m| m - before_m).chain(after.iter().map(|m| m - after_m));
    let within: Vec<f64> = within.collect();
    let (n, free) = (count as f64, independent(&within));
    // Two means are taken out: n_eff − 2 independent squares are left.
    let squares: f64 = within.iter().map(|off| off * off).sum();
    let variance = squares / n * free / (free - 2.0).max(0.5);
    let parts = 1.0 / before.len() as f64 + 1.0 / after.len() as f64;
    let step_sd = (after_m - before_m).abs() / (variance * parts * n / free).sqrt();
    let near_m = mean(&after[..NEAR]) - mean(&before[split - NEAR..]);
    let least_sd = if free >= MIN_WHITE { MIN_WHITE_STEP_SD } else { MIN_STEP_SD };
    let is_step = step_sd > least_sd && near_m / (after_m - before_m) > NEAR_SHARE;

    let change = ChangedDistance { first, second, before_m, after_m, step_sd };
    is_step.then(|| {
        let place = first_epoch_behind(&distances_m, begin(split - 1)..begin(split + 1), &change);
        (change, [times[place - 1], times[place]])
    })
}

/// The block behind the largest step, by the sums of what the blocks are off their mean.
fn largest_step(blocks_m: &[f64]) -> usize {
    let (n, centre) = (blocks_m.len() as f64, mean(blocks_m));
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // a part of the blocks
    let margin = NEAR.max((MIN_PART * n) as usize);
    let (mut sum, mut best) = (0.0, (margin, 0.0));
    for (place, block) in blocks_m[..blocks_m.len() - margin].iter().enumerate() {
        sum += block - centre;
        let before = (place + 1) as f64;
        let size = f64::abs(sum) / (before * (n - before) / n).sqrt();
        if place + 1 >= margin && size > best.1 {
            best = (place + 1, size);
        }
    }
    best.0
}

/// The epoch of two blocks from which on distances are nearer to what they are behind the step.
fn first_epoch_behind(
    distances_m: &[f64],
    blocks: core::ops::Range<usize>,
    change: &ChangedDistance,
) -> usize {
    let middle_m = 0.5 * (change.before_m + change.after_m);
    let towards = (change.after_m - change.before_m).signum();
    let (mut sum, mut best) = (0.0, (blocks.start, 0.0));
    for place in blocks {
        sum += towards * (distances_m[place] - middle_m);
        if sum < best.1 {
            best = (place, sum);
        }
    }
    best.0 + 1
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frames::Vector;
    use rand::{RngExt, SeedableRng};
    use rand_distr::StandardNormal;
    use rand_xoshiro::Xoshiro256PlusPlus;

    const PLACES: [[f64; 3]; 4] =
        [[0.0, 0.0, 0.0], [0.8, 0.0, 0.0], [0.0, 0.5, 0.0], [0.0, -0.5, 0.0]];

    /// Antenna 1 goes forward at epoch 130 of 240; 2 mm of noise, correlated over so many epochs.
    fn session(forward_m: f64, correlation: f64, seed: u64) -> Vec<PositionEpoch> {
        let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
        let memory = if correlation > 0.0 { (-1.0 / correlation).exp() } else { 0.0 };
        let mut noise_m = [[0.0; 3]; 4];
        let mut epoch = |k: u32| {
            let antenna = |(index, place): (usize, &[f64; 3])| {
                for noise_m in &mut noise_m[index] {
                    let step: f64 = random.sample(StandardNormal);
                    *noise_m = memory * *noise_m + 0.002 * (1.0 - memory * memory).sqrt() * step;
                }
                let [x, y, z] = noise_m[index];
                let forward_m = if index == 1 && k >= 130 { forward_m } else { 0.0 };
                let offset = Vector::new(place[0] + forward_m + x, place[1] + y, place[2] + z);
                let position_m = Vector::new(3e6, 4e6, 4e6) + offset;
                Some(AntennaFix { position_m, sd_ned_m: [0.002; 3], doubt: None })
            };
            PositionEpoch {
                time: GpsTime::from_nanoseconds(1_300_000_000_000_000_000) + f64::from(k),
                antennas: PLACES.iter().enumerate().map(antenna).collect(),
            }
        };
        (0..240).map(&mut epoch).collect()
    }

    #[test]
    fn a_moved_antenna_is_told_with_place_and_time() {
        for (forward_m, seconds) in [(0.2, 0.0), (-0.02, 2.0), (0.01, 4.0)] {
            let moved = find(&session(forward_m, 0.0, 5), 4).unwrap();
            assert_eq!(moved.antennas, [1], "{moved:?}");
            let late_s =
                moved.between[1] - (GpsTime::from_nanoseconds(1_300_000_000_000_000_000) + 130.0);
            assert!(late_s.abs() <= seconds, "{late_s}");
            let to_origin = moved.distances.iter().find(|step| step.first == 0).unwrap();
            let step_m = to_origin.after_m - to_origin.before_m;
            assert!((step_m - forward_m).abs() < 0.002, "{moved:?}");
        }
    }

    #[test]
    fn noise_and_reflections_are_no_move() {
        for correlation in [0.0, 5.0, 30.0, 120.0] {
            for seed in 0..5 {
                assert_eq!(find(&session(0.0, correlation, seed), 4), None, "{correlation} {seed}");
            }
        }
    }
}
