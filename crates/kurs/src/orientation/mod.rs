//! Attitude from the coordinates that receivers give themselves, epoch by epoch.
//!
//! The array is laid onto the measured points with their covariances ([`crate::attitude::coordinates`]).
//! Receivers that are off, floating or jumped, betray themselves by the known distances and are left
//! out, or the epoch is refused ([`consistency`]). Antennas on one line leave a turn open, of which
//! the last whole attitude tells for a while ([`crate::attitude::line`]). Where nobody has measured
//! the array, the data do ([`geometry`]), unless an antenna was moved meanwhile ([`moved`]).

pub mod consistency;
pub mod geometry;
pub mod lengths;
pub mod moved;
pub mod survey;

use nalgebra::{DMatrix, Matrix3, Vector3};

use crate::array::AntennaArray;
use crate::attitude::coordinates::MeasuredPoint;
use crate::attitude::installation::survey_turn_rad2;
use crate::attitude::weighted::logarithm;
use crate::attitude::{AttitudeError, MeasuredLine, Minimum, VerticalMemory, three_point};
use crate::frames::{Body, Ecef, Geodetic, Ned, Rotation, Vector, enu_from_ned};
use crate::solution::{
    AttitudeEstimate, BaselineEstimate, EpochSolution, Outcome, PointEstimate, PositionEstimate,
    PositionOrigin, Reason, Status,
};
use crate::time::GpsTime;
use consistency::{ArrayFit, FitKind, NoFit};
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
pub struct OrienterSettings {
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
    /// For antennas on one line: how far the angle that they cannot see may be from zero (1 sigma).
    pub roll_sd_rad: f64,
    /// Angles less certain than this are left out; a row whose coordinates cause it is not fixed.
    pub max_angle_sd_rad: f64,
    /// Points of the body that are wanted in the outside frame.
    pub points_m: Vec<Vector<Body>>,
}

/// Turns coordinates into attitude.
#[derive(Debug, Clone, PartialEq)]
pub struct Orienter {
    settings: OrienterSettings,
}

/// One epoch with the array laid onto its antennas, as far as they keep the known distances.
#[derive(Debug, Clone)]
pub struct FittedEpoch {
    time: GpsTime,
    /// `None` without any antenna.
    found: Option<(LocalEpoch, Result<ArrayFit, NoFit>)>,
}

/// The antennas of one epoch in local level axes at the first one that is there.
#[derive(Debug, Clone)]
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
    pub fn new(settings: OrienterSettings) -> Result<Self, AttitudeError> {
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

    /// What the orienter remembers from row to row, at the beginning.
    #[must_use]
    pub fn memory(&self) -> VerticalMemory {
        VerticalMemory::new(self.settings.roll_sd_rad)
    }

    /// The row of one epoch; epochs come in the order of time.
    pub fn push(&self, epoch: &PositionEpoch, memory: &mut VerticalMemory) -> EpochSolution {
        self.row(&self.fit(epoch), memory)
    }

    /// The work that an epoch makes: it needs none of the others.
    #[must_use]
    pub fn fit(&self, epoch: &PositionEpoch) -> FittedEpoch {
        let found = self.local(epoch).map(|local| {
            let points: Vec<MeasuredPoint> = local.points.iter().map(|p| p.point).collect();
            let fit = consistency::consistent_fit(&points);
            (local, fit.map(ArrayFit::with_unbiased_information))
        });
        FittedEpoch { time: epoch.time, found }
    }

    /// The row of a fitted epoch, with what the rows before it know of the vertical.
    pub fn row(&self, fitted: &FittedEpoch, memory: &mut VerticalMemory) -> EpochSolution {
        let mut row = EpochSolution::lost(fitted.time, Reason::FewAntennas);
        let Some((local, fit)) = &fitted.found else { return row };
        row.antennas = local.points.len();
        row.position = Some(first_position(local));
        match fit {
            Ok(fit) => self.fill(&mut row, local, fit, memory),
            Err(NoFit::TooFew) => {}
            Err(NoFit::Inconsistent) => {
                row.refuse_attitude(Reason::Geometry);
                row.baselines = baselines(local, |_| Status::Inconsistent);
            }
            Err(NoFit::TwoMinima) => row.refuse_attitude(Reason::TwoMinima),
            Err(NoFit::BadInput) => row.refuse_attitude(Reason::BadInput),
        }
        if let Outcome::Fixed { attitude } = &row.outcome {
            memory.remember(row.time, attitude);
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
    fn fill(
        &self,
        row: &mut EpochSolution,
        local: &LocalEpoch,
        fit: &ArrayFit,
        memory: &VerticalMemory,
    ) {
        let used = |index: usize| fit.excluded != Some(index);
        row.antennas = local.points.len() - usize::from(fit.excluded.is_some());
        row.residual_rms_m = Some(fit.residual_rms_m);
        let mut used_points = local.points.iter().enumerate().filter(|(index, _)| used(*index));
        let doubt = used_points.find_map(|(_, point)| point.doubt);
        row.baselines = baselines(local, |index| match (used(index), local.points[index].doubt) {
            (false, _) => Status::Inconsistent,
            (true, None) => Status::Fixed,
            (true, Some(_)) => Status::Float,
        });

        let points = local.points.iter().enumerate();
        let points: Vec<LocalPoint> =
            points.filter_map(|(index, point)| used(index).then_some(*point)).collect();
        let attitude = match (&fit.kind, self.settings.method) {
            (FitKind::Line { axis, direction }, _) => {
                let line = MeasuredLine {
                    axis: Vector::from_xyz(*axis),
                    direction: Vector::from_xyz(direction.unit),
                    covariance_rad2: direction.covariance_rad2,
                };
                let vertical = memory.at(row.time, &line.axis);
                let installation = line
                    .ned_from_body(&vertical)
                    .and_then(|rotation| self.survey_turn(&points, &rotation, Some(axis)));
                AttitudeEstimate::of_line(&line, &vertical, &installation.unwrap_or_default())
            }
            (FitKind::Body { minimum, .. }, Method::Weighted) => {
                let covariance = minimum.covariance().unwrap_or_default();
                let rotation = Rotation::from_matrix(minimum.rotation);
                let installation = self.survey_turn(&points, &rotation, None).unwrap_or_default();
                AttitudeEstimate::full(rotation, &covariance).with_installation(&installation)
            }
            (FitKind::Body { .. }, Method::ThreePoint) => {
                match three_point_attitude(&points, self.settings.array_sd_m) {
                    Ok(attitude) => attitude,
                    Err(reason) => return row.refuse_attitude(reason),
                }
            }
        };
        let tilt = [attitude.pitch_rad, attitude.roll_rad];
        if tilt.into_iter().flatten().any(|angle| angle.abs() > self.settings.max_tilt_rad) {
            return row.refuse_attitude(Reason::Tilt);
        }
        let max_sd_rad = self.settings.max_angle_sd_rad;
        let certain = attitude.certain_to(max_sd_rad);
        let is_weak = match &fit.kind {
            // How uncertain the turn about the line is says nothing about the coordinates.
            FitKind::Line { direction, .. } => direction.max_sd_rad() > max_sd_rad,
            // Nor does the least certain turn of a body, about an array that is long and thin.
            FitKind::Body { minimum, .. } => second_sd_rad(minimum) > max_sd_rad,
        };
        row.outcome = match doubt.or(is_weak.then_some(Reason::WeakModel)) {
            None => Outcome::Fixed { attitude: certain },
            reason => Outcome::Float { attitude: Some(certain), reason },
        };
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

    /// What errors of the survey turn the body by, when it is laid onto these points.
    fn survey_turn(
        &self,
        points: &[LocalPoint],
        ned_from_body: &Rotation<Ned, Body>,
        line: Option<&Vector3<f64>>,
    ) -> Option<Matrix3<f64>> {
        let (first, others) = points.split_first()?;
        let array_sd_m = self.settings.array_sd_m;
        let body: Vec<_> = others.iter().map(|p| p.point.body_m - first.point.body_m).collect();
        // Baselines from the first of them share its noise.
        let with_survey = |p: &LocalPoint| {
            p.covariance_m2 + Matrix3::from_diagonal_element(array_sd_m * array_sd_m)
        };
        let mut covariance_m2 = DMatrix::from_fn(3 * body.len(), 3 * body.len(), |i, j| {
            with_survey(first)[(i % 3, j % 3)]
        });
        for (block, point) in others.iter().enumerate() {
            let mut own = covariance_m2.fixed_view_mut::<3, 3>(3 * block, 3 * block);
            own += with_survey(point);
        }
        survey_turn_rad2(&body, &ned_from_body.matrix(), &covariance_m2, line, array_sd_m)
    }
}

fn position(position_m: Vector<Ecef>, covariance_m2: Matrix3<f64>) -> PositionEstimate {
    PositionEstimate {
        antenna: None,
        geodetic: Geodetic::from_ecef(position_m),
        position_m,
        covariance_m2,
        velocity_mps: None,
        clock_m: None,
        hdop: None,
        origin: PositionOrigin::Alone,
    }
}

/// The second largest of the standard deviations that turns about the principal axes have.
fn second_sd_rad(minimum: &Minimum) -> f64 {
    let covariance = minimum.covariance().unwrap_or_default();
    let variances = covariance.symmetric_eigenvalues();
    let middle = variances.sum() - variances.max() - variances.min();
    middle.max(0.0).sqrt()
}

/// The first antenna, while the attitude is unknown.
fn first_position(local: &LocalEpoch) -> PositionEstimate {
    PositionEstimate {
        antenna: Some(local.points[0].antenna),
        geodetic: local.anchor,
        position_m: local.anchor_m,
        covariance_m2: local.points[0].covariance_m2,
        velocity_mps: None,
        clock_m: None,
        hdop: None,
        origin: PositionOrigin::Alone,
    }
}

/// The published closed form for the first three antennas, its covariance by central differences.
fn three_point_attitude(
    points: &[LocalPoint],
    array_sd_m: f64,
) -> Result<AttitudeEstimate, Reason> {
    let [first, second, third, ..] = points else { return Err(Reason::FewAntennas) };
    let three = [first, second, third];
    let body = three.map(|p| p.point.body_m);
    let measured = three.map(|p| p.point.measured_m);
    let rotation = three_point::attitude(&body, &measured).map_err(|_| Reason::Geometry)?;
    let (mut noise, mut survey) = (Matrix3::zeros(), Matrix3::zeros());
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
            noise += column * column.transpose() * point.covariance_m2[(axis, axis)];
            survey += column * column.transpose() * array_sd_m.powi(2);
        }
    }
    let attitude = AttitudeEstimate::full(Rotation::from_matrix(rotation), &(noise + survey));
    Ok(attitude.with_installation(&survey))
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
