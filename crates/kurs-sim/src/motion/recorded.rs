//! A motion from a table: cubic between the rows in position, the shortest turn in attitude.

use kurs::frames::{Attitude, Ecef, Rotation, Vector};
use nalgebra::{Rotation3, UnitQuaternion, Vector3};

use super::{Pose, attitude_of};
use crate::check;
use crate::scenario::Place;

/// A row of the table.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RecordedPose {
    /// From the start of the scenario.
    pub time_s: f64,
    /// Where.
    pub place: Place,
    /// Heading, pitch and roll.
    pub angles_deg: [f64; 3],
}

/// The table cannot be interpolated.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum BadPoseTable {
    /// Fewer than two rows.
    #[error("{found} rows, at least 2 are needed")]
    Rows {
        /// How many there are.
        found: usize,
    },
    /// Times must increase.
    #[error("row {row}: time_s {time_s} is not later than the row before")]
    Order {
        /// Which row, from 1.
        row: usize,
        /// Its time.
        time_s: f64,
    },
    /// A number that cannot be.
    #[error("row {row}: {problem}")]
    Value {
        /// Which row, from 1.
        row: usize,
        /// Column, number and what was expected.
        problem: String,
    },
}

/// See the module.
#[derive(Debug, Clone)]
pub struct Recorded {
    rows: Vec<(f64, Vector3<f64>, UnitQuaternion<f64>)>,
}

impl Recorded {
    pub(super) fn new(poses: &[RecordedPose]) -> Result<Self, BadPoseTable> {
        if poses.len() < 2 {
            return Err(BadPoseTable::Rows { found: poses.len() });
        }
        for (k, pose) in poses.iter().enumerate() {
            check::check_pose(pose)
                .map_err(|error| BadPoseTable::Value { row: k + 1, problem: error.to_string() })?;
        }
        let late = |k: &usize| poses[*k].time_s <= poses[*k - 1].time_s;
        if let Some(row) = (1..poses.len()).find(late) {
            return Err(BadPoseTable::Order { row: row + 1, time_s: poses[row].time_s });
        }
        let row = |pose: &RecordedPose| {
            let matrix = attitude_of(pose.angles_deg).ned_from_body().matrix();
            let turn = Rotation3::from_matrix_unchecked(matrix);
            let position = pose.place.geodetic().to_ecef().xyz();
            (pose.time_s, position, UnitQuaternion::from_rotation_matrix(&turn))
        };
        Ok(Self { rows: poses.iter().map(row).collect() })
    }

    /// Before the first and after the last row the body stands still.
    pub(super) fn pose(&self, time_s: f64) -> Pose {
        let last = self.rows.len() - 1;
        let next = self.rows.partition_point(|row| row.0 <= time_s).clamp(1, last);
        let (from, to) = (&self.rows[next - 1], &self.rows[next]);
        let span_s = to.0 - from.0;
        let s = ((time_s - from.0) / span_s).clamp(0.0, 1.0);
        let slope = |k: usize| {
            let (before, after) = (&self.rows[k.max(1) - 1], &self.rows[(k + 1).min(last)]);
            (after.1 - before.1) / (after.0 - before.0) * span_s
        };
        let position: Vector<Ecef> =
            Vector::from_xyz(hermite(s, from.1, slope(next - 1), to.1, slope(next)));
        let turn = from.2.try_slerp(&to.2, s, 1e-12).unwrap_or(to.2);
        let ned_from_body = Rotation::from_matrix(turn.to_rotation_matrix().into_inner());
        Pose { position_m: position, attitude: Attitude::from_ned_from_body(&ned_from_body) }
    }
}

/// The cubic with these values and slopes (for the whole span) at `s` = 0 and 1.
fn hermite(
    s: f64,
    from: Vector3<f64>,
    from_slope: Vector3<f64>,
    to: Vector3<f64>,
    to_slope: Vector3<f64>,
) -> Vector3<f64> {
    let (s2, s3) = (s * s, s * s * s);
    from * (2.0 * s3 - 3.0 * s2 + 1.0)
        + from_slope * (s3 - 2.0 * s2 + s)
        + to * (3.0 * s2 - 2.0 * s3)
        + to_slope * (s3 - s2)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_are_met_and_the_way_between_is_smooth() {
        let row = |k: f64| RecordedPose {
            time_s: k,
            place: Place { latitude_deg: 10.0 + k * 1e-5, longitude_deg: 20.0, height_m: k },
            angles_deg: [350.0 + 8.0 * k, 2.0 * k, -k],
        };
        let rows: Vec<RecordedPose> = (0..5).map(|k| row(f64::from(k))).collect();
        let recorded = Recorded::new(&rows).unwrap();
        for wanted in &rows {
            let pose = recorded.pose(wanted.time_s);
            let off_m = (pose.position_m - wanted.place.geodetic().to_ecef()).norm();
            assert!(off_m < 1e-6, "{off_m}");
            let turn = attitude_of(wanted.angles_deg).ned_from_body().matrix()
                - pose.attitude.ned_from_body().matrix();
            assert!(turn.norm() < 1e-9, "{}", turn.norm());
        }
        // Heading goes through north the short way: 358 and 6 degrees have 2 degrees between them.
        let heading_deg = recorded.pose(1.5).attitude.heading_rad.to_degrees();
        assert!((heading_deg - 2.0).abs() < 0.1, "{heading_deg}");
        assert_eq!(Recorded::new(&rows[..1]).unwrap_err(), BadPoseTable::Rows { found: 1 });
        let far = RecordedPose { place: Place { latitude_deg: 95.0, ..rows[0].place }, ..rows[1] };
        let error = Recorded::new(&[rows[0], far]).unwrap_err().to_string();
        assert_eq!(error, "row 2: latitude_deg: 95, expected from -90 to 90");
        let twice = [rows[0], rows[0]];
        assert!(matches!(Recorded::new(&twice), Err(BadPoseTable::Order { row: 2, .. })));
    }
}
