//! What the fixed epochs of a run are worth, in the few lines at its end: standard deviations,
//! satellites, gaps.

use kurs::solution::{AttitudeEstimate, EpochSolution, Outcome};

use crate::report::span;
use crate::session_span::SessionSpan;

const NAMES: [&str; 3] = ["heading", "pitch", "roll"];
/// Spread of a heading, in its standard deviations, from which on the body turns: reflections at
/// rest leave less.
const MIN_TURN_SIGMAS: f64 = 5.0;

/// See the module; fed row by row.
#[derive(Debug, Default)]
pub(crate) struct Quality {
    /// Sum of the logarithms of the standard deviations in degrees, and their number: the few
    /// epochs that are much worse do not speak for all.
    ln_sd: [(f64, u64); 3],
    /// Fewest, most, sum and number of the rows that count.
    satellites: Option<(usize, usize, usize, usize)>,
}

impl Quality {
    /// Takes one row in.
    pub(crate) fn add(&mut self, row: &EpochSolution) {
        let Outcome::Fixed { attitude } = &row.outcome else { return };
        self.add_deviations(attitude);
        let count = row.satellites;
        let (fewest, most, sum, rows) = self.satellites.unwrap_or((count, count, 0, 0));
        self.satellites = Some((fewest.min(count), most.max(count), sum + count, rows + 1));
    }

    fn add_deviations(&mut self, attitude: &AttitudeEstimate) {
        let angles = [attitude.heading_rad, attitude.pitch_rad, attitude.roll_rad];
        for (k, (sum, count)) in self.ln_sd.iter_mut().enumerate() {
            let sd_deg = attitude.covariance_rad2[(k, k)].sqrt().to_degrees();
            if angles[k].is_some() && sd_deg > 0.0 {
                *sum += sd_deg.ln();
                *count += 1;
            }
        }
    }

    /// The usual standard deviation of an angle, degrees.
    fn usual_sd_deg(&self, k: usize) -> Option<f64> {
        let (sum, count) = self.ln_sd[k];
        (count > 0).then(|| (sum / count as f64).exp())
    }

    /// Whether headings that spread so far are those of a body that turns.
    pub(crate) fn is_turning(&self, heading_std_deg: f64) -> bool {
        self.usual_sd_deg(0).is_some_and(|sd| heading_std_deg > MIN_TURN_SIGMAS * sd)
    }

    /// The lines; `session`: the times of all rows.
    pub(crate) fn lines(&self, session: &SessionSpan) -> Vec<String> {
        let mut lines = Vec::new();
        let usual = |k: usize| Some(format!("{} {:.3}°", NAMES[k], self.usual_sd_deg(k)?));
        let deviations: Vec<String> = (0..3).filter_map(usual).collect();
        if !deviations.is_empty() {
            lines.push(format!("usual standard deviation: {}", deviations.join(", ")));
        }
        // The coordinates that `orient` reads have no satellites.
        if let Some((fewest, most, sum, rows)) = self.satellites.filter(|(_, most, ..)| *most > 0) {
            let mean = sum as f64 / rows as f64;
            lines.push(format!("satellites: {mean:.1} on average, {fewest} to {most}"));
        }
        lines.extend(span::gaps(session).map(|gaps| format!("gaps that no antenna has: {gaps}")));
        lines
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use kurs::solution::Reason;
    use kurs::time::GpsTime;
    use nalgebra::Matrix3;

    #[test]
    fn a_body_that_moves_is_told_by_its_deviations() {
        let (mut quality, mut session) = (Quality::default(), SessionSpan::default());
        let first = GpsTime::from_week_tow(2320, 0.0).unwrap();
        for k in [0, 1, 2, 3, 10] {
            let sd_rad = 0.1f64.to_radians();
            let attitude = AttitudeEstimate {
                heading_rad: Some(f64::from(k)),
                pitch_rad: Some(0.0),
                roll_rad: None,
                covariance_rad2: Matrix3::identity() * sd_rad * sd_rad,
                installation_rad2: Matrix3::zeros(),
                ned_from_body: None,
                line_elevation_rad: None,
            };
            let mut row = EpochSolution::lost(first + f64::from(k), Reason::Ratio);
            row.outcome = Outcome::Fixed { attitude };
            row.satellites = if k == 3 { 7 } else { 9 };
            quality.add(&row);
            session.add(row.time);
        }
        assert_eq!(
            quality.lines(&session),
            [
                "usual standard deviation: heading 0.100°, pitch 0.100°",
                "satellites: 8.6 on average, 7 to 9",
                "gaps that no antenna has: 1, the longest of 7 s",
            ]
        );
        assert!(quality.is_turning(2.0) && !quality.is_turning(0.2));
    }
}
