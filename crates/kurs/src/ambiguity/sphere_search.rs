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
//! **No vector is missed.** Let `c(z) <= c`, reached at `b`. Then the length of `b` is within `√c σ`
//! of `l`, and so within `h` of the radius `r` of one of the shells of the grid; its stretch costs at
//! least `((|r − l| − h) / σ)²`, which leaves `c'` for all else. A point `b'` of the shell is within
//! `ε = r δ + h` of `b`, where `δ` is the angle between rings and between the points of a ring: go
//! half of `δ` along the meridian to the nearest ring, and half of `δ` along the ring. The prior and
//! the first `k` phases misfit `b` by at most `√c'`, in the norm of their weights, and from `b` to
//! `b'` this changes by no more than `ε` times the largest stretch of that norm:
//!
//! ```text
//! |b' − b_P|²_N + Σᵢ uᵢ² (i <= k)  <=  (√c' + ε √λmax(N_P + G_kᵀ Q_k⁻¹ G_k))²
//! L u = φ − Λ z − G b',     Q_φ = L Lᵀ
//! ```
//!
//! At every point all vectors are tried, one integer after the other, that keep to this for each `k`.

use std::collections::BTreeMap;

use nalgebra::{Cholesky, DMatrix, DVector, Dyn, Matrix3, Vector3};

use super::{AmbiguityError, MAX_CYCLES, sphere::Length};

/// Share of the shortest wavelength between points of the grid. Fewer points leave more integers at each: of 1/8, 1/5,
/// 1/4 and 1/3 this took the least time (13 ambiguities, 1 m: medians of 10, 6.6, 6.1 and 9.8 ms on a busy machine).
const SPACING: f64 = 1.0 / 4.0;
/// A grid of more points than this is refused: at L1 a sphere of about 30 m.
const MAX_POINTS: f64 = 2e7;
/// Newton steps for the baseline of one vector.
const MAX_STEPS: usize = 50;
/// Below this the standard deviation of the length is taken as this, m: a hundredth of a
/// millimetre is nothing to a phase.
const MIN_LENGTH_SD_M: f64 = 1e-5;

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
    let mut no_end = usize::MAX;
    all_in_time(model, length, max_cost, &mut no_end)
}

/// All candidates as [`all_within`] finds them, but no more than `nodes` integers are tried, those that are left
/// remain: noisy phases leave many at each point.
///
/// # Errors
///
/// As [`all_within`]; `BudgetExceeded` also where these are too few.
pub fn all_in_time(
    model: &PhaseModel,
    length: Length,
    max_cost: f64,
    nodes: &mut usize,
) -> Result<Vec<SphereCandidate>, AmbiguityError> {
    let factor = checked_factor(model, length)?;
    let weight = factor.inverse();
    let mut best_start: BTreeMap<Vec<i64>, (f64, Vector3<f64>)> = BTreeMap::new();
    let mut branch = Branch { nodes_left: *nodes, ..Branch::default() };
    for shell in shells(model, length, max_cost)? {
        let tree = Tree::new(model, &factor, shell.max_cost, shell.reach_m());
        shell.for_each_point(|point| {
            tree.for_each_vector(point, &mut branch, |integers, cost| {
                match best_start.get_mut(integers) {
                    Some(start) if start.0 <= cost => {}
                    Some(start) => *start = (cost, *point),
                    None => {
                        best_start.insert(integers.to_vec(), (cost, *point));
                    }
                }
            });
        });
        if branch.nodes_left == 0 {
            let nodes = core::mem::take(nodes);
            return Err(AmbiguityError::BudgetExceeded { nodes });
        }
    }
    *nodes = branch.nodes_left;
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

/// `Q_φ`, factored, after a check of everything.
fn checked_factor(
    model: &PhaseModel,
    length: Length,
) -> Result<Cholesky<f64, Dyn>, AmbiguityError> {
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
    model.covariance_m2.clone().cholesky().ok_or_else(|| {
        let variance = model.covariance_m2.diagonal().min();
        AmbiguityError::NotPositiveDefinite { index: 0, variance }
    })
}

/// Rings of points on a sphere.
struct Shell {
    /// `r`, m.
    radius_m: f64,
    rings: u32,
    /// `h`, m.
    half_thickness_m: f64,
    /// `c'`.
    max_cost: f64,
}

/// Shells that hold every baseline whose length alone costs no more than `max_cost`.
fn shells(model: &PhaseModel, length: Length, max_cost: f64) -> Result<Vec<Shell>, AmbiguityError> {
    let spacing_m = SPACING * model.wavelengths_m.min();
    let sd_m = length.sd_m.max(MIN_LENGTH_SD_M);
    let stretch_m = max_cost.max(0.0).sqrt() * sd_m;
    let (shortest_m, longest_m) =
        ((length.length_m - stretch_m).max(0.0), length.length_m + stretch_m);
    let count = ((longest_m - shortest_m) / spacing_m).ceil().max(1.0);
    let rings = (std::f64::consts::PI * longest_m / spacing_m).ceil().max(2.0);
    let points = 4.0 * rings * rings / std::f64::consts::PI * count;
    if points > MAX_POINTS {
        return Err(AmbiguityError::BudgetExceeded { nodes: whole_count(points) });
    }
    let rings = u32::try_from(whole_count(rings)).unwrap_or(u32::MAX);
    let half_thickness_m = (longest_m - shortest_m) / (2.0 * count);
    let shell = |number: usize| {
        let radius_m = shortest_m + (2 * number + 1) as f64 * half_thickness_m;
        let least_off_m = ((radius_m - length.length_m).abs() - half_thickness_m).max(0.0);
        let max_cost = max_cost - (least_off_m / sd_m).powi(2);
        Shell { radius_m, rings, half_thickness_m, max_cost }
    };
    Ok((0..whole_count(count)).map(shell).collect())
}

impl Shell {
    /// `ε`, m.
    fn reach_m(&self) -> f64 {
        self.radius_m * std::f64::consts::PI / f64::from(self.rings) + self.half_thickness_m
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
}

/// The integers of one point, one phase after the other.
struct Tree<'a> {
    model: &'a PhaseModel,
    /// `Lᵀ`, `n × n`: its columns are what the levels need.
    upper: DMatrix<f64>,
    /// Rows of `G`.
    design: Vec<Vector3<f64>>,
    /// What the prior alone may misfit by at a point, and the first `k + 1` phases with it.
    prior_limit: f64,
    limits: Vec<f64>,
}

/// The way down to one vector; keeps its memory from point to point.
#[derive(Default)]
struct Branch {
    integers: Vec<i64>,
    /// Last integer to try on each level.
    last: Vec<i64>,
    /// `φᵢ − gᵢᵀ b' − Σ Lᵢⱼ uⱼ (j < i)` with `λᵢ zᵢ` still in it, m.
    rest_m: Vec<f64>,
    /// `uᵢ`.
    whitened: Vec<f64>,
    /// Misfit with the integers above this level.
    misfit: Vec<f64>,
    nodes_left: usize,
}

impl<'a> Tree<'a> {
    fn new(
        model: &'a PhaseModel,
        factor: &Cholesky<f64, Dyn>,
        max_cost: f64,
        reach_m: f64,
    ) -> Self {
        let mut whitened = model.design.clone();
        factor.l_dirty().solve_lower_triangular_mut(&mut whitened);
        let mut information = model.prior_information;
        let limit = |information: &Matrix3<f64>| {
            let stretch = information.symmetric_eigenvalues().max().max(0.0).sqrt();
            (max_cost.max(0.0).sqrt() + reach_m * stretch).powi(2)
        };
        let prior_limit = limit(&information);
        let limits = (0..whitened.nrows())
            .map(|k| {
                let row = Vector3::new(whitened[(k, 0)], whitened[(k, 1)], whitened[(k, 2)]);
                information += row * row.transpose();
                limit(&information)
            })
            .collect();
        let design =
            model.design.row_iter().map(|row| Vector3::new(row[0], row[1], row[2])).collect();
        Self { model, upper: factor.l().transpose(), design, prior_limit, limits }
    }

    /// All vectors that keep to the limits at `point`, and what they misfit by there.
    fn for_each_vector(
        &self,
        point: &Vector3<f64>,
        branch: &mut Branch,
        mut visit: impl FnMut(&[i64], f64),
    ) {
        let n = self.limits.len();
        let from_prior = point - self.model.prior_m;
        let prior_misfit = from_prior.dot(&(self.model.prior_information * from_prior));
        if prior_misfit > self.prior_limit || branch.nodes_left == 0 {
            return;
        }
        branch.integers.resize(n, 0);
        branch.last.resize(n, 0);
        branch.rest_m.resize(n, 0.0);
        branch.whitened.resize(n, 0.0);
        branch.misfit.resize(n + 1, 0.0);
        branch.misfit[0] = prior_misfit;
        self.enter(0, point, branch);
        let mut level = 0;
        while branch.nodes_left > 0 {
            if branch.integers[level] > branch.last[level] {
                if level == 0 {
                    return;
                }
                level -= 1;
                branch.integers[level] += 1;
                continue;
            }
            branch.nodes_left -= 1;
            let cycles_m = self.model.wavelengths_m[level] * branch.integers[level] as f64;
            let u = (branch.rest_m[level] - cycles_m) / self.upper[(level, level)];
            branch.whitened[level] = u;
            branch.misfit[level + 1] = branch.misfit[level] + u * u;
            if level + 1 == n {
                visit(&branch.integers, branch.misfit[n]);
                branch.integers[level] += 1;
            } else {
                level += 1;
                self.enter(level, point, branch);
            }
        }
    }

    /// The integers to try on a level, those above it being chosen.
    fn enter(&self, level: usize, point: &Vector3<f64>, branch: &mut Branch) {
        let n = self.limits.len();
        let row = &self.upper.as_slice()[level * n..level * n + level];
        let before: f64 = row.iter().zip(&branch.whitened).map(|(l, u)| l * u).sum();
        let rest_m = self.model.phases_m[level] - self.design[level].dot(point) - before;
        let left = (self.limits[level] - branch.misfit[level]).max(0.0);
        let within_m = self.upper[(level, level)] * left.sqrt();
        let wavelength_m = self.model.wavelengths_m[level];
        branch.rest_m[level] = rest_m;
        branch.integers[level] = whole((rest_m - within_m) / wavelength_m, f64::ceil);
        branch.last[level] = whole((rest_m + within_m) / wavelength_m, f64::floor);
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
        let stretch = (b.norm() - self.length.length_m) / self.length.sd_m.max(MIN_LENGTH_SD_M);
        cost + from_prior.dot(&(model.prior_information * from_prior)) + stretch * stretch
    }

    /// Newton's method from `start`, damped so that it descends.
    fn minimiser(&self, start: Vector3<f64>) -> Vector3<f64> {
        let model = self.model;
        let information = model.design.transpose() * self.weight * &model.design;
        let information: Matrix3<f64> =
            information.fixed_view::<3, 3>(0, 0) + model.prior_information;
        let length_weight = self.length.sd_m.max(MIN_LENGTH_SD_M).powi(-2);
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

    /// The work that a search reports is what it needs, and one integer less is too few.
    #[test]
    fn the_work_is_counted() {
        let mut random = seeded(64);
        let noise = Noise { code_m: 0.3, phase_m: 0.002 };
        let truth = Vector3::new(0.2, -0.4, 0.1);
        let epoch = Sky::random(&mut random, 8).epoch(&mut random, &[L1_M], noise, &[truth]);
        let (model, length) = (epoch.phase_model(), Length { length_m: truth.norm(), sd_m: 0.001 });
        let search = |mut nodes: usize| {
            let found = all_in_time(&model, length, 30.0, &mut nodes);
            (found, nodes)
        };
        let (found, left) = search(1_000_000);
        let (found, used) = (found.unwrap(), 1_000_000 - left);
        assert!(used > found.len(), "{used}");
        assert_eq!(search(used + 1), (Ok(found), 1));
        let (found, left) = search(used - 1);
        assert_eq!((found, left), (Err(AmbiguityError::BudgetExceeded { nodes: used - 1 }), 0));
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
