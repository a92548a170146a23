//! A row as a receiver with a moving base says it: NAV-DOP, NAV-PVT, NAV-RELPOSNED of one epoch,
//! and NAV-DAHEADING of receivers with two antennas.
//!
//! Source: u-blox F9 HPG 1.32 interface description, UBX-22008968, sections 3.15.3, 3.15.11,
//! 3.15.12; the layout of NAV-DAHEADING is that of pyubx2 1.4.0. What is not known is a flag that
//! is off, zero, and an accuracy that is the greatest number of its type.

use kurs::solution::{EpochSolution, PositionEstimate, PositionOrigin};
use kurs::time::GpsTime;
use kurs::turn_rate::course_rad;

use super::antenna_line::{AntennaLine, Measured};
use super::frame;
use crate::dilution::Dilution;
use crate::geoid::geoid_height_m;
use crate::whole;

const NAV_DOP: [u8; 2] = [0x01, 0x04];
const NAV_PVT: [u8; 2] = [0x01, 0x07];
const NAV_RELPOSNED: [u8; 2] = [0x01, 0x3c];
const NAV_DAHEADING: [u8; 2] = [0x01, 0x45];

/// Units of 10⁻⁵ degree.
const ANGLE_UNITS_PER_DEG: f64 = 1e5;
/// What an unknown accuracy says.
const UNKNOWN: u32 = u32::MAX;
/// Accuracy of a heading that is not known, 10⁻⁵ degree.
const HALF_TURN: f64 = 180.0 * ANGLE_UNITS_PER_DEG;
/// 1 sigma of the velocity, m/s: rows have none. `tests/profiles/run` holds the error of simulated
/// receivers with Doppler to three times this.
pub(crate) const SPEED_SD_MPS: f64 = 0.1;

/// `flags` of NAV-RELPOSNED and NAV-DAHEADING.
const FIX_OK: u32 = 1;
const DIFFERENTIAL: u32 = 1 << 1;
const LINE_VALID: u32 = 1 << 2;
const CARRIER_FIXED: u32 = 1 << 4;
const IS_MOVING: u32 = 1 << 5;
const HEADING_VALID_OF_TWO_ANTENNAS: u32 = 1 << 6;
const HEADING_VALID: u32 = 1 << 8;

/// The messages of a row, all with one time of week.
#[must_use]
pub fn navigation(row: &EpochSolution, line: &AntennaLine, has_two_antennas: bool) -> Vec<u8> {
    let time = to_milliseconds(row.time);
    let measured = line.in_row(row);
    let mut bytes = dop(time, row.position.as_ref());
    bytes.extend(pvt(time, row));
    bytes.extend(relposned(time, row, measured.as_ref()));
    if has_two_antennas {
        bytes.extend(daheading(time, row, measured.as_ref()));
    }
    bytes
}

/// Time tags are off by what a receiver's clock steps them aside.
fn to_milliseconds(time: GpsTime) -> GpsTime {
    const NS_PER_MS: i64 = 1_000_000;
    let milliseconds = (time.as_nanoseconds() + NS_PER_MS / 2).div_euclid(NS_PER_MS);
    GpsTime::from_nanoseconds(milliseconds * NS_PER_MS)
}

/// `iTOW`: time of the GPS week, ms.
fn tow_ms(time: GpsTime) -> [u8; 4] {
    whole::u32(time.tow_s() * 1e3).to_le_bytes()
}

/// Dilutions of precision, 0.01; 99.99 stands for none.
fn dop(time: GpsTime, position: Option<&PositionEstimate>) -> Vec<u8> {
    const NONE: f64 = 99.99;
    let known = position.and_then(Dilution::of);
    let of = |value: fn(&Dilution) -> f64| known.as_ref().map_or(NONE, value).min(NONE);
    // Those that have the time in them are not known.
    let values = [
        NONE,
        of(|d| d.position),
        NONE,
        of(|d| d.vertical),
        of(|d| d.horizontal),
        of(|d| d.north),
        of(|d| d.east),
    ];
    let mut payload = tow_ms(time).to_vec();
    payload.extend(values.iter().flat_map(|value| whole::u16(value * 100.0).to_le_bytes()));
    frame(NAV_DOP, &payload)
}

/// Position, velocity, time.
fn pvt(time: GpsTime, row: &EpochSolution) -> Vec<u8> {
    /// Date and time are valid, and to the second.
    const TIME_VALID: u8 = 0b111;
    const FIX_3D: u8 = 3;
    const VEHICLE_HEADING_VALID: u8 = 1 << 5;
    const INVALID_PLACE: u16 = 1;
    /// Accuracy of the broadcast time, ns.
    const TIME_ACCURACY_NS: u32 = 100;
    let position = row.position.as_ref();
    let utc = time.utc();
    let whole_second = utc.second.floor();
    let heading = row.attitude().filter(|_| row.is_fixed()).and_then(|a| a.heading_rad);

    let mut p = tow_ms(time).to_vec();
    p.extend(whole::u16(f64::from(utc.year)).to_le_bytes());
    p.extend([utc.month, utc.day, utc.hour, utc.minute, whole::u8(whole_second), TIME_VALID]);
    p.extend(TIME_ACCURACY_NS.to_le_bytes());
    p.extend(whole::i32((utc.second - whole_second) * 1e9).to_le_bytes());
    p.push(if position.is_some() { FIX_3D } else { 0 });
    let vehicle = if heading.is_some() { VEHICLE_HEADING_VALID } else { 0 };
    // `flags2`: nothing is confirmed.
    p.extend([position.map_or(0, fix_flags) | vehicle, 0]);
    p.push(u8::try_from(row.satellites_in_use()).unwrap_or(u8::MAX));
    p.extend(place_and_velocity(position));
    let pdop = position.and_then(Dilution::of).map_or(99.99, |d| d.position.min(99.99));
    p.extend(whole::u16(pdop * 100.0).to_le_bytes());
    p.extend(if position.is_some() { 0 } else { INVALID_PLACE }.to_le_bytes());
    p.extend([0; 4]);
    p.extend(angle(heading).to_le_bytes());
    // The magnetic declination is not known.
    p.extend([0; 4]);
    frame(NAV_PVT, &p)
}

/// `flags` of NAV-PVT: fix, differential corrections, phases with integers.
fn fix_flags(position: &PositionEstimate) -> u8 {
    match position.origin {
        PositionOrigin::Alone => 0b01,
        PositionOrigin::StationCode => 0b11,
        PositionOrigin::StationPhase => 0b11 | 2 << 6,
    }
}

/// Longitude to accuracy of the heading of motion.
fn place_and_velocity(position: Option<&PositionEstimate>) -> Vec<u8> {
    let Some(position) = position else {
        let (zero, unknown) = ([0; 16], [UNKNOWN.to_le_bytes(); 2]);
        let mut nothing = zero.to_vec();
        nothing.extend(unknown.as_flattened());
        nothing.extend(motion(None, None));
        return nothing;
    };
    let geodetic = &position.geodetic;
    let sea_height_m = geodetic.height_m - geoid_height_m(geodetic);
    let covariance = &position.covariance_m2;
    let horizontal_sd_m = (covariance[(0, 0)] + covariance[(1, 1)]).sqrt();
    let signed = [
        geodetic.longitude_rad.to_degrees() * 1e7,
        geodetic.latitude_rad.to_degrees() * 1e7,
        geodetic.height_m * 1e3,
        sea_height_m * 1e3,
    ];
    let accuracies = [horizontal_sd_m * 1e3, covariance[(2, 2)].sqrt() * 1e3];
    let mut bytes: Vec<u8> = signed.iter().flat_map(|v| whole::i32(*v).to_le_bytes()).collect();
    bytes.extend(accuracies.iter().flat_map(|v| whole::u32(*v).to_le_bytes()));
    bytes.extend(motion(position.velocity_mps.map(|v| v.xyz().into()), course_rad(position)));
    bytes
}

/// Velocity (north, east, down), speed, course and their accuracies.
fn motion(velocity_mps: Option<[f64; 3]>, course_rad: Option<f64>) -> Vec<u8> {
    let [north, east, down] = velocity_mps.unwrap_or_default();
    let speed = north.hypot(east);
    let mut bytes: Vec<u8> =
        [north, east, down, speed].iter().flat_map(|v| whole::i32(v * 1e3).to_le_bytes()).collect();
    bytes.extend(angle(course_rad).to_le_bytes());
    let speed_accuracy = velocity_mps.map_or(UNKNOWN, |_| whole::u32(SPEED_SD_MPS * 1e3));
    let course_accuracy =
        course_rad.map_or(HALF_TURN, |_| (SPEED_SD_MPS / speed).to_degrees() * ANGLE_UNITS_PER_DEG);
    bytes.extend(speed_accuracy.to_le_bytes());
    bytes.extend(whole::u32(course_accuracy).to_le_bytes());
    bytes
}

/// The vector to the rover in centimetres and tenths of millimetres.
fn relposned(time: GpsTime, row: &EpochSolution, measured: Option<&Measured>) -> Vec<u8> {
    let mut p = vec![1, 0, 0, 0];
    p.extend(tow_ms(time));
    let parts: [(i32, i8); 4] = components_m(measured).map(|value_m| {
        let tenths = whole::i32(value_m * 1e4);
        (tenths / 100, whole::i8(f64::from(tenths % 100)))
    });
    p.extend(parts.iter().flat_map(|(centimetres, _)| centimetres.to_le_bytes()));
    p.extend(angle(measured.map(Measured::heading_rad)).to_le_bytes());
    p.extend([0; 4]);
    p.extend(parts.iter().flat_map(|(_, tenths)| tenths.to_le_bytes()));
    p.extend(accuracies(measured, 1e4));
    p.extend([0; 4]);
    let valid = measured.map_or(0, |_| HEADING_VALID);
    p.extend((line_flags(row, measured) | IS_MOVING | valid).to_le_bytes());
    frame(NAV_RELPOSNED, &p)
}

/// UBX-NAV-DAHEADING, version 2: the line and its angles, in millimetres.
fn daheading(time: GpsTime, row: &EpochSolution, measured: Option<&Measured>) -> Vec<u8> {
    let mut p = vec![2, 0, 0, 0];
    p.extend(tow_ms(time));
    let components = components_m(measured).map(|value_m| whole::i32(value_m * 1e3).to_le_bytes());
    p.extend(components.as_flattened());
    p.extend(angle(measured.map(Measured::heading_rad)).to_le_bytes());
    p.extend([0; 4]);
    p.extend(accuracies(measured, 1e3));
    p.extend([0; 4]);
    let valid = measured.map_or(0, |_| HEADING_VALID_OF_TWO_ANTENNAS);
    p.extend((line_flags(row, measured) | valid).to_le_bytes());
    frame(NAV_DAHEADING, &p)
}

/// North, east, down, length.
fn components_m(measured: Option<&Measured>) -> [f64; 4] {
    measured.map_or([0.0; 4], |measured| {
        let [north, east, down]: [f64; 3] = measured.ned_m.xyz().into();
        [north, east, down, measured.length_m()]
    })
}

/// Accuracies of the components, the length and the heading.
fn accuracies(measured: Option<&Measured>, units_per_m: f64) -> Vec<u8> {
    let Some(measured) = measured else {
        return [UNKNOWN.to_le_bytes(); 5].as_flattened().to_vec();
    };
    let [north, east, down]: [f64; 3] = measured.covariance_m2.diagonal().into();
    let length_variance = measured.length_sd_m().powi(2);
    let mut bytes: Vec<u8> = [north, east, down, length_variance]
        .iter()
        .flat_map(|variance| whole::u32(variance.sqrt() * units_per_m).to_le_bytes())
        .collect();
    let heading_sd = measured.heading_sd_rad().to_degrees() * ANGLE_UNITS_PER_DEG;
    // An accuracy of zero would be one that is not known.
    bytes.extend(whole::u32(heading_sd.max(1.0)).to_le_bytes());
    bytes
}

fn line_flags(row: &EpochSolution, measured: Option<&Measured>) -> u32 {
    let fix = if row.position.is_some() { FIX_OK } else { 0 };
    fix | measured.map_or(0, |_| DIFFERENTIAL | LINE_VALID | CARRIER_FIXED)
}

/// Units of 10⁻⁵ degree, below a full turn also after rounding.
fn angle(angle_rad: Option<f64>) -> i32 {
    const TURN: f64 = 360.0 * ANGLE_UNITS_PER_DEG;
    let units = angle_rad.map_or(0.0, |angle| angle.to_degrees() * ANGLE_UNITS_PER_DEG);
    whole::i32(units.round().rem_euclid(TURN))
}
