//! Logs of inertial sensors as CSV: the header names columns and units, `time_s, ax_mps2, …`, and
//! the angle of a rotating arm, `arm_deg`, where an encoder measures it.

use std::path::Path;

use anyhow::{Context, bail};
use nalgebra::Vector3;

use crate::summary::Damage;

/// Standard gravity, the unit "g".
const STANDARD_GRAVITY_MPS2: f64 = 9.806_65;

/// Endings of accelerometer columns and what they stand for in m/s².
const ACCELERATION_UNITS: [(&str, f64); 3] =
    [("mps2", 1.0), ("g", STANDARD_GRAVITY_MPS2), ("mg", STANDARD_GRAVITY_MPS2 * 1e-3)];

/// Longest list of damage that is kept.
const LISTED_DAMAGE: usize = 20;

/// Samples of one file in SI units; rows that cannot be used are left out and noted.
#[derive(Debug, Default)]
pub(crate) struct SensorLog {
    pub(crate) time_s: Vec<f64>,
    /// m/s²; empty if the file has none.
    pub(crate) accelerometer: Vec<Vector3<f64>>,
    /// rad/s; empty if the file has none.
    pub(crate) gyro: Vec<Vector3<f64>>,
    /// rad; empty if the file has none.
    pub(crate) arm_angle: Vec<f64>,
    /// What was left out.
    pub(crate) damage: Vec<Damage>,
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
struct Columns {
    time: usize,
    accelerometer: Option<Triple>,
    gyro: Option<Triple>,
    arm_angle: Option<usize>,
}

/// Three columns and the factor to SI units.
struct Triple {
    columns: [usize; 3],
    factor: f64,
}

impl SensorLog {
    /// Reads a file.
    pub(crate) fn read(path: &Path, backwards: Backwards) -> anyhow::Result<Self> {
        let name = path.display();
        let mut reader = csv::ReaderBuilder::new()
            .flexible(true)
            .trim(csv::Trim::All)
            .comment(Some(b'#'))
            .from_path(path)
            .with_context(|| format!("{name}: cannot be read"))?;
        let header = reader.headers().with_context(|| format!("{name}:1"))?.clone();
        let names: Vec<&str> = header.iter().collect();
        let Some(time) = names.iter().position(|column| *column == "time_s") else {
            bail!("{name}:1: no column `time_s`; found: {}", names.join(", "));
        };
        let columns = Columns {
            time,
            accelerometer: triple(&names, 'a', &ACCELERATION_UNITS),
            gyro: triple(&names, 'g', &[("radps", 1.0), ("degps", 1f64.to_radians())]),
            arm_angle: names.iter().position(|name| *name == "arm_deg"),
        };
        if columns.accelerometer.is_none() && columns.gyro.is_none() {
            bail!(
                "{name}:1: no sensor columns; expected ax_mps2, ay_mps2, az_mps2 (or _g, _mg) or \
                 gx_radps, gy_radps, gz_radps (or _degps); found: {}",
                names.join(", ")
            );
        }
        let mut log = Self::default();
        for record in reader.records() {
            match record {
                Ok(record) => {
                    let line = record.position().map_or(0, csv::Position::line);
                    if let Err(what) = log.add(&record, &columns, backwards) {
                        log.note(path, line, what);
                    }
                }
                Err(error) => {
                    let line = error.position().map_or(0, csv::Position::line);
                    log.note(path, line, error.to_string());
                }
            }
        }
        if log.time_s.is_empty() {
            bail!("{name}: no usable row");
        }
        Ok(log)
    }

    /// Median time between samples.
    pub(crate) fn step_s(&self) -> f64 {
        let mut steps: Vec<f64> = self.time_s.windows(2).map(|pair| pair[1] - pair[0]).collect();
        steps.sort_by(f64::total_cmp);
        steps.get(steps.len() / 2).copied().unwrap_or(f64::NAN)
    }

    fn add(
        &mut self,
        record: &csv::StringRecord,
        columns: &Columns,
        backwards: Backwards,
    ) -> Result<(), String> {
        let time_s = number(record, columns.time)?;
        let last = self.time_s.last().filter(|last| time_s <= **last);
        if let (Some(last), Backwards::LeftOut) = (last, backwards) {
            return Err(format!("time goes back from {last} s to {time_s} s"));
        }
        let force = columns.accelerometer.as_ref().map(|triple| triple.read(record)).transpose()?;
        let rate = columns.gyro.as_ref().map(|triple| triple.read(record)).transpose()?;
        let angle = columns.arm_angle.map(|column| number(record, column)).transpose()?;
        self.time_s.push(time_s);
        self.accelerometer.extend(force);
        self.gyro.extend(rate);
        self.arm_angle.extend(angle.map(f64::to_radians));
        Ok(())
    }

    fn note(&mut self, path: &Path, line: u64, what: String) {
        let what = match self.damage.len() {
            0..LISTED_DAMAGE => what,
            LISTED_DAMAGE => "and more".to_owned(),
            _ => return,
        };
        self.damage.push(Damage { file: path.display().to_string(), line, what });
    }
}

impl Triple {
    fn read(&self, record: &csv::StringRecord) -> Result<Vector3<f64>, String> {
        let [x, y, z] = self.columns.map(|column| number(record, column));
        Ok(Vector3::new(x?, y?, z?) * self.factor)
    }
}

/// The columns `{letter}x_{unit}`, `{letter}y_{unit}`, `{letter}z_{unit}` of the first unit that is
/// there.
fn triple(columns: &[&str], letter: char, units: &[(&str, f64)]) -> Option<Triple> {
    units.iter().find_map(|(unit, factor)| {
        let find = |axis: char| {
            let wanted = format!("{letter}{axis}_{unit}");
            columns.iter().position(|column| *column == wanted)
        };
        Some(Triple { columns: [find('x')?, find('y')?, find('z')?], factor: *factor })
    })
}

fn number(record: &csv::StringRecord, column: usize) -> Result<f64, String> {
    let text = record.get(column).ok_or_else(|| format!("column {} is missing", column + 1))?;
    match text.parse::<f64>() {
        Ok(value) if value.is_finite() => Ok(value),
        _ => Err(format!("`{text}` is not a number")),
    }
}
