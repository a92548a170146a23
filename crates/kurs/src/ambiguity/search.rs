//! Integer least squares: the integer vectors nearest to the float one, exactly.
//!
//! `min |â − z|²_Q = (â − z)ᵀ Q⁻¹ (â − z)` over integer `z`: decorrelation, then a depth-first
//! search from the last ambiguity to the first, nearest integers first, in an ellipsoid that
//! shrinks with every vector found (Schnorr & Euchner 1994). Partial sums of the conditional
//! estimates are kept per level, after Ghasemmehdi & Agrell (2011), *Faster recursions in sphere
//! decoding*.

use nalgebra::DMatrix;

use super::success_rate::bootstrapped_success_rate;
use super::{AmbiguityError, MAX_CYCLES, decorrelate::Decorrelation, dot};

/// Nodes that a search visits by default before it gives up: some tenths of a second.
pub const DEFAULT_NODE_BUDGET: usize = 5_000_000;

/// How much farther than the nearest vector (in squared distance) a rival is looked for by default:
/// beyond, it is less probable than the nearest one by a factor of `exp(30)`.
pub const DEFAULT_HORIZON: f64 = 60.0;

/// Success rate above which a model is strong.
const STRONG: f64 = 0.99;

/// An integer vector and how far it is from the float one.
#[derive(Debug, Clone, PartialEq)]
pub struct Candidate {
    /// `z`, cycles, in the order of the float ambiguities.
    pub integers: Vec<i64>,
    /// `(â − z)ᵀ Q⁻¹ (â − z)`, no unit.
    pub squared_distance: f64,
}

/// The `count` integer vectors nearest to `float` (cycles) in the metric of `covariance`
/// (`n × n`, cycles²), nearest first, however far.
///
/// # Errors
///
/// [`AmbiguityError`]; `BudgetExceeded` after [`DEFAULT_NODE_BUDGET`] nodes.
pub fn integer_least_squares(
    float: &[f64],
    covariance: &DMatrix<f64>,
    count: usize,
) -> Result<Vec<Candidate>, AmbiguityError> {
    let mut search = IntegerLeastSquares { horizon: f64::INFINITY, ..Default::default() };
    search.solve(float, covariance, count)
}

/// The search with its memory: keep one and call it every epoch.
#[derive(Debug, Clone)]
pub struct IntegerLeastSquares {
    /// Nodes visited before [`AmbiguityError::BudgetExceeded`].
    pub node_budget: usize,
    /// The same for each ambiguity of a model whose success rate is above 0.99: its right integers are found at once,
    /// and where the nearest ones are not, they are too far to be right.
    pub node_budget_of_strong_models: usize,
    /// Vectors farther than the nearest one by more than this, in squared distance, are not
    /// looked for.
    pub horizon: f64,
    /// Ambiguities that have one integer within this are not decorrelated further, even if the horizon is farther: in a
    /// strong model that takes longer than the nodes it saves.
    pub reduced_within: f64,
    decorrelation: Decorrelation,
    tree: Tree,
    nodes: usize,
    proven_to: f64,
    success_rate: f64,
}

impl Default for IntegerLeastSquares {
    fn default() -> Self {
        Self {
            node_budget: DEFAULT_NODE_BUDGET,
            node_budget_of_strong_models: DEFAULT_NODE_BUDGET,
            horizon: DEFAULT_HORIZON,
            reduced_within: f64::INFINITY,
            decorrelation: Decorrelation::default(),
            tree: Tree::default(),
            nodes: 0,
            proven_to: f64::NAN,
            success_rate: 0.0,
        }
    }
}

impl IntegerLeastSquares {
    /// The `count` integer vectors nearest to `float` (cycles) in the metric of `covariance`
    /// (`n × n`, cycles²), nearest first; fewer if the others lie beyond the
    /// [`horizon`](Self::horizon).
    ///
    /// # Errors
    ///
    /// [`AmbiguityError`].
    pub fn solve(
        &mut self,
        float: &[f64],
        covariance: &DMatrix<f64>,
        count: usize,
    ) -> Result<Vec<Candidate>, AmbiguityError> {
        (self.nodes, self.proven_to, self.success_rate) = (0, f64::NAN, 0.0);
        check_horizon(self.horizon)?;
        let (whole, fraction) = whole_and_fraction(float, covariance.nrows())?;
        let settled = settled_variance(self.horizon.min(self.reduced_within));
        self.decorrelation.compute_in_blocks(covariance, &[covariance.nrows()], settled)?;
        self.success_rate = bootstrapped_success_rate(self.decorrelation.conditional_variances());
        self.tree.prepare(&self.decorrelation, &fraction);
        let (leaves, radius) = self.nearest(count)?;
        self.proven_to = radius;
        leaves
            .into_iter()
            .map(|leaf| {
                let mut integers = self.decorrelation.original(leaf.integers)?;
                for (integer, offset) in integers.iter_mut().zip(&whole) {
                    *integer += offset;
                }
                Ok(Candidate { integers, squared_distance: leaf.squared_distance })
            })
            .collect()
    }

    /// Every integer vector that the last call of [`solve`](Self::solve) has not returned is at
    /// least this far, in squared distance.
    #[must_use]
    pub fn proven_to(&self) -> f64 {
        self.proven_to
    }

    /// Nodes that the last call of [`solve`](Self::solve) has visited.
    #[must_use]
    pub fn nodes(&self) -> usize {
        self.nodes
    }

    /// How often the model of the last call of [`solve`](Self::solve) gives the right integers: bootstrapped.
    #[must_use]
    pub fn success_rate(&self) -> f64 {
        self.success_rate
    }

    /// The decorrelation of the last call of [`solve`](Self::solve).
    #[must_use]
    pub fn decorrelation(&self) -> &Decorrelation {
        &self.decorrelation
    }

    /// The `count` nearest leaves, nearest first, and the radius in which there are no others.
    fn nearest(&mut self, count: usize) -> Result<(Vec<Leaf>, f64), AmbiguityError> {
        self.nodes = 0;
        let tree = &mut self.tree;
        let n = self.decorrelation.dimension();
        if count == 0 {
            return Ok((Vec::new(), 0.0));
        }
        let node_budget = if self.success_rate > STRONG {
            self.node_budget.min(self.node_budget_of_strong_models.saturating_mul(n))
        } else {
            self.node_budget
        };
        // A node gives one vector at most.
        let mut found: Vec<Leaf> = Vec::with_capacity(count.min(node_budget) + 1);
        let mut radius = f64::INFINITY;
        let mut k = n - 1;
        tree.enter(&self.decorrelation, k, 0.0);
        while self.nodes < node_budget {
            self.nodes += 1;
            let residual = tree.centers[k] - tree.integers[k];
            let norm = tree.norms_above[k] + residual * residual * tree.weights[k];
            // False for a norm that is not a number, too: such a branch is left.
            if norm < radius {
                if k > 0 {
                    tree.residuals[k] = residual;
                    k -= 1;
                    tree.enter(&self.decorrelation, k, norm);
                    continue;
                }
                let place = found.partition_point(|leaf| leaf.squared_distance <= norm);
                found.insert(place, tree.leaf(norm));
                radius = found[0].squared_distance + self.horizon;
                if found.len() >= count {
                    found.truncate(count);
                    radius = radius.min(found[count - 1].squared_distance);
                }
            } else {
                k += 1;
                if k == n {
                    found.retain(|leaf| leaf.squared_distance <= radius);
                    return Ok((found, radius));
                }
            }
            tree.next_integer(k);
        }
        Err(AmbiguityError::BudgetExceeded { nodes: node_budget })
    }
}

/// Refuses a horizon within which nothing is, not even the nearest vector.
pub(super) fn check_horizon(horizon: f64) -> Result<(), AmbiguityError> {
    if horizon >= 0.0 {
        return Ok(());
    }
    Err(AmbiguityError::OutOfRange { what: "the horizon", value: horizon })
}

/// The conditional variance, cycles², from which down an ambiguity has one integer for a search that looks no farther
/// than `horizon` beyond the nearest vector: the next one adds `(1 − 2|r|)/d`, more than the horizon for all residuals
/// `|r| < 3/8`, which are six standard deviations. In a strong model nearly all ambiguities are such, and nine of ten
/// exchanges would be theirs.
pub(super) fn settled_variance(horizon: f64) -> f64 {
    0.25 / horizon.max(DEFAULT_HORIZON)
}

/// Splits float values into the nearest whole cycles and the rest: phase counts near 10⁹ cycles
/// would cost nine digits of every sum.
pub(super) fn whole_and_fraction(
    float: &[f64],
    dimension: usize,
) -> Result<(Vec<i64>, Vec<f64>), AmbiguityError> {
    AmbiguityError::expect_dimension("the float vector", float.len(), dimension)?;
    if let Some(&value) = float.iter().find(|value| value.is_nan() || value.abs() >= MAX_CYCLES) {
        return Err(AmbiguityError::OutOfRange { what: "a float ambiguity", value });
    }
    #[expect(clippy::cast_possible_truncation, reason = "whole numbers below 2⁵²")]
    let whole = float.iter().map(|value| value.round() as i64).collect();
    let fraction = float.iter().map(|value| value - value.round()).collect();
    Ok((whole, fraction))
}

/// The state of the depth-first search; level `k` belongs to the decorrelated ambiguity `k`.
#[derive(Debug, Clone, Default)]
struct Tree {
    /// `ẑ`, the decorrelated float values.
    float: Vec<f64>,
    /// `1 / dₖ`.
    weights: Vec<f64>,
    /// `zₖ`, the integer being tried.
    integers: Vec<f64>,
    /// Difference to the integer to be tried next: +1, −2, +3, … or the mirror image.
    strides: Vec<f64>,
    /// `cₖ`, conditional estimate given the integers of the levels above.
    centers: Vec<f64>,
    /// `wₖ = cₖ − zₖ`.
    residuals: Vec<f64>,
    /// `Σ wᵢ²/dᵢ` over the levels above `k`.
    norms_above: Vec<f64>,
    /// `ẑₖ − Σⱼ lⱼₖ wⱼ` over `j >= i`, at `i + k (n + 1)`; `cₖ` is the one of `i = k + 1`.
    partial_centers: Vec<f64>,
    /// Highest level whose residual has changed since the partial centers of `k` were computed; `n` before its first
    /// visit, which most levels of a strong model have no second one after and which needs no partial centers.
    stale_from: Vec<usize>,
}

impl Tree {
    fn prepare(&mut self, decorrelation: &Decorrelation, fraction: &[f64]) {
        let n = decorrelation.dimension();
        decorrelation.decorrelated(fraction, &mut self.float);
        self.weights.clear();
        self.weights.extend(decorrelation.conditional_variances().iter().map(|d| 1.0 / d));
        for values in [
            &mut self.integers,
            &mut self.strides,
            &mut self.centers,
            &mut self.residuals,
            &mut self.norms_above,
        ] {
            values.clear();
            values.resize(n, 0.0);
        }
        self.stale_from.clear();
        self.stale_from.resize(n, n);
        // All but the outermost are computed before they are read.
        self.partial_centers.resize(n * (n + 1), 0.0);
        for k in 0..n {
            self.partial_centers[n + k * (n + 1)] = self.float[k];
        }
    }

    /// Comes to level `k` from above: conditional estimate, and the integer nearest to it.
    fn enter(&mut self, decorrelation: &Decorrelation, k: usize, norm_above: f64) {
        let n = self.float.len();
        // cₖ = ẑₖ − Σᵢ lᵢₖ wᵢ      for i > k
        let column = &decorrelation.lower().as_slice()[k * n..(k + 1) * n];
        let partial = &mut self.partial_centers[k * (n + 1)..(k + 1) * (n + 1)];
        let stale_from = self.stale_from[k].max(k + 1);
        let center = if stale_from == n {
            self.stale_from[k] = n - 1;
            self.float[k] - dot(&column[k + 1..], &self.residuals[k + 1..])
        } else {
            for i in (k + 1..=stale_from).rev() {
                partial[i] = partial[i + 1] - column[i] * self.residuals[i];
            }
            self.stale_from[k] = k + 1;
            partial[k + 1]
        };
        if k > 0 {
            self.stale_from[k - 1] = self.stale_from[k - 1].max(stale_from);
        }
        self.norms_above[k] = norm_above;
        self.centers[k] = center;
        self.integers[k] = center.round();
        self.strides[k] = if center < self.integers[k] { -1.0 } else { 1.0 };
    }

    /// The next nearest integer of level `k`: to the other side, one farther.
    fn next_integer(&mut self, k: usize) {
        self.integers[k] += self.strides[k];
        self.strides[k] = -self.strides[k] - self.strides[k].signum();
    }

    #[expect(
        clippy::cast_possible_truncation,
        reason = "a cast saturates; the way back is checked"
    )]
    fn leaf(&self, squared_distance: f64) -> Leaf {
        let integers = self.integers.iter().map(|&z| z as i64).collect();
        Leaf { integers, squared_distance }
    }
}

/// A complete vector of decorrelated integers.
#[derive(Debug, Clone)]
struct Leaf {
    integers: Vec<i64>,
    squared_distance: f64,
}

#[cfg(test)]
mod tests {
    use nalgebra::{DVector, Vector3};
    use rand::RngExt;

    use super::super::problems::{
        L1_M, L2_M, Noise, Sky, faq_covariance, float_near_integers, geometry_covariance,
        random_covariance, random_float, seeded,
    };
    use super::*;

    /// `(â − z)ᵀ Q⁻¹ (â − z)` by Cholesky, without our factorization.
    fn squared_distance(float: &[f64], integers: &[i64], q: &DMatrix<f64>) -> f64 {
        let e = DVector::from_iterator(
            float.len(),
            float.iter().zip(integers).map(|(a, z)| a - *z as f64),
        );
        e.dot(&q.clone().cholesky().unwrap().solve(&e))
    }

    #[test]
    fn joosten_and_tiberius_example() {
        // LAMBDA: FAQs, GPS Solutions 6 (2002).
        let found = integer_least_squares(&[5.450, 3.100, 2.970], &faq_covariance(), 2).unwrap();
        assert_eq!(found[0].integers, [5, 3, 4]);
        assert!((found[0].squared_distance - 0.218_331_095_336_938).abs() < 1e-12);
        assert_eq!(found[1].integers, [6, 4, 4]);
        assert!((found[1].squared_distance - 0.307_272_575_790_269).abs() < 1e-12);
    }

    /// `diagonal` on the diagonal, `off_diagonal` elsewhere.
    fn uniform(n: usize, diagonal: f64, off_diagonal: f64) -> DMatrix<f64> {
        DMatrix::from_fn(n, n, |i, j| if i == j { diagonal } else { off_diagonal })
    }

    #[test]
    fn single_frequency_case_of_rtklib() {
        // Numbers of RTKLIB, test/utest/t_lambda.c, case 1.
        let float = [
            1_585_184.171,
            -6_716_599.430,
            3_915_742.905,
            7_627_233.455,
            9_565_990.879,
            989_457_273.200,
        ];
        let mut q = uniform(6, 0.227_134, 0.112_202);
        for i in 0..5 {
            q[(5, i)] = 0.103_473;
            q[(i, 5)] = 0.103_473;
        }
        q[(5, 5)] = 0.434_339;
        let found = integer_least_squares(&float, &q, 2).unwrap();
        let best = [1_585_184, -6_716_599, 3_915_743, 7_627_234, 9_565_991, 989_457_273];
        assert_eq!(found[0].integers, best);
        let mut second = best;
        second[1] -= 1;
        second[3] -= 1;
        assert_eq!(found[1].integers, second);
        assert!((found[0].squared_distance - 3.507_984_5).abs() < 1e-6);
        assert!((found[1].squared_distance - 3.708_456_2).abs() < 1e-6);
    }

    #[test]
    fn dual_frequency_case_of_rtklib() {
        // Numbers of RTKLIB, test/utest/t_lambda.c, case 2: the nearest vector lies up to 20
        // cycles from rounding.
        let float = [
            -13_324_172.755_747,
            -10_668_894.713_608,
            -7_157_225.010_770,
            -6_149_367.974_367,
            -7_454_133.571_066,
            -5_969_200.494_550,
            8_336_734.058_423,
            6_186_974.084_502,
            -17_549_093.883_655,
            -13_970_158.922_370,
        ];
        let mut q = DMatrix::zeros(10, 10);
        q.view_mut((0, 0), (5, 5)).copy_from(&uniform(5, 0.446_320, 0.223_160));
        q.view_mut((0, 5), (5, 5)).copy_from(&uniform(5, 0.572_775, 0.286_388));
        q.view_mut((5, 0), (5, 5)).copy_from(&uniform(5, 0.572_775, 0.286_388));
        q.view_mut((5, 5), (5, 5)).copy_from(&uniform(5, 0.735_063, 0.367_531));
        let found = integer_least_squares(&float, &q, 2).unwrap();
        let best = [
            -13_324_188,
            -10_668_901,
            -7_157_236,
            -6_149_379,
            -7_454_143,
            -5_969_220,
            8_336_726,
            6_186_960,
            -17_549_108,
            -13_970_171,
        ];
        assert_eq!(found[0].integers, best);
        let mut second = best;
        second[1] = -10_668_908;
        second[6] = 8_336_717;
        assert_eq!(found[1].integers, second);
        assert!((found[0].squared_distance - 1_506.435_789).abs() < 1e-4);
        assert!((found[1].squared_distance - 1_612.811_795).abs() < 1e-4);
    }

    /// Orekit's recipe: sorted, distances recomputed by other means, perturbations never better.
    fn check_recipe(
        float: &[f64],
        q: &DMatrix<f64>,
        random: &mut rand_xoshiro::Xoshiro256PlusPlus,
    ) {
        let found = integer_least_squares(float, q, 3).unwrap();
        assert_eq!(found.len(), 3);
        assert!(found.windows(2).all(|pair| pair[0].squared_distance <= pair[1].squared_distance));
        for candidate in &found {
            let expected = squared_distance(float, &candidate.integers, q);
            let error = (candidate.squared_distance - expected).abs();
            assert!(error < 1e-7 * (1.0 + expected), "{error:e} of {expected}");
        }
        for _ in 0..1000 {
            let mut perturbed = found[0].integers.clone();
            for _ in 0..random.random_range(1..=3) {
                let i = random.random_range(0..perturbed.len());
                perturbed[i] += random.random_range(-2..=2);
            }
            let distance = squared_distance(float, &perturbed, q);
            if perturbed != found[0].integers {
                assert!(distance >= found[1].squared_distance * (1.0 - 1e-7), "{perturbed:?}");
            }
        }
    }

    #[test]
    fn a_thousand_random_problems() {
        let mut random = seeded(3);
        for case in 0..1000 {
            let n = 2 + case % 12;
            let q = random_covariance(&mut random, n);
            let float = random_float(&mut random, n);
            check_recipe(&float, &q, &mut random);
        }
    }

    #[test]
    fn strongly_correlated_problems_of_up_to_sixty() {
        let mut random = seeded(4);
        for satellites in [5, 8, 11, 16, 21, 31] {
            for _ in 0..3 {
                let n = 2 * (satellites - 1);
                let q = geometry_covariance(&mut random, n);
                let float = float_near_integers(&mut random, &q);
                check_recipe(&float, &q, &mut random);
            }
        }
    }

    #[test]
    fn twelve_satellites_on_two_bands_give_the_true_integers() {
        let mut random = seeded(9);
        for _ in 0..50 {
            let noise = Noise { code_m: 0.3, phase_m: 0.003 };
            let baseline_m = Vector3::new(0.7, -0.6, 0.1);
            let epoch = Sky::random(&mut random, 12).epoch(
                &mut random,
                &[L1_M, L2_M],
                noise,
                &[baseline_m],
            );
            let float = &epoch.float;
            let found =
                integer_least_squares(float.ambiguities.as_slice(), &float.ambiguity_covariance, 2);
            assert_eq!(found.unwrap()[0].integers, epoch.integers);
        }
    }

    #[test]
    fn brute_force_agrees_up_to_four() {
        let mut random = seeded(5);
        for case in 0..400 {
            let n = 1 + case % 4;
            let q = random_covariance(&mut random, n);
            let float = random_float(&mut random, n);
            let found = integer_least_squares(&float, &q, 2).unwrap();
            // Every z with |â − z|²_Q <= R lies in the box |âᵢ − zᵢ|² <= R qᵢᵢ.
            let radius = found[1].squared_distance * (1.0 + 1e-9);
            let reach: Vec<f64> = (0..n).map(|i| (radius * q[(i, i)]).sqrt()).collect();
            let mut all: Vec<(f64, Vec<i64>)> = Vec::new();
            #[expect(clippy::cast_possible_truncation, reason = "whole and small")]
            let first: Vec<i64> = (0..n).map(|i| (float[i] - reach[i]).ceil() as i64).collect();
            let mut z = first.clone();
            'box_: loop {
                all.push((squared_distance(&float, &z, &q), z.clone()));
                for i in 0..n {
                    z[i] += 1;
                    if z[i] as f64 <= float[i] + reach[i] {
                        continue 'box_;
                    }
                    z[i] = first[i];
                }
                break;
            }
            all.sort_by(|a, b| a.0.total_cmp(&b.0));
            for (candidate, (distance, z)) in found.iter().zip(&all) {
                assert_eq!(&candidate.integers, z, "case {case}");
                assert!((candidate.squared_distance - distance).abs() < 1e-8 * (1.0 + distance));
            }
        }
    }

    #[test]
    fn many_candidates_are_the_same_as_few() {
        let mut random = seeded(6);
        let q = random_covariance(&mut random, 8);
        let float = random_float(&mut random, 8);
        let many = integer_least_squares(&float, &q, 50).unwrap();
        let few = integer_least_squares(&float, &q, 7).unwrap();
        assert_eq!(many[..7], few[..]);
        assert_eq!(many.len(), 50);
        assert!(integer_least_squares(&float, &q, 0).unwrap().is_empty());
        let mut search = IntegerLeastSquares { horizon: 1.0, ..Default::default() };
        let all = search.solve(&float, &q, usize::MAX).unwrap();
        assert_eq!(all[..50], many[..]);
    }

    #[test]
    fn rivals_beyond_the_horizon_are_proven_to_be_far() {
        let mut random = seeded(10);
        let mut search = IntegerLeastSquares::default();
        let mut alone = 0;
        for case in 0..200 {
            let q = random_covariance(&mut random, 2 + case % 8) * 0.005;
            let float = float_near_integers(&mut random, &q);
            let all = integer_least_squares(&float, &q, 4).unwrap();
            let near = search.solve(&float, &q, 4).unwrap();
            assert_eq!(near[..], all[..near.len()]);
            match all.get(near.len()) {
                Some(next) => {
                    assert!(search.proven_to() <= next.squared_distance);
                    assert!(search.proven_to() == near[0].squared_distance + DEFAULT_HORIZON);
                    alone += 1;
                }
                None => assert!(search.proven_to() == near[3].squared_distance),
            }
        }
        assert!(alone > 20 && alone < 180, "{alone}");
    }

    #[test]
    fn an_exhausted_budget_is_no_answer() {
        let mut random = seeded(7);
        let q = random_covariance(&mut random, 10) * 1e4;
        let float = random_float(&mut random, 10);
        let mut search = IntegerLeastSquares { node_budget: 15, ..Default::default() };
        let found = search.solve(&float, &q, 2);
        assert_eq!(found, Err(AmbiguityError::BudgetExceeded { nodes: 15 }));
    }

    #[test]
    fn bad_input_is_refused() {
        let q = faq_covariance();
        let short = integer_least_squares(&[0.0; 2], &q, 2);
        assert!(matches!(short, Err(AmbiguityError::Dimension { found: 2, expected: 3, .. })));
        for value in [f64::NAN, f64::INFINITY, 1e17] {
            let found = integer_least_squares(&[0.0, value, 0.0], &q, 2);
            assert!(matches!(found, Err(AmbiguityError::OutOfRange { .. })), "{found:?}");
        }
        for horizon in [f64::NAN, -1.0] {
            let mut search = IntegerLeastSquares { horizon, ..Default::default() };
            let found = search.solve(&[0.0; 3], &q, 2);
            let is_named =
                matches!(found, Err(AmbiguityError::OutOfRange { what: "the horizon", .. }));
            assert!(is_named, "{found:?}");
        }
        let empty = integer_least_squares(&[], &DMatrix::zeros(0, 0), 2);
        assert_eq!(empty, Err(AmbiguityError::Empty));
    }
}
