//! One measured number, what it should be at a given position, and its gradient there.

use nalgebra::Vector3;

use super::station::Station;
use crate::frames::{Ecef, Vector, wrap_angle};

/// What is measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Quantity {
    /// Clockwise from the station's north, rad.
    Azimuth,
    /// Above the station's horizon, rad.
    Elevation,
    /// Distance to the station, m.
    Range,
    /// Distance to the station minus distance to the reference station, m.
    RangeDifference {
        /// Index of the reference station.
        reference: usize,
    },
    /// Cosine of the angle between the line of sight and the station's north (`cos θx`).
    CosineNorth,
    /// Cosine of the angle between the line of sight and the station's east (`cos θz`).
    CosineEast,
}

/// One measurement of one station.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measurement {
    /// Index of the station.
    pub station: usize,
    /// What is measured.
    pub quantity: Quantity,
    /// The measured number: rad, m or 1.
    pub value: f64,
    /// Its standard deviation, in the same unit.
    pub sigma: f64,
}

impl Measurement {
    /// The reference station of a range difference; the station itself otherwise.
    #[must_use]
    pub const fn reference_or_station(&self) -> usize {
        match self.quantity {
            Quantity::RangeDifference { reference } => reference,
            _ => self.station,
        }
    }

    pub(super) const fn is_difference(&self) -> bool {
        matches!(self.quantity, Quantity::RangeDifference { .. })
    }
}

impl Quantity {
    /// What an error-free station would measure of an object at `object_m`.
    ///
    /// `reference` is the reference station of a range difference; other quantities ignore it.
    #[must_use]
    pub fn predict(self, station: &Station, reference: &Station, object_m: Vector<Ecef>) -> f64 {
        let sight = station.sight(object_m).xyz();
        match self {
            Self::Azimuth => sight.y.atan2(sight.x),
            Self::Elevation => (-sight.z).atan2(sight.x.hypot(sight.y)),
            Self::Range => sight.norm(),
            Self::RangeDifference { .. } => sight.norm() - reference.sight(object_m).norm(),
            Self::CosineNorth => sight.x / sight.norm(),
            Self::CosineEast => sight.y / sight.norm(),
        }
    }

    /// The number and its gradient with respect to the object's position in the common frame, per
    /// metre: the row of `Z` in equation (1).
    ///
    /// Not finite where the quantity has no derivative: at the station, and for the azimuth above
    /// it.
    #[must_use]
    pub fn linearise(
        self,
        station: &Station,
        reference: &Station,
        object_m: Vector<Ecef>,
    ) -> (f64, Vector3<f64>) {
        let sight = station.sight(object_m).xyz();
        let (north, east, down) = (sight.x, sight.y, sight.z);
        let horizontal_squared = north * north + east * east;
        let (value, local) = match self {
            Self::Azimuth => {
                // ∂α = (−z, 0, x) / p²
                let gradient = Vector3::new(-east, north, 0.0) / horizontal_squared;
                (east.atan2(north), gradient)
            }
            Self::Elevation => {
                // ∂γ = (−xy/p, p, −zy/p) / d²
                let horizontal = horizontal_squared.sqrt();
                let slope = down / horizontal;
                let range_squared = horizontal_squared + down * down;
                let gradient =
                    Vector3::new(north * slope, east * slope, -horizontal) / range_squared;
                ((-down).atan2(horizontal), gradient)
            }
            Self::Range => {
                let range = sight.norm();
                (range, sight / range)
            }
            Self::RangeDifference { .. } => {
                let (range, other) = (sight.norm(), reference.sight(object_m).xyz());
                let other_range = other.norm();
                let gradient = station.matrix().tr_mul(&(sight / range))
                    - reference.matrix().tr_mul(&(other / other_range));
                return (range - other_range, gradient);
            }
            Self::CosineNorth => cosine(&sight, Vector3::x()),
            Self::CosineEast => cosine(&sight, Vector3::y()),
        };
        (value, station.matrix().tr_mul(&local))
    }

    /// Measured minus predicted; for the azimuth the short way round.
    #[must_use]
    pub fn residual(self, measured: f64, predicted: f64) -> f64 {
        let difference = measured - predicted;
        if self == Self::Azimuth { wrap_angle(difference) } else { difference }
    }
}

/// ∂ cos θ = (e − cos θ u) / d
fn cosine(sight: &Vector3<f64>, axis: Vector3<f64>) -> (f64, Vector3<f64>) {
    let range = sight.norm();
    let unit = sight / range;
    let cosine = unit.dot(&axis);
    (cosine, (axis - unit * cosine) / range)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frames::Geodetic;
    use core::f64::consts::{PI, TAU};

    const QUANTITIES: [Quantity; 6] = [
        Quantity::Azimuth,
        Quantity::Elevation,
        Quantity::Range,
        Quantity::RangeDifference { reference: 1 },
        Quantity::CosineNorth,
        Quantity::CosineEast,
    ];

    #[test]
    fn axes_point_as_the_compass_does() {
        let place = Geodetic::from_degrees(64.5, 40.5, 100.0);
        let station = Station::at(&place);
        let north_east = Geodetic { latitude_rad: place.latitude_rad + 1e-4, ..place }.to_ecef();
        let north = |quantity: Quantity| quantity.predict(&station, &station, north_east);
        assert!(north(Quantity::Azimuth).abs() < 1e-6);
        assert!((north(Quantity::CosineNorth) - 1.0).abs() < 1e-6);
        let above = Geodetic { height_m: 1100.0, ..place }.to_ecef();
        let up = |quantity: Quantity| quantity.predict(&station, &station, above);
        assert!((up(Quantity::Elevation) - PI / 2.0).abs() < 1e-9);
        assert!((up(Quantity::Range) - 1000.0).abs() < 1e-8);
    }

    #[test]
    fn gradients_agree_with_central_differences() {
        let stations = [
            Station::at(&Geodetic::from_degrees(64.5, 40.5, 100.0)),
            Station::at(&Geodetic::from_degrees(65.5, 41.4, 150.0)),
        ];
        for (latitude_deg, height_m) in [(64.6, 50e3), (64.0, 2e3), (65.2, 300.0)] {
            let object = Geodetic::from_degrees(latitude_deg, 39.0, height_m).to_ecef();
            for quantity in QUANTITIES {
                let (value, gradient) = quantity.linearise(&stations[0], &stations[1], object);
                let predict = |r| quantity.predict(&stations[0], &stations[1], r);
                assert!((value - predict(object)).abs() < 1e-15 * value.abs().max(1.0));
                for axis in 0..3 {
                    let mut step = Vector3::zeros();
                    step[axis] = 8.0;
                    let step = Vector::from_xyz(step);
                    let slope = (predict(object + step) - predict(object - step)) / 16.0;
                    let error = (slope - gradient[axis]).abs();
                    assert!(error < 2e-7 * gradient.norm(), "{quantity:?} axis {axis}: {error:e}");
                }
            }
        }
    }

    #[test]
    fn azimuth_residual_goes_the_short_way() {
        let residual = Quantity::Azimuth.residual(3.1, -3.1);
        assert!((residual - (6.2 - TAU)).abs() < 1e-15);
        assert_eq!(wrap_angle(-PI), PI);
        assert_eq!(Quantity::Range.residual(10.0, 2.0), 8.0);
    }
}
