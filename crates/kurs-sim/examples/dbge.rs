#![allow(warnings)]
#[path = "../tests/solving/mod.rs"]
mod solving;
use kurs::engine::{Constraint, Settings};
use kurs_sim::scenario::Scenario;
use solving::figures::Figures;
fn main() {
    let seeds: u64 = std::env::var("SEEDS").map_or(3, |s| s.parse().unwrap());
    for path in std::env::args().skip(1) {
        let jobs: Vec<u64> = (0..seeds).collect();
        let parts = solving::in_parallel(&jobs, |seed| {
            let mut s: Scenario = toml::from_str(&std::fs::read_to_string(&path).unwrap()).unwrap();
            s.seed += 1000 * seed;
            s.start = format!("2024-03-10T{:02}:00:00", (12 + 5 * seed) % 24);
            s.interval_s = std::env::var("STEP").map_or(5.0, |s| s.parse().unwrap());
            let told = solving::as_told(&s, Constraint::Array);
            let set = [told.clone(), solving::continuous(told)];
            let mut f: [Figures; 2] = Default::default();
            solving::solve_each(s, set, |k, t, r, i| f[k].take(t, r, i));
            f
        });
        for k in 0..2 {
            let mut f = Figures::default();
            parts.iter().for_each(|p| f.add(&p[k]));
            println!(
                "   {} rows {} fixed {:.1} wrong {} ({:.2} %) off {} beyond {:.1} {:?} {}",
                ["inst", "cont"][k],
                f.rows,
                f.per_cent(f.fixed),
                f.wrong,
                f.per_cent_of_fixed(f.wrong),
                f.off,
                f.per_cent_of_fixed(f.beyond),
                f.mean_squares(),
                f.most_frequent_reasons(3)
            );
        }
    }
}
