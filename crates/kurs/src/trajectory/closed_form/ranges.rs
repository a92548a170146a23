//! Ranges: one with a direction, and three from three beacons.

use super::super::station::Station;
use super::{Refusal, Roots};
use crate::frames::{Ecef, Ned, Vector};

/// Squared height over the beacon plane, relative to the squared range, that counts as zero.
const TOUCHING: f64 = 1e-12;
/// Sine between the beacon directions that counts as collinear.
const COLLINEAR: f64 = 1e-10;

/// A range and a direction from one station: r = b + d Φ (cos γ cos α, sin γ, cos γ sin α).
///
/// # Errors
///
/// [`Refusal::Behind`] if the range is not positive.
pub fn range_and_direction(
    station: &Station,
    range_m: f64,
    direction: Vector<Ned>,
) -> Result<Roots, Refusal> {
    if range_m > 0.0 {
        Ok(Roots::one(station.position_m() + station.to_ecef(direction) * range_m))
    } else {
        Err(Refusal::Behind)
    }
}

/// Three ranges: trilateration in the axes of the beacon plane. Both mirror images are roots.
///
/// # Errors
///
/// [`Refusal::Parallel`] for collinear beacons, [`Refusal::NoIntersection`] if the spheres do not
/// meet, [`Refusal::Tangent`] if the object is in the plane of the beacons.
pub fn three_ranges(beacons_m: [Vector<Ecef>; 3], ranges_m: [f64; 3]) -> Result<Roots, Refusal> {
    let [first, second, third] = beacons_m;
    let (to_second, to_third) = (second - first, third - first);
    // Axes of the beacon plane: x to beacon 2, beacon 3 at (i, j), z across
    let d = to_second.norm();
    let x_axis = to_second * (1.0 / d);
    let i = to_third.dot(&x_axis);
    let aside = to_third - x_axis * i;
    let j = aside.norm();
    let sine = j / to_third.norm();
    // A length of zero makes the sine not a number: that is singular too.
    if sine.is_nan() || d == 0.0 || sine <= COLLINEAR {
        return Err(Refusal::Parallel { sine });
    }
    let y_axis = aside * (1.0 / j);

    let [d1, d2, d3] = ranges_m;
    // x = (d₁² − d₂² + d²) / 2d,  y = (d₁² − d₃² + i² + j² − 2ix) / 2j,  z² = d₁² − x² − y²
    let x = ((d1 - d2) * (d1 + d2) + d * d) / (2.0 * d);
    let y = ((d1 - d3) * (d1 + d3) + i * i + j * j - 2.0 * i * x) / (2.0 * j);
    let in_plane = x.hypot(y);
    let z_squared = (d1 - in_plane) * (d1 + in_plane);

    let foot = first + x_axis * x + y_axis * y;
    if z_squared.abs() <= TOUCHING * (d1 * d1 + in_plane * in_plane) {
        return Err(Refusal::Tangent { touch_m: foot });
    }
    if z_squared < 0.0 {
        return Err(Refusal::NoIntersection { squared: z_squared });
    }
    let across = x_axis.cross(&y_axis) * z_squared.sqrt();
    Ok(Roots { first_m: foot + across, second_m: Some(foot - across) })
}
