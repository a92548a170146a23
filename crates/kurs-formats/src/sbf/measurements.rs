//! MeasEpoch: the observations of all antennas at one epoch.
//!
//! Source: reference guide, 4.2.1. A sub-block of type 1 has the first signal of a satellite in
//! full; the sub-blocks of type 2 behind it have further signals of the satellite as differences to
//! it.

use std::collections::BTreeMap;

use kurs::observation::Observation;
use kurs::signal::{SPEED_OF_LIGHT_MPS, Satellite, Signal, System};
use kurs::time::GpsTime;

use super::AntennaId;
use super::signal::{is_gps_p, satellite, signal};
use crate::logs::lock_time::{LockTime, LockTimes, Tracked};
use crate::logs::{LittleEndian, is_empty, plausible};

/// Number of the block.
pub(crate) const MEAS_EPOCH: u16 = 4027;

/// Bytes before the sub-blocks; lengths of the sub-blocks, which later revisions may make longer.
pub(super) const HEADER: usize = 6;
pub(super) const TYPE_1: usize = 20;
pub(super) const TYPE_2: usize = 12;

/// `CommonFlags`: Galileo E6 is E6B; the observations are encrypted.
const E6B_USED: u8 = 1 << 6;
const SCRAMBLED: u8 = 1 << 7;

/// Signal number in the type of a sub-block that says where the number is.
pub(super) const EXTENDED: u8 = 31;
/// What is taken off the numbers that stand there.
pub(super) const EXTENDED_FROM: u8 = 32;
/// What is added to a GLONASS channel.
pub(super) const CHANNEL_OFFSET: i8 = 8;
/// `ObsInfo`: the phase may be off by half a cycle. (Bit 0: the pseudorange is smoothed.)
pub(super) const HALF_CYCLE: u8 = 1 << 2;

/// Units of ranges and offsets, cycles, Doppler shifts, strengths.
pub(super) const RANGE_M: f64 = 1e-3;
pub(super) const PHASE_CYCLES: f64 = 1e-3;
pub(super) const DOPPLER_HZ: f64 = 1e-4;
pub(super) const STRENGTH_DBHZ: f64 = 0.25;
/// What is taken off the strengths of all signals but the two P codes of GPS.
pub(super) const STRENGTH_OFFSET_DBHZ: f64 = 10.0;
/// Strengths and lock times that stand for none; lock times stop one before.
pub(super) const NO_STRENGTH: u8 = u8::MAX;
pub(super) const NO_LOCK_1: u16 = u16::MAX;
pub(super) const NO_LOCK_2: u8 = u8::MAX;

/// The part before the sub-blocks.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Header {
    satellites: u8,
    type_1: usize,
    type_2: usize,
    flags: u8,
}

impl Header {
    /// Reads the header; the error says why the observations behind it cannot be used.
    pub(crate) fn read(content: &[u8]) -> Result<Self, &'static str> {
        let [satellites, type_1, type_2, flags] =
            content.array(0).ok_or("MeasEpoch without a header, skipped")?;
        let header =
            Self { satellites, type_1: usize::from(type_1), type_2: usize::from(type_2), flags };
        if flags & SCRAMBLED != 0 {
            return Err("MeasEpoch with scrambled observations, skipped");
        }
        if satellites > 0 && (header.type_1 < TYPE_1 || header.type_2 < TYPE_2) {
            return Err("MeasEpoch with sub-blocks that are too short, skipped");
        }
        Ok(header)
    }

    /// Whether no antenna observes anything.
    pub(crate) const fn is_empty(&self) -> bool {
        self.satellites == 0
    }

    /// The sub-blocks of type 1 in the order of the block, each with those of type 2 behind it.
    fn groups<'a>(&self, content: &'a [u8]) -> impl Iterator<Item = (&'a [u8], &'a [u8])> {
        let (type_1, type_2) = (self.type_1, self.type_2);
        let mut rest = content.get(HEADER..).unwrap_or_default();
        (0..self.satellites).map_while(move |_| {
            let (first, behind) = rest.split_at_checked(type_1)?;
            let (others, behind) = behind.split_at_checked(type_2 * usize::from(first[19]))?;
            rest = behind;
            Some((first, others))
        })
    }

    /// The antennas that have any observation, as a mask of their numbers.
    pub(crate) fn antennas(&self, content: &[u8]) -> u8 {
        let mut mask = 0;
        for (first, others) in self.groups(content) {
            mask |= 1 << antenna(first[1]);
            others.chunks_exact(self.type_2).for_each(|second| mask |= 1 << antenna(second[0]));
        }
        mask
    }
}

/// The antenna in the type of a sub-block.
const fn antenna(kind: u8) -> u8 {
    kind >> 5
}

/// The signal number of a sub-block.
const fn number(kind: u8, info: u8) -> u8 {
    let low = kind & 0x1f;
    if low == EXTENDED { EXTENDED_FROM + (info >> 3) } else { low }
}

/// What all signals of a satellite are measured from.
#[derive(Debug, Clone, Copy, Default)]
struct Reference {
    pseudorange_m: Option<f64>,
    doppler_hz: Option<f64>,
    frequency_hz: Option<f64>,
}

/// Numbers of one signal, the same in both types of sub-block.
#[derive(Debug, Clone, Copy)]
struct Measurement {
    signal: Signal,
    frequency_hz: Option<f64>,
    pseudorange_m: Option<f64>,
    phase_offset_cycles: Option<f64>,
    doppler_hz: Option<f64>,
    strength: u8,
    /// Lock time, s, and where its count stops.
    lock: Option<(u16, u16)>,
    info: u8,
    is_gps_p: bool,
}

impl Reference {
    /// Reads a sub-block of type 1, whose signal has this frequency.
    fn read(first: &[u8], frequency_hz: Option<f64>) -> Self {
        let doppler = first.array(8).map(i32::from_le_bytes).filter(|d| *d != i32::MIN);
        Self {
            pseudorange_m: range_m(first[3], first.array(4)),
            doppler_hz: doppler.map(|d| f64::from(d) * DOPPLER_HZ),
            frequency_hz,
        }
    }

    /// The signal of the sub-block of type 1 itself.
    fn own(&self, signal: Signal, first: &[u8]) -> Measurement {
        let (kind, info) = (first[1], first[18]);
        Measurement {
            signal,
            frequency_hz: self.frequency_hz,
            pseudorange_m: self.pseudorange_m,
            phase_offset_cycles: phase_offset_cycles(first[14], first.u16(12)),
            doppler_hz: self.doppler_hz,
            strength: first[15],
            lock: first.u16(16).filter(|s| *s != NO_LOCK_1).map(|s| (s, NO_LOCK_1 - 1)),
            info,
            is_gps_p: is_gps_p(number(kind, info)),
        }
    }

    /// A further signal, from its sub-block of type 2.
    fn further(&self, signal: Signal, frequency_hz: Option<f64>, second: &[u8]) -> Measurement {
        let (kind, info, offsets) = (second[0], second[5], second[3]);
        // Three bits in two's complement above 16, five above 16.
        let range_high = sign_extended(offsets & 7, 3);
        let doppler_high = sign_extended(offsets >> 3, 5);
        let offset_m = offset(range_high, -4, second.u16(6)).map(|units| units * RANGE_M);
        let offset_hz = offset(doppler_high, -16, second.u16(10)).map(|u| u * DOPPLER_HZ);
        // D₂ = α D₁ + ΔD with α = f₂ / f₁
        let scaled_hz = || Some(self.doppler_hz? * frequency_hz? / self.frequency_hz?);
        Measurement {
            signal,
            frequency_hz,
            pseudorange_m: self.pseudorange_m.zip(offset_m).map(|(a, b)| a + b),
            phase_offset_cycles: phase_offset_cycles(second[4], second.u16(8)),
            doppler_hz: offset_hz.and_then(|offset_hz| Some(scaled_hz()? + offset_hz)),
            strength: second[2],
            lock: (second[1] != NO_LOCK_2)
                .then_some((u16::from(second[1]), u16::from(NO_LOCK_2 - 1))),
            info,
            is_gps_p: is_gps_p(number(kind, info)),
        }
    }
}

/// What becomes of the measurements of one antenna.
pub(crate) struct Epoch<'a> {
    pub(crate) antenna: AntennaId,
    pub(crate) time: GpsTime,
    pub(crate) locks: &'a mut LockTimes,
    pub(crate) glonass_channels: &'a mut BTreeMap<u8, i8>,
    pub(crate) observations: &'a mut Vec<Observation>,
}

impl Epoch<'_> {
    /// Takes the observations of the antenna from a block; `None` if the block is shorter than its
    /// counts say, and what is there is taken.
    pub(crate) fn read(&mut self, header: &Header, content: &[u8]) -> Option<()> {
        let mut groups = 0;
        for (first, others) in header.groups(content) {
            groups += 1;
            let Some(satellite) = satellite(first[2]) else { continue };
            self.read_satellite(header, satellite, first, others);
        }
        (groups == header.satellites).then_some(())
    }

    fn read_satellite(
        &mut self,
        header: &Header,
        satellite: Satellite,
        first: &[u8],
        others: &[u8],
    ) {
        self.learn_channel(satellite, first);
        let channel = self.glonass_channels.get(&satellite.number).copied();
        let frequency_hz = |signal: Signal| signal.band.frequency_hz(channel);
        let e6b_used = header.flags & E6B_USED != 0;
        let signal_of = |kind, info| signal(satellite.system, number(kind, info), e6b_used);

        let own = signal_of(first[1], first[18]);
        let reference = Reference::read(first, own.and_then(frequency_hz));
        if let Some(signal) = own.filter(|_| antenna(first[1]) == self.antenna.0) {
            self.add(satellite, &reference.own(signal, first));
        }
        for second in others.chunks_exact(header.type_2) {
            if antenna(second[0]) == self.antenna.0
                && let Some(signal) = signal_of(second[0], second[5])
            {
                self.add(satellite, &reference.further(signal, frequency_hz(signal), second));
            }
        }
    }

    /// Keeps the channel of a GLONASS satellite, which stands where others extend the signal
    /// number.
    fn learn_channel(&mut self, satellite: Satellite, first: &[u8]) {
        if satellite.system == System::Glonass
            && first[1] & 0x1f != EXTENDED
            && let channel @ -7..=13 = (first[18] >> 3).cast_signed() - CHANNEL_OFFSET
        {
            self.glonass_channels.insert(satellite.number, channel);
        }
    }

    /// Adds a signal's observation, if there is anything in it.
    fn add(&mut self, satellite: Satellite, m: &Measurement) {
        // L = P / λ + offset
        let range_cycles = || Some(m.pseudorange_m? * m.frequency_hz? / SPEED_OF_LIGHT_MPS);
        let phase_cycles = m
            .phase_offset_cycles
            .and_then(|offset| plausible(range_cycles()? + offset))
            .filter(|_| m.lock.is_some());
        let lock_time = m.lock.map(|(seconds, last)| LockTime {
            least_s: f64::from(seconds),
            most_s: if seconds >= last { f64::INFINITY } else { f64::from(seconds) + 1.0 },
        });
        let tracked = Tracked {
            satellite,
            signal: m.signal,
            time: self.time,
            lock: lock_time,
            half_cycle_added: false,
            has_phase: phase_cycles.is_some(),
        };
        let half_cycle = m.info & HALF_CYCLE != 0;
        let Some(lock) = self.locks.digit(&tracked, half_cycle) else { return };
        let strength_dbhz = f64::from(m.strength) * STRENGTH_DBHZ
            + if m.is_gps_p { 0.0 } else { STRENGTH_OFFSET_DBHZ };
        let observation = Observation {
            satellite,
            signal: m.signal,
            pseudorange_m: m.pseudorange_m.and_then(plausible),
            phase_cycles,
            doppler_hz: m.doppler_hz.and_then(plausible),
            cn0_dbhz: plausible(strength_dbhz).filter(|_| m.strength != NO_STRENGTH),
            lock,
        };
        if !is_empty(&observation) {
            self.observations.push(observation);
        }
    }
}

/// The pseudorange of a sub-block of type 1: 36 bits, zero for none.
fn range_m(misc: u8, low: Option<[u8; 4]>) -> Option<f64> {
    let units = u64::from(misc & 0xf) << 32 | u64::from(u32::from_le_bytes(low?));
    (units != 0).then_some(units as f64 * RANGE_M)
}

/// The phase less the pseudorange, 24 bits, the least number for none.
fn phase_offset_cycles(high: u8, low: Option<u16>) -> Option<f64> {
    offset(high.cast_signed(), i8::MIN, low).map(|units| units * PHASE_CYCLES)
}

/// A number in two's complement of which the 16 low bits stand apart; `none` with zeros for none.
fn offset(high: i8, none: i8, low: Option<u16>) -> Option<f64> {
    let low = low?;
    let units = i32::from(high) * (1 << 16) + i32::from(low);
    ((high, low) != (none, 0)).then_some(f64::from(units))
}

const fn sign_extended(bits: u8, width: u32) -> i8 {
    (bits << (8 - width)).cast_signed() >> (8 - width)
}

#[cfg(test)]
mod tests {
    use kurs::observation::Lock;

    use super::*;

    fn read(content: &[u8], antenna: u8) -> (Vec<Observation>, Option<()>) {
        let mut observations = Vec::new();
        let header = Header::read(content).unwrap();
        let whole = Epoch {
            antenna: AntennaId(antenna),
            time: GpsTime::from_week_tow(2300, 3.0).unwrap(),
            locks: &mut LockTimes::default(),
            glonass_channels: &mut BTreeMap::new(),
            observations: &mut observations,
        }
        .read(&header, content);
        (observations, whole)
    }

    /// A block by hand, sub-blocks longer than this revision's: G05 L1 C/A with L2P of the main
    /// antenna and L5 of another one; R07 with channel −4; J02 with the signal number 33.
    fn by_hand() -> Vec<u8> {
        let mut content = vec![3, 24, 16, 0, 0, 0];
        // Channel, type, satellite, 2³² mm, 20 000 000 000 mm less them; 1234.5678 Hz.
        content.extend([1, 0, 5, 4]);
        content.extend((20_000_000_000u64 - (4 << 32)).to_le_bytes()[..4].iter());
        content.extend(12_345_678i32.to_le_bytes());
        // −1 · 65.536 + 0.036 cycles, 45.25 dB-Hz, 100 s, half a cycle, two more signals.
        content.extend([36, 0, 255, 141, 100, 0, 4, 2]);
        content.extend([0; 4]);
        // L2P: lock time 7 s, 20.25 dB-Hz, −1 · 65.536 + 65.000 m, 0 · 6.5536 + 0.0001 Hz,
        // 1 · 65.536 + 0.001 cycles.
        content.extend([2, 7, 81, 0b0000_0111, 1, 0]);
        content.extend([65_000u16, 1, 1].iter().flat_map(|n| n.to_le_bytes()));
        content.extend([0; 4]);
        // L5 of aux1: nothing but its strength, 10 dB-Hz and 30.
        content.extend([4 | 1 << 5, 255, 120, 0b1000_0100, 128, 0, 0, 0, 0, 0, 0, 0]);
        content.extend([0; 4]);
        // R07, L1 C/A, channel −4 and 8: no Doppler.
        content.extend([2, 8, 44, 4]);
        content.extend((21_000_000_000u64 - (4 << 32)).to_le_bytes()[..4].iter());
        content.extend(i32::MIN.to_le_bytes());
        content.extend([0, 0, 0, 255, 254, 255, 4 << 3, 0]);
        content.extend([0; 4]);
        // J02, 33 − 32 in the info; no phase.
        content.extend([3, 31, 182, 4, 0, 0, 0, 0]);
        content.extend(0i32.to_le_bytes());
        content.extend([0, 0, 128, 100, 255, 255, 1 << 3, 0]);
        content.extend([0; 4]);
        content
    }

    #[test]
    fn a_block_by_hand() {
        let (main, whole) = read(&by_hand(), 0);
        assert_eq!(whole, Some(()));
        let names: Vec<String> =
            main.iter().map(|o| format!("{} {}", o.satellite, o.signal)).collect();
        assert_eq!(names, ["G05 G1C", "G05 G2W", "R07 R1C", "J02 J1Z"]);
        let near = |found: Option<f64>, wanted: f64| {
            assert!((found.unwrap() - wanted).abs() < 1e-6 * wanted.abs().max(1.0) * 1e-3);
        };
        near(main[0].pseudorange_m, 2e7);
        near(main[0].phase_cycles, 2e7 / 0.190_293_672_798_364_87 - 65.5);
        near(main[0].doppler_hz, 1234.5678);
        assert_eq!((main[0].cn0_dbhz, main[0].lock), (Some(45.25), Lock(2)));
        near(main[1].pseudorange_m, 2e7 - 0.536);
        near(main[1].phase_cycles, (2e7 - 0.536) / 0.244_210_213_424_568_27 + 65.537);
        near(main[1].doppler_hz, 1234.5678 * 60.0 / 77.0 + 1e-4);
        assert_eq!((main[1].cn0_dbhz, main[1].lock), (Some(20.25), Lock(0)));
        near(main[2].phase_cycles, 21e6 * (1602.0 - 4.0 * 0.5625) / 299.792_458);
        assert_eq!((main[2].doppler_hz, main[2].cn0_dbhz), (None, None));
        assert_eq!((main[3].phase_cycles, main[3].cn0_dbhz), (None, Some(35.0)));

        let (aux1, _) = read(&by_hand(), 1);
        assert_eq!(aux1.len(), 1);
        assert_eq!((aux1[0].pseudorange_m, aux1[0].cn0_dbhz), (None, Some(40.0)));
        let content = by_hand();
        assert_eq!(Header::read(&content).unwrap().antennas(&content), 0b11);
    }

    #[test]
    fn short_and_scrambled_blocks_are_told_of() {
        let content = by_hand();
        let (some, whole) = read(&content[..content.len() - 1], 0);
        assert_eq!((some.len(), whole), (3, None));
        let (some, whole) = read(&content[..60], 0);
        assert_eq!((some.len(), whole), (0, None));
        for (at, value) in [(1, 19), (2, 11), (3, SCRAMBLED)] {
            let mut wrong = content.clone();
            wrong[at] = value;
            assert!(Header::read(&wrong).is_err());
        }
        assert!(Header::read(&content[..3]).is_err());
        assert!(Header::read(&[0; 6]).unwrap().is_empty());
    }
}
