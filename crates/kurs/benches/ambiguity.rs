//! Time of the integer searches: `cargo bench -p kurs --bench ambiguity`. Before the table, the median
//! and the 99th percentile over the epochs of the cases that `docs/experiments/integers.md` names, and what a node
//! takes in the hundredth of them that take longest, which is what `engine/work_budget.rs` counts with.
#![allow(clippy::print_stdout)]

use std::time::Instant;

use divan::{Bencher, black_box};
use kurs::ambiguity::{
    MixedFloat, array_constrained::ArrayConstrained, frame::FrameMetric,
    length_constrained::LengthConstrained, search::IntegerLeastSquares, sphere::Length,
    sphere_search,
};
use nalgebra::{SMatrix, SVector, Vector3};

#[path = "../src/ambiguity/problems.rs"]
#[expect(dead_code, reason = "shared with the tests")]
mod problems;

use problems::{L1_M, L2_M, Noise, Sky, normal, seeded};

/// Epochs that a benchmark goes through in turn, so that it sees easy and hard ones.
const EPOCHS: usize = 500;
const CODE_M: f64 = 0.3;
const WEAK_CODE_M: f64 = 10.0;

fn main() {
    quantiles("plain search, n = 60", plain(60, CODE_M));
    quantiles("length-constrained search, n = 15", with_length(15, CODE_M));
    quantiles(
        "array-constrained search, 3 antennas, 10 satellites, one band",
        of_array(10, CODE_M),
    );
    println!("Epochs in which most of the time goes to nodes, code of {WEAK_CODE_M} m:");
    quantiles("plain search, n = 15", plain(16, WEAK_CODE_M));
    quantiles("length-constrained search, n = 12", with_length(12, WEAK_CODE_M));
    quantiles("array-constrained search, 3 antennas, 8 satellites", of_array(8, WEAK_CODE_M));
    quantiles("array-constrained search, 4 antennas, 6 satellites", of_space(6, WEAK_CODE_M));
    nearest_axes();
    divan::main();
}

/// Times of a search, each epoch the median of five: what counts is which epochs are hard.
fn quantiles(name: &str, mut search: impl FnMut(usize) -> usize) {
    let mut times: Vec<(f64, usize)> = (0..EPOCHS)
        .map(|epoch| {
            let mut nodes = 0;
            let mut five = [0.0; 5].map(|_: f64| {
                let start = Instant::now();
                nodes = search(epoch);
                1e3 * start.elapsed().as_secs_f64()
            });
            five.sort_by(f64::total_cmp);
            (five[2], nodes)
        })
        .collect();
    times.sort_by(|a, b| a.0.total_cmp(&b.0));
    let at = |share: usize| times[EPOCHS * share / 100].0;
    let hard = &times[EPOCHS * 99 / 100..];
    let (time_ms, nodes) = hard.iter().fold((0.0, 0), |sum, one| (sum.0 + one.0, sum.1 + one.1));
    let node_ns = 1e6 * time_ms / nodes as f64;
    println!("{name}: p50 {:.3} ms, p99 {:.3} ms; {node_ns:.0} ns a node", at(50), at(99));
}

fn epochs(
    satellites: usize,
    bands: &[f64],
    code_m: f64,
    baselines_m: &[Vector3<f64>],
) -> Vec<MixedFloat> {
    let mut random = seeded(100);
    let noise = Noise { code_m, phase_m: 0.003 };
    (0..EPOCHS)
        .map(|_| {
            Sky::random(&mut random, satellites).epoch(&mut random, bands, noise, baselines_m).float
        })
        .collect()
}

/// Dual-frequency double differences of one baseline, `n` ambiguities.
fn plain(n: usize, code_m: f64) -> impl FnMut(usize) -> usize {
    let epochs = epochs(n / 2 + 1, &[L1_M, L2_M], code_m, &[Vector3::new(1.0, 0.0, 0.0)]);
    let mut search = IntegerLeastSquares::default();
    move |turn| {
        let float = &epochs[turn % EPOCHS];
        let covariance = black_box(&float.ambiguity_covariance);
        let _ = black_box(search.solve(float.ambiguities.as_slice(), covariance, 2));
        search.nodes()
    }
}

/// One band, `n` ambiguities, 1 m.
fn with_length(n: usize, code_m: f64) -> impl FnMut(usize) -> usize {
    let epochs = epochs(n + 1, &[L1_M], code_m, &[Vector3::new(0.6, 0.8, 0.0)]);
    let mut search = LengthConstrained::default();
    let length = Length { length_m: 1.0, sd_m: 0.002 };
    move |turn| {
        let _ = black_box(search.solve(&epochs[turn % EPOCHS], black_box(length), 2));
        search.nodes()
    }
}

/// Three antennas at a right angle, 1 m, one band.
fn of_array(satellites: usize, code_m: f64) -> impl FnMut(usize) -> usize {
    with_shape(satellites, code_m, [Vector3::x(), Vector3::y()])
}

/// Four antennas at the corner of a cube of 1 m, one band.
fn of_space(satellites: usize, code_m: f64) -> impl FnMut(usize) -> usize {
    with_shape(satellites, code_m, [Vector3::x(), Vector3::y(), Vector3::z()])
}

fn with_shape<const K: usize>(
    satellites: usize,
    code_m: f64,
    body_m: [Vector3<f64>; K],
) -> impl FnMut(usize) -> usize {
    let turned = |b: Vector3<f64>| Vector3::new(0.6 * b.x - 0.8 * b.y, 0.8 * b.x + 0.6 * b.y, b.z);
    let baselines_m = body_m.map(turned);
    let epochs = epochs(satellites, &[L1_M], code_m, &baselines_m);
    let mut search = ArrayConstrained::default();
    search.work_budget = 20_000; // as the engine's
    move |turn| {
        let float = epochs[turn % EPOCHS].clone();
        let _ = black_box(search.solve(float, &[satellites - 1; K], black_box(&body_m), 0.002, 2));
        search.work()
    }
}

/// What the nearest axes take where the bound proves them, and where all rotations have to be searched.
fn nearest_axes() {
    let mut random = seeded(101);
    for (what, noise) in [("near", 0.05), ("far", 1.0)] {
        let mut times: [Vec<f64>; 2] = Default::default();
        for _ in 0..EPOCHS {
            let root = SMatrix::<f64, 9, 9>::from_fn(|_, _| normal(&mut random));
            let covariance = root * root.transpose() + SMatrix::identity() * 0.1;
            let metric = FrameMetric::<9, 6>::new(&covariance).expect("positive definite");
            let vectors = SVector::<f64, 9>::from_fn(|row, _| {
                f64::from(u8::from(row % 4 == 0)) + noise * normal(&mut random)
            });
            let start = Instant::now();
            let nearest = metric.nearest(black_box(&vectors), SVector::zeros());
            let time_us = 1e6 * start.elapsed().as_secs_f64();
            times[usize::from(nearest.expect("axes").is_certified)].push(time_us);
        }
        for (how, mut times) in ["searched", "certified"].into_iter().zip(times) {
            times.sort_by(f64::total_cmp);
            let middle = times.get(times.len() / 2).copied().unwrap_or(f64::NAN);
            println!("axes {what}, {how}: {} times, median {middle:.1} µs", times.len());
        }
    }
}

/// Each call takes the next epoch.
fn in_turn(bencher: Bencher, mut search: impl FnMut(usize) -> usize) {
    let mut turn = 0;
    bencher.bench_local(move || {
        turn += 1;
        search(turn);
    });
}

#[divan::bench(args = [14, 30, 60, 120])]
fn integer_least_squares(bencher: Bencher, n: usize) {
    in_turn(bencher, plain(n, CODE_M));
}

#[divan::bench(args = [4, 7, 15])]
fn length_constrained(bencher: Bencher, n: usize) {
    in_turn(bencher, with_length(n, CODE_M));
}

#[divan::bench(args = [5, 6, 8, 10])]
fn array_constrained(bencher: Bencher, satellites: usize) {
    in_turn(bencher, of_array(satellites, CODE_M));
}
