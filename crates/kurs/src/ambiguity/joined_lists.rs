//! All integer vectors of an array up to a cost, joined from exhaustive lists of its baselines: the
//! judge of [`array_constrained`](super::array_constrained), with which it shares no code.
//!
//! ```text
//! J(z) = min over R and b of |φ − Λ z − G b|²_Qφ + |b − b_P|²_QP + |b − vec(R B)|²_S
//! S = s² (I + 11ᵀ) ⊗ I
//! ```
//!
//! A part of the observations with its own covariance costs no more than all of them
//! (`xᵀ Q⁻¹ x >= x₁ᵀ Q₁₁⁻¹ x₁`). So a vector with `J(z) <= c` has its integers of every baseline in
//! the list up to `c` that the search over the sphere gives for that baseline alone, and those of
//! the first baselines cost no more than `c` in the array of these alone. The lists are joined
//! baseline after baseline; the minimum over `R` comes from descents that start all around.

use nalgebra::{DMatrix, DVector, Matrix3, Rotation3, Vector3};
use rand::RngExt;
use rand::seq::SliceRandom;
use rand_xoshiro::Xoshiro256PlusPlus;

use super::array_constrained::ArrayConstrained;
use super::problems::{Epoch, L1_M, L2_M, Noise, Sky, normal};
use super::sphere::Length;
use super::{AmbiguityError, sphere_search};

/// Candidates that cost so much more than the true integers are still compared.
const BEYOND_TRUTH: f64 = 8.0;
/// Costs computed in two ways agree to this, relative to `1 + cost`.
const AGREEMENT: f64 = 1e-5;
/// Steps of one descent.
const MAX_STEPS: usize = 1000;

/// How one epoch came out.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Comparison {
    /// Candidates compared.
    pub candidates: usize,
    /// Whether search and lists have the same vectors at the same costs.
    pub same: bool,
    /// Whether the search gave up before its end.
    pub gave_up: bool,
}

/// A random epoch of three or four antennas, by the search and by lists: 4 to 20 satellites, one or
/// two bands, baselines of 0.2 to 2 m on a line, in a plane or in space, known exactly, to 2 or to
/// 5 mm; in one of three epochs every antenna has satellites of its own.
pub(crate) fn compare(
    random: &mut Xoshiro256PlusPlus,
    search: &mut ArrayConstrained,
    antennas: usize,
) -> Comparison {
    let satellites = random.random_range(4..=20);
    let bands: &[f64] = if random.random_bool(0.5) { &[L1_M] } else { &[L1_M, L2_M] };
    let noise = Noise { code_m: random.random_range(0.15..0.6), phase_m: 0.003 };
    let array_sd_m = [0.0, 0.002, 0.005][random.random_range(0..3)];
    let body_m = random_array(random, antennas - 1);
    let rotation = random_rotation(random);
    let baselines_m: Vec<_> = body_m.iter().map(|b| rotation * b).collect();
    let sky = Sky::random(random, satellites);
    let seen = random_view(random, satellites, body_m.len());
    let epoch = sky.epoch_seen(random, bands, noise, &baselines_m, &seen);

    let all = Part::first(&epoch, &body_m, body_m.len(), array_sd_m);
    let max_cost = all.cost(&all.residual(&epoch.integers)) + BEYOND_TRUTH;
    let expected = all_within(&epoch, &body_m, array_sd_m, max_cost);

    let ambiguities_of: Vec<usize> = (0..body_m.len())
        .map(|block| epoch.baseline_of.iter().filter(|b| **b == block).count())
        .collect();
    let count = expected.len() + 1;
    // Beyond the cost that the lists go to, rivals need no proof.
    search.horizon = max_cost - expected[0].0;
    let found = search.solve(epoch.float.clone(), &ambiguities_of, &body_m, array_sd_m, count);
    let found = match found {
        Err(AmbiguityError::BudgetExceeded { .. }) => {
            return Comparison { gave_up: true, ..Comparison::default() };
        }
        found => found.expect("a model that determines the baselines"),
    };
    let next = found.get(expected.len()).map_or(search.proven_to(), |candidate| candidate.cost);
    let agree = |(ours, theirs): (&super::array_constrained::ArrayCandidate, &(f64, Vec<i64>))| {
        ours.integers == theirs.1 && (ours.cost - theirs.0).abs() < AGREEMENT * (1.0 + theirs.0)
    };
    let same = found.len() >= expected.len()
        && found.iter().zip(&expected).all(agree)
        && next > max_cost - AGREEMENT * (1.0 + max_cost);
    Comparison { candidates: expected.len(), same, gave_up: false }
}

/// Baselines of an array on a line, in a plane or in space.
fn random_array(random: &mut Xoshiro256PlusPlus, baselines: usize) -> Vec<Vector3<f64>> {
    let dimension = random.random_range(1..=baselines.min(3));
    let mut array = Vec::with_capacity(baselines);
    while array.len() < baselines {
        let direction =
            Vector3::from_fn(|axis, _| if axis < dimension { normal(random) } else { 0.0 });
        array.push(direction.normalize() * random.random_range(0.2..2.0));
    }
    array
}

fn random_rotation(random: &mut Xoshiro256PlusPlus) -> Matrix3<f64> {
    let angles = [0, 1, 2].map(|_| random.random_range(-3.2..3.2));
    Rotation3::from_euler_angles(angles[0], angles[1], angles[2]).into_inner()
}

/// Satellites of each baseline in any order: all, or, in one epoch of three, at least four of them.
fn random_view(
    random: &mut Xoshiro256PlusPlus,
    satellites: usize,
    baselines: usize,
) -> Vec<Vec<usize>> {
    let own = random.random_bool(1.0 / 3.0);
    (0..baselines)
        .map(|_| {
            let mut all: Vec<usize> = (0..satellites).collect();
            if own {
                all.shuffle(random);
                all.truncate(random.random_range((2 * satellites / 3).max(4)..=satellites));
            }
            all
        })
        .collect()
}

/// Every integer vector with `J(z) <= max_cost` and its cost, cheapest first.
fn all_within(
    epoch: &Epoch,
    body_m: &[Vector3<f64>],
    array_sd_m: f64,
    max_cost: f64,
) -> Vec<(f64, Vec<i64>)> {
    let mut joined: Vec<(f64, Vec<i64>)> = vec![(0.0, Vec::new())];
    for (baseline, body) in body_m.iter().enumerate() {
        let length = Length {
            length_m: body.norm(),
            // |b − R b_j|² / 2s² is least at (|b| − l)² / 2s².
            sd_m: array_sd_m * core::f64::consts::SQRT_2,
        };
        let model = epoch.phase_model_of(baseline);
        let list = sphere_search::all_within(&model, length, max_cost).expect("a small sphere");
        let part = Part::first(epoch, body_m, baseline + 1, array_sd_m);
        let mut next = Vec::new();
        for (_, so_far) in &joined {
            for candidate in &list {
                let integers = [so_far.as_slice(), candidate.integers.as_slice()].concat();
                let residual = part.residual(&integers);
                if part.least_cost(&residual) <= max_cost {
                    let cost = part.cost(&residual);
                    if cost <= max_cost {
                        next.push((cost, integers));
                    }
                }
            }
        }
        joined = next;
    }
    joined.sort_by(|a, b| a.0.total_cmp(&b.0));
    joined
}

/// The first baselines of an epoch by themselves.
struct Part<'a> {
    body_m: &'a [Vector3<f64>],
    phases_m: DVector<f64>,
    wavelengths_m: DVector<f64>,
    /// `x̌ = K (φ − Λ z) + x_P`
    gain: DMatrix<f64>,
    from_prior_m: DVector<f64>,
    /// What `b` costs before the array: weights of phases and prior.
    design: DMatrix<f64>,
    phase_weight: DMatrix<f64>,
    prior_m: DVector<f64>,
    prior_weight: DMatrix<f64>,
    /// `Q⁻¹`,   `Q = (Gᵀ W G + N_P)⁻¹ + S`
    array_weight: DMatrix<f64>,
    /// Largest eigenvalue of `Q`.
    widest_m2: f64,
}

impl<'a> Part<'a> {
    fn first(epoch: &Epoch, body_m: &'a [Vector3<f64>], baselines: usize, sd_m: f64) -> Self {
        let n = epoch.baseline_of.iter().filter(|b| **b < baselines).count();
        let p = 3 * baselines;
        let inverse = |m: DMatrix<f64>| m.cholesky().expect("positive definite").inverse();
        let design: DMatrix<f64> = epoch.design.view((0, 0), (n, p)).into();
        let phase_weight = inverse(epoch.phase_covariance_m2.view((0, 0), (n, n)).into());
        let prior_weight = inverse(epoch.code_covariance_m2.view((0, 0), (p, p)).into());
        let prior_m: DVector<f64> = epoch.float.reals_m.rows(0, p).into();
        let covariance_m2 = inverse(design.transpose() * &phase_weight * &design + &prior_weight);
        let gain = &covariance_m2 * design.transpose() * &phase_weight;
        let from_prior_m = &covariance_m2 * &prior_weight * &prior_m;
        let shared = DMatrix::from_fn(baselines, baselines, |i, j| if i == j { 2.0 } else { 1.0 });
        let survey_m2 = shared.kronecker(&Matrix3::<f64>::identity()) * sd_m.powi(2);
        let array_covariance_m2 = covariance_m2 + survey_m2;
        Self {
            body_m: &body_m[..baselines],
            phases_m: epoch.phases_m.rows(0, n).into(),
            wavelengths_m: epoch.wavelengths_m.rows(0, n).into(),
            gain,
            from_prior_m,
            design,
            phase_weight,
            prior_m,
            prior_weight,
            widest_m2: array_covariance_m2.clone().symmetric_eigenvalues().max(),
            array_weight: inverse(array_covariance_m2),
        }
    }

    /// `φ − Λ z`
    fn residual(&self, integers: &[i64]) -> DVector<f64> {
        DVector::from_fn(integers.len(), |i, _| {
            self.phases_m[i] - self.wavelengths_m[i] * integers[i] as f64
        })
    }

    /// A bound of the cost that needs no rotation: a length, or a distance of two ends, that does
    /// not fit.
    fn least_cost(&self, residual: &DVector<f64>) -> f64 {
        let x = &self.gain * residual + &self.from_prior_m;
        let end = |i: usize| Vector3::new(x[3 * i], x[3 * i + 1], x[3 * i + 2]);
        let last = self.body_m.len() - 1;
        let mut misfit_m2 = (end(last).norm() - self.body_m[last].norm()).powi(2);
        for i in 0..last {
            let known_m = (self.body_m[last] - self.body_m[i]).norm();
            let off_m = (end(last) - end(i)).norm() - known_m;
            misfit_m2 = misfit_m2.max(off_m * off_m / 2.0);
        }
        misfit_m2 / self.widest_m2
    }

    /// `J(z)` of these baselines.
    fn cost(&self, residual: &DVector<f64>) -> f64 {
        let x = &self.gain * residual + &self.from_prior_m;
        let misfit_m = residual - &self.design * &x;
        let from_prior_m = &x - &self.prior_m;
        let before = misfit_m.dot(&(&self.phase_weight * &misfit_m))
            + from_prior_m.dot(&(&self.prior_weight * &from_prior_m));
        let near = self.nearest_rotation(&x);
        let starts = (0..24).map(|number| turned(number) * near);
        before + starts.map(|start| self.descend(&x, start)).fold(f64::INFINITY, f64::min)
    }

    /// The rotation of `B` nearest to `x`, all components alike.
    fn nearest_rotation(&self, x: &DVector<f64>) -> Matrix3<f64> {
        let mut sum = Matrix3::zeros();
        for (i, body) in self.body_m.iter().enumerate() {
            sum += Vector3::new(x[3 * i], x[3 * i + 1], x[3 * i + 2]) * body.transpose();
        }
        let svd = sum.svd(true, true);
        let (u, v_t) = (svd.u.expect("asked for"), svd.v_t.expect("asked for"));
        let handed = Vector3::new(1.0, 1.0, (u * v_t).determinant().signum());
        u * Matrix3::from_diagonal(&handed) * v_t
    }

    /// `|x̌ − vec(R B)|²_Q` at the end of a descent from `start` (Levenberg-Marquardt on rotation
    /// vectors, `d(R b) = −[R b]× dθ`).
    fn descend(&self, x: &DVector<f64>, start: Matrix3<f64>) -> f64 {
        let p = x.len();
        let misfit = |rotation: &Matrix3<f64>| {
            let ends = self.body_m.iter().map(|b| rotation * b);
            DVector::from_iterator(p, ends.flat_map(|end| [end.x, end.y, end.z])) - x
        };
        let cost = |v: &DVector<f64>| v.dot(&(&self.array_weight * v));
        let mut rotation = start;
        let mut here = misfit(&rotation);
        let mut value = cost(&here);
        let mut damping = 1e-6;
        for _ in 0..MAX_STEPS {
            let mut slope = DMatrix::zeros(p, 3);
            for (i, body) in self.body_m.iter().enumerate() {
                let turned = -(rotation * body).cross_matrix();
                slope.view_mut((3 * i, 0), (3, 3)).copy_from(&turned);
            }
            let weighted = slope.transpose() * &self.array_weight;
            let normal: Matrix3<f64> = (&weighted * &slope).fixed_view::<3, 3>(0, 0).into();
            let right = &weighted * &here;
            let right = Vector3::new(right[0], right[1], right[2]);
            let scale = normal.trace();
            let damped = normal + Matrix3::identity() * (damping * scale);
            let Some(factor) = damped.cholesky() else { return value };
            let step = -factor.solve(&right);
            let there = Rotation3::new(step).into_inner() * rotation;
            let next = misfit(&there);
            let next_value = cost(&next);
            if next_value > value {
                damping = (damping * 10.0).max(1e-6);
                if damping > 1e6 {
                    return value;
                }
                continue;
            }
            let gain = value - next_value;
            (rotation, here, value) = (there, next, next_value);
            damping *= 0.2;
            if gain < 1e-12 * (1.0 + value) && step.norm() < 1e-8 {
                return value;
            }
        }
        value
    }
}

/// The turns that bring a cube onto itself.
fn turned(number: usize) -> Matrix3<f64> {
    let axes =
        [Vector3::x(), -Vector3::x(), Vector3::y(), -Vector3::y(), Vector3::z(), -Vector3::z()];
    let first = axes[number / 4];
    let across = axes[(number / 8 * 2 + 2) % 6];
    let quarter = Rotation3::new(first * core::f64::consts::FRAC_PI_2 * (number % 4) as f64);
    let second = quarter * across;
    Matrix3::from_columns(&[first, second, first.cross(&second)])
}

#[cfg(test)]
mod tests {
    use super::super::problems::seeded;
    use super::*;

    /// `cargo run --release -p kurs --example search_oracle 100000` is the long run.
    #[test]
    fn the_search_of_an_array_finds_the_same() {
        let mut random = seeded(70);
        let mut search = ArrayConstrained::default();
        search.work_budget = 20_000;
        let (mut candidates, mut ended) = (0, 0);
        for case in 0..60 {
            let comparison = compare(&mut random, &mut search, 3 + case % 2);
            assert!(comparison.same || comparison.gave_up, "case {case}: {comparison:?}");
            candidates += comparison.candidates;
            ended += usize::from(!comparison.gave_up);
        }
        assert!(ended >= 55 && candidates >= ended, "{ended} {candidates}");
    }
}
