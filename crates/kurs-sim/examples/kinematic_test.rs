//! The kinematic test of Rapoport's section 5, simulated: the ready scenario `car`, four antennas at
//! 10 Hz. Its figures 2 (track) and 3 (azimuth and roll over time), with the truth beside them.
//!
//! `cargo run --release -p kurs-sim --example kinematic_test [SEEDS]` writes
//! `docs/experiments/kinematic-*.svg` and prints the errors with 95 % intervals of the seeds.
#![allow(clippy::print_stdout, clippy::unwrap_used)]

#[path = "../tests/simulated/solving/mod.rs"]
mod solving;

use kurs::engine::Constraint;
use kurs::frames::{Ecef, Geodetic, Vector};
use nalgebra::Vector3;
use plotters::prelude::*;
use solving::{Tally, settings};

/// One point of a figure for so many epochs.
const EVERY: usize = 4;
const FOLDER: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/experiments");
const TRUTH: RGBColor = RGBColor(230, 159, 0);
const ESTIMATE: RGBColor = RGBColor(0, 114, 178);

/// What the figures show of an epoch: the truth and, where fixed, the estimate.
struct Point {
    time_s: f64,
    place_m: [Vector3<f64>; 2],
    heading_deg: [f64; 2],
    roll_deg: [f64; 2],
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let seeds: u64 = std::env::args().nth(1).map_or(10, |count| count.parse().expect("seeds"));
    let mut tallies = Vec::new();
    let mut points = Vec::new();
    for seed in 0..seeds {
        let (tally, of_seed) = drive(seed);
        tallies.push(tally);
        if seed == 0 {
            points = of_seed;
        }
    }
    print_errors(&tallies);
    draw_track(&points)?;
    draw_angles(&points)?;
    Ok(())
}

fn drive(seed: u64) -> (Tally, Vec<Point>) {
    let mut scenario = solving::ready("car");
    scenario.seed += 100 * seed;
    let known = settings(&scenario, Constraint::Array);
    let (mut tally, mut points, mut origin) = (Tally::default(), Vec::new(), None);
    solving::solve(scenario, known, |truth, row, integers| {
        tally.add(truth, row, integers);
        let (first_time, first_m) = *origin.get_or_insert((truth.time, truth.position_m));
        let attitude = row.attitude().filter(|_| row.is_fixed());
        let (Some(attitude), Some(position)) = (attitude, &row.position) else { return };
        let level = |place_m: Vector<Ecef>| {
            (Geodetic::from_ecef(first_m).ned_from_ecef() * (place_m - first_m)).xyz()
        };
        let both = |truth: f64, found: Option<f64>| [truth, found.unwrap()].map(f64::to_degrees);
        if tally.epochs % EVERY == 1 {
            points.push(Point {
                time_s: truth.time - first_time,
                place_m: [truth.position_m, position.position_m].map(level),
                heading_deg: both(truth.attitude.heading_rad, attitude.heading_rad),
                roll_deg: both(truth.attitude.roll_rad, attitude.roll_rad),
            });
        }
    });
    (tally, points)
}

fn print_errors(tallies: &[Tally]) {
    let count = tallies.len() as f64;
    let sum = |of: fn(&Tally) -> usize| -> usize { tallies.iter().map(of).sum() };
    let (epochs, fixed, wrong) = (sum(|t| t.epochs), sum(|t| t.fixed), sum(|t| t.wrong));
    println!("{} seeds, {epochs} epochs, {fixed} fixed, {wrong} wrong\n", tallies.len());
    println!("| angle | RMS error, degrees |\n|---|---|");
    for (k, name) in ["azimuth", "pitch", "roll"].iter().enumerate() {
        let rms: Vec<f64> = tallies.iter().map(|tally| tally.rms_deg()[k]).collect();
        let mean = rms.iter().sum::<f64>() / count;
        let variance = rms.iter().map(|r| (r - mean).powi(2)).sum::<f64>() / (count - 1.0).max(1.0);
        println!("| {name} | {mean:.3} ± {:.3} |", 1.96 * (variance / count).sqrt());
    }
}

/// Figure 2.
fn draw_track(points: &[Point]) -> Result<(), Box<dyn std::error::Error>> {
    let path = format!("{FOLDER}/kinematic-track.svg");
    let area = SVGBackend::new(&path, (640, 640)).into_drawing_area();
    area.fill(&WHITE)?;
    let ground = |k: usize| points.iter().map(move |p| (p.place_m[k].y, p.place_m[k].x));
    let (east, north) = (limits(ground(0).map(|p| p.0)), limits(ground(0).map(|p| p.1)));
    let mut chart = ChartBuilder::on(&area)
        .margin(12)
        .x_label_area_size(36)
        .y_label_area_size(48)
        .build_cartesian_2d(east, north)?;
    mesh(&mut chart, "east, m", "north, m")?;
    draw_both(&mut chart, ground(0).collect(), ground(1).collect())?;
    legend(&mut chart, SeriesLabelPosition::LowerRight)?;
    area.present()?;
    Ok(())
}

/// Figure 3: azimuth above, roll below.
fn draw_angles(points: &[Point]) -> Result<(), Box<dyn std::error::Error>> {
    let path = format!("{FOLDER}/kinematic-angles.svg");
    let area = SVGBackend::new(&path, (900, 640)).into_drawing_area();
    area.fill(&WHITE)?;
    let end_s = points.last().map_or(1.0, |p| p.time_s);
    let angles = [
        ("azimuth, degrees", azimuths(points), SeriesLabelPosition::LowerLeft),
        (
            "roll, degrees",
            points.iter().map(|p| p.roll_deg).collect(),
            SeriesLabelPosition::LowerRight,
        ),
    ];
    for (part, (name, angle, place)) in area.split_evenly((2, 1)).iter().zip(angles) {
        let range = limits(angle.iter().map(|both| both[1]));
        let mut chart = ChartBuilder::on(part)
            .margin(12)
            .x_label_area_size(36)
            .y_label_area_size(48)
            .build_cartesian_2d(0.0..end_s, range)?;
        mesh(&mut chart, "time, s", name)?;
        let over_time =
            |k: usize| points.iter().zip(&angle).map(|(p, both)| (p.time_s, both[k])).collect();
        draw_both(&mut chart, over_time(0), over_time(1))?;
        legend(&mut chart, place)?;
    }
    area.present()?;
    Ok(())
}

/// Truth and estimate, continued through north so that no line crosses the figure.
fn azimuths(points: &[Point]) -> Vec<[f64; 2]> {
    let near = |angle: f64, reference: f64| angle - 360.0 * ((angle - reference) / 360.0).round();
    let mut before = 0.0;
    let continued = points.iter().map(|point| {
        let [truth, estimate] = point.heading_deg;
        before = near(truth, before);
        [before, near(estimate, before)]
    });
    continued.collect()
}

type Chart<'a> = ChartContext<
    'a,
    SVGBackend<'a>,
    Cartesian2d<plotters::coord::types::RangedCoordf64, plotters::coord::types::RangedCoordf64>,
>;

fn mesh(chart: &mut Chart<'_>, x: &str, y: &str) -> Result<(), Box<dyn std::error::Error>> {
    let whole = |value: &f64| format!("{value:.0}");
    let mut mesh = chart.configure_mesh();
    mesh.x_desc(x).y_desc(y).x_label_formatter(&whole).y_label_formatter(&whole);
    mesh.light_line_style(WHITE).draw()?;
    Ok(())
}

/// The truth as a broad line, the estimate as a thin one on it.
fn draw_both(
    chart: &mut Chart<'_>,
    truth: Vec<(f64, f64)>,
    estimate: Vec<(f64, f64)>,
) -> Result<(), Box<dyn std::error::Error>> {
    for (name, line, colour, width) in
        [("truth", truth, TRUTH, 5), ("estimate", estimate, ESTIMATE, 1)]
    {
        let style = colour.stroke_width(width);
        let key = move |(x, y)| PathElement::new([(x, y), (x + 20, y)], style);
        chart.draw_series(LineSeries::new(line, style))?.label(name).legend(key);
    }
    Ok(())
}

fn legend(
    chart: &mut Chart<'_>,
    place: SeriesLabelPosition,
) -> Result<(), Box<dyn std::error::Error>> {
    let mut labels = chart.configure_series_labels();
    labels.position(place).background_style(WHITE).border_style(BLACK).draw()?;
    Ok(())
}

/// A range with a little room at both ends.
fn limits(values: impl Iterator<Item = f64>) -> core::ops::Range<f64> {
    let (low, high) = values.fold((f64::MAX, f64::MIN), |(low, high), v| (low.min(v), high.max(v)));
    let room = 0.05 * (high - low);
    low - room..high + room
}
