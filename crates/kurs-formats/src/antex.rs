//! ANTEX, phase centres of receiver antennas; those of satellites are read past.
//!
//! Source: M. Rothacher, R. Schmid, "ANTEX: The Antenna Exchange Format 1.4", 2010. Offsets and
//! variations are in millimetres, angles in degrees.

use kurs::antenna_calibration::{
    AntennaCalibration, AntennaCalibrations, Axis, BadCalibration, PhaseCenter,
};
use kurs::signal::{Band, System};

use crate::content::Content;
use crate::damage::DamageLog;
use crate::rinex::fields::{columns, decimal, label, text};
use crate::source::{ReadError, Source};

/// Numbers of a pattern line that are admitted; what goes beyond makes the band unusable.
const LINE_VALUES_MAX: usize = 1000;
/// Pattern values of a band that are admitted, likewise.
const TABLE_VALUES_MAX: usize = 1_000_000;

/// Reads an ANTEX file; a damaged band is noted and left out, the others are kept. Of several
/// entries of one type that without a serial number counts (the mean of the type), else the first.
///
/// # Errors
///
/// [`ReadError`] if reading fails or the content is something else.
pub fn read(source: &mut Source) -> Result<(AntennaCalibrations, DamageLog), ReadError> {
    match Content::of(source.start(Content::ENOUGH)?) {
        Content::Antex => {}
        other => return Err(source.wrong_content(other.to_string(), "an ANTEX antenna file")),
    }
    let mut antennas = AntennaCalibrations::default();
    let mut damage = DamageLog::default();
    let mut antenna = Antenna::default();
    while source.advance()? {
        let (line, number) = (source.line(), source.line_number());
        match label(line).get(..20).unwrap_or(label(line)) {
            b"START OF ANTENNA" => antenna = Antenna::default(),
            b"TYPE / SERIAL NO" => {
                antenna.name = text(line, 0..20);
                antenna.is_individual = !columns(line, 20..40).trim_ascii().is_empty();
                antenna.is_of_satellite = !columns(line, 40..50).trim_ascii().is_empty();
            }
            b"DAZI" => antenna.azimuth_step_deg = decimal(columns(line, 2..8)),
            b"ZEN1 / ZEN2 / DZEN" => antenna.zenith = zenith(line),
            b"START OF FREQUENCY" => antenna.band = Some(Pattern::of(band(line))),
            b"START OF FREQ RMS" | b"END OF FREQ RMS" => antenna.band = None,
            b"END OF FREQUENCY" => {
                if let Err(what) = antenna.finish_band() {
                    damage.note(number, format!("{}: {what}; the band is left out", antenna.name));
                }
            }
            b"END OF ANTENNA" => {
                let antenna = core::mem::take(&mut antenna);
                let is_known = antenna.is_individual && antennas.contains(&antenna.name);
                if !antenna.is_of_satellite && !antenna.name.is_empty() && !is_known {
                    antennas.insert(&antenna.name, antenna.calibration);
                }
            }
            b"NORTH / EAST / UP" => {
                if let Some(pattern) = &mut antenna.band {
                    pattern.offset_m = offset_m(line);
                }
            }
            _ => {
                if let Some(pattern) = &mut antenna.band {
                    pattern.take(line);
                }
            }
        }
    }
    Ok((antennas, damage))
}

/// An antenna under construction.
#[derive(Debug, Default)]
struct Antenna {
    name: String,
    is_of_satellite: bool,
    /// Measured of one antenna, not the mean of its type.
    is_individual: bool,
    azimuth_step_deg: Option<f64>,
    zenith: Option<Axis>,
    band: Option<Pattern>,
    calibration: AntennaCalibration,
}

/// A band under construction.
#[derive(Debug, Default)]
struct Pattern {
    band: Option<Band>,
    offset_m: Option<[f64; 3]>,
    mean_m: Vec<f64>,
    table_m: Vec<f64>,
    /// The first field that is not a number.
    damage: Option<String>,
}

/// Why a band is left out.
#[derive(Debug, thiserror::Error)]
enum BadBand {
    #[error("no offset, zenith angles or azimuth step")]
    Incomplete,
    #[error("{0:?} is not a number")]
    NotANumber(String),
    #[error(transparent)]
    Calibration(#[from] BadCalibration),
}

impl Antenna {
    /// Takes the band that ends here; a band of a system that Kurs does not know is left out.
    fn finish_band(&mut self) -> Result<(), BadBand> {
        let Some(pattern) = self.band.take() else { return Ok(()) };
        let Some(band) = pattern.band.filter(|_| !self.is_of_satellite) else { return Ok(()) };
        if let Some(found) = pattern.damage {
            return Err(BadBand::NotANumber(found));
        }
        let (Some(offset_m), Some(zenith), Some(step_deg)) =
            (pattern.offset_m, self.zenith, self.azimuth_step_deg)
        else {
            return Err(BadBand::Incomplete);
        };
        // DAZI = 0: the pattern does not depend on the azimuth.
        let turn = Axis { first_deg: 0.0, last_deg: 360.0, step_deg };
        let table = (step_deg != 0.0).then_some((turn, pattern.table_m));
        let center = PhaseCenter::new(offset_m, zenith, pattern.mean_m, table)?;
        self.calibration.insert(band, center);
        Ok(())
    }
}

impl Pattern {
    fn of(band: Option<Band>) -> Self {
        Self { band, ..Self::default() }
    }

    /// A line of the pattern: `NOAZI` or an azimuth, then a number a zenith angle.
    fn take(&mut self, line: &[u8]) {
        let values = match columns(line, 0..8).trim_ascii() {
            b"NOAZI" => &mut self.mean_m,
            _ => &mut self.table_m,
        };
        let fields = columns(line, 8..line.len()).trim_ascii_end().chunks(8);
        for field in fields.take(LINE_VALUES_MAX) {
            match decimal(field) {
                Some(millimetres) if values.len() < TABLE_VALUES_MAX => {
                    values.push(millimetres * 1e-3);
                }
                _ => {
                    self.damage.get_or_insert(String::from_utf8_lossy(field).trim().to_owned());
                }
            }
        }
    }
}

fn zenith(line: &[u8]) -> Option<Axis> {
    Some(Axis {
        first_deg: decimal(columns(line, 2..8))?,
        last_deg: decimal(columns(line, 8..14))?,
        step_deg: decimal(columns(line, 14..20))?,
    })
}

fn offset_m(line: &[u8]) -> Option<[f64; 3]> {
    let number = |start| Some(decimal(columns(line, start..start + 10))? * 1e-3);
    Some([number(0)?, number(10)?, number(20)?])
}

/// `G01`: system letter and the band digit of RINEX 3.
fn band(line: &[u8]) -> Option<Band> {
    let [letter, b'0', digit @ b'1'..=b'9'] = columns(line, 3..6) else { return None };
    Some(Band::new(System::from_letter(*letter)?, digit - b'0'))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An antenna of two bands with made-up numbers, and one of a satellite.
    fn file() -> String {
        let line = |content: &str, label: &str| format!("{content:<60}{label:<20}\n");
        [
            line("     1.4            M", "ANTEX VERSION / SYST"),
            line("A", "PCV TYPE / REFANT"),
            line("", "END OF HEADER"),
            line("", "START OF ANTENNA"),
            line("BLOCK IIA           G01                 G032      1992-079A", "TYPE / SERIAL NO"),
            line("     0.0", "DAZI"),
            line("     0.0  14.0   1.0", "ZEN1 / ZEN2 / DZEN"),
            line("   G01", "START OF FREQUENCY"),
            line("    279.00      0.00   2201.00", "NORTH / EAST / UP"),
            line("   G01", "END OF FREQUENCY"),
            line("", "END OF ANTENNA"),
            line("", "START OF ANTENNA"),
            line("TESTANT_A       NONE", "TYPE / SERIAL NO"),
            line("   180.0", "DAZI"),
            line("     0.0  90.0  45.0", "ZEN1 / ZEN2 / DZEN"),
            line("     2", "# OF FREQUENCIES"),
            line("   G01", "START OF FREQUENCY"),
            line("      1.00     -2.00     60.00", "NORTH / EAST / UP"),
            "   NOAZI    0.00   -1.00    3.00\n".into(),
            "     0.0    0.00   -1.50    2.00\n".into(),
            "   180.0    0.00   -0.50    4.00\n".into(),
            "   360.0    0.00   -1.50    2.00\n".into(),
            line("   G01", "END OF FREQUENCY"),
            line("   E05", "START OF FREQUENCY"),
            line("      0.00      0.00     55.00", "NORTH / EAST / UP"),
            "   NOAZI    0.00    0.00    0.00\n".into(),
            "     0.0    0.00    0.00    0.00\n".into(),
            "   180.0    0.00    0.00    0.00\n".into(),
            "   360.0    0.00    0.00    0.00\n".into(),
            line("   E05", "END OF FREQUENCY"),
            line("   G01", "START OF FREQ RMS"),
            line("      9.00      9.00      9.00", "NORTH / EAST / UP"),
            "   NOAZI    9.00    9.00    9.00\n".into(),
            line("   G01", "END OF FREQ RMS"),
            line("", "END OF ANTENNA"),
        ]
        .concat()
    }

    fn read_text(text: &str) -> (AntennaCalibrations, DamageLog) {
        let bytes = std::io::Cursor::new(text.as_bytes().to_vec());
        read(&mut Source::new(bytes, "test.atx").unwrap()).unwrap()
    }

    #[test]
    fn receiver_antennas_are_read() {
        let (antennas, damage) = read_text(&file());
        assert_eq!((antennas.len(), damage.total()), (1, 0), "{damage:?}");
        let antenna = antennas.find("TESTANT_A NONE").unwrap();
        let [g1, e5] = [Band::new(System::Gps, 1), Band::new(System::Galileo, 5)];
        assert_eq!(antenna.bands().collect::<Vec<_>>(), [g1, e5]);
        assert_eq!(antenna.phase_center(g1).unwrap().offset_m(), [0.001, -0.002, 0.060]);
        // West at 45°: the offset by hand, the variation half-way between −0.5 and −1.5 mm.
        let (azimuth, elevation) = (270f64.to_radians(), 45f64.to_radians());
        let expected = -(0.002 * elevation.cos() + 0.060 * elevation.sin()) - 0.001;
        let found = antenna.correction_m(g1, azimuth, elevation).unwrap();
        assert!((found - expected).abs() < 1e-15, "{found}");
    }

    #[test]
    fn the_mean_of_a_type_counts_before_single_antennas() {
        let mean = file();
        let antenna = &mean[mean.rfind("START OF ANTENNA").unwrap() - 60..];
        let single = |serial: &str, up: &str| {
            let named = antenna
                .replace("TESTANT_A       NONE    ", &format!("TESTANT_A       NONE{serial}"));
            named.replacen("     60.00", up, 1)
        };
        let [first, second] = [single("0001", "     70.00"), single("0002", "     80.00")];
        let header = mean[..mean.find("START OF ANTENNA").unwrap() - 60].to_owned();
        for (antennas, up_m) in [
            ([antenna, &first, &second], 0.060),
            ([&first, antenna, &second], 0.060),
            ([&first, &second, &second], 0.070),
        ] {
            let (antennas, damage) = read_text(&(header.clone() + &antennas.concat()));
            assert_eq!((antennas.len(), damage.total()), (1, 0));
            let found = antennas.find("TESTANT_A").unwrap();
            let center = found.phase_center(Band::new(System::Gps, 1)).unwrap();
            assert_eq!(center.offset_m()[2], up_m);
        }
    }

    #[test]
    fn a_damaged_band_loses_itself_only() {
        for (found, broken) in [
            ("-0.50", "-0.x0"),
            ("     60.00", "     six00"),
            ("   180.0    0.00   -0.50    4.00\n", ""),
        ] {
            let (antennas, damage) = read_text(&file().replacen(found, broken, 1));
            let antenna = antennas.find("TESTANT_A").unwrap();
            assert_eq!(antenna.bands().count(), 1, "{broken}");
            assert_eq!(damage.total(), 1, "{damage:?}");
        }
    }

    #[test]
    fn another_file_is_named() {
        let mut source = Source::new(&b"hello world"[..], "x.atx").unwrap();
        assert!(read(&mut source).unwrap_err().to_string().contains("ANTEX"));
    }
}
