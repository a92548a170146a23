//! What the satellites tell beside their ephemerides: GPSIon, GALIon, BDSIon; GPSUtc, GALUtc, BDSUtc,
//! GLOTime; GALGstGps.
//!
//! Source: reference guide, 4.2.3 to 4.2.6.

use kurs::ephemeris::{Klobuchar, NavigationData, SystemTimeOffset, UtcParameters};
use kurs::signal::System;
use kurs::time::{GPST_MINUS_BDT_S, GpsTime};

use super::block::{Block, BlockFields, BlockReader, BlockWriter};

const GPS_ION: u16 = 5893;
const GAL_ION: u16 = 4030;
const BDS_ION: u16 = 4120;
const GPS_UTC: u16 = 5894;
const GAL_UTC: u16 = 4031;
const BDS_UTC: u16 = 4121;
const GLO_TIME: u16 = 4036;
const GAL_GST_GPS: u16 = 4032;

/// Weeks of UTC parameters have eight bits, that of the offset to GPS time six.
const UTC_WEEKS: u64 = 256;
const OFFSET_WEEKS: u64 = 64;
const WEEK_S: f64 = 604_800.0;
const DAY_S: f64 = 86_400.0;

/// Takes what a block tells, received at `time`; `None` if it is another block or too short.
pub(super) fn take(block: &Block<'_>, time: GpsTime, data: &mut NavigationData) -> Option<()> {
    let mut reader = BlockReader::new(block.content);
    reader.skip(2); // satellite, source
    match block.number {
        GPS_ION | BDS_ION => {
            let mut model = Klobuchar { alpha: [0.0; 4], beta: [0.0; 4] };
            describe_klobuchar(&mut reader, &mut model);
            let model = reader.is_whole().then_some(model)?;
            let of_system = match block.number {
                GPS_ION => &mut data.ionosphere.gps,
                _ => &mut data.ionosphere.beidou,
            };
            *of_system = Some(model);
        }
        GAL_ION => {
            let mut levels = [0.0; 3];
            levels.iter_mut().for_each(|level| reader.f4(1.0, level));
            data.ionosphere.galileo = Some(reader.is_whole().then_some(levels)?);
        }
        GPS_UTC | GAL_UTC => {
            let mut utc = Utc::default();
            describe_utc(&mut reader, &mut utc);
            let system = if block.number == GPS_UTC { System::Gps } else { System::Galileo };
            let reference_time = in_week(time, utc.week, UTC_WEEKS) + utc.reference_s;
            if reader.is_whole() {
                push_utc(data, utc.parameters(system, reference_time));
                data.leap_seconds = Some(utc.leaps.at(time));
            }
        }
        BDS_UTC => {
            let mut utc = Utc::default();
            reader.f4(1.0, &mut utc.drift);
            reader.f8(1.0, &mut utc.bias_s);
            describe_leaps(&mut reader, &mut utc.leaps);
            // A₁ counts from the beginning of BeiDou's week.
            let own = time + -GPST_MINUS_BDT_S;
            let reference_time = own + -own.tow_s() + GPST_MINUS_BDT_S;
            if reader.is_whole() {
                push_utc(data, utc.parameters(System::BeiDou, reference_time));
            }
        }
        GLO_TIME => {
            let (mut ahead_s, mut correction_s) = (0.0, 0.0);
            reader.skip(1 + 1 + 2); // N₄, KP, N
            reader.f4(1.0, &mut ahead_s);
            reader.f8(1.0, &mut correction_s);
            if reader.is_whole() {
                let reference_time = time + -time.tow_s() % DAY_S;
                // UTC = t + τ_c and GPST = t + τ_GPS, whole seconds left out.
                let utc = Utc { bias_s: -correction_s, ..Utc::default() };
                push_utc(data, utc.parameters(System::Glonass, reference_time));
                let bias_s = -ahead_s;
                push_offset(data, System::Glonass, [bias_s, 0.0], reference_time);
            }
        }
        GAL_GST_GPS => {
            const NANOSECOND_S: f64 = 1e-9;
            let (mut drift, mut bias_s, mut reference_s, mut week) = (0.0, 0.0, 0.0, 0);
            reader.f4(NANOSECOND_S, &mut drift);
            reader.f4(NANOSECOND_S, &mut bias_s);
            reader.seconds(&mut reference_s);
            reader.u1(&mut week);
            if reader.is_whole() {
                // Weeks of Galileo are those of GPS less 1024.
                let reference_time = in_week(time, week, OFFSET_WEEKS) + reference_s;
                push_offset(data, System::Galileo, [bias_s, drift], reference_time);
            }
        }
        _ => return None,
    }
    Some(())
}

/// The blocks that say what `data` says of the ionosphere and of UTC, as of `time`.
pub(super) fn blocks(data: &NavigationData, time: GpsTime) -> Vec<(u16, Vec<u8>)> {
    let block = |number: u16, describe: &mut dyn FnMut(&mut BlockWriter)| {
        let mut writer = BlockWriter::default();
        // The first satellite of the system; its message.
        writer.bytes(match number {
            GAL_ION | GAL_UTC => [71, 2],
            BDS_ION => [141, 0],
            _ => [1, 0],
        });
        describe(&mut writer);
        writer.finish().map(|content| (number, content))
    };
    let ionosphere = &data.ionosphere;
    let klobuchar = |number: u16, model: Option<Klobuchar>| {
        let mut model = model?;
        block(number, &mut |writer| describe_klobuchar(writer, &mut model))
    };
    let galileo = ionosphere.galileo.and_then(|mut levels| {
        block(GAL_ION, &mut |writer| {
            levels.iter_mut().for_each(|level| writer.f4(1.0, level));
            writer.skip(1); // storms
        })
    });
    let utc = |(number, system): (u16, System)| {
        let parameters = data.utc.iter().find(|parameters| parameters.system == system)?;
        let mut utc = Utc::of(parameters, time);
        block(number, &mut |writer| describe_utc(writer, &mut utc))
    };
    [klobuchar(GPS_ION, ionosphere.gps), klobuchar(BDS_ION, ionosphere.beidou), galileo]
        .into_iter()
        .chain([(GPS_UTC, System::Gps), (GAL_UTC, System::Galileo)].map(utc))
        .flatten()
        .collect()
}

fn describe_klobuchar(f: &mut impl BlockFields, model: &mut Klobuchar) {
    let Klobuchar { alpha, beta } = model;
    alpha.iter_mut().chain(beta).for_each(|coefficient| f.f4(1.0, coefficient));
}

/// System time against UTC, as messages tell it.
#[derive(Debug, Clone, Copy, Default)]
struct Utc {
    drift: f64,
    bias_s: f64,
    reference_s: f64,
    week: u64,
    leaps: Leaps,
}

/// Leap seconds before and after an instant.
#[derive(Debug, Clone, Copy, Default)]
struct Leaps {
    before: i32,
    week: u64,
    day: u64,
    after: i32,
}

impl Utc {
    const fn parameters(&self, system: System, reference_time: GpsTime) -> UtcParameters {
        UtcParameters { system, bias_s: self.bias_s, drift: self.drift, reference_time }
    }

    /// What a message says at `time`, no leap second being near.
    fn of(parameters: &UtcParameters, time: GpsTime) -> Self {
        let weeks = |time: GpsTime| time.week().rem_euclid(256).unsigned_abs();
        let reference_s = parameters.reference_time.tow_s().round();
        let leaps = time.leap_seconds();
        Self {
            drift: parameters.drift,
            bias_s: parameters.bias_s,
            reference_s,
            week: weeks(parameters.reference_time),
            leaps: Leaps { before: leaps, week: weeks(time), day: 1, after: leaps },
        }
    }
}

impl Leaps {
    /// The leap seconds in force at `time`: they change at the end of the day, the first one being 1.
    fn at(&self, time: GpsTime) -> i32 {
        let effective = in_week(time, self.week, UTC_WEEKS) + self.day as f64 * DAY_S;
        if time < effective { self.before } else { self.after }
    }
}

/// GPSUtc and GALUtc behind the satellite.
fn describe_utc(f: &mut impl BlockFields, utc: &mut Utc) {
    f.f4(1.0, &mut utc.drift);
    f.f8(1.0, &mut utc.bias_s);
    f.seconds(&mut utc.reference_s);
    f.u1(&mut utc.week);
    describe_leaps(f, &mut utc.leaps);
}

fn describe_leaps(f: &mut impl BlockFields, leaps: &mut Leaps) {
    f.i1(&mut leaps.before);
    f.u1(&mut leaps.week);
    f.u1(&mut leaps.day);
    f.i1(&mut leaps.after);
}

/// The beginning of the week next to `time` whose number ends like `week`.
fn in_week(time: GpsTime, week: u64, period: u64) -> GpsTime {
    let period = period.cast_signed();
    let behind = (time.week() - week.cast_signed() + period / 2).rem_euclid(period) - period / 2;
    time + -time.tow_s() + -(behind as f64 * WEEK_S)
}

/// Every satellite sends the same parameters: they are kept once.
fn push_utc(data: &mut NavigationData, parameters: UtcParameters) {
    if !data.utc.contains(&parameters) {
        data.utc.push(parameters);
    }
}

fn push_offset(
    data: &mut NavigationData,
    minuend: System,
    [bias_s, drift]: [f64; 2],
    reference_time: GpsTime,
) {
    let subtrahend = System::Gps;
    let offset = SystemTimeOffset { minuend, subtrahend, bias_s, drift, reference_time };
    if !data.time_offsets.contains(&offset) {
        data.time_offsets.push(offset);
    }
}
