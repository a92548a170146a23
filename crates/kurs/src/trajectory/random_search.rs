//! Random search for the minimum of (21), kept to compare with least squares.
//!
//! A Gaussian step in all directions that grows after a success and shrinks after failures. It finds
//! well-shaped minima, but creeps along narrow ravines: see `docs/experiments/trajectory.md`.

use nalgebra::Vector3;

use super::problem::Problem;
use crate::frames::{Ecef, Vector};

/// Factor on the step after a success; failures shrink it so that one success in five is neutral.
const GROWTH: f64 = 1.5;

/// How to search.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SearchSettings {
    /// Standard deviation of the first steps, m.
    pub first_step_m: f64,
    /// Steps shorter than this end the search, m.
    pub last_step_m: f64,
    /// Most evaluations of the cost.
    pub evaluations: usize,
}

/// Where the search ended.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Found {
    /// Best position.
    pub position_m: Vector<Ecef>,
    /// Its sum of squared weighted residuals.
    pub cost: f64,
    /// Evaluations of the cost that it took.
    pub evaluations: usize,
}

/// Searches from a start; `standard_normal` gives independent numbers of mean 0 and variance 1.
pub fn random_search(
    problem: &Problem,
    start_m: Vector<Ecef>,
    settings: &SearchSettings,
    standard_normal: &mut impl FnMut() -> f64,
) -> Found {
    let shrink = GROWTH.powf(-0.25);
    let cost_at = |position_m| problem.normal(position_m).cost;
    let mut found = Found { position_m: start_m, cost: cost_at(start_m), evaluations: 1 };
    let mut step_m = settings.first_step_m;
    while found.evaluations < settings.evaluations && step_m > settings.last_step_m {
        let step = Vector3::from_fn(|_, _| standard_normal()) * step_m;
        let position_m = found.position_m + Vector::from_xyz(step);
        let cost = cost_at(position_m);
        found.evaluations += 1;
        if cost < found.cost {
            (found.position_m, found.cost) = (position_m, cost);
            step_m *= GROWTH;
        } else {
            step_m *= shrink;
        }
    }
    found
}
