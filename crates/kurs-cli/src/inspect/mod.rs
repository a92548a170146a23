//! `kurs inspect`: what is in a file, before anything is computed from it.

mod antennas;
mod arcs;
mod navigation;
mod observations;
mod oddities;
mod sky;
mod text;
mod timeline;

use std::io::Write as _;
use std::path::{Path, PathBuf};

use kurs::ephemeris::NavigationData;
use kurs_formats::content::Content;
use kurs_formats::damage::Damage;
use kurs_formats::logs::{self, LogPart};
use kurs_formats::source::{ReadError, Source};
use serde::Serialize;

use crate::failure::{ExitCode, UsageError};
use crate::output::{OutputFile, OutputFolder};
use crate::page::Page;
use crate::pipe::InputFile;

/// What is in files: signals, intervals, gaps, cycle slips, signal strengths, sky, oddities, damage.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Observation, navigation, orbit (SP3) and antenna (ANTEX) files; `-` for standard input.
    #[arg(required = true, value_name = "FILE")]
    files: Vec<PathBuf>,
    /// Navigation files for the sky, not reported themselves (those among the files serve too).
    #[arg(long, value_name = "FILE", num_args = 1..)]
    nav: Vec<PathBuf>,
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

/// Runs the command.
pub(crate) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    refuse_to_overwrite(args)?;
    let files = InputFile::open_all(&args.files)?;
    let files: Vec<&Path> = files.iter().map(InputFile::path).collect();
    let navigation = read_navigation(&args.nav, &files)?;
    let mut reports = Vec::new();
    for file in files {
        let found = inspect(file, &navigation).unwrap_or_else(|error| {
            eprintln!("error: {error}");
            let (file, error) = (file.display().to_string(), error.to_string());
            vec![Report::Unusable { file, error }]
        });
        reports.extend(found);
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
        Some(None) => println!("{}", serde_json::to_string_pretty(&reports)?),
        Some(Some(path)) => {
            write_json(path, &reports)?;
            args.tell(&reports);
        }
        None => args.tell(&reports),
    }
    let unusable = reports.iter().any(|report| matches!(report, Report::Unusable { .. }));
    Ok(ExitCode::from(u8::from(unusable)))
}

impl Args {
    fn tell(&self, reports: &[Report]) {
        if !self.quiet {
            print!("{}", text::of(reports));
        }
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
/// those among the others.
fn read_navigation(nav: &[PathBuf], files: &[&Path]) -> Result<NavigationData, ReadError> {
    let mut data = NavigationData::default();
    for file in nav {
        kurs_formats::navigation::read(&mut Source::open(file)?, &mut data)?;
    }
    for file in files {
        // A file that cannot be read is told of where it is reported.
        let Ok(mut source) = Source::open(file) else { continue };
        let content = source.start(Content::ENOUGH).map(Content::of);
        let has_orbits = |content: &Content| {
            content.is_log() || matches!(content, Content::RinexNavigation | Content::Sp3)
        };
        if content.as_ref().is_ok_and(has_orbits) {
            let _ = kurs_formats::navigation::read(&mut source, &mut data);
        }
    }
    Ok(data)
}

/// The report on a file; on a log of several stations or antennas one for each of them.
fn inspect(file: &Path, navigation: &NavigationData) -> Result<Vec<Report>, ReadError> {
    let mut source = Source::open(file)?;
    let content = Content::of(source.start(Content::ENOUGH)?);
    let observations = |part: Option<LogPart>| {
        let report = observations::inspect(file, &content, part, navigation)?;
        Ok(Report::Observations(Box::new(report)))
    };
    let report = match content {
        Content::RinexNavigation => {
            let content = "RINEX navigation";
            navigation::inspect(&mut source, content).map(Report::Navigation)
        }
        Content::Sp3 => navigation::inspect(&mut source, "SP3 orbits").map(Report::Navigation),
        Content::Antex => antennas::inspect(&mut source).map(Report::Antennas),
        Content::Rtcm3 | Content::Sbf => {
            let parts = logs::parts(&mut source)?;
            if parts.len() > 1 {
                return parts.into_iter().map(|part| observations(Some(part))).collect();
            }
            observations(None)
        }
        Content::RinexObservation | Content::CompactRinex | Content::Ubx => observations(None),
        other => Err(source.wrong_content(
            other.to_string(),
            "observations, navigation data, orbits (SP3) or antennas (ANTEX)",
        )),
    };
    Ok(vec![report?])
}
