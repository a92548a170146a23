//! The rows of a service in one folder for every day (GPST) of its epochs.

use std::path::{Path, PathBuf};

use kurs::solution::EpochSolution;
use kurs::time::GpsTime;
use kurs_live::RelativeRow;

use crate::solve::antenna_names;
use crate::solve::config::Loaded;
use crate::table::Table;
use crate::tables::{self, RELATIVE, Tables};

/// See the module; a service that begins again on the same day goes on with its files.
pub(super) struct DayTables {
    directory: PathBuf,
    antennas: Vec<String>,
    points: Vec<String>,
    has_station: bool,
    /// Day and tables.
    open: Option<(String, Tables)>,
    /// Other bodies, opened with the first row of one.
    relative: Option<(String, Table)>,
}

impl DayTables {
    pub(super) fn new(directory: &Path, loaded: &Loaded) -> Self {
        Self {
            directory: directory.to_owned(),
            antennas: antenna_names(loaded),
            points: loaded.config.point.iter().map(|point| point.name.clone()).collect(),
            has_station: loaded.config.station.is_some(),
            open: None,
            relative: None,
        }
    }

    /// Writes the rows of an epoch and hands them on to the system.
    pub(super) fn write(&mut self, row: &EpochSolution) -> anyhow::Result<()> {
        let day = day(row.time);
        if self.open.as_ref().is_none_or(|(open, _)| *open != day) {
            let before = self.open.take().map(|(_, tables)| tables.into_turn_rate());
            let tables = Tables::append(
                &self.directory.join(&day),
                self.antennas.clone(),
                self.points.clone(),
                self.has_station,
                before.unwrap_or_default(),
            )?;
            self.open = Some((day, tables));
        }
        let written = self.open.as_mut().map_or(Ok(()), |(_, tables)| {
            tables.write(row)?;
            tables.flush()
        });
        if written.is_err() {
            // Its buffers may end inside a row, which is cut off when the file is opened again.
            self.open = None;
        }
        written
    }

    /// Writes another body as seen from this one.
    pub(super) fn write_relative(&mut self, row: &RelativeRow) -> anyhow::Result<()> {
        let day = day(row.time);
        if self.relative.as_ref().is_none_or(|(open, _)| *open != day) {
            let table = Table::append(&self.directory.join(&day), "relative", RELATIVE)?;
            self.relative = Some((day, table));
        }
        let written = self.relative.as_mut().map_or(Ok(()), |(_, table)| {
            tables::write_relative(table, row)?;
            table.flush()
        });
        if written.is_err() {
            self.relative = None;
        }
        written
    }
}

/// The folder of a day (GPST).
fn day(time: GpsTime) -> String {
    let date = time.calendar();
    format!("{:04}-{:02}-{:02}", date.year, date.month, date.day)
}
