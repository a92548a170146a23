//! Integer least squares for a baseline of known length (C-LAMBDA), exactly.
//!
//! ```text
//! min over integer z and real b of
//!     |â − z|²_Qa  +  |b̌(z) − b|²_Qb|a  +  (|b| − l)² / σ²
//! ```
//!
//! by the search of `best_first`, with the [`sphere`](super::sphere) as its
//! constraint. Problem: Teunissen (2010), *Integer least-squares theory for the GNSS compass*,
//! J. Geodesy 84.

use nalgebra::{Matrix3, Vector3};

use super::{
    AmbiguityError, MixedFloat,
    best_first::{BestFirst, Constraint, Cost, DEFAULT_NODE_BUDGET, Extent, Levels, informative},
    decorrelate::Decorrelation,
    search::{DEFAULT_HORIZON, settled_variance},
    sphere::{Length, SphereMetric},
};

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
    decorrelation: Decorrelation,
    tree: BestFirst<3, f64>,
    proven_to: f64,
}

impl Default for LengthConstrained {
    fn default() -> Self {
        Self {
            node_budget: DEFAULT_NODE_BUDGET,
            horizon: DEFAULT_HORIZON,
            decorrelation: Decorrelation::default(),
            tree: BestFirst::default(),
            proven_to: f64::NAN,
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
        let covariance = &float.ambiguity_covariance;
        self.decorrelation.compute_in_blocks(
            covariance,
            &[covariance.nrows()],
            settled_variance(self.horizon),
        )?;
        let levels = Levels::<3>::new(&self.decorrelation, float)?;
        let conditional: Matrix3<f64> =
            float.conditional_covariance_m2.fixed_view::<3, 3>(0, 0).into();
        let mut spheres = Spheres::new(levels.covariances(conditional).collect(), length)?;
        let extent = Extent { count, horizon: self.horizon, work_budget: self.node_budget };
        let (leaves, proven_to) = self.tree.cheapest(&levels, &mut spheres, extent)?;
        self.proven_to = proven_to;
        let candidates = leaves.into_iter().map(|leaf| LengthCandidate {
            integers: leaf.integers,
            cost: leaf.cost,
            baseline_m: spheres.last.nearest(&leaf.reals),
        });
        Ok(candidates.collect())
    }

    /// Every integer vector that the last call of [`solve`](Self::solve) has not returned costs at
    /// least this.
    #[must_use]
    pub fn proven_to(&self) -> f64 {
        self.proven_to
    }

    /// Branches that the last call of [`solve`](Self::solve) has opened.
    #[must_use]
    pub fn nodes(&self) -> usize {
        self.tree.work()
    }

    /// The decorrelation of the last call of [`solve`](Self::solve), for its success rate.
    #[must_use]
    pub fn decorrelation(&self) -> &Decorrelation {
        &self.decorrelation
    }
}

/// One sphere in the metrics of all levels, each prepared when it is first asked for.
struct Spheres {
    /// `Q₀ … Qₙ`, m².
    covariances_m2: Vec<Matrix3<f64>>,
    informative: Vec<bool>,
    metrics: Vec<Option<SphereMetric>>,
    /// The metric of level 0: every integer fixed.
    last: SphereMetric,
    length: Length,
}

impl Spheres {
    fn new(covariances_m2: Vec<Matrix3<f64>>, length: Length) -> Result<Self, AmbiguityError> {
        let last = SphereMetric::new(&covariances_m2[0], length)?;
        let informative = informative(&covariances_m2);
        let metrics = vec![None; covariances_m2.len()];
        Ok(Self { covariances_m2, informative, metrics, last, length })
    }
}

impl Constraint<3> for Spheres {
    type Multiplier = f64;
    const BRANCH_WORK: usize = 1;
    const BOUND_WORK: usize = 0;

    fn is_informative(&self, level: usize) -> bool {
        self.informative[level]
    }

    fn bound(&mut self, level: usize, reals: &Vector3<f64>, start: Option<f64>) -> (f64, f64) {
        let metric = &mut self.metrics[level];
        if metric.is_none() {
            *metric = SphereMetric::new(&self.covariances_m2[level], self.length).ok();
        }
        // Covariances grow from level to level: they are as positive definite as the first. If
        // rounding says otherwise, zero is a bound too.
        match (metric, start) {
            (Some(metric), Some(multiplier)) => metric.lower_bound(reals, multiplier),
            (Some(metric), None) => metric.cost_and_multiplier(reals),
            (None, _) => (0.0, start.unwrap_or(0.0)),
        }
    }

    fn cost(
        &mut self,
        reals: &Vector3<f64>,
        _: f64,
        _: f64,
    ) -> Result<(Cost, usize), AmbiguityError> {
        Ok((Cost::Exact(self.last.cost(reals)), 0))
    }
}

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
            for (near, found) in near.iter().zip(&found) {
                assert_eq!(near.integers, found.integers, "case {case}");
                assert!((near.cost - found.cost).abs() < 1e-9 * (1.0 + found.cost));
            }
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
        // A place where the baseline belongs: millions of integers are as cheap.
        let mut place = float.clone();
        place.reals_m *= 6.4e5;
        search.node_budget = 1000;
        let found = search.solve(&place, Length { length_m: 10.0, sd_m: 0.01 }, 2);
        let Err(AmbiguityError::BudgetExceeded { nodes }) = found else { panic!("{found:?}") };
        assert!((1001..1010).contains(&nodes), "{nodes}");
    }
}
