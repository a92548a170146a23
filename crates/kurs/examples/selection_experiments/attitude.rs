//! What a choice costs in attitude: the error with only the chosen tree, relative to all antennas.

use kurs::array::AntennaArray;
use kurs::selection::{
    Baselines, Criterion, Graph, best_by_enumeration, error_relative_to_all_antennas,
    for_each_graph,
};
use rand::{RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;

use crate::statistics::mean;
use crate::{Law, draw};

const ARRAYS: usize = 300;
const TREE: Graph = Graph::SpanningTree;

pub(crate) fn print_table() {
    println!("## Attitude error with only the chosen tree\n");
    println!(
        "Total RMS relative to all antennas with the full covariance, equal independent noise of the \
         antennas, mean over {ARRAYS} random cubes.\n"
    );
    println!("| tree | 4 antennas | 5 | 6 |");
    println!("|---|---|---|---|");
    let names = [
        "best κ(R), the published criterion",
        "best κ(J)",
        "largest λ_min(J)",
        "smallest tr J⁻¹ (default)",
        "random",
        "best star",
        "worst of all trees",
        "all pairs, unit weights",
        "noise independent per baseline: κ(R) tree relative to tr J⁻¹ tree",
    ];
    let mut ratios = vec![vec![Vec::new(); 3]; names.len()];
    for antennas in [4_usize, 5, 6] {
        let mut random = Xoshiro256PlusPlus::seed_from_u64(400 + antennas as u64);
        for _ in 0..ARRAYS {
            let (array, baselines) = draw(antennas, Law::Box(1.0, 1.0, 1.0), &mut random);
            for (row, ratio) in one_array(&array, &baselines, &mut random).iter().enumerate() {
                ratios[row][antennas - 4].push(*ratio);
            }
        }
    }
    for (name, of_name) in names.iter().zip(&ratios) {
        let columns: Vec<String> = of_name.iter().map(|values| mean(values)).collect();
        println!("| {name} | {} |", columns.join(" | "));
    }
    println!();
}

/// One value for each row of the table.
fn one_array(
    array: &AntennaArray,
    baselines: &Baselines,
    random: &mut Xoshiro256PlusPlus,
) -> [f64; 9] {
    let relative =
        |chosen: &[usize]| error_relative_to_all_antennas(array, &baselines.pairs_of(chosen));
    let best = Criterion::ALL.map(|criterion| best_by_enumeration(baselines, TREE, criterion));
    let mut trees = Vec::new();
    for_each_graph(baselines, TREE, |chosen, _| trees.push(chosen.to_vec()));
    let stars = (0..array.len()).map(|hub| {
        let of_hub = |k: &usize| {
            let (i, j) = baselines.pairs()[*k];
            i == hub || j == hub
        };
        relative(&baselines.every().into_iter().filter(of_hub).collect::<Vec<_>>())
    });
    let trace_of_covariance =
        |chosen: &[usize]| baselines.value(chosen, Criterion::TraceOfCovariance);
    [
        relative(&best[0]),
        relative(&best[1]),
        relative(&best[2]),
        relative(&best[3]),
        relative(&trees[random.random_range(0..trees.len())]),
        stars.fold(f64::INFINITY, f64::min),
        trees.iter().map(|tree| relative(tree)).fold(0.0, f64::max),
        relative(&baselines.every()),
        (trace_of_covariance(&best[0]) / trace_of_covariance(&best[3])).sqrt(),
    ]
}
