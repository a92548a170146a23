//! Factorization of the float-ambiguity covariance, the first step of LAMBDA.
//!
//! Source: de Jonge & Tiberius (1996), *The LAMBDA method for integer ambiguity estimation:
//! implementation aspects*; symmetric pivoting after Chang, Yang & Zhou (2005), *MLAMBDA*; in panels, so that most of
//! the work is a product of matrices, as Golub & Van Loan, *Matrix Computations*, 4.2.9, do it for Cholesky's factors.

use nalgebra::{DMatrix, DMatrixView};

use super::AmbiguityError;

/// So many ambiguities are eliminated before the rest of the covariance hears of it.
const PANEL: usize = 8;
/// Columns of the rest that change together: only their part above the diagonal is wanted.
const STRIP: usize = 32;

/// `P Q Pᵀ = Lᵀ D L`, `L` unit lower triangular, `D` diagonal, `P` a permutation.
///
/// The last ambiguity is eliminated first, so the last element of `D` is its plain variance and
/// the first one the variance of the first ambiguity given all others. Among the ambiguities that
/// remain, the one with the smallest conditional variance goes next: `D` comes out nearly in the
/// order that the search wants.
#[derive(Debug, Clone, PartialEq)]
pub struct Ldl {
    /// `L`, `n × n`, no unit; zeros above the diagonal. During the factorization what is left of the covariance stands
    /// there.
    pub lower: DMatrix<f64>,
    /// `D`, `n` conditional variances, cycles².
    pub variances: Vec<f64>,
    /// Position `i` of the factorization is ambiguity `order[i]` of the covariance.
    pub order: Vec<usize>,
    /// The first position of the block to which position `i` belongs.
    pub block_starts: Vec<usize>,
    /// Rows of `L` of which the rest of the covariance has not heard, each in a column of `n`.
    panel: Vec<f64>,
    /// The same rows times their `d`.
    weighted: Vec<f64>,
}

impl Default for Ldl {
    fn default() -> Self {
        Self {
            lower: DMatrix::zeros(0, 0),
            variances: Vec::new(),
            order: Vec::new(),
            block_starts: Vec::new(),
            panel: Vec::new(),
            weighted: Vec::new(),
        }
    }
}

impl Ldl {
    /// Factors `covariance` (`n × n`, cycles²; its upper triangle is read), reusing memory.
    ///
    /// Ambiguities change places only within consecutive blocks of the sizes `blocks`; give
    /// `&[n]` for free choice. One whose conditional variance is at most `settled` (cycles²) goes when its turn comes,
    /// whether or not there is a smaller one.
    ///
    /// # Errors
    ///
    /// [`AmbiguityError::Empty`], [`AmbiguityError::Dimension`] if it is not square or the blocks
    /// do not add up, and [`AmbiguityError::NotPositiveDefinite`].
    pub fn factor(
        &mut self,
        covariance: &DMatrix<f64>,
        blocks: &[usize],
        settled: f64,
    ) -> Result<(), AmbiguityError> {
        let n = covariance.nrows();
        if n == 0 {
            return Err(AmbiguityError::Empty);
        }
        AmbiguityError::expect_dimension("the covariance", covariance.ncols(), n)?;
        AmbiguityError::expect_dimension("the sum of the blocks", blocks.iter().sum(), n)?;
        self.block_starts.clear();
        for &size in blocks {
            let start = self.block_starts.len();
            self.block_starts.resize(start + size, start);
        }
        if self.lower.shape() == covariance.shape() {
            self.lower.copy_from(covariance);
        } else {
            self.lower.clone_from(covariance);
        }
        self.variances.clear();
        self.variances.extend((0..n).map(|i| covariance[(i, i)]));
        self.order.clear();
        self.order.extend(0..n);
        self.panel.resize(n * PANEL.min(n), 0.0);
        self.weighted.resize(n * PANEL.min(n), 0.0);
        let mut end = n;
        while end > 0 {
            let start = end.saturating_sub(PANEL);
            for i in (start..end).rev() {
                self.eliminate(i, end, settled)?;
            }
            self.update_rest(start, end);
            end = start;
        }
        Ok(())
    }

    /// Eliminates the best ambiguity of the block of `i` in the place `i`, and puts its row of `L` into the next column
    /// of the panel, which holds those since `end`. Of these the covariance of the ambiguities before has heard only on
    /// its diagonal, which stands in the places of `D` that are to come.
    fn eliminate(&mut self, i: usize, end: usize, settled: f64) -> Result<(), AmbiguityError> {
        let n = self.variances.len();
        let q = self.lower.as_mut_slice(); // column-major: qₖⱼ is q[k + j n]
        let (first, variances) = (self.block_starts[i], &mut self.variances);
        let (mut pivot, mut least) = (i, variances[i]);
        if least > settled {
            for (j, variance) in variances[..i].iter().enumerate().skip(first) {
                if *variance < least {
                    (pivot, least) = (j, *variance);
                }
            }
        }
        let done = (end - 1 - i) * n;
        let (rows, row) = self.panel.split_at_mut(done);
        let (weighted, weighted_row) = self.weighted.split_at_mut(done);
        if pivot < i {
            exchange(q, n, pivot, i, end);
            let done = rows.chunks_exact_mut(n).chain(weighted.chunks_exact_mut(n));
            done.for_each(|row| row.swap(pivot, i));
            self.order.swap(pivot, i);
            variances.swap(pivot, i);
        }
        // dᵢ = qᵢᵢ
        let variance = variances[i];
        if !(variance > 0.0 && variance.is_finite()) {
            return Err(AmbiguityError::NotPositiveDefinite { index: self.order[i], variance });
        }
        // qₖᵢ ← qₖᵢ − Σ dₚ lₚᵢ lₚₖ  (i < p < end),   lᵢₖ = qₖᵢ / dᵢ,   qₖₖ ← qₖₖ − lᵢₖ qₖᵢ      for k < i
        let (row, weighted_row) = (&mut row[..i], &mut weighted_row[..i]);
        weighted_row.copy_from_slice(&q[i * n..i + i * n]);
        for (later, weighted) in rows.chunks_exact(n).zip(weighted.chunks_exact(n)) {
            let weight = weighted[i];
            for (q_ki, l_pk) in weighted_row.iter_mut().zip(later) {
                *q_ki -= weight * l_pk;
            }
        }
        let precision = 1.0 / variance;
        for ((l_ik, q_ki), q_kk) in row.iter_mut().zip(weighted_row).zip(variances) {
            *l_ik = *q_ki * precision;
            *q_kk -= *l_ik * *q_ki;
        }
        Ok(())
    }

    /// Writes the rows of `L` in the panel where they belong, and tells the covariance of the ambiguities before
    /// `start` of them: `qₖⱼ ← qₖⱼ − Σ lₚₖ dₚ lₚⱼ` for `k <= j`.
    fn update_rest(&mut self, start: usize, end: usize) {
        let (n, count) = (self.variances.len(), end - start);
        let q = self.lower.as_mut_slice();
        for (k, column) in q.chunks_exact_mut(n).enumerate().take(end) {
            for i in start.max(k + 1)..end {
                column[i] = self.panel[k + (end - 1 - i) * n];
            }
            if k >= start {
                column[..k].fill(0.0);
                column[k] = 1.0;
            }
        }
        let left = DMatrixView::from_slice(&self.panel, n, count);
        let right = DMatrixView::from_slice_with_strides(&self.weighted, count, start, n, 1);
        for first in (0..start).step_by(STRIP) {
            let width = STRIP.min(start - first);
            let height = first + width;
            let (left, right) = (left.rows(0, height), right.columns(first, width));
            self.lower.view_mut((0, first), (height, width)).gemm(-1.0, &left, &right, 1.0);
        }
    }
}

/// Exchanges ambiguities `p < i`: in what is left of the covariance, above the diagonal of `q`, and in the rows of `L`
/// from `end` on.
fn exchange(q: &mut [f64], n: usize, p: usize, i: usize, end: usize) {
    let (left, of_i) = q.split_at_mut(i * n);
    let (of_p, between) = left[p * n..].split_at_mut(n);
    of_p[..p].swap_with_slice(&mut of_i[..p]);
    for (q_pk, q_ki) in between.iter_mut().skip(p).step_by(n).zip(&mut of_i[p + 1..i]) {
        core::mem::swap(q_pk, q_ki);
    }
    of_p[end..].swap_with_slice(&mut of_i[end..n]);
}

#[cfg(test)]
mod tests {
    use super::super::problems::{faq_covariance, random_covariance, seeded};
    use super::*;

    fn rebuilt(factors: &Ldl) -> DMatrix<f64> {
        let n = factors.variances.len();
        let d = DMatrix::from_diagonal(&factors.variances.clone().into());
        let permuted = factors.lower.transpose() * d * &factors.lower;
        let mut q = DMatrix::zeros(n, n);
        for i in 0..n {
            for j in 0..n {
                q[(factors.order[i], factors.order[j])] = permuted[(i, j)];
            }
        }
        q
    }

    #[test]
    fn product_gives_the_covariance_back() {
        let mut factors = Ldl::default();
        factors.factor(&faq_covariance(), &[3], 0.0).unwrap();
        assert!((rebuilt(&factors) - faq_covariance()).amax() < 1e-14);
        assert_eq!(factors.order[2], 2, "6.288 is the smallest variance");
    }

    #[test]
    fn a_thousand_random_covariances_are_rebuilt() {
        let mut random = seeded(1);
        let mut factors = Ldl::default();
        for case in 0..1000 {
            let q = random_covariance(&mut random, 1 + case % 40);
            let first = case % (1 + case % 40);
            let settled = [0.0, 0.5, f64::INFINITY][case % 3];
            factors.factor(&q, &[first, q.nrows() - first], settled).unwrap();
            let error = (rebuilt(&factors) - &q).amax() / q.amax();
            assert!(error < 1e-13, "case {case}: {error:e}");
            assert!(factors.order[..first].iter().all(|&i| i < first), "blocks stay together");
        }
    }

    #[test]
    fn singular_covariance_is_named_not_panicked() {
        let q = DMatrix::from_element(2, 2, 1.0);
        let found = Ldl::default().factor(&q, &[2], 0.0);
        assert_eq!(found, Err(AmbiguityError::NotPositiveDefinite { index: 0, variance: 0.0 }));
        let not_square = Ldl::default().factor(&DMatrix::zeros(2, 3), &[2], 0.0);
        assert!(matches!(not_square, Err(AmbiguityError::Dimension { found: 3, expected: 2, .. })));
        let not_a_number = Ldl::default().factor(&DMatrix::from_element(2, 2, f64::NAN), &[2], 0.0);
        assert!(matches!(not_a_number, Err(AmbiguityError::NotPositiveDefinite { .. })));
    }
}
