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
    /// What kind of solution it is, by the receiver's own word.
    pub quality: Quality,
    /// Whether the height is above the geoid, whose distance from the ellipsoid is not known.
    pub is_above_geoid: bool,
}

/// Kinds of solutions, the best first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Quality {
    /// Nothing is said.
    Unknown,
    /// Carrier phase with integers.
    RtkFixed,
    /// Carrier phase with real-valued ambiguities.
    RtkFloat,
    /// Code with corrections.
    DifferentialCode,
    /// Code.
    Code,
}

impl Quality {
    /// How many times less certain than the best kind: centimetres, decimetres for a float
    /// solution, then code with and without corrections. Nothing said counts as the best: its
    /// standard deviations are the user's.
    #[must_use]
    pub const fn sd_factor(self) -> f64 {
        match self {
            Self::Unknown | Self::RtkFixed => 1.0,
            Self::RtkFloat => 20.0,
            Self::DifferentialCode => 50.0,
            Self::Code => 150.0,
        }
    }
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
