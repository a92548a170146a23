//! Every admissible graph, by backtracking over the baselines in order; the Gram matrix grows with
//! the choice.

use super::gram::Gram;
use super::parts::Parts;
use super::swap::descend;
use super::{Baselines, Criterion, Graph, MAX_ANTENNAS};

/// Room for the rounding of sums of squared lengths.
const TRACE_SLACK: f64 = 1.0 - 1e-9;

/// The recursion over the baselines, with what stays the same in it.
struct Enumeration<'a, Visit> {
    baselines: &'a Baselines,
    /// Takes a set and its Gram matrix; returns the trace that later sets must have to matter.
    visit: Visit,
    chosen: [usize; MAX_ANTENNAS],
    size: usize,
    /// `longest_m2[k][r]`: sum of the r largest squared lengths from baseline k on.
    longest_m2: Vec<Vec<f64>>,
    least_trace_m2: f64,
    /// Branches that may still be entered.
    budget: u64,
}

impl<Visit: FnMut(&[usize], &Gram) -> f64> Enumeration<'_, Visit> {
    /// Looks at every set that can matter; false if the budget of branches ended before.
    fn run(baselines: &Baselines, graph: Graph, budget: u64, visit: Visit) -> bool {
        let mut enumeration = Enumeration {
            baselines,
            visit,
            chosen: [0; MAX_ANTENNAS],
            size: baselines.antennas - 1,
            longest_m2: longest_sums(baselines),
            least_trace_m2: 0.0,
            budget,
        };
        enumeration.extend(0, 0, &Parts::none(graph, baselines.antennas), &Gram::default());
        enumeration.budget > 0
    }

    /// Adds each baseline from index `start` on that keeps the graph admissible.
    fn extend(&mut self, start: usize, taken: usize, parts: &Parts, gram: &Gram) {
        let left = self.size - taken;
        let pairs = &self.baselines.pairs;
        let mut first_antenna = usize::MAX;
        for k in start..=pairs.len() - left {
            let pair = pairs[k];
            if pair.0 != first_antenna {
                first_antenna = pair.0;
                if !parts.can_be_completed(first_antenna, left) {
                    return;
                }
            }
            if !(if left > 1 { parts.admits(pair) } else { parts.is_completed_by(pair) }) {
                continue;
            }
            self.chosen[taken] = k;
            let sum = *gram + self.baselines.grams[k];
            if left == 1 {
                self.least_trace_m2 = (self.visit)(&self.chosen[..self.size], &sum);
            } else if sum.trace() + self.longest_m2[k + 1][left - 1] >= self.least_trace_m2 {
                self.budget = self.budget.saturating_sub(1);
                if self.budget == 0 {
                    return;
                }
                self.extend(k + 1, taken + 1, &parts.with(pair), &sum);
            }
        }
    }
}

/// `[k][r]`: sum of the r largest squared lengths from baseline k on, r below the antenna count.
fn longest_sums(baselines: &Baselines) -> Vec<Vec<f64>> {
    let sums_from = |k: usize| {
        let mut squared: Vec<f64> = baselines.grams[k..].iter().map(Gram::trace).collect();
        squared.sort_by(|a, b| b.total_cmp(a));
        let mut sum = 0.0;
        let longest = squared.iter().take(baselines.antennas).map(|length| {
            sum += length;
            sum
        });
        core::iter::once(0.0).chain(longest).collect()
    };
    (0..baselines.grams.len()).map(sums_from).collect()
}

/// Calls `visit` with every admissible set of baselines (ascending indices) and its Gram matrix, in
/// lexicographic order.
///
/// The number of sets grows as n^(n−2) for trees and as C(n(n−1)/2, n−1) in general.
pub fn for_each_graph(baselines: &Baselines, graph: Graph, mut visit: impl FnMut(&[usize], &Gram)) {
    if graph == Graph::AllPairs {
        let every = baselines.every();
        visit(&every, &baselines.gram(&every));
    } else {
        Enumeration::run(baselines, graph, u64::MAX, |chosen, gram| {
            visit(chosen, gram);
            0.0
        });
    }
}

/// The admissible set with the smallest cost: every set is looked at, or belongs to a branch whose
/// baselines are too short for any of its sets to be better than one already found.
#[must_use]
pub fn best_by_enumeration(
    baselines: &Baselines,
    graph: Graph,
    criterion: Criterion,
) -> Vec<usize> {
    if graph == Graph::AllPairs {
        return baselines.every();
    }
    // A good set at the start rules out many: the star at antenna 0, improved by edge swaps.
    let star = (0..baselines.antennas - 1).collect();
    let start = descend(baselines, graph, criterion, star);
    branch_and_bound(baselines, graph, criterion, start, u64::MAX).0
}

/// The best set found from `best` on with at most `budget` branches, and whether that is all: then
/// no set is better.
pub(super) fn branch_and_bound(
    baselines: &Baselines,
    graph: Graph,
    criterion: Criterion,
    mut best: Vec<usize>,
    budget: u64,
) -> (Vec<usize>, bool) {
    let mut best_cost = criterion.cost_of(&baselines.gram(&best));
    let complete = Enumeration::run(baselines, graph, budget, |chosen, gram| {
        // Eigenvalues only for the few that may be better.
        if criterion.can_be_below(best_cost, gram) {
            let cost = criterion.cost_of(gram);
            if cost < best_cost {
                best_cost = cost;
                best = chosen.to_vec();
            }
        }
        criterion.least_trace(best_cost) * TRACE_SLACK
    });
    (best, complete)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::array::AntennaArray;
    use crate::frames::Vector;

    /// Antennas on a curve that no plane contains.
    fn array(antennas: usize) -> Baselines {
        let position = |i: usize| {
            let t = i as f64;
            Vector::new(t, t * t / 4.0, (1.7 * t).sin())
        };
        Baselines::of(&AntennaArray::new((0..antennas).map(position).collect()).unwrap()).unwrap()
    }

    fn count(antennas: usize, graph: Graph) -> u64 {
        let mut graphs = 0;
        for_each_graph(&array(antennas), graph, |_, _| graphs += 1);
        graphs
    }

    /// Cayley: n^(n−2) trees; graphs without isolated vertex as counted in the published question.
    #[test]
    fn published_counts() {
        let subsets = |n: u64, k: u64| (0..k).fold(1, |c, i| c * (n - i) / (i + 1));
        assert_eq!(subsets(28, 7), 1_184_040);
        assert_eq!(count(8, Graph::SpanningTree), 262_144);
        assert_eq!(count(8, Graph::General), 427_260);
        for (antennas, trees, general) in
            [(2, 1, 1), (3, 3, 3), (4, 16, 16), (5, 125, 135), (6, 1296, 1581), (7, 16807, 23604)]
        {
            assert_eq!(count(antennas, Graph::SpanningTree), trees, "trees of {antennas}");
            assert_eq!(count(antennas, Graph::General), general, "graphs of {antennas}");
            assert_eq!(count(antennas, Graph::AllPairs), 1);
        }
    }

    /// Sets are distinct, ascending, and of the kind they claim, by an independent check.
    #[test]
    fn every_set_is_admissible() {
        let baselines = array(6);
        for graph in [Graph::SpanningTree, Graph::General] {
            let mut previous: Vec<usize> = Vec::new();
            for_each_graph(&baselines, graph, |chosen, gram| {
                assert!(previous.as_slice() < chosen, "lexicographic and distinct");
                previous = chosen.to_vec();
                let pairs = baselines.pairs_of(chosen);
                let mut label: Vec<usize> = (0..6).collect();
                for (i, j) in &pairs {
                    let (from, to) = (label[*i], label[*j]);
                    label.iter_mut().filter(|l| **l == from).for_each(|l| *l = to);
                }
                let touched = (0..6).all(|v| pairs.iter().any(|(i, j)| *i == v || *j == v));
                let connected = label.iter().all(|l| *l == label[0]);
                assert!(if graph == Graph::General { touched } else { connected }, "{pairs:?}");
                let again = baselines.gram(chosen);
                assert!((again.matrix() - gram.matrix()).norm() < 1e-12 * again.matrix().norm());
            });
        }
    }

    /// The shortcut by bounds changes nothing.
    #[test]
    fn the_best_is_the_best_of_all() {
        let baselines = array(6);
        for criterion in Criterion::ALL {
            for graph in [Graph::SpanningTree, Graph::General, Graph::AllPairs] {
                let best = best_by_enumeration(&baselines, graph, criterion);
                let cost = |chosen: &[usize]| criterion.cost(baselines.value(chosen, criterion));
                let mut smallest = f64::INFINITY;
                for_each_graph(&baselines, graph, |chosen, _| {
                    smallest = smallest.min(cost(chosen));
                });
                assert!((cost(&best) / smallest - 1.0).abs() < 1e-11, "{criterion:?} {graph:?}");
            }
        }
    }
}
