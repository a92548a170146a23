//! Where the antennas are on the body, from the coordinates alone.
//!
//! Distances first: the mean squared distance of two antennas, less its share of noise, survives
//! outliers by a trimmed mean. From the squared distances the shape follows by classical scaling
//! (Torgerson 1952), and is refined by laying it onto every epoch and averaging. Axes: the first
//! antenna is the origin, x goes through the second, the third is in the x–y plane, and z points
//! down on the average. Distances do not tell a shape from its mirror image: the data do, unless the
//! antennas are in a plane.
//!
//! To first order the averaged shape in these axes is the mean of the coordinates that every epoch
//! alone has in them. Their scatter tells how well each coordinate is known; residuals of the shape on
//! an epoch do not, because the turn that lays it on takes up a part of the noise.

use nalgebra::{DMatrix, Vector3};

use super::{AntennaFix, PositionEpoch};
use crate::attitude::coordinates;
use crate::attitude::triad::triad;
use crate::frames::{Body, Geodetic, Vector};

/// Epochs that are used, spread evenly.
const MAX_EPOCHS: usize = 5000;
/// Epochs that two antennas must share.
const MIN_EPOCHS: usize = 10;
/// Distances further from the median than this many deviations are outliers.
const TRIM: f64 = 4.0;
/// Normal standard deviation over median absolute deviation.
const DEVIATION_OF_MEDIAN: f64 = 1.4826;
/// Epochs on which the shape lies worse than the median by more than this factor are outliers.
const OUTLIER: f64 = 3.0;
/// Rounds of laying on and averaging.
const ROUNDS: usize = 20;
/// An antenna nearer to the line of the first two than this share of its distance does not tell the
/// plane, if another one is farther from it.
const FLAT_RATIO: f64 = 0.05;
/// Rounding errors of scaled coordinates, a root of those of squared distances, are below this share.
const ROUNDING: f64 = 1e-6;
/// Antennas are on one line where their squared extent across it scatters from epoch to epoch by more
/// than this share of its median. Noise alone scatters by 1.03 in two directions and by 0.83 in
/// three, an extent of `h` deviations of one epoch by `2/h`: less than three of them are not told from
/// noise, which would bend the line by as much as itself.
const LINE_SCATTER: f64 = 2.0 / 3.0;

/// Antenna positions found from the data.
#[derive(Debug, Clone, PartialEq)]
pub struct EstimatedGeometry {
    /// Positions in body axes, m.
    pub positions_m: Vec<Vector<Body>>,
    /// Coordinates of each antenna as every epoch alone has them, m, in the order of time. Those that
    /// the axes define are exactly zero. Of antennas on one line, y and z are equal shares of the
    /// distance from it.
    pub coordinates_m: Vec<Vec<Vector3<f64>>>,
    /// Epochs used.
    pub epochs: usize,
}

/// The data do not determine the array.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum GeometryError {
    /// Two antennas are hardly ever there together.
    #[error("antennas {first} and {second} share {epochs} epochs, {MIN_EPOCHS} are needed")]
    TooFewEpochs {
        /// Index of the first antenna.
        first: usize,
        /// Index of the second antenna.
        second: usize,
        /// Epochs that both have.
        epochs: usize,
    },
}

impl GeometryError {
    /// The message with the names of the antennas.
    #[must_use]
    pub fn named(&self, names: &[String]) -> String {
        let Self::TooFewEpochs { first, second, epochs } = self;
        let (first, second) = (&names[*first], &names[*second]);
        format!("antennas {first} and {second} share {epochs} epochs, {MIN_EPOCHS} are needed")
    }
}

/// One epoch in local level axes at its first antenna.
type LocalPoints = Vec<Option<Vector3<f64>>>;

/// Positions of `antennas` antennas in body axes.
///
/// # Errors
///
/// [`GeometryError::TooFewEpochs`].
pub fn estimate(
    epochs: &[PositionEpoch],
    antennas: usize,
) -> Result<EstimatedGeometry, GeometryError> {
    let step = epochs.len().div_ceil(MAX_EPOCHS).max(1);
    let sample: Vec<&PositionEpoch> = epochs.iter().step_by(step).collect();
    let squared_m2 = squared_distances(&sample, antennas)?;
    let local: Vec<LocalPoints> = sample.iter().map(|epoch| local_points(epoch)).collect();
    let scaled = without_bend(classical_scaling(&squared_m2), &local);
    let mirrored: Vec<Vector3<f64>> = scaled.iter().map(|p| Vector3::new(p.x, p.y, -p.z)).collect();
    let shape = [scaled, mirrored]
        .map(|shape| refined(shape, &local))
        .into_iter()
        .min_by(|a, b| a.1.total_cmp(&b.1))
        .map_or_else(Vec::new, |(shape, _)| shape);
    let axes = Axes::of(&shape, &local);
    let positions_m = axes.coordinates(&shape.iter().copied().map(Some).collect::<Vec<_>>());
    let positions_m = positions_m.into_iter().map(Option::unwrap_or_default);
    Ok(EstimatedGeometry {
        coordinates_m: coordinates(&axes, &shape, &local),
        positions_m: positions_m.map(Vector::from_xyz).collect(),
        epochs: sample.len(),
    })
}

impl EstimatedGeometry {
    /// Root mean square of one epoch about the position of each antenna, for each axis, m.
    #[must_use]
    pub fn scatter_m(&self) -> Vec<[f64; 3]> {
        let scatter = |(position, epochs): (&Vector<Body>, &Vec<Vector3<f64>>)| {
            let off = epochs.iter().map(|epoch| epoch - position.xyz());
            let squares: Vector3<f64> = off.map(|off| off.component_mul(&off)).sum();
            (squares / epochs.len().max(1) as f64).map(f64::sqrt).into()
        };
        self.positions_m.iter().zip(&self.coordinates_m).map(scatter).collect()
    }
}

/// Mean squared distances without their noise, m².
fn squared_distances(
    epochs: &[&PositionEpoch],
    antennas: usize,
) -> Result<DMatrix<f64>, GeometryError> {
    let mut squared = DMatrix::zeros(antennas, antennas);
    for first in 0..antennas {
        for second in first + 1..antennas {
            let pairs = epochs.iter().filter_map(|epoch| {
                let pair: (AntennaFix, AntennaFix) =
                    (epoch.antennas[first]?, epoch.antennas[second]?);
                Some(pair)
            });
            let distances: Vec<f64> =
                pairs.map(|(a, b)| (a.position_m - b.position_m).norm()).collect();
            if distances.len() < MIN_EPOCHS {
                let epochs = distances.len();
                return Err(GeometryError::TooFewEpochs { first, second, epochs });
            }
            let value = squared_distance(&distances);
            squared[(first, second)] = value;
            squared[(second, first)] = value;
        }
    }
    Ok(squared)
}

/// Trimmed mean of the squares; noise of variance `s²` on every axis adds `3 s²`, of which the
/// scatter along the line shows `s²`.
fn squared_distance(distances: &[f64]) -> f64 {
    let centre = median(distances.to_vec());
    let deviation = scatter(distances);
    let kept: Vec<f64> = distances
        .iter()
        .copied()
        .filter(|d| (d - centre).abs() <= TRIM * deviation.max(1e-9 * centre))
        .collect();
    let mean = kept.iter().map(|d| d * d).sum::<f64>() / kept.len() as f64;
    (mean - 3.0 * deviation * deviation).max(0.25 * mean)
}

/// Standard deviation that outliers do not reach.
pub(super) fn scatter(values: &[f64]) -> f64 {
    let centre = median(values.to_vec());
    DEVIATION_OF_MEDIAN * median(values.iter().map(|value| (value - centre).abs()).collect())
}

pub(super) fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

/// Coordinates of which these are the squared distances: `−½ J D² J` has them as its factor.
fn classical_scaling(squared_m2: &DMatrix<f64>) -> Vec<Vector3<f64>> {
    let count = squared_m2.nrows();
    let centring =
        DMatrix::identity(count, count) - DMatrix::from_element(count, count, 1.0 / count as f64);
    let eigen = (&centring * squared_m2 * &centring * -0.5).symmetric_eigen();
    let mut order: Vec<usize> = (0..count).collect();
    order.sort_by(|i, j| eigen.eigenvalues[*j].total_cmp(&eigen.eigenvalues[*i]));
    (0..count)
        .map(|antenna| {
            Vector3::from_fn(|axis, _| {
                order.get(axis).map_or(0.0, |k| {
                    eigen.eigenvectors[(antenna, *k)] * eigen.eigenvalues[*k].max(0.0).sqrt()
                })
            })
        })
        .collect()
}

/// The shape, on a line if nothing but noise takes it off one.
///
/// The second of the scaled coordinates, `v`, has the sum zero: `‖Σ vₖ pₖ‖` of an epoch is its extent
/// in that direction, however the body stands.
fn without_bend(shape: Vec<Vector3<f64>>, local: &[LocalPoints]) -> Vec<Vector3<f64>> {
    let extent = |points: &LocalPoints| -> Option<f64> {
        let across = shape.iter().zip(points).map(|(place, point)| Some(place.y * (*point)?));
        Some(across.sum::<Option<Vector3<f64>>>()?.norm_squared())
    };
    let extents: Vec<f64> = local.iter().filter_map(extent).collect();
    if extents.is_empty() || scatter(&extents) <= LINE_SCATTER * median(extents) {
        return shape;
    }
    shape.into_iter().map(|place| Vector3::new(place.x, 0.0, 0.0)).collect()
}

/// The shape laid onto every epoch and averaged until it stands; the median of the residuals, m.
fn refined(mut shape: Vec<Vector3<f64>>, local: &[LocalPoints]) -> (Vec<Vector3<f64>>, f64) {
    let mut misfit = f64::INFINITY;
    for _ in 0..ROUNDS {
        let fits: Vec<_> = local.iter().map(|points| lay_on(&shape, points)).collect();
        let residuals: Vec<f64> = fits.iter().flatten().map(|fit| fit.residual_rms_m).collect();
        if residuals.is_empty() {
            return (shape, misfit);
        }
        misfit = median(residuals);
        let mut sums = vec![(Vector3::zeros(), 0.0); shape.len()];
        for (fit, points) in fits.iter().zip(local) {
            let Some(fit) = fit.filter(|fit| fit.residual_rms_m <= OUTLIER * misfit) else {
                continue;
            };
            for (sum, point) in sums.iter_mut().zip(points) {
                if let Some(point) = point {
                    sum.0 += fit.rotation.transpose() * (point - fit.origin_m);
                    sum.1 += 1.0;
                }
            }
        }
        for (position, (sum, count)) in shape.iter_mut().zip(sums) {
            if count > 0.0 {
                *position = sum / count;
            }
        }
    }
    (shape, misfit)
}

/// The shape laid onto the points of one epoch; `None` for fewer than three or a line.
fn lay_on(shape: &[Vector3<f64>], points: &LocalPoints) -> Option<coordinates::RigidFit> {
    let (body, measured): (Vec<_>, Vec<_>) =
        shape.iter().zip(points).filter_map(|(body, point)| point.map(|p| (*body, p))).unzip();
    if body.len() < 3 {
        return None;
    }
    coordinates::fit(&body, &measured, &vec![1.0; body.len()]).ok()
}

fn local_points(epoch: &PositionEpoch) -> LocalPoints {
    let first = epoch.antennas.iter().flatten().next();
    let Some(first) = first else { return vec![None; epoch.antennas.len()] };
    let ned_from_ecef = Geodetic::from_ecef(first.position_m).ned_from_ecef();
    let offset = |fix: &AntennaFix| (ned_from_ecef * (fix.position_m - first.position_m)).xyz();
    epoch.antennas.iter().map(|fix| fix.as_ref().map(offset)).collect()
}

/// The antennas that define the axes: x from the first through the second; with one off that line in
/// the x–y plane and z down on the average.
#[derive(Debug, Clone, Copy)]
struct Axes {
    /// The antenna in the x–y plane, and the direction of y to which it lies; `None` on a line.
    side: Option<(usize, f64)>,
}

impl Axes {
    fn of(shape: &[Vector3<f64>], local: &[LocalPoints]) -> Self {
        let x = (shape[1] - shape[0]).normalize();
        let from_line = |k: &usize| x.cross(&(shape[*k] - shape[0])).norm();
        let is_off = |k: &usize| from_line(k) > FLAT_RATIO * (shape[*k] - shape[0]).norm();
        let farthest = || (2..shape.len()).max_by(|a, b| from_line(a).total_cmp(&from_line(b)));
        let side = (2..shape.len()).find(is_off).or_else(farthest);
        let bends = |side: &usize| from_line(side) > ROUNDING * (shape[*side] - shape[0]).norm();
        let Some(side) = side.filter(bends) else { return Self { side: None } };
        let down_in_shape = x.cross(&(shape[side] - shape[0]));
        let fits = local.iter().filter_map(|points| lay_on(shape, points));
        let down: f64 = fits.map(|fit| (fit.rotation * down_in_shape).z).sum();
        Self { side: Some((side, if down >= 0.0 { 1.0 } else { -1.0 })) }
    }

    /// Coordinates in these axes; none where one of the antennas that define them is missing.
    fn coordinates(&self, points: &[Option<Vector3<f64>>]) -> Vec<Option<Vector3<f64>>> {
        let none = || vec![None; points.len()];
        let (Some(origin), Some(second)) = (points[0], points[1]) else { return none() };
        let Some(x) = (second - origin).try_normalize(0.0) else { return none() };
        let mut body: Vec<Option<Vector3<f64>>> = match self.side {
            None => {
                let on_line = |point: &Vector3<f64>| {
                    let across = x.cross(&(point - origin)).norm() / 2f64.sqrt();
                    Vector3::new(x.dot(&(point - origin)), across, across)
                };
                points.iter().map(|point| point.as_ref().map(on_line)).collect()
            }
            Some((side, y)) => {
                let Some(third) = points[side] else { return none() };
                let turn = triad([&x, &(third - origin)], [&Vector3::x(), &(y * Vector3::y())]);
                let Ok(turn) = turn else { return none() };
                points.iter().map(|point| point.map(|p| turn * (p - origin))).collect()
            }
        };
        // What the axes define is zero, not nearly.
        body[0] = Some(Vector3::zeros());
        body[1] = body[1].map(|p| Vector3::new(p.x, 0.0, 0.0));
        if let Some((side, _)) = self.side {
            body[side] = body[side].map(|p| Vector3::new(p.x, p.y, 0.0));
        }
        body
    }
}

/// Coordinates of every antenna in the epochs on which the shape lies as on most.
fn coordinates(
    axes: &Axes,
    shape: &[Vector3<f64>],
    local: &[LocalPoints],
) -> Vec<Vec<Vector3<f64>>> {
    let misfit_m = |points: &LocalPoints| match axes.side {
        Some(_) => Some(lay_on(shape, points)?.residual_rms_m),
        None => Some((axes.coordinates(points)[1]?.x - (shape[1] - shape[0]).norm()).abs()),
    };
    let outlier = if axes.side.is_some() { OUTLIER } else { TRIM * DEVIATION_OF_MEDIAN };
    let misfits_m: Vec<Option<f64>> = local.iter().map(misfit_m).collect();
    let known_m: Vec<f64> = misfits_m.iter().flatten().copied().collect();
    let limit_m = if known_m.is_empty() { 0.0 } else { outlier * median(known_m) };
    let mut coordinates = vec![Vec::new(); shape.len()];
    for (points, misfit_m) in local.iter().zip(misfits_m) {
        if misfit_m.is_some_and(|misfit_m| misfit_m <= limit_m) {
            for (all, own) in coordinates.iter_mut().zip(axes.coordinates(points)) {
                all.extend(own);
            }
        }
    }
    coordinates
}
