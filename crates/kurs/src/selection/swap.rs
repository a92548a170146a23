//! Local search: exchange one baseline for another as long as that helps, from many random starts.

use rand::RngExt;
use rand_xoshiro::Xoshiro256PlusPlus;

use super::gram::Gram;
use super::parts::Parts;
use super::{Baselines, Criterion, Graph};

/// A smaller improvement than this (relative) is rounding; it could go round in circles.
const MIN_IMPROVEMENT: f64 = 1e-12;

/// The best set that edge swaps reach from `starts` random spanning trees.
#[must_use]
pub fn search(
    baselines: &Baselines,
    graph: Graph,
    criterion: Criterion,
    starts: usize,
    random: &mut Xoshiro256PlusPlus,
) -> Vec<usize> {
    let mut best = (f64::INFINITY, random_tree(baselines, random));
    for _ in 0..starts {
        let reached = descend(baselines, graph, criterion, random_tree(baselines, random));
        let cost = criterion.cost_of(&baselines.gram(&reached));
        if cost < best.0 {
            best = (cost, reached);
        }
    }
    best.1
}

/// Exchanges each baseline in turn for the one that serves best in its place, until no exchange
/// helps.
///
/// `chosen` is an admissible set of `graph`, and so is the result (ascending indices).
#[must_use]
pub fn descend(
    baselines: &Baselines,
    graph: Graph,
    criterion: Criterion,
    mut chosen: Vec<usize>,
) -> Vec<usize> {
    let mut cost = criterion.cost_of(&baselines.gram(&chosen));
    let mut kept = 0;
    // Each exchange lowers the cost, so no set comes twice.
    for place in (0..chosen.len()).cycle() {
        match best_exchange(baselines, graph, criterion, &chosen, place, cost) {
            Some((entering, lower)) => {
                chosen[place] = entering;
                cost = lower;
                kept = 0;
            }
            None => kept += 1,
        }
        if kept == chosen.len() {
            break;
        }
    }
    chosen.sort_unstable();
    chosen
}

/// The baseline that lowers the cost most in this place, with the cost; `None` if none lowers it.
fn best_exchange(
    baselines: &Baselines,
    graph: Graph,
    criterion: Criterion,
    chosen: &[usize],
    place: usize,
    cost: f64,
) -> Option<(usize, f64)> {
    let mut rest = Gram::default();
    let mut parts = Parts::none(graph, baselines.antennas);
    for &k in chosen.iter().filter(|k| **k != chosen[place]) {
        rest = rest + baselines.grams[k];
        parts = parts.with(baselines.pairs[k]);
    }
    let mut best = None;
    let mut limit = cost * (1.0 - MIN_IMPROVEMENT);
    for (entering, &pair) in baselines.pairs.iter().enumerate() {
        if !parts.is_completed_by(pair) || chosen.contains(&entering) {
            continue;
        }
        let gram = rest + baselines.grams[entering];
        // Eigenvalues only for the few that may be better.
        if !criterion.can_be_below(limit, &gram) {
            continue;
        }
        let cost = criterion.cost_of(&gram);
        if cost < limit {
            limit = cost;
            best = Some((entering, cost));
        }
    }
    best
}

/// A random spanning tree: baselines in random order, each taken if it joins two parts.
fn random_tree(baselines: &Baselines, random: &mut Xoshiro256PlusPlus) -> Vec<usize> {
    let mut order: Vec<usize> = (0..baselines.pairs.len()).collect();
    let mut parts = Parts::none(Graph::SpanningTree, baselines.antennas);
    let mut chosen = Vec::with_capacity(baselines.antennas - 1);
    for next in 0..order.len() {
        order.swap(next, random.random_range(next..baselines.pairs.len()));
        let pair = baselines.pairs[order[next]];
        if parts.admits(pair) {
            parts = parts.with(pair);
            chosen.push(order[next]);
        }
    }
    chosen.sort_unstable();
    chosen
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::array::AntennaArray;
    use crate::frames::Vector;
    use crate::selection::best_by_enumeration;
    use rand::SeedableRng;

    pub(crate) fn random_array(antennas: usize, random: &mut Xoshiro256PlusPlus) -> Baselines {
        let mut coordinate = || random.random_range(-1.0..1.0);
        let positions =
            (0..antennas).map(|_| Vector::new(coordinate(), coordinate(), coordinate())).collect();
        Baselines::of(&AntennaArray::new(positions).unwrap()).unwrap()
    }

    /// Two hundred starts find every optimum up to six antennas.
    #[test]
    fn swaps_reach_the_optimum_of_small_arrays() {
        let mut random = Xoshiro256PlusPlus::seed_from_u64(20);
        for antennas in [4, 5, 6] {
            for _ in 0..10 {
                let baselines = random_array(antennas, &mut random);
                for graph in [Graph::SpanningTree, Graph::General] {
                    for criterion in Criterion::ALL {
                        let cost = |set: &[usize]| criterion.cost(baselines.value(set, criterion));
                        let exact = cost(&best_by_enumeration(&baselines, graph, criterion));
                        let found = cost(&search(&baselines, graph, criterion, 200, &mut random));
                        assert!(
                            (found / exact - 1.0).abs() < 1e-9,
                            "{antennas} {graph:?} {criterion:?}"
                        );
                    }
                }
            }
        }
    }

    #[test]
    fn a_descent_ends_where_no_exchange_helps() {
        let mut random = Xoshiro256PlusPlus::seed_from_u64(21);
        let baselines = random_array(10, &mut random);
        for criterion in Criterion::ALL {
            let start = random_tree(&baselines, &mut random);
            let before = criterion.cost_of(&baselines.gram(&start));
            let end = descend(&baselines, Graph::SpanningTree, criterion, start);
            let after = criterion.cost_of(&baselines.gram(&end));
            assert!(after <= before);
            // An independent look at every exchange.
            for place in 0..end.len() {
                for entering in 0..baselines.pairs.len() {
                    let mut other = end.clone();
                    other[place] = entering;
                    let parts = other
                        .iter()
                        .fold(Parts::none(Graph::SpanningTree, baselines.antennas), |parts, k| {
                            parts.with(baselines.pairs[*k])
                        });
                    let connected = (1..10).all(|antenna| !parts.admits((0, antenna)));
                    if connected {
                        let cost = criterion.cost_of(&baselines.gram(&other));
                        assert!(cost >= after * (1.0 - 1e-11), "{criterion:?}: {cost} {after}");
                    }
                }
            }
        }
    }
}
