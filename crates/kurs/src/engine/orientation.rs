//! From baselines to the angles of the body.

use nalgebra::{DMatrix, DVector, Matrix3};

use super::array_misfit::Misfit;

use crate::array::{AntennaArray, Shape, survey_covariance};
use crate::attitude::installation::survey_turn_rad2;
use crate::attitude::{MeasuredLine, VerticalMemory, joint};
use crate::baseline::Baselines;
use crate::float_solution::Fit;
use crate::frames::{Body, Ecef, Rotation, Vector};
use crate::sky::Horizon;
use crate::solution::{AttitudeEstimate, Reason};
use crate::time::GpsTime;

/// A second attitude whose χ² is worse by less than this is not told apart (99.9 %, one degree of
/// freedom).
const TWO_MINIMA_CHI2: f64 = 10.8;

/// What is known of the body before an epoch.
#[derive(Debug, Clone, Copy)]
pub(super) struct KnownBody<'a> {
    /// The antennas, if they have places.
    pub(super) array: Option<&'a AntennaArray>,
    /// Standard deviation of each of their coordinates.
    pub(super) array_sd_m: f64,
    /// For antennas on one line: where down was on the body.
    pub(super) memory: &'a VerticalMemory,
    /// Of the epoch.
    pub(super) time: GpsTime,
    /// An angle less certain than this is not told.
    pub(super) max_angle_sd_rad: f64,
}

/// How the body stands, and how its baselines fit to the known array.
#[derive(Debug)]
pub(super) struct Orientation {
    pub(super) attitude: Result<AttitudeEstimate, Reason>,
    /// How the baselines fit to the array; `None` where it has nothing but a length, or no known places.
    pub(super) geometry: Option<Fit>,
    /// `None` where nothing is known that they could fit to.
    pub(super) misfit: Option<Misfit>,
}

/// Orientation of the body: all three angles for an array that spans a plane, otherwise what a line of
/// antennas sees.
pub(super) fn orient(
    baselines: &Baselines,
    horizon: &Horizon,
    known: &KnownBody<'_>,
) -> Orientation {
    let present = |array: &AntennaArray| array.part(baselines.reference, &baselines.rovers);
    let orientation = match known.array.and_then(present) {
        Some(part) if part.shape() == Shape::Collinear => line(baselines, horizon, &part, known),
        Some(part) => full(baselines, horizon, &part, known.array_sd_m),
        None => of_first_baseline(baselines, horizon, known),
    };
    let certain = |attitude: AttitudeEstimate| attitude.certain_to(known.max_angle_sd_rad);
    Orientation { attitude: orientation.attitude.map(certain), ..orientation }
}

/// The first baseline as the forward axis of a body whose array nobody knows.
fn of_first_baseline(
    baselines: &Baselines,
    horizon: &Horizon,
    known: &KnownBody<'_>,
) -> Orientation {
    let ned_from_ecef = horizon.ned_from_ecef();
    let baseline = ned_from_ecef * baselines.vector_m(0);
    let direction = baseline.direction();
    // ∂u = (I − u uᵀ) ∂b / ‖b‖
    let unit = direction.xyz();
    let across = (Matrix3::identity() - unit * unit.transpose()) / baseline.norm();
    let covariance_m2 = ned_from_ecef.turn_covariance(&baselines.block_m2(0));
    let line = MeasuredLine {
        axis: Vector::new(1.0, 0.0, 0.0),
        direction,
        covariance_rad2: across * covariance_m2 * across,
    };
    let vertical = known.memory.at(known.time, &line.axis);
    let attitude = AttitudeEstimate::of_line(&line, &vertical, &Matrix3::zeros());
    Orientation { attitude: Ok(attitude), geometry: None, misfit: None }
}

/// Antennas on one line: its direction, and the turn about it as far as the vertical is known.
fn line(
    baselines: &Baselines,
    horizon: &Horizon,
    array: &AntennaArray,
    known: &KnownBody<'_>,
) -> Orientation {
    let vectors = vectors(baselines);
    let covariance_m2 = with_survey(baselines, known.array_sd_m);
    let Ok(solved) = joint::solve_direction(array, &vectors, &covariance_m2) else {
        return Orientation { attitude: Err(Reason::Geometry), geometry: None, misfit: None };
    };
    let ned_from_ecef = horizon.ned_from_ecef();
    let line = MeasuredLine {
        axis: solved.axis,
        direction: ned_from_ecef * solved.direction,
        covariance_rad2: ned_from_ecef.turn_covariance(&solved.covariance_rad2),
    };
    let vertical = known.memory.at(known.time, &line.axis);
    let ned_from_body = line.ned_from_body(&vertical);
    let ecef_from_body = ned_from_body.map(|rotation| ned_from_ecef.inverse() * rotation);
    let installation = ecef_from_body.and_then(|rotation| {
        let body: Vec<_> = array.baselines_m().map(|b| b.xyz()).collect();
        let line = solved.axis.xyz();
        let (matrix, sd_m) = (rotation.matrix(), known.array_sd_m);
        survey_turn_rad2(&body, &matrix, &covariance_m2, Some(&line), sd_m)
    });
    // The length of a single baseline was judged with its integers.
    let is_single = vectors.len() == 1;
    let fit = Fit { sum: solved.chi_squared, degrees_of_freedom: solved.degrees_of_freedom };
    let geometry = (!is_single).then_some(fit);
    let attitude = if solved.cost_gap.is_some_and(|gap| gap < TWO_MINIMA_CHI2 / 2.0) {
        Err(Reason::TwoMinima)
    } else {
        let installation = installation.unwrap_or_default();
        Ok(AttitudeEstimate::of_line(&line, &vertical, &installation))
    };
    let misfit = ecef_from_body.map(|rotation| {
        in_body_axes(baselines, array, rotation, &solved.residuals_m, known.array_sd_m)
    });
    Orientation { attitude, geometry, misfit }
}

/// All three angles: Wahba start, Newton with the full covariance of the baselines.
fn full(
    baselines: &Baselines,
    horizon: &Horizon,
    array: &AntennaArray,
    array_sd_m: f64,
) -> Orientation {
    let covariance_m2 = with_survey(baselines, array_sd_m);
    let gap = TWO_MINIMA_CHI2 / 2.0;
    let Ok(solved) = joint::solve(array, &vectors(baselines), &covariance_m2, gap) else {
        return Orientation { attitude: Err(Reason::Geometry), geometry: None, misfit: None };
    };
    let ecef_from_body = solved.outside_from_body;
    let attitude = if solved.uniqueness.is_ambiguous(gap) {
        Err(Reason::TwoMinima)
    } else {
        let body: Vec<_> = array.baselines_m().map(|b| b.xyz()).collect();
        let matrix = ecef_from_body.matrix();
        let survey = survey_turn_rad2(&body, &matrix, &covariance_m2, None, array_sd_m);
        let ned_from_body = horizon.ned_from_ecef() * ecef_from_body;
        Ok(AttitudeEstimate::full(ned_from_body, &solved.covariance_body_rad2)
            .with_installation(&survey.unwrap_or_default()))
    };
    let misfit = in_body_axes(baselines, array, ecef_from_body, &solved.residuals_m, array_sd_m);
    let fit = Fit { sum: solved.chi_squared, degrees_of_freedom: solved.degrees_of_freedom };
    Orientation { attitude, geometry: Some(fit), misfit: Some(misfit) }
}

/// The baselines one by one.
fn vectors(baselines: &Baselines) -> Vec<Vector<Ecef>> {
    (0..baselines.rovers.len()).map(|block| baselines.vector_m(block)).collect()
}

/// How far measured baselines may be from the array as it was surveyed, m²: both are uncertain.
fn with_survey(baselines: &Baselines, array_sd_m: f64) -> DMatrix<f64> {
    &baselines.covariance_m2 + survey_covariance(baselines.rovers.len(), array_sd_m)
}

/// What the baselines leave against the array, and their covariance, in body axes.
fn in_body_axes(
    baselines: &Baselines,
    array: &AntennaArray,
    ecef_from_body: Rotation<Ecef, Body>,
    residuals_m: &[Vector<Ecef>],
    array_sd_m: f64,
) -> Misfit {
    let body_from_ecef = ecef_from_body.inverse();
    let turned = residuals_m.iter().map(|residual| body_from_ecef * *residual);
    let mut turn = DMatrix::zeros(baselines.vectors_m.len(), baselines.vectors_m.len());
    for block in 0..baselines.rovers.len() {
        turn.fixed_view_mut::<3, 3>(3 * block, 3 * block).copy_from(&body_from_ecef.matrix());
    }
    Misfit {
        antennas: [baselines.reference].iter().chain(&baselines.rovers).copied().collect(),
        known_m: array.baselines_m().map(|b| b.xyz()).collect(),
        residual_m: DVector::from_iterator(
            baselines.vectors_m.len(),
            turned.flat_map(|residual| <[f64; 3]>::from(residual.xyz())),
        ),
        covariance_m2: &turn * &baselines.covariance_m2 * turn.transpose(),
        array_sd_m,
    }
}
