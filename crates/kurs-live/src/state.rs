//! What a restart should know: ephemerides (`ephemerides.rnx`), and time and place of the last row
//! (`last.txt`). Written under another name and renamed, so that a file is whole or not there.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use kurs::ephemeris::{Ephemeris, NavigationData};
use kurs::frames::{Geodetic, Vector};
use kurs::solution::EpochSolution;
use kurs::time::GpsTime;
use kurs_formats::rinex::write_navigation;
use kurs_formats::source::Source;

const EPHEMERIDES: &str = "ephemerides.rnx";
const LAST: &str = "last.txt";

/// The files, and what will be in them.
#[derive(Debug)]
pub(crate) struct StateFiles {
    directory: PathBuf,
    last: Option<(GpsTime, Option<Geodetic>)>,
    saved: NavigationData,
}

/// What an earlier run left.
#[derive(Debug, Default)]
pub struct Remembered {
    /// Ephemerides and the other parameters.
    pub navigation: NavigationData,
    /// Time of the last row.
    pub time: Option<GpsTime>,
    /// Where the body was.
    pub place: Option<Geodetic>,
}

impl StateFiles {
    pub(crate) fn new(directory: PathBuf) -> Self {
        Self { directory, last: None, saved: NavigationData::default() }
    }

    pub(crate) fn note(&mut self, row: &EpochSolution) {
        let place = row.position.map(|position| position.geodetic);
        let before = self.last.and_then(|(_, place)| place);
        self.last = Some((row.time, place.or(before)));
    }

    /// Writes what has changed; a disk that is full is told of, and nothing more.
    pub(crate) fn save(&mut self, navigation: &NavigationData) {
        if let Err(error) = self.try_save(navigation) {
            tracing::error!("{}: the state cannot be kept: {error}", self.directory.display());
        }
    }

    fn try_save(&mut self, navigation: &NavigationData) -> io::Result<()> {
        fs::create_dir_all(&self.directory)?;
        if self.saved != *navigation {
            let mut text = Vec::new();
            write_navigation(&mut text, navigation)?;
            replace(&self.directory.join(EPHEMERIDES), &text)?;
            self.saved = navigation.clone();
        }
        if let Some((time, place)) = &self.last {
            let mut text = time.as_nanoseconds().to_string();
            if let Some(place) = place {
                let xyz = place.to_ecef().xyz();
                text += &format!(" {} {} {}", xyz.x, xyz.y, xyz.z);
            }
            replace(&self.directory.join(LAST), text.as_bytes())?;
        }
        Ok(())
    }
}

fn replace(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let temporary = path.with_extension("part");
    fs::write(&temporary, bytes)?;
    fs::rename(&temporary, path)
}

/// Reads what an earlier run left; what is damaged or not there is not known.
#[must_use]
pub fn remembered(directory: &Path) -> Remembered {
    let mut found = Remembered::default();
    let path = directory.join(EPHEMERIDES);
    if path.exists() {
        let mut navigation = NavigationData::default();
        let read = Source::open(&path)
            .and_then(|mut source| kurs_formats::navigation::read(&mut source, &mut navigation));
        match read {
            Ok(_) => found.navigation = navigation,
            Err(error) => tracing::warn!("ephemerides of the last run: {error}"),
        }
    }
    let last = fs::read_to_string(directory.join(LAST)).unwrap_or_default();
    let mut words = last.split_ascii_whitespace();
    found.time = words.next().and_then(|ns| ns.parse().ok()).map(GpsTime::from_nanoseconds);
    let metres: Vec<f64> = words.filter_map(|word| word.parse().ok()).collect();
    if let [x, y, z] = metres[..] {
        found.place = Some(Geodetic::from_ecef(Vector::new(x, y, z)));
    }
    found
}

/// The newest reference time of an ephemeris.
#[must_use]
pub fn newest_reference_time(navigation: &NavigationData) -> Option<GpsTime> {
    navigation.ephemerides.iter().map(Ephemeris::reference_time).max()
}

#[cfg(test)]
mod tests {
    use super::*;
    use kurs::solution::Reason;

    #[test]
    fn what_was_saved_is_remembered() {
        let folder = tempfile::tempdir().unwrap();
        let directory = folder.path().join("state");
        assert!(remembered(&directory).time.is_none());
        let mut files = StateFiles::new(directory.clone());
        let time = GpsTime::from_week_tow(2300, 5.25).unwrap();
        files.note(&EpochSolution::lost(time, Reason::FewAntennas));
        let navigation = NavigationData::default();
        files.save(&navigation);
        let found = remembered(&directory);
        assert_eq!((found.time, found.place.is_none()), (Some(time), true));

        fs::write(directory.join(LAST), "12 6378137 0 0").unwrap();
        let place = remembered(&directory).place.unwrap();
        assert!(place.height_m.abs() < 1e-6 && place.latitude_rad == 0.0);
        fs::write(directory.join(LAST), "nonsense").unwrap();
        fs::write(directory.join(EPHEMERIDES), [0, 1, 2]).unwrap();
        let found = remembered(&directory);
        assert!(found.time.is_none() && found.navigation == NavigationData::default());
    }
}
