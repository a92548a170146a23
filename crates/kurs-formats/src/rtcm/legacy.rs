//! The observation messages before the multiple signal messages: 1002 and 1004 (GPS and SBAS), 1010
//! and 1012 (GLONASS).
//!
//! Source: RTCM 10403.3, tables 3.5-1 to 3.5-4 and 3.5-9 to 3.5-12. (1001, 1003, 1009 and 1011
//! leave out the whole milliseconds of the ranges.)

use std::collections::BTreeMap;

use kurs::observation::Observation;
use kurs::signal::{Satellite, Signal, System};
use kurs::time::GpsTime;

use super::lock;
use super::msm::MS_M;
use crate::fields::{BitReader, sign_extended};
use crate::logs::lock_time::{LockTimes, Tracked};
use crate::logs::{is_empty, plausible};

/// Units of ranges, m; of phases less ranges, m; of strengths, dB-Hz.
const RANGE_M: f64 = 0.02;
const PHASE_M: f64 = 0.0005;
const STRENGTH_DBHZ: f64 = 0.25;
/// GLONASS: what the whole part of a range counts, light milliseconds.
const GLONASS_MODULUS_MS: f64 = 2.0;
/// Cycles by which phases less ranges are brought back into their field.
const ROLLOVER_CYCLES: f64 = 1500.0;
/// Satellite numbers from here on are those of SBAS, less this and 20.
const FIRST_SBAS: u8 = 40;

/// What a message number says of the layout.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Layout {
    pub(super) system: System,
    has_second_band: bool,
    /// Whole milliseconds and strengths are there.
    is_extended: bool,
}

/// The layout of a message, if it is one of 1001 to 1004 or 1009 to 1012.
pub(super) const fn layout(number: u16) -> Option<Layout> {
    let (system, place) = match number {
        1001..=1004 => (System::Gps, number - 1001),
        1009..=1012 => (System::Glonass, number - 1009),
        _ => return None,
    };
    Some(Layout { system, has_second_band: place >= 2, is_extended: place % 2 == 1 })
}

impl Layout {
    /// Whether the ranges are whole.
    pub(super) const fn has_whole_ranges(self) -> bool {
        self.is_extended
    }

    /// Bits of the epoch time.
    pub(super) const fn time_bits(self) -> u32 {
        if matches!(self.system, System::Glonass) { 27 } else { 30 }
    }
}

/// What is remembered from one epoch to the next.
#[derive(Debug, Default)]
pub(super) struct Memory {
    locks: LockTimes,
    /// Phase less range in cycles, and the cycles that were put on it.
    unwrapped: BTreeMap<(Satellite, Signal), f64>,
}

/// The numbers of one band as the message has them.
struct BandFields {
    code: u64,
    range: Option<f64>,
    phase_less_range: u64,
    lock: u64,
    strength: u64,
}

/// The numbers of one satellite as the message has them.
struct SatelliteFields {
    number: u8,
    /// The frequency channel, which only GLONASS has.
    channel: Option<i8>,
    /// The range of the first band.
    range_m: f64,
    first: BandFields,
    second: Option<BandFields>,
}

impl SatelliteFields {
    /// Reads the next satellite; `None` if the message ends before it does.
    fn read(reader: &mut BitReader<'_>, layout: Layout) -> Option<Self> {
        let is_glonass = layout.system == System::Glonass;
        let number = u8::try_from(reader.take(6)).ok()?;
        let code = reader.take(1);
        let channel = if is_glonass { i8::try_from(reader.take(5)).ok() } else { None };
        let range = reader.take(if is_glonass { 25 } else { 24 });
        let (phase_less_range, lock) = (reader.take(20), reader.take(7));
        let whole = reader.take(if is_glonass { 7 } else { 8 });
        let strength = reader.take(8);
        let modulus_m = if is_glonass { GLONASS_MODULUS_MS } else { 1.0 } * MS_M;
        let range_m = range as f64 * RANGE_M + whole as f64 * modulus_m;
        let first = BandFields { code, range: Some(range_m), phase_less_range, lock, strength };
        let second = layout.has_second_band.then(|| {
            let code = reader.take(2);
            let difference = sign_extended(reader.take(14), 14);
            let range = (difference != -8192).then_some(range_m + difference as f64 * RANGE_M);
            let (phase_less_range, lock) = (reader.take(20), reader.take(7));
            BandFields { code, range, phase_less_range, lock, strength: reader.take(8) }
        });
        let channel = channel.filter(|channel| (0..=13).contains(channel)).map(|c| c - 7);
        reader.is_whole().then_some(Self { number, channel, range_m, first, second })
    }
}

impl Memory {
    /// Reads the observations of a message; `None` if it is shorter than its count says.
    pub(super) fn read(
        &mut self,
        layout: Layout,
        message: &[u8],
        time: GpsTime,
        glonass_channels: &mut BTreeMap<u8, i8>,
        observations: &mut Vec<Observation>,
    ) -> Option<()> {
        let mut reader = BitReader::new(message);
        reader.take(12 + 12);
        reader.take(layout.time_bits() + 1);
        let count = reader.take(5);
        reader.take(1 + 3); // smoothing
        for _ in 0..count {
            let fields = SatelliteFields::read(&mut reader, layout)?;
            let Some(satellite) = satellite(layout.system, fields.number) else { continue };
            if let Some(channel) = fields.channel {
                glonass_channels.insert(fields.number, channel);
            }
            let channel = glonass_channels.get(&fields.number).copied();
            for (digit, band) in [(1, Some(&fields.first)), (2, fields.second.as_ref())] {
                let Some(band) = band else { continue };
                let signal =
                    Signal::new(satellite.system, digit, attribute(satellite, digit, band.code));
                let read = self.observation(satellite, signal, fields.range_m, band, time, channel);
                observations.extend(read.filter(|o| !is_empty(o)));
            }
        }
        Some(())
    }

    fn observation(
        &mut self,
        satellite: Satellite,
        signal: Signal,
        first_range_m: f64,
        band: &BandFields,
        time: GpsTime,
        channel: Option<i8>,
    ) -> Option<Observation> {
        let channel = channel.filter(|_| satellite.system == System::Glonass);
        let wavelength_m = signal.band.wavelength_m(channel)?;
        let difference = sign_extended(band.phase_less_range, 20);
        // Both phases are given against the range of the first band.
        let phase_cycles = (difference != -(1 << 19)).then(|| {
            let cycles = difference as f64 * PHASE_M / wavelength_m;
            let last = self.unwrapped.entry((satellite, signal)).or_insert(cycles);
            *last = cycles + ((*last - cycles) / ROLLOVER_CYCLES).round() * ROLLOVER_CYCLES;
            first_range_m / wavelength_m + *last
        });
        let phase_cycles = phase_cycles.and_then(plausible);
        let tracked = Tracked {
            satellite,
            signal,
            time,
            lock: Some(lock::of_seven_bits(band.lock)),
            half_cycle_added: false,
            has_phase: phase_cycles.is_some(),
        };
        let lock = self.locks.digit(&tracked, false)?;
        Some(Observation {
            satellite,
            signal,
            pseudorange_m: band.range.and_then(plausible),
            phase_cycles,
            doppler_hz: None,
            cn0_dbhz: plausible(band.strength as f64 * STRENGTH_DBHZ),
            lock,
        })
    }
}

/// A satellite by its number in a message.
fn satellite(system: System, number: u8) -> Option<Satellite> {
    let (system, number) = match (system, number) {
        (System::Gps, FIRST_SBAS..=58) => (System::Sbas, number - 20),
        (System::Gps, 1..=32) | (System::Glonass, 1..=24) => (system, number),
        _ => return None,
    };
    Some(Satellite::new(system, number))
}

/// Tracking code by the indicator of a message (DF010, DF016; DF039, DF046).
const fn attribute(satellite: Satellite, digit: u8, indicator: u64) -> u8 {
    match (satellite.system, digit, indicator) {
        (System::Sbas, ..) | (_, 1, 0) | (System::Glonass, 2, 0) => b'C',
        // L2C, whichever of its parts; P tracked directly, cross-correlated, correlated.
        (_, 2, 0) => b'X',
        (System::Gps, 2, 2) => b'D',
        (System::Gps, 2, 3) => b'W',
        _ => b'P',
    }
}
