//! Standard deviations three ways: from the information matrix (2), which is
//! [`Estimate::covariance_m2`](super::least_squares::Estimate), from the linearised closed form (4),
//! and from stochastic modelling (5), (6).
//!
//! The first two agree identically for three measurements (∂F/∂Y = Z⁻¹ by the implicit function
//! theorem); modelling adds what linearisation leaves out, and covers closed forms that do not use
//! all of the measurements.

use nalgebra::{DMatrix, Matrix3, Vector3};

use super::closed_form::Preference;
use super::measurement::Measurement;
use super::minimal_set::MinimalSet;
use super::problem::Problem;
use crate::frames::{Ecef, Vector};

/// Steps of the difference quotient in (4), in standard deviations of the measurement.
const STEP_SIGMAS: f64 = 1e-2;

/// (4): K ≈ (∂F/∂Y) K_Y (∂F/∂Y)ᵀ of a closed form F at a position, m².
///
/// ∂F/∂Y is taken by central differences around the error-free measurements; `None` where the
/// closed form has no root there.
#[must_use]
pub fn linearised_covariance(
    set: &MinimalSet,
    problem: &Problem,
    position_m: Vector<Ecef>,
) -> Option<Matrix3<f64>> {
    let count = problem.measurements().len();
    let mut measurements = error_free(problem, position_m);
    let mut jacobian = DMatrix::zeros(3, count);
    for index in 0..count {
        let Measurement { value, sigma, .. } = measurements[index];
        let step = STEP_SIGMAS * sigma;
        let mut at = |value: f64| {
            measurements[index].value = value;
            nearest_root(set, problem, &measurements, position_m)
        };
        let (above, below) = (at(value + step)?, at(value - step)?);
        measurements[index].value = value;
        jacobian.set_column(index, &((above - below).xyz() / (2.0 * step)));
    }
    let covariance = &jacobian * problem.covariance() * jacobian.transpose();
    Some(covariance.fixed_view::<3, 3>(0, 0).into_owned())
}

/// (5), (6): draws measurements around the error-free ones and puts each draw through the closed
/// form; the root nearest to `position_m` counts.
///
/// `standard_normal` gives independent random numbers of mean 0 and variance 1.
pub fn stochastic_model(
    set: &MinimalSet,
    problem: &Problem,
    position_m: Vector<Ecef>,
    draws: usize,
    standard_normal: &mut impl FnMut() -> f64,
) -> Scatter {
    let calculated = error_free(problem, position_m);
    let mut drawn = calculated.clone();
    let mut scatter = Scatter::default();
    for _ in 0..draws {
        draw_errors(problem, &calculated, &mut drawn, standard_normal);
        match nearest_root(set, problem, &drawn, position_m) {
            Some(root) => scatter.add(root - position_m),
            None => scatter.refuse(),
        }
    }
    scatter
}

/// (5): y = y_calc + ε, with ε = L z for correlated errors.
pub fn draw_errors(
    problem: &Problem,
    calculated: &[Measurement],
    drawn: &mut [Measurement],
    standard_normal: &mut impl FnMut() -> f64,
) {
    match problem.correlation_factor() {
        None => {
            for (to, from) in drawn.iter_mut().zip(calculated) {
                to.value = from.value + from.sigma * standard_normal();
            }
        }
        Some(factor) => {
            let normals: Vec<f64> = drawn.iter().map(|_| standard_normal()).collect();
            for (i, (to, from)) in drawn.iter_mut().zip(calculated).enumerate() {
                let error: f64 = (0..=i).map(|j| factor[(i, j)] * normals[j]).sum();
                to.value = from.value + error;
            }
        }
    }
}

/// The measurements with the values that they would have without errors.
#[must_use]
pub fn error_free(problem: &Problem, position_m: Vector<Ecef>) -> Vec<Measurement> {
    let measurements = problem.measurements().iter().enumerate();
    measurements
        .map(|(index, m)| Measurement { value: problem.predict(index, position_m), ..*m })
        .collect()
}

fn nearest_root(
    set: &MinimalSet,
    problem: &Problem,
    measurements: &[Measurement],
    position_m: Vector<Ecef>,
) -> Option<Vector<Ecef>> {
    let roots = set.roots(&problem.with_values(measurements)).ok()?;
    roots.choose(&Preference::Prior(position_m)).ok().map(|choice| choice.position_m)
}

/// How modelled positions scatter around the true one. Parts computed apart can be merged.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Scatter {
    /// Draws with a position.
    pub count: usize,
    /// Draws for which the closed form gave no position.
    pub refused: usize,
    sum: Vector3<f64>,
    squares: Matrix3<f64>,
}

impl Scatter {
    /// Takes one deviation from the true position.
    pub fn add(&mut self, deviation_m: Vector<Ecef>) {
        let deviation = deviation_m.xyz();
        self.count += 1;
        self.sum += deviation;
        self.squares += deviation * deviation.transpose();
    }

    /// Takes a draw without a position.
    pub fn refuse(&mut self) {
        self.refused += 1;
    }

    /// Both together.
    #[must_use]
    pub fn merge(self, other: Self) -> Self {
        Self {
            count: self.count + other.count,
            refused: self.refused + other.refused,
            sum: self.sum + other.sum,
            squares: self.squares + other.squares,
        }
    }

    /// Mean deviation: the bias of the closed form, m.
    #[must_use]
    pub fn bias_m(&self) -> Vector<Ecef> {
        Vector::from_xyz(self.sum / self.count as f64)
    }

    /// (6), about the true position, so that the bias is part of it and the divisor is the number
    /// of draws: m², common frame.
    #[must_use]
    pub fn covariance_m2(&self) -> Matrix3<f64> {
        self.squares / self.count as f64
    }

    /// Standard deviations along the axes of the common frame, m.
    #[must_use]
    pub fn sigmas_m(&self) -> Vector3<f64> {
        self.covariance_m2().diagonal().map(f64::sqrt)
    }

    /// Confidence interval of a standard deviation found from this many draws, as factors on it.
    ///
    /// `normal_quantile` is 1.96 for 95 %, 3.29 for 99.9 %.
    #[must_use]
    pub fn interval(&self, normal_quantile: f64) -> [f64; 2] {
        // σ̂ √(N / χ²), with the χ² quantile N (1 − 2/9N ± z √(2/9N))³ of Wilson & Hilferty (1931)
        let part = 2.0 / (9.0 * self.count as f64);
        let factor = |z: f64| (1.0 - part + z * part.sqrt()).max(0.0).powf(-1.5);
        [factor(normal_quantile), factor(-normal_quantile)]
    }

    /// Whether the standard deviations `expected_m` lie outside the 99.9 % interval on any axis:
    /// then the closed form is too non-linear, or uses too little, for (2) to describe it.
    #[must_use]
    pub fn disagrees_with(&self, covariance_m2: &Matrix3<f64>) -> bool {
        let [low, high] = self.interval(3.29);
        let expected = covariance_m2.diagonal().map(f64::sqrt);
        let modelled = self.sigmas_m();
        (0..3).any(|axis| !(modelled[axis] * low..=modelled[axis] * high).contains(&expected[axis]))
    }
}

#[cfg(test)]
mod tests {
    use super::super::least_squares::refine;
    use super::super::measurement::Quantity;
    use super::super::problem::Correlation;
    use super::super::station::Station;
    use super::*;
    use crate::frames::Geodetic;
    use rand_distr::{Distribution, StandardNormal};
    use rand_xoshiro::Xoshiro256PlusPlus;
    use rand_xoshiro::rand_core::SeedableRng;

    const TEN_SECONDS_OF_ARC: f64 = 4.848_136_811_095_36e-5;

    /// Stations and object as in the geometry of `docs/experiments/trajectory.md`, 26 km high.
    fn geometry() -> ([Station; 5], Vector<Ecef>) {
        let place = |latitude, longitude, height| {
            Station::at(&Geodetic::from_degrees(latitude, longitude, height))
        };
        let stations = [
            place(65.508_851_757, 41.386_914_958, 150.0),
            place(64.5, 40.5, 100.0),
            place(65.245_523_594, 37.977_698_196, 900.0),
            place(64.169_869_658, 38.919_177_277, 2500.0),
            place(64.0, 41.0, 300.0),
        ];
        (stations, Geodetic::from_degrees(64.53, 38.2, 26e3).to_ecef())
    }

    fn measurement(station: usize, quantity: Quantity, sigma: f64) -> Measurement {
        Measurement { station, quantity, value: 0.0, sigma }
    }

    fn normals(seed: u64) -> impl FnMut() -> f64 {
        let mut generator = Xoshiro256PlusPlus::seed_from_u64(seed);
        move || StandardNormal.sample(&mut generator)
    }

    /// The exactly determined sets: (4) equals (2), and modelling agrees within 3 %.
    #[test]
    fn three_ways_agree_for_three_measurements() {
        use Quantity::{Azimuth, Elevation, Range, RangeDifference};
        let angle = TEN_SECONDS_OF_ARC;
        let difference = RangeDifference { reference: 0 };
        let sets: [[(usize, Quantity, f64); 3]; 5] = [
            [(0, Azimuth, angle), (0, Elevation, angle), (1, Azimuth, angle)],
            [(0, Azimuth, angle), (0, Elevation, angle), (1, Elevation, angle)],
            [(0, Range, 5.0), (0, Azimuth, angle), (0, Elevation, angle)],
            [(0, Range, 5.0), (1, Range, 5.0), (2, Range, 5.0)],
            [(1, difference, 5.0), (2, difference, 5.0), (3, difference, 5.0)],
        ];
        let (stations, object) = geometry();
        for kinds in sets {
            let blank =
                kinds.map(|(station, quantity, sigma)| measurement(station, quantity, sigma));
            let measurements = error_free(&Problem::new(&stations, &blank).unwrap(), object);
            let problem = Problem::new(&stations, &measurements).unwrap();
            let set = MinimalSet::find(&problem).next().unwrap();
            let name = set.name(&problem);
            let information = refine(&problem, object).unwrap().covariance_m2;

            let linearised = linearised_covariance(&set, &problem, object).unwrap();
            let error = (linearised - information).amax() / information.amax();
            assert!(error < 1e-4, "{name}: {error:e}");

            let scatter = stochastic_model(&set, &problem, object, 10_000, &mut normals(3));
            assert_eq!(scatter.count + scatter.refused, 10_000);
            for axis in 0..3 {
                let ratio = scatter.sigmas_m()[axis] / information[(axis, axis)].sqrt();
                assert!((ratio - 1.0).abs() < 0.03, "{name} axis {axis}: {ratio}");
            }
            assert!(!scatter.disagrees_with(&information), "{name}");
            assert!(scatter.disagrees_with(&(information * 1.21)), "{name}");
        }
    }

    /// Four angles: modelling of the law of sines follows its own (4), not (2).
    #[test]
    fn law_of_sines_is_not_least_squares() {
        let (stations, object) = geometry();
        let kinds = [
            (0, Quantity::Azimuth),
            (0, Quantity::Elevation),
            (1, Quantity::Azimuth),
            (1, Quantity::Elevation),
        ];
        let blank =
            kinds.map(|(station, quantity)| measurement(station, quantity, TEN_SECONDS_OF_ARC));
        let measurements = error_free(&Problem::new(&stations, &blank).unwrap(), object);
        let problem = Problem::new(&stations, &measurements).unwrap();
        let set = MinimalSet::find(&problem).next().unwrap();
        let information = refine(&problem, object).unwrap().covariance_m2;
        let linearised = linearised_covariance(&set, &problem, object).unwrap();
        let scatter = stochastic_model(&set, &problem, object, 10_000, &mut normals(3));
        for axis in 0..3 {
            let ratio = scatter.sigmas_m()[axis] / linearised[(axis, axis)].sqrt();
            assert!((ratio - 1.0).abs() < 0.03, "axis {axis}: {ratio}");
            assert!(linearised[(axis, axis)] > information[(axis, axis)] * 0.999);
        }
        assert!(scatter.disagrees_with(&information));
    }

    /// Range differences share the noise of the reference: modelling with that correlation matches
    /// the correlated information matrix, and the uncorrelated one is far off.
    #[test]
    fn correlated_errors_are_modelled_and_weighted() {
        let (stations, object) = geometry();
        let difference = Quantity::RangeDifference { reference: 0 };
        let blank: Vec<Measurement> =
            (1..5).map(|station| measurement(station, difference, 5.0)).collect();
        let pairs = [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]];
        let correlations = pairs.map(|between| Correlation { between, coefficient: 0.5 });
        let plain = Problem::new(&stations, &blank).unwrap();
        let calculated = error_free(&plain, object);
        let problem = Problem::correlated(&stations, &calculated, &correlations).unwrap();
        let mut drawn = calculated.clone();
        let mut normal = normals(7);
        let (mut scatter, mut nees) = (Scatter::default(), 0.0);
        let covariance = refine(&problem, object).unwrap().covariance_m2;
        for _ in 0..2000 {
            draw_errors(&problem, &calculated, &mut drawn, &mut normal);
            let noisy = Problem::correlated(&stations, &drawn, &correlations).unwrap();
            let estimate = refine(&noisy, object).unwrap();
            let deviation = (estimate.position_m - object).xyz();
            let inverse = estimate.covariance_m2.try_inverse().unwrap();
            nees += deviation.dot(&(inverse * deviation)) / 2000.0;
            scatter.add(estimate.position_m - object);
        }
        // 99.9 % band of the mean of 2000 χ²₃: 3 ± 3.29 √(6/2000)
        assert!((nees - 3.0).abs() < 0.18, "{nees}");
        assert!(!scatter.disagrees_with(&covariance));
        let wrong = refine(&Problem::new(&stations, &calculated).unwrap(), object).unwrap();
        assert!(scatter.disagrees_with(&wrong.covariance_m2));
    }

    #[test]
    fn confidence_interval_of_a_sigma() {
        // χ² quantiles for N = 100: 74.222 and 129.561 (Abramowitz & Stegun, table 26.8)
        let scatter = Scatter { count: 100, ..Scatter::default() };
        let [low, high] = scatter.interval(1.959_964);
        assert!((low - (100.0_f64 / 129.561).sqrt()).abs() < 1e-4, "{low}");
        assert!((high - (100.0_f64 / 74.222).sqrt()).abs() < 1e-4, "{high}");
    }
}
