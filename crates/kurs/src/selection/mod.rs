//! Which baselines to process, when they are processed one by one.
//!
//! With n antennas there are n(n−1)/2 baselines; n−1 of them can already hold all antennas. Which
//! n−1 give the best attitude is the question of Rapoport and Tormagov ("Optimisation of the choice
//! of baselines in the problem of attitude determination"). With the full covariance of the
//! baselines the choice does not matter: every spanning tree carries the same information. It does
//! matter when each baseline is weighted as if it were alone.
//!
//! * [`select`] answers: exactly up to [`EXACT_ANTENNAS`] antennas, beyond that by a search whose
//!   gap to a bound is reported.
//! * [`published`] holds the method as published: relaxation, bisection and rounding.

mod attitude_error;
mod cone_program;
mod criterion;
mod enumerate;
mod gram;
mod parts;
pub mod published;
mod relaxation;
mod swap;

use nalgebra::{DMatrix, Vector3};
use rand_xoshiro::Xoshiro256PlusPlus;

use crate::array::AntennaArray;

pub use attitude_error::error_relative_to_all_antennas;
pub use criterion::Criterion;
pub use enumerate::{best_by_enumeration, for_each_graph};
pub use gram::Gram;
pub use relaxation::{Relaxed, relax};
pub use swap::{descend, search};

use enumerate::branch_and_bound;

/// Up to this many antennas every admissible graph is looked at.
pub const EXACT_ANTENNAS: usize = 9;
/// More antennas than this are refused.
pub const MAX_ANTENNAS: usize = 16;
/// Starts of the edge-swap search beyond [`EXACT_ANTENNAS`] antennas.
const STARTS: usize = 1000;
/// Branches after it, to prove the result or improve it: enough for the criteria that count length.
const BRANCHES: u64 = 2_000_000;
/// Singular values of the baselines below this share of the largest are zero: the next digits of
/// the criterion would be rounding errors.
const RANK_TOLERANCE: f64 = 1e-7;
/// Squared lengths (times weight) that leave room for the third powers of the invariants.
const SQUARED_LENGTH_RANGE: core::ops::RangeInclusive<f64> = 1e-60..=1e60;

/// Which sets of baselines are allowed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Graph {
    /// n−1 baselines that connect all antennas.
    #[default]
    SpanningTree,
    /// n−1 baselines that leave no antenna out; they may fall into separate parts.
    General,
    /// All n(n−1)/2 baselines: nothing to choose, for comparison.
    AllPairs,
}

/// A baseline: the pair of antennas (0-based), smaller number first.
pub type Pair = (usize, usize);

/// All baselines of an array, in the order (0,1), (0,2), …, (1,2), …; sets of baselines are lists of
/// indices into this order, ascending.
#[derive(Debug, Clone)]
pub struct Baselines {
    antennas: usize,
    pairs: Vec<Pair>,
    /// √w l, m.
    scaled_m: Vec<Vector3<f64>>,
    grams: Vec<Gram>,
}

/// The chosen baselines.
#[derive(Debug, Clone, PartialEq)]
pub struct Selection {
    /// Pairs of antennas, ascending.
    pub pairs: Vec<Pair>,
    /// Criterion of this choice.
    pub value: f64,
    /// No choice of this graph kind can be better than this; equal to `value` when every choice was
    /// looked at.
    pub bound: f64,
}

/// The question has no answer.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SelectionError {
    /// More antennas than the search is made for.
    #[error("{found} antennas, at most {MAX_ANTENNAS} can be searched")]
    TooManyAntennas {
        /// Number of antennas.
        found: usize,
    },
    /// Not one weight for each baseline.
    #[error("{found} weights for {expected} baselines")]
    WeightCount {
        /// Weights given.
        found: usize,
        /// Baselines of the array, n(n−1)/2.
        expected: usize,
    },
    /// A weight is not a positive number, or weight and length are beyond all practice.
    #[error("the weight {weight} of baseline {}-{} cannot be used", pair.0, pair.1)]
    Weight {
        /// The baseline.
        pair: Pair,
        /// Its weight.
        weight: f64,
    },
    /// All antennas on a line: the rotation about it is not observable, no criterion is defined.
    #[error("the antennas stand on one line, the rotation about it cannot be observed")]
    Collinear,
    /// All antennas in a plane: κ(R) is infinite for every choice.
    #[error(
        "the antennas stand in one plane: the condition number of the baselines is infinite for \
         every choice, although the attitude is determined; use a criterion of the attitude \
         information"
    )]
    Coplanar,
}

impl Baselines {
    /// All baselines of `array`, equally weighted.
    ///
    /// # Errors
    ///
    /// [`SelectionError`] for more than [`MAX_ANTENNAS`] antennas or lengths beyond all practice.
    pub fn of(array: &AntennaArray) -> Result<Self, SelectionError> {
        let count = array.len() * (array.len() - 1) / 2;
        Self::weighted(array, &vec![1.0; count])
    }

    /// All baselines of `array`, each with a weight (information per square metre, relative), in the
    /// order (0,1), (0,2), …, (1,2), ….
    ///
    /// # Errors
    ///
    /// [`SelectionError`] for more than [`MAX_ANTENNAS`] antennas, a wrong number of weights, or a
    /// weight that is not a positive number.
    pub fn weighted(array: &AntennaArray, weights: &[f64]) -> Result<Self, SelectionError> {
        let antennas = array.len();
        if antennas > MAX_ANTENNAS {
            return Err(SelectionError::TooManyAntennas { found: antennas });
        }
        let pairs: Vec<Pair> =
            (0..antennas).flat_map(|i| (i + 1..antennas).map(move |j| (i, j))).collect();
        if weights.len() != pairs.len() {
            return Err(SelectionError::WeightCount {
                found: weights.len(),
                expected: pairs.len(),
            });
        }
        let position = |antenna: usize| array.positions_m()[antenna].xyz();
        let mut scaled_m = Vec::with_capacity(pairs.len());
        for (&(i, j), &weight) in pairs.iter().zip(weights) {
            let scaled = (position(j) - position(i)) * weight.sqrt();
            if !(weight > 0.0 && SQUARED_LENGTH_RANGE.contains(&scaled.norm_squared())) {
                return Err(SelectionError::Weight { pair: (i, j), weight });
            }
            scaled_m.push(scaled);
        }
        let grams = scaled_m.iter().map(|scaled| Gram::of(scaled, 1.0)).collect();
        Ok(Self { antennas, pairs, scaled_m, grams })
    }

    /// Number of antennas.
    #[must_use]
    pub fn antennas(&self) -> usize {
        self.antennas
    }

    /// Every baseline, in index order.
    #[must_use]
    pub fn pairs(&self) -> &[Pair] {
        &self.pairs
    }

    /// The pairs with these indices.
    #[must_use]
    pub fn pairs_of(&self, chosen: &[usize]) -> Vec<Pair> {
        chosen.iter().map(|&k| self.pairs[k]).collect()
    }

    /// The set of all baselines.
    #[must_use]
    pub fn every(&self) -> Vec<usize> {
        (0..self.pairs.len()).collect()
    }

    /// R = Σ w l lᵀ over the chosen baselines (m²).
    #[must_use]
    pub fn gram(&self, chosen: &[usize]) -> Gram {
        chosen.iter().fold(Gram::default(), |sum, &k| sum + self.grams[k])
    }

    /// Criterion of the chosen baselines, from the singular values of the baselines themselves: the
    /// small eigenvalue of a flat array keeps its digits, which a Gram matrix has already lost.
    #[must_use]
    pub fn value(&self, chosen: &[usize], criterion: Criterion) -> f64 {
        criterion.value(self.singular_values_m(chosen).map(|sigma| sigma * sigma))
    }

    /// Singular values of the chosen baselines √w l as columns, ascending.
    fn singular_values_m(&self, chosen: &[usize]) -> [f64; 3] {
        // At least three rows, so that there are always three singular values.
        let rows = chosen.len().max(3);
        let mut stacked = DMatrix::zeros(rows, 3);
        for (row, &k) in chosen.iter().enumerate() {
            stacked.row_mut(row).copy_from(&self.scaled_m[k].transpose());
        }
        let singular = stacked.singular_values();
        let mut ascending = [singular[0], singular[1], singular[2]];
        ascending.sort_by(f64::total_cmp);
        ascending
    }

    /// Whether the criterion is defined for this array at all.
    ///
    /// # Errors
    ///
    /// [`SelectionError::Collinear`] or [`SelectionError::Coplanar`] if every choice would be singular.
    pub fn check(&self, criterion: Criterion) -> Result<(), SelectionError> {
        let [s1, s2, s3] = self.singular_values_m(&self.every());
        if s2 <= RANK_TOLERANCE * s3 {
            Err(SelectionError::Collinear)
        } else if criterion == Criterion::BaselineCondition && s1 <= RANK_TOLERANCE * s3 {
            Err(SelectionError::Coplanar)
        } else {
            Ok(())
        }
    }
}

impl Selection {
    /// How much better than this choice another could be at most, relative; 0 if this is the best.
    #[must_use]
    pub fn gap(&self) -> f64 {
        ((self.value - self.bound) / self.bound).abs()
    }
}

/// The best baselines by `criterion` among the graphs of kind `graph`.
///
/// Up to [`EXACT_ANTENNAS`] antennas the answer is the optimum; beyond, edge swaps from many random
/// starts, for the criteria that count length a limited branch and bound, and, where that does not
/// end, the bound of the convex relaxation beside the result.
///
/// # Errors
///
/// [`SelectionError::Collinear`] or [`SelectionError::Coplanar`] if the criterion is not defined.
pub fn select(
    baselines: &Baselines,
    graph: Graph,
    criterion: Criterion,
    random: &mut Xoshiro256PlusPlus,
) -> Result<Selection, SelectionError> {
    baselines.check(criterion)?;
    let (chosen, exact) = if graph == Graph::AllPairs || baselines.antennas() <= EXACT_ANTENNAS {
        (best_by_enumeration(baselines, graph, criterion), true)
    } else {
        let found = search(baselines, graph, criterion, STARTS, random);
        // Without length to prune by no budget would suffice.
        let branches = if criterion.counts_length() { BRANCHES } else { 0 };
        branch_and_bound(baselines, graph, criterion, found, branches)
    };
    let value = baselines.value(&chosen, criterion);
    let bound = if exact { value } else { relax(baselines, graph, criterion).bound };
    Ok(Selection { pairs: baselines.pairs_of(&chosen), value, bound })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::array::ArrayError;
    use crate::frames::Vector;
    use nalgebra::Rotation3;
    use proptest::prelude::*;
    use rand::SeedableRng;

    fn array(positions: &[[f64; 3]]) -> Result<AntennaArray, ArrayError> {
        AntennaArray::new(positions.iter().map(|[x, y, z]| Vector::new(*x, *y, *z)).collect())
    }

    fn choose(
        baselines: &Baselines,
        graph: Graph,
        criterion: Criterion,
    ) -> Result<Selection, SelectionError> {
        select(baselines, graph, criterion, &mut Xoshiro256PlusPlus::seed_from_u64(1))
    }

    const KINDS: [Graph; 3] = [Graph::SpanningTree, Graph::General, Graph::AllPairs];

    #[test]
    fn a_roof_has_no_condition_number_but_a_best_tree() {
        let roof = array(&[[0.0; 3], [1.5, 0.1, 0.0], [0.0, 1.0, 0.0], [1.4, 1.1, 0.0]]).unwrap();
        let baselines = Baselines::of(&roof).unwrap();
        for graph in KINDS {
            let refused = choose(&baselines, graph, Criterion::BaselineCondition);
            assert_eq!(refused, Err(SelectionError::Coplanar));
            assert!(refused.unwrap_err().to_string().contains("one plane"));
            let chosen = choose(&baselines, graph, Criterion::TraceOfCovariance).unwrap();
            assert_eq!(chosen.gap(), 0.0);
        }
        // By inverting J of each of the sixteen trees.
        let mut least = f64::INFINITY;
        for_each_graph(&baselines, Graph::SpanningTree, |_, gram| {
            let r = gram.matrix();
            let information = nalgebra::Matrix3::from_diagonal_element(r.trace()) - r;
            least = least.min(information.try_inverse().unwrap().trace());
        });
        let tree = choose(&baselines, Graph::SpanningTree, Criterion::TraceOfCovariance).unwrap();
        assert!((tree.value - least).abs() < 1e-13, "{} {least}", tree.value);
        assert!(tree.pairs.contains(&(0, 3)) && tree.pairs.contains(&(1, 2)), "both diagonals");
    }

    #[test]
    fn lines_and_pairs_are_refused() {
        let line = array(&[[0.0; 3], [1.0, 1.0, 1.0], [3.0, 3.0, 3.0]]).unwrap();
        let pair = array(&[[0.0; 3], [1.0, 0.0, 0.0]]).unwrap();
        for array in [line, pair] {
            let baselines = Baselines::of(&array).unwrap();
            for criterion in Criterion::ALL {
                for graph in KINDS {
                    let refused = choose(&baselines, graph, criterion);
                    assert_eq!(refused, Err(SelectionError::Collinear));
                }
            }
        }
    }

    #[test]
    fn three_antennas_have_three_trees() {
        let triangle = array(&[[0.0; 3], [2.0, 0.0, 0.0], [0.0, 1.0, 0.0]]).unwrap();
        let baselines = Baselines::of(&triangle).unwrap();
        let chosen = choose(&baselines, Graph::SpanningTree, Criterion::TraceOfCovariance).unwrap();
        // e₂(R) is 4 for each tree, e₁ is 5, 9 or 6:  tr J⁻¹ = (e₁² + e₂)/(e₁e₂) is 29/20, 85/36 or 5/3.
        assert_eq!(chosen.pairs, [(0, 1), (0, 2)]);
        assert!((chosen.value - 29.0 / 20.0).abs() < 1e-14, "{}", chosen.value);
    }

    #[test]
    fn unusable_input_has_names() {
        let spread = |n: usize| -> Vec<[f64; 3]> {
            (0..n).map(|i| [i as f64, (i * i) as f64, (i as f64).sin()]).collect()
        };
        let many = array(&spread(17)).unwrap();
        let refused = Baselines::of(&many).unwrap_err();
        assert_eq!(refused, SelectionError::TooManyAntennas { found: 17 });
        let four = array(&spread(4)).unwrap();
        let refused = Baselines::weighted(&four, &[1.0; 5]).unwrap_err();
        assert_eq!(refused, SelectionError::WeightCount { found: 5, expected: 6 });
        for wrong in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            let weights = [1.0, 1.0, wrong, 1.0, 1.0, 1.0];
            let refused = Baselines::weighted(&four, &weights).unwrap_err();
            assert!(
                matches!(refused, SelectionError::Weight { pair: (0, 3), .. }),
                "{wrong}: {refused}"
            );
        }
        let huge = array(&[[0.0; 3], [1e200, 0.0, 0.0], [0.0, 1.0, 0.0]]).unwrap();
        assert!(matches!(Baselines::of(&huge), Err(SelectionError::Weight { .. })));
    }

    /// A baseline that is twenty times noisier is not taken while another way exists.
    #[test]
    fn a_noisy_baseline_is_avoided() {
        let positions = [[0.0; 3], [1.5, 0.1, 0.2], [0.0, 1.0, -0.1], [1.4, 1.1, 0.3]];
        let array = array(&positions).unwrap();
        let criterion = Criterion::TraceOfCovariance;
        let free = Baselines::of(&array).unwrap();
        let chosen = choose(&free, Graph::SpanningTree, criterion).unwrap();
        let avoided = chosen.pairs[0];
        let weights: Vec<f64> = free
            .pairs()
            .iter()
            .map(|pair| if *pair == avoided { 1.0 / 400.0 } else { 1.0 })
            .collect();
        let weighted = Baselines::weighted(&array, &weights).unwrap();
        let other = choose(&weighted, Graph::SpanningTree, criterion).unwrap();
        assert!(!other.pairs.contains(&avoided), "{:?} {:?}", chosen.pairs, other.pairs);
        assert!(other.value > chosen.value);
    }

    /// All pairs with equal weights carry n times the information of the centred array: the same as
    /// any tree with the full covariance.
    #[test]
    fn all_pairs_are_the_centred_array() {
        let positions = [[0.0; 3], [1.5, 0.1, 0.2], [0.0, 1.0, -0.1], [1.4, 1.1, 0.3]];
        let baselines = Baselines::of(&array(&positions).unwrap()).unwrap();
        let points = positions.map(Vector3::from);
        let mean = points.iter().sum::<Vector3<f64>>() / 4.0;
        let centred =
            points.iter().fold(Gram::default(), |sum, p| sum + Gram::of(&(p - mean), 4.0));
        let difference = centred.matrix() - baselines.gram(&baselines.every()).matrix();
        assert!(difference.norm() < 1e-14);
    }

    /// Twelve antennas: the search, its proof for the default criterion, and its gap for the others.
    #[test]
    fn twelve_antennas_have_a_stated_gap() {
        let mut random = Xoshiro256PlusPlus::seed_from_u64(12);
        let baselines = swap::tests::random_array(12, &mut random);
        for criterion in Criterion::ALL {
            let chosen = choose(&baselines, Graph::SpanningTree, criterion).unwrap();
            let (cost, bound) = (criterion.cost(chosen.value), criterion.cost(chosen.bound));
            assert!(bound <= cost * (1.0 + 1e-12) && chosen.gap() < 0.2, "{criterion:?}");
            assert_eq!(chosen.pairs.len(), 11);
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(40))]

        /// Rotating, shifting and renumbering the antennas changes no optimum; scaling changes it as
        /// the unit says.
        #[test]
        fn the_optimum_does_not_depend_on_the_frame(
            coordinates in proptest::collection::vec(-1.0..1.0f64, 15),
            turn in proptest::collection::vec(-3.0..3.0f64, 3),
            scale in 0.1..10.0f64,
        ) {
            let points: Vec<Vector3<f64>> =
                coordinates.chunks(3).map(|c| Vector3::new(c[0], c[1], c[2])).collect();
            let rotation = Rotation3::new(Vector3::new(turn[0], turn[1], turn[2]));
            let moved: Vec<[f64; 3]> = points
                .iter()
                .rev()
                .map(|p| (rotation * p * scale + Vector3::new(5.0, -3.0, 1.0)).into())
                .collect();
            let still: Vec<[f64; 3]> = points.iter().map(|p| (*p).into()).collect();
            let (Ok(still), Ok(moved)) = (array(&still), array(&moved)) else { return Ok(()) };
            let (still, moved) = (Baselines::of(&still).unwrap(), Baselines::of(&moved).unwrap());
            for (criterion, power) in Criterion::ALL.into_iter().zip([0, 0, 2, -2]) {
                for graph in KINDS {
                    let (Ok(a), Ok(b)) =
                        (choose(&still, graph, criterion), choose(&moved, graph, criterion))
                    else {
                        continue;
                    };
                    let [s1, _, s3] = still.singular_values_m(&still.every());
                    let tolerance = 1e-12 * (s3 / s1).powi(2);
                    let ratio = b.value / (a.value * scale.powi(power));
                    prop_assert!((ratio - 1.0).abs() < tolerance.max(1e-9), "{criterion:?} {ratio}");
                }
            }
        }

        /// Whatever the numbers, there is an answer or a named error, and the answer is admissible.
        #[test]
        fn no_input_panics(
            coordinates in proptest::collection::vec(
                prop_oneof![-2.0..2.0f64, Just(0.0), Just(1.0), Just(f64::NAN), -1e300..1e300f64], 3..18),
            weight in prop_oneof![0.1..10.0f64, Just(0.0), Just(f64::NAN), Just(1e-300)],
        ) {
            let positions = coordinates.chunks_exact(3).map(|c| Vector::new(c[0], c[1], c[2]));
            if let Ok(array) = AntennaArray::new(positions.collect()) {
                let count = array.len() * (array.len() - 1) / 2;
                if let Ok(baselines) = Baselines::weighted(&array, &vec![weight; count]) {
                    for criterion in Criterion::ALL {
                        for graph in KINDS {
                            if let Ok(chosen) = choose(&baselines, graph, criterion) {
                                prop_assert!(chosen.value > 0.0);
                            }
                            let relaxed = relax(&baselines, graph, criterion);
                            prop_assert_eq!(relaxed.shares.len(), count);
                        }
                    }
                }
            }
        }
    }
}
