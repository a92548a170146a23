//! Rows to the files, by a thread of their own: a disk that stalls delays nothing else.

use std::io;
use std::sync::mpsc::{self, Receiver, SyncSender};
use std::thread;

use kurs::solution::EpochSolution;

use crate::peer::RelativeRow;
use crate::setup::{WriteRelative, WriteRow};

/// Rows that may wait for the files: a minute at 100 Hz.
const MAX_ROWS: usize = 6000;

/// What goes to the files.
pub(crate) enum ForFiles {
    Row(Box<EpochSolution>),
    /// Other bodies at one row of this one.
    Relative(Vec<RelativeRow>),
}

/// Starts the thread, which ends when the sender of rows is gone and the last one is written.
pub(crate) fn start(
    write_row: WriteRow,
    write_relative: WriteRelative,
) -> io::Result<(SyncSender<ForFiles>, thread::JoinHandle<()>)> {
    let (sender, rows) = mpsc::sync_channel(MAX_ROWS);
    let named = thread::Builder::new().name("rows".into());
    Ok((sender, named.spawn(move || write(&rows, write_row, write_relative))?))
}

fn write(rows: &Receiver<ForFiles>, mut write_row: WriteRow, mut write_relative: WriteRelative) {
    let mut last_error = String::new();
    for rows in rows {
        let written = match rows {
            ForFiles::Row(row) => write_row(&row),
            ForFiles::Relative(rows) => rows.iter().try_for_each(&mut write_relative),
        };
        match written {
            Ok(()) => last_error.clear(),
            // An error that goes on and on is reported once.
            Err(error) if error == last_error => {}
            Err(error) => {
                tracing::error!("a row cannot be written: {error}");
                last_error = error;
            }
        }
    }
}
