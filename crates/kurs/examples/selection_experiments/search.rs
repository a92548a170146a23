//! How often edge swaps find the optimum, and what the search costs.

use std::fs;
use std::sync::OnceLock;
use std::time::Instant;

use kurs::selection::published::{RoundingWeight, problem_2, round};
use kurs::selection::{Criterion, Graph, best_by_enumeration, descend, search, select};
use rand::SeedableRng;
use rand_xoshiro::Xoshiro256PlusPlus;

use crate::statistics::percent;
use crate::{Law, draw};

const SAME: f64 = 1.0 + 1e-9;
const CUBE: Law = Law::Box(1.0, 1.0, 1.0);
const TREE: Graph = Graph::SpanningTree;
const CRITERION: Criterion = Criterion::BaselineCondition;

pub(crate) fn print_table() {
    println!("## Edge swaps (cube, κ of the baselines, spanning trees)\n");
    println!("Per cent of arrays where the optimal tree is found.\n");
    println!(
        "| antennas (arrays) | published | + swaps | 10 starts | 30 starts | 1000 starts | max ratio (1000) |"
    );
    println!("|---|---|---|---|---|---|---|");
    for (antennas, tests) in [(4, 300), (5, 300), (6, 200), (7, 120), (8, 80), (9, 40)] {
        let mut random = Xoshiro256PlusPlus::seed_from_u64(300 + antennas as u64);
        let mut hits = [0; 5];
        let mut worst: f64 = 0.0;
        for _ in 0..tests {
            let (_, baselines) = draw(antennas, CUBE, &mut random);
            let optimum =
                baselines.value(&best_by_enumeration(&baselines, TREE, CRITERION), CRITERION);
            let shares = problem_2(&baselines, TREE, 5);
            let published = round(&baselines, TREE, &shares, RoundingWeight::Complement);
            let swapped = descend(&baselines, TREE, CRITERION, published.clone());
            let mut from_starts = |starts| search(&baselines, TREE, CRITERION, starts, &mut random);
            let found = [published, swapped, from_starts(10), from_starts(30), from_starts(1000)];
            for (hit, chosen) in hits.iter_mut().zip(&found) {
                *hit += usize::from(baselines.value(chosen, CRITERION) < optimum * SAME);
            }
            worst = worst.max(baselines.value(&found[4], CRITERION) / optimum);
        }
        let columns: Vec<String> = hits.iter().map(|hit| percent(*hit, tests)).collect();
        println!("| {antennas} ({tests}) | {} | {worst:.3} |", columns.join(" | "));
    }
    println!();
}

/// Processor time of this thread so far, ms, which other work on the machine does not lengthen; wall
/// time where the system does not tell it.
fn processor_ms() -> f64 {
    static START: OnceLock<Instant> = OnceLock::new();
    let wall_ms = START.get_or_init(Instant::now).elapsed().as_secs_f64() * 1e3;
    let of_thread = fs::read_to_string("/proc/thread-self/schedstat").ok();
    let nanoseconds = of_thread.and_then(|text| text.split(' ').next()?.parse::<f64>().ok());
    nanoseconds.map_or(wall_ms, |ns| ns * 1e-6)
}

pub(crate) fn print_twelve() {
    println!("## Time and gap\n");
    println!(
        "One random cube each, one thread. The gap is to a bound that no choice can pass: 0 where \
         every choice was looked at or excluded, else from the relaxation. Times are processor time.\n"
    );
    println!("| antennas | graph | criterion | value | gap | time, ms |");
    println!("|---|---|---|---|---|---|");
    for antennas in [8, 9, 10, 12] {
        let mut random = Xoshiro256PlusPlus::seed_from_u64(7);
        let (_, baselines) = draw(antennas, CUBE, &mut random);
        for graph in [Graph::SpanningTree, Graph::General] {
            for criterion in Criterion::ALL {
                let start_ms = processor_ms();
                let Ok(chosen) = select(&baselines, graph, criterion, &mut random) else {
                    continue;
                };
                println!(
                    "| {antennas} | {graph:?} | {criterion:?} | {:.6} | {:.4} | {:.1} |",
                    chosen.value,
                    chosen.gap(),
                    processor_ms() - start_ms
                );
            }
        }
    }
    println!();
}
