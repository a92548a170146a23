//! The static test of Rapoport's section 5, simulated: what each weighting of the phases is worth.
//!
//! A level car stands under a sky for 2400 epochs; 240 skies of 8 to 14 satellites stand for the one
//! that the paper does not describe. Errors of an estimator are root mean squares over all of them;
//! intervals are those of the skies (95 %, by drawing skies again).

use core::fmt;

use kurs::attitude::reduction::{BaselineWeight, SingleDifferences};
use kurs::attitude::{AttitudeError, wahba};
use nalgebra::{Matrix3, Vector3};
use rand::{RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;

use crate::interval::{Interval, bootstrap};
use crate::scene::{AntennaNoise, Scene, on_bands, random_sky};

/// Baselines of the paper's roof, forward-right-down, m.
const ROOF_M: [[f64; 3]; 3] =
    [[0.766, 0.0, -0.030], [0.019, -0.491, -0.001], [-0.020, 0.488, 0.007]];
/// Standard deviations of a single difference, cycles, between which the paper's lie.
const SIGMA_CYCLES: [f64; 2] = [0.02, 0.07];
const PUBLISHED: usize = 2;
const FULL: usize = 3;

/// A weighting and the attitude that it gives.
type Estimator = (&'static str, fn(&Scene) -> Result<Matrix3<f64>, AttitudeError>);

const ESTIMATORS: [Estimator; 4] = [
    ("unit weights", |scene| {
        let unit_m = vec![1.0; scene.sigma_m.len()];
        least_squares_and_svd(
            scene,
            &SingleDifferences { sigma_m: &unit_m, ..scene.single_differences() },
        )
    }),
    ("auxiliary weight (12)", |scene| least_squares_and_svd(scene, &scene.single_differences())),
    ("published weight (5)", |scene| newton(scene, BaselineWeight::Independent)),
    ("full weight", |scene| newton(scene, BaselineWeight::SharedAntenna)),
];

/// How the standard deviation depends on the satellite.
#[derive(Debug, Clone, Copy)]
enum Law {
    /// 0.02 cycle / sin(elevation), at most 0.07.
    Elevation,
    /// Drawn evenly between 0.02 and 0.07 cycle.
    Even,
}

/// Mean square errors (heading, pitch, roll) under one sky.
#[derive(Debug, Clone, Copy, Default)]
struct Sky {
    estimators: [Vector3<f64>; ESTIMATORS.len()],
    bound: Vector3<f64>,
}

/// Prints the tables.
pub(crate) fn print_study(skies: usize, epochs: usize) {
    println!(
        "{skies} skies of 8 to 14 satellites, {epochs} epochs each; degrees, 95 % intervals of the skies"
    );
    for (title, law, noise, factor) in [
        (
            "σ by elevation, 0.02 to 0.07 cycle; antenna 0 shared",
            Law::Elevation,
            AntennaNoise::Shared,
            1.0,
        ),
        (
            "σ drawn evenly, 0.02 to 0.07 cycle; antenna 0 shared",
            Law::Even,
            AntennaNoise::Shared,
            1.0,
        ),
        ("the same, every baseline with noise of its own", Law::Even, AntennaNoise::Own, 1.0),
        (
            "σ drawn evenly, 0.38 times as large; antenna 0 shared",
            Law::Even,
            AntennaNoise::Shared,
            0.38,
        ),
    ] {
        println!("\n{title}\n");
        print_table(&study(skies, epochs, law, noise, factor));
    }
}

fn study(skies: usize, epochs: usize, law: Law, noise: AntennaNoise, factor: f64) -> Vec<Sky> {
    (0..skies)
        .map(|number| {
            let mut random = Xoshiro256PlusPlus::seed_from_u64(number as u64);
            let satellites = random.random_range(8..=14);
            let lines_of_sight = random_sky(&mut random, satellites);
            let mut sigma = |line_of_sight: &Vector3<f64>| match law {
                Law::Elevation => (SIGMA_CYCLES[0] / -line_of_sight.z).min(SIGMA_CYCLES[1]),
                Law::Even => random.random_range(SIGMA_CYCLES[0]..SIGMA_CYCLES[1]),
            };
            let cycles: Vec<f64> = lines_of_sight.iter().map(|u| factor * sigma(u)).collect();
            let body = ROOF_M.map(Vector3::from).to_vec();
            let sigma_m = on_bands(&cycles);
            let mut scene = Scene { lines_of_sight, body, sigma_m, phases_m: Vec::new() };
            under(&mut scene, &mut random, epochs, noise).expect("a random sky is a problem")
        })
        .collect()
}

/// All epochs under one sky; the car stands level, nose to the north.
fn under(
    scene: &mut Scene,
    random: &mut Xoshiro256PlusPlus,
    epochs: usize,
    noise: AntennaNoise,
) -> Result<Sky, AttitudeError> {
    let mut sky = Sky::default();
    for epoch in 0..epochs {
        scene.draw(random, &Matrix3::identity(), noise);
        for ((_, estimate), squares) in ESTIMATORS.iter().zip(&mut sky.estimators) {
            let q = estimate(scene)?;
            // heading, pitch, roll of Rz Ry Rx
            let error = Vector3::new(
                q[(1, 0)].atan2(q[(0, 0)]),
                -q[(2, 0)].clamp(-1.0, 1.0).asin(),
                q[(2, 1)].atan2(q[(2, 2)]),
            );
            *squares += error.component_mul(&error) / epochs as f64;
        }
        if epoch == 0 {
            // Cramér and Rao: the information at the truth; turns about x, y, z are roll, pitch, heading.
            let problem = scene.problem(BaselineWeight::SharedAntenna)?;
            let covariance = problem.minimum_from(Matrix3::identity())?.covariance()?;
            sky.bound = Vector3::new(covariance[(2, 2)], covariance[(1, 1)], covariance[(0, 0)]);
        }
    }
    Ok(sky)
}

/// Baselines by least squares, then Wahba's closed form: equation (12).
fn least_squares_and_svd(
    scene: &Scene,
    differences: &SingleDifferences<'_>,
) -> Result<Matrix3<f64>, AttitudeError> {
    let baselines_m = differences.reduce()?.baselines_m().ok_or(AttitudeError::Unobservable)?;
    wahba::solve(&scene.body, &baselines_m, &[1.0; ROOF_M.len()])
}

fn newton(scene: &Scene, weight: BaselineWeight) -> Result<Matrix3<f64>, AttitudeError> {
    Ok(scene.problem(weight)?.minimum()?.rotation)
}

fn print_table(skies: &[Sky]) {
    println!("| weighting | heading | pitch | roll | total against the published |");
    println!("|---|---|---|---|---|");
    let published = |sky: &Sky| sky.estimators[PUBLISHED];
    for (index, (name, _)) in ESTIMATORS.iter().enumerate() {
        let ratio = total_ratio(skies, |sky| sky.estimators[index], published);
        println!("| {name} | {} | {ratio} |", Angles::over(skies, |sky| sky.estimators[index]));
    }
    let bound = |sky: &Sky| sky.bound;
    let ratio = total_ratio(skies, bound, published);
    println!("| bound of Cramér and Rao | {} | {ratio} |", Angles::over(skies, bound));
    let above = total_ratio(skies, |sky| sky.estimators[FULL], bound);
    println!("\nfull weight against the bound: {above}");
}

/// Ratio of two total errors (heading, pitch and roll together), with its interval.
fn total_ratio(
    skies: &[Sky],
    one: impl Fn(&Sky) -> Vector3<f64>,
    other: impl Fn(&Sky) -> Vector3<f64>,
) -> Interval {
    bootstrap(skies.len(), |drawn| {
        let total = |of: &dyn Fn(&Sky) -> Vector3<f64>| -> f64 {
            drawn.iter().map(|sky| of(&skies[*sky]).sum()).sum()
        };
        (total(&one) / total(&other)).sqrt()
    })
}

/// Root mean squares of the three angles, degrees.
struct Angles(Vector3<f64>);

impl Angles {
    fn over(skies: &[Sky], squares: impl Fn(&Sky) -> Vector3<f64>) -> Self {
        let mean: Vector3<f64> =
            skies.iter().map(squares).sum::<Vector3<f64>>() / skies.len() as f64;
        Self(mean.map(|square| square.sqrt().to_degrees()))
    }
}

impl fmt::Display for Angles {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:.3} | {:.3} | {:.3}", self.0.x, self.0.y, self.0.z)
    }
}
