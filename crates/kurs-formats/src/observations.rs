//! Observations of one antenna from a file of any format, found by its content.

use std::io::Read;
use std::path::Path;

use kurs::observation::AntennaEpoch;

use crate::damage::Damage;
use crate::rinex::observation::ObservationReader;
use crate::source::{ReadError, Source};

/// A file with observations, opened.
#[derive(Debug)]
pub enum ObservationSource {
    /// RINEX 2, 3 or 4, compact or not.
    Rinex(Box<ObservationReader>),
}

impl ObservationSource {
    /// Opens a file and finds its format.
    ///
    /// # Errors
    ///
    /// [`ReadError`] if it cannot be read or holds something else than observations.
    pub fn open(path: impl AsRef<Path>) -> Result<Self, ReadError> {
        Self::from_source(Source::open(path)?)
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

    fn from_source(source: Source) -> Result<Self, ReadError> {
        Ok(Self::Rinex(Box::new(ObservationReader::from_source(source)?)))
    }

    /// Reads the next epoch into `epoch`; `false` at the end of the file.
    ///
    /// # Errors
    ///
    /// [`ReadError::Io`] if the operating system refuses to read on.
    pub fn next_epoch(&mut self, epoch: &mut AntennaEpoch) -> Result<bool, ReadError> {
        match self {
            Self::Rinex(reader) => reader.next_epoch(epoch),
        }
    }

    /// What was skipped so far.
    #[must_use]
    pub fn damage(&self) -> &[Damage] {
        match self {
            Self::Rinex(reader) => reader.damage(),
        }
    }
}
