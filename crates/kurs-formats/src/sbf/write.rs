//! Writes SBF logs: MeasEpoch, decoded navigation messages and the pages that they come from.

use std::collections::{BTreeMap, BTreeSet};
use std::io::{self, Write};

use kurs::ephemeris::NavigationData;
use kurs::observation::{AntennaEpoch, Observation};
use kurs::signal::{SPEED_OF_LIGHT_MPS, Satellite, System};
use kurs::time::GpsTime;

use super::block::framed;
use super::measurements::{
    CHANNEL_OFFSET, DOPPLER_HZ, EXTENDED, EXTENDED_FROM, HALF_CYCLE, HEADER, MEAS_EPOCH, NO_LOCK_1,
    NO_LOCK_2, NO_STRENGTH, PHASE_CYCLES, RANGE_M, STRENGTH_DBHZ, STRENGTH_OFFSET_DBHZ, TYPE_1,
    TYPE_2,
};
use super::signal::{is_gps_p, satellite_number, signal_number};
use super::{AntennaId, messages, pages, parameters};
use crate::logs::lock_clock::LockClock;
use crate::logs::whole_cycles::WholeCycles;
use crate::logs::whole_milliseconds;
use crate::navigation_frames::schedule::{Schedule, glonass_channels};

/// How far a phase may be from its pseudorange: less than the 8388 cycles of the format.
const PHASE_SPAN_CYCLES: f64 = 8000.0;

/// Writes the log of one receiver.
///
/// Phases differ from those of the observations by whole cycles, which the format has no room for;
/// time tags are whole milliseconds, and observations are moved there as a receiver clock that was
/// set would have them.
#[derive(Debug)]
pub struct SbfWriter<W: Write> {
    output: W,
    glonass_channels: BTreeMap<u8, i8>,
    antennas: [Antenna; AntennaId::COUNT as usize],
    schedule: Schedule,
    /// What is sent once, with the first epoch.
    navigation: Option<NavigationData>,
}

/// What is remembered of an antenna.
#[derive(Debug, Default)]
struct Antenna {
    locks: LockClock,
    whole_cycles: WholeCycles,
}

impl<W: Write> SbfWriter<W> {
    /// Begins a log of a receiver that receives the ephemerides of `navigation` too. Signals that
    /// Septentrio has no number for, and GLONASS satellites without a known channel, are left out.
    pub fn new(output: W, navigation: &NavigationData) -> Self {
        Self {
            output,
            glonass_channels: glonass_channels(navigation),
            antennas: Default::default(),
            schedule: Schedule::new(navigation),
            navigation: Some(navigation.clone()),
        }
    }

    /// Writes an epoch of the antennas in the order of [`AntennaId`], the main one first, and
    /// before it the ephemerides that have come by then.
    ///
    /// # Errors
    ///
    /// What the output refuses; epochs of more antennas than the format has room for.
    pub fn write(&mut self, antennas: &[&AntennaEpoch]) -> io::Result<()> {
        if antennas.len() > self.antennas.len() {
            return Err(io::Error::other("more antennas than a block of SBF has room for"));
        }
        let Some(time) = antennas.first().map(|epoch| whole_milliseconds(epoch.time)) else {
            return Ok(());
        };
        if let Some(navigation) = self.navigation.take() {
            for (number, content) in parameters::blocks(&navigation, time) {
                self.send(number, time, &content)?;
            }
        }
        while let Some(next) = self.schedule.next(time) {
            let message = messages::block(&next, time);
            if message.is_none() {
                self.schedule.leave_out(next.satellite());
            }
            for (number, content) in message.into_iter().chain(pages::blocks(&next, time)) {
                self.send(number, time, &content)?;
            }
        }
        let content = self.meas_epoch(time, antennas)?;
        self.send(MEAS_EPOCH, time, &content)
    }

    /// Header and sub-blocks.
    fn meas_epoch(&mut self, time: GpsTime, antennas: &[&AntennaEpoch]) -> io::Result<Vec<u8>> {
        let mut groups: Vec<Group> = Vec::new();
        for ((epoch, antenna), number) in antennas.iter().zip(&mut self.antennas).zip(0..) {
            // t' = t + δ is a clock that shows δ more: every range grows by c δ.
            let shift_m = (time - epoch.time) * SPEED_OF_LIGHT_MPS;
            let first_group = groups.len();
            for o in &epoch.observations {
                let lock_s = antenna.locks.lock_s(epoch.time, o);
                let channel = self.glonass_channels.get(&o.satellite.number);
                let Some(signal) =
                    Signal::of(o, number, channel.copied(), lock_s, shift_m, antenna)
                else {
                    continue;
                };
                let own = groups[first_group..].iter_mut().find(|g| g.satellite == o.satellite);
                let second = own.and_then(|group| Some((signal.type_2(&group.first)?, group)));
                match second {
                    Some((second, group)) => group.others.push(second),
                    None => groups.push(Group {
                        satellite: o.satellite,
                        first: signal,
                        others: Vec::new(),
                    }),
                }
            }
        }
        let count = u8::try_from(groups.len()).map_err(io::Error::other)?;
        let sizes = [TYPE_1, TYPE_2].map(|size| u8::try_from(size).unwrap_or(u8::MAX));
        let mut content = vec![count, sizes[0], sizes[1], 0, 0, 0];
        debug_assert_eq!(content.len(), HEADER);
        for group in &groups {
            let others = u8::try_from(group.others.len()).map_err(io::Error::other)?;
            content.extend(group.first.type_1(others));
            content.extend(group.others.iter().flatten());
        }
        Ok(content)
    }

    fn send(&mut self, number: u16, time: GpsTime, content: &[u8]) -> io::Result<()> {
        let framed = framed(number, time, content);
        let framed = framed.ok_or_else(|| io::Error::other("a block is too long for SBF"))?;
        self.output.write_all(&framed)
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

/// A sub-block of type 1 and those of type 2 behind it.
struct Group {
    satellite: Satellite,
    first: Signal,
    others: Vec<[u8; TYPE_2]>,
}

/// An observation in the units of the format.
#[derive(Debug, Clone, Copy)]
struct Signal {
    svid: u8,
    number: u8,
    antenna: u8,
    /// GLONASS channel and its offset, zero for others.
    channel: u8,
    frequency_hz: f64,
    /// Pseudorange, mm.
    range: Option<i64>,
    /// Phase less pseudorange, 0.001 cycles.
    phase: Option<i64>,
    doppler: Option<i64>,
    strength: u8,
    lock_s: f64,
    half_cycle: bool,
}

impl Signal {
    /// `None` for satellites and signals without a number.
    fn of(
        o: &Observation,
        antenna_number: u8,
        channel: Option<i8>,
        lock_s: f64,
        shift_m: f64,
        antenna: &mut Antenna,
    ) -> Option<Self> {
        let channel = channel.filter(|_| o.satellite.system == System::Glonass);
        let number = signal_number(o.signal, false)?;
        let frequency_hz = o.signal.band.frequency_hz(channel)?;
        let wavelength_m = SPEED_OF_LIGHT_MPS / frequency_hz;
        let range = o.pseudorange_m.and_then(|range_m| units(range_m + shift_m, RANGE_M));
        let phase = range.zip(o.phase_cycles).and_then(|(range, cycles)| {
            let cycles = cycles + shift_m / wavelength_m;
            let range_cycles = range as f64 * RANGE_M / wavelength_m;
            let key = (o.satellite, o.signal);
            let kept = antenna.whole_cycles.take_off(key, cycles, range_cycles, PHASE_SPAN_CYCLES);
            units(kept - range_cycles, PHASE_CYCLES)
        });
        let offset_dbhz = if is_gps_p(number) { 0.0 } else { STRENGTH_OFFSET_DBHZ };
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // saturates
        let strength = o.cn0_dbhz.map_or(NO_STRENGTH, |dbhz| {
            ((dbhz - offset_dbhz) / STRENGTH_DBHZ).round().min(f64::from(NO_STRENGTH - 1)) as u8
        });
        Some(Self {
            svid: satellite_number(o.satellite)?,
            number,
            antenna: antenna_number,
            channel: channel.map_or(0, |channel| (channel + CHANNEL_OFFSET).cast_unsigned()),
            frequency_hz,
            range,
            phase,
            doppler: o.doppler_hz.and_then(|doppler_hz| units(doppler_hz, DOPPLER_HZ)),
            strength,
            lock_s,
            half_cycle: o.lock.half_cycle_unresolved(),
        })
    }

    /// Antenna and signal number: the type of a sub-block.
    fn kind(&self) -> u8 {
        self.number.min(EXTENDED) | self.antenna << 5
    }

    /// Half cycle; GLONASS channel or the signal numbers from 32 on.
    fn info(&self) -> u8 {
        let high = self.number.checked_sub(EXTENDED_FROM).unwrap_or(self.channel);
        high << 3 | if self.half_cycle { HALF_CYCLE } else { 0 }
    }

    fn phase_bytes(&self) -> Option<(u8, [u8; 2])> {
        two_parts(self.phase.unwrap_or(i64::from(i8::MIN) << 16), 8)
    }

    /// The lock time, up to `longest`; `none` without a phase.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // not negative, cut
    fn lock(&self, none: u16) -> u16 {
        let seconds = self.lock_s.floor().min(f64::from(none - 1)) as u16;
        if self.phase.is_some() { seconds } else { none }
    }

    /// The signal in full.
    fn type_1(&self, others: u8) -> [u8; TYPE_1] {
        let range = self.range.unwrap_or(0).to_le_bytes();
        let [doppler @ .., _, _, _, _] = self.doppler.unwrap_or(i64::from(i32::MIN)).to_le_bytes();
        let (phase_high, phase_low) =
            self.phase_bytes().unwrap_or((i8::MIN.cast_unsigned(), [0; 2]));
        let mut block = [0; TYPE_1];
        block[1..4].copy_from_slice(&[self.kind(), self.svid, range[4]]);
        block[4..8].copy_from_slice(&range[..4]);
        block[8..12].copy_from_slice(&doppler);
        block[12..14].copy_from_slice(&phase_low);
        block[14..16].copy_from_slice(&[phase_high, self.strength]);
        block[16..18].copy_from_slice(&self.lock(NO_LOCK_1).to_le_bytes());
        block[18..20].copy_from_slice(&[self.info(), others]);
        block
    }

    /// The signal as differences to the first one; `None` if they do not fit.
    fn type_2(&self, first: &Self) -> Option<[u8; TYPE_2]> {
        let range = match (self.range, first.range) {
            (Some(range), Some(first)) => range - first,
            (None, _) => -4 << 16,
            (Some(_), None) => return None,
        };
        let doppler = match (self.doppler, first.doppler) {
            (Some(doppler), Some(first_doppler)) => {
                let scaled = first_doppler as f64 * self.frequency_hz / first.frequency_hz;
                doppler - units(scaled, 1.0)?
            }
            (None, _) => -16 << 16,
            (Some(_), None) => return None,
        };
        let (range_high, range_low) = two_parts(range, 3)?;
        let (doppler_high, doppler_low) = two_parts(doppler, 5)?;
        let (phase_high, phase_low) = self.phase_bytes()?;
        let lock = u8::try_from(self.lock(u16::from(NO_LOCK_2))).ok()?;
        let mut block = [0; TYPE_2];
        block[..6].copy_from_slice(&[
            self.kind(),
            lock,
            self.strength,
            range_high | doppler_high << 3,
            phase_high,
            self.info(),
        ]);
        block[6..8].copy_from_slice(&range_low);
        block[8..10].copy_from_slice(&phase_low);
        block[10..12].copy_from_slice(&doppler_low);
        Some(block)
    }
}

/// Bits above 16, `width` of them, and the bytes of those below; `None` if the number does not fit.
fn two_parts(number: i64, width: u32) -> Option<(u8, [u8; 2])> {
    let [low, middle, high, ..] = number.to_le_bytes();
    let limit = 1i64 << (15 + width);
    (-limit..limit).contains(&number).then_some((high & (0xff >> (8 - width)), [low, middle]))
}

/// A number in units, if it is one.
#[allow(clippy::cast_possible_truncation)] // saturates
fn units(value: f64, unit: f64) -> Option<i64> {
    value.is_finite().then_some((value / unit).round() as i64)
}
