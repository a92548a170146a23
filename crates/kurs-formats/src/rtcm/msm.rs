//! Multiple signal messages (MSM 4 to 7): the observations of one system at one epoch.
//!
//! Source: RTCM 10403.3, tables 3.5-78 to 3.5-87. Ranges are sums of a rough part, one for each
//! satellite, and a fine part for each signal, in light milliseconds.

use std::collections::BTreeMap;

use kurs::observation::{Lock, Observation};
use kurs::signal::{SPEED_OF_LIGHT_MPS, Satellite, Signal, System};
use kurs::time::GpsTime;

use super::lock;
use super::signal::{kind, message_number, satellite, satellite_bit, signal, signal_bit};
use crate::fields::{BitReader, BitWriter, Fields, sign_extended, two_to};
use crate::logs::lock_time::{Continuity, LockTimes, Tracked};
use crate::logs::{is_empty, plausible};

/// Metres in a light millisecond.
pub(super) const MS_M: f64 = SPEED_OF_LIGHT_MPS * 1e-3;
/// Cells that the mask of a message has room for.
pub(super) const CELLS_MAX: usize = 64;
/// Rough range in whole milliseconds that stands for none.
const NO_ROUGH_RANGE: u64 = 255;
/// Unit of the fine range rate, m/s.
const FINE_RATE_MPS: f64 = 1e-4;

/// What stands before the satellites.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Header {
    pub(super) system: System,
    /// 4 to 7.
    kind: u16,
    pub(super) station: u16,
    /// 30 bits, the meaning of which depends on the system.
    pub(super) epoch_time: u64,
    /// Another message of the same epoch and station follows; some programs do not set it.
    pub(super) more_follows: bool,
    satellites: u64,
    signals: u32,
}

/// Widths and units of the fine parts.
struct Resolution {
    range: (u32, f64),
    phase: (u32, f64),
    lock_bits: u32,
    strength: (u32, f64),
    has_rates: bool,
}

fn resolution(kind: u16) -> Resolution {
    let has_rates = matches!(kind, 5 | 7);
    if kind >= 6 {
        Resolution {
            range: (20, two_to(-29)),
            phase: (24, two_to(-31)),
            lock_bits: 10,
            strength: (10, two_to(-4)),
            has_rates,
        }
    } else {
        Resolution {
            range: (15, two_to(-24)),
            phase: (22, two_to(-29)),
            lock_bits: 4,
            strength: (6, 1.0),
            has_rates,
        }
    }
}

impl Header {
    /// Reads the header, if this is a message with observations.
    pub(super) fn read(message: &[u8]) -> Option<Self> {
        let (system, kind) = kind(super::number(message)).filter(|(_, kind)| *kind >= 4)?;
        let mut reader = BitReader::new(message);
        reader.take(12);
        let station = u16::try_from(reader.take(12)).ok()?;
        let epoch_time = reader.take(30);
        let more_follows = reader.take(1) == 1;
        // Issue of data station, reserved, clock steering, external clock, smoothing.
        reader.take(3 + 7 + 2 + 2 + 1 + 3);
        let satellites = reader.take(64);
        let signals = u32::try_from(reader.take(32)).ok()?;
        let header = Self { system, kind, station, epoch_time, more_follows, satellites, signals };
        reader.is_whole().then_some(header)
    }

    fn write(&self, writer: &mut BitWriter) {
        writer.bits(12, u64::from(message_number(self.system, self.kind)));
        writer.bits(12, u64::from(self.station));
        writer.bits(30, self.epoch_time);
        writer.bits(1, u64::from(self.more_follows));
        writer.bits(3 + 7 + 2 + 2 + 1 + 3, 0);
        writer.bits(64, self.satellites);
        writer.bits(32, u64::from(self.signals));
    }
}

/// The rough part of a satellite's observations.
#[derive(Debug, Clone, Copy)]
struct Rough {
    satellite: Option<Satellite>,
    range_ms: Option<f64>,
    rate_mps: Option<f64>,
}

/// Reads the observations of a message; `None` if it is shorter than its masks say.
pub(super) fn read(
    header: &Header,
    message: &[u8],
    time: GpsTime,
    locks: &mut LockTimes,
    glonass_channels: &mut BTreeMap<u8, i8>,
    observations: &mut Vec<Observation>,
) -> Option<()> {
    let Header { system, kind, .. } = *header;
    let resolution = resolution(kind);
    let mut reader = BitReader::new(message);
    reader.take(64 + 9);
    reader.take(64 + 32);
    let signals: Vec<Option<Signal>> =
        set_bits(u64::from(header.signals), 32).map(|bit| signal(system, bit)).collect();
    let mut satellites: Vec<Rough> = set_bits(header.satellites, 64)
        .map(|bit| Rough { satellite: satellite(system, bit), range_ms: None, rate_mps: None })
        .collect();
    let cells = satellites.len() * signals.len();
    if cells > CELLS_MAX {
        return None;
    }
    #[allow(clippy::cast_possible_truncation)] // at most 64
    let mask = if cells == 0 { 0 } else { reader.take(cells as u32) };
    read_rough(&mut reader, system, &resolution, &mut satellites, glonass_channels);

    let is_set = |cell: &usize| mask >> (cells - 1 - cell) & 1 == 1;
    let cells: Vec<usize> = (0..cells).filter(is_set).collect();
    let mut column =
        |width: u32| -> Vec<u64> { cells.iter().map(|_| reader.take(width)).collect() };
    let ranges = column(resolution.range.0);
    let phases = column(resolution.phase.0);
    let lock_times = column(resolution.lock_bits);
    let half_cycles = column(1);
    let strengths = column(resolution.strength.0);
    let rates = if resolution.has_rates { column(15) } else { Vec::new() };
    if !reader.is_whole() {
        return None;
    }
    for (index, cell) in cells.iter().enumerate() {
        let rough = &satellites[cell / signals.len()];
        let (Some(satellite), Some(signal)) = (rough.satellite, signals[cell % signals.len()])
        else {
            continue;
        };
        let whole_ms = |(width, unit_ms): (u32, f64), bits: u64| {
            Some(rough.range_ms? + fine(bits, width)? * unit_ms)
        };
        let channel = glonass_channels.get(&satellite.number).copied();
        let wavelength_m = signal.band.wavelength_m(channel);
        let phase_cycles = whole_ms(resolution.phase, phases[index])
            .and_then(|range_ms| plausible(range_ms * MS_M / wavelength_m?));
        let rate_mps = rates.get(index).and_then(|bits| fine(*bits, 15)).map(|r| r * FINE_RATE_MPS);
        let rate_mps = rough.rate_mps.and_then(|rough_mps| Some(rough_mps + rate_mps?));
        let lock_bits = lock_times[index];
        let is_short = resolution.lock_bits == 4;
        let lock_time =
            if is_short { lock::of_four_bits(lock_bits) } else { lock::of_ten_bits(lock_bits) };
        let tracked = Tracked {
            satellite,
            signal,
            time,
            lock: Some(lock_time),
            half_cycle_added: false,
            has_phase: phase_cycles.is_some(),
        };
        let slip = match locks.update(&tracked) {
            Continuity::Repeated => continue,
            Continuity::Slipped => Lock::SLIP,
            Continuity::Continuous => 0,
        };
        let half = if half_cycles[index] == 1 { Lock::HALF_CYCLE } else { 0 };
        let observation = Observation {
            satellite,
            signal,
            pseudorange_m: whole_ms(resolution.range, ranges[index])
                .and_then(|range_ms| plausible(range_ms * MS_M)),
            phase_cycles,
            doppler_hz: rate_mps.and_then(|rate_mps| plausible(-rate_mps / wavelength_m?)),
            cn0_dbhz: plausible(strengths[index] as f64 * resolution.strength.1),
            lock: if phase_cycles.is_some() { Lock(slip | half) } else { Lock(0) },
        };
        if !is_empty(&observation) {
            observations.push(observation);
        }
    }
    Some(())
}

/// Reads the satellites' part, and the channels that GLONASS satellites have there.
fn read_rough(
    reader: &mut BitReader<'_>,
    system: System,
    resolution: &Resolution,
    satellites: &mut [Rough],
    glonass_channels: &mut BTreeMap<u8, i8>,
) {
    for rough in satellites.iter_mut() {
        let whole_ms = reader.take(8);
        rough.range_ms = (whole_ms != NO_ROUGH_RANGE).then_some(whole_ms as f64);
    }
    for rough in satellites.iter().filter(|_| resolution.has_rates) {
        let extended = reader.take(4);
        if let (System::Glonass, Some(satellite), Ok(channel @ 0..=13)) =
            (system, rough.satellite, i8::try_from(extended))
        {
            glonass_channels.insert(satellite.number, channel - 7);
        }
    }
    for rough in satellites.iter_mut() {
        let part_ms = reader.take(10) as f64 * two_to(-10);
        rough.range_ms = rough.range_ms.map(|whole_ms| whole_ms + part_ms);
    }
    for rough in satellites.iter_mut().filter(|_| resolution.has_rates) {
        rough.rate_mps = fine(reader.take(14), 14);
    }
}

/// A number in two's complement, the smallest of which stands for none.
fn fine(bits: u64, width: u32) -> Option<f64> {
    let value = sign_extended(bits, width);
    (value != -(1 << (width - 1))).then_some(value as f64)
}

/// Numbers of the bits that are set, the first of `width` bits being 1.
fn set_bits(mask: u64, width: u32) -> impl Iterator<Item = u8> {
    (1..=width)
        .filter(move |bit| mask >> (width - bit) & 1 == 1)
        .filter_map(|b| u8::try_from(b).ok())
}

/// An observation to be sent, in the units of the message.
#[derive(Debug, Clone, Copy)]
pub(super) struct Cell {
    pub(super) satellite: Satellite,
    pub(super) signal: Signal,
    pub(super) range_ms: f64,
    /// Within 2⁻⁸ ms of the range, whole cycles taken off.
    pub(super) phase_ms: Option<f64>,
    pub(super) rate_mps: Option<f64>,
    pub(super) lock_s: f64,
    pub(super) half_cycle: bool,
    pub(super) strength_dbhz: f64,
    /// GLONASS channel and 7, zero for others.
    pub(super) extended: u8,
}

/// The number of bits that a mask for these satellites and signals needs.
pub(super) fn mask_size(cells: &[Cell]) -> usize {
    let (satellites, signals) = masks(cells);
    (satellites.count_ones() * signals.count_ones()) as usize
}

fn masks(cells: &[Cell]) -> (u64, u32) {
    cells.iter().fold((0, 0), |(satellites, signals), cell| {
        let satellite = satellite_bit(cell.satellite).map_or(0, |bit| 1 << (64 - bit));
        let signal = signal_bit(cell.signal).map_or(0, |bit| 1 << (32 - bit));
        (satellites | satellite, signals | signal)
    })
}

/// MSM 7 of cells of one system, in the order of satellites and signals of the masks; `None` if a
/// value does not fit.
pub(super) fn write(
    system: System,
    station: u16,
    epoch_time: u64,
    more_follows: bool,
    cells: &[Cell],
) -> Option<Vec<u8>> {
    const KIND: u16 = 7;
    let Resolution { range, phase, lock_bits, strength, .. } = resolution(KIND);
    let (satellites, signals) = masks(cells);
    let header =
        Header { system, kind: KIND, station, epoch_time, more_follows, satellites, signals };
    let mut writer = BitWriter::default();
    header.write(&mut writer);
    let of = |satellite: u8, signal: u8| {
        cells.iter().find(move |cell| {
            satellite_bit(cell.satellite) == Some(satellite)
                && signal_bit(cell.signal) == Some(signal)
        })
    };
    let first_of = |satellite: u8| {
        cells.iter().find(move |cell| satellite_bit(cell.satellite) == Some(satellite))
    };
    let in_order: Vec<Option<&Cell>> = set_bits(satellites, 64)
        .flat_map(|satellite| {
            set_bits(u64::from(signals), 32).map(move |signal| of(satellite, signal))
        })
        .collect();
    in_order.iter().for_each(|cell| writer.constant(1, u64::from(cell.is_some())));

    let firsts: Vec<&Cell> = set_bits(satellites, 64).filter_map(first_of).collect();
    let mut rough: Vec<f64> =
        firsts.iter().map(|cell| (cell.range_ms * 1024.0).round() / 1024.0).collect();
    for rough_ms in &mut rough {
        let mut whole_ms = rough_ms.floor();
        writer.scaled_unsigned(8, 1.0, &mut whole_ms);
    }
    firsts.iter().for_each(|cell| writer.constant(4, u64::from(cell.extended)));
    for rough_ms in &mut rough {
        let mut part_ms = rough_ms.fract();
        writer.scaled_unsigned(10, two_to(-10), &mut part_ms);
    }
    let mut rough_rates: Vec<f64> =
        firsts.iter().map(|cell| cell.rate_mps.unwrap_or(-8192.0).round()).collect();
    rough_rates.iter_mut().for_each(|rate_mps| writer.scaled(14, 1.0, rate_mps));

    let cells: Vec<(&Cell, usize)> = in_order
        .into_iter()
        .flatten()
        .filter_map(|cell| {
            Some((cell, firsts.iter().position(|first| first.satellite == cell.satellite)?))
        })
        .collect();
    for (cell, at) in &cells {
        let mut fine_ms = cell.range_ms - rough[*at];
        writer.scaled(range.0, range.1, &mut fine_ms);
    }
    for (cell, at) in &cells {
        let none = -two_to(23) * phase.1;
        let mut fine_ms = cell.phase_ms.map_or(none, |phase_ms| phase_ms - rough[*at]);
        writer.scaled(phase.0, phase.1, &mut fine_ms);
    }
    cells.iter().for_each(|(cell, _)| writer.constant(lock_bits, lock::to_ten_bits(cell.lock_s)));
    cells.iter().for_each(|(cell, _)| writer.constant(1, u64::from(cell.half_cycle)));
    for (cell, _) in &cells {
        let mut strength_dbhz = cell.strength_dbhz;
        writer.scaled_unsigned(strength.0, strength.1, &mut strength_dbhz);
    }
    for (cell, at) in &cells {
        let none = -two_to(14) * FINE_RATE_MPS;
        let mut fine_mps = cell.rate_mps.map_or(none, |rate_mps| rate_mps - rough_rates[*at]);
        writer.scaled(15, FINE_RATE_MPS, &mut fine_mps);
    }
    writer.finish()
}
