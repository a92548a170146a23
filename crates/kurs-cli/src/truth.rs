//! A solution laid against the truth of a simulation.

use std::collections::BTreeMap;
use std::fs::File;
use std::path::Path;

use anyhow::Context;
use kurs::solution::{EpochSolution, Status};
use kurs::time::GpsTime;
use nalgebra::Vector3;

/// Names of the three angles in the columns of `truth.csv`.
const ANGLES: [&str; 3] = ["heading_deg", "pitch_deg", "roll_deg"];
const AXES: [&str; 3] = ["east", "north", "up"];
/// A fixed baseline further off than this and five standard deviations is wrong, m.
const WRONG_M: f64 = 0.05;
const WRONG_SIGMAS: f64 = 5.0;
/// Time tags of one epoch agree within this, s.
const SAME_EPOCH_S: f64 = 1e-4;

/// One epoch of `truth.csv`.
#[derive(Debug, Clone)]
pub(crate) struct TruthRow {
    /// Heading, pitch, roll, degrees.
    pub(crate) angles_deg: [f64; 3],
    /// To every antenna but the first, east, north, up.
    baselines_m: Vec<Vector3<f64>>,
}

/// `truth.csv`, by time tag.
#[derive(Debug, Default)]
pub(crate) struct Truth(BTreeMap<GpsTime, TruthRow>);

/// How a solution agrees with the truth, over its fixed epochs.
#[derive(Debug, Clone, Default)]
pub(crate) struct Agreement {
    fixed: u64,
    wrong: u64,
    /// Of every angle: how many, sum of squares (degrees²), sum of squares over variance.
    angles: [(u64, f64, f64); 3],
}

impl Truth {
    /// Reads the table that `kurs simulate` wrote; `antennas` are the names in order.
    pub(crate) fn read(path: &Path, antennas: &[String]) -> anyhow::Result<Self> {
        let context = || path.display().to_string();
        let file = File::open(path).with_context(context)?;
        let mut reader = csv::Reader::from_reader(file);
        let header = reader.headers().with_context(context)?.clone();
        let column = |name: &str| {
            header
                .iter()
                .position(|found| found == name)
                .with_context(|| format!("{}: no column {name}", path.display()))
        };
        let times = [column("gps_week")?, column("tow_s")?];
        let angles = [column(ANGLES[0])?, column(ANGLES[1])?, column(ANGLES[2])?];
        let mut baselines = Vec::new();
        for name in antennas.iter().skip(1) {
            let place = |axis: &str| column(&format!("{name}_{axis}_m"));
            baselines.push([place(AXES[0])?, place(AXES[1])?, place(AXES[2])?]);
        }
        let mut rows = BTreeMap::new();
        for record in reader.records() {
            let record = record.with_context(context)?;
            let number = |column: usize| -> anyhow::Result<f64> {
                let text = record.get(column).unwrap_or_default();
                text.parse().with_context(|| format!("{}: {text:?}", path.display()))
            };
            let week: i32 =
                record.get(times[0]).unwrap_or_default().parse().with_context(context)?;
            let time = GpsTime::from_week_tow(week, number(times[1])?).with_context(context)?;
            let angles_deg = [number(angles[0])?, number(angles[1])?, number(angles[2])?];
            let baselines_m: anyhow::Result<Vec<_>> = baselines
                .iter()
                .map(|[e, n, u]| Ok(Vector3::new(number(*e)?, number(*n)?, number(*u)?)))
                .collect();
            rows.insert(time, TruthRow { angles_deg, baselines_m: baselines_m? });
        }
        Ok(Self(rows))
    }

    /// The truth of an epoch.
    pub(crate) fn at(&self, time: GpsTime) -> Option<&TruthRow> {
        let near = self.0.range(time + -SAME_EPOCH_S..=time + SAME_EPOCH_S);
        near.map(|(_, row)| row).next()
    }
}

impl Agreement {
    /// Takes one epoch into account; only fixed ones count.
    pub(crate) fn add(&mut self, row: &EpochSolution, truth: &TruthRow) {
        if row.status != Status::Fixed {
            return;
        }
        self.fixed += 1;
        self.wrong += u64::from(is_wrong(row, truth));
        let Some(attitude) = &row.attitude else { return };
        let angles = [attitude.heading_rad, attitude.pitch_rad, attitude.roll_rad];
        for (k, angle) in angles.iter().enumerate() {
            let Some(angle_rad) = angle else { continue };
            let error_deg = difference_deg(angle_rad.to_degrees(), truth.angles_deg[k]);
            let sd_deg = attitude.covariance_rad2[(k, k)].sqrt().to_degrees();
            let (count, squares, normalised) = &mut self.angles[k];
            *count += 1;
            *squares += error_deg * error_deg;
            *normalised += (error_deg / sd_deg).powi(2);
        }
    }

    /// A small table: what was found, under which name.
    pub(crate) fn rows(&self) -> Vec<[String; 2]> {
        let mut rows = vec![
            ["fixed".to_owned(), self.fixed.to_string()],
            ["wrong".to_owned(), self.wrong.to_string()],
        ];
        for (name, (count, squares, normalised)) in
            ["heading", "pitch", "roll"].iter().zip(self.angles)
        {
            if count > 0 {
                let (rms_deg, ratio) = ((squares / count as f64).sqrt(), normalised / count as f64);
                let consistency = format!("{rms_deg:.3}°, (error / sigma)² {ratio:.2}");
                rows.push([format!("{name}, RMS error"), consistency]);
            }
        }
        rows
    }
}

/// Whether any component of a fixed baseline is off by more than noise can be.
fn is_wrong(row: &EpochSolution, truth: &TruthRow) -> bool {
    row.baselines.iter().filter(|baseline| baseline.base == 0).any(|baseline| {
        let Some(wanted) = baseline.rover.checked_sub(1).and_then(|k| truth.baselines_m.get(k))
        else {
            return false;
        };
        let off_m = baseline.baseline_m.xyz() - wanted;
        (0..3).any(|k| {
            let sd_m = baseline.covariance_m2[(k, k)].sqrt();
            off_m[k].abs() > WRONG_M.max(WRONG_SIGMAS * sd_m)
        })
    })
}

/// The difference of two angles, between −180° and 180°.
pub(crate) fn difference_deg(one: f64, other: f64) -> f64 {
    (one - other + 180.0).rem_euclid(360.0) - 180.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use kurs::frames::Vector;
    use kurs::solution::{BaselineEstimate, Reason};
    use nalgebra::Matrix3;

    #[test]
    fn angles_are_compared_across_north() {
        assert!((difference_deg(359.0, 1.0) + 2.0).abs() < 1e-12);
        assert!((difference_deg(1.0, 359.0) - 2.0).abs() < 1e-12);
    }

    #[test]
    fn a_baseline_a_wavelength_off_is_wrong() {
        let truth =
            TruthRow { angles_deg: [0.0; 3], baselines_m: vec![Vector3::new(1.0, 0.0, 0.0)] };
        let mut row = EpochSolution::lost(GpsTime::default(), Reason::Ratio);
        let with = |east_m: f64, sd_m: f64| BaselineEstimate {
            base: 0,
            rover: 1,
            status: Status::Fixed,
            baseline_m: Vector::new(east_m, 0.0, 0.0),
            covariance_m2: Matrix3::identity() * sd_m * sd_m,
        };
        for (east_m, sd_m, wrong) in
            [(1.01, 0.003, false), (1.06, 0.003, true), (1.06, 0.02, false)]
        {
            row.baselines = vec![with(east_m, sd_m)];
            assert_eq!(is_wrong(&row, &truth), wrong, "{east_m} {sd_m}");
        }
    }
}
