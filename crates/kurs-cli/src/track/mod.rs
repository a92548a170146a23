//! `kurs track`: a trajectory from the measurements of ground stations, or, with `--simulate`,
//! measurements of a known one and what accuracy to expect of them.

mod config;
mod input;
mod monte_carlo;
mod path;
mod report;
mod simulate;
mod write;

use std::collections::BTreeMap;
use std::fmt::{self, Write as _};
use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::bail;
use kurs::frames::{Ecef, Vector};
use kurs::trajectory::measurement::{Measurement, Quantity};
use kurs::trajectory::station::Station;
use serde::Serialize;

use self::config::{Config, SimulateConfig};
use self::input::Observation;
use self::monte_carlo::SetComparison;
use self::path::{PathFound, Residual, Status};
use self::simulate::TruePoint;
use self::write::words;
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
    let simulation = Simulation::of(args, &config, &stations)?;
    let folder = &pipe::folder_of(file.path());
    let inputs: Vec<PathBuf> = config.track.files.iter().map(|file| folder.join(file)).collect();
    let named: &[PathBuf] = if args.simulate { &[] } else { &inputs };
    let outputs = OutputFolder::begin(&args.out, OUTPUTS, named)?;
    let observations = observations(args, &config, &stations, simulation.as_ref(), folder)?;
    if let Some(simulation) = &simulation {
        write::simulated(&config, &observations, &simulation.truth, outputs.path())?;
    }
    let found = path::find(&config, &stations, &observations)?;
    note_left_out(&config, &found);
    let mut told = String::new();
    write::trajectory(&found.points, outputs.path())?;
    write::residuals(&config, &found, outputs.path())?;
    write::parameters(&config, &found, outputs.path(), &mut told)?;
    write::maps(&found.points, outputs.path())?;
    let counts = Counts::of(&found, observations.len());
    writeln!(told, "{counts}")?;
    if let Some(misfit) = found.misfit {
        writeln!(
            told,
            "the residuals are {misfit:.1} times what the standard deviations say: these are too small, or \
             the object manoeuvres more than `jerk_mps2_per_sqrt_s`; every point is inconsistent"
        )?;
    }

    let mut comparisons = Vec::new();
    if let Some(simulation) = &simulation {
        tell_errors(&found, &simulation.truth, &mut told);
        if let Some(draws) = args.monte_carlo {
            comparisons = simulation.compare_sets(draws.max(1), outputs.path(), &mut told)?;
        }
    }
    if args.report {
        report::write(&config, &stations, &found, &comparisons, named, outputs.path())?;
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

/// Names the stations that lost more than a few measurements of a kind.
fn note_left_out(config: &Config, found: &PathFound) {
    /// More than this share does not come from single faults.
    const FEW: f64 = 0.05;
    let mut counts: BTreeMap<(usize, Quantity), [usize; 2]> = BTreeMap::new();
    for Residual { observation, excluded, .. } in &found.residuals {
        let Measurement { station, quantity, .. } = observation.measurement;
        let [left_out, all] = counts.entry((station, quantity)).or_default();
        *left_out += usize::from(*excluded);
        *all += 1;
    }
    for ((station, quantity), [left_out, all]) in counts {
        let share = left_out as f64 / all as f64;
        if share > FEW {
            eprintln!(
                "note: station `{}`, {}: {left_out} of {all} measurements are left out ({:.0} %), the \
                 others contradict them",
                config.station[station].name,
                words(quantity).0,
                100.0 * share
            );
        }
    }
}

/// The measurements of the window, read or simulated.
fn observations(
    args: &Args,
    config: &Config,
    stations: &[Station],
    simulation: Option<&Simulation<'_>>,
    folder: &Path,
) -> anyhow::Result<Vec<Observation>> {
    let mut observations = match simulation {
        Some(Simulation { table, truth, seed, .. }) => {
            simulate::observations(config, table, stations, truth, *seed)?
        }
        None => input::read(config, folder)?,
    };
    observations.retain(|observation| args.window.contains(observation.time));
    if observations.is_empty() {
        bail!("no measurement is inside --from, --to and --every");
    }
    Ok(observations)
}

/// What `--simulate` makes.
struct Simulation<'a> {
    config: &'a Config,
    stations: &'a [Station],
    table: &'a SimulateConfig,
    truth: Vec<TruePoint>,
    seed: u64,
}

impl<'a> Simulation<'a> {
    /// The simulation that is asked for, if one is.
    fn of(
        args: &Args,
        config: &'a Config,
        stations: &'a [Station],
    ) -> anyhow::Result<Option<Self>> {
        if !args.simulate {
            return Ok(None);
        }
        let Some(table) = &config.simulate else {
            return Err(UsageError("--simulate needs a table [simulate]".to_owned()).into());
        };
        let truth = simulate::truth(config, table)?;
        let seed = args.seed.unwrap_or(table.seed);
        Ok(Some(Self { config, stations, table, truth, seed }))
    }

    /// Compares sets of measurements by `draws` of the noise at each point.
    fn compare_sets(
        &self,
        draws: usize,
        out: &Path,
        told: &mut String,
    ) -> anyhow::Result<Vec<SetComparison>> {
        let Self { config, stations, table, truth, seed } = self;
        let began = Instant::now();
        let comparisons = monte_carlo::run(config, &table.set, stations, truth, draws, *seed)?;
        let elapsed_s = began.elapsed().as_secs_f64();
        monte_carlo::report(&comparisons, out, told)?;
        let total: usize = comparisons.iter().map(|c| c.points.len() * draws).sum();
        writeln!(told, "{total} draws in {elapsed_s:.2} s")?;
        monte_carlo::deviations(config, &table.set, stations, truth, *seed, out)?;
        Ok(comparisons)
    }
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
