//! Files of coordinates become epochs: told apart by content, matched in time.

use std::path::{Path, PathBuf};

use kurs::orientation::{AntennaFix, PositionEpoch};
use kurs::time::GpsTime;
use kurs_formats::content::Content;
use kurs_formats::damage::DamageLog;
use kurs_formats::positions::{PositionFix, csv, nmea};
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
    /// What could not be used.
    pub(super) damage: Vec<Damage>,
}

/// Reads the files, `FILE` or `NAME=FILE`; `date` is for logs without one.
pub(super) fn read(
    files: &[String],
    date: Option<nmea::Date>,
    config: &Config,
) -> anyhow::Result<Positions> {
    let names = config.names();
    let mut fixes: Vec<PositionFix> = Vec::new();
    let mut positions = Positions::default();
    for (place, argument) in files.iter().enumerate() {
        let (name, path) = split_argument(argument, &names);
        let file = InputFile::open(&path)?;
        let mut source = Source::open(file.path())?;
        let mut log = DamageLog::default();
        let start = source.start(Content::ENOUGH)?;
        match Content::of(start) {
            // A log may begin in the middle of a sentence or with binary messages.
            _ if nmea::has_sentence(start) => {
                let antenna = antenna_of(name, &path, place, files.len(), &names)?;
                nmea::read(&mut source, antenna, date, &mut log, |fix| fixes.push(fix))?;
            }
            Content::Text(_) => {
                csv::read(&mut source, &names, &mut log, |fix| fixes.push(fix))?;
            }
            found => {
                let expected = "a table of coordinates (CSV) or an NMEA log";
                return Err(source.wrong_content(found.to_string(), expected).into());
            }
        }
        let name = path.display().to_string();
        positions.damage.extend(log.listed().iter().map(|d| Damage::new(name.clone(), d)));
    }
    positions.states_sd = fixes.iter().any(|fix| fix.sd_ned_m.is_some());
    positions.epochs = epochs(fixes, config);
    Ok(positions)
}

/// The files of the arguments.
pub(super) fn files(arguments: &[String], names: &[String]) -> Vec<PathBuf> {
    arguments.iter().map(|argument| split_argument(argument, names).1).collect()
}

/// `NAME=FILE` with the name of an antenna, or just a file.
fn split_argument<'a>(argument: &'a str, names: &[String]) -> (Option<&'a str>, PathBuf) {
    match argument.split_once('=') {
        Some((name, file)) if names.iter().any(|known| known == name) => {
            (Some(name), PathBuf::from(file))
        }
        _ => (None, PathBuf::from(argument)),
    }
}

/// The antenna of an NMEA log: as the argument says, by the file's name, or by its place where there
/// is one file for each antenna.
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
    // Some receivers tell the same position under two talkers.
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
            let assumed = || default_sd.map(|sd| fix.sd_factor * sd);
            let sd_ned_m = fix.sd_ned_m.unwrap_or_else(assumed);
            epoch.antennas[fix.antenna] = Some(AntennaFix { position_m: fix.position_m, sd_ned_m });
        }
    }
    epochs
}
