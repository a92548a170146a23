//! What the plots of all pages share: curves over the time of day that show gaps, and plain maps.

use kurs::time::GpsTime;
use plotly::common::{Anchor, Line, Marker, MarkerSymbol, Mode, Title};
use plotly::layout::{Annotation, Axis, AxisConstrain, AxisType, RangeMode};
use plotly::{Layout, Plot, Scatter};

use crate::page::colour::VERMILION;
use crate::page::laid_out;

/// 1970-01-01 to the first day of GPS time, s: plots count from there.
const GPS_EPOCH_S: i64 = 315_964_800;
const NS_PER_MS: i64 = 1_000_000;
/// A line is broken where the time to the next value is longer than this many usual ones.
const BREAK: f64 = 1.5;
/// Share of the map's width that its scale takes, at most.
const MAX_SCALE_SHARE: f64 = 0.25;
/// How far a map goes to either side of its middle, in extents of what it shows.
const MAP_MARGIN: f64 = 0.62;
/// Colour of what is written into a map.
const INK: &str = "#222222";
/// Smallest map, m: what does not move is a point on it.
const MIN_MAP_M: f64 = 0.01;

/// Values over time; gaps where there are none.
pub(crate) type Curve = Vec<Option<f64>>;

/// The instants of curves, in time order.
#[derive(Debug)]
pub(crate) struct Clock {
    /// Milliseconds since 1970 in GPS time, as the axis counts.
    ms: Vec<f64>,
    /// Where the next instant is further than this, some are missing.
    longest_ms: f64,
}

impl Clock {
    /// The clock of these instants.
    pub(crate) fn new(times: impl IntoIterator<Item = GpsTime>) -> Self {
        let ms: Vec<f64> = times.into_iter().map(milliseconds).collect();
        let mut steps: Vec<f64> = ms.windows(2).map(|two| two[1] - two[0]).collect();
        steps.retain(|step| *step > 0.0);
        steps.sort_by(f64::total_cmp);
        let longest_ms = steps.get(steps.len() / 2).map_or(f64::INFINITY, |usual| BREAK * usual);
        Self { ms, longest_ms }
    }

    /// The axis of a curve of which only one instant of `group` neighbours is there: their spacing
    /// is uneven.
    pub(crate) fn thinned(mut self, group: usize) -> Self {
        if group > 1 {
            self.longest_ms *= 2.0;
        }
        self
    }

    /// As the axis counts.
    pub(crate) fn ms(&self) -> &[f64] {
        &self.ms
    }

    /// Whether instants are missing between two that follow each other.
    pub(crate) fn is_broken(&self, before_ms: f64, after_ms: f64) -> bool {
        after_ms - before_ms > self.longest_ms
    }

    /// An empty plot over all of the time.
    pub(crate) fn plot(&self, title: &str) -> Plot {
        self.with_axis(Axis::new().title(Title::with_text(title)))
    }

    /// An empty plot over all of the time, with the zero of its values in sight.
    pub(crate) fn plot_from_zero(&self, title: &str) -> Plot {
        self.with_axis(Axis::new().title(Title::with_text(title)).range_mode(RangeMode::ToZero))
    }

    fn with_axis(&self, axis: Axis) -> Plot {
        let (first, last) = (self.ms.first().copied(), self.ms.last().copied());
        let first = first.unwrap_or(0.0);
        let range = vec![first, last.unwrap_or(first).max(first + 1.0)];
        let time = Axis::new()
            .type_(AxisType::Date)
            .title(Title::with_text("GPS time"))
            .range(range)
            .tick_angle(0.0);
        laid_out(Layout::new().x_axis(time).y_axis(axis.auto_margin(true)))
    }

    /// Draws a curve: a line, broken where there are no values, and a mark for each value that
    /// stands alone between gaps.
    pub(crate) fn draw(
        &self,
        plot: &mut Plot,
        values: &Curve,
        name: &str,
        line: Line,
        colour: &'static str,
    ) {
        let (mut times, mut broken) = (Vec::new(), Vec::new());
        let (mut alone_ms, mut alone) = (Vec::new(), Vec::new());
        for (k, (ms, value)) in self.ms.iter().zip(values).enumerate() {
            times.push(*ms);
            broken.push(*value);
            let joins = |other: usize| {
                let [before, after] = [self.ms[k.min(other)], self.ms[k.max(other)]];
                values[other].is_some() && !self.is_broken(before, after)
            };
            let is_joined = (k > 0 && joins(k - 1)) || (k + 1 < values.len() && joins(k + 1));
            if value.is_some() && !is_joined {
                alone_ms.push(*ms);
                alone.push(*value);
            }
            if self.ms.get(k + 1).is_some_and(|next| self.is_broken(*ms, *next)) {
                times.push(*ms + 1.0);
                broken.push(None);
            }
        }
        let trace = Scatter::new(times, broken).mode(Mode::Lines).line(line).name(name);
        plot.add_trace(trace.connect_gaps(false).legend_group(name));
        if !alone.is_empty() {
            let marks = Scatter::new(alone_ms, alone).mode(Mode::Markers).name(name);
            let marker = Marker::new().color(colour).size(4);
            plot.add_trace(marks.marker(marker).legend_group(name).show_legend(false));
        }
    }
}

/// An instant as the time axis counts.
pub(crate) fn milliseconds(time: GpsTime) -> f64 {
    (time.as_nanoseconds() / NS_PER_MS + GPS_EPOCH_S * 1000) as f64
}

/// The one value of a curve that never leaves it by more than `tolerance`; `None` where it moves,
/// or has no value at all. What says nothing more needs no plot.
pub(crate) fn constant(curve: &Curve, tolerance: f64) -> Option<f64> {
    let (mut least, mut most) = (f64::INFINITY, f64::NEG_INFINITY);
    for value in curve.iter().flatten() {
        (least, most) = (least.min(*value), most.max(*value));
    }
    (least <= most && most - least <= tolerance).then_some(f64::midpoint(least, most))
}

/// An empty map: metres (or `unit`) to east and north at one scale, on a grid.
pub(crate) fn map(unit: &str) -> Plot {
    laid_out(
        Layout::new()
            .plot_background_color("#ffffff")
            .x_axis(map_axis("east", unit).scale_anchor("y"))
            .y_axis(map_axis("north", unit).auto_margin(true)),
    )
}

fn map_axis(title: &str, unit: &str) -> Axis {
    Axis::new()
        .title(Title::with_text(format!("{title}, {unit}")))
        .constrain(AxisConstrain::Domain)
        .show_grid(true)
        .grid_color("#dddddd")
        .zero_line(false)
}

/// Ends a map: shows all of these places, with north and a scale, and words at some of them; `unit`
/// is that of the axes.
pub(crate) fn finish_map(
    plot: &mut Plot,
    places: &[[f64; 2]],
    words: &[(&str, [f64; 2])],
    unit: &str,
) {
    let ends = |axis: usize| {
        let values = places.iter().map(|place| place[axis]);
        (values.clone().fold(f64::INFINITY, f64::min), values.fold(f64::NEG_INFINITY, f64::max))
    };
    let ((west, east), (south, north)) = (ends(0), ends(1));
    if !(west <= east && south <= north) {
        return;
    }
    let extent = (east - west).max(north - south).max(MIN_MAP_M);
    let [x, y] = [f64::midpoint(west, east), f64::midpoint(south, north)];
    let (left, right) = (x - MAP_MARGIN * extent, x + MAP_MARGIN * extent);
    let (bottom, top) = (y - MAP_MARGIN * extent, y + MAP_MARGIN * extent);
    // Below all places.
    let (start, height) = (x - 0.5 * extent, y - 0.57 * extent);
    let length = round_below(MAX_SCALE_SHARE * extent);
    let bar = Scatter::new(vec![start, start + length], vec![height; 2]).mode(Mode::LinesMarkers);
    let marker = Marker::new().symbol(MarkerSymbol::LineNSOpen).size(9).color(INK);
    let line = Line::new().color(INK).width(3.0);
    plot.add_trace(bar.line(line).marker(marker).name("scale").show_legend(false));
    let label = |text: &str, [x, y]: [f64; 2]| {
        let text = Annotation::new().text(text).x(x).y(y).x_anchor(Anchor::Left);
        text.x_shift(8.0).show_arrow(false)
    };
    let arrow = Annotation::new().text("<b>▲</b><br>N").x(right).y(top);
    let mut annotations = vec![
        label(&format!("{} {unit}", plain(length)), [start + length, height]),
        arrow.x_anchor(Anchor::Right).y_anchor(Anchor::Top).show_arrow(false),
    ];
    annotations.extend(words.iter().map(|(text, place)| label(text, *place)));
    let layout = plot.layout().clone().annotations(annotations);
    plot.set_layout(
        layout
            .x_axis(map_axis("east", unit).scale_anchor("y").range(vec![left, right]))
            .y_axis(map_axis("north", unit).auto_margin(true).range(vec![bottom, top])),
    );
}

/// A mark where a way begins.
pub(crate) fn add_start(plot: &mut Plot, place: [f64; 2]) {
    let marker = Marker::new().color(VERMILION).symbol(MarkerSymbol::TriangleUp).size(12);
    let start = Scatter::new(vec![place[0]], vec![place[1]]).mode(Mode::Markers).marker(marker);
    plot.add_trace(start.name("start"));
}

/// The largest of 1, 2, 5, 10, … that is not above it.
fn round_below(value: f64) -> f64 {
    let power = 10f64.powf(value.log10().floor());
    let first = [5.0, 2.0, 1.0].into_iter().find(|first| first * power <= value * 1.000_001);
    first.unwrap_or(1.0) * power
}

/// A round number without needless digits.
fn plain(value: f64) -> String {
    let decimals = (-value.log10().floor()).clamp(0.0, 9.0);
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // 0 to 9
    let decimals = decimals as usize;
    format!("{value:.decimals$}")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn clock(seconds: &[f64]) -> Clock {
        let first = GpsTime::from_week_tow(2320, 86_400.0).unwrap();
        Clock::new(seconds.iter().map(|s| first + *s))
    }

    #[test]
    fn values_between_gaps_are_seen() {
        let clock = clock(&[0.0, 1.0, 2.0, 3.0, 4.0, 9.0]);
        // 2024-06-24T00:00:00.
        assert_eq!(clock.ms()[0], 1_719_187_200_000.0);
        let mut plot = clock.plot("heading");
        let curve = [Some(1.0), None, Some(2.0), Some(3.0), Some(4.0), Some(5.0)];
        clock.draw(&mut plot, &curve.to_vec(), "solution", Line::new(), VERMILION);
        let json: serde_json::Value = serde_json::from_str(&plot.to_json()).unwrap();
        let line = &json["data"][0];
        assert_eq!(line["y"], serde_json::json!([1.0, null, 2.0, 3.0, 4.0, null, 5.0]));
        let alone = &json["data"][1];
        assert_eq!(
            (&alone["mode"], &alone["y"]),
            (&"markers".into(), &serde_json::json!([1.0, 5.0]))
        );
        assert_eq!(json["layout"]["xaxis"]["type"], "date");
    }

    #[test]
    fn what_never_moves_is_a_number() {
        assert_eq!(constant(&vec![Some(1.0), None, Some(1.0)], 1e-3), Some(1.0));
        assert_eq!(constant(&vec![Some(1.0), Some(1.01)], 1e-3), None);
        assert_eq!(constant(&vec![None], 1.0), None);
    }

    #[test]
    fn scales_are_round_lengths() {
        let scales = [0.0301, 4.9, 99.0, 1234.0].map(round_below);
        assert_eq!(scales.map(plain), ["0.02", "2", "50", "1000"]);
    }
}
