//! A small primal barrier solver for linear programmes with matrix inequalities, and a bound that its
//! last centre certifies.

use nalgebra::{DMatrix, DVector, Matrix4};

/// Growth of the barrier parameter from one centre to the next.
const GROWTH: f64 = 30.0;
const MAX_CENTRES: usize = 16;
const MAX_STEPS: usize = 40;
/// Relative accuracy of the optimum.
const ACCURACY: f64 = 1e-9;
/// A Newton decrement below this is a centre.
const CENTRED: f64 = 1e-3;

/// Minimise c·x subject to a·x = 0 or its value at the start, g·x ≤ h for each inequality, and
/// C + Σ xᵢ Aᵢ ⪰ 0 for each block.
#[derive(Debug, Clone)]
pub(super) struct ConeProgram {
    pub(super) cost: DVector<f64>,
    /// a: the steps stay in a·Δx = 0.
    pub(super) equality: DVector<f64>,
    pub(super) inequalities: Vec<Inequality>,
    pub(super) blocks: Vec<Block>,
}

/// Σ coefficient · x ≤ bound, with the terms that are not zero.
#[derive(Debug, Clone)]
pub(super) struct Inequality {
    pub(super) terms: Vec<(usize, f64)>,
    pub(super) bound: f64,
}

/// A symmetric matrix linear in x that must stay positive semidefinite; a 3×3 one has a 1 in the
/// corner of `constant`.
#[derive(Debug, Clone)]
pub(super) struct Block {
    pub(super) constant: Matrix4<f64>,
    pub(super) terms: Vec<Matrix4<f64>>,
}

/// The last centre.
#[derive(Debug, Clone)]
pub(super) struct Optimum {
    pub(super) x: DVector<f64>,
    /// c·x is nowhere below this on the feasible set.
    pub(super) bound: f64,
}

/// Value of the barrier function at a strictly feasible point, with what its derivatives need.
struct Inside {
    value: f64,
    slacks: Vec<f64>,
    inverse_factors: Vec<Matrix4<f64>>,
}

impl ConeProgram {
    /// Minimum from the strictly feasible `start`; `None` if the start is not strictly feasible.
    pub(super) fn minimise(&self, start: DVector<f64>) -> Option<Optimum> {
        let complexity = (self.inequalities.len() + 4 * self.blocks.len()) as f64;
        let mut x = start;
        let mut bound = f64::NEG_INFINITY;
        let mut sharpness = complexity / self.cost.dot(&x).abs().max(1e-3);
        self.inside(&x, sharpness)?;
        for _ in 0..MAX_CENTRES {
            let decrement = self.centre(&mut x, sharpness);
            let value = self.cost.dot(&x);
            if decrement < CENTRED {
                // c·x − min ≤ (ν + (δ + √ν) δ/(1 − δ))/t  (Nesterov, Introductory Lectures, 4.2.7)
                let excess = (decrement + complexity.sqrt()) * decrement / (1.0 - decrement);
                bound = bound.max(value - (complexity + excess) / sharpness);
            }
            if value - bound < ACCURACY * value.abs() {
                break;
            }
            sharpness *= GROWTH;
        }
        Some(Optimum { x, bound })
    }

    /// Damped Newton steps towards the minimum of t c·x − Σ log slack − Σ log det block; returns the
    /// last Newton decrement.
    fn centre(&self, x: &mut DVector<f64>, sharpness: f64) -> f64 {
        let mut decrement = f64::INFINITY;
        for _ in 0..MAX_STEPS {
            let Some(here) = self.inside(x, sharpness) else { break };
            let (gradient, hessian) = self.derivatives(&here, sharpness);
            let Some(step) = self.newton_step(&gradient, hessian) else { break };
            let slope = gradient.dot(&step);
            decrement = (-slope).max(0.0).sqrt();
            if decrement < CENTRED {
                break;
            }
            let mut length = 1.0;
            let accepted = (0..50).find_map(|_| {
                let next = &*x + &step * length;
                let lower = self
                    .inside(&next, sharpness)
                    .is_some_and(|there| there.value <= here.value + 0.1 * length * slope);
                length *= 0.5;
                lower.then_some(next)
            });
            match accepted {
                Some(next) => *x = next,
                None => break,
            }
        }
        decrement
    }

    /// The barrier function; `None` outside the feasible set or on its border.
    fn inside(&self, x: &DVector<f64>, sharpness: f64) -> Option<Inside> {
        let mut value = sharpness * self.cost.dot(x);
        let mut slacks = Vec::with_capacity(self.inequalities.len());
        for inequality in &self.inequalities {
            let slack = inequality.bound
                - inequality.terms.iter().map(|(i, coefficient)| coefficient * x[*i]).sum::<f64>();
            if slack.is_nan() || slack <= 0.0 {
                return None;
            }
            value -= slack.ln();
            slacks.push(slack);
        }
        let mut inverse_factors = Vec::with_capacity(self.blocks.len());
        for block in &self.blocks {
            let matrix = x
                .iter()
                .zip(&block.terms)
                .fold(block.constant, |sum, (weight, term)| sum + term * *weight);
            let factor = matrix.cholesky()?.unpack();
            value -= 2.0 * factor.diagonal().map(f64::ln).sum();
            inverse_factors.push(factor.solve_lower_triangular(&Matrix4::identity())?);
        }
        value.is_finite().then_some(Inside { value, slacks, inverse_factors })
    }

    /// Gradient and Hessian of the barrier function.
    fn derivatives(&self, here: &Inside, sharpness: f64) -> (DVector<f64>, DMatrix<f64>) {
        let size = self.cost.len();
        let mut gradient = &self.cost * sharpness;
        let mut hessian = DMatrix::zeros(size, size);
        // ∇ = g/slack,  ∇² = g gᵀ/slack²
        for (inequality, slack) in self.inequalities.iter().zip(&here.slacks) {
            for (place, (i, a)) in inequality.terms.iter().enumerate() {
                gradient[*i] += a / slack;
                for (j, b) in &inequality.terms[..=place] {
                    hessian[(*i.max(j), *i.min(j))] += a * b / (slack * slack);
                }
            }
        }
        // V = L⁻¹ A L⁻ᵀ:  ∇ᵢ = −tr Vᵢ,  ∇²ᵢⱼ = ⟨Vᵢ, Vⱼ⟩
        for (block, inverse_factor) in self.blocks.iter().zip(&here.inverse_factors) {
            let whitened: Vec<Matrix4<f64>> = block
                .terms
                .iter()
                .map(|term| inverse_factor * term * inverse_factor.transpose())
                .collect();
            for i in 0..size {
                gradient[i] -= whitened[i].trace();
                for j in 0..=i {
                    hessian[(i, j)] += whitened[i].dot(&whitened[j]);
                }
            }
        }
        hessian.fill_upper_triangle_with_lower_triangle();
        (gradient, hessian)
    }

    /// Newton step in the plane a·Δx = 0.
    fn newton_step(&self, gradient: &DVector<f64>, hessian: DMatrix<f64>) -> Option<DVector<f64>> {
        let factor = guarded_cholesky(hessian)?;
        let free = factor.solve(gradient);
        let across = factor.solve(&self.equality);
        // Δx = −H⁻¹∇ + H⁻¹a (aᵀH⁻¹∇)/(aᵀH⁻¹a)
        let multiplier = self.equality.dot(&free) / self.equality.dot(&across);
        let mut step = across * multiplier - free;
        // What rounding leaves of a·Δx near the border must not add up.
        step -= &self.equality * (self.equality.dot(&step) / self.equality.norm_squared());
        step.iter().all(|s| s.is_finite()).then_some(step)
    }
}

/// Cholesky factor of the Hessian, with a growing share of its diagonal added while it is singular to
/// rounding, as it becomes near the border.
fn guarded_cholesky(hessian: DMatrix<f64>) -> Option<nalgebra::Cholesky<f64, nalgebra::Dyn>> {
    let mut share = 0.0;
    for _ in 0..8 {
        let mut guarded = hessian.clone();
        for i in 0..guarded.nrows() {
            guarded[(i, i)] *= 1.0 + share;
        }
        if let Some(factor) = guarded.cholesky() {
            return Some(factor);
        }
        share = if share == 0.0 { 1e-14 } else { share * 100.0 };
    }
    None
}
