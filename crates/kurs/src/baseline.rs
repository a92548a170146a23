//! Baselines in local level axes, from the corrections of the float or fixed solution.

use nalgebra::{DMatrix, DVector, Matrix3};

use crate::frames::{Ecef, Vector, enu_from_ned};
use crate::sky::Horizon;
use crate::solution::{BaselineEstimate, Status};

/// Corrections and covariance of all baselines (3k, 3k × 3k, ECEF, m) with the vectors that they
/// correct.
#[derive(Debug, Clone, PartialEq)]
pub struct Baselines {
    /// Antenna that they start from.
    pub reference: usize,
    /// Antennas that they lead to.
    pub rovers: Vec<usize>,
    /// Baselines, ECEF, m (3k).
    pub vectors_m: DVector<f64>,
    /// Their covariance, m² (3k × 3k).
    pub covariance_m2: DMatrix<f64>,
}

impl Baselines {
    /// The baseline to the rover of this block.
    #[must_use]
    pub fn vector_m(&self, block: usize) -> Vector<Ecef> {
        Vector::from_xyz(self.vectors_m.fixed_rows::<3>(3 * block).into_owned())
    }

    /// Covariance of one baseline, ECEF, m².
    #[must_use]
    pub fn block_m2(&self, block: usize) -> Matrix3<f64> {
        self.covariance_m2.fixed_view::<3, 3>(3 * block, 3 * block).into_owned()
    }

    /// Length of one baseline and its standard deviation, m: `σ² = uᵀ Q u` along the baseline.
    #[must_use]
    pub fn length_m(&self, block: usize) -> (f64, f64) {
        let vector = self.vector_m(block);
        let along = vector.direction().xyz();
        (vector.norm(), (along.transpose() * self.block_m2(block) * along)[0].sqrt())
    }

    /// All of them in east, north, up at the horizon of the antenna where they start.
    #[must_use]
    pub fn local(&self, horizon: &Horizon, status: Status) -> Vec<BaselineEstimate> {
        let enu_from_ecef = enu_from_ned() * horizon.ned_from_ecef();
        let estimates = self.rovers.iter().enumerate().map(|(block, rover)| BaselineEstimate {
            base: self.reference,
            rover: *rover,
            status,
            baseline_m: enu_from_ecef * self.vector_m(block),
            covariance_m2: enu_from_ecef.turn_covariance(&self.block_m2(block)),
        });
        estimates.collect()
    }
}
