//! Integer least squares for an array of known shape (MC-LAMBDA's problem), exactly.
//!
//! ```text
//! min over integer z and rotations R of   |â − z|²_Qa  +  |x̌(z) − vec(R B)|²_Qx|a
//! ```
//!
//! `x` stacks the baselines from antenna 0 to all others in an outside frame, `B` (`3 × k`) holds
//! them in body axes. `B = E G` with `r` orthonormal body axes `E`, `r` the dimension of the array,
//! so that `vec(R B) = (Gᵀ ⊗ I) f` with `f` the same axes seen from outside:
//!
//! 1. more baselines than dimensions obey linear conditions, which improve the float solution
//!    (Teunissen 2012, *The affine constrained GNSS attitude model*, J. Geodesy 86);
//! 2. one axis is a vector of length one: the search of [`length_constrained`];
//! 3. two or three axes are a [`frame`](super::frame): the same search, baseline after baseline.
//!
//! [`length_constrained`]: super::length_constrained

use nalgebra::{DMatrix, Matrix3, Matrix3xX, SMatrix, SVector, Vector3};

use super::{
    AmbiguityError, MixedFloat,
    best_first::{BestFirst, Constraint, Cost, Extent, Levels, informative},
    decorrelate::Decorrelation,
    frame::{FrameMetric, Nearest, completed},
    length_constrained::LengthConstrained,
    search::{DEFAULT_HORIZON, settled_variance},
    sphere::Length,
};
use crate::array::survey_covariance;

/// An extent of the array below this share of the largest is no dimension of it.
const FLAT_RATIO: f64 = 1e-6;

/// Work that a search does by default before it gives up: some tenths of a second.
const DEFAULT_WORK_BUDGET: usize = 2_000_000;
/// A branch of a line, with its bound, takes 0.25 µs (`engine/work_budget.rs`), as long as three of two axes.
const LINE_BRANCH_WORK: usize = 3;

/// An integer vector, the array that goes with it, and what both cost together.
#[derive(Debug, Clone, PartialEq)]
pub struct ArrayCandidate {
    /// `z`, cycles, in the order of the float ambiguities.
    pub integers: Vec<i64>,
    /// The minimum over the attitude of the constrained cost, no unit.
    pub cost: f64,
    /// The baselines `R B` with this minimum, m.
    pub baselines_m: Vec<Vector3<f64>>,
    /// `R`; none for a collinear array, which can turn about its line.
    pub outside_from_body: Option<Matrix3<f64>>,
}

/// The search with its memory: keep one and call it every epoch.
#[derive(Debug, Clone)]
pub struct ArrayConstrained {
    /// Work before [`AmbiguityError::BudgetExceeded`], in branches of two axes that could be opened.
    pub work_budget: usize,
    /// Vectors that cost more than the best by more than this are not looked for.
    pub horizon: f64,
    decorrelation: Decorrelation,
    line: LengthConstrained,
    plane: BestFirst<6, SVector<f64, 3>>,
    space: BestFirst<9, SVector<f64, 6>>,
    work: usize,
    proven_to: f64,
}

impl Default for ArrayConstrained {
    fn default() -> Self {
        Self {
            work_budget: DEFAULT_WORK_BUDGET,
            horizon: DEFAULT_HORIZON,
            decorrelation: Decorrelation::default(),
            line: LengthConstrained::default(),
            plane: BestFirst::default(),
            space: BestFirst::default(),
            work: 0,
            proven_to: f64::NAN,
        }
    }
}

impl ArrayConstrained {
    /// The `count` integer vectors of least cost, cheapest first; fewer if the others lie beyond
    /// the [`horizon`](Self::horizon).
    ///
    /// `float` holds the `3k` components of the baselines as its reals and their ambiguities
    /// baseline after baseline, `ambiguities_of[j]` of them for baseline `j`; `body_m` the
    /// baselines in body axes, and `array_sd_m` the standard deviation of an antenna position in
    /// them (zero for an exact array).
    ///
    /// # Errors
    ///
    /// [`AmbiguityError`].
    pub fn solve(
        &mut self,
        float: MixedFloat,
        ambiguities_of: &[usize],
        body_m: &[Vector3<f64>],
        array_sd_m: f64,
        count: usize,
    ) -> Result<Vec<ArrayCandidate>, AmbiguityError> {
        self.work = 0;
        let expect = AmbiguityError::expect_dimension;
        let (n, baselines) = (float.ambiguities.len(), body_m.len());
        expect("the list of ambiguities per baseline", ambiguities_of.len(), baselines)?;
        expect("the sum of ambiguities per baseline", ambiguities_of.iter().sum(), n)?;
        let shape = Shape::new(body_m)?;
        let softened = softened(float, body_m.len(), array_sd_m)?;
        let (axes_float, misfit) = shape.reduced(softened)?;
        let mut candidates = match shape.dimension() {
            1 => {
                let found = self.on_a_line(&axes_float, &shape, count);
                self.work = self.line.nodes() * LINE_BRANCH_WORK;
                found
            }
            2 => {
                let mut tree = std::mem::take(&mut self.plane);
                let found = self.with_frame(&axes_float, &shape, ambiguities_of, count, &mut tree);
                self.work = tree.work();
                self.plane = tree;
                found
            }
            _ => {
                let mut tree = std::mem::take(&mut self.space);
                let found = self.with_frame(&axes_float, &shape, ambiguities_of, count, &mut tree);
                self.work = tree.work();
                self.space = tree;
                found
            }
        }?;
        for candidate in &mut candidates {
            candidate.cost += misfit;
        }
        self.proven_to += misfit;
        Ok(candidates)
    }

    /// Every integer vector that the last call of [`solve`](Self::solve) has not returned costs at
    /// least this.
    #[must_use]
    pub fn proven_to(&self) -> f64 {
        self.proven_to
    }

    /// Work of the last call of [`solve`](Self::solve), in branches of two axes.
    #[must_use]
    pub fn work(&self) -> usize {
        self.work
    }

    /// The decorrelation of the last call of [`solve`](Self::solve), for its success rate.
    #[must_use]
    pub fn decorrelation(&self) -> &Decorrelation {
        &self.decorrelation
    }

    /// A collinear array: its axis is a vector of length one.
    fn on_a_line(
        &mut self,
        float: &MixedFloat,
        shape: &Shape,
        count: usize,
    ) -> Result<Vec<ArrayCandidate>, AmbiguityError> {
        self.line.node_budget = self.work_budget / LINE_BRANCH_WORK;
        self.line.horizon = self.horizon;
        let unit = Length { length_m: 1.0, sd_m: 0.0 };
        let found = self.line.solve(float, unit, count)?;
        self.decorrelation.clone_from(self.line.decorrelation());
        self.proven_to = self.line.proven_to();
        let candidates = found.into_iter().map(|candidate| ArrayCandidate {
            integers: candidate.integers,
            cost: candidate.cost,
            baselines_m: shape.baselines(candidate.baseline_m.as_slice()),
            outside_from_body: None,
        });
        Ok(candidates.collect())
    }

    /// An array with two or three axes.
    fn with_frame<const P: usize, const S: usize>(
        &mut self,
        float: &MixedFloat,
        shape: &Shape,
        ambiguities_of: &[usize],
        count: usize,
        tree: &mut BestFirst<P, SVector<f64, S>>,
    ) -> Result<Vec<ArrayCandidate>, AmbiguityError> {
        let covariance = &float.ambiguity_covariance;
        self.decorrelation.compute_in_blocks(
            covariance,
            ambiguities_of,
            settled_variance(self.horizon),
        )?;
        let levels = Levels::<P>::new(&self.decorrelation, float)?;
        let conditional = float.conditional_covariance_m2.fixed_view::<P, P>(0, 0).into_owned();
        let mut frames = Frames::<P, S>::new(levels.covariances(conditional).collect())?;
        let extent = Extent { count, horizon: self.horizon, work_budget: self.work_budget };
        let (leaves, proven_to) = tree.cheapest(&levels, &mut frames, extent)?;
        self.proven_to = proven_to;
        leaves
            .into_iter()
            .map(|leaf| {
                let (_, multipliers) = frames.last.bound(&leaf.reals, None);
                let Nearest { axes, .. } = frames.last.nearest(&leaf.reals, multipliers)?;
                Ok(ArrayCandidate {
                    integers: leaf.integers,
                    cost: leaf.cost,
                    baselines_m: shape.baselines(axes.as_slice()),
                    outside_from_body: Some(completed(&axes) * shape.body_axes.transpose()),
                })
            })
            .collect()
    }
}

/// Orthonormal axes in the metrics of all levels, each prepared when it is first asked for.
struct Frames<const P: usize, const S: usize> {
    /// `Q₀ … Qₙ`.
    covariances: Vec<SMatrix<f64, P, P>>,
    informative: Vec<bool>,
    metrics: Vec<Option<FrameMetric<P, S>>>,
    /// The metric of level 0: every integer fixed.
    last: FrameMetric<P, S>,
}

/// Work is counted in branches of two axes, 0.08 µs each. A bound takes 1.1 µs, a tight one 12, the nearest axes 30
/// where they are proven and 200 where all rotations are searched; of three axes a branch takes 0.3 µs, a bound 2.6,
/// and the others 42, 42 and 140 (least squares over the searches of `epoch_cost scenarios/canopy-array.toml`, with and
/// without its last antenna).
impl<const P: usize, const S: usize> Frames<P, S> {
    const TIGHT_BOUND_WORK: usize = if P == 9 { 400 } else { 120 };
    const CERTIFIED_WORK: usize = if P == 9 { 400 } else { 300 };
    const SEARCHED_WORK: usize = 2_000;

    fn new(covariances: Vec<SMatrix<f64, P, P>>) -> Result<Self, AmbiguityError> {
        let last = FrameMetric::new(&covariances[0])?;
        let informative = informative(&covariances);
        Ok(Self { metrics: vec![None; covariances.len()], covariances, informative, last })
    }
}

impl<const P: usize, const S: usize> Constraint<P> for Frames<P, S> {
    type Multiplier = SVector<f64, S>;
    const BRANCH_WORK: usize = if P == 9 { 3 } else { 1 };
    const BOUND_WORK: usize = if P == 9 { 26 } else { 11 };

    fn is_informative(&self, level: usize) -> bool {
        self.informative[level]
    }

    fn bound(
        &mut self,
        level: usize,
        reals: &SVector<f64, P>,
        start: Option<SVector<f64, S>>,
    ) -> (f64, SVector<f64, S>) {
        let metric = &mut self.metrics[level];
        if metric.is_none() {
            *metric = FrameMetric::new(&self.covariances[level]).ok();
        }
        // Covariances grow from level to level: they are as positive definite as the first. If
        // rounding says otherwise, zero is a bound too.
        let nothing = (0.0, start.unwrap_or_else(SVector::zeros));
        metric.as_ref().map_or(nothing, |metric| metric.bound(reals, start))
    }

    fn cost(
        &mut self,
        reals: &SVector<f64, P>,
        multiplier: SVector<f64, S>,
        enough: f64,
    ) -> Result<(Cost, usize), AmbiguityError> {
        let (bound, multiplier) = self.last.tight_bound(reals, multiplier);
        if bound > enough {
            return Ok((Cost::AtLeast(bound), Self::TIGHT_BOUND_WORK));
        }
        let Nearest { cost, is_certified, .. } = self.last.nearest(reals, multiplier)?;
        let work = if is_certified { Self::CERTIFIED_WORK } else { Self::SEARCHED_WORK };
        Ok((Cost::Exact(cost), work))
    }
}

/// The array in axes of its own: `B = E G`.
struct Shape {
    /// `E` completed to a right-handed frame; the axes of the array come first.
    body_axes: Matrix3<f64>,
    /// `G`, `r × k`, m.
    coordinates_m: DMatrix<f64>,
}

impl Shape {
    fn new(body_m: &[Vector3<f64>]) -> Result<Self, AmbiguityError> {
        if body_m.is_empty() {
            return Err(AmbiguityError::Dimension { what: "the array", found: 0, expected: 1 });
        }
        if let Some(value) = body_m.iter().flatten().find(|component| !component.is_finite()) {
            return Err(AmbiguityError::OutOfRange { what: "a body coordinate", value: *value });
        }
        let body = Matrix3xX::from_columns(body_m);
        let eigen = (&body * body.transpose()).symmetric_eigen();
        let mut order = [0, 1, 2];
        order.sort_by(|&i, &j| eigen.eigenvalues[j].total_cmp(&eigen.eigenvalues[i]));
        let extent = |i: usize| eigen.eigenvalues[order[i]].max(0.0).sqrt();
        if extent(0) == 0.0 {
            return Err(AmbiguityError::OutOfRange { what: "the size of the array", value: 0.0 });
        }
        let dimension = (0..3).filter(|&i| extent(i) > FLAT_RATIO * extent(0)).count();
        let first = eigen.eigenvectors.column(order[0]).into_owned();
        let second = eigen.eigenvectors.column(order[1]).into_owned();
        let body_axes = Matrix3::from_columns(&[first, second, first.cross(&second)]);
        let coordinates_m = (body_axes.transpose() * body).rows(0, dimension).into_owned();
        Ok(Self {
            body_axes,
            coordinates_m: DMatrix::from_iterator(
                dimension,
                body_m.len(),
                coordinates_m.iter().copied(),
            ),
        })
    }

    /// `r`.
    fn dimension(&self) -> usize {
        self.coordinates_m.nrows()
    }

    /// `(Gᵀ ⊗ I) f`.
    fn baselines(&self, axes: &[f64]) -> Vec<Vector3<f64>> {
        let axes = Matrix3xX::from_column_slice(axes);
        (axes * &self.coordinates_m).column_iter().map(|b| b.into_owned()).collect()
    }

    /// The float solution with the axes `f` in the place of the baselines, and what the linear
    /// conditions among more baselines than axes cost whatever the integers.
    fn reduced(&self, float: MixedFloat) -> Result<(MixedFloat, f64), AmbiguityError> {
        let (float, misfit) = self.with_linear_conditions(float)?;
        let identity = Matrix3::<f64>::identity();
        // f = T⁺ x,   T = Gᵀ ⊗ I,   T⁺ = (G Gᵀ)⁻¹ G ⊗ I
        let g = &self.coordinates_m;
        let gram = (g * g.transpose()).cholesky().ok_or(AmbiguityError::NoAttitude)?;
        let axes_from_baselines = gram.solve(g).kronecker(&identity);
        // Q_f|a = (Tᵀ Q_x|a⁻¹ T)⁻¹
        let t = g.transpose().kronecker(&identity);
        let solved = cholesky(&float.conditional_covariance_m2)?.solve(&t);
        let information = t.transpose() * solved;
        let conditional = cholesky(&information)?.inverse();
        let reduced = MixedFloat {
            ambiguities: float.ambiguities,
            ambiguity_covariance: float.ambiguity_covariance,
            reals_m: &axes_from_baselines * float.reals_m,
            real_covariance_m2: &axes_from_baselines
                * float.real_covariance_m2
                * axes_from_baselines.transpose(),
            cross_covariance: &axes_from_baselines * float.cross_covariance,
            conditional_covariance_m2: conditional,
        };
        Ok((reduced, misfit))
    }

    /// Conditions the ambiguities and baselines on `N x = 0`, `N = N₀ ⊗ I` with `N₀ Gᵀ = 0`.
    ///
    /// ```text
    /// K_· = Q_·x Nᵀ (N Q_x Nᵀ)⁻¹,     â ← â − K_a N x̂,     Q_a ← Q_a − K_a N Q_xa,     …
    /// ```
    fn with_linear_conditions(
        &self,
        mut float: MixedFloat,
    ) -> Result<(MixedFloat, f64), AmbiguityError> {
        let g = &self.coordinates_m;
        let (r, k) = g.shape();
        if k == r {
            return Ok((float, 0.0));
        }
        let eigen = (g.transpose() * g).symmetric_eigen();
        let mut order: Vec<usize> = (0..k).collect();
        order.sort_by(|&i, &j| eigen.eigenvalues[i].total_cmp(&eigen.eigenvalues[j]));
        let null =
            DMatrix::from_fn(k - r, k, |row, column| eigen.eigenvectors[(column, order[row])]);
        let conditions = null.kronecker(&Matrix3::<f64>::identity());

        let discrepancy = &conditions * &float.reals_m;
        let condition_reals = &conditions * &float.real_covariance_m2;
        let condition_cross = &conditions * &float.cross_covariance;
        let q_discrepancy = cholesky(&(&condition_reals * conditions.transpose()))?;
        let misfit = discrepancy.dot(&q_discrepancy.solve(&discrepancy));

        let x_gain = q_discrepancy.solve(&condition_reals).transpose();
        let a_gain = q_discrepancy.solve(&condition_cross).transpose();
        float.reals_m -= &x_gain * &discrepancy;
        float.ambiguities -= &a_gain * &discrepancy;
        float.real_covariance_m2.gemm(-1.0, &x_gain, &condition_reals, 1.0);
        float.cross_covariance.gemm(-1.0, &x_gain, &condition_cross, 1.0);
        float.ambiguity_covariance.gemm(-1.0, &a_gain, &condition_cross, 1.0);
        Ok((float, misfit))
    }
}

/// Adds the covariance of the survey to `Q_x` and `Q_x|a`.
fn softened(
    mut float: MixedFloat,
    baselines: usize,
    array_sd_m: f64,
) -> Result<MixedFloat, AmbiguityError> {
    float.checked_dimension(3 * baselines)?;
    if !(array_sd_m >= 0.0 && array_sd_m.is_finite()) {
        let what = "the standard deviation of the array";
        return Err(AmbiguityError::OutOfRange { what, value: array_sd_m });
    }
    let survey = survey_covariance(baselines, array_sd_m);
    float.real_covariance_m2 += &survey;
    float.conditional_covariance_m2 += survey;
    Ok(float)
}

fn cholesky(
    matrix: &DMatrix<f64>,
) -> Result<nalgebra::Cholesky<f64, nalgebra::Dyn>, AmbiguityError> {
    matrix.clone().cholesky().ok_or_else(|| {
        let variance = matrix.diagonal().min();
        AmbiguityError::NotPositiveDefinite { index: 0, variance }
    })
}

#[cfg(test)]
mod tests {
    use nalgebra::DVector;
    use rand_xoshiro::Xoshiro256PlusPlus;

    use super::super::problems::{L1_M, Noise, Sky, normal, seeded};
    use super::super::search::integer_least_squares;
    use super::*;
    use crate::attitude::joint;
    use crate::attitude::wahba::nearest_rotation;

    const NOISE: Noise = Noise { code_m: 0.3, phase_m: 0.003 };

    fn random_rotation(random: &mut Xoshiro256PlusPlus) -> Matrix3<f64> {
        nearest_rotation(&Matrix3::from_fn(|_, _| normal(random))).unwrap().rotation
    }

    fn body(positions: &[[f64; 3]]) -> Vec<Vector3<f64>> {
        positions.iter().map(|&p| Vector3::from(p)).collect()
    }

    /// Where a bound is enough the nearest axes are not looked for.
    #[test]
    fn a_bound_that_is_enough_spares_the_cost() {
        let mut frames = Frames::<6, 3>::new(vec![SMatrix::identity() * 1e-4]).unwrap();
        // Two axes of which one is too long and both lean to each other.
        let reals = SVector::<f64, 6>::from([1.1, 0.1, 0.0, 0.1, 1.0, 0.05]);
        let (bound, multiplier) = frames.bound(0, &reals, None);
        let (exact, work) = frames.cost(&reals, multiplier, f64::INFINITY).unwrap();
        let Cost::Exact(exact) = exact else { panic!("{exact:?}") };
        assert!(0.0 < bound && bound <= exact * (1.0 + 1e-9), "{bound} of {exact}");
        assert!(work > Frames::<6, 3>::TIGHT_BOUND_WORK, "{work}");
        let (spared, work) = frames.cost(&reals, multiplier, 0.5 * exact).unwrap();
        let Cost::AtLeast(least) = spared else { panic!("{spared:?}") };
        assert!(0.5 * exact < least && least <= exact * (1.0 + 1e-9), "{least} of {exact}");
        assert_eq!(work, Frames::<6, 3>::TIGHT_BOUND_WORK);
    }

    /// The cost of `integers` by its definition, from the attitude problem of the full baselines.
    fn cost(float: &MixedFloat, integers: &[i64], body_m: &[Vector3<f64>], sd_m: f64) -> f64 {
        let e = DVector::from_fn(integers.len(), |i, _| float.ambiguities[i] - integers[i] as f64);
        let solved = cholesky(&float.ambiguity_covariance).unwrap().solve(&e);
        let conditional = &float.reals_m - &float.cross_covariance * &solved;
        let q = softened(float.clone(), body_m.len(), sd_m).unwrap().conditional_covariance_m2;
        let inverse = cholesky(&q).unwrap().inverse();
        let weight = 0.5 * (&inverse + inverse.transpose());
        let problem = joint::problem(body_m, &conditional, &weight).unwrap();
        let lowest = problem.search(problem.minimum().unwrap()).minimum.rotation;
        let turned = DVector::from_iterator(
            3 * body_m.len(),
            body_m.iter().flat_map(|b| Vec::from((lowest * b).as_slice())),
        );
        let misfit = conditional - turned;
        e.dot(&solved) + misfit.dot(&(weight * &misfit))
    }

    fn check_against_list(seed: u64, body_m: &[Vector3<f64>], satellites: usize, code_m: f64) {
        let mut random = seeded(seed);
        let mut search = ArrayConstrained::default();
        let noise = Noise { code_m, ..NOISE };
        let (mut compared, mut right) = (0, 0);
        for case in 0..6 {
            let sky = Sky::random(&mut random, satellites);
            let rotation = random_rotation(&mut random);
            let baselines: Vec<_> = body_m.iter().map(|b| rotation * b).collect();
            let epoch = sky.epoch(&mut random, &[L1_M], noise, &baselines);
            let of = vec![satellites - 1; body_m.len()];
            let found = search.solve(epoch.float.clone(), &of, body_m, 0.002, 2).unwrap();
            for candidate in &found {
                let expected = cost(&epoch.float, &candidate.integers, body_m, 0.002);
                let error = (candidate.cost - expected).abs();
                assert!(
                    error < 1e-5 * (1.0 + expected),
                    "case {case}: {} {expected}",
                    candidate.cost
                );
                let rotation = candidate.outside_from_body.unwrap();
                for (baseline, b) in candidate.baselines_m.iter().zip(body_m) {
                    assert!((baseline - rotation * b).norm() < 1e-3 * b.norm());
                }
            }
            right += usize::from(found[0].integers == epoch.integers);
            // |â − z|² <= cost(z): whoever beats a candidate is among these.
            let float = &epoch.float;
            let (a, q) = (float.ambiguities.as_slice(), &float.ambiguity_covariance);
            let nearest = integer_least_squares(a, q, 1000).unwrap();
            let listed_to = nearest[999].squared_distance;
            let reach = search.proven_to().min(listed_to);
            let mut all: Vec<(f64, Vec<i64>)> = nearest
                .into_iter()
                .filter(|c| c.squared_distance <= reach)
                .map(|c| (cost(float, &c.integers, body_m, 0.002), c.integers))
                .filter(|(cost, _)| *cost < reach)
                .collect();
            all.sort_by(|a, b| a.0.total_cmp(&b.0));
            let within: Vec<_> = found.iter().filter(|c| c.cost < reach).collect();
            assert_eq!(within.len(), all.len().min(2), "case {case}");
            for (candidate, (_, integers)) in within.iter().zip(&all) {
                assert_eq!(&candidate.integers, integers, "case {case}");
            }
            compared += within.len();
        }
        assert!(compared >= 4, "{compared}");
        assert!(right >= 5, "{right}");
    }

    #[test]
    fn planar_array_of_three() {
        check_against_list(50, &body(&[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]), 5, 0.1);
    }

    #[test]
    fn planar_array_of_four() {
        check_against_list(51, &body(&[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0]]), 5, 0.1);
    }

    #[test]
    fn spatial_array_of_four() {
        check_against_list(
            52,
            &body(&[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.3, 0.3, -0.8]]),
            6,
            0.1,
        );
    }

    #[test]
    fn collinear_array_of_three() {
        let mut random = seeded(53);
        let mut search = ArrayConstrained::default();
        let line = body(&[[0.7, 0.0, 0.0], [-1.4, 0.0, 0.0]]);
        let mut right = 0;
        for _ in 0..40 {
            let sky = Sky::random(&mut random, 6);
            let rotation = random_rotation(&mut random);
            let baselines: Vec<_> = line.iter().map(|b| rotation * b).collect();
            let epoch = sky.epoch(&mut random, &[L1_M], NOISE, &baselines);
            let found = search.solve(epoch.float.clone(), &[5, 5], &line, 0.0, 2).unwrap();
            assert!(found[0].outside_from_body.is_none());
            assert!((found[0].baselines_m[0] * -2.0 - found[0].baselines_m[1]).norm() < 1e-12);
            if found[0].integers == epoch.integers {
                right += 1;
                assert!((found[0].baselines_m[1] - baselines[1]).norm() < 0.1);
            }
        }
        assert!(right >= 36, "{right}");
    }

    #[test]
    fn one_baseline_is_a_length() {
        let mut random = seeded(54);
        let sky = Sky::random(&mut random, 7);
        let epoch = sky.epoch(&mut random, &[L1_M], NOISE, &[Vector3::new(0.0, 2.0, 0.0)]);
        let found = ArrayConstrained::default()
            .solve(epoch.float.clone(), &[6], &body(&[[2.0, 0.0, 0.0]]), 0.0, 2)
            .unwrap();
        let length = Length { length_m: 2.0, sd_m: 0.0 };
        let expected = LengthConstrained::default().solve(&epoch.float, length, 2).unwrap();
        assert_eq!(found[0].integers, expected[0].integers);
        assert!((found[0].cost - expected[0].cost).abs() < 1e-6 * (1.0 + expected[0].cost));
        assert!((found[0].baselines_m[0] - expected[0].baseline_m).norm() < 1e-9);
    }
}
