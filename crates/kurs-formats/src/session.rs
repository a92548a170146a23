//! Several files of one antenna in time order, read as if they were one.

use std::collections::VecDeque;
use std::path::{Path, PathBuf};

use kurs::observation::AntennaEpoch;
use kurs::time::GpsTime;

use crate::damage::Damage;
use crate::logs::LogOptions;
use crate::observations::ObservationSource;
use crate::source::ReadError;

/// Reads the epochs of one file after the other.
///
/// Each file has its own header, which is in force for its epochs. Epochs of a file that are not
/// later than what came before are skipped, and noted in the damage of that file.
#[derive(Debug)]
pub struct SessionReader {
    current: ObservationSource,
    waiting: VecDeque<PathBuf>,
    options: LogOptions,
    last: Option<GpsTime>,
    /// Epochs of the current file that are not later than the files before.
    overlapping: u64,
    /// Of the files that are behind.
    damage: Vec<FileDamage>,
    damage_count: u64,
}

/// Damage with the file that it is in.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FileDamage {
    /// Name of the file.
    pub file: String,
    /// Line, and what was wrong.
    pub damage: Damage,
}

impl SessionReader {
    /// Opens the files; every one is opened once now, so that a wrong one is found before the work.
    ///
    /// # Errors
    ///
    /// [`ReadError`] of the first file that cannot be used; [`ReadError::NoFile`] for an empty list.
    pub fn open<P: AsRef<Path>>(paths: impl IntoIterator<Item = P>) -> Result<Self, ReadError> {
        Self::open_with(paths, LogOptions::default())
    }

    /// As [`SessionReader::open`], with what receiver logs do not say by themselves.
    ///
    /// # Errors
    ///
    /// As [`SessionReader::open`].
    pub fn open_with<P: AsRef<Path>>(
        paths: impl IntoIterator<Item = P>,
        options: LogOptions,
    ) -> Result<Self, ReadError> {
        let mut paths = paths.into_iter();
        let first = paths.next().ok_or(ReadError::NoFile)?;
        let current = ObservationSource::open_with(first, &options)?;
        let waiting: VecDeque<PathBuf> = paths.map(|path| path.as_ref().to_owned()).collect();
        for path in &waiting {
            ObservationSource::open_with(path, &options)?;
        }
        let (damage, damage_count) = (Vec::new(), 0);
        Ok(Self { current, waiting, options, last: None, overlapping: 0, damage, damage_count })
    }

    /// Reads the next epoch into `epoch`; `false` at the end of the last file.
    ///
    /// # Errors
    ///
    /// [`ReadError`] if a file cannot be read (any more).
    pub fn next_epoch(&mut self, epoch: &mut AntennaEpoch) -> Result<bool, ReadError> {
        loop {
            if !self.current.next_epoch(epoch)? {
                self.note_overlap();
                let Some(path) = self.waiting.pop_front() else { return Ok(false) };
                self.damage = self.damage();
                self.damage_count = self.damage_count();
                self.current = ObservationSource::open_with(path, &self.options)?;
            } else if self.last.is_none_or(|last| epoch.time > last) {
                self.note_overlap();
                self.last = Some(epoch.time);
                return Ok(true);
            } else {
                self.overlapping += 1;
            }
        }
    }

    fn note_overlap(&mut self) {
        let epochs = core::mem::take(&mut self.overlapping);
        if epochs > 0 {
            let what = "epochs are not later than the end of the file before, skipped";
            let damage = Damage { line: 1, what: format!("{epochs} {what}").into() };
            self.damage.push(FileDamage { file: self.current.name().to_owned(), damage });
            self.damage_count += 1;
        }
    }

    /// The file that is being read.
    #[must_use]
    pub const fn current(&self) -> &ObservationSource {
        &self.current
    }

    /// What was skipped so far, with the name of the file.
    #[must_use]
    pub fn damage(&self) -> Vec<FileDamage> {
        let file = self.current.name();
        let current = self.current.damage().iter();
        let current = current.map(|d| FileDamage { file: file.to_owned(), damage: d.clone() });
        self.damage.iter().cloned().chain(current).collect()
    }

    /// How much was skipped so far, the unlisted included.
    #[must_use]
    pub const fn damage_count(&self) -> u64 {
        self.damage_count + self.current.damage_count()
    }
}
