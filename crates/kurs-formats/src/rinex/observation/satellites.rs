//! The satellites of an epoch: which columns their lines have, and whose phases have slipped.

use kurs::signal::{Satellite, System};

use super::columns::Columns;
use super::header::ObservationHeader;
use crate::damage::DamageLog;
use crate::pending_slips::PendingSlips;

/// The columns of all systems, and the satellites of this epoch and of the one before.
#[derive(Debug, Default)]
pub(super) struct Satellites {
    /// One for each system, in the order of [`System::ALL`].
    columns: [Columns; System::ALL.len()],
    /// Systems whose observations are not wanted, in that order.
    pub(super) passed_over: [bool; System::ALL.len()],
    /// In the order of the file; `None` for a satellite that is skipped.
    pub(super) listed: Vec<Option<Satellite>>,
    before: Vec<Option<Satellite>>,
}

impl Satellites {
    /// Works out what the columns mean; `damage` names the codes that mean nothing.
    pub(super) fn lay_out(
        &mut self,
        header: &ObservationHeader,
        line_number: u64,
        damage: &mut DamageLog,
    ) {
        for (columns, system) in self.columns.iter_mut().zip(System::ALL) {
            let known = core::mem::replace(columns, Columns::of(system, header));
            if !columns.unknown.is_empty() && columns.unknown != known.unknown {
                let version = header.version;
                let who = if version.major < 3 { "no system".into() } else { system.to_string() };
                let has = if version.major < 3 { "has" } else { "has no" };
                let names: Vec<String> = columns.unknown.iter().map(ToString::to_string).collect();
                let names = names.join(", ");
                let what = format!("{who} {has} observations {names} in RINEX {version}, not read");
                damage.note(line_number, what);
            }
        }
    }

    pub(super) const fn columns(&self, system: System) -> &Columns {
        &self.columns[system as usize]
    }

    pub(super) const fn is_wanted(&self, system: System) -> bool {
        !self.passed_over[system as usize]
    }

    /// Starts an epoch, which has no satellites yet.
    pub(super) fn begin_epoch(&mut self) {
        core::mem::swap(&mut self.listed, &mut self.before);
        self.listed.clear();
    }

    /// Adds a satellite to the epoch and gives its columns; `None` if its line is not to be read,
    /// which is damage where the header declares no columns for the system.
    pub(super) fn begin_satellite(
        &mut self,
        satellite: Satellite,
        line_number: u64,
        damage: &mut DamageLog,
    ) -> Option<&Columns> {
        self.listed.push(Some(satellite));
        let columns = self.columns(satellite.system);
        if columns.columns.is_empty() {
            let what = "no observations of this system in the header, skipped";
            damage.note_with(line_number, || format!("{satellite}: {what}").into());
            return None;
        }
        self.is_wanted(satellite.system).then_some(columns)
    }

    /// Marks all signals of a satellite as slipped.
    pub(super) fn mark(&self, satellite: Satellite, slips: &mut PendingSlips) {
        for signal in &self.columns(satellite.system).signals {
            slips.mark(satellite, *signal);
        }
    }

    /// Marks the satellites that the epoch before had and this one has not.
    pub(super) fn mark_absent(&self, slips: &mut PendingSlips) {
        for satellite in self.before.iter().filter(|s| !self.listed.contains(s)).flatten() {
            self.mark(*satellite, slips);
        }
    }
}
