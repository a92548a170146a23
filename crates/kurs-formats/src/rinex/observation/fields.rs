//! The fields of one satellite, put into its observations.

use kurs::observation::{Lock, Observation};

use super::columns::{Column, Quantity};
use crate::damage::DamageLog;
use crate::pending_slips::PendingSlips;
use crate::rinex::fields::{Damaged, columns, f14_3};

/// Width of an observation: F14.3, loss-of-lock digit, strength digit.
pub(super) const FIELD: usize = 16;

/// What a file says in one field of a satellite.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Field {
    /// The number in thousandths; `None` if it is blank.
    pub(super) thousandths: Option<i64>,
    /// The loss-of-lock digit.
    pub(super) indicator: u8,
}

/// Puts the fields of some columns into the observations of one satellite, one for each signal, and
/// counts the fields with a number, zero included.
///
/// A field that is damaged counts as missing; with a phase its loss-of-lock digit is lost too, so
/// the next phase is marked as slipped.
pub(super) fn put_fields(
    columns: &[Column],
    field: impl Fn(usize) -> Result<Field, Damaged>,
    observations: &mut [Observation],
    line_number: u64,
    slips: &mut PendingSlips,
    damage: &mut DamageLog,
) -> u64 {
    let mut filled = 0;
    for (index, column) in columns.iter().enumerate() {
        if column.quantity == Quantity::Other {
            continue;
        }
        let Some(o) = observations.get_mut(column.signal) else { continue };
        let Ok(Field { thousandths, indicator }) = field(index) else {
            if column.quantity == Quantity::Phase {
                slips.mark(o.satellite, o.signal);
            }
            damage.note_with(line_number, || {
                format!("{}: field {} is not an observation, skipped", o.satellite, index + 1)
                    .into()
            });
            continue;
        };
        filled += u64::from(thousandths.is_some());
        // Zero means missing, as blank does. Below 2⁵³ the quotient is the nearest double.
        let number = thousandths.filter(|n| *n != 0).map(|n| n as f64 / column.divisor);
        // Where two columns mean the same (C1 and C2 of BeiDou in RINEX 2) the first one counts.
        match column.quantity {
            Quantity::Pseudorange => o.pseudorange_m = o.pseudorange_m.or(number),
            Quantity::Phase if o.phase_cycles.is_none() => {
                o.phase_cycles = number;
                o.lock = Lock(indicator);
            }
            Quantity::Doppler => o.doppler_hz = o.doppler_hz.or(number),
            Quantity::Strength => o.cn0_dbhz = o.cn0_dbhz.or(number),
            Quantity::Phase | Quantity::Other => {}
        }
    }
    filled
}

/// The fields that a line has, at most as many as there are columns.
pub(super) fn present<'a>(columns: &'a [Column], line: &[u8]) -> &'a [Column] {
    &columns[..columns.len().min(line.len().div_ceil(FIELD))]
}

/// The field `index` of a line, which is blank behind the end of it.
pub(super) fn text_field(line: &[u8], index: usize) -> Result<Field, Damaged> {
    let field = columns(line, index * FIELD..(index + 1) * FIELD);
    let digit_at = |at: usize| field.get(at).map_or(Ok(0), |byte| digit(*byte));
    let (indicator, _strength) = (digit_at(14)?, digit_at(15)?);
    let number = &field[..field.len().min(14)];
    match f14_3(number) {
        Ok(thousandths) => Ok(Field { thousandths, indicator }),
        Err(Damaged) if is_no_number(number) => Ok(Field { thousandths: None, indicator }),
        Err(Damaged) => Err(Damaged),
    }
}

/// Whether a program wrote its word for a missing number.
fn is_no_number(field: &[u8]) -> bool {
    let text = field.trim_ascii();
    let text = text.strip_prefix(b"-").unwrap_or(text);
    [&b"nan"[..], b"inf"].iter().any(|none| text.eq_ignore_ascii_case(none))
}

/// A loss-of-lock or strength digit, blank being zero.
pub(super) fn digit(byte: u8) -> Result<u8, Damaged> {
    match byte {
        b' ' => Ok(0),
        b'0'..=b'9' => Ok(byte - b'0'),
        _ => Err(Damaged),
    }
}

/// Whether a line is nothing but observations, at least one.
pub(super) fn is_observations(line: &[u8]) -> bool {
    let mut numbers = 0;
    for index in 0..line.trim_ascii_end().len().div_ceil(FIELD) {
        let Ok(field) = text_field(line.trim_ascii_end(), index) else { return false };
        numbers += usize::from(field.thousandths.is_some_and(|number| number != 0));
    }
    numbers > 0
}

/// Removes the observations from `base` on that have no content.
pub(super) fn drop_empty(observations: &mut Vec<Observation>, base: usize) {
    let mut kept = base;
    for index in base..observations.len() {
        let o = &observations[index];
        let empty = o.pseudorange_m.is_none()
            && o.phase_cycles.is_none()
            && o.doppler_hz.is_none()
            && o.cn0_dbhz.is_none();
        if !empty {
            observations.swap(kept, index);
            kept += 1;
        }
    }
    observations.truncate(kept);
}
