//! The vector between two antennas, as a receiver with a moving base measures it.

use kurs::frames::{Body, Ned, Vector, skew};
use kurs::solution::{AttitudeEstimate, EpochSolution, Status};
use nalgebra::{Matrix3, Vector3};

/// From the first antenna to another one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AntennaLine {
    /// Index of the other antenna.
    pub rover: usize,
    /// The vector in body axes, m.
    pub body_m: Vector<Body>,
}

/// The vector in an epoch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Measured {
    /// North, east, down, m.
    pub(crate) ned_m: Vector<Ned>,
    /// Covariance of that, m².
    pub(crate) covariance_m2: Matrix3<f64>,
}

impl AntennaLine {
    /// The vector of a fixed row: turned by the attitude where all three angles are known, which
    /// serves even while the antenna itself is missing; else the baseline.
    pub(crate) fn in_row(&self, row: &EpochSolution) -> Option<Measured> {
        let attitude = row.attitude().filter(|_| row.is_fixed())?;
        self.turned(attitude).or_else(|| self.baseline(row))
    }

    /// `v = R b`. With the axes that the angles turn about, `dv = Σ (axis × v) dangle`.
    fn turned(&self, attitude: &AttitudeEstimate) -> Option<Measured> {
        let ned_from_body = attitude.ned_from_body?;
        let ned_m = ned_from_body * self.body_m;
        let heading_rad = attitude.heading_rad?;
        let axes = Matrix3::from_columns(&[
            Vector3::z(),
            Vector3::new(-heading_rad.sin(), heading_rad.cos(), 0.0),
            ned_from_body.matrix().column(0).into_owned(),
        ]);
        let by_angles = -skew(&ned_m.xyz()) * axes;
        let covariance_m2 = by_angles * attitude.covariance_rad2 * by_angles.transpose();
        Some(Measured { ned_m, covariance_m2 })
    }

    fn baseline(&self, row: &EpochSolution) -> Option<Measured> {
        let fixed = |b: &&kurs::solution::BaselineEstimate| {
            b.base == 0 && b.rover == self.rover && b.status == Status::Fixed
        };
        let baseline = row.baselines.iter().find(fixed)?;
        let ned_from_enu = kurs::frames::enu_from_ned().inverse();
        let covariance_m2 = ned_from_enu.turn_covariance(&baseline.covariance_m2);
        Some(Measured { ned_m: ned_from_enu * baseline.baseline_m, covariance_m2 })
    }
}

impl Measured {
    pub(crate) fn length_m(&self) -> f64 {
        self.ned_m.norm()
    }

    /// Standard deviation of the length, m.
    pub(crate) fn length_sd_m(&self) -> f64 {
        let along = self.ned_m.direction().xyz();
        (along.transpose() * self.covariance_m2 * along)[0].max(0.0).sqrt()
    }

    /// Clockwise from true north, `0 ≤ heading < 2π`.
    pub(crate) fn heading_rad(&self) -> f64 {
        let [north, east, _]: [f64; 3] = self.ned_m.xyz().into();
        kurs::frames::wrap_heading(east.atan2(north))
    }

    /// Standard deviation of the heading, rad.
    pub(crate) fn heading_sd_rad(&self) -> f64 {
        let [north, east, _]: [f64; 3] = self.ned_m.xyz().into();
        let across = Vector3::new(-east, north, 0.0) / (north * north + east * east);
        (across.transpose() * self.covariance_m2 * across)[0].max(0.0).sqrt()
    }
}
