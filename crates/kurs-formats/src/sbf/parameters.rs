//! What the satellites broadcast beside their ephemerides: GPSIon, GALIon, BDSIon; GPSUtc, GALUtc,
//! BDSUtc, GLOTime; GALGstGps.
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
/// UTC parameters, and offsets between systems, that are kept: satellites send new ones once a day.
const KEPT_MAX: usize = 1000;

/// Takes what a block tells, received at `time`; `None` if it is another block or damaged.
pub(super) fn take(block: &Block<'_>, time: GpsTime, data: &mut NavigationData) -> Option<()> {
    let mut reader = BlockReader::new(block.content);
    reader.skip(2); // satellite, source
    match block.number {
        GPS_ION => data.ionosphere.gps = Some(klobuchar(&mut reader)?),
        BDS_ION => data.ionosphere.beidou = Some(klobuchar(&mut reader)?),
        GAL_ION => data.ionosphere.galileo = Some(galileo_ionosphere(&mut reader)?),
        GPS_UTC => take_utc(&mut reader, System::Gps, time, data),
        GAL_UTC => take_utc(&mut reader, System::Galileo, time, data),
        BDS_UTC => take_beidou_utc(&mut reader, time, data),
        GLO_TIME => take_glonass_time(&mut reader, time, data),
        GAL_GST_GPS => take_galileo_offset(&mut reader, time, data),
        _ => return None,
    }
    Some(())
}

fn klobuchar(reader: &mut BlockReader<'_>) -> Option<Klobuchar> {
    let mut model = Klobuchar { alpha: [0.0; 4], beta: [0.0; 4] };
    describe_klobuchar(reader, &mut model);
    let is_sane = model.alpha.iter().chain(&model.beta).all(|number| number.is_finite());
    (reader.is_whole() && is_sane).then_some(model)
}

fn galileo_ionosphere(reader: &mut BlockReader<'_>) -> Option<[f64; 3]> {
    let mut levels = [0.0; 3];
    levels.iter_mut().for_each(|level| reader.f4(1.0, level));
    (reader.is_whole() && levels.iter().all(|level| level.is_finite())).then_some(levels)
}

/// GPSUtc and GALUtc, which have the leap seconds too.
fn take_utc(
    reader: &mut BlockReader<'_>,
    system: System,
    time: GpsTime,
    data: &mut NavigationData,
) {
    let mut utc = Utc::default();
    describe_utc(reader, &mut utc);
    let reference_time = in_week(time, utc.week, UTC_WEEKS) + utc.reference_s;
    if reader.is_whole() {
        push_utc(data, utc.parameters(system, reference_time));
        data.leap_seconds = Some(utc.leaps.at(time));
    }
}

fn take_beidou_utc(reader: &mut BlockReader<'_>, time: GpsTime, data: &mut NavigationData) {
    let mut utc = Utc::default();
    reader.f4(1.0, &mut utc.drift);
    reader.f8(1.0, &mut utc.bias_s);
    describe_leaps(reader, &mut utc.leaps);
    // A₁ counts from the beginning of BeiDou's week.
    let own = time + -GPST_MINUS_BDT_S;
    let reference_time = own + -own.tow_s() + GPST_MINUS_BDT_S;
    if reader.is_whole() {
        push_utc(data, utc.parameters(System::BeiDou, reference_time));
    }
}

/// GLOTime: GLONASS time against UTC and against GPS time.
fn take_glonass_time(reader: &mut BlockReader<'_>, time: GpsTime, data: &mut NavigationData) {
    let (mut ahead_s, mut correction_s) = (0.0, 0.0);
    reader.skip(1 + 1 + 2); // N₄, KP, N
    reader.f4(1.0, &mut ahead_s);
    reader.f8(1.0, &mut correction_s);
    if reader.is_whole() {
        let reference_time = time + -time.tow_s() % DAY_S;
        // UTC = t + τ_c and GPST = t + τ_GPS, whole seconds left out.
        let utc = Utc { bias_s: -correction_s, ..Utc::default() };
        push_utc(data, utc.parameters(System::Glonass, reference_time));
        push_offset(data, System::Glonass, [-ahead_s, 0.0], reference_time);
    }
}

/// GALGstGps: Galileo time against GPS time.
fn take_galileo_offset(reader: &mut BlockReader<'_>, time: GpsTime, data: &mut NavigationData) {
    let (mut drift, mut bias_s, mut reference_s, mut week) = (0.0, 0.0, 0.0, 0);
    // "1·10⁹ ns/s" and "1·10⁹ ns": s/s and s.
    reader.f4(1.0, &mut drift);
    reader.f4(1.0, &mut bias_s);
    reader.seconds(&mut reference_s);
    reader.u1(&mut week);
    if reader.is_whole() {
        // Weeks of Galileo are those of GPS less 1024.
        let reference_time = in_week(time, week, OFFSET_WEEKS) + reference_s;
        push_offset(data, System::Galileo, [bias_s, drift], reference_time);
    }
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
    if data.utc.len() < KEPT_MAX && !data.utc.contains(&parameters) {
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
    if data.time_offsets.len() < KEPT_MAX && !data.time_offsets.contains(&offset) {
        data.time_offsets.push(offset);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Week 2300 (252 in eight bits, 60 in six), Wednesday noon.
    fn time() -> GpsTime {
        GpsTime::from_week_tow(2300, 3.5 * DAY_S).unwrap()
    }

    /// What a block with this content, byte by byte as the guide lists it, tells.
    fn read(number: u16, content: &[&[u8]]) -> NavigationData {
        let mut data = NavigationData::default();
        let framed = super::super::block::framed(number, time(), &content.concat()).unwrap();
        take(&Block::of(&framed[4..]), time(), &mut data);
        data
    }

    fn f4(value: f32) -> [u8; 4] {
        value.to_le_bytes()
    }

    fn f8(value: f64) -> [u8; 8] {
        value.to_le_bytes()
    }

    /// PRN and a byte more, A₁, A₀, t_ot, WN_t, Δt_LS, WN_LSF, DN, Δt_LSF.
    fn utc(leaps: [u8; 4]) -> NavigationData {
        let reference = [405_504u32.to_le_bytes().as_slice(), &[252]].concat();
        read(GPS_UTC, &[&[3, 0], &f4(2f32.powi(-50)), &f8(2f64.powi(-30)), &reference, &leaps])
    }

    #[test]
    fn utc_of_gps_and_galileo() {
        let data = utc([18, 137, 7, 18]);
        let reference_time = GpsTime::from_week_tow(2300, 405_504.0).unwrap();
        let (bias_s, drift) = (2f64.powi(-30), 2f64.powi(-50));
        let system = System::Gps;
        assert_eq!(data.utc, [UtcParameters { system, bias_s, drift, reference_time }]);
        assert_eq!(data.leap_seconds, Some(18));
        // A leap second at the end of the third day of this week, which is behind or ahead.
        assert_eq!(utc([18, 252, 3, 19]).leap_seconds, Some(19));
        assert_eq!(utc([18, 252, 4, 19]).leap_seconds, Some(18));
        let content: &[&[u8]] =
            &[&[71, 2], &f4(0.0), &f8(1e-9), &[0; 4], &[252], &[18, 137, 7, 18]];
        let data = read(GAL_UTC, content);
        assert_eq!((data.utc[0].system, data.utc[0].bias_s), (System::Galileo, 1e-9));
        // A block that is cut tells nothing (the framing fills up to a multiple of four bytes).
        assert_eq!(read(GPS_UTC, &[&[3, 0], &f4(0.0), &f8(1e-9)]), NavigationData::default());
    }

    #[test]
    fn utc_of_beidou() {
        let data = read(BDS_UTC, &[&[145, 0], &f4(1e-14), &f8(3e-9), &[4, 61, 6, 4]]);
        // The week of BeiDou begins 14 s behind that of GPS.
        let reference_time = GpsTime::from_week_tow(2300, 14.0).unwrap();
        let [UtcParameters { system: System::BeiDou, bias_s: 3e-9, drift, reference_time: found }] =
            data.utc[..]
        else {
            panic!("{:?}", data.utc);
        };
        assert_eq!((drift, found), (f64::from(1e-14f32), reference_time));
        assert_eq!(data.leap_seconds, None);
    }

    /// UTC = t + τ_c, GPST = t + τ_GPS: GPST − UTC = τ_GPS − τ_c, whole seconds left out.
    #[test]
    fn time_of_glonass() {
        let day = 700u16.to_le_bytes();
        let content: &[&[u8]] = &[&[45, 8, 7, 0], &day, &f4(2e-9), &f8(-5e-9), &f4(0.0), &f4(0.0)];
        let data = read(GLO_TIME, content);
        assert_eq!(data.utc[0].bias_s, 5e-9);
        assert_eq!(data.time_offsets[0].minuend, System::Glonass);
        assert!((data.utc_remainder_s(time()) - 7e-9).abs() < 1e-15);
    }

    #[test]
    fn galileo_time_against_that_of_gps() {
        let reference = [345_600u32.to_le_bytes().as_slice(), &[60]].concat();
        let data = read(GAL_GST_GPS, &[&[71, 2], &f4(2e-15), &f4(3e-9), &reference]);
        let reference_time = GpsTime::from_week_tow(2300, 345_600.0).unwrap();
        let offset = data.time_offsets[0];
        assert_eq!((offset.minuend, offset.subtrahend), (System::Galileo, System::Gps));
        assert_eq!(offset.reference_time, reference_time);
        assert_eq!((offset.bias_s, offset.drift), (f64::from(3e-9f32), f64::from(2e-15f32)));
    }

    #[test]
    fn ionosphere() {
        let coefficients = [1e-8f32, 2e-8, -3e-8, -4e-8, 9e4, 1e5, -6e4, -3e5];
        let bytes = coefficients.map(f4).concat();
        for (number, satellite) in [(GPS_ION, 5), (BDS_ION, 145)] {
            let data = read(number, &[&[satellite, 0], &bytes]);
            let [gps, beidou] = [data.ionosphere.gps, data.ionosphere.beidou];
            let model = if number == GPS_ION { gps } else { beidou }.unwrap();
            assert_eq!((model.alpha[2], model.beta[3]), (f64::from(-3e-8f32), -3e5));
        }
        let data = read(GAL_ION, &[&[71, 2], &[30f32, 0.5, 0.01].map(f4).concat(), &[0]]);
        assert_eq!(data.ionosphere.galileo, Some([30.0, 0.5, f64::from(0.01f32)]));
        let no_numbers = [f32::NAN; 8].map(f4).concat();
        assert_eq!(read(GPS_ION, &[&[5, 0], &no_numbers]), NavigationData::default());
        assert_eq!(read(GAL_ION, &[&[71, 2], &no_numbers]), NavigationData::default());
    }
}
