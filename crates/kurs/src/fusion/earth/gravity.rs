//! Normal gravity of the WGS 84 ellipsoid.

use crate::frames::{E2, WGS84_A_M, WGS84_F};

/// Normal gravity at the equator, m/s² (NIMA TR8350.2, table 3.4).
const EQUATOR_MPS2: f64 = 9.780_325_335_9;
/// Somigliana's constant k = b γₚ / (a γₑ) − 1 (NIMA TR8350.2, table 3.4).
const SOMIGLIANA: f64 = 0.001_931_852_652_41;
/// m = Ω² a² b / GM (NIMA TR8350.2, table 3.4).
const CENTRIFUGAL: f64 = 0.003_449_786_506_84;

/// Normal gravity at a geodetic latitude and height above the ellipsoid: what a resting plumb line
/// feels, centrifugal part of the turning Earth included.
///
/// Source: NIMA TR8350.2, equations 4-1 and 4-3; the height series is good to a few µm/s² up to
/// 20 km.
#[must_use]
pub fn normal_gravity_mps2(latitude_rad: f64, height_m: f64) -> f64 {
    let sin2 = latitude_rad.sin().powi(2);
    // γ₀ = γₑ (1 + k sin²φ) / √(1 − e² sin²φ)
    let at_ellipsoid = EQUATOR_MPS2 * (1.0 + SOMIGLIANA * sin2) / (1.0 - E2 * sin2).sqrt();
    // γ = γ₀ [1 − 2 (1 + f + m − 2 f sin²φ) h/a + 3 h²/a²]
    let h = height_m / WGS84_A_M;
    let slope = 1.0 + WGS84_F + CENTRIFUGAL - 2.0 * WGS84_F * sin2;
    at_ellipsoid * (1.0 - 2.0 * slope * h + 3.0 * h * h)
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::f64::consts::FRAC_PI_2;

    /// Polar normal gravity 9.8321849378 m/s² is a published constant that the formula does not
    /// contain.
    #[test]
    fn published_values_at_equator_and_pole() {
        assert!((normal_gravity_mps2(0.0, 0.0) - 9.780_325_335_9).abs() < 1e-12);
        assert!((normal_gravity_mps2(FRAC_PI_2, 0.0) - 9.832_184_937_8).abs() < 1e-9);
        assert!((normal_gravity_mps2(-FRAC_PI_2, 0.0) - 9.832_184_937_8).abs() < 1e-9);
    }

    /// Free-air gradient: 0.3086 mGal/m at middle latitudes.
    #[test]
    fn falls_with_height() {
        let drop = normal_gravity_mps2(0.8, 0.0) - normal_gravity_mps2(0.8, 100.0);
        assert!((drop / 100.0 - 3.086e-6).abs() < 2e-9, "{drop}");
    }
}
