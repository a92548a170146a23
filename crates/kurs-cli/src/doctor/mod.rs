//! `kurs doctor`: why there is no fix, in words, and what to change.
//!
//! A sample of the session is solved again and again: as configured, without known geometry, without
//! one system, without one antenna. What the trials have in common is no cause; what one of them
//! mends is.

mod causes;
mod geometry;
mod sample;
mod trials;
mod usage;

use std::path::PathBuf;
use std::process::ExitCode;

use kurs::array::AntennaArray;
use serde::Serialize;

use crate::output;
use crate::solve::config::{self, Overrides};
use crate::solve::{Input, antenna_names};
use causes::Finding;
use sample::Sample;
use trials::Trials;
use usage::{UsageRow, usage};

/// Says in words why there is no fix, and what to change.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Configuration file (TOML) as for `kurs solve`.
    config: PathBuf,
    /// Sets a key of the table `solve`, or `table.key`.
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Folder for doctor.json.
    #[arg(long, value_name = "DIR", default_value = "kurs-out")]
    out: PathBuf,
    /// Lists every satellite, band and antenna, not only the sums.
    #[arg(long)]
    signals: bool,
}

/// `doctor.json`.
#[derive(Serialize)]
struct File<'a> {
    version: &'static str,
    epochs: usize,
    sampled: usize,
    findings: &'a [Finding],
    trials: Vec<trials::TrialRow>,
    signals: &'a [UsageRow],
}

/// Runs the command.
pub(crate) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let overrides = Overrides { set: &args.set, ..Overrides::default() };
    let mut loaded = config::load(Some(&args.config), &overrides)?;
    // The sample leaves epochs out, and causes are looked for with everything that is known.
    loaded.config.nav.as_received = false;
    let settings = loaded.settings()?;
    let names = antenna_names(&loaded);
    let Input { navigation, mut streams, phase_centers, damage } = Input::open(&loaded)?;
    let mounts = phase_centers.mounts;
    let sample = Sample::take(&mut streams)?;

    let trials = Trials::run(&settings, &navigation, &mounts, &sample, &names);
    let signals = usage(&sample, &trials.configured, &navigation, &settings, &names);
    let array: Option<&AntennaArray> = settings.array.as_ref();
    let patient = causes::Patient {
        names: &names,
        settings: &settings,
        array,
        navigation: &navigation,
        mounts: &mounts,
    };
    let findings = causes::findings(&patient, &sample, &trials, &signals, &damage);

    println!("{} of {} epochs were solved in each of these ways:", sample.epochs.len(), sample.of);
    print!("{}", trials.text());
    print!("{}", usage::text(&signals, &names, args.signals));
    for (number, finding) in findings.iter().enumerate() {
        println!(
            "\n{}. {}\n   {}\n   -> {}",
            number + 1,
            finding.cause,
            finding.evidence,
            finding.advice
        );
    }
    if findings.is_empty() {
        println!("\nnothing is wrong: {}", trials.configured.share_text());
    }
    let file = File {
        version: env!("CARGO_PKG_VERSION"),
        epochs: sample.of,
        sampled: sample.epochs.len(),
        findings: &findings,
        trials: trials.rows(),
        signals: &signals,
    };
    output::write_json(&args.out, "doctor.json", &file)?;
    Ok(ExitCode::SUCCESS)
}
