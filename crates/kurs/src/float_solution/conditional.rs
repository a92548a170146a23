//! The baselines once the integers are known, and what they leave of code and phases:
//!
//! `x̌ = (N + Σ A_Φᵀ Q_Φ⁻¹ A_Φ)⁻¹ (b + Σ A_Φᵀ Q_Φ⁻¹ (y_Φ − Λ z))`,
//!
//! with the normal equations `N x̂ = b` of the code, or of the code and of what earlier epochs know.

use nalgebra::{DMatrix, DVector};

use super::{Fit, FloatSolution, well_conditioned_inverse};

/// Baselines with integer ambiguities put in.
#[derive(Debug, Clone, PartialEq)]
pub struct Conditional {
    /// Corrections to the approximate baselines, ECEF, m (3k).
    pub correction_m: DVector<f64>,
    /// Their covariance given the integers, m² (3k × 3k).
    pub covariance_m2: DMatrix<f64>,
    /// Weighted residuals of the phases.
    pub phase_fit: Fit,
    /// Root mean square of the double-difference phase residuals, m.
    pub residual_rms_m: f64,
}

/// Normal matrix of the baselines once the integers are known, `N + Σ A_Φᵀ Q_Φ⁻¹ A_Φ`.
#[derive(Debug, Clone)]
pub(super) struct ConditionalNormal {
    pub(super) matrix: DMatrix<f64>,
    /// Its inverse; `None` if it is singular.
    pub(super) covariance_m2: Option<DMatrix<f64>>,
}

impl ConditionalNormal {
    pub(super) fn new(matrix: DMatrix<f64>) -> Self {
        Self { covariance_m2: well_conditioned_inverse(&matrix), matrix }
    }
}

impl FloatSolution {
    /// Covariance of the baselines once the integers are known,
    /// `Q_x|a = (N + Σ A_Φᵀ Q_Φ⁻¹ A_Φ)⁻¹`, m²; `None` if that is singular.
    #[must_use]
    pub fn conditional_covariance_m2(&self) -> Option<&DMatrix<f64>> {
        self.conditional.covariance_m2.as_ref()
    }

    /// Baselines given integer ambiguities (n, cycles), code and phases together, and how the phases fit; `None` if
    /// they are not determined.
    #[must_use]
    pub fn conditional(&self, integers: &[f64]) -> Option<Conditional> {
        let mut whitened = self.whitened_ranges(integers.iter().copied());
        let correction_m = self.conditional_correction(integers.iter().copied(), &whitened)?;
        let mut phase_sum = 0.0;
        let mut residual_squares = 0.0;
        let mut first = 0;
        for phases in &self.phases {
            let count = phases.misclosure_m.len();
            // L⁻¹ (y_Φ − Λ z − A_Φ x̌)
            let mut residual = whitened.rows_mut(first, count);
            residual.gemv(-1.0, &phases.whitened_design, &correction_m, 1.0);
            phase_sum += residual.norm_squared();
            for i in 0..count {
                let along_m = phases.design.row(i).tr_dot(&correction_m);
                let range_m = phases.range_m(i, integers[first + i]);
                residual_squares += (range_m - along_m).powi(2);
            }
            first += count;
        }
        let (n, unknowns) = (integers.len(), correction_m.len());
        Some(Conditional {
            correction_m,
            covariance_m2: self.conditional.covariance_m2.clone()?,
            phase_fit: Fit { sum: phase_sum, degrees_of_freedom: n.saturating_sub(unknowns) },
            residual_rms_m: (residual_squares / n.max(1) as f64).sqrt(),
        })
    }

    /// By how much the weighted squares of the epoch's code grow with these integers.
    #[must_use]
    pub fn code_excess_of(&self, integers: impl Iterator<Item = f64> + Clone) -> Option<f64> {
        let whitened = self.whitened_ranges(integers.clone());
        Some(self.code_excess(&self.conditional_correction(integers, &whitened)?))
    }

    /// `(â − z)ᵀ Q_â⁻¹ (â − z)` of these integers `z`: the squares that they leave of the phases, and of the code
    /// beyond what code alone leaves. `None` where the solution is not of one epoch alone, and where the baselines are
    /// not determined.
    #[must_use]
    pub fn squared_distance(&self, integers: &[f64]) -> Option<f64> {
        let conditional = self.is_of_one_epoch().then(|| self.conditional(integers))??;
        Some(self.squares_left(&conditional))
    }

    /// `L⁻¹ (y_Φ − Λ z)`, with the factor `L` of each group's `Q_Φ`, in the order of the ambiguities.
    fn whitened_ranges(&self, mut integers: impl Iterator<Item = f64>) -> DVector<f64> {
        let mut whitened = DVector::zeros(self.ambiguities_cycles.len());
        let mut first = 0;
        for phases in &self.phases {
            let mut of_group = whitened.rows_mut(first, phases.misclosure_m.len());
            for (i, (range_m, z)) in of_group.iter_mut().zip(integers.by_ref()).enumerate() {
                *range_m = phases.range_m(i, z);
            }
            phases.factor.l_dirty().solve_lower_triangular_mut(&mut of_group);
            first += phases.misclosure_m.len();
        }
        whitened
    }

    /// `x̌ = (N + Σ A_Φᵀ Q_Φ⁻¹ A_Φ)⁻¹ (b + Σ A_Φᵀ Q_Φ⁻¹ (y_Φ − Λ z))`
    fn conditional_correction(
        &self,
        integers: impl Iterator<Item = f64>,
        whitened_ranges: &DVector<f64>,
    ) -> Option<DVector<f64>> {
        let covariance_m2 = self.conditional.covariance_m2.as_ref()?;
        if let Some(memory) = &self.memory {
            let mut right = memory.right.clone();
            for (of_ambiguity, z) in memory.cross.column_iter().zip(integers) {
                right.axpy(-z, &of_ambiguity, 1.0);
            }
            return Some(covariance_m2 * right);
        }
        let mut right = self.code_right.clone();
        let mut first = 0;
        for phases in &self.phases {
            let of_group = whitened_ranges.rows(first, phases.misclosure_m.len());
            right.gemv_tr(1.0, &phases.whitened_design, &of_group, 1.0);
            first += phases.misclosure_m.len();
        }
        Some(covariance_m2 * right)
    }

    /// Increase of the weighted squares of the epoch's code residuals if the corrections are these
    /// instead of those that code alone gives, `(x − x̂)ᵀ N (x − x̂)`.
    #[must_use]
    pub fn code_excess(&self, correction_m: &DVector<f64>) -> f64 {
        if self.without_code {
            return 0.0;
        }
        let off_m = |i: usize| correction_m[i] - self.code.correction_m[i];
        let of_columns = self.code.normal.column_iter().enumerate().map(|(j, column)| {
            let along: f64 = column.iter().enumerate().map(|(i, n)| n * off_m(i)).sum();
            along * off_m(j)
        });
        of_columns.sum()
    }

    /// Squares that integers leave of the phases, and of the code beyond what code alone leaves.
    #[must_use]
    pub fn squares_left(&self, conditional: &Conditional) -> f64 {
        conditional.phase_fit.sum + self.code_excess(&conditional.correction_m)
    }
}
