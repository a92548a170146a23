//! Table 1 of the paper: relaxation, five bisections, rounding, against the optimum.

use kurs::selection::published::{RoundingWeight, problem_2, round, round_with_guard};
use kurs::selection::{Baselines, Criterion, Graph, best_by_enumeration};
use rand::SeedableRng;
use rand_xoshiro::Xoshiro256PlusPlus;

use crate::statistics::percent;
use crate::{Law, draw};

/// Bisections in the paper.
const BISECTIONS: usize = 5;
/// Equal condition numbers.
const SAME: f64 = 1.0 + 1e-6;
const CRITERION: Criterion = Criterion::BaselineCondition;
const SEED: u64 = 2019;

const LAWS: [(&str, Law); 7] = [
    ("uniform cube", Law::Box(1.0, 1.0, 1.0)),
    ("normal", Law::Normal),
    ("ball", Law::Ball),
    ("sphere", Law::Sphere),
    ("box 1 × 0.75 × 0.25", Law::Box(1.0, 0.75, 0.25)),
    ("box 1 × 1 × 0.2", Law::Box(1.0, 1.0, 0.2)),
    ("box 1 × 0.3 × 0.1", Law::Box(1.0, 0.3, 0.1)),
];

/// How the approximations of one array kind compare with the optimum.
#[derive(Default)]
struct Tally {
    tests: usize,
    same: usize,
    worst: f64,
    guarded_same: usize,
    guarded_worst: f64,
    /// Both weights lead to different sets.
    differing: usize,
}

impl Tally {
    fn take(&mut self, baselines: &Baselines, graph: Graph) {
        let shares = problem_2(baselines, graph, BISECTIONS);
        let optimum = baselines.value(&best_by_enumeration(baselines, graph, CRITERION), CRITERION);
        let ratio = |chosen: &[usize]| baselines.value(chosen, CRITERION) / optimum;

        let chosen = round(baselines, graph, &shares, RoundingWeight::Complement);
        let other = round(baselines, graph, &shares, RoundingWeight::InverseSquare);
        let guarded =
            round_with_guard(baselines, graph, &shares, RoundingWeight::Complement, CRITERION);
        self.tests += 1;
        self.same += usize::from(ratio(&chosen) < SAME);
        self.worst = self.worst.max(ratio(&chosen));
        self.guarded_same += usize::from(ratio(&guarded) < SAME);
        self.guarded_worst = self.guarded_worst.max(ratio(&guarded));
        self.differing += usize::from(chosen != other);
    }
}

/// Two decimals, or a power of ten where they would mislead.
fn short(ratio: f64) -> String {
    if ratio < 100.0 { format!("{ratio:.2}") } else { format!("{ratio:.0e}") }
}

pub(crate) fn print_table(tests: usize) {
    println!("## The published method (Table 1 of the paper)\n");
    println!(
        "{tests} random arrays per row; problem 1, {BISECTIONS} bisections of problem 2, shares of \
         the last one, weights 1 − s, Prim or integer programme. Per cent of arrays where the \
         optimum is found / largest ratio of condition numbers. Largest ratios hang on single draws.\n"
    );
    println!("| positions | 4 antennas, tree | 4, general | 5, tree | 5, general |");
    println!("|---|---|---|---|---|");
    println!("| paper | 92.4 / 6.92 | 92.5 / 3.59 | 65.8 / 3.21 | 61 / 3.95 |");
    let mut guarded_rows = Vec::new();
    for (name, law) in LAWS {
        let mut row = format!("| {name} |");
        let mut guarded_row = row.clone();
        for antennas in [4, 5] {
            for graph in [Graph::SpanningTree, Graph::General] {
                let mut random = Xoshiro256PlusPlus::seed_from_u64(SEED + antennas as u64);
                let mut tally = Tally::default();
                while tally.tests < tests {
                    let (_, baselines) = draw(antennas, law, &mut random);
                    // A draw that is flat to rounding has no condition number to compare.
                    if baselines.check(CRITERION).is_ok() {
                        tally.take(&baselines, graph);
                    }
                }
                row += &format!(" {} / {} |", percent(tally.same, tests), short(tally.worst));
                if graph == Graph::General {
                    guarded_row += &format!(
                        " {} / {:.2} | {} |",
                        percent(tally.guarded_same, tests),
                        tally.guarded_worst,
                        tally.differing
                    );
                }
            }
        }
        println!("{row}");
        guarded_rows.push(guarded_row);
    }
    println!(
        "\nThe same general graphs with the guard: rounded to a Prim tree too, the better kept."
    );
    println!(
        "Prim's tree is the same for 1 − s and 1/(s + ¼)²; the last column of each pair counts"
    );
    println!("the arrays where the integer programme takes another set with the second weight.\n");
    println!(
        "| positions | 4, general, guarded | weights differ | 5, general, guarded | weights differ |"
    );
    println!("|---|---|---|---|---|");
    guarded_rows.iter().for_each(|row| println!("{row}"));
    println!();
}
