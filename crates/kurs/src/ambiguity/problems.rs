//! Seeded random problems for the tests, examples and benchmarks of this module.

use nalgebra::{DMatrix, DVector, Matrix3, Vector3};
use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use rand_xoshiro::Xoshiro256PlusPlus;

use super::{MixedFloat, sphere_search::PhaseModel};

/// Wavelength of GPS L1, m.
pub(crate) const L1_M: f64 = 299_792_458.0 / 1_575.42e6;
/// Wavelength of GPS L2, m.
pub(crate) const L2_M: f64 = 299_792_458.0 / 1_227.60e6;

pub(crate) fn seeded(seed: u64) -> Xoshiro256PlusPlus {
    Xoshiro256PlusPlus::seed_from_u64(seed)
}

/// The 3 × 3 example of Joosten & Tiberius, *LAMBDA: FAQs*, GPS Solutions 6 (2002).
pub(crate) fn faq_covariance() -> DMatrix<f64> {
    DMatrix::from_row_slice(3, 3, &[6.290, 5.978, 0.544, 5.978, 6.292, 2.340, 0.544, 2.340, 6.288])
}

/// A well-filled positive definite matrix.
pub(crate) fn random_covariance(random: &mut Xoshiro256PlusPlus, n: usize) -> DMatrix<f64> {
    let root = DMatrix::from_fn(n, n, |_, _| normal(random));
    &root * root.transpose() + DMatrix::identity(n, n) * 0.1
}

/// Float ambiguities of some hundred thousand cycles.
pub(crate) fn random_float(random: &mut Xoshiro256PlusPlus, n: usize) -> Vec<f64> {
    (0..n).map(|_| random.random_range(-1e5..1e5)).collect()
}

/// Float ambiguities drawn around integers with the covariance `q`.
pub(crate) fn float_near_integers(random: &mut Xoshiro256PlusPlus, q: &DMatrix<f64>) -> Vec<f64> {
    let root = q.clone().cholesky().expect("positive definite").l();
    let white = DVector::from_fn(q.nrows(), |_, _| normal(random));
    (root * white)
        .iter()
        .map(|noise| noise + random.random_range(-100_000_i32..100_000) as f64)
        .collect()
}

/// Covariance of `n` ambiguities of one epoch on one band (odd `n`) or two bands (even `n`).
pub(crate) fn geometry_covariance(random: &mut Xoshiro256PlusPlus, n: usize) -> DMatrix<f64> {
    let bands: &[f64] = if n.is_multiple_of(2) && n >= 8 { &[L1_M, L2_M] } else { &[L1_M] };
    let sky = Sky::random(random, n / bands.len() + 1);
    let noise = Noise { code_m: 0.3, phase_m: 0.003 };
    sky.epoch(random, bands, noise, &[Vector3::new(1.0, 0.0, 0.0)]).float.ambiguity_covariance
}

pub(crate) fn normal(random: &mut Xoshiro256PlusPlus) -> f64 {
    StandardNormal.sample(random)
}

/// Undifferenced standard deviations, m, the same for all satellites.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Noise {
    pub code_m: f64,
    pub phase_m: f64,
}

/// Directions to satellites, east-north-up.
#[derive(Debug, Clone)]
pub(crate) struct Sky {
    pub lines_of_sight: Vec<Vector3<f64>>,
}

/// Largest position dilution of precision drawn; four satellites rarely reach it.
const MAX_PDOP: f64 = 8.0;

impl Sky {
    /// `satellites` with the sine of the elevation uniform in [sin 10°, 1] and azimuth uniform,
    /// drawn again until the position dilution of precision is below eight.
    pub(crate) fn random(random: &mut Xoshiro256PlusPlus, satellites: usize) -> Self {
        loop {
            let lines_of_sight = (0..satellites)
                .map(|_| {
                    let sine: f64 = random.random_range(10_f64.to_radians().sin()..1.0);
                    let azimuth: f64 = random.random_range(0.0..std::f64::consts::TAU);
                    let cosine = (1.0 - sine * sine).sqrt();
                    Vector3::new(cosine * azimuth.sin(), cosine * azimuth.cos(), sine)
                })
                .collect();
            let sky = Self { lines_of_sight };
            if sky.position_dilution() < MAX_PDOP {
                return sky;
            }
        }
    }

    fn position_dilution(&self) -> f64 {
        let count = self.lines_of_sight.len() as f64;
        let mean = self.lines_of_sight.iter().sum::<Vector3<f64>>() / count;
        let scatter: Matrix3<f64> =
            self.lines_of_sight.iter().map(|u| (u - mean) * (u - mean).transpose()).sum();
        scatter.try_inverse().map_or(f64::INFINITY, |inverse| inverse.trace().sqrt())
    }

    /// One epoch of double differences of `baselines_m` that share antenna 0, observed on every
    /// band in `wavelengths_m`, and its float solution.
    pub(crate) fn epoch(
        &self,
        random: &mut Xoshiro256PlusPlus,
        wavelengths_m: &[f64],
        noise: Noise,
        baselines_m: &[Vector3<f64>],
    ) -> Epoch {
        let all: Vec<usize> = (0..self.lines_of_sight.len()).collect();
        let seen = vec![all; baselines_m.len()];
        self.epoch_seen(random, wavelengths_m, noise, baselines_m, &seen)
    }

    /// An epoch in which baseline `j` has only the satellites `seen[j]`, the first of them its
    /// reference.
    pub(crate) fn epoch_seen(
        &self,
        random: &mut Xoshiro256PlusPlus,
        wavelengths_m: &[f64],
        noise: Noise,
        baselines_m: &[Vector3<f64>],
        seen: &[Vec<usize>],
    ) -> Epoch {
        let mut rows = Vec::new();
        for (baseline, satellites) in seen.iter().enumerate() {
            for band in 0..wavelengths_m.len() {
                rows.extend(satellites[1..].iter().map(|&satellite| DoubleDifference {
                    baseline,
                    band,
                    satellite,
                    reference: satellites[0],
                }));
            }
        }
        let n = rows.len();
        let reals = 3 * baselines_m.len();
        let design = DMatrix::from_fn(n, reals, |i, column| {
            let row = rows[i];
            let of_axis = |satellite: usize| self.lines_of_sight[satellite][column % 3];
            let own = column / 3 == row.baseline;
            if own { of_axis(row.reference) - of_axis(row.satellite) } else { 0.0 }
        });
        // Antenna 0 is in every baseline, a satellite in many double differences.
        let shared = DMatrix::from_fn(n, n, |i, j| rows[i].shared(rows[j]));
        let root = shared.clone().cholesky().expect("positive definite").l();
        let mut draw = |sigma_m: f64| {
            let white = DVector::from_fn(n, |_, _| normal(random));
            &root * white * sigma_m
        };
        let code_noise_m = draw(noise.code_m);
        let phase_noise_m = draw(noise.phase_m);
        let truth_m =
            DVector::from_iterator(reals, baselines_m.iter().flat_map(|b| b.iter().copied()));
        let integers: Vec<i64> =
            (0..n).map(|_| random.random_range(-1_000_000..1_000_000)).collect();
        let wavelengths = DVector::from_fn(n, |i, _| wavelengths_m[rows[i].band]);

        let range_m = &design * &truth_m;
        let code_m = &range_m + code_noise_m;
        let fraction_cycles = (&range_m + phase_noise_m).component_div(&wavelengths);

        // b̂ = (Gᵀ W G)⁻¹ Gᵀ W P,   â = Λ⁻¹ (Φ − G b̂)
        let weight = shared.clone().cholesky().expect("positive definite").inverse();
        let weighted = design.transpose() * &weight;
        let inverse_normal = (&weighted * &design).cholesky().expect("three dimensions").inverse();
        let reals_m = &inverse_normal * &weighted * code_m;
        let offset = (&design * &reals_m).component_div(&wavelengths);
        let ambiguities =
            DVector::from_fn(n, |i, _| fraction_cycles[i] + integers[i] as f64 - offset[i]);

        // Q_b = σ_P² (Gᵀ W G)⁻¹,   Q_ba = −Q_b Gᵀ Λ⁻¹,   Q_a = Λ⁻¹ (σ_φ² S + G Q_b Gᵀ) Λ⁻¹
        let inverse_wavelengths = DMatrix::from_diagonal(&wavelengths.map(|w| 1.0 / w));
        let q_b = &inverse_normal * noise.code_m.powi(2);
        let cross_covariance = -(&q_b * design.transpose() * &inverse_wavelengths);
        let ambiguity_covariance = &inverse_wavelengths
            * (&shared * noise.phase_m.powi(2) + &design * &q_b * design.transpose())
            * &inverse_wavelengths;
        // Q_b|a = (σ_P⁻² + σ_φ⁻²)⁻¹ (Gᵀ W G)⁻¹
        let precision = noise.code_m.powi(-2) + noise.phase_m.powi(-2);
        let conditional_covariance_m2 = &inverse_normal / precision;
        Epoch {
            float: MixedFloat {
                ambiguities,
                ambiguity_covariance,
                reals_m,
                real_covariance_m2: q_b.clone(),
                cross_covariance,
                conditional_covariance_m2,
            },
            phases_m: DVector::from_fn(n, |i, _| {
                (fraction_cycles[i] + integers[i] as f64) * wavelengths[i]
            }),
            integers,
            wavelengths_m: wavelengths,
            phase_covariance_m2: &shared * noise.phase_m.powi(2),
            code_covariance_m2: q_b,
            design,
            baseline_of: rows.iter().map(|row| row.baseline).collect(),
        }
    }
}

/// Satellite less reference satellite, antenna less antenna 0.
#[derive(Debug, Clone, Copy)]
struct DoubleDifference {
    baseline: usize,
    band: usize,
    satellite: usize,
    reference: usize,
}

impl DoubleDifference {
    /// Their covariance where every observation has variance one.
    fn shared(self, other: Self) -> f64 {
        if self.band != other.band {
            return 0.0;
        }
        let antennas = if self.baseline == other.baseline { 2.0 } else { 1.0 };
        let same = |one: usize, two: usize| f64::from(u8::from(one == two));
        antennas
            * (same(self.satellite, other.satellite) + same(self.reference, other.reference)
                - same(self.satellite, other.reference)
                - same(self.reference, other.satellite))
    }
}

/// A float solution, and what it was made of.
#[derive(Debug, Clone)]
pub(crate) struct Epoch {
    pub float: MixedFloat,
    pub integers: Vec<i64>,
    /// Baseline of each ambiguity.
    pub baseline_of: Vec<usize>,
    /// `φ`, `λ`, m.
    pub phases_m: DVector<f64>,
    pub wavelengths_m: DVector<f64>,
    pub design: DMatrix<f64>,
    pub phase_covariance_m2: DMatrix<f64>,
    /// Of the baselines from code alone, which the float solution holds.
    pub code_covariance_m2: DMatrix<f64>,
}

impl Epoch {
    /// The epoch of one baseline for the search over the sphere.
    pub(crate) fn phase_model(&self) -> PhaseModel {
        self.phase_model_of(0)
    }

    /// What one baseline of the epoch says by itself.
    pub(crate) fn phase_model_of(&self, baseline: usize) -> PhaseModel {
        let rows: Vec<usize> =
            (0..self.baseline_of.len()).filter(|i| self.baseline_of[*i] == baseline).collect();
        let (n, first) = (rows.len(), 3 * baseline);
        let code: Matrix3<f64> = self.code_covariance_m2.fixed_view::<3, 3>(first, first).into();
        PhaseModel {
            phases_m: self.phases_m.select_rows(&rows),
            wavelengths_m: self.wavelengths_m.select_rows(&rows),
            design: self.design.select_rows(&rows).columns(first, 3).into(),
            covariance_m2: DMatrix::from_fn(n, n, |i, j| {
                self.phase_covariance_m2[(rows[i], rows[j])]
            }),
            prior_m: self.float.reals_m.fixed_rows::<3>(first).into(),
            prior_information: code.try_inverse().expect("three dimensions"),
        }
    }
}
