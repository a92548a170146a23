//! `kurs track`: a trajectory from the measurements of ground stations, or, with `--simulate`,
//! measurements of a known one and what accuracy to expect of them.

mod config;
mod input;
mod monte_carlo;
mod path;
mod report;
mod simulate;
mod write;

use std::fmt::{self, Write as _};
use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::bail;
use kurs::frames::{Ecef, Vector};
use kurs::trajectory::station::Station;
use serde::Serialize;

use self::config::{Config, SimulateConfig};
use self::monte_carlo::SetComparison;
use self::path::{PathFound, Status};
use self::simulate::TruePoint;
use crate::failure::{ExitCode, UsageError};
use crate::output::{self, OutputFolder};
use crate::pipe::{self, InputFile};
use crate::window::Window;

/// Trajectory of a moving object from angles, ranges, range differences and direction cosines that
/// ground stations measure.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Configuration file (TOML).
    config: PathBuf,
    /// Sets a key of the table `track`, or `table.key`.
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    #[command(flatten)]
    window: Window,
    /// Folder for the results.
    #[arg(long, value_name = "DIR", default_value = "kurs-out/track")]
    out: PathBuf,
    /// Make measurements of the path in `[simulate]` instead of reading files, and compare.
    #[arg(long)]
    simulate: bool,
    /// With --simulate: standard deviations three ways, from this many draws a point.
    #[arg(long, value_name = "N", requires = "simulate")]
    monte_carlo: Option<usize>,
    /// With --simulate: seed of the noise instead of the one in the file.
    #[arg(long, requires = "simulate")]
    seed: Option<u64>,
    /// Also write report.html.
    #[arg(long)]
    report: bool,
    /// Prints the counts as JSON in place of the closing lines.
    #[arg(long)]
    json: bool,
    /// No closing lines.
    #[arg(long, short)]
    quiet: bool,
}

/// What a run may leave in its folder.
const OUTPUTS: &[&str] = &[
    "trajectory.csv",
    "residuals.csv",
    "stations.csv",
    "path.kml",
    "path.geojson",
    "measurements.csv",
    "measurements.tdm",
    "measurements.xml",
    "truth.csv",
    "monte_carlo.csv",
    "deviations.csv",
    "summary.json",
    "report.html",
];

pub(crate) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    args.window.check()?;
    let file = InputFile::open(&args.config)?;
    let config = Config::read(file.path(), &args.set)?;
    let stations = config.stations()?;
    let simulate = match (&config.simulate, args.simulate) {
        (Some(simulate), true) => Some(simulate),
        (None, true) => {
            return Err(UsageError("--simulate needs a table [simulate]".to_owned()).into());
        }
        (_, false) => None,
    };
    let folder = &pipe::folder_of(file.path());

    let truth = simulate.map(|simulate| simulate::truth(&config, simulate)).transpose()?;
    let mut observations = match (simulate, &truth) {
        (Some(simulate), Some(truth)) => {
            let seed = args.seed.unwrap_or(simulate.seed);
            simulate::observations(&config, simulate, &stations, truth, seed)?
        }
        _ => input::read(&config, folder)?,
    };
    observations.retain(|observation| args.window.contains(observation.time));
    if observations.is_empty() {
        bail!("no measurement is inside --from, --to and --every");
    }
    let inputs: Vec<PathBuf> = config.track.files.iter().map(|file| folder.join(file)).collect();
    let named: Vec<PathBuf> = if args.simulate { Vec::new() } else { inputs.clone() };
    let outputs = OutputFolder::begin(&args.out, OUTPUTS, &named)?;
    if let Some(truth) = &truth {
        write::simulated(&config, &observations, truth, outputs.path())?;
    }
    let found = path::find(&config, &stations, &observations)?;
    write::trajectory(&found.points, outputs.path())?;
    write::residuals(&config, &found, outputs.path())?;
    let mut told = String::new();
    write::parameters(&config, &found, outputs.path(), &mut told)?;
    write::maps(&found.points, outputs.path())?;
    let counts = Counts::of(&found, observations.len());
    writeln!(told, "{counts}")?;

    let mut comparisons = Vec::new();
    if let (Some(simulate), Some(truth)) = (simulate, &truth) {
        tell_errors(&found, truth, &mut told);
        if let Some(draws) = args.monte_carlo {
            let draws = draws.max(1);
            let seed = args.seed.unwrap_or(simulate.seed);
            let trial =
                Trial { config: &config, simulate, stations: &stations, truth, draws, seed };
            comparisons = compare_sets(&trial, outputs.path(), &mut told)?;
        }
    }
    if args.report {
        let files = if args.simulate { Vec::new() } else { inputs };
        report::write(&config, &stations, &found, &comparisons, &files, outputs.path())?;
    }
    output::write_json(outputs.path(), "summary.json", &counts)?;
    outputs.publish()?;
    if args.json {
        output::print_json(&counts)?;
    } else if !args.quiet {
        output::print(format_args!("{told}written to {}\n", args.out.display()))?;
    }
    match found.points.first() {
        Some(first) if found.points.iter().all(|point| point.status == Status::Lost) => {
            bail!("every point is lost, the first one because: {}", first.reason)
        }
        _ => Ok(ExitCode::SUCCESS),
    }
}

/// What a comparison of sets of measurements needs.
struct Trial<'a> {
    config: &'a Config,
    simulate: &'a SimulateConfig,
    stations: &'a [Station],
    truth: &'a [TruePoint],
    draws: usize,
    seed: u64,
}

fn compare_sets(
    trial: &Trial<'_>,
    out: &Path,
    told: &mut String,
) -> anyhow::Result<Vec<SetComparison>> {
    let Trial { config, simulate, stations, truth, draws, seed } = *trial;
    let began = Instant::now();
    let comparisons = monte_carlo::run(config, &simulate.set, stations, truth, draws, seed)?;
    let elapsed_s = began.elapsed().as_secs_f64();
    monte_carlo::report(&comparisons, out, told)?;
    let total: usize = comparisons.iter().map(|c| c.points.len() * draws).sum();
    writeln!(told, "{total} draws in {elapsed_s:.2} s")?;
    monte_carlo::deviations(config, &simulate.set, stations, truth, seed, out)?;
    Ok(comparisons)
}

/// `summary.json`: how many measurements and points of each kind there are.
#[derive(Debug, Serialize)]
struct Counts {
    version: &'static str,
    measurements: usize,
    left_out: usize,
    points: usize,
    ok: usize,
    ambiguous: usize,
    inconsistent: usize,
    lost: usize,
}

impl Counts {
    fn of(found: &PathFound, measurements: usize) -> Self {
        let count = |status| found.points.iter().filter(|point| point.status == status).count();
        Self {
            version: env!("CARGO_PKG_VERSION"),
            measurements,
            left_out: found.residuals.iter().filter(|residual| residual.excluded).count(),
            points: found.points.len(),
            ok: count(Status::Ok),
            ambiguous: count(Status::Ambiguous),
            inconsistent: count(Status::Inconsistent),
            lost: count(Status::Lost),
        }
    }
}

impl fmt::Display for Counts {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { measurements, left_out, points, ok, ambiguous, inconsistent, lost, .. } = self;
        write!(
            f,
            "{measurements} measurements, {left_out} left out; {points} points: {ok} ok, {ambiguous} ambiguous, \
             {inconsistent} inconsistent, {lost} lost"
        )
    }
}

/// Errors of the simulated path: root mean square, and normalised by the covariance (3 expected).
fn tell_errors(found: &PathFound, truth: &[TruePoint], told: &mut String) {
    let (mut squares, mut normalised, mut count) = (0.0, 0.0, 0_u32);
    for point in &found.points {
        let at = truth.iter().find(|true_point| (true_point.time - point.time).abs() < 1e-6);
        let (Some(at), Some(position), Some(covariance)) =
            (at, point.position_m, point.covariance_m2)
        else {
            continue;
        };
        let error: Vector<Ecef> = position - at.position_m;
        let Some(information) = covariance.try_inverse() else { continue };
        squares += error.dot(&error);
        normalised += error.xyz().dot(&(information * error.xyz()));
        count += 1;
    }
    if count > 0 {
        let count = f64::from(count);
        let _ = writeln!(
            told,
            "against the truth: RMS {:.2} m, normalised error squared {:.2} (3 expected)",
            (squares / count).sqrt(),
            normalised / count
        );
    }
}
