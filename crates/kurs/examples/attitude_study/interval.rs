//! A figure with its interval, by drawing the sample again.

use core::fmt;

use rand::{RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;

const DRAWS: usize = 1000;
const SEED: u64 = 95;

/// A figure and its 95 % interval.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Interval {
    /// Of the sample as it is.
    pub(crate) value: f64,
    /// 2.5 % and 97.5 % of the drawn samples.
    pub(crate) limits: [f64; 2],
}

/// A statistic of `count` members, given by their numbers, with its interval (Efron 1979).
pub(crate) fn bootstrap(count: usize, statistic: impl Fn(&[usize]) -> f64) -> Interval {
    let mut random = Xoshiro256PlusPlus::seed_from_u64(SEED);
    let all: Vec<usize> = (0..count).collect();
    let mut drawn_values: Vec<f64> = (0..DRAWS)
        .map(|_| {
            let drawn: Vec<usize> = (0..count).map(|_| random.random_range(0..count)).collect();
            statistic(&drawn)
        })
        .collect();
    drawn_values.sort_by(f64::total_cmp);
    let limits = [drawn_values[DRAWS / 40], drawn_values[DRAWS - 1 - DRAWS / 40]];
    Interval { value: statistic(&all), limits }
}

impl fmt::Display for Interval {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { value, limits: [low, high] } = self;
        write!(f, "{value:.3} ({low:.3} to {high:.3})")
    }
}
