//! `kurs doctor`: why there is no fix, in words, and what to change.
//!
//! A sample of the session is solved again and again: as configured, without known geometry,
//! without one system, without one antenna. What the trials have in common is not a cause; what one
//! of them mends is.

mod attendance;
mod causes;
mod diagnosis;
mod geometry;
mod interference;
mod noise;
mod patient;
mod presence;
mod reasons;
pub(crate) mod sample;
mod shape;
mod trials;
mod usage;

use std::fmt::Write as _;
use std::path::PathBuf;

use kurs_formats::source::can_be_read_again;
use serde::Serialize;

use crate::failure::ExitCode;
use crate::integers::{CheckRow, IdleRow, Integers, LeftOutRow};
use crate::output::{self, OutputFolder};
use crate::page::Page;
use crate::report::views::{HiddenRow, Views};
use crate::solve::config::Loaded;
use crate::solve::session_args::SessionArgs;
use crate::solve::{Input, antenna_names, input};
use crate::summary::Damage;
use noise::NoiseRow;
pub(crate) use patient::MANY;
use patient::{Finding, Patient};
use sample::Sample;
use trials::Trials;
use usage::{UsageRow, usage};

/// A session with this share fixed needs no doctor.
pub(crate) const WELL: f64 = 0.98;
/// Epochs that are solved in every way: each of a dozen ways takes up to 20 ms for an epoch whose
/// integers do not fit, and nobody waits for more than ten seconds.
const MAX_EPOCHS: usize = 80;

/// Satellites behind something that are named in the text.
const MAX_HIDDEN: usize = 5;

/// Says in words why there is no fix, and what to change.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    #[command(flatten)]
    session: SessionArgs,
    /// Folder for doctor.json.
    #[arg(long, value_name = "DIR", default_value = "kurs-out/doctor")]
    out: PathBuf,
    /// Lists every satellite, band and antenna, not only the sums.
    #[arg(long)]
    signals: bool,
    /// Writes report.html: the findings on one page.
    #[arg(long)]
    report: bool,
    /// Prints doctor.json in place of the text.
    #[arg(long)]
    json: bool,
    /// No text.
    #[arg(long, short)]
    quiet: bool,
}

/// What a run may leave in its folder.
const OUTPUTS: &[&str] = &["doctor.json", "report.html"];

/// What was found in a session.
struct Examination {
    sample: Sample,
    /// Absent where the files themselves explain everything.
    trials: Option<Trials>,
    /// As configured.
    integers: Integers,
    views: Views,
    noise: Vec<NoiseRow>,
    signals: Vec<UsageRow>,
    findings: Vec<Finding>,
}

/// `doctor.json`.
#[derive(Serialize)]
struct File<'a> {
    version: &'static str,
    epochs: u64,
    sampled: usize,
    fixed_of_session: Option<f64>,
    findings: &'a [Finding],
    trials: Vec<trials::TrialRow>,
    checks: Vec<CheckRow>,
    left_out: Vec<LeftOutRow<'a>>,
    idle_antennas: Vec<IdleRow<'a>>,
    hidden: Vec<HiddenRow>,
    noise: &'a [NoiseRow],
    signals: &'a [UsageRow],
}

/// Runs the command.
pub(crate) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let session = args.session.load()?;
    let examination = examine(&session.loaded)?;
    let names = antenna_names(&session.loaded);
    let told = examination.text(&names, args.signals);
    let Examination { sample, trials, integers, views, noise, signals, findings } = &examination;
    let file = File {
        version: env!("CARGO_PKG_VERSION"),
        epochs: sample.of(),
        sampled: sample.judged().count(),
        fixed_of_session: examination.fixed_of_session(),
        findings,
        trials: trials.as_ref().map_or_else(Vec::new, Trials::rows),
        checks: integers.failed(),
        left_out: integers.left_out(),
        idle_antennas: integers.idle(&names),
        hidden: views.hidden(&names),
        noise,
        signals,
    };
    let folder = OutputFolder::begin(&args.out, OUTPUTS, &session.inputs())?;
    output::write_json(folder.path(), "doctor.json", &file)?;
    if args.report {
        let mut page = Page::new("Kurs: why there is no fix");
        for Finding { cause, evidence, advice, .. } in findings {
            page.heading(cause);
            page.paragraph(evidence);
            page.paragraph(advice);
        }
        page.heading("What was tried");
        page.columns(&told);
        page.paragraph(&format!("Made by kurs {}.", env!("CARGO_PKG_VERSION")));
        page.write(folder.path(), "report.html")?;
    }
    folder.publish()?;
    match (args.json, args.quiet) {
        (true, _) => output::print_json(&file)?,
        (false, false) => output::print(told)?,
        (false, true) => {}
    }
    Ok(ExitCode::SUCCESS)
}

/// Solves a sample of the session in several ways, and finds causes.
fn examine(loaded: &Loaded) -> anyhow::Result<Examination> {
    let mut loaded = loaded.clone();
    // The sample leaves epochs out, and causes are looked for with everything that is known.
    loaded.config.nav.as_received = false;
    let settings = loaded.settings()?;
    let names = antenna_names(&loaded);
    let Input { navigation, mut streams, phase_centers, mut damage } = Input::open(&loaded)?;
    let mounts = phase_centers.mounts;
    let sample = Sample::take(&mut streams, MAX_EPOCHS)?;
    damage.extend(streams.damage().into_iter().map(|d| Damage::new(d.file, &d.damage)));
    damage.extend(input::misdated(&loaded, sample.attendance.antennas()));
    if let Some(copy) = presence::one_recording(&names, &sample) {
        let findings = std::iter::once(copy).chain(presence::broken_files(&damage)).collect();
        return Ok(Examination {
            sample,
            trials: None,
            integers: Integers::default(),
            views: Views::default(),
            noise: Vec::new(),
            signals: Vec::new(),
            findings,
        });
    }
    let trials = Trials::run(&settings, &navigation, &mounts, &sample, &names);
    let integers = Integers::of(&trials.configured.rows, &names);
    let signals = usage(&sample, &trials.configured, &navigation, &settings, &names);
    let rows = &trials.configured.rows;
    let noise = noise::noise(rows, &settings.noise, &names);
    let mut views = Views::default();
    rows.iter().for_each(|row| views.add(row.residuals()));
    let patient = Patient {
        names: &names,
        settings: &settings,
        array: settings.array.as_ref(),
        navigation: &navigation,
        mounts: &mounts,
        views: &views,
    };
    let findings = diagnosis::findings(&patient, &sample, &trials, &signals, &integers, &damage);
    let trials = Some(trials);
    Ok(Examination { sample, trials, integers, views, noise, signals, findings })
}

/// The first finding in one line, for the end of another command; where the files cannot be read
/// again, what the most frequent reason means.
pub(crate) fn in_one_line(loaded: &Loaded, main_reason: Option<&'static str>) -> String {
    let can_be_examined = loaded.input_files().iter().all(can_be_read_again);
    let examination = can_be_examined.then(|| examine(loaded).ok()).flatten();
    match examination.as_ref().and_then(|found| found.findings.first()) {
        Some(Finding { cause, evidence, .. }) => {
            format!("{cause} ({evidence}); `kurs doctor` says more")
        }
        None => main_reason.map_or("the reason is not known", reasons::meaning).to_owned(),
    }
}

impl Examination {
    /// Share of the session's epochs that are fixed, gaps included.
    fn fixed_of_session(&self) -> Option<f64> {
        let trials = self.trials.as_ref()?;
        Some(diagnosis::fixed_of_session(&self.sample, trials))
    }

    /// For the terminal.
    fn text(&self, names: &[String], every_signal: bool) -> String {
        let mut text = String::new();
        if let Some(trials) = &self.trials {
            let _ = writeln!(text, "{} were solved in each of these ways:", self.sample.size());
            text += &trials.text();
            for sentence in self.integers.sentences(names) {
                let _ = writeln!(text, "as configured: {sentence}");
            }
            for row in self.views.hidden(names).iter().take(MAX_HIDDEN) {
                let _ = writeln!(text, "{}", row.sentence());
            }
            text += &noise::text(&self.noise);
            text += &usage::text(&self.signals, names, every_signal);
        }
        for (number, Finding { cause, evidence, advice, .. }) in self.findings.iter().enumerate() {
            let _ = writeln!(text, "\n{}. {cause}\n   {evidence}\n   -> {advice}", number + 1);
        }
        if let (true, Some(share)) = (self.findings.is_empty(), self.fixed_of_session()) {
            let _ = writeln!(
                text,
                "\nnothing is wrong: {:.1} % of the session is fixed",
                100.0 * share
            );
        }
        text
    }
}
