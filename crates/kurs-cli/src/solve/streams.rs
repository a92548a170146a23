//! The observation files of all antennas, matched in time: one array epoch for every epoch that
//! any antenna has.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::Context;
use kurs::ephemeris::{AsReceived, NavigationData};
use kurs::observation::matcher::Matcher;
use kurs::observation::{AntennaEpoch, ArrayEpoch};
use kurs::signal::System;
use kurs::time::GpsTime;
use kurs_formats::fingerprint::Fingerprint;
use kurs_formats::logs::LogOptions;
use kurs_formats::session::{FileDamage, SessionReader};

use crate::summary::Damage;
use crate::window::Window;

/// Files are read without a clock: whoever is missing is waited for.
const NO_CLOCK_S: f64 = 0.0;

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
    next: Option<AntennaEpoch>,
    window: Window,
    /// First and last epoch so far.
    span: Option<(GpsTime, GpsTime)>,
}

/// All antennas' epochs in time order.
pub(crate) struct Streams {
    streams: Vec<Stream>,
    matcher: Matcher,
    /// Navigation data that the logs bring along, where they count as received.
    received: AsReceived,
    /// A fixed station; its epochs alone make no row.
    station: Option<Stream>,
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
            let mut stream = Stream { name, reader, next: None, window, span: None };
            stream.next = stream.read(AntennaEpoch::default())?;
            Ok(stream)
        };
        let streams = antennas.into_iter().map(open).collect::<anyhow::Result<Vec<_>>>()?;
        let station = station.map(open).transpose()?;
        let (matcher, received) = (Matcher::new(streams.len()), AsReceived::new(streams.len()));
        Ok(Self { streams, matcher, received, station, bytes })
    }

    /// Leaves out the systems that are not wanted from the next epoch on, where their observations
    /// need not be read.
    pub(crate) fn keep_systems(&mut self, wanted: impl Fn(System) -> bool) {
        for stream in self.streams.iter_mut().chain(&mut self.station) {
            stream.reader.keep_systems(&wanted);
        }
    }

    /// How much of all files is read, 0 to 1; `None` where their size is unknown.
    pub(crate) fn share(&self) -> Option<f64> {
        let read: u64 =
            self.streams.iter().chain(&self.station).map(|s| s.reader.bytes_read()).sum();
        (self.bytes > 0).then(|| (read as f64 / self.bytes as f64).min(1.0))
    }

    /// What the files hold that were read to their ends, by name.
    pub(super) fn fingerprints(&self) -> Vec<(String, Fingerprint)> {
        let readers = self.streams.iter().chain(&self.station).map(|stream| &stream.reader);
        readers.flat_map(SessionReader::fingerprints).collect()
    }

    /// Shortest time between two epochs of one antenna so far, s; `None` before there were two.
    pub(crate) fn interval_s(&self) -> Option<f64> {
        self.matcher.interval_s()
    }

    /// Number of antennas that have any epoch at all.
    pub(crate) fn antennas_with_epochs(&self) -> usize {
        self.streams.iter().filter(|s| s.span.is_some()).count()
    }

    /// Fills `epoch` with the next instant ([`Matcher`]). `false` at the end of all files.
    pub(crate) fn next(&mut self, epoch: &mut ArrayEpoch) -> anyhow::Result<bool> {
        let Some(next) = self.next_match(epoch)? else { return Ok(false) };
        let station = epoch.station.take();
        *epoch = ArrayEpoch { station, ..next };
        self.match_station(epoch, self.matcher.window_s())?;
        Ok(true)
    }

    /// The next instant; the buffers of `done` are filled again.
    fn next_match(&mut self, done: &mut ArrayEpoch) -> anyhow::Result<Option<ArrayEpoch>> {
        for (antenna, stream) in self.streams.iter_mut().enumerate() {
            // An epoch that comes too late is dropped, and the next one may be in time.
            while self.matcher.waiting(antenna) == 0 {
                let Some(epoch) = stream.next.take() else {
                    self.matcher.leave(antenna);
                    break;
                };
                self.received.hold(antenna, epoch.time, stream.reader.take_news());
                stream.next = stream.read(reclaim(done, antenna))?;
                if let Some(next) = &stream.next {
                    self.matcher.expect_interval(next.time - epoch.time);
                }
                let found = self.matcher.push(antenna, epoch, NO_CLOCK_S);
                if found.is_some() {
                    return Ok(found);
                }
            }
        }
        Ok(self.matcher.poll(NO_CLOCK_S))
    }

    /// Navigation data that the logs brought before `epoch`, the one that was given last, where
    /// they count as received.
    pub(crate) fn news(&mut self, epoch: &ArrayEpoch) -> Vec<NavigationData> {
        self.received.release(epoch)
    }

    /// Gives the epoch the station's observations of the same time, and passes over older ones.
    fn match_station(&mut self, epoch: &mut ArrayEpoch, window_s: f64) -> anyhow::Result<()> {
        let Some(station) = &mut self.station else { return Ok(()) };
        let number = self.streams.len();
        let passed = |next: &mut AntennaEpoch| next.time - epoch.time <= -window_s;
        while let Some(next) = station.next.take_if(passed) {
            self.received.hold(number, next.time, station.reader.take_news());
            station.next = station.read(next)?;
        }
        let belongs = |next: &mut AntennaEpoch| next.time - epoch.time < window_s;
        if let Some(next) = station.next.take_if(belongs) {
            self.received.hold(number, next.time, station.reader.take_news());
            let read = epoch.station.replace(next).unwrap_or_default();
            station.next = station.read(read)?;
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

    /// Epochs that are in no row, as rows of their time had gone out without them.
    pub(super) fn late(&self) -> impl Iterator<Item = Damage> {
        let counts = self.streams.iter().enumerate().map(|(i, s)| (&s.name, self.matcher.late(i)));
        counts.filter(|(_, count)| *count > 0).map(|(name, count)| {
            let what = "epochs are too near behind those before them for rows of their own";
            Damage::at(format!("antenna {name}"), 0, format!("{count} {what}"))
        })
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
    /// Reads the next epoch into `buffer`; `None` at the end.
    fn read(&mut self, mut buffer: AntennaEpoch) -> anyhow::Result<Option<AntennaEpoch>> {
        let context = || format!("antenna {}", self.name);
        loop {
            if !self.reader.next_epoch(&mut buffer).with_context(context)?
                || self.window.is_after(buffer.time)
            {
                return Ok(None);
            }
            if self.window.contains(buffer.time) {
                self.span = Some((self.span.map_or(buffer.time, |(first, _)| first), buffer.time));
                return Ok(Some(buffer));
            }
        }
    }
}

/// The buffer of an antenna in an epoch that is done with.
fn reclaim(epoch: &mut ArrayEpoch, antenna: usize) -> AntennaEpoch {
    epoch.antennas.get_mut(antenna).and_then(Option::take).unwrap_or_default()
}

/// Bytes of a file; `None` for what is not a file.
fn size(file: &Path) -> Option<u64> {
    std::fs::metadata(file).ok().filter(std::fs::Metadata::is_file).map(|data| data.len())
}
