//! Errors of the published continuation, and of Newton's method in as many steps, against the exact
//! minimum.

use kurs::attitude::AttitudeProblem;
use kurs::attitude::continuation::{Scale, Step};
use kurs::attitude::reduction::BaselineWeight;
use kurs::attitude::wahba::nearest_rotation;
use nalgebra::Matrix3;
use rand::{RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;

use crate::scene::{Antennas, Scene};

/// One method: its name and what it makes of a problem.
type Method = (&'static str, fn(&AttitudeProblem) -> Option<Matrix3<f64>>);

const METHODS: [Method; 11] = [
    ("Wahba start", |problem| problem.wahba_start().ok()),
    ("Euler 2, as printed", |problem| problem.continuation(2, Scale::Printed, Step::Euler).ok()),
    ("Euler 4, as printed", |problem| problem.continuation(4, Scale::Printed, Step::Euler).ok()),
    ("Euler 2, κ = tr N/3", |problem| problem.continuation(2, Scale::Trace, Step::Euler).ok()),
    ("Euler 4, κ = tr N/3", |problem| problem.continuation(4, Scale::Trace, Step::Euler).ok()),
    ("exponential 2, κ", |problem| problem.continuation(2, Scale::Trace, Step::Exponential).ok()),
    ("polar 2, κ", |problem| problem.continuation(2, Scale::Trace, Step::Polar).ok()),
    ("1 Newton step", |problem| newton(problem, problem.wahba_start().ok()?, 1)),
    ("2 Newton steps", |problem| newton(problem, problem.wahba_start().ok()?, 2)),
    ("3 Newton steps", |problem| newton(problem, problem.wahba_start().ok()?, 3)),
    ("exponential 2, κ, 1 Newton step", |problem| {
        newton(problem, problem.continuation(2, Scale::Trace, Step::Exponential).ok()?, 1)
    }),
];

fn newton(problem: &AttitudeProblem, start: Matrix3<f64>, steps: usize) -> Option<Matrix3<f64>> {
    let mut rotation = start;
    for _ in 0..steps {
        rotation = problem.newton_step(&rotation).ok()?.0;
    }
    Some(rotation)
}

/// Error of a method over all scenes.
pub(crate) struct Errors {
    /// The method.
    pub(crate) name: &'static str,
    /// Angles to the exact minimum, ascending; of matrices that are no rotations, of the nearest one.
    pub(crate) angles_deg: Vec<f64>,
    /// Largest `‖QᵀQ − I‖`.
    pub(crate) defect: f64,
}

/// Random skies of 8 to 14 satellites over the roof array, weight as published (`C = I`).
pub(crate) fn errors(scenes: usize) -> Vec<Errors> {
    let problems: Vec<(AttitudeProblem, Matrix3<f64>)> = (0..scenes)
        .map(|number| {
            let mut random = Xoshiro256PlusPlus::seed_from_u64(number as u64);
            let satellites = random.random_range(8..=14);
            let body = Antennas::Roof.baselines(&mut random);
            let scene = Scene::random(&mut random, satellites, body, 1.0);
            let problem =
                scene.problem(BaselineWeight::Independent).expect("a random scene is a problem");
            let exact = problem.global_minimum(0.0).expect("a roof is not a line");
            (problem, exact.minimum.rotation)
        })
        .collect();
    METHODS.iter().map(|(name, method)| error_of(name, *method, &problems)).collect()
}

fn error_of(
    name: &'static str,
    method: fn(&AttitudeProblem) -> Option<Matrix3<f64>>,
    problems: &[(AttitudeProblem, Matrix3<f64>)],
) -> Errors {
    let mut defect: f64 = 0.0;
    let mut angles_deg: Vec<f64> = problems
        .iter()
        .map(|(problem, exact)| {
            let found = method(problem).unwrap_or(Matrix3::repeat(f64::NAN));
            defect = defect.max((found.transpose() * found - Matrix3::identity()).norm());
            nearest_rotation(&found).map_or(f64::INFINITY, |nearest| {
                // ‖A − B‖ = 2 √2 sin(φ/2): exact for small angles, where the arccosine is not
                let chord = (nearest.rotation - exact).norm() / 8.0_f64.sqrt();
                2.0 * chord.min(1.0).asin().to_degrees()
            })
        })
        .collect();
    angles_deg.sort_by(f64::total_cmp);
    Errors { name, angles_deg, defect }
}

/// Prints the table.
pub(crate) fn print_table(scenes: usize) {
    println!("| method | median, deg | 95 % | largest | ‖QᵀQ − I‖ |");
    println!("|---|---|---|---|---|");
    for Errors { name, angles_deg, defect } in errors(scenes) {
        let at = |percent: usize| angles_deg[(scenes - 1) * percent / 100];
        println!("| {name} | {:.1e} | {:.1e} | {:.1e} | {defect:.0e} |", at(50), at(95), at(100));
    }
}
