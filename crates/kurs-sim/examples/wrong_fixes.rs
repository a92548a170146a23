//! How many fixes are wrong, over all scenarios, many seeds and the hours of a day: table and curve
//! of `docs/experiments/integers.md`.
//!
//! `cargo run --release -p kurs-sim --example wrong_fixes [EPOCHS] [CURVE.svg]`
//!
//! Epochs are a second apart. For `urban` the curve lays the acceptance of the engine beside a fixed
//! ratio test: share of the epochs that are fixed and right, against wrong fixes per fix.
#![allow(clippy::print_stdout, clippy::unwrap_used)]

#[path = "../tests/solving/mod.rs"]
mod solving;

use kurs::engine::{Constraint, Settings};
use kurs::solution::Status;
use kurs_sim::scenario::Scenario;
use plotters::prelude::*;
use solving::{Integers, settings};

const SCENARIOS: [&str; 6] = ["roof-static", "car", "ship", "uav", "few-satellites", "urban"];
/// Rates that acceptance is asked to keep.
const RATES: [f64; 2] = [1e-3, 1e-4];

/// What is known of one epoch's best integers.
struct Judged {
    right: bool,
    fixed: bool,
    ratio: f64,
    rivals: f64,
}

fn main() {
    let mut arguments = std::env::args().skip(1);
    let total: usize = arguments.next().map_or(12_000, |text| text.parse().expect("epochs"));
    let picture = arguments.next();
    let each = total / (SCENARIOS.len() * RATES.len());
    println!("| scenario | rate asked | epochs | fixed and right | wrong | wrong / fixed |");
    println!("|---|---|---|---|---|---|");
    let mut urban = Vec::new();
    for rate in RATES {
        let (mut all_fixed, mut all_wrong) = (0, 0);
        for name in SCENARIOS {
            let judged = run(name, rate, each);
            let fixed = judged.iter().filter(|j| j.fixed).count();
            let wrong = judged.iter().filter(|j| j.fixed && !j.right).count();
            println!(
                "| {name} | {rate:e} | {} | {:.2} % | {wrong} | {:.1e} |",
                judged.len(),
                100.0 * (fixed - wrong) as f64 / judged.len() as f64,
                wrong as f64 / fixed.max(1) as f64
            );
            (all_fixed, all_wrong) = (all_fixed + fixed, all_wrong + wrong);
            if name == "urban" && rate == RATES[0] {
                urban = judged;
            }
        }
        println!(
            "| all | {rate:e} | | {all_fixed} fixed | {all_wrong} | {:.1e} |",
            all_wrong as f64 / all_fixed.max(1) as f64
        );
    }
    let ratio = curve(&urban, |j| j.ratio);
    let rivals = curve(&urban, |j| -j.rivals.ln());
    println!("\nurban: fixed and right at the same share of wrong fixes\n");
    println!("| wrong / fixed at most | ratio test | probability of the rivals |\n|---|---|---|");
    for limit in [3e-2, 1e-2, 3e-3, 1e-3] {
        let best = |points: &[(f64, f64)]| {
            let within = points.iter().filter(|(wrong, _)| *wrong <= limit);
            100.0 * within.map(|(_, right)| *right).fold(0.0, f64::max)
        };
        println!("| {limit:e} | {:.1} % | {:.1} % |", best(&ratio), best(&rivals));
    }
    if let Some(path) = picture {
        draw(&path, &ratio, &rivals).unwrap();
    }
}

/// At least `epochs` epochs of a scenario, hour after hour, seed after seed.
fn run(name: &str, rate: f64, epochs: usize) -> Vec<Judged> {
    let mut judged = Vec::with_capacity(epochs);
    let mut seed = 0;
    while judged.len() < epochs {
        let mut scenario: Scenario = solving::ready(name);
        scenario.seed += 1000 * seed;
        scenario.start = format!("2024-03-10T{:02}:00:00", (12 + 5 * seed) % 24);
        scenario.interval_s = 1.0;
        let known = Settings { max_wrong_fix_rate: rate, ..settings(&scenario, Constraint::Array) };
        solving::solve(scenario, known, |_, row, integers| {
            judged.push(Judged {
                right: integers == Integers::Right,
                fixed: row.status == Status::Fixed,
                ratio: row.ratio.unwrap_or(0.0),
                rivals: row.rivals.unwrap_or(f64::INFINITY).max(1e-300),
            });
        });
        seed += 1;
    }
    judged
}

/// Wrong fixes per fix and right fixes per epoch, for every threshold on `score` (larger is surer).
fn curve(judged: &[Judged], score: impl Fn(&Judged) -> f64) -> Vec<(f64, f64)> {
    let mut order: Vec<&Judged> = judged.iter().collect();
    order.sort_by(|a, b| score(b).total_cmp(&score(a)));
    let (mut right, mut wrong) = (0, 0);
    let mut points = Vec::with_capacity(order.len());
    for one in order {
        if one.right {
            right += 1;
        } else {
            wrong += 1;
        }
        let fixed = (right + wrong) as f64;
        points.push((f64::from(wrong) / fixed, f64::from(right) / judged.len() as f64));
    }
    points
}

/// Both curves, wrong fixes on a logarithmic axis.
fn draw(
    path: &str,
    ratio: &[(f64, f64)],
    rivals: &[(f64, f64)],
) -> Result<(), Box<dyn std::error::Error>> {
    let area = SVGBackend::new(path, (640, 420)).into_drawing_area();
    area.fill(&WHITE)?;
    let mut chart = ChartBuilder::on(&area)
        .margin(12)
        .x_label_area_size(36)
        .y_label_area_size(48)
        .build_cartesian_2d((1e-4..0.3f64).log_scale(), 0.0..1.0)?;
    chart
        .configure_mesh()
        .x_desc("wrong fixes per fix")
        .y_desc("fixed and right, share of all epochs")
        .draw()?;
    let shown = |points: &[(f64, f64)]| -> Vec<(f64, f64)> {
        let step = points.len().div_ceil(2000).max(1);
        points.iter().step_by(step).map(|(w, r)| (w.max(1e-4), *r)).collect()
    };
    for (points, colour, name) in
        [(ratio, RGBColor(213, 94, 0), "fixed ratio"), (rivals, RGBColor(0, 114, 178), "rivals")]
    {
        chart
            .draw_series(LineSeries::new(shown(points), colour.stroke_width(2)))?
            .label(name)
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], colour.stroke_width(2)));
    }
    chart.configure_series_labels().border_style(BLACK).background_style(WHITE).draw()?;
    area.present()?;
    Ok(())
}
