//! The convex relaxation: baselines taken in shares 0 ≤ s ≤ 1 instead of wholly or not at all. Its
//! optimum bounds every choice, and its shares say which baselines matter.
//!
//! With F(s) = Σ sₖ wₖ lₖ lₖᵀ (or the attitude information of it) each criterion is a linear
//! programme with matrix inequalities:
//!
//! * λ_min: max t, F ⪰ t I (problem 1 as published);
//! * κ: with z = τ s, min k, I ⪯ F(z) ⪯ k I (problem 2 as published, homogenised: no bisection);
//! * tr J⁻¹: min Σ uᵢ, [J eᵢ; eᵢᵀ uᵢ] ⪰ 0.

use nalgebra::{DVector, Matrix3, Matrix4};

use super::cone_program::{Block, ConeProgram, Inequality};
use super::{Baselines, Criterion, Graph};

/// Rounds of added subset constraints; the bound holds after each.
const MAX_ROUNDS: usize = 20;
/// A subset constraint broken by less than this is kept.
const VIOLATION: f64 = 1e-7;

/// Optimum of the relaxation.
#[derive(Debug, Clone, PartialEq)]
pub struct Relaxed {
    /// Share 0 ≤ s ≤ 1 of each baseline; they sum to n − 1.
    pub shares: Vec<f64>,
    /// No choice has a better value of the criterion than this.
    pub bound: f64,
}

/// The relaxation of the choice of a graph of kind `graph` by `criterion`.
///
/// Where the solver finds no certificate (an array that is flat almost to rounding) the bound is the
/// trivial one: 1 for condition numbers, 0 or infinity for the others.
#[must_use]
pub fn relax(baselines: &Baselines, graph: Graph, criterion: Criterion) -> Relaxed {
    separate(baselines, graph, |subsets| match criterion {
        Criterion::BaselineCondition => least_condition(baselines, subsets, Information::Baselines),
        Criterion::InformationCondition => {
            least_condition(baselines, subsets, Information::Attitude)
        }
        Criterion::SmallestInformation => {
            largest_smallest_eigenvalue(baselines, subsets, Information::Attitude)
        }
        Criterion::TraceOfCovariance => least_trace_of_inverse(baselines, subsets),
    })
}

/// Solves with the subset constraints (4) of a tree that are needed, found by separation: there are
/// 2ⁿ of them, and few are ever active.
///
/// `solve` takes the subsets (bit masks of antennas) whose constraints are in force.
pub(super) fn separate(
    baselines: &Baselines,
    graph: Graph,
    solve: impl Fn(&[u32]) -> Relaxed,
) -> Relaxed {
    let mut subsets = Vec::new();
    let mut relaxed = solve(&subsets);
    if graph == Graph::SpanningTree {
        for _ in 0..MAX_ROUNDS {
            let violated = violated_subsets(baselines, &relaxed.shares);
            if violated.is_empty() {
                break;
            }
            subsets.extend(violated);
            relaxed = solve(&subsets);
        }
    }
    relaxed
}

/// The most violated subset constraints, at most two for each antenna.
fn violated_subsets(baselines: &Baselines, shares: &[f64]) -> Vec<u32> {
    let antennas = baselines.antennas;
    let mut share_of_pair = vec![vec![0.0; antennas]; antennas];
    for (&(i, j), share) in baselines.pairs.iter().zip(shares) {
        share_of_pair[i][j] = *share;
    }
    // Σ s inside S = Σ s inside S without its first antenna + Σ s from that antenna into S
    let mut inside = vec![0.0; 1 << antennas];
    let mut violated = Vec::new();
    for members in 1_usize..1 << antennas {
        let first = members.trailing_zeros() as usize;
        let others = members & (members - 1);
        let joining = (first + 1..antennas).filter(|j| others >> j & 1 == 1);
        inside[members] = inside[others] + joining.map(|j| share_of_pair[first][j]).sum::<f64>();
        let excess = inside[members] - f64::from(members.count_ones() - 1);
        if excess > VIOLATION {
            violated.push((excess, members));
        }
    }
    violated.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    let masks = violated.iter().filter_map(|(_, members)| u32::try_from(*members).ok());
    masks.take(2 * antennas).collect()
}

/// Which matrix of the shares a relaxation is about.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Information {
    /// F = Σ s w l lᵀ.
    Baselines,
    /// J = tr(F) I − F.
    Attitude,
}

/// One baseline's contribution to the matrix, divided by the mean squared length: numbers near 1.
fn terms(baselines: &Baselines, information: Information) -> (Vec<Matrix3<f64>>, f64) {
    let scale = baselines.scaled_m.iter().map(|l| l.norm_squared()).sum::<f64>()
        / baselines.scaled_m.len() as f64;
    let term = |gram: &super::Gram| {
        let matrix = gram.matrix() / scale;
        match information {
            Information::Baselines => matrix,
            Information::Attitude => Matrix3::from_diagonal_element(matrix.trace()) - matrix,
        }
    };
    (baselines.grams.iter().map(term).collect(), scale)
}

/// Shares of equal size: inside every constraint.
fn equal_shares(baselines: &Baselines) -> DVector<f64> {
    DVector::from_element(baselines.pairs.len(), 2.0 / baselines.antennas as f64)
}

/// Constraints (2) of the paper and (4) for these subsets; (3) follows from (4) and the sum.
///
/// `scale` is the variable that the right-hand sides are multiplied with, if the problem is
/// homogenised.
fn constraints(baselines: &Baselines, subsets: &[u32], scale: Option<usize>) -> Vec<Inequality> {
    let within = |members: u32| {
        let pairs = baselines.pairs.iter().enumerate();
        pairs.filter(move |(_, (i, j))| members >> i & members >> j & 1 == 1).map(|(k, _)| k)
    };
    let inequality = |mut terms: Vec<(usize, f64)>, bound: f64| match scale {
        Some(variable) => {
            terms.push((variable, -bound));
            Inequality { terms, bound: 0.0 }
        }
        None => Inequality { terms, bound },
    };
    // s ≥ 0
    let mut list: Vec<Inequality> = (0..baselines.pairs.len())
        .map(|k| Inequality { terms: vec![(k, -1.0)], bound: 0.0 })
        .collect();
    // (2): s ≤ 1 and Σ s at each antenna ≥ 1
    for k in 0..baselines.pairs.len() {
        list.push(inequality(vec![(k, 1.0)], 1.0));
    }
    for antenna in 0..baselines.antennas {
        let touching = baselines.pairs.iter().enumerate();
        let terms = touching
            .filter(|(_, (i, j))| *i == antenna || *j == antenna)
            .map(|(k, _)| (k, -1.0))
            .collect();
        list.push(inequality(terms, -1.0));
    }
    // (4): Σ s inside a set of antennas ≤ its size − 1
    for &members in subsets {
        let terms = within(members).map(|k| (k, 1.0)).collect();
        list.push(inequality(terms, f64::from(members.count_ones()) - 1.0));
    }
    list
}

/// The 3×3 matrix as a block whose fourth row does nothing.
fn block(constant: Matrix3<f64>, terms: Vec<Matrix3<f64>>) -> Block {
    let embed = |matrix: &Matrix3<f64>, corner: f64| {
        let mut embedded = Matrix4::zeros();
        embedded.fixed_view_mut::<3, 3>(0, 0).copy_from(matrix);
        embedded[(3, 3)] = corner;
        embedded
    };
    Block {
        constant: embed(&constant, 1.0),
        terms: terms.iter().map(|term| embed(term, 0.0)).collect(),
    }
}

/// Extends a vector over the baselines by further variables.
fn extended(shares: &DVector<f64>, further: &[f64]) -> DVector<f64> {
    DVector::from_iterator(shares.len() + further.len(), shares.iter().chain(further).copied())
}

fn sum_of_shares(count: usize, further: &[f64]) -> DVector<f64> {
    extended(&DVector::from_element(count, 1.0), further)
}

/// Smallest and largest eigenvalue.
fn extremes(matrix: &Matrix3<f64>) -> (f64, f64) {
    let eigenvalues = matrix.symmetric_eigenvalues();
    (eigenvalues.min(), eigenvalues.max())
}

fn combine(terms: &[Matrix3<f64>], shares: &DVector<f64>) -> Matrix3<f64> {
    terms.iter().zip(shares.iter()).fold(Matrix3::zeros(), |sum, (term, s)| sum + term * *s)
}

/// Problem 1: max t subject to F(s) − t I ⪰ 0. The bound is on λ_min, m².
pub(super) fn largest_smallest_eigenvalue(
    baselines: &Baselines,
    subsets: &[u32],
    information: Information,
) -> Relaxed {
    let (terms, scale) = terms(baselines, information);
    let count = terms.len();
    let shares = equal_shares(baselines);
    let (smallest, largest) = extremes(&combine(&terms, &shares));
    let programme = ConeProgram {
        cost: extended(&DVector::zeros(count), &[-1.0]),
        equality: sum_of_shares(count, &[0.0]),
        inequalities: constraints(baselines, subsets, None),
        blocks: vec![block(Matrix3::zeros(), [terms, vec![-Matrix3::identity()]].concat())],
    };
    match programme.minimise(extended(&shares, &[smallest - 0.1 * largest])) {
        Some(optimum) => Relaxed {
            shares: optimum.x.rows(0, count).iter().copied().collect(),
            bound: -optimum.bound * scale,
        },
        None => Relaxed { shares: shares.iter().copied().collect(), bound: f64::INFINITY },
    }
}

/// Problem 2 for one v: min λ_max(F) − v λ_min(F) as min t₁ − v t₂ subject to t₁ I ⪰ F ⪰ t₂ I.
/// The bound is the minimum itself, in units of the mean squared length.
pub(super) fn least_weighted_spread(baselines: &Baselines, subsets: &[u32], v: f64) -> Relaxed {
    let (terms, _) = terms(baselines, Information::Baselines);
    let count = terms.len();
    let shares = equal_shares(baselines);
    let (smallest, largest) = extremes(&combine(&terms, &shares));
    let negative: Vec<Matrix3<f64>> = terms.iter().map(|term| -term).collect();
    let identity = Matrix3::identity();
    let zero = Matrix3::zeros();
    let programme = ConeProgram {
        cost: extended(&DVector::zeros(count), &[1.0, -v]),
        equality: sum_of_shares(count, &[0.0, 0.0]),
        inequalities: constraints(baselines, subsets, None),
        blocks: vec![
            block(zero, [negative, vec![identity, zero]].concat()),
            block(zero, [terms, vec![zero, -identity]].concat()),
        ],
    };
    let start = extended(&shares, &[1.1 * largest, smallest - 0.1 * largest]);
    let x = programme.minimise(start.clone()).map_or(start, |optimum| optimum.x);
    Relaxed { shares: x.rows(0, count).iter().copied().collect(), bound: programme.cost.dot(&x) }
}

/// Problem 2 at once: z = τ s, min k subject to I ⪯ F(z) ⪯ k I. The bound is on κ.
pub(super) fn least_condition(
    baselines: &Baselines,
    subsets: &[u32],
    information: Information,
) -> Relaxed {
    let (terms, _) = terms(baselines, information);
    let count = terms.len();
    let shares = equal_shares(baselines);
    let (smallest, largest) = extremes(&combine(&terms, &shares));
    let negative: Vec<Matrix3<f64>> = terms.iter().map(|term| -term).collect();
    let identity = Matrix3::identity();
    let zero = Matrix3::zeros();
    let programme = ConeProgram {
        cost: extended(&DVector::zeros(count), &[0.0, 1.0]),
        // Σ z = (n − 1) τ
        equality: sum_of_shares(count, &[1.0 - baselines.antennas as f64, 0.0]),
        inequalities: constraints(baselines, subsets, Some(count)),
        blocks: vec![
            block(-identity, [terms, vec![zero, zero]].concat()),
            block(zero, [negative, vec![zero, identity]].concat()),
        ],
    };
    // Twice the smallest multiple of equal shares that is above I.
    let scale = 2.0 / smallest;
    let start = extended(&(&shares * scale), &[scale, 2.0 * largest * scale]);
    match programme.minimise(start) {
        Some(optimum) => Relaxed {
            shares: optimum.x.rows(0, count).iter().map(|z| z / optimum.x[count]).collect(),
            bound: optimum.bound.max(1.0),
        },
        None => Relaxed { shares: shares.iter().copied().collect(), bound: 1.0 },
    }
}

/// min Σ uᵢ subject to [J(s) eᵢ; eᵢᵀ uᵢ] ⪰ 0, that is uᵢ ≥ (J⁻¹)ᵢᵢ. The bound is on tr J⁻¹, m⁻².
fn least_trace_of_inverse(baselines: &Baselines, subsets: &[u32]) -> Relaxed {
    let (terms, scale) = terms(baselines, Information::Attitude);
    let count = terms.len();
    let shares = equal_shares(baselines);
    let (smallest, _) = extremes(&combine(&terms, &shares));
    let variance_block = |axis: usize| {
        let mut block = block(Matrix3::zeros(), terms.clone());
        block.constant[(3, 3)] = 0.0;
        (block.constant[(axis, 3)], block.constant[(3, axis)]) = (1.0, 1.0);
        for variance in 0..3 {
            let mut term = Matrix4::zeros();
            term[(3, 3)] = f64::from(u8::from(variance == axis));
            block.terms.push(term);
        }
        block
    };
    let programme = ConeProgram {
        cost: extended(&DVector::zeros(count), &[1.0; 3]),
        equality: sum_of_shares(count, &[0.0; 3]),
        inequalities: constraints(baselines, subsets, None),
        blocks: (0..3).map(variance_block).collect(),
    };
    match programme.minimise(extended(&shares, &[2.0 / smallest; 3])) {
        Some(optimum) => Relaxed {
            shares: optimum.x.rows(0, count).iter().copied().collect(),
            bound: optimum.bound.max(0.0) / scale,
        },
        None => Relaxed { shares: shares.iter().copied().collect(), bound: 0.0 },
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::selection::best_by_enumeration;
    use crate::selection::swap::tests::random_array;
    use rand::SeedableRng;
    use rand_xoshiro::Xoshiro256PlusPlus;

    /// Value of the criterion for shares.
    fn value_of_shares(baselines: &Baselines, shares: &[f64], criterion: Criterion) -> f64 {
        let pairs = baselines.scaled_m.iter().zip(shares);
        let gram = pairs.fold(crate::selection::Gram::default(), |sum, (l, s)| {
            sum + crate::selection::Gram::of(l, *s)
        });
        criterion.value(gram.eigenvalues())
    }

    /// The bound is below every choice, the shares reach it, and they keep the constraints: a proof
    /// of optimality that does not trust the solver.
    #[test]
    fn the_shares_reach_the_bound_and_no_choice_passes_it() {
        let mut random = Xoshiro256PlusPlus::seed_from_u64(30);
        for antennas in [3, 4, 5, 7] {
            for graph in [Graph::SpanningTree, Graph::General] {
                let baselines = random_array(antennas, &mut random);
                for criterion in Criterion::ALL {
                    if baselines.check(criterion).is_err() {
                        continue;
                    }
                    let Relaxed { shares, bound } = relax(&baselines, graph, criterion);
                    let best = best_by_enumeration(&baselines, graph, criterion);
                    let bound = criterion.cost(bound);
                    let reached = criterion.cost(value_of_shares(&baselines, &shares, criterion));
                    let best = criterion.cost(baselines.value(&best, criterion));
                    let name = format!("{antennas} {graph:?} {criterion:?}");
                    assert!(bound <= best * (1.0 + 1e-12), "{name}: {bound} above {best}");
                    assert!((reached / bound - 1.0).abs() < 1e-7, "{name}: {reached} {bound}");
                    let every_subset: Vec<u32> = match graph {
                        Graph::SpanningTree => (1..1 << antennas).collect(),
                        _ => Vec::new(),
                    };
                    for constraint in constraints(&baselines, &every_subset, None) {
                        let terms = constraint.terms.iter();
                        let sum: f64 = terms.map(|(k, factor)| factor * shares[*k]).sum();
                        assert!(sum < constraint.bound + 2.0 * VIOLATION, "{name}: {sum}");
                    }
                    let sum: f64 = shares.iter().sum();
                    assert!((sum - (antennas as f64 - 1.0)).abs() < 1e-9, "{name}: {sum}");
                }
            }
        }
    }

    /// A cube's corners: by symmetry all shares of equal length may be equal, and κ = 1.
    #[test]
    fn a_cube_is_perfectly_conditioned() {
        let corner = |i: usize| {
            let bit = |b: usize| (i >> b & 1) as f64;
            crate::frames::Vector::new(bit(0), bit(1), bit(2))
        };
        let array = crate::array::AntennaArray::new((0..8).map(corner).collect()).unwrap();
        let baselines = Baselines::of(&array).unwrap();
        let relaxed = relax(&baselines, Graph::SpanningTree, Criterion::BaselineCondition);
        let reached = value_of_shares(&baselines, &relaxed.shares, Criterion::BaselineCondition);
        assert!((reached - 1.0).abs() < 1e-7 && relaxed.bound <= 1.0, "{reached}");
    }
}
