//! NMEA 0183 logs of one receiver: GGA for the place, RMC or ZDA for the date, GST for the standard
//! deviations.
//!
//! A sentence counts only with its checksum; what stands before its `$` on the line is passed over
//! (time stamps of loggers, binary messages in between). GGA gives a time of day; its date comes from
//! an RMC or ZDA of the same second or, failing that, from the last one, counted on over midnight.
//! What comes before the first date is dated backwards from it. Where GST is missing, the quality that
//! GGA states tells kinds of solutions apart.

use kurs::frames::{Geodetic, Vector};
use kurs::time::{Calendar, GpsTime};

use super::{PositionFix, checked_place};
use crate::damage::DamageLog;
use crate::source::{ReadError, Source};

const DAY_S: f64 = 86_400.0;
/// A step of the time of day by more than this goes over midnight.
const HALF_DAY_S: f64 = 43_200.0;

/// Year, month, day.
pub type Date = (i32, u8, u8);

/// Reads a log of the antenna with this number; `date` is that of its first position, for logs
/// that say none.
///
/// # Errors
///
/// [`ReadError`] if the file cannot be read.
pub fn read(
    source: &mut Source,
    antenna: usize,
    date: Option<Date>,
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
    log.release(&mut take);
    if log.last_date.is_none() && !log.undated.is_empty() {
        match date {
            Some(date) => log.date_all(date, &mut take),
            None => damage.note(
                source.line_number(),
                "no RMC or ZDA sentence: the date of the positions is not known (give --date)",
            ),
        }
    }
    Ok(())
}

/// Whether one of these first lines of a file has a sentence, whatever else there is.
#[must_use]
pub fn has_sentence(start: &[u8]) -> bool {
    start.split(|byte| *byte == b'\n').any(|line| sentence(line.trim_ascii()).is_ok())
}

/// Fields of a sentence whose checksum is right, without `$` and checksum.
fn sentence(line: &[u8]) -> Result<Vec<&str>, String> {
    let start = line.iter().rposition(|byte| matches!(byte, b'$' | b'!'));
    let body = &line[start.ok_or("no sentence: there is no $")? + 1..];
    let body = core::str::from_utf8(body).map_err(|_| "not text".to_owned())?;
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
    sd_factor: f64,
}

/// State between sentences.
#[derive(Debug, Default)]
struct Log {
    antenna: usize,
    pending: Option<Pending>,
    /// The last known date, and the time of day it stood with.
    last_date: Option<(Date, f64)>,
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
    fn date(&mut self, day_s: f64, date: Date, take: &mut impl FnMut(PositionFix)) {
        if self.last_date.is_none() {
            for earlier in core::mem::take(&mut self.undated) {
                self.emit(&earlier, day_s, date, take);
            }
        }
        self.last_date = Some((date, day_s));
    }

    /// No sentence gave a date: the first position was on this one.
    fn date_all(&mut self, mut date: Date, take: &mut impl FnMut(PositionFix)) {
        let mut day_s = self.undated.first().map_or(0.0, |first| first.day_s);
        for pending in core::mem::take(&mut self.undated) {
            date = self.emit(&pending, day_s, date, take);
            day_s = pending.day_s;
        }
    }

    /// The waiting GGA has all it will get.
    fn release(&mut self, take: &mut impl FnMut(PositionFix)) {
        let Some(pending) = self.pending.take() else { return };
        match self.last_date {
            Some((date, day_s)) => {
                let date = self.emit(&pending, day_s, date, take);
                self.last_date = Some((date, pending.day_s));
            }
            None => self.undated.push(pending),
        }
    }

    /// Gives the fix, dated by a date that stood with the time of day `day_s`; returns its own date.
    fn emit(
        &self,
        pending: &Pending,
        day_s: f64,
        date: Date,
        take: &mut impl FnMut(PositionFix),
    ) -> Date {
        let step_s = pending.day_s - day_s;
        let date = if step_s < -HALF_DAY_S {
            days_after(date, 1.0)
        } else if step_s > HALF_DAY_S {
            days_after(date, -1.0)
        } else {
            date
        };
        let (year, month, day) = date;
        let midnight = Calendar { year, month, day, hour: 0, minute: 0, second: 0.0 };
        if let Some(midnight) = GpsTime::from_utc(midnight) {
            let Pending { position_m, sd_ned_m, sd_factor, .. } = *pending;
            let time = midnight + pending.day_s;
            take(PositionFix { time, antenna: self.antenna, position_m, sd_ned_m, sd_factor });
        }
        date
    }
}

fn days_after(date: Date, days: f64) -> Date {
    let (year, month, day) = date;
    let noon = Calendar { year, month, day, hour: 12, minute: 0, second: 0.0 };
    GpsTime::from_calendar(noon).map_or(date, |noon| {
        let Calendar { year, month, day, .. } = (noon + days * DAY_S).calendar();
        (year, month, day)
    })
}

/// `GGA,hhmmss.ss,ddmm.mm,N,dddmm.mm,E,quality,satellites,hdop,altitude,M,separation,M,…`; `None`
/// without a position.
fn gga(fields: &[&str]) -> Result<Option<Pending>, String> {
    let Some(sd_factor) = sd_factor(field(fields, 6)) else { return Ok(None) };
    if field(fields, 2).is_empty() {
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
    let place = Geodetic::from_degrees(latitude, longitude, height);
    let position_m = checked_place(place.to_ecef())?;
    Ok(Some(Pending { day_s, position_m, sd_ned_m: None, sd_factor }))
}

/// How much less certain a quality of GGA is than a fixed RTK solution: centimetres, decimetres for a
/// float one, then code solutions with and without corrections. `None` where nothing was measured:
/// no fix, dead reckoning, entered by hand.
fn sd_factor(quality: &str) -> Option<f64> {
    match quality {
        "" | "0" | "6" | "7" => None,
        "4" => Some(1.0),
        "5" => Some(20.0),
        "2" => Some(50.0),
        _ => Some(150.0),
    }
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
        read_dated(text, None)
    }

    fn read_dated(text: Vec<u8>, date: Option<Date>) -> (Vec<PositionFix>, DamageLog) {
        let mut source = Source::new(std::io::Cursor::new(text), "log").unwrap();
        let (mut found, mut damage) = (Vec::new(), DamageLog::default());
        read(&mut source, 2, date, &mut damage, |fix| found.push(fix)).unwrap();
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
        assert!(damage.listed()[0].what.contains("--date"), "{:?}", damage.listed());
    }

    /// A date at the start, or given from outside, lasts for days.
    #[test]
    fn one_date_is_counted_on() {
        let gga = |hour: u32| {
            with_checksum(&format!("GNGGA,{:02}0000,0000.0,N,00000.0,E,4,9,1,0,M,0,M,,", hour % 24))
        };
        let log: String = (20..80).map(gga).collect();
        let zda = with_checksum("GNZDA,200000.00,28,02,2024,00,00");
        for (found, damage) in [
            read_all(format!("{zda}{log}").into_bytes()),
            read_dated(log.clone().into_bytes(), Some((2024, 2, 28))),
        ] {
            let last = at(2024, 3, 2, 7, 0, 0.0);
            assert_eq!((found.len(), found[59].time, damage.total()), (60, last, 0));
            assert!(found.windows(2).all(|pair| pair[1].time - pair[0].time == 3600.0));
        }
    }

    #[test]
    fn qualities_are_told_apart() {
        let zda = "GPZDA,000000,01,01,2024,00,00".to_owned();
        let gga =
            |quality: &str| format!("GPGGA,000000,0000.0,N,00000.0,E,{quality},5,1,0,M,0,M,,");
        let log: Vec<String> =
            std::iter::once(zda).chain(["4", "5", "2", "1", "0", "6", ""].map(gga)).collect();
        let (found, _) = fixes(&log.iter().map(String::as_str).collect::<Vec<_>>());
        let factors: Vec<f64> = found.iter().map(|fix| fix.sd_factor).collect();
        assert_eq!(factors, [1.0, 20.0, 50.0, 150.0]);
    }

    #[test]
    fn stamps_and_binary_before_a_sentence_are_passed_over() {
        let zda = with_checksum("GPZDA,000000,01,01,2024,00,00");
        let gga = with_checksum("GPGGA,000000,0000.0,N,00000.0,E,1,5,1,0,M,0,M,,");
        let log =
            [b"\xb5\x62\x01\x07\xff".as_slice(), zda.as_bytes(), b"12:00:01 ", gga.as_bytes()];
        let log = log.concat();
        assert!(has_sentence(&log) && !has_sentence(b"name,x_m,y_m,z_m\n1,2,3,4\n"));
        let (found, damage) = read_all(log);
        assert_eq!((found.len(), damage.total()), (1, 0));
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
