//! Frames as types: `Vector<Ned> + Vector<Body>` does not compile.
//!
//! A rotation is named after both ends, target first (`ned_from_body`), and chains like the matrix
//! product it is; the inner names meet:
//!
//! ```
//! use kurs::frames::{Attitude, Body, Ecef, Geodetic, Rotation, Vector};
//!
//! let here = Geodetic::from_degrees(55.75, 37.62, 200.0);
//! let attitude = Attitude { heading_rad: 0.5, pitch_rad: 0.1, roll_rad: -0.2 };
//! let ecef_from_body: Rotation<Ecef, Body> = here.ecef_from_ned() * attitude.ned_from_body();
//!
//! let lever_arm: Vector<Body> = Vector::new(1.0, 0.0, 0.0);
//! let antenna: Vector<Ecef> = here.to_ecef() + ecef_from_body * lever_arm;
//! assert!(((antenna - here.to_ecef()).norm() - 1.0).abs() < 1e-9);
//! ```
//!
//! ```compile_fail
//! use kurs::frames::{Attitude, Geodetic};
//! let here = Geodetic::from_degrees(55.75, 37.62, 200.0);
//! let attitude = Attitude { heading_rad: 0.5, pitch_rad: 0.1, roll_rad: -0.2 };
//! let wrong = attitude.ned_from_body() * here.ecef_from_ned(); // body does not meet ecef
//! ```
//!
//! What the types do not protect against: a local level frame belongs to a point, and two `Ned`
//! vectors taken at different points add without complaint.

use core::marker::PhantomData;
use core::ops::{Add, AddAssign, Mul, Neg, Sub};

use nalgebra::{Matrix3, Quaternion, Rotation3, UnitQuaternion, Vector3};

/// Earth-centred, Earth-fixed axes (WGS 84).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Ecef;
/// Local level axes: north, east, down.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Ned;
/// Local level axes: east, north, up; for output, as GNSS users expect.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Enu;
/// Vehicle axes: x forward, y right, z down (FRD).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Body;

/// WGS 84: semi-major axis, m.
pub const WGS84_A_M: f64 = 6_378_137.0;
/// WGS 84: flattening.
pub const WGS84_F: f64 = 1.0 / 298.257_223_563;
/// WGS 84: angular velocity of the Earth, rad/s.
pub const EARTH_RATE_RADPS: f64 = 7.292_115e-5;
/// First eccentricity squared, e² = f (2 − f).
pub(crate) const E2: f64 = WGS84_F * (2.0 - WGS84_F);

/// Three components in the axes of frame `F`; the unit (m, m/s, …) is in the variable's name.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Vector<F> {
    xyz: Vector3<f64>,
    frame: PhantomData<F>,
}

/// Turns components in `From` axes into components in `To` axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rotation<To, From> {
    matrix: Matrix3<f64>,
    frames: PhantomData<(To, From)>,
}

/// A point on or near the Earth, WGS 84.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Geodetic {
    /// Geodetic latitude, −π/2 to π/2.
    pub latitude_rad: f64,
    /// East longitude, −π to π.
    pub longitude_rad: f64,
    /// Height above the ellipsoid.
    pub height_m: f64,
}

/// Attitude as angles: `ned_from_body = Rz(heading) Ry(pitch) Rx(roll)`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Attitude {
    /// Clockwise from true north, `0 ≤ heading_rad < 2π` when computed.
    pub heading_rad: f64,
    /// Nose up positive, −π/2 to π/2.
    pub pitch_rad: f64,
    /// Right side down positive, −π to π.
    pub roll_rad: f64,
}

#[cfg(feature = "serde")]
impl<F> serde::Serialize for Vector<F> {
    /// `[x, y, z]`
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        <[f64; 3]>::from(self.xyz).serialize(serializer)
    }
}

#[cfg(feature = "serde")]
impl<To, From> serde::Serialize for Rotation<To, From> {
    /// `[w, x, y, z]` as [`Rotation::quaternion`] gives it.
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        self.quaternion().serialize(serializer)
    }
}

/// A matrix row by row.
#[cfg(feature = "serde")]
pub(crate) fn serialize_rows<S: serde::Serializer>(
    matrix: &Matrix3<f64>,
    serializer: S,
) -> Result<S::Ok, S::Error> {
    use serde::Serialize;
    let row = |i: usize| [matrix[(i, 0)], matrix[(i, 1)], matrix[(i, 2)]];
    [row(0), row(1), row(2)].serialize(serializer)
}

impl<F> Vector<F> {
    /// The claim that these numbers are in `F` is made here and in [`Vector::from_xyz`] only.
    #[must_use]
    pub const fn new(x: f64, y: f64, z: f64) -> Self {
        Self { xyz: Vector3::new(x, y, z), frame: PhantomData }
    }

    /// From the bare vector of a matrix kernel.
    #[must_use]
    pub const fn from_xyz(xyz: Vector3<f64>) -> Self {
        Self { xyz, frame: PhantomData }
    }

    /// The bare vector, for the matrix kernels.
    #[must_use]
    pub const fn xyz(&self) -> Vector3<f64> {
        self.xyz
    }

    /// Length.
    #[must_use]
    pub fn norm(&self) -> f64 {
        self.xyz.norm()
    }

    /// Scalar product.
    #[must_use]
    pub fn dot(&self, other: &Self) -> f64 {
        self.xyz.dot(&other.xyz)
    }

    /// Vector product.
    #[must_use]
    pub fn cross(&self, other: &Self) -> Self {
        Self::from_xyz(self.xyz.cross(&other.xyz))
    }

    /// Unit vector in the same direction (not a number for the zero vector).
    #[must_use]
    pub fn direction(&self) -> Self {
        Self::from_xyz(self.xyz / self.norm())
    }

    /// Whether no component is infinite or not a number.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        self.xyz.iter().all(|c| c.is_finite())
    }
}

impl<F> Add for Vector<F> {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self::from_xyz(self.xyz + other.xyz)
    }
}

impl<F> AddAssign for Vector<F> {
    fn add_assign(&mut self, other: Self) {
        self.xyz += other.xyz;
    }
}

impl<F> Sub for Vector<F> {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        Self::from_xyz(self.xyz - other.xyz)
    }
}

impl<F> Neg for Vector<F> {
    type Output = Self;
    fn neg(self) -> Self {
        Self::from_xyz(-self.xyz)
    }
}

impl<F> Mul<f64> for Vector<F> {
    type Output = Self;
    fn mul(self, scale: f64) -> Self {
        Self::from_xyz(self.xyz * scale)
    }
}

impl<To, From> Rotation<To, From> {
    /// The claim that `matrix` is orthogonal with determinant +1 and joins these frames is made
    /// here.
    #[must_use]
    pub const fn from_matrix(matrix: Matrix3<f64>) -> Self {
        Self { matrix, frames: PhantomData }
    }

    /// From a quaternion `w, x, y, z` (Hamilton, same rotation as the matrix); it is normalised.
    #[must_use]
    pub fn from_quaternion([w, x, y, z]: [f64; 4]) -> Self {
        let unit = UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z));
        Self::from_matrix(unit.to_rotation_matrix().into_inner())
    }

    /// The bare matrix, for the kernels.
    #[must_use]
    pub const fn matrix(&self) -> Matrix3<f64> {
        self.matrix
    }

    /// The rotation the other way.
    #[must_use]
    pub fn inverse(&self) -> Rotation<From, To> {
        Rotation::from_matrix(self.matrix.transpose())
    }

    /// Quaternion `w, x, y, z`: Hamilton, scalar first, `w ≥ 0`, same rotation as the matrix.
    #[must_use]
    pub fn quaternion(&self) -> [f64; 4] {
        let rotation = Rotation3::from_matrix_unchecked(self.matrix);
        let q = UnitQuaternion::from_rotation_matrix(&rotation);
        let sign = if q.w < 0.0 { -1.0 } else { 1.0 };
        [q.w * sign, q.i * sign, q.j * sign, q.k * sign]
    }

    /// Covariance (3×3) of a vector turned along with it: `R P Rᵀ`.
    #[must_use]
    pub fn turn_covariance(&self, covariance: &Matrix3<f64>) -> Matrix3<f64> {
        self.matrix * covariance * self.matrix.transpose()
    }
}

impl<To, From> Mul<Vector<From>> for Rotation<To, From> {
    type Output = Vector<To>;
    fn mul(self, v: Vector<From>) -> Vector<To> {
        Vector::from_xyz(self.matrix * v.xyz)
    }
}

impl<A, B, C> Mul<Rotation<B, C>> for Rotation<A, B> {
    type Output = Rotation<A, C>;
    fn mul(self, b_from_c: Rotation<B, C>) -> Rotation<A, C> {
        Rotation::from_matrix(self.matrix * b_from_c.matrix)
    }
}

/// East-north-up from north-east-down: the axes of both are at the same point.
#[must_use]
pub const fn enu_from_ned() -> Rotation<Enu, Ned> {
    Rotation::from_matrix(Matrix3::new(0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, -1.0))
}

impl Geodetic {
    /// From degrees and metres.
    #[must_use]
    pub fn from_degrees(latitude_deg: f64, longitude_deg: f64, height_m: f64) -> Self {
        Self {
            latitude_rad: latitude_deg.to_radians(),
            longitude_rad: longitude_deg.to_radians(),
            height_m,
        }
    }

    /// ECEF position, metres.
    #[must_use]
    pub fn to_ecef(&self) -> Vector<Ecef> {
        let (sin_lat, cos_lat) = self.latitude_rad.sin_cos();
        let (sin_lon, cos_lon) = self.longitude_rad.sin_cos();
        // N = a / √(1 − e² sin²φ)
        let n = WGS84_A_M / (1.0 - E2 * sin_lat * sin_lat).sqrt();
        Vector::new(
            (n + self.height_m) * cos_lat * cos_lon,
            (n + self.height_m) * cos_lat * sin_lon,
            (n * (1.0 - E2) + self.height_m) * sin_lat,
        )
    }

    /// Geodetic coordinates of an ECEF position in metres; below a nanometre of error from the
    /// Earth's centre region (above 100 km from it) to beyond the satellites.
    ///
    /// Method: Bowring's (1976) formula for the reduced latitude, iterated until it stands; the
    /// iteration is limited.
    #[must_use]
    pub fn from_ecef(position_m: Vector<Ecef>) -> Self {
        let Vector { xyz, .. } = position_m;
        let p = xyz.x.hypot(xyz.y);
        let b = WGS84_A_M * (1.0 - WGS84_F);
        let ep2 = E2 / (1.0 - E2);
        // tan β₀ = z / ((1 − f) p);  tan φ = (z + e'² b sin³β) / (p − e² a cos³β)
        let mut beta = xyz.z.atan2((1.0 - WGS84_F) * p);
        let mut latitude_rad = 0.0;
        for _ in 0..6 {
            let (s, c) = beta.sin_cos();
            latitude_rad = (xyz.z + ep2 * b * s * s * s).atan2(p - E2 * WGS84_A_M * c * c * c);
            let next = ((1.0 - WGS84_F) * latitude_rad.sin()).atan2(latitude_rad.cos());
            // Convergence is cubic: a change below 1e-9 leaves nothing for the next step.
            let settled = (next - beta).abs() < 1e-9;
            beta = next;
            if settled {
                break;
            }
        }
        let (sin_lat, cos_lat) = latitude_rad.sin_cos();
        // h = p cos φ + z sin φ − a √(1 − e² sin²φ), regular at the poles
        let height_m =
            p * cos_lat + xyz.z * sin_lat - WGS84_A_M * (1.0 - E2 * sin_lat * sin_lat).sqrt();
        Self { latitude_rad, longitude_rad: xyz.y.atan2(xyz.x), height_m }
    }

    /// Radii of curvature of the ellipsoid along the meridian and across it, m:
    /// `M = N (1 − e²) / (1 − e² sin²φ)`, `N = a / √(1 − e² sin²φ)`.
    #[must_use]
    pub fn curvature_radii_m(&self) -> [f64; 2] {
        let w2 = 1.0 - E2 * self.latitude_rad.sin().powi(2);
        let across_m = WGS84_A_M / w2.sqrt();
        [across_m * (1.0 - E2) / w2, across_m]
    }

    /// Rotation from the local level axes at this point to ECEF.
    #[must_use]
    pub fn ecef_from_ned(&self) -> Rotation<Ecef, Ned> {
        let (sin_lat, cos_lat) = self.latitude_rad.sin_cos();
        let (sin_lon, cos_lon) = self.longitude_rad.sin_cos();
        Rotation::from_matrix(Matrix3::new(
            -sin_lat * cos_lon,
            -sin_lon,
            -cos_lat * cos_lon,
            -sin_lat * sin_lon,
            cos_lon,
            -cos_lat * sin_lon,
            cos_lat,
            0.0,
            -sin_lat,
        ))
    }

    /// Rotation from ECEF to the local level axes at this point.
    #[must_use]
    pub fn ned_from_ecef(&self) -> Rotation<Ned, Ecef> {
        self.ecef_from_ned().inverse()
    }
}

impl Attitude {
    /// The rotation of this attitude, Rz(heading) Ry(pitch) Rx(roll).
    #[must_use]
    pub fn ned_from_body(&self) -> Rotation<Ned, Body> {
        let (sh, ch) = self.heading_rad.sin_cos();
        let (sp, cp) = self.pitch_rad.sin_cos();
        let (sr, cr) = self.roll_rad.sin_cos();
        Rotation::from_matrix(Matrix3::new(
            ch * cp,
            ch * sp * sr - sh * cr,
            ch * sp * cr + sh * sr,
            sh * cp,
            sh * sp * sr + ch * cr,
            sh * sp * cr - ch * sr,
            -sp,
            cp * sr,
            cp * cr,
        ))
    }

    /// The angles of a rotation. At pitch ±90° heading and roll are not separate: the roll is then
    /// taken as 0.
    #[must_use]
    pub fn from_ned_from_body(ned_from_body: &Rotation<Ned, Body>) -> Self {
        let m = &ned_from_body.matrix;
        let cos_pitch = m[(2, 1)].hypot(m[(2, 2)]);
        let pitch_rad = (-m[(2, 0)]).atan2(cos_pitch);
        // What is no number stays so.
        let (heading, roll_rad) = if cos_pitch <= 1e-12 {
            ((-m[(0, 1)]).atan2(m[(1, 1)]), 0.0)
        } else {
            (m[(1, 0)].atan2(m[(0, 0)]), m[(2, 1)].atan2(m[(2, 2)]))
        };
        Self { heading_rad: wrap_heading(heading), pitch_rad, roll_rad }
    }
}

/// An angle turned into `(−π, π]`.
#[must_use]
pub fn wrap_angle(angle_rad: f64) -> f64 {
    use core::f64::consts::{PI, TAU};
    if -PI < angle_rad && angle_rad <= PI {
        return angle_rad;
    }
    let turned = angle_rad.rem_euclid(TAU);
    if turned > PI { turned - TAU } else { turned }
}

/// An angle turned into `[0, 2π)`.
#[must_use]
pub fn wrap_heading(angle_rad: f64) -> f64 {
    let wrapped = angle_rad.rem_euclid(core::f64::consts::TAU);
    // A tiny negative angle rounds up to 2π itself.
    if wrapped >= core::f64::consts::TAU { 0.0 } else { wrapped }
}

/// Antisymmetric matrix of a vector: `skew(a) b = a × b`.
#[must_use]
pub fn skew(a: &Vector3<f64>) -> Matrix3<f64> {
    Matrix3::new(0.0, -a.z, a.y, a.z, 0.0, -a.x, -a.y, a.x, 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// National Geospatial-Intelligence Agency WGS 84 constants: the equator and the pole.
    #[test]
    fn axes_of_the_ellipsoid() {
        let equator = Geodetic::from_degrees(0.0, 90.0, 0.0).to_ecef();
        assert!((equator - Vector::new(0.0, 6_378_137.0, 0.0)).norm() < 1e-8);
        let pole = Geodetic::from_degrees(90.0, 0.0, 100.0).to_ecef();
        assert!((pole - Vector::new(0.0, 0.0, 6_356_852.314_245_18)).norm() < 1e-7);
    }

    #[test]
    fn nose_up_right_down_clockwise() {
        let forward = Vector::<Body>::new(1.0, 0.0, 0.0);
        let right = Vector::<Body>::new(0.0, 1.0, 0.0);
        let turn = |heading_rad, pitch_rad, roll_rad| {
            Attitude { heading_rad, pitch_rad, roll_rad }.ned_from_body()
        };
        assert!((turn(0.3, 0.0, 0.0) * forward).xyz().y > 0.0, "heading is clockwise");
        assert!((turn(0.0, 0.3, 0.0) * forward).xyz().z < 0.0, "pitch is nose up");
        assert!((turn(0.0, 0.0, 0.3) * right).xyz().z > 0.0, "roll is right side down");
    }

    #[test]
    fn heading_stays_below_a_full_turn() {
        assert_eq!(wrap_heading(-1e-17), 0.0);
        assert!(wrap_heading(-0.1) > 6.0);
    }

    #[test]
    fn of_no_rotation_no_angle_is_known() {
        let nothing = Rotation::from_matrix(Matrix3::from_element(f64::NAN));
        let Attitude { heading_rad, pitch_rad, roll_rad } = Attitude::from_ned_from_body(&nothing);
        assert!(heading_rad.is_nan() && pitch_rad.is_nan() && roll_rad.is_nan());
    }

    proptest! {
        #[test]
        fn geodetic_round_trips(lat in -90.0..90.0f64, lon in -180.0..180.0f64, h in -1e5..3e7f64) {
            let point = Geodetic::from_degrees(lat, lon, h);
            let back = Geodetic::from_ecef(point.to_ecef());
            // Five units in the last place of the largest coordinate, 3.6e7 m.
            prop_assert!((back.to_ecef() - point.to_ecef()).norm() < 4e-8);
            prop_assert!((back.height_m - h).abs() < 4e-8);
        }

        #[test]
        fn attitude_round_trips(h in 0.0..360.0f64, p in -89.9..89.9f64, r in -180.0..180.0f64) {
            let attitude = Attitude {
                heading_rad: h.to_radians(), pitch_rad: p.to_radians(), roll_rad: r.to_radians(),
            };
            let rotation = attitude.ned_from_body();
            let back = Attitude::from_ned_from_body(&rotation).ned_from_body();
            prop_assert!((back.matrix() - rotation.matrix()).norm() < 1e-12);
            let again = Rotation::<Ned, Body>::from_quaternion(rotation.quaternion());
            prop_assert!((again.matrix() - rotation.matrix()).norm() < 1e-14);
            prop_assert!(rotation.quaternion()[0] >= 0.0);
        }
    }
}
