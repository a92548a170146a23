//! `kurs demo`: a car with four antennas is simulated, solved and laid against the truth.

use std::path::PathBuf;

use crate::failure::ExitCode;
use crate::{simulate, solve};

/// Simulates a car with four antennas, solves it, compares with the truth and writes the report.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Folder for the files.
    #[arg(long, value_name = "DIR", default_value = "kurs-out/demo")]
    out: PathBuf,
    /// Prints summary.json in place of the closing summary.
    #[arg(long)]
    json: bool,
    /// No progress and no closing summary.
    #[arg(long, short)]
    quiet: bool,
}

/// Runs the command: what a user would do by hand.
pub(crate) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let Args { out, json, quiet } = args;
    // What to run next is said by the other command.
    simulate::run(&simulate::Args::built_in("car", out.clone(), true))?;
    let (configuration, truth) = (out.join("kurs.toml"), out.join("truth.csv"));
    let code =
        solve::run(&solve::Args::of_simulation(configuration, truth, out.clone(), *json, *quiet))?;
    if !quiet && !json {
        println!("\nopen {}", out.join("report.html").display());
    }
    Ok(code)
}
