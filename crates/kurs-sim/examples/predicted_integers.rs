//! What a prediction of the attitude by a gyro does for the integers: table of
//! `docs/experiments/fusion.md`.
//!
//! `cargo run --release -p kurs-sim --example predicted_integers [SEEDS]`; `urban`, slow to search, has a quarter
//! of the seeds.
#![allow(clippy::print_stdout, clippy::unwrap_used)]

#[path = "../tests/simulated/predicting/mod.rs"]
mod predicting;
#[path = "../tests/simulated/solving/mod.rs"]
mod solving;

use predicting::{Case, Fault, Judged, OUTAGE_ENDS_S, solve};

const FAULTS: [(Fault, &str); 4] = [
    (Fault::None, "none"),
    (Fault::GyroJolt(0.5), "gyro off by 0.5°/s for 10 s"),
    (Fault::GyroBias(0.5), "gyro off by 0.5°/s"),
    (Fault::Heading(20.0), "heading off by 20°"),
];

fn main() {
    let seeds: u64 = std::env::args().nth(1).map_or(4, |text| text.parse().expect("seeds"));
    println!(
        "| scenario | fault | epochs | fixed alone | fixed with prediction | decided | refused | wrong alone | wrong with it |"
    );
    println!("|---|---|---|---|---|---|---|---|---|");
    let mut returns: Vec<[Judged; 2]> = Vec::new();
    for case in Case::ALL {
        for (fault, words) in FAULTS {
            let mut epochs: Vec<[Judged; 2]> = Vec::new();
            for seed in 0..if case == Case::Urban { seeds.div_ceil(4) } else { seeds } {
                let of_seed = solve(case.scenario(seed), fault);
                if (case, fault) == (Case::Outage, Fault::None) {
                    returns.extend(of_seed.iter().find(|e| e[1].time_s > OUTAGE_ENDS_S));
                }
                epochs.extend(of_seed);
            }
            let count = |which: fn(&Judged) -> bool, way: usize| {
                epochs.iter().filter(|epoch| which(&epoch[way])).count()
            };
            let fixed = [0, 1].map(|way| 100.0 * count(Judged::is_fixed, way) as f64);
            println!(
                "| {} | {words} | {} | {:.1} % | {:.1} % | {} | {} | {} | {} |",
                case.name(),
                epochs.len(),
                fixed[0] / epochs.len() as f64,
                fixed[1] / epochs.len() as f64,
                count(Judged::is_decided, 1),
                count(Judged::is_refused, 1),
                count(Judged::is_wrong, 0),
                count(Judged::is_wrong, 1),
            );
        }
    }
    let seen: Vec<&[Judged; 2]> = returns.iter().filter(|epoch| epoch[1].is_solved()).collect();
    let right = |way: usize| {
        seen.iter().filter(|epoch| epoch[way].is_fixed() && !epoch[way].is_wrong()).count()
    };
    println!(
        "\nFirst epoch after the outage, where it has a solution: {} fixed and right alone, {} with prediction, \
         of {} (of {} outages).",
        right(0),
        right(1),
        seen.len(),
        returns.len()
    );
}
