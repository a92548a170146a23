//! Logs of inertial sensors as CSV: the header names columns and units, `time_s, ax_mps2, …`, and
//! the angle of a rotating arm, `arm_deg`, where an encoder measures it.

use std::collections::VecDeque;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use nalgebra::Vector3;

use crate::pipe;
use crate::summary::{Damage, damaged};
use crate::text_file::TextFile;

/// Standard gravity, the unit "g".
const STANDARD_GRAVITY_MPS2: f64 = 9.806_65;

/// Endings of accelerometer columns and what they stand for in m/s².
const ACCELERATION_UNITS: [(&str, f64); 3] =
    [("mps2", 1.0), ("g", STANDARD_GRAVITY_MPS2), ("mg", STANDARD_GRAVITY_MPS2 * 1e-3)];

/// Endings of gyro columns and what they stand for in rad/s.
const RATE_UNITS: [(&str, f64); 2] = [("radps", 1.0), ("degps", core::f64::consts::PI / 180.0)];

/// Longest list of damage that is kept.
const LISTED_DAMAGE: usize = 20;
/// Beyond these a reading is none: the fastest gyros measure to 20 000 °/s, shock accelerometers to 100 000 g.
const MAX_RATE_RADPS: f64 = 20_000.0 * core::f64::consts::PI / 180.0;
const MAX_FORCE_MPS2: f64 = 1e6;

/// Usable rows at the beginning of a log whose times are looked at.
const LOOKED_AT: usize = 200;
/// Where this many samples, and a quarter of all, go back in time, the log has no order.
const MAX_BACKWARDS: usize = 10;
/// Times between samples that sensors have: 100 kHz to 1 Hz.
const MIN_STEP_S: f64 = 1e-5;
const MAX_STEP_S: f64 = 1.0;
/// Seconds since 1970, 1980 or the beginning of a week stay below this until the year 2286.
const MAX_TIME_S: f64 = 1e10;
/// Units that times are logged in, in seconds.
const TIME_UNITS: [(&str, f64); 3] =
    [("milliseconds", 1e-3), ("microseconds", 1e-6), ("nanoseconds", 1e-9)];
/// An ordinary time between samples: 100 Hz.
const USUAL_STEP_S: f64 = 0.01;

/// Samples of one file in SI units; rows that cannot be used are left out and noted.
#[derive(Debug, Default)]
pub(crate) struct SensorLog {
    pub(crate) time_s: Vec<f64>,
    /// m/s²; empty if the file has none.
    pub(crate) accelerometer: Vec<Vector3<f64>>,
    /// rad/s; empty if the file has none.
    pub(crate) gyro: Vec<Vector3<f64>>,
    /// What was left out.
    pub(crate) damage: Vec<Damage>,
}

/// One row, in SI units.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct SensorRow {
    pub(crate) time_s: f64,
    /// Where it stands in its file.
    pub(crate) line: u64,
    /// m/s², if the file has the columns.
    pub(crate) accelerometer: Option<Vector3<f64>>,
    /// rad/s, if the file has the columns.
    pub(crate) gyro: Option<Vector3<f64>>,
    /// rad, if the file has the column.
    pub(crate) arm_angle: Option<f64>,
}

/// Reads a log row by row.
pub(crate) struct SensorReader {
    path: PathBuf,
    records: csv::StringRecordsIntoIter<TextFile>,
    columns: Columns,
    backwards: Backwards,
    last_s: f64,
    /// Rows with numbers.
    rows: usize,
    /// Those of them whose times are before that of the row before.
    backwards_rows: usize,
    damage: Vec<Damage>,
    /// Rows that were read to look at their times.
    ahead: VecDeque<SensorRow>,
}

/// What happens to a row whose time is not later than that of the row before.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Backwards {
    /// It is left out and noted.
    LeftOut,
    /// It is kept where it stands.
    Kept,
}

/// Columns by their place in a row.
#[derive(Debug)]
pub(crate) struct Columns {
    time: usize,
    accelerometer: Option<Triple>,
    gyro: Option<Triple>,
    arm_angle: Option<usize>,
}

/// Three columns, the factor to SI units, and the largest reading in these.
#[derive(Debug)]
struct Triple {
    columns: [usize; 3],
    factor: f64,
    largest: f64,
}

impl SensorLog {
    /// Reads a whole file.
    pub(crate) fn read(path: &Path, backwards: Backwards) -> anyhow::Result<Self> {
        let mut reader = SensorReader::open(path, backwards)?;
        let mut log = Self::default();
        for row in &mut reader {
            log.time_s.push(row.time_s);
            log.accelerometer.extend(row.accelerometer);
            log.gyro.extend(row.gyro);
        }
        if log.time_s.is_empty() {
            bail!("{}: no usable row{}", path.display(), damaged(&reader.damage));
        }
        log.damage = reader.damage;
        Ok(log)
    }

    /// Whether two logs are one recording.
    pub(crate) fn has_samples_of(&self, other: &Self) -> bool {
        self.time_s == other.time_s && self.accelerometer == other.accelerometer
    }

    /// How many steps are longer than five usual ones, and the longest.
    pub(crate) fn gaps(&self) -> Option<(usize, f64)> {
        let limit_s = 5.0 * self.step_s();
        let steps = self.time_s.windows(2).map(|pair| pair[1] - pair[0]);
        let gaps: Vec<f64> = steps.filter(|step_s| *step_s > limit_s).collect();
        (!gaps.is_empty()).then(|| (gaps.len(), gaps.iter().copied().fold(0.0, f64::max)))
    }

    /// From the first sample to the last.
    pub(crate) fn length_s(&self) -> f64 {
        self.time_s.last().unwrap_or(&0.0) - self.time_s.first().unwrap_or(&0.0)
    }

    /// Median time between samples.
    pub(crate) fn step_s(&self) -> f64 {
        let mut steps: Vec<f64> = self.time_s.windows(2).map(|pair| pair[1] - pair[0]).collect();
        steps.sort_by(f64::total_cmp);
        steps.get(steps.len() / 2).copied().unwrap_or(f64::NAN)
    }
}

impl Columns {
    /// The columns that a header names; the error says what is missing.
    pub(crate) fn of_header(header: &csv::StringRecord) -> Result<Self, String> {
        let names: Vec<&str> = header.iter().collect();
        let Some(time) = names.iter().position(|column| *column == "time_s") else {
            return Err(format!("no column `time_s`; found: {}", names.join(", ")));
        };
        let columns = Self {
            time,
            accelerometer: triple(&names, 'a', &ACCELERATION_UNITS, MAX_FORCE_MPS2),
            gyro: triple(&names, 'g', &RATE_UNITS, MAX_RATE_RADPS),
            arm_angle: names.iter().position(|name| *name == "arm_deg"),
        };
        if columns.accelerometer.is_none() && columns.gyro.is_none() {
            return Err(format!(
                "no sensor columns; expected ax_mps2, ay_mps2, az_mps2 (or _g, _mg) or \
                 gx_radps, gy_radps, gz_radps (or _degps); found: {}",
                names.join(", ")
            ));
        }
        Ok(columns)
    }

    /// Whether every row has a rate.
    pub(crate) const fn has_gyro(&self) -> bool {
        self.gyro.is_some()
    }

    /// The values of a row; the error names the one that is not a number.
    pub(crate) fn row(&self, record: &csv::StringRecord) -> Result<SensorRow, String> {
        let time_s = number(record, self.time)?;
        let force = self.accelerometer.as_ref().map(|triple| triple.read(record)).transpose()?;
        let rate = self.gyro.as_ref().map(|triple| triple.read(record)).transpose()?;
        let angle = self.arm_angle.map(|column| number(record, column)).transpose()?;
        let arm_angle = angle.map(f64::to_radians);
        let line = record.position().map_or(0, csv::Position::line);
        Ok(SensorRow { time_s, line, accelerometer: force, gyro: rate, arm_angle })
    }
}

impl SensorReader {
    /// Opens a file and reads its header.
    pub(crate) fn open(path: &Path, backwards: Backwards) -> anyhow::Result<Self> {
        let name = path.display();
        let mut reader = csv::ReaderBuilder::new()
            .flexible(true)
            .trim(csv::Trim::All)
            .comment(Some(b'#'))
            .from_reader(TextFile::open(path)?);
        let header = reader.headers().with_context(|| format!("{name}:1"))?.clone();
        let columns = match Columns::of_header(&header) {
            Ok(columns) => columns,
            Err(what) => bail!("{name}:1: {what}"),
        };
        let mut reader = Self {
            path: path.to_owned(),
            records: reader.into_records(),
            columns,
            backwards,
            last_s: f64::NEG_INFINITY,
            rows: 0,
            backwards_rows: 0,
            damage: Vec::new(),
            ahead: VecDeque::new(),
        };
        reader.ahead = core::iter::from_fn(|| reader.read_row()).take(LOOKED_AT).collect();
        if reader.backwards_rows > MAX_BACKWARDS && reader.backwards_rows > reader.ahead.len() / 4 {
            bail!(
                "{name}: the time goes back in {} of the first {} rows, rows in the order of `time_s` are expected",
                reader.backwards_rows,
                reader.rows
            );
        }
        let times_s: Vec<f64> = reader.ahead.iter().map(|row| row.time_s).collect();
        match wrong_times(&times_s) {
            Some(wrong) => bail!("{name}: {wrong}"),
            None => Ok(reader),
        }
    }

    /// Whether every row has a specific force.
    pub(crate) const fn has_accelerometer(&self) -> bool {
        self.columns.accelerometer.is_some()
    }

    /// Whether every row has a rate.
    pub(crate) const fn has_gyro(&self) -> bool {
        self.columns.gyro.is_some()
    }

    /// What was left out so far.
    pub(crate) fn damage(&self) -> &[Damage] {
        &self.damage
    }

    fn row(&mut self, record: &csv::StringRecord) -> Result<SensorRow, String> {
        let row = self.columns.row(record)?;
        let time_s = row.time_s;
        self.rows += 1;
        self.backwards_rows += usize::from(time_s < self.last_s);
        if time_s <= self.last_s && self.backwards == Backwards::LeftOut {
            return Err(if time_s == self.last_s {
                format!("time {time_s} s is that of the row before")
            } else {
                format!("time goes back from {} s to {time_s} s", self.last_s)
            });
        }
        self.last_s = time_s;
        Ok(row)
    }

    /// Reads on to the next row that can be used.
    fn read_row(&mut self) -> Option<SensorRow> {
        loop {
            match self.records.next()? {
                Ok(record) => match self.row(&record) {
                    Ok(row) => return Some(row),
                    Err(what) => self.note(record.position().map_or(0, csv::Position::line), what),
                },
                Err(error) => {
                    let line = error.position().map_or(0, csv::Position::line);
                    self.note(line, error.to_string());
                    // A file that cannot be read on gives the same error for ever.
                    if matches!(error.kind(), csv::ErrorKind::Io(_)) {
                        return None;
                    }
                }
            }
        }
    }

    /// Lists what is wrong with a row.
    pub(crate) fn note(&mut self, line: u64, what: String) {
        let damage = Damage::at(pipe::named(&self.path), line, what);
        damage.add_to(&mut self.damage, LISTED_DAMAGE);
    }
}

impl Iterator for SensorReader {
    type Item = SensorRow;

    /// The next row that can be used.
    fn next(&mut self) -> Option<SensorRow> {
        self.ahead.pop_front().or_else(|| self.read_row())
    }
}

/// What is wrong with times that no sensor has, in words: their step, or their size.
fn wrong_times(times_s: &[f64]) -> Option<String> {
    let mut steps_s: Vec<f64> = times_s.windows(2).map(|pair| (pair[1] - pair[0]).abs()).collect();
    steps_s.retain(|step_s| *step_s > 0.0);
    steps_s.sort_by(f64::total_cmp);
    let step_s = *steps_s.get(steps_s.len() / 2)?;
    let largest = times_s.iter().fold(0.0, |largest: f64, time_s| largest.max(time_s.abs()));
    if (MIN_STEP_S..=MAX_STEP_S).contains(&step_s) && largest < MAX_TIME_S {
        return None;
    }
    // Among the units that make it a sensor's step, the one with the most usual step.
    let unusual = |unit_s: f64| (step_s * unit_s / USUAL_STEP_S).ln().abs();
    let fits = |(_, unit_s): &&(&str, f64)| (MIN_STEP_S..=MAX_STEP_S).contains(&(step_s * unit_s));
    let unit = TIME_UNITS.iter().filter(fits).min_by(|a, b| unusual(a.1).total_cmp(&unusual(b.1)));
    let hint = unit.map_or_else(
        || "is `time_s` in seconds?".to_owned(),
        |(unit, unit_s)| format!("`time_s` looks like {unit}, multiply it by {unit_s:e}"),
    );
    Some(format!(
        "{step_s:.3e} s from sample to sample at times up to {largest:e} s, sensors have {MIN_STEP_S:e} \
         to {MAX_STEP_S} s: {hint}"
    ))
}

impl Triple {
    fn read(&self, record: &csv::StringRecord) -> Result<Vector3<f64>, String> {
        let [x, y, z] = self.columns.map(|column| number(record, column));
        let reading = Vector3::new(x?, y?, z?);
        if reading.amax() * self.factor > self.largest {
            let (found, largest) = (reading.amax(), self.largest / self.factor);
            return Err(format!(
                "{found:e} is no reading of a sensor, {largest:.0} or less expected"
            ));
        }
        Ok(reading * self.factor)
    }
}

/// The columns `{letter}x_{unit}`, `{letter}y_{unit}`, `{letter}z_{unit}` of the first unit that is
/// there.
fn triple(columns: &[&str], letter: char, units: &[(&str, f64)], largest: f64) -> Option<Triple> {
    units.iter().find_map(|(unit, factor)| {
        let find = |axis: char| {
            let wanted = format!("{letter}{axis}_{unit}");
            columns.iter().position(|column| *column == wanted)
        };
        Some(Triple { columns: [find('x')?, find('y')?, find('z')?], factor: *factor, largest })
    })
}

fn number(record: &csv::StringRecord, column: usize) -> Result<f64, String> {
    let text = record.get(column).ok_or_else(|| format!("column {} is missing", column + 1))?;
    match text.parse::<f64>() {
        Ok(value) if value.is_finite() => Ok(value),
        _ => Err(format!("`{text}` is not a number")),
    }
}
