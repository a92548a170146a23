//! What the air does to elevations and ranges: an exponential atmosphere.
//!
//! Refractivity N(h) = N₀ e^(−h/H) (ITU-R P.453: N₀ = 315, H = 7.35 km on average). For an object at
//! height h over the station, stratified air raises the elevation by the mean bending on the way and
//! lengthens the range; both go with cot and 1/sin of the elevation, regularised near the horizon
//! as in Bennett's (1982) formula. Good to a few per cent above 5°, a fifth at 1°.

use super::measurement::Quantity;
use super::station::Station;
use crate::frames::{Ecef, Geodetic, Vector};

/// The refractivity of the air over a station.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Atmosphere {
    /// N₀ at the station, in units of 1e-6: about 315 for radio, 280 for light.
    pub surface_refractivity: f64,
    /// H, m.
    pub scale_height_m: f64,
}

impl Default for Atmosphere {
    fn default() -> Self {
        Self { surface_refractivity: 315.0, scale_height_m: 7350.0 }
    }
}

impl Atmosphere {
    /// What the air adds to a measurement of an object at `object_m`: subtract it from the measured
    /// number. Azimuths and direction cosines are left alone.
    #[must_use]
    pub fn effect(
        &self,
        quantity: Quantity,
        station: &Station,
        reference: &Station,
        object_m: Vector<Ecef>,
    ) -> f64 {
        match quantity {
            Quantity::Elevation => self.elevation_rad(station, object_m),
            Quantity::Range => self.range_m(station, object_m),
            Quantity::RangeDifference { .. } => {
                self.range_m(station, object_m) - self.range_m(reference, object_m)
            }
            Quantity::Azimuth | Quantity::CosineNorth | Quantity::CosineEast => 0.0,
        }
    }

    /// N₀ cot γ [1 − (H/h)(1 − e^(−h/H))]
    fn elevation_rad(&self, station: &Station, object_m: Vector<Ecef>) -> f64 {
        let relative_height = self.relative_height(station, object_m);
        // 1 − (1 − e^(−x))/x, which is x/2 near zero
        let share = if relative_height < 1e-4 {
            0.5 * relative_height
        } else {
            1.0 + (-relative_height).exp_m1() / relative_height
        };
        1e-6 * self.surface_refractivity * share / regular_elevation(station, object_m).tan()
    }

    /// N₀ H (1 − e^(−h/H)) / sin γ
    fn range_m(&self, station: &Station, object_m: Vector<Ecef>) -> f64 {
        let share = -(-self.relative_height(station, object_m)).exp_m1();
        let zenith_m = 1e-6 * self.surface_refractivity * self.scale_height_m * share;
        zenith_m / regular_elevation(station, object_m).sin()
    }

    /// Height over the station, in scale heights.
    fn relative_height(&self, station: &Station, object_m: Vector<Ecef>) -> f64 {
        let height = |position| Geodetic::from_ecef(position).height_m;
        ((height(object_m) - height(station.position_m())) / self.scale_height_m).max(0.0)
    }
}

/// γ + 7.31°/(γ + 4.4°) with γ in degrees: elevation that stays away from zero (Bennett 1982).
fn regular_elevation(station: &Station, object_m: Vector<Ecef>) -> f64 {
    let elevation_rad = Quantity::Elevation.predict(station, station, object_m);
    let degrees = elevation_rad.to_degrees().max(-1.0);
    (degrees + 7.31 / (degrees + 4.4)).to_radians()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn seen_at(elevation_deg: f64, distance_m: f64) -> (Station, Vector<Ecef>) {
        let place = Geodetic::from_degrees(60.0, 30.0, 0.0);
        let (sine, cosine) = elevation_deg.to_radians().sin_cos();
        let sight = Vector::new(cosine * distance_m, 0.0, -sine * distance_m);
        (Station::at(&place), place.to_ecef() + place.ecef_from_ned() * sight)
    }

    /// Outside the air and at 45° light is bent by 58.2″ at 1010 hPa and 10 °C (Bennett 1982),
    /// where N₀ is 281; a zenith range through all of it is 2.3 m longer (N₀ H).
    #[test]
    fn known_sizes() {
        let light = Atmosphere { surface_refractivity: 281.0, scale_height_m: 7350.0 };
        let (station, star) = seen_at(45.0, 1e9);
        let bending = light.effect(Quantity::Elevation, &station, &station, star);
        assert!((bending.to_degrees() * 3600.0 - 58.0).abs() < 0.6, "{bending}");
        let (station, satellite) = seen_at(90.0, 1e7);
        let longer = Atmosphere::default().effect(Quantity::Range, &station, &station, satellite);
        assert!((longer - 2.315).abs() < 0.01, "{longer}");
        let (station, beside) = seen_at(30.0, 10.0);
        let bending = light.effect(Quantity::Elevation, &station, &station, beside);
        assert!((0.0..1e-6).contains(&bending), "nothing is bent over ten metres: {bending}");
    }
}
