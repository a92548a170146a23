//! Iterated weighted least squares for position, clock and inter-system biases.
//!
//! Model (equations 1 to 14 of `docs/papers/004-three-antennas.md`, corrected), for satellite `s` of system `k`:
//!
//! `P = |xₛ − x| + c (δt + Bₖ) − c δtₛ + I + T`,    `B` of the first system present = 0
//!
//! with the weights `1/σ²` of the noise model, the broadcast orbit and what remains of the
//! atmosphere. Every row has one clock, that of its system: subtracting the weighted mean of each
//! system from its rows leaves three unknowns (`fit.rs`, with the ranges of `ranges.rs`). Satellites that are at fault
//! are found by what the others say (`faults.rs`).

mod faults;
mod fit;
mod ranges;

use nalgebra::Matrix3;

use self::faults::{consensus, least_absolute, without_faults, without_gross_faults};
use self::fit::PositionFit;
use super::track::Tracked;
use crate::ephemeris::NavigationData;
use crate::frames::{Ecef, Vector};
use crate::signal::{Satellite, System};
use crate::sky::{Dop, Horizon, NoiseModel};
use crate::time::GpsTime;

/// Code this far off is a reflection, an imitation, or the signal of a satellite whose orbit is wrong.
const USELESS_M: f64 = 50.0;
/// Above this root mean square the starting point itself may be at fault: begin again from the
/// Earth's centre.
const GROSS_RMS: f64 = 30.0;

/// What the position depends on besides the observations.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PointSettings {
    /// Satellites below are ignored.
    pub elevation_mask_rad: f64,
    /// Code noise.
    pub noise: NoiseModel,
}

/// A satellite that was left out because its residual did not fit the others.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Exclusion {
    /// The satellite.
    pub satellite: Satellite,
    /// Its residual against the others, m.
    pub residual_m: f64,
}

impl Exclusion {
    /// Whether nothing of the satellite is of use, not its phase either: what is tracked is a reflection or an
    /// imitation, or its orbit is wrong, or the time at which it was looked up.
    #[must_use]
    pub fn is_useless(&self) -> bool {
        self.residual_m.abs() > USELESS_M
    }
}

/// Position, clock and what they rest on.
#[derive(Debug, Clone, PartialEq)]
pub struct PointSolution {
    /// Antenna, ECEF, m.
    pub position_m: Vector<Ecef>,
    /// Covariance of the position, ECEF, m²; grown with the residuals where they contradict each other.
    pub covariance_m2: Matrix3<f64>,
    /// Receiver clock against GPST by the first system present: tag − true time, times c, m.
    pub clock_m: f64,
    /// Further systems' clocks against that, m, in the order of [`System::ALL`].
    pub inter_system_m: [Option<f64>; System::ALL.len()],
    /// Geometry of the satellites used.
    pub dop: Dop,
    /// Local level axes at the antenna.
    pub horizon: Horizon,
    /// Number of satellites used.
    pub satellites: usize,
    /// Satellites excluded as faulty.
    pub exclusions: Vec<Exclusion>,
    /// Root mean square of the code residuals over their standard deviations.
    pub unit_weight_rms: f64,
}

/// Why there is no position.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum NoPosition {
    /// Fewer satellites than unknowns.
    #[error("{have} satellites above the mask, {need} are needed")]
    FewSatellites {
        /// Usable satellites.
        have: usize,
        /// Unknowns: three coordinates and one clock for each system.
        need: usize,
    },
    /// The satellites stand so that they do not determine a position.
    #[error("the geometry of the satellites is singular")]
    Singular,
    /// The iteration does not settle, or settles far from the Earth.
    #[error("the iteration does not converge to a place near the Earth")]
    Diverged,
}

/// Solves for the antenna's position from the Earth's centre, and excludes faulty satellites.
///
/// # Errors
///
/// [`NoPosition`] when the satellites are too few, badly placed or contradictory.
pub fn solve(
    tracked: &[Tracked],
    navigation: &NavigationData,
    time: GpsTime,
    settings: &PointSettings,
) -> Result<PointSolution, NoPosition> {
    let mut fit = PositionFit::new(tracked, &navigation.ionosphere, time, settings);
    let converged = fit.converge();
    let mut fit = match converged {
        Ok(()) if fit.is_consistent() => fit,
        _ => without_gross_faults(&fit).unwrap_or(fit),
    };
    fit.near = true;
    solved(fit)
}

/// As [`solve`], from a place where the antenna is likely to be; where that leads nowhere or to gross contradictions,
/// from the Earth's centre.
///
/// # Errors
///
/// As [`solve`].
pub fn solve_near(
    tracked: &[Tracked],
    navigation: &NavigationData,
    time: GpsTime,
    settings: &PointSettings,
    near_m: Vector<Ecef>,
) -> Result<PointSolution, NoPosition> {
    let mut fit = PositionFit::new(tracked, &navigation.ionosphere, time, settings);
    (fit.position_m, fit.near) = (near_m.xyz(), true);
    match solved(fit) {
        Ok(solution) if solution.unit_weight_rms < GROSS_RMS => Ok(solution),
        contradictory => solve(tracked, navigation, time, settings).or(contradictory),
    }
}

fn solved(mut fit: PositionFit<'_>) -> Result<PointSolution, NoPosition> {
    fit.converge()?;
    if fit.is_consistent() {
        return fit.solution();
    }
    if let Some(explained) = without_faults(&fit) {
        return explained.solution();
    }
    let Some(central) = least_absolute(&fit) else { return fit.solution() };
    let apart_m = central.position_m - fit.position_m;
    if let Some(explained) = consensus(&fit, central) {
        return explained.solution();
    }
    // Unexplained misfit stays in the residuals. If the fits of least squares and of least sizes differ,
    // their separation is added to the covariance.
    let mut solution = fit.solution()?;
    solution.covariance_m2 += apart_m * apart_m.transpose();
    Ok(solution)
}
