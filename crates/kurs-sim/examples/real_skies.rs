//! What goes wrong under real skies, one fault at a time, each in many sessions: weak models under
//! reflections, lengths told wrong, half cycles, ephemerides and codes that are off. Table of
//! `docs/experiments/real-skies.md`.
//!
//! `cargo run --release -p kurs-sim --example real_skies -- [--rate RATE] [SEEDS [KIND]]`: sessions of 200
//! epochs (default 8 of each kind) of those kinds whose names contain `KIND`, each epoch alone and
//! continuous on the same observations.
#![allow(clippy::print_stdout, clippy::unwrap_used)]

#[path = "../tests/simulated/solving/mod.rs"]
mod solving;

use kurs::array::AntennaArray;
use kurs::engine::{Constraint, Settings};
use kurs::frames::Vector;
use kurs::signal::System::{Galileo, Gps};
use kurs::signal::{Satellite, System};
use kurs_sim::noise::Noise;
use kurs_sim::scenario::{Bias, Scenario};
use solving::figures::Figures;
use solving::sky::{leave_only, satellites};
use solving::{as_told, continuous, in_parallel, solve_each};

/// Two antennas a metre apart, at rest; noise of 2 mm and 0.3 m at the zenith.
const PAIR: &str = r#"
start = "2024-03-10T00:00:00"
duration_s = 199.0
interval_s = 1.0
signals = ["G1C"]
[sky]
systems = ["G"]
[noise]
law = "mixed"
code_sd_m = 0.3
phase_sd_cycles = 0.0105
[[body]]
name = "boom"
[body.motion]
kind = "static"
place = { latitude_deg = 45.9, longitude_deg = 21.1, height_m = 100.0 }
heading_deg = 70.0
[[body.antenna]]
name = "A0"
position_m = [0.0, 0.0, 0.0]
[[body.antenna]]
name = "A1"
position_m = [1.0, 0.0, 0.0]
"#;
const THIRD: &str = "[[body.antenna]]\nname = \"A2\"\nposition_m = [0.2, 0.9, 0.0]\n";
/// What the configuration says of the survey, m.
const TOLD_SD_M: f64 = 0.002;
/// A wrong array should be known for wrong after so many rows.
const ROWS_TO_LEARN: usize = 100;

/// A fault, and how a session with it is made.
struct Kind {
    name: &'static str,
    scene: fn(u64) -> Scene,
}

/// A session, and by how much the first baseline is told too long.
struct Scene {
    scenario: Scenario,
    told_longer_m: f64,
}

const KINDS: &[Kind] = &[
    Kind { name: "G1, 7 satellites, white noise", scene: |seed| few(seed, 7, 0).right() },
    Kind {
        name: "G1, 7 satellites, reflections",
        scene: |seed| reflected(few(seed, 7, 0)).right(),
    },
    Kind {
        name: "G1, 6 satellites, reflections",
        scene: |seed| reflected(few(seed, 6, 0)).right(),
    },
    Kind { name: "G1 E1, 4 + 3, reflections", scene: |seed| reflected(few(seed, 4, 3)).right() },
    Kind {
        name: "three antennas, G1, 7, reflections",
        scene: |seed| {
            let mut scenario = session(seed, &["G1C"], THIRD);
            leave_only(&mut scenario, &[(Gps, 7)]);
            reflected(scenario).right()
        },
    },
    Kind {
        name: "G1 G2, 7, codes reflected alike",
        scene: |seed| {
            let mut scenario = session(seed, &["G1C", "G2L"], "");
            leave_only(&mut scenario, &[(Gps, 7)]);
            scenario.multipath.code_sd_m = 3.0;
            scenario.multipath.phase_sd_m = 0.004;
            scenario.multipath.correlation_s = correlation_s(seed);
            scenario.multipath.common_share = 1.0;
            scenario.right()
        },
    },
    Kind { name: "7 satellites, length right", scene: |seed| few(seed, 4, 3).right() },
    Kind { name: "7 satellites, told +19 cm", scene: |seed| few(seed, 4, 3).told_longer(0.1903) },
    Kind { name: "7 satellites, told -19 cm", scene: |seed| few(seed, 4, 3).told_longer(-0.1903) },
    Kind { name: "7 satellites, told +5 cm", scene: |seed| few(seed, 4, 3).told_longer(0.05) },
    Kind { name: "7 satellites, told -5 cm", scene: |seed| few(seed, 4, 3).told_longer(-0.05) },
    Kind { name: "open sky, length right", scene: |seed| open(seed).right() },
    Kind { name: "open sky, told +19 cm", scene: |seed| open(seed).told_longer(0.1903) },
    Kind { name: "open sky, told -19 cm", scene: |seed| open(seed).told_longer(-0.1903) },
    Kind { name: "open sky, told +5 cm", scene: |seed| open(seed).told_longer(0.05) },
    Kind { name: "open sky, told -5 cm", scene: |seed| open(seed).told_longer(-0.05) },
    Kind {
        name: "a fifth half a cycle off",
        scene: |seed| {
            let half = |_: &mut Noise| Bias {
                antenna: "A1".to_owned(),
                phase_cycles: 0.5,
                ..Bias::default()
            };
            spoilt(open(seed), 0.2, half).right()
        },
    },
    Kind {
        name: "three ephemerides 1 km off",
        scene: |seed| {
            let scenario = session(seed, &["G1C", "G2L"], "");
            let three = 3.0 / satellites(&scenario).len() as f64;
            spoilt(scenario, three, |noise| range_error(noise, [60.0, 250.0])).right()
        },
    },
    Kind {
        name: "a quarter of 7 codes 5-50 m off",
        scene: |seed| {
            spoilt(few(seed, 7, 0), 0.25, |noise| range_error(noise, [5.0, 50.0])).right()
        },
    },
    Kind {
        name: "a quarter of codes 5-50 m off",
        scene: |seed| spoilt(open(seed), 0.25, |noise| range_error(noise, [5.0, 50.0])).right(),
    },
    Kind {
        name: "half of the satellites 400 m off",
        scene: |seed| {
            let pulled = |_: &mut Noise| Bias { code_m: 400.0, ..Bias::default() };
            spoilt(open(seed), 0.5, pulled).right()
        },
    },
];

/// A session of the pair, with more antennas.
fn session(seed: u64, signals: &[&str], more: &str) -> Scenario {
    let mut scenario: Scenario = toml::from_str(&format!("{PAIR}{more}")).unwrap();
    scenario.seed = 100 + seed;
    scenario.start = format!("2024-03-10T{:02}:{:02}:00", 5 * seed % 24, 17 * seed % 60);
    scenario.signals = signals.iter().copied().map(str::to_owned).collect();
    if signals.iter().any(|signal| signal.starts_with('E')) {
        scenario.sky.systems.push("E".to_owned());
    }
    scenario
}

/// The pair with few satellites of GPS and of Galileo on one band.
fn few(seed: u64, gps: usize, galileo: usize) -> Scenario {
    let signals: &[&str] = if galileo > 0 { &["G1C", "E1C"] } else { &["G1C"] };
    let mut scenario = session(seed, signals, "");
    leave_only(&mut scenario, &[(Gps, gps), (Galileo, galileo)] as &[(System, usize)]);
    scenario
}

/// The pair with all satellites of GPS and Galileo on one band.
fn open(seed: u64) -> Scenario {
    session(seed, &["G1C", "E1C"], "")
}

/// With reflections of about 4 mm and 0.5 m at 40° that stay for 10 to 60 s.
fn reflected(mut scenario: Scenario) -> Scenario {
    scenario.multipath.code_sd_m = 0.8;
    scenario.multipath.phase_sd_m = 0.006;
    scenario.multipath.correlation_s = correlation_s(scenario.seed);
    scenario
}

fn correlation_s(seed: u64) -> f64 {
    10.0 + 10.0 * (seed % 6) as f64
}

/// With a bias of its own for each of a share of the satellites in view.
fn spoilt(mut scenario: Scenario, share: f64, bias: impl Fn(&mut Noise) -> Bias) -> Scenario {
    let hidden: Vec<String> = scenario.outage.iter().flat_map(|o| o.satellites.clone()).collect();
    let mut visible = satellites(&scenario);
    visible.retain(|satellite| !hidden.contains(&satellite.to_string()));
    let count = (share * visible.len() as f64).round().max(1.0);
    let mut noise = Noise::seeded(scenario.seed);
    for (satellite, _) in visible.iter().rev().zip(0..).take_while(|(_, k)| f64::from(*k) < count) {
        let satellites = vec![Satellite::to_string(satellite)];
        scenario.bias.push(Bias { satellites, ..bias(&mut noise) });
    }
    scenario
}

/// A pseudorange error of either sign, the same for all antennas.
fn range_error(noise: &mut Noise, [low, high]: [f64; 2]) -> Bias {
    let size_m = low + (high - low) * noise.uniform();
    let code_m = if noise.uniform() < 0.5 { -size_m } else { size_m };
    Bias { code_m, ..Bias::default() }
}

/// Turns a scenario into a scene.
trait Told {
    fn told_longer(self, by_m: f64) -> Scene;

    fn right(self) -> Scene;
}

impl Told for Scenario {
    fn told_longer(self, by_m: f64) -> Scene {
        Scene { scenario: self, told_longer_m: by_m }
    }

    fn right(self) -> Scene {
        self.told_longer(0.0)
    }
}

impl Scene {
    fn settings(&self, rate: f64) -> Settings {
        let mut places: Vec<[f64; 3]> =
            self.scenario.body[0].antenna.iter().map(|antenna| antenna.position_m).collect();
        places[1][0] += self.told_longer_m;
        let places = places.into_iter().map(|[x, y, z]| Vector::new(x, y, z)).collect();
        Settings {
            array: Some(AntennaArray::new(places).unwrap()),
            array_sd_m: TOLD_SD_M,
            max_wrong_fix_rate: rate,
            ..as_told(&self.scenario, Constraint::Array)
        }
    }
}

/// What a kind came to in one mode.
#[derive(Debug, Clone, Default)]
struct Sum {
    figures: Figures,
    /// Rows after the first of each session, and those that blame the array.
    later: usize,
    array_blamed: usize,
}

impl Sum {
    fn add(&mut self, other: &Self) {
        self.figures.add(&other.figures);
        self.later += other.later;
        self.array_blamed += other.array_blamed;
    }
}

fn main() {
    let mut words: Vec<String> = std::env::args().skip(1).collect();
    let flag = words.iter().position(|word| word == "--rate");
    let rate = flag.map_or(1e-3, |k| {
        let rate = words.remove(k + 1).parse().expect("rate");
        words.remove(k);
        rate
    });
    let seeds: u64 = words.first().map_or(8, |text| text.parse().expect("seeds"));
    let wanted = words.get(1).map_or("", String::as_str);
    println!("rate {rate:e}, {seeds} sessions of 200 rows\n");
    println!(
        "| kind | mode | rows | fixed | wrong | wrong of fixed (95 %) | off | beyond 3 σ | position beyond 5 σ | array blamed after {ROWS_TO_LEARN} rows | most often not fixed |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|---|");
    for kind in KINDS.iter().filter(|kind| kind.name.contains(wanted)) {
        let seeds: Vec<u64> = (0..seeds).collect();
        let of_seeds = in_parallel(&seeds, |seed| solve(&(kind.scene)(*seed), rate));
        for (k, mode) in ["each alone", "continuous"].iter().enumerate() {
            let mut sum = Sum::default();
            of_seeds.iter().for_each(|of_seed| sum.add(&of_seed[k]));
            print_row(kind.name, mode, &sum);
        }
    }
}

/// Each epoch alone and continuous.
fn solve(scene: &Scene, rate: f64) -> [Sum; 2] {
    let alone = scene.settings(rate);
    let mut sums: [Sum; 2] = Default::default();
    solve_each(
        scene.scenario.clone(),
        [alone.clone(), continuous(alone)],
        |k, truth, row, integers| {
            let sum = &mut sums[k];
            sum.figures.take(truth, row, integers);
            if sum.figures.rows > ROWS_TO_LEARN {
                sum.later += 1;
                let word = row.reason().map_or("", |reason| reason.word());
                sum.array_blamed += usize::from(["length", "geometry"].contains(&word));
            }
        },
    );
    sums
}

fn print_row(kind: &str, mode: &str, sum: &Sum) {
    let figures = &sum.figures;
    let [wrong, low, high] = figures.wrong_per_fix().map(|share| 100.0 * share);
    println!(
        "| {kind} | {mode} | {} | {:.1} % | {} | {wrong:.2} % ({low:.2} to {high:.2}) | {} | {:.1} % | {:.1} % | {:.1} % | {} |",
        figures.rows,
        figures.per_cent(figures.fixed),
        figures.wrong,
        figures.off,
        figures.per_cent_of_fixed(figures.beyond),
        100.0 * figures.far as f64 / figures.located.max(1) as f64,
        100.0 * sum.array_blamed as f64 / sum.later.max(1) as f64,
        figures.most_frequent_reasons(3),
    );
}
