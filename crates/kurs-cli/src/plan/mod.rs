//! `kurs plan`: how accurate an array will be, where it is weak, and which baselines to process.

mod config;
mod improvement;
mod report;
mod session;
mod sky;

use std::collections::BTreeSet;
use std::path::PathBuf;
use std::time::Instant;

use anyhow::{anyhow, bail};
use kurs::array::AntennaArray;
use kurs::engine::{Constraint, Settings};
use kurs::frames::Attitude;
use kurs::prediction::{
    AttitudeAccuracy, Sight, SimulatedRate, attitude_accuracy, baseline_success_rate,
    simulated_success_rate,
};
use kurs::selection::{
    Baselines, Criterion, Graph, Pair, SelectionError, error_relative_to_all_antennas, select,
};
use kurs::signal::{Band, System};
use kurs::time::GpsTime;
use rand::SeedableRng;
use rand_xoshiro::Xoshiro256PlusPlus;

use self::config::ArrayFile;
use self::improvement::Improvement;
use self::session::Session;
use self::sky::Sky;
use crate::failure::{ExitCode, UsageError};
use crate::output::{self, OutputFolder};
use crate::pipe::InputFile;
use crate::window::{parse_seconds, parse_time};

/// Simulated epochs for a success rate: a share of a half is known to 6 % by them (95 %).
const DRAWS: u32 = 300;
/// Epochs over the time span that stand for all of it where every candidate costs a calculation.
const SAMPLED_EPOCHS: usize = 24;
/// More epochs than this are refused: a mistyped step.
const MAX_EPOCHS: f64 = 100_000.0;

/// Predicted accuracy of an antenna array, its weak axis, and the baselines worth processing.
#[derive(Debug, Clone, clap::Args)]
pub(crate) struct Args {
    /// Antennas (`[[antenna]]` with `name` and `position_m`) and what is planned for (`[plan]`), or
    /// the configuration of `kurs solve`
    array: PathBuf,
    /// Navigation file, in place of those of the file; several may be given; a nominal sky without
    /// any
    #[arg(long)]
    nav: Vec<PathBuf>,
    /// GPS time to begin with, such as 2024-06-24T08:20:00 (default: the first observation, or the
    /// first ephemeris)
    #[arg(long, visible_alias = "from", value_name = "TIME", value_parser = parse_time)]
    at: Option<GpsTime>,
    /// Time span, such as 24h, 90m or 600s
    #[arg(long = "for", default_value = "24h", conflicts_with = "to")]
    duration: String,
    /// GPS time to end with, in place of --for
    #[arg(long, value_name = "TIME", value_parser = parse_time)]
    to: Option<GpsTime>,
    /// Time from epoch to epoch of the plan, s, in place of `step_s`
    #[arg(long, value_name = "SECONDS", value_parser = parse_seconds)]
    every: Option<f64>,
    /// Folder for plan.json and plan.html
    #[arg(long, value_name = "DIR", default_value = "kurs-out/plan")]
    out: PathBuf,
    /// Sets a key of the table `plan`, or `table.key`
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Writes the page; this command always does
    #[arg(long)]
    report: bool,
    /// Prints plan.json in place of the tables
    #[arg(long)]
    json: bool,
    /// No tables
    #[arg(long, short)]
    quiet: bool,
}

/// What a run may leave in its folder.
const OUTPUTS: &[&str] = &["plan.json", "plan.html"];

/// One instant of the plan.
#[derive(Debug)]
struct Epoch {
    time: GpsTime,
    hours: f64,
    satellites: usize,
    sights: Vec<Sight>,
    /// Absent where the satellites do not suffice.
    accuracy: Option<AttitudeAccuracy>,
    /// Success rate of one baseline from one epoch, without any constraint.
    success_rate: Option<f64>,
}

/// The answer of one criterion.
#[derive(Debug)]
struct Choice {
    criterion: Criterion,
    answer: Result<Answer, SelectionError>,
}

#[derive(Debug)]
struct Answer {
    pairs: Vec<Pair>,
    value: f64,
    gap: f64,
    milliseconds: f64,
    /// Attitude error with only these baselines, each as if alone, relative to all antennas.
    relative_error: f64,
}

/// Everything that the report shows.
#[derive(Debug)]
struct Plan {
    file: ArrayFile,
    array: AntennaArray,
    sky: String,
    /// What a user should know before the numbers.
    notes: Vec<String>,
    epochs: Vec<Epoch>,
    /// For each antenna but the first: success rate of its baseline with known length.
    length_constrained: Vec<Option<SimulatedRate>>,
    /// Success rate of the whole array with its geometry known.
    array_constrained: Option<SimulatedRate>,
    improvement: Option<Improvement>,
    choices: Vec<Choice>,
}

impl Args {
    /// The length of the plan, by `--to` or `--duration`.
    fn duration_s(&self, start: GpsTime) -> anyhow::Result<f64> {
        match self.to {
            Some(to) if to < start => {
                Err(UsageError(format!("--to {to} is before the begin, {start}")).into())
            }
            Some(to) => Ok(to - start),
            None => sky::parse_duration_s(&self.duration),
        }
    }
}

pub(crate) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let input = InputFile::open(&args.array)?;
    let args = &Args { array: input.path().to_owned(), ..args.clone() };
    let mut file = ArrayFile::read(&args.array, &args.set)?;
    file.plan.step_s = args.every.unwrap_or(file.plan.step_s);
    let (settings, array, baselines) =
        checked(&file).map_err(|UsageError(what)| UsageError(in_file(args, &what)))?;
    let mut notes = Vec::new();
    let session = observed(args, &file, &mut notes);
    if let Some(session) = &session {
        file.fill(session);
    }
    // The observations may have told other bands.
    let settings = Settings { bands: Some(file.plan.bands()?), ..settings };
    let first = session.as_ref().and_then(|session| session.start);
    let sky = match session {
        Some(session) => Sky::OfFiles(Box::new(session.navigation)),
        None => Sky::read(if args.nav.is_empty() { file.navigation() } else { &args.nav })?,
    };
    sky.check(&file.plan.bands()?)?;
    let start = args.at.or(first).unwrap_or_else(|| sky.start());
    let duration_s = args.duration_s(start)?;
    let epochs = predict(&file, &settings, &sky, start, duration_s)?;
    notes.extend(uncovered(&epochs, &file.plan.bands()?));
    if epochs.iter().all(|epoch| epoch.accuracy.is_none()) {
        bail!("no epoch from {start} on has satellites enough for an attitude");
    }
    let mut random = Xoshiro256PlusPlus::seed_from_u64(1);
    let attitude = file.plan.attitude();
    let median = median_epoch(&epochs).map(|epoch| epoch.sights.as_slice()).unwrap_or_default();
    let length_constrained = length_constrained(&settings, &array, &attitude, median, &mut random);
    let plan = Plan {
        array_constrained: match length_constrained[..] {
            [of_the_line] => of_the_line,
            _ => array_constrained(&settings, &attitude, median, &mut random),
        },
        length_constrained,
        improvement: improvement::best(&settings, &attitude, &sampled(&epochs)),
        choices: choose(&array, &baselines, file.plan.graph(), &mut random),
        sky: sky.description(),
        notes,
        file,
        array,
        epochs,
    };
    let folder = OutputFolder::begin(&args.out, OUTPUTS, std::slice::from_ref(&args.array))?;
    let document = report::document(&plan);
    output::write_json(folder.path(), "plan.json", &document)?;
    report::write_page(&plan, folder.path())?;
    folder.publish()?;
    if args.json {
        output::print_json(&document)?;
    } else if !args.quiet {
        let (told, out) = (report::text(&plan), args.out.display());
        output::print(format_args!("{told}\nwritten: {out}/plan.json, {out}/plan.html\n"))?;
    }
    Ok(ExitCode::SUCCESS)
}

/// What the observations of the file tell; `None`, with a note, where they cannot be read.
fn observed(args: &Args, file: &ArrayFile, notes: &mut Vec<String>) -> Option<Session> {
    let first = file.observations().next()?;
    let session = match file.observations().find(|path| !path.exists()) {
        Some(absent) => Err(anyhow!("{} is not there", absent.display())),
        None => Session::read(&args.array, &args.nav),
    };
    let told = session.map_err(|error| {
        notes.push(format!(
            "The observations ({}, …) tell nothing, what they could is assumed: {error:#}",
            first.display()
        ));
    });
    told.ok()
}

/// Systems whose ephemerides end before the plan does.
fn uncovered(epochs: &[Epoch], bands: &[Band]) -> Vec<String> {
    let systems: BTreeSet<System> = bands.iter().map(|band| band.system).collect();
    let ends = systems.into_iter().filter_map(|system| {
        let has = |epoch: &Epoch| epoch.sights.iter().any(|sight| sight.band.system == system);
        let without = epochs.iter().rev().take_while(|epoch| !has(epoch)).count();
        let last = epochs.len().checked_sub(without + 1).map(|last| epochs[last].time);
        let which = last.map_or("none at all".to_owned(), |last| format!("the last at {last}"));
        (without > 0).then(|| {
            format!(
                "The ephemerides of {system} end: {without} of {} epochs have none ({which}). Give \
                 navigation files of those hours, or a shorter --for.",
                epochs.len()
            )
        })
    });
    ends.collect()
}

/// The engine, the array and its baselines, if all of the file makes sense.
fn checked(file: &ArrayFile) -> Result<(Settings, AntennaArray, Baselines), UsageError> {
    file.check()?;
    let settings = file.engine()?;
    let array = settings.array.clone().ok_or_else(|| UsageError("no [[antenna]]".to_owned()))?;
    let baselines = file.baselines(&array)?;
    Ok((settings, array, baselines))
}

/// What is wrong, with where it was said.
fn in_file(args: &Args, what: &str) -> String {
    let with_set = if args.set.is_empty() { "" } else { " with --set" };
    format!("{}{with_set}: {what}", args.array.display())
}

/// Accuracy at every step of the time span.
fn predict(
    file: &ArrayFile,
    settings: &Settings,
    sky: &Sky,
    start: GpsTime,
    duration_s: f64,
) -> anyhow::Result<Vec<Epoch>> {
    let bands = file.plan.bands()?;
    let steps = (duration_s / file.plan.step_s).floor();
    if steps > MAX_EPOCHS {
        bail!(UsageError(format!("{steps} epochs: plan.step_s is too short for this time span")));
    }
    let attitude = file.plan.attitude();
    let mut epochs = Vec::new();
    let mut after_s = 0.0;
    while after_s <= duration_s {
        let time = start + after_s;
        let (sights, satellites) = sky.sights(time, file, &bands);
        epochs.push(Epoch {
            time,
            hours: after_s / 3600.0,
            satellites,
            accuracy: attitude_accuracy(settings, &attitude, &sights),
            success_rate: baseline_success_rate(&sights),
            sights,
        });
        after_s += file.plan.step_s;
    }
    Ok(epochs)
}

/// Signals of some epochs, spread evenly over those with an accuracy.
fn sampled(epochs: &[Epoch]) -> Vec<&[Sight]> {
    let usable: Vec<&Epoch> = epochs.iter().filter(|epoch| epoch.accuracy.is_some()).collect();
    let stride = usable.len().div_ceil(SAMPLED_EPOCHS).max(1);
    usable.iter().step_by(stride).map(|epoch| epoch.sights.as_slice()).collect()
}

/// The epoch whose unconstrained success rate is the median.
fn median_epoch(epochs: &[Epoch]) -> Option<&Epoch> {
    let mut by_rate: Vec<(f64, &Epoch)> =
        epochs.iter().filter_map(|epoch| Some((epoch.success_rate?, epoch))).collect();
    by_rate.sort_by(|a, b| a.0.total_cmp(&b.0));
    by_rate.get(by_rate.len() / 2).map(|(_, epoch)| *epoch)
}

/// Success rate with known length of each baseline from the first antenna under this sky.
fn length_constrained(
    settings: &Settings,
    array: &AntennaArray,
    attitude: &Attitude,
    sights: &[Sight],
    random: &mut Xoshiro256PlusPlus,
) -> Vec<Option<SimulatedRate>> {
    let [first, others @ ..] = array.positions_m() else { return Vec::new() };
    let mut rate = |rover| {
        let of_pair = Settings {
            antennas: 2,
            array: AntennaArray::new(vec![*first, rover]).ok(),
            constraint: Constraint::Length,
            ..settings.clone()
        };
        simulated_success_rate(&of_pair, attitude, sights, DRAWS, random)
    };
    others.iter().map(|rover| rate(*rover)).collect()
}

/// Success rate of all integers with the known array under this sky.
fn array_constrained(
    settings: &Settings,
    attitude: &Attitude,
    sights: &[Sight],
    random: &mut Xoshiro256PlusPlus,
) -> Option<SimulatedRate> {
    let of_array = Settings { constraint: Constraint::Array, ..settings.clone() };
    simulated_success_rate(&of_array, attitude, sights, DRAWS, random)
}

/// The best baselines by every criterion.
fn choose(
    array: &AntennaArray,
    baselines: &Baselines,
    graph: Graph,
    random: &mut Xoshiro256PlusPlus,
) -> Vec<Choice> {
    let mut choice = |criterion| {
        let begun = Instant::now();
        let answer = select(baselines, graph, criterion, random).map(|selection| Answer {
            value: selection.value,
            gap: selection.gap(),
            milliseconds: begun.elapsed().as_secs_f64() * 1e3,
            relative_error: error_relative_to_all_antennas(array, &selection.pairs),
            pairs: selection.pairs,
        });
        Choice { criterion, answer }
    };
    Criterion::ALL.into_iter().map(&mut choice).collect()
}
