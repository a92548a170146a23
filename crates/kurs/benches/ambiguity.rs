//! Time of the integer searches: `cargo bench -p kurs --bench ambiguity`.

use divan::{Bencher, black_box};
use kurs::ambiguity::{
    MixedFloat, array_constrained::ArrayConstrained, length_constrained::LengthConstrained,
    search::IntegerLeastSquares, sphere::Length, sphere_search,
};
use nalgebra::Vector3;

#[path = "../src/ambiguity/problems.rs"]
#[expect(dead_code, reason = "shared with the tests")]
mod problems;

use problems::{L1_M, L2_M, Noise, Sky, seeded};

/// Epochs that a benchmark goes through in turn, so that it sees easy and hard ones.
const EPOCHS: usize = 500;

fn main() {
    divan::main();
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
#[divan::bench(args = [14, 30, 60, 120])]
fn integer_least_squares(bencher: Bencher, n: usize) {
    let epochs = epochs(n / 2 + 1, &[L1_M, L2_M], 0.3, &[Vector3::new(1.0, 0.0, 0.0)]);
    let mut search = IntegerLeastSquares::default();
    let mut turn = epochs.iter().cycle();
    bencher.bench_local(move || {
        let float = turn.next().expect("a cycle has no end");
        search.solve(float.ambiguities.as_slice(), black_box(&float.ambiguity_covariance), 2)
    });
}

/// One band, `n` ambiguities, 1 m.
#[divan::bench(args = [4, 7, 15])]
fn length_constrained(bencher: Bencher, n: usize) {
    let epochs = epochs(n + 1, &[L1_M], 0.3, &[Vector3::new(0.6, 0.8, 0.0)]);
    let mut search = LengthConstrained::default();
    let length = Length { length_m: 1.0, sd_m: 0.002 };
    let mut turn = epochs.iter().cycle();
    bencher.bench_local(move || {
        search.solve(turn.next().expect("a cycle has no end"), black_box(length), 2)
    });
}

/// Three antennas at a right angle, 1 m, one band.
#[divan::bench(args = [5, 6, 8, 10])]
fn array_constrained(bencher: Bencher, satellites: usize) {
    let body_m = [Vector3::x(), Vector3::y()];
    let epochs = epochs(
        satellites,
        &[L1_M],
        0.3,
        &[Vector3::new(0.6, 0.8, 0.0), Vector3::new(-0.8, 0.6, 0.0)],
    );
    let mut search = ArrayConstrained::default();
    let mut turn = epochs.iter().cycle();
    bencher.bench_local(move || {
        let float = turn.next().expect("a cycle has no end");
        search.solve(float.clone(), &[satellites - 1; 2], black_box(&body_m), 0.002, 2)
    });
}
