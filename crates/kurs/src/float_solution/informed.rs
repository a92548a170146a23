//! A float solution that is told something of its baselines from outside.

use std::sync::OnceLock;

use nalgebra::{DMatrix, DVector};

use super::{ConditionalNormal, Fit, FloatSolution};

impl FloatSolution {
    /// The solution with the components `y = Uᵀ x + e` of its corrections `x` (3k) measured, `e ~ N(0, V)`:
    ///
    /// ```text
    /// S = Uᵀ Q_x̂ U + V,   K_· = Q_·x̂ U S⁻¹,   x̂ ← x̂ + K_x (y − Uᵀ x̂),   Q_x̂ ← Q_x̂ − K_x Uᵀ Q_x̂,   …
    /// ```
    ///
    /// `U` is `3k × r`, `V` `r × r` (m²). The innovation counts among the residuals of the code. `None` if
    /// `V` or `S` is not positive definite.
    #[must_use]
    pub fn informed(
        &self,
        directions: &DMatrix<f64>,
        measured_m: &DVector<f64>,
        covariance_m2: &DMatrix<f64>,
    ) -> Option<Self> {
        let innovation_m = measured_m - directions.tr_mul(&self.correction_m);
        // Uᵀ Q_x̂, Uᵀ Q_x̂â
        let (x_seen, a_seen) =
            (directions.tr_mul(&self.covariance_m2), directions.tr_mul(&self.cross_covariance));
        let s = (&x_seen * directions + covariance_m2).cholesky()?;
        let weighted = s.solve(&innovation_m);
        let (x_solved, a_solved) = (s.solve(&x_seen), s.solve(&a_seen));

        // Λ_xx ← Λ_xx + U V⁻¹ Uᵀ,   right ← right + U V⁻¹ y
        let v = covariance_m2.clone().cholesky()?;
        let right = directions * v.solve(measured_m);
        let mut memory = self.memory.clone();
        if let Some(memory) = &mut memory {
            memory.right += &right;
        }
        Some(Self {
            correction_m: &self.correction_m + x_seen.tr_mul(&weighted),
            covariance_m2: &self.covariance_m2 - x_seen.tr_mul(&x_solved),
            ambiguities_cycles: &self.ambiguities_cycles + a_seen.tr_mul(&weighted),
            ambiguity_covariance: OnceLock::from(
                self.ambiguity_covariance() - a_seen.tr_mul(&a_solved),
            ),
            cross_covariance: &self.cross_covariance - x_seen.tr_mul(&a_solved),
            code_fit: Fit {
                sum: self.code_fit.sum + innovation_m.dot(&weighted),
                degrees_of_freedom: self.code_fit.degrees_of_freedom + innovation_m.len(),
            },
            conditional: ConditionalNormal::new(
                &self.conditional.matrix + directions * v.solve(&directions.transpose()),
            ),
            code_right: &self.code_right + right,
            memory,
            informed: self.informed + innovation_m.len(),
            ..self.clone()
        })
    }
}
