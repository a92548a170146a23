//! What a choice costs in attitude: the error with only the chosen tree, relative to all antennas.

use kurs::selection::{Baselines, Criterion, Graph, best_by_enumeration, for_each_graph};
use nalgebra::{Matrix3, Vector3};
use rand::{RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;

use crate::statistics::mean;
use crate::{Law, draw};

const ARRAYS: usize = 300;
const TREE: Graph = Graph::SpanningTree;

/// J = tr(R) I − R.
fn information(r: Matrix3<f64>) -> Matrix3<f64> {
    Matrix3::from_diagonal_element(r.trace()) - r
}

/// Total RMS attitude error of a unit-weight Wahba solution over the chosen baselines, for antenna
/// positions with unit, independent, isotropic noise.
///
/// The normal equations are J θ = Σ l × (n_j − n_i) = Σ_a g_a × n_a, where g_a sums the baselines that
/// end at antenna a minus those that start there: cov θ = J⁻¹ (Σ_a |g_a|² I − g_a g_aᵀ) J⁻¹.
fn rms_of_baselines(positions: &[Vector3<f64>], baselines: &Baselines, chosen: &[usize]) -> f64 {
    let mut lever = vec![Vector3::zeros(); positions.len()];
    for (i, j) in baselines.pairs_of(chosen) {
        let baseline = positions[j] - positions[i];
        lever[j] += baseline;
        lever[i] -= baseline;
    }
    let scatter: Matrix3<f64> = lever.iter().map(|g| g * g.transpose()).sum();
    let inverse = information(baselines.gram(chosen).matrix()).try_inverse();
    inverse
        .map_or(f64::INFINITY, |inverse| (inverse * information(scatter) * inverse).trace().sqrt())
}

/// The same with all antennas and the full covariance: J of the positions about their centroid.
fn rms_of_all(positions: &[Vector3<f64>]) -> f64 {
    let centroid = positions.iter().sum::<Vector3<f64>>() / positions.len() as f64;
    let scatter =
        positions.iter().map(|p| (p - centroid) * (p - centroid).transpose()).sum::<Matrix3<f64>>();
    information(scatter).try_inverse().map_or(f64::INFINITY, |inverse| inverse.trace().sqrt())
}

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
            let (positions, baselines) = draw(antennas, Law::Box(1.0, 1.0, 1.0), &mut random);
            for (row, ratio) in one_array(&positions, &baselines, &mut random).iter().enumerate() {
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
    positions: &[Vector3<f64>],
    baselines: &Baselines,
    random: &mut Xoshiro256PlusPlus,
) -> [f64; 9] {
    let relative =
        |chosen: &[usize]| rms_of_baselines(positions, baselines, chosen) / rms_of_all(positions);
    let best = Criterion::ALL.map(|criterion| best_by_enumeration(baselines, TREE, criterion));
    let mut trees = Vec::new();
    for_each_graph(baselines, TREE, |chosen, _| trees.push(chosen.to_vec()));
    let stars = (0..positions.len()).map(|hub| {
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
