//! Parameter continuation (Rapoport, equations 12 to 20): from Wahba's weight to the real one.
//!
//! At `α = 0` the weight is the auxiliary one, for which Wahba's closed form is the solution; at
//! `α = 1` it is the real one. The solution is followed by its derivative, a few steps long:
//!
//! ```text
//! α ½ tr(lᵀQᵀM̂Ql) − α tr(BM̂Q) − tr(BQ) → min,   M̂ = N/κ − I,   B = l C L*ᵀ
//! Π = QᵀM̂Q,  Ψ = QᵀM̂Bᵀ − ΠR
//! (α mix(Π, R) + 2 (tr(μ) I − μ)) s = vex(Ψ − Ψᵀ),     Q′ = Q [s]×
//! μ′ = ½ (Ψ − α Π[s]×R − 2 [s]×μ)                       (symmetric multiplier)
//! ```
//!
//! With `κ = tr(N)/3`: as printed (`κ = 1`) all of the path happens at `α ~ 1/κ` and the steps
//! diverge. Newton's method reaches more in as many steps; `docs/theory/attitude.md` has the table.

use nalgebra::Matrix3;

use super::AttitudeError;
use super::small::{Factored, product, transposed_product};
use super::wahba::any_nearest_rotation;
use super::weighted::{AttitudeProblem, exponential, mix, vex_of_difference};
use crate::frames::skew;

/// The factor `κ` that makes the real weight comparable to the auxiliary one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scale {
    /// `κ = 1`, as printed: diverges in realistic units.
    Printed,
    /// `κ = tr(N)/3`.
    Trace,
}

/// How a step moves the rotation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Step {
    /// `Q + Δα Q[s]×`, as published: leaves the rotations.
    Euler,
    /// `Q exp(Δα [s]×)`.
    Exponential,
    /// The rotation nearest to Euler's step.
    Polar,
}

impl AttitudeProblem {
    /// Follows the solution from `α = 0` to `α = 1` in `steps` equal steps. The result is as near to
    /// orthogonal as the kind of step makes it.
    ///
    /// # Errors
    ///
    /// Input errors as [`AttitudeProblem::minimum`]; [`AttitudeError::Unobservable`] for a singular
    /// normal matrix, for which the auxiliary weight does not exist, and where the derivative is not
    /// determined; [`AttitudeError::NotSeparable`] for the general form.
    pub fn continuation(
        &self,
        steps: usize,
        scale: Scale,
        step: Step,
    ) -> Result<Matrix3<f64>, AttitudeError> {
        self.check()?;
        let Self::Separable { normal, spread, cross } = self else {
            return Err(AttitudeError::NotSeparable);
        };
        // Bᵀ = N⁻¹ X,  M̂Bᵀ = X/κ − Bᵀ
        let factored = Factored::new(normal).ok_or(AttitudeError::Unobservable)?;
        let b_transposed = factored.solve_columns(cross);
        let kappa = match scale {
            Scale::Printed => 1.0,
            Scale::Trace => normal.trace() / 3.0,
        };
        let m = normal / kappa - Matrix3::identity();
        let m_b_transposed = cross / kappa - b_transposed;

        let mut rotation = any_nearest_rotation(&b_transposed)?;
        // μ(0) = ½ P diag(1, 1, d) Σ Pᵀ = ½ QᵀBᵀ
        let start = transposed_product(&rotation, &b_transposed);
        let mut mu = 0.25 * (start + start.transpose());
        let delta = 1.0 / steps as f64;
        for index in 0..steps {
            let alpha = index as f64 * delta;
            let pi = transposed_product(&rotation, &product(&m, &rotation));
            let psi = transposed_product(&rotation, &m_b_transposed) - product(&pi, spread);
            let k = alpha * mix(&pi, spread) + 2.0 * (mu.trace() * Matrix3::identity() - mu);
            let inverse = k.try_inverse().ok_or(AttitudeError::Unobservable)?;
            let s = inverse * vex_of_difference(&psi);
            let turn = skew(&s);
            let bent = alpha * product(&pi, &product(&turn, spread)) + 2.0 * product(&turn, &mu);
            mu += 0.5 * delta * (psi - bent);
            let euler = rotation + delta * product(&rotation, &turn);
            rotation = match step {
                Step::Euler => euler,
                Step::Exponential => product(&rotation, &exponential(&(delta * s))),
                Step::Polar => any_nearest_rotation(&euler)?,
            };
        }
        Ok(rotation)
    }
}
