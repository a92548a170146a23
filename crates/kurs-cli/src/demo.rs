//! `kurs demo`: a car with four antennas is simulated, solved and laid against the truth.

use std::path::PathBuf;
use std::process::ExitCode;

use crate::{simulate, solve};

/// Simulates a car with four antennas, solves it, compares with the truth and writes the report.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Folder for the files.
    #[arg(long, value_name = "DIR", default_value = "kurs-demo")]
    out: PathBuf,
    /// No progress.
    #[arg(long, short)]
    quiet: bool,
}

/// Runs the command: what a user would do by hand.
pub(crate) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    simulate::run(&simulate::Args::new("car".into(), args.out.clone()))?;
    let configuration = args.out.join("kurs.toml");
    solve::run(&solve::Args::of_demo(configuration, args.out.join("truth.csv"), args.out.clone(), args.quiet))
}
