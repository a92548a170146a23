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
use super::views::View;
use crate::chart::{self, Clock, Curve, constant};
use crate::page::colour::{BLUE, GREEN, GREY, ORANGE, VERMILION};
use crate::page::laid_out;
use crate::truth::difference_deg;

const ONE_SIGMA: &str = "rgba(86,180,233,0.45)";
const THREE_SIGMA: &str = "rgba(86,180,233,0.20)";
/// Residual from which on the last colour of the scale is used, mm.
const MAX_COLOUR_MM: f64 = 8.0;
/// Missing strength of a signal from which on the last colour is used, dB.
const MAX_COLOUR_DB: f64 = 12.0;
/// Standard deviation up to which an angle has a band, degrees: wider ones would hide all others.
const MAX_BAND_SD_DEG: f64 = 60.0;
/// Change of the success rate up to which it is one number, not a curve.
const SUCCESS_RATE_TOLERANCE: f64 = 5e-4;
/// Times at which the sky is drawn.
const SKY_INSTANTS: usize = 60;

/// The epochs that are drawn.
pub(super) struct Epochs {
    pub(super) samples: Vec<Sample>,
    clock: Clock,
}

impl Epochs {
    /// `kept_every`: epochs that each sample stands for.
    pub(super) fn new(samples: Vec<Sample>, kept_every: usize) -> Self {
        let clock = Clock::new(samples.iter().map(|sample| sample.time)).thinned(kept_every);
        Self { samples, clock }
    }

    /// Values rounded to what a plot can show: the page stays small.
    fn curve(&self, value: impl Fn(&Sample) -> Option<f64>) -> Curve {
        self.samples.iter().map(|sample| value(sample).map(rounded)).collect()
    }

    fn draw(&self, plot: &mut Plot, values: &Curve, name: &str, colour: &'static str) {
        self.clock.draw(plot, values, name, Line::new().color(colour).width(1.5), colour);
    }

    /// Whether any has a value.
    pub(super) fn has(&self, value: impl Fn(&Sample) -> bool) -> bool {
        self.samples.iter().any(value)
    }
}

/// An angle with its bands of one and three standard deviations, and the truth where known.
pub(super) fn angle(epochs: &Epochs, k: usize, name: &str) -> Plot {
    let mut plot = epochs.clock.plot(&format!("{name}, degrees"));
    let angles = continued(epochs.curve(|sample| sample.angles_deg[k]));
    add_bands(&mut plot, epochs, &angles, |sample| sample.sd_deg[k]);
    epochs.draw(&mut plot, &angles, "solution", BLUE);
    if epochs.has(|sample| sample.truth_deg.is_some()) {
        let truth = epochs.curve(|sample| sample.truth_deg.map(|angles| angles[k]));
        // On top, with gaps through which the solution is seen.
        let line = Line::new().color(VERMILION).width(2.0).dash(DashType::Dash);
        let truth = continued_beside(truth, &angles);
        epochs.clock.draw(&mut plot, &truth, "truth", line, VERMILION);
    }
    plot
}

/// Whether the plot of the heading leaves the range of a compass.
pub(super) fn is_continued(epochs: &Epochs) -> bool {
    let headings = continued(epochs.curve(|sample| sample.angles_deg[0]));
    headings.iter().flatten().any(|heading| !(0.0..=360.0).contains(heading))
}

/// The error of an angle inside the bands that it claims.
pub(super) fn error(epochs: &Epochs, k: usize, name: &str) -> Plot {
    let mut plot = epochs.clock.plot(&format!("{name} error, degrees"));
    let zero = epochs.curve(|sample| sample.angles_deg[k].map(|_| 0.0));
    add_bands(&mut plot, epochs, &zero, |sample| sample.sd_deg[k]);
    let error = |sample: &Sample| Some(difference_deg(sample.angles_deg[k]?, sample.truth_deg?[k]));
    epochs.draw(&mut plot, &epochs.curve(error), "solution minus truth", BLUE);
    plot
}

/// How fast an angle changes, with bands of one and three standard deviations.
pub(super) fn rate(epochs: &Epochs, k: usize, name: &str) -> Plot {
    let mut plot = epochs.clock.plot(&format!("{name} rate, degrees/s"));
    let rates = epochs.curve(|sample| Some(sample.rates[k]?.radps.to_degrees()));
    let sd = |sample: &Sample| sample.rates[k].map_or(0.0, |rate| rate.sd_radps.to_degrees());
    add_bands(&mut plot, epochs, &rates, sd);
    epochs.draw(&mut plot, &rates, "rate", BLUE);
    plot
}

/// Status and reason.
fn label(sample: &Sample) -> String {
    match sample.reason {
        "" => sample.status.word().to_owned(),
        reason => format!("{}: {reason}", sample.status.word()),
    }
}

/// The status that all epochs have, where it is one.
pub(super) fn only_status(epochs: &Epochs) -> Option<String> {
    let first = label(epochs.samples.first()?);
    epochs.samples.iter().all(|sample| label(sample) == first).then_some(first)
}

/// A line for every status and reason that occurs, and their number.
pub(super) fn status(epochs: &Epochs) -> (Plot, usize) {
    let mut plot = epochs.clock.plot("");
    let mut lines = BTreeSet::new();
    for status in Status::ALL {
        let of_status = epochs.samples.iter().zip(epochs.clock.ms());
        let (times, labels): (Vec<f64>, Vec<String>) = of_status
            .filter(|(sample, _)| sample.status == status)
            .map(|(sample, ms)| (*ms, label(sample)))
            .unzip();
        if times.is_empty() {
            continue;
        }
        lines.extend(labels.iter().cloned());
        let marker = Marker::new().color(colour_of_status(status)).size(5);
        plot.add_trace(
            Scatter::new(times, labels).mode(Mode::Markers).marker(marker).name(status.word()),
        );
    }
    (plot, lines.len())
}

const fn colour_of_status(status: Status) -> &'static str {
    match status {
        Status::Fixed => GREEN,
        Status::Float => ORANGE,
        Status::Lost | Status::NotCapable => GREY,
        Status::Inconsistent => VERMILION,
    }
}

/// The length of a baseline, and the length it should have.
pub(super) fn length(epochs: &Epochs, k: usize, name: &str, known_m: Option<f64>) -> Plot {
    let mut plot = epochs.clock.plot(&format!("{name}, m"));
    let marker = Marker::new().color(BLUE).size(3);
    let lengths = epochs.curve(|sample| sample.lengths_m.get(k).copied().flatten());
    plot.add_trace(
        Scatter::new(epochs.clock.ms().to_vec(), lengths)
            .mode(Mode::Markers)
            .marker(marker)
            .name("solution"),
    );
    let ends = [epochs.clock.ms().first(), epochs.clock.ms().last()];
    if let (Some(known_m), [Some(first), Some(last)]) = (known_m, ends) {
        let known = Scatter::new(vec![*first, *last], vec![known_m; 2]).mode(Mode::Lines);
        plot.add_trace(known.line(Line::new().color(VERMILION).width(1.5)).name("known"));
    }
    plot
}

/// RMS of the double-differenced phase residuals.
pub(super) fn residuals(epochs: &Epochs) -> Plot {
    let mut plot = epochs.clock.plot("phase, RMS, mm");
    let rms = epochs.curve(|sample| sample.residual_rms_m.map(|rms| rms * 1e3));
    epochs.draw(&mut plot, &rms, "phase residuals", BLUE);
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

/// A curve, or a sentence that says as much.
pub(super) enum Shown {
    Curve(Box<Plot>),
    Sentence(String),
}

/// How many satellites take part; nothing where there are none.
pub(super) fn satellites(epochs: &Epochs) -> Option<Shown> {
    let count = epochs.curve(|sample| Some(sample.satellites as f64));
    if let Some(count) = constant(&count, 0.0) {
        let sentence = format!("{count} satellites in every epoch.");
        return (count > 0.0).then_some(Shown::Sentence(sentence));
    }
    let mut plot = epochs.clock.plot_from_zero("satellites");
    epochs.draw(&mut plot, &count, "satellites", BLUE);
    Some(Shown::Curve(Box::new(plot)))
}

/// How sure the integers are before the fact; nothing where there are none.
pub(super) fn success_rate(epochs: &Epochs) -> Option<Shown> {
    let rate = epochs.curve(|sample| sample.success_rate);
    if let Some(rate) = constant(&rate, SUCCESS_RATE_TOLERANCE) {
        let sentence = format!("Predicted success rate of the integers: {rate:.3} in every epoch.");
        return Some(Shown::Sentence(sentence));
    }
    let mut plot = epochs.clock.plot_from_zero("success rate");
    epochs.draw(&mut plot, &rate, "predicted success rate", BLUE);
    epochs.has(|sample| sample.success_rate.is_some()).then(|| Shown::Curve(Box::new(plot)))
}

/// The satellites above the horizon, zenith in the middle, north up: where phases were used
/// coloured by their residuals, and the paths of the others.
pub(super) fn sky(epochs: &Epochs, ephemerides: &EphemerisStore, residuals: &Residuals) -> Plot {
    let mut plot = disc();
    add_paths(&mut plot, &epochs.samples, ephemerides);
    add_cells(&mut plot, residuals);
    plot
}

/// The sky of one antenna, coloured by what is missing of the signals.
pub(super) fn view(views: &[View]) -> Plot {
    let mut plot = disc();
    let place = |view: &View| on_disc(view.azimuth_rad, view.elevation_rad);
    let (x, y): (Vec<f64>, Vec<f64>) =
        views.iter().map(place).map(|(east, north)| (rounded(east), rounded(north))).unzip();
    let missing_db: Vec<f64> = views.iter().map(|view| rounded(view.missing_db)).collect();
    let words = |view: &View| format!("{} {:.1} dB", view.satellite, view.missing_db);
    let marker = Marker::new()
        .color_array(missing_db)
        .cmin(0.0)
        .cmax(MAX_COLOUR_DB)
        .color_scale(ColorScale::Palette(ColorScalePalette::Cividis))
        .color_bar(colour_bar("missing, dB"))
        .show_scale(true)
        .size(9);
    let names: Vec<String> = views.iter().map(words).collect();
    let cells = Scatter::new(x, y).mode(Mode::Markers).marker(marker);
    plot.add_trace(cells.show_legend(false).hover_text_array(names));
    plot
}

/// An empty sky: north up, the zenith in the middle.
fn disc() -> Plot {
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
            if direction.sin_elevation() > 0.0 {
                let (east, north) = on_disc(direction.azimuth_rad(), direction.elevation_rad());
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

/// The scale of a disc's colours, below it.
fn colour_bar(title: &str) -> ColorBar {
    ColorBar::new()
        .title(title)
        .orientation(Orientation::Horizontal)
        .y(-0.02)
        .y_anchor(Anchor::Top)
        .thickness(12)
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
        let marker = Marker::new()
            .color_array(millimetres)
            .cmin(0.0)
            .cmax(MAX_COLOUR_MM)
            .color_scale(ColorScale::Palette(ColorScalePalette::Cividis))
            .color_bar(colour_bar("phase residual, mm"))
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

/// The way on a map in metres from its first place, coloured by what each epoch is.
pub(super) fn track(epochs: &Epochs) -> Plot {
    let mut plot = chart::map("m");
    let located = || epochs.samples.iter().filter_map(|s| Some((s.status, s.position?)));
    let Some((_, (first, first_m))) = located().next() else { return plot };
    let ned_from_ecef = first.ned_from_ecef();
    let level = |place_m: Vector<Ecef>| {
        let ned_m = (ned_from_ecef * (place_m - first_m)).xyz();
        [ned_m.y, ned_m.x].map(rounded)
    };
    let places: Vec<(Status, [f64; 2])> =
        located().map(|(status, (_, place_m))| (status, level(place_m))).collect();
    for status in Status::ALL {
        let of_status = places.iter().filter(|(of, _)| *of == status);
        let (east, north): (Vec<f64>, Vec<f64>) = of_status.map(|(_, [e, n])| (*e, *n)).unzip();
        if !east.is_empty() {
            let marker = Marker::new().color(colour_of_status(status)).size(4);
            let marks = Scatter::new(east, north).mode(Mode::Markers).marker(marker);
            plot.add_trace(marks.name(status.word()));
        }
    }
    chart::add_start(&mut plot, [0.0, 0.0]);
    let places: Vec<[f64; 2]> = places.into_iter().map(|(_, place)| place).collect();
    chart::finish_map(&mut plot, &places, &[], "m");
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

fn rounded(value: f64) -> f64 {
    (value * 1e4).round() / 1e4
}

/// Headings continued through north, beyond 360° or below 0°, so that no line crosses the plot.
fn continued(angles: Curve) -> Curve {
    let alone = vec![None; angles.len()];
    continued_beside(angles, &alone)
}

/// Headings continued through north, as near as can be to other headings where there are any.
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

/// Bands of one and three standard deviations around an angle or its rate; without width where
/// there are none.
fn add_bands(plot: &mut Plot, epochs: &Epochs, angles: &Curve, sd_deg: impl Fn(&Sample) -> f64) {
    // Time, angle and standard deviation.
    let mut known: Vec<(f64, f64, f64)> = Vec::new();
    for ((sample, ms), angle) in epochs.samples.iter().zip(epochs.clock.ms()).zip(angles) {
        let Some(angle) = *angle else { continue };
        if let Some((before_ms, before, _)) = known.last().copied()
            && epochs.clock.is_broken(before_ms, *ms)
        {
            known.extend([(before_ms, before, 0.0), (*ms, angle, 0.0)]);
        }
        known.push((*ms, angle, sd_deg(sample).min(MAX_BAND_SD_DEG)));
    }
    let times: Vec<f64> = known.iter().map(|(ms, ..)| *ms).collect();
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
