//! How fast the angles change, from rows that follow each other, and the course over ground.
//!
//! A rate is that of the angle itself, `ȧ ≈ (a₂ − a₁) / (t₂ − t₁)` with the difference taken the short
//! way round. Both rows bring their noise, `σ² = (σ₁² + σ₂²) / (t₂ − t₁)²`; what the survey of the
//! antennas leaves in both is the same and cancels.

use std::collections::VecDeque;

use crate::solution::{EpochSolution, Outcome, PositionEstimate, Status};
use crate::time::GpsTime;

/// Rows further apart than this many intervals have a gap between them.
const MAX_INTERVALS: f64 = 2.0;
/// Time tags may be off by this share of an interval.
const JITTER: f64 = 0.05;
/// Spacings of rows whose median is the interval.
const SPACINGS: usize = 15;
/// A body slower than this has no course: Doppler tells velocities to some centimetres a second.
const MIN_COURSE_SPEED_MPS: f64 = 0.5;

/// Rate of an angle with its standard deviation, rad/s.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rate {
    /// The derivative of the angle.
    pub radps: f64,
    /// Standard deviation of it.
    pub sd_radps: f64,
}

/// Rates of heading, pitch and roll; `None` where this row or the one before does not have the angle.
pub type AngleRates = [Option<Rate>; 3];

/// Follows rows in the order of time.
#[derive(Debug, Clone, Default)]
pub struct TurnRate {
    spacings_s: VecDeque<f64>,
    newest: Option<GpsTime>,
    /// Status, time, angle and its variance of the last row that had the angle.
    last: [Option<(Status, GpsTime, f64, f64)>; 3],
}

impl TurnRate {
    /// Takes the next row in and gives the rates at it, from this row and earlier ones alone.
    pub fn push(&mut self, row: &EpochSolution) -> AngleRates {
        self.take_spacing(row.time);
        let longest_s = self.interval_s().map(|s| s * (MAX_INTERVALS + JITTER));
        let (Outcome::Fixed { attitude } | Outcome::Float { attitude: Some(attitude), .. }) =
            &row.outcome
        else {
            return [None; 3];
        };
        let (angles, noise_rad2) = (attitude.angles_rad(), attitude.noise_rad2());
        core::array::from_fn(|k| {
            let (angle, variance) = (angles[k]?, noise_rad2[(k, k)]);
            let before = self.last[k].replace((row.status(), row.time, angle, variance));
            let (status, time, angle_before, variance_before) = before?;
            let elapsed_s = row.time - time;
            let follows = elapsed_s > 0.0 && elapsed_s <= longest_s? && status == row.status();
            let turn = (angle - angle_before + core::f64::consts::PI)
                .rem_euclid(core::f64::consts::TAU)
                - core::f64::consts::PI;
            follows.then(|| Rate {
                radps: turn / elapsed_s,
                sd_radps: (variance + variance_before).sqrt() / elapsed_s,
            })
        })
    }

    fn take_spacing(&mut self, time: GpsTime) {
        if let Some(before) = self.newest.replace(time)
            && time > before
        {
            self.spacings_s.push_back(time - before);
            if self.spacings_s.len() > SPACINGS {
                self.spacings_s.pop_front();
            }
        }
    }

    /// Median of the last spacings.
    fn interval_s(&self) -> Option<f64> {
        let mut sorted: Vec<f64> = self.spacings_s.iter().copied().collect();
        sorted.sort_by(f64::total_cmp);
        sorted.get(sorted.len().saturating_sub(1) / 2).copied()
    }
}

/// Course over ground, clockwise from true north, `0 ≤ course < 2π`; `None` without a velocity, and
/// for a body that hardly moves.
#[must_use]
pub fn course_rad(position: &PositionEstimate) -> Option<f64> {
    let [north, east, _]: [f64; 3] = position.velocity_mps?.xyz().into();
    let moves = north.hypot(east) >= MIN_COURSE_SPEED_MPS;
    moves.then(|| crate::frames::wrap_heading(east.atan2(north)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frames::{Attitude, Geodetic, Vector};
    use crate::solution::{AttitudeEstimate, Reason};
    use nalgebra::{Matrix3, Vector3};

    /// A level row with these variances of the heading: noise, and that of the installation.
    fn row(second: f64, heading_deg: f64, noise: f64, installation: f64) -> EpochSolution {
        let angles =
            Attitude { heading_rad: heading_deg.to_radians(), pitch_rad: 0.0, roll_rad: 0.0 };
        let about_z = |variance| Matrix3::from_diagonal(&Vector3::new(1e-6, 1e-6, variance));
        let attitude =
            AttitudeEstimate::full(angles.ned_from_body(), &about_z(noise + installation))
                .with_installation(&Matrix3::from_diagonal(&Vector3::new(0.0, 0.0, installation)));
        EpochSolution {
            outcome: Outcome::Fixed { attitude },
            ..EpochSolution::lost(GpsTime::from_week_tow(2300, second).unwrap(), Reason::Ratio)
        }
    }

    #[test]
    fn the_rate_goes_the_short_way_and_loses_the_constant() {
        let mut rate = TurnRate::default();
        assert_eq!(rate.push(&row(0.0, 359.0, 1e-6, 1e-2)), [None; 3]);
        let [heading, pitch, _] = rate.push(&row(0.5, 2.0, 3e-6, 1e-2));
        let heading = heading.unwrap();
        assert!((heading.radps.to_degrees() - 6.0).abs() < 1e-9, "3° in half a second");
        assert!((heading.sd_radps - 2.0 * 4e-6f64.sqrt()).abs() < 1e-9, "{}", heading.sd_radps);
        assert_eq!(pitch.unwrap().radps, 0.0);
        // And back to port.
        let [heading, ..] = rate.push(&row(1.0, 358.0, 1e-6, 1e-2));
        assert!((heading.unwrap().radps.to_degrees() + 8.0).abs() < 1e-9);
    }

    /// One row without an angle is bridged, two are a gap; after it the next row has rates again.
    #[test]
    fn none_across_a_gap() {
        let mut rate = TurnRate::default();
        let has_rate = |rate: &mut TurnRate, second: f64| {
            rate.push(&row(second, second, 1e-6, 0.0))[0].is_some()
        };
        let found: Vec<bool> =
            [0.0, 1.0, 2.0, 3.0, 5.0, 8.0, 9.0, 11.1].map(|s| has_rate(&mut rate, s)).to_vec();
        assert_eq!(found, [false, true, true, true, true, false, true, false]);
        let lost = EpochSolution::lost(GpsTime::from_week_tow(2300, 12.1).unwrap(), Reason::Ratio);
        assert_eq!(rate.push(&lost), [None; 3]);
        assert!(has_rate(&mut rate, 13.1), "two intervals after the last fix");
        let mut float = row(14.1, 90.0, 1.0, 0.0);
        float.outcome = Outcome::Float { attitude: float.attitude().copied(), reason: None };
        assert_eq!(
            rate.push(&float)[0],
            None,
            "what jumps from a fix to a float solution is no turn"
        );
    }

    #[test]
    fn a_course_needs_a_moving_body() {
        let at = |north, east| {
            course_rad(&PositionEstimate {
                antenna: None,
                geodetic: Geodetic::from_degrees(50.0, 10.0, 0.0),
                position_m: Vector::new(0.0, 0.0, 0.0),
                covariance_m2: Matrix3::identity(),
                velocity_mps: Some(Vector::new(north, east, 3.0)),
                clock_m: None,
                hdop: None,
                origin: crate::solution::PositionOrigin::Alone,
            })
        };
        assert!((at(0.0, -1.0).unwrap().to_degrees() - 270.0).abs() < 1e-12);
        assert_eq!(at(0.2, 0.3), None);
    }
}
