#![allow(warnings)]
#[path = "../tests/links/mod.rs"]
mod links;
use kurs_sim::scenario::Scenario;
fn main() {
    let seeds: u64 = std::env::var("SEEDS").map_or(3, |s| s.parse().unwrap());
    for path in std::env::args().skip(1) {
        for (what, f) in [
            ("all", (|s: &mut Scenario| {}) as fn(&mut Scenario)),
            ("quiet", |s| {
                s.noise.phase_sd_cycles = 0.0;
                s.multipath.phase_sd_m = 0.0;
                s.noise.gain_sd_db = 0.0;
                s.slips.per_hour = 0.0
            }),
        ] {
            let mut sum = links::Links::default();
            for seed in 0..seeds {
                let mut s: Scenario =
                    toml::from_str(&std::fs::read_to_string(&path).unwrap()).unwrap();
                s.seed += 1000 * seed;
                s.start = format!("2024-03-10T{:02}:00:00", (12 + 5 * seed) % 24);
                s.interval_s = std::env::var("STEP").map_or(10.0, |s| s.parse().unwrap());
                f(&mut s);
                sum.add(&links::Links::of(&s));
            }
            print!("{what} {path}: ");
            for c in 0..7 {
                print!("{:.2} of {} | ", 100.0 * sum.share(c), sum.all[c]);
            }
            println!();
        }
    }
}
