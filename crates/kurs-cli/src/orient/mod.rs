//! `kurs orient`: coordinates of antennas in, attitude out.

mod config;
mod positions;

use std::fmt::Write as _;
use std::io::Write as _;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use kurs::array::AntennaArray;
use kurs::frames::Vector;
use kurs::orientation::geometry::{self, EstimatedGeometry};
use kurs::orientation::{Method, Orienter, PositionEpoch, Settings};
use kurs::solution::{EpochSolution, Status};
use kurs_formats::positions::nmea::Date;
use rayon::prelude::*;

use crate::config_file;
use crate::failure::{ExitCode, UsageError};
use crate::output::{self, OutputFile};
use crate::progress::Progress;
use crate::summary::Summary;
use crate::table::TableFormat;
use crate::tables::Tables;
use config::Config;
use positions::Positions;

/// Stated standard deviations are left alone unless they are this many times too small.
const TRUSTED_SD_FACTOR: f64 = 1.5;
/// Epochs that are solved, by all processors, while those before are written.
const EPOCHS_AT_ONCE: usize = 8192;

/// Attitude from antenna coordinates that receivers already give.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Configuration file (TOML): the antennas, with or without their places on the body.
    config: PathBuf,
    /// Coordinates: tables with a header line (CSV), or one NMEA log for each antenna.
    #[arg(required = true, value_name = "[NAME=]FILE")]
    positions: Vec<String>,
    /// How the attitude is found.
    #[arg(long, value_enum, default_value = "weighted")]
    method: MethodName,
    /// UTC date of the first position, for NMEA logs that say none.
    #[arg(long, value_name = "YYYY-MM-DD", value_parser = date)]
    date: Option<Date>,
    /// Folder for the outputs.
    #[arg(long, value_name = "DIR", default_value = "kurs-out")]
    out: PathBuf,
    /// Output formats.
    #[arg(long, value_enum, default_value = "csv", value_delimiter = ',')]
    format: Vec<TableFormat>,
    /// No progress and no closing summary.
    #[arg(long, short)]
    quiet: bool,
}

/// Words of `--method`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum MethodName {
    /// All antennas with their covariances.
    Weighted,
    /// The published closed form for the first three antennas.
    ThreePoint,
}

/// Reads `--date`.
fn date(text: &str) -> Result<Date, String> {
    let parts: Vec<&str> = text.split('-').collect();
    let [year, month, day] = parts[..] else { return Err("expected YYYY-MM-DD".to_owned()) };
    match (year.parse(), month.parse(), day.parse()) {
        (Ok(year @ 1980..=2200), Ok(month @ 1..=12), Ok(day @ 1..=31)) => Ok((year, month, day)),
        _ => Err("expected YYYY-MM-DD".to_owned()),
    }
}

/// Runs the command.
pub(crate) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let config: Config = config_file::read(&args.config)?;
    config.check()?;
    let given = config.array()?;
    let names = config.names();
    let input = positions::read(&args.positions, args.date, &config)?;
    if input.epochs.is_empty() {
        bail!("no position of the antennas {} in {}", names.join(", "), args.positions.join(", "));
    }

    let array = match given {
        Some(array) => array,
        None => estimated_array(&input, &names, &args.out)?,
    };
    let orienter = orienter(args, &config, array, &input)?;
    let mut outputs = Outputs::create(args, &config)?;
    outputs.write_all(&orienter, &input.epochs)?;
    let Outputs { summary, tables, progress } = outputs;
    let wall_s = progress.finish();

    let text = std::fs::read_to_string(&args.config).unwrap_or_default();
    let file = summary.file(&text, &input.damage, wall_s);
    output::write_json(&args.out, "summary.json", &file)?;
    for tables in tables {
        tables.finish()?;
    }
    if !args.quiet {
        println!("{}\nwritten to {}", summary.text(), args.out.display());
    }
    if summary.has_solution() {
        return Ok(ExitCode::SUCCESS);
    }
    match summary.main_reason() {
        Some("few_antennas") => bail!("no epoch has two antennas: do the times overlap?"),
        Some("geometry") => bail!("the coordinates never keep the distances of the antennas"),
        _ => bail!("no epoch has an attitude"),
    }
}

/// Where the rows go.
struct Outputs {
    summary: Summary,
    tables: Vec<Tables>,
    progress: Progress,
}

impl Outputs {
    fn create(args: &Args, config: &Config) -> anyhow::Result<Self> {
        let points: Vec<String> = config.point.iter().map(|point| point.name.clone()).collect();
        let tables = args
            .format
            .iter()
            .map(|format| Tables::create(&args.out, *format, config.names(), points.clone()));
        Ok(Self {
            summary: Summary::new(config.names()),
            tables: tables.collect::<anyhow::Result<_>>()?,
            progress: Progress::start(args.quiet),
        })
    }

    /// Solves all epochs and writes their rows in order.
    fn write_all(&mut self, orienter: &Orienter, epochs: &[PositionEpoch]) -> anyhow::Result<()> {
        let mut blocks = epochs.chunks(EPOCHS_AT_ONCE);
        let mut solve_next = || -> Option<Vec<EpochSolution>> {
            Some(blocks.next()?.par_iter().map(|epoch| orienter.push(epoch)).collect())
        };
        let mut solved = solve_next();
        while let Some(rows) = solved {
            let (written, next) = rayon::join(|| self.write(&rows), &mut solve_next);
            written?;
            solved = next;
        }
        Ok(())
    }

    fn write(&mut self, rows: &[EpochSolution]) -> anyhow::Result<()> {
        for row in rows {
            self.summary.add(row, row.antennas >= 2);
            for tables in &mut self.tables {
                tables.write(row)?;
            }
            self.progress.epoch(row.status == Status::Fixed);
        }
        Ok(())
    }
}

/// The method with standard deviations that fit the data.
fn orienter(
    args: &Args,
    config: &Config,
    array: AntennaArray,
    input: &Positions,
) -> anyhow::Result<Orienter> {
    let method = match args.method {
        MethodName::Weighted => Method::Weighted,
        MethodName::ThreePoint => Method::ThreePoint,
    };
    let point_of = |[x, y, z]: [f64; 3]| Vector::new(x, y, z);
    let settings = Settings {
        array,
        array_sd_m: config.orient.array_sd_m,
        sd_scale: 1.0,
        method,
        max_tilt_rad: config.orient.max_tilt_deg.to_radians(),
        points_m: config.point.iter().map(|point| point_of(point.position_m)).collect(),
    };
    let usage = |error: kurs::attitude::AttitudeError| UsageError(error.to_string());
    let orienter = Orienter::new(settings.clone()).map_err(usage)?;
    let Some(factor) = orienter.sd_factor(&input.epochs) else { return Ok(orienter) };
    if input.states_sd && factor <= TRUSTED_SD_FACTOR {
        return Ok(orienter);
    }
    let kind = if input.states_sd { "stated" } else { "assumed" };
    if !args.quiet {
        eprintln!("{kind} standard deviations times {factor:.2}, as the known distances show");
    }
    Ok(Orienter::new(Settings { sd_scale: factor, ..settings }).map_err(usage)?)
}

/// The array as the data have it, written to `array.toml`.
fn estimated_array(
    input: &Positions,
    names: &[String],
    out: &Path,
) -> anyhow::Result<AntennaArray> {
    let estimate = geometry::estimate(&input.epochs, names.len())
        .context("the array cannot be estimated (give `position_m`)")?;
    let mut file = OutputFile::create(out, "array.toml")?;
    file.write_all(array_text(&estimate, names).as_bytes())?;
    file.finish()?;
    Ok(AntennaArray::new(estimate.positions_m)?)
}

/// `[[antenna]]` tables for a configuration.
fn array_text(estimate: &EstimatedGeometry, names: &[String]) -> String {
    let mut text = format!(
        "# Estimated from {} epochs: the first antenna is the origin, x goes through the second,\n\
         # the next one off that line is in the x-y plane, z is down.\n",
        estimate.epochs
    );
    let rows = names.iter().zip(&estimate.positions_m).zip(&estimate.spread_m);
    for ((name, position), [x, y, z]) in rows {
        let p = position.xyz();
        let _ = write!(
            text,
            "\n[[antenna]]\nname = {}\nposition_m = [{:.4}, {:.4}, {:.4}] # scatter of one epoch {x:.4}, {y:.4}, {z:.4} m\n",
            toml::Value::from(name.as_str()),
            p.x,
            p.y,
            p.z
        );
    }
    text
}
