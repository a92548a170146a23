//! `kurs track`: a trajectory from the measurements of ground stations, or, with `--simulate`,
//! measurements of a known one and what accuracy to expect of them.

mod config;
mod input;
mod monte_carlo;
mod path;
mod report;
mod simulate;
mod write;

use std::path::{Path, PathBuf};
use std::time::Instant;

use kurs::frames::{Ecef, Vector};
use kurs::trajectory::station::Station;

use self::config::{Config, SimulateConfig};
use self::monte_carlo::SetComparison;
use self::path::{PathFound, Status};
use self::simulate::TruePoint;
use crate::failure::{ExitCode, UsageError};

/// Trajectory of a moving object from angles, ranges, range differences and direction cosines that
/// ground stations measure.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Configuration file (TOML).
    config: PathBuf,
    /// Folder for the results.
    #[arg(long, default_value = "kurs-out")]
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
}

pub(crate) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let config = Config::read(&args.config)?;
    let stations = config.stations()?;
    let simulate = match (&config.simulate, args.simulate) {
        (Some(simulate), true) => Some(simulate),
        (None, true) => {
            return Err(UsageError("--simulate needs a table [simulate]".to_owned()).into());
        }
        (_, false) => None,
    };
    let folder = args.config.parent().unwrap_or(Path::new(""));

    let truth = simulate.map(|simulate| simulate::truth(&config, simulate)).transpose()?;
    let observations = match (simulate, &truth) {
        (Some(simulate), Some(truth)) => {
            let seed = args.seed.unwrap_or(simulate.seed);
            let made = simulate::observations(&config, simulate, &stations, truth, seed)?;
            write::simulated(&config, &made, truth, &args.out)?;
            made
        }
        _ => input::read(&config, folder)?,
    };
    let found = path::find(&config, &stations, &observations)?;
    write::trajectory(&found.points, &args.out)?;
    write::residuals(&config, &found, &args.out)?;
    write::parameters(&config, &found, &args.out)?;
    write::maps(&found.points, &args.out)?;
    print_counts(&found, observations.len());

    let mut comparisons = Vec::new();
    if let (Some(simulate), Some(truth)) = (simulate, &truth) {
        print_errors(&found, truth);
        if let Some(draws) = args.monte_carlo {
            comparisons = compare_sets(args, &config, simulate, &stations, truth, draws.max(1))?;
        }
    }
    if args.report {
        report::write(&config, &stations, &found, &comparisons, &args.out)?;
    }
    let all_lost = found.points.iter().all(|point| point.status == Status::Lost);
    Ok(ExitCode::from(u8::from(all_lost)))
}

fn compare_sets(
    args: &Args,
    config: &Config,
    simulate: &SimulateConfig,
    stations: &[Station],
    truth: &[TruePoint],
    draws: usize,
) -> anyhow::Result<Vec<SetComparison>> {
    let seed = args.seed.unwrap_or(simulate.seed);
    let began = Instant::now();
    let comparisons = monte_carlo::run(config, &simulate.set, stations, truth, draws, seed)?;
    let elapsed_s = began.elapsed().as_secs_f64();
    monte_carlo::report(&comparisons, &args.out)?;
    let total: usize = comparisons.iter().map(|c| c.points.len() * draws).sum();
    println!("{total} draws in {elapsed_s:.2} s");
    monte_carlo::deviations(config, &simulate.set, stations, truth, seed, &args.out)?;
    Ok(comparisons)
}

fn print_counts(found: &PathFound, measurements: usize) {
    let count = |status| found.points.iter().filter(|point| point.status == status).count();
    let excluded = found.residuals.iter().filter(|residual| residual.excluded).count();
    println!(
        "{measurements} measurements, {excluded} left out; {} points: {} ok, {} ambiguous, {} \
         inconsistent, {} lost",
        found.points.len(),
        count(Status::Ok),
        count(Status::Ambiguous),
        count(Status::Inconsistent),
        count(Status::Lost)
    );
}

/// Errors of the simulated path: root mean square, and normalised by the covariance (3 expected).
fn print_errors(found: &PathFound, truth: &[TruePoint]) {
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
        println!(
            "against the truth: RMS {:.2} m, normalised error squared {:.2} (3 expected)",
            (squares / count).sqrt(),
            normalised / count
        );
    }
}
