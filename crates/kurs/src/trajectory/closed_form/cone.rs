//! A ray and the cone of an elevation.

use super::super::station::Station;
use super::rays::on_ray;
use super::{DEGENERATE, Refusal, Roots};
use crate::frames::{Ned, Vector};

/// A leading coefficient below this belongs to a ray parallel to a generatrix: a linear equation.
const PARALLEL_TO_GENERATRIX: f64 = 1e-14;

/// A direction from station 1 and an elevation from station 2, (17)–(20): the ray meets the cone
/// about the vertical of station 2, multiplied by sin²θ so that it is regular at the zenith.
///
/// The two roots are often both admissible and far apart: choose by a prior position.
///
/// # Errors
///
/// [`Refusal::NoIntersection`] if the ray misses the cone, [`Refusal::Tangent`] if it touches it,
/// [`Refusal::Behind`] if all roots are behind station 1 or on the other half of the cone,
/// [`Refusal::Parallel`] if the ray runs through station 2.
pub fn ray_and_cone(
    ray_station: &Station,
    direction: Vector<Ned>,
    cone_station: &Station,
    elevation_rad: f64,
) -> Result<Roots, Refusal> {
    let ray = ray_station.to_ecef(direction);
    // (14) in the axes of station 2: horizontal and vertical parts of r₂ = a t + r₀
    let slope = cone_station.to_local(ray).xyz();
    let start = cone_station.sight(ray_station.position_m()).xyz();
    let (slope_up, start_up) = (-slope.z, -start.z);
    let (slope_h, start_h) = (slope.xy(), start.xy());
    let (sine, cosine) = elevation_rad.sin_cos();
    let (s2, c2) = (sine * sine, cosine * cosine);

    // (19): A t² + 2B t + C = 0
    let a = slope_h.norm_squared() * s2 - slope_up * slope_up * c2;
    let b = slope_h.dot(&start_h) * s2 - slope_up * start_up * c2;
    let c = start_h.norm_squared() * s2 - start_up * start_up * c2;
    // B² − AC = sin²γ (c²p² − s²q²),  p = |a_up r_h − r_up a_h|,  q = |a_h × r_h|:
    // the same number without its cancellation
    let p = (start_h * slope_up - slope_h * start_up).norm();
    let q = (slope_h.x * start_h.y - slope_h.y * start_h.x).abs();
    let (wide, narrow) = (cosine.abs() * p, sine.abs() * q);

    let scale = start.norm();
    if p.max(q) <= DEGENERATE * scale {
        return Err(Refusal::Parallel { sine: p.max(q) / scale });
    }
    if a.abs() > PARALLEL_TO_GENERATRIX && (wide - narrow).abs() <= DEGENERATE * scale {
        return Err(Refusal::Tangent { touch_m: on_ray(ray_station, ray, -b / a) });
    }
    if wide < narrow {
        return Err(Refusal::NoIntersection { squared: s2 * (wide + narrow) * (wide - narrow) });
    }

    let admissible = |distance_m: f64| {
        let up = start_up + slope_up * distance_m;
        let half = up * sine > 0.0 || sine.abs() <= DEGENERATE;
        (distance_m > 0.0 && half).then(|| on_ray(ray_station, ray, distance_m))
    };
    let root = sine.abs() * ((wide + narrow) * (wide - narrow)).sqrt();
    let [first, second] = quadratic_roots(a, b, c, root);
    let twice = first == second;
    Roots::from_pair([admissible(first), if twice { None } else { admissible(second) }])
}

/// Roots of A t² + 2B t + C = 0 from √(B² − AC), without cancellation; equal if there is one.
fn quadratic_roots(a: f64, b: f64, c: f64, root: f64) -> [f64; 2] {
    if a.abs() < PARALLEL_TO_GENERATRIX {
        return [-c / (2.0 * b); 2];
    }
    // q = −(B + sign(B) √D);  t₁ = q / A,  t₂ = C / q
    let q = -(b + root.copysign(b));
    if root == 0.0 || q == 0.0 { [-b / a; 2] } else { [q / a, c / q] }
}
