//! Observation files of RINEX 2.10 to 4.02, read epoch by epoch into one reused buffer.

mod columns;
mod compact;
mod epoch_line;
mod header;
mod lines;

use std::collections::BTreeMap;
use std::io::Read;
use std::path::Path;

use kurs::observation::{AntennaEpoch, Lock, Observation};
use kurs::signal::{Satellite, Signal, System};
use kurs::time::GpsTime;

use self::columns::{Column, Columns, Quantity};
use self::compact::CompactLines;
use self::epoch_line::{EpochFlag, EpochLine};
use self::header::{HeaderRecords, satellite};
pub use self::header::{
    ObservationCode, ObservationHeader, PhaseShift, ScaleFactor, TimeSystem, Version,
};
use self::lines::Lines;
use super::fields::{Value, columns, f14_3, label, text};
use crate::content::Content;
use crate::damage::{Damage, DamageLog};
use crate::source::{ReadError, Source};

/// Satellites that an epoch can have: the format counts them with three digits.
const SATELLITES_MAX: usize = 999;
/// Width of an observation: F14.3, loss-of-lock digit, strength digit.
const FIELD: usize = 16;
/// Observations in a line of RINEX 2.
const FIELDS_A_LINE: usize = 5;
/// What the errors call a readable file.
const EXPECTED: &str = "a RINEX observation file (2.10 to 4.02, also compact or packed with gzip)";

/// Reads an observation file from its start to its end.
///
/// Every satellite and signal becomes one [`Observation`]; numbers that are blank or zero are
/// missing, and an observation with nothing in it is left out. Times are converted to the GPS
/// scale. Epochs come out with increasing times: one that is not later than the epoch before is
/// skipped and noted as damage. Everything that cannot be used is noted with its line, and reading
/// goes on behind it.
#[derive(Debug)]
pub struct ObservationReader {
    lines: Lines,
    header: ObservationHeader,
    /// One for each system, in the order of [`System::ALL`].
    columns: [Columns; 7],
    satellites: Vec<Option<Satellite>>,
    seen: Seen,
    slips: Vec<(Satellite, Signal)>,
    last: Option<GpsTime>,
    damage: DamageLog,
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
        let mut reader = Self {
            lines: open_lines(source)?,
            header: ObservationHeader::default(),
            columns: Default::default(),
            satellites: Vec::new(),
            seen: Seen::default(),
            slips: Vec::new(),
            last: None,
            damage: DamageLog::default(),
        };
        reader.read_version()?;
        reader.read_header()?;
        Ok(reader)
    }

    /// The header as it stands after the last epoch that was read.
    #[must_use]
    pub const fn header(&self) -> &ObservationHeader {
        &self.header
    }

    /// GLONASS frequency channel of each orbital slot that the header tells.
    #[must_use]
    pub const fn glonass_channels(&self) -> &BTreeMap<u8, i8> {
        &self.header.glonass_channels
    }

    /// What was skipped so far, the first [`DamageLog::LISTED_MAX`] entries of it.
    #[must_use]
    pub fn damage(&self) -> &[Damage] {
        self.damage.listed()
    }

    /// How much was skipped so far, the unlisted included.
    #[must_use]
    pub const fn damage_count(&self) -> u64 {
        self.damage.total()
    }

    /// Name of the file.
    #[must_use]
    pub fn name(&self) -> &str {
        self.lines.source().name()
    }

    /// Reads the next epoch into `epoch`; `false` (and an empty `epoch`) at the end of the file.
    ///
    /// # Errors
    ///
    /// [`ReadError::Io`] if the operating system refuses to read on.
    pub fn next_epoch(&mut self, epoch: &mut AntennaEpoch) -> Result<bool, ReadError> {
        while self.lines.advance(&mut self.damage)? {
            let scale = self.header.time_system;
            let Some(line) = EpochLine::parse(self.lines.line(), self.header.version, scale) else {
                self.skip_to_epoch("not an epoch line")?;
                continue;
            };
            let number = self.lines.line_number();
            match line.flag {
                EpochFlag::Observations | EpochFlag::AfterPowerFailure => {
                    self.read_observations(&line, epoch)?;
                    if self.is_later(epoch.time, number) {
                        self.apply_slips(epoch);
                        return Ok(true);
                    }
                }
                EpochFlag::CycleSlips => {
                    self.read_observations(&line, epoch)?;
                    let slipped = epoch.observations.iter().map(|o| (o.satellite, o.signal));
                    self.slips.extend(slipped);
                    self.slips.sort_unstable();
                    self.slips.dedup();
                }
                EpochFlag::MovingAntenna
                | EpochFlag::NewSite
                | EpochFlag::HeaderRecords
                | EpochFlag::ExternalEvent => self.read_event(line.count)?,
            }
        }
        if let Some(reason) = self.lines.source().broken_off() {
            self.damage.note(self.lines.line_number(), reason.to_owned());
        }
        epoch.observations.clear();
        Ok(false)
    }

    /// The first record of the header; the lines are at it.
    fn read_version(&mut self) -> Result<(), ReadError> {
        let line = self.lines.line();
        let version = Version::parse(columns(line, 0..9));
        let Some(version) = version.filter(|version| (2..=4).contains(&version.major)) else {
            let found = format!("RINEX version {:?}", text(line, 0..20));
            return Err(self.lines.source().wrong_content(found, EXPECTED));
        };
        self.header.version = version;
        self.header.system = match columns(line, 40..41) {
            [b' '] | [] => Some(System::Gps),
            [letter, ..] => System::from_letter(*letter),
        };
        Ok(())
    }

    fn read_header(&mut self) -> Result<(), ReadError> {
        let mut records = HeaderRecords::default();
        loop {
            if !self.lines.advance(&mut self.damage)? {
                return Err(self.lines.source().bad_line("the file ends inside its header"));
            }
            let (line, number) = (self.lines.line(), self.lines.line_number());
            if label(line) == b"END OF HEADER" {
                break;
            }
            let scale = self.header.time_system;
            if EpochLine::parse(line, self.header.version, scale).is_some() {
                self.damage.note(number, "the header has no end, epochs begin here");
                self.lines.hold_line();
                break;
            }
            records.read(&mut self.header, line, number, &mut self.damage);
        }
        if self.header.observation_types.is_empty() {
            return Err(self.lines.source().bad_line("the header declares no observation types"));
        }
        self.lay_out_columns();
        Ok(())
    }

    fn lay_out_columns(&mut self) {
        for (columns, system) in self.columns.iter_mut().zip(System::ALL) {
            *columns = Columns::of(system, &self.header);
        }
    }

    /// Header records (or nothing of interest) that follow an event line.
    fn read_event(&mut self, count: usize) -> Result<(), ReadError> {
        let mut records = HeaderRecords::default();
        for _ in 0..count {
            if !self.lines.advance(&mut self.damage)? {
                self.damage.note(self.lines.line_number(), "the file ends inside an event");
                break;
            }
            let (line, number) = (self.lines.line(), self.lines.line_number());
            let scale = self.header.time_system;
            if EpochLine::parse(line, self.header.version, scale).is_some() {
                self.damage.note(number, "the event has fewer records than it declares");
                self.lines.hold_line();
                break;
            }
            records.read(&mut self.header, line, number, &mut self.damage);
        }
        self.lay_out_columns();
        Ok(())
    }

    fn read_observations(
        &mut self,
        line: &EpochLine,
        epoch: &mut AntennaEpoch,
    ) -> Result<(), ReadError> {
        epoch.time = line.time.unwrap_or_default();
        epoch.power_failure = line.flag == EpochFlag::AfterPowerFailure;
        epoch.clock_offset_s = line.clock_offset_s.filter(|_| !self.header.clock_offset_applied);
        epoch.observations.clear();
        self.seen = Seen::default();
        if self.header.version.major < 3 {
            self.read_satellites_2(line.count, epoch)
        } else {
            self.read_satellites_3(line.count, epoch)
        }
    }

    /// RINEX 3 and 4: one line a satellite, up to the next `>`.
    fn read_satellites_3(
        &mut self,
        count: usize,
        epoch: &mut AntennaEpoch,
    ) -> Result<(), ReadError> {
        let mut found = 0;
        loop {
            if !self.lines.advance(&mut self.damage)? {
                break;
            }
            let (line, number) = (self.lines.line(), self.lines.line_number());
            if line.first() == Some(&b'>') {
                self.lines.hold_line();
                break;
            }
            if label(line) == b"COMMENT" {
                continue;
            }
            found += 1;
            if found > SATELLITES_MAX {
                self.damage.note(number, "too many satellites in one epoch, skipped");
                continue;
            }
            let satellite = satellite(columns(line, 0..3));
            let Some(satellite) = self.seen.admit(satellite, number, &mut self.damage) else {
                continue;
            };
            let layout = &self.columns[satellite.system as usize];
            if layout.columns.is_empty() {
                self.damage.note(number, "the header declares no observations of this system");
                continue;
            }
            let base = epoch.observations.len();
            epoch.observations.extend(layout.blank(satellite));
            let observations = &mut epoch.observations[base..];
            let fields = line.get(3..).unwrap_or_default();
            read_fields(&layout.columns, fields, observations, number, &mut self.damage);
            drop_empty(&mut epoch.observations, base);
        }
        if found != count {
            let line = self.lines.line_number();
            self.damage.note_with(line, || {
                format!("the epoch has {found} satellites and declares {count}").into()
            });
        }
        Ok(())
    }

    /// RINEX 2: the satellites stand in the epoch line and its continuations, then come the
    /// observations of each, five a line.
    fn read_satellites_2(
        &mut self,
        count: usize,
        epoch: &mut AntennaEpoch,
    ) -> Result<(), ReadError> {
        if !self.read_satellite_list(count)? {
            return Ok(());
        }
        for index in 0..self.satellites.len() {
            let number = self.lines.line_number();
            let satellite = self.seen.admit(self.satellites[index], number, &mut self.damage);
            // RINEX 2 has one list of columns: a satellite that is skipped has as many lines.
            let system = satellite.map_or(self.header.default_system(), |s| s.system);
            let layout = &self.columns[system as usize];
            let base = epoch.observations.len();
            epoch.observations.extend(satellite.iter().flat_map(|s| layout.blank(*s)));
            for fields in layout.columns.chunks(FIELDS_A_LINE) {
                let at_end = !self.lines.advance(&mut self.damage)?;
                let (line, number) = (self.lines.line(), self.lines.line_number());
                let scale = self.header.time_system;
                let cut = at_end || EpochLine::parse(line, self.header.version, scale).is_some();
                if cut {
                    self.damage.note(number, "the epoch ends before its last satellite");
                    if !at_end {
                        self.lines.hold_line();
                    }
                    drop_empty(&mut epoch.observations, base);
                    return Ok(());
                }
                let observations = &mut epoch.observations[base..];
                if satellite.is_some() {
                    read_fields(fields, line, observations, number, &mut self.damage);
                }
            }
            drop_empty(&mut epoch.observations, base);
        }
        Ok(())
    }

    /// The satellites of a RINEX 2 epoch, twelve a line from column 33 on.
    fn read_satellite_list(&mut self, count: usize) -> Result<bool, ReadError> {
        self.satellites.clear();
        for index in 0..count.min(SATELLITES_MAX) {
            let place = index % 12;
            if index > 0 && place == 0 && !self.lines.advance(&mut self.damage)? {
                self.damage.note(self.lines.line_number(), "the epoch ends in its satellite list");
                return Ok(false);
            }
            let name = columns(self.lines.line(), 32 + 3 * place..35 + 3 * place);
            let name = match *name {
                [b' ', tens, units] => [self.header.default_system().letter() as u8, tens, units],
                [letter, tens, units] => [letter, tens, units],
                _ => [b' '; 3],
            };
            self.satellites.push(satellite(&name));
        }
        Ok(true)
    }

    /// Passes over lines up to the next epoch line, which is held.
    fn skip_to_epoch(&mut self, what: &'static str) -> Result<(), ReadError> {
        let first = self.lines.line_number();
        if self.lines.line().trim_ascii().is_empty() || label(self.lines.line()) == b"COMMENT" {
            return Ok(());
        }
        let scale = self.header.time_system;
        while self.lines.advance(&mut self.damage)? {
            if EpochLine::parse(self.lines.line(), self.header.version, scale).is_some() {
                self.lines.hold_line();
                break;
            }
        }
        let last = self.lines.line_number();
        self.damage.note_with(first, || format!("{what}; skipped to line {last}").into());
        Ok(())
    }

    fn is_later(&mut self, time: GpsTime, line: u64) -> bool {
        let later = self.last.is_none_or(|last| time > last);
        if later {
            self.last = Some(time);
        } else {
            self.damage.note_with(line, || {
                format!("epoch {time} is not later than the one before, skipped").into()
            });
        }
        later
    }

    /// Slip records mark the next observation of their satellite and signal.
    fn apply_slips(&mut self, epoch: &mut AntennaEpoch) {
        if self.slips.is_empty() {
            return;
        }
        for observation in &mut epoch.observations {
            let key = (observation.satellite, observation.signal);
            if observation.phase_cycles.is_some()
                && let Ok(index) = self.slips.binary_search(&key)
            {
                observation.lock.0 |= Lock::SLIP;
                self.slips.remove(index);
            }
        }
    }
}

/// Goes to the first line of the RINEX header, if there is one.
fn open_lines(mut source: Source) -> Result<Lines, ReadError> {
    let content = Content::of(source.start(Content::ENOUGH)?);
    if !matches!(content, Content::RinexObservation | Content::CompactRinex) {
        return Err(source.wrong_content(content.to_string(), EXPECTED));
    }
    let mut compact_version = 0;
    while source.advance()? {
        match label(source.line()) {
            b"CRINEX VERS   / TYPE" => {
                compact_version =
                    Version::parse(columns(source.line(), 0..9)).map_or(0, |v| v.major);
                if !matches!(compact_version, 1 | 3) {
                    let found = format!("compact RINEX version {:?}", text(source.line(), 0..20));
                    return Err(source.wrong_content(found, EXPECTED));
                }
            }
            b"RINEX VERSION / TYPE" if compact_version == 0 => return Ok(Lines::Plain(source)),
            b"RINEX VERSION / TYPE" => {
                return Ok(Lines::Compact(Box::new(CompactLines::new(source, compact_version))));
            }
            _ => {}
        }
    }
    Err(source.wrong_content("no RINEX header", EXPECTED))
}

/// Reads the columns of one line into the observations of one satellite.
fn read_fields(
    columns: &[Column],
    line: &[u8],
    observations: &mut [Observation],
    line_number: u64,
    damage: &mut DamageLog,
) {
    for (index, column) in columns.iter().enumerate() {
        let start = index * FIELD;
        if start >= line.len() {
            break;
        }
        if column.quantity == Quantity::Other {
            continue;
        }
        let field = &line[start..line.len().min(start + FIELD)];
        let value = f14_3(&field[..field.len().min(14)], column.factor);
        let indicator = field.get(14).copied().unwrap_or(b' ');
        let strength = field.get(15).copied().unwrap_or(b' ');
        let digits = [indicator, strength].iter().all(|d| *d == b' ' || d.is_ascii_digit());
        let Some(observation) = observations.get_mut(column.signal) else { continue };
        let number = match value {
            Value::Number(number) if digits => Some(number),
            Value::Missing if digits => None,
            _ => {
                damage.note_with(line_number, || {
                    format!("column {} is not an observation, skipped", index + 1).into()
                });
                continue;
            }
        };
        // Where two columns mean the same (C1 and C2 of BeiDou in RINEX 2) the first one counts.
        let o = observation;
        match column.quantity {
            Quantity::Pseudorange => o.pseudorange_m = o.pseudorange_m.or(number),
            Quantity::Phase if o.phase_cycles.is_none() => {
                o.phase_cycles = number;
                o.lock = Lock(indicator.saturating_sub(b'0'));
            }
            Quantity::Doppler => o.doppler_hz = o.doppler_hz.or(number),
            Quantity::Strength => o.cn0_dbhz = o.cn0_dbhz.or(number),
            Quantity::Phase | Quantity::Other => {}
        }
    }
}

/// Removes the observations from `base` on that have no content.
fn drop_empty(observations: &mut Vec<Observation>, base: usize) {
    let mut kept = base;
    for index in base..observations.len() {
        let o = &observations[index];
        let empty = o.pseudorange_m.is_none()
            && o.phase_cycles.is_none()
            && o.doppler_hz.is_none()
            && o.cn0_dbhz.is_none();
        if !empty {
            observations.swap(kept, index);
            kept += 1;
        }
    }
    observations.truncate(kept);
}

/// The satellites that an epoch has had already.
#[derive(Debug, Clone, Copy, Default)]
struct Seen([u128; 7]);

impl Seen {
    /// The satellite, unless it is unreadable or comes a second time, which is noted.
    fn admit(
        &mut self,
        satellite: Option<Satellite>,
        line: u64,
        damage: &mut DamageLog,
    ) -> Option<Satellite> {
        let Some(satellite) = satellite else {
            damage.note(line, "not the name of a satellite, skipped");
            return None;
        };
        let bit = 1_u128 << (satellite.number & 127);
        let seen = &mut self.0[satellite.system as usize];
        if *seen & bit != 0 {
            damage.note_with(line, || {
                format!("{satellite} comes twice in one epoch, skipped").into()
            });
            return None;
        }
        *seen |= bit;
        Some(satellite)
    }
}
