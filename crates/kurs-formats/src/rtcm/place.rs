//! Messages 1005 and 1006: where the reference point of a station's antenna is.
//!
//! Source: RTCM 10403.3, tables 3.5-6 and 3.5-7.

use kurs::frames::{Ecef, Vector};

use crate::fields::{BitReader, BitWriter, Fields};

pub(super) const WITHOUT_HEIGHT: u16 = 1005;
pub(super) const WITH_HEIGHT: u16 = 1006;
/// Unit of the coordinates, m.
const UNIT_M: f64 = 1e-4;

/// The station and its place; `None` if this is another message or too short.
pub(crate) fn read(message: &[u8]) -> Option<(u16, Vector<Ecef>)> {
    if !matches!(super::number(message), WITHOUT_HEIGHT | WITH_HEIGHT) {
        return None;
    }
    let (mut station, mut place) = (0, [0.0; 3]);
    let mut reader = BitReader::new(message);
    reader.take(12);
    describe(&mut reader, &mut station, &mut place);
    let station = u16::try_from(station).ok().filter(|_| reader.is_whole())?;
    Some((station, Vector::new(place[0], place[1], place[2])))
}

/// Message 1006 with no height above the reference point; `None` if the place does not fit.
pub(super) fn write(station: u16, place: Vector<Ecef>) -> Option<Vec<u8>> {
    let mut writer = BitWriter::default();
    writer.constant(12, u64::from(WITH_HEIGHT));
    describe(&mut writer, &mut u64::from(station), &mut place.xyz().into());
    writer.constant(16, 0);
    writer.finish()
}

/// Everything but the number and the height.
fn describe(f: &mut impl Fields, station: &mut u64, [x, y, z]: &mut [f64; 3]) {
    f.unsigned(12, station);
    f.constant(6, 0); // year of the reference frame
    f.constant(4, 0b1110); // GPS, GLONASS, Galileo; a real station
    f.scaled(38, UNIT_M, x);
    f.constant(2, 0b10); // one oscillator; reserved
    f.scaled(38, UNIT_M, y);
    f.constant(2, 0); // quarter cycles: not stated
    f.scaled(38, UNIT_M, z);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_round_trip() {
        let place = Vector::new(-2_700_000.123_4, 4_300_000.567_8, -6_000_000.000_1);
        let message = write(4095, place).unwrap();
        assert_eq!(message.len(), 21);
        let (station, read_back) = read(&message).unwrap();
        assert_eq!(station, 4095);
        assert!((read_back - place).norm() < 1e-4);
        assert_eq!(read(&message[..18]), None);
    }
}
