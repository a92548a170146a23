//! Everything that a row goes to: outputs, page, other bodies' view of this one, files; and what
//! connections that are yet to be made will know of it.

use std::sync::Arc;
use std::sync::atomic::Ordering::Relaxed;
use std::sync::mpsc::{SyncSender, TrySendError};
use std::time::{Duration, Instant};

use kurs::observation::ArrayEpoch;
use kurs::solution::EpochSolution;
use kurs::turn_rate::{AngleRates, TurnRate};

use crate::files::ForFiles;
use crate::input::Known;
use crate::lock::lock;
use crate::output::{Message, Sink};
use crate::page::Hub;
use crate::peer::{PeerLine, Peers};
use crate::setup::{Gga, Times};
use crate::status::Status;

/// A consumer drops an attitude that is older than this (ArduPilot: 300 ms to 400 ms); counted from
/// the first byte of the epoch.
pub(crate) const EXPIRES: Duration = Duration::from_millis(300);

/// See the module.
pub(crate) struct Outlets {
    pub(crate) status: Arc<Status>,
    pub(crate) sinks: Vec<Sink>,
    pub(crate) page: Option<Arc<Hub>>,
    pub(crate) peers: Option<Peers>,
    pub(crate) turn_rate: TurnRate,
    pub(crate) known: Arc<Known>,
    pub(crate) gga: Gga,
    pub(crate) rows: SyncSender<ForFiles>,
    /// A run over files: messages do not expire, and rows wait for the disk.
    pub(crate) once: bool,
}

impl Outlets {
    /// Shows an epoch and what the antennas alone make of it.
    pub(crate) fn see(&self, epoch: &ArrayEpoch, row: &EpochSolution) {
        self.page.iter().for_each(|page| page.see(epoch, row));
    }

    /// Sends a row everywhere.
    pub(crate) fn send(&mut self, row: EpochSolution, times: &Times) {
        self.status.note_row(&row, times);
        self.tell_connections(&row);
        // Rates need every row, though an output may not get every one.
        let rates = self.turn_rate.push(&row);
        let expires = (!self.once).then(|| times.first_byte + EXPIRES);
        self.send_messages(&row, &rates, times, expires);
        if let Some(page) = &self.page {
            page.note(&row, &rates, times);
        }
        if let Some(peers) = &mut self.peers {
            peers.push_own(&row, &rates, expires);
        }
        self.write(ForFiles::Row(Box::new(row)));
    }

    fn tell_connections(&self, row: &EpochSolution) {
        *lock(&self.known.time) = Some(row.time);
        if let Some(gga) = (self.gga)(row) {
            *lock(&self.known.gga) = Some(gga);
        }
    }

    fn send_messages(
        &mut self,
        row: &EpochSolution,
        rates: &AngleRates,
        times: &Times,
        expires: Option<Instant>,
    ) {
        for sink in &mut self.sinks {
            let Some(bytes) = sink.encode(row, rates, times) else { continue };
            if expires.is_some_and(|expires| Instant::now() > expires) {
                self.status.expired.fetch_add(1, Relaxed);
                sink.note_expired();
                continue;
            }
            sink.send(Message { bytes: bytes.into(), expires });
        }
    }

    /// Takes a line of another body.
    pub(crate) fn take_peer(&mut self, number: usize, line: PeerLine, arrived: Instant) {
        if let Some(peers) = &mut self.peers {
            peers.push(number, line, arrived);
        }
    }

    /// When a row waits no longer for other bodies.
    pub(crate) fn due(&self) -> Option<Instant> {
        self.peers.as_ref().and_then(Peers::due)
    }

    /// The other bodies at rows that need not wait for them any longer.
    pub(crate) fn send_relative(&mut self, now: Instant) {
        while let Some(rows) = self.peers.as_mut().and_then(|peers| peers.next_rows(now)) {
            self.status.note_relative(rows.clone());
            self.write(ForFiles::Relative(rows));
        }
    }

    /// Sends what still waits for other bodies.
    pub(crate) fn finish(&mut self) {
        while let Some(due) = self.due() {
            self.send_relative(due);
        }
    }

    /// A run over files waits for the disk; a live one goes on.
    fn write(&self, rows: ForFiles) {
        let unwritten = match self.once {
            true => self.rows.send(rows).is_err(),
            false => matches!(self.rows.try_send(rows), Err(TrySendError::Full(_))),
        };
        self.status.unwritten.fetch_add(u64::from(unwritten), Relaxed);
    }
}
