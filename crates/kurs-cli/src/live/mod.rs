//! `kurs live`: streams of receivers in, attitude out, until it is told to stop.

mod companions;
mod day_tables;
mod explain;
mod messages;
mod sensor_lines;
mod setup;

use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

use anyhow::bail;
use kurs_live::ServiceError;

use crate::failure::{ExitCode, RequiredFix, UsageError};
use crate::interrupt::Watch;
use crate::output;
use crate::solve::antenna_names;
use crate::solve::config::{self, Loaded, Overrides};
use crate::summary::Summary;
use day_tables::DayTables;
pub(crate) use setup::navigation_files;

/// Attitude from live streams: serial, TCP, UDP, NTRIP, recorded logs.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Configuration file (TOML).
    config: PathBuf,
    /// Folder for the rows, by day.
    #[arg(long, value_name = "DIR", default_value = "kurs-out/live")]
    out: PathBuf,
    /// Ends when every stream has ended, with summary.json.
    #[arg(long)]
    once: bool,
    /// Prints what to set at the reader of a profile, for this array, and ends.
    #[arg(long, value_name = "PROFILE")]
    explain: Option<String>,
    /// Sets a key of the table `solve`, or `table.key`.
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    #[command(flatten)]
    required_fix: RequiredFix,
    /// Warnings and errors only.
    #[arg(long, short)]
    quiet: bool,
}

impl Args {
    /// Runs a configuration until its streams have ended.
    pub(crate) fn of_demonstration(config: PathBuf, out: PathBuf, quiet: bool) -> Self {
        let (explain, set, required_fix) = (None, Vec::new(), RequiredFix::default());
        Self { config, out, once: true, explain, set, required_fix, quiet }
    }
}

/// Runs the command.
pub(crate) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let loaded = args.load()?;
    if let Some(word) = &args.explain {
        output::print(explain::explain(word, &loaded)?)?;
        return Ok(ExitCode::SUCCESS);
    }
    let level = if args.quiet { tracing::Level::WARN } else { tracing::Level::INFO };
    // A second service in one process keeps the subscriber of the first.
    let _ = tracing_subscriber::fmt()
        .with_max_level(level)
        .with_writer(std::io::stderr)
        .with_ansi(false)
        .try_init();
    let began = Instant::now();
    let summary = Arc::new(Mutex::new(Summary::new(antenna_names(&loaded))));
    let tables = DayTables::new(&args.out, &loaded);
    let setup = setup::setup(&loaded, tables, Arc::clone(&summary), args.once)?;
    let reload = || {
        let read = args.load().map_err(|error| error.to_string())?;
        setup::reloaded(&loaded, &read).map_err(|error| error.to_string())
    };
    // The service ends by itself at the first signal.
    let _watch = Watch::begin();
    match kurs_live::run(setup, reload) {
        Err(ServiceError::Engine(what)) => return Err(UsageError(what).into()),
        outcome => outcome?,
    }
    let summary = summary.lock().unwrap_or_else(PoisonError::into_inner);
    if !args.once {
        return Ok(ExitCode::SUCCESS);
    }
    let file = summary.file(loaded.text(), &[], began.elapsed().as_secs_f64());
    output::write_json(&args.out, "summary.json", &file)?;
    if summary.epochs() == 0 {
        bail!("no epoch came from any stream");
    }
    if !summary.has_solution() {
        bail!("every epoch is lost, mostly because of `{}`", summary.main_reason().unwrap_or(""));
    }
    if !args.quiet {
        let (text, out) = (summary.text(), args.out.display());
        output::print(format_args!("{text}\nwritten to {out}\n"))?;
    }
    Ok(args.required_fix.exit_code(&summary))
}

impl Args {
    fn load(&self) -> Result<Loaded, UsageError> {
        let overrides = Overrides { set: &self.set, is_live: true, ..Overrides::default() };
        config::load(Some(&self.config), &overrides)
    }
}
