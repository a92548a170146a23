//! What accuracy an array will have under a sky, before any observation: standard deviations of the
//! attitude and the chance to find the integers.

use nalgebra::{DMatrix, DVector, Matrix3, Vector3};
use rand::RngExt;
use rand_xoshiro::Xoshiro256PlusPlus;

use crate::ambiguity::MixedFloat;
use crate::ambiguity::array_constrained::ArrayConstrained;
use crate::ambiguity::decorrelate::Decorrelation;
use crate::ambiguity::length_constrained::LengthConstrained;
use crate::ambiguity::sphere::Length;
use crate::ambiguity::success_rate::bootstrapped_success_rate;
use crate::array::{AntennaArray, Shape};
use crate::attitude::angles::angle_covariance;
use crate::frames::{Attitude, Body, Ned, Vector, skew};
use crate::signal::Band;

/// One satellite's signal as every antenna of the array will see it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sight {
    /// Unit vector from the receiver to the satellite.
    pub direction: Vector<Ned>,
    /// The band; signals of one band share the receiver's delay, which is not known.
    pub band: Band,
    /// Carrier wavelength.
    pub wavelength_m: f64,
    /// Standard deviation of one antenna's code observation.
    pub code_sd_m: f64,
    /// Standard deviation of one antenna's phase observation.
    pub phase_sd_m: f64,
}

/// Predicted standard deviations, rad. Roll is absent for antennas on one line: heading and pitch are
/// then those of the line.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AttitudeAccuracy {
    /// Heading.
    pub heading_sd_rad: f64,
    /// Pitch.
    pub pitch_sd_rad: f64,
    /// Roll.
    pub roll_sd_rad: Option<f64>,
    /// Covariance of the rotation vector in body axes, rad²; zero about the line of collinear
    /// antennas.
    pub covariance_rad2: Matrix3<f64>,
}

/// A simulation ends early when the search has given up in so many epochs: each of them uses up its
/// whole work budget.
const MAX_GIVEN_UP: u32 = 5;

/// How often simulated epochs gave the right integers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SimulatedRate {
    /// Epochs with the right integers.
    pub right: u32,
    /// All epochs, at least one.
    pub draws: u32,
}

impl SimulatedRate {
    /// `right / draws`.
    #[must_use]
    pub fn rate(self) -> f64 {
        f64::from(self.right) / f64::from(self.draws)
    }

    /// 95 % interval of the probability (Wilson 1927):
    /// `(p + z²/2n ± z √(p (1 − p)/n + z²/4n²)) / (1 + z²/n)`.
    #[must_use]
    pub fn interval(self) -> [f64; 2] {
        const Z: f64 = 1.96;
        let (p, n) = (self.rate(), f64::from(self.draws));
        let z2 = Z * Z / n;
        let half = Z * (p * (1.0 - p) / n + z2 / (4.0 * n)).sqrt();
        [p + 0.5 * z2 - half, p + 0.5 * z2 + half].map(|edge| (edge / (1.0 + z2)).clamp(0.0, 1.0))
    }
}

/// Accuracy of the attitude with fixed integers and the full covariance of all antennas, all of
/// which see `sights`; `None` if the satellites are too few or too close together.
///
/// `I = Σ_a [p_a − p̄]×ᵀ Qᵀ N Q [p_a − p̄]×`, Q = `ned_from_body`, N the phase information of one
/// antenna's position with a free delay for each band.
#[must_use]
pub fn attitude_accuracy(
    array: &AntennaArray,
    attitude: &Attitude,
    sights: &[Sight],
) -> Option<AttitudeAccuracy> {
    let ned_from_body = attitude.ned_from_body().matrix();
    let normal = position_information(sights, |sight| sight.phase_sd_m);
    let normal_body = ned_from_body.transpose() * normal * ned_from_body;
    let positions = array.positions_m();
    let centroid = positions.iter().map(|b| b.xyz()).sum::<Vector3<f64>>() / array.len() as f64;
    let information: Matrix3<f64> = positions
        .iter()
        .map(|p| skew(&(p.xyz() - centroid)))
        .map(|lever| lever.transpose() * normal_body * lever)
        .sum();
    if array.shape() == Shape::Collinear {
        return line_accuracy(&array.baseline_m(array.len() - 1), &ned_from_body, &information);
    }
    let covariance_rad2 = checked_inverse(&information)?;
    let angles = angle_covariance(attitude, &covariance_rad2);
    Some(AttitudeAccuracy {
        heading_sd_rad: angles[(0, 0)].sqrt(),
        pitch_sd_rad: angles[(1, 1)].sqrt(),
        roll_sd_rad: Some(angles[(2, 2)].sqrt()),
        covariance_rad2,
    })
}

/// Heading and pitch of a line of antennas; the rotation about it is left out.
fn line_accuracy(
    line: &Vector<Body>,
    ned_from_body: &Matrix3<f64>,
    information: &Matrix3<f64>,
) -> Option<AttitudeAccuracy> {
    let axis = line.xyz().normalize();
    // With the information about the axis made 1 and decoupled, the inverse is that of the others.
    let across = Matrix3::identity() - axis * axis.transpose();
    let scale = information.trace();
    let completed = across * information * across + axis * axis.transpose() * scale;
    let covariance_rad2 = across * checked_inverse(&completed)? * across;

    let u = ned_from_body * axis;
    let horizontal = u.x.hypot(u.y);
    // δu = −[u]× θ;  δheading = east-of-u · δu / cos p,  δpitch = up-of-u · δu
    let covariance_ned = ned_from_body * covariance_rad2 * ned_from_body.transpose();
    let direction = skew(&u) * covariance_ned * skew(&u).transpose();
    let east = Vector3::new(-u.y, u.x, 0.0) / horizontal;
    let up = east.cross(&u);
    Some(AttitudeAccuracy {
        heading_sd_rad: east.dot(&(direction * east)).sqrt() / horizontal,
        pitch_sd_rad: up.dot(&(direction * up)).sqrt(),
        roll_sd_rad: None,
        covariance_rad2,
    })
}

/// Float solution of one baseline of two such antennas from one epoch of code and phase, with the
/// true values taken as zero; `None` if the satellites are too few.
///
/// Double differences to the first signal of each band. With code alone for the baseline,
/// `Q_b = (Σ Gᵀ Q_P⁻¹ G)⁻¹`, the ambiguities have `Q_a = Λ⁻¹ (Q_Φ + G Q_b Gᵀ) Λ⁻¹` and
/// `Q_ba = −Q_b Gᵀ Λ⁻¹`; given the integers the baseline has `(Q_b⁻¹ + Gᵀ Q_Φ⁻¹ G)⁻¹`.
#[must_use]
pub fn baseline_float(sights: &[Sight]) -> Option<MixedFloat> {
    // Differences of two antennas: twice the variances.
    let code = position_information(sights, |sight| sight.code_sd_m) * 0.5;
    let phase = position_information(sights, |sight| sight.phase_sd_m) * 0.5;
    let baseline_covariance = checked_inverse(&code)?;
    let pairs = double_differences(sights);
    let (count, reference_of) = (pairs.len(), |row: usize| &sights[pairs[row].1]);
    let geometry = DMatrix::from_fn(count, 3, |row, axis| {
        let gradient = reference_of(row).direction - sights[pairs[row].0].direction;
        gradient.xyz()[axis] / reference_of(row).wavelength_m
    });
    let phase_covariance = DMatrix::from_fn(count, count, |row, column| {
        let shared = if pairs[row].1 == pairs[column].1 {
            2.0 * reference_of(row).phase_sd_m.powi(2)
        } else {
            0.0
        };
        let own = if row == column { 2.0 * sights[pairs[row].0].phase_sd_m.powi(2) } else { 0.0 };
        (shared + own) / (reference_of(row).wavelength_m * reference_of(column).wavelength_m)
    });
    let cross = -(baseline_covariance * geometry.transpose());
    let conditional = checked_inverse(&(code + phase))?;
    Some(MixedFloat {
        ambiguities: DVector::zeros(count),
        ambiguity_covariance: phase_covariance
            + &geometry * baseline_covariance * geometry.transpose(),
        reals_m: DVector::zeros(3),
        real_covariance_m2: DMatrix::from_fn(3, 3, |i, j| baseline_covariance[(i, j)]),
        cross_covariance: DMatrix::from_fn(3, count, |i, j| cross[(i, j)]),
        conditional_covariance_m2: DMatrix::from_fn(3, 3, |i, j| conditional[(i, j)]),
    })
}

/// Bootstrapped success rate of one baseline from one epoch, without any constraint; `None` if the
/// satellites are too few.
#[must_use]
pub fn baseline_success_rate(sights: &[Sight]) -> Option<f64> {
    let float = baseline_float(sights)?;
    let mut decorrelation = Decorrelation::default();
    decorrelation.compute(&float.ambiguity_covariance).ok()?;
    Some(bootstrapped_success_rate(decorrelation.conditional_variances()))
}

/// In how many of `draws` simulated epochs the search with the known length finds the integers of one
/// baseline; where it gives up it does not. `None` if the satellites are too few.
#[must_use]
pub fn length_constrained_success_rate(
    sights: &[Sight],
    baseline_m: &Vector<Ned>,
    length_sd_m: f64,
    draws: u32,
    random: &mut Xoshiro256PlusPlus,
) -> Option<SimulatedRate> {
    let length = Length { length_m: baseline_m.norm(), sd_m: length_sd_m };
    let truth_m = DVector::from_column_slice(baseline_m.xyz().as_slice());
    let mut search = LengthConstrained::default();
    count_right_integers(&baseline_float(sights)?, &truth_m, draws, random, |float| {
        Some(search.solve(float, length, 1).ok()?.into_iter().next()?.integers)
    })
}

/// In how many of `draws` simulated epochs the search with the known array finds all integers of it; where it
/// gives up it does not. `None` if the satellites are too few.
#[must_use]
pub fn array_constrained_success_rate(
    array: &AntennaArray,
    attitude: &Attitude,
    sights: &[Sight],
    array_sd_m: f64,
    draws: u32,
    random: &mut Xoshiro256PlusPlus,
) -> Option<SimulatedRate> {
    let of_one = baseline_float(sights)?;
    let count = array.len() - 1;
    // Antenna 0 is in every difference: K = ½ (I + 11ᵀ), all covariances are K ⊗ those of one.
    let shared = DMatrix::from_fn(count, count, |i, j| if i == j { 1.0 } else { 0.5 });
    let float = MixedFloat {
        ambiguities: DVector::zeros(count * of_one.ambiguities.len()),
        ambiguity_covariance: shared.kronecker(&of_one.ambiguity_covariance),
        reals_m: DVector::zeros(3 * count),
        real_covariance_m2: shared.kronecker(&of_one.real_covariance_m2),
        cross_covariance: shared.kronecker(&of_one.cross_covariance),
        conditional_covariance_m2: shared.kronecker(&of_one.conditional_covariance_m2),
    };
    let ned_from_body = attitude.ned_from_body();
    let body_m: Vec<Vector3<f64>> = array.baselines_m().map(|b| b.xyz()).collect();
    let components = (1..=count).flat_map(|j| {
        let baseline_m = (ned_from_body * array.baseline_m(j)).xyz();
        [baseline_m.x, baseline_m.y, baseline_m.z]
    });
    let truth_m = DVector::from_iterator(3 * count, components);
    let ambiguities_of = vec![of_one.ambiguities.len(); count];
    let mut search = ArrayConstrained::default();
    count_right_integers(&float, &truth_m, draws, random, |float| {
        let best = search.solve(float.clone(), &ambiguities_of, &body_m, array_sd_m, 1).ok()?;
        Some(best.into_iter().next()?.integers)
    })
}

/// Draws float solutions about the true baselines and zero integers, and counts how often `search`
/// answers zero.
fn count_right_integers(
    model: &MixedFloat,
    truth_m: &DVector<f64>,
    draws: u32,
    random: &mut Xoshiro256PlusPlus,
    mut search: impl FnMut(&MixedFloat) -> Option<Vec<i64>>,
) -> Option<SimulatedRate> {
    let ambiguity_cholesky = model.ambiguity_covariance.clone().cholesky()?;
    let gains = ambiguity_cholesky.solve(&model.cross_covariance.transpose()).transpose();
    let ambiguity_factor = ambiguity_cholesky.unpack();
    let conditional_factor = model.conditional_covariance_m2.clone().cholesky()?.unpack();
    let mut rate = SimulatedRate { right: 0, draws: 0 };
    let mut given_up = 0;
    while rate.draws < draws && given_up < MAX_GIVEN_UP {
        // â = Q_a^½ n,  b̂ = b + Q_ba Q_a⁻¹ â + Q_b|a^½ n
        let ambiguities = &ambiguity_factor * standard_normal(ambiguity_factor.nrows(), random);
        let given = &conditional_factor * standard_normal(conditional_factor.nrows(), random);
        let reals_m = truth_m + &gains * &ambiguities + given;
        let integers = search(&MixedFloat { ambiguities, reals_m, ..model.clone() });
        given_up += u32::from(integers.is_none());
        rate.right += u32::from(integers.is_some_and(|integers| integers.iter().all(|z| *z == 0)));
        rate.draws += 1;
    }
    (rate.draws > 0).then_some(rate)
}

/// Independent standard normal numbers, by Box and Muller.
fn standard_normal(count: usize, random: &mut Xoshiro256PlusPlus) -> DVector<f64> {
    DVector::from_fn(count, |_, _| {
        // 1 − u lies in (0, 1], so that the logarithm is finite.
        let [radius, angle] = [random.random::<f64>(), random.random::<f64>()];
        (-2.0 * (1.0 - radius).ln()).sqrt() * (core::f64::consts::TAU * angle).cos()
    })
}

/// Information about a position (m⁻²) from one observation of each signal with a free delay for each
/// band: `Σ w u uᵀ` about the weighted mean direction of the band.
fn position_information(sights: &[Sight], sd_m: impl Fn(&Sight) -> f64) -> Matrix3<f64> {
    let mut total = Matrix3::zeros();
    for (first, sight) in sights.iter().enumerate() {
        let starts_band = sights[..first].iter().all(|earlier| earlier.band != sight.band);
        if !starts_band {
            continue;
        }
        let of_band = || sights[first..].iter().filter(|other| other.band == sight.band);
        let weight = |s: &Sight| sd_m(s).powi(-2);
        let sum: f64 = of_band().map(weight).sum();
        let mean = of_band().map(|s| s.direction.xyz() * weight(s)).sum::<Vector3<f64>>() / sum;
        for other in of_band() {
            let about_mean = other.direction.xyz() - mean;
            total += about_mean * about_mean.transpose() * weight(other);
        }
    }
    total
}

/// Pairs of indices (signal, reference signal): the reference is the first one of each band.
fn double_differences(sights: &[Sight]) -> Vec<(usize, usize)> {
    let reference = |k: usize| sights.iter().position(|other| other.band == sights[k].band);
    let with_reference = (0..sights.len()).filter_map(|k| Some((k, reference(k)?)));
    with_reference.filter(|(k, first)| k != first).collect()
}

/// Inverse of a symmetric positive matrix that is not singular to rounding.
fn checked_inverse(matrix: &Matrix3<f64>) -> Option<Matrix3<f64>> {
    let eigenvalues = matrix.symmetric_eigenvalues();
    let regular = eigenvalues.min() > 1e-9 * eigenvalues.max() && eigenvalues.max().is_finite();
    if regular { matrix.try_inverse() } else { None }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::signal::System;
    use rand::SeedableRng;

    /// Eight satellites on two bands of one system and four on another, unevenly spread.
    fn sky() -> Vec<Sight> {
        let directions = (0..8).map(|k| {
            let azimuth = 0.8 * f64::from(k) + 0.3 * f64::from(k % 3);
            let elevation: f64 = 0.25 + 0.16 * f64::from(k);
            (azimuth, elevation)
        });
        let mut sights = Vec::new();
        for (k, (azimuth, elevation)) in directions.enumerate() {
            let direction = Vector::new(
                elevation.cos() * azimuth.cos(),
                elevation.cos() * azimuth.sin(),
                -elevation.sin(),
            );
            for (band, wavelength_m) in [
                (Band::new(System::Gps, 1), 0.1903),
                (Band::new(System::Gps, 2), 0.2442),
                (Band::new(System::Galileo, 5), 0.2548),
            ] {
                if band.system == System::Gps || k % 2 == 0 {
                    let noise = 1.0 + 0.5 / elevation.sin();
                    let (code_sd_m, phase_sd_m) = (0.3 * noise, 0.003 * noise);
                    sights.push(Sight { direction, band, wavelength_m, code_sd_m, phase_sd_m });
                }
            }
        }
        sights
    }

    fn roof() -> AntennaArray {
        let positions = [[0.0; 3], [1.5, 0.1, 0.2], [0.0, 1.0, -0.1], [1.4, 1.1, 0.0]];
        AntennaArray::new(positions.iter().map(|[x, y, z]| Vector::new(*x, *y, *z)).collect())
            .unwrap()
    }

    /// The formula against plain least squares: undifferenced phases of all antennas, unknown delays
    /// of every satellite signal and of every antenna and band, three angles by central differences.
    #[test]
    fn accuracy_is_that_of_least_squares() {
        let (sights, array) = (sky(), roof());
        let attitude = Attitude { heading_rad: 0.7, pitch_rad: 0.1, roll_rad: -0.2 };
        let bands: Vec<Band> = sights.iter().map(|s| s.band).collect();
        let mut distinct = bands.clone();
        distinct.dedup();
        distinct.sort_unstable();
        distinct.dedup();
        let (antennas, signals) = (array.len(), sights.len());
        let unknowns = 3 + signals + antennas * distinct.len();
        let range = |antenna: usize, sight: &Sight, angles: [f64; 3]| {
            let [heading_rad, pitch_rad, roll_rad] = angles;
            let rotation = Attitude { heading_rad, pitch_rad, roll_rad }.ned_from_body();
            -(rotation * array.positions_m()[antenna]).dot(&sight.direction)
        };
        let mut design = DMatrix::zeros(antennas * signals, unknowns);
        for antenna in 0..antennas {
            for (k, sight) in sights.iter().enumerate() {
                let row = antenna * signals + k;
                let scale = 1.0 / sight.phase_sd_m;
                for angle in 0..3 {
                    let step = 1e-5;
                    let mut at = [attitude.heading_rad, attitude.pitch_rad, attitude.roll_rad];
                    at[angle] += step;
                    let above = range(antenna, sight, at);
                    at[angle] -= 2.0 * step;
                    let below = range(antenna, sight, at);
                    design[(row, angle)] = scale * (above - below) / (2.0 * step);
                }
                design[(row, 3 + k)] = scale;
                let band = distinct.iter().position(|band| *band == sight.band).unwrap();
                design[(row, 3 + signals + antenna * distinct.len() + band)] = scale;
            }
        }
        let covariance = (design.transpose() * &design).pseudo_inverse(1e-6).unwrap();
        let found = attitude_accuracy(&array, &attitude, &sights).unwrap();
        for (angle, sd_rad) in
            [found.heading_sd_rad, found.pitch_sd_rad, found.roll_sd_rad.unwrap()]
                .into_iter()
                .enumerate()
        {
            let expected = covariance[(angle, angle)].sqrt();
            assert!((sd_rad / expected - 1.0).abs() < 1e-6, "{angle}: {sd_rad} {expected}");
        }
    }

    /// Two antennas: the line's heading and pitch do not depend on how the body rolls about it, and
    /// are those of a third antenna array that is nearly a line.
    #[test]
    fn a_line_has_heading_and_pitch() {
        let line = AntennaArray::new(vec![Vector::new(0.0, 0.0, 0.0), Vector::new(2.0, 0.0, 0.0)])
            .unwrap();
        let at = |roll_rad| Attitude { heading_rad: 2.0, pitch_rad: 0.2, roll_rad };
        let level = attitude_accuracy(&line, &at(0.0), &sky()).unwrap();
        let rolled = attitude_accuracy(&line, &at(1.0), &sky()).unwrap();
        assert_eq!(level.roll_sd_rad, None);
        assert!((level.heading_sd_rad / rolled.heading_sd_rad - 1.0).abs() < 1e-9);
        assert!((level.pitch_sd_rad / rolled.pitch_sd_rad - 1.0).abs() < 1e-9);
        // The baseline's covariance across the line, seen from 2 m away.
        let normal = position_information(&sky(), |sight| sight.phase_sd_m) * 0.5;
        let u = at(0.0).ned_from_body() * Vector::new(1.0, 0.0, 0.0);
        let east = Vector3::new(-u.xyz().y, u.xyz().x, 0.0).normalize();
        let up = east.cross(&u.xyz());
        let across = nalgebra::Matrix3x2::from_columns(&[east, up]);
        let covariance = (across.transpose() * normal * across).try_inverse().unwrap();
        let heading = covariance[(0, 0)].sqrt() / (2.0 * 0.2_f64.cos());
        assert!((level.heading_sd_rad / heading - 1.0).abs() < 1e-9);
        assert!((level.pitch_sd_rad / (covariance[(1, 1)].sqrt() / 2.0) - 1.0).abs() < 1e-9);
    }

    /// The float solution against the inverse of its whole normal matrix.
    #[test]
    fn the_float_solution_is_that_of_least_squares() {
        let sights = sky();
        let float = baseline_float(&sights).unwrap();
        let pairs = double_differences(&sights);
        let count = pairs.len();
        let difference = DMatrix::from_fn(count, sights.len(), |row, k| {
            f64::from(u8::from(pairs[row].0 == k)) - f64::from(u8::from(pairs[row].1 == k))
        });
        let weight = |sd: fn(&Sight) -> f64| {
            let diagonal = DVector::from_fn(sights.len(), |k, _| 2.0 * sd(&sights[k]).powi(2));
            let covariance =
                &difference * DMatrix::from_diagonal(&diagonal) * difference.transpose();
            covariance.try_inverse().unwrap()
        };
        let geometry =
            -&difference * DMatrix::from_fn(sights.len(), 3, |k, i| sights[k].direction.xyz()[i]);
        let wavelengths = DMatrix::from_diagonal(&DVector::from_fn(count, |row, _| {
            sights[pairs[row].0].wavelength_m
        }));
        let (code, phase) = (weight(|s| s.code_sd_m), weight(|s| s.phase_sd_m));
        let mut normal = DMatrix::zeros(count + 3, count + 3);
        let couple = &wavelengths * &phase * &geometry;
        normal.view_mut((0, 0), (count, count)).copy_from(&(&wavelengths * &phase * &wavelengths));
        normal.view_mut((0, count), (count, 3)).copy_from(&couple);
        normal.view_mut((count, 0), (3, count)).copy_from(&couple.transpose());
        normal
            .view_mut((count, count), (3, 3))
            .copy_from(&(geometry.transpose() * (&code + &phase) * &geometry));
        let conditional = normal.view((count, count), (3, 3)).into_owned().try_inverse().unwrap();
        let covariance = normal.try_inverse().unwrap();
        let scale = covariance.norm();
        let of_ambiguities = covariance.view((0, 0), (count, count)) - &float.ambiguity_covariance;
        assert!(of_ambiguities.norm() < 1e-8 * scale);
        let cross = covariance.view((count, 0), (3, count)) - &float.cross_covariance;
        assert!(cross.norm() < 1e-8 * scale);
        let given = conditional - &float.conditional_covariance_m2;
        assert!(given.norm() < 1e-9 * float.conditional_covariance_m2.norm());
    }

    /// The known length helps, and both rates are probabilities.
    #[test]
    fn a_known_length_helps() {
        let sights: Vec<Sight> =
            sky().into_iter().filter(|s| s.band == Band::new(System::Gps, 1)).collect();
        let free = baseline_success_rate(&sights).unwrap();
        let mut random = Xoshiro256PlusPlus::seed_from_u64(60);
        let baseline_m = Vector::new(0.8, 0.6, 0.0);
        let constrained =
            length_constrained_success_rate(&sights, &baseline_m, 0.002, 300, &mut random);
        let constrained = constrained.unwrap().rate();
        assert!(free > 0.01 && free < 0.9, "{free}");
        assert!(constrained > free + 0.1 && constrained <= 1.0, "{free} {constrained}");
        let attitude = Attitude { heading_rad: 0.7, pitch_rad: 0.0, roll_rad: 0.0 };
        let whole =
            array_constrained_success_rate(&roof(), &attitude, &sights, 0.002, 50, &mut random);
        let whole = whole.unwrap().rate();
        assert!(whole > constrained - 0.1 && whole <= 1.0, "{constrained} {whole}");
    }

    /// Newcombe (1998), table I: 81 of 263 and 15 of 148, none of 20.
    #[test]
    fn intervals_of_shares() {
        for (right, draws, [low, high]) in
            [(81, 263, [0.2553, 0.3662]), (15, 148, [0.0624, 0.1605]), (0, 20, [0.0, 0.1611])]
        {
            let found = SimulatedRate { right, draws }.interval();
            assert!((found[0] - low).abs() < 1e-4 && (found[1] - high).abs() < 1e-4, "{found:?}");
        }
    }

    #[test]
    fn too_few_satellites_have_no_accuracy() {
        let attitude = Attitude { heading_rad: 0.0, pitch_rad: 0.0, roll_rad: 0.0 };
        for count in 0..3 {
            let few: Vec<Sight> = sky()
                .into_iter()
                .filter(|s| s.band == Band::new(System::Gps, 1))
                .take(count)
                .collect();
            assert_eq!(attitude_accuracy(&roof(), &attitude, &few), None);
            assert_eq!(baseline_success_rate(&few), None);
        }
    }
}
