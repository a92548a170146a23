//! What the rows show against the truth.

use kurs::frames::Attitude;
use nalgebra::{Matrix3, Vector3};

use super::simulation::{Simulation, Truth, bound};

const STATUS: usize = 3;
const ANTENNAS: usize = 5;
const ANGLES: usize = 8;
/// Columns whose places are used here.
pub(crate) const COLUMNS: [(usize, &str); 3] =
    [(STATUS, "status"), (ANTENNAS, "antennas"), (ANGLES, "heading_deg")];
/// χ² of three that chance exceeds once in a hundred thousand epochs.
const REPAIRED_CHI_SQUARED: f64 = 25.9;

/// Figures over all rows of a run.
#[derive(Debug, Default)]
pub(crate) struct Figures {
    /// Rows without a displaced antenna, and those of them that are fixed.
    pub(crate) undisturbed: usize,
    pub(crate) fixed: usize,
    /// Mean of the normalised squared error of these (three degrees of freedom).
    pub(crate) nees: f64,
    /// RMS of the rotation against the Cramér–Rao bound of these.
    pub(crate) rms_over_bound: f64,
    /// RMS of the rotation, degrees.
    pub(crate) rms_deg: f64,
    /// Rows with all antennas there and one displaced, and those that are fixed and wrong.
    pub(crate) displaced: usize,
    pub(crate) missed: usize,
}

impl Figures {
    /// Compares the rows of `attitude.csv`.
    pub(crate) fn of(rows: &[csv::StringRecord], simulation: &Simulation) -> Self {
        assert_eq!(rows.len(), simulation.truths.len());
        let mut figures = Self::default();
        let (mut squares, mut bounds) = (0.0, 0.0);
        for (row, truth) in rows.iter().zip(&simulation.truths) {
            if truth.displaced.is_some() {
                figures.displaced += usize::from(truth.is_whole);
                let is_wrong = is_fixed(row) && nees(row, truth) > REPAIRED_CHI_SQUARED;
                figures.missed += usize::from(truth.is_whole && is_wrong);
                continue;
            }
            figures.undisturbed += 1;
            if is_fixed(row) {
                figures.fixed += 1;
                figures.nees += nees(row, truth);
                squares += rotation_error(row, truth).norm_squared();
                let present = simulation.array.len() - usize::from(!truth.is_whole);
                bounds += bound(&simulation.array[..present], &truth.attitude).trace();
            }
        }
        let count = figures.fixed as f64;
        figures.nees /= count;
        figures.rms_over_bound = (squares / bounds).sqrt();
        figures.rms_deg = (squares / count).sqrt().to_degrees();
        figures
    }

    /// Half width of the 99.9 % band of the mean of `fixed` values of χ² with three degrees of
    /// freedom: 3.29 √(6/n).
    pub(crate) fn nees_band(&self) -> f64 {
        3.29 * (6.0 / self.fixed as f64).sqrt()
    }

    /// Share of the displaced epochs that pass as good.
    pub(crate) fn missed_share(&self) -> f64 {
        self.missed as f64 / self.displaced as f64
    }

    /// The figures that every run must reach.
    pub(crate) fn check(&self) {
        assert!((self.nees - 3.0).abs() < self.nees_band(), "{self:?}");
        assert!((self.rms_over_bound - 1.0).abs() < 0.05, "{self:?}");
        assert!(self.fixed as f64 >= 0.999 * self.undisturbed as f64, "{self:?}");
    }
}

fn number(row: &csv::StringRecord, column: usize) -> f64 {
    row[column].parse().unwrap()
}

pub(crate) fn is_fixed(row: &csv::StringRecord) -> bool {
    &row[STATUS] == "fixed"
}

fn attitude(row: &csv::StringRecord) -> Attitude {
    let [heading, pitch, roll] = [0, 1, 2].map(|i| number(row, ANGLES + i).to_radians());
    Attitude { heading_rad: heading, pitch_rad: pitch, roll_rad: roll }
}

/// Angle of the turn from the truth to the row as a vector in body axes.
fn rotation_error(row: &csv::StringRecord, truth: &Truth) -> Vector3<f64> {
    let found = attitude(row).ned_from_body().matrix();
    let turn = truth.attitude.ned_from_body().matrix().transpose() * found;
    kurs::attitude::weighted::logarithm(&turn)
}

/// Normalised squared error of the three angles with the covariance of the row.
pub(crate) fn nees(row: &csv::StringRecord, truth: &Truth) -> f64 {
    let (found, wanted) = (attitude(row), &truth.attitude);
    let error = Vector3::new(
        found.heading_rad - wanted.heading_rad,
        found.pitch_rad - wanted.pitch_rad,
        found.roll_rad - wanted.roll_rad,
    )
    .map(|angle| (angle.to_degrees() + 180.0).rem_euclid(360.0) - 180.0);
    let [h, p, r] = [3, 4, 5].map(|i| number(row, ANGLES + i).powi(2));
    let [hp, hr, pr] = [6, 7, 8].map(|i| number(row, ANGLES + i));
    let covariance = Matrix3::new(h, hp, hr, hp, p, pr, hr, pr, r);
    error.dot(&(covariance.try_inverse().unwrap() * error))
}
