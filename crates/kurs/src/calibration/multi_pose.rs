//! Calibration without levelling: in any resting pose the corrected reading has the length g.

use nalgebra::{Matrix3, SMatrix, SVector, Vector3};

use super::sensor_model::{CalibrationProblem, Pose, SensorModel, check_poses};

/// Six elements of the upper triangular T and three of b.
const UNKNOWNS: usize = 9;
const ITERATIONS: usize = 50;
/// Beyond it the poses do not determine the unknowns: a pose more or less changes everything.
const WORST_CONDITION: f64 = 1e5;

type Parameters = SVector<f64, UNKNOWNS>;
type Normal = SMatrix<f64, UNKNOWNS, UNKNOWNS>;

/// Fit of |T (y − b)| = g, T upper triangular: scale, non-orthogonality and bias. The rotation of
/// the triad in its box cannot be seen without levelling.
///
/// The result is given as y = M a + b with M = T⁻¹. Gauss-Newton from T = I, b = 0; standard
/// deviations from the noise of the pose means.
///
/// # Errors
///
/// [`CalibrationProblem`] in words.
pub fn calibrate(poses: &[Pose], gravity_mps2: f64) -> Result<SensorModel, CalibrationProblem> {
    check_poses(poses, gravity_mps2)?;
    if poses.len() < UNKNOWNS {
        return Err(CalibrationProblem::TooFewPoses { found: poses.len(), needed: UNKNOWNS });
    }
    let mut parameters = Parameters::zeros();
    for diagonal in [0, 3, 5] {
        parameters[diagonal] = 1.0;
    }
    for _ in 0..ITERATIONS {
        let (normal, right, _) = normal_equations(poses, &parameters, gravity_mps2);
        let condition = scaled_condition(&normal);
        if condition.is_nan() || condition > WORST_CONDITION {
            return Err(CalibrationProblem::Alike { condition });
        }
        let Some(factor) = normal.cholesky() else {
            return Err(CalibrationProblem::Alike { condition: f64::INFINITY });
        };
        let step = factor.solve(&right);
        parameters -= step;
        if step.amax() < 1e-12 {
            return Ok(model(&parameters, &factor.inverse()));
        }
    }
    let (_, _, sum) = normal_equations(poses, &parameters, gravity_mps2);
    Err(CalibrationProblem::NotConverged { residual_mps2: (sum / poses.len() as f64).sqrt() })
}

/// |T (y − b)| − g of each pose, m/s².
#[must_use]
pub fn residuals_mps2(poses: &[Pose], model: &SensorModel, gravity_mps2: f64) -> Vec<f64> {
    let length = |pose: &Pose| model.corrected(&pose.mean_mps2).map_or(f64::NAN, |a| a.norm());
    poses.iter().map(|pose| length(pose) - gravity_mps2).collect()
}

/// T of the parameters t₁₁ t₁₂ t₁₃ t₂₂ t₂₃ t₃₃ b₁ b₂ b₃.
fn triangle(p: &Parameters) -> Matrix3<f64> {
    Matrix3::new(p[0], p[1], p[2], 0.0, p[3], p[4], 0.0, 0.0, p[5])
}

/// Jᵀ W J, Jᵀ W r and Σ r² of r = |T (y − b)| − g.
fn normal_equations(
    poses: &[Pose],
    parameters: &Parameters,
    gravity_mps2: f64,
) -> (Normal, Parameters, f64) {
    let t = triangle(parameters);
    let bias = Vector3::new(parameters[6], parameters[7], parameters[8]);
    let (mut normal, mut right, mut sum) = (Normal::zeros(), Parameters::zeros(), 0.0);
    for pose in poses {
        let d = pose.mean_mps2 - bias;
        let a = t * d;
        let residual = a.norm() - gravity_mps2;
        // ∂r/∂tᵢⱼ = uᵢ dⱼ, ∂r/∂b = −Tᵀ u, u = a/|a|
        let u = a / a.norm();
        let by_bias = -t.tr_mul(&u);
        let row = Parameters::from_column_slice(&[
            u.x * d.x,
            u.x * d.y,
            u.x * d.z,
            u.y * d.y,
            u.y * d.z,
            u.z * d.z,
            by_bias.x,
            by_bias.y,
            by_bias.z,
        ]);
        let weight = 1.0 / pose.mean_sd_mps2().max(1e-9).powi(2);
        normal += row * row.transpose() * weight;
        right += row * (weight * residual);
        sum += residual * residual;
    }
    (normal, right, sum)
}

/// Condition number of the normal equations scaled to a unit diagonal.
fn scaled_condition(normal: &Normal) -> f64 {
    let scale = normal.diagonal().map(|value| 1.0 / value.sqrt());
    let scaled = Normal::from_fn(|i, j| normal[(i, j)] * scale[i] * scale[j]);
    let values = scaled.symmetric_eigenvalues();
    if values.min() <= 0.0 { f64::INFINITY } else { values.max() / values.min() }
}

/// M = T⁻¹ with first-order standard deviations: δM = −M δT M.
fn model(parameters: &Parameters, covariance: &Normal) -> SensorModel {
    const ELEMENTS: [(usize, usize); 6] = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)];
    let matrix = triangle(parameters).try_inverse().unwrap_or_else(Matrix3::zeros);
    let mut by_element = SMatrix::<f64, 9, 6>::zeros();
    for (k, (i, j)) in ELEMENTS.iter().enumerate() {
        let change = -matrix.column(*i) * matrix.row(*j);
        by_element.column_mut(k).copy_from_slice(change.as_slice());
    }
    let block = covariance.fixed_view::<6, 6>(0, 0);
    let variances = (by_element * block * by_element.transpose()).diagonal();
    SensorModel {
        matrix,
        bias_mps2: Vector3::new(parameters[6], parameters[7], parameters[8]),
        matrix_sd: Matrix3::from_column_slice(variances.map(f64::sqrt).as_slice()),
        bias_sd_mps2: Vector3::from_fn(|k, _| covariance[(6 + k, 6 + k)].sqrt()),
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::print_stdout)]
    use super::*;
    use core::f64::consts::PI;
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};
    use rand_xoshiro::Xoshiro256PlusPlus;

    const G: f64 = 9.81;

    fn truth() -> (Matrix3<f64>, Vector3<f64>) {
        let m = Matrix3::new(1.003, 0.002, -0.001, 0.0, 0.998, 0.003, 0.0, 0.0, 1.001);
        (m, Vector3::new(0.05, -0.08, 0.12))
    }

    /// `count` poses spread evenly over the sphere (golden angle), 1000 samples of 0.02 m/s² each.
    fn poses(seed: u64, count: u32) -> Vec<Pose> {
        let mut generator = Xoshiro256PlusPlus::seed_from_u64(seed);
        let (m, b) = truth();
        (0..count)
            .map(|k| {
                let z = 1.0 - (2.0 * f64::from(k) + 1.0) / f64::from(count);
                let azimuth = PI * (3.0 - 5f64.sqrt()) * f64::from(k);
                let level = (1.0 - z * z).sqrt();
                let a = Vector3::new(level * azimuth.cos(), level * azimuth.sin(), z) * G;
                let noise = Vector3::from_fn(|_, _| {
                    let unit: f64 = StandardNormal.sample(&mut generator);
                    unit * 0.02 / 1000f64.sqrt()
                });
                Pose { mean_mps2: m * a + b + noise, sample_sd_mps2: 0.02, samples: 1000 }
            })
            .collect()
    }

    /// Reference: 12 poses 139 ppm and 0.39 mm/s², 24 poses 61 ppm and 0.25 mm/s²; these are spread
    /// more evenly.
    #[test]
    fn twelve_and_twenty_four_poses() {
        campaign(12, 139e-6, 0.39e-3);
        campaign(24, 61e-6, 0.25e-3);
    }

    /// Root mean square errors below the bounds, and sigmas consistent over 100 seeds (99.9 %).
    fn campaign(count: u32, scale_bound: f64, bias_bound_mps2: f64) {
        let (m, b) = truth();
        let (mut scale, mut bias, mut normalised) = (0.0, 0.0, 0.0);
        for seed in 0..100 {
            let found = calibrate(&poses(seed, count), G).unwrap();
            let (e, eb) = (found.matrix - m, found.bias_mps2 - b);
            scale += e.diagonal().norm_squared();
            bias += eb.norm_squared();
            for (i, j) in [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)] {
                normalised += (e[(i, j)] / found.matrix_sd[(i, j)]).powi(2);
            }
            normalised += eb.component_div(&found.bias_sd_mps2).norm_squared();
        }
        let (scale, bias) = ((scale / 300.0).sqrt(), (bias / 300.0).sqrt());
        println!("{count} poses: scale {:.0} ppm, bias {:.2} mm/s²", scale * 1e6, bias * 1e3);
        assert!(scale < scale_bound, "{count}: {scale}");
        assert!(bias < bias_bound_mps2, "{count}: {bias}");
        let normalised = normalised / 900.0;
        assert!((normalised - 1.0).abs() < 3.3 * (2f64 / 900.0).sqrt(), "{normalised}");
    }

    #[test]
    fn residuals_are_noise() {
        let poses = poses(3, 24);
        let model = calibrate(&poses, G).unwrap();
        let residuals = residuals_mps2(&poses, &model, G);
        assert_eq!(residuals.len(), 24);
        assert!(residuals.iter().all(|r| r.abs() < 4.0 * 0.02 / 1000f64.sqrt()));
    }

    #[test]
    fn poor_sets_of_poses_are_refused_in_words() {
        let problem = calibrate(&poses(1, 8), G).unwrap_err();
        assert!(problem.to_string().contains("8 resting poses"), "{problem}");
        let one_sided: Vec<Pose> = poses(1, 200).into_iter().take(20).collect();
        let problem = calibrate(&one_sided, G).unwrap_err();
        assert!(matches!(problem, CalibrationProblem::Alike { .. }), "{problem}");
    }
}
