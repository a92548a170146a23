//! The header of a navigation file: ionosphere, time scales, leap seconds.

use core::ops::Range;

use kurs::ephemeris::{Klobuchar, NavigationData, SystemTimeOffset, UtcParameters};
use kurs::signal::System;
use kurs::time::GpsTime;

use super::{Version, record};
use crate::read_summary::ReadSummary;
use crate::rinex::fields::{columns, exponential, integer, label};
use crate::source::{ReadError, Source};

/// Reads up to `END OF HEADER`, or to the first record where that is missing; a line that cannot be
/// read is noted and left out.
pub(super) fn read(
    source: &mut Source,
    version: Version,
    data: &mut NavigationData,
    summary: &mut ReadSummary,
) -> Result<(), ReadError> {
    while source.advance()? {
        let line = source.line();
        let label = label(line);
        let taken = match label {
            b"END OF HEADER" => return Ok(()),
            b"ION ALPHA" => coefficients(line, 2).map(|alpha| gps(data).alpha = alpha),
            b"ION BETA" => coefficients(line, 2).map(|beta| gps(data).beta = beta),
            b"IONOSPHERIC CORR" => ionosphere(line, data),
            b"DELTA-UTC: A0,A1,T,W" => {
                offset_line(*b"GPUT", line, [3..22, 22..41, 41..50, 50..59], data)
            }
            b"TIME SYSTEM CORR" => match columns(line, 0..4).try_into() {
                Ok(code) => offset_line(code, line, [5..22, 22..38, 38..45, 45..50], data),
                Err(_) => None,
            },
            b"LEAP SECONDS" => leap_seconds(line, data),
            b"COMMENT" => Some(()),
            _ if record::begins(line, version) => {
                let what = "the header has no end, records begin here";
                summary.damage.note(source.line_number(), what);
                source.hold_line();
                return Ok(());
            }
            _ => Some(()),
        };
        if taken.is_none() {
            let label = String::from_utf8_lossy(label).into_owned();
            summary.damage.note(source.line_number(), format!("{label}: not a number; left out"));
        }
    }
    summary.damage.note(source.line_number(), "the file ends inside its header");
    Ok(())
}

fn gps(data: &mut NavigationData) -> &mut Klobuchar {
    data.ionosphere.gps.get_or_insert(Klobuchar { alpha: [0.0; 4], beta: [0.0; 4] })
}

/// Four numbers of twelve columns.
fn coefficients(line: &[u8], start: usize) -> Option<[f64; 4]> {
    let mut numbers = [0.0; 4];
    for (i, value) in numbers.iter_mut().enumerate() {
        *value = exponential(columns(line, start + 12 * i..start + 12 * (i + 1)))?;
    }
    Some(numbers)
}

/// RINEX 3: `GPSA`, `GPSB`, `QZSA`, `QZSB`, `BDSA`, `BDSB`, `GAL `.
fn ionosphere(line: &[u8], data: &mut NavigationData) -> Option<()> {
    let numbers = coefficients(line, 5)?;
    let ionosphere = &mut data.ionosphere;
    let model = match columns(line, 0..3) {
        b"GAL" => {
            ionosphere.galileo = Some([numbers[0], numbers[1], numbers[2]]);
            return Some(());
        }
        b"GPS" => &mut ionosphere.gps,
        b"QZS" => &mut ionosphere.qzss,
        b"BDS" => &mut ionosphere.beidou,
        _ => return Some(()),
    };
    let model = model.get_or_insert(Klobuchar { alpha: [0.0; 4], beta: [0.0; 4] });
    match columns(line, 3..4) {
        b"A" => model.alpha = numbers,
        b"B" => model.beta = numbers,
        _ => {}
    }
    Some(())
}

fn leap_seconds(line: &[u8], data: &mut NavigationData) -> Option<()> {
    let count = integer(columns(line, 0..6))?;
    // Some files give the count of BeiDou time, and say so.
    if columns(line, 24..26) != b"BD" {
        data.leap_seconds = Some(count);
    }
    Some(())
}

/// A₀, A₁, second and week of reference in the given columns.
fn offset_line(
    code: [u8; 4],
    line: &[u8],
    fields: [Range<usize>; 4],
    data: &mut NavigationData,
) -> Option<()> {
    let [bias_s, drift, tow_s, week] = fields.map(|field| exponential(columns(line, field)));
    #[allow(clippy::cast_possible_truncation)] // saturates, and a wrong week gives no time
    let reference = GpsTime::from_week_tow(week? as i32, tow_s?).unwrap_or_default();
    time_offset(code, [bias_s?, drift?], reference, data);
    Some(())
}

/// Keeps the offset of two time scales, named by the four letters of RINEX.
pub(super) fn time_offset(
    code: [u8; 4],
    [bias_s, drift]: [f64; 2],
    reference_time: GpsTime,
    data: &mut NavigationData,
) {
    let [a, b, c, d] = code;
    match (scale([a, b]), [c, d]) {
        (Some(system), [b'U', b'T']) => {
            data.utc.push(UtcParameters { system, bias_s, drift, reference_time });
        }
        (Some(minuend), other) => {
            if let Some(subtrahend) = scale(other) {
                data.time_offsets.push(SystemTimeOffset {
                    minuend,
                    subtrahend,
                    bias_s,
                    drift,
                    reference_time,
                });
            }
        }
        (None, _) => {}
    }
}

fn scale(letters: [u8; 2]) -> Option<System> {
    Some(match &letters {
        b"GP" => System::Gps,
        b"GA" => System::Galileo,
        b"BD" => System::BeiDou,
        b"GL" => System::Glonass,
        b"QZ" => System::Qzss,
        b"IR" => System::NavIc,
        b"SB" => System::Sbas,
        _ => return None,
    })
}
