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

pub use criterion::Criterion;
pub use enumerate::{best_by_enumeration, for_each_graph};
pub use gram::Gram;
pub use relaxation::{Relaxed, relax};
pub use swap::{descend, search};

/// Up to this many antennas every admissible graph is looked at.
pub const EXACT_ANTENNAS: usize = 9;
/// More antennas than this are refused.
pub const MAX_ANTENNAS: usize = 16;
/// Starts of the edge-swap search beyond [`EXACT_ANTENNAS`] antennas.
const STARTS: usize = 2000;
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
        let every: Vec<usize> = (0..self.pairs.len()).collect();
        let [s1, s2, s3] = self.singular_values_m(&every);
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
/// starts, with the bound of the convex relaxation beside it.
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
    let exact = graph == Graph::AllPairs || baselines.antennas() <= EXACT_ANTENNAS;
    let chosen = if exact {
        best_by_enumeration(baselines, graph, criterion)
    } else {
        search(baselines, graph, criterion, STARTS, random)
    };
    let value = baselines.value(&chosen, criterion);
    let bound = if exact { value } else { relax(baselines, graph, criterion).bound };
    Ok(Selection { pairs: baselines.pairs_of(&chosen), value, bound })
}
