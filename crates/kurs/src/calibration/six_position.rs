//! Six-position calibration: each axis once up and once down, the sensor's box levelled.

use nalgebra::{Matrix3, Vector3};

use super::sensor_model::{CalibrationProblem, Pose, SensorModel, check_poses};

/// Above it a box stands on no side.
const MOST_LEVELLING_RAD: f64 = 0.5;

/// Bias, scale and misalignment from poses in which one axis of the box is vertical; several poses
/// of the same direction are averaged.
///
/// `levelling_sd_rad` is how well the box stood, 1 σ about each horizontal axis; it dominates the
/// uncertainty of misalignment and bias and cannot be seen in the data.
///
/// y = M a + b with a = ±g eᵢ: column i of M is (yᵢ⁺ − yᵢ⁻) / 2g, b the mean of all six; the least
/// squares solution.
///
/// # Errors
///
/// [`CalibrationProblem`] in words, if poses are missing, disturbed or in another unit.
pub fn calibrate(
    poses: &[Pose],
    gravity_mps2: f64,
    levelling_sd_rad: f64,
) -> Result<SensorModel, CalibrationProblem> {
    check_poses(poses, gravity_mps2)?;
    if !(0.0..=MOST_LEVELLING_RAD).contains(&levelling_sd_rad) {
        let levelling_deg = levelling_sd_rad.to_degrees();
        return Err(CalibrationProblem::Levelling { levelling_deg });
    }
    let six = sort_into_six(poses)?;
    let mut matrix = Matrix3::zeros();
    let mut matrix_sd = Matrix3::zeros();
    let mut bias_mps2 = Vector3::zeros();
    let mut noise_variance = 0.0;
    for axis in 0..3 {
        let [up, down] = [&six[2 * axis], &six[2 * axis + 1]];
        let column = (up.mean_mps2 - down.mean_mps2) / (2.0 * gravity_mps2);
        matrix.set_column(axis, &column);
        bias_mps2 += (up.mean_mps2 + down.mean_mps2) / 6.0;
        let pair_variance = up.mean_sd_mps2().powi(2) + down.mean_sd_mps2().powi(2);
        noise_variance += pair_variance / 36.0;
        for row in 0..3 {
            // A tilt δ of a pose puts g δ on the two other axes, g δ²/2 on its own.
            let tilted = match row == axis {
                true => gravity_mps2 * levelling_sd_rad.powi(2),
                false => gravity_mps2 * levelling_sd_rad,
            };
            let variance = pair_variance + 2.0 * tilted * tilted;
            matrix_sd[(row, axis)] = variance.sqrt() / (2.0 * gravity_mps2);
        }
    }
    // Four of the six poses put their tilt on any one axis.
    let levelling_variance = 4.0 * (gravity_mps2 * levelling_sd_rad / 6.0).powi(2);
    let bias_sd_mps2 = Vector3::repeat((noise_variance + levelling_variance).sqrt());
    Ok(SensorModel { matrix, bias_mps2, matrix_sd, bias_sd_mps2 })
}

/// Means of the poses by direction: x up, x down, y up, y down, z up, z down ("up" reads +g).
fn sort_into_six(poses: &[Pose]) -> Result<[Pose; 6], CalibrationProblem> {
    const NAMES: [&str; 6] = ["x up", "x down", "y up", "y down", "z up", "z down"];
    let mut groups: [Vec<&Pose>; 6] = Default::default();
    for pose in poses {
        let axis = pose.mean_mps2.iamax();
        groups[2 * axis + usize::from(pose.mean_mps2[axis] < 0.0)].push(pose);
    }
    let missing: Vec<&str> =
        NAMES.iter().zip(&groups).filter(|(_, group)| group.is_empty()).map(|(n, _)| *n).collect();
    if !missing.is_empty() {
        return Err(CalibrationProblem::MissingPoses { missing: missing.join(", ") });
    }
    Ok(groups.map(|group| average(&group)))
}

fn average(group: &[&Pose]) -> Pose {
    let samples: usize = group.iter().map(|pose| pose.samples).sum();
    let weight = |pose: &Pose| pose.samples as f64 / samples.max(1) as f64;
    let mean_mps2 = group.iter().map(|pose| pose.mean_mps2 * weight(pose)).sum();
    let variance: f64 = group.iter().map(|p| p.sample_sd_mps2.powi(2) * weight(p)).sum();
    Pose { mean_mps2, sample_sd_mps2: variance.sqrt(), samples }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::print_stdout)]
    use super::*;
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};
    use rand_xoshiro::Xoshiro256PlusPlus;

    const G: f64 = 9.81;
    const NOISE_MPS2: f64 = 0.02;
    const SAMPLES: usize = 1000;

    fn truth() -> (Matrix3<f64>, Vector3<f64>) {
        let m = Matrix3::new(1.003, 0.002, -0.001, 0.0015, 0.998, 0.003, -0.002, 0.001, 1.001);
        (m, Vector3::new(0.05, -0.08, 0.12))
    }

    /// Poses with noisy means and tilted by `levelling_sd_rad`.
    fn poses(seed: u64, levelling_sd_rad: f64) -> Vec<Pose> {
        let mut generator = Xoshiro256PlusPlus::seed_from_u64(seed);
        let mut normal = |sd: f64| {
            let unit: f64 = StandardNormal.sample(&mut generator);
            unit * sd
        };
        let (m, b) = truth();
        (0..6)
            .map(|k| {
                let mut a = Vector3::zeros();
                a[k / 2] = if k % 2 == 0 { G } else { -G };
                let tilt = Vector3::from_fn(|_, _| normal(levelling_sd_rad));
                let a = nalgebra::Rotation3::new(tilt) * a;
                let noise = Vector3::from_fn(|_, _| normal(NOISE_MPS2 / (SAMPLES as f64).sqrt()));
                Pose { mean_mps2: m * a + b + noise, sample_sd_mps2: NOISE_MPS2, samples: SAMPLES }
            })
            .collect()
    }

    /// Root mean square errors (scale, misalignment, bias) and the mean of the squared normalised
    /// errors of all twelve parameters, over 100 seeds.
    fn campaign(levelling_sd_rad: f64) -> (f64, f64, f64, f64) {
        let (m, b) = truth();
        let (mut scale, mut misalignment, mut bias, mut normalised) = (0.0, 0.0, 0.0, 0.0);
        for seed in 0..100 {
            let found = calibrate(&poses(seed, levelling_sd_rad), G, levelling_sd_rad).unwrap();
            let error = found.matrix - m;
            let bias_error = found.bias_mps2 - b;
            for (k, e) in error.iter().enumerate() {
                let part = if k % 4 == 0 { &mut scale } else { &mut misalignment };
                *part += e * e;
            }
            bias += bias_error.norm_squared();
            normalised += error.component_div(&found.matrix_sd).norm_squared()
                + bias_error.component_div(&found.bias_sd_mps2).norm_squared();
        }
        let rms = |sum: f64, count: f64| (sum / count).sqrt();
        (rms(scale, 300.0), rms(misalignment, 600.0), rms(bias, 300.0), normalised / 1200.0)
    }

    /// Reference with exact poses: scale 45 ppm, misalignment 0.046 mrad, bias 0.25 mm/s². χ² of
    /// 1200 errors within its 99.9 % band, ±3.3 √(2/1200).
    #[test]
    fn exact_poses() {
        let (scale, misalignment, bias, normalised) = campaign(0.0);
        println!(
            "exact poses: scale {:.0} ppm, misalignment {:.3} mrad, bias {:.2} mm/s², (error/σ)² {normalised:.3}",
            scale * 1e6,
            misalignment * 1e3,
            bias * 1e3
        );
        assert!((scale / 45e-6 - 1.0).abs() < 0.2, "{scale}");
        assert!((misalignment / 0.046e-3 - 1.0).abs() < 0.2, "{misalignment}");
        assert!((bias / 0.25e-3 - 1.0).abs() < 0.2, "{bias}");
        assert!((normalised - 1.0).abs() < 0.135, "{normalised}");
    }

    /// Reference for 0.1° of levelling: 47 ppm, 1.24 mrad, 5.7 mm/s², and the stated sigmas say so.
    #[test]
    fn levelling_shows_in_the_uncertainty() {
        let levelling_sd_rad = 0.1f64.to_radians();
        let (scale, misalignment, bias, normalised) = campaign(levelling_sd_rad);
        println!(
            "0.1° of levelling: scale {:.0} ppm, misalignment {:.2} mrad, bias {:.1} mm/s², (error/σ)² {normalised:.3}",
            scale * 1e6,
            misalignment * 1e3,
            bias * 1e3
        );
        assert!(scale < 60e-6, "{scale}");
        assert!((misalignment / 1.24e-3 - 1.0).abs() < 0.2, "{misalignment}");
        assert!((bias / 5.7e-3 - 1.0).abs() < 0.2, "{bias}");
        assert!((normalised - 1.0).abs() < 0.2, "{normalised}");
        let found = calibrate(&poses(1, levelling_sd_rad), G, levelling_sd_rad).unwrap();
        assert!((found.matrix_sd[(0, 1)] - 1.23e-3).abs() < 0.02e-3);
        assert!((found.bias_sd_mps2.x - 5.7e-3).abs() < 0.1e-3);
    }

    #[test]
    fn missing_poses_are_named() {
        let six = poses(1, 0.0);
        let problem = calibrate(&six[..4], G, 0.0).unwrap_err();
        assert!(problem.to_string().contains("z up, z down"), "{problem}");
    }

    #[test]
    fn a_box_that_stands_on_no_side_is_refused() {
        for levelling_sd_rad in [7.0, -0.1, f64::NAN] {
            let problem = calibrate(&poses(1, 0.0), G, levelling_sd_rad).unwrap_err();
            assert!(problem.to_string().contains("0 to 28 expected"), "{problem}");
        }
    }

    #[test]
    fn wrong_gravity_is_suspected() {
        let six = poses(1, 0.0);
        assert_eq!(calibrate(&six, G, 0.0).unwrap().suspected_gravity_error(), None);
        let mut ideal = six;
        for (k, pose) in ideal.iter_mut().enumerate() {
            pose.mean_mps2 = Vector3::zeros();
            pose.mean_mps2[k / 2] = if k % 2 == 0 { G } else { -G };
        }
        // A gravity that is itself uncertain makes every scale so, and no bias.
        let sure = calibrate(&ideal, G, 0.0).unwrap();
        let unsure = sure.with_gravity_sd(G, 0.0981);
        assert!((unsure.matrix_sd[(0, 0)] - 0.01f64.hypot(sure.matrix_sd[(0, 0)])).abs() < 1e-12);
        assert_eq!(unsure.bias_sd_mps2, sure.bias_sd_mps2);
        let suspected = calibrate(&ideal, 9.78, 0.0).unwrap().suspected_gravity_error().unwrap();
        assert!((suspected - (9.81 / 9.78 - 1.0)).abs() < 1e-9, "{suspected}");
    }
}
