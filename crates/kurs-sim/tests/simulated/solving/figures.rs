//! What many rows came to: how many are fixed, how many of these are wrong, and whether errors are
//! what their standard deviations say.

use std::collections::BTreeMap;

use kurs::chi_square::chi_square_tail;
use kurs::frames::{Geodetic, enu_from_ned};
use kurs::solution::EpochSolution;
use kurs_sim::simulation::BodyTruth;

use super::{Integers, known_angle_errors};

/// A baseline further off than this, and than so many of its standard deviations, is wrong on
/// recordings, where integers are not known.
const OFF_M: f64 = 0.05;
const OFF_SDS: f64 = 5.0;

/// Sums over rows.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Figures {
    pub(crate) rows: usize,
    pub(crate) fixed: usize,
    /// Fixed with at least one wrong integer.
    pub(crate) wrong: usize,
    /// Fixed with a baseline off as it would be called wrong on a recording.
    pub(crate) off: usize,
    /// Fixed with heading, pitch or roll beyond three standard deviations.
    pub(crate) beyond: usize,
    /// Of heading, pitch, roll of right fixes over their standard deviations: sums of squares, and
    /// how many.
    squares: [f64; 3],
    known: [usize; 3],
    /// Rows with a position, and those with one further off than five standard deviations.
    pub(crate) located: usize,
    pub(crate) far: usize,
    /// Rows that are not fixed, by reason.
    pub(crate) reasons: BTreeMap<&'static str, usize>,
}

impl Figures {
    /// Takes a row in.
    pub(crate) fn take(&mut self, truth: &BodyTruth, row: &EpochSolution, integers: Integers) {
        self.rows += 1;
        self.take_position(truth, row);
        if !row.is_fixed() {
            let word = row.reason().map_or("none", |reason| reason.word());
            *self.reasons.entry(word).or_default() += 1;
            return;
        }
        self.fixed += 1;
        self.off += usize::from(is_off(truth, row));
        let is_right = integers == Integers::Right;
        self.wrong += usize::from(!is_right);
        let unit = unit_angle_errors(truth, row);
        self.beyond += usize::from(unit.iter().flatten().any(|error| error.abs() > 3.0));
        for (k, error) in unit.iter().enumerate() {
            if let Some(error) = error.filter(|_| is_right) {
                self.squares[k] += error * error;
                self.known[k] += 1;
            }
        }
    }

    fn take_position(&mut self, truth: &BodyTruth, row: &EpochSolution) {
        let Some(position) = &row.position else { return };
        self.located += 1;
        let to_ned = Geodetic::from_ecef(truth.position_m).ned_from_ecef();
        let error_m = (to_ned * (position.position_m - truth.position_m)).xyz();
        let sds_m = position.covariance_m2.diagonal().map(f64::sqrt);
        let is_far = error_m.iter().zip(&sds_m).any(|(error, sd)| error.abs() > OFF_SDS * sd);
        self.far += usize::from(is_far);
    }

    /// Adds others.
    pub(crate) fn add(&mut self, others: &Self) {
        self.rows += others.rows;
        self.fixed += others.fixed;
        self.wrong += others.wrong;
        self.off += others.off;
        self.beyond += others.beyond;
        self.located += others.located;
        self.far += others.far;
        for k in 0..3 {
            self.squares[k] += others.squares[k];
            self.known[k] += others.known[k];
        }
        for (word, count) in &others.reasons {
            *self.reasons.entry(word).or_default() += count;
        }
    }

    /// Mean normalised squares of heading, pitch and roll, 1 where standard deviations are honest.
    pub(crate) fn mean_squares(&self) -> [Option<f64>; 3] {
        core::array::from_fn(|k| {
            (self.known[k] > 0).then(|| self.squares[k] / self.known[k] as f64)
        })
    }

    /// Share of the rows, per cent.
    pub(crate) fn per_cent(&self, count: usize) -> f64 {
        100.0 * count as f64 / self.rows.max(1) as f64
    }

    /// Share of the fixed rows, per cent.
    pub(crate) fn per_cent_of_fixed(&self, count: usize) -> f64 {
        100.0 * count as f64 / self.fixed.max(1) as f64
    }

    /// Wrong fixes per fix with the interval of 95 % that belongs to their number.
    pub(crate) fn wrong_per_fix(&self) -> [f64; 3] {
        let [low, high] = poisson_interval(self.wrong);
        [self.wrong as f64, low, high].map(|count| count / self.fixed.max(1) as f64)
    }

    /// The most frequent reasons of rows that are not fixed, in words.
    pub(crate) fn most_frequent_reasons(&self, most: usize) -> String {
        let mut reasons: Vec<_> = self.reasons.iter().collect();
        reasons.sort_by_key(|(_, count)| core::cmp::Reverse(**count));
        let words = reasons.iter().take(most);
        let words = words.map(|(word, count)| format!("{word} {:.1} %", self.per_cent(**count)));
        words.collect::<Vec<_>>().join(", ")
    }
}

/// Heading, pitch, roll over their standard deviations, where they are known.
fn unit_angle_errors(truth: &BodyTruth, row: &EpochSolution) -> [Option<f64>; 3] {
    let errors = known_angle_errors(truth, row);
    core::array::from_fn(|k| {
        let variance = row.attitude()?.covariance_rad2[(k, k)];
        errors[k].map(|error| error / variance.sqrt())
    })
}

fn is_off(truth: &BodyTruth, row: &EpochSolution) -> bool {
    row.baselines.iter().filter(|baseline| baseline.base == 0).any(|baseline| {
        let wanted = enu_from_ned() * truth.baselines_m[baseline.rover - 1];
        let error_m = (baseline.baseline_m - wanted).xyz();
        let limits_m = baseline.covariance_m2.diagonal().map(|v| (OFF_SDS * v.sqrt()).max(OFF_M));
        error_m.iter().zip(&limits_m).any(|(error, limit)| error.abs() > *limit)
    })
}

/// Means of a Poisson distribution under which no fewer and no more than `count` have 2.5 % each.
pub(crate) fn poisson_interval(count: usize) -> [f64; 2] {
    /// Above, the distribution is normal for all purposes, and the sums below lose their digits.
    const MANY: usize = 300;
    if count > MANY {
        let half = 1.96 * (count as f64).sqrt();
        return [count as f64 - half, count as f64 + half];
    }
    // P(at most k | λ) = P(χ²(2k + 2) > 2λ)
    let at_most = |k: usize, mean: f64| chi_square_tail(2.0 * mean, 2 * k + 2);
    let high = falls_to(0.025, |mean| at_most(count, mean));
    let low = count.checked_sub(1).map_or(0.0, |less| falls_to(0.975, |mean| at_most(less, mean)));
    [low, high]
}

/// Where a falling function of a mean between 0 and 1000 has this value.
fn falls_to(value: f64, function: impl Fn(f64) -> f64) -> f64 {
    let (mut low, mut high) = (0.0, 1000.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if function(middle) > value { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}
