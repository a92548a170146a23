//! `report.html`: one self-contained page that shows how a run went.

mod plots;
mod residuals;
mod thinning;

use std::path::Path;

use kurs::ephemeris::EphemerisStore;
use kurs::frames::{Ecef, Geodetic, Vector};
use kurs::solution::{EpochSolution, Status};
use kurs::time::GpsTime;

use crate::page::Page;
use crate::truth::TruthRow;
use residuals::Residuals;
use thinning::Thinned;

/// What the plots need of one epoch.
#[derive(Debug, Clone)]
struct Sample {
    time: GpsTime,
    /// From the first epoch.
    elapsed_s: f64,
    status: Status,
    reason: &'static str,
    /// Heading, pitch, roll, degrees, with their standard deviations.
    angles_deg: [Option<f64>; 3],
    sd_deg: [f64; 3],
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
    first: Option<GpsTime>,
    samples: Thinned,
    residuals: Residuals,
}

/// What stands beside the plots.
pub(crate) struct Words<'a> {
    /// Name and value of the headline numbers.
    pub(crate) headline: Vec<[String; 2]>,
    /// Name, mean and standard deviation of angles and baselines.
    pub(crate) moments: Vec<[String; 3]>,
    /// The configuration in force.
    pub(crate) configuration: String,
    /// Orbits, for the sky plot.
    pub(crate) ephemerides: &'a EphemerisStore,
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
            first: None,
            samples: Thinned::default(),
            residuals: Residuals::default(),
        }
    }

    /// Takes an epoch in.
    pub(crate) fn add(&mut self, row: &EpochSolution, truth: Option<&TruthRow>) {
        let first = *self.first.get_or_insert(row.time);
        self.residuals.add(&row.residuals);
        let attitude = row.attitude.as_ref();
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
            elapsed_s: row.time - first,
            status: row.status,
            reason: row.reason.map_or("", kurs::solution::Reason::word),
            angles_deg: angles.map(|angle| angle.map(f64::to_degrees)),
            sd_deg: [sd(0), sd(1), sd(2)],
            truth_deg: truth.map(|truth| truth.angles_deg),
            satellites: row.satellites,
            success_rate: row.success_rate,
            residual_rms_m: row.residual_rms_m,
            lengths_m,
            position: row.position.as_ref().map(|p| (p.geodetic, p.position_m)),
        });
    }

    /// Writes `directory/report.html`.
    pub(crate) fn write(&self, directory: &Path, words: &Words<'_>) -> anyhow::Result<()> {
        let samples = self.samples.all();
        let mut page = Page::new("Kurs: heading, pitch and roll");
        if let Some(first) = self.first {
            page.paragraph(&format!(
                "First epoch {first} GPST; time in the plots is counted from it."
            ));
        }
        page.tiles(&words.headline);
        let moments: Vec<_> = words.moments.iter().map(|row| row.to_vec()).collect();
        page.folded_table(
            "Mean and standard deviation of angles and baselines over the fixed epochs",
            &["", "mean", "standard deviation"],
            &moments,
        );
        if self.samples.kept_every() > 1 {
            page.paragraph(&format!(
                "The plots show one epoch of every {}, and of each such group one that is not fixed \
                 if there is any.",
                self.samples.kept_every()
            ));
        }
        for (k, name) in ["Heading", "Pitch", "Roll"].iter().enumerate() {
            if samples.iter().any(|sample| sample.angles_deg[k].is_some()) {
                page.heading(name);
                if k == 0 && plots::is_continued(samples) {
                    page.paragraph("Continued through north: below 0° or above 360° it counts on.");
                }
                page.plot(&plots::angle(samples, k, name));
                if samples.iter().any(|sample| sample.truth_deg.is_some()) {
                    page.plot(&plots::error(samples, k, name));
                }
            }
        }
        page.heading("Status, and why epochs are not fixed");
        let (plot, lines) = plots::status(samples);
        page.plot_of_lines(&plot, lines);
        page.heading("Lengths of the baselines");
        for (k, name) in self.antennas.iter().skip(1).enumerate() {
            let known_m = self.known_lengths_m.get(k).copied().flatten();
            page.plot(&plots::length(
                samples,
                k,
                &format!("{} to {name}", self.antennas[0]),
                known_m,
            ));
        }
        page.heading("Residuals");
        page.plot(&plots::residuals(samples));
        let by_signal = self.residuals.by_signal();
        if !by_signal.is_empty() {
            page.plot(&plots::phase_residuals(&by_signal));
            page.plot(&plots::code_residuals(&by_signal));
        }
        page.heading("Satellites and success rate");
        page.plot(&plots::satellites(samples));
        page.plot(&plots::success_rate(samples));
        page.heading("Sky");
        page.square_plot(&plots::sky(samples, words.ephemerides, &self.residuals));
        page.heading("Track");
        page.square_plot(&plots::track(samples));
        page.heading("Configuration in force");
        page.verbatim(&words.configuration);
        page.write(directory, "report.html")
    }
}
