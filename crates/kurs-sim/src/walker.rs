//! Satellites on circular orbits: a Walker constellation.

use core::f64::consts::TAU;

use kurs::frames::EARTH_RATE_RADPS;
use nalgebra::Vector3;

/// Gravitational constant of the Earth, m³/s² (WGS 84).
pub(crate) const GM_M3PS2: f64 = 3.986_004_418e14;

/// A Walker constellation i : T/P/F of circular orbits, seen in ECEF.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Walker {
    /// Orbit radius.
    pub radius_m: f64,
    /// i.
    pub inclination_rad: f64,
    /// P.
    pub planes: u16,
    /// T/P.
    pub per_plane: u16,
    /// F, phase between neighbouring planes in units of 2π/T.
    pub phasing: u16,
    /// Longitude of the first ascending node in ECEF at time zero.
    pub first_node_rad: f64,
    /// Argument of latitude of the first satellite at time zero.
    pub first_latitude_argument_rad: f64,
}

/// ECEF position and velocity.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SatelliteTruth {
    /// Position.
    pub position_m: Vector3<f64>,
    /// Velocity relative to the turning Earth.
    pub velocity_mps: Vector3<f64>,
}

impl Walker {
    /// The constellation of the rotating-arm reference: 30/6/1, nine satellites above 10° at
    /// 55.75° N 37.62° E at time zero, at elevations 73.5° to 11.3°.
    #[must_use]
    pub fn rotating_arm_reference() -> Self {
        Self {
            radius_m: 26.56e6,
            inclination_rad: 55f64.to_radians(),
            planes: 6,
            per_plane: 5,
            phasing: 1,
            first_node_rad: 58f64.to_radians(),
            first_latitude_argument_rad: 60f64.to_radians(),
        }
    }

    /// Every satellite at a time.
    #[must_use]
    pub fn at(&self, time_s: f64) -> Vec<SatelliteTruth> {
        let rate = (GM_M3PS2 / self.radius_m.powi(3)).sqrt();
        let total = f64::from(self.planes * self.per_plane);
        let mut satellites = Vec::with_capacity(usize::from(self.planes * self.per_plane));
        for plane in 0..self.planes {
            let node = self.first_node_rad + TAU * f64::from(plane) / f64::from(self.planes)
                - EARTH_RATE_RADPS * time_s;
            for place in 0..self.per_plane {
                let u = self.first_latitude_argument_rad
                    + TAU * f64::from(place) / f64::from(self.per_plane)
                    + TAU * f64::from(self.phasing) * f64::from(plane) / total
                    + rate * time_s;
                satellites.push(self.satellite(node, u, rate));
            }
        }
        satellites
    }

    fn satellite(&self, node: f64, u: f64, rate: f64) -> SatelliteTruth {
        let (sin_node, cos_node) = node.sin_cos();
        let (sin_i, cos_i) = self.inclination_rad.sin_cos();
        let (sin_u, cos_u) = u.sin_cos();
        let towards_node = Vector3::new(cos_node, sin_node, 0.0);
        let ahead = Vector3::new(-sin_node * cos_i, cos_node * cos_i, sin_i);
        let position_m = (towards_node * cos_u + ahead * sin_u) * self.radius_m;
        let inertial = (ahead * cos_u - towards_node * sin_u) * (self.radius_m * rate);
        let earth = Vector3::new(0.0, 0.0, EARTH_RATE_RADPS);
        SatelliteTruth { position_m, velocity_mps: inertial - earth.cross(&position_m) }
    }
}

/// Elevation of a direction above the horizon of an ECEF position, rad.
#[must_use]
pub fn elevation_rad(from_m: &Vector3<f64>, up: &Vector3<f64>, to_m: &Vector3<f64>) -> f64 {
    (to_m - from_m).normalize().dot(up).asin()
}

#[cfg(test)]
mod tests {
    use super::*;
    use kurs::frames::Geodetic;

    #[test]
    fn velocity_is_the_derivative_of_position() {
        let walker = Walker::rotating_arm_reference();
        let (after, at, before) = (walker.at(100.5), walker.at(100.0), walker.at(99.5));
        for k in 0..30 {
            let difference = after[k].position_m - before[k].position_m;
            assert!((difference - at[k].velocity_mps).norm() < 1e-4);
        }
    }

    /// Elevations stated by the reference, which does not give the orbits: nine within 0.2°.
    #[test]
    fn nine_satellites_at_the_reference_site() {
        let site = Geodetic::from_degrees(55.75, 37.62, 200.0);
        let up = -(site.ecef_from_ned().matrix().column(2).into_owned());
        let position_m = site.to_ecef().xyz();
        let mut elevations: Vec<f64> = Walker::rotating_arm_reference()
            .at(0.0)
            .iter()
            .map(|s| elevation_rad(&position_m, &up, &s.position_m).to_degrees())
            .filter(|elevation| *elevation > 10.0)
            .collect();
        elevations.sort_by(|a, b| b.total_cmp(a));
        let expected = [73.5, 65.6, 47.9, 37.9, 31.2, 23.4, 20.1, 17.3, 11.3];
        assert_eq!(elevations.len(), expected.len());
        for (found, expected) in elevations.iter().zip(expected) {
            assert!((found - expected).abs() < 0.2, "{found} {expected}");
        }
    }
}
