//! What a triad of accelerometers does to the truth: y = M a + b.

use nalgebra::{Matrix3, Vector3};

/// A box set on one of its sides by eye, with a bias of 0.2 g.
pub(super) const MOST_OFF_AXIS_DEG: f64 = 20.0;

/// Scale, misalignment and bias of a triad, with 1 σ of each.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SensorModel {
    /// M: diagonal scale factors, the rest misalignment in rad.
    pub matrix: Matrix3<f64>,
    /// b, m/s².
    pub bias_mps2: Vector3<f64>,
    /// Standard deviations of M, element by element.
    pub matrix_sd: Matrix3<f64>,
    /// Standard deviations of b, m/s².
    pub bias_sd_mps2: Vector3<f64>,
}

/// A resting pose: mean of its samples and noise of that mean.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    /// Mean of the samples, m/s².
    pub mean_mps2: Vector3<f64>,
    /// Standard deviation of one sample, the largest of the three axes, m/s².
    pub sample_sd_mps2: f64,
    /// How many samples.
    pub samples: usize,
}

/// Why a calibration gives no result, in words that say what to do.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CalibrationProblem {
    /// Not every direction was measured.
    #[error(
        "poses are missing: {missing}; turn the sensor so that each of its axes points up once and down once, and rest a few seconds in each pose"
    )]
    MissingPoses {
        /// The axes and senses.
        missing: String,
    },
    /// Too few poses for the unknowns.
    #[error(
        "{found} resting poses, at least {needed} are needed, 12 to 24 are better; rest longer in each pose, or in more directions"
    )]
    TooFewPoses {
        /// Found.
        found: usize,
        /// Needed.
        needed: usize,
    },
    /// The poses do not determine all unknowns.
    #[error(
        "the poses are too much alike (condition {condition:.0}): spread them over all directions, upside down too"
    )]
    Alike {
        /// Condition number of the scaled normal equations.
        condition: f64,
    },
    /// The sensor moved.
    #[error(
        "motion in pose {pose}: its noise of {sample_sd_mps2:.3} m/s² is {ratio:.1} times that of the quiet poses; put the sensor on something firm and take this pose again"
    )]
    Motion {
        /// Number of the pose, from 1.
        pose: usize,
        /// Noise of one sample.
        sample_sd_mps2: f64,
        /// Against the median of all poses.
        ratio: f64,
    },
    /// The norm is that of another unit.
    #[error(
        "a resting accelerometer must read about {expected_mps2:.2} m/s², this one reads {found:.3}: the unit is probably {unit}; name it in the header of the file"
    )]
    WrongUnit {
        /// Median norm.
        found: f64,
        /// Local gravity.
        expected_mps2: f64,
        /// The likely unit.
        unit: &'static str,
    },
    /// The fit did not settle.
    #[error(
        "the fit did not converge ({residual_mps2:.3} m/s² left): check for motion in a pose, a saturated axis, or a wrong unit"
    )]
    NotConverged {
        /// Root mean square of what is left.
        residual_mps2: f64,
    },
    /// A value that is not a number.
    #[error("a sample is not a number")]
    NotFinite,
    /// A pose of nothing, or with a noise that is none.
    #[error(
        "pose {pose} has {samples} samples with a noise of {sample_sd_mps2} m/s²: at least one sample and a noise of 0 or more are expected"
    )]
    NoPose {
        /// Number of the pose, from 1.
        pose: usize,
        /// How many samples.
        samples: usize,
        /// Noise of one sample.
        sample_sd_mps2: f64,
    },
    /// A pose between the six directions.
    #[error(
        "pose {pose} is {off_deg:.0}° off the nearest axis of the sensor, at most {MOST_OFF_AXIS_DEG}° are expected of a box on one of its sides: leave that rest out, or calibrate by many poses (multi-pose)"
    )]
    OffAxis {
        /// Number of the pose, from 1.
        pose: usize,
        /// Angle between the reading and the nearest axis.
        off_deg: f64,
    },
    /// How well the box stood cannot be this.
    #[error("levelled to {levelling_deg}°, 0 to 28 expected")]
    Levelling {
        /// One standard deviation.
        levelling_deg: f64,
    },
}

impl SensorModel {
    /// a = M⁻¹ (y − b); `None` if M is singular.
    #[must_use]
    pub fn corrected(&self, reading_mps2: &Vector3<f64>) -> Option<Vector3<f64>> {
        Some(self.matrix.try_inverse()? * (reading_mps2 - self.bias_mps2))
    }

    /// The model with standard deviations that also hold an uncertainty of gravity: every element of M
    /// is in proportion to 1/g, the bias does not depend on it.
    #[must_use]
    pub fn with_gravity_sd(mut self, gravity_mps2: f64, gravity_sd_mps2: f64) -> Self {
        let common = self.matrix * (gravity_sd_mps2 / gravity_mps2);
        self.matrix_sd = self.matrix_sd.zip_map(&common, f64::hypot);
        self
    }

    /// Common deviation of the three scale factors from one, where it is clearly larger than their
    /// differences: as a wrong local gravity looks.
    #[must_use]
    pub fn suspected_gravity_error(&self) -> Option<f64> {
        let scale = self.matrix.diagonal();
        let common = scale.mean() - 1.0;
        let spread = scale.max() - scale.min();
        (common.abs() > 1e-3 && common.abs() > 5.0 * spread).then_some(common)
    }
}

impl Pose {
    /// Standard deviation of the mean, for white noise.
    #[must_use]
    pub fn mean_sd_mps2(&self) -> f64 {
        self.sample_sd_mps2 / (self.samples.max(1) as f64).sqrt()
    }
}

/// Refuses what no fit can repair: values that are not numbers, another unit, motion in a pose.
///
/// # Errors
///
/// [`CalibrationProblem`].
pub fn check_poses(poses: &[Pose], gravity_mps2: f64) -> Result<(), CalibrationProblem> {
    if !poses.iter().all(|pose| pose.mean_mps2.iter().all(|value| value.is_finite())) {
        return Err(CalibrationProblem::NotFinite);
    }
    for (index, &Pose { samples, sample_sd_mps2, .. }) in poses.iter().enumerate() {
        if samples == 0 || !(0.0..f64::INFINITY).contains(&sample_sd_mps2) {
            return Err(CalibrationProblem::NoPose { pose: index + 1, samples, sample_sd_mps2 });
        }
    }
    let norm = median(poses.iter().map(|pose| pose.mean_mps2.norm()).collect());
    if poses.is_empty() || (0.8..1.25).contains(&(norm / gravity_mps2)) {
        return check_motion(poses);
    }
    // A header of g over numbers in m/s² multiplies by g once too often.
    let squared = gravity_mps2 * gravity_mps2;
    let units = [
        (1.0, "g"),
        (1000.0, "mg"),
        (100.0 * gravity_mps2, "cm/s²"),
        (squared, "m/s², though the header says g"),
        (1e-3 * squared, "m/s², though the header says mg"),
    ];
    let off = |one_g: f64| (norm / one_g - 1.0).abs();
    let nearest = units.iter().min_by(|a, b| off(a.0).total_cmp(&off(b.0)));
    let likely = nearest.filter(|(one_g, _)| off(*one_g) < 0.2);
    let unit = likely.map_or("raw counts", |(_, unit)| unit);
    Err(CalibrationProblem::WrongUnit { found: norm, expected_mps2: gravity_mps2, unit })
}

fn check_motion(poses: &[Pose]) -> Result<(), CalibrationProblem> {
    let usual = median(poses.iter().map(|pose| pose.sample_sd_mps2).collect());
    for (index, pose) in poses.iter().enumerate() {
        let ratio = pose.sample_sd_mps2 / usual;
        if ratio > 5.0 {
            let sample_sd_mps2 = pose.sample_sd_mps2;
            return Err(CalibrationProblem::Motion { pose: index + 1, sample_sd_mps2, ratio });
        }
    }
    Ok(())
}

fn median(mut values: Vec<f64>) -> f64 {
    crate::median::median(&mut values).unwrap_or(f64::NAN)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pose(z: f64, sample_sd_mps2: f64) -> Pose {
        Pose { mean_mps2: Vector3::new(0.0, 0.0, z), sample_sd_mps2, samples: 100 }
    }

    #[test]
    fn problems_are_named() {
        let unit = |poses: &[Pose]| match check_poses(poses, 9.8) {
            Err(CalibrationProblem::WrongUnit { unit, .. }) => unit,
            other => panic!("{other:?}"),
        };
        assert_eq!(unit(&[pose(1.0, 0.1)]), "g");
        assert_eq!(unit(&[pose(-1003.0, 0.1)]), "mg");
        assert_eq!(unit(&[pose(982.0, 0.1)]), "cm/s²");
        assert_eq!(unit(&[pose(96.8, 0.1)]), "m/s², though the header says g");
        assert_eq!(unit(&[pose(16384.0, 0.1)]), "raw counts");
        let moved = [pose(9.8, 0.02), pose(-9.8, 0.02), pose(9.8, 0.5), pose(9.8, 0.02)];
        assert!(matches!(
            check_poses(&moved, 9.8),
            Err(CalibrationProblem::Motion { pose: 3, .. })
        ));
        assert_eq!(check_poses(&[pose(f64::NAN, 0.1)], 9.8), Err(CalibrationProblem::NotFinite));
        assert_eq!(check_poses(&moved[..2], 9.8), Ok(()));
        let nothing = [pose(9.8, 0.02), Pose { samples: 0, ..pose(9.8, 0.02) }];
        for poses in [
            &nothing[..],
            &[pose(9.8, 0.02), pose(9.8, -1.0)],
            &[pose(9.8, 0.02), pose(9.8, f64::NAN)],
        ] {
            let found = check_poses(poses, 9.8);
            assert!(matches!(found, Err(CalibrationProblem::NoPose { pose: 2, .. })), "{found:?}");
        }
    }
}
