//! Six-position calibration: each axis once up and once down, the sensor's box levelled.

use nalgebra::{Matrix3, Vector3};

use super::sensor_model::{CalibrationProblem, MOST_OFF_AXIS_DEG, Pose, SensorModel, check_poses};
use crate::chi_square::chi_square_tail;

/// Above it a box stands on no side.
const MOST_LEVELLING_RAD: f64 = 0.5;
/// Disagreement of the poses that has less than this probability is not taken for chance.
const UNLIKELY: f64 = 1e-3;

/// How well the box stood, where the data show that it was worse than stated.
#[derive(Debug, Clone, PartialEq)]
pub struct Levelling {
    /// 1 σ about each horizontal axis, rad.
    pub sd_rad: f64,
    /// The pair of directions that agrees least with the others: an axis up and down.
    pub worst: &'static str,
    /// Numbers of its poses, from 1.
    pub poses: Vec<usize>,
}

/// Bias, scale and misalignment from poses in which one axis of the box is vertical; several poses
/// of the same direction are averaged.
///
/// `levelling_sd_rad` is how well the box stood, 1 σ about each horizontal axis; it dominates the
/// uncertainty of misalignment and bias. Where [`levelling`] finds it worse, that is taken.
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
    let found = six_levelling(&six, gravity_mps2, levelling_sd_rad);
    let levelling_sd_rad = found.map_or(levelling_sd_rad, |(found_rad, _)| found_rad);
    let six = six.map(|(pose, _)| pose);
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

/// How well the box stood by the data, if that is worse than stated: three pairs of poses give the
/// bias three times, and a tilt moves what a pair gives for the two axes that it does not lie on.
///
/// # Errors
///
/// [`CalibrationProblem`] as [`calibrate`].
pub fn levelling(
    poses: &[Pose],
    gravity_mps2: f64,
    levelling_sd_rad: f64,
) -> Result<Option<Levelling>, CalibrationProblem> {
    const PAIRS: [&str; 3] = ["x up and x down", "y up and y down", "z up and z down"];
    check_poses(poses, gravity_mps2)?;
    let six = sort_into_six(poses)?;
    let found = six_levelling(&six, gravity_mps2, levelling_sd_rad);
    Ok(found.map(|(sd_rad, axis)| {
        let mut poses = [&six[2 * axis].1[..], &six[2 * axis + 1].1].concat();
        poses.sort_unstable();
        Levelling { sd_rad, worst: PAIRS[axis], poses }
    }))
}

/// Standard deviation of the tilts, and the axis whose pair agrees least; `None` if they agree as well
/// as the stated one lets expect.
fn six_levelling(
    six: &[(Pose, Vec<usize>); 6],
    gravity_mps2: f64,
    stated_rad: f64,
) -> Option<(f64, usize)> {
    let pair = |axis: usize| [&six[2 * axis].0, &six[2 * axis + 1].0];
    // sᵢ = (yᵢ⁺ + yᵢ⁻) / 2 = b + g (δ⁺ + δ⁻) / 2 across the axis; r = sᵢ − mean has six degrees of freedom
    let sums = [0, 1, 2].map(|axis| (pair(axis)[0].mean_mps2 + pair(axis)[1].mean_mps2) / 2.0);
    let mean = (sums[0] + sums[1] + sums[2]) / 3.0;
    let apart = sums.map(|sum| sum - mean);
    let squares: f64 = apart.iter().map(Vector3::norm_squared).sum();
    let noise_variance = six.iter().map(|(p, _)| p.mean_sd_mps2().powi(2)).sum::<f64>() / 12.0;
    // Σ r² = 6 σ² + 4 τ²,  τ² = g² δ² / 2: two of three sums are tilted along each axis
    let tilt_variance = |sd_rad: f64| (gravity_mps2 * sd_rad).powi(2) / 2.0;
    let expected = noise_variance + 2.0 / 3.0 * tilt_variance(stated_rad);
    if squares == 0.0 || chi_square_tail(squares / expected, 6) >= UNLIKELY {
        return None;
    }
    let found_rad = ((squares - 6.0 * noise_variance) / 2.0).max(0.0).sqrt() / gravity_mps2;
    let worst =
        [0, 1, 2].into_iter().max_by(|a, b| apart[*a].amax().total_cmp(&apart[*b].amax()))?;
    (found_rad > stated_rad).then_some((found_rad, worst))
}

/// Means of the poses by direction, with the numbers of the poses: x up, x down, y up, y down, z up, z
/// down ("up" reads +g).
fn sort_into_six(poses: &[Pose]) -> Result<[(Pose, Vec<usize>); 6], CalibrationProblem> {
    const NAMES: [&str; 6] = ["x up", "x down", "y up", "y down", "z up", "z down"];
    let mut groups: [Vec<usize>; 6] = Default::default();
    for (index, Pose { mean_mps2, .. }) in poses.iter().enumerate() {
        let axis = mean_mps2.iamax();
        let off_deg = (mean_mps2[axis].abs() / mean_mps2.norm()).min(1.0).acos().to_degrees();
        if off_deg > MOST_OFF_AXIS_DEG {
            return Err(CalibrationProblem::OffAxis { pose: index + 1, off_deg });
        }
        groups[2 * axis + usize::from(mean_mps2[axis] < 0.0)].push(index + 1);
    }
    let missing: Vec<&str> =
        NAMES.iter().zip(&groups).filter(|(_, group)| group.is_empty()).map(|(n, _)| *n).collect();
    if !missing.is_empty() {
        return Err(CalibrationProblem::MissingPoses { missing: missing.join(", ") });
    }
    Ok(groups.map(|numbers| {
        let group: Vec<&Pose> = numbers.iter().map(|number| &poses[number - 1]).collect();
        (average(&group), numbers)
    }))
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

    /// The sums of the pairs show tilts that are not stated; the sigmas hold for them.
    #[test]
    fn tilts_that_are_not_stated_are_seen_in_the_data() {
        let levelling_sd_rad = 0.3f64.to_radians();
        let (_, b) = truth();
        let (mut variance, mut normalised) = (0.0, 0.0);
        for seed in 0..100 {
            let tilted = poses(seed, levelling_sd_rad);
            let found = levelling(&tilted, G, 0.0).unwrap().unwrap();
            variance += found.sd_rad.powi(2) / 100.0;
            let model = calibrate(&tilted, G, 0.0).unwrap();
            let error = (model.bias_mps2 - b).component_div(&model.bias_sd_mps2);
            normalised += error.norm_squared() / 300.0;
            assert_eq!(levelling(&tilted, G, 2.0 * levelling_sd_rad), Ok(None));
        }
        let sd_deg = variance.sqrt().to_degrees();
        println!(
            "0.3° of levelling, none stated: {sd_deg:.2}° found, bias (error/σ)² {normalised:.2}"
        );
        assert!((sd_deg / 0.3 - 1.0).abs() < 0.1, "{sd_deg}");
        assert!(normalised < 3.0, "{normalised}");
    }

    #[test]
    fn the_tilted_pair_is_named_and_a_pose_between_the_axes_refused() {
        let mut tilted = poses(1, 0.0);
        let (m, b) = truth();
        let turned = |deg: f64| {
            let (sin, cos) = deg.to_radians().sin_cos();
            m * Vector3::new(cos, sin, 0.0) * G + b
        };
        tilted[0].mean_mps2 = turned(2.0);
        let found = levelling(&tilted, G, 0.0).unwrap().unwrap();
        assert_eq!((found.worst, found.poses), ("x up and x down", vec![1, 2]));
        let mut more = poses(1, 0.0);
        more.push(Pose { mean_mps2: turned(44.0), ..more[0] });
        for problem in
            [calibrate(&more, G, 0.0).unwrap_err(), levelling(&more, G, 0.0).unwrap_err()]
        {
            assert!(
                problem.to_string().contains("pose 7 is 43° off the nearest axis"),
                "{problem}"
            );
        }
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
