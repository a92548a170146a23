//! Velocity of the body's origin from those of its antennas.
//!
//! On a rigid body that turns with `ω` the antenna at `r` from the origin moves with
//!
//! `v = v₀ + ω × r = (I  −[r]×) (v₀, ω)`,
//!
//! linear in both: least squares over the antennas that have a Doppler velocity, each with the covariance of its own.
//! What the antennas hardly tell of `ω` is drawn to no turn.

use nalgebra::{Matrix3x6, Matrix6, Vector6};

use super::locate::Located;
use crate::array::AntennaArray;
use crate::frames::{Body, Ecef, Rotation, Vector, skew};

/// Bodies that turn faster, 1-sigma and about any axis, are rare: 57 °/s.
const TURN_SD_RADPS: f64 = 1.0;

/// Velocity of the body origin, ECEF, m/s; `None` where no antenna has one.
pub(super) fn body_velocity(
    located: &[Located],
    array: &AntennaArray,
    ecef_from_body: &Rotation<Ecef, Body>,
) -> Option<Vector<Ecef>> {
    let mut normal = Matrix6::zeros();
    normal.fixed_view_mut::<3, 3>(3, 3).fill_diagonal(TURN_SD_RADPS.powi(-2));
    let mut right = Vector6::zeros();
    for one in located {
        let Some(velocity) = one.velocity else { continue };
        let Some(weight) = velocity.covariance_m2ps2.try_inverse() else { continue };
        let r_m = *ecef_from_body * array.positions_m()[one.antenna];
        let mut design = Matrix3x6::zeros();
        design.fixed_view_mut::<3, 3>(0, 0).fill_with_identity();
        design.fixed_view_mut::<3, 3>(0, 3).copy_from(&-skew(&r_m.xyz()));
        let weighted = design.transpose() * weight;
        normal += weighted * design;
        right += weighted * velocity.velocity_mps.xyz();
    }
    let both = normal.cholesky()?.solve(&right);
    Some(Vector::new(both[0], both[1], both[2]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frames::Geodetic;
    use crate::point::{NoPosition, Velocity};
    use crate::time::GpsTime;
    use nalgebra::{Matrix3, Vector3};

    /// Antennas 25 m above the origin of a body that rolls with 20 °/s.
    #[test]
    fn the_origin_below_a_mast_moves_otherwise_than_the_antennas() {
        let places = [[0.0, 0.0, -25.0], [-6.0, -2.0, -24.0], [-6.0, 2.0, -25.0]];
        let array =
            AntennaArray::new(places.map(|p| Vector::from_xyz(Vector3::from(p))).to_vec()).unwrap();
        let ecef_from_body = Geodetic::from_degrees(54.0, 10.0, 0.0).ecef_from_ned()
            * crate::frames::Attitude { heading_rad: 1.0, pitch_rad: 0.1, roll_rad: -0.2 }
                .ned_from_body();
        let turn = ecef_from_body * Vector::<Body>::new(0.35, 0.0, 0.0);
        let origin = Vector::<Ecef>::new(1.0, -2.0, 0.5);
        let one = |antenna: usize| Located {
            antenna,
            tag: GpsTime::from_week_tow(2300, 0.0).unwrap(),
            tracked: Vec::new(),
            without_ephemeris: 0,
            point: Err(NoPosition::Singular),
            velocity: Some(Velocity {
                velocity_mps: origin + turn.cross(&(ecef_from_body * array.positions_m()[antenna])),
                covariance_m2ps2: Matrix3::identity() * 1e-6,
                clock_drift_mps: 0.0,
            }),
        };
        let located = [0, 1, 2].map(one);
        let found = body_velocity(&located, &array, &ecef_from_body).unwrap();
        assert!((found - origin).norm() < 1e-3, "{found:?}");
        assert!((located[0].velocity.unwrap().velocity_mps - origin).norm() > 8.0);
        let silent = located.map(|one| Located { velocity: None, ..one });
        assert!(body_velocity(&silent, &array, &ecef_from_body).is_none());
    }
}
