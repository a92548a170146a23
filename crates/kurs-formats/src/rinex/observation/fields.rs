//! The fields of one satellite, put into its observations.

use kurs::observation::{Lock, Observation};
use kurs::signal::{Satellite, System};

use super::columns::{Column, Quantity};
use super::slips::PendingSlips;
use crate::damage::DamageLog;
use crate::rinex::fields::{Value, f14_3};

/// Width of an observation: F14.3, loss-of-lock digit, strength digit.
pub(super) const FIELD: usize = 16;

/// Reads the columns of one line into the observations of one satellite, one for each signal, and
/// counts the fields with a number, zero included.
///
/// A field that is damaged counts as missing; with a phase its loss-of-lock digit is lost too, so
/// the next phase is marked as slipped.
pub(super) fn read_fields(
    columns: &[Column],
    line: &[u8],
    observations: &mut [Observation],
    line_number: u64,
    slips: &mut PendingSlips,
    damage: &mut DamageLog,
) -> u64 {
    let mut filled = 0;
    for (index, column) in columns.iter().enumerate() {
        let start = index * FIELD;
        if start >= line.len() {
            break;
        }
        if column.quantity == Quantity::Other {
            continue;
        }
        let Some(o) = observations.get_mut(column.signal) else { continue };
        let field = &line[start..line.len().min(start + FIELD)];
        let Ok((value, indicator)) = read_field(field, column.factor) else {
            if column.quantity == Quantity::Phase {
                slips.mark(o.satellite, o.signal);
            }
            damage.note_with(line_number, || {
                format!("{}: field {} is not an observation, skipped", o.satellite, index + 1)
                    .into()
            });
            continue;
        };
        filled += u64::from(value != Value::Blank);
        let number = value.number();
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

/// The field is not an observation.
struct Damaged;

/// Number and loss-of-lock digit of a field.
fn read_field(field: &[u8], factor: f64) -> Result<(Value, u8), Damaged> {
    let digit = |at: usize| match field.get(at) {
        None | Some(b' ') => Ok(0),
        Some(digit @ b'0'..=b'9') => Ok(digit - b'0'),
        Some(_) => Err(Damaged),
    };
    let (indicator, _strength) = (digit(14)?, digit(15)?);
    match f14_3(&field[..field.len().min(14)], factor) {
        Value::Damaged => Err(Damaged),
        value => Ok((value, indicator)),
    }
}

/// Whether a line is nothing but observations, at least one.
pub(super) fn is_observations(line: &[u8]) -> bool {
    let mut numbers = 0;
    for field in line.trim_ascii_end().chunks(FIELD) {
        let Ok((value, _)) = read_field(field, 1.0) else { return false };
        numbers += usize::from(value.number().is_some());
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

/// The satellites that an epoch has had already.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Seen([u128; System::ALL.len()]);

impl Seen {
    /// Whether the satellite comes for the first time.
    pub(super) fn admit(&mut self, satellite: Satellite) -> bool {
        let seen = &mut self.0[satellite.system as usize];
        let bit = 1_u128 << (satellite.number & 127);
        let first = *seen & bit == 0;
        *seen |= bit;
        first
    }
}
