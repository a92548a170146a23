//! The engine of a configuration, to which observations come one by one: as `kurs live` solves,
//! without streams and without a clock of its own.

use std::collections::VecDeque;
use std::path::Path;

use kurs::differential::Differential;
use kurs::ephemeris::{AsReceived, NavigationData};
use kurs::observation::matcher::{Deadline, Matcher};
use kurs::observation::{AntennaEpoch, ArrayEpoch};
use kurs::time::GpsTime;
use kurs_formats::logs::LogOptions;
use kurs_formats::source::{ReadError, Source};

use super::Failure;
use super::decoder::{ByteDecoder, Decoded};
use super::station::StationEpochs;
use crate::copies::Copies;
use crate::failure::UsageError;
use crate::live::navigation_files;
use crate::solve::config::{self, Loaded, Overrides};
use crate::solve::{self, antenna_names, phase_centers};
use crate::tables::{ATTITUDE, BASELINES, POINTS, Tables};

/// The rows of the epochs that were completed, as lines of CSV without a header.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Rows {
    /// Rows of `attitude.csv`.
    pub attitude: Vec<u8>,
    /// Rows of `baselines.csv`.
    pub baselines: Vec<u8>,
    /// Rows of `points.csv`.
    pub points: Vec<u8>,
    /// Rows of `antennas.csv`: coordinates by code differences to a station.
    pub by_code: Vec<u8>,
}

impl Rows {
    /// The columns of the four tables.
    pub const COLUMNS: [&[&str]; 4] = [ATTITUDE, BASELINES, POINTS, POINTS];
}

/// See the module.
#[derive(Debug)]
pub struct EmbeddedEngine {
    /// Name of each antenna, and of the station behind them, and how its bytes are read.
    sources: Vec<(String, LogOptions)>,
    decoders: Vec<Option<ByteDecoder>>,
    received: AsReceived,
    matcher: Matcher,
    /// Matched epochs of the antennas, whose rows wait for the station.
    matched: VecDeque<ArrayEpoch>,
    station: Option<StationEpochs>,
    engine: Differential,
    copies: Copies,
    tables: Tables<Vec<u8>>,
}

impl EmbeddedEngine {
    /// The engine of a configuration file with keys set as by `--set`; its observation files, if it
    /// names any, are not read. With `deadline_s` an epoch goes that long after its first antenna
    /// came, by the times that the caller passes in, with the newest epoch of the station
    /// (`max_age_s`); without it every row waits for the station's epoch of its time.
    ///
    /// # Errors
    ///
    /// [`Failure`] as of `kurs live`.
    pub fn open(file: &Path, set: &[String], deadline_s: Option<f64>) -> Result<Self, Failure> {
        Ok(Self::opened(file, set, deadline_s)?)
    }

    fn opened(file: &Path, set: &[String], deadline_s: Option<f64>) -> anyhow::Result<Self> {
        let overrides = Overrides { set, is_live: true, ..Overrides::default() };
        let loaded = config::load(Some(file), &overrides)?;
        let navigation = navigation_files(&loaded)?;
        let phase_centers = phase_centers::read(&loaded, &mut Vec::new())?;
        let known_time = kurs_live::newest_reference_time(&navigation);
        let engine = solve::engine(&loaded, loaded.settings()?, navigation, phase_centers.mounts)?;
        let names = antenna_names(&loaded);
        let matcher = match deadline_s {
            None => Matcher::new(names.len()),
            Some(s) if s > 0.0 && s.is_finite() => {
                Matcher::new(names.len()).with_deadline(Deadline::Seconds(s))
            }
            Some(s) => {
                let text = format!("deadline_s is {s}, expected a positive number of seconds");
                return Err(UsageError(text).into());
            }
        };
        let points = loaded.config.point.iter().map(|point| point.name.clone()).collect();
        let sources = sources(&loaded, known_time);
        let station = match &loaded.config.station {
            Some(table) => {
                table.check_has_place()?;
                let max_age_s = table.max_age_s()?;
                Some(StationEpochs::new(deadline_s.map(|_| max_age_s)))
            }
            None => None,
        };
        Ok(Self {
            decoders: sources.iter().map(|_| None).collect(),
            sources,
            received: AsReceived::new(names.len()),
            matcher,
            matched: VecDeque::new(),
            tables: Tables::in_memory(names, points, station.is_some()),
            station,
            engine,
            copies: Copies::default(),
        })
    }

    /// Names of the antennas, in the order of the configuration; behind them `station` if there is
    /// one. Their places are the numbers that [`EmbeddedEngine::push`] wants.
    pub fn sources(&self) -> impl Iterator<Item = &str> {
        self.sources.iter().map(|(name, _)| name.as_str())
    }

    /// Takes navigation data that count from now on.
    pub fn insert(&mut self, news: &NavigationData) {
        self.engine.insert(news);
    }

    /// Takes navigation data of the bytes of a file or log.
    ///
    /// # Errors
    ///
    /// [`Failure::Input`] if they are no navigation data.
    pub fn insert_bytes(&mut self, bytes: &[u8]) -> Result<(), Failure> {
        let wrong = |error: ReadError| Failure::Input(error.to_string());
        let bytes = std::io::Cursor::new(bytes.to_vec());
        let mut source = Source::new(bytes, "navigation data".to_owned()).map_err(wrong)?;
        let mut news = NavigationData::default();
        kurs_formats::navigation::read(&mut source, &mut news).map_err(wrong)?;
        self.insert(&news);
        Ok(())
    }

    /// Takes an epoch of one antenna or the station that came at `now_s`, by any clock that does
    /// not go back.
    ///
    /// # Errors
    ///
    /// Rows that cannot be written.
    pub fn push(
        &mut self,
        antenna: usize,
        epoch: AntennaEpoch,
        now_s: f64,
    ) -> Result<Rows, Failure> {
        self.take(antenna, vec![(epoch, NavigationData::default())], now_s)
    }

    /// Takes bytes of an antenna's receiver (UBX, RTCM 3, SBF) that came at `now_s`.
    ///
    /// # Errors
    ///
    /// [`Failure::Input`] if nothing can be made of them.
    pub fn push_bytes(
        &mut self,
        antenna: usize,
        bytes: &[u8],
        now_s: f64,
    ) -> Result<Rows, Failure> {
        let (name, options) = &self.sources[antenna];
        let decoder = self.decoders[antenna].get_or_insert_with(|| ByteDecoder::new(name, options));
        let (decoded, error) = decoder.push(bytes);
        if error.is_some() {
            // The next bytes begin a new stream.
            self.decoders[antenna] = None;
        }
        let rows = self.take(antenna, decoded, now_s)?;
        error.map_or(Ok(rows), |what| Err(Failure::Input(what)))
    }

    /// The rows that are due at `now_s`, by their deadline.
    ///
    /// # Errors
    ///
    /// As [`EmbeddedEngine::push`].
    pub fn poll(&mut self, now_s: f64) -> Result<Rows, Failure> {
        while let Some(epoch) = self.matcher.poll(now_s) {
            self.matched.push_back(epoch);
        }
        while let Some(epoch) = self.next_ready() {
            self.solve(epoch)?;
        }
        Ok(self.rows())
    }

    /// All rows that are left: nothing more of these streams will come.
    ///
    /// # Errors
    ///
    /// As [`EmbeddedEngine::push`].
    pub fn flush(&mut self, now_s: f64) -> Result<Rows, Failure> {
        for antenna in 0..self.decoders.len() {
            if let Some(decoder) = self.decoders[antenna].take() {
                let (decoded, _) = decoder.finish();
                self.enter(antenna, decoded, now_s);
            }
        }
        while let Some(epoch) = self.matcher.flush(now_s) {
            self.matched.push_back(epoch);
        }
        while let Some(epoch) = self.matched.pop_front() {
            self.solve(epoch)?;
        }
        Ok(self.rows())
    }

    fn take(&mut self, antenna: usize, decoded: Vec<Decoded>, now_s: f64) -> Result<Rows, Failure> {
        self.enter(antenna, decoded, now_s);
        self.poll(now_s)
    }

    fn enter(&mut self, antenna: usize, decoded: Vec<Decoded>, now_s: f64) {
        for (epoch, news) in decoded {
            self.received.hold(antenna, epoch.time, news);
            match &mut self.station {
                Some(station) if antenna + 1 == self.sources.len() => station.push(epoch),
                _ => self.matched.extend(self.matcher.push(antenna, epoch, now_s)),
            }
        }
    }

    /// The next epoch that has nothing to wait for.
    fn next_ready(&mut self) -> Option<ArrayEpoch> {
        let (station, window_s) = (self.station.as_ref(), self.matcher.window_s());
        let is_ready = |epoch: &mut ArrayEpoch| {
            station.is_none_or(|station| station.is_ready(epoch.time, window_s))
        };
        self.matched.pop_front_if(is_ready)
    }

    fn solve(&mut self, mut epoch: ArrayEpoch) -> Result<(), Failure> {
        let (time, window_s) = (epoch.time, self.matcher.window_s());
        epoch.station = self.station.as_mut().and_then(|station| station.at(time, window_s));
        for news in self.received.release(&epoch) {
            self.engine.insert(&news);
        }
        let mut row = self.engine.push(&epoch, None);
        if self.copies.add(&epoch) {
            solve::refuse_zero_baseline(&mut row);
        }
        Ok(self.tables.write(&row)?)
    }

    fn rows(&mut self) -> Rows {
        let [attitude, baselines, points, by_code] = self.tables.take_text();
        Rows { attitude, baselines, points, by_code }
    }
}

/// Name of each antenna, and of the station, and how its bytes are read.
fn sources(loaded: &Loaded, known_time: Option<GpsTime>) -> Vec<(String, LogOptions)> {
    let approximate_time = known_time.or(loaded.approximate_time());
    let options = LogOptions { approximate_time, as_received: true, ..LogOptions::default() };
    let antennas = loaded.config.antenna.iter().map(|a| {
        let (protocol, station, antenna) = (a.protocol, a.station_id, a.antenna_id);
        (a.name.clone(), LogOptions { protocol, station, antenna, ..options })
    });
    let station = loaded.config.station.iter().map(|s| {
        let (protocol, station, antenna) = (s.protocol, s.station_id, s.antenna_id);
        ("station".to_owned(), LogOptions { protocol, station, antenna, ..options })
    });
    antennas.chain(station).collect()
}
