//! Where the antennas are on the body, from the coordinates alone.
//!
//! Distances first: the mean squared distance of two antennas, less its share of noise, survives
//! outliers by a trimmed mean. From the squared distances the shape follows by classical scaling
//! (Torgerson 1952), and is refined by laying it onto every epoch and averaging. Axes: the first
//! antenna is the origin, x goes through the second, the third is in the x–y plane, and z points
//! down on the average. Distances do not tell a shape from its mirror image: the data do, unless the
//! antennas are in a plane.

use nalgebra::{DMatrix, Matrix3, Vector3};

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
/// Rounds of laying on and averaging.
const ROUNDS: usize = 20;
/// An extent below this share of the largest is flat.
const FLAT_RATIO: f64 = 0.05;

/// Antenna positions found from the data.
#[derive(Debug, Clone, PartialEq)]
pub struct EstimatedGeometry {
    /// Positions in body axes, m.
    pub positions_m: Vec<Vector<Body>>,
    /// Root mean square, per axis, of each antenna's residuals about its position, m: the scatter of
    /// one epoch. The mean is better by the root of the epochs.
    pub spread_m: Vec<[f64; 3]>,
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
    let scaled = classical_scaling(&squared_m2);
    let mirrored: Vec<Vector3<f64>> = scaled.iter().map(|p| Vector3::new(p.x, p.y, -p.z)).collect();
    let shape = [scaled, mirrored]
        .map(|shape| refined(shape, &local))
        .into_iter()
        .min_by(|a, b| a.1.total_cmp(&b.1))
        .map_or_else(Vec::new, |(shape, _)| shape);
    let axes = body_axes(&shape, &local);
    let positions: Vec<Vector3<f64>> = shape.iter().map(|p| axes * (p - shape[0])).collect();
    let spread_m = spread(&positions, &local);
    Ok(EstimatedGeometry {
        positions_m: positions.into_iter().map(Vector::from_xyz).collect(),
        spread_m,
        epochs: sample.len(),
    })
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
    let deviations: Vec<f64> = distances.iter().map(|d| (d - centre).abs()).collect();
    let deviation = DEVIATION_OF_MEDIAN * median(deviations);
    let kept: Vec<f64> = distances
        .iter()
        .copied()
        .filter(|d| (d - centre).abs() <= TRIM * deviation.max(1e-9 * centre))
        .collect();
    let mean = kept.iter().map(|d| d * d).sum::<f64>() / kept.len() as f64;
    (mean - 3.0 * deviation * deviation).max(0.25 * mean)
}

fn median(mut values: Vec<f64>) -> f64 {
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
            let Some(fit) = fit.filter(|fit| fit.residual_rms_m <= 3.0 * misfit) else { continue };
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

/// Rotation from the axes of the shape to body axes: x through the second antenna, the first
/// antenna off that line in the x–y plane, z down on the average.
fn body_axes(shape: &[Vector3<f64>], local: &[LocalPoints]) -> Matrix3<f64> {
    let x = shape[1] - shape[0];
    let off_line = shape
        .iter()
        .map(|p| p - shape[0])
        .find(|offset| x.cross(offset).norm() > FLAT_RATIO * x.norm() * offset.norm().max(1e-3));
    let Some(side) = off_line else {
        // A line: any direction across it will do.
        let mut across = Vector3::zeros();
        across[x.iamin()] = 1.0;
        return triad([&x, &across], [&Vector3::x(), &Vector3::y()])
            .unwrap_or_else(|_| Matrix3::identity());
    };
    let body_from_shape = |y: Vector3<f64>| {
        triad([&x, &side], [&Vector3::x(), &y]).unwrap_or_else(|_| Matrix3::identity())
    };
    let right = body_from_shape(Vector3::y());
    let z_in_shape = right.transpose() * Vector3::z();
    let down: f64 = local
        .iter()
        .filter_map(|points| lay_on(shape, points))
        .map(|fit| (fit.rotation * z_in_shape).z)
        .sum();
    if down >= 0.0 { right } else { body_from_shape(-Vector3::y()) }
}

/// Root mean square residuals of each antenna in body axes.
fn spread(positions: &[Vector3<f64>], local: &[LocalPoints]) -> Vec<[f64; 3]> {
    let mut sums = vec![(Vector3::zeros(), 0.0); positions.len()];
    let fits: Vec<_> = local.iter().map(|points| lay_on(positions, points)).collect();
    let misfit = fits.iter().flatten().map(|fit| fit.residual_rms_m).collect::<Vec<_>>();
    let limit = if misfit.is_empty() { 0.0 } else { 3.0 * median(misfit) };
    for (fit, points) in fits.iter().zip(local) {
        let Some(fit) = fit.filter(|fit| fit.residual_rms_m <= limit) else { continue };
        for ((sum, position), point) in sums.iter_mut().zip(positions).zip(points) {
            if let Some(point) = point {
                let residual = fit.rotation.transpose() * (point - fit.origin_m) - position;
                sum.0 += residual.component_mul(&residual);
                sum.1 += 1.0;
            }
        }
    }
    sums.into_iter()
        .map(|(sum, count)| (sum / f64::max(count, 1.0)).map(f64::sqrt).into())
        .collect()
}
