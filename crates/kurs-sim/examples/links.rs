//! Share of simulated links whose phase is off by more than 0.15 cycle, by how much weaker one antenna
//! receives than the other, beside what recordings show. Table of `docs/experiments/real-skies.md`.
//!
//! `cargo run --release -p kurs-sim --example links [SEEDS]`
#![allow(clippy::print_stdout, clippy::unwrap_used)]

#[path = "../tests/simulated/links/mod.rs"]
mod links;
#[path = "../tests/simulated/solving/mod.rs"]
mod solving;

use links::{CLASSES_DB, Links, RECORDED};

fn main() {
    let seeds: u64 = std::env::args().nth(1).map_or(8, |count| count.parse().expect("seeds"));
    let mut all = Links::default();
    let mut columns = Vec::new();
    for name in ["edge", "canopy", "street"] {
        let mut sum = Links::default();
        for seed in 0..seeds {
            let mut scenario = solving::session(name, seed);
            scenario.interval_s = 10.0;
            sum.add(&Links::of(&scenario));
        }
        all.add(&sum);
        columns.push(sum);
    }
    columns.push(all);
    println!("| C/N0 differs by, dB | recorded | edge | canopy | street | together |");
    println!("|---|---|---|---|---|---|");
    for (class, low_db) in CLASSES_DB.iter().enumerate() {
        let cells = columns
            .iter()
            .map(|links| format!(" {:.2} % of {} |", 100.0 * links.share(class), links.all[class]));
        let cells: String = cells.collect();
        println!("| {low_db} and more | {:.1} % |{cells}", 100.0 * RECORDED[class]);
    }
}
