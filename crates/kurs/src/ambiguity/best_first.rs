//! Search for integers and constrained reals together, most promising branch first.
//!
//! ```text
//! min over integer z and admissible x of   |â − z|²_Qa  +  |x̌(z) − x|²_Qx|a
//! ```
//!
//! where `x` is not free: a baseline of known length, or the axes of a rigid body. The integers
//! are fixed one after the other, in the decorrelated order. When those from level `k` on are
//! fixed, let the others be real: then the reals have a conditional estimate `x̌ₖ` and covariance
//! `Qₖ`, and
//!
//! ```text
//! Σᵢ wᵢ²/dᵢ (i >= k)  +  min over admissible x of |x̌ₖ − x|²_Qₖ
//! x̌ₖ = x̂ − Σᵢ γᵢ wᵢ (i >= k),     Qₖ = Q_x|a + Σᵢ γᵢ γᵢᵀ dᵢ (i < k)
//! ```
//!
//! is the exact minimum of this relaxation: a lower bound for all integers below, and the cost
//! itself once every integer is fixed. It grows from level to level. Branches are opened in the
//! order of their bounds, so that candidates come out in the order of their costs, and the first
//! is proven to be the best. The constraint prunes as soon as the integers determine the reals.
//!
//! The bound of the constraint costs far more than the sum. It is asked for only when a branch has
//! its turn, not while all others lie far behind, and not where the reals are hardly better known
//! than when it was asked for last: the many integers of a strong model follow from the first few.

use std::{cmp::Ordering, collections::BinaryHeap};

use nalgebra::{SMatrix, SVector};

use super::{
    AmbiguityError, MixedFloat,
    decorrelate::Decorrelation,
    search::{check_horizon, whole_and_fraction},
};

/// Branches that a search opens by default before it gives up: some tens of milliseconds.
pub(super) const DEFAULT_NODE_BUDGET: usize = 100_000;
/// A branch that is cheaper than all others by more than this is opened without its constraint: the
/// misfit of the right one is smaller.
const CLEAR_LEAD: f64 = 40.0;
/// The constraint is asked for again when a variance of the reals has come down to this share.
const BETTER_KNOWN: f64 = 0.7;

/// The constraint on `P` reals, level by level; level `k` leaves `k` ambiguities real.
pub(super) trait Constraint<const P: usize> {
    /// What makes a good start for the bounds of the branches below.
    type Multiplier: Copy;

    /// Work of opening a branch.
    const BRANCH_WORK: usize;
    /// Work of a bound that has a start.
    const BOUND_WORK: usize;

    /// Whether the constraint can say more at this level than at those before, see [`informative`].
    fn is_informative(&self, level: usize) -> bool;

    /// A lower bound of `min |x̌ₖ − x|²_Qₖ`, tight without a `start`.
    fn bound(
        &mut self,
        level: usize,
        reals: &SVector<f64, P>,
        start: Option<Self::Multiplier>,
    ) -> (f64, Self::Multiplier);

    /// `min |x̌₀ − x|²_Q₀`, or a better lower bound if that is already above `enough`; and the work of finding it.
    ///
    /// # Errors
    ///
    /// If it cannot be found.
    fn cost(
        &mut self,
        reals: &SVector<f64, P>,
        multiplier: Self::Multiplier,
        enough: f64,
    ) -> Result<(Cost, usize), AmbiguityError>;
}

/// For `Q₀ … Qₙ`, the levels at which the reals are better known than at the last such level.
pub(super) fn informative<const P: usize>(covariances: &[SMatrix<f64, P, P>]) -> Vec<bool> {
    let mut levels = vec![false; covariances.len()];
    let Some(root) = covariances.last() else { return levels };
    let mut known = root.diagonal();
    for (level, covariance) in covariances.iter().enumerate().rev() {
        let variances = covariance.diagonal();
        levels[level] = variances.iter().zip(&known).any(|(now, then)| *now < BETTER_KNOWN * then);
        if levels[level] {
            known = variances;
        }
    }
    levels
}

/// What is known of a cost.
#[derive(Debug, Clone, Copy)]
pub(super) enum Cost {
    /// The cost itself.
    Exact(f64),
    /// It is at least this.
    AtLeast(f64),
}

/// How far a search goes.
#[derive(Debug, Clone, Copy)]
pub(super) struct Extent {
    /// Candidates wanted.
    pub count: usize,
    /// Candidates that cost more than the best by more than this are not.
    pub horizon: f64,
    /// Work before [`AmbiguityError::BudgetExceeded`].
    pub work_budget: usize,
}

/// Integers found, and the reals that go with them before the constraint.
pub(super) struct Leaf<const P: usize> {
    /// In the order of the float ambiguities.
    pub integers: Vec<i64>,
    /// The least cost with these integers.
    pub cost: f64,
    /// `x̌(z)`.
    pub reals: SVector<f64, P>,
}

/// A mixed float solution seen from its decorrelated ambiguities.
pub(super) struct Levels<'a, const P: usize> {
    decorrelation: &'a Decorrelation,
    /// Whole cycles taken off the float ambiguities.
    whole: Vec<i64>,
    /// `ẑ`.
    float: Vec<f64>,
    /// `γₖ`.
    gains: Vec<SVector<f64, P>>,
    /// `x̂`.
    reals: SVector<f64, P>,
}

impl<'a, const P: usize> Levels<'a, P> {
    /// `float` has `P` reals; `decorrelation` is that of its ambiguities.
    pub(super) fn new(
        decorrelation: &'a Decorrelation,
        float: &MixedFloat,
    ) -> Result<Self, AmbiguityError> {
        let n = float.checked_dimension(P)?;
        let (whole, fraction) = whole_and_fraction(float.ambiguities.as_slice(), n)?;
        let mut decorrelated = Vec::with_capacity(n);
        decorrelation.decorrelated(&fraction, &mut decorrelated);
        let gains = decorrelation.gains(&float.cross_covariance);
        let gains = gains.column_iter().map(|gain| gain.fixed_rows::<P>(0).into_owned()).collect();
        let reals = float.reals_m.fixed_rows::<P>(0).into_owned();
        Ok(Self { decorrelation, whole, float: decorrelated, gains, reals })
    }

    /// `Q₀ … Qₙ` from `Q₀ = Q_x|a`:   `Qₖ₊₁ = Qₖ + γₖ γₖᵀ dₖ`.
    pub(super) fn covariances(
        &self,
        conditional: SMatrix<f64, P, P>,
    ) -> impl Iterator<Item = SMatrix<f64, P, P>> {
        let mut covariance = conditional;
        let growth = self.gains.iter().zip(self.decorrelation.conditional_variances());
        std::iter::once(conditional).chain(growth.map(move |(gain, &variance)| {
            covariance += gain * gain.transpose() * variance;
            covariance
        }))
    }
}

/// The memory of the search.
#[derive(Debug, Clone)]
pub(super) struct BestFirst<const P: usize, M> {
    nodes: Vec<Node<P, M>>,
    queue: BinaryHeap<Queued>,
    work: usize,
}

impl<const P: usize, M> Default for BestFirst<P, M> {
    fn default() -> Self {
        Self { nodes: Vec::new(), queue: BinaryHeap::new(), work: 0 }
    }
}

impl<const P: usize, M: Copy> BestFirst<P, M> {
    /// The cheapest integers, cheapest first, and what every other vector costs at least.
    pub(super) fn cheapest<C: Constraint<P, Multiplier = M>>(
        &mut self,
        levels: &Levels<P>,
        constraint: &mut C,
        extent: Extent,
    ) -> Result<(Vec<Leaf<P>>, f64), AmbiguityError> {
        check_horizon(extent.horizon)?;
        self.nodes.clear();
        self.queue.clear();
        self.work = 0;
        let n = levels.float.len();
        let (bound, multiplier) = constraint.bound(n, &levels.reals, None);
        self.push(Node::root(n, bound, levels.reals, multiplier));
        // A candidate takes some work.
        let mut leaves: Vec<Leaf<P>> = Vec::with_capacity(extent.count.min(extent.work_budget));
        loop {
            // The children of a node are without number: the queue is never empty.
            let Some(Queued { bound, node }) = self.queue.pop() else {
                return Ok((leaves, f64::INFINITY));
            };
            let end = leaves.first().map_or(f64::INFINITY, |best| best.cost + extent.horizon);
            if leaves.len() == extent.count || bound > end {
                return Ok((leaves, bound));
            }
            match self.nodes[node].stage {
                Stage::Unasked
                    if self.next_bound() - bound <= CLEAR_LEAD
                        && constraint.is_informative(self.nodes[node].free) =>
                {
                    self.ask(constraint, node);
                }
                Stage::Unasked | Stage::Children { .. } => {
                    let opened = self.nodes.len();
                    let left = extent.work_budget.saturating_sub(self.work);
                    self.open(levels, node, bound, left / C::BRANCH_WORK + 1);
                    self.work += C::BRANCH_WORK * (self.nodes.len() - opened);
                }
                Stage::Bounded => self.settle(constraint, node)?,
                Stage::Settled => leaves.push(self.leaf(levels, node)?),
            }
            if self.work > extent.work_budget {
                return Err(AmbiguityError::BudgetExceeded { nodes: self.work });
            }
        }
    }

    /// Work of the last search.
    pub(super) fn work(&self) -> usize {
        self.work
    }

    /// What the cheapest waiting branch costs at least.
    fn next_bound(&self) -> f64 {
        self.queue.peek().map_or(f64::INFINITY, |queued| queued.bound)
    }

    /// Raises the bound of a node by its constraint.
    fn ask<C: Constraint<P, Multiplier = M>>(&mut self, constraint: &mut C, index: usize) {
        self.work += C::BOUND_WORK;
        let node = &mut self.nodes[index];
        let (inner, multiplier) = constraint.bound(node.free, &node.reals, Some(node.multiplier));
        node.bound = node.bound.max(node.norm + inner);
        node.multiplier = multiplier;
        node.stage = Stage::Children { next: None };
        self.queue.push(Queued { bound: node.bound, node: index });
    }

    /// Queues the children of a node that may be as cheap as `bound`, and the rest as a whole. Behind
    /// the first `most` of them the budget is spent and the search ends: what is wildly off, as a
    /// place in the place of a baseline, makes millions as cheap.
    fn open(&mut self, levels: &Levels<P>, parent: usize, bound: f64, most: usize) {
        let k = self.nodes[parent].free - 1;
        let mut siblings = match self.nodes[parent].stage {
            Stage::Children { next: Some(siblings) } => siblings,
            _ => Siblings::around(self.center(levels, parent, k)),
        };
        let variance = levels.decorrelation.conditional_variances()[k];
        for _ in 0..most {
            let node = &self.nodes[parent];
            let residual = siblings.center - siblings.integer;
            let norm = node.norm + residual * residual / variance;
            if norm.is_nan() {
                return;
            }
            if norm > bound {
                // Farther integers of this level have larger norms still.
                self.nodes[parent].stage = Stage::Children { next: Some(siblings) };
                self.queue.push(Queued { bound: norm, node: parent });
                return;
            }
            let child = Node {
                free: k,
                parent,
                integer: siblings.integer,
                residual,
                norm,
                bound: norm.max(node.bound),
                reals: node.reals - levels.gains[k] * residual,
                multiplier: node.multiplier,
                stage: if k == 0 { Stage::Bounded } else { Stage::Unasked },
            };
            self.push(child);
            siblings.advance();
        }
    }

    /// Replaces the bound of a node with all integers fixed by its cost, or by a better bound if
    /// others come first then.
    fn settle(
        &mut self,
        constraint: &mut impl Constraint<P, Multiplier = M>,
        index: usize,
    ) -> Result<(), AmbiguityError> {
        let next = self.next_bound();
        let node = &mut self.nodes[index];
        let (cost, work) = constraint.cost(&node.reals, node.multiplier, next - node.norm)?;
        self.work += work;
        let inner = match cost {
            Cost::Exact(inner) => {
                node.stage = Stage::Settled;
                inner
            }
            Cost::AtLeast(inner) => inner,
        };
        node.bound = node.bound.max(node.norm + inner);
        self.queue.push(Queued { bound: node.bound, node: index });
        Ok(())
    }

    fn push(&mut self, node: Node<P, M>) {
        self.queue.push(Queued { bound: node.bound, node: self.nodes.len() });
        self.nodes.push(node);
    }

    /// Conditional estimate of level `k`: `cₖ = ẑₖ − Σᵢ lᵢₖ wᵢ` for `i > k`.
    fn center(&self, levels: &Levels<P>, parent: usize, k: usize) -> f64 {
        let n = levels.float.len();
        let column = &levels.decorrelation.lower().as_slice()[k * n..(k + 1) * n];
        let mut center = levels.float[k];
        let mut node = &self.nodes[parent];
        while node.free < n {
            center -= column[node.free] * node.residual;
            node = &self.nodes[node.parent];
        }
        center
    }

    fn leaf(&self, levels: &Levels<P>, index: usize) -> Result<Leaf<P>, AmbiguityError> {
        let n = levels.float.len();
        let mut decorrelated = vec![0; n];
        let mut node = &self.nodes[index];
        let (cost, reals) = (node.bound, node.reals);
        while node.free < n {
            decorrelated[node.free] = whole_number(node.integer);
            node = &self.nodes[node.parent];
        }
        let mut integers = levels.decorrelation.original(decorrelated)?;
        for (integer, offset) in integers.iter_mut().zip(&levels.whole) {
            *integer += offset;
        }
        Ok(Leaf { integers, cost, reals })
    }
}

#[expect(clippy::cast_possible_truncation, reason = "saturates; the way back is checked")]
fn whole_number(integer: f64) -> i64 {
    integer as i64
}

/// A branch of the search: the integers from level `free` on are fixed.
#[derive(Debug, Clone)]
struct Node<const P: usize, M> {
    /// Number of ambiguities that are not fixed yet, and the level that was fixed last.
    free: usize,
    /// Index of the node with one integer fewer.
    parent: usize,
    /// The integer of level `free`, and `w` there.
    integer: f64,
    residual: f64,
    /// `Σ wᵢ²/dᵢ`.
    norm: f64,
    /// Lower bound of the cost; the cost itself once settled.
    bound: f64,
    /// `x̌ₖ`.
    reals: SVector<f64, P>,
    multiplier: M,
    stage: Stage,
}

impl<const P: usize, M> Node<P, M> {
    /// Nothing fixed yet.
    fn root(n: usize, bound: f64, reals: SVector<f64, P>, multiplier: M) -> Self {
        let stage = Stage::Children { next: None };
        Self {
            free: n,
            parent: 0,
            integer: 0.0,
            residual: 0.0,
            norm: 0.0,
            bound,
            reals,
            multiplier,
            stage,
        }
    }
}

/// What is to be done with a node when its turn comes.
#[derive(Debug, Clone, Copy)]
enum Stage {
    /// The bound is that of the branch above: the constraint may raise it.
    Unasked,
    /// Open its children, from `next` on.
    Children { next: Option<Siblings> },
    /// All integers are fixed: compute the cost.
    Bounded,
    /// The cost is known: it is the next candidate.
    Settled,
}

/// The integers of one level, nearest to the conditional estimate first.
#[derive(Debug, Clone, Copy)]
struct Siblings {
    center: f64,
    integer: f64,
    /// Difference to the integer after this: +1, −2, +3, … or the mirror image.
    stride: f64,
}

impl Siblings {
    fn around(center: f64) -> Self {
        let integer = center.round();
        Self { center, integer, stride: if center < integer { -1.0 } else { 1.0 } }
    }

    fn advance(&mut self) {
        self.integer += self.stride;
        self.stride = -self.stride - self.stride.signum();
    }
}

/// A node in the queue: the least bound first, the older one if equal.
#[derive(Debug, Clone)]
struct Queued {
    bound: f64,
    node: usize,
}

impl Ord for Queued {
    fn cmp(&self, other: &Self) -> Ordering {
        other.bound.total_cmp(&self.bound).then(other.node.cmp(&self.node))
    }
}

impl PartialOrd for Queued {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Queued {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Queued {}
