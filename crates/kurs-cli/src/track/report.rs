//! `report.html`: plan and profile with ellipses, residuals by station, standard deviations along
//! the path.

use std::path::Path;

use kurs::frames::{Ecef, Geodetic, Vector};
use kurs::trajectory::station::Station;
use plotly::common::{Line, Mode, Title};
use plotly::layout::{Axis, Layout};
use plotly::{Plot, Scatter};

use super::config::Config;
use super::monte_carlo::SetComparison;
use super::path::{PathFound, PathPoint, Status};
use super::write::{local_sigmas, words};
use crate::page::Page;

/// Points of an ellipse drawn as a polygon.
const ELLIPSE_POINTS: u32 = 36;
/// Most ellipses in a plot.
const MAX_ELLIPSES: usize = 40;

/// Writes `report.html`.
pub(super) fn write(
    config: &Config,
    stations: &[Station],
    found: &PathFound,
    comparisons: &[SetComparison],
    out: &Path,
) -> anyhow::Result<()> {
    let mut page = Page::new("Trajectory from ground measurements");
    summary(&mut page, found);
    page.heading("Plan");
    page.paragraph("East and north of the first station; ellipses of one standard deviation, enlarged as the legend says.");
    page.plot(&plan(config, stations, found));
    page.heading("Profile");
    page.plot(&profile(found));
    page.heading("Standard deviation along the path");
    page.plot(&sigmas(found));
    page.heading("Residuals by station, in standard deviations");
    page.plot(&residuals(config, found));
    for comparison in comparisons {
        page.heading(&format!(
            "{}: least squares (2) and stochastic modelling (5), (6)",
            comparison.name
        ));
        page.plot(&figure_4(comparison));
    }
    page.write(out, "report.html")
}

fn summary(page: &mut Page, found: &PathFound) {
    let count =
        |status: Status| found.points.iter().filter(|p| p.status == status).count().to_string();
    let rows: Vec<Vec<String>> =
        [Status::Ok, Status::Ambiguous, Status::Inconsistent, Status::Lost]
            .map(|status| vec![status.word().to_owned(), count(status)])
            .to_vec();
    page.table(&["status", "points"], &rows);
}

fn axes(x: &str, y: &str) -> Layout {
    Layout::new()
        .x_axis(Axis::new().title(Title::with_text(x)))
        .y_axis(Axis::new().title(Title::with_text(y)))
}

fn located(found: &PathFound) -> impl Iterator<Item = (&PathPoint, Vector<Ecef>)> {
    found.points.iter().filter_map(|point| Some((point, point.position_m?)))
}

fn seconds(found: &PathFound) -> impl Fn(&PathPoint) -> f64 {
    let first = found.points.first().map(|point| point.time);
    move |point| first.map_or(0.0, |first| point.time - first)
}

fn plan(config: &Config, stations: &[Station], found: &PathFound) -> Plot {
    let mut plot = Plot::new();
    let origin = &stations[0];
    let km = |position: Vector<Ecef>| {
        let sight = origin.sight(position).xyz();
        [sight.y / 1e3, sight.x / 1e3]
    };
    let split = |points: Vec<[f64; 2]>| -> (Vec<f64>, Vec<f64>) {
        points.iter().map(|p| (p[0], p[1])).unzip()
    };
    let (east, north) = split(located(found).map(|(_, r)| km(r)).collect());
    plot.add_trace(Scatter::new(east, north).mode(Mode::LinesMarkers).name("path"));
    let names: Vec<&str> = config.station.iter().map(|s| s.name.as_str()).collect();
    let (east, north) = split(stations.iter().map(|s| km(s.position_m())).collect());
    plot.add_trace(
        Scatter::new(east, north).mode(Mode::MarkersText).text_array(names).name("stations"),
    );

    let (east, north, factor) = ellipses(stations, found);
    let name = format!("ellipses × {factor:.0}");
    plot.add_trace(
        Scatter::new(east, north).mode(Mode::Lines).line(Line::new().width(1.0)).name(name),
    );
    let layout = Layout::new()
        .x_axis(Axis::new().title(Title::with_text("east, km")))
        .y_axis(Axis::new().title(Title::with_text("north, km")).scale_anchor("x"));
    plot.set_layout(layout);
    plot
}

/// Polygons of the horizontal ellipses, separated by gaps, enlarged so that they are seen.
fn ellipses(stations: &[Station], found: &PathFound) -> (Vec<Option<f64>>, Vec<Option<f64>>, f64) {
    let origin = &stations[0];
    let known: Vec<_> =
        located(found).filter_map(|(point, r)| Some((r, point.covariance_m2?))).collect();
    let largest_m = known.iter().map(|(_, k)| k.trace().sqrt()).fold(1e-9, f64::max);
    let extent_m = known.iter().map(|(r, _)| (*r - origin.position_m()).norm()).fold(1.0, f64::max);
    let factor = (0.03 * extent_m / largest_m).clamp(1.0, 1e4).floor();
    let (mut east, mut north) = (Vec::new(), Vec::new());
    for (position, covariance) in known.iter().step_by(known.len().div_ceil(MAX_ELLIPSES).max(1)) {
        let matrix = origin.ned_from_ecef().turn_covariance(covariance);
        let Some(root) = matrix.fixed_view::<2, 2>(0, 0).into_owned().cholesky() else { continue };
        let centre = origin.sight(*position).xyz();
        for step in 0..=ELLIPSE_POINTS {
            let (sine, cosine) =
                (f64::from(step) * core::f64::consts::TAU / f64::from(ELLIPSE_POINTS)).sin_cos();
            let offset = root.l() * nalgebra::Vector2::new(cosine, sine) * factor;
            north.push(Some((centre.x + offset.x) / 1e3));
            east.push(Some((centre.y + offset.y) / 1e3));
        }
        north.push(None);
        east.push(None);
    }
    (east, north, factor)
}

fn profile(found: &PathFound) -> Plot {
    let seconds = seconds(found);
    let mut plot = Plot::new();
    let rows: Vec<(f64, f64, f64)> = located(found)
        .map(|(point, r)| {
            let up = point.covariance_m2.map_or(0.0, |k| local_sigmas(r, &k)[2]);
            (seconds(point), Geodetic::from_ecef(r).height_m, up)
        })
        .collect();
    let times: Vec<f64> = rows.iter().map(|row| row.0).collect();
    let line = |values: Vec<f64>, name: &str| {
        Scatter::new(times.clone(), values).mode(Mode::Lines).name(name)
    };
    plot.add_trace(line(rows.iter().map(|row| row.1).collect(), "height"));
    plot.add_trace(line(rows.iter().map(|row| row.1 + row.2).collect(), "+1 standard deviation"));
    plot.add_trace(line(rows.iter().map(|row| row.1 - row.2).collect(), "−1 standard deviation"));
    plot.set_layout(axes("time, s", "height, m"));
    plot
}

fn sigmas(found: &PathFound) -> Plot {
    let seconds = seconds(found);
    let mut plot = Plot::new();
    let rows: Vec<(f64, [f64; 3])> = located(found)
        .filter_map(|(point, r)| Some((seconds(point), local_sigmas(r, &point.covariance_m2?))))
        .collect();
    let times: Vec<f64> = rows.iter().map(|row| row.0).collect();
    for (axis, name) in ["north", "east", "up"].into_iter().enumerate() {
        let values = rows.iter().map(|row| row.1[axis]).collect();
        plot.add_trace(Scatter::new(times.clone(), values).mode(Mode::Lines).name(name));
    }
    plot.set_layout(axes("time, s", "standard deviation, m"));
    plot
}

fn residuals(config: &Config, found: &PathFound) -> Plot {
    let mut plot = Plot::new();
    let Some(first) = found.residuals.first().map(|r| r.observation.time) else { return plot };
    for (index, station) in config.station.iter().enumerate() {
        for name in
            ["azimuth", "elevation", "range", "range_difference", "cosine_north", "cosine_east"]
        {
            let (times, values): (Vec<f64>, Vec<f64>) = found
                .residuals
                .iter()
                .filter(|r| {
                    let m = r.observation.measurement;
                    m.station == index && words(m.quantity).0 == name
                })
                .map(|r| (r.observation.time - first, r.residual / r.observation.measurement.sigma))
                .unzip();
            if !times.is_empty() {
                let name = format!("{} {name}", station.name);
                plot.add_trace(Scatter::new(times, values).mode(Mode::Markers).name(name));
            }
        }
    }
    plot.set_layout(axes("time, s", "residual / standard deviation"));
    plot
}

fn figure_4(comparison: &SetComparison) -> Plot {
    let mut plot = Plot::new();
    let times: Vec<f64> = comparison.points.iter().map(|point| point.time_s).collect();
    for (axis, name) in ["x", "y", "z"].into_iter().enumerate() {
        let expected = comparison.points.iter().map(|p| p.information_m[axis]).collect();
        let modelled = comparison.points.iter().map(|p| p.scatter.sigmas_m()[axis]).collect();
        let line = |values, name: String| Scatter::new(times.clone(), values).name(name);
        plot.add_trace(line(expected, format!("{name}: least squares")).mode(Mode::Lines));
        plot.add_trace(line(modelled, format!("{name}: modelled")).mode(Mode::Markers));
    }
    plot.set_layout(axes("time, s", "standard deviation (ECEF), m"));
    plot
}
