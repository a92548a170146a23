//! Decorrelation: an integer change of variables that makes the ambiguities nearly independent.
//!
//! `ẑ = Zᵀ â` with `Z` integer and unimodular, so that `z` is integer exactly when `a` is, and
//! `Q_z = Zᵀ Q_a Z` has conditional variances that fall, as far as possible, from the first to the
//! last. `Z` is kept as the list of its elementary steps. Each is integer and has an integer
//! inverse, so the way back is exact; and a step costs one operation on a vector.
//!
//! Sources: Teunissen (1995), J. Geodesy 70, 65-82; the order of work after Xie, Chang & Al Borno
//! (2011), *Partial LLL reduction*: an element is reduced when an exchange follows from it.

use nalgebra::DMatrix;

use super::{AmbiguityError, MAX_CYCLES, dot, exchange::Exchanges, ldl::Ldl};

/// An exchange must lower the conditional variance by at least this share.
const MIN_GAIN: f64 = 1e-6;
/// At most this many exchanges for each entry of the `n × n` covariance; then the reduction stays as far as it got.
const MAX_EXCHANGES_PER_ENTRY: usize = 64;

/// An elementary integer change of the ambiguities.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Step {
    /// `z[target] ← z[target] − multiple · z[source]`.
    Subtract { target: usize, source: usize, multiple: i64 },
    /// `z[first] ↔ z[first + 1]`.
    Exchange { first: usize },
}

/// The decorrelated factorization `Q_z = Lᵀ D L` and the way from `a` to `z` and back.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Decorrelation {
    ldl: Ldl,
    steps: Vec<Step>,
    exchanges: Exchanges,
}

impl Decorrelation {
    /// Factors and decorrelates `covariance` (`n × n`, cycles²), reusing memory.
    ///
    /// # Errors
    ///
    /// Those of [`Ldl::factor`], and [`AmbiguityError::OutOfRange`] for correlations so strong
    /// that the integers of `Z` would not be exact.
    pub fn compute(&mut self, covariance: &DMatrix<f64>) -> Result<(), AmbiguityError> {
        self.compute_in_blocks(covariance, &[covariance.nrows()], 0.0)
    }

    /// As [`compute`](Self::compute), but ambiguities change places only within consecutive blocks
    /// of the sizes `blocks`: the search then comes to the last block first, and to the first one
    /// last. Ambiguities whose conditional variance is at most `settled` (cycles²) change places with
    /// nothing.
    ///
    /// # Errors
    ///
    /// Those of [`compute`](Self::compute), and [`AmbiguityError::Dimension`] if the blocks do not
    /// add up.
    pub fn compute_in_blocks(
        &mut self,
        covariance: &DMatrix<f64>,
        blocks: &[usize],
        settled: f64,
    ) -> Result<(), AmbiguityError> {
        self.ldl.factor(covariance, blocks, settled)?;
        self.steps.clear();
        let n = self.dimension();
        self.exchanges.begin(n);
        let mut exchanges_left = MAX_EXCHANGES_PER_ENTRY * n * n;
        // From the last pair to the first, one back after each exchange.
        let mut pair = n - 1;
        while pair > 0 {
            let k = pair - 1;
            self.exchanges.tell(&mut self.ldl.lower, k);
            // δ = dₖ + (l − μ)² dₖ₊₁,  μ = nearest integer to l: the variance that ambiguity k would have
            // in the place of k + 1
            let l = self.ldl.lower[(k + 1, k)];
            let multiple = nearest_integer(l);
            let variance = self.ldl.variances[k + 1];
            let exchanged = self.ldl.variances[k] + (l - multiple).powi(2) * variance;
            let one_block = self.ldl.block_starts[k] == self.ldl.block_starts[k + 1];
            let gains = variance > settled && exchanged < (1.0 - MIN_GAIN) * variance;
            if one_block && gains && exchanges_left > 0 {
                self.subtract(k, k + 1, multiple)?;
                if multiple.abs() > 1.0 {
                    // A large multiple makes the rest of the column large: keep it small.
                    for source in k + 2..n {
                        let multiple = nearest_integer(self.ldl.lower[(source, k)]);
                        self.subtract(k, source, multiple)?;
                    }
                }
                self.exchange(k, exchanged);
                exchanges_left -= 1;
                pair = (pair + 1).min(n - 1);
            } else {
                pair -= 1;
            }
        }
        Ok(())
    }

    /// Number of ambiguities `n`.
    #[must_use]
    pub fn dimension(&self) -> usize {
        self.ldl.variances.len()
    }

    /// `L` of `Q_z = Lᵀ D L`, `n × n`, unit lower triangular.
    #[must_use]
    pub fn lower(&self) -> &DMatrix<f64> {
        &self.ldl.lower
    }

    /// `D` of `Q_z = Lᵀ D L`: variance of each decorrelated ambiguity, given those after it, cycles².
    #[must_use]
    pub fn conditional_variances(&self) -> &[f64] {
        &self.ldl.variances
    }

    /// Writes `z = Zᵀ a`.
    pub fn decorrelated(&self, a: &[f64], z: &mut Vec<f64>) {
        z.clear();
        z.extend(self.ldl.order.iter().map(|&i| a[i]));
        for step in &self.steps {
            match *step {
                Step::Subtract { target, source, multiple } => {
                    z[target] -= multiple as f64 * z[source];
                }
                Step::Exchange { first } => z.swap(first, first + 1),
            }
        }
    }

    /// The integers `a = Z⁻ᵀ z`, exactly.
    ///
    /// # Errors
    ///
    /// [`AmbiguityError::OutOfRange`] if one does not fit.
    pub fn original(&self, z: Vec<i64>) -> Result<Vec<i64>, AmbiguityError> {
        let mut unwound = z;
        for step in self.steps.iter().rev() {
            match *step {
                Step::Subtract { target, source, multiple } => {
                    unwound[target] = multiple
                        .checked_mul(unwound[source])
                        .and_then(|product| unwound[target].checked_add(product))
                        .ok_or(AmbiguityError::OutOfRange {
                            what: "an integer of the decorrelation",
                            value: multiple as f64 * unwound[source] as f64,
                        })?;
                }
                Step::Exchange { first } => unwound.swap(first, first + 1),
            }
        }
        let mut a = vec![0; unwound.len()];
        for (value, &i) in unwound.iter().zip(&self.ldl.order) {
            a[i] = *value;
        }
        Ok(a)
    }

    /// `Γ` (`p × n`) of `x̌(z) = x̂ − Γ w`: how the reals follow the conditional residuals
    /// `w = L⁻ᵀ (ẑ − z)`, from their covariance with the ambiguities `cross` (`Q_xa`, `p × n`).
    ///
    /// ```text
    /// Q_xa Q_a⁻¹ (â − a) = Q_xz L⁻¹ D⁻¹ w,   Γ = Q_xz L⁻¹ D⁻¹,   Q_xz = Q_xa Z
    /// ```
    #[must_use]
    pub fn gains(&self, cross: &DMatrix<f64>) -> DMatrix<f64> {
        let (p, n) = cross.shape();
        let mut gains = DMatrix::zeros(p, n);
        let mut row = Vec::with_capacity(n);
        let mut transformed = Vec::with_capacity(n);
        for r in 0..p {
            row.clear();
            row.extend(cross.row(r).iter());
            self.decorrelated(&row, &mut transformed);
            // gⱼ = qⱼ − Σᵢ gᵢ lᵢⱼ      for i > j
            for j in (0..n).rev() {
                let column = &self.ldl.lower.as_slice()[j * n + j + 1..(j + 1) * n];
                transformed[j] -= dot(column, &transformed[j + 1..]);
            }
            for j in 0..n {
                gains[(r, j)] = transformed[j] / self.ldl.variances[j];
            }
        }
        gains
    }

    /// Integer Gauss transformation: column `target` of `L` minus `multiple` times column `source`.
    fn subtract(
        &mut self,
        target: usize,
        source: usize,
        multiple: f64,
    ) -> Result<(), AmbiguityError> {
        if multiple == 0.0 {
            return Ok(());
        }
        if multiple.is_nan() || multiple.abs() >= MAX_CYCLES {
            return Err(AmbiguityError::OutOfRange {
                what: "an integer of the decorrelation",
                value: multiple,
            });
        }
        let n = self.dimension();
        let (left, right) = self.ldl.lower.as_mut_slice().split_at_mut(source * n);
        let target_column = &mut left[target * n + source..(target + 1) * n];
        for (to, from) in target_column.iter_mut().zip(&right[source..n]) {
            *to -= multiple * from;
        }
        #[expect(clippy::cast_possible_truncation, reason = "a whole number below 2⁵²")]
        self.steps.push(Step::Subtract { target, source, multiple: multiple as i64 });
        Ok(())
    }

    /// Exchanges ambiguities `k` and `k + 1`; `exchanged` is the new variance of place `k + 1`.
    fn exchange(&mut self, k: usize, exchanged: f64) {
        let Ldl { lower, variances, .. } = &mut self.ldl;
        self.exchanges.exchange(variances, lower, k, exchanged);
        self.steps.push(Step::Exchange { first: k });
    }
}

/// Most are zero, which takes no rounding.
fn nearest_integer(l: f64) -> f64 {
    if l.abs() < 0.5 { 0.0 } else { l.round() }
}

#[cfg(test)]
mod tests {
    use super::super::problems::{faq_covariance, geometry_covariance, random_covariance, seeded};
    use super::*;

    /// `Zᵀ`, from the images of the unit vectors.
    fn z_transposed(decorrelation: &Decorrelation) -> DMatrix<f64> {
        let n = decorrelation.dimension();
        let mut columns = DMatrix::zeros(n, n);
        let mut image = Vec::new();
        for i in 0..n {
            let mut unit = vec![0.0; n];
            unit[i] = 1.0;
            decorrelation.decorrelated(&unit, &mut image);
            columns.column_mut(i).copy_from_slice(&image);
        }
        columns
    }

    fn check(q: &DMatrix<f64>, case: &str) {
        let n = q.nrows();
        let mut decorrelation = Decorrelation::default();
        decorrelation.compute(q).unwrap();
        let z_t = z_transposed(&decorrelation);

        // Z is integer, and Z⁻ᵀ (exact, in integers) is its inverse: Z is unimodular.
        assert!(z_t.iter().all(|entry| entry.fract() == 0.0), "{case}");
        for i in 0..n {
            let mut unit = vec![0_i64; n];
            unit[i] = 1;
            let back = decorrelation.original(unit).unwrap();
            for j in 0..n {
                // Whole numbers far below 2⁵³: the sum is exact.
                let product: f64 = (0..n).map(|k| z_t[(j, k)] * back[k] as f64).sum();
                assert_eq!(product, f64::from(u8::from(i == j)), "{case}: {j},{i}");
            }
        }

        // Zᵀ Q Z = Lᵀ D L.
        let d = DMatrix::from_diagonal(&decorrelation.conditional_variances().to_vec().into());
        let rebuilt = decorrelation.lower().transpose() * d * decorrelation.lower();
        let transformed = &z_t * q * z_t.transpose();
        let scale = (z_t.abs() * q.abs() * z_t.abs().transpose()).amax();
        assert!((rebuilt - transformed).amax() < 1e-12 * scale, "{case}");

        // No exchange of neighbours would help any more.
        for k in 0..n - 1 {
            let l = decorrelation.lower()[(k + 1, k)];
            let d = decorrelation.conditional_variances();
            let exchanged = d[k] + (l - l.round()).powi(2) * d[k + 1];
            assert!(exchanged >= (1.0 - MIN_GAIN) * d[k + 1], "{case}: pair {k}");
        }
    }

    #[test]
    fn change_of_variables_is_unimodular_and_reduced() {
        check(&faq_covariance(), "FAQ");
        let mut random = seeded(2);
        for case in 0..200 {
            check(&random_covariance(&mut random, 1 + case % 20), &format!("random {case}"));
        }
        for case in 0..50 {
            let q = geometry_covariance(&mut random, 4 + case);
            check(&q, &format!("geometry {case}"));
        }
    }

    #[test]
    fn integers_that_do_not_fit_are_refused() {
        let q = DMatrix::from_row_slice(2, 2, &[98.5, 9.9, 9.9, 1.0]);
        let mut decorrelation = Decorrelation::default();
        decorrelation.compute(&q).unwrap();
        assert_eq!(decorrelation.original(vec![0, 1]).unwrap(), [1, 0], "10 a₁ was taken from a₀");
        let found = decorrelation.original(vec![i64::MAX / 5, i64::MAX / 5]);
        assert!(matches!(found, Err(AmbiguityError::OutOfRange { .. })), "{found:?}");
    }
}
