//! Where an array is weak, and what one more or one moved antenna would bring.

use kurs::array::AntennaArray;
use kurs::engine::Settings;
use kurs::frames::{Attitude, Body, Vector};
use kurs::prediction::{Sight, attitude_accuracy};
use nalgebra::{Matrix3, Vector3};

/// An antenna is moved this far along each axis.
pub(super) const MOVE_M: f64 = 0.25;
/// An extra antenna stands this far outside the array.
pub(super) const MARGIN_M: f64 = 0.5;

/// The weak axis and the best changes found.
#[derive(Debug)]
pub(super) struct Improvement {
    /// Body axis about which the attitude is least accurate, unit vector.
    pub(super) weakest_axis: Vector3<f64>,
    /// RMS about it.
    pub(super) weakest_sd_rad: f64,
    /// RMS of the whole rotation vector.
    pub(super) total_rad: f64,
    /// Antenna, its new position, and the total then.
    pub(super) moved: Option<(usize, Vector3<f64>, f64)>,
    /// Position of one more antenna, and the total then.
    pub(super) added: Option<(Vector3<f64>, f64)>,
}

/// The weak axis over these epochs, the best move by [`MOVE_M`] and the best additional antenna on
/// a corner or face of the box around the array; `None` if no epoch has an accuracy.
pub(super) fn best(
    settings: &Settings,
    attitude: &Attitude,
    epochs: &[&[Sight]],
) -> Option<Improvement> {
    let array = settings.array.as_ref()?;
    let covariance = mean_covariance(settings, attitude, epochs)?;
    let eigen = covariance.symmetric_eigen();
    let weakest = eigen.eigenvalues.imax();
    let total = |positions: Vec<Vector<Body>>| {
        let array = Some(AntennaArray::new(positions).ok()?);
        let settings = Settings { array, ..settings.clone() };
        Some(mean_covariance(&settings, attitude, epochs)?.trace().sqrt())
    };
    let moves = (0..array.len()).flat_map(|antenna| {
        directions().filter(|step| step.abs().sum() == 1.0).map(move |step| (antenna, step))
    });
    let moved = moves.filter_map(|(antenna, step)| {
        let mut positions = array.positions_m().to_vec();
        positions[antenna] += Vector::from_xyz(step * MOVE_M);
        let place = positions[antenna].xyz();
        Some((antenna, place, total(positions)?))
    });
    let added = directions().filter_map(|side| {
        let place = outside(array, &side);
        let positions = [array.positions_m(), &[Vector::from_xyz(place)]].concat();
        Some((place, total(positions)?))
    });
    Some(Improvement {
        weakest_axis: eigen.eigenvectors.column(weakest).into_owned(),
        weakest_sd_rad: eigen.eigenvalues[weakest].sqrt(),
        total_rad: covariance.trace().sqrt(),
        moved: moved.min_by(|a, b| a.2.total_cmp(&b.2)),
        added: added.min_by(|a, b| a.1.total_cmp(&b.1)),
    })
}

/// The 26 corners, edges and faces of a cube.
fn directions() -> impl Iterator<Item = Vector3<f64>> {
    let part = |k: i32| f64::from(k % 3 - 1);
    (0..27).map(move |k| Vector3::new(part(k), part(k / 3), part(k / 9))).filter(|d| d.norm() > 0.0)
}

/// The point on that side of the box around the array, widened by [`MARGIN_M`].
fn outside(array: &AntennaArray, side: &Vector3<f64>) -> Vector3<f64> {
    let positions = || array.positions_m().iter().map(Vector::xyz);
    let low = positions().reduce(|a, b| a.inf(&b)).unwrap_or_default();
    let high = positions().reduce(|a, b| a.sup(&b)).unwrap_or_default();
    let half = (high - low) * 0.5 + Vector3::repeat(MARGIN_M);
    (low + high) * 0.5 + side.component_mul(&half)
}

/// Mean covariance of the rotation vector in body axes, rad².
fn mean_covariance(
    settings: &Settings,
    attitude: &Attitude,
    epochs: &[&[Sight]],
) -> Option<Matrix3<f64>> {
    let covariances: Vec<Matrix3<f64>> = epochs
        .iter()
        .filter_map(|sights| attitude_accuracy(settings, attitude, sights))
        .map(|accuracy| accuracy.covariance_rad2)
        .collect();
    let count = covariances.len();
    (count > 0).then(|| covariances.into_iter().sum::<Matrix3<f64>>() / count as f64)
}
