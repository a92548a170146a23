//! Integers: found, and accepted or not.

use std::ops::Range;

use nalgebra::{DMatrix, DVector, Vector3};

use crate::ambiguity::array_constrained::ArrayConstrained;
use crate::ambiguity::length_constrained::LengthConstrained;
use crate::ambiguity::search::IntegerLeastSquares;
use crate::ambiguity::sphere::Length;
use crate::ambiguity::success_rate::bootstrapped_success_rate;
use crate::ambiguity::{AmbiguityError, MixedFloat};
use crate::array::AntennaArray;
use crate::baseline::Baselines;
use crate::difference::{self, Link};
use crate::float_solution::{Conditional, Fit, FloatSolution, NoFloat, VarianceFactors};
use crate::signal::System;
use crate::solution::Reason;
use crate::time::GpsTime;

use super::locate::CommonFrame;
use super::noise_scale::{Independence, NoiseScale};
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
/// Integers that beat all others by this ratio teach the phase noise, even while the noise level is
/// too uncertain to accept them.
const CLEAR_RATIO: f64 = 3.0;
/// Models that are right more often than this choose no integers by chance.
const STRONG_MODEL: f64 = 0.999;
/// Baselines that stay less certain than this, although the integers are known, have a geometry so
/// poor that other integers fit as well, m.
const MAX_FIXED_SD_M: f64 = 0.3;
/// A fix whose phase residuals are this many times larger than their weights say is no fix.
const MAX_UNIT_WEIGHT: f64 = 4.0;
/// Integers of baselines that leave more than this, in cycles, around a triangle of antennas do not
/// close.
const MAX_CLOSURE_CYCLES: f64 = 0.25;
/// A model that was expected to be right less often than this is too weak to blame the rivals.
const LEAST_SUCCESS: f64 = 0.5;
/// A length that is off by more than this many standard deviations breaks the known geometry.
const MAX_LENGTH_SD: f64 = 5.0;

/// What becomes of the best integers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Verdict {
    /// Accepted.
    Fixed,
    /// Not sure: the float solution stands.
    Float(Reason),
    /// Sure, but against what is known: refused.
    Refused(Reason),
}

impl Verdict {
    /// Whether the integers are sure, so that the baselines may be laid against the known array.
    pub(super) fn is_sure(self) -> bool {
        matches!(self, Self::Fixed | Self::Refused(Reason::Length))
    }

    /// Whether one system may have spoilt integers that the model is strong enough for.
    pub(super) fn is_spoilt(self) -> bool {
        matches!(
            self,
            Self::Float(Reason::Ratio | Reason::Budget | Reason::Slip)
                | Self::Refused(Reason::Residuals)
        )
    }

    /// The same where too many cycle slips at once left the epoch alone: that is why it is not sure.
    pub(super) fn after_many_slips(self) -> Self {
        match self {
            Self::Float(Reason::Ratio | Reason::SuccessRate | Reason::Budget) => {
                Self::Float(Reason::Slip)
            }
            other => other,
        }
    }
}

/// Baselines of the epoch with what is known of their integers.
#[derive(Debug)]
pub(super) struct Outcome {
    pub(super) verdict: Verdict,
    pub(super) success_rate: Option<f64>,
    pub(super) ratio: Option<f64>,
    pub(super) residual_rms_m: Option<f64>,
    pub(super) baselines: Baselines,
    /// Corrections to the approximate baselines that `baselines` holds, m.
    pub(super) correction_m: DVector<f64>,
    /// The integers that `correction_m` follows from, accepted or refused; `None` for a float
    /// solution.
    pub(super) integers: Option<Vec<f64>>,
    /// The best integers of the search, and the probability of all others over theirs.
    pub(super) best: Option<(Vec<f64>, f64)>,
}

/// Part of an epoch whose integers are accepted.
#[derive(Debug)]
pub(super) struct Part {
    pub(super) links: Vec<Link>,
    pub(super) groups: Vec<Range<usize>>,
    pub(super) float: FloatSolution,
    pub(super) outcome: Outcome,
    rivals: f64,
}

/// The best integers and how they stand against the others.
pub(super) struct Found {
    /// In the order of the float solution's ambiguities, cycles.
    pub(super) integers: Vec<f64>,
    /// Second-best over best cost.
    ratio: f64,
    /// Probability of the other candidates over that of the best.
    rivals: f64,
    /// Bootstrapped.
    success_rate: f64,
    /// Whether the integers of single baselines agree around triangles of antennas; those of a joint
    /// search always do.
    close: bool,
}

/// The searches with their memory, and the noise of the session.
#[derive(Debug)]
pub(super) struct Fixer {
    free: IntegerLeastSquares,
    length: LengthConstrained,
    array: ArrayConstrained,
    code: NoiseScale,
    phase: NoiseScale,
    independence: Independence,
    /// Of the epoch, beside those before.
    weight: f64,
}

impl Default for Fixer {
    fn default() -> Self {
        // Proving that nothing lies far beyond the best takes longer than finding it.
        let mut array = ArrayConstrained::default();
        (array.horizon, array.node_budget) = (ARRAY_HORIZON, ARRAY_NODES);
        Self {
            free: IntegerLeastSquares::default(),
            length: LengthConstrained::default(),
            array,
            code: NoiseScale::default(),
            phase: NoiseScale::default(),
            independence: Independence::default(),
            weight: 1.0,
        }
    }
}

impl Fixer {
    /// Begins the epoch at `time`.
    pub(super) fn begin(&mut self, time: GpsTime) {
        self.weight = self.independence.weight(time);
    }

    /// Float solution with the noise level of the session, which learns from its code residuals.
    pub(super) fn float(
        &mut self,
        links: &[Link],
        groups: &[Range<usize>],
        frame: &CommonFrame,
    ) -> Result<FloatSolution, NoFloat> {
        let rovers: Vec<usize> = frame.rovers().collect();
        FloatSolution::solve(links, groups, frame.reference, &rovers, |code_fit| {
            self.code.learn(code_fit, 1.0, self.weight);
            self.factors()
        })
    }

    fn factors(&self) -> VarianceFactors {
        VarianceFactors { code: self.code.variance_factor(), phase: self.phase.variance_factor() }
    }

    /// Integers of the epoch alone without one of its systems, one after the other left out: a biased
    /// constellation spoils those of all. Each trial may go wrong, so each is allowed its share of the
    /// rate only; the surest one counts.
    pub(super) fn fix_without_one_system(
        &mut self,
        links: &[Link],
        frame: &CommonFrame,
        settings: &Settings,
    ) -> Option<Part> {
        let mut systems: Vec<System> = links.iter().map(|l| l.satellite.system).collect();
        systems.sort_unstable();
        systems.dedup();
        if systems.len() < 2 {
            return None;
        }
        let rate = settings.max_wrong_fix_rate / systems.len() as f64;
        let without = |spoilt: &System| {
            let rest = links.iter().filter(|l| l.satellite.system != *spoilt).copied();
            self.fix_part(rest.collect(), frame, settings, rate)
        };
        systems.iter().filter_map(without).min_by(|a, b| a.rivals.total_cmp(&b.rivals))
    }

    fn fix_part(
        &mut self,
        mut links: Vec<Link>,
        frame: &CommonFrame,
        settings: &Settings,
        rate: f64,
    ) -> Option<Part> {
        let groups = difference::group(&mut links);
        let rovers: Vec<usize> = frame.rovers().collect();
        let factors = self.factors();
        let float =
            FloatSolution::solve(&links, &groups, frame.reference, &rovers, |_| factors).ok()?;
        let outcome = self.fix(&float, &links, frame, settings, rate);
        let rivals = outcome.best.as_ref()?.1;
        (outcome.verdict == Verdict::Fixed).then_some(Part {
            links,
            groups,
            float,
            outcome,
            rivals,
        })
    }

    /// Searches the integers of the epoch under the constraint in force, and judges them: of its fixes
    /// a share of `rate` may be wrong.
    pub(super) fn fix(
        &mut self,
        float: &FloatSolution,
        links: &[Link],
        frame: &CommonFrame,
        settings: &Settings,
        rate: f64,
    ) -> Outcome {
        let mut outcome = Outcome::float(float, frame);
        if float.ambiguities_cycles.is_empty() {
            return outcome;
        }
        let found = match (settings.constraint, &settings.array) {
            (Constraint::Length, Some(array)) => {
                self.with_lengths(float, links, frame, array, settings.array_sd_m)
            }
            (Constraint::Array, Some(array)) => self
                .with_array(float, frame, array, settings.array_sd_m)
                .or_else(|reason| self.without_array(reason, float, links, frame, settings, rate)),
            _ => self.without_constraint(float),
        };
        match found {
            Ok(found) => {
                let fit = outcome.judge(&found, float, frame, settings, rate);
                // The residual test may refuse just because the level is not known yet.
                if found.rivals <= rate || found.ratio >= CLEAR_RATIO {
                    let applied = self.phase.variance_factor();
                    if found.success_rate > STRONG_MODEL {
                        self.phase.learn(fit, applied, self.weight);
                    } else {
                        self.phase.learn_from_chosen(fit, applied, self.weight);
                    }
                }
            }
            Err(reason) => {
                outcome.verdict = Verdict::Float(reason);
                outcome.success_rate = self.predicted_success(settings.constraint);
            }
        }
        outcome
    }

    /// What the model of the last search promised, for one that came to no end.
    fn predicted_success(&self, constraint: Constraint) -> Option<f64> {
        let decorrelation = match constraint {
            Constraint::None => self.free.decorrelation(),
            Constraint::Length => self.length.decorrelation(),
            Constraint::Array => self.array.decorrelation(),
        };
        let variances = decorrelation.conditional_variances();
        (!variances.is_empty()).then(|| bootstrapped_success_rate(variances))
    }

    /// All ambiguities of all baselines together, nothing known of the geometry.
    fn without_constraint(&mut self, float: &FloatSolution) -> Result<Found, Reason> {
        let candidates = self
            .free
            .solve(float.ambiguities_cycles.as_slice(), &float.ambiguity_covariance, CANDIDATES)
            .map_err(reason)?;
        let costs: Vec<f64> = candidates.iter().map(|c| c.squared_distance).collect();
        let variances = self.free.decorrelation().conditional_variances();
        let rate = bootstrapped_success_rate(variances);
        let best = candidates.first().ok_or(Reason::WeakModel)?;
        self.weigh(&best.integers, &costs, self.free.proven_to(), float, rate)
    }

    /// All baselines together, as the known array turned by one rotation.
    pub(super) fn with_array(
        &mut self,
        float: &FloatSolution,
        frame: &CommonFrame,
        array: &AntennaArray,
        array_sd_m: f64,
    ) -> Result<Found, Reason> {
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
        let mixed = reordered(mixed_float(float, &frame.approximate())?, &order);
        let candidates = self
            .array
            .solve(mixed, &ambiguities_of, &body_m, array_sd_m, ARRAY_CANDIDATES)
            .map_err(reason)?;
        let costs: Vec<f64> = candidates.iter().map(|c| c.cost).collect();
        let variances = self.array.decorrelation().conditional_variances();
        let rate = bootstrapped_success_rate(variances);
        let best = candidates.first().ok_or(Reason::WeakModel)?;
        let mut integers = vec![0; order.len()];
        for (row, integer) in order.iter().zip(&best.integers) {
            integers[*row] = *integer;
        }
        self.weigh(&integers, &costs, self.array.proven_to(), float, rate)
    }

    /// Where the search of the array finds no end, integers that are sure without it: of all baselines
    /// with nothing known, or of each with its length. If the array is wrong, they show it by the checks
    /// that they are going to fail.
    fn without_array(
        &mut self,
        reason: Reason,
        float: &FloatSolution,
        links: &[Link],
        frame: &CommonFrame,
        settings: &Settings,
        rate: f64,
    ) -> Result<Found, Reason> {
        let sure = |found: &Found| found.rivals <= rate;
        if let Some(found) = self.without_constraint(float).ok().filter(sure) {
            return Ok(found);
        }
        let Some(array) = &settings.array else { return Err(reason) };
        let by_lengths = self.with_lengths(float, links, frame, array, settings.array_sd_m);
        by_lengths.ok().filter(sure).ok_or(reason)
    }

    /// Each baseline by itself with its known length; the joint ambiguities follow from the
    /// baselines, which are then known to millimetres.
    fn with_lengths(
        &mut self,
        float: &FloatSolution,
        links: &[Link],
        frame: &CommonFrame,
        array: &AntennaArray,
        array_sd_m: f64,
    ) -> Result<Found, Reason> {
        let length = |rover: usize| Length {
            length_m: (array.positions_m()[rover] - array.positions_m()[float.reference]).norm(),
            // Both ends are uncertain along the baseline.
            sd_m: array_sd_m * core::f64::consts::SQRT_2,
        };
        if let [rover] = float.rovers[..] {
            let (found, _) = self.one_length(float, frame.approximate_m[0].xyz(), length(rover))?;
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
            let mut of_pair: Vec<Link> = links
                .iter()
                .filter(|l| l.antenna == float.reference || l.antenna == *rover)
                .copied()
                .collect();
            let groups = difference::group(&mut of_pair);
            let factors = self.factors();
            let pair =
                FloatSolution::solve(&of_pair, &groups, float.reference, &[*rover], |_| factors)
                    .map_err(|_| Reason::FewSatellites)?;
            let approximate_m = frame.approximate_m[block].xyz();
            let (found, conditional) = self.one_length(&pair, approximate_m, length(*rover))?;
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

    /// One baseline with its known length.
    fn one_length(
        &mut self,
        float: &FloatSolution,
        approximate_m: Vector3<f64>,
        length: Length,
    ) -> Result<(Found, Conditional), Reason> {
        let approximate_m = DVector::from_column_slice(approximate_m.as_slice());
        let mixed = mixed_float(float, &approximate_m)?;
        let candidates = self.length.solve(&mixed, length, CANDIDATES).map_err(reason)?;
        let costs: Vec<f64> = candidates.iter().map(|c| c.cost).collect();
        let variances = self.length.decorrelation().conditional_variances();
        let rate = bootstrapped_success_rate(variances);
        let best = candidates.first().ok_or(Reason::WeakModel)?;
        let found = self.weigh(&best.integers, &costs, self.length.proven_to(), float, rate)?;
        let conditional = float.conditional(&found.integers).ok_or(Reason::WeakModel)?;
        Ok((found, conditional))
    }

    /// Weighs the candidates (cheapest first) against each other; all that were not found cost
    /// `proven_to` or more.
    ///
    /// With Gaussian noise of a level that is itself uncertain (inverse-gamma, `ν` degrees of
    /// freedom around the session's level), a candidate with the total cost `q` of `f` degrees of
    /// freedom has a likelihood ∝ `(ν + q)^{−(ν + f)/2}`.
    fn weigh(
        &self,
        integers: &[i64],
        costs: &[f64],
        proven_to: f64,
        float: &FloatSolution,
        success_rate: f64,
    ) -> Result<Found, Reason> {
        let [best, others @ ..] = costs else { return Err(Reason::WeakModel) };
        let prior = self.code.freedom().min(MAX_PRIOR_FREEDOM);
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

impl Outcome {
    /// The float solution, as long as nothing better is known.
    pub(super) fn float(float: &FloatSolution, frame: &CommonFrame) -> Self {
        Self {
            verdict: Verdict::Float(Reason::NoPhase),
            success_rate: None,
            ratio: None,
            residual_rms_m: None,
            baselines: Baselines {
                reference: float.reference,
                rovers: float.rovers.clone(),
                vectors_m: frame.approximate() + &float.correction_m,
                covariance_m2: float.covariance_m2.clone(),
            },
            correction_m: float.correction_m.clone(),
            integers: None,
            best: None,
        }
    }

    /// Accepts the integers if the others are improbable enough and all checks hold; returns how
    /// well the phases fit.
    pub(super) fn judge(
        &mut self,
        found: &Found,
        float: &FloatSolution,
        frame: &CommonFrame,
        settings: &Settings,
        rate: f64,
    ) -> Fit {
        self.success_rate = Some(found.success_rate);
        self.ratio = Some(found.ratio);
        self.best = Some((found.integers.clone(), found.rivals));
        let Some(conditional) = float.conditional(&found.integers) else {
            self.verdict = Verdict::Float(Reason::WeakModel);
            return Fit::default();
        };
        self.residual_rms_m = Some(conditional.residual_rms_m);
        if conditional.covariance_m2.diagonal().max().sqrt() > MAX_FIXED_SD_M {
            self.verdict = Verdict::Float(Reason::WeakModel);
            return Fit::default();
        }
        if found.rivals > rate {
            let weak = found.success_rate < LEAST_SUCCESS;
            self.verdict = Verdict::Float(if weak { Reason::SuccessRate } else { Reason::Ratio });
            return conditional.phase_fit;
        }
        self.baselines.vectors_m = frame.approximate() + &conditional.correction_m;
        self.verdict = if !found.close {
            Verdict::Refused(Reason::Closure)
        } else if conditional.phase_fit.unit_weight() > MAX_UNIT_WEIGHT {
            Verdict::Refused(Reason::Residuals)
        } else if self.breaks_length(&conditional, settings) {
            Verdict::Refused(Reason::Length)
        } else {
            Verdict::Fixed
        };
        self.baselines.covariance_m2 = conditional.covariance_m2;
        self.correction_m = conditional.correction_m;
        self.integers = Some(found.integers.clone());
        conditional.phase_fit
    }

    /// Whether a baseline does not have the length that the known array gives it.
    fn breaks_length(&self, conditional: &Conditional, settings: &Settings) -> bool {
        let Some(array) = &settings.array else { return false };
        let positions_m = array.positions_m();
        let reference = positions_m[self.baselines.reference];
        self.baselines.rovers.iter().enumerate().any(|(block, rover)| {
            let known_m = (positions_m[*rover] - reference).norm();
            let (found_m, _) = self.baselines.length_m(block);
            let along = self.baselines.vector_m(block).direction().xyz();
            let q = conditional.covariance_m2.fixed_view::<3, 3>(3 * block, 3 * block);
            let variance_m2 =
                (along.transpose() * q * along)[0] + 2.0 * settings.array_sd_m.powi(2);
            (found_m - known_m).abs() > MAX_LENGTH_SD * variance_m2.sqrt()
        })
    }
}
