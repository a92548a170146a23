//! Three range differences from four beacons.

use nalgebra::{Matrix3, Matrix4x3, Vector3, Vector4};

use super::{Refusal, Roots};
use crate::frames::{Ecef, Vector};

/// Discriminant, relative to its terms, that counts as zero.
const TOUCHING: f64 = 1e-13;
/// Ratio of the pivots of the beacon equations that counts as rank two.
const COLLINEAR: f64 = 1e-10;

/// Three range differences `Δᵢ = dᵢ − d₁`, i = 2..4, of four beacons, the first being the reference.
///
/// Subtracting the sphere of beacon 1 leaves three equations linear in the position r and the range
/// d₁ (both counted from beacon 1): sᵢ·r + Δᵢ d₁ = (|sᵢ|² − Δᵢ²)/2. Their solutions are a line in
/// the four dimensions (r, d₁), which the cone |r| = d₁ cuts in two points. Nothing is special
/// about coplanar beacons here, unlike in the usual elimination of r.
///
/// # Errors
///
/// [`Refusal::Parallel`] for collinear beacons or an object infinitely far, [`Refusal::NoIntersection`]
/// and [`Refusal::Tangent`] after the discriminant, [`Refusal::Behind`] if a range of every root is
/// negative.
pub fn three_range_differences(
    beacons_m: [Vector<Ecef>; 4],
    differences_m: [f64; 3],
) -> Result<Roots, Refusal> {
    let [origin, ..] = beacons_m;
    let arms = [1, 2, 3].map(|beacon: usize| (beacons_m[beacon] - origin).xyz());
    let column = |k: usize| Vector4::new(arms[k].x, arms[k].y, arms[k].z, differences_m[k]);
    let transposed = Matrix4x3::from_columns(&[column(0), column(1), column(2)]);
    let right = Vector3::from_fn(|k, _| {
        let arm = arms[k].norm();
        0.5 * (arm - differences_m[k]) * (arm + differences_m[k])
    });

    // The line p + λ w of solutions (r, d₁): p by QR of the transposed equations, w across them
    let particular = smallest_solution(&transposed, &right)?;
    let across = null_vector(&transposed).normalize();

    // |r|² = d₁²:  (w, w) λ² + 2 (p, w) λ + (p, p) = 0 with (u, v) = u_r·v_r − u_d v_d
    let a = minkowski(&across, &across);
    let b = minkowski(&particular, &across);
    let c = minkowski(&particular, &particular);
    let discriminant = b * b - a * c;
    let scale = particular.norm_squared();
    let position = |point: &Vector4<f64>| origin + Vector::from_xyz(point.xyz());
    if discriminant.abs() <= TOUCHING * scale && a.abs() > TOUCHING {
        return Err(Refusal::Tangent { touch_m: position(&(particular - across * (b / a))) });
    }
    if discriminant < 0.0 {
        return Err(Refusal::NoIntersection { squared: discriminant });
    }

    let admissible = |parameter: f64| {
        let point = particular + across * parameter;
        let ranges_positive =
            point.w > 0.0 && differences_m.iter().all(|difference| point.w + difference > 0.0);
        (parameter.is_finite() && ranges_positive).then(|| position(&point))
    };
    // λ₁ = q / a,  λ₂ = c / q,  q = −(b + sign(b) √D); a → 0 sends λ₁ to infinity
    let q = -(b + discriminant.sqrt().copysign(b));
    Roots::from_pair([admissible(c / q), admissible(q / a)])
}

/// The solution of `Mᵀ x = y` (three equations, four unknowns) of smallest length.
fn smallest_solution(
    transposed: &Matrix4x3<f64>,
    right: &Vector3<f64>,
) -> Result<Vector4<f64>, Refusal> {
    let qr = transposed.qr();
    let r: Matrix3<f64> = qr.r();
    let pivots = r.diagonal().abs();
    let sine = pivots.min() / pivots.max();
    if sine.is_nan() || sine <= COLLINEAR {
        return Err(Refusal::Parallel { sine });
    }
    let solution = r.tr_solve_upper_triangular(right).map(|y| qr.q() * y);
    solution.ok_or(Refusal::Parallel { sine })
}

/// The vector orthogonal to three columns: their cofactors.
fn null_vector(columns: &Matrix4x3<f64>) -> Vector4<f64> {
    let without = |row: usize| columns.remove_row(row).determinant();
    Vector4::new(without(0), -without(1), without(2), -without(3))
}

/// u_r·v_r − u_d v_d.
fn minkowski(u: &Vector4<f64>, v: &Vector4<f64>) -> f64 {
    u.xyz().dot(&v.xyz()) - u.w * v.w
}
