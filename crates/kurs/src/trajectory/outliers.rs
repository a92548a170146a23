//! Which measurements do not belong to the position that the others agree on.

use super::least_squares::{Estimate, NotSolved, solve};
use super::measurement::Measurement;
use super::problem::Problem;
use crate::frames::{Ecef, Vector};

/// A position and what had to be left out for it.
#[derive(Debug, Clone, PartialEq)]
pub struct Screened {
    /// The position of the measurements kept.
    pub estimate: Estimate,
    /// Indices of the measurements left out, in the order of leaving out.
    pub excluded: Vec<usize>,
}

/// Solves, and as long as residuals as large as these have less than `probability` under the
/// standard deviations given, leaves out the measurement without which the cost is least.
///
/// With one measurement too many the test can fail but cannot say which one is wrong, so nothing is
/// left out there: compare [`Estimate::likelihood`] with `probability` to see it.
///
/// # Errors
///
/// [`NotSolved`] of the full set.
pub fn exclude_outliers(
    problem: &Problem,
    prior_m: Option<Vector<Ecef>>,
    probability: f64,
) -> Result<Screened, NotSolved> {
    let mut estimate = solve(problem, prior_m)?;
    let mut current = problem.clone();
    let mut kept: Vec<usize> = (0..problem.measurements().len()).collect();
    let mut excluded = Vec::new();
    let mut rest: Vec<Vec<Measurement>> = vec![Vec::new(); problem.measurements().len()];
    for room in &mut rest {
        if estimate.likelihood() >= probability || estimate.degrees_of_freedom < 2 {
            break;
        }
        let Some((worst, better)) = least_cost_without_one(&current, prior_m) else { break };
        excluded.push(kept.remove(worst));
        estimate = better;
        current = current.without(worst, room);
    }
    Ok(Screened { estimate, excluded })
}

/// The measurement whose absence lowers the cost most, and the position without it.
fn least_cost_without_one(
    problem: &Problem,
    prior_m: Option<Vector<Ecef>>,
) -> Option<(usize, Estimate)> {
    let mut room = Vec::new();
    (0..problem.measurements().len())
        .filter_map(|index| {
            let estimate = solve(&problem.without(index, &mut room), prior_m).ok()?;
            Some((index, estimate))
        })
        .min_by(|(_, a), (_, b)| a.cost.total_cmp(&b.cost))
}
