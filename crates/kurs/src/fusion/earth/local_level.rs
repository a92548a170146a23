//! The local level axes and gravity at the centre of rotation, and how they turn as it moves.

use nalgebra::{Matrix3, Vector3};

use super::gravity::normal_gravity_mps2;
use crate::frames::{Ecef, Geodetic, Vector};

/// North-up-east axes and gravity at a point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LocalLevel {
    /// T_EN.
    pub nhe_from_ecef: Matrix3<f64>,
    /// û_H in ECEF axes.
    pub up: Vector3<f64>,
    /// γ, m/s².
    pub gravity_mps2: f64,
}

/// First-order change of [`LocalLevel`] with the position.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LevelDerivative {
    /// Ψ, rad/m: moving by δ (ECEF, m) turns the level axes by the rotation vector Ψ δ (ECEF axes).
    pub turning: Matrix3<f64>,
    /// ∇γ in ECEF axes, 1/s².
    pub gravity_gradient: Vector3<f64>,
}

/// North-up-east components (T_EN, equation 27 of the rotating-frame paper) from ECEF components.
#[must_use]
pub fn nhe_from_ecef(at: &Geodetic) -> Matrix3<f64> {
    let (sin_lat, cos_lat) = at.latitude_rad.sin_cos();
    let (sin_lon, cos_lon) = at.longitude_rad.sin_cos();
    Matrix3::new(
        -cos_lon * sin_lat,
        -sin_lon * sin_lat,
        cos_lat,
        cos_lon * cos_lat,
        sin_lon * cos_lat,
        sin_lat,
        -sin_lon,
        cos_lon,
        0.0,
    )
}

impl LocalLevel {
    /// At an ECEF position, m.
    #[must_use]
    pub fn at(position_m: &Vector3<f64>) -> Self {
        let here = Geodetic::from_ecef(Vector::<Ecef>::from_xyz(*position_m));
        let nhe_from_ecef = nhe_from_ecef(&here);
        Self {
            nhe_from_ecef,
            up: nhe_from_ecef.row(1).transpose(),
            gravity_mps2: normal_gravity_mps2(here.latitude_rad, here.height_m),
        }
    }

    /// Its derivative at an ECEF position, m; not a number at the poles, where east is undefined.
    #[must_use]
    pub fn derivative_at(position_m: &Vector3<f64>) -> LevelDerivative {
        let here = Geodetic::from_ecef(Vector::<Ecef>::from_xyz(*position_m));
        let axes = nhe_from_ecef(&here);
        let [north, up, east] = [0, 1, 2].map(|row| axes.row(row).transpose());
        let cos_lat = here.latitude_rad.cos();
        let [meridian_m, across_m] = here.curvature_radii_m();
        let latitude_gradient = north / (meridian_m + here.height_m);
        let longitude_gradient = east / ((across_m + here.height_m) * cos_lat);
        // Going north turns the axes about west, going east about the Earth's axis.
        let turning =
            -east * latitude_gradient.transpose() + Vector3::z() * longitude_gradient.transpose();
        // The formula of γ is smooth: its differences are good to 1e-10 of its gradient.
        let (step_rad, step_m) = (1e-4, 100.0);
        let gamma = |latitude, height| normal_gravity_mps2(latitude, height);
        let by_latitude = (gamma(here.latitude_rad + step_rad, here.height_m)
            - gamma(here.latitude_rad - step_rad, here.height_m))
            / (2.0 * step_rad);
        let by_height = (gamma(here.latitude_rad, here.height_m + step_m)
            - gamma(here.latitude_rad, here.height_m - step_m))
            / (2.0 * step_m);
        let gravity_gradient = latitude_gradient * by_latitude + up * by_height;
        LevelDerivative { turning, gravity_gradient }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn derivative_agrees_with_differences() {
        let at = Geodetic::from_degrees(-41.3, 174.8, 3200.0).to_ecef().xyz();
        let derivative = LocalLevel::derivative_at(&at);
        let here = LocalLevel::at(&at);
        let step = 200.0;
        for axis in 0..3 {
            let mut h = Vector3::zeros();
            h[axis] = step;
            let (after, before) = (LocalLevel::at(&(at + h)), LocalLevel::at(&(at - h)));
            // ecef_from_nhe turns: Ċ Cᵀ = [Ψ δ ×]
            let change = (after.nhe_from_ecef - before.nhe_from_ecef).transpose() / (2.0 * step);
            let skew = change * here.nhe_from_ecef;
            let expected = derivative.turning.column(axis).into_owned().cross_matrix();
            assert!((skew - expected).norm() < 1e-15, "{skew} {expected}");
            let change = (after.gravity_mps2 - before.gravity_mps2) / (2.0 * step);
            assert!((change - derivative.gravity_gradient[axis]).abs() < 1e-12);
        }
    }
}
