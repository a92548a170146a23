//! The integers of an epoch under the constraint in force, and how they stand against all others.

use nalgebra::{DMatrix, DVector, Vector3};

use crate::ambiguity::array_constrained::ArrayConstrained;
use crate::ambiguity::length_constrained::LengthConstrained;
use crate::ambiguity::search::IntegerLeastSquares;
use crate::ambiguity::sphere::Length;
use crate::ambiguity::success_rate::bootstrapped_success_rate;
use crate::ambiguity::{AmbiguityError, MixedFloat};
use crate::array::AntennaArray;
use crate::difference::{self, Link};
use crate::float_solution::{Conditional, FloatSolution, VarianceFactors};
use crate::solution::Reason;

use super::code_free::CodeFree;
use super::locate::CommonFrame;
use super::settings::{Constraint, Settings};

/// Candidates whose probabilities are weighed against each other.
const CANDIDATES: usize = 4;
/// The same for the search of a whole array, where a rival must break the geometry too.
const ARRAY_CANDIDATES: usize = 2;
/// Branches that the search of an array opens before it gives up, many times what a good epoch needs.
const ARRAY_NODES: usize = 4_000;
/// Rivals of an array that cost more than the best by more than this are not looked for.
const ARRAY_HORIZON: f64 = 30.0;
/// Degrees of freedom that the session's noise level counts for against the residuals of the epoch:
/// never more than this, because multipath changes from satellite to satellite and with time.
const MAX_PRIOR_FREEDOM: f64 = 100.0;
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
    /// The session's noise level, and the degrees of freedom that of the code is known with.
    pub(super) noise: VarianceFactors,
    pub(super) noise_freedom: f64,
}

/// The best integers and how they stand against the others.
pub(super) struct Found {
    /// In the order of the float solution's ambiguities, cycles.
    pub(super) integers: Vec<f64>,
    /// Second-best over best cost.
    pub(super) ratio: f64,
    /// Probability of the other candidates over that of the best.
    pub(super) rivals: f64,
    /// Bootstrapped.
    pub(super) success_rate: f64,
    /// Whether the integers of single baselines agree around triangles of antennas; those of a joint
    /// search always do.
    pub(super) close: bool,
}

/// The searches with their memory.
#[derive(Debug)]
pub(super) struct Searches {
    free: IntegerLeastSquares,
    length: LengthConstrained,
    array: ArrayConstrained,
    code_free: CodeFree,
}

impl Default for Searches {
    fn default() -> Self {
        // Proving that nothing lies far beyond the best takes longer than finding it.
        let mut array = ArrayConstrained::default();
        (array.horizon, array.node_budget) = (ARRAY_HORIZON, ARRAY_NODES);
        Self {
            free: IntegerLeastSquares::default(),
            length: LengthConstrained::default(),
            array,
            code_free: CodeFree::default(),
        }
    }
}

impl Searches {
    /// The most probable integers under the constraint in force.
    ///
    /// # Errors
    ///
    /// The reason why there are none.
    pub(super) fn find(&mut self, problem: &Problem) -> Result<Found, Reason> {
        match (problem.settings.constraint, &problem.settings.array) {
            (Constraint::Length, Some(array)) => self.with_lengths(problem, array),
            // Without code the search of the array has no end; the checks come after.
            (Constraint::Array, Some(array)) if problem.float.is_without_code() => {
                self.with_lengths(problem, array)
            }
            (Constraint::Array, Some(array)) => self
                .with_array(problem, array)
                .or_else(|reason| self.without_array(reason, problem, array)),
            _ => self.without_constraint(problem),
        }
    }

    /// What the model of the last search promised, for one that came to no end.
    pub(super) fn predicted_success(&self, constraint: Constraint) -> Option<f64> {
        let decorrelation = match constraint {
            Constraint::None => self.free.decorrelation(),
            Constraint::Length => self.length.decorrelation(),
            Constraint::Array => self.array.decorrelation(),
        };
        let variances = decorrelation.conditional_variances();
        (!variances.is_empty()).then(|| bootstrapped_success_rate(variances))
    }

    /// All ambiguities of all baselines together, nothing known of the geometry.
    fn without_constraint(&mut self, problem: &Problem) -> Result<Found, Reason> {
        let float = problem.float;
        let candidates = self
            .free
            .solve(float.ambiguities_cycles.as_slice(), &float.ambiguity_covariance, CANDIDATES)
            .map_err(reason)?;
        let costs: Vec<f64> = candidates.iter().map(|c| c.squared_distance).collect();
        let variances = self.free.decorrelation().conditional_variances();
        let rate = bootstrapped_success_rate(variances);
        let best = candidates.first().ok_or(Reason::WeakModel)?;
        problem.weigh(float, &best.integers, &costs, self.free.proven_to(), rate)
    }

    /// All baselines together, as the known array turned by one rotation.
    pub(super) fn with_array(
        &mut self,
        problem: &Problem,
        array: &AntennaArray,
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
        let mixed = reordered(mixed_float(float, &problem.frame.approximate())?, &order);
        let candidates = self
            .array
            .solve(mixed, &ambiguities_of, &body_m, problem.settings.array_sd_m, ARRAY_CANDIDATES)
            .map_err(reason)?;
        let costs: Vec<f64> = candidates.iter().map(|c| c.cost).collect();
        let variances = self.array.decorrelation().conditional_variances();
        let rate = bootstrapped_success_rate(variances);
        let best = candidates.first().ok_or(Reason::WeakModel)?;
        let mut integers = vec![0; order.len()];
        for (row, integer) in order.iter().zip(&best.integers) {
            integers[*row] = *integer;
        }
        problem.weigh(float, &integers, &costs, self.array.proven_to(), rate)
    }

    /// Where the search of the array finds no end, integers that are sure without it: of all baselines
    /// with nothing known, or of each with its length. If the array is wrong, they show it by the checks
    /// that they are going to fail.
    fn without_array(
        &mut self,
        reason: Reason,
        problem: &Problem,
        array: &AntennaArray,
    ) -> Result<Found, Reason> {
        let sure = |found: &Found| found.rivals <= problem.rate;
        if let Some(found) = self.without_constraint(problem).ok().filter(sure) {
            return Ok(found);
        }
        self.with_lengths(problem, array).ok().filter(sure).ok_or(reason)
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
            ratio: f64::INFINITY,
            rivals: 0.0,
            success_rate: 1.0,
            close: true,
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
            let noise = problem.noise;
            let pair =
                FloatSolution::solve(&of_pair, &groups, float.reference, &[*rover], |_| noise)
                    .map_err(|_| Reason::FewSatellites)?;
            let pair = if float.is_without_code() { pair.without_code() } else { pair };
            let approximate_m = frame.approximate_m[block].xyz();
            let (found, conditional) =
                self.one_length(problem, &pair, approximate_m, length(*rover))?;
            corrections_m.rows_mut(3 * block, 3).copy_from(&conditional.correction_m);
            joint.ratio = joint.ratio.min(found.ratio);
            joint.rivals += found.rivals;
            joint.success_rate *= found.success_rate;
        }
        let cycles = float.cycles(&corrections_m);
        joint.integers = cycles.iter().map(|cycles| cycles.round()).collect();
        joint.close = cycles.iter().all(|c| (c - c.round()).abs() <= MAX_CLOSURE_CYCLES);
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
            let (candidates, proven_to) = self.code_free.solve(float, approximate_m, length)?;
            (candidates, proven_to, self.code_free.decorrelation())
        } else {
            let stacked_m = DVector::from_column_slice(approximate_m.as_slice());
            let mixed = mixed_float(float, &stacked_m)?;
            let candidates = self.length.solve(&mixed, length, CANDIDATES).map_err(reason)?;
            (candidates, self.length.proven_to(), self.length.decorrelation())
        };
        let costs: Vec<f64> = candidates.iter().map(|c| c.cost).collect();
        let rate = bootstrapped_success_rate(decorrelation.conditional_variances());
        let best = candidates.first().ok_or(Reason::WeakModel)?;
        let found = problem.weigh(float, &best.integers, &costs, proven_to, rate)?;
        let conditional = float.conditional(&found.integers).ok_or(Reason::WeakModel)?;
        Ok((found, conditional))
    }
}

impl Problem<'_> {
    /// Weighs the candidates (cheapest first) of a float solution against each other; all that were
    /// not found cost `proven_to` or more.
    ///
    /// With Gaussian noise of a level that is itself uncertain (inverse-gamma, `ν` degrees of
    /// freedom around the session's level), a candidate with the total cost `q` of `f` degrees of
    /// freedom has a likelihood ∝ `(ν + q)^{−(ν + f)/2}`.
    fn weigh(
        &self,
        float: &FloatSolution,
        integers: &[i64],
        costs: &[f64],
        proven_to: f64,
        success_rate: f64,
    ) -> Result<Found, Reason> {
        let [best, others @ ..] = costs else { return Err(Reason::WeakModel) };
        let prior = self.noise_freedom.min(MAX_PRIOR_FREEDOM);
        let freedom = (float.code_fit.freedom + float.ambiguities_cycles.len()) as f64;
        let total = |cost: &f64| prior + float.code_fit.sum + cost;
        let likelihood = |cost: &f64| (total(cost) / total(best)).powf(-0.5 * (prior + freedom));
        Ok(Found {
            integers: integers.iter().map(|z| *z as f64).collect(),
            ratio: others.first().unwrap_or(&proven_to) / best.max(1e-12),
            // What was not found costs at least `proven_to`: it counts as one more rival.
            rivals: others.iter().chain([&proven_to]).map(likelihood).sum(),
            success_rate,
            close: true,
        })
    }
}

/// The float solution in the form that the constrained searches take.
fn mixed_float(float: &FloatSolution, approximate_m: &DVector<f64>) -> Result<MixedFloat, Reason> {
    Ok(MixedFloat {
        ambiguities: float.ambiguities_cycles.clone(),
        ambiguity_covariance: float.ambiguity_covariance.clone(),
        reals_m: approximate_m + &float.correction_m,
        cross_covariance: float.cross_covariance.clone(),
        conditional_covariance_m2: float.conditional_covariance_m2().ok_or(Reason::WeakModel)?,
    })
}

/// The same with its ambiguities in another order.
fn reordered(mixed: MixedFloat, order: &[usize]) -> MixedFloat {
    if order.is_sorted() {
        return mixed;
    }
    let n = order.len();
    let (covariance, cross) = (&mixed.ambiguity_covariance, &mixed.cross_covariance);
    MixedFloat {
        ambiguities: mixed.ambiguities.select_rows(order),
        ambiguity_covariance: DMatrix::from_fn(n, n, |i, j| covariance[(order[i], order[j])]),
        cross_covariance: cross.select_columns(order),
        ..mixed
    }
}

/// Why a search gave nothing, in the words of the outputs.
fn reason(error: AmbiguityError) -> Reason {
    match error {
        AmbiguityError::BudgetExceeded { .. } => Reason::Budget,
        _ => Reason::WeakModel,
    }
}
