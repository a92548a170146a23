//! Attitude from the coordinates that receivers give themselves, epoch by epoch.
//!
//! The array is laid onto the measured points with their covariances ([`crate::attitude::coordinates`]).
//! Receivers that are off, floating or jumped, betray themselves by the known distances and are left
//! out, or the epoch is refused ([`consistency`]). Where nobody has measured the array, the data do
//! ([`geometry`]).

pub mod consistency;
pub mod geometry;
pub mod lengths;
pub mod survey;

use nalgebra::{Matrix3, Vector3};

use crate::array::AntennaArray;
use crate::attitude::coordinates::MeasuredPoint;
use crate::attitude::weighted::logarithm;
use crate::attitude::{AttitudeError, three_point};
use crate::frames::{Body, Ecef, Geodetic, Ned, Rotation, Vector, enu_from_ned};
use crate::solution::{
    AttitudeEstimate, BaselineEstimate, EpochSolution, PointEstimate, PositionEstimate, Reason,
    Status,
};
use crate::time::GpsTime;
use consistency::{Fit, FitKind, NoFit};
use lengths::Length;

/// Epochs from which the factor on the standard deviations is found.
const MAX_EPOCHS_FOR_FACTOR: usize = 5000;
/// Step of the central differences for the covariance of the three-point method, m.
const DIFFERENCE_STEP_M: f64 = 1e-4;

/// One antenna's coordinates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AntennaFix {
    /// Where it was measured.
    pub position_m: Vector<Ecef>,
    /// Standard deviations north, east, down, m.
    pub sd_ned_m: [f64; 3],
    /// Why the receiver's own solution is less than one with integers; `None` if it is one, or nothing
    /// is said.
    pub doubt: Option<Reason>,
}

/// Coordinates of one time.
#[derive(Debug, Clone, PartialEq)]
pub struct PositionEpoch {
    /// When.
    pub time: GpsTime,
    /// One entry for each antenna of the array; `None` where it is missing.
    pub antennas: Vec<Option<AntennaFix>>,
}

/// How the attitude is found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Method {
    /// Weighted fit of all antennas.
    Weighted,
    /// The published closed form for the first three antennas.
    ThreePoint,
}

/// What is known beforehand.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// The antennas in body axes.
    pub array: AntennaArray,
    /// How well they are known, m.
    pub array_sd_m: f64,
    /// Factor on the standard deviations that the coordinates state.
    pub sd_scale: f64,
    /// How the attitude is found.
    pub method: Method,
    /// What the body cannot exceed in pitch or roll.
    pub max_tilt_rad: f64,
    /// An angle with a larger standard deviation is left out, and its row is not fixed.
    pub max_angle_sd_rad: f64,
    /// Points of the body that are wanted in the outside frame.
    pub points_m: Vec<Vector<Body>>,
}

/// Turns coordinates into attitude.
#[derive(Debug, Clone, PartialEq)]
pub struct Orienter {
    settings: Settings,
}

/// The antennas of one epoch in local level axes at the first one that is there.
struct LocalEpoch {
    anchor: Geodetic,
    anchor_m: Vector<Ecef>,
    points: Vec<LocalPoint>,
}

/// One antenna of a [`LocalEpoch`].
#[derive(Debug, Clone, Copy)]
struct LocalPoint {
    antenna: usize,
    point: MeasuredPoint,
    covariance_m2: Matrix3<f64>,
    doubt: Option<Reason>,
}

impl Orienter {
    /// Checks that the method suits the array.
    ///
    /// # Errors
    ///
    /// [`AttitudeError::NotAcute`] or [`AttitudeError::TooFewVectors`] where the three-point method
    /// cannot take the first three antennas.
    pub fn new(settings: Settings) -> Result<Self, AttitudeError> {
        if settings.method == Method::ThreePoint {
            three_point::corner(&first_three(settings.array.positions_m())?)?;
        }
        Ok(Self { settings })
    }

    /// The factor on all standard deviations with which the known distances are kept as well as
    /// chance lets them be, from the median epoch; `None` without epochs that can tell.
    #[must_use]
    pub fn sd_factor(&self, epochs: &[PositionEpoch]) -> Option<f64> {
        let step = epochs.len().div_ceil(MAX_EPOCHS_FOR_FACTOR).max(1);
        let local = epochs.iter().step_by(step).filter_map(|epoch| self.local(epoch));
        let points = local.map(|local| local.points.iter().map(|p| p.point).collect());
        Some(consistency::variance_factor(points)?.sqrt())
    }

    /// The lengths between the antennas as measured and as known, of every pair that is there together.
    #[must_use]
    pub fn lengths(&self, epochs: &[PositionEpoch]) -> Vec<Length> {
        let step = epochs.len().div_ceil(MAX_EPOCHS_FOR_FACTOR).max(1);
        let local = epochs.iter().step_by(step).filter_map(|epoch| self.local(epoch));
        lengths::of(local.map(|local| local.points.iter().map(|p| (p.antenna, p.point)).collect()))
    }

    /// The row of one epoch.
    #[must_use]
    pub fn push(&self, epoch: &PositionEpoch) -> EpochSolution {
        let Some(local) = self.local(epoch) else {
            return EpochSolution::lost(epoch.time, Reason::FewAntennas);
        };
        let mut row = EpochSolution::lost(epoch.time, Reason::FewAntennas);
        row.antennas = local.points.len();
        row.position = Some(first_position(&local));
        let points: Vec<MeasuredPoint> = local.points.iter().map(|p| p.point).collect();
        match consistency::consistent_fit(&points) {
            Ok(fit) => self.fill(&mut row, &local, &fit.with_unbiased_information()),
            Err(NoFit::TooFew) => {}
            Err(NoFit::Inconsistent) => {
                refuse(&mut row, Reason::Geometry);
                row.baselines = baselines(&local, |_| Status::Inconsistent);
            }
            Err(NoFit::TwoMinima) => refuse(&mut row, Reason::TwoMinima),
            Err(NoFit::BadInput) => refuse(&mut row, Reason::BadInput),
        }
        row
    }

    /// Antennas that are there, in local level axes.
    fn local(&self, epoch: &PositionEpoch) -> Option<LocalEpoch> {
        let array = &self.settings.array;
        let present = || {
            let fixes = epoch.antennas.iter().take(array.len()).enumerate();
            fixes.filter_map(|(antenna, fix)| fix.map(|fix| (antenna, fix)))
        };
        let (_, first) = present().next()?;
        let anchor = Geodetic::from_ecef(first.position_m);
        let ned_from_ecef = anchor.ned_from_ecef();
        let points = present().map(|(antenna, fix)| {
            let array_variance = self.settings.array_sd_m * self.settings.array_sd_m;
            let variances =
                Vector3::from(fix.sd_ned_m).map(|sd| (self.settings.sd_scale * sd).powi(2));
            let point = MeasuredPoint {
                body_m: array.positions_m()[antenna].xyz(),
                measured_m: (ned_from_ecef * (fix.position_m - first.position_m)).xyz(),
                information: Matrix3::from_diagonal(&variances.map(|v| 1.0 / (v + array_variance))),
            };
            LocalPoint {
                antenna,
                point,
                covariance_m2: Matrix3::from_diagonal(&variances),
                doubt: fix.doubt,
            }
        });
        Some(LocalEpoch { anchor, anchor_m: first.position_m, points: points.collect() })
    }

    /// Attitude, position, baselines and points of a consistent epoch.
    fn fill(&self, row: &mut EpochSolution, local: &LocalEpoch, fit: &Fit) {
        let used = |index: usize| fit.excluded != Some(index);
        row.antennas = local.points.len() - usize::from(fit.excluded.is_some());
        row.residual_rms_m = Some(fit.residual_rms_m);
        let mut used_points = local.points.iter().enumerate().filter(|(index, _)| used(*index));
        row.reason = used_points.find_map(|(_, point)| point.doubt);
        row.status = if row.reason.is_none() { Status::Fixed } else { Status::Float };
        row.baselines = baselines(local, |index| match (used(index), local.points[index].doubt) {
            (false, _) => Status::Inconsistent,
            (true, None) => Status::Fixed,
            (true, Some(_)) => Status::Float,
        });

        let attitude = match (&fit.kind, self.settings.method) {
            (FitKind::Line { axis, direction }, _) => {
                let (axis, unit) = (Vector::from_xyz(*axis), Vector::from_xyz(direction.unit));
                match AttitudeEstimate::of_axis(&axis, &unit, &direction.covariance_rad2) {
                    Some(attitude) => attitude,
                    None => return refuse(row, Reason::Geometry),
                }
            }
            (FitKind::Body { minimum, .. }, Method::Weighted) => {
                let covariance = minimum.covariance().unwrap_or_default();
                AttitudeEstimate::full(Rotation::from_matrix(minimum.rotation), &covariance)
            }
            (FitKind::Body { .. }, Method::ThreePoint) => {
                match three_point_attitude(
                    local
                        .points
                        .iter()
                        .enumerate()
                        .filter_map(|(index, point)| used(index).then_some(*point)),
                ) {
                    Ok(attitude) => attitude,
                    Err(reason) => return refuse(row, reason),
                }
            }
        };
        let tilt = [attitude.pitch_rad, attitude.roll_rad];
        if tilt.into_iter().flatten().any(|angle| angle.abs() > self.settings.max_tilt_rad) {
            return refuse(row, Reason::Tilt);
        }
        let surer = surer_than(attitude, self.settings.max_angle_sd_rad);
        if surer != attitude && row.status == Status::Fixed {
            (row.status, row.reason) = (Status::Float, Some(Reason::WeakModel));
        }
        row.attitude = Some(surer);
        if let (FitKind::Body { minimum, normal }, Some(rotation)) =
            (&fit.kind, attitude.ned_from_body)
        {
            let origin = Vector::<Ned>::from_xyz(normal.origin_m(&rotation.matrix()));
            let place = |body: &Vector<Body>| {
                let ecef = local.anchor.ecef_from_ned() * (origin + rotation * *body);
                let covariance = normal.point_covariance_m2(minimum, &body.xyz());
                (local.anchor_m + ecef, covariance.unwrap_or_default())
            };
            let (position_m, covariance_m2) = place(&Vector::new(0.0, 0.0, 0.0));
            row.position = Some(position(position_m, covariance_m2));
            let points = self.settings.points_m.iter().enumerate();
            row.points = points
                .map(|(index, body)| {
                    let (position_m, covariance_m2) = place(body);
                    PointEstimate {
                        index,
                        geodetic: Geodetic::from_ecef(position_m),
                        covariance_m2,
                    }
                })
                .collect();
        }
    }
}

/// The attitude without the angles that are less certain.
fn surer_than(mut attitude: AttitudeEstimate, sd_rad: f64) -> AttitudeEstimate {
    let angles =
        [&mut attitude.heading_rad, &mut attitude.pitch_rad, &mut attitude.roll_rad].into_iter();
    let mut all = true;
    for (place, angle) in angles.enumerate() {
        let is_sure = attitude.covariance_rad2[(place, place)] <= sd_rad * sd_rad;
        *angle = angle.filter(|_| is_sure);
        all &= is_sure;
    }
    attitude.ned_from_body = attitude.ned_from_body.filter(|_| all);
    attitude
}

fn refuse(row: &mut EpochSolution, reason: Reason) {
    (row.status, row.reason) = (Status::Inconsistent, Some(reason));
}

fn position(position_m: Vector<Ecef>, covariance_m2: Matrix3<f64>) -> PositionEstimate {
    PositionEstimate {
        geodetic: Geodetic::from_ecef(position_m),
        position_m,
        covariance_m2,
        velocity_mps: None,
        clock_m: None,
    }
}

/// The first antenna, while the attitude is unknown.
fn first_position(local: &LocalEpoch) -> PositionEstimate {
    PositionEstimate {
        geodetic: local.anchor,
        position_m: local.anchor_m,
        covariance_m2: local.points[0].covariance_m2,
        velocity_mps: None,
        clock_m: None,
    }
}

/// The published closed form for the first three antennas, its covariance by central differences.
fn three_point_attitude(
    mut points: impl Iterator<Item = LocalPoint>,
) -> Result<AttitudeEstimate, Reason> {
    let mut next = || points.next().ok_or(Reason::FewAntennas);
    let three = [next()?, next()?, next()?];
    let body = three.map(|p| p.point.body_m);
    let measured = three.map(|p| p.point.measured_m);
    let rotation = three_point::attitude(&body, &measured).map_err(|_| Reason::Geometry)?;
    let mut covariance = Matrix3::zeros();
    for (corner, point) in three.iter().enumerate() {
        for axis in 0..3 {
            let moved = |step: f64| {
                let mut moved = measured;
                moved[corner][axis] += step;
                let turned = three_point::attitude(&body, &moved).map_err(|_| Reason::Geometry)?;
                Ok(logarithm(&(rotation.transpose() * turned)))
            };
            let difference = moved(DIFFERENCE_STEP_M)? - moved(-DIFFERENCE_STEP_M)?;
            let column = difference / (2.0 * DIFFERENCE_STEP_M);
            covariance += column * column.transpose() * point.covariance_m2[(axis, axis)];
        }
    }
    Ok(AttitudeEstimate::full(Rotation::from_matrix(rotation), &covariance))
}

fn first_three(positions: &[Vector<Body>]) -> Result<[Vector3<f64>; 3], AttitudeError> {
    match positions {
        [a, b, c, ..] => Ok([a.xyz(), b.xyz(), c.xyz()]),
        _ => Err(AttitudeError::TooFewVectors { found: positions.len() }),
    }
}

/// From the first antenna to each other one, where both are there; east, north, up.
fn baselines(local: &LocalEpoch, status: impl Fn(usize) -> Status) -> Vec<BaselineEstimate> {
    let enu = enu_from_ned();
    let Some(base) = local.points.first().filter(|point| point.antenna == 0) else {
        return Vec::new();
    };
    let rovers = local.points.iter().enumerate().skip(1);
    rovers
        .map(|(index, rover)| {
            let baseline = Vector::<Ned>::from_xyz(rover.point.measured_m - base.point.measured_m);
            BaselineEstimate {
                base: base.antenna,
                rover: rover.antenna,
                status: status(0).max(status(index)),
                baseline_m: enu * baseline,
                covariance_m2: enu.turn_covariance(&(base.covariance_m2 + rover.covariance_m2)),
            }
        })
        .collect()
}
