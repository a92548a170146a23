//! The integers of an epoch under the constraint in force, and how they stand against all others.

use nalgebra::{DMatrix, DVector, Vector3};

use crate::ambiguity::array_constrained::{ArrayCandidate, ArrayConstrained};
use crate::ambiguity::decorrelate::Decorrelation;
use crate::ambiguity::length_constrained::LengthConstrained;
use crate::ambiguity::parts::PartwiseLeastSquares;
use crate::ambiguity::search::{Candidate, IntegerLeastSquares};
use crate::ambiguity::sphere::Length;
use crate::ambiguity::success_rate::bootstrapped_success_rate;
use crate::ambiguity::{AmbiguityError, MixedFloat};
use crate::array::{AntennaArray, Shape};
use crate::difference::{self, Link};
use crate::float_solution::{Conditional, Fit, FloatSolution};
use crate::solution::Reason;

use super::acceptance::Known;
use super::code_free::CodeFree;
use super::likelihood::Likelihood;
use super::locate::CommonFrame;
use super::settings::{Constraint, Settings};
use super::work_budget::{Search, WorkBudget};

/// Candidates whose probabilities are weighed against each other.
const CANDIDATES: usize = 4;
/// Candidates that the search of a whole array weighs, where a rival must break the geometry too.
const ARRAY_CANDIDATES: usize = 2;
/// Rivals of an array that are less probable than this share of what all of them may be are not looked for; nor are
/// those that cost more than the best by more than the horizon: proving that nothing lies far beyond the best takes
/// longer than finding it.
const RIVAL_SHARE: f64 = 0.1;
const ARRAY_HORIZON: f64 = 30.0;
/// An array's search has this part of the epoch's work where it hardly helps: code full of reflections leads it away,
/// and a model that is strong without the constraint has what is wrong elsewhere. The rest is for the trials without
/// code and without suspects (under branches, `scenarios/canopy-array.toml`, 562 of 601 epochs with a third, 490 with
/// all of it).
const IN_VAIN: usize = 3;
/// Nodes for each ambiguity of a strong model where nothing is known of the geometry. Under branches right integers
/// took five at most, and those that took more than sixteen cost four times their degrees of freedom.
const STRONG_MODEL_NODES: usize = 64;
/// Models that are right more often than this without the constraint hardly gain by it.
const STRONG_WITHOUT_CONSTRAINT: f64 = 0.9;
/// Integers of baselines that leave more than this, in cycles, around a triangle of antennas do not
/// close.
const MAX_CLOSURE_CYCLES: f64 = 0.25;

/// An epoch whose integers are wanted.
#[derive(Debug, Clone, Copy)]
pub(super) struct Problem<'a> {
    pub(super) float: &'a FloatSolution,
    pub(super) links: &'a [Link],
    pub(super) frame: &'a CommonFrame,
    pub(super) settings: &'a Settings,
    /// Share of the fixes that may be wrong.
    pub(super) rate: f64,
    /// How well the noise levels of the session are known.
    pub(super) known: Known,
    /// Probability that the known geometry is not that of the antennas; 0 once that is out of the question.
    pub(super) doubt: f64,
    /// Whether to look for integers without the constraint first: where none come near, none do with it.
    pub(super) begins_free: bool,
    /// Whether the code contradicts itself, so that a trial without it may come after.
    pub(super) is_code_useless: bool,
}

/// The best integers and how they stand against the others.
#[derive(Debug, Clone)]
pub(super) struct Found {
    /// In the order of the float solution's ambiguities, cycles.
    pub(super) integers: Vec<f64>,
    /// What they cost in the metric of the float solution, with what the constraint adds: χ² if they are right.
    pub(super) misfit: Fit,
    /// Whether they were found without the known geometry, so that the misfit says nothing of it.
    pub(super) is_without_geometry: bool,
    /// Probability that the geometry is wrong and other integers are right, over that of these.
    pub(super) doubt: f64,
    /// Second-best over best cost.
    pub(super) ratio: f64,
    /// Probability of the other candidates over that of the best.
    pub(super) rivals: f64,
    /// Bootstrapped.
    pub(super) success_rate: f64,
    /// Whether the integers of single baselines agree around triangles of antennas; those of a joint
    /// search always do.
    pub(super) closes: bool,
}

/// The searches with their memory.
#[derive(Debug, Clone)]
pub(super) struct Searches {
    free: IntegerLeastSquares,
    parts: PartwiseLeastSquares,
    length: LengthConstrained,
    array: ArrayConstrained,
    code_free: CodeFree,
    budget: WorkBudget,
    /// Success rate of the last model if nothing is known of the geometry, where that was asked for.
    success_without_constraint: Option<f64>,
    /// Ambiguities of a model that was weak without the constraint: with more it has not been.
    weak_ambiguities: usize,
    /// Ambiguities of a model whose baselines were weak by themselves.
    weak_in_parts: usize,
}

impl Default for Searches {
    fn default() -> Self {
        let mut free = IntegerLeastSquares::default();
        free.node_budget_of_strong_models = STRONG_MODEL_NODES;
        let mut parts = PartwiseLeastSquares::default();
        parts.search.node_budget_of_strong_models = STRONG_MODEL_NODES;
        Self {
            free,
            parts,
            length: LengthConstrained::default(),
            array: ArrayConstrained::default(),
            code_free: CodeFree::default(),
            budget: WorkBudget::default(),
            success_without_constraint: None,
            weak_ambiguities: 0,
            weak_in_parts: 0,
        }
    }
}

impl Searches {
    /// Gives the searches the work of an epoch.
    pub(super) fn begin_epoch(&mut self) {
        self.budget = WorkBudget::default();
    }

    /// Whether the work of the epoch is done.
    pub(super) fn are_spent(&self) -> bool {
        self.budget.is_spent()
    }

    /// The most probable integers under the constraint in force; where these are not sure, those that are sure
    /// without it: a right geometry never loses them, and a wrong one shows by the checks that they are going to fail.
    ///
    /// # Errors
    ///
    /// The reason why there are none.
    pub(super) fn find(&mut self, problem: &Problem) -> Result<Found, Reason> {
        self.success_without_constraint = None;
        if problem.settings.constraint == Constraint::None {
            return self.without_constraint(problem);
        }
        let mut free = None;
        if problem.begins_free || self.is_likely_strong(problem.float) {
            match self.without_constraint(problem) {
                Ok(found) if problem.is_sure(&found) => return Ok(found),
                Err(reason) if problem.begins_free => return Err(reason),
                unsure => free = Some(unsure),
            }
        }
        let unsure = match self.find_constrained(problem) {
            Ok(found) if problem.is_sure(&found) => return Ok(self.with_doubt(problem, found)),
            unsure if problem.begins_free => return unsure,
            unsure => unsure,
        };
        match free.unwrap_or_else(|| self.without_constraint(problem)) {
            Ok(free) if problem.is_sure(&free) => Ok(free),
            Err(_) if self.is_strong_without_constraint() => unsure,
            _ => unsure.or_else(|reason| {
                let found = self.sure_lengths(problem).ok_or(reason)?;
                Ok(self.with_doubt(problem, found))
            }),
        }
    }

    /// Whether nothing need be known of the geometry: three antennas and more have enough ambiguities of their own,
    /// unless a model with as many was weak before.
    fn is_likely_strong(&self, float: &FloatSolution) -> bool {
        float.rovers.len() > 1 && float.ambiguities_cycles.len() > self.weak_ambiguities
    }

    /// Integers that the geometry makes sure, with the probability that it is wrong as long as that is not out of the
    /// question.
    fn with_doubt(&mut self, problem: &Problem, found: Found) -> Found {
        if problem.doubt == 0.0 {
            return found;
        }
        Found { doubt: problem.doubt * self.none_of_them(problem, &found), ..found }
    }

    /// Whether the model of the last [`find`](Self::find) hardly gains by the constraint, as far as that was asked for:
    /// integers that are not found without it are too far to be right, with it too.
    pub(super) fn is_strong_without_constraint(&self) -> bool {
        self.success_without_constraint.is_some_and(|rate| rate > STRONG_WITHOUT_CONSTRAINT)
    }

    /// Probability of all other integers if nothing is known of the geometry, over that of those `found` with it: what
    /// is right if the geometry is wrong. Where the model without the constraint is weak, each of them is one of many
    /// and right as rarely as its success rate says; where its search comes to no end, integers that fit without any
    /// misfit may be among those it did not reach.
    fn none_of_them(&mut self, problem: &Problem, found: &Found) -> f64 {
        let float = problem.float;
        let (ambiguities, covariance) = (&float.ambiguities_cycles, float.ambiguity_covariance());
        let integers: Vec<i64> = found.integers.iter().map(|z| whole(*z)).collect();
        let found = (integers.as_slice(), found.misfit.sum);
        let likelihood = Likelihood::new(float, problem.known, 0);
        let Ok(free) = self.nearest(ambiguities.as_slice(), covariance, CANDIDATES) else {
            return likelihood.others(float, core::iter::empty(), 0.0, found);
        };
        let others = free.iter().map(|c| (c.integers.as_slice(), c.squared_distance));
        let others = others.filter(|(z, _)| *z != found.0);
        let others = likelihood.others(float, others, self.free.proven_to(), found);
        others * self.free.success_rate()
    }

    /// The most probable integers, if the geometry is right.
    pub(super) fn find_constrained(&mut self, problem: &Problem) -> Result<Found, Reason> {
        match (problem.settings.constraint, &problem.settings.array) {
            (Constraint::Length, Some(array)) => self.with_lengths(problem, array),
            // Without code the search of the array has no end; the checks come after.
            (Constraint::Array, Some(array)) if problem.float.is_without_code() => {
                self.with_lengths(problem, array)
            }
            (Constraint::Array, Some(array)) => self.with_array(problem, array),
            _ => self.without_constraint(problem),
        }
    }

    /// Of the last search under this constraint.
    pub(super) fn decorrelation(&self, constraint: Constraint) -> &Decorrelation {
        match constraint {
            Constraint::None => self.free.decorrelation(),
            Constraint::Length => self.length.decorrelation(),
            Constraint::Array => self.array.decorrelation(),
        }
    }

    /// All ambiguities of all baselines together, nothing known of the geometry.
    fn without_constraint(&mut self, problem: &Problem) -> Result<Found, Reason> {
        let float = problem.float;
        let in_parts = self.baseline_after_baseline(float);
        let (candidates, proven_to, rate) = match in_parts {
            Some(candidates) => (Ok(candidates), self.parts.proven_to(), self.parts.success_rate()),
            None => {
                // Of a search that is not begun nothing is known, nor of its model.
                self.budget.nodes(Search::Free)?;
                let ambiguities = float.ambiguities_cycles.as_slice();
                let found = self.nearest(ambiguities, float.ambiguity_covariance(), CANDIDATES);
                (found, self.free.proven_to(), self.free.success_rate())
            }
        };
        self.success_without_constraint = Some(rate);
        self.weak_ambiguities = match float.ambiguities_cycles.len() {
            strong if self.is_strong_without_constraint() => {
                self.weak_ambiguities.min(strong.saturating_sub(1))
            }
            weak => weak,
        };
        let candidates = candidates?;
        let list: Vec<_> =
            candidates.iter().map(|c| (c.integers.as_slice(), c.squared_distance)).collect();
        problem.weigh(float, &list, proven_to, rate, 0)
    }

    /// The nearest integers of several baselines, found in each by itself; `None` where that proves nothing.
    fn baseline_after_baseline(&mut self, float: &FloatSolution) -> Option<Vec<Candidate>> {
        let (baselines, count) = (float.rovers.len(), float.ambiguities_cycles.len());
        if baselines < 2 || !float.is_of_one_epoch() || count <= self.weak_in_parts {
            return None;
        }
        let mut parts = vec![Vec::new(); baselines];
        for (row, baseline) in float.baseline_of.iter().enumerate() {
            parts[*baseline].push(row);
        }
        self.parts.search.node_budget = self.budget.nodes(Search::Free).ok()? / baselines;
        let squared_distance = |integers: &[i64]| {
            let cycles: Vec<f64> = integers.iter().map(|z| *z as f64).collect();
            float.squared_distance(&cycles)
        };
        let among = |rows: &[usize]| float.covariance_among(rows);
        let ambiguities = float.ambiguities_cycles.as_slice();
        let found = self.parts.solve(ambiguities, &parts, among, squared_distance, CANDIDATES);
        let largest = parts.iter().map(Vec::len).max().unwrap_or(0);
        self.budget.spend(Search::Free, self.parts.nodes(), largest);
        if found.is_none() && self.parts.are_weak() {
            self.weak_in_parts = count;
        }
        found
    }

    /// The integers nearest to these ambiguities, within the work of the epoch.
    fn nearest(
        &mut self,
        ambiguities: &[f64],
        covariance: &DMatrix<f64>,
        count: usize,
    ) -> Result<Vec<Candidate>, Reason> {
        self.free.node_budget = self.budget.nodes(Search::Free)?;
        let found = self.free.solve(ambiguities, covariance, count);
        self.budget.spend(Search::Free, self.free.nodes(), ambiguities.len());
        found.map_err(reason)
    }

    /// All baselines together, as the known array turned by one rotation. Rivals are looked for as far as they are of
    /// weight beside integers that fit well; where these fit so badly that what lies beyond leaves them unsure, again
    /// and farther.
    pub(super) fn with_array(
        &mut self,
        problem: &Problem,
        array: &AntennaArray,
    ) -> Result<Found, Reason> {
        // The attitude remains of the baselines' coordinates: two angles of a line, else three.
        let rovers = &problem.float.rovers;
        let present = array.part(problem.float.reference, rovers).ok_or(Reason::WeakModel)?;
        let angles = if present.shape() == Shape::Collinear { 2 } else { 3 };
        let constrained = 3 * rovers.len() - angles;
        let likelihood = Likelihood::new(problem.float, problem.known, constrained);
        let near = likelihood.horizon(RIVAL_SHARE * problem.rate).min(ARRAY_HORIZON);
        let found = self.with_array_within(problem, array, constrained, near)?;
        let is_alone = self.array.proven_to() > found.misfit.sum + 0.999 * near;
        if problem.is_sure(&found) || !is_alone || near == ARRAY_HORIZON {
            return Ok(found);
        }
        Ok(self.with_array_within(problem, array, constrained, ARRAY_HORIZON).unwrap_or(found))
    }

    /// As [`with_array`](Self::with_array), with the rivals within a horizon.
    fn with_array_within(
        &mut self,
        problem: &Problem,
        array: &AntennaArray,
        constrained: usize,
        horizon: f64,
    ) -> Result<Found, Reason> {
        let float = problem.float;
        let positions_m = array.positions_m();
        let reference_m = positions_m[float.reference];
        let body_m: Vec<Vector3<f64>> =
            float.rovers.iter().map(|rover| (positions_m[*rover] - reference_m).xyz()).collect();
        // The search wants the ambiguities baseline after baseline.
        let mut order: Vec<usize> = (0..float.ambiguities_cycles.len()).collect();
        order.sort_by_key(|row| float.baseline_of[*row]);
        let ambiguities_of: Vec<usize> = (0..body_m.len())
            .map(|block| float.baseline_of.iter().filter(|b| **b == block).count())
            .collect();
        let mixed = mixed_float(float, &problem.frame.approximate(), &order)?;
        let array_sd_m = problem.settings.array_sd_m;
        self.array.horizon = horizon;
        let most_work = self.budget.nodes(Search::Array)?;
        let is_in_vain = problem.is_code_useless || self.is_strong_without_constraint();
        self.array.work_budget = if is_in_vain { most_work / IN_VAIN } else { most_work };
        let found = self.array.solve(mixed, &ambiguities_of, &body_m, array_sd_m, ARRAY_CANDIDATES);
        self.budget.spend(Search::Array, self.array.work(), order.len());
        let candidates = found.map_err(reason)?;
        let variances = self.array.decorrelation().conditional_variances();
        let rate = bootstrapped_success_rate(variances);
        let in_place = |candidate: &ArrayCandidate| {
            let mut integers = vec![0; order.len()];
            for (row, integer) in order.iter().zip(&candidate.integers) {
                integers[*row] = *integer;
            }
            integers
        };
        let integers: Vec<Vec<i64>> = candidates.iter().map(in_place).collect();
        let costs = candidates.iter().map(|c| c.cost);
        let list: Vec<_> = integers.iter().map(Vec::as_slice).zip(costs).collect();
        problem.weigh(float, &list, self.array.proven_to(), rate, constrained)
    }

    /// Where the search of the array finds no end: integers of each baseline with its length, if they are sure.
    fn sure_lengths(&mut self, problem: &Problem) -> Option<Found> {
        let is_array = problem.settings.constraint == Constraint::Array;
        let array = problem.settings.array.as_ref().filter(|_| is_array)?;
        self.with_lengths(problem, array).ok().filter(|found| problem.is_sure(found))
    }

    /// Each baseline by itself with its known length; the joint ambiguities follow from the
    /// baselines, which are then known to millimetres.
    fn with_lengths(&mut self, problem: &Problem, array: &AntennaArray) -> Result<Found, Reason> {
        let (float, frame) = (problem.float, problem.frame);
        let length = |rover: usize| Length {
            length_m: (array.positions_m()[rover] - array.positions_m()[float.reference]).norm(),
            // Both ends are uncertain along the baseline.
            sd_m: problem.settings.array_sd_m * core::f64::consts::SQRT_2,
        };
        if let [rover] = float.rovers[..] {
            let approximate_m = frame.approximate_m[0].xyz();
            let (found, _) = self.one_length(problem, float, approximate_m, length(rover))?;
            return Ok(found);
        }
        let mut joint = Found {
            integers: Vec::new(),
            misfit: Fit::default(),
            is_without_geometry: false,
            doubt: 0.0,
            ratio: f64::INFINITY,
            rivals: 0.0,
            success_rate: 1.0,
            closes: true,
        };
        let mut corrections_m = DVector::zeros(float.correction_m.len());
        for (block, rover) in float.rovers.iter().enumerate() {
            let mut of_pair: Vec<Link> = problem
                .links
                .iter()
                .filter(|l| l.antenna == float.reference || l.antenna == *rover)
                .copied()
                .collect();
            let groups = difference::group(&mut of_pair);
            let pair = FloatSolution::solve(&of_pair, &groups, float.reference, &[*rover])
                .map_err(|_| Reason::FewSatellites)?;
            let pair = if float.is_without_code() { pair.without_code() } else { pair };
            let approximate_m = frame.approximate_m[block].xyz();
            let (found, conditional) =
                self.one_length(problem, &pair, approximate_m, length(*rover))?;
            corrections_m.rows_mut(3 * block, 3).copy_from(&conditional.correction_m);
            joint.misfit = joint.misfit.plus(found.misfit);
            joint.ratio = joint.ratio.min(found.ratio);
            joint.rivals += found.rivals;
            joint.success_rate *= found.success_rate;
        }
        let cycles = float.cycles(&corrections_m);
        joint.integers = cycles.iter().map(|cycles| cycles.round()).collect();
        joint.closes = cycles.iter().all(|c| (c - c.round()).abs() <= MAX_CLOSURE_CYCLES);
        Ok(joint)
    }

    /// One baseline, whose float solution this is, with its known length.
    fn one_length(
        &mut self,
        problem: &Problem,
        float: &FloatSolution,
        approximate_m: Vector3<f64>,
        length: Length,
    ) -> Result<(Found, Conditional), Reason> {
        let (candidates, proven_to, decorrelation) = if float.is_without_code() {
            let nodes = self.budget.nodes(Search::Sphere)?;
            let mut left = nodes;
            let found = self.code_free.solve(float, approximate_m, length, &mut left);
            self.budget.spend(Search::Sphere, nodes - left, float.ambiguities_cycles.len());
            let (candidates, proven_to) = found?;
            (candidates, proven_to, self.code_free.decorrelation())
        } else {
            let stacked_m = DVector::from_column_slice(approximate_m.as_slice());
            let as_they_are: Vec<usize> = (0..float.ambiguities_cycles.len()).collect();
            let mixed = mixed_float(float, &stacked_m, &as_they_are)?;
            // All baselines together may take what one search may.
            let baselines = problem.float.rovers.len();
            self.length.node_budget = self.budget.nodes(Search::Length)? / baselines;
            let found = self.length.solve(&mixed, length, CANDIDATES);
            let ambiguities = float.ambiguities_cycles.len();
            self.budget.spend(Search::Length, self.length.nodes(), ambiguities);
            let candidates = found.map_err(reason)?;
            (candidates, self.length.proven_to(), self.length.decorrelation())
        };
        let rate = bootstrapped_success_rate(decorrelation.conditional_variances());
        let list: Vec<_> = candidates.iter().map(|c| (c.integers.as_slice(), c.cost)).collect();
        let found = problem.weigh(float, &list, proven_to, rate, 1)?;
        let conditional = float.conditional(&found.integers).ok_or(Reason::WeakModel)?;
        Ok((found, conditional))
    }
}

impl Problem<'_> {
    /// Whether all other integers are improbable.
    fn is_sure(&self, found: &Found) -> bool {
        found.rivals <= self.rate && found.closes
    }

    /// Weighs the candidates (cheapest first) of a float solution against each other; all that were
    /// not found cost `proven_to` or more. The constraint fixes `constrained` coordinates.
    fn weigh(
        &self,
        float: &FloatSolution,
        candidates: &[(&[i64], f64)],
        proven_to: f64,
        success_rate: f64,
        constrained: usize,
    ) -> Result<Found, Reason> {
        let [(integers, cost), others @ ..] = candidates else { return Err(Reason::WeakModel) };
        let likelihood = Likelihood::new(float, self.known, constrained);
        Ok(Found {
            integers: integers.iter().map(|z| *z as f64).collect(),
            misfit: Fit { sum: *cost, degrees_of_freedom: integers.len() + constrained },
            is_without_geometry: constrained == 0,
            doubt: 0.0,
            ratio: others.first().map_or(proven_to, |(_, cost)| *cost) / cost.max(1e-12),
            rivals: likelihood.rivals(float, candidates.iter().copied(), proven_to),
            success_rate,
            closes: true,
        })
    }
}

/// The float solution in the form that the constrained searches take, its ambiguities in this order.
fn mixed_float(
    float: &FloatSolution,
    approximate_m: &DVector<f64>,
    order: &[usize],
) -> Result<MixedFloat, Reason> {
    let (n, covariance) = (order.len(), float.ambiguity_covariance());
    Ok(MixedFloat {
        ambiguities: float.ambiguities_cycles.select_rows(order),
        ambiguity_covariance: DMatrix::from_fn(n, n, |i, j| covariance[(order[i], order[j])]),
        reals_m: approximate_m + &float.correction_m,
        real_covariance_m2: float.covariance_m2.clone(),
        cross_covariance: float.cross_covariance.select_columns(order),
        conditional_covariance_m2: float
            .conditional_covariance_m2()
            .cloned()
            .ok_or(Reason::WeakModel)?,
    })
}

#[allow(clippy::cast_possible_truncation)] // integers already
fn whole(value: f64) -> i64 {
    value.round() as i64
}

/// Why a search gave nothing, in the words of the outputs.
fn reason(error: AmbiguityError) -> Reason {
    match error {
        AmbiguityError::BudgetExceeded { .. } => Reason::Budget,
        _ => Reason::WeakModel,
    }
}
