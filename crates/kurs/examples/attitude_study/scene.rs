//! Random attitude problems: satellites, antennas, an attitude, and phases with noise.

use kurs::attitude::reduction::{BaselineWeight, SingleDifferences};
use kurs::attitude::{AttitudeError, AttitudeProblem};
use kurs::frames::{Body, Ned, Rotation};
use nalgebra::{Matrix3, Vector3};
use rand::{Rng, RngExt};
use rand_distr::{Distribution, StandardNormal};

/// Wavelengths of L1 and L2, m.
pub(crate) const WAVELENGTHS_M: [f64; 2] = [0.190_293_672_798_364_9, 0.244_210_213_424_567_8];

/// One epoch of an array, noise included.
pub(crate) struct Scene {
    /// Unit vectors receiver → satellite, north-east-down.
    pub(crate) lines_of_sight: Vec<Vector3<f64>>,
    /// Baselines in body axes, m.
    pub(crate) body: Vec<Vector3<f64>>,
    /// Standard deviation of each single difference, m.
    pub(crate) sigma_m: Vec<f64>,
    /// Phases, baseline after baseline, m.
    pub(crate) phases_m: Vec<f64>,
}

impl Scene {
    /// Satellites above 10°, single differences of 0.02 to 0.07 cycles times `noise` on two bands, all
    /// of which share the noise of antenna 0.
    pub(crate) fn random(
        random: &mut impl Rng,
        satellites: usize,
        body: Vec<Vector3<f64>>,
        noise: f64,
    ) -> Self {
        let lines_of_sight = random_sky(random, satellites);
        let truth = random_rotation(random);
        let cycles: Vec<f64> =
            (0..satellites).map(|_| noise * random.random_range(0.02..0.07)).collect();
        let mut scene = Self { lines_of_sight, body, sigma_m: on_bands(&cycles), phases_m: vec![] };
        scene.draw(random, &truth, AntennaNoise::Shared);
        scene
    }

    /// Draws new phases for this sky, with the attitude `truth`.
    pub(crate) fn draw(
        &mut self,
        random: &mut impl Rng,
        truth: &Matrix3<f64>,
        reference: AntennaNoise,
    ) {
        // A single difference has √2 times the noise of one antenna.
        let mut antenna_noise = || -> Vec<f64> {
            let one = |sigma: &f64| {
                let normal: f64 = StandardNormal.sample(random);
                normal * sigma * core::f64::consts::FRAC_1_SQRT_2
            };
            self.sigma_m.iter().map(one).collect()
        };
        let mut at_reference = antenna_noise();
        self.phases_m.clear();
        for (index, l) in self.body.iter().enumerate() {
            if index > 0 && reference == AntennaNoise::Own {
                at_reference = antenna_noise();
            }
            let rover = antenna_noise();
            let clock_m = 3.0 * index as f64 - 4.0;
            for row in 0..self.sigma_m.len() {
                let line_of_sight = self.lines_of_sight[row % self.lines_of_sight.len()];
                let range = -line_of_sight.dot(&(truth * l));
                self.phases_m.push(range + clock_m + rover[row] - at_reference[row]);
            }
        }
    }

    /// The attitude problem of the scene.
    pub(crate) fn problem(&self, weight: BaselineWeight) -> Result<AttitudeProblem, AttitudeError> {
        self.single_differences().reduce()?.problem(&self.body, weight)
    }

    /// What is given to the reduction.
    pub(crate) fn single_differences(&self) -> SingleDifferences<'_> {
        SingleDifferences {
            lines_of_sight: &self.lines_of_sight,
            sigma_m: &self.sigma_m,
            phases_m: &self.phases_m,
        }
    }
}

/// Unit vectors towards satellites, even over the sky above 10°, north-east-down.
pub(crate) fn random_sky(random: &mut impl Rng, satellites: usize) -> Vec<Vector3<f64>> {
    let direction = |_| {
        let down = -random.random_range(10.0_f64.to_radians().sin()..1.0);
        let azimuth = random.random_range(0.0..core::f64::consts::TAU);
        let level = (1.0 - down * down).sqrt();
        Vector3::new(level * azimuth.cos(), level * azimuth.sin(), down)
    };
    (0..satellites).map(direction).collect()
}

/// Standard deviations in cycles, one for each satellite, as metres on both bands.
pub(crate) fn on_bands(cycles: &[f64]) -> Vec<f64> {
    WAVELENGTHS_M.iter().flat_map(|wavelength| cycles.iter().map(move |c| c * wavelength)).collect()
}

/// Whether all baselines have the noise of one reference antenna.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum AntennaNoise {
    /// They do: equal antennas, differenced to the first.
    Shared,
    /// Every baseline has a reference antenna of its own.
    Own,
}

/// Where the antennas of a study are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Antennas {
    /// The roof of Rapoport's experiment: four antennas, flat to a few millimetres.
    Roof,
    /// Three to six antennas, even in a cube of 1 m.
    Cube,
    /// Three to six antennas, even in a box of 1 m × 1 m × 0.1 m.
    FlatBox,
}

impl Antennas {
    /// The word in the tables.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Roof => "roof",
            Self::Cube => "cube",
            Self::FlatBox => "flat box",
        }
    }

    /// Baselines in body axes, m.
    pub(crate) fn baselines(self, random: &mut impl Rng) -> Vec<Vector3<f64>> {
        let height_m = match self {
            Self::Roof => {
                return vec![
                    Vector3::new(0.0, 0.766, 0.030),
                    Vector3::new(-0.491, 0.019, 0.001),
                    Vector3::new(0.488, -0.020, -0.007),
                ];
            }
            Self::Cube => 1.0,
            Self::FlatBox => 0.1,
        };
        let count = random.random_range(2..=5);
        let sides = Vector3::new(1.0, 1.0, height_m);
        let mut point = || sides.map(|side| side * random.random_range(-0.5..0.5));
        let first = point();
        (0..count).map(|_| point() - first).collect()
    }
}

/// A rotation, even over all of them.
pub(crate) fn random_rotation(random: &mut impl Rng) -> Matrix3<f64> {
    let quaternion = [(); 4].map(|()| StandardNormal.sample(random));
    Rotation::<Ned, Body>::from_quaternion(quaternion).matrix()
}
