//! Compact RINEX (CRINEX 1 for RINEX 2, CRINEX 3 for RINEX 3 and 4), decoded epoch by epoch.
//!
//! Numbers are written as differences in time, up to a stated order, and texts by the characters
//! that changed. Source: Y. Hatanaka, A Compression Format and Tools for GNSS Observation Data,
//! Bulletin of the Geographical Survey Institute 55 (2008) 21-30.
//!
//! Header, epoch lines and events are given out as lines of RINEX; the observations are not written
//! out, but added up as the thousandths that they are.
//!
//! Differences carry damage on, so an epoch is given out only when the line behind it is where the
//! next epoch begins. Otherwise everything up to the next epoch that is written in full is dropped.

use core::ops::Range;

use kurs::signal::{Satellite, System};

use super::epoch_line::EpochLine;
use super::fields::{Field, digit};
use super::header::{HeaderRecords, ObservationHeader, TimeSystem, Version, satellite};
use crate::damage::DamageLog;
use crate::rinex::fields::{Damaged, label};
use crate::source::{ReadError, Source};

/// Highest order of differences that one digit can state.
const ORDER_MAX: usize = 9;
/// The numbers of satellites in one system.
const NUMBERS: usize = 100;
/// Lines of an event that are kept: its count has three digits.
const EVENT_LINES_MAX: usize = 1000;
/// Columns of an epoch line in front of the names of the satellites, in RINEX 2 and from 3 on.
const EPOCH_COLUMNS: [usize; 2] = [32, 41];
/// The numbers that fit the columns of an observation, in thousandths.
const F14_3: Range<i64> = -999_999_999_999..10_000_000_000_000;
/// The same of a receiver clock offset in RINEX 2, and from 3 on.
const F12_9: Range<i64> = -9_999_999_999..100_000_000_000;
const F15_12: Range<i64> = -9_999_999_999_999..100_000_000_000_000;

/// The lines of a compact file that are not a satellite's, and what the others mean.
#[derive(Debug)]
pub(super) struct CompactLines {
    source: Source,
    /// For the number of columns of each system.
    header: ObservationHeader,
    records: HeaderRecords,
    in_header: bool,
    /// Epoch line with the names of all satellites behind it, in the version's columns.
    epoch_text: Vec<u8>,
    /// `epoch_text` is that of the epoch that comes next; the cursor of the source is on its line.
    epoch_known: bool,
    epoch_count: u64,
    clock: Arc,
    clock_offset_s: Option<f64>,
    /// By system and number.
    satellites: Vec<SatelliteState>,
    names: Vec<Satellite>,
    rows: Vec<Row>,
    block: Block,
    /// An epoch was dropped before the block, or behind it.
    lost: bool,
    lost_behind: bool,
    /// The header of another file follows.
    header_behind: bool,
}

/// A satellite of the epoch, and its line in the file.
#[derive(Debug, Clone, Copy)]
pub(super) struct Row {
    pub(super) satellite: Satellite,
    pub(super) line_number: u64,
}

/// The line of one epoch, or the lines of one event.
#[derive(Debug, Default)]
struct Block {
    text: Vec<u8>,
    /// Lines of the text, each with the line of the file that it comes from.
    lines: Vec<(Range<usize>, u64)>,
    next: usize,
}

/// What the next line of a satellite is the difference to.
#[derive(Debug, Clone, Default)]
struct SatelliteState {
    /// The epoch in which the satellite was last; its arcs go on only from the epoch before.
    epoch: u64,
    arcs: Vec<Arc>,
    /// Loss-of-lock and strength digits.
    digits: Vec<u8>,
}

/// A number that is written by its differences.
#[derive(Debug, Clone, Copy, Default)]
struct Arc {
    /// What the last field means.
    number: Number,
    order: usize,
    level: usize,
    differences: [i64; ORDER_MAX + 1],
}

/// What a field of an arc means.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
enum Number {
    /// The field is empty, and the arc ends.
    #[default]
    Blank,
    /// The difference of order zero.
    Known,
    /// Neither a beginning nor a difference to anything: the arc is lost until it begins anew.
    Lost,
}

impl Arc {
    /// Takes the next field: `order&number` begins an arc, a bare number is a difference. A number
    /// outside of the `limits` of its columns in RINEX is invalid.
    fn take(&mut self, field: &[u8], limits: &Range<i64>) {
        let difference = match *field {
            [] => {
                self.number = Number::Blank;
                return;
            }
            [order @ b'0'..=b'9', b'&', ref number @ ..] => {
                (self.order, self.level) = (usize::from(order - b'0'), 0);
                signed(number)
            }
            ref difference => {
                // The order grows to its limit as the arc goes on.
                self.level = self.order.min(self.level + 1);
                signed(difference).filter(|_| self.number == Number::Known)
            }
        };
        // Δᵏ⁻¹y(t) = Δᵏ⁻¹y(t−1) + Δᵏy(t), from the highest order down to y itself
        self.differences[self.level] = difference.unwrap_or_default();
        for k in (1..=self.level).rev() {
            self.differences[k - 1] = self.differences[k - 1].wrapping_add(self.differences[k]);
        }
        let known = difference.is_some() && limits.contains(&self.differences[0]);
        self.number = if known { Number::Known } else { Number::Lost };
    }

    fn value(&self) -> Result<Option<i64>, Damaged> {
        match self.number {
            Number::Blank => Ok(None),
            Number::Known => Ok(Some(self.differences[0])),
            Number::Lost => Err(Damaged),
        }
    }
}

impl CompactLines {
    /// Takes over at the first line of the RINEX header, behind the two of the compact one.
    pub(super) fn new(source: Source, compact_version: u8, system: Option<System>) -> Self {
        // CRINEX 1 has the columns of RINEX 2 and CRINEX 3 those of RINEX 3, also for RINEX 4.
        let version = Version { major: if compact_version < 3 { 2 } else { 3 }, minor: 0 };
        let header = ObservationHeader::new(version, system);
        Self {
            source,
            header,
            records: HeaderRecords::default(),
            in_header: true,
            epoch_text: Vec::new(),
            epoch_known: false,
            epoch_count: 0,
            clock: Arc::default(),
            clock_offset_s: None,
            satellites: vec![SatelliteState::default(); System::ALL.len() * NUMBERS],
            names: Vec::new(),
            rows: Vec::new(),
            block: Block::default(),
            lost: false,
            lost_behind: false,
            header_behind: false,
        }
    }

    /// Whether epochs were dropped since this was asked last.
    pub(super) fn take_lost(&mut self) -> bool {
        core::mem::take(&mut self.lost)
    }

    pub(super) const fn source(&self) -> &Source {
        &self.source
    }

    pub(super) const fn source_mut(&mut self) -> &mut Source {
        &mut self.source
    }

    /// The satellites behind the epoch line under the cursor, in the order of the file.
    pub(super) fn rows(&self) -> &[Row] {
        &self.rows
    }

    /// The receiver clock offset of that epoch, s.
    pub(super) const fn clock_offset_s(&self) -> Option<f64> {
        self.clock_offset_s
    }

    /// What column `index` of a satellite says in that epoch.
    pub(super) fn field(&self, satellite: Satellite, index: usize) -> Result<Field, Damaged> {
        let state = &self.satellites[place(satellite)];
        let digit_at = |at: usize| state.digits.get(at).map_or(Ok(0), |byte| digit(*byte));
        let (indicator, _strength) = (digit_at(2 * index)?, digit_at(2 * index + 1)?);
        let thousandths = state.arcs.get(index).map_or(Ok(None), Arc::value)?;
        Ok(Field { thousandths, indicator })
    }

    pub(super) fn line(&self) -> &[u8] {
        match self.in_header {
            true => self.source.line(),
            false => self.block.line(),
        }
    }

    pub(super) fn line_number(&self) -> u64 {
        match self.in_header {
            true => self.source.line_number(),
            false => self.block.line_number().unwrap_or(self.source.line_number()),
        }
    }

    pub(super) fn hold_line(&mut self) {
        match self.in_header {
            true => self.source.hold_line(),
            false => self.block.next = self.block.next.saturating_sub(1),
        }
    }

    pub(super) fn advance(&mut self, damage: &mut DamageLog) -> Result<bool, ReadError> {
        if self.in_header && label(self.source.line()) != b"END OF HEADER" {
            let more = self.source.advance()?;
            let epochs_begin = self.is_full_epoch_line() && label(self.source.line()) != b"COMMENT";
            if !more || !epochs_begin {
                self.note_types();
                return Ok(more);
            }
            self.source.hold_line();
        }
        self.in_header = false;
        while self.block.next == self.block.lines.len() {
            if core::mem::take(&mut self.header_behind) {
                self.in_header = true;
                self.records = HeaderRecords::default();
                return self.source.advance();
            }
            if !self.decode_epoch(damage)? {
                return Ok(false);
            }
        }
        self.block.next += 1;
        Ok(true)
    }

    /// Keeps the columns of each system up to date with the header record under the cursor.
    fn note_types(&mut self) {
        let line = self.source.line();
        if matches!(label(line), b"# / TYPES OF OBSERV" | b"SYS / # / OBS TYPES") {
            self.records.read(&mut self.header, line, 0, &mut DamageLog::default());
        }
    }

    /// Decodes the next epoch or event; the block stays empty where one is dropped.
    fn decode_epoch(&mut self, damage: &mut DamageLog) -> Result<bool, ReadError> {
        self.block.clear();
        self.rows.clear();
        self.lost |= core::mem::take(&mut self.lost_behind);
        if !self.epoch_known && !self.source.advance()? {
            return Ok(false);
        }
        if self.finds_header() {
            return Ok(true);
        }
        let first = self.source.line_number();
        if !core::mem::take(&mut self.epoch_known) && !self.take_epoch_line() {
            self.skip_to_full_epoch(first, damage)?;
            return Ok(true);
        }
        let Some(epoch) = self.epoch_line() else { return Ok(true) };
        if !epoch.flag.has_observations() {
            self.pass_event()?;
            return Ok(true);
        }
        if !self.source.advance()? {
            damage.note(first, "the file ends inside an epoch");
            return Ok(true);
        }
        self.decode_clock_offset(damage);
        let epoch_columns = self.epoch_columns().min(self.epoch_text.len());
        self.block.text.extend_from_slice(&self.epoch_text[..epoch_columns]);
        self.block.end_line(first);
        if self.decode_satellites(first, damage)? {
            self.know_next_epoch(damage)?;
        }
        Ok(true)
    }

    /// The line behind the epoch line, in units of the last decimal that RINEX has (F12.9, F15.12).
    fn decode_clock_offset(&mut self, damage: &mut DamageLog) {
        let (limits, units_a_second) = match self.header.version.major {
            ..3 => (F12_9, 1e9),
            _ => (F15_12, 1e12),
        };
        self.clock.take(self.source.line().trim_ascii(), &limits);
        let units = self.clock.value().unwrap_or_else(|Damaged| {
            damage.note(self.source.line_number(), "not a receiver clock offset, skipped");
            None
        });
        self.clock_offset_s = units.map(|units| units as f64 / units_a_second);
    }

    /// Decodes the line of every satellite; `false` if there are not as many.
    fn decode_satellites(&mut self, first: u64, damage: &mut DamageLog) -> Result<bool, ReadError> {
        for index in 0..self.names.len() {
            if !self.source.advance()? {
                // A file that was cut ends in a line; here one may be missing before.
                self.block.clear();
                damage.note(first, "the file ends inside an epoch, dropped");
                return Ok(false);
            }
            if !self.source.line_is_whole() {
                damage.note(self.source.line_number(), "the line is cut, skipped");
                return Ok(false);
            }
            if self.is_full_epoch_line() {
                self.source.hold_line();
                self.block.clear();
                self.lost_behind = true;
                damage.note(first, "the epoch has fewer lines than satellites, dropped");
                return Ok(false);
            }
            self.decode_satellite(self.names[index], damage);
        }
        Ok(true)
    }

    /// The observations of one satellite: numbers, each followed by a blank, then changed digits.
    fn decode_satellite(&mut self, satellite: Satellite, damage: &mut DamageLog) {
        let line_number = self.source.line_number();
        let types = self.header.observation_types.get(&satellite.system);
        let count = types.map_or(0, Vec::len);
        let state = &mut self.satellites[place(satellite)];
        if state.epoch == self.epoch_count {
            // Twice in one epoch: which line is whose is unknown.
            *state = SatelliteState { epoch: self.epoch_count, ..SatelliteState::default() };
            self.rows.retain(|row| row.satellite != satellite);
            self.lost_behind = true;
            damage.note_with(line_number, || {
                format!("{satellite} comes twice in one epoch, skipped").into()
            });
            return;
        }
        state.begin_epoch(self.epoch_count, count);
        let mut rest = self.source.line();
        for arc in &mut state.arcs {
            let end = rest.iter().position(|byte| *byte == b' ').unwrap_or(rest.len());
            let (field, behind) = rest.split_at(end);
            rest = behind.get(1..).unwrap_or_default();
            arc.take(field, &F14_3);
        }
        apply_changes(&mut state.digits, rest);
        state.digits.truncate(2 * count);
        // A missing observation has no digits, and the next change is one to blanks.
        for (digits, arc) in state.digits.chunks_mut(2).zip(&state.arcs) {
            if arc.number == Number::Blank {
                digits.fill(b' ');
            }
        }
        self.rows.push(Row { satellite, line_number });
    }

    /// Looks whether the next epoch begins behind this one. If not, and the lines may have belonged
    /// to other satellites, this epoch is dropped too.
    fn know_next_epoch(&mut self, damage: &mut DamageLog) -> Result<(), ReadError> {
        // An epoch line that is not in full begins with a blank, for the mark that stays the same.
        let ends_with_satellite = !matches!(self.source.line().first(), None | Some(b' '));
        if !self.source.advance()? {
            return Ok(());
        }
        if self.is_full_epoch_line() {
            self.source.hold_line();
            return Ok(());
        }
        if self.finds_header() {
            return Ok(());
        }
        let number = self.source.line_number();
        let line = self.source.line().trim_ascii_end();
        let one_field = !line.contains(&b' ');
        // An empty line would mean the same epoch again; there are some at the end of files.
        if line.is_empty() || line == b"END OF FILE" {
            if !self.source.advance()? {
                return Ok(());
            }
            self.source.hold_line();
        } else if self.take_epoch_line() {
            self.epoch_known = true;
            return Ok(());
        }
        // A single number, or none, is the clock offset behind an epoch line that is lost; anything
        // else is a line too many.
        if !(ends_with_satellite && one_field) {
            self.block.clear();
        }
        self.skip_to_full_epoch(number, damage)
    }

    /// Whether another file begins here (files were joined); its header is read next.
    fn finds_header(&mut self) -> bool {
        let begins = label(self.source.line()) == b"CRINEX VERS   / TYPE";
        if begins {
            self.source.hold_line();
            self.epoch_text.clear();
            self.header_behind = true;
        }
        begins
    }

    /// Whether the line is an epoch line in full, from which everything begins anew.
    fn is_full_epoch_line(&self) -> bool {
        let mark = if self.header.version.major < 3 { b'&' } else { b'>' };
        self.source.line().first() == Some(&mark)
    }

    /// Applies an epoch line to the text of the one before; `false` if that gives no epoch line.
    fn take_epoch_line(&mut self) -> bool {
        self.epoch_count += 1;
        if self.is_full_epoch_line() {
            self.epoch_count += 1;
            self.clock = Arc::default();
            self.epoch_text.clear();
        }
        let line = self.source.line();
        if self.epoch_text.is_empty() && !self.is_full_epoch_line() {
            return false;
        }
        apply_changes(&mut self.epoch_text, line);
        self.epoch_line().is_some_and(|epoch| self.take_names(&epoch))
    }

    fn epoch_line(&self) -> Option<EpochLine> {
        EpochLine::parse(&self.epoch_text, self.header.version, TimeSystem::Gps)
    }

    /// The satellites behind the epoch line; `false` if they are not as many as it says.
    fn take_names(&mut self, epoch: &EpochLine) -> bool {
        self.names.clear();
        if !epoch.flag.has_observations() {
            return true;
        }
        let system = self.header.default_system().letter() as u8;
        let list = self.epoch_text.get(self.epoch_columns()..).unwrap_or_default().trim_ascii_end();
        for name in list.chunks(3) {
            let named = match name {
                [b' ', tens, units] => satellite(&[system, *tens, *units]),
                name => satellite(name),
            };
            let Some(satellite) = named else { return false };
            self.names.push(satellite);
        }
        self.names.len() == epoch.count
    }

    /// The records of an event stand in the file as they are; behind it comes an epoch in full.
    fn pass_event(&mut self) -> Result<(), ReadError> {
        self.block.text.extend_from_slice(&self.epoch_text);
        self.block.end_line(self.source.line_number());
        self.records = HeaderRecords::default();
        while self.source.advance()? {
            if self.is_full_epoch_line() {
                self.source.hold_line();
                break;
            }
            if self.block.lines.len() < EVENT_LINES_MAX {
                self.note_types();
                self.block.text.extend_from_slice(self.source.line());
                self.block.end_line(self.source.line_number());
            }
        }
        self.epoch_text.clear();
        Ok(())
    }

    fn skip_to_full_epoch(&mut self, first: u64, damage: &mut DamageLog) -> Result<(), ReadError> {
        self.epoch_text.clear();
        self.lost_behind = true;
        let mut last = first;
        while self.source.advance()? {
            if self.is_full_epoch_line() {
                self.source.hold_line();
                break;
            }
            if self.finds_header() {
                break;
            }
            last = self.source.line_number();
        }
        damage.note_with(first, || {
            format!(
                "no epoch begins here, dropped up to line {last}, where the next in full begins"
            )
            .into()
        });
        Ok(())
    }

    const fn epoch_columns(&self) -> usize {
        EPOCH_COLUMNS[(self.header.version.major >= 3) as usize]
    }
}

impl SatelliteState {
    /// Arcs go on from the epoch before; behind a gap everything begins anew.
    fn begin_epoch(&mut self, epoch: u64, count: usize) {
        if self.epoch + 1 != epoch {
            self.arcs.clear();
            self.digits.clear();
        }
        self.epoch = epoch;
        self.arcs.resize(count, Arc::default());
    }
}

impl Block {
    fn clear(&mut self) {
        self.text.clear();
        self.lines.clear();
        self.next = 0;
    }

    fn line_start(&self) -> usize {
        self.lines.last().map_or(0, |(range, _)| range.end)
    }

    fn end_line(&mut self, line_number: u64) {
        self.lines.push((self.line_start()..self.text.len(), line_number));
    }

    fn current(&self) -> Option<&(Range<usize>, u64)> {
        self.lines.get(self.next.checked_sub(1)?)
    }

    fn line(&self) -> &[u8] {
        self.current().map_or(&[], |(range, _)| &self.text[range.clone()])
    }

    fn line_number(&self) -> Option<u64> {
        self.current().map(|(_, number)| *number)
    }
}

/// Changes a text: a blank keeps the character, `&` makes it blank, another one replaces it.
fn apply_changes(text: &mut Vec<u8>, changes: &[u8]) {
    for (index, &change) in changes.iter().enumerate() {
        if index == text.len() {
            text.push(b' ');
        }
        match change {
            b' ' => {}
            b'&' => text[index] = b' ',
            other => text[index] = other,
        }
    }
}

/// Where the state of a satellite is kept.
fn place(satellite: Satellite) -> usize {
    satellite.system as usize * NUMBERS + usize::from(satellite.number)
}

/// An integer of up to 18 digits.
fn signed(field: &[u8]) -> Option<i64> {
    let (negative, digits) = match field {
        [b'-', digits @ ..] => (true, digits),
        digits => (false, digits),
    };
    if digits.is_empty() || digits.len() > 18 || !digits.iter().all(u8::is_ascii_digit) {
        return None;
    }
    let magnitude = digits.iter().fold(0, |value, digit| value * 10 + i64::from(digit - b'0'));
    Some(if negative { -magnitude } else { magnitude })
}
