//! What every row has to be, whatever came in.

use kurs::solution::{EpochSolution, Status};
use nalgebra::Matrix3;

/// Panics where a row says something that is no answer: a status without its reason, a number that is none, a
/// covariance that is not positive definite.
pub(crate) fn check(row: &EpochSolution) {
    let needs_none = matches!(row.status(), Status::Fixed | Status::NotCapable);
    assert_eq!(row.reason().is_none(), needs_none, "{row:?}");
    let is_covariance = |matrix: &Matrix3<f64>| {
        matrix.iter().all(|number| number.is_finite()) && matrix.cholesky().is_some()
    };
    if let Some(attitude) = row.attitude() {
        let angles = attitude.angles_rad();
        for (k, angle) in angles.iter().enumerate() {
            let Some(angle) = angle else { continue };
            let variance = attitude.covariance_rad2[(k, k)];
            assert!(angle.is_finite() && variance.is_finite() && variance > 0.0, "{attitude:?}");
        }
        let is_whole = angles.iter().all(Option::is_some);
        assert!(!is_whole || is_covariance(&attitude.covariance_rad2), "{attitude:?}");
    }
    for baseline in &row.baselines {
        assert!(baseline.baseline_m.xyz().iter().all(|metres| metres.is_finite()), "{baseline:?}");
        assert!(is_covariance(&baseline.covariance_m2), "{baseline:?}");
    }
    if let Some(position) = &row.position {
        assert!(position.position_m.xyz().iter().all(|metres| metres.is_finite()), "{position:?}");
        assert!(is_covariance(&position.covariance_m2), "{position:?}");
    }
}
