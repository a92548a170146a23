//! The list of observation types in a header: which column of the data has which name.
//!
//! The first record of a list declares how many names it has. Where there are others the header is
//! damaged, and a name that is lost must not move those behind it into the columns of other
//! signals.

use kurs::signal::System;

use super::header::ObservationCode;
use crate::damage::DamageLog;
use crate::rinex::fields::integer;

/// Columns of a system that are kept; the header of a sane file stays far below.
const COLUMNS_MAX: usize = 200;
/// The code of a column that has no name.
const NAMELESS: ObservationCode = ObservationCode(*b"   ");

/// A list under construction, record by record.
#[derive(Debug)]
pub(super) struct TypeList {
    /// Line of its first record.
    line: u64,
    /// `None` in RINEX 2, where one list is for all systems.
    pub(super) system: Option<System>,
    /// How many names it should have, if that can be read.
    declared: Option<usize>,
    /// The names of all records, nameless where there is none.
    places: Vec<ObservationCode>,
    /// Names that a record has room for.
    room: usize,
}

impl TypeList {
    /// A list that begins at `line`; `declared` are the columns of the number.
    pub(super) fn begin(line: u64, system: Option<System>, declared: &[u8], room: usize) -> Self {
        let declared = integer(declared).and_then(|count| usize::try_from(count).ok());
        Self { line, system, declared, places: Vec::new(), room }
    }

    /// Takes the names of one record, `None` where a place is blank or cut.
    pub(super) fn take(&mut self, names: impl Iterator<Item = Option<ObservationCode>>) {
        let left = COLUMNS_MAX - self.places.len();
        self.places.extend(names.map(|name| name.unwrap_or(NAMELESS)).take(left));
    }

    fn names(&self) -> impl Iterator<Item = ObservationCode> + '_ {
        self.places.iter().copied().filter(|code| *code != NAMELESS)
    }

    /// The columns of the data as far as they are known.
    pub(super) fn columns(&self) -> Vec<ObservationCode> {
        let (found, behind_last) = (self.names().count(), self.behind_last_name());
        match self.declared {
            // Some programs leave places at the end of a record free.
            Some(declared) if found == declared => self.names().collect(),
            Some(declared) if found < declared => {
                let mut columns = self.places.clone();
                columns.truncate(if self.has_all_records(declared) { declared } else { self.room });
                columns.resize(declared.min(COLUMNS_MAX), NAMELESS);
                columns
            }
            _ => self.places[..behind_last].to_vec(),
        }
    }

    fn behind_last_name(&self) -> usize {
        self.places.iter().rposition(|code| *code != NAMELESS).map_or(0, |last| last + 1)
    }

    /// Whether the names of a list that is too short stand in their places: no record is missing,
    /// and none has places that were left free.
    fn has_all_records(&self, declared: usize) -> bool {
        self.places.len() >= declared && self.behind_last_name() <= declared
    }

    /// Notes a list with other than the declared number of names.
    pub(super) fn note_count(&self, damage: &mut DamageLog) {
        let found = self.names().count();
        let what = match self.declared {
            Some(declared) if found == declared => return,
            Some(declared) => {
                let fate = if found > declared {
                    "all of them are read"
                } else if self.has_all_records(declared) {
                    "columns without a name are not read"
                } else {
                    "which columns are those behind the first line is unknown, they are not read"
                };
                format!("{found} observation types instead of {declared}; {fate}")
            }
            None => format!("the number of observation types is unreadable, {found} are named"),
        };
        let who = self.system.map(|system| format!("{system}: ")).unwrap_or_default();
        damage.note(self.line, who + &what);
    }
}
