//! What the methods cost: three baselines, twelve satellites on two bands, from single differences to
//! the attitude. Every round times all methods one after the other, so that the ratios hold on a
//! machine with other work; the yardstick is least squares with Wahba's closed form.

use core::hint::black_box;
use std::time::Instant;

use kurs::attitude::continuation::{Scale, Step};
use kurs::attitude::reduction::BaselineWeight::{Independent, SharedAntenna};
use kurs::attitude::{AttitudeError, wahba};
use nalgebra::Matrix3;
use rand::SeedableRng;
use rand_xoshiro::Xoshiro256PlusPlus;

use crate::interval::bootstrap;
use crate::scene::{Antennas, Scene};

const SCENES: u64 = 100;
const SATELLITES: usize = 12;

type Method = (&'static str, fn(&Scene) -> Result<Matrix3<f64>, AttitudeError>);

const METHODS: [Method; 7] = [
    ("least squares + SVD", |scene| {
        let reduced = scene.single_differences().reduce()?;
        let baselines_m = reduced.baselines_m().ok_or(AttitudeError::Unobservable)?;
        wahba::solve(&scene.body, &baselines_m, &[1.0; 3])
    }),
    ("+ 2 steps of continuation", |scene| continuation(scene, 2)),
    ("+ 4 steps of continuation", |scene| continuation(scene, 4)),
    ("+ 1 Newton step", |scene| newton(scene, 1)),
    ("+ 2 Newton steps", |scene| newton(scene, 2)),
    ("Newton to 1e-9 rad, full weight", |scene| {
        Ok(scene.problem(SharedAntenna)?.minimum()?.rotation)
    }),
    ("the same, proven unique", |scene| {
        Ok(scene.problem(SharedAntenna)?.global_minimum(1.0)?.minimum.rotation)
    }),
];

fn continuation(scene: &Scene, steps: usize) -> Result<Matrix3<f64>, AttitudeError> {
    scene.problem(Independent)?.continuation(steps, Scale::Trace, Step::Euler)
}

fn newton(scene: &Scene, steps: usize) -> Result<Matrix3<f64>, AttitudeError> {
    let problem = scene.problem(Independent)?;
    let mut rotation = problem.wahba_start()?;
    for _ in 0..steps {
        rotation = problem.newton_step(&rotation)?.0;
    }
    Ok(rotation)
}

/// Prints the table.
pub(crate) fn print_table(rounds: usize) {
    let scenes: Vec<Scene> = (0..SCENES)
        .map(|seed| {
            let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
            let body = Antennas::Roof.baselines(&mut random);
            Scene::random(&mut random, SATELLITES, body, 1.0)
        })
        .collect();
    let times_ns: Vec<[f64; METHODS.len()]> =
        (0..rounds).map(|_| METHODS.map(|(_, method)| time_ns(&scenes, method))).collect();
    println!("{rounds} rounds over {SCENES} scenes; medians, 95 % intervals\n");
    println!("| method | ns | against least squares + SVD |");
    println!("|---|---|---|");
    for (index, (name, _)) in METHODS.iter().enumerate() {
        let median_of = |drawn: &[usize], of: &dyn Fn(usize) -> f64| {
            let mut values: Vec<f64> = drawn.iter().map(|round| of(*round)).collect();
            values.sort_by(f64::total_cmp);
            values[values.len() / 2]
        };
        let ratio = bootstrap(rounds, |drawn| {
            median_of(drawn, &|round| times_ns[round][index] / times_ns[round][0])
        });
        let all: Vec<usize> = (0..rounds).collect();
        println!("| {name} | {:.0} | {ratio} |", median_of(&all, &|round| times_ns[round][index]));
    }
}

/// Mean time of one scene.
fn time_ns(scenes: &[Scene], method: fn(&Scene) -> Result<Matrix3<f64>, AttitudeError>) -> f64 {
    let start = Instant::now();
    for scene in scenes {
        let _ = black_box(method(black_box(scene)));
    }
    start.elapsed().as_secs_f64() * 1e9 / scenes.len() as f64
}
