//! A solution laid against the truth of a simulation: `truth.csv`, and `ambiguities.csv` beside it.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::Context;
use kurs::signal::{Satellite, Signal};
use kurs::solution::{EpochSolution, IntegerSum, Outcome};
use kurs::time::GpsTime;
use nalgebra::Vector3;
use serde::Deserialize;

use crate::pipe::InputFile;
use crate::text_file::TextFile;

/// Names of the three angles in the columns of `truth.csv`.
const ANGLES: [&str; 3] = ["heading_deg", "pitch_deg", "roll_deg"];
const AXES: [&str; 3] = ["east", "north", "up"];
/// Name of the file with the whole cycles.
const AMBIGUITIES: &str = "ambiguities.csv";
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

/// `truth.csv`, by time tag, and the whole cycles of `ambiguities.csv` where that file is.
#[derive(Debug, Default)]
pub(crate) struct Truth {
    rows: BTreeMap<GpsTime, TruthRow>,
    cycles: Option<Cycles>,
}

/// The whole cycles of every phase, each from a time tag on.
#[derive(Debug, Default)]
struct Cycles {
    of_link: BTreeMap<(usize, Satellite, Signal), Vec<(GpsTime, i64)>>,
    /// Tags of one epoch differ by less than this.
    half_interval_s: f64,
}

/// A row of `ambiguities.csv`.
#[derive(Debug, Deserialize)]
struct CyclesRow {
    gps_week: i32,
    tow_s: f64,
    antenna: String,
    satellite: String,
    signal: String,
    cycles: i64,
}

/// How a solution agrees with the truth, over its fixed epochs.
#[derive(Debug, Clone, Default)]
pub(crate) struct Agreement {
    /// Rows of which the truth is known.
    known: u64,
    fixed: u64,
    wrong: u64,
    /// For every angle: count, sum of squares (degrees²), sum of squares over variance.
    angles: [(u64, f64, f64); 3],
}

impl Truth {
    /// Reads the table that `kurs simulate` wrote; `antennas` are the names in order.
    pub(crate) fn read(path: &Path, antennas: &[String]) -> anyhow::Result<Self> {
        let context = || path.display().to_string();
        let input = InputFile::open(path)?;
        let mut reader = csv::Reader::from_reader(TextFile::open(input.path())?);
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
                let number = text.parse().ok().filter(|number: &f64| number.is_finite());
                number.with_context(|| {
                    let line = record.position().map_or(0, csv::Position::line);
                    format!("{}:{line}: `{text}` found, a number expected", path.display())
                })
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
        let beside = path.with_file_name(AMBIGUITIES);
        let is_there = !input.is_copy() && beside.is_file();
        let cycles = is_there.then(|| Cycles::read(&beside, antennas, &rows)).transpose()?;
        Ok(Self { rows, cycles })
    }

    /// Whether an epoch is wrong: one of its integers is, or, without `ambiguities.csv`, a
    /// component of a baseline is off by more than noise can be.
    pub(crate) fn is_wrong(&self, row: &EpochSolution, truth: &TruthRow) -> bool {
        match &self.cycles {
            Some(cycles) => {
                let mut sums = row.signals.iter().flat_map(|signals| &signals.integers);
                !sums.all(|sum| cycles.confirm(sum, row.time))
            }
            None => is_off(row, truth),
        }
    }

    /// What makes an epoch wrong, in words.
    pub(crate) fn criterion(&self) -> &'static str {
        if self.cycles.is_some() { "wrong (any integer)" } else { "wrong (any baseline)" }
    }

    /// The truth of an epoch.
    pub(crate) fn at(&self, time: GpsTime) -> Option<&TruthRow> {
        let near = self.rows.range(time + -SAME_EPOCH_S..=time + SAME_EPOCH_S);
        near.map(|(_, row)| row).next()
    }
}

impl Cycles {
    fn read(
        path: &Path,
        antennas: &[String],
        epochs: &BTreeMap<GpsTime, TruthRow>,
    ) -> anyhow::Result<Self> {
        let context = || path.display().to_string();
        let mut times = epochs.keys();
        let (first, second) = (times.next(), times.next());
        let interval_s = first.zip(second).map_or(SAME_EPOCH_S, |(one, next)| *next - *one);
        let mut cycles = Self { half_interval_s: interval_s / 2.0, ..Self::default() };
        let mut reader = csv::Reader::from_reader(TextFile::open(path)?);
        for row in reader.deserialize() {
            let row: CyclesRow = row.with_context(context)?;
            let Some(antenna) = antennas.iter().position(|name| *name == row.antenna) else {
                continue;
            };
            let time = GpsTime::from_week_tow(row.gps_week, row.tow_s).with_context(context)?;
            let satellite =
                row.satellite.parse().map_err(anyhow::Error::msg).with_context(context)?;
            let signal = row.signal.parse().map_err(anyhow::Error::msg).with_context(context)?;
            let of_link = cycles.of_link.entry((antenna, satellite, signal)).or_default();
            of_link.push((time, row.cycles));
        }
        Ok(cycles)
    }

    /// Whether a sum of whole cycles is the true one at an epoch.
    fn confirm(&self, sum: &IntegerSum, time: GpsTime) -> bool {
        let end = time + self.half_interval_s;
        let terms = sum.links.iter().map(|(antenna, satellite, signal, sign)| {
            let changes = self.of_link.get(&(*antenna, *satellite, *signal))?;
            let last = changes.iter().rev().find(|(since, _)| *since <= end)?;
            Some(sign * last.1)
        });
        terms.sum::<Option<i64>>() == Some(sum.cycles)
    }
}

impl Agreement {
    /// Takes one epoch into account; only fixed ones count.
    pub(crate) fn add(&mut self, row: &EpochSolution, known: &TruthRow, truth: &Truth) {
        self.known += 1;
        let Outcome::Fixed { attitude } = &row.outcome else { return };
        self.fixed += 1;
        self.wrong += u64::from(truth.is_wrong(row, known));
        let angles = [attitude.heading_rad, attitude.pitch_rad, attitude.roll_rad];
        for (k, angle) in angles.iter().enumerate() {
            let Some(angle_rad) = angle else { continue };
            let error_deg = difference_deg(angle_rad.to_degrees(), known.angles_deg[k]);
            let sd_deg = attitude.covariance_rad2[(k, k)].sqrt().to_degrees();
            let (count, squares, normalised) = &mut self.angles[k];
            *count += 1;
            *squares += error_deg * error_deg;
            *normalised += (error_deg / sd_deg).powi(2);
        }
    }

    /// A small table: what was found, under which name; `criterion` says what makes an epoch wrong.
    pub(crate) fn rows(&self, criterion: &str) -> Vec<[String; 2]> {
        if self.known == 0 {
            return vec![["rows".to_owned(), "none is of a time that the truth has".to_owned()]];
        }
        let mut rows = vec![
            ["fixed".to_owned(), self.fixed.to_string()],
            [criterion.to_owned(), self.wrong.to_string()],
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
fn is_off(row: &EpochSolution, truth: &TruthRow) -> bool {
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
    use kurs::solution::{BaselineEstimate, Reason, SignalReport, Status};
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
            assert_eq!(is_off(&row, &truth), wrong, "{east_m} {sd_m}");
        }
    }

    #[test]
    fn a_truth_is_of_numbers_and_of_the_session() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("truth.csv");
        let text = "gps_week,tow_s,heading_deg,pitch_deg,roll_deg\n2305,0,0,0,0\n2305,1,NaN,0,0\n";
        std::fs::write(&file, text).unwrap();
        let error = Truth::read(&file, &[]).unwrap_err().to_string();
        assert!(error.ends_with("truth.csv:3: `NaN` found, a number expected"), "{error}");

        let [[_, none]] = &Agreement::default().rows("wrong")[..] else { panic!("one row") };
        assert_eq!(none, "none is of a time that the truth has");
    }

    /// A sum of cycles is confirmed by the values in force at its epoch: slips count from their tag
    /// on.
    #[test]
    fn integers_are_laid_against_the_table() {
        let folder = tempfile::tempdir().unwrap();
        let truth_file = folder.path().join("truth.csv");
        let header = "gps_week,tow_s,heading_deg,pitch_deg,roll_deg,A1_east_m,A1_north_m,A1_up_m";
        let rows = (0..3).map(|k| format!("2305,{k}.0,0,0,0,1,0,0\n")).collect::<String>();
        std::fs::write(&truth_file, format!("{header}\n{rows}")).unwrap();
        let antennas = ["A0", "A1"].map(str::to_owned);
        let without = Truth::read(&truth_file, &antennas).unwrap();
        assert_eq!(without.criterion(), "wrong (any baseline)");

        let table = "gps_week,tow_s,antenna,satellite,signal,cycles,slip_cycles,flagged\n\
            2305,0.0,A0,G01,G1C,100,,false\n2305,0.0,A1,G01,G1C,30,,false\n\
            2305,1.2,A1,G01,G1C,35,5,false\n2305,0.0,B9,G01,G1C,7,,false\n";
        std::fs::write(folder.path().join(AMBIGUITIES), table).unwrap();
        let truth = Truth::read(&truth_file, &antennas).unwrap();
        assert_eq!(truth.criterion(), "wrong (any integer)");
        let (satellite, signal) = ("G01".parse().unwrap(), "G1C".parse().unwrap());
        let links = vec![(1, satellite, signal, 1), (0, satellite, signal, -1)];
        for (tow_s, cycles, wrong) in [(0.0, -70, false), (1.0, -70, true), (1.0, -65, false)] {
            let time = GpsTime::from_week_tow(2305, tow_s).unwrap();
            let mut row = EpochSolution::lost(time, Reason::Ratio);
            let mut signals = SignalReport::default();
            signals.integers = vec![IntegerSum { links: links.clone(), cycles }];
            row.signals = Some(signals);
            let known = truth.at(time).unwrap();
            assert_eq!(truth.is_wrong(&row, known), wrong, "{tow_s} {cycles}");
        }
    }
}
