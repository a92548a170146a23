//! Systems, satellites, bands and signals, named as in RINEX 3.

use core::fmt;
use core::str::FromStr;

/// Speed of light in vacuum, m/s.
pub const SPEED_OF_LIGHT_MPS: f64 = 299_792_458.0;

/// A satellite navigation system; the order is the order of output.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum System {
    /// GPS (United States).
    Gps,
    /// Galileo (European Union).
    Galileo,
    /// BeiDou (China).
    BeiDou,
    /// GLONASS (Russia).
    Glonass,
    /// QZSS (Japan).
    Qzss,
    /// NavIC, formerly IRNSS (India).
    NavIc,
    /// Satellite-based augmentation.
    Sbas,
}

/// A satellite: system and the number that RINEX 3 prints (`G05`, `J02`, `S20`).
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Satellite {
    /// The system it belongs to.
    pub system: System,
    /// Two-digit RINEX 3 number (QZSS: PRN − 192; SBAS: PRN − 100; GLONASS: orbital slot).
    pub number: u8,
}

/// A frequency band of one system: system letter and RINEX band digit (`G1`, `E5`, `C2`).
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Band {
    /// The system.
    pub system: System,
    /// RINEX 3 band digit, 1 to 9.
    pub digit: u8,
}

/// A signal: band and tracking code (`G1C`, `E5Q`).
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Signal {
    /// The band.
    pub band: Band,
    /// RINEX 3 tracking attribute, an ASCII capital letter (`b'C'`, `b'W'`, …).
    pub attribute: u8,
}

/// The text is not the name of a system, satellite, band or signal.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{found:?} is not {expected}")]
pub struct UnknownName {
    found: String,
    expected: &'static str,
}

#[cfg(feature = "serde")]
mod names {
    use super::{Band, Satellite, Signal, System};

    /// Serialises a type as its name.
    macro_rules! as_its_name {
        ($($type:ty),*) => {$(
            impl serde::Serialize for $type {
                fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
                    serializer.collect_str(self)
                }
            }
        )*};
    }
    as_its_name!(System, Satellite, Band, Signal);
}

impl System {
    /// Every system, in the order of output.
    pub const ALL: [Self; 7] = [
        Self::Gps,
        Self::Galileo,
        Self::BeiDou,
        Self::Glonass,
        Self::Qzss,
        Self::NavIc,
        Self::Sbas,
    ];

    /// The letter of RINEX 3.
    #[must_use]
    pub const fn letter(self) -> char {
        match self {
            Self::Gps => 'G',
            Self::Galileo => 'E',
            Self::BeiDou => 'C',
            Self::Glonass => 'R',
            Self::Qzss => 'J',
            Self::NavIc => 'I',
            Self::Sbas => 'S',
        }
    }

    /// The system with this RINEX 3 letter.
    #[must_use]
    pub const fn from_letter(letter: u8) -> Option<Self> {
        Some(match letter {
            b'G' => Self::Gps,
            b'E' => Self::Galileo,
            b'C' => Self::BeiDou,
            b'R' => Self::Glonass,
            b'J' => Self::Qzss,
            b'I' => Self::NavIc,
            b'S' => Self::Sbas,
            _ => return None,
        })
    }
}

impl Satellite {
    /// Satellite `number` of `system`.
    #[must_use]
    pub const fn new(system: System, number: u8) -> Self {
        Self { system, number }
    }

    /// Its place in the order of satellites.
    pub(crate) const fn ordinal(self) -> u16 {
        (self.system as u16) << 8 | self.number as u16
    }

    /// Whether this is a BeiDou satellite in geostationary orbit: BDS-2 C01 to C05 and BDS-3 C59 to
    /// C63, whose broadcast orbits are given in a frame of their own (BDS-SIS-ICD-B1I-3.0, table 5-11).
    #[must_use]
    pub const fn is_beidou_geo(self) -> bool {
        matches!(self.system, System::BeiDou) && (self.number <= 5 || self.number >= 59)
    }
}

/// A set of satellites.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct SatelliteSet([[u128; 2]; System::ALL.len()]);

impl SatelliteSet {
    /// Adds a satellite; whether it was not there.
    pub fn insert(&mut self, satellite: Satellite) -> bool {
        let numbers = &mut self.0[satellite.system as usize][usize::from(satellite.number >> 7)];
        let bit = 1 << (satellite.number & 127);
        let is_new = *numbers & bit == 0;
        *numbers |= bit;
        is_new
    }

    /// How many there are.
    #[must_use]
    pub fn len(&self) -> usize {
        self.0.iter().flatten().map(|numbers| numbers.count_ones() as usize).sum()
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }
}

impl FromIterator<Satellite> for SatelliteSet {
    fn from_iter<I: IntoIterator<Item = Satellite>>(satellites: I) -> Self {
        let mut set = Self::default();
        for satellite in satellites {
            set.insert(satellite);
        }
        set
    }
}

impl Band {
    /// Its place in the order of bands.
    pub(crate) const fn ordinal(self) -> u16 {
        (self.system as u16) << 8 | self.digit as u16
    }

    /// Band `digit` of `system`.
    #[must_use]
    pub const fn new(system: System, digit: u8) -> Self {
        Self { system, digit }
    }

    /// Carrier frequency in Hz; for the two FDMA bands of GLONASS it depends on the satellite's
    /// frequency channel (−7 to +6). `None` for a band that the system does not have, or for a
    /// GLONASS FDMA band without a known channel.
    ///
    /// Source: RINEX 4.02, tables 4 to 10.
    #[must_use]
    pub fn frequency_hz(self, glonass_channel: Option<i8>) -> Option<f64> {
        use System::{BeiDou, Galileo, Glonass, Gps, NavIc, Qzss, Sbas};
        let mhz = match (self.system, self.digit) {
            (Gps | Qzss | Galileo | Sbas | BeiDou | NavIc, 1) => 1575.42,
            (Gps | Qzss, 2) => 1227.60,
            (Gps | Qzss | Galileo | Sbas | BeiDou | NavIc, 5) => 1176.45,
            (Galileo | Qzss, 6) => 1278.75,
            (Galileo | BeiDou, 7) => 1207.14,
            (Galileo | BeiDou, 8) => 1191.795,
            (BeiDou, 2) => 1561.098,
            (BeiDou, 6) => 1268.52,
            (NavIc, 9) => 2492.028,
            (Glonass, 1) => 1602.0 + 0.5625 * f64::from(glonass_channel?),
            (Glonass, 2) => 1246.0 + 0.4375 * f64::from(glonass_channel?),
            (Glonass, 3) => 1202.025,
            (Glonass, 4) => 1600.995,
            (Glonass, 6) => 1248.06,
            _ => return None,
        };
        Some(mhz * 1e6)
    }

    /// Carrier wavelength in metres, λ = c / f; `None` as for [`Band::frequency_hz`].
    #[must_use]
    pub fn wavelength_m(self, glonass_channel: Option<i8>) -> Option<f64> {
        Some(SPEED_OF_LIGHT_MPS / self.frequency_hz(glonass_channel)?)
    }
}

impl Signal {
    /// Signal of `system` on band `digit` with tracking `attribute`.
    #[must_use]
    pub const fn new(system: System, digit: u8, attribute: u8) -> Self {
        Self { band: Band::new(system, digit), attribute }
    }
}

impl fmt::Display for System {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Gps => "GPS",
            Self::Galileo => "Galileo",
            Self::BeiDou => "BeiDou",
            Self::Glonass => "GLONASS",
            Self::Qzss => "QZSS",
            Self::NavIc => "NavIC",
            Self::Sbas => "SBAS",
        })
    }
}

impl fmt::Display for Satellite {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}{:02}", self.system.letter(), self.number)
    }
}

impl fmt::Display for Band {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}{}", self.system.letter(), self.digit)
    }
}

impl fmt::Display for Signal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}{}", self.band, char::from(self.attribute))
    }
}

impl FromStr for Satellite {
    type Err = UnknownName;
    fn from_str(text: &str) -> Result<Self, UnknownName> {
        let parsed = match text.as_bytes() {
            [letter, unit @ b'0'..=b'9'] => Some((letter, unit - b'0')),
            [letter, ten @ b'0'..=b'9', unit @ b'0'..=b'9'] => {
                Some((letter, 10 * (ten - b'0') + unit - b'0'))
            }
            _ => None,
        }
        .and_then(|(letter, number)| Some((System::from_letter(*letter)?, number)));
        let (system, number) = parsed.ok_or_else(|| UnknownName {
            found: text.to_owned(),
            expected: "a satellite such as G05 or E11",
        })?;
        Ok(Self { system, number })
    }
}

impl FromStr for Band {
    type Err = UnknownName;
    fn from_str(text: &str) -> Result<Self, UnknownName> {
        let band = match text.as_bytes() {
            [letter, digit @ b'1'..=b'9'] => {
                System::from_letter(*letter).map(|system| Self::new(system, digit - b'0'))
            }
            _ => None,
        };
        band.filter(|band| band.frequency_hz(Some(0)).is_some()).ok_or_else(|| UnknownName {
            found: text.to_owned(),
            expected: "a band such as G1, E5 or C2 (system letter and RINEX band digit)",
        })
    }
}

impl FromStr for Signal {
    type Err = UnknownName;
    fn from_str(text: &str) -> Result<Self, UnknownName> {
        let parsed = match text.as_bytes() {
            [_, _, attribute @ b'A'..=b'Z'] => {
                text[..2].parse().ok().map(|band| Self { band, attribute: *attribute })
            }
            _ => None,
        };
        parsed.ok_or_else(|| UnknownName {
            found: text.to_owned(),
            expected: "a signal such as G1C or E5Q (system letter, RINEX band digit, tracking code)",
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_set_holds_each_satellite_once() {
        let mut set = SatelliteSet::default();
        assert!(set.is_empty());
        for (system, number) in [(System::Gps, 1), (System::Sbas, 127), (System::Sbas, 255)] {
            assert!(set.insert(Satellite::new(system, number)));
            assert!(!set.insert(Satellite::new(system, number)));
        }
        assert_eq!(set.len(), 3);
        let all: SatelliteSet =
            (0..=255).map(|number| Satellite::new(System::Gps, number)).collect();
        assert_eq!(all.len(), 256);
    }

    #[test]
    fn names_round_trip() {
        for text in ["G05", "E11", "C60", "R24", "J02", "S20", "I07"] {
            assert_eq!(text.parse::<Satellite>().unwrap().to_string(), text);
        }
        for text in ["G1", "E5", "C2", "R1", "J6"] {
            assert_eq!(text.parse::<Band>().unwrap().to_string(), text);
        }
        for text in ["G1C", "E5Q", "C2I", "R1C"] {
            assert_eq!(text.parse::<Signal>().unwrap().to_string(), text);
        }
        for wrong in ["", "G1", "G1c", "G3C", "G1CC", "1C"] {
            assert!(wrong.parse::<Signal>().is_err(), "{wrong}");
        }
        for wrong in ["", "G", "X05", "G5x", "Gé", "G123", "G+5", "\u{feff}", "\u{fffd}"] {
            assert!(wrong.parse::<Satellite>().is_err(), "{wrong}");
        }
        for wrong in ["", "G", "G3", "G0", "L1", "G11"] {
            assert!(wrong.parse::<Band>().is_err(), "{wrong}");
        }
    }

    #[test]
    fn l1_wavelength() {
        let l1 = Band::new(System::Gps, 1).wavelength_m(None).unwrap();
        assert!((l1 - 0.190_293_672_798).abs() < 1e-12);
        assert_eq!(Band::new(System::Glonass, 1).wavelength_m(None), None);
    }
}
