//! The searches over integers against those over the sphere, epoch after epoch.
//!
//! `cargo run --release -p kurs --example search_oracle [EPOCHS]` compares candidates on random
//! epochs (4 to 20 satellites, one or two bands, code noise 0.15 to 0.6 m, baselines of 0.2 to 2 m)
//! and prints how many epochs differ. Six of ten have two antennas and a length known to 0.01 to
//! 5 mm; there all candidates up to a cost of 30 are compared. The others have three or four
//! antennas, with the lists of the baselines joined (`ambiguity/joined_lists.rs`).
//! `search_oracle EPOCHS LENGTH_M` has two antennas at that distance in all of them.
#![expect(clippy::print_stdout, reason = "the count is for reading")]

use kurs::ambiguity::{
    AmbiguityError, MixedFloat, array_constrained, array_constrained::ArrayConstrained,
    length_constrained::LengthConstrained, sphere, sphere::Length, sphere_search,
};
use nalgebra::Vector3;
use rand::RngExt;
use rand_xoshiro::Xoshiro256PlusPlus;

#[path = "../src/ambiguity/joined_lists.rs"]
mod joined_lists;
#[path = "../src/ambiguity/problems.rs"]
#[expect(dead_code, reason = "shared with the tests")]
mod problems;

use joined_lists::Comparison;
use problems::{L1_M, L2_M, Noise, Sky, normal, seeded};

/// Candidates of two antennas up to this cost are compared.
const MAX_COST: f64 = 30.0;
/// Antennas of ten epochs in turn.
const ANTENNAS: [usize; 10] = [2, 3, 2, 4, 2, 3, 2, 3, 2, 2];
/// Ten times what an engine may spend; the few weakest models of four antennas need still more.
const NODE_BUDGET: usize = 200_000;
const THREADS: usize = 2;

fn main() {
    let epochs: usize = std::env::args().nth(1).and_then(|text| text.parse().ok()).unwrap_or(1000);
    let fixed_length_m: Option<f64> = std::env::args().nth(2).and_then(|text| text.parse().ok());
    let mut counts = [Count::default(); 5];
    std::thread::scope(|scope| {
        let parts: Vec<_> = (0..THREADS)
            .map(|part| scope.spawn(move || compare_every(part, epochs, fixed_length_m)))
            .collect();
        for part in parts {
            let part = part.join().expect("counts");
            counts.iter_mut().zip(&part).for_each(|(all, count)| all.merge(count));
        }
    });
    for (antennas, count) in counts.iter().enumerate().filter(|(_, count)| count.epochs > 0) {
        println!(
            "{antennas} antennas: {} epochs, {} candidates compared, {} epochs differ, {} searches \
             without an end",
            count.epochs, count.candidates, count.different, count.gave_up
        );
    }
}

/// Every [`THREADS`]-th epoch from `part` on; each has a seed of its own.
fn compare_every(part: usize, epochs: usize, fixed_length_m: Option<f64>) -> [Count; 5] {
    let mut line = LengthConstrained::default();
    let mut array = ArrayConstrained::default();
    (line.node_budget, array.work_budget) = (NODE_BUDGET, NODE_BUDGET);
    let mut counts = [Count::default(); 5];
    for epoch_number in (part..epochs).step_by(THREADS) {
        let mut random = seeded(epoch_number as u64);
        let antennas = if fixed_length_m.is_some() { 2 } else { ANTENNAS[epoch_number % 10] };
        let comparison = if antennas == 2 {
            let length_m = fixed_length_m.unwrap_or_else(|| random.random_range(0.2..2.0));
            compare_baseline(&mut random, &mut line, length_m)
        } else {
            joined_lists::compare(&mut random, &mut array, antennas)
        };
        counts[antennas].add(comparison);
        if !comparison.same && !comparison.gave_up {
            println!("epoch {epoch_number} ({antennas} antennas) differs");
        }
    }
    counts
}

/// Two antennas at a known distance.
fn compare_baseline(
    random: &mut Xoshiro256PlusPlus,
    search: &mut LengthConstrained,
    length_m: f64,
) -> Comparison {
    let satellites = random.random_range(4..=20);
    let bands: &[f64] = if random.random_bool(0.5) { &[L1_M] } else { &[L1_M, L2_M] };
    let noise = Noise { code_m: random.random_range(0.15..0.6), phase_m: 0.003 };
    let direction = Vector3::from_fn(|_, _| normal(random)).normalize();
    let sky = Sky::random(random, satellites);
    let epoch = sky.epoch(random, bands, noise, &[direction * length_m]);
    let length = Length { length_m, sd_m: [1e-5, 0.002, 0.005][random.random_range(0..3)] };

    let expected = sphere_search::all_within(&epoch.phase_model(), length, MAX_COST);
    let expected = expected.expect("a small sphere");
    let found = match search.solve(&epoch.float, length, expected.len() + 1) {
        Err(AmbiguityError::BudgetExceeded { .. }) => {
            return Comparison { gave_up: true, ..Comparison::default() };
        }
        found => found.expect("a strong model"),
    };
    let next = found.get(expected.len()).map_or(search.proven_to(), |candidate| candidate.cost);
    let same = found.len() >= expected.len()
        && found.iter().zip(&expected).all(|(ours, oracle)| ours.integers == oracle.integers)
        && next > MAX_COST * (1.0 - 1e-6);
    Comparison { candidates: expected.len(), same, gave_up: false }
}

/// Sums over the epochs of one number of antennas.
#[derive(Debug, Clone, Copy, Default)]
struct Count {
    epochs: usize,
    candidates: usize,
    different: usize,
    gave_up: usize,
}

impl Count {
    fn merge(&mut self, other: &Self) {
        self.epochs += other.epochs;
        self.candidates += other.candidates;
        self.different += other.different;
        self.gave_up += other.gave_up;
    }

    fn add(&mut self, comparison: Comparison) {
        self.epochs += 1;
        self.candidates += comparison.candidates;
        self.gave_up += usize::from(comparison.gave_up);
        self.different += usize::from(!comparison.same && !comparison.gave_up);
    }
}
