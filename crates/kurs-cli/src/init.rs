//! `kurs init`: files in, a commented configuration out.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::{Path, PathBuf};

use kurs::observation::AntennaEpoch;
use kurs::signal::Band;
use kurs::time::GpsTime;
use kurs_formats::logs::{LogOptions, LogPart};
use kurs_formats::observations::ObservationSource;

use crate::config_file;
use crate::failure::{ExitCode, UsageError};
use crate::output::{self, OutputFile};
use crate::pipe::{self, InputFile};
use crate::solve::found_files::{FoundAntenna, FoundFiles};

/// Epochs of each antenna that are looked at.
const EPOCHS: usize = 100;
/// A band counts if this share of the epochs has carrier phases of it.
const MIN_SHARE_OF_EPOCHS: f64 = 0.5;
/// Name of the configuration.
const CONFIGURATION: &str = "kurs.toml";

/// A commented configuration for `kurs solve` from files: antennas, bands, what is in them.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Observation, navigation, orbit (SP3) and antenna (ANTEX) files in any order: their content
    /// tells what they are.
    #[arg(required = true, value_name = "FILE")]
    files: Vec<PathBuf>,
    /// Folder for kurs.toml; `-` prints it.
    #[arg(long, value_name = "DIR", default_value = "kurs-out/init")]
    out: PathBuf,
    /// Replaces a kurs.toml that is there.
    #[arg(long)]
    force: bool,
    /// No closing line.
    #[arg(long, short)]
    quiet: bool,
}

/// What the first epochs of an antenna show.
struct Seen {
    first: Option<GpsTime>,
    /// Shortest step, s.
    interval_s: Option<f64>,
    /// Bands with carrier phases.
    bands: BTreeSet<Band>,
}

/// Runs the command.
pub(crate) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let is_printed = output::is_standard_output(&args.out);
    let target = args.out.join(CONFIGURATION);
    if !is_printed && target.exists() && !args.force {
        let text = "is there already: --force replaces it, --out DIR writes another";
        return Err(UsageError(format!("{}: {text}", target.display())).into());
    }
    let files = InputFile::open_all(&args.files)?;
    if let Some(pipe) = files.iter().find(|file| file.is_copy()) {
        let text = "a pipe is gone when the configuration is read, expected a file";
        return Err(UsageError(format!("{}: {text}", pipe::named(pipe.path()))).into());
    }
    let found = FoundFiles::sort(&files, &[], 0)?;
    if let Some(text) = &found.configuration {
        let is_one = config_file::read::<toml::Table>(text).is_ok();
        let found = if is_one { "is a configuration already" } else { "is some other text" };
        let expected = "expected observations and navigation data";
        return Err(UsageError(format!("{}: {found}, {expected}", text.display())).into());
    }
    if found.antennas.is_empty() {
        return Err(UsageError(format!("no observations among the files; found {found}")).into());
    }
    let seen = found.antennas.iter().map(look).collect::<anyhow::Result<Vec<Seen>>>()?;
    let missing = missing(&found.antennas, &seen)?;
    let text = text(&found, &seen, missing.as_deref(), &args.out)?;
    if is_printed {
        output::print(text)?;
        return Ok(ExitCode::SUCCESS);
    }
    let mut file = OutputFile::create(&args.out, CONFIGURATION)?;
    file.write_all(text.as_bytes())?;
    file.finish()?;
    if !args.quiet {
        let target = target.display();
        let next = missing.unwrap_or_else(|| format!("next: kurs solve {target}"));
        output::print(format_args!("written to {target}\n{next}\n"))?;
    }
    Ok(ExitCode::SUCCESS)
}

/// Reads the first epochs.
fn look(antenna: &FoundAntenna) -> anyhow::Result<Seen> {
    let mut source = ObservationSource::open_with(&antenna.files[0], &options(antenna))?;
    let mut epoch = AntennaEpoch::default();
    let (mut first, mut last, mut interval_s) = (None, None::<GpsTime>, None::<f64>);
    let (mut epochs, mut with_phase) = (0_usize, BTreeMap::<Band, usize>::new());
    while epochs < EPOCHS && source.next_epoch(&mut epoch)? {
        epochs += 1;
        first.get_or_insert(epoch.time);
        if let Some(last) = last.replace(epoch.time) {
            // A difference of tags is off by their rounding, far below a microsecond.
            let step_s = ((epoch.time - last) * 1e6).round() / 1e6;
            interval_s = Some(interval_s.map_or(step_s, |shortest| shortest.min(step_s)));
        }
        let phases = epoch.observations.iter().filter(|o| o.phase_cycles.is_some());
        let bands: BTreeSet<Band> = phases.map(|o| o.signal.band).collect();
        bands.into_iter().for_each(|band| *with_phase.entry(band).or_default() += 1);
    }
    let is_usual = |count: usize| count as f64 >= MIN_SHARE_OF_EPOCHS * epochs as f64;
    let bands = with_phase.into_iter().filter(|(_, count)| is_usual(*count)).map(|(band, _)| band);
    Ok(Seen { first, interval_s, bands: bands.collect() })
}

/// What these files lack for an attitude: a second antenna, or time that two antennas have in common.
fn missing(antennas: &[FoundAntenna], seen: &[Seen]) -> anyhow::Result<Option<String>> {
    let pairs = antennas.iter().zip(seen);
    let mut begun: Vec<_> = pairs.filter_map(|(a, seen)| Some((seen.first?, a))).collect();
    begun.sort_by_key(|(first, _)| *first);
    let [others @ .., (begin, last)] = &begun[..] else { return Ok(None) };
    if others.is_empty() {
        let text =
            "one antenna has no attitude: `kurs solve` expects the observations of two or more";
        return Ok(Some(text.into()));
    }
    for (_, other) in others {
        if !reaches(other, *begin)? {
            let (ended, begun) = (&other.name, &last.name);
            return Ok(Some(format!(
                "no common time: {ended} ends before {begun} begins, {begin}"
            )));
        }
    }
    Ok(None)
}

/// Whether an antenna has an epoch then or later: read no further than up to the first one.
fn reaches(antenna: &FoundAntenna, time: GpsTime) -> anyhow::Result<bool> {
    let mut epoch = AntennaEpoch::default();
    for file in antenna.files.iter().rev() {
        let mut source = ObservationSource::open_with(file, &options(antenna))?;
        while source.next_epoch(&mut epoch)? {
            if epoch.time >= time {
                return Ok(true);
            }
        }
    }
    Ok(false)
}

/// Which part of its files is this antenna.
fn options(antenna: &FoundAntenna) -> LogOptions {
    antenna.part.map_or_else(LogOptions::default, LogPart::options)
}

/// The configuration; what is missing stands at its begin.
fn text(
    found: &FoundFiles,
    seen: &[Seen],
    missing: Option<&str>,
    out: &Path,
) -> anyhow::Result<String> {
    let mut text = String::from(
        "# Configuration of `kurs solve`, begun by `kurs init`. A line behind a # is not in force: it shows\n\
         # the default, or what could stand there. Paths are relative to this file's folder.\n",
    );
    missing.map_or(Ok(()), |missing| writeln!(text, "# {missing}"))?;
    for (antenna, seen) in found.antennas.iter().zip(seen) {
        write_antenna(&mut text, antenna, seen, out)?;
    }
    writeln!(text, "\n[nav]")?;
    let (nav, _) = found.navigation();
    if nav.is_empty() {
        writeln!(
            text,
            "# Navigation files and precise orbits; receiver logs bring their ephemerides along."
        )?;
        writeln!(text, "# files = [\"brdc.rnx\"]")?;
    } else {
        writeln!(text, "files = {}", list(&nav, out))?;
    }
    if !found.antex.is_empty() {
        writeln!(text, "\n[antex]\nfiles = {}", list(&found.antex, out))?;
    }
    write_method(&mut text, &shared(seen))?;
    Ok(text)
}

fn write_antenna(
    text: &mut String,
    antenna: &FoundAntenna,
    seen: &Seen,
    out: &Path,
) -> anyhow::Result<()> {
    let bands = names(&seen.bands).join(" ");
    writeln!(text, "\n[[antenna]]")?;
    writeln!(text, "name = {}", toml::Value::from(antenna.name.as_str()))?;
    match (seen.first, seen.interval_s) {
        (Some(first), Some(s)) => {
            writeln!(text, "# from {first} on, every {s} s; carrier phases of {bands}")?;
        }
        (Some(first), None) => writeln!(text, "# one epoch, {first}; carrier phases of {bands}")?,
        (None, _) => writeln!(text, "# no epoch was found in it")?,
    }
    writeln!(text, "obs = {}", list(&antenna.files, out))?;
    match antenna.part {
        Some(LogPart::Receiver) => writeln!(text, "protocol = \"ubx\"")?,
        Some(LogPart::Station(id)) => writeln!(text, "station_id = {id}")?,
        Some(LogPart::Antenna(id)) => writeln!(text, "antenna_id = \"{id}\"")?,
        None => {}
    }
    writeln!(
        text,
        "# Metres forward, right and down on the body; for every antenna or for none. With places the known\n\
         # lengths go into the search, and heading, pitch and roll are those of the body.\n\
         # position_m = [0.0, 0.0, 0.0]"
    )?;
    Ok(())
}

/// The keys that are changed most, with their defaults.
fn write_method(text: &mut String, shared: &BTreeSet<Band>) -> anyhow::Result<()> {
    let shared: Vec<String> = names(shared).iter().map(|name| format!("\"{name}\"")).collect();
    writeln!(
        text,
        "\n[solve]\n\
         # Bands with carrier phases at two antennas and more; all of them are used unless some are named.\n\
         # bands = [{}]\n\
         # Satellites below are ignored.\n\
         # elevation_mask_deg = 10.0\n\
         # Each epoch alone, or \"continuous\": ambiguities carried on between cycle slips.\n\
         # ambiguity = \"instantaneous\"\n\
         # What is known of the array: \"array\", \"length\" or \"none\"; by default what position_m allows.\n\
         # constraint = \"array\"\n\
         # Standard deviation of position_m.\n\
         # array_sd_m = 0.002\n\
         # What the body cannot exceed in pitch or roll.\n\
         # max_tilt_deg = 90.0\n\
         # Wrong / fixed that the acceptance test keeps.\n\
         # max_wrong_fix_rate = 0.001",
        shared.join(", ")
    )?;
    writeln!(
        text,
        "\n# A point of the body that is wanted too.\n\
         # [[point]]\n# name = \"mast\"\n# position_m = [12.0, 0.0, 1.5]"
    )?;
    Ok(())
}

/// Bands that two antennas have.
fn shared(seen: &[Seen]) -> BTreeSet<Band> {
    let all: BTreeSet<Band> = seen.iter().flat_map(|seen| seen.bands.iter().copied()).collect();
    let count = |band: &Band| seen.iter().filter(|seen| seen.bands.contains(band)).count();
    all.into_iter().filter(|band| count(band) >= 2).collect()
}

fn names(bands: &BTreeSet<Band>) -> Vec<String> {
    bands.iter().map(ToString::to_string).collect()
}

/// Paths as TOML: relative where they are inside the configuration's folder (a printed one's is
/// this).
fn list(files: &[PathBuf], out: &Path) -> toml::Value {
    let out = if output::is_standard_output(out) { Path::new(".") } else { out };
    let folder = std::path::absolute(out).unwrap_or_default();
    let of = |file: &PathBuf| {
        let whole = std::path::absolute(file).unwrap_or_else(|_| file.clone());
        let inside = whole.strip_prefix(&folder).unwrap_or(&whole);
        toml::Value::String(inside.display().to_string())
    };
    toml::Value::Array(files.iter().map(of).collect())
}
