//! GPS_INPUT of MAVLink 2: position, velocity and yaw for ArduPilot (`GPS1_TYPE` 14).
//!
//! Source: message 232 of `common.xml`, mavlink.io. The yaw is in hundredths of a degree; 0 stands
//! for no yaw, 36000 for north.

use kurs::solution::{EpochSolution, PositionEstimate, PositionOrigin};

use crate::dilution::Dilution;
use crate::geoid::geoid_height_m;
use crate::ubx::SPEED_SD_MPS;
use crate::unix_time;
use crate::whole;

const GPS_INPUT: u32 = 232;
/// Checksum seed of the layout of GPS_INPUT.
const CRC_EXTRA: u8 = 151;
/// The vehicle, and a GNSS receiver on it.
const SYSTEM: u8 = 1;
const COMPONENT: u8 = 220;

/// The message of a row; `sequence` counts the messages of a sender.
#[must_use]
pub fn gps_input(row: &EpochSolution, sequence: u8) -> Vec<u8> {
    let time = row.time;
    let mut payload = Vec::new();
    payload.extend(unix_time::nanoseconds(time).div_euclid(1000).to_le_bytes());
    payload.extend(whole::u32(time.tow_s() * 1e3).to_le_bytes());
    let values = Values::of(row.position.as_ref());
    payload.extend(values.place.iter().flat_map(|v| v.to_le_bytes()));
    payload.extend(values.numbers.iter().flat_map(|v| v.to_le_bytes()));
    payload.extend(values.ignored.to_le_bytes());
    payload.extend(u16::try_from(time.week()).unwrap_or(0).to_le_bytes());
    let satellites = u8::try_from(row.satellites_in_use()).unwrap_or(u8::MAX);
    payload.extend([0, values.fix, satellites]);
    payload.extend(yaw(row).to_le_bytes());
    message(GPS_INPUT, CRC_EXTRA, sequence, &payload)
}

/// Hundredths of a degree from 1 to 36000; 0 without a heading.
fn yaw(row: &EpochSolution) -> u16 {
    const TURN: u16 = 36_000;
    let heading = row.attitude().filter(|_| row.is_fixed()).and_then(|a| a.heading_rad);
    let Some(heading_rad) = heading else { return 0 };
    match whole::u16(heading_rad.to_degrees() * 100.0) % TURN {
        0 => TURN,
        yaw => yaw,
    }
}

/// What the position gives.
struct Values {
    /// Latitude, longitude, 10⁻⁷ degree.
    place: [i32; 2],
    /// Height above the sea, HDOP, VDOP, velocity (north, east, down), accuracies (speed, place,
    /// height).
    numbers: [f32; 9],
    /// Which of them mean nothing.
    ignored: u16,
    fix: u8,
}

impl Values {
    fn of(position: Option<&PositionEstimate>) -> Self {
        const NO_HDOP: u16 = 1 << 1;
        const NO_VDOP: u16 = 1 << 2;
        /// Horizontal, vertical, and their accuracy.
        const NO_VELOCITY: u16 = 1 << 3 | 1 << 4 | 1 << 5;
        const NOTHING: u16 = 0xff;
        const NO_FIX: u8 = 1;
        let Some(p) = position else {
            return Self { place: [0; 2], numbers: [0.0; 9], ignored: NOTHING, fix: NO_FIX };
        };
        let dilution = Dilution::of(p);
        let covariance = &p.covariance_m2;
        let [north, east, down]: [f64; 3] =
            p.velocity_mps.map(|velocity| velocity.xyz().into()).unwrap_or_default();
        let numbers = [
            p.geodetic.height_m - geoid_height_m(&p.geodetic),
            dilution.map_or(0.0, |d| d.horizontal),
            dilution.map_or(0.0, |d| d.vertical),
            north,
            east,
            down,
            SPEED_SD_MPS,
            (covariance[(0, 0)] + covariance[(1, 1)]).sqrt(),
            covariance[(2, 2)].sqrt(),
        ];
        let no_dilution = if dilution.is_none() { NO_HDOP | NO_VDOP } else { 0 };
        let no_velocity = if p.velocity_mps.is_none() { NO_VELOCITY } else { 0 };
        let angles = [p.geodetic.latitude_rad, p.geodetic.longitude_rad];
        #[allow(clippy::cast_possible_truncation)] // to the accuracy of the field
        Self {
            place: angles.map(|angle| whole::i32(angle.to_degrees() * 1e7)),
            numbers: numbers.map(|value| value as f32),
            ignored: no_dilution | no_velocity,
            fix: match p.origin {
                PositionOrigin::Alone => 3,
                PositionOrigin::StationCode => 4,
                PositionOrigin::StationPhase => 6,
            },
        }
    }
}

/// The frame of MAVLink 2; zeros at the end of a payload are left out.
fn message(id: u32, crc_extra: u8, sequence: u8, payload: &[u8]) -> Vec<u8> {
    const START: u8 = 0xfd;
    let used = payload.iter().rposition(|byte| *byte != 0).map_or(1, |last| last + 1);
    let [low, middle, high, _] = id.to_le_bytes();
    let length = u8::try_from(used).unwrap_or(u8::MAX);
    let mut bytes = vec![START, length, 0, 0, sequence, SYSTEM, COMPONENT, low, middle, high];
    bytes.extend(payload.iter().take(usize::from(length)));
    let checked = bytes[1..].iter().chain([&crc_extra]);
    bytes.extend(checked.fold(0xffff, crc).to_le_bytes());
    bytes
}

/// One byte more in a CRC-16/MCRF4XX (polynomial 1021₁₆, least significant bit first).
fn crc(so_far: u16, byte: &u8) -> u16 {
    (0..8).fold(so_far ^ u16::from(*byte), |remainder, _| {
        (remainder >> 1) ^ if remainder & 1 == 1 { 0x8408 } else { 0 }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Check value of the catalogue of parametrised CRC algorithms.
    #[test]
    fn check_value() {
        assert_eq!(b"123456789".iter().fold(0xffff, crc), 0x6f91);
    }
}
