//! Products and factors of 3×3 matrices, written out: an attitude takes dozens of them, and the
//! general ones of the matrix library, which are not inlined, take three times as long.

use nalgebra::{Matrix3, Vector3};

/// `A B`.
pub(super) fn product(a: &Matrix3<f64>, b: &Matrix3<f64>) -> Matrix3<f64> {
    Matrix3::from_fn(|i, j| a[(i, 0)] * b[(0, j)] + a[(i, 1)] * b[(1, j)] + a[(i, 2)] * b[(2, j)])
}

/// `Aᵀ B`.
pub(super) fn transposed_product(a: &Matrix3<f64>, b: &Matrix3<f64>) -> Matrix3<f64> {
    Matrix3::from_fn(|i, j| a[(0, i)] * b[(0, j)] + a[(1, i)] * b[(1, j)] + a[(2, i)] * b[(2, j)])
}

/// `a bᵀ`.
pub(super) fn outer(a: &Vector3<f64>, b: &Vector3<f64>) -> Matrix3<f64> {
    Matrix3::from_fn(|i, j| a[i] * b[j])
}

/// `L D Lᵀ` of a symmetric positive definite matrix.
#[derive(Debug, Clone, Copy)]
pub(super) struct Factored {
    /// `D`, all positive.
    pub(super) pivots: Vector3<f64>,
    /// Below the diagonal of `L`: rows 1 and 2 of column 0, row 2 of column 1.
    lower: [f64; 3],
}

impl Factored {
    /// `None` unless all pivots are positive.
    pub(super) fn new(matrix: &Matrix3<f64>) -> Option<Self> {
        let d0 = matrix[(0, 0)];
        let (l10, l20) = (matrix[(1, 0)] / d0, matrix[(2, 0)] / d0);
        let d1 = matrix[(1, 1)] - l10 * matrix[(1, 0)];
        let l21 = (matrix[(2, 1)] - l20 * matrix[(1, 0)]) / d1;
        let d2 = matrix[(2, 2)] - l20 * matrix[(2, 0)] - l21 * l21 * d1;
        let pivots = Vector3::new(d0, d1, d2);
        pivots.iter().all(|d| *d > 0.0).then_some(Self { pivots, lower: [l10, l20, l21] })
    }

    /// The solution `x` of `A x = b`.
    pub(super) fn solve(&self, right: &Vector3<f64>) -> Vector3<f64> {
        let ([l10, l20, l21], d) = (self.lower, &self.pivots);
        // L y = b,  Lᵀ x = D⁻¹ y
        let y1 = right.y - l10 * right.x;
        let y2 = right.z - l20 * right.x - l21 * y1;
        let z = y2 / d.z;
        let y = y1 / d.y - l21 * z;
        Vector3::new(right.x / d.x - l10 * y - l20 * z, y, z)
    }

    /// `A⁻¹ B`.
    pub(super) fn solve_columns(&self, right: &Matrix3<f64>) -> Matrix3<f64> {
        Matrix3::from_columns(&[0, 1, 2].map(|j| self.solve(&right.column(j).into_owned())))
    }

    /// `A⁻¹`, symmetric to the last bit.
    pub(super) fn inverse(&self) -> Matrix3<f64> {
        let inverse = self.solve_columns(&Matrix3::identity());
        0.5 * (inverse + inverse.transpose())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn as_the_general_ones(
            a in proptest::array::uniform9(-1.0..1.0f64), b in proptest::array::uniform9(-1.0..1.0f64),
        ) {
            let [a, b] = [a, b].map(|c| Matrix3::from_row_slice(&c));
            prop_assert!((product(&a, &b) - a * b).norm() < 1e-15);
            prop_assert!((transposed_product(&a, &b) - a.transpose() * b).norm() < 1e-15);
            let (u, v) = (a.column(0).into_owned(), b.column(1).into_owned());
            prop_assert!((outer(&u, &v) - u * v.transpose()).norm() < 1e-15);
            let symmetric = a * a.transpose() + 0.01 * Matrix3::identity();
            let factored = Factored::new(&symmetric).unwrap();
            prop_assert!((symmetric * factored.solve_columns(&b) - b).norm() < 1e-12);
            prop_assert!((symmetric * factored.inverse() - Matrix3::identity()).norm() < 1e-12);
            prop_assert!(Factored::new(&-symmetric).is_none());
        }
    }

    #[test]
    fn nothing_but_positive_pivots_passes() {
        assert!(Factored::new(&Matrix3::zeros()).is_none());
        assert!(Factored::new(&Matrix3::repeat(f64::NAN)).is_none());
        let saddle = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, -1.0));
        assert!(Factored::new(&saddle).is_none());
    }
}
