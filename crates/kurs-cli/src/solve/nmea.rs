//! NMEA 0183 sentences of a solution: HDT, THS, PASHR and GGA.

use std::fmt::Write as _;
use std::io::Write as _;
use std::path::Path;

use kurs::solution::{EpochSolution, Status};
use kurs::time::Calendar;

use crate::output::OutputFile;

/// A log of sentences, one group an epoch.
#[derive(Debug)]
pub(crate) struct NmeaLog {
    file: OutputFile,
}

impl NmeaLog {
    /// Starts `directory/attitude.nmea`.
    pub(crate) fn create(directory: &Path) -> anyhow::Result<Self> {
        Ok(Self { file: OutputFile::create(directory, "attitude.nmea")? })
    }

    /// Writes the sentences of one epoch.
    pub(crate) fn write(&mut self, row: &EpochSolution) -> anyhow::Result<()> {
        Ok(self.file.write_all(sentences(row).as_bytes())?)
    }

    /// Gives the file its name.
    pub(crate) fn finish(self) -> anyhow::Result<()> {
        self.file.finish()
    }
}

/// All sentences of an epoch; an angle that is not known or not fixed leaves its field empty.
pub(crate) fn sentences(row: &EpochSolution) -> String {
    let utc = row.time_utc.unwrap_or_else(|| row.time.utc());
    let fixed = row.attitude.filter(|_| row.status == Status::Fixed);
    let degrees = |angle: Option<f64>| angle.map(f64::to_degrees);
    let heading = degrees(fixed.and_then(|a| a.heading_rad));
    let mut text = String::new();

    push(&mut text, &format!("GPHDT,{},T", number(heading, 3)));
    // Mode A: autonomous; V: not valid
    push(
        &mut text,
        &format!("GPTHS,{},{}", number(heading, 3), if heading.is_some() { 'A' } else { 'V' }),
    );
    let sd = |i: usize| fixed.map(|a| a.covariance_rad2[(i, i)].sqrt().to_degrees());
    let known = |angle: Option<f64>, sd: Option<f64>| angle.and(sd);
    let pitch = degrees(fixed.and_then(|a| a.pitch_rad));
    let roll = degrees(fixed.and_then(|a| a.roll_rad));
    push(
        &mut text,
        &format!(
            "PASHR,{},{},T,{},{},,{},{},{},{},0",
            clock(&utc),
            number(heading, 2),
            signed(roll),
            signed(pitch),
            number(known(roll, sd(2)), 3),
            number(known(pitch, sd(1)), 3),
            number(known(heading, sd(0)), 3),
            u8::from(row.position.is_some()),
        ),
    );
    push(&mut text, &gga(row, &utc));
    text
}

/// Position: WGS 84 ellipsoidal height, geoid separation empty.
fn gga(row: &EpochSolution, utc: &Calendar) -> String {
    let Some(position) = &row.position else {
        return format!("GPGGA,{},,,,,0,,,,M,,M,,", clock(utc));
    };
    let geodetic = &position.geodetic;
    format!(
        "GPGGA,{},{},{},{},{},1,{:02},,{:.3},M,,M,,",
        clock(utc),
        degrees_minutes(geodetic.latitude_rad, 2),
        if geodetic.latitude_rad < 0.0 { 'S' } else { 'N' },
        degrees_minutes(geodetic.longitude_rad, 3),
        if geodetic.longitude_rad < 0.0 { 'W' } else { 'E' },
        row.satellites.min(99),
        geodetic.height_m,
    )
}

/// `hhmmss.ss`
fn clock(utc: &Calendar) -> String {
    // Cut, not rounded: 59.999 must not become 60.
    let hundredths = (utc.second * 100.0 + 1e-6).floor() / 100.0;
    format!("{:02}{:02}{hundredths:05.2}", utc.hour, utc.minute)
}

/// `ddmm.mmmmmmm` with the sign left out.
fn degrees_minutes(angle_rad: f64, width: usize) -> String {
    const SCALE: f64 = 1e7;
    let minutes = (angle_rad.abs().to_degrees() * 60.0 * SCALE).round() / SCALE;
    let degrees = (minutes / 60.0).floor();
    format!("{degrees:0width$}{:010.7}", minutes - 60.0 * degrees)
}

fn number(value: Option<f64>, decimals: usize) -> String {
    value.map_or_else(String::new, |v| format!("{v:.decimals$}"))
}

fn signed(value: Option<f64>) -> String {
    value.map_or_else(String::new, |v| format!("{v:+.2}"))
}

/// Appends `$body*checksum`: the exclusive or of all characters between `$` and `*`.
fn push(text: &mut String, body: &str) {
    let checksum = body.bytes().fold(0, |sum, byte| sum ^ byte);
    let _ = write!(text, "${body}*{checksum:02X}\r\n");
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The example sentence of NMEA 0183: `$GPGLL,…*31`-style checksums by hand.
    #[test]
    fn checksum_is_the_exclusive_or() {
        let mut text = String::new();
        push(&mut text, "GPHDT,274.07,T");
        assert_eq!(text, "$GPHDT,274.07,T*03\r\n");
    }

    #[test]
    fn minutes_carry_into_degrees() {
        assert_eq!(degrees_minutes(48f64.to_radians(), 2), "4800.0000000");
        assert_eq!(degrees_minutes(-0.5f64.to_radians(), 3), "00030.0000000");
        let almost = (12.0 - 1e-12f64).to_radians();
        assert_eq!(degrees_minutes(almost, 3), "01200.0000000");
    }

    #[test]
    fn clock_never_shows_sixty() {
        let late = Calendar { year: 2024, month: 1, day: 1, hour: 23, minute: 59, second: 59.999 };
        assert_eq!(clock(&late), "235959.99");
    }
}
