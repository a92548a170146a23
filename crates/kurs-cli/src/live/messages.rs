//! What leaves by the outputs: one message for a row.

use std::sync::Arc;
use std::time::SystemTime;

use kurs::solution::{EpochSolution, Reason, Status};
use kurs::turn_rate::AngleRates;
use kurs_formats::nmea;
use kurs_live::{Encode, RelativeRow, Times, gps_time};
use serde_json::{Map, Value};

use crate::table::{Table, TableFormat};
use crate::tables::{self, ATTITUDE, RELATIVE, TimeColumns};

/// The rows of `attitude.csv`.
pub(super) fn csv(leaves: Leaves) -> Encode {
    Arc::new(move |row, rates, _| line(row, rates, leaves, TableFormat::Csv))
}

/// The columns of `attitude.csv` as JSON lines, with the times of the message and whose it is.
pub(super) fn json_lines(leaves: Leaves, body: &str) -> Encode {
    let body = body.to_owned();
    Arc::new(move |row, rates, times| json_line(row, rates, times, leaves, &body))
}

/// A row as the page gets it: the line of an output of this kind.
pub(super) fn page_line(body: &str) -> Encode {
    let body = body.to_owned();
    Arc::new(move |row, rates, times| json_line(row, rates, times, Leaves::default(), &body))
}

/// Which rows without a fix leave with their angles.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Leaves {
    /// Real-valued ambiguities.
    pub(super) float: bool,
    /// Carried by a gyro.
    pub(super) predicted: bool,
}

impl Leaves {
    fn has(self, row: &EpochSolution) -> bool {
        match (row.status(), row.reason()) {
            (Status::Fixed, _) => true,
            (Status::Float, Some(Reason::Predicted)) => self.predicted,
            (Status::Float, _) => self.float,
            _ => false,
        }
    }
}

/// Another body as one object.
pub(super) fn relative_line(row: &RelativeRow) -> Option<Vec<u8>> {
    let mut table = Table::in_memory(TableFormat::Jsonl, RELATIVE);
    tables::write_relative(&mut table, row).ok()?;
    Some(table.into_text())
}

/// The position as a GGA sentence.
pub(super) fn gga(row: &EpochSolution) -> Option<String> {
    row.position.map(|_| nmea::gga(row))
}

/// The row without angles and rates that are not to leave.
fn line(
    row: &EpochSolution,
    rates: &AngleRates,
    leaves: Leaves,
    format: TableFormat,
) -> Option<Vec<u8>> {
    let leaves = leaves.has(row);
    let rates = if leaves { *rates } else { [None; 3] };
    let mut row = row.clone();
    if !leaves {
        row.outcome = row.outcome.without_unfixed_attitude();
    }
    let mut table = Table::in_memory(format, ATTITUDE);
    tables::write_attitude(&mut table, &TimeColumns::new(row.time), &row, &rates).ok()?;
    Some(table.into_text())
}

/// The row, and whose it is and how old.
fn json_line(
    row: &EpochSolution,
    rates: &AngleRates,
    times: &Times,
    leaves: Leaves,
    body: &str,
) -> Option<Vec<u8>> {
    let mut text = line(row, rates, leaves, TableFormat::Jsonl)?;
    let mut more = Map::new();
    let mut add = |name: &str, value: Value| more.insert(name.to_owned(), value);
    add("body", body.into());
    add("measured_gpst", row.time.calendar().iso(3).into());
    add("last_byte_in_utc", utc(times.last_byte_utc).into());
    add("row_out_utc", utc(times.row_out_utc).into());
    let age_s = gps_time(times.row_out_utc) - row.time;
    add("age_s", rounded(age_s));
    if let Some(station_age_s) = times.station_age_s {
        add("station_age_s", rounded(station_age_s));
    }
    let more = serde_json::to_string(&more).ok()?;
    // `{…}` and a line end become one object with the other.
    text.truncate(text.len().checked_sub(2)?);
    text.push(b',');
    text.extend_from_slice(&more.as_bytes()[1..]);
    text.push(b'\n');
    Some(text)
}

/// Tenths of milliseconds.
fn rounded(seconds: f64) -> Value {
    ((seconds * 1e4).round() / 1e4).into()
}

fn utc(time: SystemTime) -> String {
    format!("{}Z", gps_time(time).utc().iso(6))
}

#[cfg(test)]
mod tests {
    use super::*;
    use kurs::time::GpsTime;
    use std::time::{Duration, Instant, UNIX_EPOCH};

    /// 2026-11-29 00:00:20.5 UTC is 00:00:38.5 GPST.
    #[test]
    fn a_json_line_has_the_row_and_three_times() {
        let time = GpsTime::from_week_tow(2447, 38.25).unwrap();
        let row = EpochSolution::lost(time, Reason::FewAntennas);
        let utc = UNIX_EPOCH + Duration::from_secs(20_786 * 86_400 + 20);
        let times = Times {
            first_byte: Instant::now(),
            last_byte: Instant::now(),
            last_byte_utc: utc + Duration::from_millis(450),
            row_out: Instant::now(),
            row_out_utc: utc + Duration::from_millis(500),
            station_age_s: Some(1.5),
        };
        let text = json_line(&row, &[None; 3], &times, Leaves::default(), "ferry \"Ada\"").unwrap();
        assert!(text.ends_with(b"}\n"));
        let value: Value = serde_json::from_slice(&text).unwrap();
        assert_eq!(value["status"], "lost");
        assert_eq!(value["body"], "ferry \"Ada\"");
        assert_eq!(value["measured_gpst"], "2026-11-29T00:00:38.250");
        assert_eq!(value["last_byte_in_utc"], "2026-11-29T00:00:20.450000Z");
        assert_eq!(value["row_out_utc"], "2026-11-29T00:00:20.500000Z");
        assert_eq!(value["age_s"], 0.25);
        assert_eq!(value["station_age_s"], 1.5);
        assert_eq!(value["heading_deg"], Value::Null);
        assert_eq!(value.as_object().unwrap().len(), ATTITUDE.len() + 6);
    }
}
