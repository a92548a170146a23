//! Dilution of precision: what the geometry alone does to the errors.

use nalgebra::Matrix3;

use super::measurement::Quantity;
use super::problem::Problem;
use crate::frames::{Ecef, Geodetic, Vector};

/// Metres of position error per metre of measurement error, equal and independent in all
/// measurements; an angle's metres are those that it subtends at the object.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Dilution {
    /// In all three directions together (PDOP).
    pub position: f64,
    /// In the horizontal plane of the object (HDOP).
    pub horizontal: f64,
    /// Along its vertical (VDOP).
    pub vertical: f64,
}

/// The dilution of precision at a position; `None` where the geometry does not determine it.
#[must_use]
pub fn dilution(problem: &Problem, position_m: Vector<Ecef>) -> Option<Dilution> {
    let mut information = Matrix3::zeros();
    for (index, measurement) in problem.measurements().iter().enumerate() {
        let sight = problem.stations()[measurement.station].sight(position_m).xyz();
        let metres_per_unit = match measurement.quantity {
            Quantity::Azimuth => sight.xy().norm(),
            Quantity::Elevation | Quantity::CosineNorth | Quantity::CosineEast => sight.norm(),
            Quantity::Range | Quantity::RangeDifference { .. } => 1.0,
        };
        let row = problem.row(index, position_m).1 * metres_per_unit;
        information += row * row.transpose();
    }
    let cofactor = information.cholesky()?.inverse();
    let ned_from_ecef = Geodetic::from_ecef(position_m).ned_from_ecef();
    let local = ned_from_ecef.turn_covariance(&cofactor);
    let horizontal_squared = local[(0, 0)] + local[(1, 1)];
    let dilution = Dilution {
        position: local.trace().sqrt(),
        horizontal: horizontal_squared.sqrt(),
        vertical: local[(2, 2)].sqrt(),
    };
    dilution.position.is_finite().then_some(dilution)
}
