//! Velocity and clock drift from Doppler shifts.
//!
//! `−λ D = u · (vₛ − v) + c (δṫ − δṫₛ)` (and what the Earth turns meanwhile), linear in `v` and `c δṫ`: one least-squares step.

use nalgebra::{Matrix3, Matrix4, Vector4};

use super::position::PointSolution;
use super::track::Tracked;
use crate::frames::{EARTH_RATE_RADPS, Ecef, Vector};
use crate::signal::SPEED_OF_LIGHT_MPS;
use crate::sky::View;

/// Doppler noise at the zenith and full signal strength, m/s.
const DOPPLER_ZENITH_MPS: f64 = 0.02;
/// A range rate that differs from the others by more than this is not used, m/s.
const OUTLIER_MPS: f64 = 1.0;

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

/// Velocity at the position `point`, from the satellites above the mask that have a Doppler shift;
/// `None` with fewer than four of them.
#[must_use]
pub fn velocity(
    tracked: &[Tracked],
    point: &PointSolution,
    elevation_mask_rad: f64,
) -> Option<Velocity> {
    let lowest_rad = point.horizon.lowest_elevation_rad(elevation_mask_rad);
    let mut estimate = Vector4::zeros();
    // The second pass leaves out what the first shows to be an outlier.
    for pass in 0..2 {
        let mut normal = Matrix4::zeros();
        let mut right = Vector4::zeros();
        let mut count = 0;
        for satellite in tracked {
            if point.exclusions.iter().any(|e| e.satellite == satellite.satellite) {
                continue;
            }
            let Some(measured_mps) = satellite.range_rate_mps else { continue };
            let view = View::new(&satellite.state, point.position_m);
            let elevation_rad = point.horizon.direction(view.line_of_sight).elevation_rad;
            if elevation_rad < lowest_rad {
                continue;
            }
            let u = view.line_of_sight.xyz();
            let row = Vector4::new(-u.x, -u.y, -u.z, 1.0);
            let innovation_mps = measured_mps - satellite_part_mps(satellite, &view);
            if pass > 0 && (innovation_mps - row.dot(&estimate)).abs() > OUTLIER_MPS {
                continue;
            }
            let sigma_mps = DOPPLER_ZENITH_MPS / elevation_rad.sin().max(0.087);
            let weight = 1.0 / (sigma_mps * sigma_mps);
            normal += row * row.transpose() * weight;
            right += row * (weight * innovation_mps);
            count += 1;
        }
        if count < 4 {
            return None;
        }
        let cofactor = normal.cholesky()?.inverse();
        estimate = cofactor * right;
        if pass > 0 {
            return Some(Velocity {
                velocity_mps: Vector::new(estimate.x, estimate.y, estimate.z),
                covariance_m2ps2: cofactor.fixed_view::<3, 3>(0, 0).into_owned(),
                clock_drift_mps: estimate.w,
            });
        }
    }
    None
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
