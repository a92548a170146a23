//! The 3×3 Gram matrix of chosen baselines, R = Σ w l lᵀ: adding a baseline, invariants, eigenvalues.

use core::ops::Add;

use nalgebra::{Matrix3, Vector3};

/// Symmetric 3×3 matrix R = Σ w l lᵀ (m²), six numbers, so that adding a baseline is six additions.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Gram {
    xx: f64,
    yy: f64,
    zz: f64,
    xy: f64,
    xz: f64,
    yz: f64,
}

/// Coefficients of the characteristic polynomial λ³ − e₁λ² + e₂λ − e₃ of a symmetric 3×3 matrix.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Invariants {
    pub(super) e1: f64,
    pub(super) e2: f64,
    pub(super) e3: f64,
}

impl Gram {
    /// w l lᵀ of one baseline `l` (m).
    #[must_use]
    pub fn of(baseline: &Vector3<f64>, weight: f64) -> Self {
        let (x, y, z) = (baseline.x, baseline.y, baseline.z);
        Self {
            xx: weight * x * x,
            yy: weight * y * y,
            zz: weight * z * z,
            xy: weight * x * y,
            xz: weight * x * z,
            yz: weight * y * z,
        }
    }

    /// The matrix itself.
    #[must_use]
    pub fn matrix(&self) -> Matrix3<f64> {
        Matrix3::new(
            self.xx, self.xy, self.xz, //
            self.xy, self.yy, self.yz, //
            self.xz, self.yz, self.zz,
        )
    }

    /// tr R, the sum of the squared lengths (m²).
    #[inline]
    pub(super) fn trace(&self) -> f64 {
        self.xx + self.yy + self.zz
    }

    /// e₁ = tr R, e₂ = sum of the principal 2×2 minors, e₃ = det R.
    #[inline]
    pub(super) fn invariants(&self) -> Invariants {
        let minor_x = self.yy * self.zz - self.yz * self.yz;
        let minor_y = self.xx * self.zz - self.xz * self.xz;
        let minor_z = self.xx * self.yy - self.xy * self.xy;
        Invariants {
            e1: self.trace(),
            e2: minor_x + minor_y + minor_z,
            e3: self.xx * minor_x
                + self.xy * (self.xz * self.yz - self.xy * self.zz)
                + self.xz * (self.xy * self.yz - self.xz * self.yy),
        }
    }

    /// Eigenvalues, ascending, in closed form; error a few units in the last place of the largest.
    ///
    /// The trigonometric formula (Smith, 1961) is exact to rounding only for the eigenvalue that is
    /// far from the other two; those come from the 2×2 block orthogonal to its eigenvector
    /// (Eberly, "A robust eigensolver for 3×3 symmetric matrices").
    #[must_use]
    pub fn eigenvalues(&self) -> [f64; 3] {
        let matrix = self.matrix();
        let mean = matrix.trace() / 3.0;
        let deviator = matrix - Matrix3::from_diagonal_element(mean);
        // p² = tr(B²)/6, cos 3φ = det(B)/(2p³), isolated eigenvalue of B: 2p cos φ or −2p cos(π/3 − φ)
        let p = (deviator.norm_squared() / 6.0).sqrt();
        if p <= f64::MIN_POSITIVE.sqrt() {
            return [mean; 3];
        }
        let half_determinant = ((deviator / p).determinant() / 2.0).clamp(-1.0, 1.0);
        let angle = half_determinant.abs().acos() / 3.0;
        let isolated = (2.0 * p * angle.cos()).copysign(half_determinant);
        let axis = null_direction(&(deviator - Matrix3::from_diagonal_element(isolated)));
        let (below, above) = eigenvalues_across(&deviator, &axis);
        let isolated = axis.dot(&(deviator * axis));
        let mut eigenvalues = [mean + isolated, mean + below, mean + above];
        eigenvalues.sort_by(f64::total_cmp);
        eigenvalues
    }
}

impl Add for Gram {
    type Output = Self;
    #[inline]
    fn add(self, other: Self) -> Self {
        Self {
            xx: self.xx + other.xx,
            yy: self.yy + other.yy,
            zz: self.zz + other.zz,
            xy: self.xy + other.xy,
            xz: self.xz + other.xz,
            yz: self.yz + other.yz,
        }
    }
}

impl Invariants {
    /// Invariants of the squared matrix (Graeffe's step).
    #[inline]
    pub(super) fn squared(&self) -> Self {
        Self {
            e1: self.e1 * self.e1 - 2.0 * self.e2,
            e2: self.e2 * self.e2 - 2.0 * self.e1 * self.e3,
            e3: self.e3 * self.e3,
        }
    }

    /// Invariants of the attitude information J = tr(R) I − R, whose eigenvalues are sums of two
    /// eigenvalues of R.
    #[inline]
    pub(super) fn of_information(&self) -> Self {
        // det((e₁ − λ)I − R) expanded: e₁(J) = 2e₁, e₂(J) = e₁² + e₂, e₃(J) = e₁e₂ − e₃
        Self { e1: 2.0 * self.e1, e2: self.e1 * self.e1 + self.e2, e3: self.e1 * self.e2 - self.e3 }
    }
}

/// Unit vector of the null space of a symmetric matrix of rank 2: the longest cross product of rows.
fn null_direction(matrix: &Matrix3<f64>) -> Vector3<f64> {
    let row = |i: usize| Vector3::new(matrix[(i, 0)], matrix[(i, 1)], matrix[(i, 2)]);
    let candidates = [row(0).cross(&row(1)), row(1).cross(&row(2)), row(2).cross(&row(0))];
    let longest = candidates
        .iter()
        .max_by(|a, b| a.norm_squared().total_cmp(&b.norm_squared()))
        .copied()
        .unwrap_or_else(Vector3::x);
    longest.try_normalize(0.0).unwrap_or_else(Vector3::x)
}

/// The two eigenvalues of a symmetric matrix in the plane orthogonal to its unit eigenvector `axis`.
fn eigenvalues_across(matrix: &Matrix3<f64>, axis: &Vector3<f64>) -> (f64, f64) {
    let least = if axis.x.abs() < 0.6 { Vector3::x() } else { Vector3::y() };
    let first = axis.cross(&least).normalize();
    let second = axis.cross(&first);
    let (a, b) = (first.dot(&(matrix * first)), second.dot(&(matrix * second)));
    let c = first.dot(&(matrix * second));
    // λ = (a + b)/2 ± √(((a − b)/2)² + c²)
    let radius = (0.5 * (a - b)).hypot(c);
    (0.5 * (a + b) - radius, 0.5 * (a + b) + radius)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Rotation3;
    use proptest::prelude::*;

    fn from_eigenvalues(values: [f64; 3], axis_angle: Vector3<f64>) -> Gram {
        let rotation = Rotation3::new(axis_angle);
        (0..3).fold(Gram::default(), |sum, i| {
            sum + Gram::of(&rotation.matrix().column(i).into_owned(), values[i])
        })
    }

    #[test]
    fn double_and_triple_eigenvalues() {
        let turn = Vector3::new(0.3, -1.1, 0.7);
        for values in [[1.0, 1.0, 1.0], [1.0, 1.0, 4.0], [1.0, 4.0, 4.0], [0.0, 0.0, 2.0], [0.0; 3]]
        {
            let found = from_eigenvalues(values, turn).eigenvalues();
            for i in 0..3 {
                assert!((found[i] - values[i]).abs() < 4e-15 * 4.0, "{values:?}: {found:?}");
            }
        }
    }

    proptest! {
        #[test]
        fn eigenvalues_are_those_it_was_built_from(
            a in 0.0..5.0f64, gap in -16.0..0.5f64, c in 0.0..5.0f64,
            x in -3.0..3.0f64, y in -3.0..3.0f64, z in -3.0..3.0f64,
        ) {
            let mut values = [a, a + 10f64.powf(gap), c];
            values.sort_by(f64::total_cmp);
            let gram = from_eigenvalues(values, Vector3::new(x, y, z));
            let found = gram.eigenvalues();
            for i in 0..3 {
                prop_assert!((found[i] - values[i]).abs() < 2e-15 * (1.0 + values[2]) * 4.0);
            }
            let Invariants { e1, e2, e3 } = gram.invariants();
            let [l1, l2, l3] = values;
            prop_assert!((e1 - (l1 + l2 + l3)).abs() < 1e-13 * (1.0 + e1));
            prop_assert!((e2 - (l1 * l2 + l1 * l3 + l2 * l3)).abs() < 1e-13 * (1.0 + e1 * e1));
            prop_assert!((e3 - l1 * l2 * l3).abs() < 1e-13 * (1.0 + e1 * e1 * e1));
            let squared = gram.invariants().squared();
            prop_assert!((squared.e1 - (l1 * l1 + l2 * l2 + l3 * l3)).abs() < 1e-12 * (1.0 + e1 * e1));
            let information = gram.invariants().of_information();
            let (s1, s2, s3) = (l1 + l2, l1 + l3, l2 + l3);
            prop_assert!((information.e1 - (s1 + s2 + s3)).abs() < 1e-12 * (1.0 + e1));
            prop_assert!((information.e2 - (s1 * s2 + s1 * s3 + s2 * s3)).abs() < 1e-12 * (1.0 + e1 * e1));
            prop_assert!((information.e3 - s1 * s2 * s3).abs() < 1e-12 * (1.0 + e1 * e1 * e1));
        }
    }
}
