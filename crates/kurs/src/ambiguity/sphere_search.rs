//! All integer vectors that fit some direction of a baseline of known length: a search over the
//! sphere instead of over the integers.
//!
//! It shares no code with the other searches, so that it can judge them, and it does not need code
//! observations. Its cost is the number of directions, so it is for short baselines.
//!
//! ```text
//! c(z) = min over b of |φ − Λ z − G b|²_Qφ + (b − b_P)ᵀ N_P (b − b_P) + (|b| − l)² / σ²
//! ```
//!
//! **No vector is missed.** Let `c(z) <= c`, reached at `b`. Then each phase residual is within
//! `√c σᵢ`, the length within `√c σ` of `l`, and a point `b'` of the grid of radius `l` is within
//! `ε = l δ + √c σ` of `b`, where `δ` is the angle between rings and between the points of a ring:
//! go half of `δ` along the meridian to the nearest ring, and half of `δ` along the ring. So
//! `|φᵢ − λᵢ zᵢ − gᵢᵀ b'| <= √c σᵢ + |gᵢ| ε` for every `i`, and all integers in these intervals are
//! tried.

use std::collections::BTreeMap;

use nalgebra::{DMatrix, DVector, Matrix3, Vector3};

use super::{AmbiguityError, MAX_CYCLES, sphere::Length};

/// Share of the shortest wavelength between points of the grid.
const SPACING: f64 = 1.0 / 16.0;
/// A grid of more points than this is refused: at L1 a sphere of about 13 m.
const MAX_POINTS: f64 = 2e7;
/// Newton steps for the baseline of one vector.
const MAX_STEPS: usize = 50;
/// Below this the standard deviation of the length is taken as this, m: a hundredth of a
/// millimetre is nothing to a phase.
const LEAST_LENGTH_SD_M: f64 = 1e-5;

/// Differenced phases of one baseline, and what else is known of it.
#[derive(Debug, Clone, PartialEq)]
pub struct PhaseModel {
    /// `φ`, `n`, m.
    pub phases_m: DVector<f64>,
    /// `λ`, `n`, m.
    pub wavelengths_m: DVector<f64>,
    /// `G`, `n × 3`: change of the phases with the baseline.
    pub design: DMatrix<f64>,
    /// `Q_φ`, `n × n`, m².
    pub covariance_m2: DMatrix<f64>,
    /// `b_P`, m: the baseline from code alone.
    pub prior_m: Vector3<f64>,
    /// `N_P`, 1/m²: its information; zero without code.
    pub prior_information: Matrix3<f64>,
}

/// An integer vector that fits.
#[derive(Debug, Clone, PartialEq)]
pub struct SphereCandidate {
    /// `z`, cycles.
    pub integers: Vec<i64>,
    /// `c(z)`.
    pub cost: f64,
    /// The baseline with this cost, m.
    pub baseline_m: Vector3<f64>,
}

/// Every integer vector with `c(z) <= max_cost`, cheapest first.
///
/// # Errors
///
/// [`AmbiguityError`]: dimensions, numbers that are not finite, a covariance that is not positive
/// definite, and `BudgetExceeded` for a grid of more than twenty million points.
pub fn all_within(
    model: &PhaseModel,
    length: Length,
    max_cost: f64,
) -> Result<Vec<SphereCandidate>, AmbiguityError> {
    let weight = checked_weight(model, length)?;
    let mut best_start: BTreeMap<Vec<i64>, (f64, Vector3<f64>)> = BTreeMap::new();
    let grid = Grid::new(model, length, max_cost)?;
    let mut ranges = Vec::with_capacity(model.phases_m.len());
    grid.for_each_point(|point| {
        if grid.integer_ranges(model, point, &mut ranges) {
            for_each_vector(&ranges, |integers| {
                let cost = Objective { model, weight: &weight, length, integers }.value(point);
                match best_start.get_mut(integers) {
                    Some(start) if start.0 <= cost => {}
                    Some(start) => *start = (cost, *point),
                    None => {
                        best_start.insert(integers.to_vec(), (cost, *point));
                    }
                }
            });
        }
    });
    let mut found: Vec<SphereCandidate> = best_start
        .into_iter()
        .map(|(integers, (_, start))| {
            let objective = Objective { model, weight: &weight, length, integers: &integers };
            let baseline_m = objective.minimiser(start);
            SphereCandidate { cost: objective.value(&baseline_m), integers, baseline_m }
        })
        .filter(|candidate| candidate.cost <= max_cost)
        .collect();
    found.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    Ok(found)
}

/// `Q_φ⁻¹`, after a check of everything.
fn checked_weight(model: &PhaseModel, length: Length) -> Result<DMatrix<f64>, AmbiguityError> {
    length.check()?;
    let n = model.phases_m.len();
    if n == 0 {
        return Err(AmbiguityError::Empty);
    }
    for (what, found, expected) in [
        ("the wavelengths", model.wavelengths_m.len(), n),
        ("the design (rows)", model.design.nrows(), n),
        ("the design (columns)", model.design.ncols(), 3),
        ("the covariance (rows)", model.covariance_m2.nrows(), n),
        ("the covariance (columns)", model.covariance_m2.ncols(), n),
    ] {
        if found != expected {
            return Err(AmbiguityError::Dimension { what, found, expected });
        }
    }
    for (phase, wavelength) in model.phases_m.iter().zip(&model.wavelengths_m) {
        let cycles = phase / wavelength;
        if !cycles.is_finite() || cycles.abs() >= MAX_CYCLES || *wavelength <= 0.0 {
            return Err(AmbiguityError::OutOfRange { what: "a phase in cycles", value: cycles });
        }
    }
    let rest = model.design.iter().chain(&model.prior_m).chain(&model.prior_information);
    if let Some(value) = rest.copied().find(|value| !value.is_finite()) {
        return Err(AmbiguityError::OutOfRange { what: "the phase model", value });
    }
    let factor = model.covariance_m2.clone().cholesky().ok_or_else(|| {
        let variance = model.covariance_m2.diagonal().min();
        AmbiguityError::NotPositiveDefinite { index: 0, variance }
    })?;
    Ok(factor.inverse())
}

/// Rings of points on the sphere, and how far a phase may be from what a point predicts.
struct Grid {
    radius_m: f64,
    rings: u32,
    /// `√c σᵢ + |gᵢ| ε`, m.
    tolerances_m: Vec<f64>,
}

impl Grid {
    fn new(model: &PhaseModel, length: Length, max_cost: f64) -> Result<Self, AmbiguityError> {
        let spacing_m = SPACING * model.wavelengths_m.min();
        let rings = (std::f64::consts::PI * length.length_m / spacing_m).ceil().max(2.0);
        let points = 4.0 * rings * rings / std::f64::consts::PI;
        if points > MAX_POINTS {
            return Err(AmbiguityError::BudgetExceeded { nodes: whole_count(points) });
        }
        let rings = u32::try_from(whole_count(rings)).unwrap_or(u32::MAX);
        let deviations = max_cost.max(0.0).sqrt();
        let angle = std::f64::consts::PI / f64::from(rings);
        let reach_m = length.length_m * angle + deviations * length.sd_m.max(LEAST_LENGTH_SD_M);
        let tolerances_m = (0..model.phases_m.len())
            .map(|i| {
                let sigma_m = model.covariance_m2[(i, i)].sqrt();
                deviations * sigma_m + model.design.row(i).norm() * reach_m
            })
            .collect();
        Ok(Self { radius_m: length.length_m, rings, tolerances_m })
    }

    /// Points at most `δ = π / rings` apart along each ring, rings at most `δ` apart.
    fn for_each_point(&self, mut visit: impl FnMut(&Vector3<f64>)) {
        let angle = std::f64::consts::PI / f64::from(self.rings);
        for ring in 0..self.rings {
            let (sine, cosine) = ((f64::from(ring) + 0.5) * angle).sin_cos();
            let points = (std::f64::consts::TAU * sine / angle).ceil().max(1.0);
            let mut number = 0.0;
            while number < points {
                let (y, x) = (number * std::f64::consts::TAU / points).sin_cos();
                visit(&(Vector3::new(sine * x, sine * y, cosine) * self.radius_m));
                number += 1.0;
            }
        }
    }

    /// First and last integer that each phase allows at a point; false if one allows none.
    fn integer_ranges(
        &self,
        model: &PhaseModel,
        point: &Vector3<f64>,
        ranges: &mut Vec<(i64, i64)>,
    ) -> bool {
        ranges.clear();
        for i in 0..model.phases_m.len() {
            let predicted_m = model.design[(i, 0)] * point.x
                + model.design[(i, 1)] * point.y
                + model.design[(i, 2)] * point.z;
            let rest_m = model.phases_m[i] - predicted_m;
            let first = whole((rest_m - self.tolerances_m[i]) / model.wavelengths_m[i], f64::ceil);
            let last = whole((rest_m + self.tolerances_m[i]) / model.wavelengths_m[i], f64::floor);
            if first > last {
                return false;
            }
            ranges.push((first, last));
        }
        true
    }
}

#[expect(clippy::cast_possible_truncation, reason = "phases are checked to be below 2⁵² cycles")]
fn whole(cycles: f64, round: fn(f64) -> f64) -> i64 {
    round(cycles) as i64
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a count; saturates")]
fn whole_count(count: f64) -> usize {
    count as usize
}

/// All vectors with each integer in its range.
fn for_each_vector(ranges: &[(i64, i64)], mut visit: impl FnMut(&[i64])) {
    let mut integers: Vec<i64> = ranges.iter().map(|range| range.0).collect();
    loop {
        visit(&integers);
        let Some(i) = (0..ranges.len()).find(|&i| integers[i] < ranges[i].1) else { return };
        integers[i] += 1;
        for (integer, range) in integers[..i].iter_mut().zip(ranges) {
            *integer = range.0;
        }
    }
}

/// The cost of one integer vector as a function of the baseline.
struct Objective<'a> {
    model: &'a PhaseModel,
    weight: &'a DMatrix<f64>,
    length: Length,
    integers: &'a [i64],
}

impl Objective<'_> {
    fn value(&self, b: &Vector3<f64>) -> f64 {
        let model = self.model;
        let n = self.integers.len();
        let residual = |i: usize| {
            model.phases_m[i]
                - model.wavelengths_m[i] * self.integers[i] as f64
                - model.design[(i, 0)] * b.x
                - model.design[(i, 1)] * b.y
                - model.design[(i, 2)] * b.z
        };
        let residuals: Vec<f64> = (0..n).map(residual).collect();
        let mut cost = 0.0;
        for j in 0..n {
            let column = self.weight.column(j);
            let weighted: f64 = column.iter().zip(&residuals).map(|(w, r)| w * r).sum();
            cost += residuals[j] * weighted;
        }
        let from_prior = b - model.prior_m;
        let stretch = (b.norm() - self.length.length_m) / self.length.sd_m.max(LEAST_LENGTH_SD_M);
        cost + from_prior.dot(&(model.prior_information * from_prior)) + stretch * stretch
    }

    /// Newton's method from `start`, damped so that it descends.
    fn minimiser(&self, start: Vector3<f64>) -> Vector3<f64> {
        let model = self.model;
        let information = model.design.transpose() * self.weight * &model.design;
        let information: Matrix3<f64> =
            information.fixed_view::<3, 3>(0, 0) + model.prior_information;
        let length_weight = self.length.sd_m.max(LEAST_LENGTH_SD_M).powi(-2);
        let mut b = start;
        let mut value = self.value(&b);
        for _ in 0..MAX_STEPS {
            let integers = DVector::from_iterator(
                self.integers.len(),
                self.integers.iter().map(|&z| z as f64),
            );
            let residual =
                &model.phases_m - model.wavelengths_m.component_mul(&integers) - &model.design * b;
            let pull = model.design.transpose() * (self.weight * residual);
            let r = b.norm();
            let unit = b / r;
            let stretch = r - self.length.length_m;
            // −½ ∇ and ½ ∇² (without the part of a shorter length, which would bend down)
            let descent = Vector3::new(pull[0], pull[1], pull[2])
                - model.prior_information * (b - model.prior_m)
                - unit * (stretch * length_weight);
            let outer = unit * unit.transpose();
            let across = (Matrix3::identity() - outer) * (stretch.max(0.0) / r);
            let curvature = information + (outer + across) * length_weight;
            let Some(factor) = curvature.cholesky() else { return b };
            let mut step = factor.solve(&descent);
            let mut next = self.value(&(b + step));
            while next > value && step.norm() > 1e-12 {
                step *= 0.5;
                next = self.value(&(b + step));
            }
            if next > value {
                return b;
            }
            b += step;
            value = next;
            if step.norm() < 1e-11 {
                return b;
            }
        }
        b
    }
}

#[cfg(test)]
mod tests {
    use super::super::length_constrained::LengthConstrained;
    use super::super::problems::{L1_M, L2_M, Noise, Sky, normal, seeded};
    use super::*;

    /// Both searches on random epochs; returns how many candidates were compared.
    fn compare(epochs: usize, seed: u64, length_m: f64, satellites: [usize; 2]) -> usize {
        const MAX_COST: f64 = 30.0;
        let mut random = seeded(seed);
        let mut search = LengthConstrained::default();
        let mut compared = 0;
        for case in 0..epochs {
            let sky = Sky::random(
                &mut random,
                satellites[0] + case % (satellites[1] - satellites[0] + 1),
            );
            let bands: &[f64] = if case % 3 == 0 { &[L1_M, L2_M] } else { &[L1_M] };
            let noise = Noise { code_m: [0.15, 0.3, 0.6][case % 3], phase_m: 0.003 };
            let direction = Vector3::from_fn(|_, _| normal(&mut random)).normalize();
            let epoch = sky.epoch(&mut random, bands, noise, &[direction * length_m]);
            let length = Length { length_m, sd_m: [1e-5, 0.002, 0.005][case % 3] };
            let expected = all_within(&epoch.phase_model(), length, MAX_COST).unwrap();
            let found = search.solve(&epoch.float, length, expected.len() + 1).unwrap();
            for (ours, oracle) in found.iter().zip(&expected) {
                assert!(
                    (ours.cost - oracle.cost).abs() < 1e-4 * (1.0 + oracle.cost),
                    "case {case}"
                );
                assert_eq!(ours.integers, oracle.integers, "case {case}");
                assert!((ours.baseline_m - oracle.baseline_m).norm() < 1e-4, "case {case}");
            }
            let next = found.get(expected.len()).map_or(search.proven_to(), |c| c.cost);
            assert!(next > MAX_COST * (1.0 - 1e-6), "case {case}: one more at {next}");
            compared += found.len().min(expected.len());
        }
        compared
    }

    #[test]
    fn the_search_over_integers_finds_the_same() {
        let compared = compare(150, 60, 0.5, [4, 12]);
        assert!(compared > 150, "{compared}");
        compare(20, 61, 1.0, [4, 20]);
    }

    #[test]
    fn code_is_not_needed() {
        let mut random = seeded(62);
        let mut right = 0;
        for _ in 0..10 {
            let noise = Noise { code_m: 0.3, phase_m: 0.002 };
            let truth = Vector3::new(0.2, -0.4, 0.1);
            let epoch = Sky::random(&mut random, 10).epoch(&mut random, &[L1_M], noise, &[truth]);
            let mut model = epoch.phase_model();
            model.prior_information = Matrix3::zeros();
            let length = Length { length_m: truth.norm(), sd_m: 0.001 };
            let found = all_within(&model, length, 60.0).unwrap();
            right += usize::from(found[0].integers == epoch.integers);
        }
        assert!(right >= 8, "{right}");
    }

    #[test]
    fn a_sphere_too_large_is_refused() {
        let mut random = seeded(63);
        let noise = Noise { code_m: 0.3, phase_m: 0.003 };
        let epoch = Sky::random(&mut random, 6).epoch(&mut random, &[L1_M], noise, &[Vector3::x()]);
        let length = Length { length_m: 100.0, sd_m: 0.01 };
        let found = all_within(&epoch.phase_model(), length, 30.0);
        assert!(matches!(found, Err(AmbiguityError::BudgetExceeded { .. })), "{found:?}");
    }
}
