//! `kurs batch`: the sessions of a manifest, several at a time, each solved once.
//!
//! Every session has its folder in the data set, `session=LABEL`, with the tables of `kurs solve`
//! and, written last, their summary.json. A session is done when that summary has the hash of the
//! keys in force, the program's version and the contents of all inputs, and was not interrupted: a
//! run that was killed goes on where it was, and a session whose input changed is solved anew.
//! Nothing else is kept, so any number of runs, on any machines, may share the work by `--shard` or
//! `--session`; `--merge` sums up what is there.

mod manifest;
mod session;
mod status;

use std::path::PathBuf;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

use crate::failure::{ExitCode, UsageError};
use crate::interrupt::Watch;
use crate::output;
use crate::progress::Tasks;
use crate::solve::Format;
use manifest::Manifest;
use session::SessionPlan;
pub(crate) use status::FAILURE;
use status::{Outcome, SessionStatus};

/// Many sessions, in parallel, that go on where a killed run was.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Sessions (CSV): `label` and `config`, `files`, `obs:ANTENNA`, `nav`, `set`; lists are
    /// divided by `;`
    manifest: PathBuf,
    /// Folder of the data set: session=LABEL/attitude.csv, …, and manifest-status.csv
    #[arg(long, value_name = "DIR", default_value = "kurs-out/batch")]
    out: PathBuf,
    /// Only the sessions I, I + N, I + 2N, … of the manifest, counted from 0; without
    /// manifest-status.csv, which --merge writes
    #[arg(long, value_name = "I/N", value_parser = shard, conflicts_with_all = ["session", "merge"])]
    shard: Option<Shard>,
    /// Only the session of this label; may be given several times
    #[arg(long, value_name = "LABEL", conflicts_with = "merge")]
    session: Vec<String>,
    /// Solves nothing: writes manifest-status.csv of what is there
    #[arg(long)]
    merge: bool,
    /// Sessions at a time (default: as many as there are processors)
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    jobs: Option<u16>,
    /// Output formats of every session
    #[arg(long, value_enum, default_value = "csv", value_delimiter = ',')]
    format: Vec<Format>,
    /// Sets a key of the table `solve`, or `table.key`, of every session
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Prints the counts as JSON in place of the closing line
    #[arg(long)]
    json: bool,
    /// No progress and no closing line
    #[arg(long, short)]
    quiet: bool,
}

/// Part of a manifest.
#[derive(Debug, Clone, Copy)]
struct Shard {
    index: usize,
    of: usize,
}

/// Reads `I/N`.
fn shard(text: &str) -> Result<Shard, String> {
    let parts = text.split_once('/').and_then(|(i, n)| Some((i.parse().ok()?, n.parse().ok()?)));
    match parts {
        Some((index, of)) if index < of => Ok(Shard { index, of }),
        _ => Err("expected I/N with I from 0 to N - 1".into()),
    }
}

/// Runs the command.
pub(crate) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    Format::check(&args.format)?;
    let manifest = Manifest::read(&args.manifest)?;
    if args.merge {
        return close(args, &manifest, &status::merge(&manifest, &args.out)?);
    }
    let plans: Vec<SessionPlan> = chosen(args, &manifest)?
        .into_iter()
        .map(|entry| SessionPlan::new(entry, &args.out, &args.set, &args.format))
        .collect();
    let watch = Watch::begin();
    let statuses = solve_all(args, &plans, &watch);
    if watch.was_interrupted() {
        return Ok(watch.status(ExitCode::SUCCESS));
    }
    let is_whole = args.shard.is_none() && args.session.is_empty();
    if is_whole {
        status::write(&args.out, &statuses)?;
    }
    close(args, &manifest, &statuses)
}

/// The entries that this run is to solve.
fn chosen<'a>(args: &Args, manifest: &'a Manifest) -> anyhow::Result<Vec<&'a manifest::Entry>> {
    if let Some(shard) = args.shard {
        return Ok(manifest.entries.iter().skip(shard.index).step_by(shard.of).collect());
    }
    if args.session.is_empty() {
        return Ok(manifest.entries.iter().collect());
    }
    let find = |label: &String| {
        let found = manifest.entries.iter().find(|entry| entry.label == *label);
        let place = args.manifest.display();
        found.ok_or_else(|| {
            UsageError(format!("--session {label}: {place} has no such label")).into()
        })
    };
    args.session.iter().map(find).collect()
}

/// Solves what is not done, several sessions at a time.
fn solve_all(args: &Args, plans: &[SessionPlan], watch: &Watch) -> Vec<SessionStatus> {
    let processors = std::thread::available_parallelism().map_or(1, usize::from);
    let jobs = args.jobs.map_or(processors, usize::from).min(plans.len().max(1));
    let next = AtomicUsize::new(0);
    let progress = Mutex::new(Tasks::start(args.quiet, "sessions", plans.len()));
    let work = || {
        let mut statuses = Vec::new();
        while !watch.asks_to_end() {
            let index = next.fetch_add(1, Ordering::Relaxed);
            let Some(plan) = plans.get(index) else { break };
            let status = plan.run();
            let has_failed = matches!(status.outcome, Outcome::Failed | Outcome::NothingFixed);
            progress.lock().unwrap_or_else(PoisonError::into_inner).done(has_failed);
            statuses.push((index, status));
        }
        statuses
    };
    let mut all: Vec<(usize, SessionStatus)> = std::thread::scope(|scope| {
        let threads: Vec<_> = (0..jobs).map(|_| scope.spawn(work)).collect();
        threads.into_iter().flat_map(|thread| thread.join().unwrap_or_default()).collect()
    });
    progress.into_inner().unwrap_or_else(PoisonError::into_inner).finish();
    all.sort_by_key(|(index, _)| *index);
    all.into_iter().map(|(_, status)| status).collect()
}

/// The closing line and the exit status.
fn close(args: &Args, manifest: &Manifest, statuses: &[SessionStatus]) -> anyhow::Result<ExitCode> {
    let counts = status::Counts::of(statuses, status::others(manifest, &args.out));
    if args.json {
        output::print_json(&counts.json())?;
    } else if !args.quiet {
        output::print(format_args!("{counts}\nwritten to {}\n", args.out.display()))?;
    }
    Ok(counts.exit_code())
}
