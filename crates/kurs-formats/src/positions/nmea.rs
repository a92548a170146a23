//! NMEA 0183 logs of one receiver: GGA or GNS for the place, RMC or ZDA for the date, GST for the
//! standard deviations.
//!
//! A `$` anywhere on a line begins a sentence; what stands before and behind it (time stamps of
//! loggers, binary messages) is passed over. A sentence counts only with its checksum, unless those
//! without any are accepted. GGA and GNS give a time of day; `dates` finds the day. Where GST is
//! missing, the quality that they state tells kinds of solutions apart.
//!
//! Heights above the ellipsoid are altitude plus separation of the geoid. Where a sentence leaves
//! the separation out it is that of the nearest sentence before, or of the first that has one.

mod dates;
mod sentence;

use std::collections::BTreeMap;

use kurs::frames::Geodetic;

use super::{PositionFix, Quality, checked_place};
use crate::damage::DamageLog;
use crate::source::{ReadError, Source};
use dates::Dates;
use sentence::{Fields, Piece, pieces};

/// Year, month, day.
pub type Date = (i32, u8, u8);

/// What a log is read by.
#[derive(Debug, Clone, Copy, Default)]
pub struct NmeaOptions {
    /// UTC date of its first position, for logs that say none.
    pub date: Option<Date>,
    /// Whether sentences without a checksum count.
    pub accept_no_checksum: bool,
}

/// What a log holds, whether it could be used or not.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Sentences {
    /// Number of sentences that count, by kind.
    pub kinds: BTreeMap<String, u64>,
    /// Sentences that have no checksum.
    pub without_checksum: u64,
    /// Sentences whose checksum is wrong.
    pub damaged: u64,
    /// Positions without a fix.
    pub without_fix: u64,
    /// The last separation of the geoid that a position states, m.
    pub separation_m: Option<f64>,
    /// What was wrong with the first sentence that could not be used.
    pub refused: Option<String>,
}

/// Reads a log of the antenna with this number.
///
/// # Errors
///
/// [`ReadError`] if the file cannot be read.
pub fn read(
    source: &mut Source,
    antenna: usize,
    options: NmeaOptions,
    damage: &mut DamageLog,
    mut take: impl FnMut(PositionFix),
) -> Result<Sentences, ReadError> {
    let mut log = Log { antenna, ..Log::default() };
    while source.advance()? {
        let number = source.line_number();
        let line = source.line().trim_ascii();
        if !line.is_empty() && !line.iter().any(|byte| matches!(byte, b'$' | b'!')) {
            damage.note(number, "no sentence: there is no $");
        }
        for piece in pieces(line) {
            let fields = match piece {
                Piece::Sentence(fields) => fields,
                Piece::WithoutChecksum(fields) => {
                    log.sentences.without_checksum += 1;
                    if !options.accept_no_checksum {
                        damage.note(number, "a sentence without checksum");
                        continue;
                    }
                    fields
                }
                Piece::Damaged(what) => {
                    log.sentences.damaged += 1;
                    damage.note(number, what);
                    continue;
                }
            };
            if let Err(what) = log.push(&fields, number, damage, &mut take) {
                log.sentences.refused.get_or_insert_with(|| what.to_string());
                damage.note(number, what);
            }
        }
    }
    log.finish(options.date, source.line_number(), damage, &mut take);
    Ok(log.sentences)
}

/// Whether one of these first lines of a file has a sentence, whatever else there is.
#[must_use]
pub fn has_sentence(start: &[u8]) -> bool {
    start.split(|byte| *byte == b'\n').any(|line| pieces(line).next().is_some())
}

impl Sentences {
    /// Why the log gave no position, in words.
    #[must_use]
    pub fn why_no_position(&self) -> String {
        let Self { without_checksum, damaged, without_fix, .. } = self;
        let listed = || {
            let kinds = self.kinds.iter().map(|(kind, count)| format!("{count} {kind}"));
            kinds.collect::<Vec<_>>().join(", ")
        };
        let positions = ["GGA", "GNS"].iter().filter_map(|kind| self.kinds.get(*kind)).sum::<u64>();
        match (self.kinds.is_empty(), positions) {
            (true, _) if *without_checksum > 0 => format!(
                "no sentence has a right checksum ({without_checksum} without any, {damaged} wrong); \
                 --accept-no-checksum takes those without"
            ),
            (true, _) => format!("no sentence has a right checksum ({damaged} wrong)"),
            (false, 0) => format!("no GGA and no GNS ({})", listed()),
            (false, _) if positions == *without_fix => {
                format!("{without_fix} positions, all without a fix ({})", listed())
            }
            (false, _) => format!(
                "{positions} positions that cannot be used ({}): {}",
                listed(),
                self.refused.as_deref().unwrap_or("they lack a time")
            ),
        }
    }
}

/// What a position says of its place.
#[derive(Debug, Clone, Copy)]
struct Place {
    /// With the altitude above the geoid for height.
    above_geoid: Geodetic,
    separation_m: Option<f64>,
    last_digit_ned_m: [f64; 3],
    quality: Quality,
}

/// A position that waits for its date and its standard deviations.
#[derive(Debug, Clone, Copy)]
struct Pending {
    day: i32,
    day_s: f64,
    place: Place,
    sd_ned_m: Option<[f64; 3]>,
}

/// State between sentences.
#[derive(Debug, Default)]
struct Log {
    antenna: usize,
    sentences: Sentences,
    dates: Dates,
    /// Positions of the stretch of time whose dates are not all read yet.
    waiting: Vec<Pending>,
}

impl Log {
    fn push(
        &mut self,
        fields: &Fields<'_>,
        line: u64,
        damage: &mut DamageLog,
        take: &mut impl FnMut(PositionFix),
    ) -> Result<(), String> {
        let kind = fields.kind();
        *self.sentences.kinds.entry(kind.to_owned()).or_default() += 1;
        match kind {
            "GGA" => self.position(fields.gga()?, fields.day_s(), damage, take)?,
            "GNS" => self.position(fields.gns()?, fields.day_s(), damage, take)?,
            "RMC" => {
                if let Some((date, holds)) = fields.rmc()? {
                    let day = self.day(fields.day_s()?, damage, take);
                    self.dates.vote(date, day, holds, line)?;
                }
            }
            "ZDA" => {
                if let Some(date) = fields.zda()? {
                    let day = self.day(fields.day_s()?, damage, take);
                    self.dates.vote(date, day, true, line)?;
                }
            }
            "GST" => {
                let day_s = fields.day_s()?;
                if let Some(position) = self.waiting.last_mut().filter(|p| p.day_s == day_s) {
                    position.sd_ned_m = fields.gst()?;
                }
            }
            _ => {}
        }
        Ok(())
    }

    /// The day number of a sentence; what waits is given out where a new stretch of time begins.
    fn day(
        &mut self,
        day_s: f64,
        damage: &mut DamageLog,
        take: &mut impl FnMut(PositionFix),
    ) -> i32 {
        let (day, is_new) = self.dates.step(day_s);
        // A stretch without any date belongs to the next one.
        if is_new && self.dates.has_votes() {
            let day_zero = self.dates.end_stretch(damage);
            self.release(day_zero, take);
        }
        day
    }

    /// A sentence with a place, or without a fix.
    fn position(
        &mut self,
        place: Option<Place>,
        day_s: Result<f64, String>,
        damage: &mut DamageLog,
        take: &mut impl FnMut(PositionFix),
    ) -> Result<(), String> {
        let Some(mut place) = place else {
            self.sentences.without_fix += 1;
            return Ok(());
        };
        let day_s = day_s?;
        let day = self.day(day_s, damage, take);
        place.separation_m = place.separation_m.or(self.sentences.separation_m);
        if self.sentences.separation_m.is_none() && place.separation_m.is_some() {
            let earlier = self.waiting.iter_mut().map(|p| &mut p.place.separation_m);
            earlier.for_each(|separation_m| *separation_m = place.separation_m);
        }
        self.sentences.separation_m = place.separation_m;
        // GGA and GNS of one epoch, or two talkers, say the same.
        if self.waiting.last().is_none_or(|last| (last.day, last.day_s) != (day, day_s)) {
            self.waiting.push(Pending { day, day_s, place, sd_ned_m: None });
        }
        Ok(())
    }

    /// Gives out what waits.
    fn release(&mut self, day_zero: Option<i64>, take: &mut impl FnMut(PositionFix)) {
        let Some(day_zero) = day_zero else { return };
        for Pending { day, day_s, place, sd_ned_m } in self.waiting.drain(..) {
            let Geodetic { latitude_rad, longitude_rad, height_m } = place.above_geoid;
            let height_m = height_m + place.separation_m.unwrap_or(0.0);
            let above_ellipsoid = Geodetic { latitude_rad, longitude_rad, height_m };
            // The altitude was checked; a separation beyond all measure is left out with its place.
            let Ok(position_m) = checked_place(above_ellipsoid.to_ecef()) else { continue };
            if let Some(time) = dates::instant(day_zero, day, day_s) {
                take(PositionFix {
                    time,
                    antenna: self.antenna,
                    position_m,
                    sd_ned_m,
                    last_digit_ned_m: place.last_digit_ned_m,
                    quality: place.quality,
                    is_above_geoid: place.separation_m.is_none(),
                });
            }
        }
    }

    /// The log has ended.
    fn finish(
        &mut self,
        date: Option<Date>,
        line: u64,
        damage: &mut DamageLog,
        take: &mut impl FnMut(PositionFix),
    ) {
        let first_day = self.waiting.first().map(|first| first.day);
        let by_log = self.dates.end_stretch(damage);
        let assumed = || self.dates.assumed(date.zip(first_day));
        let day_zero = by_log.or_else(assumed);
        if day_zero.is_none() && !self.waiting.is_empty() {
            let what = "no RMC or ZDA sentence with a date: the date of the positions is not known (give --date)";
            self.sentences.refused.get_or_insert_with(|| what.to_owned());
            damage.note(line, what);
        }
        self.release(day_zero, take);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use kurs::time::{Calendar, GpsTime};
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
        let options = NmeaOptions { date, ..NmeaOptions::default() };
        read(&mut source, 2, options, &mut damage, |fix| found.push(fix)).unwrap();
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
        // Minutes with four digits are 0.19 m of latitude.
        let [north, east, down] = found[0].last_digit_ned_m;
        assert!((north - 0.185).abs() < 1e-3 && (east - 0.105).abs() < 1e-3 && down == 0.1);
        // The separation that is left out is that of the sentence before.
        let expected = Geodetic::from_degrees(-55.5, -37.5, 164.5).to_ecef();
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
        let gga = |(second, quality): (usize, &&str)| {
            format!("GPGGA,00000{second},0000.0,N,00000.0,E,{quality},5,1,0,M,0,M,,")
        };
        let qualities = ["4", "5", "2", "1", "0", "6", ""];
        let log: Vec<String> =
            std::iter::once(zda).chain(qualities.iter().enumerate().map(gga)).collect();
        let (found, _) = fixes(&log.iter().map(String::as_str).collect::<Vec<_>>());
        let factors: Vec<f64> = found.iter().map(|fix| fix.quality.sd_factor()).collect();
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

    fn gga(second: u32, rest: &str) -> String {
        format!("GNGGA,1200{second:02}.00,5000.0,N,00800.0,E,{rest},M,1.0,0001")
    }

    fn rmc(second: u32, status: &str, date: &str) -> String {
        format!("GNRMC,1200{second:02}.00,{status},5000.0,N,00800.0,E,0.0,0.0,{date},,,R")
    }

    /// Void dates and one that contradicts its neighbours date nothing; only the latter is damage.
    #[test]
    fn wrong_dates_are_outvoted() {
        let log: Vec<String> = (0..10)
            .flat_map(|k| {
                let date = if k == 6 { "160604" } else { "160624" };
                let position = gga(k, "4,12,0.6,52.0,M,48.0");
                [rmc(k, "V", "050505"), position, rmc(k, "A", date)]
            })
            .collect();
        let (found, damage) = fixes(&log.iter().map(String::as_str).collect::<Vec<_>>());
        let times: Vec<GpsTime> = found.iter().map(|fix| fix.time).collect();
        let noon = at(2024, 6, 16, 12, 0, 0.0);
        assert_eq!(times, (0..10).map(|k| noon + f64::from(k)).collect::<Vec<_>>());
        assert_eq!(damage.total(), 1);
        let what = &damage.listed()[0].what;
        assert!(what.contains("1 sentences date the log -7305 days off"), "{what}");
        assert_eq!(damage.listed()[0].line, 21);
    }

    /// Before any valid date a void one may serve, but a date from outside goes first.
    #[test]
    fn a_void_date_serves_where_there_is_no_other() {
        let log =
            with_checksum(&rmc(0, "V", "160624")) + &with_checksum(&gga(0, "4,12,0.6,52.0,M,48.0"));
        let (found, _) = read_all(log.clone().into_bytes());
        assert_eq!(found[0].time, at(2024, 6, 16, 12, 0, 0.0));
        let (found, _) = read_dated(log.into_bytes(), Some((2024, 6, 17)));
        assert_eq!(found[0].time, at(2024, 6, 17, 12, 0, 0.0));
    }

    #[test]
    fn a_pause_of_days_is_obeyed() {
        let (found, damage) = fixes(&[
            &gga(0, "4,12,0.6,52.0,M,48.0"),
            &rmc(0, "A", "160624"),
            &gga(1, "4,12,0.6,52.0,M,48.0"),
            "GNGGA,110000.00,5000.0,N,00800.0,E,4,12,0.6,52.0,M,48.0,M,1.0,0001",
            "GNZDA,110000.00,20,06,2024,00,00",
            "GNGGA,110001.00,5000.0,N,00800.0,E,4,12,0.6,52.0,M,48.0,M,1.0,0001",
        ]);
        let times: Vec<GpsTime> = found.iter().map(|fix| fix.time).collect();
        let (first, second) = (at(2024, 6, 16, 12, 0, 0.0), at(2024, 6, 20, 11, 0, 0.0));
        assert_eq!((times, damage.total()), (vec![first, first + 1.0, second, second + 1.0], 0));
    }

    fn heights(found: &[PositionFix]) -> Vec<f64> {
        let height_m = |fix: &PositionFix| Geodetic::from_ecef(fix.position_m).height_m;
        found.iter().map(|fix| (1e6 * height_m(fix)).round() / 1e6).collect()
    }

    /// A separation that is left out is that of the neighbours; without any the height says so.
    #[test]
    fn an_empty_separation_is_not_zero() {
        let date = rmc(0, "A", "160624");
        let (found, _) = fixes(&[
            &date,
            &gga(0, "4,12,0.6,52.0,M,"),
            &gga(1, "4,12,0.6,52.0,M,48.0"),
            &gga(2, "4,12,0.6,52.0,M,"),
        ]);
        assert_eq!(heights(&found), [100.0, 100.0, 100.0]);
        assert!(found.iter().all(|fix| !fix.is_above_geoid));
        let (found, _) = fixes(&[&date, &gga(0, "4,12,0.6,52.0,M,")]);
        assert_eq!((heights(&found), found[0].is_above_geoid), (vec![52.0], true));
    }

    #[test]
    fn gns_gives_places_and_is_as_good_as_its_worst_system() {
        let zda = "GNZDA,120000.00,16,06,2024,00,00".to_owned();
        let gns = |second: usize, modes: &str| {
            format!("GNGNS,1200{second:02}.00,5000.0,N,00800.0,E,{modes},24,0.6,52.0,48.0,1.0,0001")
        };
        let modes = ["RRNN", "RFNN", "DAN", "NNNN"];
        let log: Vec<String> =
            std::iter::once(zda).chain(modes.iter().enumerate().map(|(k, m)| gns(k, m))).collect();
        let (found, damage) = fixes(&log.iter().map(String::as_str).collect::<Vec<_>>());
        let qualities: Vec<Quality> = found.iter().map(|fix| fix.quality).collect();
        assert_eq!(qualities, [Quality::RtkFixed, Quality::RtkFloat, Quality::Code]);
        assert_eq!((heights(&found), damage.total()), (vec![100.0; 3], 0));
    }

    /// Both sentences of one epoch are one position, with the standard deviations that follow.
    #[test]
    fn sentences_on_one_line_count_each() {
        let line = with_checksum("GNZDA,120000.00,16,06,2024,00,00").trim_end().to_owned()
            + with_checksum(&gga(0, "4,12,0.6,52.0,M,48.0")).trim_end()
            + ",12:00:00.1 "
            + with_checksum("GNGNS,120000.00,5000.0,N,00800.0,E,RR,24,0.6,52.0,48.0,1.0,0001")
                .trim_end()
            + &with_checksum("GNGST,120000.00,0.02,,,,0.010,0.012,0.021");
        let (found, damage) = read_all(line.into_bytes());
        assert_eq!((found.len(), damage.total()), (1, 0));
        assert_eq!(found[0].sd_ned_m, Some([0.010, 0.012, 0.021]));
    }

    #[test]
    fn logs_without_checksums_or_positions_say_so() {
        let bare = |accept_no_checksum: bool, text: &str| {
            let text = text.as_bytes().to_vec();
            let mut source = Source::new(std::io::Cursor::new(text), "log").unwrap();
            let (mut count, mut damage) = (0, DamageLog::default());
            let options = NmeaOptions { accept_no_checksum, date: Some((2024, 6, 16)) };
            let sentences = read(&mut source, 0, options, &mut damage, |_| count += 1).unwrap();
            (count, damage.total(), sentences.why_no_position())
        };
        let log = format!(
            "${}\r\n${}\r\n",
            gga(0, "4,12,0.6,52.0,M,48.0"),
            gga(1, "4,12,0.6,52.0,M,48.0")
        );
        assert!(has_sentence(log.as_bytes()));
        let (count, damage, why) = bare(false, &log);
        assert_eq!((count, damage), (0, 2));
        assert!(
            why.starts_with("no sentence has a right checksum (2 without any, 0 wrong)"),
            "{why}"
        );
        assert_eq!((bare(true, &log).0, bare(true, &log).1), (2, 0));
        let gll = with_checksum("GNGLL,5000.0,N,00800.0,E,120000.00,A,A").repeat(3);
        assert_eq!(bare(false, &gll).2, "no GGA and no GNS (3 GLL)");
        let void = with_checksum("GNGGA,120000.00,,,,,0,00,,,M,,M,,");
        assert_eq!(bare(false, &void).2, "1 positions, all without a fix (1 GGA)");
    }

    proptest! {
        #[test]
        fn no_bytes_panic(bytes in proptest::collection::vec(any::<u8>(), 0..300)) {
            read_all(bytes);
        }

        #[test]
        fn no_sentence_panics(body in "G[NP](GGA|GNS|RMC|ZDA|GST)[-,.0-9NSEWARV]{0,80}") {
            fixes(&[&body]);
        }
    }
}
