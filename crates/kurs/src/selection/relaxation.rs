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

use super::cone_program::{Block, ConeProgram, Inequality, Optimum};
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

/// What every relaxation starts from.
struct Start {
    /// Each baseline's contribution to the matrix, divided by `scale`: numbers near 1.
    terms: Vec<Matrix3<f64>>,
    /// Mean squared length.
    scale: f64,
    /// Equal shares: inside every constraint.
    shares: DVector<f64>,
    /// Extreme eigenvalues of the matrix of equal shares.
    smallest: f64,
    largest: f64,
}

impl Start {
    fn new(baselines: &Baselines, information: Information) -> Self {
        let count = baselines.pairs.len();
        let squared = baselines.scaled_m.iter().map(|l| l.norm_squared());
        let scale = squared.sum::<f64>() / count as f64;
        let term = |gram: &super::Gram| {
            let matrix = gram.matrix() / scale;
            match information {
                Information::Baselines => matrix,
                Information::Attitude => Matrix3::from_diagonal_element(matrix.trace()) - matrix,
            }
        };
        let terms: Vec<Matrix3<f64>> = baselines.grams.iter().map(term).collect();
        let share = 2.0 / baselines.antennas as f64;
        let eigenvalues = (terms.iter().sum::<Matrix3<f64>>() * share).symmetric_eigenvalues();
        Self {
            terms,
            scale,
            shares: DVector::from_element(count, share),
            smallest: eigenvalues.min(),
            largest: eigenvalues.max(),
        }
    }

    /// Cost, row or point of the programme: a number for each baseline, then the further variables.
    fn with_further(&self, of_baselines: f64, further: &[f64]) -> DVector<f64> {
        extended(&DVector::from_element(self.shares.len(), of_baselines), further)
    }

    /// The relaxation from the minimum of a programme; equal shares and the trivial bound where it
    /// has found none.
    fn relaxed(
        &self,
        optimum: Option<Optimum>,
        bound: impl Fn(&Optimum) -> f64,
        trivial: f64,
    ) -> Relaxed {
        let shares_of =
            |x: &DVector<f64>| x.iter().take(self.shares.len()).copied().collect::<Vec<f64>>();
        match optimum {
            Some(optimum) => Relaxed { shares: shares_of(&optimum.x), bound: bound(&optimum) },
            None => Relaxed { shares: shares_of(&self.shares), bound: trivial },
        }
    }
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

/// Problem 1: max t subject to F(s) − t I ⪰ 0. The bound is on λ_min, m².
pub(super) fn largest_smallest_eigenvalue(
    baselines: &Baselines,
    subsets: &[u32],
    information: Information,
) -> Relaxed {
    let start = Start::new(baselines, information);
    let terms = start.terms.clone();
    let programme = ConeProgram {
        cost: start.with_further(0.0, &[-1.0]),
        equality: start.with_further(1.0, &[0.0]),
        inequalities: constraints(baselines, subsets, None),
        blocks: vec![block(Matrix3::zeros(), [terms, vec![-Matrix3::identity()]].concat())],
    };
    let inside = extended(&start.shares, &[start.smallest - 0.1 * start.largest]);
    let bound = |optimum: &Optimum| -optimum.bound * start.scale;
    start.relaxed(programme.minimise(inside), bound, f64::INFINITY)
}

/// Problem 2 for one v: min λ_max(F) − v λ_min(F) as min t₁ − v t₂ subject to t₁ I ⪰ F ⪰ t₂ I.
/// The bound is the minimum itself, in units of the mean squared length.
pub(super) fn least_weighted_spread(baselines: &Baselines, subsets: &[u32], v: f64) -> Relaxed {
    let start = Start::new(baselines, Information::Baselines);
    let (identity, zero) = (Matrix3::identity(), Matrix3::zeros());
    let programme = ConeProgram {
        cost: start.with_further(0.0, &[1.0, -v]),
        equality: start.with_further(1.0, &[0.0, 0.0]),
        inequalities: constraints(baselines, subsets, None),
        blocks: vec![
            block(zero, [negative(&start.terms), vec![identity, zero]].concat()),
            block(zero, [start.terms.clone(), vec![zero, -identity]].concat()),
        ],
    };
    let further = [1.1 * start.largest, start.smallest - 0.1 * start.largest];
    let inside = extended(&start.shares, &further);
    let trivial = programme.cost.dot(&inside);
    let bound = |optimum: &Optimum| programme.cost.dot(&optimum.x);
    start.relaxed(programme.minimise(inside), bound, trivial)
}

/// Problem 2 at once: z = τ s, min k subject to I ⪯ F(z) ⪯ k I. The bound is on κ.
pub(super) fn least_condition(
    baselines: &Baselines,
    subsets: &[u32],
    information: Information,
) -> Relaxed {
    let start = Start::new(baselines, information);
    let count = start.terms.len();
    let (identity, zero) = (Matrix3::identity(), Matrix3::zeros());
    let programme = ConeProgram {
        cost: start.with_further(0.0, &[0.0, 1.0]),
        // Σ z = (n − 1) τ
        equality: start.with_further(1.0, &[1.0 - baselines.antennas as f64, 0.0]),
        inequalities: constraints(baselines, subsets, Some(count)),
        blocks: vec![
            block(-identity, [start.terms.clone(), vec![zero, zero]].concat()),
            block(zero, [negative(&start.terms), vec![zero, identity]].concat()),
        ],
    };
    // Twice the smallest multiple of equal shares that is above I.
    let tau = 2.0 / start.smallest;
    let inside = extended(&(&start.shares * tau), &[tau, 2.0 * start.largest * tau]);
    let optimum = programme.minimise(inside).map(|optimum| {
        // s = z / τ
        let mut x = optimum.x;
        x /= x[count];
        Optimum { x, ..optimum }
    });
    start.relaxed(optimum, |optimum| optimum.bound.max(1.0), 1.0)
}

/// min Σ uᵢ subject to [J(s) eᵢ; eᵢᵀ uᵢ] ⪰ 0, that is uᵢ ≥ (J⁻¹)ᵢᵢ. The bound is on tr J⁻¹, m⁻².
fn least_trace_of_inverse(baselines: &Baselines, subsets: &[u32]) -> Relaxed {
    let start = Start::new(baselines, Information::Attitude);
    let variance_block = |axis: usize| {
        let mut block = block(Matrix3::zeros(), start.terms.clone());
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
        cost: start.with_further(0.0, &[1.0; 3]),
        equality: start.with_further(1.0, &[0.0; 3]),
        inequalities: constraints(baselines, subsets, None),
        blocks: (0..3).map(variance_block).collect(),
    };
    let inside = extended(&start.shares, &[2.0 / start.smallest; 3]);
    let bound = |optimum: &Optimum| optimum.bound.max(0.0) / start.scale;
    start.relaxed(programme.minimise(inside), bound, 0.0)
}

fn negative(terms: &[Matrix3<f64>]) -> Vec<Matrix3<f64>> {
    terms.iter().map(|term| -term).collect()
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
