//! Integers without code: phases and a known length, searched over the sphere.
//!
//! Reflections in a street can put tens of metres on the pseudoranges of an antenna and millimetres on
//! its phases. Without code the integers have no end to search in, but a short baseline has few enough
//! directions to try them all.

use nalgebra::{DMatrix, DVector, Matrix3, Vector3};

use crate::ambiguity::decorrelate::Decorrelation;
use crate::ambiguity::length_constrained::LengthCandidate;
use crate::ambiguity::sphere::Length;
use crate::ambiguity::sphere_search::{PhaseModel, SphereCandidate, all_in_time};
use crate::float_solution::{Fit, FloatSolution};
use crate::solution::Reason;

/// Code residuals so many times larger than the session's, root mean square, are of no use.
const USELESS: f64 = 2.0;
/// With fewer redundant observations that is chance too often.
const MIN_FREEDOM: usize = 8;
/// The time for a sphere grows with its area: some tens of milliseconds for this radius, m.
const MAX_LENGTH_M: f64 = 3.0;
/// Rivals that cost so much more than the phases' degrees of freedom are not looked for.
const HORIZON: f64 = 50.0;

/// Whether the code of the epoch contradicts itself too much to be of use.
pub(super) fn code_is_useless(fit: Fit) -> bool {
    fit.degrees_of_freedom >= MIN_FREEDOM && fit.unit_weight() > USELESS
}

/// The search over the sphere, with the memory of its success rate.
#[derive(Debug, Clone, Default)]
pub(super) struct CodeFree {
    decorrelation: Decorrelation,
}

impl CodeFree {
    /// The integers of one baseline, cheapest first, and what all others cost at least; no more than `nodes`
    /// integers are tried, those that are left remain: noisy phases leave too many.
    ///
    /// # Errors
    ///
    /// [`Reason::Budget`] where that takes too long, [`Reason::WeakModel`].
    pub(super) fn solve(
        &mut self,
        float: &FloatSolution,
        approximate_m: Vector3<f64>,
        length: Length,
        nodes: &mut usize,
    ) -> Result<(Vec<LengthCandidate>, f64), Reason> {
        if length.length_m > MAX_LENGTH_M {
            return Err(Reason::Budget);
        }
        let weak = Reason::WeakModel;
        self.decorrelation.compute(float.ambiguity_covariance()).map_err(|_| weak)?;
        let model = phase_model(float, approximate_m).ok_or(weak)?;
        let max_cost = model.phases_m.len() as f64 + HORIZON;
        let found = all_in_time(&model, length, max_cost, nodes).map_err(|_| Reason::Budget)?;
        let candidate = |c: SphereCandidate| LengthCandidate {
            integers: c.integers,
            cost: c.cost,
            baseline_m: c.baseline_m,
        };
        Ok((found.into_iter().map(candidate).collect(), max_cost))
    }

    /// Of the last call of [`solve`](Self::solve).
    pub(super) fn decorrelation(&self) -> &Decorrelation {
        &self.decorrelation
    }
}

/// The phases of the one baseline of a float solution, with its code as the prior.
fn phase_model(float: &FloatSolution, approximate_m: Vector3<f64>) -> Option<PhaseModel> {
    let code_m2: Matrix3<f64> = float.covariance_m2.fixed_view::<3, 3>(0, 0).into();
    let correction_m: Vector3<f64> = float.correction_m.fixed_rows::<3>(0).into();
    let n = float.ambiguities_cycles.len();
    let mut model = PhaseModel {
        phases_m: DVector::zeros(n),
        wavelengths_m: DVector::zeros(n),
        design: DMatrix::zeros(n, 3),
        covariance_m2: DMatrix::zeros(n, n),
        prior_m: approximate_m + correction_m,
        prior_information: code_m2.try_inverse()?,
    };
    let mut first = 0;
    for group in float.phase_groups() {
        let rows = group.misclosure_m.len();
        let range_m = group.misclosure_m + group.design * approximate_m;
        model.phases_m.rows_mut(first, rows).copy_from(&range_m);
        model.wavelengths_m.rows_mut(first, rows).copy_from(group.wavelengths_m);
        model.design.rows_mut(first, rows).copy_from(group.design);
        model.covariance_m2.view_mut((first, first), (rows, rows)).copy_from(group.covariance_m2);
        first += rows;
    }
    Some(model)
}
