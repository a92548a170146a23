//! Epochs and events as they stand in the file.
//!
//! In RINEX 3 and 4 every line names its satellite, so a bad line costs that satellite only. In
//! RINEX 2 the order of the lines alone tells whose they are: where a line is missing or too many,
//! the epoch is dropped, because its numbers may be those of other satellites.

use std::ops::ControlFlow;

use kurs::observation::AntennaEpoch;
use kurs::signal::{Satellite, SatelliteSet};

use super::compact::Row;
use super::epoch_line::{EpochFlag, EpochLine};
use super::events::EventLog;
use super::fields::{FIELD, drop_empty, is_observations, present, put_fields, text_field};
use super::first_record;
use super::header::{HeaderRecords, ObservationHeader, satellite};
use super::lines::Lines;
use super::satellites::Satellites;
use crate::damage::DamageLog;
use crate::epoch_order::RawEpochs;
use crate::pending_slips::PendingSlips;
use crate::rinex::fields::{columns, label};
use crate::source::ReadError;

/// Satellites that an epoch can have: the format counts them with three digits.
const SATELLITES_MAX: usize = 999;
/// Observations in a line of RINEX 2.
const FIELDS_A_LINE: usize = 5;
/// Satellites in an epoch line of RINEX 2, and in each line that continues it.
const NAMES_A_LINE: usize = 12;

/// Reads epoch by epoch behind the header; its parts are for [`super::ObservationReader`].
#[derive(Debug)]
pub(super) struct EpochReader {
    pub(super) lines: Lines,
    pub(super) header: ObservationHeader,
    pub(super) damage: DamageLog,
    pub(super) slips: PendingSlips,
    pub(super) events: EventLog,
    /// Fields with a number so far.
    pub(super) field_count: u64,
    pub(super) satellites: Satellites,
}

impl RawEpochs for EpochReader {
    /// Events on the way change the header or become slips.
    fn next(&mut self, epoch: &mut AntennaEpoch) -> Result<Option<u64>, ReadError> {
        while self.advance()? {
            if self.lines.take_lost() {
                self.slips.mark_all();
            }
            let Some(line) = self.epoch_line() else {
                if is_header_record(self.lines.line()) {
                    self.read_joined_header()?;
                } else {
                    self.skip_to_epoch()?;
                }
                continue;
            };
            let number = self.lines.line_number();
            self.events.note(number, &line);
            match line.flag {
                EpochFlag::Observations | EpochFlag::AfterPowerFailure => {
                    let all = self.slips.take_all();
                    if self.read_observations(&line, epoch)? {
                        self.slips.apply(epoch, all);
                        return Ok(Some(number));
                    }
                    self.slips.mark_all();
                }
                EpochFlag::CycleSlips => {
                    self.read_observations(&line, epoch)?;
                    self.take_slips(epoch);
                }
                EpochFlag::MovingAntenna
                | EpochFlag::NewSite
                | EpochFlag::HeaderRecords
                | EpochFlag::ExternalEvent => self.read_event(line.count)?,
            }
        }
        if let Some(reason) = self.lines.source_mut().take_broken_off() {
            self.damage.note(self.lines.line_number(), reason);
        }
        epoch.observations.clear();
        Ok(None)
    }

    fn slips(&mut self) -> &mut PendingSlips {
        &mut self.slips
    }

    fn damage(&mut self) -> &mut DamageLog {
        &mut self.damage
    }
}

impl EpochReader {
    /// Reads the header; the lines are at its first record, which is in `header` already.
    pub(super) fn new(lines: Lines, header: ObservationHeader) -> Result<Self, ReadError> {
        let mut reader = Self {
            lines,
            header,
            damage: DamageLog::default(),
            slips: PendingSlips::default(),
            events: EventLog::default(),
            field_count: 0,
            satellites: Satellites::default(),
        };
        reader.read_header()?;
        Ok(reader)
    }

    fn advance(&mut self) -> Result<bool, ReadError> {
        self.lines.advance(&mut self.damage)
    }

    /// The line as the beginning of an epoch or event, if it is that.
    fn epoch_line(&self) -> Option<EpochLine> {
        EpochLine::parse(self.lines.line(), self.header.version, self.header.time_system)
    }

    fn read_header(&mut self) -> Result<(), ReadError> {
        let mut records = HeaderRecords::default();
        loop {
            if !self.advance()? {
                return Err(self.lines.source().bad_line("the file ends inside its header"));
            }
            let number = self.lines.line_number();
            if label(self.lines.line()) == b"END OF HEADER" {
                break;
            }
            if self.epoch_line().is_some() {
                self.damage.note(number, "the header has no end, epochs begin here");
                self.lines.hold_line();
                break;
            }
            records.read(&mut self.header, self.lines.line(), number, &mut self.damage);
        }
        records.end_types(&mut self.damage);
        if self.header.observation_types.is_empty() {
            return Err(self.lines.source().bad_line("the header declares no observation types"));
        }
        self.lay_out_columns();
        Ok(())
    }

    /// Header records in the midst of the data: files were joined. They are obeyed up to the end of
    /// the header, and all phases slipped.
    fn read_joined_header(&mut self) -> Result<(), ReadError> {
        self.damage.note(self.lines.line_number(), "a second header: files were joined here");
        let mut records = HeaderRecords::default();
        loop {
            let (line, number) = (self.lines.line(), self.lines.line_number());
            match label(line) {
                b"END OF HEADER" => break,
                b"CRINEX VERS   / TYPE" if matches!(self.lines, Lines::Plain(_)) => {
                    let what = "a compact file begins in a plain one: give them one by one";
                    return Err(self.lines.source().bad_line(what));
                }
                b"RINEX VERSION / TYPE" => {
                    let header = first_record(line).map_err(|found| {
                        let what =
                            format!("a second header of {found}, which is none that is read");
                        self.lines.source().bad_line(what)
                    })?;
                    if (header.version.major < 3) != (self.header.version.major < 3) {
                        let what = format!(
                            "a second header of RINEX {} begins in a file of RINEX {}: these files \
                             cannot be read joined, give them one by one",
                            header.version, self.header.version
                        );
                        return Err(self.lines.source().bad_line(what));
                    }
                    self.header = header;
                }
                _ => records.read(&mut self.header, line, number, &mut self.damage),
            }
            if !self.advance()? {
                break;
            }
            if self.epoch_line().is_some() {
                self.lines.hold_line();
                break;
            }
        }
        records.end_types(&mut self.damage);
        self.slips.mark_all();
        self.lay_out_columns();
        Ok(())
    }

    fn lay_out_columns(&mut self) {
        self.satellites.lay_out(&self.header, self.lines.line_number(), &mut self.damage);
    }

    /// The records behind an event line: header records, or comments.
    fn read_event(&mut self, count: usize) -> Result<(), ReadError> {
        let mut records = HeaderRecords::default();
        for _ in 0..count {
            if !self.advance()? {
                self.damage.note(self.lines.line_number(), "the file ends inside an event");
                break;
            }
            let number = self.lines.line_number();
            if self.epoch_line().is_some() {
                self.damage.note(number, "the event has fewer records than it declares");
                self.lines.hold_line();
                break;
            }
            records.read(&mut self.header, self.lines.line(), number, &mut self.damage);
        }
        records.end_types(&mut self.damage);
        self.lay_out_columns();
        Ok(())
    }

    /// Slip records have the form of observations: a number where a phase slipped. A satellite
    /// without any number slipped on all its signals.
    fn take_slips(&mut self, records: &AntennaEpoch) {
        for o in records.observations.iter().filter(|o| o.phase_cycles.is_some()) {
            self.slips.mark(o.satellite, o.signal);
        }
        for satellite in self.satellites.listed.iter().flatten() {
            if !records.observations.iter().any(|o| o.satellite == *satellite) {
                self.satellites.mark(*satellite, &mut self.slips);
            }
        }
    }

    /// Reads the satellites of an epoch; `false` if they had to be dropped.
    fn read_observations(
        &mut self,
        line: &EpochLine,
        epoch: &mut AntennaEpoch,
    ) -> Result<bool, ReadError> {
        epoch.time = line.time.unwrap_or_default();
        epoch.power_failure = line.flag == EpochFlag::AfterPowerFailure;
        epoch.clock_offset_s = line.clock_offset_s.filter(|_| !self.header.clock_offset_applied);
        epoch.observations.clear();
        self.satellites.begin_epoch();
        if line.flag.has_observations() && matches!(self.lines, Lines::Compact(_)) {
            self.take_decoded(line.count, epoch);
            Ok(true)
        } else if self.header.version.major < 3 {
            self.read_satellite_list(line.count)?;
            self.read_satellites_2(epoch)
        } else {
            self.read_satellites_3(line.count, epoch)?;
            Ok(true)
        }
    }

    /// A compact file: what the lines of the satellites mean is known already.
    fn take_decoded(&mut self, count: usize, epoch: &mut AntennaEpoch) {
        let Lines::Compact(lines) = &self.lines else { return };
        epoch.clock_offset_s = lines.clock_offset_s().filter(|_| !self.header.clock_offset_applied);
        for &Row { satellite, line_number } in lines.rows() {
            let damage = &mut self.damage;
            let Some(layout) = self.satellites.begin_satellite(satellite, line_number, damage)
            else {
                continue;
            };
            let base = epoch.observations.len();
            epoch.observations.extend(layout.blank(satellite));
            let observations = &mut epoch.observations[base..];
            let field = |index| lines.field(satellite, index);
            let slips = &mut self.slips;
            self.field_count +=
                put_fields(&layout.columns, field, observations, line_number, slips, damage);
            self.header.apply_wavelength_factors(observations);
            drop_empty(&mut epoch.observations, base);
        }
        let (found, line_number) = (lines.rows().len(), lines.source().line_number());
        if found != count {
            self.note_count(line_number, found, "epoch", count);
            self.slips.mark_all();
        }
    }

    /// Notes that a list or an epoch has not as many satellites as its epoch line declares.
    fn note_count(&mut self, line_number: u64, found: usize, place: &str, declared: usize) {
        let what = || format!("{found} satellites in the {place} instead of {declared}").into();
        self.damage.note_with(line_number, what);
    }

    /// RINEX 3 and 4: a line for each satellite, up to the next `>`.
    fn read_satellites_3(
        &mut self,
        count: usize,
        epoch: &mut AntennaEpoch,
    ) -> Result<(), ReadError> {
        let (mut found, mut repeated) = (0, 0);
        let mut declared_end = None;
        let mut seen = SatelliteSet::default();
        while self.advance()? {
            let line = self.lines.line();
            if line.first() == Some(&b'>') || is_header_record(line) {
                self.lines.hold_line();
                break;
            }
            if says_nothing(line) {
                continue;
            }
            if found == count {
                declared_end = Some(epoch.observations.len());
            }
            found += 1;
            if found <= SATELLITES_MAX && !self.read_satellite_3(&mut seen, epoch) {
                repeated += 1;
            }
        }
        if found != count {
            self.note_count(self.lines.line_number(), found, "epoch", count);
        }
        // A lost line belongs to a satellite that was there before and is not now; where satellites
        // are repeated, any of them may have lost its own.
        if repeated > 0 {
            self.slips.mark_all();
        } else if found < count || self.satellites.listed.len() < found {
            self.satellites.mark_absent(&mut self.slips);
        }
        // Too many, and the same again: the line of the next epoch is lost, its satellites are not
        // of this one.
        if let Some(end) = declared_end.filter(|_| repeated > 0) {
            epoch.observations.truncate(end);
        }
        Ok(())
    }

    /// Reads the line of one satellite; `false` if the epoch has the satellite already.
    fn read_satellite_3(&mut self, seen: &mut SatelliteSet, epoch: &mut AntennaEpoch) -> bool {
        let (line, number) = (self.lines.line(), self.lines.line_number());
        let (slips, damage) = (&mut self.slips, &mut self.damage);
        let Some(satellite) = satellite(columns(line, 0..3)) else {
            damage.note(number, "not the line of a satellite, skipped");
            return true;
        };
        if !seen.insert(satellite) {
            let what = "comes twice in one epoch, skipped";
            damage.note_with(number, || format!("{satellite} {what}").into());
            return false;
        }
        let Some(layout) = self.satellites.begin_satellite(satellite, number, damage) else {
            return true;
        };
        let base = epoch.observations.len();
        epoch.observations.extend(layout.blank(satellite));
        let observations = &mut epoch.observations[base..];
        let fields = line.get(3..).unwrap_or_default();
        let columns = present(&layout.columns, fields);
        let field = |index| text_field(fields, index);
        self.field_count += put_fields(columns, field, observations, number, slips, damage);
        drop_empty(&mut epoch.observations, base);
        true
    }

    /// RINEX 2: the satellites of an epoch, twelve a line from column 33 on.
    fn read_satellite_list(&mut self, count: usize) -> Result<(), ReadError> {
        let mut seen = SatelliteSet::default();
        let default = self.header.default_system().letter() as u8;
        loop {
            for place in 0..NAMES_A_LINE {
                let name = columns(self.lines.line(), 32 + 3 * place..35 + 3 * place);
                if name.trim_ascii().is_empty() {
                    break;
                }
                let name = match *name {
                    [b' ', tens, units] => satellite(&[default, tens, units]),
                    _ => satellite(name),
                };
                self.satellites.listed.push(name.filter(|satellite| seen.insert(*satellite)));
            }
            let found = self.satellites.listed.len();
            let full = found > 0 && found.is_multiple_of(NAMES_A_LINE);
            let more = full && found < count.min(SATELLITES_MAX);
            if !more || !self.advance()? {
                break;
            }
            if !columns(self.lines.line(), 0..32).trim_ascii().is_empty() {
                self.lines.hold_line();
                break;
            }
        }
        let (found, number) = (self.satellites.listed.len(), self.lines.line_number());
        if found != count {
            self.note_count(number, found, "list", count);
        }
        if self.satellites.listed.contains(&None) {
            self.damage.note(number, "a satellite without a name or twice in the list, skipped");
            self.slips.mark_all();
        }
        Ok(())
    }

    /// RINEX 2: the observations of each satellite of the list, five a line.
    fn read_satellites_2(&mut self, epoch: &mut AntennaEpoch) -> Result<bool, ReadError> {
        for index in 0..self.satellites.listed.len() {
            let satellite = self.satellites.listed[index];
            if let ControlFlow::Break(is_usable) = self.read_satellite_2(satellite, epoch)? {
                return Ok(is_usable);
            }
        }
        self.ends_with_its_lines()
    }

    /// Reads the lines of one satellite; breaks off where they end early, and says whether the
    /// satellites before it are usable.
    fn read_satellite_2(
        &mut self,
        satellite: Option<Satellite>,
        epoch: &mut AntennaEpoch,
    ) -> Result<ControlFlow<bool>, ReadError> {
        // All systems have the same columns: a satellite that is skipped has as many lines.
        let system = satellite.map_or(self.header.default_system(), |s| s.system);
        let layout = self.satellites.columns(system);
        let line_count = layout.columns.len().div_ceil(FIELDS_A_LINE);
        let is_wanted = self.satellites.is_wanted(system);
        let base = epoch.observations.len();
        let own = satellite.filter(|_| is_wanted);
        epoch.observations.extend(own.iter().flat_map(|s| layout.blank(*s)));
        for part in 0..line_count {
            if !self.advance_past_comments()? {
                self.damage.note(self.lines.line_number(), "the file ends inside an epoch");
                epoch.observations.truncate(base);
                return Ok(ControlFlow::Break(true));
            }
            let (line, number) = (self.lines.line(), self.lines.line_number());
            let layout = &self.satellites.columns(system).columns;
            let of_line = layout.chunks(FIELDS_A_LINE).nth(part).unwrap_or_default();
            let beyond = columns(line, of_line.len() * FIELD..FIELDS_A_LINE * FIELD);
            if self.epoch_line().is_some() || !beyond.trim_ascii().is_empty() {
                self.damage.note(number, "not the line of its satellite, the epoch is dropped");
                self.lines.hold_line();
                return Ok(ControlFlow::Break(false));
            }
            if is_wanted {
                let observations = &mut epoch.observations[base..];
                let (slips, damage) = (&mut self.slips, &mut self.damage);
                let columns = present(of_line, line);
                let field = |index| text_field(line, index);
                self.field_count += put_fields(columns, field, observations, number, slips, damage);
            }
        }
        self.header.apply_wavelength_factors(&mut epoch.observations[base..]);
        drop_empty(&mut epoch.observations, base);
        Ok(ControlFlow::Continue(()))
    }

    /// Whether the next epoch begins behind the satellites of this one (RINEX 2). If more
    /// observations stand there, there was a line too many; only if there are many of them it is
    /// rather the next epoch line that is lost.
    fn ends_with_its_lines(&mut self) -> Result<bool, ReadError> {
        let mut extra = 0;
        let first = self.lines.line_number() + 1;
        while self.advance()? {
            if self.epoch_line().is_some() || !is_observations(self.lines.line()) {
                self.lines.hold_line();
                break;
            }
            extra += 1;
        }
        if extra == 0 {
            return Ok(true);
        }
        self.slips.mark_all();
        let layout = self.satellites.columns(self.header.default_system());
        let own = extra >= 2 * layout.columns.len().div_ceil(FIELDS_A_LINE);
        let fate = if own { "skipped" } else { "the epoch before is dropped" };
        self.damage.note_with(first, || format!("{extra} lines without an epoch, {fate}").into());
        Ok(own)
    }

    fn advance_past_comments(&mut self) -> Result<bool, ReadError> {
        loop {
            if !self.advance()? {
                return Ok(false);
            }
            if columns(self.lines.line(), 60..67) != b"COMMENT" {
                return Ok(true);
            }
        }
    }

    /// Passes over a line that should begin an epoch, and all up to the next one that does.
    fn skip_to_epoch(&mut self) -> Result<(), ReadError> {
        let first = self.lines.line_number();
        let line = self.lines.line();
        if says_nothing(line) {
            return Ok(());
        }
        let mut skipped = 1_u64;
        while self.advance()? {
            if self.epoch_line().is_some() || is_header_record(self.lines.line()) {
                self.lines.hold_line();
                break;
            }
            skipped += 1;
        }
        self.slips.mark_all();
        self.damage.note_with(first, || {
            format!("not an epoch line, skipped with {} lines behind it", skipped - 1).into()
        });
        Ok(())
    }
}

/// Whether a line in the data is a record of a header: no columns of observations read so.
fn is_header_record(line: &[u8]) -> bool {
    matches!(
        label(line),
        b"RINEX VERSION / TYPE"
            | b"CRINEX VERS   / TYPE"
            | b"CRINEX PROG / DATE"
            | b"PGM / RUN BY / DATE"
            | b"MARKER NAME"
            | b"OBSERVER / AGENCY"
            | b"REC # / TYPE / VERS"
            | b"ANT # / TYPE"
            | b"APPROX POSITION XYZ"
            | b"ANTENNA: DELTA H/E/N"
            | b"WAVELENGTH FACT L1/2"
            | b"# / TYPES OF OBSERV"
            | b"SYS / # / OBS TYPES"
            | b"TIME OF FIRST OBS"
            | b"END OF HEADER"
    )
}

/// Whether a line in the data is empty, a comment, or the mark that some programs end files with.
fn says_nothing(line: &[u8]) -> bool {
    let text = line.trim_ascii();
    text.is_empty() || text == b"END OF FILE" || columns(line, 60..67) == b"COMMENT"
}
