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
    /// What one of the last written digit is worth north, east, down, m: rounding to it has the standard
    /// deviation of a twelfth's root.
    pub last_digit_ned_m: [f64; 3],
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

/// A degree of a great circle, m.
const DEGREE_M: f64 = 6_371_000.0 * std::f64::consts::PI / 180.0;

/// What one of the last digit of a number is worth: 0.001 of `-1.250`, 100 of `12e2`.
fn last_digit(word: &str) -> f64 {
    let (digits, exponent) = word.split_once(['e', 'E']).unwrap_or((word, "0"));
    let decimals = digits.split_once('.').map_or(0, |(_, decimals)| decimals.len());
    let exponent: f64 = exponent.parse().unwrap_or(0.0);
    10f64.powf(exponent - decimals as f64)
}

/// What last digits of angles and height are worth north, east, down, m.
fn last_digit_ned_m(latitude_rad: f64, angle_deg: f64, height_m: f64) -> [f64; 3] {
    [angle_deg * DEGREE_M, angle_deg * DEGREE_M * latitude_rad.cos(), height_m]
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn last_digits() {
        for (word, expected) in
            [("-1.250", 0.001), ("55.", 1.0), ("6378137", 1.0), ("12e2", 100.0), ("1.5E-3", 1e-4)]
        {
            assert!((last_digit(word) / expected - 1.0).abs() < 1e-12, "{word}");
        }
        let [north, east, down] = last_digit_ned_m(60f64.to_radians(), 1e-6, 0.1);
        assert!((north - 0.1112).abs() < 1e-4 && (east - 0.0556).abs() < 1e-4 && down == 0.1);
    }
}
