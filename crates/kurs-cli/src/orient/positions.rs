//! Files of coordinates become epochs: told apart by content, matched in time.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use kurs::frames::{Ecef, Geodetic, Vector};
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
    let mut coarse: Vec<(String, String)> = Vec::new();
    for (place, argument) in files.iter().enumerate() {
        let (name, path) = split_argument(argument, &names)?;
        let file = InputFile::open(&path)?;
        let mut source = Source::open(file.path())?;
        let mut log = DamageLog::default();
        let before = fixes.len();
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
        coarse.extend(round_alike(&mut fixes[before..], config).map(|what| (name.clone(), what)));
        positions.damage.extend(log.listed().iter().map(|d| Damage::new(name.clone(), d)));
    }
    let silent = silent(&logs, &fixes);
    let filled = fill_separations(&logs, &mut fixes);
    positions.states_sd = fixes.iter().any(|fix| fix.sd_ned_m.is_some());
    let has_quality = |fix: &PositionFix| fix.quality != Quality::Unknown;
    positions.states_quality = positions.states_sd || fixes.iter().any(has_quality);
    let (epochs, apart) = epochs(fixes, config);
    positions.epochs = epochs;
    for note in unasked.into_iter().chain(coarse).chain(silent).chain(filled).chain(apart) {
        let damage = Damage::at(note.0.clone(), 1, note.1.clone());
        positions.damage.push(damage);
        positions.notes.push(format!("{}: {}", note.0, note.1));
    }
    Ok(positions)
}

/// Coordinates of one file are rounded alike: by the last digit that any of them shows, because some
/// writers drop zeros. Says where that is coarser than the standard deviations.
fn round_alike(fixes: &mut [PositionFix], config: &Config) -> Option<String> {
    let finest = fixes.iter().fold([f64::INFINITY; 3], |finest, fix| {
        [0, 1, 2].map(|axis| fix.last_digit_ned_m[axis].min(finest[axis]))
    });
    fixes.iter_mut().for_each(|fix| fix.last_digit_ned_m = finest);
    let is_coarse = |fix: &PositionFix| {
        let sd_ned_m = sd_ned_m(fix, config);
        (0..3).any(|axis| rounding_sd_m(finest[axis]) > sd_ned_m[axis])
    };
    let count = fixes.iter().filter(|fix| is_coarse(fix)).count();
    let [north, east, down] = finest;
    (count > 0).then(|| {
        format!(
            "the last digit of the coordinates is worth {north:.3} m north, {east:.3} m east, \
             {down:.3} m down: more than the standard deviations of {count} positions, to which rounding is \
             added; write more digits"
        )
    })
}

/// Rounding to multiples of `q` has the variance `q²/12`.
fn rounding_sd_m(last_digit_m: f64) -> f64 {
    last_digit_m / 12f64.sqrt()
}

/// Standard deviations as stated, or else as assumed.
fn sd_ned_m(fix: &PositionFix, config: &Config) -> [f64; 3] {
    let orient = &config.orient;
    let assumed = [orient.sd_north_m, orient.sd_east_m, orient.sd_down_m];
    fix.sd_ned_m.unwrap_or_else(|| assumed.map(|sd| fix.quality.sd_factor() * sd))
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
/// next. Each is taken to the time of the first one. Says how many could not be.
fn epochs(
    mut fixes: Vec<PositionFix>,
    config: &Config,
) -> (Vec<PositionEpoch>, Option<(String, String)>) {
    fixes.sort_by_key(|fix| (fix.time, fix.antenna));
    // Some receivers send the same position under two talkers.
    fixes.dedup_by_key(|fix| (fix.time, fix.antenna));
    let neighbours = neighbours(&fixes, config.antenna.len());
    let mut epochs: Vec<PositionEpoch> = Vec::new();
    let is_later = |time: GpsTime, first: GpsTime| time - first > config.orient.match_window_s;
    let (mut left, mut most_s) = (0, 0.0);
    for (fix, [before, behind]) in fixes.iter().zip(neighbours) {
        let is_new = epochs.last().is_none_or(|epoch| {
            is_later(fix.time, epoch.time) || epoch.antennas[fix.antenna].is_some()
        });
        if is_new {
            epochs
                .push(PositionEpoch { time: fix.time, antennas: vec![None; config.antenna.len()] });
        }
        if let Some(epoch) = epochs.last_mut() {
            let taken = position_at(epoch.time, fix, &fixes[before], &fixes[behind]);
            if taken.is_none() {
                left += 1;
                most_s = f64::max(most_s, fix.time - epoch.time);
            }
            let (sd_m, last_digit_m) = (sd_ned_m(fix, config), fix.last_digit_ned_m);
            epoch.antennas[fix.antenna] = Some(AntennaFix {
                position_m: taken.unwrap_or(fix.position_m),
                sd_ned_m: [0, 1, 2].map(|axis| sd_m[axis].hypot(rounding_sd_m(last_digit_m[axis]))),
                doubt: doubt(fix.quality),
            });
        }
    }
    let note = (left > 0).then(|| {
        let what = format!(
            "{left} positions are up to {most_s:.3} s behind the first one of their epoch and lack neighbours \
             that tell how the antenna moved meanwhile: they are right for a body at rest"
        );
        ("match_window_s".to_owned(), what)
    });
    (epochs, note)
}

/// The places of the positions before and behind each one, of the same antenna; its own at an end.
fn neighbours(fixes: &[PositionFix], antennas: usize) -> Vec<[usize; 2]> {
    let mut neighbours: Vec<[usize; 2]> = (0..fixes.len()).map(|place| [place, place]).collect();
    let mut last = vec![None; antennas];
    for (place, fix) in fixes.iter().enumerate() {
        if let Some(before) = last[fix.antenna].replace(place) {
            neighbours[place][0] = before;
            neighbours[before][1] = place;
        }
    }
    neighbours
}

/// Where an antenna was at a time near that of its position, by the mean velocity between its
/// neighbours; `None` where they are too near each other, or not there.
fn position_at(
    time: GpsTime,
    fix: &PositionFix,
    before: &PositionFix,
    behind: &PositionFix,
) -> Option<Vector<Ecef>> {
    let (away_s, span_s) = (time - fix.time, behind.time - before.time);
    if away_s == 0.0 {
        return Some(fix.position_m);
    }
    (span_s >= 2.0 * away_s.abs())
        .then(|| fix.position_m + (behind.position_m - before.position_m) * (away_s / span_s))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two antennas on a body that goes north at 20 m/s, the second sampled 15 ms later.
    fn moving(seconds: u32) -> Vec<PositionFix> {
        let fix = |antenna: usize, time_s: f64| PositionFix {
            time: GpsTime::from_nanoseconds(0) + time_s,
            antenna,
            position_m: Vector::new(6_378_137.0, 2.0 * antenna as f64, 20.0 * time_s),
            sd_ned_m: Some([0.01; 3]),
            last_digit_ned_m: [0.1, 1e-4, 1e-4],
            quality: Quality::RtkFixed,
            is_above_geoid: false,
        };
        (0..seconds)
            .map(f64::from)
            .flat_map(|second| [fix(0, second), fix(1, second + 0.015)])
            .collect()
    }

    fn two() -> Config {
        toml::from_str("[[antenna]]\nname = \"A\"\n[[antenna]]\nname = \"B\"\n").unwrap()
    }

    #[test]
    fn antennas_sampled_apart_are_taken_to_one_time() {
        let (found, note) = epochs(moving(5), &two());
        assert_eq!((found.len(), note), (5, None));
        for epoch in &found {
            let [Some(a), Some(b)] = epoch.antennas[..] else { panic!("{epoch:?}") };
            let apart = b.position_m - a.position_m;
            assert!((apart - Vector::new(0.0, 2.0, 0.0)).norm() < 1e-6, "{apart:?}");
        }
        // One position alone does not tell how fast it moves.
        let (found, note) = epochs(moving(1), &two());
        assert_eq!(found.len(), 1);
        assert!(note.unwrap().1.contains("1 positions are up to 0.015 s behind"));
    }

    #[test]
    fn rounding_adds_to_the_standard_deviations() {
        let mut fixes = moving(3);
        let note = round_alike(&mut fixes, &two()).unwrap();
        assert!(note.contains("0.100 m north") && note.contains("of 6 positions"), "{note}");
        let (found, _) = epochs(fixes, &two());
        let [north, east, _] = found[0].antennas[0].unwrap().sd_ned_m;
        assert!((north - f64::hypot(0.01, 0.1 / 12f64.sqrt())).abs() < 1e-12);
        assert!((east - 0.01).abs() < 1e-5);
    }
}
