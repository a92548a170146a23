//! The attitude and place of another body as seen from this one.
//!
//! Both attitudes are brought to the time of this body's row by their rates of turn, with what
//! these are uncertain by; then `R = R₁ᵀ R₂` ([`relative_orientation`]), in one frame of local
//! level axes.

use kurs::attitude::angles::{angle_covariance, angles_from_rotation_vector, relative_orientation};
use kurs::frames::{Attitude, Body, Geodetic, Ned, Rotation, Vector, enu_from_ned};
use kurs::solution::Status;
use kurs::time::GpsTime;
use kurs::turn_rate::AngleRates;
use nalgebra::{Matrix3, Vector3};

/// Turn of a body whose rates are not known, 1 σ, rad/s: few vehicles turn by 60° in a second.
const UNKNOWN_RATE_RADPS: f64 = 20.0 * core::f64::consts::PI / 180.0;
/// How much a rate may change meanwhile, 1 σ, rad/s²: a car that begins a tight turn gains 20°/s in
/// a second.
const RATE_CHANGE_RADPS2: f64 = 10.0 * core::f64::consts::PI / 180.0;
/// A rate comes from this attitude and the one before, which are as uncertain as each other: the
/// errors of angle and rate are correlated by `1/√2`.
const ANGLE_RATE_CORRELATION: f64 = core::f64::consts::FRAC_1_SQRT_2;
/// Times closer than this, s, count as equal: steered receivers differ by less.
const ONE_TIME_S: f64 = 1e-6;

/// What is known of a body at one time.
#[derive(Debug, Clone, PartialEq)]
pub struct BodyState {
    /// Measurement time.
    pub time: GpsTime,
    /// Fixed or float, as its row says.
    pub status: Status,
    /// Heading, pitch, roll, rad; `None` where unknown.
    pub angles_rad: [Option<f64>; 3],
    /// Their covariance, rad²; rows of unknown angles mean nothing.
    pub covariance_rad2: Matrix3<f64>,
    /// Their rates.
    pub rates: AngleRates,
    /// Where the body is, and its velocity if known, m/s.
    pub place: Option<(Geodetic, Option<Vector<Ned>>)>,
}

/// What counts as known.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RelativeSettings {
    /// 1 σ of pitch or roll that a body's antennas do not see, about zero.
    pub unseen_sd_rad: f64,
    /// Angles less certain than this stay empty.
    pub max_angle_sd_rad: f64,
}

/// Another body as seen from this one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Relative {
    /// Heading, pitch, roll of the other body in the axes of this one, rad; `None` where not
    /// certain enough.
    pub angles_rad: [Option<f64>; 3],
    /// Their covariance, rad².
    pub covariance_rad2: Matrix3<f64>,
    /// From the origin of this body to that of the other, m, where both places are known.
    pub east_north_up_m: Option<Vector3<f64>>,
}

/// The other body as seen from this one at a time; `None` where one of them has no heading.
#[must_use]
pub fn relative(
    own: &BodyState,
    other: &BodyState,
    time: GpsTime,
    settings: RelativeSettings,
) -> Option<Relative> {
    let places = own.place_at(time).zip(other.place_at(time));
    let own_level_from_other = places.map_or_else(
        || Rotation::from_matrix(Matrix3::identity()),
        |(here, there)| here.ned_from_ecef() * there.ecef_from_ned(),
    );
    let (own_attitude, own_rad2) = own.attitude_at(time, settings)?;
    let (other_attitude, other_rad2) = other.attitude_at(time, settings)?;
    let other_attitude: Rotation<Ned, Body> = own_level_from_other * other_attitude;
    let seen = relative_orientation((&own_attitude, &own_rad2), (&other_attitude, &other_rad2));
    // The axes of this body stand for local level ones.
    let angles =
        Attitude::from_ned_from_body(&Rotation::from_matrix(seen.first_from_second.matrix()));
    let covariance_rad2 = angle_covariance(&angles, &seen.covariance_rad2);
    let found = [angles.heading_rad, angles.pitch_rad, angles.roll_rad];
    let max_rad2 = settings.max_angle_sd_rad * settings.max_angle_sd_rad;
    Some(Relative {
        angles_rad: core::array::from_fn(|k| {
            (covariance_rad2[(k, k)] <= max_rad2).then_some(found[k])
        }),
        covariance_rad2,
        east_north_up_m: places.map(|(here, there)| {
            let between = Vector::from_xyz(there.to_ecef().xyz() - here.to_ecef().xyz());
            (enu_from_ned() * (here.ned_from_ecef() * between)).xyz()
        }),
    })
}

impl BodyState {
    /// The whole attitude at another time, with the covariance of the rotation vector in body axes,
    /// rad².
    fn attitude_at(
        &self,
        time: GpsTime,
        settings: RelativeSettings,
    ) -> Option<(Rotation<Ned, Body>, Matrix3<f64>)> {
        let elapsed_s = time - self.time;
        let mut covariance_rad2 = self.covariance_rad2;
        let mut at = [self.angles_rad[0]?, 0.0, 0.0];
        for k in 0..3 {
            let Some(angle) = self.angles_rad[k] else {
                covariance_rad2.row_mut(k).fill(0.0);
                covariance_rad2.column_mut(k).fill(0.0);
                covariance_rad2[(k, k)] = settings.unseen_sd_rad * settings.unseen_sd_rad;
                continue;
            };
            let (rate, sd) =
                self.rates[k].map_or((0.0, UNKNOWN_RATE_RADPS), |r| (r.radps, r.sd_radps));
            at[k] = angle;
            if elapsed_s.abs() > ONE_TIME_S {
                at[k] += rate * elapsed_s;
                let angle_sd = covariance_rad2[(k, k)].sqrt();
                // Backwards the two errors would cancel in part; that is not counted on.
                let common = 2.0 * ANGLE_RATE_CORRELATION * angle_sd * sd * elapsed_s.max(0.0);
                let change = 0.5 * RATE_CHANGE_RADPS2 * elapsed_s * elapsed_s;
                covariance_rad2[(k, k)] += common + (sd * elapsed_s).powi(2) + change * change;
            }
        }
        let angles = Attitude { heading_rad: at[0], pitch_rad: at[1], roll_rad: at[2] };
        // φ = J⁻¹ δ(heading, pitch, roll)
        let by_angles = angles_from_rotation_vector(&angles).try_inverse()?;
        Some((angles.ned_from_body(), by_angles * covariance_rad2 * by_angles.transpose()))
    }

    /// Where the body is at another time.
    fn place_at(&self, time: GpsTime) -> Option<Geodetic> {
        let (place, velocity_mps) = self.place?;
        let moved_m = velocity_mps.map_or_else(Vector3::zeros, |v| v.xyz() * (time - self.time));
        let moved_m = place.ecef_from_ned() * Vector::from_xyz(moved_m);
        Some(Geodetic::from_ecef(Vector::from_xyz(place.to_ecef().xyz() + moved_m.xyz())))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use kurs::turn_rate::Rate;

    const SETTINGS: RelativeSettings = RelativeSettings {
        unseen_sd_rad: 5.0 * core::f64::consts::PI / 180.0,
        max_angle_sd_rad: 5.0 * core::f64::consts::PI / 180.0,
    };

    fn at(second: f64) -> GpsTime {
        GpsTime::from_week_tow(2300, 1000.0).unwrap() + second
    }

    /// A body with these angles, degrees, whose heading turns; 0.1° each.
    fn body(second: f64, angles_deg: [f64; 3], heading_rate_degps: f64) -> BodyState {
        let rate =
            |degps: f64| Some(Rate { radps: degps.to_radians(), sd_radps: 0.2f64.to_radians() });
        BodyState {
            time: at(second),
            status: Status::Fixed,
            angles_rad: angles_deg.map(|angle| Some(angle.to_radians())),
            covariance_rad2: Matrix3::identity() * 0.1f64.to_radians().powi(2),
            rates: [rate(heading_rate_degps), rate(0.0), rate(0.0)],
            place: Some((Geodetic::from_degrees(52.0, 13.0, 100.0), None)),
        }
    }

    fn degrees(found: &Relative) -> [f64; 3] {
        found.angles_rad.map(|angle| angle.unwrap().to_degrees())
    }

    /// Both turn by 10°/s; the other one was last seen a tenth of a second ago.
    #[test]
    fn both_are_brought_to_one_time() {
        let own = body(1.0, [350.0, 0.0, 0.0], 10.0);
        let other = body(0.9, [20.0, 3.0, 0.0], 10.0);
        let found = relative(&own, &other, at(1.0), SETTINGS).unwrap();
        for (found, wanted) in degrees(&found).into_iter().zip([31.0, 3.0, 0.0]) {
            assert!((found - wanted).abs() < 1e-9, "{found}, {wanted}");
        }
        let sd_deg = found.covariance_rad2[(0, 0)].sqrt().to_degrees();
        // 0.1² + 0.1² + 2·0.1·(0.2·0.1)/√2 + (0.2·0.1)² + 0.05²
        let wanted_deg = (0.02f64 + 0.002_828 + 0.0004 + 0.0025).sqrt();
        assert!((sd_deg - wanted_deg).abs() < 2e-4, "{sd_deg}, {wanted_deg}");
        assert_eq!(found.east_north_up_m.unwrap().norm(), 0.0);
    }

    /// Seventy kilometres to the east north is another one, by `Δλ sin φ` to the west.
    #[test]
    fn level_axes_are_those_of_this_body() {
        let own = body(0.0, [0.0; 3], 0.0);
        let mut other = body(0.0, [0.0; 3], 0.0);
        other.place = Some((Geodetic::from_degrees(52.0, 14.0, 100.0), None));
        let found = relative(&own, &other, at(0.0), SETTINGS).unwrap();
        let [heading_deg, ..] = degrees(&found);
        let wanted_deg = 360.0 - 52f64.to_radians().sin();
        assert!((heading_deg - wanted_deg).abs() < 1e-3, "{heading_deg}");
        let [east_m, north_m, up_m]: [f64; 3] = found.east_north_up_m.unwrap().into();
        assert!((68_000.0..69_000.0).contains(&east_m), "{east_m}");
        assert!(north_m > 0.0 && up_m < 0.0, "{north_m}, {up_m}");
    }

    /// What the antennas of one of them do not see stays empty; without a rate a second is too
    /// long.
    #[test]
    fn what_is_not_known_stays_empty() {
        let own = body(1.0, [90.0, 0.0, 0.0], 0.0);
        let mut other = body(1.0, [90.0, 0.0, 0.0], 0.0);
        other.angles_rad[2] = None;
        let found = relative(&own, &other, at(1.0), SETTINGS).unwrap();
        assert!(found.angles_rad[0].is_some() && found.angles_rad[1].is_some());
        assert_eq!(found.angles_rad[2], None);
        other.rates = [None; 3];
        other.time = at(0.0);
        assert_eq!(relative(&own, &other, at(1.0), SETTINGS).unwrap().angles_rad, [None; 3]);
        other.angles_rad[0] = None;
        assert_eq!(relative(&own, &other, at(1.0), SETTINGS), None);
    }
}
