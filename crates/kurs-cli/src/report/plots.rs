//! The plots of the report.

use core::f64::consts::FRAC_PI_2;
use std::collections::BTreeSet;

use kurs::ephemeris::{Ephemeris, EphemerisStore};
use kurs::frames::{Ecef, Vector};
use kurs::signal::{Satellite, System};
use kurs::sky::Horizon;
use kurs::solution::Status;
use kurs::time::GpsTime;
use plotly::common::{
    Anchor, ColorBar, ColorScale, ColorScalePalette, DashType, Fill, Font, Line, Marker,
    MarkerSymbol, Mode, Orientation, Title,
};
use plotly::layout::{Axis, AxisConstrain, AxisType, CategoryOrder, RangeMode};
use plotly::{Layout, Plot, Scatter};

use super::Sample;
use super::residuals::{OfCell, OfSignal, Residuals};
use crate::page::colour::{BLUE, GREEN, GREY, ORANGE, VERMILION};
use crate::page::laid_out;
use crate::truth::difference_deg;

const ONE_SIGMA: &str = "rgba(86,180,233,0.45)";
const THREE_SIGMA: &str = "rgba(86,180,233,0.20)";
/// Residuals from here on have the last colour of the scale.
const MAX_COLOUR_MM: f64 = 8.0;
/// Lines are broken where the time to the next epoch is so many times the usual one.
const LONG_GAP: f64 = 5.0;
/// Times at which the sky is drawn.
const SKY_INSTANTS: usize = 60;

/// Values over time; gaps where there are none.
type Curve = Vec<Option<f64>>;

/// An angle with its bands of one and three standard deviations, and the truth where known.
pub(super) fn angle(samples: &[Sample], k: usize, name: &str) -> Plot {
    let mut plot = over_time(samples, &format!("{name}, degrees"));
    let angles = continued(curve(samples, |sample| sample.angles_deg[k]));
    add_bands(&mut plot, samples, k, &angles);
    add_line(&mut plot, samples, &angles, "solution", Line::new().color(BLUE).width(1.5));
    if samples.iter().any(|sample| sample.truth_deg.is_some()) {
        let truth = curve(samples, |sample| sample.truth_deg.map(|angles| angles[k]));
        // On top, with gaps through which the solution is seen.
        let line = Line::new().color(VERMILION).width(2.0).dash(DashType::Dash);
        add_line(&mut plot, samples, &continued_beside(truth, &angles), "truth", line);
    }
    plot
}

/// Whether the plot of the heading leaves the range of a compass.
pub(super) fn is_continued(samples: &[Sample]) -> bool {
    let headings = continued(curve(samples, |sample| sample.angles_deg[0]));
    headings.iter().flatten().any(|heading| !(0.0..=360.0).contains(heading))
}

/// The error of an angle inside the bands that it claims.
pub(super) fn error(samples: &[Sample], k: usize, name: &str) -> Plot {
    let mut plot = over_time(samples, &format!("{name} error, degrees"));
    let zero = curve(samples, |sample| sample.angles_deg[k].map(|_| 0.0));
    add_bands(&mut plot, samples, k, &zero);
    let error = |sample: &Sample| Some(difference_deg(sample.angles_deg[k]?, sample.truth_deg?[k]));
    let line = Line::new().color(BLUE).width(1.5);
    add_line(&mut plot, samples, &curve(samples, error), "solution minus truth", line);
    plot
}

/// A line for every status and reason that occurs, and their number.
pub(super) fn status(samples: &[Sample]) -> (Plot, usize) {
    let label = |sample: &Sample| match sample.reason {
        "" => sample.status.word().to_owned(),
        reason => format!("{}: {reason}", sample.status.word()),
    };
    let mut plot = over_time(samples, "");
    let mut lines = BTreeSet::new();
    for status in Status::ALL {
        let of_status: Vec<&Sample> = samples.iter().filter(|s| s.status == status).collect();
        if of_status.is_empty() {
            continue;
        }
        let colour = match status {
            Status::Fixed => GREEN,
            Status::Float => ORANGE,
            Status::Lost | Status::NotCapable => GREY,
            Status::Inconsistent => VERMILION,
        };
        let times: Vec<f64> = of_status.iter().map(|s| s.elapsed_s).collect();
        let labels: Vec<String> = of_status.iter().map(|s| label(s)).collect();
        lines.extend(labels.iter().cloned());
        let marker = Marker::new().color(colour).size(5);
        plot.add_trace(
            Scatter::new(times, labels).mode(Mode::Markers).marker(marker).name(status.word()),
        );
    }
    (plot, lines.len())
}

/// The length of a baseline, and the length it should have.
pub(super) fn length(samples: &[Sample], k: usize, name: &str, known_m: Option<f64>) -> Plot {
    let mut plot = over_time(samples, &format!("{name}, m"));
    let marker = Marker::new().color(BLUE).size(3);
    let lengths = curve(samples, |sample| sample.lengths_m.get(k).copied().flatten());
    plot.add_trace(
        Scatter::new(times(samples), lengths).mode(Mode::Markers).marker(marker).name("solution"),
    );
    if let Some(known_m) = known_m {
        let known = vec![Some(known_m); samples.len()];
        add_line(&mut plot, samples, &known, "known", Line::new().color(VERMILION).width(1.5));
    }
    plot
}

/// RMS of the double-differenced phase residuals.
pub(super) fn residuals(samples: &[Sample]) -> Plot {
    let mut plot = over_time(samples, "phase, RMS, mm");
    let rms = curve(samples, |sample| sample.residual_rms_m.map(|rms| rms * 1e3));
    add_line(&mut plot, samples, &rms, "phase residuals", Line::new().color(BLUE).width(1.5));
    plot
}

/// RMS phase residual of every satellite, a mark for each signal.
pub(super) fn phase_residuals(signals: &[OfSignal]) -> Plot {
    by_satellite("phase, RMS, mm", signals, |of_signal| (&of_signal.phase_m, 1e3))
}

/// RMS code residual of every satellite, a mark for each signal.
pub(super) fn code_residuals(signals: &[OfSignal]) -> Plot {
    by_satellite("code, RMS, m", signals, |of_signal| (&of_signal.code_m, 1.0))
}

fn by_satellite(
    title: &str,
    signals: &[OfSignal],
    values: impl Fn(&OfSignal) -> (&Vec<(Satellite, f64)>, f64),
) -> Plot {
    const SYMBOLS: [MarkerSymbol; 4] =
        [MarkerSymbol::Circle, MarkerSymbol::Square, MarkerSymbol::Diamond, MarkerSymbol::Cross];
    let mut plot = laid_out(
        Layout::new()
            .x_axis(
                Axis::new()
                    .type_(AxisType::Category)
                    .category_order(CategoryOrder::CategoryAscending),
            )
            .y_axis(
                Axis::new()
                    .title(Title::with_text(title))
                    .auto_margin(true)
                    .range_mode(RangeMode::ToZero),
            ),
    );
    let (mut system, mut of_system) = (None, 0);
    for of_signal in signals {
        // Colours tell systems apart, shapes the signals of one system.
        let own = of_signal.signal.band.system;
        of_system = if system == Some(own) { of_system + 1 } else { 0 };
        system = Some(own);
        let (rms, factor) = values(of_signal);
        let names: Vec<String> = rms.iter().map(|(satellite, _)| satellite.to_string()).collect();
        let heights: Vec<f64> = rms.iter().map(|(_, rms)| rounded(rms * factor)).collect();
        let symbol = SYMBOLS[of_system % SYMBOLS.len()].clone();
        let marker = Marker::new().color(colour_of(own)).symbol(symbol).size(8);
        let name = of_signal.signal.to_string();
        plot.add_trace(Scatter::new(names, heights).mode(Mode::Markers).marker(marker).name(name));
    }
    plot
}

/// How many satellites take part.
pub(super) fn satellites(samples: &[Sample]) -> Plot {
    let mut plot = over_time_from_zero(samples, "satellites");
    let count = curve(samples, |sample| Some(sample.satellites as f64));
    add_line(&mut plot, samples, &count, "satellites", Line::new().color(BLUE).width(1.5));
    plot
}

/// How sure the integers are before the fact.
pub(super) fn success_rate(samples: &[Sample]) -> Plot {
    let mut plot = over_time_from_zero(samples, "success rate");
    let rate = curve(samples, |sample| sample.success_rate);
    let line = Line::new().color(BLUE).width(1.5);
    add_line(&mut plot, samples, &rate, "predicted success rate", line);
    plot
}

/// The satellites above the horizon, zenith in the middle, north up: where phases were used coloured by
/// their residuals, and the paths of the others.
pub(super) fn sky(samples: &[Sample], ephemerides: &EphemerisStore, residuals: &Residuals) -> Plot {
    let axis = || Axis::new().visible(false).range(vec![-1.15, 1.15]);
    let mut plot = laid_out(
        Layout::new()
            .x_axis(axis().constrain(AxisConstrain::Domain))
            .y_axis(axis().constrain(AxisConstrain::Domain).scale_anchor("x")),
    );
    let (east, north, letters) =
        ([0.0, 1.08, 0.0, -1.08], [1.08, 0.0, -1.08, 0.0], ["N", "E", "S", "W"]);
    let quarters = Scatter::new(east.to_vec(), north.to_vec()).mode(Mode::Text);
    plot.add_trace(quarters.text_array(letters.to_vec()).show_legend(false));
    for elevation_deg in [0.0, 30.0, 60.0] {
        let circle: Vec<(f64, f64)> = (0..=72)
            .map(|k| on_disc(f64::from(k) * 5f64.to_radians(), f64::to_radians(elevation_deg)))
            .collect();
        let (x, y): (Vec<f64>, Vec<f64>) = circle.into_iter().unzip();
        let line = Line::new().color("#cccccc").width(1.0);
        let name = format!("{elevation_deg}°");
        plot.add_trace(
            Scatter::new(x, y).mode(Mode::Lines).line(line).name(name).show_legend(false),
        );
    }
    let heights = Scatter::new(vec![0.0; 2], [30.0, 60.0].map(|deg| 1.0 - deg / 90.0).to_vec());
    let heights = heights.mode(Mode::Text).text_array(vec!["30°", "60°"]);
    plot.add_trace(heights.text_font(Font::new().size(10).color(GREY)).show_legend(false));
    add_paths(&mut plot, samples, ephemerides);
    add_cells(&mut plot, residuals);
    plot
}

/// Paths of all satellites, by the orbits.
fn add_paths(plot: &mut Plot, samples: &[Sample], ephemerides: &EphemerisStore) {
    let places: Vec<(GpsTime, Vector<Ecef>)> = {
        let step = samples.len().div_ceil(SKY_INSTANTS).max(1);
        let chosen = samples.iter().step_by(step);
        chosen.filter_map(|s| Some((s.time, s.position?.1))).collect()
    };
    let mut known: Vec<Satellite> = ephemerides.iter().map(Ephemeris::satellite).collect();
    known.dedup();
    let (mut x, mut y, mut names) = (Vec::new(), Vec::new(), Vec::new());
    for satellite in known {
        for (time, place_m) in &places {
            let Ok(state) = ephemerides.state(satellite, *time) else { continue };
            let line_of_sight = (state.position_m - *place_m).direction();
            let direction = Horizon::at(*place_m).direction(line_of_sight);
            if direction.elevation_rad > 0.0 {
                let (east, north) = on_disc(direction.azimuth_rad, direction.elevation_rad);
                x.push(rounded(east));
                y.push(rounded(north));
                names.push(satellite.to_string());
            }
        }
    }
    let marker = Marker::new().color(GREY).size(3);
    let paths = Scatter::new(x, y).mode(Mode::Markers).marker(marker).hover_text_array(names);
    plot.add_trace(paths.name("not used"));
}

/// Where phases were used: the shape tells the system, the colour the residual.
fn add_cells(plot: &mut Plot, residuals: &Residuals) {
    let mut has_scale = false;
    for system in System::ALL {
        let cells = residuals.by_cell(system);
        if cells.is_empty() {
            continue;
        }
        let place = |cell: &OfCell| on_disc(cell.azimuth_rad, cell.elevation_rad);
        let (x, y): (Vec<f64>, Vec<f64>) =
            cells.iter().map(place).map(|(east, north)| (rounded(east), rounded(north))).unzip();
        let millimetres: Vec<f64> = cells.iter().map(|cell| rounded(cell.phase_m * 1e3)).collect();
        let words = |(cell, mm): (&OfCell, &f64)| format!("{} {mm:.1} mm", cell.satellite);
        let names: Vec<String> = cells.iter().zip(&millimetres).map(words).collect();
        let bar = ColorBar::new()
            .title("phase residual, mm")
            .orientation(Orientation::Horizontal)
            .y(-0.02)
            .y_anchor(Anchor::Top)
            .thickness(12);
        let marker = Marker::new()
            .color_array(millimetres)
            .cmin(0.0)
            .cmax(MAX_COLOUR_MM)
            .color_scale(ColorScale::Palette(ColorScalePalette::Cividis))
            .color_bar(bar)
            .show_scale(!has_scale)
            .symbol(symbol_of(system))
            .size(9);
        has_scale = true;
        plot.add_trace(
            Scatter::new(x, y)
                .mode(Mode::Markers)
                .marker(marker)
                .name(system.to_string())
                .show_legend(false)
                .hover_text_array(names),
        );
        // In the legend the shape alone: colours are residuals.
        let marker = Marker::new().color("#333333").symbol(symbol_of(system)).size(9);
        let shape = Scatter::new(vec![None::<f64>], vec![None::<f64>]).mode(Mode::Markers);
        plot.add_trace(shape.marker(marker).name(system.to_string()));
    }
}

/// The way in metres from the first place.
pub(super) fn track(samples: &[Sample]) -> Plot {
    let mut plot = laid_out(
        Layout::new()
            .x_axis(
                Axis::new()
                    .title(Title::with_text("east, m"))
                    .scale_anchor("y")
                    .constrain(AxisConstrain::Domain),
            )
            .y_axis(
                Axis::new()
                    .title(Title::with_text("north, m"))
                    .auto_margin(true)
                    .constrain(AxisConstrain::Domain),
            ),
    );
    let mut places = samples.iter().filter_map(|sample| sample.position);
    if let Some((first, first_m)) = places.next() {
        let ned_from_ecef = first.ned_from_ecef();
        let level = |place_m: Vector<Ecef>| (ned_from_ecef * (place_m - first_m)).xyz();
        let (east, north): (Vec<f64>, Vec<f64>) =
            places.map(|(_, place_m)| (level(place_m).y, level(place_m).x)).unzip();
        let marker = Marker::new().color(BLUE).size(3);
        plot.add_trace(
            Scatter::new(east, north).mode(Mode::Markers).marker(marker).name("position"),
        );
        let marker = Marker::new().color(VERMILION).symbol(MarkerSymbol::TriangleUp).size(12);
        let start = Scatter::new(vec![0.0], vec![0.0]).mode(Mode::Markers).marker(marker);
        plot.add_trace(start.name("start"));
    }
    plot
}

const fn colour_of(system: System) -> &'static str {
    match system {
        System::Gps => BLUE,
        System::Galileo => ORANGE,
        System::BeiDou => VERMILION,
        System::Glonass => GREEN,
        System::Qzss => "#CC79A7",
        System::NavIc => "#56B4E9",
        System::Sbas => GREY,
    }
}

const fn symbol_of(system: System) -> MarkerSymbol {
    match system {
        System::Gps => MarkerSymbol::Circle,
        System::Galileo => MarkerSymbol::Square,
        System::BeiDou => MarkerSymbol::Diamond,
        System::Glonass => MarkerSymbol::Cross,
        System::Qzss => MarkerSymbol::TriangleUp,
        System::NavIc => MarkerSymbol::TriangleDown,
        System::Sbas => MarkerSymbol::Star,
    }
}

/// East and north on a disc whose radius is the zenith distance over 90°.
fn on_disc(azimuth_rad: f64, elevation_rad: f64) -> (f64, f64) {
    let radius = 1.0 - elevation_rad / FRAC_PI_2;
    (radius * azimuth_rad.sin(), radius * azimuth_rad.cos())
}

fn times(samples: &[Sample]) -> Vec<f64> {
    samples.iter().map(|sample| rounded(sample.elapsed_s)).collect()
}

/// Values rounded to what a plot can show: the page stays small.
fn curve(samples: &[Sample], value: impl Fn(&Sample) -> Option<f64>) -> Curve {
    samples.iter().map(|sample| value(sample).map(rounded)).collect()
}

fn rounded(value: f64) -> f64 {
    (value * 1e4).round() / 1e4
}

/// Headings continued through north, beyond 360° or below 0°, so that no line crosses the plot.
fn continued(angles: Curve) -> Curve {
    let alone = vec![None; angles.len()];
    continued_beside(angles, &alone)
}

/// The same, as near as can be to other headings where there are any.
fn continued_beside(mut angles: Curve, others: &Curve) -> Curve {
    let mut last = None;
    for (angle, other) in angles.iter_mut().zip(others) {
        let Some(angle) = angle else { continue };
        if let Some(near) = other.or(last) {
            *angle = near + difference_deg(*angle, near);
        }
        last = Some(*angle);
    }
    angles
}

/// Bands of one and three standard deviations of angle `k` around its values; without width where there
/// are none for long.
fn add_bands(plot: &mut Plot, samples: &[Sample], k: usize, angles: &Curve) {
    let longest_s = longest_step_s(samples);
    // Time, angle and standard deviation.
    let mut known: Vec<(f64, f64, f64)> = Vec::new();
    for (sample, angle) in samples.iter().zip(angles) {
        let Some(angle) = *angle else { continue };
        let now_s = rounded(sample.elapsed_s);
        if let Some((before_s, before, _)) = known.last().copied()
            && now_s - before_s > longest_s
        {
            known.extend([(before_s, before, 0.0), (now_s, angle, 0.0)]);
        }
        known.push((now_s, angle, sample.sd_deg[k]));
    }
    let times: Vec<f64> = known.iter().map(|(time_s, ..)| *time_s).collect();
    for (sigmas, name, colour) in [(3.0, "3 sigma", THREE_SIGMA), (1.0, "1 sigma", ONE_SIGMA)] {
        let edge = |sigmas: f64| -> Vec<f64> {
            known.iter().map(|(_, angle, sd)| rounded(angle + sigmas * sd)).collect()
        };
        let lower = Scatter::new(times.clone(), edge(-sigmas)).show_legend(false);
        let upper = Scatter::new(times.clone(), edge(sigmas)).name(name);
        let none = || Line::new().width(0.0).color(colour);
        plot.add_trace(lower.mode(Mode::Lines).line(none()));
        plot.add_trace(upper.mode(Mode::Lines).line(none()).fill(Fill::ToNextY).fill_color(colour));
    }
}

/// A line that is broken where there are no values, and where there are no epochs for long.
fn add_line(plot: &mut Plot, samples: &[Sample], values: &Curve, name: &str, line: Line) {
    let longest_s = longest_step_s(samples);
    let (mut times, mut broken) = (Vec::new(), Vec::new());
    for ((sample, value), step_s) in samples.iter().zip(values).zip(steps_s(samples).chain([0.0])) {
        times.push(rounded(sample.elapsed_s));
        broken.push(*value);
        if step_s > longest_s {
            times.push(rounded(sample.elapsed_s + step_s / 2.0));
            broken.push(None);
        }
    }
    let trace = Scatter::new(times, broken).mode(Mode::Lines).line(line).name(name);
    plot.add_trace(trace.connect_gaps(false));
}

/// Times from each epoch to the next.
fn steps_s(samples: &[Sample]) -> impl Iterator<Item = f64> {
    samples.windows(2).map(|two| two[1].elapsed_s - two[0].elapsed_s)
}

/// Where the next epoch is further than this, some are missing.
fn longest_step_s(samples: &[Sample]) -> f64 {
    let mut steps: Vec<f64> = steps_s(samples).collect();
    steps.sort_by(f64::total_cmp);
    steps.get(steps.len() / 2).map_or(f64::INFINITY, |usual| LONG_GAP * usual)
}

fn over_time(samples: &[Sample], title: &str) -> Plot {
    with_time(samples, Axis::new().title(Title::with_text(title)))
}

fn over_time_from_zero(samples: &[Sample], title: &str) -> Plot {
    with_time(samples, Axis::new().title(Title::with_text(title)).range_mode(RangeMode::ToZero))
}

/// All plots over time begin and end at the same time.
fn with_time(samples: &[Sample], axis: Axis) -> Plot {
    let last_s = samples.last().map_or(1.0, |sample| sample.elapsed_s.max(1e-3));
    let time = Axis::new().title(Title::with_text("time, s")).range(vec![0.0, last_s]);
    laid_out(Layout::new().x_axis(time).y_axis(axis.auto_margin(true)))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A heading near north begins at 359.9° or at 0.1°: the truth goes with it.
    #[test]
    fn truth_is_drawn_beside_the_solution() {
        let solution = continued([359.9, 0.2, 10.0, 350.0].map(Some).to_vec());
        assert_eq!(solution, [359.9, 360.2, 370.0, 350.0].map(Some).to_vec());
        let truth = continued_beside([0.0, 0.0, 10.5, 350.5].map(Some).to_vec(), &solution);
        assert_eq!(truth, [360.0, 360.0, 370.5, 350.5].map(Some).to_vec());
        let gaps =
            continued_beside(vec![Some(1.0), None, Some(2.0)], &vec![Some(361.0), None, None]);
        assert_eq!(gaps, [Some(361.0), None, Some(362.0)]);
    }
}
