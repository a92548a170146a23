//! What an engine will make of an array under a sky, before any observation: standard deviations of the
//! attitude, and how often it fixes an epoch.
//!
//! The standard deviations are those of the engine's own estimates for given baselines; the epochs are simulated and
//! go through its own searches and checks, so that nothing is promised which it would refuse.

use nalgebra::{DMatrix, Matrix3, Vector3};
use rand::RngExt;
use rand_xoshiro::Xoshiro256PlusPlus;

use crate::ambiguity::decorrelate::Decorrelation;
use crate::ambiguity::success_rate::bootstrapped_success_rate;
use crate::array::{AntennaArray, Shape, survey_covariance};
use crate::attitude::MeasuredLine;
use crate::attitude::installation::turn_covariance_rad2;
use crate::attitude::vertical::Vertical;
use crate::difference::Link;
use crate::engine::{Ambiguities, Estimator, Settings};
use crate::frames::{Attitude, Geodetic, Ned, Vector, skew};
use crate::signal::{Band, Satellite, Signal};
use crate::sky::Horizon;
use crate::solution::AttitudeEstimate;
use crate::time::GpsTime;

/// One satellite's signal as every antenna of the array will see it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sight {
    /// The satellite.
    pub satellite: Satellite,
    /// Unit vector from the receiver to it.
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

/// Predicted standard deviations, rad; absent for angles that the antennas do not see, or not well enough
/// ([`Settings::max_angle_sd_rad`]).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AttitudeAccuracy {
    /// Heading.
    pub heading_sd_rad: Option<f64>,
    /// Pitch.
    pub pitch_sd_rad: Option<f64>,
    /// Roll.
    pub roll_sd_rad: Option<f64>,
    /// Covariance of the rotation vector in body axes, rad²; zero about the line of collinear
    /// antennas.
    pub covariance_rad2: Matrix3<f64>,
}

/// What becomes of simulated epochs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SimulatedRate {
    /// Epochs fixed with the right integers.
    pub right: u32,
    /// Epochs fixed with wrong ones.
    pub wrong: u32,
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
/// which see `sights`, as an engine with these settings tells it; `None` without an array, or if the
/// satellites are too few or too close together.
///
/// The baselines from antenna 0 have the covariance `(I + 11ᵀ) ⊗ (N⁻¹ + s² I)`: `N` is the phase information of one
/// antenna's position with a free delay for each band, `s` how well each coordinate of the antennas is surveyed.
/// Antennas on one line leave a turn open, of which only a body that is level give or take
/// [`Settings::roll_sd_rad`] tells ([`crate::attitude::line`]).
#[must_use]
pub fn attitude_accuracy(
    settings: &Settings,
    attitude: &Attitude,
    sights: &[Sight],
) -> Option<AttitudeAccuracy> {
    let array = settings.array.as_ref()?;
    let position_m2 = checked_inverse(&position_information(sights, |sight| sight.phase_sd_m))?;
    let baselines_m: Vec<Vector3<f64>> = array.baselines_m().map(|b| b.xyz()).collect();
    let count = baselines_m.len();
    let shared = DMatrix::from_fn(count, count, |i, j| if i == j { 2.0 } else { 1.0 });
    let covariance_m2 =
        shared.kronecker(&position_m2) + survey_covariance(count, settings.array_sd_m);

    let ned_from_body = attitude.ned_from_body();
    let matrix = ned_from_body.matrix();
    let axis = (array.shape() == Shape::Collinear).then(|| array.baseline_m(count).direction());
    let line = axis.map(|axis| axis.xyz());
    let covariance_rad2 =
        turn_covariance_rad2(&baselines_m, &matrix, &covariance_m2, line.as_ref())?;
    let estimate = match axis {
        None => AttitudeEstimate::full(ned_from_body, &covariance_rad2),
        Some(axis) => {
            // ∂u = Q [θ]× e
            let by_turn = matrix * skew(&axis.xyz());
            let line = MeasuredLine {
                axis,
                direction: ned_from_body * axis,
                covariance_rad2: by_turn * covariance_rad2 * by_turn.transpose(),
            };
            let vertical = Vertical::level(settings.roll_sd_rad);
            AttitudeEstimate::of_line(&line, &vertical, &Matrix3::zeros())
        }
    };
    let estimate = estimate.certain_to(settings.max_angle_sd_rad);
    let sd_rad =
        |k: usize| estimate.angles_rad()[k].map(|_| estimate.covariance_rad2[(k, k)].sqrt());
    Some(AttitudeAccuracy {
        heading_sd_rad: sd_rad(0),
        pitch_sd_rad: sd_rad(1),
        roll_sd_rad: sd_rad(2),
        covariance_rad2,
    })
}

/// Covariance of the float ambiguities of one baseline of two such antennas from one epoch of code and phase,
/// cycles²; `None` if the satellites are too few.
///
/// Double differences to the first signal of each band. With code alone for the baseline, `Q_b = (Σ Gᵀ Q_P⁻¹ G)⁻¹`,
/// it is `Q_a = Λ⁻¹ (Q_Φ + G Q_b Gᵀ) Λ⁻¹`.
fn ambiguity_covariance(sights: &[Sight]) -> Option<DMatrix<f64>> {
    // Differences of two antennas: twice the variances.
    let code = position_information(sights, |sight| sight.code_sd_m) * 0.5;
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
    Some(phase_covariance + &geometry * baseline_covariance * geometry.transpose())
}

/// Bootstrapped success rate of one baseline from one epoch, without any constraint; `None` if the
/// satellites are too few.
#[must_use]
pub fn baseline_success_rate(sights: &[Sight]) -> Option<f64> {
    let mut decorrelation = Decorrelation::default();
    decorrelation.compute(&ambiguity_covariance(sights)?).ok()?;
    Some(bootstrapped_success_rate(decorrelation.conditional_variances()))
}

/// Time from one simulated epoch to the next, s: the usual one of receivers.
const INTERVAL_S: f64 = 1.0;

/// What an engine with these settings makes of `draws` epochs, each alone, of antennas that all see `sights`, with
/// nothing but noise: its own searches in its own work budget, and all its checks. `None` without an array, or if the
/// satellites are too few.
///
/// The epochs are a session: the engine begins with the noise of its settings and learns that of `sights`.
#[must_use]
pub fn simulated_success_rate(
    settings: &Settings,
    attitude: &Attitude,
    sights: &[Sight],
    draws: u32,
    random: &mut Xoshiro256PlusPlus,
) -> Option<SimulatedRate> {
    let array = settings.array.as_ref()?;
    let settings = Settings { ambiguities: Ambiguities::Instantaneous, ..settings.clone() };
    let horizon = Horizon::at(Geodetic::from_degrees(0.0, 0.0, 0.0).to_ecef());
    let noiseless = noiseless_links(array, attitude, sights, &settings, &horizon);
    let mut estimator = Estimator::new(settings).ok()?;
    let mut rate = SimulatedRate { right: 0, wrong: 0, draws };
    for epoch in 0..draws {
        let links = noiseless.iter().map(|(link, sight)| Link {
            code_m: link.code_m.map(|code_m| code_m + sight.code_sd_m * standard_normal(random)),
            phase_m: link
                .phase_m
                .map(|phase_m| phase_m + sight.phase_sd_m * standard_normal(random)),
            ..*link
        });
        let time = GpsTime::default() + INTERVAL_S * f64::from(epoch);
        let fixed = estimator.push_links(time, horizon, links.collect()).ok()?;
        // The true integers are zero.
        let is_right = fixed.map(|integers| integers.iter().all(|z| *z == 0.0));
        rate.right += u32::from(is_right == Some(true));
        rate.wrong += u32::from(is_right == Some(false));
    }
    (draws > 0).then_some(rate)
}

/// What each antenna observes of each satellite, less what is computed for one place of all antennas.
fn noiseless_links<'a>(
    array: &AntennaArray,
    attitude: &Attitude,
    sights: &'a [Sight],
    settings: &Settings,
    horizon: &Horizon,
) -> Vec<(Link, &'a Sight)> {
    let ecef_from_ned = horizon.ned_from_ecef().inverse();
    let ned_from_body = attitude.ned_from_body();
    let link = |antenna: usize, sight: &Sight| {
        let line_of_sight = ecef_from_ned * sight.direction;
        let direction = horizon.direction(line_of_sight);
        let range_m = -(ned_from_body * array.positions_m()[antenna]).dot(&sight.direction);
        Link {
            antenna,
            satellite: sight.satellite,
            signal: Signal { band: sight.band, attribute: b'C' },
            code_m: Some(range_m),
            phase_m: Some(range_m),
            whole_cycles: 0.0,
            common_sd_cycles: settings.noise.common_cycles(sight.wavelength_m),
            wavelength_m: sight.wavelength_m,
            variances: settings.noise.variances(sight.band, direction.sin_elevation(), None),
            cn0_dbhz: None,
            missing_db: 0.0,
            bands: 1,
            gradient: -line_of_sight.xyz(),
            direction,
        }
    };
    let of_antenna = |antenna| sights.iter().map(move |sight| (link(antenna, sight), sight));
    (0..array.len()).flat_map(of_antenna).collect()
}

/// A standard normal number, by Box and Muller.
fn standard_normal(random: &mut Xoshiro256PlusPlus) -> f64 {
    // 1 − u lies in (0, 1], so that the logarithm is finite.
    let [radius, angle] = [random.random::<f64>(), random.random::<f64>()];
    (-2.0 * (1.0 - radius).ln()).sqrt() * (core::f64::consts::TAU * angle).cos()
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
    use crate::engine::Constraint;
    use crate::signal::System;
    use nalgebra::DVector;
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
                    let satellite =
                        Satellite { system: band.system, number: u8::try_from(k).unwrap() + 1 };
                    sights.push(Sight {
                        satellite,
                        direction,
                        band,
                        wavelength_m,
                        code_sd_m,
                        phase_sd_m,
                    });
                }
            }
        }
        sights
    }

    /// An engine that knows these antennas without error.
    fn exactly(positions_m: &[[f64; 3]]) -> Settings {
        let places = positions_m.iter().map(|[x, y, z]| Vector::new(*x, *y, *z));
        Settings {
            antennas: positions_m.len(),
            array: Some(AntennaArray::new(places.collect()).unwrap()),
            constraint: if positions_m.len() == 2 { Constraint::Length } else { Constraint::Array },
            array_sd_m: 0.0,
            ..Settings::default()
        }
    }

    fn roof() -> Settings {
        exactly(&[[0.0; 3], [1.5, 0.1, 0.2], [0.0, 1.0, -0.1], [1.4, 1.1, 0.0]])
    }

    /// The formula against plain least squares: undifferenced phases of all antennas, unknown delays
    /// of every satellite signal and of every antenna and band, three angles by central differences.
    #[test]
    fn accuracy_is_that_of_least_squares() {
        let (sights, settings) = (sky(), roof());
        let array = settings.array.clone().unwrap();
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
        let found = attitude_accuracy(&settings, &attitude, &sights).unwrap();
        for (angle, sd_rad) in [found.heading_sd_rad, found.pitch_sd_rad, found.roll_sd_rad]
            .into_iter()
            .map(Option::unwrap)
            .enumerate()
        {
            let expected = covariance[(angle, angle)].sqrt();
            assert!((sd_rad / expected - 1.0).abs() < 1e-6, "{angle}: {sd_rad} {expected}");
        }
    }

    /// Two antennas along the body: heading and pitch are those of the line, however the body rolls about it.
    #[test]
    fn a_line_has_heading_and_pitch() {
        let line = exactly(&[[0.0; 3], [2.0, 0.0, 0.0]]);
        let at = |roll_rad| Attitude { heading_rad: 2.0, pitch_rad: 0.2, roll_rad };
        // The baseline's covariance across the line, seen from 2 m away.
        let normal = position_information(&sky(), |sight| sight.phase_sd_m) * 0.5;
        let u = at(0.0).ned_from_body() * Vector::new(1.0, 0.0, 0.0);
        let east = Vector3::new(-u.xyz().y, u.xyz().x, 0.0).normalize();
        let up = east.cross(&u.xyz());
        let across = nalgebra::Matrix3x2::from_columns(&[east, up]);
        let covariance = (across.transpose() * normal * across).try_inverse().unwrap();
        let heading = covariance[(0, 0)].sqrt() / (2.0 * 0.2_f64.cos());
        let pitch = covariance[(1, 1)].sqrt() / 2.0;
        for roll_rad in [0.0, 1.0] {
            let found = attitude_accuracy(&line, &at(roll_rad), &sky()).unwrap();
            assert_eq!(found.roll_sd_rad, None);
            assert!((found.heading_sd_rad.unwrap() / heading - 1.0).abs() < 1e-6);
            assert!((found.pitch_sd_rad.unwrap() / pitch - 1.0).abs() < 1e-6);
        }
    }

    /// A line that rises on the body: what `roll_sd_rad` allows of the turn about it goes into the heading; along the
    /// vertical there is none.
    #[test]
    fn the_unseen_roll_is_part_of_the_heading() {
        let level = Attitude { heading_rad: 0.7, pitch_rad: 0.0, roll_rad: 0.0 };
        let accuracy =
            |line_m: [f64; 3]| attitude_accuracy(&exactly(&[[0.0; 3], line_m]), &level, &sky());
        let rising = accuracy([1.0, 0.0, -0.2]).unwrap();
        let (flat, found) = (
            accuracy([1.0, 0.0, 0.0]).unwrap().heading_sd_rad.unwrap(),
            rising.heading_sd_rad.unwrap(),
        );
        let expected = flat.hypot(0.2 * 5f64.to_radians());
        assert!((found / expected - 1.0).abs() < 0.03, "{found} {expected}");
        let upright = accuracy([0.0, 0.0, -1.0]).unwrap();
        assert_eq!([upright.heading_sd_rad, upright.pitch_sd_rad, upright.roll_sd_rad], [None; 3]);
    }

    /// Two antennas 1 m apart, each of them surveyed to 5 mm: √2 · 5 mrad across the line.
    #[test]
    fn the_survey_is_part_of_the_angles() {
        let level = Attitude { heading_rad: 0.7, pitch_rad: 0.0, roll_rad: 0.0 };
        let exact = exactly(&[[0.0; 3], [1.0, 0.0, 0.0]]);
        let surveyed = Settings { array_sd_m: 0.005, ..exact.clone() };
        let heading =
            |settings| attitude_accuracy(settings, &level, &sky()).unwrap().heading_sd_rad.unwrap();
        let expected = heading(&exact).hypot(2f64.sqrt() * 0.005);
        let found = heading(&surveyed);
        // The length is known less well too, and with it what the noise has in common along and across.
        assert!((found / expected - 1.0).abs() < 0.03, "{found} {expected}");
    }

    /// The ambiguities against the inverse of the whole normal matrix.
    #[test]
    fn the_ambiguities_are_those_of_least_squares() {
        let sights = sky();
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
        let covariance = normal.try_inverse().unwrap();
        let found = ambiguity_covariance(&sights).unwrap();
        let error = covariance.view((0, 0), (count, count)) - found;
        assert!(error.norm() < 1e-8 * covariance.norm());
    }

    fn of_band(band: Band) -> Vec<Sight> {
        sky().into_iter().filter(|s| s.band == band).collect()
    }

    /// All bands are fixed, and rightly. Of one noisy band the nearest integers that fit to the array are often right,
    /// but no engine would believe them.
    #[test]
    fn epochs_count_that_an_engine_accepts() {
        let weak = of_band(Band::new(System::Gps, 1));
        let mut random = Xoshiro256PlusPlus::seed_from_u64(60);
        let mut rate = |sights: &[Sight]| {
            let attitude = Attitude { heading_rad: 0.7, pitch_rad: 0.0, roll_rad: 0.0 };
            simulated_success_rate(&roof(), &attitude, sights, 100, &mut random).unwrap()
        };
        let (all, weak) = (rate(&sky()), rate(&weak));
        assert!(all.rate() > 0.9 && weak.rate() < 0.2, "{all:?} {weak:?}");
        assert!(all.wrong + weak.wrong <= 1, "{all:?} {weak:?}");
    }

    /// Newcombe (1998), table I: 81 of 263 and 15 of 148, none of 20.
    #[test]
    fn intervals_of_shares() {
        for (right, draws, [low, high]) in
            [(81, 263, [0.2553, 0.3662]), (15, 148, [0.0624, 0.1605]), (0, 20, [0.0, 0.1611])]
        {
            let found = SimulatedRate { right, wrong: 0, draws }.interval();
            assert!((found[0] - low).abs() < 1e-4 && (found[1] - high).abs() < 1e-4, "{found:?}");
        }
    }

    #[test]
    fn too_few_satellites_have_no_accuracy() {
        let attitude = Attitude { heading_rad: 0.0, pitch_rad: 0.0, roll_rad: 0.0 };
        for count in 0..3 {
            let few = &of_band(Band::new(System::Gps, 1))[..count];
            assert_eq!(attitude_accuracy(&roof(), &attitude, few), None);
            assert_eq!(baseline_success_rate(few), None);
            let mut random = Xoshiro256PlusPlus::seed_from_u64(60);
            let simulated = simulated_success_rate(&roof(), &attitude, few, 3, &mut random);
            assert_eq!(simulated, None);
        }
    }
}
