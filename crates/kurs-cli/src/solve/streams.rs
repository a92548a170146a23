//! The observation files of all antennas, matched in time: one array epoch for every epoch that
//! any antenna has.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::Context;
use kurs::observation::{AntennaEpoch, ArrayEpoch};
use kurs::time::GpsTime;
use kurs_formats::logs::LogOptions;
use kurs_formats::session::{FileDamage, SessionReader};

use crate::window::Window;

/// Interval that is assumed while no antenna has shown two epochs, s.
const UNKNOWN_INTERVAL_S: f64 = 1.0;

/// Where the observations of one antenna are.
pub(crate) struct AntennaFiles {
    pub(crate) name: String,
    /// In any order.
    pub(crate) files: Vec<PathBuf>,
    pub(crate) options: LogOptions,
}

/// One antenna's epochs, read one ahead.
struct Stream {
    name: String,
    reader: SessionReader,
    next: AntennaEpoch,
    has_next: bool,
    window: Window,
    /// First and last epoch so far.
    span: Option<(GpsTime, GpsTime)>,
}

/// All antennas' epochs in time order.
pub(crate) struct Streams {
    streams: Vec<Stream>,
    /// A fixed station; its epochs alone make no row.
    station: Option<Stream>,
    /// Shortest time between two epochs of one antenna so far, s.
    interval_s: f64,
    /// Size of all files; 0 if one of them has none, as a pipe.
    bytes: u64,
}

impl Streams {
    /// Opens the files of every antenna, and of the station if there is one, and reads their first
    /// epochs inside the window.
    pub(crate) fn open(
        antennas: Vec<AntennaFiles>,
        station: Option<AntennaFiles>,
        window: Window,
    ) -> anyhow::Result<Self> {
        let files = antennas.iter().chain(&station).flat_map(|antenna| &antenna.files);
        let sizes: Option<Vec<u64>> = files.map(|file| size(file)).collect();
        let bytes = sizes.map_or(0, |sizes| sizes.iter().sum());
        let open = |AntennaFiles { name, files, options }: AntennaFiles| {
            let context = || format!("antenna {name}");
            let reader = SessionReader::open_with(&files, options).with_context(context)?;
            let next = AntennaEpoch::default();
            let mut stream = Stream { name, reader, next, has_next: false, window, span: None };
            stream.advance()?;
            Ok(stream)
        };
        let streams = antennas.into_iter().map(open).collect::<anyhow::Result<_>>()?;
        let station = station.map(open).transpose()?;
        Ok(Self { streams, station, interval_s: f64::INFINITY, bytes })
    }

    /// How much of all files is read, 0 to 1; `None` where their size is unknown.
    pub(crate) fn share(&self) -> Option<f64> {
        let read: u64 =
            self.streams.iter().chain(&self.station).map(|s| s.reader.bytes_read()).sum();
        (self.bytes > 0).then(|| (read as f64 / self.bytes as f64).min(1.0))
    }

    /// Shortest time between two epochs of one antenna so far, s; `None` before there were two.
    pub(crate) fn interval_s(&self) -> Option<f64> {
        Some(self.interval_s).filter(|s| s.is_finite())
    }

    /// Number of antennas that have any epoch at all.
    pub(crate) fn antennas_with_epochs(&self) -> usize {
        self.streams.iter().filter(|s| s.span.is_some()).count()
    }

    /// Fills `epoch` with the next instant: the earliest waiting epoch and those of other antennas
    /// less than half an interval after it. `false` at the end of all files.
    pub(crate) fn next(&mut self, epoch: &mut ArrayEpoch) -> anyhow::Result<bool> {
        let waiting = self.streams.iter().filter(|s| s.has_next);
        let Some(earliest) = waiting.map(|s| s.next.time).min() else { return Ok(false) };
        let interval_s =
            if self.interval_s.is_finite() { self.interval_s } else { UNKNOWN_INTERVAL_S };
        epoch.antennas.resize_with(self.streams.len(), || None);
        let mut first = None;
        for (stream, slot) in self.streams.iter_mut().zip(&mut epoch.antennas) {
            if !stream.has_next || stream.next.time - earliest >= 0.5 * interval_s {
                *slot = None;
                continue;
            }
            first.get_or_insert(stream.next.time);
            // The buffer of the epoch before comes back to be filled again.
            std::mem::swap(slot.get_or_insert_default(), &mut stream.next);
            self.interval_s = self.interval_s.min(stream.advance()?);
        }
        epoch.time = first.unwrap_or(earliest);
        self.match_station(epoch, 0.5 * interval_s)?;
        Ok(true)
    }

    /// Gives the epoch the station's observations of the same time, and passes over older ones.
    fn match_station(&mut self, epoch: &mut ArrayEpoch, window_s: f64) -> anyhow::Result<()> {
        let Some(station) = &mut self.station else { return Ok(()) };
        while station.has_next && station.next.time - epoch.time <= -window_s {
            station.advance()?;
        }
        if station.has_next && station.next.time - epoch.time < window_s {
            std::mem::swap(epoch.station.get_or_insert_default(), &mut station.next);
            station.advance()?;
        } else {
            epoch.station = None;
        }
        Ok(())
    }

    /// GLONASS frequency channel of each orbital slot, as far as any file told so far.
    pub(crate) fn glonass_channels(&self) -> BTreeMap<u8, i8> {
        let streams = self.streams.iter().chain(&self.station);
        streams.flat_map(|s| s.reader.glonass_channels()).collect()
    }

    /// Everything that was damaged so far.
    pub(crate) fn damage(&self) -> Vec<FileDamage> {
        self.streams.iter().chain(&self.station).flat_map(|s| s.reader.damage()).collect()
    }

    /// Time span of each antenna in words, for the message that they do not overlap.
    pub(crate) fn spans(&self) -> String {
        let words = self.streams.iter().chain(&self.station).map(|s| match s.span {
            Some((first, last)) => format!("{} from {first} to {last}", s.name),
            None => format!("{} has no epoch", s.name),
        });
        words.collect::<Vec<_>>().join(", ")
    }
}

impl Stream {
    /// Reads the next epoch; returns the time since the one before, s (infinite at either end).
    fn advance(&mut self) -> anyhow::Result<f64> {
        let context = || format!("antenna {}", self.name);
        let time = loop {
            self.has_next = self.reader.next_epoch(&mut self.next).with_context(context)?;
            self.has_next &= !self.window.is_after(self.next.time);
            if !self.has_next {
                return Ok(f64::INFINITY);
            }
            if self.window.contains(self.next.time) {
                break self.next.time;
            }
        };
        let before = self.span.map(|(_, last)| last);
        self.span = Some((self.span.map_or(time, |(first, _)| first), time));
        Ok(before.map_or(f64::INFINITY, |before| time - before))
    }
}

/// Bytes of a file; `None` for what is none.
fn size(file: &Path) -> Option<u64> {
    std::fs::metadata(file).ok().filter(std::fs::Metadata::is_file).map(|data| data.len())
}
