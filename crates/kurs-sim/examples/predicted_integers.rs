//! What a prediction of the attitude by a gyro does for the integers: table of
//! `docs/experiments/fusion.md`.
//!
//! `cargo run --release -p kurs-sim --example predicted_integers [SEEDS]`
#![allow(clippy::print_stdout, clippy::unwrap_used)]

#[path = "../tests/predicting/mod.rs"]
mod predicting;
#[path = "../tests/solving/mod.rs"]
mod solving;

use kurs::solution::PredictionRole;
use predicting::{Case, Fault, Judged, OUTAGE_ENDS_S, solve};

const FAULTS: [(Fault, &str); 3] = [
    (Fault::None, "none"),
    (Fault::GyroBias(0.5), "gyro off by 0.5°/s"),
    (Fault::Heading(20.0), "heading off by 20°"),
];

fn main() {
    let seeds: u64 = std::env::args().nth(1).map_or(4, |text| text.parse().expect("seeds"));
    println!(
        "| scenario | fault | epochs | fixed alone | fixed with prediction | decided | refused | wrong alone | wrong with it |"
    );
    println!("|---|---|---|---|---|---|---|---|---|");
    let (mut back, mut outages) = (0, 0);
    for case in Case::ALL {
        for (fault, words) in FAULTS {
            let mut rows: Vec<[Judged; 2]> = Vec::new();
            for seed in 0..seeds {
                let of_seed = solve(case.scenario(seed), fault);
                if (case, fault) == (Case::Outage, Fault::None) {
                    let first = of_seed.iter().find(|rows| rows[1].time_s > OUTAGE_ENDS_S).unwrap();
                    outages += 1;
                    back += usize::from(first[1].is_fixed() && !first[1].is_wrong());
                }
                rows.extend(of_seed);
            }
            let count = |which: fn(&[Judged; 2]) -> bool| rows.iter().filter(|r| which(r)).count();
            let share = |n: usize| 100.0 * n as f64 / rows.len() as f64;
            println!(
                "| {} | {words} | {} | {:.1} % | {:.1} % | {} | {} | {} | {} |",
                case.name(),
                rows.len(),
                share(count(|r| r[0].is_fixed())),
                share(count(|r| r[1].is_fixed())),
                count(|r| r[1].is_fixed() && r[1].prediction == Some(PredictionRole::Decided)),
                count(|r| r[1].prediction == Some(PredictionRole::Refused)),
                count(|r| r[0].is_wrong()),
                count(|r| r[1].is_wrong()),
            );
        }
    }
    println!("\nFirst epoch after the outage fixed and right: {back} of {outages}.");
}
