//! How many fixes are wrong, over all scenarios, many seeds and the hours of a day: table and curve
//! of `docs/experiments/integers.md`.
//!
//! `cargo run --release -p kurs-sim --example wrong_fixes [EPOCHS] [CURVE.svg]`, `EPOCHS` those of the six
//! whole scenarios at both rates together.
//!
//! Epochs are a second apart. `urban` with both bands hardly ever has wrong best integers, so it is also
//! solved with less: one band, GPS alone, lengths, nothing known. For each of these the acceptance of
//! the engine is laid beside a fixed ratio test: share of the epochs that are fixed and right, against
//! wrong fixes per fix.
#![allow(clippy::print_stdout, clippy::unwrap_used)]

#[path = "../tests/solving/mod.rs"]
mod solving;

use std::collections::BTreeMap;

use kurs::engine::{Constraint, Settings};
use kurs::solution::Status;
use kurs_sim::scenario::Scenario;
use plotters::prelude::*;
use solving::{Integers, settings};

/// A scenario, or part of it.
struct Case {
    name: &'static str,
    scenario: &'static str,
    constraint: Constraint,
    /// Parts of `urban` are slow to search: a tenth of the epochs.
    tenth: bool,
    /// Systems and signals, if not all.
    only: Option<(&'static [&'static str], &'static [&'static str])>,
}

const fn whole(name: &'static str) -> Case {
    Case { name, scenario: name, constraint: Constraint::Array, tenth: false, only: None }
}

const ONE_BAND: Option<(&[&str], &[&str])> = Some((&["G", "E"], &["G1C", "E1C"]));

const fn part_of_urban(
    name: &'static str,
    only: Option<(&'static [&'static str], &'static [&'static str])>,
    constraint: Constraint,
) -> Case {
    Case { name, constraint, tenth: true, only, ..whole("urban") }
}

const CASES: [Case; 10] = [
    whole("roof-static"),
    whole("car"),
    whole("ship"),
    whole("uav"),
    whole("few-satellites"),
    whole("urban"),
    part_of_urban("urban, lengths", None, Constraint::Length),
    part_of_urban("urban, G1 and E1", ONE_BAND, Constraint::Array),
    part_of_urban("urban, G1 and E1, lengths", ONE_BAND, Constraint::Length),
    part_of_urban("urban, G1 and E1, nothing known", ONE_BAND, Constraint::None),
];
/// The case whose curves are drawn.
const DRAWN: &str = "urban, G1 and E1, lengths";
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
    let each = total / (CASES.iter().filter(|c| !c.tenth).count() * RATES.len());
    println!(
        "| scenario | rate asked | epochs | fixed and right | wrong | wrong / fixed | most often not fixed |"
    );
    println!("|---|---|---|---|---|---|---|");
    let mut compared = Vec::new();
    for rate in RATES {
        let (mut all_fixed, mut all_wrong) = (0, 0);
        for case in &CASES {
            let epochs = if case.tenth { each / 10 } else { each };
            let (judged, reasons) = run(case, rate, epochs);
            let fixed = judged.iter().filter(|j| j.fixed).count();
            let wrong = judged.iter().filter(|j| j.fixed && !j.right).count();
            println!(
                "| {} | {rate:e} | {} | {:.2} % | {wrong} | {:.1e} | {reasons} |",
                case.name,
                judged.len(),
                100.0 * (fixed - wrong) as f64 / judged.len() as f64,
                wrong as f64 / fixed.max(1) as f64
            );
            (all_fixed, all_wrong) = (all_fixed + fixed, all_wrong + wrong);
            if case.scenario == "urban" && rate == RATES[0] {
                compared.push((case.name, judged));
            }
        }
        println!(
            "| all | {rate:e} | | {all_fixed} fixed | {all_wrong} | {:.1e} | |",
            all_wrong as f64 / all_fixed.max(1) as f64
        );
    }
    println!(
        "\nFixed and right at the same share of wrong fixes, by a fixed ratio and by the rivals:\n"
    );
    println!("| scenario | wrong / fixed at most | ratio test | probability of the rivals |");
    println!("|---|---|---|---|");
    for (name, judged) in &compared {
        let ratio = curve(judged, |j| j.ratio);
        let rivals = curve(judged, |j| -j.rivals.ln());
        for limit in [1e-2, 1e-3, 1e-4] {
            let best = |points: &[(f64, f64)]| {
                let within = points.iter().filter(|(wrong, _)| *wrong <= limit);
                100.0 * within.map(|(_, right)| *right).fold(0.0, f64::max)
            };
            println!("| {name} | {limit:e} | {:.2} % | {:.2} % |", best(&ratio), best(&rivals));
        }
        if let Some(path) = picture.as_ref().filter(|_| *name == DRAWN) {
            draw(path, &ratio, &rivals).unwrap();
        }
    }
}

/// At least `epochs` epochs of a scenario, hour after hour, seed after seed, and in words the three
/// most frequent reasons of those that are not fixed.
fn run(case: &Case, rate: f64, epochs: usize) -> (Vec<Judged>, String) {
    let mut judged = Vec::with_capacity(epochs);
    let mut reasons: BTreeMap<&str, usize> = BTreeMap::new();
    let mut seed = 0;
    while judged.len() < epochs.max(1) {
        let mut scenario: Scenario = solving::ready(case.scenario);
        scenario.seed += 1000 * seed;
        scenario.start = format!("2024-03-10T{:02}:00:00", (12 + 5 * seed) % 24);
        scenario.interval_s = 1.0;
        if let Some((systems, signals)) = case.only {
            scenario.sky.systems = systems.iter().copied().map(str::to_owned).collect();
            scenario.signals = signals.iter().copied().map(str::to_owned).collect();
        }
        let known = settings(&scenario, case.constraint);
        let known = Settings { max_wrong_fix_rate: rate, ..known };
        solving::solve(scenario, known, |_, row, integers| {
            if let Some(reason) = row.reason {
                *reasons.entry(reason.word()).or_default() += 1;
            }
            judged.push(Judged {
                right: integers == Integers::Right,
                fixed: row.status == Status::Fixed,
                ratio: row.ratio.unwrap_or(0.0),
                rivals: row.rivals.unwrap_or(f64::INFINITY).max(1e-300),
            });
        });
        seed += 1;
    }
    let mut reasons: Vec<(&str, usize)> = reasons.into_iter().collect();
    reasons.sort_by_key(|(_, count)| core::cmp::Reverse(*count));
    let share = |count: usize| 100.0 * count as f64 / judged.len() as f64;
    let words = reasons.iter().take(3).map(|(word, n)| format!("{word} {:.2} %", share(*n)));
    let words = words.collect::<Vec<_>>().join(", ");
    (judged, words)
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
