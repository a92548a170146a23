//! `attitude.nmea`: the sentences of a solution.

use std::io::Write as _;
use std::path::Path;

use kurs::solution::EpochSolution;
use kurs_formats::nmea::{Encoder, Profile};

use crate::output::OutputFile;

/// A log of sentences, one group an epoch.
#[derive(Debug)]
pub(crate) struct NmeaLog {
    file: OutputFile,
    encoder: Encoder,
    text: String,
}

impl NmeaLog {
    /// Starts `directory/attitude.nmea`.
    pub(crate) fn create(directory: &Path, profile: Profile) -> anyhow::Result<Self> {
        let file = OutputFile::create(directory, "attitude.nmea")?;
        Ok(Self { file, encoder: Encoder::new(profile), text: String::new() })
    }

    /// Writes the sentences of one epoch.
    pub(crate) fn write(&mut self, row: &EpochSolution) -> anyhow::Result<()> {
        self.text.clear();
        self.encoder.encode(row, &mut self.text);
        Ok(self.file.write_all(self.text.as_bytes())?)
    }

    /// Gives the file its name.
    pub(crate) fn finish(self) -> anyhow::Result<()> {
        self.file.finish()
    }
}
