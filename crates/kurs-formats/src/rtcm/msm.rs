//! Multiple signal messages (MSM 4 to 7): the observations of one system at one epoch.
//!
//! Source: RTCM 10403.3, tables 3.5-78 to 3.5-87. Ranges are sums of a rough part, one for each
//! satellite, and a fine part for each signal, in light milliseconds.

use std::collections::BTreeMap;

use kurs::observation::Observation;
use kurs::signal::{SPEED_OF_LIGHT_MPS, Satellite, Signal, System};
use kurs::time::GpsTime;

use super::lock;
use super::signal::{kind, message_number, satellite, satellite_bit, signal, signal_bit};
use crate::fields::{BitReader, BitWriter, Fields, sign_extended, two_to};
use crate::logs::lock_time::{LockTime, LockTimes, Tracked};
use crate::logs::{is_empty, plausible};

/// Metres in a light millisecond.
pub(super) const MS_M: f64 = SPEED_OF_LIGHT_MPS * 1e-3;
/// Cells that the mask of a message has room for.
pub(super) const CELLS_MAX: usize = 64;
/// Rough range in whole milliseconds that stands for none.
const NO_ROUGH_RANGE: u64 = 255;
/// Rough range rate that stands for none, m/s.
const NO_ROUGH_RATE_MPS: f64 = -8192.0;
/// Unit of the fine range rate, m/s.
const FINE_RATE_MPS: f64 = 1e-4;

/// The part before the satellites.
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
#[derive(Debug, Clone, Copy)]
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

/// Which satellites and signals a message has, and which pairs of them it has observations of.
struct Masks {
    satellites: Vec<Rough>,
    signals: Vec<Option<Signal>>,
    /// Numbers of the cells in use, counted satellite by satellite.
    cells: Vec<usize>,
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
    let resolution = resolution(header.kind);
    let mut reader = BitReader::new(message);
    let mut masks = read_masks(&mut reader, header)?;
    read_rough(&mut reader, header.system, &resolution, &mut masks.satellites, glonass_channels);
    let columns = Columns::read(&mut reader, resolution, masks.cells.len());
    if !reader.is_whole() {
        return None;
    }
    for (index, cell) in masks.cells.iter().enumerate() {
        let rough = &masks.satellites[cell / masks.signals.len()];
        let signal = masks.signals[cell % masks.signals.len()];
        let Some((satellite, signal)) = rough.satellite.zip(signal) else { continue };
        let channel = glonass_channels.get(&satellite.number).copied();
        let measured = columns.measured(index, rough);
        let observation = measured.observation(satellite, signal, channel, time, locks);
        observations.extend(observation.filter(|o| !is_empty(o)));
    }
    Some(())
}

/// Reads past the header and the mask of the cells; `None` if there are more than can be.
fn read_masks(reader: &mut BitReader<'_>, header: &Header) -> Option<Masks> {
    let Header { system, .. } = *header;
    reader.take(64 + 9);
    reader.take(64 + 32);
    let signals: Vec<Option<Signal>> =
        set_bits(u64::from(header.signals), 32).map(|bit| signal(system, bit)).collect();
    let satellites: Vec<Rough> = set_bits(header.satellites, 64)
        .map(|bit| Rough { satellite: satellite(system, bit), range_ms: None, rate_mps: None })
        .collect();
    let cells = satellites.len() * signals.len();
    if cells > CELLS_MAX {
        return None;
    }
    #[allow(clippy::cast_possible_truncation)] // at most 64
    let mask = if cells == 0 { 0 } else { reader.take(cells as u32) };
    let is_set = |cell: &usize| mask >> (cells - 1 - cell) & 1 == 1;
    Some(Masks { satellites, signals, cells: (0..cells).filter(is_set).collect() })
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

/// The fine parts: a number for each cell in use in every column.
struct Columns {
    resolution: Resolution,
    ranges: Vec<u64>,
    phases: Vec<u64>,
    lock_times: Vec<u64>,
    half_cycles: Vec<u64>,
    strengths: Vec<u64>,
    /// Empty if the message has no rates.
    rates: Vec<u64>,
}

impl Columns {
    fn read(reader: &mut BitReader<'_>, resolution: Resolution, cells: usize) -> Self {
        let mut column = |width: u32| (0..cells).map(|_| reader.take(width)).collect();
        Self {
            ranges: column(resolution.range.0),
            phases: column(resolution.phase.0),
            lock_times: column(resolution.lock_bits),
            half_cycles: column(1),
            strengths: column(resolution.strength.0),
            rates: if resolution.has_rates { column(15) } else { Vec::new() },
            resolution,
        }
    }

    /// The sums of rough and fine parts in one cell.
    fn measured(&self, index: usize, rough: &Rough) -> Measured {
        let Resolution { range, phase, lock_bits, strength, .. } = self.resolution;
        let sum_ms = |(width, unit_ms): (u32, f64), bits: u64| {
            Some(rough.range_ms? + fine(bits, width)? * unit_ms)
        };
        let lock_time = if lock_bits == 4 { lock::of_four_bits } else { lock::of_ten_bits };
        let rate_mps = self.rates.get(index).and_then(|bits| fine(*bits, 15));
        Measured {
            range_ms: sum_ms(range, self.ranges[index]),
            phase_ms: sum_ms(phase, self.phases[index]),
            rate_mps: rough
                .rate_mps
                .zip(rate_mps)
                .map(|(rough, fine)| rough + fine * FINE_RATE_MPS),
            lock_time: lock_time(self.lock_times[index]),
            half_cycle: self.half_cycles[index] == 1,
            strength_dbhz: self.strengths[index] as f64 * strength.1,
        }
    }
}

/// What a message says of one signal of one satellite.
struct Measured {
    range_ms: Option<f64>,
    phase_ms: Option<f64>,
    rate_mps: Option<f64>,
    lock_time: LockTime,
    half_cycle: bool,
    strength_dbhz: f64,
}

impl Measured {
    /// The observation in cycles and hertz; `None` if the epoch has one of this signal already.
    fn observation(
        &self,
        satellite: Satellite,
        signal: Signal,
        channel: Option<i8>,
        time: GpsTime,
        locks: &mut LockTimes,
    ) -> Option<Observation> {
        let wavelength_m = signal.band.wavelength_m(channel);
        let in_cycles = |range_ms: f64| plausible(range_ms * MS_M / wavelength_m?);
        let phase_cycles = self.phase_ms.and_then(in_cycles);
        let tracked = Tracked {
            satellite,
            signal,
            time,
            lock: Some(self.lock_time),
            half_cycle_added: false,
            has_phase: phase_cycles.is_some(),
        };
        Some(Observation {
            satellite,
            signal,
            lock: locks.digit(&tracked, self.half_cycle)?,
            pseudorange_m: self.range_ms.and_then(|range_ms| plausible(range_ms * MS_M)),
            phase_cycles,
            doppler_hz: self.rate_mps.and_then(|rate_mps| plausible(-rate_mps / wavelength_m?)),
            cn0_dbhz: plausible(self.strength_dbhz),
        })
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
    let (satellites, signals) = masks(cells);
    let header =
        Header { system, kind: KIND, station, epoch_time, more_follows, satellites, signals };
    let mut writer = BitWriter::default();
    header.write(&mut writer);
    let in_order = write_cell_mask(&mut writer, &header, cells);
    let rough = write_rough(&mut writer, satellites, cells);
    let of_satellite = |cell: &Cell| rough.iter().find(|r| r.satellite == cell.satellite).copied();
    let in_order: Vec<(&Cell, RoughSent)> =
        in_order.into_iter().filter_map(|cell| Some((cell, of_satellite(cell)?))).collect();
    write_columns(&mut writer, &resolution(KIND), &in_order);
    writer.finish()
}

/// Writes which pairs of satellite and signal there are, and returns their cells in this order.
fn write_cell_mask<'a>(
    writer: &mut BitWriter,
    header: &Header,
    cells: &'a [Cell],
) -> Vec<&'a Cell> {
    let mut in_order = Vec::with_capacity(cells.len());
    for satellite in set_bits(header.satellites, 64) {
        for signal in set_bits(u64::from(header.signals), 32) {
            let cell = cells.iter().find(|cell| {
                satellite_bit(cell.satellite) == Some(satellite)
                    && signal_bit(cell.signal) == Some(signal)
            });
            writer.constant(1, u64::from(cell.is_some()));
            in_order.extend(cell);
        }
    }
    in_order
}

/// The rough part of a satellite as it is sent.
#[derive(Debug, Clone, Copy)]
struct RoughSent {
    satellite: Satellite,
    range_ms: f64,
    rate_mps: f64,
}

/// Writes the satellites' part: ranges and rates are those of the first cell of each.
fn write_rough(writer: &mut BitWriter, satellites: u64, cells: &[Cell]) -> Vec<RoughSent> {
    let first_of =
        |bit: u8| cells.iter().find(move |cell| satellite_bit(cell.satellite) == Some(bit));
    let firsts: Vec<&Cell> = set_bits(satellites, 64).filter_map(first_of).collect();
    let sent = |cell: &&Cell| RoughSent {
        satellite: cell.satellite,
        range_ms: (cell.range_ms * 1024.0).round() / 1024.0,
        rate_mps: cell.rate_mps.unwrap_or(NO_ROUGH_RATE_MPS).round(),
    };
    let mut rough: Vec<RoughSent> = firsts.iter().map(sent).collect();
    rough.iter().for_each(|r| writer.scaled_unsigned(8, 1.0, &mut r.range_ms.floor()));
    firsts.iter().for_each(|cell| writer.constant(4, u64::from(cell.extended)));
    rough.iter().for_each(|r| writer.scaled_unsigned(10, two_to(-10), &mut r.range_ms.fract()));
    rough.iter_mut().for_each(|r| writer.scaled(14, 1.0, &mut r.rate_mps));
    rough
}

/// Writes the fine parts, column by column: what the rough part of the satellite leaves.
fn write_columns(writer: &mut BitWriter, resolution: &Resolution, cells: &[(&Cell, RoughSent)]) {
    let Resolution { range, phase, lock_bits, strength, .. } = *resolution;
    for (cell, rough) in cells {
        writer.scaled(range.0, range.1, &mut (cell.range_ms - rough.range_ms));
    }
    for (cell, rough) in cells {
        let none = -two_to(23) * phase.1;
        let mut fine_ms = cell.phase_ms.map_or(none, |phase_ms| phase_ms - rough.range_ms);
        writer.scaled(phase.0, phase.1, &mut fine_ms);
    }
    cells.iter().for_each(|(cell, _)| writer.constant(lock_bits, lock::to_ten_bits(cell.lock_s)));
    cells.iter().for_each(|(cell, _)| writer.constant(1, u64::from(cell.half_cycle)));
    for (cell, _) in cells {
        writer.scaled_unsigned(strength.0, strength.1, &mut { cell.strength_dbhz });
    }
    for (cell, rough) in cells {
        let none = -two_to(14) * FINE_RATE_MPS;
        let mut fine_mps = cell.rate_mps.map_or(none, |rate_mps| rate_mps - rough.rate_mps);
        writer.scaled(15, FINE_RATE_MPS, &mut fine_mps);
    }
}
