//! Measured lengths between antennas against the known ones: is it noise, or another body?
//!
//! Noise scatters from epoch to epoch. What the median length is off in every epoch alike is no noise,
//! and no factor on the standard deviations makes it one.

use std::collections::BTreeMap;

use super::geometry::{median, scatter};
use crate::attitude::coordinates::MeasuredPoint;

/// The length between two antennas over many epochs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Length {
    /// Index of the first antenna.
    pub first: usize,
    /// Index of the second antenna.
    pub second: usize,
    /// Known length, m.
    pub known_m: f64,
    /// Median of the measured lengths, m.
    pub measured_m: f64,
    /// Their scatter from epoch to epoch, one standard deviation, m.
    pub scatter_m: f64,
    /// Median of the standard deviations that the coordinates state, m.
    pub stated_sd_m: f64,
    /// Epochs that have both antennas.
    pub epochs: usize,
}

impl Length {
    /// How much too long it is, in stated standard deviations.
    #[must_use]
    pub fn excess(&self) -> f64 {
        (self.measured_m - self.known_m).abs() / self.stated_sd_m
    }

    /// Whether it is off in nearly every epoch alike, by more than its noise.
    #[must_use]
    pub fn is_steadily_off(&self) -> bool {
        self.epochs >= STEADY_EPOCHS
            && self.excess() > 1.0
            && (self.measured_m - self.known_m).abs() > STEADY_SD * self.scatter_m
    }
}

/// A median length so many deviations of one epoch off is off in every epoch: noise of which the median
/// is the same would lie on one side only.
const STEADY_SD: f64 = 3.0;
/// Epochs from which the scatter tells.
const STEADY_EPOCHS: usize = 10;

/// One pair in every epoch.
#[derive(Debug, Default)]
struct Measured {
    known_m: f64,
    lengths_m: Vec<f64>,
    stated_sd_m: Vec<f64>,
}

/// Lengths of all pairs of these epochs, each a list of antennas and points.
pub(super) fn of(epochs: impl Iterator<Item = Vec<(usize, MeasuredPoint)>>) -> Vec<Length> {
    let mut pairs: BTreeMap<(usize, usize), Measured> = BTreeMap::new();
    for points in epochs {
        for (place, (second, b)) in points.iter().enumerate() {
            for (first, a) in &points[..place] {
                let known_m = (b.body_m - a.body_m).norm();
                let line = b.measured_m - a.measured_m;
                let unit = line.try_normalize(0.0).unwrap_or_default();
                let variance_m2 = |p: &MeasuredPoint| {
                    // Information is diagonal in local level axes.
                    unit.component_mul(&unit).component_div(&p.information.diagonal()).sum()
                };
                let measured = pairs.entry((*first, *second)).or_default();
                measured.known_m = known_m;
                measured.lengths_m.push(line.norm());
                measured.stated_sd_m.push((variance_m2(a) + variance_m2(b)).sqrt());
            }
        }
    }
    let length = |((first, second), measured): ((usize, usize), Measured)| {
        let Measured { known_m, lengths_m, stated_sd_m } = measured;
        let epochs = lengths_m.len();
        let (measured_m, scatter_m) = (median(lengths_m.clone()), scatter(&lengths_m));
        let stated_sd_m = median(stated_sd_m);
        Length { first, second, known_m, measured_m, scatter_m, stated_sd_m, epochs }
    };
    pairs.into_iter().map(length).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix3, Vector3};

    #[test]
    fn scatter_and_excess_are_told_apart() {
        let epoch = |longer_m: f64| {
            let point = |body: f64, measured: f64| MeasuredPoint {
                body_m: Vector3::new(body, 0.0, 0.0),
                measured_m: Vector3::new(0.0, measured, 0.0),
                information: Matrix3::identity() / (0.01 * 0.01),
            };
            vec![(0, point(0.0, 0.0)), (2, point(2.0, 2.5 + longer_m))]
        };
        let lengths = of([-0.03, -0.01, 0.0, 0.01, 0.02].into_iter().map(epoch));
        let [length] = lengths[..] else { panic!("{lengths:?}") };
        assert_eq!((length.first, length.second, length.known_m), (0, 2, 2.0));
        assert!((length.measured_m - 2.5).abs() < 1e-12);
        assert!((length.scatter_m - 0.014_826).abs() < 1e-9);
        assert!((length.stated_sd_m - 0.01 * 2f64.sqrt()).abs() < 1e-12);
        assert!((length.excess() - 0.5 / 0.014_142_135_6).abs() < 1e-6);
        assert!(Length { epochs: 10, ..length }.is_steadily_off() && !length.is_steadily_off());
    }
}
