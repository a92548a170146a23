//! Observation files of RINEX 2.10 to 4.02, read epoch by epoch into one reused buffer.
//!
//! Sources: RINEX 2.11, sections 5 to 10 and table A1/A2; RINEX 3.05 and 4.02, section 5 and the
//! tables of header and observation records; for compact files see `compact.rs`.

mod columns;
mod compact;
mod epoch_line;
mod epochs;
mod events;
mod fields;
mod header;
mod lines;
mod satellites;
mod type_list;

use std::collections::BTreeMap;
use std::io::Read;
use std::path::Path;

use kurs::observation::AntennaEpoch;
use kurs::signal::System;

use self::compact::CompactLines;
use self::epochs::EpochReader;
pub use self::events::{Event, EventKind, EventLog};
pub use self::header::{
    ObservationCode, ObservationHeader, PhaseShift, ScaleFactor, TimeSystem, Version,
};
use self::lines::Lines;
use super::fields::{columns, label, text};
use crate::content::Content;
use crate::damage::Damage;
use crate::epoch_order::Ordered;
use crate::fingerprint::Fingerprint;
use crate::source::{ReadError, Source};

/// What the errors call a readable file.
const EXPECTED: &str = "a RINEX observation file (2.10 to 4.02, also compact or packed with gzip)";

/// Reads an observation file from its start to its end.
///
/// * Every satellite and signal becomes one [`Observation`](kurs::observation::Observation);
///   numbers that are blank or zero are missing, and an observation with nothing in it is left out.
///   Scale factors are divided out.
/// * RINEX 2 names the code of pseudoranges only. Phase, Doppler and strength of a band belong to
///   one code for the whole header: on band 1 the C/A code if the file has `C1`, else P; on band 2
///   the P code if the file has `P2`, else the civil code. `P` of GPS is `W`.
/// * BeiDou's B1I is band 2, also where an old file calls it band 1.
/// * The digits of the phase are in [`Lock`](kurs::observation::Lock) as they are (bit 2, values
///   above 7 too). Slip records mark the next phase of their satellite, and so does a phase that
///   was lost in damage: its digit is not known.
/// * Times are converted to the GPS scale (GLONASS files count UTC, BeiDou files BeiDou time).
/// * Epochs come out with increasing times. One that is not later than the epoch before is
///   skipped; one that jumps far ahead is skipped if the next one is earlier.
/// * What cannot be used is listed in [`ObservationReader::damage`], and reading goes on behind it.
#[derive(Debug)]
pub struct ObservationReader {
    epochs: Ordered<EpochReader>,
}

impl ObservationReader {
    /// Opens a file and reads its header.
    ///
    /// # Errors
    ///
    /// [`ReadError`] if the file cannot be read, is something else, or its header declares no
    /// observations.
    pub fn open(path: impl AsRef<Path>) -> Result<Self, ReadError> {
        Self::from_source(Source::open(path)?)
    }

    /// Wraps a stream and reads the header; `name` stands for it in messages.
    ///
    /// # Errors
    ///
    /// As [`ObservationReader::open`].
    pub fn new(
        input: impl Read + Send + 'static,
        name: impl Into<String>,
    ) -> Result<Self, ReadError> {
        Self::from_source(Source::new(input, name)?)
    }

    /// Reads the header from a source at its start.
    ///
    /// # Errors
    ///
    /// As [`ObservationReader::open`].
    pub fn from_source(source: Source) -> Result<Self, ReadError> {
        let (lines, header) = open_lines(source)?;
        Ok(Self { epochs: Ordered::new(EpochReader::new(lines, header)?) })
    }

    /// Leaves out the systems that are not wanted: their lines are passed over unread.
    pub fn keep_systems(&mut self, wanted: impl Fn(System) -> bool) {
        self.epochs.raw.satellites.passed_over = System::ALL.map(|system| !wanted(system));
    }

    /// The header as it stands after the last epoch that was read.
    #[must_use]
    pub const fn header(&self) -> &ObservationHeader {
        &self.epochs.raw.header
    }

    /// GLONASS frequency channel of each orbital slot that the header tells.
    #[must_use]
    pub const fn glonass_channels(&self) -> &BTreeMap<u8, i8> {
        &self.epochs.raw.header.glonass_channels
    }

    /// What was skipped so far, the first [`DamageLog::LISTED_MAX`] entries of it.
    ///
    /// [`DamageLog::LISTED_MAX`]: crate::damage::DamageLog::LISTED_MAX
    #[must_use]
    pub fn damage(&self) -> &[Damage] {
        self.epochs.raw.damage.listed()
    }

    /// How much was skipped so far, the unlisted included.
    #[must_use]
    pub const fn damage_count(&self) -> u64 {
        self.epochs.raw.damage.total()
    }

    /// What happened between the observations so far: power failures, moves, external events.
    #[must_use]
    pub const fn events(&self) -> &EventLog {
        &self.epochs.raw.events
    }

    /// Fields of signals that were not blank so far: observations as the file counts them, zeros
    /// (which mean a missing observation) and skipped epochs included.
    #[must_use]
    pub const fn field_count(&self) -> u64 {
        self.epochs.raw.field_count
    }

    /// Name of the file.
    #[must_use]
    pub fn name(&self) -> &str {
        self.epochs.raw.lines.source().name()
    }

    /// Bytes of the file that were read so far.
    #[must_use]
    pub fn bytes_read(&self) -> u64 {
        self.epochs.raw.lines.source().bytes_read()
    }

    /// What the file holds, once it was read to its end.
    #[must_use]
    pub fn fingerprint(&self) -> Option<Fingerprint> {
        self.epochs.raw.lines.source().fingerprint()
    }

    /// Reads the next epoch into `epoch`; `false` (and no observations) at the end of the file.
    ///
    /// # Errors
    ///
    /// [`ReadError::Io`] if the operating system refuses to read on.
    pub fn next_epoch(&mut self, epoch: &mut AntennaEpoch) -> Result<bool, ReadError> {
        self.epochs.next_epoch(epoch)
    }
}

/// Finds the RINEX header and reads its first record.
fn open_lines(mut source: Source) -> Result<(Lines, ObservationHeader), ReadError> {
    let content = Content::of(source.start(Content::ENOUGH)?);
    if !matches!(content, Content::RinexObservation | Content::CompactRinex) {
        return Err(source.wrong_content(content.to_string(), EXPECTED));
    }
    let mut compact_version = None;
    while source.advance()? {
        match label(source.line()) {
            b"CRINEX VERS   / TYPE" => {
                let version = Version::parse(columns(source.line(), 0..9)).map_or(0, |v| v.major);
                if !matches!(version, 1 | 3) {
                    let found = format!("compact RINEX version {:?}", text(source.line(), 0..20));
                    return Err(source.wrong_content(found, EXPECTED));
                }
                compact_version = Some(version);
            }
            b"RINEX VERSION / TYPE" => {
                let header = first_record(source.line())
                    .map_err(|found| source.wrong_content(found, EXPECTED))?;
                let lines = match compact_version {
                    None => Lines::Plain(source),
                    Some(version) => {
                        Lines::Compact(Box::new(CompactLines::new(source, version, header.system)))
                    }
                };
                return Ok((lines, header));
            }
            _ => {}
        }
    }
    Err(source.wrong_content("no RINEX header", EXPECTED))
}

/// Version and system of the file; the error says what was found in place of a readable version.
fn first_record(line: &[u8]) -> Result<ObservationHeader, String> {
    let version = Version::parse(columns(line, 0..9));
    let Some(version) = version.filter(|version| (2..=4).contains(&version.major)) else {
        return Err(format!("RINEX version {:?}", text(line, 0..20)));
    };
    let system = match columns(line, 40..41) {
        [b' '] | [] => Some(System::Gps),
        [letter, ..] => System::from_letter(*letter),
    };
    Ok(ObservationHeader::new(version, system))
}
