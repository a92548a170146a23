//! One record of a navigation file: its lines as a satellite, a date and numbers.

use core::fmt;

use kurs::signal::{Satellite, System};
use kurs::time::Calendar;

use super::Version;
use crate::rinex::fields::{columns, exponential, small_integer, text};

/// Numbers that a record of 9 lines after the epoch line can have; what goes beyond is dropped.
const VALUES_MAX: usize = 40;

/// Columns of a number (D19.12).
const NUMBER: usize = 19;

/// What a record is about.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) enum Kind {
    /// No record was begun.
    #[default]
    None,
    Ephemeris,
    Ionosphere,
    TimeOffset,
    /// Read past.
    Other,
}

/// A record under construction.
#[derive(Debug, Default)]
pub(super) struct Record {
    pub(super) kind: Kind,
    /// Line of the file where it begins.
    pub(super) line: u64,
    pub(super) satellite: Option<Satellite>,
    /// Message type of RINEX 4, empty in older files.
    pub(super) message: String,
    /// Which time scales a RINEX 4 STO record is about.
    pub(super) offset_code: [u8; 4],
    pub(super) date: Option<Calendar>,
    /// The date as the file has it.
    pub(super) date_text: String,
    /// The numbers in their order, without the date.
    pub(super) values: Vec<f64>,
    has_lines: bool,
    /// Lines behind the one with the date.
    pub(super) further_lines: usize,
    /// Blanks before the numbers of its further lines.
    indent: usize,
    /// Satellite or date that could not be read.
    pub(super) damage: Option<String>,
    /// Numbers that could not be read: their indices, and what stands there.
    pub(super) damaged_values: Vec<(usize, String)>,
    /// Numbers that count as zero because nothing stands in their places.
    pub(super) gaps: Vec<Gap>,
}

/// A field that is blank, or in which its line ends.
#[derive(Debug, Clone, Copy)]
pub(super) struct Gap {
    /// Index of the number in the record.
    pub(super) index: usize,
    line: u64,
    /// Counted from 0.
    column: usize,
}

impl fmt::Display for Gap {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (first, last) = (self.column + 1, self.column + NUMBER);
        write!(f, "no whole number in columns {first} to {last} of line {}", self.line)
    }
}

/// Whether a record begins with this line: a frame line, or a satellite and a date.
pub(super) fn begins(line: &[u8], version: Version) -> bool {
    let start = indent(line, version);
    line.starts_with(b"> ")
        || satellite(columns(line, 0..3), version.system).is_some()
            && calendar(columns(line, start - 1..start + 19)).is_some()
}

/// Columns before the numbers of a record's lines, and of the satellite's name in the first one. In
/// RINEX 2 a name with the letter of its system (RINEX 2.12) takes a column more.
fn indent(line: &[u8], version: Version) -> usize {
    let has_letter = line.first().is_some_and(u8::is_ascii_alphabetic);
    if version.major == 2 && !has_letter { 3 } else { 4 }
}

impl Record {
    /// Begins with a frame line of RINEX 4: `> EPH G05 LNAV`.
    pub(super) fn begin_frame(&mut self, line: &[u8], number: u64) {
        let line = String::from_utf8_lossy(line);
        let mut words = line.split_ascii_whitespace().skip(1);
        let about = words.next().unwrap_or_default();
        let kind = match about {
            "EPH" => Kind::Ephemeris,
            "ION" => Kind::Ionosphere,
            "STO" => Kind::TimeOffset,
            _ => Kind::Other,
        };
        let satellite = words.next().and_then(|name| name.parse().ok());
        let mut message = words.next().unwrap_or_default().to_owned();
        if kind == Kind::Other {
            message = format!("{about} {message}");
        }
        *self = Self { kind, line: number, satellite, message, ..Self::default() };
    }

    /// Whether a RINEX 4 frame line was the last line.
    pub(super) fn is_frame_without_lines(&self) -> bool {
        self.kind != Kind::None && !self.has_lines
    }

    /// Whether `line` belongs to this record.
    pub(super) fn is_continued_by(&self, line: &[u8], version: Version) -> bool {
        let width = if self.kind == Kind::None { indent(line, version) } else { self.indent };
        line.iter().take(width).all(|byte| *byte == b' ')
    }

    /// Begins with an epoch line (RINEX 2 and 3), or takes it as the first line of a frame.
    pub(super) fn begin(&mut self, line: &[u8], number: u64, version: Version) {
        if self.kind == Kind::None {
            self.kind = Kind::Ephemeris;
            self.line = number;
            self.satellite = satellite(columns(line, 0..3), version.system);
            if self.satellite.is_none() {
                self.note(format!("{:?} is not a satellite", text(line, 0..3)));
            }
        }
        self.has_lines = true;
        let start = indent(line, version);
        self.indent = start;
        self.date = calendar(columns(line, start - 1..start + 19));
        self.date_text = text(line, start..start + 19);
        if self.date.is_none() {
            self.note(format!("{:?} is not a date and time", self.date_text));
        }
        if self.kind == Kind::TimeOffset {
            let code = columns(line, 24..28);
            self.offset_code[..code.len()].copy_from_slice(code);
        } else {
            self.take_numbers(line, number, start + 19, 3);
        }
    }

    /// Takes one more line.
    pub(super) fn continue_with(&mut self, line: &[u8], number: u64) {
        self.further_lines += 1;
        self.take_numbers(line, number, self.indent, 4);
    }

    fn take_numbers(&mut self, line: &[u8], number: u64, start: usize, count: usize) {
        for i in 0..count {
            let column = start + NUMBER * i;
            let field = column..column + NUMBER;
            let index = self.values.len();
            if index == VALUES_MAX {
                break;
            }
            let there = columns(line, field.clone());
            let value = exponential(there);
            if value.is_none() {
                let what = format!("{:?} is not a number", text(line, field));
                self.damaged_values.push((index, what));
            } else if there.len() < NUMBER || there.trim_ascii().is_empty() {
                // Numbers end in the last column of their fields: one that ends before lost digits,
                // and maybe its exponent.
                self.gaps.push(Gap { index, line: number, column });
            }
            self.values.push(value.unwrap_or(0.0));
        }
    }

    fn note(&mut self, damage: String) {
        self.damage.get_or_insert(damage);
    }

    /// The number at `index`, zero if the record is shorter.
    pub(super) fn value(&self, index: usize) -> f64 {
        self.values.get(index).copied().unwrap_or(0.0)
    }

    /// Whether the number at `index` is there and was read.
    pub(super) fn has(&self, index: usize) -> bool {
        index < self.values.len() && !self.damaged_values.iter().any(|(at, _)| *at == index)
    }

    /// System and message, for the count of records that are read past.
    pub(super) fn name(&self) -> String {
        let letter = self.satellite.map_or('?', |satellite| satellite.system.letter());
        format!("{letter} {}", self.message).trim_end().to_owned()
    }
}

/// `"G05"`, `"G 5"`, or in RINEX 2 `" 5"` of the file's system.
fn satellite(field: &[u8], of_file: System) -> Option<Satellite> {
    let (system, digits) = match field.first()? {
        b' ' | b'0'..=b'9' => (of_file, columns(field, 0..2)),
        letter => (System::from_letter(*letter)?, columns(field, 1..3)),
    };
    let number = small_integer(digits)?;
    (1..=99).contains(&number).then_some(Satellite::new(system, number))
}

/// `yyyy mm dd hh mm ss` or `yy mm dd hh mm ss.s`; two digits are 1980 to 2079.
fn calendar(field: &[u8]) -> Option<Calendar> {
    let mut words = str::from_utf8(field).ok()?.split_ascii_whitespace();
    let year: i32 = words.next()?.parse().ok()?;
    let mut small = || words.next()?.parse::<u8>().ok();
    let (month, day, hour, minute) = (small()?, small()?, small()?, small()?);
    let second = words.next()?.parse().ok()?;
    let year = match year {
        0..80 => 2000 + year,
        80..100 => 1900 + year,
        _ => year,
    };
    Some(Calendar { year, month, day, hour, minute, second })
}
