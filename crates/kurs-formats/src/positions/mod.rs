//! Coordinates that receivers give themselves: tables ([`csv`]) and NMEA logs ([`nmea`]).

pub mod csv;
pub mod nmea;

use kurs::frames::{Ecef, Vector};
use kurs::time::GpsTime;

/// Receivers do not stand further from the Earth's centre than this, nor nearer than a tenth of it.
const FARTHEST_M: f64 = 5e7;

/// Where one antenna was at one time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PositionFix {
    /// When.
    pub time: GpsTime,
    /// Which antenna: its place in the list of names that was given to the reader.
    pub antenna: usize,
    /// Where.
    pub position_m: Vector<Ecef>,
    /// Standard deviations north, east, down, m, if the receiver states them.
    pub sd_ned_m: Option<[f64; 3]>,
    /// How many times less certain than the best kind of solution, by the receiver's word for its
    /// kind: 1 where it has none.
    pub sd_factor: f64,
}

/// The place, if a receiver can be there.
fn checked_place(position_m: Vector<Ecef>) -> Result<Vector<Ecef>, String> {
    let distance_m = position_m.norm();
    if (0.1 * FARTHEST_M..FARTHEST_M).contains(&distance_m) {
        Ok(position_m)
    } else {
        Err(format!("{distance_m:.0} m from the Earth's centre"))
    }
}
