//! RXM-RAWX: the observations of one epoch.

use std::collections::BTreeMap;

use kurs::observation::{AntennaEpoch, Observation};
use kurs::signal::System;
use kurs::time::GpsTime;

use super::signal::{glonass_channel, satellite, signal};
use crate::damage::DamageLog;
use crate::logs::lock_time::{LockTime, LockTimes, Tracked};
use crate::logs::{LittleEndian, is_empty, plausible};

/// Class and number of the message.
pub(crate) const RXM_RAWX: [u8; 2] = [0x02, 0x15];
pub(super) const HEADER: usize = 16;
pub(super) const MEASUREMENT: usize = 32;

/// `trkStat`: what of a measurement is good.
pub(super) const RANGE_VALID: u8 = 1;
pub(super) const PHASE_VALID: u8 = 2;
pub(super) const HALF_CYCLE_KNOWN: u8 = 4;
const HALF_CYCLE_ADDED: u8 = 8;

/// Where the count of the lock time stops, ms.
pub(super) const LOCK_TIME_MAX_MS: u16 = 64_500;

/// The time tag by the receiver's own clock; `None` while the receiver does not know the week.
pub(crate) fn time(payload: &[u8]) -> Option<GpsTime> {
    let week = i32::from(payload.u16(8)?);
    GpsTime::from_week_tow(week, payload.f64(0)?).filter(|_| week > 0)
}

/// Reads the observations of a message into `epoch`, whose time is set already.
pub(crate) fn read(
    payload: &[u8],
    offset: u64,
    epoch: &mut AntennaEpoch,
    locks: &mut LockTimes,
    glonass_channels: &mut BTreeMap<u8, i8>,
    damage: &mut DamageLog,
) {
    let measurements = payload.get(HEADER..).unwrap_or_default().chunks_exact(MEASUREMENT);
    if payload.get(11).map(|count| usize::from(*count)) != Some(measurements.len()) {
        damage.note(offset, "RXM-RAWX: the count of measurements does not fit the length");
    }
    for m in measurements {
        let Some(satellite) = satellite(m[20], m[21]) else { continue };
        let Some(signal) = signal(satellite.system, m[22]) else { continue };
        let lock_ms = u16::from_le_bytes([m[24], m[25]]);
        let status = m[30];
        let has = |flag: u8| status & flag != 0;
        let least_s = f64::from(lock_ms) * 1e-3;
        let stopped = lock_ms >= LOCK_TIME_MAX_MS;
        let most_s = if stopped { f64::INFINITY } else { least_s + 1e-3 };
        let phase_cycles = m.f64(8).filter(|_| has(PHASE_VALID)).and_then(plausible);
        let tracked = Tracked {
            satellite,
            signal,
            time: epoch.time,
            lock: Some(LockTime { least_s, most_s }),
            half_cycle_added: has(HALF_CYCLE_ADDED),
            has_phase: phase_cycles.is_some(),
        };
        let Some(lock) = locks.digit(&tracked, !has(HALF_CYCLE_KNOWN)) else { continue };
        if satellite.system == System::Glonass
            && let Some(channel) = glonass_channel(m[23])
        {
            glonass_channels.insert(satellite.number, channel);
        }
        let observation = Observation {
            satellite,
            signal,
            pseudorange_m: m.f64(0).filter(|_| has(RANGE_VALID)).and_then(plausible),
            phase_cycles,
            doppler_hz: m.f32(16).map(f64::from).and_then(plausible),
            cn0_dbhz: plausible(f64::from(m[26])),
            lock,
        };
        if !is_empty(&observation) {
            epoch.observations.push(observation);
        }
    }
}
