//! What a growing set of baselines connects, in bit masks.

use super::{Graph, MAX_ANTENNAS, Pair};

/// What the baselines chosen so far connect.
#[derive(Clone, Copy)]
pub(super) struct Parts {
    graph: Graph,
    /// One bit for each antenna of the array.
    all: u16,
    /// Antennas that some chosen baseline touches, one bit each.
    covered: u16,
    /// For each antenna the bits of the antennas that it is connected with.
    connected: [u16; MAX_ANTENNAS],
}

impl Parts {
    /// No baseline yet: each antenna is alone.
    pub(super) fn none(graph: Graph, antennas: usize) -> Self {
        let connected = core::array::from_fn(|antenna| 1 << antenna);
        Self { graph, all: u16::MAX >> (MAX_ANTENNAS - antennas), covered: 0, connected }
    }

    /// Whether an admissible graph can have this baseline besides the chosen ones.
    #[inline]
    pub(super) fn admits(&self, (i, j): Pair) -> bool {
        self.graph != Graph::SpanningTree || self.connected[i] >> j & 1 == 0
    }

    /// Whether this baseline as the last one makes the graph admissible.
    #[inline]
    pub(super) fn is_completed_by(&self, (i, j): Pair) -> bool {
        if self.graph == Graph::SpanningTree {
            self.connected[i] >> j & 1 == 0
        } else {
            self.covered | 1 << i | 1 << j == self.all
        }
    }

    /// The parts after this baseline is added.
    #[inline]
    pub(super) fn with(&self, (i, j): Pair) -> Self {
        let mut joined = *self;
        joined.covered |= 1 << i | 1 << j;
        if self.graph == Graph::SpanningTree {
            let union = self.connected[i] | self.connected[j];
            for (antenna, connected) in joined.connected.iter_mut().enumerate() {
                *connected = if union >> antenna & 1 == 1 { union } else { *connected };
            }
        }
        joined
    }

    /// Whether `left` more baselines, all between antennas `from` and above, can still complete an
    /// admissible graph: no finished part is left alone, and enough ends are left for all antennas.
    #[inline]
    pub(super) fn can_be_completed(&self, from: usize, left: usize) -> bool {
        if self.graph == Graph::SpanningTree {
            self.connected[..from].iter().all(|connected| connected >> from != 0)
        } else {
            let alone = !self.covered & self.all;
            alone & ((1 << from) - 1) == 0 && alone.count_ones() as usize <= 2 * left
        }
    }
}
