//! `kurs orient`: coordinates of antennas in, attitude out.

mod config;
mod positions;

use std::fmt::Write as _;
use std::io::Write as _;
use std::path::{Path, PathBuf};

use anyhow::{Context, anyhow, bail};
use kurs::array::AntennaArray;
use kurs::frames::Vector;
use kurs::orientation::geometry::{self, EstimatedGeometry};
use kurs::orientation::lengths::Length;
use kurs::orientation::{FittedEpoch, Method, Orienter, OrienterSettings, PositionEpoch};
use kurs::solution::{EpochSolution, Outcome};
use kurs_formats::positions::nmea::{Date, NmeaOptions};
use rayon::prelude::*;

use crate::config_file;
use crate::failure::{ExitCode, RequiredFix, UsageError};
use crate::interrupt::Watch;
use crate::output::{self, OutputFile, OutputFolder};
use crate::pipe::InputFile;
use crate::progress::{Progress, Work};
use crate::report::{Report, Words};
use crate::summary::{Summary, damaged};
use crate::table::TableFormat;
use crate::tables::Tables;
use crate::window::Window;
use config::Config;
use positions::Positions;

/// Stated standard deviations are left alone unless they are this many times too small.
const TRUSTED_SD_FACTOR: f64 = 1.5;
/// The known lengths scale standard deviations by no more: beyond it the lengths are wrong, not the
/// standard deviations. A fixed RTK solution is good to centimetres, here counted as 1 cm, and is
/// never as bad as five.
const MAX_SD_FACTOR: f64 = 5.0;
/// Nor are they ten times better: lengths that agree to less are copies of each other, or rounded.
const MIN_SD_FACTOR: f64 = 0.1;
/// Epochs that are fitted, by all processors, while those before are written.
const EPOCHS_AT_ONCE: usize = 8192;

/// What a run may leave in its folder.
const OUTPUTS: &[&str] = &[
    "attitude.csv",
    "attitude.jsonl",
    "baselines.csv",
    "baselines.jsonl",
    "points.csv",
    "points.jsonl",
    "array.toml",
    "summary.json",
    "report.html",
    "track.geojson",
    "track.kml",
];

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
    /// Takes NMEA sentences that have no checksum.
    #[arg(long)]
    accept_no_checksum: bool,
    #[command(flatten)]
    required_fix: RequiredFix,
    /// Sets a key of the table `orient`, or `table.key`.
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    #[command(flatten)]
    window: Window,
    /// Folder for the outputs.
    #[arg(long, value_name = "DIR", default_value = "kurs-out/orient")]
    out: PathBuf,
    /// Output formats.
    #[arg(long, value_enum, default_value = "csv", value_delimiter = ',')]
    format: Vec<TableFormat>,
    /// Writes report.html: plots of the whole run on one page that needs no network; and the track
    /// for maps, track.geojson and track.kml.
    #[arg(long)]
    report: bool,
    /// Prints summary.json in place of the closing summary.
    #[arg(long)]
    json: bool,
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
    args.window.check()?;
    let file = InputFile::open(&args.config)?;
    let config: Config = config_file::read_with(file.path(), &args.set, "orient")?;
    config.check()?;
    let given = config.array()?;
    let names = config.names();
    let inputs = positions::files(&args.positions, &names)?;
    let named = inputs.iter().cloned().chain([args.config.clone()]).collect::<Vec<_>>();
    let folder = OutputFolder::begin(&args.out, OUTPUTS, &named)?;
    let input = read_positions(args, &config, &names)?;

    let array = match given {
        Some(array) => array,
        None => estimated_array(&input, &names, folder.path())?,
    };
    let orienter = orienter(args, &config, array, &input)?;
    let present = input.antennas();
    let watch = Watch::begin();
    let mut outputs = Outputs::create(folder.path(), args, &config, present.len() >= 2)?;
    outputs.write_all(&orienter, &input.epochs, &watch)?;
    let Outputs { mut summary, tables, progress, report, .. } = outputs;
    let wall_s = progress.finish();
    if watch.was_interrupted() {
        summary.interrupt();
    }

    let text = config_file::text(file.path())?;
    let file = summary.file(&text, &input.damage, wall_s);
    for tables in tables {
        tables.finish()?;
    }
    if let Some(report) = report {
        let input = |file: &PathBuf| ["positions".to_owned(), file.display().to_string()];
        let words = Words {
            title: "Kurs: attitude from coordinates",
            inputs: inputs.iter().map(input).collect(),
            headline: summary.headline(),
            moments: summary.means(),
            configuration: text,
            ephemerides: None,
        };
        report.write(folder.path(), &words)?;
    }
    output::write_json(folder.path(), "summary.json", &file)?;
    folder.publish()?;
    if args.json {
        output::print_json(&file)?;
    } else if !args.quiet {
        // Notes are told already.
        let (damage, _) = input.damage.split_at(input.damage.len() - input.notes.len());
        let (text, damaged, out) = (summary.text(), damaged(damage), args.out.display());
        output::print(format_args!("{text}{damaged}\nwritten to {out}\n"))?;
    }
    if summary.has_solution() {
        return Ok(watch.status(args.required_fix.exit_code(&summary)));
    }
    let present: Vec<usize> = present.into_iter().collect();
    Err(watch.unless_interrupted(anyhow!("{}", why_nothing(&present, &names, &summary))))
}

/// Reads the positions of the window, and says what is odd about them.
fn read_positions(args: &Args, config: &Config, names: &[String]) -> anyhow::Result<Positions> {
    let options = NmeaOptions { date: args.date, accept_no_checksum: args.accept_no_checksum };
    let mut input = positions::read(&args.positions, options, config)?;
    input.epochs.retain(|epoch| args.window.contains(epoch.time));
    if input.epochs.is_empty() {
        let files = args.positions.join(", ");
        let notes: String = input.notes.iter().map(|note| format!("\n{note}")).collect();
        let why = if notes.is_empty() { damaged(&input.damage) } else { notes };
        bail!("no position of the antennas {} in {files}{why}", names.join(", "));
    }
    if !args.quiet {
        input.notes.iter().for_each(|note| eprintln!("{note}"));
    }
    Ok(input)
}

/// Why not a single row has an attitude; `present`: the antennas that have positions.
fn why_nothing(present: &[usize], names: &[String], summary: &Summary) -> String {
    match (present, summary.main_reason()) {
        ([only], _) => {
            format!("only antenna {} has positions: an attitude needs those of two", names[*only])
        }
        (_, Some("few_antennas")) => "no epoch has two antennas: do the times overlap?".into(),
        _ => "no epoch has an attitude".into(),
    }
}

/// Where the rows go.
struct Outputs {
    summary: Summary,
    tables: Vec<Tables>,
    report: Option<Report>,
    progress: Progress,
    done: usize,
    /// Two antennas have positions, if not at one time.
    is_capable: bool,
}

impl Outputs {
    fn create(
        folder: &Path,
        args: &Args,
        config: &Config,
        is_capable: bool,
    ) -> anyhow::Result<Self> {
        let points: Vec<String> = config.point.iter().map(|point| point.name.clone()).collect();
        let tables = args
            .format
            .iter()
            .map(|format| Tables::create(folder, *format, config.names(), points.clone()));
        Ok(Self {
            summary: Summary::new(config.names()).with_capable("that two antennas have"),
            tables: tables.collect::<anyhow::Result<_>>()?,
            report: args.report.then(|| Report::new(config.names(), &config.places())),
            progress: Progress::start(args.quiet, Work::ORIENT),
            done: 0,
            is_capable,
        })
    }

    /// Solves all epochs and writes their rows in order.
    fn write_all(
        &mut self,
        orienter: &Orienter,
        epochs: &[PositionEpoch],
        watch: &Watch,
    ) -> anyhow::Result<()> {
        let mut memory = orienter.memory();
        let mut blocks = epochs.chunks(EPOCHS_AT_ONCE);
        let mut fit_next = || -> Option<Vec<FittedEpoch>> {
            Some(blocks.next()?.par_iter().map(|epoch| orienter.fit(epoch)).collect())
        };
        let mut fitted = fit_next();
        while let Some(block) = fitted {
            let write = || -> anyhow::Result<()> {
                for epoch in &block {
                    let mut row = orienter.row(epoch, &mut memory);
                    if !self.is_capable {
                        row.outcome = Outcome::NotCapable;
                    }
                    self.write(&row, epochs.len())?;
                }
                Ok(())
            };
            let (written, next) = rayon::join(write, &mut fit_next);
            written?;
            fitted = next.filter(|_| !watch.asks_to_end());
        }
        Ok(())
    }

    fn write(&mut self, row: &EpochSolution, all: usize) -> anyhow::Result<()> {
        self.summary.add(row, row.antennas >= 2);
        for tables in &mut self.tables {
            tables.write(row)?;
        }
        if let Some(report) = &mut self.report {
            report.add(row, None);
        }
        self.done += 1;
        let share = self.done as f64 / all as f64;
        self.progress.epoch(row.is_fixed(), || Some(share));
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
    let settings = OrienterSettings {
        array,
        array_sd_m: config.orient.array_sd_m,
        sd_scale: 1.0,
        method,
        max_tilt_rad: config.orient.max_tilt_deg.to_radians(),
        roll_sd_rad: config.orient.roll_sd_deg.to_radians(),
        max_angle_sd_rad: config.orient.max_angle_sd_deg.to_radians(),
        points_m: config.point.iter().map(|point| point_of(point.position_m)).collect(),
    };
    let usage = |error: kurs::attitude::AttitudeError| UsageError(error.to_string());
    let orienter = Orienter::new(settings.clone()).map_err(usage)?;
    let Some(factor) = orienter.sd_factor(&input.epochs) else { return Ok(orienter) };
    let factor = factor.max(MIN_SD_FACTOR);
    if input.states_sd && factor <= TRUSTED_SD_FACTOR {
        return Ok(orienter);
    }
    let lengths = orienter.lengths(&input.epochs);
    if factor > max_factor(&lengths, input) {
        eprintln!("{}", misfit_text(&lengths, &config.names(), factor));
        return Ok(orienter);
    }
    let kind = if input.states_sd { "stated" } else { "assumed" };
    let steady = worst(&lengths).filter(|length| factor > 1.0 && length.is_steadily_off());
    if let Some(length) = steady {
        let off = length_text(length, &config.names());
        eprintln!(
            "{kind} standard deviations times {factor:.2}, but it is no noise: {off}; a wrong length, \
             receivers that sample apart, or errors that last"
        );
    } else if !args.quiet {
        eprintln!("{kind} standard deviations times {factor:.2}, as the known distances show");
    }
    Ok(Orienter::new(OrienterSettings { sd_scale: factor, ..settings }).map_err(usage)?)
}

/// The largest factor on the standard deviations that the known lengths may ask for. Where nothing
/// is said of the positions' quality it counts from what scatters.
fn max_factor(lengths: &[Length], input: &Positions) -> f64 {
    if input.states_quality {
        return MAX_SD_FACTOR;
    }
    let scatter = lengths.iter().map(|length| length.scatter_m / length.stated_sd_m);
    MAX_SD_FACTOR * scatter.fold(1.0, f64::max)
}

/// Says that the known lengths do not fit, by the pair that fits worst.
fn misfit_text(lengths: &[Length], names: &[String], factor: f64) -> String {
    worst(lengths).map_or_else(String::new, |length| {
        format!(
            "the known lengths do not fit: {}; only standard deviations {factor:.0} times larger would explain it",
            length_text(length, names)
        )
    })
}

/// The pair that is farthest from its known length.
fn worst(lengths: &[Length]) -> Option<&Length> {
    lengths.iter().max_by(|a, b| a.excess().total_cmp(&b.excess()))
}

fn length_text(length: &Length, names: &[String]) -> String {
    let Length { first, second, known_m, measured_m, scatter_m, .. } = length;
    format!(
        "{} to {} measured {measured_m:.3} ± {scatter_m:.3} m, configured {known_m:.3} m",
        names[*first], names[*second]
    )
}

/// The array as the data have it, written to `array.toml`.
fn estimated_array(
    input: &Positions,
    names: &[String],
    out: &Path,
) -> anyhow::Result<AntennaArray> {
    let named = |error: geometry::GeometryError| anyhow::anyhow!("{}", error.named(names));
    let estimate = geometry::estimate(&input.epochs, names.len())
        .map_err(named)
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
    let rows = names.iter().zip(&estimate.positions_m).zip(estimate.scatter_m());
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
