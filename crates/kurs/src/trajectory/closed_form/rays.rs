//! Directions: two rays, and a ray with the vertical plane of an azimuth.

use super::super::station::Station;
use super::{DEGENERATE, Refusal, Roots};
use crate::frames::{Ecef, Ned, Vector};

/// Unit vector in a station's axes from its direction cosines to north and east, above the horizon.
///
/// # Errors
///
/// [`Refusal::NotReal`] if the squares sum to more than one, as noise makes them at low elevation.
pub fn direction_from_cosines(cosine_north: f64, cosine_east: f64) -> Result<Vector<Ned>, Refusal> {
    let sum_of_squares = cosine_north * cosine_north + cosine_east * cosine_east;
    // cos θy = √(1 − cos²θx − cos²θz)
    if sum_of_squares <= 1.0 {
        Ok(Vector::new(cosine_north, cosine_east, -(1.0 - sum_of_squares).sqrt()))
    } else {
        Err(Refusal::NotReal { sum_of_squares })
    }
}

/// Two directions, (8)–(11): the point on ray 1 at the distance given by the law of sines.
///
/// What ray 2 says out of the plane of the baseline and ray 1 is not used; least squares does.
///
/// # Errors
///
/// [`Refusal::Parallel`] if the rays are parallel or both along the baseline; [`Refusal::Behind`]
/// if they open away from each other.
pub fn two_rays(stations: [&Station; 2], directions: [Vector<Ned>; 2]) -> Result<Roots, Refusal> {
    let baseline = stations[1].position_m() - stations[0].position_m();
    let length = baseline.norm();
    if length == 0.0 {
        return Err(Refusal::Parallel { sine: 0.0 });
    }
    let along = baseline * (1.0 / length);
    let [ray_1, ray_2] = [stations[0].to_ecef(directions[0]), stations[1].to_ecef(directions[1])];
    // (10): cos δ = u₁·b̂, cos φ = −u₂·b̂; sines from |u × b̂|, exact also near 0 and π
    let (cos_delta, sin_delta) = (ray_1.dot(&along), ray_1.cross(&along).norm());
    let (cos_phi, sin_phi) = (-ray_2.dot(&along), ray_2.cross(&along).norm());
    // (11): sin ψ = sin δ cos φ + cos δ sin φ
    let sin_psi = sin_delta * cos_phi + cos_delta * sin_phi;
    // (9): D₁ = b sin φ / sin ψ
    match sin_psi {
        sine if sine.abs() <= DEGENERATE => Err(Refusal::Parallel { sine }),
        sine if sine < 0.0 => Err(Refusal::Behind),
        sine => {
            let distance_m = length * sin_phi / sine;
            Ok(Roots::one(stations[0].position_m() + ray_1 * distance_m))
        }
    }
}

/// Two directions: the middle of the common perpendicular of the rays, which uses both in full and
/// is closer to least squares than [`two_rays`].
///
/// # Errors
///
/// As [`two_rays`].
pub fn common_perpendicular(
    stations: [&Station; 2],
    directions: [Vector<Ned>; 2],
) -> Result<Roots, Refusal> {
    let baseline = stations[1].position_m() - stations[0].position_m();
    let [ray_1, ray_2] = [stations[0].to_ecef(directions[0]), stations[1].to_ecef(directions[1])];
    let normal = ray_1.cross(&ray_2);
    let sine_squared = normal.dot(&normal);
    if sine_squared.sqrt() <= DEGENERATE {
        return Err(Refusal::Parallel { sine: sine_squared.sqrt() });
    }
    // D₁ = (b × u₂)·n / |n|²,  D₂ = (b × u₁)·n / |n|²,  n = u₁ × u₂
    let distance_1_m = baseline.cross(&ray_2).dot(&normal) / sine_squared;
    let distance_2_m = baseline.cross(&ray_1).dot(&normal) / sine_squared;
    if distance_1_m <= 0.0 || distance_2_m <= 0.0 {
        return Err(Refusal::Behind);
    }
    let foot_1 = stations[0].position_m() + ray_1 * distance_1_m;
    let foot_2 = stations[1].position_m() + ray_2 * distance_2_m;
    Ok(Roots::one(foot_1 + (foot_2 - foot_1) * 0.5))
}

/// A direction from station 1 and an azimuth from station 2: the ray meets the vertical half-plane
/// of the azimuth, (12)–(16) with the plane corrected to −x sin α₂ + z cos α₂ = 0.
///
/// # Errors
///
/// [`Refusal::Parallel`] if the ray runs along the plane; [`Refusal::Behind`] if they meet behind
/// station 1 or in the half-plane behind station 2.
pub fn ray_and_plane(
    ray_station: &Station,
    direction: Vector<Ned>,
    plane_station: &Station,
    azimuth_rad: f64,
) -> Result<Roots, Refusal> {
    let ray = ray_station.to_ecef(direction);
    // (14): r₂ = a₂ t + r₀₂
    let slope = plane_station.to_local(ray).xyz();
    let start = plane_station.sight(ray_station.position_m()).xyz();
    let (sine, cosine) = azimuth_rad.sin_cos();
    let across = |v: &nalgebra::Vector3<f64>| v.y * cosine - v.x * sine;
    let along = |v: &nalgebra::Vector3<f64>| v.x * cosine + v.y * sine;
    if across(&slope).abs() <= DEGENERATE {
        return Err(Refusal::Parallel { sine: across(&slope) });
    }
    // (15): t = −n·r₀₂ / n·a₂
    let distance_m = -across(&start) / across(&slope);
    let forward_m = along(&start) + along(&slope) * distance_m;
    if distance_m > 0.0 && forward_m > 0.0 {
        Ok(Roots::one(on_ray(ray_station, ray, distance_m)))
    } else {
        Err(Refusal::Behind)
    }
}

pub(super) fn on_ray(station: &Station, ray: Vector<Ecef>, distance_m: f64) -> Vector<Ecef> {
    station.position_m() + ray * distance_m
}
