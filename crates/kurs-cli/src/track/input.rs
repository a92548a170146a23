//! Measurements from CSV files with units in the column names, and from Tracking Data Messages.

use core::f64::consts::{FRAC_PI_2, TAU};
use std::collections::HashSet;
use std::path::Path;

use anyhow::{Context, anyhow, bail};
use kurs::time::GpsTime;
use kurs::trajectory::measurement::{Measurement, Quantity};
use kurs_formats::tdm::{self, Observable, TimeSystem};

use super::config::{Config, TwoWayRange};
use super::write::words;
use crate::failure::UsageError;
use crate::text_file;

/// One measurement with its instant.
#[derive(Debug, Clone, Copy)]
pub(super) struct Observation {
    pub(super) time: GpsTime,
    pub(super) measurement: Measurement,
}

/// Reads all files of the configuration, in order of time.
pub(super) fn read(config: &Config, folder: &Path) -> anyhow::Result<Vec<Observation>> {
    let mut observations = Vec::new();
    for file in &config.track.files {
        let path = folder.join(file);
        let text = text_file::text(&path)?;
        let name = path.display().to_string();
        let read = if tdm::looks_like(&text) {
            from_tdm(config, &name, &text)
        } else {
            from_csv(config, &text)
        };
        observations.extend(read.with_context(|| name)?);
    }
    if observations.is_empty() {
        bail!("no measurements in the files of `track.files`");
    }
    observations.sort_by_key(|observation| observation.time);
    // Counted twice, a measurement would weigh twice.
    let read = observations.len();
    let mut seen = HashSet::with_capacity(read);
    observations.retain(|Observation { time, measurement }| {
        let Measurement { station, quantity, value, .. } = *measurement;
        seen.insert((*time, station, quantity, value.to_bits()))
    });
    let repeats = read - observations.len();
    if repeats > 0 {
        eprintln!(
            "note: {repeats} of {read} measurements are exact repeats of others and left out"
        );
    }
    Ok(observations)
}

fn from_tdm(config: &Config, name: &str, text: &str) -> anyhow::Result<Vec<Observation>> {
    let data = tdm::read(text)?;
    for (keyword, count) in &data.read_past {
        eprintln!("note: {count} records of {keyword} have no use here and were read past");
    }
    for reason in &data.left_out {
        eprintln!("note: {name}: a segment is left out: {reason}");
    }
    let mut observations = Vec::with_capacity(data.records.len());
    for record in &data.records {
        let station = |name: &str| {
            let index = config.index_of(name);
            index.with_context(|| format!("line {}: no station is called `{name}`", record.line))
        };
        let index = station(&record.station)?;
        let (quantity, value) = match record.observable {
            Observable::Azimuth => (Quantity::Azimuth, record.value),
            Observable::Elevation => (Quantity::Elevation, record.value),
            Observable::OneWayRange => (Quantity::Range, record.value),
            Observable::TwoWayRange => match config.track.two_way_range {
                TwoWayRange::Half => (Quantity::Range, record.value),
                TwoWayRange::RoundTrip => (Quantity::Range, 0.5 * record.value),
            },
            Observable::RangeDifference => {
                let reference = station(record.reference.as_deref().unwrap_or_default())?;
                (Quantity::RangeDifference { reference }, record.value)
            }
        };
        let sigma = config.station[index].sigma(quantity)?;
        let measurement = Measurement { station: index, quantity, value, sigma };
        check(&measurement).with_context(|| format!("line {}", record.line))?;
        observations.push(Observation { time: record.time, measurement });
    }
    Ok(observations)
}

/// Refuses a number that no station can measure, whatever its noise.
fn check(measurement: &Measurement) -> anyhow::Result<()> {
    /// What is off by more standard deviations than this is not noise.
    const SIGMAS: f64 = 5.0;
    /// Longest range, m: beyond the planets.
    const LONGEST_M: f64 = 1e13;
    let Measurement { quantity, value, sigma, .. } = *measurement;
    let [least, most] = match quantity {
        Quantity::Azimuth => [-TAU, TAU],
        Quantity::Elevation => [-FRAC_PI_2, FRAC_PI_2],
        Quantity::Range => [0.0, LONGEST_M],
        Quantity::RangeDifference { .. } => [-LONGEST_M, LONGEST_M],
        Quantity::CosineNorth | Quantity::CosineEast => [-1.0, 1.0],
    };
    if (least - SIGMAS * sigma..=most + SIGMAS * sigma).contains(&value) {
        return Ok(());
    }
    let (name, unit, per_unit) = words(quantity);
    let [found, least, most] = [value, least, most].map(|number| number * per_unit);
    bail!("{name} {found} {unit}, expected {least} to {most}")
}

/// A column with values: its name, that of its standard deviation, and the factor to rad, m or 1.
const VALUES: [(&str, &str, Quantity); 6] = [
    ("azimuth_deg", "azimuth_sd_deg", Quantity::Azimuth),
    ("elevation_deg", "elevation_sd_deg", Quantity::Elevation),
    ("range_m", "range_sd_m", Quantity::Range),
    ("range_difference_m", "range_difference_sd_m", Quantity::RangeDifference { reference: 0 }),
    ("cosine_north", "cosine_north_sd", Quantity::CosineNorth),
    ("cosine_east", "cosine_east_sd", Quantity::CosineEast),
];
const TIMES: [&str; 3] = ["time_utc", "time_gpst", "time_s"];

/// Reads a table: a time, `station`, values, optionally their standard deviations and `reference`.
fn from_csv(config: &Config, text: &str) -> anyhow::Result<Vec<Observation>> {
    let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).from_reader(text.as_bytes());
    let columns = Columns::of(reader.headers()?)?;
    let mut observations = Vec::new();
    for record in reader.records() {
        let record = &record?;
        let line = record.position().map_or(0, csv::Position::line);
        Row { config, columns: &columns, record, line }.read(&mut observations)?;
    }
    Ok(observations)
}

/// Where the columns of a table are.
struct Columns {
    headers: csv::StringRecord,
    time: (&'static str, usize),
    station: usize,
}

impl Columns {
    fn of(headers: &csv::StringRecord) -> anyhow::Result<Self> {
        let known = |name: &str| {
            TIMES.contains(&name)
                || ["station", "reference"].contains(&name)
                || VALUES.iter().any(|(value, sd, _)| [*value, *sd].contains(&name))
        };
        if let Some(unknown) = headers.iter().find(|name| !known(name)) {
            bail!("line 1: unknown column `{unknown}`");
        }
        let column = |name: &str| headers.iter().position(|header| header == name);
        let times: Vec<_> = TIMES.iter().filter_map(|name| Some((*name, column(name)?))).collect();
        let [time] = times[..] else {
            let found = times.len();
            bail!("line 1: {found} of the columns time_utc, time_gpst, time_s found, one expected");
        };
        let station = column("station").context("line 1: the column `station` is needed")?;
        Ok(Self { headers: headers.clone(), time, station })
    }
}

/// One row of a table.
struct Row<'a> {
    config: &'a Config,
    columns: &'a Columns,
    record: &'a csv::StringRecord,
    line: u64,
}

impl Row<'_> {
    /// Adds the measurements of all value columns.
    fn read(&self, observations: &mut Vec<Observation>) -> anyhow::Result<()> {
        let line = self.line;
        let time = self.time()?;
        let station = self.station(&self.record[self.columns.station])?;
        for (value_name, sd_name, quantity) in VALUES {
            let Some(value) = self.number(value_name)? else { continue };
            let quantity = match quantity {
                Quantity::RangeDifference { .. } => {
                    let name = self.field("reference");
                    let name =
                        name.with_context(|| format!("line {line}: `reference` is empty"))?;
                    Quantity::RangeDifference { reference: self.station(name)? }
                }
                other => other,
            };
            let unit = if value_name.ends_with("_deg") { 1.0_f64.to_radians() } else { 1.0 };
            let sigma = match self.number(sd_name)? {
                Some(sigma) if sigma > 0.0 => sigma * unit,
                Some(sigma) => bail!("line {line}: {sd_name}: {sigma} is not above zero"),
                None => self.config.station[station].sigma(quantity)?,
            };
            let measurement = Measurement { station, quantity, value: value * unit, sigma };
            check(&measurement).with_context(|| format!("line {line}"))?;
            observations.push(Observation { time, measurement });
        }
        Ok(())
    }

    fn time(&self) -> anyhow::Result<GpsTime> {
        let (line, (name, column)) = (self.line, self.columns.time);
        let text = &self.record[column];
        let is_no_time = || format!("line {line}: {name}: `{text}` is not a time");
        match name {
            "time_utc" => TimeSystem::Utc.instant(text).with_context(is_no_time),
            "time_gpst" => TimeSystem::Gps.instant(text).with_context(is_no_time),
            _ => {
                let time_s: f64 = text.parse().ok().with_context(is_no_time)?;
                let time = self.config.track.instant(time_s);
                time.map_err(|UsageError(what)| anyhow!("line {line}: {what}"))
            }
        }
    }

    fn station(&self, name: &str) -> anyhow::Result<usize> {
        let index = self.config.index_of(name);
        index.with_context(|| format!("line {}: no station is called `{name}`", self.line))
    }

    /// The field of a column, unless it is blank or the table has no such column.
    fn field(&self, name: &str) -> Option<&str> {
        let column = self.columns.headers.iter().position(|header| header == name)?;
        self.record.get(column).filter(|field| !field.is_empty())
    }

    fn number(&self, name: &str) -> anyhow::Result<Option<f64>> {
        let parse = |text: &str| {
            let number = text.parse::<f64>().ok().filter(|number| number.is_finite());
            number.with_context(|| format!("line {}: {name}: `{text}` is not a number", self.line))
        };
        self.field(name).map(parse).transpose()
    }
}
