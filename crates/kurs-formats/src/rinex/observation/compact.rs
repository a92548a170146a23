//! Compact RINEX (CRINEX 1 for RINEX 2, CRINEX 3 for RINEX 3 and 4), expanded epoch by epoch.
//!
//! Numbers are written as differences in time, up to a stated order, and texts by the characters
//! that changed. Source: Y. Hatanaka, A Compression Format and Tools for GNSS Observation Data,
//! Bulletin of the Geographical Survey Institute 55 (2008) 21-30.
//!
//! Differences carry damage on, so an epoch is given out only when the line behind it is where the
//! next epoch begins. Otherwise everything up to the next epoch that is written in full is dropped.

use core::ops::Range;

use kurs::signal::{Satellite, System};

use super::epoch_line::{EpochFlag, EpochLine};
use super::header::{HeaderRecords, ObservationHeader, TimeSystem, Version, satellite};
use crate::damage::DamageLog;
use crate::rinex::fields::{columns, label};
use crate::source::{ReadError, Source};

/// Highest order of differences that one digit can state.
const ORDER_MAX: usize = 9;
/// The numbers of satellites in one system.
const NUMBERS: usize = 100;
/// Lines of an event that are kept: its count has three digits.
const EVENT_LINES_MAX: usize = 1000;

/// The expanded lines of a compact file.
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
    /// By system and number.
    satellites: Vec<SatelliteState>,
    names: Vec<Satellite>,
    block: Block,
    /// An epoch was dropped before the block, or behind it.
    lost: bool,
    lost_behind: bool,
}

/// The text of one expanded epoch.
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
    /// `None` while there is no number to be different from.
    order: Option<usize>,
    level: usize,
    differences: [i64; ORDER_MAX + 1],
}

impl Arc {
    /// The number that a field means: `order&number` begins an arc, a bare number is a difference.
    /// `Err` if the field is neither; then the arc is lost, as it is when the field is empty.
    fn take(&mut self, field: &[u8]) -> Result<Option<i64>, ()> {
        let begun = match *field {
            [] => None,
            [order @ b'0'..=b'9', b'&', ref number @ ..] => {
                self.level = 0;
                self.order = Some(usize::from(order - b'0'));
                signed(number)
            }
            ref difference if self.order.is_some() => signed(difference),
            _ => None,
        };
        let (Some(number), Some(order)) = (begun, self.order) else {
            self.order = None;
            return if field.is_empty() { Ok(None) } else { Err(()) };
        };
        // Δᵏy(t) = Δᵏ⁻¹y(t) − Δᵏ⁻¹y(t−1); the order grows to its limit as the arc goes on.
        let begins = field.get(1) == Some(&b'&');
        if !begins && self.level < order {
            self.level += 1;
        }
        self.differences[self.level] = number;
        for level in (0..self.level).rev() {
            self.differences[level] =
                self.differences[level].wrapping_add(self.differences[level + 1]);
        }
        Ok(Some(self.differences[0]))
    }
}

impl CompactLines {
    /// Takes over at the first line of the RINEX header, behind the two of the compact one.
    pub(super) fn new(source: Source, compact_version: u8) -> Self {
        // CRINEX 1 has the columns of RINEX 2 and CRINEX 3 those of RINEX 3, also for RINEX 4.
        let version = Version { major: if compact_version < 3 { 2 } else { 3 }, minor: 0 };
        let header = ObservationHeader { version, ..ObservationHeader::default() };
        Self {
            source,
            header,
            records: HeaderRecords::default(),
            in_header: true,
            epoch_text: Vec::new(),
            epoch_known: false,
            epoch_count: 0,
            clock: Arc::default(),
            satellites: vec![SatelliteState::default(); System::ALL.len() * NUMBERS],
            names: Vec::new(),
            block: Block::default(),
            lost: false,
            lost_behind: false,
        }
    }

    /// Whether epochs were dropped since this was asked last.
    pub(super) fn take_lost(&mut self) -> bool {
        core::mem::take(&mut self.lost)
    }

    pub(super) const fn source(&self) -> &Source {
        &self.source
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
            if !self.expand_epoch(damage)? {
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

    /// Expands the next epoch or event into the block; the block stays empty where one is dropped.
    fn expand_epoch(&mut self, damage: &mut DamageLog) -> Result<bool, ReadError> {
        self.block.clear();
        self.lost |= core::mem::take(&mut self.lost_behind);
        if !self.epoch_known && !self.source.advance()? {
            return Ok(false);
        }
        let first = self.source.line_number();
        if !core::mem::take(&mut self.epoch_known) && !self.take_epoch_line() {
            self.skip_to_full_epoch(first, damage)?;
            return Ok(true);
        }
        let Some(epoch) = self.epoch_line() else { return Ok(true) };
        if !matches!(epoch.flag, EpochFlag::Observations | EpochFlag::AfterPowerFailure) {
            self.pass_event()?;
            return Ok(true);
        }
        if !self.source.advance()? {
            damage.note(first, "the file ends inside an epoch");
            return Ok(true);
        }
        let clock = self.clock.take(self.source.line().trim_ascii());
        if clock.is_err() {
            damage.note(self.source.line_number(), "not a receiver clock offset, skipped");
        }
        self.write_epoch_line(clock.unwrap_or_default(), first);
        if self.expand_satellites(first, damage)? {
            self.know_next_epoch(damage)?;
        }
        Ok(true)
    }

    /// Expands the line of every satellite; `false` if there are not as many.
    fn expand_satellites(&mut self, first: u64, damage: &mut DamageLog) -> Result<bool, ReadError> {
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
            self.expand_satellite(self.names[index], damage);
        }
        Ok(true)
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
        let number = self.source.line_number();
        let line = self.source.line().trim_ascii_end();
        let one_field = !line.contains(&b' ');
        // An empty line would mean the same epoch again; there are some at the end of files.
        if line.is_empty() {
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

    /// Whether the line is an epoch line in full, from which everything begins anew.
    fn is_full_epoch_line(&self) -> bool {
        let mark = if self.header.version.major < 3 { b'&' } else { b'>' };
        self.source.line().first() == Some(&mark)
    }

    /// Applies an epoch line to the text of the one before; `false` if the result is none.
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
        if !matches!(epoch.flag, EpochFlag::Observations | EpochFlag::AfterPowerFailure) {
            return true;
        }
        let start = if self.header.version.major < 3 { 32 } else { 41 };
        let list = self.epoch_text.get(start..).unwrap_or_default().trim_ascii_end();
        for name in list.chunks(3) {
            let Some(satellite) = satellite_2_or_3(name) else { return false };
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

    /// The epoch line as RINEX has it, with the clock offset in its columns.
    fn write_epoch_line(&mut self, clock: Option<i64>, line_number: u64) {
        let block = &mut self.block;
        if self.header.version.major >= 3 {
            block.text.extend_from_slice(columns(&self.epoch_text, 0..35));
            if let Some(clock) = clock {
                block.text.resize(block.line_start() + 41, b' ');
                write_fixed(&mut block.text, clock, 15, 12);
            }
            block.end_line(line_number);
            return;
        }
        // RINEX 2: twelve satellites a line, the clock offset behind those of the first.
        let names_start = 32.min(self.epoch_text.len());
        let (epoch, names) = self.epoch_text.split_at(names_start);
        let mut lists = names.chunks(36);
        block.text.extend_from_slice(epoch);
        block.text.extend_from_slice(lists.next().unwrap_or_default());
        if let Some(clock) = clock {
            let start = block.line_start();
            block.text.resize(start + 68, b' ');
            write_fixed(&mut block.text, clock, 12, 9);
        }
        block.end_line(line_number);
        for list in lists.filter(|list| !list.trim_ascii().is_empty()) {
            block.text.extend_from_slice(&[b' '; 32]);
            block.text.extend_from_slice(list);
            block.end_line(line_number);
        }
    }

    /// The observations of one satellite: numbers, each followed by a blank, then changed digits.
    fn expand_satellite(&mut self, satellite: Satellite, damage: &mut DamageLog) {
        let (line, line_number) = (self.source.line(), self.source.line_number());
        let types = self.header.observation_types.get(&satellite.system);
        let count = types.map_or(0, Vec::len);
        let version_2 = self.header.version.major < 3;
        let state = &mut self.satellites
            [satellite.system as usize * NUMBERS + usize::from(satellite.number)];
        state.begin_epoch(self.epoch_count, count);
        let block = &mut self.block;
        if !version_2 {
            let (tens, units) = (satellite.number / 10, satellite.number % 10);
            let letter = satellite.system.letter() as u8;
            block.text.extend_from_slice(&[letter, b'0' + tens, b'0' + units]);
        }
        let start = block.text.len();
        block.text.resize(start + 16 * count, b' ');
        let mut rest = line;
        for (index, arc) in state.arcs.iter_mut().enumerate() {
            let end = memchr::memchr(b' ', rest).unwrap_or(rest.len());
            let (field, behind) = rest.split_at(end);
            rest = behind.get(1..).unwrap_or_default();
            let at = start + 16 * index;
            match arc.take(field) {
                Ok(None) => {}
                Ok(Some(number)) if (-999_999_999_999..=9_999_999_999_999).contains(&number) => {
                    write_f14_3(&mut block.text[at..at + 14], number);
                }
                _ => {
                    *arc = Arc::default();
                    damage.note_with(line_number, || {
                        format!("{satellite}, column {}: no arc goes on here, skipped", index + 1)
                            .into()
                    });
                }
            }
        }
        apply_changes(&mut state.digits, rest);
        state.digits.truncate(2 * count);
        for (index, digits) in state.digits.chunks(2).enumerate() {
            let at = start + 16 * index + 14;
            block.text[at..at + digits.len()].copy_from_slice(digits);
        }
        if version_2 {
            block.end_lines_of(5 * 16, line_number);
        } else {
            block.end_line(line_number);
        }
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

    /// Divides the rest of the text into lines of `width`.
    fn end_lines_of(&mut self, width: usize, line_number: u64) {
        let (mut start, end) = (self.line_start(), self.text.len());
        while start < end {
            let line_end = (start + width).min(end);
            self.lines.push((start..line_end, line_number));
            start = line_end;
        }
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

/// A satellite name. Where RINEX 2 leaves out the letter the system does not matter: all systems
/// have the same columns, and no two have the same name.
fn satellite_2_or_3(name: &[u8]) -> Option<Satellite> {
    match name {
        [b' ', tens, units] => satellite(&[b'G', *tens, *units]),
        name => satellite(name),
    }
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

/// Writes thousandths right-aligned into 14 blanks, which they fit.
fn write_f14_3(out: &mut [u8], thousandths: i64) {
    let mut rest = thousandths.unsigned_abs();
    let mut at = out.len();
    while rest > 0 || at > 9 {
        at -= 1;
        if at == 10 {
            out[at] = b'.';
            continue;
        }
        out[at] = b'0' + u8::try_from(rest % 10).unwrap_or_default();
        rest /= 10;
    }
    if thousandths < 0 {
        out[at - 1] = b'-';
    }
}

/// Appends a number of `decimals` implied decimals, right-aligned in `width` columns.
fn write_fixed(out: &mut Vec<u8>, number: i64, width: usize, decimals: usize) {
    let sign = if number < 0 { "-" } else { "" };
    let scale = 10_u64.pow(u32::try_from(decimals).unwrap_or_default());
    let (whole, fraction) = (number.unsigned_abs() / scale, number.unsigned_abs() % scale);
    let text = format!("{sign}{whole}.{fraction:0decimals$}");
    out.extend_from_slice(format!("{text:>width$}").as_bytes());
}
