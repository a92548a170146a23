//! A measuring station: where it stands and how its axes lie.

use nalgebra::Matrix3;

use crate::frames::{Ecef, Geodetic, Ned, Rotation, Vector};

/// A station with its local axes. North need not be true north nor down the plumb line: the axes
/// are those in which the station's angles are counted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Station {
    position_m: Vector<Ecef>,
    ned_from_ecef: Rotation<Ned, Ecef>,
}

impl Station {
    /// A station at a geodetic place, with the axes of the ellipsoid there.
    #[must_use]
    pub fn at(place: &Geodetic) -> Self {
        Self { position_m: place.to_ecef(), ned_from_ecef: place.ned_from_ecef() }
    }

    /// A station at an Earth-fixed position, with the axes of the ellipsoid there.
    #[must_use]
    pub fn at_ecef(position_m: Vector<Ecef>) -> Self {
        Self { position_m, ned_from_ecef: Geodetic::from_ecef(position_m).ned_from_ecef() }
    }

    /// A station with surveyed axes of its own.
    #[must_use]
    pub fn with_axes(position_m: Vector<Ecef>, ecef_from_local: &Rotation<Ecef, Ned>) -> Self {
        Self { position_m, ned_from_ecef: ecef_from_local.inverse() }
    }

    /// Where the station stands.
    #[must_use]
    pub const fn position_m(&self) -> Vector<Ecef> {
        self.position_m
    }

    /// The rotation from the common frame into the station's axes.
    #[must_use]
    pub const fn ned_from_ecef(&self) -> Rotation<Ned, Ecef> {
        self.ned_from_ecef
    }

    /// The object as seen from the station: components along its north, east and down, metres.
    #[must_use]
    pub fn sight(&self, object_m: Vector<Ecef>) -> Vector<Ned> {
        self.ned_from_ecef * (object_m - self.position_m)
    }

    /// A direction in the station's axes, turned into the common frame: `Φ u` of the paper.
    #[must_use]
    pub fn to_ecef(&self, direction: Vector<Ned>) -> Vector<Ecef> {
        self.ned_from_ecef.inverse() * direction
    }

    /// A direction in the common frame, turned into the station's axes: `Φᵀ u`.
    #[must_use]
    pub fn to_local(&self, direction: Vector<Ecef>) -> Vector<Ned> {
        self.ned_from_ecef * direction
    }

    /// The matrix from the common frame to the station's axes, for the kernels.
    pub(super) const fn matrix(&self) -> Matrix3<f64> {
        self.ned_from_ecef.matrix()
    }
}

/// Unit vector in a station's axes from its azimuth and elevation, rad.
#[must_use]
pub fn direction_from_angles(azimuth_rad: f64, elevation_rad: f64) -> Vector<Ned> {
    let (sin_azimuth, cos_azimuth) = azimuth_rad.sin_cos();
    let (sin_elevation, cos_elevation) = elevation_rad.sin_cos();
    // (7), corrected: cos θx = cos γ cos α, cos θz = cos γ sin α, cos θy = sin γ
    Vector::new(cos_elevation * cos_azimuth, cos_elevation * sin_azimuth, -sin_elevation)
}
