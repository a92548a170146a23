//! The choice of baselines against every tree, written down by another method: Prüfer's sequences,
//! and the eigenvalues of a library.

use kurs::array::AntennaArray;
use kurs::frames::Vector;
use kurs::selection::{Baselines, Criterion, Graph, select};
use nalgebra::{Matrix3, Vector3};
use rand::{RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;

/// Calls `visit` with the edges of every tree on `count` labelled nodes.
fn for_each_tree(count: usize, mut visit: impl FnMut(&[(usize, usize)])) {
    let length = count - 2;
    let mut edges = Vec::with_capacity(count - 1);
    for number in 0..count.pow(u32::try_from(length).unwrap()) {
        let mut rest = number;
        let sequence: Vec<usize> = (0..length)
            .map(|_| {
                let digit = rest % count;
                rest /= count;
                digit
            })
            .collect();
        let mut degree = vec![1; count];
        sequence.iter().for_each(|node| degree[*node] += 1);
        edges.clear();
        for node in &sequence {
            let leaf = (0..count).find(|leaf| degree[*leaf] == 1).unwrap();
            edges.push((leaf, *node));
            degree[leaf] -= 1;
            degree[*node] -= 1;
        }
        let mut last = (0..count).filter(|node| degree[*node] == 1);
        edges.push((last.next().unwrap(), last.next().unwrap()));
        visit(&edges);
    }
}

/// The best value of each criterion over all trees.
fn best_of_all_trees(points: &[Vector3<f64>]) -> [f64; 4] {
    let mut best = [f64::INFINITY, f64::INFINITY, 0.0, f64::INFINITY];
    for_each_tree(points.len(), |edges| {
        let gram: Matrix3<f64> =
            edges.iter().map(|(a, b)| points[*a] - points[*b]).map(|l| l * l.transpose()).sum();
        let r = gram.symmetric_eigenvalues();
        let j = (gram.trace() * Matrix3::identity() - gram).symmetric_eigenvalues();
        best[0] = best[0].min(r.max() / r.min());
        best[1] = best[1].min(j.max() / j.min());
        best[2] = best[2].max(j.min());
        best[3] = best[3].min(j.map(|value| 1.0 / value).sum());
    });
    best
}

fn check(points: &[Vector3<f64>], criteria: core::ops::Range<usize>) {
    let best = best_of_all_trees(points);
    let positions = points.iter().map(|p| Vector::from_xyz(*p)).collect();
    let baselines = Baselines::of(&AntennaArray::new(positions).unwrap()).unwrap();
    let mut random = Xoshiro256PlusPlus::seed_from_u64(0);
    for (criterion, best) in Criterion::ALL.into_iter().zip(best).skip(criteria.start) {
        let chosen = select(&baselines, Graph::SpanningTree, criterion, &mut random).unwrap();
        let error = (chosen.value / best - 1.0).abs();
        assert!(error < 1e-9, "{criterion:?}: {} where {best} exists", chosen.value);
        assert_eq!(chosen.gap(), 0.0);
    }
}

fn cube(count: usize, height: f64, seed: u64) -> Vec<Vector3<f64>> {
    let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
    let mut point = || {
        Vector3::from_fn(|axis, _| {
            random.random_range(-0.5..0.5) * if axis == 2 { height } else { 1.0 }
        })
    };
    (0..count).map(|_| point()).collect()
}

#[test]
fn trees_of_prufer() {
    let mut count = 0;
    for_each_tree(6, |_| count += 1);
    assert_eq!(count, 6_usize.pow(4));
}

#[test]
fn four_to_seven_antennas() {
    for seed in 0..5 {
        for antennas in 4..=6 {
            check(&cube(antennas, 1.0, seed), 0..4);
        }
    }
    check(&cube(7, 0.3, 9), 0..4);
}

#[test]
fn eight_antennas() {
    check(&cube(8, 1.0, 7), 0..4);
}

/// On a roof the condition number of the baselines has no meaning, the other criteria have.
#[test]
fn flat_arrays() {
    check(&cube(6, 0.0, 3), 1..4);
    check(&cube(7, 0.0, 4), 1..4);
}
