//! The plan as tables on the terminal, as JSON, and as a page.

use std::path::Path;

use comfy_table::{Table, presets};
use kurs::prediction::{AttitudeAccuracy, SimulatedRate};
use kurs::selection::{Criterion, Graph, Pair};
use nalgebra::Vector3;
use plotly::common::{Line, Marker, Mode, Position, Title};
use plotly::layout::{Axis, Layout, RangeMode};
use plotly::{Plot, Scatter};
use serde_json::{Value, json};

use super::improvement::{Improvement, MARGIN_M, MOVE_M};
use super::{Answer, Choice, Epoch, Plan};
use crate::page::colour::{BLUE, GREEN, ORANGE, VERMILION};
use crate::page::{Page, laid_out};

/// What the report says about the choice of baselines, whatever the numbers.
const WHEN_THE_CHOICE_MATTERS: &str = "With the full covariance of the baselines, as `kurs solve` \
    uses it, the choice does not matter: every spanning tree carries the same information as all \
    antennas. It matters when baselines are processed one by one and weighted as if they were \
    independent, or when only some can be processed: the column `error` says what the attitude then \
    loses against all antennas.";

/// Rows of text under a header.
type Rows = Vec<Vec<String>>;

/// The plan for the terminal.
pub(super) fn text(plan: &Plan) -> String {
    let mut text = format!("{}\n\n", summary(plan));
    for note in &plan.notes {
        text += &format!("Note: {note}\n\n");
    }
    for (title, header, rows) in tables(plan) {
        let mut table = Table::new();
        table.load_preset(presets::UTF8_FULL_CONDENSED).set_header(header);
        table.add_rows(rows);
        text += &format!("{title}\n{table}\n\n");
    }
    for remark in remarks(plan) {
        text += &format!("{remark}\n");
    }
    text
}

/// Writes `plan.html`.
pub(super) fn write_page(plan: &Plan, directory: &Path) -> anyhow::Result<()> {
    let mut page = Page::new("Antenna array: what to expect");
    page.paragraph(&summary(plan));
    for note in &plan.notes {
        page.paragraph(&format!("Note: {note}"));
    }
    page.heading("Accuracy over time");
    page.plot(&accuracy_plot(plan));
    page.heading("Array, seen from above, with the chosen baselines");
    page.square_plot(&array_plot(plan));
    for (title, header, rows) in tables(plan) {
        page.heading(title);
        page.table(&header, &rows);
    }
    for remark in remarks(plan) {
        page.paragraph(&remark);
    }
    page.write(directory, "plan.html")
}

/// `plan.json`.
pub(super) fn document(plan: &Plan) -> Value {
    let names = plan.file.names();
    let epochs: Vec<Value> = plan.epochs.iter().map(epoch_json).collect();
    let choices: Vec<Value> =
        plan.choices.iter().map(|choice| choice_json(choice, &names)).collect();
    let improvement =
        plan.improvement.as_ref().map(|improvement| improvement_json(improvement, &names));
    let length_constrained: Vec<Value> = plan
        .length_constrained
        .iter()
        .zip(&names[1..])
        .map(|(rate, rover)| {
            json!({
                "base": names[0],
                "rover": rover,
                "success_rate": rate.map(SimulatedRate::rate),
                "wrong": rate.map(|rate| rate.wrong),
                "epochs": rate.map(|rate| rate.draws),
                "interval_95": rate.map(SimulatedRate::interval),
            })
        })
        .collect();
    json!({
        "version": env!("CARGO_PKG_VERSION"),
        "sky": plan.sky,
        "notes": plan.notes,
        "basis": basis_json(plan),
        "antennas": names,
        "epochs": epochs,
        "length_constrained": length_constrained,
        "array_constrained_success_rate": plan.array_constrained.map(SimulatedRate::rate),
        "array_constrained_wrong": plan.array_constrained.map(|rate| rate.wrong),
        "array_constrained_epochs": plan.array_constrained.map(|rate| rate.draws),
        "array_constrained_interval_95": plan.array_constrained.map(SimulatedRate::interval),
        "improvement": improvement,
        "graph": graph_name(plan.file.plan.graph()),
        "choices": choices,
    })
}

fn choice_json(choice: &Choice, names: &[&str]) -> Value {
    match &choice.answer {
        Ok(answer) => json!({
            "criterion": criterion_name(choice.criterion),
            "baselines": answer.pairs.iter().map(|(i, j)| [names[*i], names[*j]]).collect::<Vec<_>>(),
            "value": answer.value,
            "gap": answer.gap,
            "time_ms": answer.milliseconds,
            "error_relative_to_all_antennas": finite(answer.relative_error),
        }),
        Err(error) => json!({
            "criterion": criterion_name(choice.criterion),
            "refused": error.to_string(),
        }),
    }
}

fn improvement_json(improvement: &Improvement, names: &[&str]) -> Value {
    json!({
        "weakest_axis_body": improvement.weakest_axis.as_slice(),
        "weakest_sd_deg": improvement.weakest_sd_rad.to_degrees(),
        "total_deg": improvement.total_rad.to_degrees(),
        "moved": improvement.moved.map(|(antenna, place, total_rad)| json!({
            "antenna": names[antenna],
            "position_m": place.as_slice(),
            "total_deg": total_rad.to_degrees(),
        })),
        "added": improvement.added.map(|(place, total_rad)| json!({
            "position_m": place.as_slice(),
            "total_deg": total_rad.to_degrees(),
        })),
    })
}

/// Value and origin of each key that the plan rests on.
fn basis_json(plan: &Plan) -> Value {
    let entry = |[key, text, origin]: [String; 3]| {
        let value = text.parse::<f64>().map_or(json!(text), |number| json!(number));
        (key, json!({ "value": value, "from": origin }))
    };
    Value::Object(plan.file.basis().into_iter().map(entry).collect())
}

fn epoch_json(epoch: &Epoch) -> Value {
    let accuracy = epoch.accuracy.as_ref();
    json!({
        "time_gpst": epoch.time.to_string(),
        "satellites": epoch.satellites,
        "heading_sd_deg": accuracy.and_then(|a| a.heading_sd_rad).map(f64::to_degrees),
        "pitch_sd_deg": accuracy.and_then(|a| a.pitch_sd_rad).map(f64::to_degrees),
        "roll_sd_deg": accuracy.and_then(|a| a.roll_sd_rad).map(f64::to_degrees),
        "success_rate": epoch.success_rate,
    })
}

fn summary(plan: &Plan) -> String {
    let settings = &plan.file.plan;
    let covered = plan.epochs.iter().filter(|epoch| epoch.accuracy.is_some()).count();
    format!(
        "{} antennas at {:.3}° {:.3}°, heading {}°; {}; mask {}°; one antenna's noise at the zenith: code \
         {} m, phase {} m; {} of {} epochs from {} have satellites enough.",
        plan.array.len(),
        settings.latitude_deg,
        settings.longitude_deg,
        settings.heading_deg,
        plan.sky,
        settings.elevation_mask_deg,
        settings.code_sd_m,
        settings.phase_sd_m,
        covered,
        plan.epochs.len(),
        plan.epochs.first().map_or_else(String::new, |epoch| epoch.time.to_string()),
    )
}

/// Title, header and rows of every table.
fn tables(plan: &Plan) -> Vec<(&'static str, Vec<&'static str>, Rows)> {
    let basis = plan.file.basis().into_iter().map(Vec::from).collect();
    let mut tables = vec![
        ("What the plan rests on", vec!["key", "value", "from"], basis),
        (
            "Standard deviations with fixed integers, all antennas and their full covariance",
            vec!["", "median", "best", "worst"],
            accuracy_rows(plan),
        ),
        (
            "Success rate of the integers from one epoch",
            vec!["", "median", "best", "worst"],
            success_rows(plan),
        ),
    ];
    if plan.improvement.is_some() {
        let header = vec!["", "where (forward, right, down), m", "total RMS", "change"];
        tables.push(("What one antenna changes", header, improvement_rows(plan)));
    }
    let header = vec!["criterion", "value", "gap", "time", "error", "baselines"];
    tables.push(("Baselines to process", header, choice_rows(plan)));
    tables
}

fn accuracy_rows(plan: &Plan) -> Rows {
    let accuracies = || plan.epochs.iter().filter_map(|epoch| epoch.accuracy.as_ref());
    // What is not seen is worse than anything.
    let angle = |name, sd_rad: fn(&AttitudeAccuracy) -> Option<f64>| {
        spread(name, accuracies().map(|a| sd_rad(a).unwrap_or(f64::INFINITY)).collect(), degrees)
    };
    let mut rows = vec![
        angle("heading", |a| a.heading_sd_rad),
        angle("pitch", |a| a.pitch_sd_rad),
        angle("roll", |a| a.roll_sd_rad),
    ];
    let usable = plan.epochs.iter().filter(|epoch| epoch.accuracy.is_some());
    let satellites = usable.map(|epoch| epoch.satellites as f64).collect();
    let mut row = spread("satellites", satellites, |count| format!("{count}"));
    // More satellites are better: the smallest number is the worst.
    row.swap(2, 3);
    rows.push(row);
    rows
}

fn success_rows(plan: &Plan) -> Rows {
    let rates = plan.epochs.iter().filter_map(|epoch| epoch.success_rate).collect();
    let mut unconstrained = spread("one baseline, bootstrapped, no constraint", rates, percent);
    unconstrained.swap(2, 3);
    let names = plan.file.names();
    let constrained = plan.length_constrained.iter().zip(&names[1..]).map(|(rate, rover)| {
        let name = format!("{}-{rover}, known length", names[0]);
        simulated_row(name, *rate)
    });
    let name = "whole array, known geometry".to_owned();
    let whole = simulated_row(name, plan.array_constrained);
    std::iter::once(unconstrained).chain(constrained).chain([whole]).collect()
}

/// A rate at the median epoch with its 95 % interval.
fn simulated_row(name: String, rate: Option<SimulatedRate>) -> Vec<String> {
    let text = rate.map_or_else(String::new, |rate| {
        let [low, high] = rate.interval().map(|edge| 100.0 * edge);
        let wrong = if rate.wrong > 0 { format!(", {} wrong", rate.wrong) } else { String::new() };
        format!("{} ({low:.1}–{high:.1}; {} epochs{wrong})", percent(rate.rate()), rate.draws)
    });
    vec![name, text, String::new(), String::new()]
}

fn improvement_rows(plan: &Plan) -> Rows {
    let Some(improvement) = &plan.improvement else {
        return Rows::new();
    };
    let place = |p: &Vector3<f64>| format!("{:.2}, {:.2}, {:.2}", p.x, p.y, p.z);
    let change = |total: f64| format!("{:+.0} %", 100.0 * (total / improvement.total_rad - 1.0));
    let mut rows = vec![vec![
        "as it is".to_owned(),
        String::new(),
        degrees(improvement.total_rad),
        String::new(),
    ]];
    if let Some((antenna, position, total)) = &improvement.moved {
        let what = format!("move {} by {MOVE_M} m", plan.file.names()[*antenna]);
        rows.push(vec![what, place(position), degrees(*total), change(*total)]);
    }
    if let Some((position, total)) = &improvement.added {
        let what = format!("one more, {MARGIN_M} m outside");
        rows.push(vec![what, place(position), degrees(*total), change(*total)]);
    }
    rows
}

fn choice_rows(plan: &Plan) -> Rows {
    let row = |choice: &super::Choice| {
        let name = criterion_name(choice.criterion).to_owned();
        match &choice.answer {
            Ok(Answer { pairs, value, gap, milliseconds, relative_error }) => vec![
                name,
                if *value < 1e4 { format!("{value:.4}") } else { format!("{value:.1e}") },
                if *gap == 0.0 { "optimal".to_owned() } else { percent(*gap) },
                format!("{milliseconds:.1} ms"),
                if relative_error.is_finite() {
                    format!("× {relative_error:.3}")
                } else {
                    "none".to_owned()
                },
                pair_names(plan, pairs),
            ],
            Err(error) => {
                let nothing = || String::from("–");
                vec![name, nothing(), nothing(), nothing(), nothing(), error.to_string()]
            }
        }
    };
    plan.choices.iter().map(row).collect()
}

fn remarks(plan: &Plan) -> Vec<String> {
    let mut remarks = Vec::new();
    if let Some(improvement) = &plan.improvement {
        let axis = improvement.weakest_axis;
        let nearest = ["roll", "pitch", "heading"][axis.map(f64::abs).imax()];
        remarks.push(format!(
            "Weakest: the rotation about ({:.2}, {:.2}, {:.2}) in body axes, mostly {nearest}: {} RMS.",
            axis.x, axis.y, axis.z, degrees(improvement.weakest_sd_rad)
        ));
    }
    remarks.push(WHEN_THE_CHOICE_MATTERS.to_owned());
    let is_seen = |a: &AttitudeAccuracy| {
        a.heading_sd_rad.is_some() && a.pitch_sd_rad.is_some() && a.roll_sd_rad.is_some()
    };
    if !plan.epochs.iter().filter_map(|epoch| epoch.accuracy.as_ref()).all(is_seen) {
        let solve = &plan.file.config.solve;
        remarks.push(format!(
            "Not seen: antennas on one line do not tell the angle, or it is less certain than max_angle_sd_deg = {}°. \
             Of the turn about a line only a body level to roll_sd_deg = {}° tells.",
            solve.max_angle_sd_deg, solve.roll_sd_deg
        ));
    }
    remarks.push(
        "The success rates are those of one epoch, with nothing but noise; the constrained ones are the share of \
         simulated epochs that `kurs solve` fixes rightly, at the epoch whose unconstrained rate is the median, with \
         their 95 % interval."
            .to_owned(),
    );
    remarks
}

/// Name, median, smallest and largest.
fn spread(name: &str, mut values: Vec<f64>, write: impl Fn(f64) -> String) -> Vec<String> {
    values.sort_by(f64::total_cmp);
    let at = |place: usize| values.get(place).map_or_else(String::new, |value| write(*value));
    let last = values.len().saturating_sub(1);
    vec![name.to_owned(), at(values.len() / 2), at(0), at(last)]
}

fn degrees(angle_rad: f64) -> String {
    if angle_rad.is_finite() {
        format!("{:.3}°", angle_rad.to_degrees())
    } else {
        "not seen".to_owned()
    }
}

fn percent(share: f64) -> String {
    format!("{:.1} %", 100.0 * share)
}

fn finite(number: f64) -> Option<f64> {
    number.is_finite().then_some(number)
}

fn pair_names(plan: &Plan, pairs: &[Pair]) -> String {
    let names = plan.file.names();
    let pairs: Vec<String> =
        pairs.iter().map(|(i, j)| format!("{}-{}", names[*i], names[*j])).collect();
    pairs.join(" ")
}

fn criterion_name(criterion: Criterion) -> &'static str {
    match criterion {
        Criterion::BaselineCondition => "baseline_condition",
        Criterion::InformationCondition => "information_condition",
        Criterion::SmallestInformation => "smallest_information",
        Criterion::TraceOfCovariance => "trace_of_covariance",
    }
}

fn graph_name(graph: Graph) -> &'static str {
    match graph {
        Graph::SpanningTree => "spanning_tree",
        Graph::General => "general",
        Graph::AllPairs => "all_pairs",
    }
}

/// Standard deviations of the angles over the hours.
fn accuracy_plot(plan: &Plan) -> Plot {
    let mut plot = laid_out(
        Layout::new().x_axis(Axis::new().title(Title::with_text("hours"))).y_axis(
            Axis::new()
                .title(Title::with_text("standard deviation, °"))
                .auto_margin(true)
                .range_mode(RangeMode::ToZero),
        ),
    );
    let mut line = |name, colour: &'static str, sd_rad: fn(&AttitudeAccuracy) -> Option<f64>| {
        let seen = |e: &Epoch| Some((e.hours, sd_rad(e.accuracy.as_ref()?)?.to_degrees()));
        let (hours, values): (Vec<f64>, Vec<f64>) = plan.epochs.iter().filter_map(seen).unzip();
        if !hours.is_empty() {
            let line = Line::new().color(colour);
            plot.add_trace(Scatter::new(hours, values).mode(Mode::Lines).line(line).name(name));
        }
    };
    line("heading", BLUE, |a| a.heading_sd_rad);
    line("pitch", ORANGE, |a| a.pitch_sd_rad);
    line("roll", GREEN, |a| a.roll_sd_rad);
    plot
}

/// Antennas with right to the right and forward up, and the baselines of the file's criterion.
fn array_plot(plan: &Plan) -> Plot {
    let at = |antenna: usize| plan.array.positions_m()[antenna].xyz();
    let mut plot = laid_out(
        Layout::new()
            .x_axis(Axis::new().title(Title::with_text("right, m")).zero_line(false))
            .y_axis(
                Axis::new()
                    .title(Title::with_text("forward, m"))
                    .auto_margin(true)
                    .zero_line(false)
                    .scale_anchor("x"),
            ),
    );
    let chosen = plan.choices.iter().find(|c| c.criterion == plan.file.plan.criterion());
    for (i, j) in chosen.and_then(|c| c.answer.as_ref().ok()).map_or(&[][..], |a| &a.pairs) {
        let line = Scatter::new(vec![at(*i).y, at(*j).y], vec![at(*i).x, at(*j).x]);
        let stroke = Line::new().color(BLUE);
        plot.add_trace(line.mode(Mode::Lines).line(stroke).show_legend(false));
    }
    let (right, forward) =
        (0..plan.array.len()).map(|a| (at(a).y, at(a).x)).unzip::<_, _, Vec<_>, Vec<_>>();
    let names = plan.file.names().into_iter().map(str::to_owned).collect();
    plot.add_trace(
        Scatter::new(right, forward)
            .mode(Mode::MarkersText)
            .text_array(names)
            .text_position(Position::TopCenter)
            .marker(Marker::new().color(VERMILION).size(9))
            .show_legend(false),
    );
    plot
}
