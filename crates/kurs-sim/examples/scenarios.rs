//! The ready scenarios solved whole, with several seeds: what is fixed, what is wrong, how large the
//! errors are against the bound. Table of `docs/experiments/scenarios.md`.
//!
//! `cargo run --release -p kurs-sim --example scenarios [SEEDS [NAME]]`
#![allow(clippy::print_stdout, clippy::unwrap_used)]

#[path = "../tests/simulated/solving/bound.rs"]
mod bound;
#[path = "../tests/simulated/solving/mod.rs"]
mod solving;

use kurs::engine::Constraint;
use kurs_sim::scenario::{Law, NoiseLaw};
use nalgebra::Vector3;
use solving::{Tally, settings};

fn main() {
    let seeds: u64 = std::env::args().nth(1).map_or(5, |count| count.parse().expect("seeds"));
    let wanted = std::env::args().nth(2);
    let is_wanted = |name: &&str| wanted.as_ref().is_none_or(|wanted| wanted == name);
    println!("{seeds} seeds; RMS of heading, pitch, roll in degrees\n");
    println!("| scenario | epochs | fixed | wrong | heading | pitch | roll | (error/σ)² of 3 |");
    println!("|---|---|---|---|---|---|---|---|");
    for name in ["roof-static", "car", "ship", "uav"].into_iter().filter(is_wanted) {
        let mut all = Tally::default();
        for seed in 0..seeds {
            let mut scenario = solving::ready(name);
            scenario.seed += 100 * seed;
            let known = settings(&scenario, Constraint::Array);
            solving::solve(scenario, known, |truth, row, integers| all.add(truth, row, integers));
        }
        let fixed = 100.0 * all.fixed as f64 / all.epochs as f64;
        let rms = all.rms_deg();
        let consistency = all.normalised / all.fixed as f64;
        println!(
            "| {name} | {} | {fixed:.2} % | {} | {:.3} | {:.3} | {:.3} | {consistency:.2} |",
            all.epochs, all.wrong, rms.x, rms.y, rms.z
        );
    }
    println!("\nroof-static, RMS over the bound of Cramér and Rao:");
    print_roof(seeds, |_| ());
    println!(
        "\nthe same with 1/sin to at most 3.5 and C/N0 from 50 dB-Hz, which the weights do not know:"
    );
    print_roof(seeds, |noise| (noise.law, noise.cn0_zenith_dbhz) = (Law::Elevation, 50.0));
}

/// Errors on the roof against the bound of Cramér and Rao, with the 95 % interval of the seeds.
fn print_roof(seeds: u64, change: impl Fn(&mut NoiseLaw)) {
    let ratio = |seed: u64| {
        let mut scenario = solving::ready("roof-static");
        scenario.seed += 100 * seed;
        change(&mut scenario.noise);
        bound::laid_against(scenario).1
    };
    let ratios: Vec<Vector3<f64>> = (0..seeds).map(ratio).collect();
    let mean = ratios.iter().sum::<Vector3<f64>>() / seeds as f64;
    let spread: Vector3<f64> = ratios.iter().map(|r| (r - mean).component_mul(&(r - mean))).sum();
    let half = (spread / (seeds * (seeds - 1).max(1)) as f64).map(|v| 1.96 * v.sqrt());
    for (k, name) in ["heading", "pitch", "roll"].iter().enumerate() {
        println!("{name} {:.3} ± {:.3}", mean[k], half[k]);
    }
}
