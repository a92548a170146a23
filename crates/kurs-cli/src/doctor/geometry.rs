//! The distances between the antennas as the data have them, against those of the configuration.

use kurs::array::AntennaArray;
use kurs::engine::{Constraint, Engine, Settings};
use kurs::frames::Vector;
use kurs::observation::ArrayEpoch;

use super::patient::Patient;
use super::sample::Sample;
use super::trials::Trial;

/// Fixed epochs that a distance needs.
const MIN_FIXES: usize = 5;
/// A distance off by less than this is not wrong: antenna phase centres alone make millimetres.
const TOLERANCE_M: f64 = 0.010;
/// All permutations are tried up to this number of antennas.
const MAX_ANTENNAS: usize = 7;
/// Lengths tried around the configured one on either side where nothing is fixed without a length.
const SCAN_STEP_M: f64 = 0.02;
const SCAN_STEPS: i32 = 15;
/// Share of the epochs that a length needs which is one of the many around the configured one. Where a model is so
/// weak that the right length fixes nothing, a wrong one, with which few integers agree, fixed up to 0.67 of the
/// epochs (single bands, half of the sky hidden up to 40°, eight seeds, three baselines); a right one that fixes
/// at all, 0.9 (the same up to 25°).
const SHARE_OF_LENGTH: f64 = 0.8;
/// The same for a unit: there are only a few, and far from each other.
const SHARE_OF_UNIT: f64 = 1.0 / 3.0;
/// Epochs of the scan.
const SCAN_EPOCHS: usize = 60;

/// One pair of antennas.
#[derive(Debug, Clone, Copy)]
pub(super) struct Distance {
    pub(super) first: usize,
    pub(super) second: usize,
    /// Median over the fixed epochs, m.
    pub(super) found_m: f64,
    /// By the configuration, m.
    pub(super) known_m: f64,
    /// Standard deviation of one epoch, m.
    sd_m: f64,
}

impl Distance {
    pub(super) fn error_m(&self) -> f64 {
        self.found_m - self.known_m
    }

    pub(super) fn is_wrong(&self, array_sd_m: f64) -> bool {
        self.error_m().abs() > TOLERANCE_M.max(3.0 * array_sd_m).max(2.0 * self.sd_m)
    }
}

/// Distances from epochs that were fixed without known geometry.
pub(super) fn distances(free: &Trial, array: &AntennaArray) -> Vec<Distance> {
    let mut found = Vec::new();
    for second in 0..array.len() {
        for first in 0..second {
            let fixed = free.rows.iter().filter(|row| row.is_fixed());
            let lengths = fixed.filter_map(|row| {
                let at = |antenna: usize| {
                    let rover = row.baselines.iter().find(|b| b.rover == antenna);
                    let base = row.baselines.iter().find(|b| b.base == antenna);
                    let origin = base.map(|_| Vector::new(0.0, 0.0, 0.0));
                    rover.map(|b| b.baseline_m).or(origin)
                };
                Some((at(second)? - at(first)?).norm())
            });
            let lengths: Vec<f64> = lengths.collect();
            let variances = free.rows.iter().filter(|row| row.is_fixed()).map(|row| {
                let ends = row.baselines.iter().filter(|b| b.rover == first || b.rover == second);
                ends.map(|b| b.covariance_m2.trace() / 3.0).sum::<f64>()
            });
            let sd_m = median(variances.collect()).sqrt();
            if lengths.len() >= MIN_FIXES {
                let known_m = (array.positions_m()[second] - array.positions_m()[first]).norm();
                let found_m = median(lengths);
                found.push(Distance { first, second, found_m, known_m, sd_m });
            }
        }
    }
    found
}

/// Where nothing is fixed without a length: the length of each baseline from the first antenna with
/// which most epochs are fixed, near the known one or at these multiples of it.
pub(super) fn scanned(
    patient: &Patient<'_>,
    sample: &Sample,
    array: &AntennaArray,
    factors: &[f64],
) -> Vec<Distance> {
    let step = sample.epochs.len().div_ceil(SCAN_EPOCHS).max(1);
    let fixes = |second: usize, length_m: f64| {
        let ends = vec![Vector::new(0.0, 0.0, 0.0), Vector::new(length_m, 0.0, 0.0)];
        let settings = Settings {
            antennas: 2,
            array: AntennaArray::new(ends).ok(),
            points_m: Vec::new(),
            constraint: Constraint::Length,
            array_sd_m: SCAN_STEP_M / 2.0,
            ..patient.settings.clone()
        };
        let Ok(engine) = Engine::new(settings, patient.navigation.clone()) else { return 0 };
        let mount = |antenna: usize| patient.mounts.get(antenna).cloned().flatten();
        let mut engine = engine.with_phase_centers(vec![mount(0), mount(second)]);
        let epochs = sample.epochs.iter().step_by(step);
        let fixed = epochs.filter(|epoch| {
            let pair = vec![epoch.antennas[0].clone(), epoch.antennas[second].clone()];
            let of_pair = ArrayEpoch { time: epoch.time, antennas: pair, station: None };
            engine.push(&of_pair).is_fixed()
        });
        fixed.count()
    };
    let mut found = Vec::new();
    for second in 1..array.len() {
        let known_m = array.baseline_m(second).norm();
        let lengths = (-SCAN_STEPS..=SCAN_STEPS).map(|k| known_m + f64::from(k) * SCAN_STEP_M);
        let scaled = factors.iter().map(|factor| known_m * factor);
        let best = lengths
            .chain(scaled)
            .filter(|length_m| *length_m > SCAN_STEP_M)
            .map(|length_m| (fixes(second, length_m), length_m))
            // Among equals the nearest to what is configured.
            .max_by(|a, b| {
                let off = |length_m: f64| -(length_m - known_m).abs();
                a.0.cmp(&b.0).then(off(a.1).total_cmp(&off(b.1)))
            });
        // A length that mends: many epochs, and more than by chance with the configured one.
        let many = |(count, length_m): (usize, f64)| {
            let is_near = (length_m - known_m).abs() < f64::from(SCAN_STEPS + 1) * SCAN_STEP_M;
            let share = if is_near { SHARE_OF_LENGTH } else { SHARE_OF_UNIT };
            count >= MIN_FIXES && (step * count) as f64 > share * sample.epochs.len() as f64
        };
        if let Some((count, found_m)) = best.filter(|best| many(*best))
            && count > 2 * fixes(second, known_m)
        {
            found.push(Distance { first: 0, second, found_m, known_m, sd_m: 0.0 });
        }
    }
    found
}

/// The order of the antennas with which all distances agree, if that of the configuration does not
/// and one does.
pub(super) fn swapped(
    distances: &[Distance],
    array: &AntennaArray,
    array_sd_m: f64,
) -> Option<Vec<usize>> {
    let pairs = array.len() * (array.len() - 1) / 2;
    if array.len() > MAX_ANTENNAS || distances.len() < pairs {
        return None;
    }
    let places = array.positions_m();
    let fits = |order: &[usize]| {
        distances.iter().all(|d| {
            let known_m = (places[order[d.second]] - places[order[d.first]]).norm();
            !Distance { known_m, ..*d }.is_wrong(array_sd_m)
        })
    };
    let mut order: Vec<usize> = (0..array.len()).collect();
    if fits(&order) {
        return None;
    }
    // The fewest antennas out of place first.
    let mut orders = Vec::new();
    permute(&mut order, 0, &mut orders);
    orders.sort_by_key(|order| order.iter().enumerate().filter(|(i, j)| i != *j).count());
    orders.into_iter().find(|order| fits(order))
}

/// The antenna whose distances are wrong while those among the others are right.
pub(super) fn misplaced(distances: &[Distance], antennas: usize, array_sd_m: f64) -> Option<usize> {
    (0..antennas).find(|antenna| {
        let (its, others): (Vec<&Distance>, Vec<&Distance>) =
            distances.iter().partition(|d| d.first == *antenna || d.second == *antenna);
        its.iter().any(|d| d.is_wrong(array_sd_m))
            && !others.is_empty()
            && !others.iter().any(|d| d.is_wrong(array_sd_m))
    })
}

fn permute(order: &mut Vec<usize>, from: usize, all: &mut Vec<Vec<usize>>) {
    if from == order.len() {
        all.push(order.clone());
        return;
    }
    for other in from..order.len() {
        order.swap(from, other);
        permute(order, from + 1, all);
        order.swap(from, other);
    }
}

pub(super) fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}
