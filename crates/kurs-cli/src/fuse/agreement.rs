//! How fused attitudes agree with the truth of a simulation.

use kurs::solution::EpochSolution;
use kurs::time::GpsTime;
use serde::Serialize;

use crate::truth::{Truth, difference_deg};

/// Time from the first row of a filter until it is compared with the truth, s.
const SETTLED_S: f64 = 10.0;

/// Sums of squares over the compared rows.
#[derive(Debug, Default)]
pub(super) struct Agreement {
    first: Option<GpsTime>,
    /// The truth has the time of a row.
    is_known: bool,
    rows: u32,
    squares: [f64; 3],
    normalised: [f64; 3],
}

/// Agreement with the truth, from ten seconds after the first row.
#[derive(Debug, Serialize)]
pub(super) struct TruthSummary {
    rows: u32,
    heading_rms_deg: f64,
    pitch_rms_deg: f64,
    roll_rms_deg: f64,
    /// Mean of (error / sigma)².
    heading_normalised: f64,
    pitch_normalised: f64,
    roll_normalised: f64,
}

impl Agreement {
    /// Takes a row into account if it has an attitude and the truth is known.
    pub(super) fn add(&mut self, solution: &EpochSolution, truth: &Truth) {
        let Some(attitude) = solution.attitude() else { return };
        let first = *self.first.get_or_insert(solution.time);
        let Some(wanted) = truth.at(solution.time) else { return };
        self.is_known = true;
        if solution.time - first < SETTLED_S {
            return;
        }
        self.rows += 1;
        let angles = [attitude.heading_rad, attitude.pitch_rad, attitude.roll_rad];
        for (k, angle_rad) in angles.into_iter().enumerate() {
            let Some(angle_rad) = angle_rad else { continue };
            let error_deg = difference_deg(angle_rad.to_degrees(), wanted.angles_deg[k]);
            let sd_deg = attitude.covariance_rad2[(k, k)].sqrt().to_degrees();
            self.squares[k] += error_deg * error_deg;
            self.normalised[k] += (error_deg / sd_deg).powi(2);
        }
    }

    /// Root mean squares, if any row was compared.
    pub(super) fn summary(&self) -> Option<TruthSummary> {
        let rows = f64::from(self.rows);
        let [heading, pitch, roll] = self.squares.map(|sum| (sum / rows).sqrt());
        let normalised = self.normalised.map(|sum| sum / rows);
        (self.rows > 0).then_some(TruthSummary {
            rows: self.rows,
            heading_rms_deg: heading,
            pitch_rms_deg: pitch,
            roll_rms_deg: roll,
            heading_normalised: normalised[0],
            pitch_normalised: normalised[1],
            roll_normalised: normalised[2],
        })
    }

    /// A line for the terminal.
    pub(super) fn text(&self, what: &str) -> Option<String> {
        if self.first.is_some() && !self.is_known {
            return Some(format!("{what} against the truth: no row is of a time that it has"));
        }
        let errors = self.summary()?;
        Some(format!(
            "{what} against the truth, from {SETTLED_S} s on: heading {:.3}°, pitch {:.3}°, roll \
             {:.3}° RMS",
            errors.heading_rms_deg, errors.pitch_rms_deg, errors.roll_rms_deg
        ))
    }
}
