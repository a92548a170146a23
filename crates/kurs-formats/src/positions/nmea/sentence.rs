//! Sentences of a line: where they begin, whether their checksum is right, what their fields say.

use kurs::frames::Geodetic;

use super::{Date, Place};
use crate::positions::{Quality, checked_place, last_digit, last_digit_ned_m};

/// Bytes of the shortest address: `PUBX` of u-blox; those of the standard have five.
const MIN_ADDRESS: usize = 4;

/// What follows a `$` on a line.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Piece<'a> {
    /// A sentence with its right checksum.
    Sentence(Fields<'a>),
    /// A sentence that states no checksum.
    WithoutChecksum(Fields<'a>),
    /// A sentence that differs from its checksum, or is not text: what is wrong.
    Damaged(String),
}

/// Fields of a sentence, the first of which is its address, without `$` and checksum.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Fields<'a>(Vec<&'a str>);

/// The sentences of a line. Each begins with `$` or `!` and an address; what stands before, between
/// and behind them is passed over.
pub(super) fn pieces(line: &[u8]) -> impl Iterator<Item = Piece<'_>> {
    let after_marks = line.split(|byte| matches!(byte, b'$' | b'!')).skip(1);
    after_marks.filter(|piece| has_address(piece)).map(piece_of)
}

/// Capital letters and digits, then a comma.
fn has_address(piece: &[u8]) -> bool {
    let is_of_address = |b: &&u8| b.is_ascii_uppercase() || b.is_ascii_digit();
    let length = piece.iter().take_while(is_of_address).count();
    length >= MIN_ADDRESS && piece[0].is_ascii_uppercase() && piece.get(length) == Some(&b',')
}

fn piece_of(piece: &[u8]) -> Piece<'_> {
    let star = piece.iter().position(|byte| *byte == b'*');
    let body = piece[..star.unwrap_or(piece.len())].trim_ascii_end();
    let Ok(text) = core::str::from_utf8(body) else { return Piece::Damaged("not text".to_owned()) };
    let fields = Fields(text.split(',').collect());
    let Some(star) = star else { return Piece::WithoutChecksum(fields) };
    // What a logger writes behind the two digits does not count.
    let digits = piece.get(star + 1..star + 3).unwrap_or_default();
    let Some(stated) =
        core::str::from_utf8(digits).ok().and_then(|hex| u8::from_str_radix(hex, 16).ok())
    else {
        return Piece::Damaged(format!("checksum `{}` is no number", digits.escape_ascii()));
    };
    let found = body.iter().fold(0, |sum, byte| sum ^ byte);
    if found == stated {
        Piece::Sentence(fields)
    } else {
        Piece::Damaged(format!("checksum {stated:02X}, but the text gives {found:02X}"))
    }
}

impl<'a> Fields<'a> {
    /// The kind, without the talker.
    pub(super) fn kind(&self) -> &'a str {
        self.0[0].get(2..).unwrap_or_default()
    }

    /// A field, or nothing beyond the end.
    fn get(&self, index: usize) -> &'a str {
        self.0.get(index).copied().unwrap_or_default()
    }

    /// Time of day of GGA, GNS, RMC, ZDA and GST, s.
    pub(super) fn day_s(&self) -> Result<f64, String> {
        time_of_day(self.get(1))
    }

    /// `GGA,hhmmss.ss,ddmm.mm,N,dddmm.mm,E,quality,satellites,hdop,altitude,M,separation,M,…`;
    /// `None` without a position.
    pub(super) fn gga(&self) -> Result<Option<Place>, String> {
        let quality = quality_of_gga(self.get(6));
        self.place(quality, [self.get(9), self.get(11)])
    }

    /// `GNS,hhmmss.ss,ddmm.mm,N,dddmm.mm,E,modes,satellites,hdop,altitude,separation,…`; `None`
    /// without a position.
    pub(super) fn gns(&self) -> Result<Option<Place>, String> {
        let quality = quality_of_gns(self.get(6));
        self.place(quality, [self.get(9), self.get(10)])
    }

    /// Latitude and longitude in fields 2 to 5, with these words for altitude and separation.
    fn place(
        &self,
        quality: Option<Quality>,
        [altitude, separation]: [&str; 2],
    ) -> Result<Option<Place>, String> {
        let Some(quality) = quality.filter(|_| !self.get(2).is_empty()) else { return Ok(None) };
        let latitude_deg = degrees(self.get(2), self.get(3), 90.0)?;
        let longitude_deg = degrees(self.get(4), self.get(5), 180.0)?;
        let separation_m = match separation {
            "" => None,
            word => Some(number(word)?),
        };
        let altitude_m = number(altitude)?;
        let above_geoid = Geodetic::from_degrees(latitude_deg, longitude_deg, altitude_m);
        checked_place(above_geoid.to_ecef())?;
        let minutes = last_digit(self.get(2)).min(last_digit(self.get(4)));
        let last_digit_ned_m =
            last_digit_ned_m(above_geoid.latitude_rad, minutes / 60.0, last_digit(altitude));
        Ok(Some(Place { above_geoid, separation_m, last_digit_ned_m, quality }))
    }

    /// `RMC,hhmmss.ss,status,…,ddmmyy,…`: the date, and whether the status says that it holds.
    pub(super) fn rmc(&self) -> Result<Option<(Date, bool)>, String> {
        let word = self.get(9);
        if word.is_empty() {
            return Ok(None);
        }
        Ok(Some((date_of_digits(word)?, self.get(2) != "V")))
    }

    /// `ZDA,hhmmss.ss,day,month,year,…`
    pub(super) fn zda(&self) -> Result<Option<Date>, String> {
        if self.get(4).is_empty() {
            return Ok(None);
        }
        Ok(Some((integer(self.get(4))?, integer(self.get(3))?, integer(self.get(2))?)))
    }

    /// `GST,hhmmss.ss,rms,major,minor,orientation,latitude,longitude,height`: standard deviations
    /// north, east, up, m; `None` where one is empty or zero.
    pub(super) fn gst(&self) -> Result<Option<[f64; 3]>, String> {
        let words = [self.get(6), self.get(7), self.get(8)];
        if words.contains(&"") {
            return Ok(None);
        }
        let sd = [number(words[0])?, number(words[1])?, number(words[2])?];
        Ok(sd.iter().all(|sd| *sd > 0.0).then_some(sd))
    }
}

/// The quality of GGA; `None` where nothing was measured: no fix, dead reckoning, entered by hand,
/// simulated.
fn quality_of_gga(digit: &str) -> Option<Quality> {
    match digit {
        "" | "0" | "6" | "7" | "8" => None,
        "4" => Some(Quality::RtkFixed),
        "5" => Some(Quality::RtkFloat),
        "2" => Some(Quality::DifferentialCode),
        _ => Some(Quality::Code),
    }
}

/// The modes of GNS, one letter for each system: as good as the worst of those that are used.
fn quality_of_gns(modes: &str) -> Option<Quality> {
    let quality = |mode| match mode {
        'R' => Some(Quality::RtkFixed),
        'F' => Some(Quality::RtkFloat),
        'D' => Some(Quality::DifferentialCode),
        'A' | 'P' => Some(Quality::Code),
        _ => None,
    };
    modes.chars().filter_map(quality).max()
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
