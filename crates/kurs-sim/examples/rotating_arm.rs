//! The full Monte Carlo comparison of the rotating-arm filters, 100 seeds a row: the table of
//! `docs/experiments/fusion.md`, and figure 2 of the paper with the filter that works.
//!
//! `cargo run --release -p kurs-sim --example rotating_arm [SEEDS]` in the root of the workspace.
#![allow(clippy::print_stdout, clippy::unwrap_used, clippy::cast_possible_truncation)]
#![allow(clippy::cast_sign_loss)]

#[path = "../tests/simulated/rotating_arm/campaign.rs"]
mod campaign;

use campaign::{ACCELERATED, COARSE, Campaign, Candidate, InitialErrors, STEADY, USUAL, corrected};
use kurs::fusion::arm::attitude_form::AttitudeForm::{Euler, Quaternion};
use kurs::fusion::kalman::Gate;
use kurs_sim::rotating_arm::{ArmScenario, Course, TurnShape};
use plotters::prelude::*;

const FIGURE: &str = "docs/experiments/fusion-heading.svg";
/// Rows of the table that the figure shows.
const SHOWN: [(&str, &str, RGBColor); 2] =
    [("C17r U (manoeuvring)", "17 states", BLUE), ("C20 U", "20 states", RED)];

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let seeds = std::env::args().nth(1).map_or(100, |count| count.parse().expect("seeds"));
    let uniform = Course::Uniform { speed_mps: 20.0 };
    let along = Course::AlongHeading { speed_mps: 20.0 };
    let standing = Course::Standing;
    let published_gate = Gate::NoiseOnly { sigmas: 3.0 };
    let with_phase = |candidate| match candidate {
        Candidate::Corrected(mut settings) => {
            settings.ambiguity_slots = 12;
            Candidate::Corrected(settings)
        }
        other => other,
    };
    let rows: Vec<(&str, Candidate, Course, InitialErrors)> = vec![
        ("C17 U", corrected(30.0, 0.03, false, Euler), uniform, USUAL),
        ("C17 T", corrected(30.0, 0.03, false, Euler), along, USUAL),
        ("C17 S", corrected(30.0, 0.03, false, Euler), standing, USUAL),
        ("C17 U from 30°", corrected(30.0, 0.03, false, Euler), uniform, COARSE),
        ("C17r U (manoeuvring)", corrected(30.0, 0.1, false, Euler), uniform, USUAL),
        ("C17r T (manoeuvring)", corrected(30.0, 0.1, false, Euler), along, USUAL),
        ("C17r U from 30°", corrected(30.0, 0.1, false, Euler), uniform, COARSE),
        ("tuned U (balanced)", corrected(1.0, 0.003, false, Euler), uniform, USUAL),
        ("tuned T (balanced)", corrected(1.0, 0.003, false, Euler), along, USUAL),
        ("tuned U from 30°", corrected(1.0, 0.003, false, Euler), uniform, COARSE),
        ("calm U", corrected(0.01, 0.1, false, Euler), uniform, USUAL),
        ("C20 U", corrected(30.0, 1.0, true, Euler), uniform, USUAL),
        ("C20 T", corrected(30.0, 1.0, true, Euler), along, USUAL),
        ("C20 U from 30°", corrected(30.0, 1.0, true, Euler), uniform, COARSE),
        ("Q17 U", corrected(30.0, 0.03, false, Quaternion), uniform, USUAL),
        ("Q17 T", corrected(30.0, 0.03, false, Quaternion), along, USUAL),
        ("Q20 U", corrected(30.0, 1.0, true, Quaternion), uniform, USUAL),
        ("Q20 T", corrected(30.0, 1.0, true, Quaternion), along, USUAL),
        ("Q20 T with phase", with_phase(corrected(30.0, 1.0, true, Quaternion)), along, USUAL),
        ("published U, own world", Candidate::PublishedOwnWorld(published_gate), uniform, USUAL),
        ("published U, own, open", Candidate::PublishedOwnWorld(Gate::Open), uniform, USUAL),
        ("published A5, own, open", Candidate::PublishedOwnWorld(Gate::Open), ACCELERATED, STEADY),
        (
            "published A5, own, open, 2°/s",
            Candidate::PublishedOwnWorld(Gate::Open),
            ACCELERATED,
            USUAL,
        ),
        (
            "published A5, own world",
            Candidate::PublishedOwnWorld(published_gate),
            ACCELERATED,
            STEADY,
        ),
        ("published U, real world", Candidate::PublishedRealWorld(published_gate), uniform, USUAL),
        ("published U, real, open", Candidate::PublishedRealWorld(Gate::Open), uniform, USUAL),
    ];
    println!(
        "| filter and course | lost % | heading steady | tilt steady | manoeuvre | peak p95 | lag s \
         | <2° p95 s | position m | velocity m/s | rejected % |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|---|");
    let mut shown = Vec::new();
    for (name, candidate, course, initial) in rows {
        let campaign = Campaign { initial, ..Campaign::new(candidate, course) };
        let s = campaign.run(0..seeds);
        if let Some((_, label, colour)) = SHOWN.iter().find(|(row, ..)| *row == name) {
            shown.push((*label, *colour, s.mean_heading.clone()));
        }
        println!(
            "| {name} | {:.0} | {:.3} | {:.3} | {:.2} | {:.1} | {:.3} | {:.1} | {:.3} | {:.3} | \
             {:.4} |",
            s.lost_percent,
            s.heading_steady,
            s.tilt_steady,
            s.heading_manoeuvre,
            s.peak_p95,
            s.lag_s,
            s.convergence_p95_s,
            s.position_m,
            s.velocity_mps,
            s.rejected_percent
        );
    }
    print_directions(seeds.min(20));
    draw(&shown)
}

/// The published filter with an open gate, by the direction of the acceleration that its reference does
/// not state.
fn print_directions(seeds: u64) {
    println!("\n| acceleration towards, degrees | heading in the turn, degrees |\n|---|---|");
    for azimuth_deg in [-80.0, -40.0, 0.0, 30.0, 90.0, 100.0, 140.0f64] {
        let azimuth_rad = azimuth_deg.to_radians();
        let course = Course::Accelerated { acceleration_mps2: 5.0, azimuth_rad };
        let published = Candidate::PublishedOwnWorld(Gate::Open);
        let campaign = Campaign { initial: STEADY, ..Campaign::new(published, course) };
        let heading_deg = campaign.run(0..seeds).heading_manoeuvre;
        println!("| {azimuth_deg:.0} | {heading_deg:.1} |");
    }
}

/// Figure 2: the heading that the body turns through and the mean estimates.
fn draw(shown: &[(&str, RGBColor, Vec<f64>)]) -> Result<(), Box<dyn std::error::Error>> {
    const WINDOW_S: core::ops::Range<f64> = 19.5..25.5;
    let area = SVGBackend::new(FIGURE, (800, 420)).into_drawing_area();
    area.fill(&WHITE)?;
    let mut chart = ChartBuilder::on(&area)
        .margin(12)
        .x_label_area_size(36)
        .y_label_area_size(48)
        .build_cartesian_2d(WINDOW_S, 25.0..65.0)?;
    let mut mesh = chart.configure_mesh();
    mesh.x_desc("time, s").y_desc("heading, degrees").light_line_style(WHITE).draw()?;
    let scenario = ArmScenario::reference(Course::Standing, TurnShape::Smooth);
    let steps = (0..=600).map(|k| WINDOW_S.start + f64::from(k) * 0.01);
    let set = steps.map(|time_s| (time_s, scenario.heading_at_rad(time_s).to_degrees()));
    let broad = BLACK.mix(0.25).stroke_width(5);
    chart
        .draw_series(LineSeries::new(set, broad))?
        .label("set")
        .legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], broad));
    for (label, colour, mean_heading) in shown {
        let epochs = mean_heading.iter().enumerate().map(|(k, h)| ((k + 1) as f64 * 0.1, *h));
        let inside = epochs.filter(|(time_s, _)| WINDOW_S.contains(time_s));
        let line = colour.stroke_width(2);
        chart
            .draw_series(LineSeries::new(inside, line))?
            .label(*label)
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], line));
    }
    chart.configure_series_labels().border_style(BLACK).background_style(WHITE).draw()?;
    area.present()?;
    Ok(())
}
