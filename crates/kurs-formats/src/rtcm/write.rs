//! Writes RTCM 3 logs: 1006, MSM 7 and ephemerides.

use std::collections::{BTreeMap, BTreeSet};
use std::io::{self, Write};

use kurs::ephemeris::NavigationData;
use kurs::frames::{Ecef, Vector};
use kurs::observation::{AntennaEpoch, Observation};
use kurs::signal::{Satellite, System};
use kurs::time::GpsTime;

use super::msm::{self, CELLS_MAX, Cell, MS_M};
use super::{clock, ephemeris, place};
use crate::logs::checksum::crc24q;
use crate::logs::lock_clock::LockClock;
use crate::logs::whole_cycles::WholeCycles;
use crate::logs::whole_milliseconds;
use crate::navigation_frames::schedule::{Schedule, glonass_channels};

/// How far a phase may be from the rough range, ms: less than the 2⁻⁸ of the format.
const PHASE_SPAN_MS: f64 = 0.0035;
/// The station's place is sent so often, s.
const PLACE_INTERVAL_S: f64 = 10.0;

/// Writes the log of one receiver.
///
/// Phases differ from those of the observations by whole cycles, which the format has no room for;
/// time tags are whole milliseconds, and observations are moved there as a receiver clock that was
/// set would have them.
#[derive(Debug)]
pub struct Rtcm3Writer<W: Write> {
    output: W,
    station: u16,
    place: Vector<Ecef>,
    place_sent: Option<GpsTime>,
    glonass_channels: BTreeMap<u8, i8>,
    locks: LockClock,
    whole_cycles: WholeCycles,
    schedule: Schedule,
}

impl<W: Write> Rtcm3Writer<W> {
    /// Begins a log of a receiver at `place` that receives the ephemerides of `navigation` too.
    /// Signals that the format has no number for, and GLONASS satellites without a known channel,
    /// are left out of it.
    pub fn new(output: W, station: u16, place: Vector<Ecef>, navigation: &NavigationData) -> Self {
        Self {
            output,
            station: station & 0xfff,
            place,
            place_sent: None,
            glonass_channels: glonass_channels(navigation),
            locks: LockClock::default(),
            whole_cycles: WholeCycles::default(),
            schedule: Schedule::new(navigation),
        }
    }

    /// Writes an epoch, and before it the ephemerides that have come by then.
    ///
    /// # Errors
    ///
    /// What the output refuses.
    pub fn write(&mut self, epoch: &AntennaEpoch) -> io::Result<()> {
        if self.place_sent.is_none_or(|sent| epoch.time - sent >= PLACE_INTERVAL_S) {
            self.place_sent = Some(epoch.time);
            self.send(place::write(self.station, self.place))?;
        }
        while let Some(next) = self.schedule.next(epoch.time) {
            let message = ephemeris::write(&next, epoch.time);
            if message.is_none() {
                self.schedule.leave_out(next.satellite());
            }
            self.send(message)?;
        }
        // t' = t + δ is a clock that shows δ more: every range grows by c δ.
        let tag = whole_milliseconds(epoch.time);
        let shift_ms = (tag - epoch.time) * 1e3;
        let mut messages: Vec<(System, Vec<Cell>)> = Vec::new();
        for system in System::ALL {
            let of_system = epoch.observations.iter().filter(|o| o.satellite.system == system);
            let mut cells: Vec<Cell> = Vec::new();
            for o in of_system {
                let lock_s = self.locks.lock_s(epoch.time, o);
                cells.extend(self.cell(o, lock_s, shift_ms));
            }
            cells.sort_by_key(|cell| cell.satellite);
            messages.extend(in_messages(cells).into_iter().map(|cells| (system, cells)));
        }
        let last = messages.len().saturating_sub(1);
        for (index, (system, cells)) in messages.iter().enumerate() {
            let time = clock::bits(*system, tag);
            self.send(msm::write(*system, self.station, time, index < last, cells))?;
        }
        Ok(())
    }

    /// The observation as the message has it; `None` without a pseudorange, which everything else
    /// hangs on, and for signals without a number.
    fn cell(&mut self, o: &Observation, lock_s: f64, shift_ms: f64) -> Option<Cell> {
        let range_ms = o.pseudorange_m? / MS_M + shift_ms;
        let channel = match o.satellite.system {
            System::Glonass => Some(*self.glonass_channels.get(&o.satellite.number)?),
            _ => None,
        };
        let wavelength_m = o.signal.band.wavelength_m(channel)?;
        super::signal::signal_bit(o.signal)?;
        super::signal::satellite_bit(o.satellite)?;
        let wavelength_ms = wavelength_m / MS_M;
        let key = (o.satellite, o.signal);
        let phase_ms = o.phase_cycles.map(|cycles| {
            let range_cycles = (range_ms - shift_ms) / wavelength_ms;
            let span_cycles = PHASE_SPAN_MS / wavelength_ms;
            let kept = self.whole_cycles.take_off(key, cycles, range_cycles, span_cycles);
            kept * wavelength_ms + shift_ms
        });
        Some(Cell {
            satellite: o.satellite,
            signal: o.signal,
            range_ms,
            phase_ms,
            rate_mps: o.doppler_hz.map(|doppler_hz| -doppler_hz * wavelength_m),
            lock_s,
            half_cycle: o.lock.half_cycle_unresolved(),
            strength_dbhz: o.cn0_dbhz.unwrap_or(0.0),
            extended: channel.map_or(0, |channel| (channel + 7).cast_unsigned()),
        })
    }

    /// Sends a message, if it could be made.
    fn send(&mut self, message: Option<Vec<u8>>) -> io::Result<()> {
        let Some(message) = message else { return Ok(()) };
        let length = u16::try_from(message.len()).map_err(io::Error::other)?;
        let mut frame = vec![0xd3];
        frame.extend(length.to_be_bytes());
        frame.extend(message);
        let checksum = crc24q(&frame);
        frame.extend(checksum);
        self.output.write_all(&frame)
    }

    /// Satellites with an ephemeris that the log does not have, because the message has no room for
    /// one of its values (a GLONASS reference time off the quarter hour) or does not exist.
    #[must_use]
    pub const fn left_out(&self) -> &BTreeSet<Satellite> {
        self.schedule.left_out()
    }

    /// Gives the output back.
    pub fn finish(self) -> W {
        self.output
    }
}

/// Cells of one system in as many messages as their masks need; a satellite is in one message.
fn in_messages(cells: Vec<Cell>) -> Vec<Vec<Cell>> {
    let mut messages: Vec<Vec<Cell>> = Vec::new();
    let mut rest = cells.as_slice();
    while let Some(first) = rest.first() {
        let count = rest.iter().take_while(|cell| cell.satellite == first.satellite).count();
        let (of_satellite, behind) = rest.split_at(count);
        rest = behind;
        match messages.last_mut() {
            Some(last) if msm::mask_size(&[last, of_satellite].concat()) <= CELLS_MAX => {
                last.extend(of_satellite);
            }
            _ => messages.push(of_satellite.to_vec()),
        }
    }
    messages
}
