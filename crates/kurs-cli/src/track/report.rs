//! `report.html`: plan and profile with ellipses, residuals by station, standard deviations along
//! the path.

use std::path::{Path, PathBuf};

use kurs::frames::{Ecef, Geodetic, Vector};
use kurs::trajectory::station::Station;
use plotly::common::{Line, Marker, MarkerSymbol, Mode, Title};
use plotly::layout::{Axis, Layout};
use plotly::{Plot, Scatter};

use super::config::Config;
use super::monte_carlo::SetComparison;
use super::path::{PathFound, PathPoint, Status};
use super::write::{local_sigmas, words};
use crate::chart::{self, Clock};
use crate::page::colour::{BLUE, GREEN, GREY, ORANGE};
use crate::page::{Page, laid_out};
use crate::report::span;
use crate::session_span::SessionSpan;

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
    inputs: &[PathBuf],
    out: &Path,
) -> anyhow::Result<()> {
    let mut page = Page::new("Kurs: trajectory from ground measurements");
    write_top(&mut page, config, found, inputs);
    page.heading("Track");
    page.paragraph("East and north of the first station; ellipses of one standard deviation, enlarged as the legend says. For maps: path.geojson, path.kml.");
    page.square_plot(&plan(config, stations, found));
    let clock = Clock::new(located(found).map(|(point, _)| point.time));
    page.heading("Height");
    page.time_plot(&profile(found, &clock));
    page.heading("Standard deviation along the path");
    page.time_plot(&sigmas(found, &clock));
    page.heading("Residuals by station, in standard deviations");
    page.time_plot(&residuals(config, found, &clock));
    for comparison in comparisons {
        page.heading(&format!(
            "{}: least squares (2) and stochastic modelling (5), (6)",
            comparison.name
        ));
        page.plot(&figure_4(comparison));
    }
    page.write(out, "report.html")
}

/// What it is about: numbers, span, inputs, version.
fn write_top(page: &mut Page, config: &Config, found: &PathFound, inputs: &[PathBuf]) {
    let count =
        |status: Status| found.points.iter().filter(|p| p.status == status).count().to_string();
    let mut tiles = vec![["points".to_owned(), found.points.len().to_string()]];
    let statuses = [Status::Ok, Status::Ambiguous, Status::Inconsistent, Status::Lost];
    tiles.extend(statuses.map(|status| [status.word().to_owned(), count(status)]));
    page.tiles(&tiles);
    let mut session = SessionSpan::default();
    found.points.iter().for_each(|point| session.add(point.time));
    let mut facts = span::facts(&session);
    let stations: Vec<&str> = config.station.iter().map(|s| s.name.as_str()).collect();
    facts.push(vec!["stations".to_owned(), stations.join(", ")]);
    let files = inputs.iter().map(|file| vec!["input".to_owned(), file.display().to_string()]);
    facts.extend(files);
    if inputs.is_empty() {
        facts.push(vec!["input".to_owned(), "simulated".to_owned()]);
    }
    facts.push(vec!["made by".to_owned(), format!("kurs {}", env!("CARGO_PKG_VERSION"))]);
    page.table(&[], &facts);
}

fn located(found: &PathFound) -> impl Iterator<Item = (&PathPoint, Vector<Ecef>)> {
    found.points.iter().filter_map(|point| Some((point, point.position_m?)))
}

fn plan(config: &Config, stations: &[Station], found: &PathFound) -> Plot {
    let mut plot = chart::map("km");
    let origin = &stations[0];
    let km = |position: Vector<Ecef>| {
        let sight = origin.sight(position).xyz();
        [sight.y / 1e3, sight.x / 1e3]
    };
    let split = |points: &[[f64; 2]]| -> (Vec<f64>, Vec<f64>) {
        points.iter().map(|p| (p[0], p[1])).unzip()
    };
    let path: Vec<[f64; 2]> = located(found).map(|(_, r)| km(r)).collect();
    let (east, north) = split(&path);
    let marker = Marker::new().color(BLUE).size(4);
    let line = Line::new().color(BLUE).width(1.5);
    plot.add_trace(
        Scatter::new(east, north).mode(Mode::LinesMarkers).line(line).marker(marker).name("path"),
    );
    let places: Vec<[f64; 2]> = stations.iter().map(|s| km(s.position_m())).collect();
    let names: Vec<&str> = config.station.iter().map(|s| s.name.as_str()).collect();
    let (east, north) = split(&places);
    let marker = Marker::new().color(GREEN).symbol(MarkerSymbol::Square).size(9);
    plot.add_trace(
        Scatter::new(east, north)
            .mode(Mode::Markers)
            .marker(marker)
            .hover_text_array(names)
            .name("stations"),
    );
    let (east, north, factor) = ellipses(stations, found);
    let name = format!("ellipses × {factor:.0}");
    let line = Line::new().color(ORANGE).width(1.0);
    plot.add_trace(Scatter::new(east, north).mode(Mode::Lines).line(line).name(name));
    if let Some(start) = path.first() {
        chart::add_start(&mut plot, *start);
    }
    let words: Vec<(&str, [f64; 2])> =
        config.station.iter().map(|s| s.name.as_str()).zip(places.iter().copied()).collect();
    let all: Vec<[f64; 2]> = path.iter().chain(&places).copied().collect();
    chart::finish_map(&mut plot, &all, &words, "km");
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

fn profile(found: &PathFound, clock: &Clock) -> Plot {
    let mut plot = clock.plot("height, m");
    let rows: Vec<(f64, f64)> = located(found)
        .map(|(point, r)| {
            let up = point.covariance_m2.map_or(0.0, |k| local_sigmas(r, &k)[2]);
            (Geodetic::from_ecef(r).height_m, up)
        })
        .collect();
    for (sigmas, name, colour, width) in [
        (0.0, "height", BLUE, 1.5),
        (1.0, "+1 standard deviation", GREY, 1.0),
        (-1.0, "−1 standard deviation", GREY, 1.0),
    ] {
        let values = rows.iter().map(|(height, up)| Some(height + sigmas * up)).collect();
        clock.draw(&mut plot, &values, name, Line::new().color(colour).width(width), colour);
    }
    plot
}

fn sigmas(found: &PathFound, clock: &Clock) -> Plot {
    let mut plot = clock.plot_from_zero("standard deviation, m");
    let rows: Vec<Option<[f64; 3]>> =
        located(found).map(|(p, r)| Some(local_sigmas(r, &p.covariance_m2?))).collect();
    for (axis, (name, colour)) in
        [("north", BLUE), ("east", ORANGE), ("up", GREEN)].iter().enumerate()
    {
        let values = rows.iter().map(|row| row.map(|sigmas| sigmas[axis])).collect();
        clock.draw(&mut plot, &values, name, Line::new().color(*colour).width(1.5), colour);
    }
    plot
}

fn residuals(config: &Config, found: &PathFound, clock: &Clock) -> Plot {
    let mut plot = clock.plot("residual / standard deviation");
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
                .map(|r| {
                    let in_sigmas = r.residual / r.observation.measurement.sigma;
                    (chart::milliseconds(r.observation.time), in_sigmas)
                })
                .unzip();
            if !times.is_empty() {
                let name = format!("{} {name}", station.name);
                let marks = Scatter::new(times, values).mode(Mode::Markers);
                plot.add_trace(marks.marker(Marker::new().size(4)).name(name));
            }
        }
    }
    plot
}

fn figure_4(comparison: &SetComparison) -> Plot {
    let axis = |title: &str| Axis::new().title(Title::with_text(title)).auto_margin(true);
    let layout = Layout::new().x_axis(axis("time, s"));
    let mut plot = laid_out(layout.y_axis(axis("standard deviation (ECEF), m")));
    let times: Vec<f64> = comparison.points.iter().map(|point| point.time_s).collect();
    for (axis, name) in ["x", "y", "z"].into_iter().enumerate() {
        let expected = comparison.points.iter().map(|p| p.information_m[axis]).collect();
        let modelled = comparison.points.iter().map(|p| p.scatter.sigmas_m()[axis]).collect();
        let line = |values, name: String| Scatter::new(times.clone(), values).name(name);
        plot.add_trace(line(expected, format!("{name}: least squares")).mode(Mode::Lines));
        plot.add_trace(line(modelled, format!("{name}: modelled")).mode(Mode::Markers));
    }
    plot
}
