//! How many fixes are wrong and how honest their standard deviations are, over all scenarios, many
//! seeds and the hours of a day, at two rates on the same observations. Table of
//! `docs/experiments/real-skies.md`.
//!
//! `cargo run --release -p kurs-sim --example wrong_fixes -- [--continuous] [ROWS [SCENARIO…]]`: at least so
//! many rows of each scenario and rate (default 2000). Epochs are a second apart, the array and its
//! survey are known, of the noise nothing is told. Wrong is a fix with a wrong integer, off one with a
//! baseline off by more than 5 cm and 5 standard deviations.
#![allow(clippy::print_stdout, clippy::unwrap_used)]
#![allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // whole seconds

#[path = "../tests/simulated/solving/mod.rs"]
mod solving;

use kurs::engine::{Constraint, Settings};
use kurs_sim::scenario::Scenario;
use solving::figures::Figures;
use solving::{as_told, continuous, in_parallel, session, solve_each};

const SCENARIOS: [&str; 13] = [
    "roof-static",
    "car",
    "ship",
    "uav",
    "leo",
    "two-bodies",
    "few-satellites",
    "urban",
    "edge",
    "canopy",
    "street",
    "urban, G1 and E1",
    "street, G1 and E1",
];
/// Rates that acceptance is asked to keep.
const RATES: [f64; 2] = [1e-3, 1e-4];
/// A scenario's part that only uses these begins with its name.
const ONE_BAND: [&str; 2] = ["G1C", "E1C"];

fn main() {
    let (flags, words): (Vec<String>, Vec<String>) =
        std::env::args().skip(1).partition(|word| word.starts_with("--"));
    let is_continuous = flags.iter().any(|flag| flag == "--continuous");
    let rows: usize = words.first().map_or(2000, |text| text.parse().expect("rows"));
    let wanted = |name: &&&str| words.len() < 2 || words[1..].iter().any(|word| word == **name);
    let mode = if is_continuous { "continuous" } else { "instantaneous" };
    println!("{mode}, array known, at least {rows} rows of each scenario\n");
    println!(
        "| scenario | rate | rows | fixed | wrong | wrong / fixed (95 %) | off | beyond 3 σ | (e/σ)² heading, pitch, roll | most often not fixed |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|");
    let mut all: [Figures; 2] = Default::default();
    for name in SCENARIOS.iter().filter(wanted) {
        for (k, figures) in run(name, rows, is_continuous).iter().enumerate() {
            print_row(name, RATES[k], figures);
            all[k].add(figures);
        }
    }
    for (rate, figures) in RATES.iter().zip(&all) {
        print_row("all", *rate, figures);
    }
}

/// Sessions of a scenario until it has so many rows; figures for each rate.
fn run(name: &str, rows: usize, is_continuous: bool) -> [Figures; 2] {
    let of_session = scenario(name, 0).duration_s as usize + 1;
    let seeds: Vec<u64> = (0..rows.div_ceil(of_session) as u64).collect();
    let of_seeds = in_parallel(&seeds, |seed| {
        let scenario = scenario(name, *seed);
        let told = as_told(&scenario, Constraint::Array);
        let told = if is_continuous { continuous(told) } else { told };
        let settings = RATES.map(|rate| Settings { max_wrong_fix_rate: rate, ..told.clone() });
        let mut figures: [Figures; 2] = Default::default();
        solve_each(scenario, settings, |k, truth, row, integers| {
            figures[k].take(truth, row, integers);
        });
        figures
    });
    let mut sum: [Figures; 2] = Default::default();
    for figures in &of_seeds {
        sum.iter_mut().zip(figures).for_each(|(sum, figures)| sum.add(figures));
    }
    sum
}

/// A session of a scenario, an epoch a second, or of a part of it.
fn scenario(name: &str, seed: u64) -> Scenario {
    let (whole, part) = name.split_once(", ").map_or((name, None), |(w, part)| (w, Some(part)));
    let mut scenario = session(whole, seed);
    scenario.interval_s = 1.0;
    if part.is_some() {
        scenario.sky.systems = ["G", "E"].map(str::to_owned).to_vec();
        scenario.signals = ONE_BAND.map(str::to_owned).to_vec();
    }
    scenario
}

fn print_row(name: &str, rate: f64, figures: &Figures) {
    let [wrong, low, high] = figures.wrong_per_fix();
    let squares = figures.mean_squares().map(|m| m.map_or("–".to_owned(), |m| format!("{m:.2}")));
    println!(
        "| {name} | {rate:e} | {} | {:.2} % | {} | {wrong:.1e} ({low:.1e} to {high:.1e}) | {} | {:.2} % | {} | {} |",
        figures.rows,
        figures.per_cent(figures.fixed),
        figures.wrong,
        figures.off,
        figures.per_cent_of_fixed(figures.beyond),
        squares.join(", "),
        figures.most_frequent_reasons(3),
    );
}
