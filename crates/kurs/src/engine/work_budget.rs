//! One budget for all searches of an epoch, in counted work and never in seconds: the same input gives the same rows
//! on any machine.
//!
//! A node of each search and its model count as what they take on the reference machine. A search may open as many
//! nodes as a quarter of what is left allows, that of an array a half, the one over the sphere three quarters: an epoch
//! whose integers find no end still has its trials without a suspect, and they have an end together.

use crate::solution::Reason;

/// What the searches of an epoch may take together. With what is not counted the worst epoch of four antennas, 30
/// satellites and two bands under branches takes 15 to 19 ms
/// (`cargo run --release -p kurs-sim --example epoch_cost scenarios/canopy-array.toml 600`).
const EPOCH_NS: u64 = 13_000_000;
/// Below, no further search is begun.
const MIN_NS: u64 = EPOCH_NS / 32;
/// Of the decorrelation, for each ambiguity to the third power.
const DECORRELATION_NS: f64 = 0.4;
/// Of a trial beside its search (float and fixed solution, checks), for each ambiguity to the second power: so large
/// that the worst epoch above stays below 20 ms.
const TRIAL_NS: f64 = 20.0;

/// The searches, each with nodes of its own price.
#[derive(Debug, Clone, Copy)]
pub(super) enum Search {
    /// Nothing is known of the geometry.
    Free,
    /// One length is.
    Length,
    /// The array is.
    Array,
    /// One length is, and no code: over the sphere.
    Sphere,
}

impl Search {
    /// Of a node, by `cargo bench -p kurs --bench ambiguity`; of an array, of the work that it counts in.
    const fn node_ns(self) -> u64 {
        match self {
            Self::Free => 30,
            Self::Length => 250,
            Self::Array => 100,
            Self::Sphere => 90,
        }
    }

    /// More nodes than this hardly help; those of an array are half of the work of an epoch: with 2 ms instead of 6.5
    /// four antennas with G1 and E1 and phases of 3 mm fix 3 of 121 epochs instead of 81.
    const fn most_nodes(self) -> u64 {
        match self {
            Self::Free => 1_000_000,
            Self::Length => 100_000,
            Self::Array => 65_000,
            Self::Sphere => 500_000,
        }
    }
}

/// What is left of the work of an epoch.
#[derive(Debug, Clone, Copy)]
pub(super) struct WorkBudget {
    left_ns: u64,
}

impl Default for WorkBudget {
    fn default() -> Self {
        Self { left_ns: EPOCH_NS }
    }
}

impl WorkBudget {
    /// Whether no further search is worth its begin.
    pub(super) fn is_spent(self) -> bool {
        self.left_ns < MIN_NS
    }

    /// Nodes that the next search may open.
    ///
    /// # Errors
    ///
    /// [`Reason::Budget`] if the work of the epoch is done.
    pub(super) fn nodes(self, search: Search) -> Result<usize, Reason> {
        if self.is_spent() {
            return Err(Reason::Budget);
        }
        let share_ns = match search {
            Search::Sphere => self.left_ns / 4 * 3,
            Search::Array => self.left_ns / 2,
            _ => self.left_ns / 4,
        };
        let nodes = (share_ns / search.node_ns()).min(search.most_nodes());
        usize::try_from(nodes).map_err(|_| Reason::Budget)
    }

    /// Takes off what a search with so many ambiguities has taken.
    pub(super) fn spend(&mut self, search: Search, nodes: usize, ambiguities: usize) {
        let n = ambiguities as f64;
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // some milliseconds
        let model_ns = (TRIAL_NS * n.powi(2) + DECORRELATION_NS * n.powi(3)) as u64;
        let nodes_ns = (nodes as u64).saturating_mul(search.node_ns());
        self.left_ns = self.left_ns.saturating_sub(model_ns.saturating_add(nodes_ns));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn searches_without_an_end_have_one_together() {
        let mut budget = WorkBudget::default();
        let mut nodes_ns = 0;
        for search in [Search::Array, Search::Length, Search::Free].into_iter().cycle() {
            let Ok(nodes) = budget.nodes(search) else { break };
            nodes_ns += nodes as u64 * search.node_ns();
            budget.spend(search, nodes, 20);
        }
        assert!(budget.is_spent());
        assert!((EPOCH_NS * 9 / 10..=EPOCH_NS).contains(&nodes_ns), "{nodes_ns} ns");
    }

    #[test]
    fn large_models_cost_what_they_take() {
        let mut budget = WorkBudget::default();
        let trials = core::iter::from_fn(|| {
            budget.nodes(Search::Free).ok()?;
            budget.spend(Search::Free, 0, 120);
            Some(())
        });
        // 0.98 ms each
        assert_eq!(trials.count(), 13);
    }
}
