//! Writes UBX logs: RXM-RAWX, RXM-SFRBX.

use std::collections::{BTreeMap, BTreeSet};
use std::io::{self, Write};

use kurs::ephemeris::NavigationData;
use kurs::observation::{AntennaEpoch, Observation};
use kurs::signal::{Satellite, System};

use super::frame;
use super::rawx::{
    HALF_CYCLE_KNOWN, HEADER, LOCK_TIME_MAX_MS, MEASUREMENT, PHASE_VALID, RANGE_VALID, RXM_RAWX,
};
use super::sfrbx;
use super::signal::{satellite_ids, signal_id};
use crate::logs::lock_clock::LockClock;
use crate::navigation_frames::schedule::{Schedule, glonass_channels};

/// Measurements that a message has room for.
const MEASUREMENTS_MAX: usize = u8::MAX as usize;
/// Stated deviations: pseudorange 0.01 · 2⁵ m, phase 2 · 0.004 cycles, Doppler 0.002 · 2⁵ Hz.
const STATED_DEVIATIONS: [u8; 3] = [5, 2, 5];
/// `recStat`: the count of leap seconds is known.
const LEAP_SECONDS_KNOWN: u8 = 1;

/// Writes the log of one receiver.
#[derive(Debug)]
pub struct UbxWriter<W: Write> {
    output: W,
    glonass_channels: BTreeMap<u8, i8>,
    locks: LockClock,
    schedule: Schedule,
    payload: Vec<u8>,
}

impl<W: Write> UbxWriter<W> {
    /// Begins a log of a receiver that receives the ephemerides of `navigation` too. Signals that
    /// u-blox has no number for, and GLONASS satellites without a known channel, are left out of
    /// it.
    pub fn new(output: W, navigation: &NavigationData) -> Self {
        Self {
            output,
            glonass_channels: glonass_channels(navigation),
            locks: LockClock::default(),
            schedule: Schedule::new(navigation),
            payload: Vec::new(),
        }
    }

    /// Writes an epoch as RXM-RAWX, and the ephemerides that have come by then.
    ///
    /// # Errors
    ///
    /// What the output refuses.
    pub fn write(&mut self, epoch: &AntennaEpoch) -> io::Result<()> {
        let time = epoch.time;
        let week = u16::try_from(time.week()).map_err(io::Error::other)?;
        let leap_seconds = i8::try_from(time.leap_seconds()).map_err(io::Error::other)?;
        self.payload.clear();
        self.payload.extend(time.tow_s().to_le_bytes());
        self.payload.extend(week.to_le_bytes());
        self.payload.extend(leap_seconds.to_le_bytes());
        // Count of measurements (set below), status, version, two reserved bytes.
        self.payload.extend([0, LEAP_SECONDS_KNOWN, 1, 0, 0]);
        let mut count = 0u8;
        for o in epoch.observations.iter().take(MEASUREMENTS_MAX) {
            let lock_s = self.locks.lock_s(time, o);
            let Some(measurement) = self.measurement(o, lock_s) else { continue };
            self.payload.extend(measurement);
            count += 1;
        }
        self.payload[11] = count;
        debug_assert_eq!(self.payload.len(), HEADER + MEASUREMENT * usize::from(count));
        self.output.write_all(&frame(RXM_RAWX, &self.payload))?;
        while let Some(ephemeris) = self.schedule.next(time) {
            let payloads = sfrbx::payloads(&ephemeris, time);
            if payloads.is_empty() {
                self.schedule.leave_out(ephemeris.satellite());
            }
            for payload in payloads {
                self.output.write_all(&frame(sfrbx::RXM_SFRBX, &payload))?;
            }
        }
        Ok(())
    }

    fn measurement(&self, o: &Observation, lock_s: f64) -> Option<[u8; MEASUREMENT]> {
        let (system, number) = satellite_ids(o.satellite)?;
        let signal = signal_id(o.satellite, o.signal)?;
        let channel = match o.satellite.system {
            System::Glonass => u8::try_from(self.glonass_channels.get(&o.satellite.number)? + 7),
            _ => Ok(0),
        };
        let mut status = 0;
        for (flag, holds) in [
            (RANGE_VALID, o.pseudorange_m.is_some()),
            (PHASE_VALID, o.phase_cycles.is_some()),
            (HALF_CYCLE_KNOWN, !o.lock.half_cycle_unresolved()),
        ] {
            status |= if holds { flag } else { 0 };
        }
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // `as` saturates
        let (lock_ms, cn0, doppler_hz) = (
            (lock_s * 1e3).round().min(f64::from(LOCK_TIME_MAX_MS)) as u16,
            o.cn0_dbhz.unwrap_or(0.0).round() as u8,
            o.doppler_hz.unwrap_or(0.0) as f32,
        );
        let mut m = [0; MEASUREMENT];
        m[0..8].copy_from_slice(&o.pseudorange_m.unwrap_or(0.0).to_le_bytes());
        m[8..16].copy_from_slice(&o.phase_cycles.unwrap_or(0.0).to_le_bytes());
        m[16..20].copy_from_slice(&doppler_hz.to_le_bytes());
        m[20..24].copy_from_slice(&[system, number, signal, channel.ok()?]);
        m[24..26].copy_from_slice(&lock_ms.to_le_bytes());
        m[26] = cn0;
        m[27..30].copy_from_slice(&STATED_DEVIATIONS);
        m[30] = status;
        Some(m)
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
