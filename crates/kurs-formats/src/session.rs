//! Several files of one antenna, read in time order as if they were one.

use std::collections::{BTreeMap, VecDeque};
use std::path::{Path, PathBuf};

use kurs::ephemeris::NavigationData;
use kurs::observation::AntennaEpoch;
use kurs::signal::System;
use kurs::time::GpsTime;

use crate::damage::Damage;
use crate::fingerprint::Fingerprint;
use crate::logs::LogOptions;
use crate::observations::ObservationSource;
use crate::source::{ReadError, can_be_read_again};

/// Reads the epochs of one file after the other.
///
/// The files are read in the order of their first epochs, whatever the order in which they are
/// given (pipes, which can be read only once, as they are given). Each has its own header, which is
/// in force for its epochs. Epochs of a file that are not later than what came before are skipped,
/// and noted in the damage of that file.
#[derive(Debug)]
pub struct SessionReader {
    current: ObservationSource,
    waiting: VecDeque<PathBuf>,
    options: LogOptions,
    /// In the order of [`System::ALL`].
    wanted: [bool; System::ALL.len()],
    /// Channels by orbital slot, from all files that were looked into.
    glonass_channels: BTreeMap<u8, i8>,
    last: Option<GpsTime>,
    /// Epochs of the current file that are not later than the files before.
    overlapping: u64,
    /// Damage of the files that are done.
    damage: Vec<FileDamage>,
    damage_count: u64,
    /// Bytes of the files that are done.
    bytes_read: u64,
    /// Fingerprints of the files that are done, by name.
    fingerprints: Vec<(String, Fingerprint)>,
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
    /// Opens the files; of several every one is read up to its first epoch, so that a wrong one is
    /// found before the work.
    ///
    /// # Errors
    ///
    /// [`ReadError`] of the first file that cannot be used; [`ReadError::NoFile`] for an empty
    /// list.
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
        let paths: Vec<PathBuf> = paths.into_iter().map(|path| path.as_ref().to_owned()).collect();
        let mut glonass_channels = BTreeMap::new();
        let mut waiting = if paths.len() > 1 && paths.iter().all(can_be_read_again) {
            in_time_order(paths, &options, &mut glonass_channels)?
        } else {
            VecDeque::from(paths)
        };
        let first = waiting.pop_front().ok_or(ReadError::NoFile)?;
        Ok(Self {
            current: ObservationSource::open_with(first, &options)?,
            waiting,
            options,
            wanted: [true; System::ALL.len()],
            glonass_channels,
            last: None,
            overlapping: 0,
            damage: Vec::new(),
            damage_count: 0,
            bytes_read: 0,
            fingerprints: Vec::new(),
        })
    }

    /// Leaves out the systems that are not wanted ([`ObservationSource::keep_systems`]).
    pub fn keep_systems(&mut self, wanted: impl Fn(System) -> bool) {
        self.wanted = System::ALL.map(wanted);
        self.current.keep_systems(|system| self.wanted[system as usize]);
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
                self.bytes_read = self.bytes_read();
                self.fingerprints = self.fingerprints();
                self.current = ObservationSource::open_with(path, &self.options)?;
                self.current.keep_systems(|system| self.wanted[system as usize]);
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

    /// GLONASS frequency channel of each orbital slot, as far as the headers of all files and the
    /// messages so far tell.
    #[must_use]
    pub fn glonass_channels(&self) -> BTreeMap<u8, i8> {
        let mut channels = self.glonass_channels.clone();
        channels.extend(self.current.glonass_channels());
        channels
    }

    /// Navigation data that came before the epoch that was read last: of a log that is read as
    /// received ([`LogOptions::as_received`]).
    pub fn take_news(&mut self) -> NavigationData {
        self.current.take_news()
    }

    /// The file that is being read.
    #[must_use]
    pub const fn current(&self) -> &ObservationSource {
        &self.current
    }

    /// Bytes of all files that were read so far.
    #[must_use]
    pub fn bytes_read(&self) -> u64 {
        self.bytes_read + self.current.bytes_read()
    }

    /// What the files hold that were read to their ends, by name.
    #[must_use]
    pub fn fingerprints(&self) -> Vec<(String, Fingerprint)> {
        let current = self.current.fingerprint().map(|f| (self.current.name().to_owned(), f));
        self.fingerprints.iter().cloned().chain(current).collect()
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

/// The files by the time of their first epochs (those without any come first).
fn in_time_order(
    paths: Vec<PathBuf>,
    options: &LogOptions,
    glonass_channels: &mut BTreeMap<u8, i8>,
) -> Result<VecDeque<PathBuf>, ReadError> {
    let mut dated = Vec::with_capacity(paths.len());
    for path in paths {
        let mut source = ObservationSource::open_with(&path, options)?;
        let mut epoch = AntennaEpoch::default();
        let first = source.next_epoch(&mut epoch)?.then_some(epoch.time);
        glonass_channels.extend(source.glonass_channels());
        dated.push((first, path));
    }
    dated.sort_by_key(|(first, _)| *first);
    Ok(dated.into_iter().map(|(_, path)| path).collect())
}
