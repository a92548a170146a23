//! What a restart should know: ephemerides (`ephemerides.rnx`), and time and place of the last row
//! (`last.txt`). Written under another name and renamed, so that a file is whole or not there, by a
//! thread of its own: a disk that stalls delays no row.

use std::collections::BTreeMap;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{self, Receiver, SyncSender};
use std::thread;
use std::time::{Duration, Instant};

use kurs::ephemeris::{Ephemeris, NavigationData};
use kurs::frames::{Geodetic, Vector};
use kurs::signal::Satellite;
use kurs::solution::EpochSolution;
use kurs::time::GpsTime;
use kurs_formats::rinex::write_navigation;
use kurs_formats::source::Source;

const EPHEMERIDES: &str = "ephemerides.rnx";
const LAST: &str = "last.txt";
/// Interval between writes when there is nothing new but the time and place of the last row.
const INTERVAL: Duration = Duration::from_secs(60);
/// Least interval between writes of what a restart would have to wait for: a receiver repeats a new
/// ephemeris only after 30 s, and sends those of all its satellites at once when it connects.
const NEWS_INTERVAL: Duration = Duration::from_secs(1);

/// What will be in the files, and when they were written.
#[derive(Debug)]
pub(crate) struct StateFiles {
    snapshots: SyncSender<Snapshot>,
    writer: thread::JoinHandle<()>,
    last: Option<(GpsTime, Option<Geodetic>)>,
    /// Reference time of the newest ephemeris of every satellite.
    newest: BTreeMap<Satellite, GpsTime>,
    has_news: bool,
    saved: Instant,
}

/// What is written at once.
#[derive(Debug)]
struct Snapshot {
    navigation: NavigationData,
    last: Option<(GpsTime, Option<Geodetic>)>,
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
    /// Nothing is known yet.
    ///
    /// # Errors
    ///
    /// If the system has no thread for it.
    pub(crate) fn new(directory: PathBuf) -> io::Result<Self> {
        let (snapshots, received) = mpsc::sync_channel(1);
        let write = move || write_all(&directory, &received);
        let writer = thread::Builder::new().name("state".into()).spawn(write)?;
        let (newest, saved) = (BTreeMap::new(), Instant::now());
        Ok(Self { snapshots, writer, last: None, newest, has_news: false, saved })
    }

    pub(crate) fn note(&mut self, row: &EpochSolution) {
        let place = row.position.map(|position| position.geodetic);
        let before = self.last.and_then(|(_, place)| place);
        self.has_news |= before.is_none() && place.is_some();
        self.last = Some((row.time, place.or(before)));
    }

    pub(crate) fn note_news(&mut self, news: &NavigationData) {
        for ephemeris in news.ephemerides.iter() {
            let time = ephemeris.reference_time();
            self.has_news |= self.newest.insert(ephemeris.satellite(), time) != Some(time);
        }
    }

    /// Writes what has changed when it is time to; if the disk is busy, later.
    pub(crate) fn save(&mut self, navigation: &NavigationData) {
        let interval = if self.has_news { NEWS_INTERVAL } else { INTERVAL };
        if self.saved.elapsed() >= interval {
            self.saved = Instant::now();
            let snapshot = Snapshot { navigation: navigation.clone(), last: self.last };
            self.has_news &= self.snapshots.try_send(snapshot).is_err();
        }
    }

    /// Writes everything and waits until it is there.
    pub(crate) fn finish(self, navigation: NavigationData) {
        let _ = self.snapshots.send(Snapshot { navigation, last: self.last });
        drop(self.snapshots);
        let _ = self.writer.join();
    }
}

/// A full disk is reported in the log, and nothing more.
fn write_all(directory: &Path, snapshots: &Receiver<Snapshot>) {
    let mut written = NavigationData::default();
    for snapshot in snapshots {
        if let Err(error) = write(directory, &snapshot, &written) {
            tracing::error!("{}: the state cannot be kept: {error}", directory.display());
        } else {
            written = snapshot.navigation;
        }
    }
}

fn write(directory: &Path, snapshot: &Snapshot, written: &NavigationData) -> io::Result<()> {
    fs::create_dir_all(directory)?;
    if snapshot.navigation != *written {
        let mut text = Vec::new();
        write_navigation(&mut text, &snapshot.navigation)?;
        replace(&directory.join(EPHEMERIDES), &text)?;
    }
    let Some((time, place)) = &snapshot.last else { return Ok(()) };
    let mut text = time.as_nanoseconds().to_string();
    if let Some(place) = place {
        let xyz = place.to_ecef().xyz();
        text += &format!(" {} {} {}", xyz.x, xyz.y, xyz.z);
    }
    replace(&directory.join(LAST), text.as_bytes())
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
        let mut files = StateFiles::new(directory.clone()).unwrap();
        let time = GpsTime::from_week_tow(2300, 5.25).unwrap();
        files.note(&EpochSolution::lost(time, Reason::FewAntennas));
        files.finish(NavigationData::default());
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
