//! The choice of baselines as published (Rapoport and Tormagov): relax, bisect, round.
//!
//! Problem 1 maximises the smallest eigenvalue of the Gram matrix of shares of baselines; problem 2
//! bisects for its smallest condition number. The shares are rounded to a spanning tree by Prim's
//! algorithm, or to a graph without isolated antenna by an integer programme. The general rounding
//! can fall into parts whose baselines are almost in a plane; [`round_with_guard`] prevents that.

use super::relaxation::{
    Information, largest_smallest_eigenvalue, least_weighted_spread, separate,
};
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
    separate(baselines, graph, |subsets| {
        largest_smallest_eigenvalue(baselines, subsets, Information::Baselines)
    })
    .shares
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
        let next =
            separate(baselines, graph, |subsets| least_weighted_spread(baselines, subsets, v));
        // min(λ_max − v λ_min) > 0: no shares have κ ≤ v
        if next.bound > 0.0 {
            low = v;
        } else {
            high = v;
        }
        shares = next.shares;
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::selection::swap::tests::random_array;
    use crate::selection::{best_by_enumeration, for_each_graph, relax};
    use rand::{RngExt, SeedableRng};
    use rand_xoshiro::Xoshiro256PlusPlus;

    /// Thirty bisections of problem 2 end at the condition number that the one homogenised programme
    /// gives at once.
    #[test]
    fn bisection_and_the_homogenised_programme_agree() {
        let mut random = Xoshiro256PlusPlus::seed_from_u64(40);
        for antennas in [4, 5, 6] {
            let baselines = random_array(antennas, &mut random);
            for graph in [Graph::SpanningTree, Graph::General] {
                let shares = problem_2(&baselines, graph, 30);
                let bisected = condition(&baselines, &shares);
                let at_once = relax(&baselines, graph, Criterion::BaselineCondition);
                assert!((bisected / at_once.bound - 1.0).abs() < 1e-5, "{antennas} {graph:?}");
                let (first, second) =
                    (condition(&baselines, &problem_1(&baselines, graph)), bisected);
                assert!(second <= first * (1.0 + 1e-6), "problem 2 refines problem 1");
            }
        }
    }

    /// The tree and the cover with the smallest sums, against all of them.
    #[test]
    fn rounding_is_exact() {
        let mut random = Xoshiro256PlusPlus::seed_from_u64(41);
        for antennas in [3, 4, 5, 6, 7] {
            let baselines = random_array(antennas, &mut random);
            for _ in 0..20 {
                let shares: Vec<f64> =
                    (0..baselines.pairs.len()).map(|_| random.random_range(0.0..1.0)).collect();
                for weight in [RoundingWeight::Complement, RoundingWeight::InverseSquare] {
                    let weights = weight.of(&shares);
                    let sum = |chosen: &[usize]| chosen.iter().map(|k| weights[*k]).sum::<f64>();
                    for graph in [Graph::SpanningTree, Graph::General] {
                        let mut smallest = f64::INFINITY;
                        for_each_graph(&baselines, graph, |chosen, _| {
                            smallest = smallest.min(sum(chosen));
                        });
                        let rounded = round(&baselines, graph, &shares, weight);
                        assert!((sum(&rounded) - smallest).abs() < 1e-12, "{antennas} {graph:?}");
                    }
                }
            }
        }
    }

    /// A triangle and a separate edge in its plane: the integer programme takes them, the guard not.
    #[test]
    fn the_guard_refuses_parts_in_a_plane() {
        use crate::array::AntennaArray;
        use crate::frames::Vector;
        let positions = vec![
            Vector::new(0.0, 0.0, 0.0),
            Vector::new(1.0, 0.0, 0.0),
            Vector::new(0.0, 1.0, 0.0),
            Vector::new(0.3, 0.2, 1.0),
            Vector::new(0.9, 0.7, 1.000_01),
        ];
        let baselines = Baselines::of(&AntennaArray::new(positions).unwrap()).unwrap();
        let mut shares = vec![0.3; baselines.pairs.len()];
        for (k, pair) in baselines.pairs.iter().enumerate() {
            if [(0, 1), (0, 2), (1, 2), (3, 4)].contains(pair) {
                shares[k] = 0.9;
            }
        }
        let criterion = Criterion::BaselineCondition;
        let weight = RoundingWeight::Complement;
        let plain = round(&baselines, Graph::General, &shares, weight);
        assert_eq!(baselines.pairs_of(&plain), [(0, 1), (0, 2), (1, 2), (3, 4)]);
        assert!(baselines.value(&plain, criterion) > 1e9);
        let guarded = round_with_guard(&baselines, Graph::General, &shares, weight, criterion);
        assert!(baselines.value(&guarded, criterion) < 100.0);
        let best = best_by_enumeration(&baselines, Graph::General, criterion);
        assert!(baselines.value(&best, criterion) <= baselines.value(&guarded, criterion));
    }
}
