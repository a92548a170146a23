//! Do the measured points keep the known distances? Which antenna is off?
//!
//! The weighted squares of a fit of `n` points, `χ²` of `3n − 6` degrees of freedom (`3n − 5` for a
//! line), contain nothing but what the known distances say. Where they are too large every antenna
//! is left out in turn; one is blamed only if the others then agree and no other one explains as
//! much. With three antennas the distances show that something is wrong, never which one it is; a
//! displacement across the plane of three antennas, or of two in a flat array of four, changes the
//! distances least and is found last.

use nalgebra::{Matrix3, Vector3};

use super::geometry::median;
use super::survey::independent;
use crate::attitude::coordinates::{CoordinateNormal, MeasuredPoint};
use crate::attitude::{AttitudeError, LineDirection, Minimum};
use crate::chi_square::chi_square_tail;

/// Share of good epochs that are called inconsistent.
const FALSE_ALARMS: f64 = 1e-4;
/// How much worse in χ² the next explanation must be.
const SEPARATION: f64 = 15.0;
/// Half of χ² that another attitude must cost more.
const MIN_GAP: f64 = 8.0;
/// Antennas whose turn about their longest extent is less certain than this, rad, are taken to be on a
/// line: at `σ/h = 1/2` the two ways to lie, `2h` apart, differ by `½ (2h/σ)² = 8` in half of χ²,
/// [`MIN_GAP`].
const LINE_TURN_RAD: f64 = 0.5;
/// Extents of more than this share of the longest are no line, however uncertain the points are: the
/// longest one is none to go by.
const LINE_RATIO: f64 = 1.0 / 6.0;
/// Degrees of freedom that the stated or assumed variances count for beside what the lengths show: they
/// are right to a factor of `1 ± √(2/4)`, about one and a half in the standard deviations.
const PRIOR_DEGREES: f64 = 4.0;

/// The body laid onto the measured points.
#[derive(Debug, Clone, PartialEq)]
pub struct ArrayFit {
    /// What the points determine.
    pub kind: FitKind,
    /// Index of the point that was left out.
    pub excluded: Option<usize>,
    /// Weighted squares of the residuals.
    pub chi_squared: f64,
    /// What they would be on average.
    pub degrees_of_freedom: usize,
    /// Root mean square of the residual components, m.
    pub residual_rms_m: f64,
}

/// What the points determine.
#[derive(Debug, Clone, PartialEq)]
pub enum FitKind {
    /// The attitude.
    Body {
        /// The attitude.
        minimum: Minimum,
        /// What gives the position.
        normal: Box<CoordinateNormal>,
    },
    /// The direction of the line on which the antennas are.
    Line {
        /// The line in body axes, a unit vector.
        axis: Vector3<f64>,
        /// The line in the outside frame.
        direction: LineDirection,
    },
}

/// Why there is no fit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NoFit {
    /// Fewer than two antennas.
    TooFew,
    /// The points break the known distances, and no single one is to blame.
    Inconsistent,
    /// Two attitudes fit.
    TwoMinima,
    /// Numbers without a fit.
    BadInput,
}

/// The fit of all points, or of all but the one that breaks the known distances.
///
/// # Errors
///
/// [`NoFit`].
pub fn consistent_fit(points: &[MeasuredPoint]) -> Result<ArrayFit, NoFit> {
    let all = fit(points)?;
    if all.is_consistent() {
        return Ok(all);
    }
    if points.len() < 4 {
        return Err(NoFit::Inconsistent);
    }
    let mut best: Option<ArrayFit> = None;
    let mut next = f64::INFINITY;
    let mut rest = Vec::with_capacity(points.len() - 1);
    for excluded in 0..points.len() {
        rest.clear();
        rest.extend(points.iter().enumerate().filter(|(i, _)| *i != excluded).map(|(_, p)| *p));
        let Ok(candidate) = fit(&rest) else { continue };
        let lowest = best.as_ref().map_or(f64::INFINITY, |best| best.chi_squared);
        if candidate.chi_squared < lowest {
            next = lowest;
            best = Some(ArrayFit { excluded: Some(excluded), ..candidate });
        } else {
            next = next.min(candidate.chi_squared);
        }
    }
    best.filter(|best| best.is_consistent() && next - best.chi_squared > SEPARATION)
        .ok_or(NoFit::Inconsistent)
}

/// The factor by which the stated variances must be multiplied so that half of the epochs have more
/// than the median of χ², as far as the epochs can tell; `None` without redundant epochs.
///
/// `f = (ν₀ + ν f_median) / (ν₀ + ν)`, `ν` the degrees of freedom of independent epochs.
#[must_use]
pub fn variance_factor(epochs: impl Iterator<Item = Vec<MeasuredPoint>>) -> Option<f64> {
    let (ratios, degrees): (Vec<f64>, Vec<f64>) = epochs
        .filter_map(|points| {
            let fit = fit(&points).ok()?;
            let ratio = fit.chi_squared / chi_squared_median(fit.degrees_of_freedom);
            Some((ratio, fit.degrees_of_freedom as f64))
        })
        .unzip();
    if ratios.is_empty() {
        return None;
    }
    let count = ratios.len() as f64;
    let degrees = degrees.iter().sum::<f64>() * independent(&ratios) / count;
    Some((PRIOR_DEGREES + degrees * median(ratios)) / (PRIOR_DEGREES + degrees))
}

/// The fit of all points, consistent or not.
///
/// # Errors
///
/// [`NoFit`], but never [`NoFit::Inconsistent`].
pub fn fit(points: &[MeasuredPoint]) -> Result<ArrayFit, NoFit> {
    if points.len() < 2 {
        return Err(NoFit::TooFew);
    }
    match long_axis(points) {
        Some((axis, turn_sd_rad)) if turn_sd_rad > LINE_TURN_RAD => fit_line(points, &axis),
        Some((axis, _)) => fit_body(points).or_else(|no_fit| match no_fit {
            NoFit::TwoMinima => fit_line(points, &axis),
            _ => Err(no_fit),
        }),
        None => fit_body(points),
    }
}

fn fit_body(points: &[MeasuredPoint]) -> Result<ArrayFit, NoFit> {
    let normal = CoordinateNormal::new(points).map_err(no_fit)?;
    let global = normal.problem.global_minimum(MIN_GAP).map_err(no_fit)?;
    if global.uniqueness.is_ambiguous(MIN_GAP) {
        return Err(NoFit::TwoMinima);
    }
    let rotation = global.minimum.rotation;
    let origin = normal.origin_m(&rotation);
    let kind = FitKind::Body { minimum: global.minimum, normal: Box::new(normal) };
    Ok(ArrayFit::new(kind, points, 6, |p| origin + rotation * p))
}

/// Antennas on one line: positions along it are all that counts. How far they are off it, to an
/// unknown side, is as if they were measured worse.
fn fit_line(points: &[MeasuredPoint], axis: &Vector3<f64>) -> Result<ArrayFit, NoFit> {
    let centre = centre_m(points);
    let on_line = |point: &MeasuredPoint| {
        let offset = point.body_m - centre;
        let body_m = axis * axis.dot(&offset);
        let off_m2 = (offset - body_m).norm_squared();
        // Information is diagonal in local level axes.
        let worse = |information: f64| information / (1.0 + information * off_m2);
        MeasuredPoint { body_m, information: point.information.map(worse), ..*point }
    };
    let on_line: Vec<MeasuredPoint> = points.iter().map(on_line).collect();
    let normal = CoordinateNormal::new(&on_line).map_err(no_fit)?;
    let direction = normal.problem.direction(axis).map_err(no_fit)?;
    if direction.cost_gap.is_some_and(|gap| gap < MIN_GAP) {
        return Err(NoFit::TwoMinima);
    }
    // Only Q e = u matters to points on the line.
    let origin = normal.origin_m(&(direction.unit * axis.transpose()));
    let kind = FitKind::Line { axis: *axis, direction };
    Ok(ArrayFit::new(kind, &on_line, 5, |body| origin + direction.unit * axis.dot(body)))
}

fn no_fit(error: AttitudeError) -> NoFit {
    match error {
        AttitudeError::TooFewVectors { .. } => NoFit::TooFew,
        _ => NoFit::BadInput,
    }
}

/// The longest extent of a long and thin array, pointing away from its first antenna, and the standard
/// deviation of a turn about it as the noise of the points lets it be; `None` for other arrays.
fn long_axis(points: &[MeasuredPoint]) -> Option<(Vector3<f64>, f64)> {
    let centre = centre_m(points);
    let offsets = points.iter().map(|point| point.body_m - centre);
    let spread: Matrix3<f64> = offsets.map(|offset| offset * offset.transpose()).sum();
    let eigen = spread.symmetric_eigen();
    let longest = eigen.eigenvalues.imax();
    let axis: Vector3<f64> = eigen.eigenvectors.column(longest).into();
    let others = (0..3).filter(|k| *k != longest).map(|k| eigen.eigenvalues[k]);
    // Exact lines leave rounding errors.
    let (along_m2, across_m2) = (eigen.eigenvalues[longest], others.fold(0.0, f64::max));
    let least = points.iter().map(|p| p.information.diagonal().min()).fold(f64::INFINITY, f64::min);
    let turn_sd_rad = (across_m2 * least).sqrt().recip();
    let is_backward = axis.dot(&(points[0].body_m - centre)) > 0.0;
    (across_m2 < LINE_RATIO.powi(2) * along_m2)
        .then_some((if is_backward { -axis } else { axis }, turn_sd_rad))
}

fn centre_m(points: &[MeasuredPoint]) -> Vector3<f64> {
    points.iter().map(|point| point.body_m).sum::<Vector3<f64>>() / points.len() as f64
}

impl ArrayFit {
    fn new(
        kind: FitKind,
        points: &[MeasuredPoint],
        unknowns: usize,
        predicted: impl Fn(&Vector3<f64>) -> Vector3<f64>,
    ) -> Self {
        let (mut chi_squared, mut squares) = (0.0, 0.0);
        for point in points {
            let residual = point.measured_m - predicted(&point.body_m);
            chi_squared += residual.dot(&(point.information * residual));
            squares += residual.norm_squared();
        }
        let count = 3 * points.len();
        Self {
            kind,
            excluded: None,
            chi_squared,
            degrees_of_freedom: count - unknowns,
            residual_rms_m: (squares / count as f64).sqrt(),
        }
    }

    /// The fit whose covariance holds for errors of some degrees too.
    #[must_use]
    pub fn with_unbiased_information(mut self) -> Self {
        if let FitKind::Body { minimum, normal } = &mut self.kind {
            minimum.information = normal.problem.unbiased_information(minimum);
        }
        self
    }

    /// Whether χ² is below what chance exceeds once in ten thousand epochs.
    #[must_use]
    pub fn is_consistent(&self) -> bool {
        chi_square_tail(self.chi_squared, self.degrees_of_freedom) >= FALSE_ALARMS
    }

    /// The rotation, where the points determine one.
    #[must_use]
    pub fn rotation(&self) -> Option<Matrix3<f64>> {
        match &self.kind {
            FitKind::Body { minimum, .. } => Some(minimum.rotation),
            FitKind::Line { .. } => None,
        }
    }
}

/// Median of χ² by Wilson and Hilferty (1931), `k (1 − 2/(9k))³`: within 4 % for one degree of
/// freedom, 1 % from three on.
fn chi_squared_median(degrees_of_freedom: usize) -> f64 {
    let k = degrees_of_freedom as f64;
    k * (1.0 - 2.0 / (9.0 * k)).powi(3)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::attitude::weighted::exponential;

    fn square(count: usize, displaced: usize, by: Vector3<f64>) -> Vec<MeasuredPoint> {
        let corners = [[0.0, 0.0], [0.8, 0.0], [0.0, 0.8], [0.8, 0.8]];
        let rotation = exponential(&Vector3::new(0.1, -0.2, 2.0));
        let point = |(index, [x, y]): (usize, [f64; 2])| {
            let body_m = Vector3::new(x, y, 0.0);
            let shift = if index == displaced { by } else { Vector3::zeros() };
            let information = Matrix3::from_diagonal(&Vector3::new(1e4, 1e4, 2.5e3));
            MeasuredPoint { body_m, measured_m: rotation * (body_m + shift), information }
        };
        corners.into_iter().take(count).enumerate().map(point).collect()
    }

    /// Abramowitz and Stegun, table 26.8.
    #[test]
    fn medians() {
        for (k, expected, share) in [(1, 0.4549, 0.04), (3, 2.366, 0.01), (6, 5.348, 0.01)] {
            let found = chi_squared_median(k);
            assert!((found / expected - 1.0).abs() < share, "{k}: {found}");
        }
    }

    /// Noise of a centimetre, `off` across a line of three metres.
    fn nearly_a_line(off_m: f64) -> Vec<MeasuredPoint> {
        let rotation = exponential(&Vector3::new(0.05, -0.02, 2.0));
        let point = |[x, y]: [f64; 2]| {
            let body_m = Vector3::new(x, y, 0.0);
            let measured_m = rotation * body_m;
            MeasuredPoint { body_m, measured_m, information: Matrix3::identity() / (0.01 * 0.01) }
        };
        [[0.0, 0.0], [1.5, 0.0], [-1.5, off_m]].map(point).into()
    }

    /// What noise hides is a line; what it does not hide gives the turn about it, well or badly.
    #[test]
    fn antennas_nearly_on_a_line_keep_its_direction() {
        for off_m in [0.0, 0.005, 0.01, 0.02, 0.03] {
            let fit = consistent_fit(&nearly_a_line(off_m)).unwrap();
            let FitKind::Line { axis, direction } = fit.kind else { panic!("{off_m}") };
            assert!(axis.x.abs() > 0.99 && direction.max_sd_rad() < 0.01, "{axis} {direction:?}");
            let expected = exponential(&Vector3::new(0.05, -0.02, 2.0)) * axis;
            assert!((direction.unit - expected).norm() < 0.5 * off_m / 1.5 + 1e-9);
        }
        assert!(consistent_fit(&nearly_a_line(0.06)).is_ok());
        for off_m in [0.2, 1.0] {
            let fit = consistent_fit(&nearly_a_line(off_m)).unwrap();
            assert!(fit.rotation().is_some(), "{off_m}");
        }
    }

    /// One epoch says little of the scale, a thousand say all.
    #[test]
    fn few_epochs_change_the_standard_deviations_little() {
        let factor = |epochs: usize, by_m: f64| {
            let epoch = |k: usize| {
                square(2, 1, Vector3::new(by_m * (1.0 - 2.0 * (k % 2) as f64), 0.0, 0.0))
            };
            variance_factor((0..epochs).map(epoch)).unwrap()
        };
        assert!((0.79..0.81).contains(&factor(1, 1e-5)), "{}", factor(1, 1e-5));
        assert!(factor(1, 1.0) > 100.0);
        assert!(variance_factor(std::iter::empty()).is_none());
    }

    #[test]
    fn one_of_four_is_found() {
        for displaced in 0..4 {
            let points = square(4, displaced, Vector3::new(0.3, 0.1, 0.0));
            let fit = consistent_fit(&points).unwrap();
            assert_eq!(fit.excluded, Some(displaced));
            assert!(fit.chi_squared < 1e-9);
        }
        let good = consistent_fit(&square(4, 4, Vector3::zeros())).unwrap();
        assert_eq!((good.excluded, good.degrees_of_freedom), (None, 6));
    }

    /// Across the plane of a square a quarter of a metre changes the distances by less than the
    /// noise, and every corner explains it equally: refused, nobody blamed. Half a metre shows in the
    /// distances too.
    #[test]
    fn across_a_flat_array_nobody_is_blamed_until_the_distances_tell() {
        let by = |down_m| square(4, 2, Vector3::new(0.0, 0.0, down_m));
        assert_eq!(consistent_fit(&by(0.25)), Err(NoFit::Inconsistent));
        assert_eq!(consistent_fit(&by(0.5)).map(|fit| fit.excluded), Ok(Some(2)));
    }

    #[test]
    fn three_and_two_antennas_are_refused_or_pass() {
        let along = Vector3::new(0.3, 0.0, 0.0);
        assert_eq!(consistent_fit(&square(3, 1, along)), Err(NoFit::Inconsistent));
        assert_eq!(consistent_fit(&square(2, 1, along)), Err(NoFit::Inconsistent));
        assert_eq!(consistent_fit(&square(1, 1, along)), Err(NoFit::TooFew));
        // Across the plane of three antennas nothing shows: the body seems to tilt.
        let across = consistent_fit(&square(3, 1, Vector3::new(0.0, 0.0, 0.05))).unwrap();
        assert!(across.is_consistent());
        let line = consistent_fit(&square(2, 4, along)).unwrap();
        assert!(matches!(line.kind, FitKind::Line { .. }) && line.degrees_of_freedom == 1);
    }
}
