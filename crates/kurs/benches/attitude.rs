//! Cost of an attitude: three baselines, twelve satellites on two bands.
//!
//! `cargo bench -p kurs --bench attitude`; compare lines of one run. The yardstick of the published
//! method is `least_squares_and_svd`: baselines by least squares, then Wahba's closed form.

#[path = "../examples/attitude_study/scene.rs"]
#[allow(dead_code)] // other arrays are for the study
mod scene;

use divan::{Bencher, black_box};
use kurs::attitude::continuation::{Scale, Step};
use kurs::attitude::reduction::BaselineWeight;
use kurs::attitude::{AttitudeProblem, joint, wahba};
use nalgebra::{DMatrix, DVector};
use rand::SeedableRng;
use rand_xoshiro::Xoshiro256PlusPlus;
use scene::{Antennas, Scene};

/// Scenes over which each figure is a mean.
const SCENES: u64 = 100;

fn main() {
    divan::main();
}

fn scenes() -> Vec<Scene> {
    (0..SCENES)
        .map(|seed| {
            let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
            let body = Antennas::Roof.baselines(&mut random);
            Scene::random(&mut random, 12, body, 1.0)
        })
        .collect()
}

fn problems() -> Vec<AttitudeProblem> {
    let problem = |scene: &Scene| scene.problem(BaselineWeight::SharedAntenna);
    scenes().iter().map(|scene| problem(scene).expect("a random scene is a problem")).collect()
}

/// Times one call, averaged over the scenes.
fn each<T, R>(bencher: Bencher, inputs: &[T], run: impl Fn(&T) -> R + Sync) {
    bencher.counter(inputs.len()).bench_local(|| {
        for input in inputs {
            black_box(run(black_box(input)));
        }
    });
}

#[divan::bench]
fn reduction(bencher: Bencher) {
    each(bencher, &scenes(), |scene| scene.single_differences().reduce());
}

#[divan::bench]
fn wahba_start(bencher: Bencher) {
    each(bencher, &problems(), AttitudeProblem::wahba_start);
}

#[divan::bench]
fn newton_from_wahba(bencher: Bencher) {
    let starts: Vec<_> = problems()
        .into_iter()
        .map(|problem| {
            let start = problem.wahba_start().expect("a roof is not a line");
            (problem, start)
        })
        .collect();
    each(bencher, &starts, |(problem, start)| problem.minimum_from(*start));
}

#[divan::bench]
fn wahba_and_newton(bencher: Bencher) {
    each(bencher, &problems(), AttitudeProblem::minimum);
}

#[divan::bench]
fn with_certificate(bencher: Bencher) {
    each(bencher, &problems(), |problem| problem.global_minimum(1.0));
}

#[divan::bench]
fn search_for_a_second_minimum(bencher: Bencher) {
    let minima: Vec<_> = problems()
        .into_iter()
        .map(|problem| {
            let minimum = problem.minimum().expect("a roof is not a line");
            (problem, minimum)
        })
        .collect();
    each(bencher, &minima, |(problem, minimum)| problem.search(*minimum));
}

#[divan::bench]
fn least_squares_and_svd(bencher: Bencher) {
    each(bencher, &scenes(), |scene| {
        let baselines = scene.single_differences().reduce().ok()?.baselines_m()?;
        wahba::solve(&scene.body, &baselines, &[1.0; 3]).ok()
    });
}

#[divan::bench]
fn published_two_steps(bencher: Bencher) {
    each(bencher, &scenes(), |scene| {
        let problem = scene.problem(BaselineWeight::Independent)?;
        problem.continuation(2, Scale::Trace, Step::Euler)
    });
}

#[divan::bench]
fn joint_form(bencher: Bencher) {
    let inputs: Vec<_> = scenes()
        .into_iter()
        .map(|scene| {
            let normal = scene.single_differences().reduce().expect("a random scene is a problem");
            let baselines = normal.baselines_m().expect("twelve satellites");
            let z = DVector::from_fn(9, |row, _| baselines[row / 3][row % 3]);
            let c = DMatrix::from_fn(3, 3, |i, j| if i == j { 1.5 } else { -0.5 });
            (scene.body, z, c.kronecker(&DMatrix::from_fn(3, 3, |i, j| normal.normal[(i, j)])))
        })
        .collect();
    each(bencher, &inputs, |(body, z, weight)| {
        joint::problem(body, z, weight)?.global_minimum(1.0)
    });
}
