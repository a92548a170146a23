//! Weighted least squares for any mixture of measurements: equations (1) and (2).
//!
//! [`solve`] starts from a closed form and goes on with Gauss–Newton; Levenberg–Marquardt stands
//! behind it, and a multiple start is used only where no closed form exists.

use nalgebra::Matrix3;

use super::closed_form::Roots;
use super::minimal_set::MinimalSet;
use super::problem::{Normal, Problem};
use crate::frames::{Ecef, Vector};

/// A step shorter than this many standard deviations ends the iteration.
const CONVERGED_SIGMAS: f64 = 1e-7;
/// So does one that rounding hides, relative to the length of the position.
const ROUNDING: f64 = 4.0 * f64::EPSILON;
const MAX_GAUSS_NEWTON: usize = 20;
const MAX_HALVINGS: usize = 8;
const MAX_LEVENBERG_MARQUARDT: usize = 200;
/// Damping beyond which no step helps.
const MAX_DAMPING: f64 = 1e12;
/// A cost less likely than this under the model makes [`solve`] look for another minimum.
const SUSPICIOUS: f64 = 1e-6;
/// A minimum whose cost is above the best by less than this is a rival.
const RIVAL_COST: f64 = 16.0;
/// A standard deviation of this many distances to a station comes from rounding errors: in truth
/// the geometry leaves a direction open.
const SENSELESS: f64 = 1e3;

/// A position with its accuracy.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimate {
    /// The position in the common frame.
    pub position_m: Vector<Ecef>,
    /// (2): K = (ZᵀWZ)⁻¹ at that position, common frame.
    pub covariance_m2: Matrix3<f64>,
    /// Sum of squared weighted residuals, χ² with `degrees_of_freedom`.
    pub cost: f64,
    /// Measurements beyond three.
    pub degrees_of_freedom: usize,
    /// Steps taken.
    pub iterations: usize,
    /// What found it.
    pub method: Method,
    /// Another minimum, away from this one, whose cost is larger by less than 16 (four standard
    /// deviations); known only where the search came across it.
    pub rival_m: Option<Vector<Ecef>>,
}

/// What found a position.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Method {
    /// Gauss–Newton from the start given or from a closed form.
    GaussNewton,
    /// Levenberg–Marquardt, after Gauss–Newton failed.
    LevenbergMarquardt,
    /// Levenberg–Marquardt from many starts, as there was no closed form.
    MultipleStart,
}

/// Why there is no least-squares position.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum NotSolved {
    /// Fewer measurements than unknowns.
    #[error("{have} measurements do not give a position, 3 are needed")]
    TooFew {
        /// How many there are.
        have: usize,
    },
    /// The measurements leave a direction undetermined.
    #[error("the geometry does not determine the position")]
    Singular,
    /// The iteration did not settle.
    #[error("no convergence in {iterations} iterations")]
    NotConverged {
        /// Where it was given up.
        iterations: usize,
    },
}

impl Estimate {
    /// Probability of residuals at least this large if the standard deviations are right.
    #[must_use]
    pub fn likelihood(&self) -> f64 {
        crate::chi_square::chi_square_tail(self.cost, self.degrees_of_freedom)
    }

    /// Whether a position is the same minimum: within a thousandth of the standard deviation.
    fn within_noise(&self, position_m: Vector<Ecef>) -> bool {
        let allowed = 1e-3 * self.covariance_m2.trace().sqrt() + ROUNDING * position_m.norm();
        (self.position_m - position_m).norm() <= allowed
    }
}

/// The position that fits all measurements best.
///
/// With a `prior_m`, of two closed-form roots only the nearer to it is followed; without, both are,
/// and the one of less cost is taken. A minimum that fits nearly as well is kept as
/// [`Estimate::rival_m`]: then the measurements alone do not tell which is the object.
///
/// # Errors
///
/// [`NotSolved`].
pub fn solve(problem: &Problem, prior_m: Option<Vector<Ecef>>) -> Result<Estimate, NotSolved> {
    enough(problem)?;
    let mut best: Option<Estimate> = None;
    for set in MinimalSet::find(problem) {
        let Ok(roots) = set.roots(problem) else { continue };
        best = match prior_m {
            Some(prior) => better(best, refine(problem, nearest(&roots, prior)).ok()),
            None => roots.iter().fold(best, |best, root| better(best, refine(problem, root).ok())),
        };
        if best.is_some_and(|estimate| estimate.likelihood() >= SUSPICIOUS) {
            break;
        }
    }
    if let (None, Some(prior)) = (best, prior_m) {
        best = refine(problem, prior).ok();
    }
    if best.is_none_or(|estimate| estimate.likelihood() < SUSPICIOUS) {
        best = better(best, multiple_start(problem).ok());
    }
    best.ok_or(NotSolved::Singular)
}

/// Gauss–Newton from a start, and Levenberg–Marquardt if that fails.
///
/// # Errors
///
/// [`NotSolved`].
pub fn refine(problem: &Problem, start_m: Vector<Ecef>) -> Result<Estimate, NotSolved> {
    gauss_newton(problem, start_m).or_else(|_| levenberg_marquardt(problem, start_m))
}

/// Equation (1), with each step halved until the cost does not grow.
///
/// # Errors
///
/// [`NotSolved`].
pub fn gauss_newton(problem: &Problem, start_m: Vector<Ecef>) -> Result<Estimate, NotSolved> {
    enough(problem)?;
    let mut position_m = start_m;
    let mut normal = problem.normal(position_m);
    for iterations in 1..=MAX_GAUSS_NEWTON {
        // ΔX = (ZᵀWZ)⁻¹ ZᵀW (Y − Y_calc(X))
        let step = normal.step(0.0).ok_or(NotSolved::Singular)?;
        let in_sigmas_squared = step.dot(&normal.right);
        let mut step_m = Vector::from_xyz(step);
        let settled = in_sigmas_squared <= CONVERGED_SIGMAS * CONVERGED_SIGMAS
            || step_m.norm() <= ROUNDING * position_m.norm();
        if settled {
            normal.cost = (normal.cost - in_sigmas_squared).max(0.0);
            let method = Method::GaussNewton;
            return estimate(problem, position_m + step_m, &normal, iterations, method);
        }
        let mut next = problem.normal(position_m + step_m);
        for _ in 0..MAX_HALVINGS {
            if !worse(&next, &normal) {
                break;
            }
            step_m = step_m * 0.5;
            next = problem.normal(position_m + step_m);
        }
        if worse(&next, &normal) {
            return Err(NotSolved::NotConverged { iterations });
        }
        position_m += step_m;
        normal = next;
    }
    Err(NotSolved::NotConverged { iterations: MAX_GAUSS_NEWTON })
}

/// Levenberg–Marquardt with Marquardt's scaling by the diagonal of ZᵀWZ.
///
/// # Errors
///
/// [`NotSolved`].
pub fn levenberg_marquardt(
    problem: &Problem,
    start_m: Vector<Ecef>,
) -> Result<Estimate, NotSolved> {
    enough(problem)?;
    let mut position_m = start_m;
    let mut normal = problem.normal(position_m);
    let mut damping = 1e-3;
    for iterations in 1..=MAX_LEVENBERG_MARQUARDT {
        let undamped = normal.step(0.0);
        if let Some(step) = undamped
            && (step.dot(&normal.right) <= CONVERGED_SIGMAS * CONVERGED_SIGMAS
                || step.norm() <= ROUNDING * position_m.norm())
        {
            let method = Method::LevenbergMarquardt;
            return estimate(problem, position_m, &normal, iterations, method);
        }
        let Some(step) = normal.step(damping) else { return Err(NotSolved::Singular) };
        let next_m = position_m + Vector::from_xyz(step);
        let next = problem.normal(next_m);
        if next.cost < normal.cost {
            (position_m, normal) = (next_m, next);
            damping = (damping * 0.1).max(1e-12);
        } else {
            damping *= 10.0;
            if damping > MAX_DAMPING {
                return Err(NotSolved::NotConverged { iterations });
            }
        }
    }
    Err(NotSolved::NotConverged { iterations: MAX_LEVENBERG_MARQUARDT })
}

/// Levenberg–Marquardt from a fixed pattern of starts around the stations, the best result taken.
///
/// # Errors
///
/// [`NotSolved::Singular`] if none of them converges.
pub fn multiple_start(problem: &Problem) -> Result<Estimate, NotSolved> {
    enough(problem)?;
    let places: Vec<Vector<Ecef>> =
        problem.measurements().iter().map(|m| problem.stations()[m.station].position_m()).collect();
    let centre = places.iter().fold(Vector::new(0.0, 0.0, 0.0), |sum, place| sum + *place)
        * (1.0 / places.len() as f64);
    let spread = places.iter().map(|place| (*place - centre).norm()).fold(1e3, f64::max);
    let mut best: Option<Estimate> = None;
    for distance in [0.3, 1.0, 3.0].map(|factor| factor * spread) {
        for direction in PATTERN {
            let [x, y, z] = direction;
            let start = centre + Vector::new(x, y, z).direction() * distance;
            best = better(best, levenberg_marquardt(problem, start).ok());
        }
    }
    best.map(|estimate| Estimate { method: Method::MultipleStart, ..estimate })
        .ok_or(NotSolved::Singular)
}

/// Directions of [`multiple_start`]: the faces and corners of a cube.
const PATTERN: [[f64; 3]; 14] = [
    [1.0, 0.0, 0.0],
    [-1.0, 0.0, 0.0],
    [0.0, 1.0, 0.0],
    [0.0, -1.0, 0.0],
    [0.0, 0.0, 1.0],
    [0.0, 0.0, -1.0],
    [1.0, 1.0, 1.0],
    [1.0, 1.0, -1.0],
    [1.0, -1.0, 1.0],
    [1.0, -1.0, -1.0],
    [-1.0, 1.0, 1.0],
    [-1.0, 1.0, -1.0],
    [-1.0, -1.0, 1.0],
    [-1.0, -1.0, -1.0],
];

fn enough(problem: &Problem) -> Result<(), NotSolved> {
    let have = problem.measurements().len();
    if have < 3 { Err(NotSolved::TooFew { have }) } else { Ok(()) }
}

fn nearest(roots: &Roots, prior_m: Vector<Ecef>) -> Vector<Ecef> {
    match roots.second_m {
        Some(other) if (other - prior_m).norm() < (roots.first_m - prior_m).norm() => other,
        _ => roots.first_m,
    }
}

/// Whether a step has raised the cost by more than rounding does.
fn worse(next: &Normal, now: &Normal) -> bool {
    next.cost.is_nan() || next.cost > now.cost + 1e-9 * (1.0 + now.cost)
}

/// The one of less cost; the other, if it is another point that fits nearly as well, as its rival.
fn better(one: Option<Estimate>, other: Option<Estimate>) -> Option<Estimate> {
    let (Some(a), Some(b)) = (one, other) else { return one.or(other) };
    let (best, second) = if b.cost < a.cost { (b, a) } else { (a, b) };
    let rival_m = [Some(second.position_m), best.rival_m, second.rival_m]
        .into_iter()
        .flatten()
        .find(|_| second.cost - best.cost < RIVAL_COST)
        .filter(|rival| !best.within_noise(*rival))
        .or(best.rival_m);
    Some(Estimate { rival_m, ..best })
}

fn estimate(
    problem: &Problem,
    position_m: Vector<Ecef>,
    normal: &Normal,
    iterations: usize,
    method: Method,
) -> Result<Estimate, NotSolved> {
    let covariance_m2 = normal.covariance().ok_or(NotSolved::Singular)?;
    let station = &problem.stations()[problem.measurements()[0].station];
    let distance_m = (position_m - station.position_m()).norm();
    let sigma_m = covariance_m2.trace().sqrt();
    if sigma_m.is_nan() || sigma_m >= SENSELESS * distance_m {
        return Err(NotSolved::Singular);
    }
    let cost = normal.cost;
    let degrees_of_freedom = problem.degrees_of_freedom();
    Ok(Estimate {
        position_m,
        covariance_m2,
        cost,
        degrees_of_freedom,
        iterations,
        method,
        rival_m: None,
    })
}
