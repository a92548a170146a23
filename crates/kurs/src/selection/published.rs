//! The choice of baselines as published (Rapoport and Tormagov): relax, bisect, round.
//!
//! Problem 1 maximises the smallest eigenvalue of the Gram matrix of shares of baselines; problem 2
//! bisects for its smallest condition number. The shares are rounded to a spanning tree by Prim's
//! algorithm, or to a graph without isolated antenna by an integer programme. The general rounding
//! can fall into parts whose baselines are almost in a plane; [`round_with_guard`] prevents that.

use super::relaxation::{Information, largest_smallest_eigenvalue, least_weighted_spread};
use super::{Baselines, Criterion, Graph};

/// How a share becomes the weight of a baseline; a small weight is taken first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum RoundingWeight {
    /// w = 1 − s.
    #[default]
    Complement,
    /// w = 1/(s + ¼)².
    InverseSquare,
}

impl RoundingWeight {
    fn of(self, shares: &[f64]) -> Vec<f64> {
        let weight = |s: &f64| match self {
            Self::Complement => 1.0 - s,
            Self::InverseSquare => (s + 0.25).powi(-2),
        };
        shares.iter().map(weight).collect()
    }
}

/// Problem 1: shares of the baselines that maximise λ_min(F).
#[must_use]
pub fn problem_1(baselines: &Baselines, graph: Graph) -> Vec<f64> {
    largest_smallest_eigenvalue(baselines, graph, Information::Baselines).shares
}

/// Problem 2: shares of the baselines that minimise κ(F), by `steps` bisections of v from
/// κ_lo = 1 and κ_hi = κ at the solution of problem 1; the shares of the last step.
#[must_use]
pub fn problem_2(baselines: &Baselines, graph: Graph, steps: usize) -> Vec<f64> {
    let mut shares = problem_1(baselines, graph);
    let mut low = 1.0;
    let mut high = condition(baselines, &shares);
    for _ in 0..steps {
        let v = 0.5 * (low + high);
        let (next, value) = least_weighted_spread(baselines, graph, v);
        // min(λ_max − v λ_min) > 0: no shares have κ ≤ v
        if value > 0.0 {
            low = v;
        } else {
            high = v;
        }
        shares = next;
    }
    shares
}

/// κ of the Gram matrix of shares.
fn condition(baselines: &Baselines, shares: &[f64]) -> f64 {
    let gram = baselines
        .scaled_m
        .iter()
        .zip(shares)
        .fold(super::Gram::default(), |sum, (l, s)| sum + super::Gram::of(l, *s));
    Criterion::BaselineCondition.value(gram.eigenvalues())
}

/// Rounds shares to a set of baselines of this kind; every baseline for [`Graph::AllPairs`].
#[must_use]
pub fn round(
    baselines: &Baselines,
    graph: Graph,
    shares: &[f64],
    weight: RoundingWeight,
) -> Vec<usize> {
    let weights = weight.of(shares);
    match graph {
        Graph::SpanningTree => minimum_spanning_tree(baselines, &weights),
        Graph::General => minimum_cover(baselines, &weights),
        Graph::AllPairs => (0..weights.len()).collect(),
    }
}

/// As [`round`], but also to a tree, and the better of both by `criterion`: the integer programme
/// looks only at weights, and may choose separate parts that lie almost in a plane.
#[must_use]
pub fn round_with_guard(
    baselines: &Baselines,
    graph: Graph,
    shares: &[f64],
    weight: RoundingWeight,
    criterion: Criterion,
) -> Vec<usize> {
    let cost = |chosen: &[usize]| criterion.cost_of(&baselines.gram(chosen));
    let rounded = round(baselines, graph, shares, weight);
    let tree = round(baselines, Graph::SpanningTree, shares, weight);
    if graph == Graph::General && cost(&tree) < cost(&rounded) { tree } else { rounded }
}

/// Spanning tree with the smallest sum of weights, by Prim's algorithm; indices ascending.
fn minimum_spanning_tree(baselines: &Baselines, weights: &[f64]) -> Vec<usize> {
    let mut reached = 1_u32;
    let mut chosen = Vec::with_capacity(baselines.antennas - 1);
    while chosen.len() + 1 < baselines.antennas {
        let leaving = (0..weights.len()).filter(|&k| {
            let (i, j) = baselines.pairs[k];
            (reached >> i & 1) != (reached >> j & 1)
        });
        let Some(nearest) = leaving.min_by(|a, b| weights[*a].total_cmp(&weights[*b])) else {
            break;
        };
        let (i, j) = baselines.pairs[nearest];
        reached |= 1 << i | 1 << j;
        chosen.push(nearest);
    }
    chosen.sort_unstable();
    chosen
}

/// n−1 baselines that touch every antenna with the smallest sum of weights: the integer programme,
/// by branch and bound; indices ascending.
fn minimum_cover(baselines: &Baselines, weights: &[f64]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..weights.len()).collect();
    order.sort_by(|a, b| weights[*a].total_cmp(&weights[*b]));
    let mut search = CoverSearch {
        baselines,
        weights,
        order,
        // A tree covers too.
        best: minimum_spanning_tree(baselines, weights),
        best_sum: f64::INFINITY,
    };
    search.best_sum = search.best.iter().map(|k| weights[*k]).sum();
    search.branch(&mut Vec::new(), 0, 0, 0.0);
    search.best.sort_unstable();
    search.best
}

/// Branch and bound of the integer programme; sets of baselines are bit masks.
struct CoverSearch<'a> {
    baselines: &'a Baselines,
    weights: &'a [f64],
    /// Baselines by growing weight.
    order: Vec<usize>,
    best: Vec<usize>,
    best_sum: f64,
}

impl CoverSearch<'_> {
    /// Branches on the baseline that covers the first uncovered antenna; `closed` are the baselines
    /// already chosen or excluded.
    fn branch(&mut self, chosen: &mut Vec<usize>, covered: u32, closed: u128, sum: f64) {
        let left = self.baselines.antennas - 1 - chosen.len();
        // The cheapest baselines still open bound what the rest costs.
        let open = self.order.iter().filter(|k| closed >> **k & 1 == 0);
        let cheapest: Vec<usize> = open.take(left).copied().collect();
        let bound = sum + cheapest.iter().map(|k| self.weights[*k]).sum::<f64>();
        if cheapest.len() < left || bound >= self.best_sum {
            return;
        }
        let Some(antenna) = (0..self.baselines.antennas).find(|v| covered >> v & 1 == 0) else {
            // Everything is covered: the bound is reached.
            self.best_sum = bound;
            self.best = [chosen.as_slice(), &cheapest].concat();
            return;
        };
        let mut closed = closed;
        for place in 0..self.order.len() {
            let k = self.order[place];
            let (i, j) = self.baselines.pairs[k];
            if left > 0 && closed >> k & 1 == 0 && (i == antenna || j == antenna) {
                closed |= 1 << k;
                chosen.push(k);
                self.branch(chosen, covered | 1 << i | 1 << j, closed, sum + self.weights[k]);
                chosen.pop();
            }
        }
    }
}
