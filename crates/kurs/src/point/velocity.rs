//! Velocity and clock drift from Doppler shifts.
//!
//! `−λ D = u · (vₛ − v) + c (δṫ − δṫₛ)` (and what the Earth turns meanwhile), linear in `v` and `c δṫ`: one
//! least-squares step.

use nalgebra::{Matrix3, Matrix4, Vector4};
use smallvec::SmallVec;

use super::position::PointSolution;
use super::track::Tracked;
use crate::frames::{EARTH_RATE_RADPS, Ecef, Vector};
use crate::signal::SPEED_OF_LIGHT_MPS;
use crate::sky::{MIN_SIN_ELEVATION, View};

/// Doppler noise at the zenith, m/s.
const DOPPLER_ZENITH_MPS: f64 = 0.02;
/// A range rate that differs from the others by more than this is not used, m/s.
const OUTLIER_MPS: f64 = 1.0;
/// A range rate of less redundance than this (of 1) shows nothing of its error.
const MIN_REDUNDANCY: f64 = 1e-6;

/// Velocity of an antenna and drift of its clock.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Velocity {
    /// ECEF, m/s.
    pub velocity_mps: Vector<Ecef>,
    /// Covariance, ECEF, (m/s)².
    pub covariance_m2ps2: Matrix3<f64>,
    /// Drift of the receiver clock times c, m/s.
    pub clock_drift_mps: f64,
}

/// One satellite's equation: `innovation = row · (v, c δṫ)`.
struct Equation {
    row: Vector4<f64>,
    innovation_mps: f64,
    weight: f64,
}

/// Velocity at the position `point`, from the satellites above the mask that have a Doppler shift;
/// `None` with fewer than four of them, or where no five agree once others had to be left out.
#[must_use]
pub fn velocity(
    tracked: &[Tracked],
    point: &PointSolution,
    elevation_mask_rad: f64,
) -> Option<Velocity> {
    let lowest = point.horizon.lowest_elevation_rad(elevation_mask_rad).sin();
    let of_satellite = |satellite: &Tracked| equation(satellite, point, lowest);
    let mut equations: SmallVec<[Equation; 32]> = tracked.iter().filter_map(of_satellite).collect();
    let mut found = least_squares(&equations)?;
    while let Some(outlier) = outlier(&equations, &found) {
        equations.remove(outlier);
        // What is left must agree with more than itself.
        found = least_squares(&equations).filter(|_| equations.len() > 4)?;
    }
    let (estimate, cofactor) = found;
    Some(Velocity {
        velocity_mps: Vector::new(estimate.x, estimate.y, estimate.z),
        covariance_m2ps2: cofactor.fixed_view::<3, 3>(0, 0).into_owned(),
        clock_drift_mps: estimate.w,
    })
}

/// `None` without Doppler shift, below the elevation whose sine is `lowest`, and for satellites that the
/// position excluded.
fn equation(satellite: &Tracked, point: &PointSolution, lowest: f64) -> Option<Equation> {
    let measured_mps = satellite.range_rate_mps?;
    if point.exclusions.iter().any(|e| e.satellite == satellite.satellite) {
        return None;
    }
    let view = View::new(&satellite.state, point.position_m);
    let sin_elevation = point.horizon.direction(view.line_of_sight).sin_elevation();
    if sin_elevation < lowest {
        return None;
    }
    let u = view.line_of_sight.xyz();
    let root_weight = sin_elevation.max(MIN_SIN_ELEVATION) / DOPPLER_ZENITH_MPS;
    Some(Equation {
        row: Vector4::new(-u.x, -u.y, -u.z, 1.0),
        innovation_mps: measured_mps - satellite_part_mps(satellite, &view),
        weight: root_weight * root_weight,
    })
}

/// Velocity and clock drift, and their covariance; `None` if the equations do not determine them.
fn least_squares(equations: &[Equation]) -> Option<(Vector4<f64>, Matrix4<f64>)> {
    let (mut normal, mut right) = (Matrix4::zeros(), Vector4::zeros());
    for Equation { row, innovation_mps, weight } in equations {
        normal += row * (row * *weight).transpose();
        right += row * (weight * innovation_mps);
    }
    let factor = normal.cholesky().filter(|_| equations.len() >= 4)?;
    let cofactor = factor.inverse();
    Some((cofactor * right, cofactor))
}

/// Of range rates that do not agree, the one with the largest residual in standard deviations of its own,
/// `v² p / (1 − p rowᵀ C row)`: of one error among exact values it is the wrong one, however large the error.
fn outlier(
    equations: &[Equation],
    (estimate, cofactor): &(Vector4<f64>, Matrix4<f64>),
) -> Option<usize> {
    let residual_mps = |e: &Equation| e.innovation_mps - e.row.dot(estimate);
    if equations.iter().all(|e| residual_mps(e).abs() <= OUTLIER_MPS) {
        return None;
    }
    let squared_sigmas = |e: &Equation| {
        let share = 1.0 - e.weight * e.row.dot(&(cofactor * e.row));
        residual_mps(e).powi(2) * e.weight / share.max(MIN_REDUNDANCY)
    };
    let of_each = equations.iter().map(squared_sigmas).enumerate();
    of_each.max_by(|a, b| a.1.total_cmp(&b.1)).map(|(index, _)| index)
}

/// The part of the range rate that does not depend on the antenna's velocity: the satellite's
/// motion, its clock, and the turn of the Earth while the signal travels.
///
/// `ρ = |R(Ω τ) s(t − τ) − r|` gives `ρ̇ = u·v (1 − τ̇) + Ω (uₓ s_y − u_y sₓ) τ̇` with `τ̇ = ρ̇ / c`.
fn satellite_part_mps(satellite: &Tracked, view: &View) -> f64 {
    let (s, u) = (view.satellite_m.xyz(), view.line_of_sight.xyz());
    let radial_mps = u.dot(&view.velocity_mps.xyz());
    let turning_mps = EARTH_RATE_RADPS * (u.x * s.y - u.y * s.x);
    radial_mps * (1.0 + (turning_mps - radial_mps) / SPEED_OF_LIGHT_MPS)
        - SPEED_OF_LIGHT_MPS * satellite.state.clock_drift
}
