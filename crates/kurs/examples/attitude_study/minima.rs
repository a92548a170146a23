//! Does Newton's method from Wahba's solution reach the global minimum?

use kurs::attitude::reduction::BaselineWeight;
use kurs::attitude::uniqueness::angle_between;
use kurs::attitude::{AttitudeProblem, Minimum, Uniqueness};
use rand::{RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;

use crate::scene::{Antennas, Scene, random_rotation};

/// Attitudes from which the referee starts.
const REFEREE_STARTS: usize = 60;
/// Relative cost and angle below which two minima are one.
const SAME_COST: f64 = 1e-9;
const SAME_ATTITUDE_RAD: f64 = 1e-6;

/// What one noise level showed.
#[derive(Debug, Default)]
pub(crate) struct Study {
    /// Numbers of the problems where Newton's method from Wahba's solution and nowhere else found
    /// another minimum than the global one.
    pub(crate) single_misses: Vec<usize>,
    /// Problems that are missed where an unproven minimum is compared with that of its mirror image.
    pub(crate) newton_misses: Vec<usize>,
    /// Problems that are missed with the search for a second minimum.
    pub(crate) checked_misses: Vec<usize>,
    /// Problems whose minimum the certificate proves.
    pub(crate) certified: usize,
    /// Newton steps, those from the mirror image included, all problems together.
    pub(crate) iterations: usize,
    /// The most steps of one problem.
    pub(crate) most_iterations: usize,
}

/// Solves `problems` random problems with this factor on the noise, 5 to 14 satellites each.
pub(crate) fn study(antennas: Antennas, problems: usize, noise: f64) -> Study {
    let mut study = Study::default();
    for number in 0..problems {
        let mut random = Xoshiro256PlusPlus::seed_from_u64(number as u64);
        let satellites = random.random_range(5..=14);
        let body = antennas.baselines(&mut random);
        let scene = Scene::random(&mut random, satellites, body, noise);
        let weight = if number % 2 == 0 {
            BaselineWeight::SharedAntenna
        } else {
            BaselineWeight::Independent
        };
        let problem = scene.problem(weight).expect("a random scene is a problem");
        let single = problem.minimum_from_wahba().expect("random antennas are not on a line");
        let newton = problem.minimum().expect("solved before");
        study.iterations += newton.iterations;
        study.most_iterations = study.most_iterations.max(newton.iterations);

        let best = referee(&problem, &mut random);
        let is_best = |minimum: &Minimum| {
            minimum.cost <= best.cost + SAME_COST * best.cost.abs()
                && (angle_between(&minimum.rotation, &best.rotation) < SAME_ATTITUDE_RAD
                    || minimum.cost < best.cost)
        };
        if !is_best(&single) {
            study.single_misses.push(number);
        }
        if !is_best(&newton) {
            study.newton_misses.push(number);
        }
        let checked = problem.global_minimum(1.0).expect("solved before");
        if matches!(checked.uniqueness, Uniqueness::Certified { .. }) {
            study.certified += 1;
        }
        if !is_best(&checked.minimum) {
            study.checked_misses.push(number);
        }
    }
    study
}

/// The lowest minimum from random attitudes.
fn referee(problem: &AttitudeProblem, random: &mut Xoshiro256PlusPlus) -> Minimum {
    (0..REFEREE_STARTS)
        .filter_map(|_| problem.minimum_from(random_rotation(random)).ok())
        .min_by(|a, b| a.cost.total_cmp(&b.cost))
        .expect("some start converges")
}

/// Prints the table for the three noise levels.
pub(crate) fn print_study(problems: usize) {
    println!(
        "| antennas | noise | from Wahba alone | and its mirror image | with the search | certified | \
         steps (most) | misses of the second |"
    );
    println!("|---|---|---|---|---|---|---|---|");
    for antennas in [Antennas::Roof, Antennas::Cube, Antennas::FlatBox] {
        for noise in [0.4, 1.0, 4.0] {
            let study = study(antennas, problems, noise);
            let percent = |count: usize| 100.0 * count as f64 / problems as f64;
            println!(
                "| {} | ×{noise} | {:.2} % | {:.2} % | {:.2} % | {:.1} % | {:.2} ({}) | {:?} |",
                antennas.name(),
                percent(problems - study.single_misses.len()),
                percent(problems - study.newton_misses.len()),
                percent(problems - study.checked_misses.len()),
                percent(study.certified),
                study.iterations as f64 / problems as f64,
                study.most_iterations,
                study.newton_misses,
            );
        }
    }
}
