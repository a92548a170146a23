//! NMEA 2000: heading, rate of turn, attitude, position, course and speed as CAN frames, in the
//! text forms of gateways.
//!
//! | PGN | priority | what |
//! |---|---|---|
//! | 127250 | 2 | heading, true |
//! | 127251 | 2 | rate of turn, to starboard positive |
//! | 127257 | 3 | yaw, pitch (bow up positive), roll (to starboard positive) |
//! | 129025 | 2 | latitude, longitude |
//! | 129026 | 2 | course (true) and speed over ground |
//! | 129029 | 3 | time, position, height, quality: seven frames |
//!
//! What is not known is the greatest number of its type. Layouts: canboat's database of PGNs; the
//! text of YDWG RAW: user manual of the Yacht Devices YDWG-02, appendix E.

use std::fmt::Write as _;

use kurs::solution::{AttitudeEstimate, EpochSolution, PositionEstimate, PositionOrigin};
use kurs::time::{Calendar, GpsTime};
use kurs::turn_rate::{AngleRates, course_rad};

use crate::geoid::geoid_height_m;
use crate::unix_time;
use crate::whole;

/// The form of the text.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Form {
    /// What a gateway says that has heard it on the bus: `hh:mm:ss.sss R 09F11223 00 …`.
    YdwgRaw,
    /// What a gateway takes to say it on the bus: `09F11223 00 …`.
    YdwgToBus,
    /// canboat's plain text, a line for a whole message:
    /// `2024-03-10T12:00:00.000Z,2,127250,35,255,8,00,…`.
    Canboat,
}

/// Address on the bus; gateways put their own in its place.
const SOURCE: u8 = 35;
const EVERYBODY: u8 = 255;
/// Bytes of a CAN frame.
const FRAME: usize = 8;
/// Reference of a direction: true north, the other bits are reserved.
const TRUE_NORTH: u8 = 0xfc;
/// 10⁻⁴ rad.
const ANGLE_UNITS_PER_RAD: f64 = 1e4;

/// A message before it is cut into frames.
struct Pgn {
    number: u32,
    priority: u8,
    payload: Vec<u8>,
}

/// The messages of a row whose angles change with these rates, as lines.
#[must_use]
pub fn lines(row: &EpochSolution, rates: &AngleRates, form: Form) -> Vec<u8> {
    let time = nominal(row.time);
    let count = sequence(time);
    let attitude = row.attitude().filter(|_| row.is_fixed());
    let turn_radps = rates[0].filter(|_| attitude.is_some()).map(|rate| rate.radps);
    let position = row.position.as_ref();
    let messages = [
        heading(count, attitude),
        rate_of_turn(count, turn_radps),
        tilt(count, attitude),
        place(position),
        course(count, position),
        fix(count, time, row),
    ];
    let mut text = String::new();
    for pgn in messages {
        match form {
            Form::YdwgRaw => frames(&mut text, &pgn, count, Some(&time.utc())),
            Form::YdwgToBus => frames(&mut text, &pgn, count, None),
            Form::Canboat => canboat_line(&mut text, &pgn, &time.utc()),
        }
    }
    text.into_bytes()
}

/// Without what a receiver's clock steps the tag aside by.
fn nominal(time: GpsTime) -> GpsTime {
    const NS_PER_MS: i64 = 1_000_000;
    let milliseconds = (time.as_nanoseconds() + NS_PER_MS / 2).div_euclid(NS_PER_MS);
    GpsTime::from_nanoseconds(milliseconds * NS_PER_MS)
}

/// The number that messages of one epoch share, 0 to 252.
fn sequence(time: GpsTime) -> u8 {
    const NS_PER_HUNDREDTH: i64 = 10_000_000;
    const COUNT: i64 = 253;
    let hundredths = time.as_nanoseconds() / NS_PER_HUNDREDTH;
    u8::try_from(hundredths.rem_euclid(COUNT)).unwrap_or(0)
}

fn heading(count: u8, attitude: Option<&AttitudeEstimate>) -> Pgn {
    let mut payload = vec![count];
    payload.extend(direction(attitude.and_then(|a| a.heading_rad)));
    // Deviation and variation are those of a compass.
    payload.extend([i16::MAX.to_le_bytes(); 2].as_flattened());
    payload.push(TRUE_NORTH);
    Pgn { number: 127_250, priority: 2, payload }
}

fn rate_of_turn(count: u8, radps: Option<f64>) -> Pgn {
    const UNIT_RADPS: f64 = 3.125e-8;
    let rate = radps.map_or(i32::MAX, |radps| whole::i32(radps / UNIT_RADPS));
    let mut payload = vec![count];
    payload.extend(rate.to_le_bytes());
    payload.extend([0xff; 3]);
    Pgn { number: 127_251, priority: 2, payload }
}

/// Yaw is the heading from −π to π.
fn tilt(count: u8, attitude: Option<&AttitudeEstimate>) -> Pgn {
    let angles = attitude.map(AttitudeEstimate::angles_rad).unwrap_or_default();
    let mut payload = vec![count];
    for angle_rad in angles {
        let units =
            angle_rad.map_or(i16::MAX, |angle| whole::i16(half_turn(angle) * ANGLE_UNITS_PER_RAD));
        payload.extend(units.to_le_bytes());
    }
    payload.push(0xff);
    Pgn { number: 127_257, priority: 3, payload }
}

fn place(position: Option<&PositionEstimate>) -> Pgn {
    let angles = position.map(|p| [p.geodetic.latitude_rad, p.geodetic.longitude_rad]);
    let units = angles.map_or([i32::MAX; 2], |a| a.map(|a| whole::i32(a.to_degrees() * 1e7)));
    let payload = units.map(i32::to_le_bytes).as_flattened().to_vec();
    Pgn { number: 129_025, priority: 2, payload }
}

fn course(count: u8, position: Option<&PositionEstimate>) -> Pgn {
    let speed = position.and_then(|p| p.velocity_mps).map(|v| v.xyz().xy().norm());
    let mut payload = vec![count, TRUE_NORTH];
    payload.extend(direction(position.and_then(course_rad)));
    payload.extend(speed.map_or(u16::MAX, |mps| whole::u16(mps * 100.0)).to_le_bytes());
    payload.extend([0xff; 2]);
    Pgn { number: 129_026, priority: 2, payload }
}

fn fix(count: u8, time: GpsTime, row: &EpochSolution) -> Pgn {
    const NS_PER_DAY: i64 = 86_400_000_000_000;
    /// Several systems together (the type is that of GPS and GLONASS), in the lower four bits.
    const SYSTEMS: u8 = 2;
    /// No integrity is watched; the other bits are reserved.
    const NO_INTEGRITY: u8 = 0xfc;
    let unix_ns = unix_time::nanoseconds(time);
    let days = u16::try_from(unix_ns.div_euclid(NS_PER_DAY)).unwrap_or(u16::MAX);
    let in_day = u32::try_from(unix_ns.rem_euclid(NS_PER_DAY) / 100_000).unwrap_or(u32::MAX);
    let position = row.position.as_ref();
    let method = match position.map(|p| p.origin) {
        None => 0,
        Some(PositionOrigin::Alone) => 1,
        Some(PositionOrigin::StationCode) => 2,
        Some(PositionOrigin::StationPhase) => 4,
    };
    let wide = |value: Option<f64>| value.map_or(i64::MAX, whole::i64).to_le_bytes();
    let geodetic = position.map(|p| p.geodetic);
    let undulation_m = geodetic.as_ref().map(geoid_height_m);
    let sea_height_m =
        geodetic.zip(undulation_m).map(|(g, undulation_m)| g.height_m - undulation_m);
    let hdop = position.and_then(|p| p.hdop);
    let mut payload = vec![count];
    payload.extend(days.to_le_bytes());
    payload.extend(in_day.to_le_bytes());
    payload.extend(wide(geodetic.map(|g| g.latitude_rad.to_degrees() * 1e16)));
    payload.extend(wide(geodetic.map(|g| g.longitude_rad.to_degrees() * 1e16)));
    payload.extend(wide(sea_height_m.map(|height_m| height_m * 1e6)));
    payload.extend([SYSTEMS | method << 4, NO_INTEGRITY]);
    payload.push(u8::try_from(row.satellites_in_use()).unwrap_or(u8::MAX));
    payload.extend(hdop.map_or(i16::MAX, |hdop| whole::i16(hdop * 100.0)).to_le_bytes());
    payload.extend(i16::MAX.to_le_bytes());
    payload.extend(undulation_m.map_or(i32::MAX, |m| whole::i32(m * 100.0)).to_le_bytes());
    // Without reference stations.
    payload.push(0);
    Pgn { number: 129_029, priority: 3, payload }
}

/// From zero up to a full turn, which it does not reach by rounding.
fn direction(angle_rad: Option<f64>) -> [u8; 2] {
    let full_turn = whole::u16(core::f64::consts::TAU * ANGLE_UNITS_PER_RAD);
    let units = |angle: f64| whole::u16(angle * ANGLE_UNITS_PER_RAD) % full_turn;
    angle_rad.map_or(u16::MAX, units).to_le_bytes()
}

/// From −π to π.
fn half_turn(angle_rad: f64) -> f64 {
    use core::f64::consts::{PI, TAU};
    if angle_rad > PI { angle_rad - TAU } else { angle_rad }
}

/// The frames of a message as lines of YDWG RAW.
fn frames(text: &mut String, pgn: &Pgn, count: u8, heard: Option<&Calendar>) {
    let identifier = u32::from(pgn.priority) << 26 | pgn.number << 8 | u32::from(SOURCE);
    for frame in cut(&pgn.payload, count) {
        if let Some(utc) = heard {
            let Calendar { hour, minute, second, .. } = utc;
            let _ = write!(text, "{hour:02}:{minute:02}:{second:06.3} R ");
        }
        let _ = write!(text, "{identifier:08X}");
        frame.iter().for_each(|byte| {
            let _ = write!(text, " {byte:02X}");
        });
        text.push_str("\r\n");
    }
}

/// More than eight bytes are a fast packet: every frame has the count of the message (three bits)
/// and its own, the first one the length; the last is filled up.
fn cut(payload: &[u8], count: u8) -> Vec<Vec<u8>> {
    const FIRST: usize = FRAME - 2;
    const NEXT: usize = FRAME - 1;
    if payload.len() <= FRAME {
        return vec![payload.to_vec()];
    }
    let message = count << 5;
    let (first, rest) = payload.split_at(FIRST);
    let length = u8::try_from(payload.len()).unwrap_or(u8::MAX);
    let mut frames = vec![[&[message, length], first].concat()];
    for (piece, number) in rest.chunks(NEXT).zip(1u8..) {
        let mut frame = [&[message | number], piece].concat();
        frame.resize(FRAME, 0xff);
        frames.push(frame);
    }
    frames
}

fn canboat_line(text: &mut String, pgn: &Pgn, utc: &Calendar) {
    let Pgn { number, priority, payload } = pgn;
    let (date, length) = (utc.iso(3), payload.len());
    let _ = write!(text, "{date}Z,{priority},{number},{SOURCE},{EVERYBODY},{length}");
    payload.iter().for_each(|byte| {
        let _ = write!(text, ",{byte:02x}");
    });
    text.push_str("\r\n");
}
