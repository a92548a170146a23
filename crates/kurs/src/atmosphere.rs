//! Delays of the signal in the atmosphere: Klobuchar's ionosphere, Saastamoinen's troposphere.

use core::f64::consts::PI;

use crate::ephemeris::{IonosphereParameters, Klobuchar};
use crate::frames::Geodetic;
use crate::signal::SPEED_OF_LIGHT_MPS;
use crate::sky::SkyDirection;
use crate::time::GpsTime;

/// Carrier to which Klobuchar's model refers, Hz.
const L1_HZ: f64 = 1575.42e6;
/// Height of the layer into which the model puts the ionosphere, m.
const IONOSPHERE_M: f64 = 350e3;

/// Heights above which the standard atmosphere below has no air left to speak of, m.
const TROPOSPHERE_TOP_M: f64 = 40_000.0;

/// Ionospheric delay of a code observation on any carrier, in metres, by the best parameters that
/// the navigation data hold; none for an antenna above the ionosphere.
///
/// GPS parameters come first, then BeiDou's and QZSS's of the same form. Galileo's single
/// effective ionisation level `Az = a₀` (solar flux units) becomes a daytime amplitude of
/// 0.2 ns per unit: Klobuchar's shape with Galileo's level, not NeQuick. Without any parameters a
/// quiet day (100 units) is assumed.
#[must_use]
pub fn ionosphere_m(
    parameters: &IonosphereParameters,
    antenna: &Geodetic,
    direction: &SkyDirection,
    time: GpsTime,
    frequency_hz: f64,
) -> f64 {
    if antenna.height_m > IONOSPHERE_M {
        return 0.0;
    }
    let broadcast = parameters.gps.or(parameters.beidou).or(parameters.qzss);
    let Klobuchar { alpha, beta } = broadcast.unwrap_or_else(|| {
        let level = parameters.galileo.map_or(100.0, |a| a[0].clamp(0.0, 400.0));
        Klobuchar { alpha: [0.2e-9 * level, 0.0, 0.0, 0.0], beta: [1.1e5, 0.0, 0.0, 0.0] }
    });
    klobuchar_m(&alpha, &beta, antenna, direction, time) * (L1_HZ / frequency_hz).powi(2)
}

/// Ionospheric delay of a code observation on GPS L1, in metres; other frequencies scale with
/// `(f_L1 / f)²`, and a carrier phase is advanced by the same amount.
///
/// `alpha` and `beta` are the eight broadcast coefficients (s, s per semicircle, …). Source:
/// IS-GPS-200, 20.3.3.5.2.5; angles there and here are semicircles.
#[must_use]
pub fn klobuchar_m(
    alpha: &[f64; 4],
    beta: &[f64; 4],
    antenna: &Geodetic,
    direction: &SkyDirection,
    time: GpsTime,
) -> f64 {
    let elevation = direction.elevation_rad().max(0.0) / PI;
    let level = direction.unit().xyz();
    let flat = level.x.hypot(level.y).max(f64::MIN_POSITIVE);
    let (sin_azimuth, cos_azimuth) = (level.y / flat, level.x / flat);

    // ψ = 0.0137 / (E + 0.11) − 0.022
    let earth_angle = 0.0137 / (elevation + 0.11) - 0.022;
    // φᵢ = φᵤ + ψ cos A, |φᵢ| ≤ 0.416
    let latitude = (antenna.latitude_rad / PI + earth_angle * cos_azimuth).clamp(-0.416, 0.416);
    // λᵢ = λᵤ + ψ sin A / cos φᵢ
    let longitude = antenna.longitude_rad / PI + earth_angle * sin_azimuth / (latitude * PI).cos();
    // φₘ = φᵢ + 0.064 cos(λᵢ − 1.617)
    let geomagnetic = latitude + 0.064 * ((longitude - 1.617) * PI).cos();
    // t = 43200 λᵢ + GPS time, in one day
    let local_s = (43_200.0 * longitude + time.tow_s()).rem_euclid(86_400.0);
    // F = 1 + 16 (0.53 − E)³
    let obliquity = 1.0 + 16.0 * (0.53 - elevation).powi(3);

    let cubic =
        |c: &[f64; 4]| c[0] + geomagnetic * (c[1] + geomagnetic * (c[2] + geomagnetic * c[3]));
    let amplitude_s = cubic(alpha).max(0.0);
    let period_s = cubic(beta).max(72_000.0);
    // x = 2π (t − 50400) / PER;  T = F [5e-9 + AMP (1 − x²/2 + x⁴/24)] for |x| < 1.57
    let x = 2.0 * PI * (local_s - 50_400.0) / period_s;
    let day_s =
        if x.abs() < 1.57 { amplitude_s * (1.0 - x * x / 2.0 + x.powi(4) / 24.0) } else { 0.0 };
    SPEED_OF_LIGHT_MPS * obliquity * (5e-9 + day_s)
}

/// Tropospheric delay at one antenna: zenith value and how it changes with height.
///
/// Saastamoinen's model in the standard atmosphere (15 °C and 1013.25 hPa at sea level, 70 %
/// humidity), for any height from below the sea to space. Source: Saastamoinen (1972); standard
/// atmosphere as in Subirana, Zornoza, Hernández-Pajares (2013), *GNSS Data Processing*, vol. I,
/// 5.4.2.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Troposphere {
    zenith_m: f64,
    slope: f64,
}

impl Troposphere {
    /// The troposphere above a point.
    #[must_use]
    pub fn above(point: &Geodetic) -> Self {
        let zenith_m = saastamoinen_zenith_m(point);
        let higher = Geodetic { height_m: point.height_m + 1.0, ..*point };
        Self { zenith_m, slope: saastamoinen_zenith_m(&higher) - zenith_m }
    }

    /// Delay of a signal from an elevation with this sine, m; zero below the horizon.
    #[must_use]
    pub fn delay_m(&self, sin_elevation: f64) -> f64 {
        self.zenith_m * mapping(sin_elevation)
    }

    /// Change of that delay per metre that the antenna rises.
    #[must_use]
    pub fn slope(&self, sin_elevation: f64) -> f64 {
        self.slope * mapping(sin_elevation)
    }
}

fn saastamoinen_zenith_m(point: &Geodetic) -> f64 {
    let height_m = point.height_m;
    if !(-1000.0..=TROPOSPHERE_TOP_M).contains(&height_m) {
        return 0.0;
    }
    // p = 1013.25 (1 − 2.2557e-5 h)^5.2568, T = 288.15 − 0.0065 h, e = 6.108 RH exp(…); above the
    // tropopause the power law ends at zero pressure
    let lapse = (1.0 - 2.2557e-5 * height_m).max(0.0);
    let pressure_hpa = 1013.25 * lapse.powf(5.2568);
    let temperature_k = (288.15 - 0.0065 * height_m).max(216.65);
    let vapour_hpa = if height_m < 11_000.0 {
        0.7 * 6.108 * ((17.15 * temperature_k - 4684.0) / (temperature_k - 38.45)).exp()
    } else {
        0.0
    };
    // dry 0.0022768 p / (1 − 0.00266 cos 2φ − 0.00028 h/km), wet 0.002277 (1255/T + 0.05) e
    let gravity = 1.0 - 0.00266 * (2.0 * point.latitude_rad).cos() - 0.00028e-3 * height_m;
    0.002_276_8 * pressure_hpa / gravity + 0.002_277 * (1255.0 / temperature_k + 0.05) * vapour_hpa
}

/// Black and Eisner's (1984) mapping of a zenith delay to elevation: `1.001 / √(0.002001 + sin² E)`.
fn mapping(sin_elevation: f64) -> f64 {
    if sin_elevation <= 0.0 {
        return 0.0;
    }
    1.001 / (0.002_001 + sin_elevation * sin_elevation).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn time_of_day(seconds: f64) -> GpsTime {
        GpsTime::from_week_tow(2000, seconds).unwrap()
    }

    /// At night only the constant 5 ns remain; at the zenith F = 1.000432.
    #[test]
    fn klobuchar_at_night() {
        let (alpha, beta) = ([1e-8, 0.0, 0.0, 0.0], [72_000.0, 0.0, 0.0, 0.0]);
        let antenna = Geodetic::from_degrees(40.0, 0.0, 0.0);
        let zenith = SkyDirection::from_angles(0.0, PI / 2.0);
        let night = klobuchar_m(&alpha, &beta, &antenna, &zenith, time_of_day(0.0));
        assert!((night - 5e-9 * 299_792_458.0 * 1.000_432).abs() < 1e-6, "{night}");
        let noon = klobuchar_m(&alpha, &beta, &antenna, &zenith, time_of_day(50_400.0));
        assert!((noon - 15e-9 * 299_792_458.0 * 1.000_432).abs() < 1e-6, "{noon}");
    }

    /// Sea level, 45°: the dry zenith delay is 2.307 m (Davis et al. 1985: 2.2768 mm/hPa); the wet
    /// part of this atmosphere (11.9 hPa of vapour) is 0.12 m.
    #[test]
    fn saastamoinen_at_the_zenith() {
        let sea = Troposphere::above(&Geodetic::from_degrees(45.0, 0.0, 0.0));
        let zenith_m = sea.delay_m(1.0);
        assert!((zenith_m - 2.426).abs() < 0.01, "{zenith_m}");
        assert_eq!(sea.delay_m(0.0), 0.0);
        let ratio = sea.delay_m(0.5) / zenith_m;
        assert!((ratio - 2.0).abs() < 0.01, "{ratio}");
    }

    #[test]
    fn slope_is_the_difference_of_two_heights() {
        let at = |height_m| Troposphere::above(&Geodetic::from_degrees(45.0, 0.0, height_m));
        let sin_elevation = 0.48;
        let difference = at(235.0).delay_m(sin_elevation) - at(200.0).delay_m(sin_elevation);
        assert!((difference - 35.0 * at(217.0).slope(sin_elevation)).abs() < 1e-4);
        assert!(difference < -0.01, "35 m are centimetres: {difference}");
    }

    #[test]
    fn no_air_in_orbit() {
        let mut previous = f64::INFINITY;
        for height_km in 0..50 {
            let point = Geodetic::from_degrees(10.0, 0.0, f64::from(height_km) * 1e3);
            let delay_m = Troposphere::above(&point).delay_m(1.0);
            assert!(delay_m <= previous, "{height_km} km: {delay_m}");
            previous = delay_m;
        }
        assert_eq!(previous, 0.0);
    }
}
