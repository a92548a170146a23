//! Tables of coordinates: one row for each antenna and time, columns found by their names.
//!
//! Time: `gps_week, tow_s`, or `time_utc` (`2024-05-01T12:00:00.5Z`, or with another zone,
//! `2024-05-01 14:00:00.5+02:00`), or `time_gpst`. Antenna: `name`. Place:
//! `latitude_deg, longitude_deg, height_m` (WGS 84, above the ellipsoid) or `x_m, y_m, z_m` (ECEF).
//! Optional: `sd_north_m, sd_east_m, sd_down_m` (or `sd_up_m`), all three or none, and `status` with the
//! words of Kurs, by which rows without a solution are left out. Other columns are passed over, but none
//! whose name begins with `sd_`.

use std::collections::BTreeMap;

use kurs::frames::{Ecef, Geodetic, Vector};
use kurs::time::{Calendar, GpsTime};

use super::{PositionFix, Quality, checked_place, last_digit, last_digit_ned_m};
use crate::damage::DamageLog;
use crate::source::{ReadError, Source};

/// Where the columns of a table are.
struct Columns {
    time: TimeColumns,
    name: usize,
    place: PlaceColumns,
    sd: Option<[usize; 3]>,
    status: Option<usize>,
    /// Fields that a row must have at least.
    count: usize,
}

/// What a row says.
enum Row<'a> {
    Fix(PositionFix),
    /// As its status says.
    WithoutSolution,
    /// An antenna that is not asked for.
    OfAnother(&'a str),
}

enum TimeColumns {
    WeekTow([usize; 2]),
    Utc(usize),
    Gpst(usize),
}

enum PlaceColumns {
    Geodetic([usize; 3]),
    Ecef([usize; 3]),
}

/// Columns that a table can have.
const FIELDS_MAX: usize = 64;
/// Characters of a header that a message repeats.
const HEADER_MAX: usize = 200;
/// Other names that are told; a column of numbers must not fill the memory.
const OTHERS_MAX: usize = 100;

/// Reads the rows of `antennas`; returns the other names in the table (a hundred at most) with
/// their numbers of rows.
///
/// Rows that cannot be used are noted in `damage`, the rest is read.
///
/// # Errors
///
/// [`ReadError`] if the file cannot be read, or its header lacks a column.
pub fn read(
    source: &mut Source,
    antennas: &[String],
    damage: &mut DamageLog,
    mut take: impl FnMut(PositionFix),
) -> Result<BTreeMap<String, u64>, ReadError> {
    let expected = "a table with a header line of column names";
    if !source.advance()? {
        return Err(source.wrong_content("an empty file", expected));
    }
    let header = String::from_utf8_lossy(source.line()).into_owned();
    let columns = Columns::of(&header).map_err(|what| source.bad_line(what))?;
    let mut others = BTreeMap::new();
    while source.advance()? {
        let number = source.line_number();
        let line = source.line();
        if line.trim_ascii().is_empty() {
            continue;
        }
        match columns.row(line, antennas) {
            Ok(Row::Fix(fix)) => take(fix),
            Ok(Row::WithoutSolution) => {}
            Ok(Row::OfAnother(name)) if others.len() < OTHERS_MAX || others.contains_key(name) => {
                *others.entry(name.to_owned()).or_default() += 1;
            }
            Ok(Row::OfAnother(_)) => {}
            Err(what) => damage.note(number, what),
        }
    }
    Ok(others)
}

/// Columns of standard deviations north, east and down: all of them or none, and no others.
fn sd_columns(names: &[&str]) -> Result<Option<[usize; 3]>, String> {
    const EXPECTED: &str = "expected `sd_north_m`, `sd_east_m` and `sd_down_m` (or `sd_up_m`)";
    let known = [&["sd_north_m"][..], &["sd_east_m"], &["sd_down_m", "sd_up_m"]];
    let is_strange = |name: &&&str| name.starts_with("sd_") && !known.concat().contains(*name);
    if let Some(name) = names.iter().find(is_strange) {
        return Err(format!("column `{name}` is no standard deviation of a place: {EXPECTED}"));
    }
    let found = known.map(|same| names.iter().position(|name| same.contains(name)));
    if let [Some(north), Some(east), Some(down)] = found {
        return Ok(Some([north, east, down]));
    }
    match (0..3).find(|k| found[*k].is_none()).filter(|_| found.iter().any(Option::is_some)) {
        Some(missing) => Err(format!("column `{}` is missing: {EXPECTED}", known[missing][0])),
        None => Ok(None),
    }
}

impl Columns {
    fn of(header: &str) -> Result<Self, String> {
        let names: Vec<&str> = header
            .trim_start_matches('\u{feff}')
            .split(',')
            .map(|name| unquoted(name.trim()))
            .collect();
        let find = |name: &str| names.iter().position(|found| *found == name);
        let three = |[a, b, c]: [&str; 3]| Some([find(a)?, find(b)?, find(c)?]);
        let found: String = header.chars().take(HEADER_MAX).collect();
        let ends = if found.len() < header.len() { "…" } else { "" };
        // Line ends of old Macintoshes make one line of the whole file.
        let one_line = if header.contains('\r') { " (its lines end with CR alone)" } else { "" };
        let missing = |what: &str| {
            let found = found.replace('\r', " ");
            format!("column {what} is missing{one_line}; found: {found}{ends}")
        };

        let week_tow = find("gps_week").zip(find("tow_s"));
        let time = match (week_tow, find("time_utc"), find("time_gpst")) {
            (Some((week, tow)), _, _) => TimeColumns::WeekTow([week, tow]),
            (None, Some(utc), _) => TimeColumns::Utc(utc),
            (None, None, Some(gpst)) => TimeColumns::Gpst(gpst),
            _ => return Err(missing("`gps_week` with `tow_s`, or `time_utc`,")),
        };
        let geodetic = three(["latitude_deg", "longitude_deg", "height_m"]);
        let place = match (geodetic, three(["x_m", "y_m", "z_m"])) {
            (Some(geodetic), _) => PlaceColumns::Geodetic(geodetic),
            (None, Some(ecef)) => PlaceColumns::Ecef(ecef),
            (None, None) => {
                let what = "`latitude_deg`, `longitude_deg`, `height_m`, or `x_m`, `y_m`, `z_m`,";
                return Err(missing(what));
            }
        };
        Ok(Self {
            time,
            name: find("name").ok_or_else(|| missing("`name`"))?,
            place,
            sd: sd_columns(&names)?,
            status: find("status"),
            count: names.len(),
        })
    }

    fn row<'a>(&self, line: &'a [u8], antennas: &[String]) -> Result<Row<'a>, String> {
        let mut fields = [&[][..]; FIELDS_MAX];
        self.split(line, &mut fields)?;
        let fields = &fields;
        let name = text(fields[self.name])?;
        let Some(antenna) = antennas.iter().position(|antenna| antenna == name) else {
            return Ok(Row::OfAnother(name));
        };
        let time = self.time(fields)?;
        let Some(quality) = self.quality(fields)? else { return Ok(Row::WithoutSolution) };
        let (position_m, last_digit_ned_m) = self.place(fields)?;
        Ok(Row::Fix(PositionFix {
            time,
            antenna,
            position_m,
            sd_ned_m: self.sd(fields)?,
            last_digit_ned_m,
            quality,
            is_above_geoid: false,
        }))
    }

    /// Puts the fields of a row in their places.
    fn split<'a>(&self, line: &'a [u8], fields: &mut [&'a [u8]]) -> Result<(), String> {
        let mut count = 0;
        for field in line.split(|byte| *byte == b',') {
            if let Some(slot) = fields.get_mut(count) {
                *slot = field.trim_ascii();
            }
            count += 1;
        }
        if count < self.count || self.count > fields.len() {
            return Err(format!("{count} fields where the header has {}", self.count));
        }
        Ok(())
    }

    fn time(&self, fields: &[&[u8]]) -> Result<GpsTime, String> {
        let dated = |column: usize, parse: fn(&str) -> Option<GpsTime>| {
            let word = text(fields[column])?;
            parse(word).ok_or_else(|| format!("no time: `{word}`"))
        };
        match self.time {
            TimeColumns::WeekTow([week, tow]) => {
                let (week, tow) = (text(fields[week])?, number(fields[tow])?);
                let week: i32 = week.parse().map_err(|_| format!("week `{week}` is no number"))?;
                GpsTime::from_week_tow(week, tow)
                    .ok_or_else(|| format!("no time: week {week}, {tow} s"))
            }
            TimeColumns::Utc(column) => dated(column, parse_utc),
            TimeColumns::Gpst(column) => {
                dated(column, |word| GpsTime::from_calendar(parse_calendar(word)?))
            }
        }
    }

    /// The place, with its last digits north, east and down, m.
    fn place(&self, fields: &[&[u8]]) -> Result<(Vector<Ecef>, [f64; 3]), String> {
        // Writers that drop zeros at the end drop them on all coordinates but few at a time.
        let finest = |columns: &[usize]| -> Result<f64, String> {
            columns.iter().try_fold(f64::INFINITY, |finest, column| {
                Ok(last_digit(text(fields[*column])?).min(finest))
            })
        };
        let (position_m, last_digit_ned_m) = match self.place {
            PlaceColumns::Ecef(columns) => {
                let [x, y, z] = numbers(fields, columns)?;
                (Vector::new(x, y, z), [finest(&columns)?; 3])
            }
            PlaceColumns::Geodetic(columns) => {
                let [latitude, longitude, height] = numbers(fields, columns)?;
                if latitude.abs() > 90.0 || longitude.abs() > 360.0 {
                    return Err(format!("no place: latitude {latitude}, longitude {longitude}"));
                }
                let geodetic = Geodetic::from_degrees(latitude, longitude, height);
                let (angle_deg, height_m) = (finest(&columns[..2])?, finest(&columns[2..])?);
                let last_digit_ned_m = last_digit_ned_m(geodetic.latitude_rad, angle_deg, height_m);
                (geodetic.to_ecef(), last_digit_ned_m)
            }
        };
        Ok((checked_place(position_m)?, last_digit_ned_m))
    }

    /// Standard deviations north, east and down, m; `None` if the row has none.
    fn sd(&self, fields: &[&[u8]]) -> Result<Option<[f64; 3]>, String> {
        let is_given = |columns: &[usize; 3]| columns.iter().any(|c| !fields[*c].is_empty());
        let Some(columns) = self.sd.filter(is_given) else { return Ok(None) };
        if columns.iter().any(|column| fields[*column].is_empty()) {
            return Err("some, but not all, standard deviations are empty".to_owned());
        }
        let sd @ [north, east, down] = numbers(fields, columns)?;
        if sd.iter().any(|sd| *sd <= 0.0) {
            return Err(format!(
                "standard deviations {north}, {east} and {down} are not all positive"
            ));
        }
        Ok(Some(sd))
    }

    /// The kind of solution, by the words of Kurs; `None` for rows that say themselves that they
    /// have none.
    fn quality(&self, fields: &[&[u8]]) -> Result<Option<Quality>, String> {
        let word = self.status.map_or(Ok(""), |column| text(fields[column]))?;
        match word {
            "" => Ok(Some(Quality::Unknown)),
            "fixed" => Ok(Some(Quality::RtkFixed)),
            "float" => Ok(Some(Quality::RtkFloat)),
            "lost" | "inconsistent" | "not_capable" => Ok(None),
            _ => Err(format!("status `{word}`, expected fixed, float, lost, inconsistent")),
        }
    }
}

/// `2024-05-01T12:00:00.5`, or a blank for `T`; the zone is `Z`, `+02:00`, `-0300` or left out.
fn parse_utc(word: &str) -> Option<GpsTime> {
    let word = word.strip_suffix(['Z', 'z']).or(word.strip_suffix(" UTC")).unwrap_or(word);
    // A sign behind the date begins the zone.
    let sign = word.get(11..)?.rfind(['+', '-']).map_or(word.len(), |place| place + 11);
    let (local, zone) = word.split_at(sign);
    Some(GpsTime::from_utc(parse_calendar(local)?)? + -zone_s(zone)?)
}

/// Seconds by which `+02:00` or `-0300` is ahead of UTC.
fn zone_s(zone: &str) -> Option<f64> {
    if zone.is_empty() {
        return Some(0.0);
    }
    let digits: String = zone[1..].chars().filter(|c| *c != ':').collect();
    let (hours, minutes) = (digits.get(..2)?, digits.get(2..).filter(|m| !m.is_empty()));
    let hours: u32 = hours.parse().ok()?;
    let minutes: u32 = minutes.map_or(Some(0), |minutes| minutes.parse().ok())?;
    let ahead_s = f64::from(3600 * hours + 60 * minutes);
    (hours < 24 && minutes < 60).then_some(if zone.starts_with('-') { -ahead_s } else { ahead_s })
}

/// Date and time of day without a zone.
fn parse_calendar(word: &str) -> Option<Calendar> {
    let (date, time) = word.trim().split_once(['T', ' '])?;
    let mut date = date.split(['-', '/']);
    let mut time = time.split(':');
    let calendar = Calendar {
        year: date.next()?.parse().ok()?,
        month: date.next()?.parse().ok()?,
        day: date.next()?.parse().ok()?,
        hour: time.next()?.parse().ok()?,
        minute: time.next()?.parse().ok()?,
        second: time.next()?.parse().ok()?,
    };
    (date.next().is_none() && time.next().is_none()).then_some(calendar)
}

fn numbers(fields: &[&[u8]], [a, b, c]: [usize; 3]) -> Result<[f64; 3], String> {
    Ok([number(fields[a])?, number(fields[b])?, number(fields[c])?])
}

fn text(field: &[u8]) -> Result<&str, String> {
    core::str::from_utf8(field).map(unquoted).map_err(|_| "a field is not text".to_owned())
}

fn number(field: &[u8]) -> Result<f64, String> {
    let word = text(field)?;
    let value: f64 = word.parse().map_err(|_| format!("`{word}` is no number"))?;
    if value.is_finite() { Ok(value) } else { Err(format!("`{word}` is not finite")) }
}

fn unquoted(word: &str) -> &str {
    word.strip_prefix('"').and_then(|word| word.strip_suffix('"')).unwrap_or(word)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fixes(text: &'static str) -> (Result<Vec<PositionFix>, ReadError>, DamageLog) {
        let mut source = Source::new(text.as_bytes(), "t.csv").unwrap();
        let (mut found, mut damage) = (Vec::new(), DamageLog::default());
        let names = ["bow".to_owned(), "stern".to_owned()];
        let result = read(&mut source, &names, &mut damage, |fix| found.push(fix));
        (result.map(|_| found), damage)
    }

    #[test]
    fn the_rows_of_others_are_counted() {
        let text = "gps_week,tow_s,name,x_m,y_m,z_m\n\
                    2200,1,bow,6378137,0,0\n2200,1, mast ,6378137,0,0\n2200,2,mast,6378137,0,0\n";
        let mut source = Source::new(text.as_bytes(), "t.csv").unwrap();
        let others = read(&mut source, &["bow".to_owned()], &mut DamageLog::default(), |_| {});
        assert_eq!(others.unwrap(), BTreeMap::from([("mast".to_owned(), 2)]));
    }

    #[test]
    fn both_kinds_of_time_and_place() {
        let (by_week, damage) = fixes(
            "name,gps_week,tow_s,x_m,y_m,z_m,sd_north_m,sd_east_m,sd_down_m\n\
             stern, 2200,100.5, 6378137.0,0,0, 0.01,0.02,0.03\n\
             mast,2200,100.5,6378137,0,0,1,1,1\n",
        );
        let by_week = by_week.unwrap();
        assert_eq!((by_week.len(), damage.total()), (1, 0));
        assert_eq!(by_week[0].antenna, 1);
        assert_eq!(by_week[0].sd_ned_m, Some([0.01, 0.02, 0.03]));
        // 2022-03-06 is the first day of GPS week 2200; UTC was 18 s behind.
        let (by_date, _) = fixes(
            "time_utc,name,latitude_deg,longitude_deg,height_m,note\r\n\
             2022-03-06T00:01:22.5Z,\"stern\",0,0,0,x\r\n",
        );
        let by_date = by_date.unwrap();
        assert_eq!(by_date[0].time, by_week[0].time);
        assert!((by_date[0].position_m - by_week[0].position_m).norm() < 1e-8);
        assert_eq!(by_date[0].sd_ned_m, None);
    }

    #[test]
    fn times_have_zones() {
        let noon = parse_utc("2024-05-01T12:00:00.5Z").unwrap();
        for same in [
            "2024-05-01 12:00:00.5",
            "2024/05/01 12:00:00.500 UTC",
            "2024-05-01T12:00:00.5+00:00",
            "2024-05-01T14:30:00.5+02:30",
            "2024-05-01 09:00:00.5-0300",
            "2024-05-01T07:00:00.5-05",
        ] {
            assert_eq!(parse_utc(same), Some(noon), "{same}");
        }
        for wrong in
            ["", "2024-05-01", "12:00:00", "2024-05-01T12:00:00+x", "2024-05-01T12:00:00+9", "é"]
        {
            assert_eq!(parse_utc(wrong), None, "{wrong}");
        }
        let (by_gpst, _) =
            fixes("time_gpst,name,x_m,y_m,z_m\n2024-05-01T12:00:18.5,bow,6378137,0,0\n");
        assert_eq!(by_gpst.unwrap()[0].time, noon);
    }

    #[test]
    fn bad_rows_are_noted_and_the_rest_is_read() {
        let (found, damage) = fixes(
            "gps_week,tow_s,name,x_m,y_m,z_m\n\
             2200,1,bow,6378137,0\n\
             2200,1,bow,6378137,zero,0\n\
             2200,700000,bow,6378137,0,0\n\
             2200,1,bow,0,0,0\n\
             2200,1,bow,NaN,0,0\n\
             2200,1,bow,6378137,0,0\n",
        );
        assert_eq!(found.unwrap().len(), 1);
        assert_eq!(damage.total(), 5);
        assert_eq!(damage.listed()[0].line, 2);
    }

    #[test]
    fn wrong_standard_deviations_are_named() {
        let (_, damage) = fixes(
            "gps_week,tow_s,name,x_m,y_m,z_m,sd_north_m,sd_east_m,sd_down_m\n\
             2200,1,bow,6378137,0,0,0.01,-0.5,0.02\n",
        );
        let [damage] = damage.listed() else { panic!("{damage:?}") };
        let what = "standard deviations 0.01, -0.5 and 0.02 are not all positive";
        assert!(damage.what.contains(what), "{}", damage.what);
    }

    /// Standard deviations that are not understood are no reason to assume others.
    #[test]
    fn some_standard_deviations_are_not_enough() {
        for (columns, what) in [
            ("sd_north_m,sd_east_m", "column `sd_down_m` is missing"),
            ("sd_north_m,sd_east_m,sd_height_m", "column `sd_height_m` is no standard deviation"),
        ] {
            let text = format!("gps_week,tow_s,name,x_m,y_m,z_m,{columns}\n");
            let (found, _) = fixes(Box::leak(text.into_boxed_str()));
            let error = found.unwrap_err().to_string();
            assert!(error.contains(what), "{error}");
        }
        let (found, damage) = fixes(
            "gps_week,tow_s,name,x_m,y_m,z_m,sd_north_m,sd_east_m,sd_up_m\n\
             2200,1,bow,6378137,0,0,0.01,0.02,0.03\n\
             2200,2,bow,6378137,0,0,0.01,,0.02\n\
             2200,3,bow,6378137,0,0,,,\n",
        );
        let stated: Vec<_> = found.unwrap().iter().map(|fix| fix.sd_ned_m).collect();
        assert_eq!((stated, damage.total()), (vec![Some([0.01, 0.02, 0.03]), None], 1));
    }

    #[test]
    fn last_digits_are_those_of_the_finest_coordinate() {
        let (found, _) = fixes("gps_week,tow_s,name,x_m,y_m,z_m\n2200,1,bow,6378137.0,0.25,0\n");
        assert_eq!(found.unwrap()[0].last_digit_ned_m, [0.01; 3]);
    }

    /// Line ends of CR alone make one line of the file: it is not repeated whole.
    #[test]
    fn a_file_of_one_line_is_told_in_short() {
        let rows = "2200,1,bow,6378137,0,0\r".repeat(1000);
        let (found, _) = fixes(Box::leak(format!("name,tow_s\r{rows}").into_boxed_str()));
        let error = found.unwrap_err().to_string();
        assert!(error.contains("lines end with CR alone") && error.len() < 400, "{error}");
    }

    #[test]
    fn a_missing_column_is_named() {
        let (found, _) = fixes("name,x_m,y_m,z_m\n");
        assert!(found.unwrap_err().to_string().contains("`gps_week` with `tow_s`"));
        let (found, _) = fixes("gps_week,tow_s,x_m,y_m,z_m\n");
        assert!(found.unwrap_err().to_string().contains("`name`"));
    }
}
