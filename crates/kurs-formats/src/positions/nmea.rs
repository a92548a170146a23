//! NMEA 0183 logs of one receiver: GGA for the place, RMC or ZDA for the date, GST for the standard
//! deviations.
//!
//! A sentence counts only with its checksum. GGA gives a time of day; its date comes from an RMC or
//! ZDA of the same second or, failing that, from the last one, counted on over midnight. What comes
//! before the first date is dated backwards from it.

use kurs::frames::{Geodetic, Vector};
use kurs::time::{Calendar, GpsTime};

use super::PositionFix;
use crate::damage::DamageLog;
use crate::source::{ReadError, Source};

const DAY_S: f64 = 86_400.0;
/// A step of the time of day by more than this goes over midnight.
const HALF_DAY_S: f64 = 43_200.0;

/// Reads a log of the antenna with this number.
///
/// # Errors
///
/// [`ReadError`] if the file cannot be read.
pub fn read(
    source: &mut Source,
    antenna: usize,
    damage: &mut DamageLog,
    mut take: impl FnMut(PositionFix),
) -> Result<(), ReadError> {
    let mut log = Log { antenna, ..Log::default() };
    while source.advance()? {
        let number = source.line_number();
        let line = source.line().trim_ascii();
        if line.is_empty() {
            continue;
        }
        match sentence(line) {
            Ok(fields) => {
                if let Err(what) = log.push(&fields, &mut take) {
                    damage.note(number, what);
                }
            }
            Err(what) => damage.note(number, what),
        }
    }
    log.finish(&mut take);
    if log.last_date.is_none() && !log.undated.is_empty() {
        damage.note(
            source.line_number(),
            "no RMC or ZDA sentence: the date of the positions is not known",
        );
    }
    Ok(())
}

/// Fields of a sentence whose checksum is right, without `$` and checksum.
fn sentence(line: &[u8]) -> Result<Vec<&str>, String> {
    let line = core::str::from_utf8(line).map_err(|_| "not text".to_owned())?;
    let body = line.strip_prefix(['$', '!']).ok_or("no sentence: it starts without $")?;
    let (body, checksum) = body.rsplit_once('*').ok_or("a sentence without checksum")?;
    let stated = u8::from_str_radix(checksum.trim(), 16)
        .map_err(|_| format!("checksum `{checksum}` is no number"))?;
    let found = body.bytes().fold(0, |sum, byte| sum ^ byte);
    if found != stated {
        return Err(format!("checksum {stated:02X}, but the text gives {found:02X}"));
    }
    Ok(body.split(',').collect())
}

/// A GGA that waits for its date and its standard deviations.
#[derive(Debug, Clone, Copy)]
struct Pending {
    day_s: f64,
    position_m: Vector<kurs::frames::Ecef>,
    sd_ned_m: Option<[f64; 3]>,
}

/// State between sentences.
#[derive(Debug, Default)]
struct Log {
    antenna: usize,
    pending: Option<Pending>,
    /// UTC midnight of the last known date as year, month, day, and the time of day it stood with.
    last_date: Option<((i32, u8, u8), f64)>,
    undated: Vec<Pending>,
}

impl Log {
    fn push(&mut self, fields: &[&str], take: &mut impl FnMut(PositionFix)) -> Result<(), String> {
        let kind = fields[0].get(2..).unwrap_or_default();
        match kind {
            "GGA" => {
                self.release(take);
                self.pending = gga(fields)?;
            }
            "RMC" => {
                let (day_s, date) = (time_of_day(field(fields, 1))?, field(fields, 9));
                if !date.is_empty() {
                    self.date(day_s, date_of_digits(date)?, take);
                }
            }
            "ZDA" => {
                let day_s = time_of_day(field(fields, 1))?;
                if !field(fields, 4).is_empty() {
                    let date = (
                        integer(field(fields, 4))?,
                        integer(field(fields, 3))?,
                        integer(field(fields, 2))?,
                    );
                    self.date(day_s, date, take);
                }
            }
            "GST" => {
                let day_s = time_of_day(field(fields, 1))?;
                if let Some(pending) = self.pending.as_mut().filter(|p| p.day_s == day_s) {
                    pending.sd_ned_m = gst(fields)?;
                }
            }
            _ => {}
        }
        Ok(())
    }

    /// A date became known.
    fn date(&mut self, day_s: f64, date: (i32, u8, u8), take: &mut impl FnMut(PositionFix)) {
        if self.last_date.is_none() {
            for earlier in core::mem::take(&mut self.undated) {
                self.emit(&earlier, day_s, date, take);
            }
        }
        self.last_date = Some((date, day_s));
    }

    /// The waiting GGA has all it will get.
    fn release(&mut self, take: &mut impl FnMut(PositionFix)) {
        let Some(pending) = self.pending.take() else { return };
        match self.last_date {
            Some((date, day_s)) => self.emit(&pending, day_s, date, take),
            None => self.undated.push(pending),
        }
    }

    fn finish(&mut self, take: &mut impl FnMut(PositionFix)) {
        self.release(take);
    }

    /// Gives the fix, dated by a date that stood with the time of day `day_s`.
    fn emit(
        &self,
        pending: &Pending,
        day_s: f64,
        (year, month, day): (i32, u8, u8),
        take: &mut impl FnMut(PositionFix),
    ) {
        let midnight = Calendar { year, month, day, hour: 0, minute: 0, second: 0.0 };
        let Some(midnight) = GpsTime::from_utc(midnight) else { return };
        let step_s = pending.day_s - day_s;
        let days = if step_s < -HALF_DAY_S {
            1.0
        } else if step_s > HALF_DAY_S {
            -1.0
        } else {
            0.0
        };
        let Pending { position_m, sd_ned_m, .. } = *pending;
        let time = midnight + (days * DAY_S + pending.day_s);
        take(PositionFix { time, antenna: self.antenna, position_m, sd_ned_m });
    }
}

/// `GGA,hhmmss.ss,ddmm.mm,N,dddmm.mm,E,quality,satellites,hdop,altitude,M,separation,M,…`; `None`
/// without a position.
fn gga(fields: &[&str]) -> Result<Option<Pending>, String> {
    if matches!(field(fields, 6), "" | "0") || field(fields, 2).is_empty() {
        return Ok(None);
    }
    let day_s = time_of_day(field(fields, 1))?;
    let latitude = degrees(field(fields, 2), field(fields, 3), 90.0)?;
    let longitude = degrees(field(fields, 4), field(fields, 5), 180.0)?;
    // Above the ellipsoid: altitude above the geoid plus the geoid's separation.
    let separation = match field(fields, 11) {
        "" => 0.0,
        word => number(word)?,
    };
    let height = number(field(fields, 9))? + separation;
    let position_m = Geodetic::from_degrees(latitude, longitude, height).to_ecef();
    Ok(Some(Pending { day_s, position_m, sd_ned_m: None }))
}

/// `GST,hhmmss.ss,rms,major,minor,orientation,latitude,longitude,height`; `None` where a field is
/// empty or zero.
fn gst(fields: &[&str]) -> Result<Option<[f64; 3]>, String> {
    let words = [field(fields, 6), field(fields, 7), field(fields, 8)];
    if words.contains(&"") {
        return Ok(None);
    }
    let sd = [number(words[0])?, number(words[1])?, number(words[2])?];
    Ok(sd.iter().all(|sd| *sd > 0.0).then_some(sd))
}

/// A field, or nothing beyond the end.
fn field<'a>(fields: &[&'a str], index: usize) -> &'a str {
    fields.get(index).copied().unwrap_or_default()
}

/// `hhmmss.ss` as seconds of the day.
fn time_of_day(word: &str) -> Result<f64, String> {
    let bad = || format!("`{word}` is no time of day");
    let hours = number(word.get(0..2).ok_or_else(bad)?)?;
    let minutes = number(word.get(2..4).ok_or_else(bad)?)?;
    let seconds = number(word.get(4..).ok_or_else(bad)?)?;
    let inside = (0.0..24.0).contains(&hours)
        && (0.0..60.0).contains(&minutes)
        && (0.0..61.0).contains(&seconds);
    if inside { Ok(3600.0 * hours + 60.0 * minutes + seconds) } else { Err(bad()) }
}

/// `ddmmyy`; years from 80 on are of the last century.
fn date_of_digits(word: &str) -> Result<(i32, u8, u8), String> {
    let bad = || format!("`{word}` is no date");
    let part = |from: usize| word.get(from..from + 2).ok_or_else(bad);
    let year: i32 = integer(part(4)?)?;
    let century = if year >= 80 { 1900 } else { 2000 };
    Ok((century + year, integer(part(2)?)?, integer(part(0)?)?))
}

/// `ddmm.mmmm` and the letter of the half.
fn degrees(word: &str, half: &str, most: f64) -> Result<f64, String> {
    let bad = || format!("`{word} {half}` is no angle");
    let point = word.find('.').unwrap_or(word.len());
    let split = point.checked_sub(2).ok_or_else(bad)?;
    let (whole, minutes) = (word.get(..split), word.get(split..));
    let (Some(whole), Some(minutes)) = (whole, minutes) else { return Err(bad()) };
    let value = number(whole)? + number(minutes)? / 60.0;
    let sign = match half {
        "N" | "E" => 1.0,
        "S" | "W" => -1.0,
        _ => return Err(bad()),
    };
    if (0.0..=most).contains(&value) { Ok(sign * value) } else { Err(bad()) }
}

fn integer<T: core::str::FromStr>(word: &str) -> Result<T, String> {
    word.parse().map_err(|_| format!("`{word}` is no number"))
}

fn number(word: &str) -> Result<f64, String> {
    let value: f64 = integer(word)?;
    if value.is_finite() { Ok(value) } else { Err(format!("`{word}` is not finite")) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn with_checksum(body: &str) -> String {
        format!("${body}*{:02X}\r\n", body.bytes().fold(0, |sum, byte| sum ^ byte))
    }

    fn fixes(bodies: &[&str]) -> (Vec<PositionFix>, DamageLog) {
        let text: String = bodies.iter().map(|body| with_checksum(body)).collect();
        read_all(text.into_bytes())
    }

    fn read_all(text: Vec<u8>) -> (Vec<PositionFix>, DamageLog) {
        let mut source = Source::new(std::io::Cursor::new(text), "log").unwrap();
        let (mut found, mut damage) = (Vec::new(), DamageLog::default());
        read(&mut source, 2, &mut damage, |fix| found.push(fix)).unwrap();
        (found, damage)
    }

    fn at(year: i32, month: u8, day: u8, hour: u8, minute: u8, second: f64) -> GpsTime {
        GpsTime::from_utc(Calendar { year, month, day, hour, minute, second }).unwrap()
    }

    #[test]
    fn place_date_and_standard_deviations() {
        let (found, damage) = fixes(&[
            "GPRMC,120000.00,A,5530.0000,N,03730.0000,E,0.0,0.0,010524,,,A",
            "GNGGA,120000.00,5530.0000,N,03730.0000,E,4,12,0.8,150.0,M,14.5,M,,",
            "GNGST,120000.00,0.02,,,,0.010,0.012,0.021",
            "GNGGA,120000.20,5530.0000,S,03730.0000,W,4,12,0.8,150.0,M,,M,,",
            "GPGSV,1,1,00",
        ]);
        assert_eq!((found.len(), damage.total()), (2, 0));
        assert_eq!(found[0].time, at(2024, 5, 1, 12, 0, 0.0));
        let expected = Geodetic::from_degrees(55.5, 37.5, 164.5).to_ecef();
        assert!((found[0].position_m - expected).norm() < 1e-6);
        assert_eq!(found[0].sd_ned_m, Some([0.010, 0.012, 0.021]));
        assert_eq!((found[0].antenna, found[1].sd_ned_m), (2, None));
        let expected = Geodetic::from_degrees(-55.5, -37.5, 150.0).to_ecef();
        assert!((found[1].position_m - expected).norm() < 1e-6);
    }

    #[test]
    fn dates_go_over_midnight_and_backwards() {
        let (found, _) = fixes(&[
            "GPGGA,235958,0000.0,N,00000.0,E,1,5,1,0,M,0,M,,",
            "GPGGA,235959,0000.0,N,00000.0,E,1,5,1,0,M,0,M,,",
            "GPZDA,235959,31,12,2023,00,00",
            "GPGGA,000000,0000.0,N,00000.0,E,1,5,1,0,M,0,M,,",
            "GPGGA,000001,0000.0,N,00000.0,E,0,0,,,M,,M,,",
        ]);
        let times: Vec<GpsTime> = found.iter().map(|fix| fix.time).collect();
        let midnight = at(2024, 1, 1, 0, 0, 0.0);
        assert_eq!(times, [midnight + -2.0, midnight + -1.0, midnight]);
    }

    #[test]
    fn wrong_checksums_do_not_count() {
        let good = with_checksum("GPZDA,000000,01,01,2024,00,00");
        let gga = with_checksum("GPGGA,000000,0000.0,N,00000.0,E,1,5,1,0,M,0,M,,");
        let broken = gga.replace("0000.0,N", "0001.0,N");
        let (found, damage) = read_all(format!("{good}{broken}{gga}GPGGA\n").into_bytes());
        assert_eq!((found.len(), damage.total()), (1, 2));
        assert!(damage.listed()[0].what.contains("checksum"), "{:?}", damage.listed());
    }

    #[test]
    fn a_log_without_a_date_says_so() {
        let (found, damage) = fixes(&["GPGGA,000000,0000.0,N,00000.0,E,1,5,1,0,M,0,M,,"]);
        assert_eq!((found.len(), damage.total()), (0, 1));
    }

    proptest! {
        #[test]
        fn no_bytes_panic(bytes in proptest::collection::vec(any::<u8>(), 0..300)) {
            read_all(bytes);
        }

        #[test]
        fn no_sentence_panics(body in "G[NP](GGA|RMC|ZDA|GST)[-,.0-9NSEWA]{0,80}") {
            fixes(&[&body]);
        }
    }
}
