//! Least squares in information form, `Λ x̂ = η`: unknowns may come, go and stay undetermined.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

/// Information below this share of the largest is rounding error: nothing is known.
const NOTHING: f64 = 1e-12;

/// `Λ` (symmetric, positive semidefinite) and `η`.
#[derive(Debug, Clone)]
pub(super) struct Information {
    pub(super) matrix: DMatrix<f64>,
    pub(super) vector: DVector<f64>,
}

impl Information {
    /// Nothing known of `unknowns`.
    pub(super) fn nothing(unknowns: usize) -> Self {
        Self { matrix: DMatrix::zeros(unknowns, unknowns), vector: DVector::zeros(unknowns) }
    }

    pub(super) fn unknowns(&self) -> usize {
        self.vector.len()
    }

    /// Whether nothing at all is known of one unknown.
    pub(super) fn lacks(&self, unknown: usize) -> bool {
        self.matrix[(unknown, unknown)] == 0.0
    }

    /// Adds independent information about the same unknowns, `factor` times.
    pub(super) fn add(&mut self, other: &Self, factor: f64) {
        self.matrix.zip_apply(&other.matrix, |mine, theirs| *mine += factor * theirs);
        self.vector.axpy(factor, &other.vector, 1.0);
    }

    /// All that is known counts less.
    pub(super) fn fade(&mut self, factor: f64) {
        self.matrix *= factor;
        self.vector *= factor;
    }

    /// Forgets one unknown; what is known of the others without it stays:
    ///
    /// `Λ ← Λ − λᵢ λᵢᵀ / Λᵢᵢ`,   `η ← η − λᵢ ηᵢ / Λᵢᵢ`   (`λᵢ` the column of the unknown)
    pub(super) fn forget(&mut self, unknown: usize) {
        let pivot = self.matrix[(unknown, unknown)];
        if pivot == 0.0 {
            return;
        }
        let largest = (0..self.unknowns()).map(|i| self.matrix[(i, i)]).fold(0.0, f64::max);
        if pivot > NOTHING * largest {
            let column = self.matrix.column(unknown).clone_owned();
            let known = self.vector[unknown];
            self.matrix.ger(-1.0 / pivot, &column, &column, 1.0);
            self.vector.axpy(-known / pivot, &column, 1.0);
        }
        self.matrix.fill_row(unknown, 0.0);
        self.matrix.fill_column(unknown, 0.0);
        self.vector[unknown] = 0.0;
    }

    /// The information about the unknowns `kept` (old indices) in their order; `None` is a new
    /// unknown. Unknowns that are left out must have been forgotten, or are held at zero.
    pub(super) fn select(&self, kept: &[Option<usize>]) -> Self {
        let n = kept.len();
        let entry = |i: usize, j: usize| match (kept[i], kept[j]) {
            (Some(i), Some(j)) => self.matrix[(i, j)],
            _ => 0.0,
        };
        Self {
            matrix: DMatrix::from_fn(n, n, entry),
            vector: DVector::from_fn(n, |i, _| kept[i].map_or(0.0, |i| self.vector[i])),
        }
    }

    /// The information about some of the unknowns, all others being zero.
    pub(super) fn part(&self, unknowns: &[usize]) -> Self {
        Self {
            matrix: self.matrix.select_columns(unknowns).select_rows(unknowns),
            vector: self.vector.select_rows(unknowns),
        }
    }

    /// The first unknowns are counted from a new origin: `x = x′ + δ`, so `η ← η − Λ_·x δ`.
    pub(super) fn shift_first(&mut self, shift: &DVector<f64>) {
        self.vector.gemv(-1.0, &self.matrix.columns(0, shift.len()), shift, 1.0);
    }

    /// The first `count` unknowns walk at random with the variance `1/p` each (`p` is `precision`):
    /// with `G = Λ_xx + p I`,
    ///
    /// `Λ_xx ← p G⁻¹ Λ_xx`,   `Λ_xN ← p G⁻¹ Λ_xN`,   `Λ_NN ← Λ_NN − Λ_Nx G⁻¹ Λ_xN`,
    ///
    /// and `η` in the same way.
    pub(super) fn diffuse_first(&mut self, count: usize, precision: f64) {
        let mut g = self.matrix.view((0, 0), (count, count)).clone_owned();
        for i in 0..count {
            g[(i, i)] += precision;
        }
        let Some(factor) = g.cholesky() else {
            (0..count).for_each(|unknown| self.forget(unknown));
            return;
        };
        let rows = self.matrix.rows(0, count).clone_owned();
        let first = self.vector.rows(0, count).clone_owned();
        // G⁻¹ (Λ_xx Λ_xN), G⁻¹ η_x
        let spread = factor.solve(&rows);
        let mean = factor.solve(&first);
        self.matrix.gemm_tr(-1.0, &rows, &spread, 1.0);
        self.vector.gemv_tr(-1.0, &rows, &mean, 1.0);
        // The rows and columns of the first unknowns themselves are p G⁻¹ times what they were.
        let walked = spread * precision;
        self.matrix.rows_mut(0, count).copy_from(&walked);
        self.matrix.columns_mut(0, count).copy_from(&walked.transpose());
        self.vector.rows_mut(0, count).copy_from(&(mean * precision));
    }

    /// `Λ = L Lᵀ`, if all unknowns are determined.
    pub(super) fn factor(&self) -> Option<Cholesky<f64, Dyn>> {
        self.matrix.clone().cholesky()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Three unknowns, four equations.
    fn example() -> Information {
        let design =
            DMatrix::from_row_slice(4, 3, &[1., 2., 0., 0., 1., -1., 3., 0., 1., 1., 1., 1.]);
        let values = DVector::from_row_slice(&[1.0, 2.0, 3.0, -1.0]);
        Information { matrix: design.transpose() * &design, vector: design.transpose() * values }
    }

    fn solved(information: &Information) -> (DVector<f64>, DMatrix<f64>) {
        let factor = information.factor().unwrap();
        (factor.solve(&information.vector), factor.inverse())
    }

    #[test]
    fn what_is_known_of_the_others_outlives_a_forgotten_unknown() {
        let (x, q) = solved(&example());
        let mut without = example();
        without.forget(1);
        assert!(without.lacks(1) && !without.lacks(0));
        let (y, p) = solved(&without.select(&[Some(2), Some(0)]));
        assert!((y[0] - x[2]).abs() < 1e-12 && (y[1] - x[0]).abs() < 1e-12);
        assert!((p[(0, 0)] - q[(2, 2)]).abs() < 1e-12 && (p[(0, 1)] - q[(2, 0)]).abs() < 1e-12);
        // Forgetting what is not known changes nothing, and a new unknown starts with nothing.
        let again = without.clone();
        without.forget(1);
        assert_eq!(without.matrix, again.matrix);
        assert!(without.select(&[Some(0), None]).lacks(1));
    }

    /// What is left of an unknown by rounding says nothing of the others.
    #[test]
    fn a_rest_of_rounding_is_only_dropped() {
        let pivot = 100.0 * NOTHING;
        let column = 10.0 * pivot.sqrt();
        let mut information = Information {
            matrix: DMatrix::from_row_slice(2, 2, &[1e6, column, column, pivot]),
            vector: DVector::from_row_slice(&[3.0, pivot]),
        };
        information.forget(1);
        assert_eq!(information.matrix, DMatrix::from_row_slice(2, 2, &[1e6, 0.0, 0.0, 0.0]));
        assert_eq!(information.vector, DVector::from_row_slice(&[3.0, 0.0]));
    }

    #[test]
    fn what_fades_says_the_same_less_surely() {
        let (x, q) = solved(&example());
        let mut faded = example();
        faded.fade(0.25);
        let (y, p) = solved(&faded);
        assert!((y - x).norm() < 1e-12 && (p - q * 4.0).norm() < 1e-12);
    }

    #[test]
    fn a_random_walk_adds_its_variance() {
        let (x, q) = solved(&example());
        let mut walked = example();
        walked.diffuse_first(2, 4.0);
        let (y, p) = solved(&walked);
        let expected = q + DMatrix::from_diagonal(&DVector::from_row_slice(&[0.25, 0.25, 0.0]));
        assert!((y - x).norm() < 1e-12);
        assert!((p - expected).norm() < 1e-12);
    }

    #[test]
    fn an_infinite_walk_is_forgetting() {
        let (mut walked, mut forgotten) = (example(), example());
        walked.diffuse_first(1, 1e-12);
        forgotten.forget(0);
        assert!((walked.matrix - forgotten.matrix).norm() < 1e-10);
    }

    #[test]
    fn a_new_origin_moves_the_first_unknowns_only() {
        let (x, q) = solved(&example());
        let mut shifted = example();
        shifted.shift_first(&DVector::from_row_slice(&[10.0]));
        let (y, p) = solved(&shifted);
        assert!((y - (x - DVector::from_row_slice(&[10.0, 0.0, 0.0]))).norm() < 1e-12);
        assert!((p - q).norm() < 1e-12);
    }
}
