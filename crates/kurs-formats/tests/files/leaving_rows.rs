//! Rows for tests of what leaves.

use kurs::frames::{Attitude, Body, Geodetic, Vector, enu_from_ned};
use kurs::solution::{
    AttitudeEstimate, BaselineEstimate, EpochSolution, Outcome, PositionEstimate, PositionOrigin,
    Reason, Status,
};
use kurs::time::GpsTime;
use nalgebra::{Matrix3, Vector3};

/// The time of row number `k` at 10 Hz.
pub(crate) fn time(k: i64) -> GpsTime {
    GpsTime::from_week_tow(2305, 43_200.0).unwrap() + 0.1 * k as f64
}

/// South of the equator, going north-east.
pub(crate) fn position() -> PositionEstimate {
    let geodetic = Geodetic::from_degrees(-43.1, 131.9, 30.0);
    PositionEstimate {
        antenna: None,
        geodetic,
        position_m: geodetic.to_ecef(),
        covariance_m2: Matrix3::from_diagonal(&Vector3::new(4.0, 5.0, 9.0)),
        velocity_mps: Some(Vector::new(3.0, 2.0, 0.1)),
        clock_m: None,
        hdop: Some(0.9),
        origin: PositionOrigin::Alone,
    }
}

/// A row with a position and without an attitude.
pub(crate) fn without_heading(k: i64) -> EpochSolution {
    let mut row = EpochSolution::lost(time(k), Reason::FewAntennas);
    row.position = Some(position());
    row.satellites = 14;
    row
}

/// A fixed row, degrees.
pub(crate) fn fixed(k: i64, [heading, pitch, roll]: [f64; 3]) -> EpochSolution {
    let mut row = without_heading(k);
    let rotation = angles([heading, pitch, roll]).ned_from_body();
    let covariance = Matrix3::from_diagonal(&Vector3::new(4e-6, 9e-6, 1e-6));
    row.outcome = Outcome::Fixed { attitude: AttitudeEstimate::full(rotation, &covariance) };
    row
}

/// A fixed row of two antennas on a line along the body: the roll is not seen.
pub(crate) fn fixed_line(k: i64, degrees: [f64; 3], line_m: Vector<Body>) -> EpochSolution {
    let mut row = fixed(k, degrees);
    let full = *row.attitude().unwrap();
    let attitude = AttitudeEstimate { roll_rad: None, ned_from_body: None, ..full };
    row.outcome = Outcome::Fixed { attitude };
    row.baselines = vec![BaselineEstimate {
        base: 0,
        rover: 1,
        status: Status::Fixed,
        baseline_m: enu_from_ned() * (angles(degrees).ned_from_body() * line_m),
        covariance_m2: Matrix3::identity() * 1e-5,
    }];
    row
}

/// A row whose integers are not accepted.
pub(crate) fn float(k: i64, degrees: [f64; 3]) -> EpochSolution {
    let mut row = fixed(k, degrees);
    let attitude = row.attitude().copied();
    row.outcome = Outcome::Float { attitude, reason: Some(Reason::Ratio) };
    row
}

pub(crate) fn angles([heading, pitch, roll]: [f64; 3]) -> Attitude {
    Attitude {
        heading_rad: heading.to_radians(),
        pitch_rad: pitch.to_radians(),
        roll_rad: roll.to_radians(),
    }
}
