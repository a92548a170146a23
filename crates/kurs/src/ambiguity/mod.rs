//! Integer ambiguities: from real-valued estimates with a covariance to whole numbers, exactly.
//!
//! Numbers only: this module knows matrices, not satellites. Ambiguities are in cycles and their
//! covariance in cycles²; baselines are in metres, in any frame.
//!
//! 1. [`ldl`] factors the covariance, [`decorrelate`] makes the factor short to search,
//! 2. [`search`] finds the integer vectors nearest in the metric of the covariance,
//! 3. [`length_constrained`] does so when the length of the baseline is known, with the nearest
//!    point of a [`sphere`] inside, and [`array_constrained`] when the shape of a whole array is,
//!    with the nearest orthonormal [`frame`] inside,
//! 4. [`sphere_search`] finds the same over the directions of one baseline: the judge of the others,
//!    and a way without code observations,
//! 5. [`success_rate`] says beforehand how often the nearest vector is the right one; whether this one may be used is
//!    a matter of the engine.

use nalgebra::{DMatrix, DVector, DVectorView};

pub mod array_constrained;
mod best_first;
pub mod decorrelate;
mod exchange;
pub mod frame;
pub mod ldl;
pub mod length_constrained;
pub mod parts;
pub mod search;
pub mod sphere;
pub mod sphere_search;
pub mod success_rate;

#[cfg(test)]
mod joined_lists;
#[cfg(test)]
mod problems;

/// Float values and integers beyond this are not exact in double precision, 2⁵².
pub const MAX_CYCLES: f64 = 4_503_599_627_370_496.0;

/// Why no integers were found. A search that ends here has not guessed.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum AmbiguityError {
    /// There is nothing to fix.
    #[error("there are no ambiguities")]
    Empty,
    /// Two arguments do not belong together.
    #[error("{what} has dimension {found}, expected {expected}")]
    Dimension {
        /// The argument.
        what: &'static str,
        /// Its dimension.
        found: usize,
        /// The dimension that would fit.
        expected: usize,
    },
    /// A conditional variance is not above zero, or not finite.
    #[error(
        "the covariance is not positive definite: conditional variance {variance:e} of ambiguity {index}"
    )]
    NotPositiveDefinite {
        /// Index of the ambiguity at which it showed.
        index: usize,
        /// The conditional variance found there, cycles².
        variance: f64,
    },
    /// A number is not finite, or too large to be a whole number of cycles.
    #[error("{what} is out of range: {value:e}")]
    OutOfRange {
        /// The argument.
        what: &'static str,
        /// Its value.
        value: f64,
    },
    /// The best attitude for a candidate was not found.
    #[error("the attitude of a candidate did not converge")]
    NoAttitude,
    /// The search was stopped before it could prove its answer.
    #[error("no proof of the best integers within {nodes} nodes")]
    BudgetExceeded {
        /// Number of nodes visited.
        nodes: usize,
    },
}

impl AmbiguityError {
    /// Refuses an argument whose dimension does not fit.
    const fn expect_dimension(
        what: &'static str,
        found: usize,
        expected: usize,
    ) -> Result<(), Self> {
        if found == expected { Ok(()) } else { Err(Self::Dimension { what, found, expected }) }
    }
}

/// A float solution split into what is integer and what is real: ambiguities `â` and other
/// parameters `x̂` (baselines, m), with the joint covariance
///
/// ```text
/// ⎡ Q_a   Q_xaᵀ ⎤          x̌(z) = x̂ − Q_xa Q_a⁻¹ (â − z)
/// ⎣ Q_xa  Q_x   ⎦          Q_x|a = Q_x − Q_xa Q_a⁻¹ Q_xaᵀ
/// ```
///
/// Instead of `Q_x` the conditional covariance `Q_x|a` is asked for: phase alone gives it without
/// the loss of digits of the difference above.
#[derive(Debug, Clone, PartialEq)]
pub struct MixedFloat {
    /// `â`, `n`, cycles.
    pub ambiguities: DVector<f64>,
    /// `Q_a`, `n × n`, cycles².
    pub ambiguity_covariance: DMatrix<f64>,
    /// `x̂`, `p`, metres.
    pub reals_m: DVector<f64>,
    /// `Q_x`, `p × p`, metres².
    pub real_covariance_m2: DMatrix<f64>,
    /// `Q_xa`, `p × n`, metre cycles.
    pub cross_covariance: DMatrix<f64>,
    /// `Q_x|a`, `p × p`, metres²: covariance of the reals once the integers are known.
    pub conditional_covariance_m2: DMatrix<f64>,
}

impl MixedFloat {
    /// From the joint covariance, which says what `Q_x|a` is.
    ///
    /// # Errors
    ///
    /// [`AmbiguityError::Dimension`] and [`AmbiguityError::NotPositiveDefinite`].
    pub fn of_joint(
        ambiguities: DVector<f64>,
        ambiguity_covariance: DMatrix<f64>,
        reals_m: DVector<f64>,
        real_covariance_m2: DMatrix<f64>,
        cross_covariance: DMatrix<f64>,
    ) -> Result<Self, AmbiguityError> {
        let mut joint = Self {
            ambiguities,
            ambiguity_covariance,
            conditional_covariance_m2: real_covariance_m2.clone(),
            real_covariance_m2,
            cross_covariance,
            reals_m,
        };
        let n = joint.checked_dimension(joint.reals_m.len())?;
        let found = joint.ambiguity_covariance.nrows();
        if found != n || joint.ambiguity_covariance.ncols() != n {
            let what = "the covariance of the ambiguities";
            return Err(AmbiguityError::Dimension { what, found, expected: n });
        }
        let Some(factor) = joint.ambiguity_covariance.clone().cholesky() else {
            return Err(AmbiguityError::NotPositiveDefinite { index: 0, variance: f64::NAN });
        };
        // Q_x|a = Q_x − Q_xa Q_a⁻¹ Q_xaᵀ
        let gains = factor.solve(&joint.cross_covariance.transpose());
        joint.conditional_covariance_m2 -= &joint.cross_covariance * gains;
        Ok(joint)
    }

    /// Number of ambiguities `n`, after a check that all dimensions agree for `reals` values.
    fn checked_dimension(&self, reals: usize) -> Result<usize, AmbiguityError> {
        let n = self.ambiguities.len();
        let expect = AmbiguityError::expect_dimension;
        expect("the vector of reals", self.reals_m.len(), reals)?;
        expect("the cross covariance (rows)", self.cross_covariance.nrows(), reals)?;
        expect("the cross covariance (columns)", self.cross_covariance.ncols(), n)?;
        expect("the covariance of the reals (rows)", self.real_covariance_m2.nrows(), reals)?;
        expect("the covariance of the reals (columns)", self.real_covariance_m2.ncols(), reals)?;
        expect("the conditional covariance (rows)", self.conditional_covariance_m2.nrows(), reals)?;
        expect(
            "the conditional covariance (columns)",
            self.conditional_covariance_m2.ncols(),
            reals,
        )?;
        let all = self
            .reals_m
            .iter()
            .chain(&self.real_covariance_m2)
            .chain(&self.cross_covariance)
            .chain(&self.conditional_covariance_m2);
        for value in all {
            if !value.is_finite() {
                return Err(AmbiguityError::OutOfRange {
                    what: "a covariance or baseline",
                    value: *value,
                });
            }
        }
        Ok(n)
    }
}

/// `aᵀ b` of vectors of one length, in several sums at a time.
fn dot(a: &[f64], b: &[f64]) -> f64 {
    DVectorView::from_slice(a, a.len()).dot(&DVectorView::from_slice(b, b.len()))
}
