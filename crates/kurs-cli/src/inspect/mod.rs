//! `kurs inspect`: what is in a file, before anything is computed from it.

mod antennas;
mod arcs;
mod gathered;
mod messages;
mod navigation;
mod observations;
mod oddities;
mod sky;
mod text;
mod timeline;

use std::collections::BTreeMap;
use std::io::Write as _;
use std::path::{Path, PathBuf};

use anyhow::bail;
use kurs::ephemeris::NavigationData;
use kurs::time::{Calendar, GpsTime};
use kurs_formats::content::Content;
use kurs_formats::damage::{Damage, DamageLog};
use kurs_formats::logs::{self, Census, LogOptions, LogPart};
use kurs_formats::source::{ReadError, Source};
use serde::Serialize;

use crate::failure::{ExitCode, UsageError};
use crate::output::{self, OutputFile, OutputFolder};
use crate::page::Page;
use crate::pipe::{self, InputFile};
use crate::solve::input::middle_time;
use crate::window::Window;

/// What is in files: signals, intervals, gaps, cycle slips, signal strengths, sky, oddities,
/// damage.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Observation, navigation, orbit (SP3) and antenna (ANTEX) files; `-` for standard input.
    #[arg(required = true, value_name = "FILE")]
    files: Vec<PathBuf>,
    /// Navigation files for the sky, not reported themselves (those among the files serve too).
    #[arg(long, value_name = "FILE", num_args = 1..)]
    nav: Vec<PathBuf>,
    /// UTC date of RTCM 3 logs that tell no week and are not dated by `--nav` or their names.
    #[arg(long, value_name = "YYYY-MM-DD", value_parser = date)]
    date: Option<GpsTime>,
    #[command(flatten)]
    window: Window,
    /// Writes everything as JSON, with the data of the sky plot, to a file; without one to
    /// standard output in place of the tables.
    #[arg(long, value_name = "FILE", num_args = 0..=1, require_equals = true)]
    json: Option<Option<PathBuf>>,
    /// Writes report.html: the tables on one page.
    #[arg(long)]
    report: bool,
    /// Folder for report.html.
    #[arg(long, value_name = "DIR", default_value = "kurs-out/inspect")]
    out: PathBuf,
    /// No tables.
    #[arg(long, short)]
    quiet: bool,
}

/// What a run may leave in its folder.
const OUTPUTS: &[&str] = &["report.html"];

/// What was found in one file.
#[derive(Debug, Serialize)]
#[serde(tag = "content", rename_all = "snake_case")]
enum Report {
    Observations(Box<observations::ObservationReport>),
    Navigation(navigation::NavigationReport),
    Antennas(antennas::AntennaReport),
    Unusable { file: String, error: String },
}

impl Report {
    /// Names the file as the user did.
    fn with_given_name(mut self) -> Self {
        let file = match &mut self {
            Self::Observations(report) => &mut report.file,
            Self::Navigation(report) => &mut report.file,
            Self::Antennas(report) => &mut report.file,
            Self::Unusable { file, .. } => file,
        };
        *file = pipe::told(file);
        self
    }
}

/// What is not as it should be in a file.
#[derive(Debug, Default, Serialize)]
struct DamageReport {
    /// All of it, the unlisted included.
    count: u64,
    /// What `at` counts: lines, or bytes of a log.
    unit: &'static str,
    listed: Vec<DamageLine>,
}

/// One thing that could not be used.
#[derive(Debug, Serialize)]
struct DamageLine {
    at: u64,
    what: String,
}

impl DamageReport {
    fn new(listed: &[Damage], count: u64) -> Self {
        let line = |d: &Damage| DamageLine { at: d.line, what: d.what.to_string() };
        Self { count, unit: "line", listed: listed.iter().map(line).collect() }
    }
}

/// What is known when a file is read.
struct Known {
    /// Navigation data of all files.
    navigation: NavigationData,
    options: LogOptions,
    /// Which epochs count.
    window: Window,
    /// What could not be used, or disagrees, among the ephemerides in logs.
    log_damage: BTreeMap<PathBuf, DamageLog>,
}

/// Noon of a day.
fn date(text: &str) -> Result<GpsTime, String> {
    let expected = || format!("found {text:?}, expected a date since 1980 as YYYY-MM-DD");
    let parts: Vec<i32> = text.split('-').filter_map(|part| part.parse().ok()).collect();
    let [year, month, day] = parts[..] else { return Err(expected()) };
    let small = |number: i32| u8::try_from(number).unwrap_or(0);
    let (month, day) = (small(month), small(day));
    let noon = Calendar { year, month, day, hour: 12, minute: 0, second: 0.0 };
    GpsTime::from_calendar(noon).ok_or_else(expected)
}

/// Runs the command.
pub(crate) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    refuse_to_overwrite(args)?;
    args.window.check()?;
    let files = InputFile::open_all(&args.files)?;
    let files: Vec<&Path> = files.iter().map(InputFile::path).collect();
    let known = read_navigation(args, &files)?;
    let (mut reports, mut unusable) = (Vec::new(), Vec::new());
    for file in files {
        let found = inspect(file, &known).unwrap_or_else(|error| {
            let (file, error) = (file.display().to_string(), pipe::told(&error.to_string()));
            unusable.push(error.clone());
            vec![Report::Unusable { file, error }]
        });
        reports.extend(found.into_iter().map(Report::with_given_name));
    }

    if args.report {
        let named: Vec<PathBuf> = args.files.iter().chain(&args.nav).cloned().collect();
        let folder = OutputFolder::begin(&args.out, OUTPUTS, &named)?;
        let mut page = Page::new("Kurs: what is in the files");
        page.columns(&text::of(&reports));
        page.paragraph(&format!("Made by kurs {}.", env!("CARGO_PKG_VERSION")));
        page.write(folder.path(), "report.html")?;
        folder.publish()?;
    }
    match &args.json {
        Some(None) => output::print_json(&reports)?,
        Some(Some(path)) => {
            write_json(path, &reports)?;
            args.tell(&reports)?;
        }
        None => args.tell(&reports)?,
    }
    if unusable.is_empty() { Ok(ExitCode::SUCCESS) } else { bail!("{}", unusable.join("\n")) }
}

impl Args {
    fn tell(&self, reports: &[Report]) -> anyhow::Result<()> {
        if self.quiet { Ok(()) } else { output::print(text::of(reports)) }
    }
}

/// An input must not become the output by a slip of the hand.
fn refuse_to_overwrite(args: &Args) -> Result<(), UsageError> {
    let Some(Some(target)) = &args.json else { return Ok(()) };
    let same = |file: &PathBuf| match (file.canonicalize(), target.canonicalize()) {
        (Ok(file), Ok(target)) => file == target,
        _ => false,
    };
    match args.files.iter().chain(&args.nav).find(|file| same(file)) {
        Some(file) => {
            Err(UsageError(format!("--json={}: this is one of the inputs", file.display())))
        }
        None => Ok(()),
    }
}

fn write_json(path: &Path, reports: &[Report]) -> anyhow::Result<()> {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
    let name = path.file_name().map(|name| name.to_string_lossy().into_owned());
    let name = name.ok_or_else(|| UsageError(format!("--json={}: no file", path.display())))?;
    let mut file = OutputFile::create(folder.unwrap_or(Path::new(".")), &name)?;
    serde_json::to_writer_pretty(&mut file, reports)?;
    file.write_all(b"\n")?;
    file.finish()
}

/// Everything that tells where satellites were: the files of `--nav`, which must be usable, and
/// those among the others. Logs without a week are dated by those that are not logs.
fn read_navigation(args: &Args, files: &[&Path]) -> Result<Known, ReadError> {
    let mut data = NavigationData::default();
    for file in &args.nav {
        kurs_formats::navigation::read_near(&mut Source::open(file)?, args.date, &mut data)?;
    }
    let mut logs = Vec::new();
    for file in files {
        // A file that cannot be read is named in its report.
        match Content::of_file(file) {
            Ok(content) if content.is_log() => logs.push(*file),
            Ok(Content::RinexNavigation | Content::Sp3) => {
                let Ok(mut source) = Source::open(file) else { continue };
                let _ = kurs_formats::navigation::read(&mut source, &mut data);
            }
            _ => {}
        }
    }
    let navigation_time = middle_time(&data);
    let mut log_damage = BTreeMap::new();
    for file in logs {
        let Ok(mut source) = Source::open(file) else { continue };
        let near = args.date.or(navigation_time);
        let read = kurs_formats::navigation::read_near(&mut source, near, &mut data);
        log_damage.extend(read.ok().map(|summary| (file.to_owned(), summary.damage)));
    }
    let options = LogOptions {
        approximate_time: args.date,
        navigation_time,
        any_week: true,
        ..LogOptions::default()
    };
    Ok(Known { navigation: data, options, window: args.window, log_damage })
}

/// The report on a file; on a log of several stations or antennas one for each of them.
fn inspect(file: &Path, known: &Known) -> Result<Vec<Report>, ReadError> {
    let mut source = Source::open(file)?;
    let content = Content::of_file(file)?;
    let observations = |part: Option<LogPart>, messages: Option<&Census>| {
        let report = observations::inspect(file, &content, part, messages, known)?;
        Ok(Report::Observations(Box::new(report)))
    };
    let report = match content {
        Content::RinexNavigation => {
            let content = "RINEX navigation";
            navigation::inspect(&mut source, content).map(Report::Navigation)
        }
        Content::Sp3 => navigation::inspect(&mut source, "SP3 orbits").map(Report::Navigation),
        Content::Antex => antennas::inspect(&mut source).map(Report::Antennas),
        Content::Ubx | Content::Rtcm3 | Content::Sbf => {
            let census = logs::census(&mut source)?;
            if census.parts.len() > 1 {
                let parts = census.parts.iter().enumerate();
                // The messages are listed once.
                let messages = |index| (index == 0).then_some(&census);
                return parts.map(|(i, part)| observations(Some(*part), messages(i))).collect();
            }
            observations(None, Some(&census))
        }
        Content::RinexObservation | Content::CompactRinex => observations(None, None),
        other => Err(source.wrong_content(
            other.to_string(),
            "observations, navigation data, orbits (SP3) or antennas (ANTEX)",
        )),
    };
    Ok(vec![report?])
}
