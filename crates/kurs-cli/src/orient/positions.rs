//! Files of coordinates become epochs: told apart by content, matched in time.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use kurs::frames::Geodetic;
use kurs::orientation::{AntennaFix, PositionEpoch};
use kurs::solution::Reason;
use kurs::time::GpsTime;
use kurs_formats::content::Content;
use kurs_formats::damage::DamageLog;
use kurs_formats::positions::nmea::{self, NmeaOptions, Sentences};
use kurs_formats::positions::{PositionFix, Quality, csv};
use kurs_formats::source::Source;

use super::config::Config;
use crate::failure::UsageError;
use crate::pipe::InputFile;
use crate::summary::Damage;

/// All coordinates of a run.
#[derive(Debug, Default)]
pub(super) struct Positions {
    /// In time order.
    pub(super) epochs: Vec<PositionEpoch>,
    /// Whether any of them states its standard deviations.
    pub(super) states_sd: bool,
    /// Whether any of them states that, or what kind of solution it is.
    pub(super) states_quality: bool,
    /// What could not be used.
    pub(super) damage: Vec<Damage>,
    /// What a user should know of the files.
    pub(super) notes: Vec<String>,
}

impl Positions {
    /// The antennas, by their places in the configuration, that have a position at any time.
    pub(super) fn antennas(&self) -> BTreeSet<usize> {
        let present = |epoch: &PositionEpoch| -> Vec<usize> {
            let antennas = epoch.antennas.iter().enumerate();
            antennas.filter_map(|(place, fix)| fix.is_some().then_some(place)).collect()
        };
        self.epochs.iter().flat_map(present).collect()
    }
}

/// An NMEA log, read.
struct Log {
    antenna: usize,
    path: String,
    sentences: Sentences,
}

/// Reads the files, `FILE` or `NAME=FILE`.
pub(super) fn read(
    files: &[String],
    options: NmeaOptions,
    config: &Config,
) -> anyhow::Result<Positions> {
    let names = config.names();
    let mut fixes: Vec<PositionFix> = Vec::new();
    let mut positions = Positions::default();
    let mut logs: Vec<Log> = Vec::new();
    let mut unasked: Vec<(String, String)> = Vec::new();
    for (place, argument) in files.iter().enumerate() {
        let (name, path) = split_argument(argument, &names)?;
        let file = InputFile::open(&path)?;
        let mut source = Source::open(file.path())?;
        let mut log = DamageLog::default();
        let start = source.start(Content::ENOUGH)?;
        match Content::of(start) {
            // A log may begin in the middle of a sentence or with binary messages.
            content if content == Content::Nmea || nmea::has_sentence(start) => {
                let antenna = antenna_of(name, &path, place, files.len(), &names)?;
                let take = |fix| fixes.push(fix);
                let sentences = nmea::read(&mut source, antenna, options, &mut log, take)?;
                logs.push(Log { antenna, path: path.display().to_string(), sentences });
            }
            Content::Text(_) => {
                let others = csv::read(&mut source, &names, &mut log, |fix| fixes.push(fix))?;
                let told = |(name, rows)| format!("rows of `{name}`, which is no antenna: {rows}");
                let told = others.into_iter().map(told);
                unasked.extend(told.map(|what| (path.display().to_string(), what)));
            }
            found => {
                let expected = "a table of coordinates (CSV) or an NMEA log";
                return Err(source.wrong_content(found.to_string(), expected).into());
            }
        }
        let name = path.display().to_string();
        positions.damage.extend(log.listed().iter().map(|d| Damage::new(name.clone(), d)));
    }
    let silent = silent(&logs, &fixes);
    for note in unasked.into_iter().chain(silent).chain(fill_separations(&logs, &mut fixes)) {
        let damage = Damage::at(note.0.clone(), 1, note.1.clone());
        positions.damage.push(damage);
        positions.notes.push(format!("{}: {}", note.0, note.1));
    }
    positions.states_sd = fixes.iter().any(|fix| fix.sd_ned_m.is_some());
    let has_quality = |fix: &PositionFix| fix.quality != Quality::Unknown;
    positions.states_quality = positions.states_sd || fixes.iter().any(has_quality);
    positions.epochs = epochs(fixes, config);
    Ok(positions)
}

/// The files of the arguments.
pub(super) fn files(arguments: &[String], names: &[String]) -> Result<Vec<PathBuf>, UsageError> {
    arguments.iter().map(|argument| Ok(split_argument(argument, names)?.1)).collect()
}

/// Logs without a position, and why they have none.
fn silent(logs: &[Log], fixes: &[PositionFix]) -> Vec<(String, String)> {
    let has_fix = |log: &&Log| fixes.iter().any(|fix| fix.antenna == log.antenna);
    let without = logs.iter().filter(|log| !has_fix(log));
    without.map(|log| (log.path.clone(), log.sentences.why_no_position())).collect()
}

/// Heights of logs that never state the separation of the geoid are taken to the ellipsoid by that
/// of another receiver: all are on one body. Says of which log.
fn fill_separations(logs: &[Log], fixes: &mut [PositionFix]) -> Vec<(String, String)> {
    let known = logs.iter().find_map(|log| Some((log, log.sentences.separation_m?)));
    let mut notes = Vec::new();
    for log in logs {
        let mut its =
            fixes.iter_mut().filter(|fix| fix.antenna == log.antenna && fix.is_above_geoid);
        let Some(first) = its.next() else { continue };
        let what = "no position states the separation of the geoid";
        let Some((other, separation_m)) = known else {
            notes.push((log.path.clone(), format!("{what}: heights are above the geoid")));
            continue;
        };
        for fix in std::iter::once(first).chain(its) {
            let place = Geodetic::from_ecef(fix.position_m);
            let above_ellipsoid = Geodetic { height_m: place.height_m + separation_m, ..place };
            fix.position_m = above_ellipsoid.to_ecef();
            fix.is_above_geoid = false;
        }
        notes.push((
            log.path.clone(),
            format!("{what}: {separation_m} m of {} is taken", other.path),
        ));
    }
    notes
}

/// Why a kind of solution is less than one with integers.
fn doubt(quality: Quality) -> Option<Reason> {
    match quality {
        Quality::Unknown | Quality::RtkFixed => None,
        Quality::RtkFloat => Some(Reason::WeakModel),
        Quality::DifferentialCode | Quality::Code => Some(Reason::NoPhase),
    }
}

/// `NAME=FILE` with the name of an antenna, or just a file.
fn split_argument<'a>(
    argument: &'a str,
    names: &[String],
) -> Result<(Option<&'a str>, PathBuf), UsageError> {
    match argument.split_once('=') {
        Some((name, file)) if names.iter().any(|known| known == name) => {
            Ok((Some(name), PathBuf::from(file)))
        }
        // A = in a file name names no antenna.
        Some((name, _)) if !Path::new(argument).exists() => Err(UsageError(format!(
            "{argument}: `{name}` is no antenna, expected one of {}",
            names.join(", ")
        ))),
        _ => Ok((None, PathBuf::from(argument))),
    }
}

/// The antenna of an NMEA log: as the argument says, by the file's name, or by its place where
/// there is one file for each antenna.
fn antenna_of(
    name: Option<&str>,
    path: &Path,
    place: usize,
    files: usize,
    names: &[String],
) -> Result<usize, UsageError> {
    let stem = path.file_stem().map(|stem| stem.to_string_lossy());
    let by_name = name.or(stem.as_deref()).and_then(|name| names.iter().position(|n| n == name));
    match by_name {
        Some(antenna) => Ok(antenna),
        None if files == names.len() => Ok(place),
        None => Err(UsageError(format!(
            "{}: which antenna is this? Write NAME=FILE, with one of: {}",
            path.display(),
            names.join(", ")
        ))),
    }
}

/// Fixes within the window of the first one form an epoch; a second fix of one antenna begins the
/// next.
fn epochs(mut fixes: Vec<PositionFix>, config: &Config) -> Vec<PositionEpoch> {
    let orient = &config.orient;
    let default_sd = [orient.sd_north_m, orient.sd_east_m, orient.sd_down_m];
    fixes.sort_by_key(|fix| (fix.time, fix.antenna));
    // Some receivers send the same position under two talkers.
    fixes.dedup_by_key(|fix| (fix.time, fix.antenna));
    let mut epochs: Vec<PositionEpoch> = Vec::new();
    let is_later = |time: GpsTime, first: GpsTime| time - first > orient.match_window_s;
    for fix in fixes {
        let is_new = epochs.last().is_none_or(|epoch| {
            is_later(fix.time, epoch.time) || epoch.antennas[fix.antenna].is_some()
        });
        if is_new {
            epochs
                .push(PositionEpoch { time: fix.time, antennas: vec![None; config.antenna.len()] });
        }
        if let Some(epoch) = epochs.last_mut() {
            let assumed = || default_sd.map(|sd| fix.quality.sd_factor() * sd);
            let sd_ned_m = fix.sd_ned_m.unwrap_or_else(assumed);
            let doubt = doubt(fix.quality);
            let antenna = AntennaFix { position_m: fix.position_m, sd_ned_m, doubt };
            epoch.antennas[fix.antenna] = Some(antenna);
        }
    }
    epochs
}
