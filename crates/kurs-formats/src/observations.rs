//! Observations of one antenna from a file of any format, found by its content.

use std::collections::BTreeMap;
use std::io::Read;
use std::path::Path;

use kurs::ephemeris::NavigationData;
use kurs::frames::{Ecef, Vector};
use kurs::observation::AntennaEpoch;
use kurs::signal::System;
use kurs::time::GpsTime;

use crate::content::Content;
use crate::damage::Damage;
use crate::fingerprint::Fingerprint;
use crate::logs::start::{self, Start};
use crate::logs::{LogOptions, LogReader, Protocol};
use crate::rinex::observation::{EventLog, ObservationHeader, ObservationReader};
use crate::source::{ReadError, Source, can_be_read_again};

/// What the errors call a readable file.
const EXPECTED: &str = "observations: RINEX 2, 3 or 4, plain, compact (CRINEX) or packed with gzip; \
    or a receiver log: UBX, RTCM 3, SBF";

/// A file with observations, opened.
#[derive(Debug)]
pub enum ObservationSource {
    /// RINEX 2, 3 or 4, compact or not.
    Rinex(Box<ObservationReader>),
    /// A receiver log: UBX, RTCM 3 or SBF.
    Log(Box<LogReader>),
}

impl ObservationSource {
    /// Opens a file and finds its format.
    ///
    /// # Errors
    ///
    /// [`ReadError`] if it cannot be read or holds something else than observations.
    pub fn open(path: impl AsRef<Path>) -> Result<Self, ReadError> {
        Self::open_with(path, &LogOptions::default())
    }

    /// As [`ObservationSource::open`], with what a log does not say by itself. A log may be read
    /// twice: what tells its date, and the first observations, may come late in it. A pipe is read
    /// once, as by [`ObservationSource::from_source_with`].
    ///
    /// # Errors
    ///
    /// As [`ObservationSource::open`].
    pub fn open_with(path: impl AsRef<Path>, options: &LogOptions) -> Result<Self, ReadError> {
        if !can_be_read_again(&path) {
            return Self::from_source_with(Source::open(path)?, options);
        }
        Self::with_start(Source::open(&path)?, options, |_, wanted, near| {
            start::look(&mut Source::open(path)?, wanted, near)
        })
    }

    /// Wraps a stream and finds its format; `name` stands for it in messages.
    ///
    /// # Errors
    ///
    /// As [`ObservationSource::open`].
    pub fn new(
        input: impl Read + Send + 'static,
        name: impl Into<String>,
    ) -> Result<Self, ReadError> {
        Self::from_source(Source::new(input, name)?)
    }

    /// Finds the format of a source at its start.
    ///
    /// # Errors
    ///
    /// As [`ObservationSource::open`].
    pub fn from_source(source: Source) -> Result<Self, ReadError> {
        Self::from_source_with(source, &LogOptions::default())
    }

    /// As [`ObservationSource::from_source`], with what a log does not say by itself. Observations,
    /// and the date of an RTCM 3 log, must stand in its first [`Source::BUFFER_SIZE`] bytes or in
    /// `options`.
    ///
    /// # Errors
    ///
    /// As [`ObservationSource::open`].
    pub fn from_source_with(source: Source, options: &LogOptions) -> Result<Self, ReadError> {
        Self::with_start(source, options, |source, wanted, near| {
            let first = source.start(Source::BUFFER_SIZE)?.to_vec();
            start::look(&mut Source::new(std::io::Cursor::new(first), "")?, wanted, near)
        })
    }

    fn with_start(
        mut source: Source,
        options: &LogOptions,
        look: impl FnOnce(&mut Source, Option<Protocol>, Option<GpsTime>) -> Result<Start, ReadError>,
    ) -> Result<Self, ReadError> {
        let content = Content::of(source.start(Content::ENOUGH)?);
        if matches!(content, Content::RinexObservation | Content::CompactRinex) {
            return Ok(Self::Rinex(Box::new(ObservationReader::from_source(source)?)));
        }
        let found = content.protocol();
        if found.is_none() && content != Content::Nmea {
            return Err(source.wrong_content(content.to_string(), EXPECTED));
        }
        let near = options.near(source.name());
        let start = look(&mut source, options.chosen_protocol(), near)?;
        // Sentences of NMEA may stand in front of a log for long.
        let Some(found) = found.or(start.found.filter(|_| start.observing.is_some())) else {
            return Err(source.wrong_content(content.to_string(), EXPECTED));
        };
        Ok(Self::Log(Box::new(LogReader::new(source, found, options, start)?)))
    }

    /// Reads the next epoch into `epoch`; `false` at the end of the file.
    ///
    /// # Errors
    ///
    /// [`ReadError::Io`] if the operating system refuses to read on.
    pub fn next_epoch(&mut self, epoch: &mut AntennaEpoch) -> Result<bool, ReadError> {
        match self {
            Self::Rinex(reader) => reader.next_epoch(epoch),
            Self::Log(reader) => reader.next_epoch(epoch),
        }
    }

    /// Leaves out the systems that are not wanted, where the format allows to pass over them
    /// unread: RINEX does.
    pub fn keep_systems(&mut self, wanted: impl Fn(System) -> bool) {
        match self {
            Self::Rinex(reader) => reader.keep_systems(wanted),
            Self::Log(_) => {}
        }
    }

    /// Navigation data that came before the epoch that was read last: of a log that is read as
    /// received ([`LogReader::take_news`]).
    pub fn take_news(&mut self) -> NavigationData {
        match self {
            Self::Rinex(_) => NavigationData::default(),
            Self::Log(reader) => reader.take_news(),
        }
    }

    /// The header as it stands after the last epoch that was read; logs have none.
    #[must_use]
    pub const fn header(&self) -> Option<&ObservationHeader> {
        match self {
            Self::Rinex(reader) => Some(reader.header()),
            Self::Log(_) => None,
        }
    }

    /// Whether the date is known: logs of RTCM 3 may tell the time of some week only.
    #[must_use]
    pub const fn is_dated(&self) -> bool {
        match self {
            Self::Rinex(_) => true,
            Self::Log(reader) => reader.is_dated(),
        }
    }

    /// Where the file says that the antenna is: the approximate position of a header; the place of
    /// a station in an RTCM 3 log, as of the messages so far.
    #[must_use]
    pub fn stated_position_m(&self) -> Option<Vector<Ecef>> {
        match self {
            Self::Rinex(reader) => reader.header().approximate_position_m,
            Self::Log(reader) => reader.place_m(),
        }
    }

    /// GLONASS frequency channel of each orbital slot, as far as the file tells.
    #[must_use]
    pub const fn glonass_channels(&self) -> &BTreeMap<u8, i8> {
        match self {
            Self::Rinex(reader) => reader.glonass_channels(),
            Self::Log(reader) => reader.glonass_channels(),
        }
    }

    /// What was skipped so far, the first [`DamageLog::LISTED_MAX`] entries of it.
    ///
    /// [`DamageLog::LISTED_MAX`]: crate::damage::DamageLog::LISTED_MAX
    #[must_use]
    pub fn damage(&self) -> &[Damage] {
        match self {
            Self::Rinex(reader) => reader.damage(),
            Self::Log(reader) => reader.damage(),
        }
    }

    /// How much was skipped so far, the unlisted included.
    #[must_use]
    pub const fn damage_count(&self) -> u64 {
        match self {
            Self::Rinex(reader) => reader.damage_count(),
            Self::Log(reader) => reader.damage_count(),
        }
    }

    /// What happened between the observations so far; logs do not tell.
    #[must_use]
    pub const fn events(&self) -> Option<&EventLog> {
        match self {
            Self::Rinex(reader) => Some(reader.events()),
            Self::Log(_) => None,
        }
    }

    /// Name of the file.
    #[must_use]
    pub fn name(&self) -> &str {
        match self {
            Self::Rinex(reader) => reader.name(),
            Self::Log(reader) => reader.name(),
        }
    }

    /// Bytes of the file that were read so far.
    #[must_use]
    pub fn bytes_read(&self) -> u64 {
        match self {
            Self::Rinex(reader) => reader.bytes_read(),
            Self::Log(reader) => reader.bytes_read(),
        }
    }

    /// What the file holds, once it was read to its end.
    #[must_use]
    pub fn fingerprint(&self) -> Option<Fingerprint> {
        match self {
            Self::Rinex(reader) => reader.fingerprint(),
            Self::Log(reader) => reader.fingerprint(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn other_content_is_named() {
        let navigation =
            format!("{:<60}RINEX VERSION / TYPE\n", "     3.04           N: GNSS NAV DATA");
        for (content, found) in [
            (navigation.as_str(), "a RINEX navigation file"),
            ("", "an empty file"),
            ("#dP2023  2 19  0  0  0.00000000", "an SP3 orbit file"),
            ("\u{1}\u{2}\u{ff}", "neither text nor a known format"),
        ] {
            let bytes = std::io::Cursor::new(content.as_bytes().to_vec());
            let error = ObservationSource::new(bytes, "x.obs").unwrap_err().to_string();
            assert!(error.starts_with("x.obs: found ") && error.contains(found), "{error}");
            assert!(error.contains("expected observations"), "{error}");
        }
    }
}
