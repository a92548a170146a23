//! Integer least squares for a baseline of known length (C-LAMBDA), exactly.
//!
//! ```text
//! min over integer z and real b of
//!     |â − z|²_Qa  +  |b̌(z) − b|²_Qb|a  +  (|b| − l)² / σ²
//! ```
//!
//! The integers are fixed one after the other, in the decorrelated order. When those from level
//! `k` on are fixed, let the others and the baseline be real: then the baseline has a conditional
//! estimate `b̌ₖ` and covariance `Qₖ`, and
//!
//! ```text
//! Σᵢ wᵢ²/dᵢ (i >= k)  +  min over b of |b̌ₖ − b|²_Qₖ + (|b| − l)²/σ²
//! b̌ₖ = b̂ − Σᵢ γᵢ wᵢ (i >= k),     Qₖ = Q_b|a + Σᵢ γᵢ γᵢᵀ dᵢ (i < k)
//! ```
//!
//! is the exact minimum of this relaxation: a lower bound for all integers below, and the cost
//! itself once every integer is fixed. It grows from level to level. Branches are opened in the
//! order of their bounds, so that candidates come out in the order of their costs, and the first
//! is proven to be the best. The length prunes as soon as the integers determine the baseline.
//!
//! Problem: Teunissen (2010), *Integer least-squares theory for the GNSS compass*, J. Geodesy 84.

use std::{cmp::Ordering, collections::BinaryHeap};

use nalgebra::{Matrix3, Vector3};

use super::{
    AmbiguityError, MixedFloat,
    decorrelate::Decorrelation,
    search::{DEFAULT_HORIZON, whole_and_fraction},
    sphere::{Length, SphereMetric},
};

/// Branches that a search opens by default before it gives up: some tens of milliseconds.
pub const DEFAULT_NODE_BUDGET: usize = 100_000;

/// An integer vector, the baseline that goes with it, and what both cost together.
#[derive(Debug, Clone, PartialEq)]
pub struct LengthCandidate {
    /// `z`, cycles, in the order of the float ambiguities.
    pub integers: Vec<i64>,
    /// The minimum over the baseline of the constrained cost, no unit.
    pub cost: f64,
    /// The baseline with this minimum, m.
    pub baseline_m: Vector3<f64>,
}

/// The search with its memory: keep one and call it every epoch.
#[derive(Debug, Clone)]
pub struct LengthConstrained {
    /// Branches opened before [`AmbiguityError::BudgetExceeded`].
    pub node_budget: usize,
    /// Vectors that cost more than the best by more than this are not looked for. With strong
    /// models most of the time would go into the proof of a rival that cannot matter.
    pub horizon: f64,
    proven_to: f64,
    decorrelation: Decorrelation,
    nodes: Vec<Node>,
    queue: BinaryHeap<Queued>,
}

impl Default for LengthConstrained {
    fn default() -> Self {
        Self {
            node_budget: DEFAULT_NODE_BUDGET,
            horizon: DEFAULT_HORIZON,
            proven_to: f64::NAN,
            decorrelation: Decorrelation::default(),
            nodes: Vec::new(),
            queue: BinaryHeap::new(),
        }
    }
}

impl LengthConstrained {
    /// The `count` integer vectors of least cost for the one baseline in `float` (three reals),
    /// cheapest first; fewer if the others lie beyond the [`horizon`](Self::horizon).
    ///
    /// # Errors
    ///
    /// [`AmbiguityError`].
    pub fn solve(
        &mut self,
        float: &MixedFloat,
        length: Length,
        count: usize,
    ) -> Result<Vec<LengthCandidate>, AmbiguityError> {
        let n = float.checked_dimension(3)?;
        let (whole, fraction) = whole_and_fraction(float.ambiguities.as_slice(), n)?;
        self.decorrelation.compute(&float.ambiguity_covariance)?;
        let levels = Levels::new(&self.decorrelation, float, &fraction, length)?;
        let leaves = self.cheapest(&levels, count)?;
        leaves.into_iter().map(|leaf| self.candidate(leaf, &levels, &whole)).collect()
    }

    /// The decorrelation of the last call of [`solve`](Self::solve), for its success rate.
    #[must_use]
    pub fn decorrelation(&self) -> &Decorrelation {
        &self.decorrelation
    }

    /// Every integer vector that the last call of [`solve`](Self::solve) has not returned costs at
    /// least this.
    #[must_use]
    pub fn proven_to(&self) -> f64 {
        self.proven_to
    }

    /// Indices of the `count` cheapest leaves, cheapest first.
    fn cheapest(&mut self, levels: &Levels, count: usize) -> Result<Vec<usize>, AmbiguityError> {
        self.nodes.clear();
        self.queue.clear();
        let mut leaves: Vec<usize> = Vec::with_capacity(count);
        self.push(levels.root());
        while let Some(Queued { bound, node }) = self.queue.pop() {
            self.proven_to = bound;
            let end =
                leaves.first().map_or(f64::INFINITY, |&best| self.nodes[best].bound + self.horizon);
            if leaves.len() == count || bound > end {
                break;
            }
            if self.nodes[node].free == 0 {
                leaves.push(node);
            } else {
                self.open(levels, node, bound);
            }
            if self.nodes.len() > self.node_budget {
                return Err(AmbiguityError::BudgetExceeded { nodes: self.nodes.len() });
            }
        }
        Ok(leaves)
    }

    /// Queues the children of a node that may be as cheap as `bound`, and the rest as a whole.
    fn open(&mut self, levels: &Levels, parent: usize, bound: f64) {
        let k = self.nodes[parent].free - 1;
        if self.nodes[parent].stride == 0.0 {
            let center = self.center(levels, parent, k);
            self.nodes[parent].start(center);
        }
        loop {
            let node = &self.nodes[parent];
            let residual = node.center - node.next_integer;
            let norm = node.norm + residual * residual / levels.variances[k];
            if norm.is_nan() {
                return;
            }
            if norm > bound {
                // Farther integers of this level have larger norms still.
                self.queue.push(Queued { bound: norm, node: parent });
                return;
            }
            let baseline_m = node.baseline_m - levels.gains_m[k] * residual;
            let (inner, multiplier) = if k == 0 {
                (levels.spheres[0].cost(&baseline_m), 0.0)
            } else {
                levels.spheres[k].lower_bound(&baseline_m, node.multiplier)
            };
            let child = Node {
                free: k,
                parent,
                integer: node.next_integer,
                residual,
                norm,
                bound: (norm + inner).max(node.bound),
                baseline_m,
                multiplier,
                ..Node::default()
            };
            self.push(child);
            self.nodes[parent].advance();
        }
    }

    fn push(&mut self, node: Node) {
        self.queue.push(Queued { bound: node.bound, node: self.nodes.len() });
        self.nodes.push(node);
    }

    /// Conditional estimate of level `k`: `cₖ = ẑₖ − Σᵢ lᵢₖ wᵢ` for `i > k`.
    fn center(&self, levels: &Levels, parent: usize, k: usize) -> f64 {
        let n = levels.float.len();
        let column = &self.decorrelation.lower().as_slice()[k * n..(k + 1) * n];
        let mut center = levels.float[k];
        let mut node = &self.nodes[parent];
        while node.free < n {
            center -= column[node.free] * node.residual;
            node = &self.nodes[node.parent];
        }
        center
    }

    fn candidate(
        &self,
        leaf: usize,
        levels: &Levels,
        whole: &[i64],
    ) -> Result<LengthCandidate, AmbiguityError> {
        let n = whole.len();
        let mut decorrelated = vec![0; n];
        let mut node = &self.nodes[leaf];
        while node.free < n {
            #[expect(
                clippy::cast_possible_truncation,
                reason = "saturates; the way back is checked"
            )]
            {
                decorrelated[node.free] = node.integer as i64;
            }
            node = &self.nodes[node.parent];
        }
        let mut integers = self.decorrelation.original(&decorrelated)?;
        for (integer, offset) in integers.iter_mut().zip(whole) {
            *integer += offset;
        }
        let leaf = &self.nodes[leaf];
        let baseline_m = levels.spheres[0].nearest(&leaf.baseline_m);
        Ok(LengthCandidate { integers, cost: leaf.bound, baseline_m })
    }
}

/// What the search needs per level; level `k` belongs to the decorrelated ambiguity `k`.
struct Levels {
    /// `ẑ`.
    float: Vec<f64>,
    /// `dₖ`, cycles².
    variances: Vec<f64>,
    /// `γₖ`, metres per cycle.
    gains_m: Vec<Vector3<f64>>,
    /// The sphere in the metric of `Qₖ`, when the ambiguities below `k` are real; `n + 1` of them.
    spheres: Vec<SphereMetric>,
    baseline_m: Vector3<f64>,
}

impl Levels {
    fn new(
        decorrelation: &Decorrelation,
        float: &MixedFloat,
        fraction: &[f64],
        length: Length,
    ) -> Result<Self, AmbiguityError> {
        let variances = decorrelation.conditional_variances().to_vec();
        let gains = decorrelation.gains(&float.cross_covariance);
        let gains_m: Vec<Vector3<f64>> =
            gains.column_iter().map(|gain| gain.fixed_rows::<3>(0).into_owned()).collect();
        // Qₖ₊₁ = Qₖ + γₖ γₖᵀ dₖ
        let mut q: Matrix3<f64> = float.conditional_covariance_m2.fixed_view::<3, 3>(0, 0).into();
        let mut spheres = vec![SphereMetric::new(&q, length)?];
        for (gain, variance) in gains_m.iter().zip(&variances) {
            q += gain * gain.transpose() * *variance;
            spheres.push(SphereMetric::new(&q, length)?);
        }
        let mut decorrelated = Vec::new();
        decorrelation.decorrelated(fraction, &mut decorrelated);
        let baseline_m = float.reals_m.fixed_rows::<3>(0).into();
        Ok(Self { float: decorrelated, variances, gains_m, spheres, baseline_m })
    }

    /// Nothing fixed yet.
    fn root(&self) -> Node {
        let n = self.float.len();
        let (bound, multiplier) = self.spheres[n].cost_and_multiplier(&self.baseline_m);
        Node { free: n, bound, baseline_m: self.baseline_m, multiplier, ..Node::default() }
    }
}

/// A branch of the search: the integers from level `free` on are fixed.
#[derive(Debug, Clone, Default)]
struct Node {
    /// Number of ambiguities that are not fixed yet, and the level that was fixed last.
    free: usize,
    /// Index of the node with one integer fewer.
    parent: usize,
    /// The integer of level `free`, and `w` there.
    integer: f64,
    residual: f64,
    /// `Σ wᵢ²/dᵢ`.
    norm: f64,
    /// Lower bound of the cost; the cost itself if nothing is free.
    bound: f64,
    /// `b̌ₖ`.
    baseline_m: Vector3<f64>,
    /// `μ` of the bound: a good start for the children, whose metrics are narrower.
    multiplier: f64,
    /// Conditional estimate of the next level, the integer to try there, and the way to the one
    /// after it: +1, −2, +3, … or the mirror image; zero before the node is opened.
    center: f64,
    next_integer: f64,
    stride: f64,
}

impl Node {
    fn start(&mut self, center: f64) {
        self.center = center;
        self.next_integer = center.round();
        self.stride = if center < self.next_integer { -1.0 } else { 1.0 };
    }

    fn advance(&mut self) {
        self.next_integer += self.stride;
        self.stride = -self.stride - self.stride.signum();
    }
}

/// A node in the queue: the least bound first, the older one if equal.
#[derive(Debug, Clone)]
struct Queued {
    bound: f64,
    node: usize,
}

impl Ord for Queued {
    fn cmp(&self, other: &Self) -> Ordering {
        other.bound.total_cmp(&self.bound).then(other.node.cmp(&self.node))
    }
}

impl PartialOrd for Queued {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Queued {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Queued {}

#[cfg(test)]
mod tests {
    use nalgebra::DVector;
    use rand::RngExt;

    use super::super::problems::{L1_M, L2_M, Noise, Sky, normal, seeded};
    use super::super::search::integer_least_squares;
    use super::*;

    fn random_baseline(
        random: &mut rand_xoshiro::Xoshiro256PlusPlus,
        length_m: f64,
    ) -> Vector3<f64> {
        Vector3::from_fn(|_, _| normal(random)).normalize() * length_m
    }

    /// The cost of `integers` by its definition, with the Cholesky factor of `Q_a`.
    fn cost(float: &MixedFloat, length: Length, integers: &[i64]) -> f64 {
        let e = DVector::from_fn(integers.len(), |i, _| float.ambiguities[i] - integers[i] as f64);
        let solved = float.ambiguity_covariance.clone().cholesky().unwrap().solve(&e);
        let conditional = &float.reals_m - &float.cross_covariance * &solved;
        let q: Matrix3<f64> = float.conditional_covariance_m2.fixed_view::<3, 3>(0, 0).into();
        let point = conditional.fixed_rows::<3>(0).into_owned();
        e.dot(&solved) + SphereMetric::new(&q, length).unwrap().cost(&point)
    }

    #[test]
    fn every_vector_of_the_ellipsoid_was_considered() {
        let mut random = seeded(30);
        let mut search = LengthConstrained { horizon: f64::INFINITY, ..Default::default() };
        let mut compared = 0;
        for case in 0..150 {
            let satellites = 5 + case % 3;
            let noise = Noise { code_m: 0.15, phase_m: 0.003 };
            let length = Length { length_m: 1.0, sd_m: 0.002 };
            let sky = Sky::random(&mut random, satellites);
            let baseline_m = random_baseline(&mut random, 1.0);
            let epoch = sky.epoch(&mut random, &[L1_M], noise, &[baseline_m]);
            let float = &epoch.float;
            let found = search.solve(float, length, 2).unwrap();
            for candidate in &found {
                let expected = cost(float, length, &candidate.integers);
                assert!((candidate.cost - expected).abs() < 1e-6 * (1.0 + expected));
            }
            // |â − z|² <= cost(z): whoever beats the second best is among these.
            let mut nearest = Vec::new();
            for count in [100, 1000, 10_000] {
                nearest = integer_least_squares(
                    float.ambiguities.as_slice(),
                    &float.ambiguity_covariance,
                    count,
                )
                .unwrap();
                if nearest[count - 1].squared_distance > found[1].cost {
                    break;
                }
            }
            if nearest.last().unwrap().squared_distance <= found[1].cost {
                continue; // too many to list
            }
            compared += 1;
            let mut all: Vec<(f64, Vec<i64>)> = nearest
                .into_iter()
                .map(|c| (cost(float, length, &c.integers), c.integers))
                .collect();
            all.sort_by(|a, b| a.0.total_cmp(&b.0));
            assert_eq!(found[0].integers, all[0].1, "case {case}");
            assert_eq!(found[1].integers, all[1].1, "case {case}");
            let near = LengthConstrained::default().solve(float, length, 2).unwrap();
            assert_eq!(near[..], found[..near.len()]);
            assert!(near.len() == 2 || found[1].cost > found[0].cost + DEFAULT_HORIZON);
        }
        assert!(compared > 100, "{compared}");
    }

    #[test]
    fn a_constraint_only_adds_to_the_cost() {
        let mut random = seeded(31);
        let mut search = LengthConstrained::default();
        for _ in 0..100 {
            let noise = Noise { code_m: 0.3, phase_m: 0.003 };
            let length_m = random.random_range(0.5..40.0);
            let sky = Sky::random(&mut random, 8);
            let baseline_m = random_baseline(&mut random, length_m);
            let float = sky.epoch(&mut random, &[L1_M, L2_M], noise, &[baseline_m]).float;
            let plain =
                integer_least_squares(float.ambiguities.as_slice(), &float.ambiguity_covariance, 1)
                    .unwrap();
            let length = Length { length_m, sd_m: 0.003 };
            let found = search.solve(&float, length, 2).unwrap();
            assert!(found[0].cost >= plain[0].squared_distance - 1e-9);
            assert!(found.windows(2).all(|pair| pair[0].cost <= pair[1].cost));
            assert!(search.proven_to() >= found[found.len() - 1].cost);
            let loose = search.solve(&float, Length { length_m, sd_m: 1e6 }, 1).unwrap();
            assert_eq!(loose[0].integers, plain[0].integers);
            assert!((loose[0].cost - plain[0].squared_distance).abs() < 1e-5);
        }
    }

    #[test]
    fn the_baseline_found_is_the_true_one() {
        let mut random = seeded(32);
        let mut search = LengthConstrained::default();
        for _ in 0..100 {
            let noise = Noise { code_m: 0.3, phase_m: 0.003 };
            let sky = Sky::random(&mut random, 12);
            let baseline_m = random_baseline(&mut random, 2.0);
            let epoch = sky.epoch(&mut random, &[L1_M], noise, &[baseline_m]);
            let length = Length { length_m: 2.0, sd_m: 0.0 };
            let found = search.solve(&epoch.float, length, 2).unwrap();
            assert_eq!(found[0].integers, epoch.integers);
            assert!((found[0].baseline_m.norm() - 2.0).abs() < 1e-9);
            assert!((found[0].baseline_m - baseline_m).norm() < 0.05);
        }
    }

    #[test]
    fn an_exhausted_budget_is_no_answer() {
        let mut random = seeded(33);
        let sky = Sky::random(&mut random, 5);
        let noise = Noise { code_m: 3.0, phase_m: 0.003 };
        let float = sky.epoch(&mut random, &[L1_M], noise, &[Vector3::new(10.0, 0.0, 0.0)]).float;
        let mut search = LengthConstrained { node_budget: 20, ..Default::default() };
        let found = search.solve(&float, Length { length_m: 10.0, sd_m: 0.01 }, 2);
        assert!(matches!(found, Err(AmbiguityError::BudgetExceeded { .. })));
    }
}
