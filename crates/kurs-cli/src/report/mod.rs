//! `report.html`: one self-contained page that shows how a run went.

mod plots;
mod residuals;
pub(crate) mod span;
mod thinning;
pub(crate) mod views;

use std::path::Path;

use kurs::ephemeris::EphemerisStore;
use kurs::frames::{Ecef, Geodetic, Vector};
use kurs::observation::ArrayEpoch;
use kurs::solution::{EpochSolution, Status};
use kurs::time::GpsTime;
use kurs::turn_rate::{AngleRates, TurnRate};

use crate::integers::Integers;
use crate::map_files::{Heights, Way};
use crate::page::Page;
use crate::session_span::SessionSpan;
use crate::stated_interference::StatedInterference;
use crate::truth::TruthRow;
use plots::{Epochs, Shown};
use residuals::Residuals;
use thinning::Thinned;
use views::Views;

/// Satellites behind something that are named for each antenna.
const MAX_HIDDEN: usize = 5;

/// What the plots need of one epoch.
#[derive(Debug, Clone)]
struct Sample {
    time: GpsTime,
    status: Status,
    reason: &'static str,
    /// Heading, pitch, roll, degrees, with their standard deviations.
    angles_deg: [Option<f64>; 3],
    sd_deg: [f64; 3],
    rates: AngleRates,
    truth_deg: Option<[f64; 3]>,
    satellites: usize,
    success_rate: Option<f64>,
    residual_rms_m: Option<f64>,
    /// Length of the baseline to every antenna but the first.
    lengths_m: Vec<Option<f64>>,
    position: Option<(Geodetic, Vector<Ecef>)>,
}

/// A page in the making, fed row by row.
#[derive(Debug)]
pub(crate) struct Report {
    antennas: Vec<String>,
    /// Known length of the baseline to every antenna but the first.
    known_lengths_m: Vec<Option<f64>>,
    span: SessionSpan,
    turn_rate: TurnRate,
    samples: Thinned,
    integers: Integers,
    residuals: Residuals,
    views: Views,
    interference: StatedInterference,
    way: Way,
}

/// What stands beside the plots.
pub(crate) struct Words<'a> {
    /// What is on the page.
    pub(crate) title: &'a str,
    /// What it is made from: a name and a file.
    pub(crate) inputs: Vec<[String; 2]>,
    /// Name and value of the headline numbers.
    pub(crate) headline: Vec<[String; 2]>,
    /// Name, mean and standard deviation of angles and baselines.
    pub(crate) moments: Vec<[String; 3]>,
    /// The configuration in force.
    pub(crate) configuration: String,
    /// Orbits, for the plot of the sky; none without satellites.
    pub(crate) ephemerides: Option<&'a EphemerisStore>,
}

impl Report {
    /// A report on these antennas; the places are those of the body, where known.
    pub(crate) fn new(antennas: Vec<String>, positions_m: &[Option<[f64; 3]>]) -> Self {
        let distance = |from: [f64; 3], to: [f64; 3]| {
            (0..3).map(|k| (to[k] - from[k]).powi(2)).sum::<f64>().sqrt()
        };
        let first = positions_m.first().copied().flatten();
        let known_lengths_m =
            positions_m.iter().skip(1).map(|p| Some(distance(first?, (*p)?))).collect();
        Self {
            antennas,
            known_lengths_m,
            span: SessionSpan::default(),
            turn_rate: TurnRate::default(),
            samples: Thinned::default(),
            integers: Integers::default(),
            residuals: Residuals::default(),
            views: Views::default(),
            interference: StatedInterference::default(),
            way: Way::default(),
        }
    }

    /// Takes in what the receivers state of foreign signals at an epoch.
    pub(crate) fn add_statements(&mut self, epoch: &ArrayEpoch) {
        self.interference.add(epoch);
    }

    /// Takes a row in.
    pub(crate) fn add(&mut self, row: &EpochSolution, truth: Option<&TruthRow>) {
        let step_s = self.span.last().map_or(0.0, |last| row.time - last);
        self.span.add(row.time);
        if row.position.is_none() || self.span.is_gap(step_s) {
            self.way.gap();
        }
        if let Some(position) = &row.position {
            self.way.push(position.geodetic);
        }
        self.integers.add(row, &self.antennas);
        self.residuals.add(row.residuals());
        self.views.add(row.residuals());
        let attitude = row.attitude();
        let angles = attitude.map_or([None; 3], |a| [a.heading_rad, a.pitch_rad, a.roll_rad]);
        let sd = |k| attitude.map_or(0.0, |a| a.covariance_rad2[(k, k)].sqrt().to_degrees());
        let mut lengths_m = vec![None; self.antennas.len().saturating_sub(1)];
        for baseline in row.baselines.iter().filter(|baseline| baseline.base == 0) {
            if let Some(length) = baseline.rover.checked_sub(1).and_then(|k| lengths_m.get_mut(k)) {
                *length = Some(baseline.baseline_m.norm());
            }
        }
        self.samples.push(Sample {
            time: row.time,
            status: row.status(),
            reason: row.reason().map_or("", kurs::solution::Reason::word),
            angles_deg: angles.map(|angle| angle.map(f64::to_degrees)),
            sd_deg: [sd(0), sd(1), sd(2)],
            rates: self.turn_rate.push(row),
            truth_deg: truth.map(|truth| truth.angles_deg),
            satellites: row.satellites,
            success_rate: row.integers.as_ref().and_then(|integers| integers.success_rate),
            residual_rms_m: row.residual_rms_m,
            lengths_m,
            position: row.position.as_ref().map(|p| (p.geodetic, p.position_m)),
        });
    }

    /// Writes `report.html`, `track.geojson` and `track.kml`.
    pub(crate) fn write(&self, directory: &Path, words: &Words<'_>) -> anyhow::Result<()> {
        self.way.write(directory, "track", Heights::OnGround)?;
        let epochs = Epochs::new(self.samples.all(), self.samples.kept_every());
        let mut page = Page::new(words.title);
        self.write_top(&mut page, words);
        self.write_angles(&mut page, &epochs);
        write_status(&mut page, &epochs);
        for sentence in self.interference.sentences(&self.antennas) {
            page.paragraph(&sentence);
        }
        self.write_integers(&mut page);
        self.write_lengths(&mut page, &epochs);
        self.write_residuals(&mut page, &epochs);
        write_satellites(&mut page, &epochs);
        if let Some(ephemerides) = words.ephemerides {
            page.heading("Sky");
            page.square_plot(&plots::sky(&epochs, ephemerides, &self.residuals));
        }
        self.write_views(&mut page);
        write_track(&mut page, &epochs);
        page.heading("Configuration in force");
        page.verbatim(&words.configuration);
        page.write(directory, "report.html")
    }

    /// What it is about: numbers, span, inputs, version.
    fn write_top(&self, page: &mut Page, words: &Words<'_>) {
        page.tiles(&words.headline);
        let mut facts = span::facts(&self.span);
        facts.extend(words.inputs.iter().map(|input| input.to_vec()));
        facts.push(vec!["made by".to_owned(), format!("kurs {}", env!("CARGO_PKG_VERSION"))]);
        page.table(&[], &facts);
        let moments: Vec<_> = words.moments.iter().map(|row| row.to_vec()).collect();
        if !moments.is_empty() {
            page.folded_table(
                "Mean and standard deviation of angles and baselines over the fixed epochs",
                &["", "mean", "standard deviation"],
                &moments,
            );
        }
        if self.samples.kept_every() > 1 {
            page.paragraph(&format!(
                "The plots show, of every {} epochs, one that is not fixed if there is any and one that has \
                 an attitude.",
                self.samples.kept_every()
            ));
        }
    }

    fn write_angles(&self, page: &mut Page, epochs: &Epochs) {
        for (k, name) in ["Heading", "Pitch", "Roll"].iter().enumerate() {
            if !epochs.has(|sample| sample.angles_deg[k].is_some()) {
                continue;
            }
            page.heading(name);
            if k == 0 && plots::is_continued(epochs) {
                page.paragraph("Continued through north: below 0° or above 360° it counts on.");
            }
            page.time_plot(&plots::angle(epochs, k, name));
            if epochs.has(|sample| sample.truth_deg.is_some()) {
                page.time_plot(&plots::error(epochs, k, name));
            }
            if epochs.has(|sample| sample.rates[k].is_some()) {
                page.time_plot(&plots::rate(epochs, k, name));
            }
        }
    }

    /// What failed, and what had no part.
    fn write_integers(&self, page: &mut Page) {
        for sentence in self.integers.sentences(&self.antennas) {
            page.paragraph(&sentence);
        }
    }

    fn write_lengths(&self, page: &mut Page, epochs: &Epochs) {
        if !epochs.has(|sample| sample.lengths_m.iter().any(Option::is_some)) {
            return;
        }
        page.heading("Lengths of the baselines");
        for (k, name) in self.antennas.iter().skip(1).enumerate() {
            let known_m = self.known_lengths_m.get(k).copied().flatten();
            let name = format!("{} to {name}", self.antennas[0]);
            page.time_plot(&plots::length(epochs, k, &name, known_m));
        }
    }

    /// The horizon as each antenna sees it, where something stands before it.
    fn write_views(&self, page: &mut Page) {
        for (antenna, name) in self.antennas.iter().enumerate() {
            let views = self.views.of_antenna(antenna);
            if views.is_empty() {
                continue;
            }
            page.heading(&format!("Sky as {name} sees it"));
            let hidden = self.views.hidden(&self.antennas);
            for row in hidden.iter().filter(|row| row.antenna == *name).take(MAX_HIDDEN) {
                page.paragraph(&format!("{}.", row.sentence()));
            }
            page.square_plot(&plots::view(&views));
        }
    }

    fn write_residuals(&self, page: &mut Page, epochs: &Epochs) {
        let by_signal = self.residuals.by_signal();
        let has_rms = epochs.has(|sample| sample.residual_rms_m.is_some());
        if !has_rms && by_signal.is_empty() {
            return;
        }
        page.heading("Residuals");
        if has_rms {
            page.time_plot(&plots::residuals(epochs));
        }
        if by_signal.iter().any(|signal| !signal.phase_m.is_empty()) {
            page.plot(&plots::phase_residuals(&by_signal));
        }
        if by_signal.iter().any(|signal| !signal.code_m.is_empty()) {
            page.plot(&plots::code_residuals(&by_signal));
        }
    }
}

fn write_status(page: &mut Page, epochs: &Epochs) {
    if let Some(only) = plots::only_status(epochs) {
        page.heading("Status");
        page.paragraph(&format!("Every epoch is {only}."));
        return;
    }
    page.heading("Status, and why epochs are not fixed");
    let (plot, lines) = plots::status(epochs);
    page.time_plot_of_lines(&plot, lines);
}

fn write_satellites(page: &mut Page, epochs: &Epochs) {
    let rate = plots::success_rate(epochs);
    page.heading(if rate.is_some() { "Satellites and success rate" } else { "Satellites" });
    for shown in plots::satellites(epochs).into_iter().chain(rate) {
        match shown {
            Shown::Curve(plot) => page.time_plot(&plot),
            Shown::Sentence(sentence) => page.paragraph(&sentence),
        }
    }
}

fn write_track(page: &mut Page, epochs: &Epochs) {
    let Some((first, _)) = epochs.samples.iter().find_map(|sample| sample.position) else { return };
    page.heading("Track");
    page.paragraph(&format!(
        "From {:.7}° latitude, {:.7}° longitude, {:.1} m above the ellipsoid; for maps: track.geojson, track.kml.",
        first.latitude_rad.to_degrees(),
        first.longitude_rad.to_degrees(),
        first.height_m
    ));
    page.square_plot(&plots::track(epochs));
}
