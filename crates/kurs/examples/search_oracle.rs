//! The search over integers against the search over the sphere, epoch after epoch.
//!
//! `cargo run --release -p kurs --example search_oracle [EPOCHS] [LENGTH_M]` compares every
//! candidate up to a cost of 30 on random epochs (4 to 20 satellites, one or two bands, code noise
//! 0.15 to 0.6 m, length known to 0.01 to 5 mm) and prints how many differ. Without a length, each
//! epoch draws one from 0.2 to 2 m.
#![expect(clippy::print_stdout, reason = "the count is for reading")]

use kurs::ambiguity::{
    MixedFloat, length_constrained::LengthConstrained, sphere::Length, sphere_search,
};
use nalgebra::Vector3;
use rand::RngExt;

#[path = "../src/ambiguity/problems.rs"]
#[expect(dead_code, reason = "shared with the tests")]
mod problems;

use problems::{L1_M, L2_M, Noise, Sky, normal, seeded};

/// Candidates up to this cost are compared.
const MAX_COST: f64 = 30.0;

fn main() {
    let epochs = std::env::args().nth(1).and_then(|text| text.parse().ok()).unwrap_or(1000);
    let fixed_length_m: Option<f64> = std::env::args().nth(2).and_then(|text| text.parse().ok());
    let mut random = seeded(7);
    let mut search = LengthConstrained::default();
    let (mut compared, mut different) = (0, 0);
    for epoch_number in 0..epochs {
        let satellites = random.random_range(4..=20);
        let bands: &[f64] = if random.random_bool(0.5) { &[L1_M] } else { &[L1_M, L2_M] };
        let noise = Noise { code_m: random.random_range(0.15..0.6), phase_m: 0.003 };
        let length_m = fixed_length_m.unwrap_or_else(|| random.random_range(0.2..2.0));
        let direction = Vector3::from_fn(|_, _| normal(&mut random)).normalize();
        let sky = Sky::random(&mut random, satellites);
        let epoch = sky.epoch(&mut random, bands, noise, &[direction * length_m]);
        let length = Length { length_m, sd_m: [1e-5, 0.002, 0.005][epoch_number % 3] };

        let expected = sphere_search::all_within(&epoch.phase_model(), length, MAX_COST);
        let expected = expected.expect("a small sphere");
        let found = search.solve(&epoch.float, length, expected.len() + 1).expect("a strong model");
        let next = found.get(expected.len()).map_or(search.proven_to(), |candidate| candidate.cost);
        let same = found.len() >= expected.len()
            && found.iter().zip(&expected).all(|(ours, oracle)| ours.integers == oracle.integers)
            && next > MAX_COST * (1.0 - 1e-6);
        compared += expected.len();
        different += usize::from(!same);
    }
    println!("{epochs} epochs, {compared} candidates compared, {different} epochs differ");
}
