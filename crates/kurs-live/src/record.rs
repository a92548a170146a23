//! The raw log: every byte of a stream as it came, and when. `NAME-TIME.raw` has the bytes and
//! nothing else, so that `kurs solve` reads it as any log; `NAME-TIME.raw.marks` has a line for
//! every piece: the offset behind it and its arrival in nanoseconds of Unix time.

use std::fs::File;
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use kurs::time::{Calendar, GpsTime};

use crate::connection::marks_of;
use crate::decoder::Chunk;

/// A disk that takes nothing is tried again after this time.
const PAUSE: Duration = Duration::from_secs(10);

/// A log in the making.
#[derive(Debug)]
pub(crate) struct Recorder {
    directory: PathBuf,
    stem: String,
    open: Option<Open>,
    paused_until: Option<Instant>,
}

#[derive(Debug)]
struct Open {
    day: u64,
    bytes: File,
    marks: File,
    written: u64,
}

impl Recorder {
    /// A log of the stream `name`; a new pair of files begins with every start and every UTC day.
    pub(crate) fn new(directory: &Path, name: &str) -> Self {
        Self { directory: directory.to_owned(), stem: stem(name), open: None, paused_until: None }
    }

    /// Writes a piece; after an error nothing for a while, and then to new files.
    pub(crate) fn write(&mut self, chunk: &Chunk) -> io::Result<()> {
        if self.paused_until.is_some_and(|until| Instant::now() < until) {
            return Ok(());
        }
        let written = self.try_write(chunk);
        self.paused_until = written.is_err().then(|| Instant::now() + PAUSE);
        if written.is_err() {
            self.open = None;
        }
        written
    }

    fn try_write(&mut self, chunk: &Chunk) -> io::Result<()> {
        const DAY_S: u64 = 86_400;
        let since = chunk.utc.duration_since(UNIX_EPOCH).unwrap_or_default();
        let day = since.as_secs() / DAY_S;
        let open = match self.open.take().filter(|open| open.day == day) {
            Some(open) => self.open.insert(open),
            None => {
                let name = format!("{}-{}.raw", self.stem, stamp(chunk.utc));
                let path = self.directory.join(name);
                std::fs::create_dir_all(&self.directory)?;
                let (bytes, marks) = (File::create(&path)?, File::create(marks_of(&path))?);
                self.open.insert(Open { day, bytes, marks, written: 0 })
            }
        };
        open.bytes.write_all(&chunk.bytes)?;
        open.written += chunk.bytes.len() as u64;
        writeln!(open.marks, "{},{}", open.written, since.as_nanos())
    }
}

/// How the names of a stream's logs begin.
pub(crate) fn stem(name: &str) -> String {
    let plain = |c: char| if c.is_ascii_alphanumeric() || c == '-' { c } else { '_' };
    name.chars().map(plain).collect()
}

/// Whether a text is a time as in the names of logs.
pub(crate) fn is_stamp(text: &str) -> bool {
    let shape = "00000000T000000Z";
    let fits = |(found, wanted): (u8, u8)| match wanted {
        b'0' => found.is_ascii_digit(),
        letter => found == letter,
    };
    text.len() == shape.len() && text.bytes().zip(shape.bytes()).all(fits)
}

/// `YYYYMMDDTHHMMSSZ`
fn stamp(utc: SystemTime) -> String {
    let Calendar { year, month, day, hour, minute, second } = calendar(utc);
    format!("{year:04}{month:02}{day:02}T{hour:02}{minute:02}{:02}Z", second.floor())
}

/// The date and time of day of the system's clock.
pub(crate) fn calendar(utc: SystemTime) -> Calendar {
    gps_time_of_utc_scale(utc).calendar()
}

/// GPS time by the system's clock.
#[must_use]
pub fn gps_time(utc: SystemTime) -> GpsTime {
    GpsTime::from_utc(calendar(utc)).unwrap_or_default()
}

/// The instant at which a clock of GPS time shows what this one shows.
fn gps_time_of_utc_scale(utc: SystemTime) -> GpsTime {
    /// 1980-01-06 in Unix time.
    const GPS_EPOCH_S: i128 = 315_964_800;
    let since = utc.duration_since(UNIX_EPOCH).unwrap_or_default().as_nanos();
    let nanoseconds = i128::try_from(since).unwrap_or(0) - GPS_EPOCH_S * 1_000_000_000;
    GpsTime::from_nanoseconds(i64::try_from(nanoseconds).unwrap_or(0).max(0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Arc;
    use std::time::{Duration, Instant};

    fn chunk(bytes: &[u8], unix_s: u64) -> Chunk {
        let utc = UNIX_EPOCH + Duration::from_secs(unix_s);
        Chunk { bytes: Arc::from(bytes), arrived: Instant::now(), utc }
    }

    /// 2026-11-29 is day 20786 of Unix time.
    #[test]
    fn bytes_and_marks_by_day() {
        let folder = tempfile::tempdir().unwrap();
        let mut recorder = Recorder::new(folder.path(), "port/0");
        let midnight = 20_786 * 86_400;
        recorder.write(&chunk(b"abc", midnight - 2)).unwrap();
        recorder.write(&chunk(b"de", midnight - 1)).unwrap();
        recorder.write(&chunk(b"f", midnight)).unwrap();
        let read = |name: &str| std::fs::read_to_string(folder.path().join(name)).unwrap();
        assert_eq!(read("port_0-20261128T235958Z.raw"), "abcde");
        let marks = read("port_0-20261128T235958Z.raw.marks");
        let ns = |unix_s: u64| unix_s * 1_000_000_000;
        assert_eq!(marks, format!("3,{}\n5,{}\n", ns(midnight - 2), ns(midnight - 1)));
        assert_eq!(read("port_0-20261129T000000Z.raw"), "f");
    }

    #[test]
    fn the_clock_of_the_system_is_ahead_of_utc_by_leap_seconds() {
        let time = gps_time(UNIX_EPOCH + Duration::from_secs(20_786 * 86_400));
        let utc = time.utc();
        assert_eq!((utc.year, utc.month, utc.day, utc.hour), (2026, 11, 29, 0));
        assert_eq!(time.calendar().second, 18.0);
    }
}
