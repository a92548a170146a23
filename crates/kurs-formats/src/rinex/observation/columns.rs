//! Which column of an observation record belongs to which signal and quantity.

use kurs::observation::{Lock, Observation};
use kurs::signal::{Band, Satellite, Signal, System};

use super::header::{ObservationCode, ObservationHeader};
use crate::rinex::codes;

/// What a column holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Quantity {
    Pseudorange,
    Phase,
    Doppler,
    Strength,
    /// Not an observation of a signal (channel number, ionospheric delay) or an unknown code.
    Other,
}

/// One column of a system's records.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Column {
    /// Index in [`Columns::signals`].
    pub(super) signal: usize,
    pub(super) quantity: Quantity,
    /// What the thousandths in the file are divided by: 1000, times the scale factor of the file.
    pub(super) divisor: f64,
}

/// The columns of one system's observation records.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Columns {
    /// Every signal once, in the order of its first column.
    pub(super) signals: Vec<Signal>,
    pub(super) columns: Vec<Column>,
    /// Codes of observations that the version does not have, so that their meaning is unknown.
    pub(super) unknown: Vec<ObservationCode>,
}

impl Columns {
    /// The columns of `system` as the header declares them; none if it does not.
    pub(super) fn of(system: System, header: &ObservationHeader) -> Self {
        let mut columns = Self::default();
        let codes = header.observation_types.get(&system).map_or(&[][..], Vec::as_slice);
        for &code in codes {
            let meaning = if header.version.major < 3 {
                version_2_meaning(system, code, codes)
            } else {
                version_3_meaning(system, code, header)
            };
            let (quantity, signal) = match meaning {
                Some((quantity, signal)) => (quantity, columns.signal_index(signal)),
                None => {
                    if means_nothing(system, code, codes, header) {
                        columns.unknown.push(code);
                    }
                    (Quantity::Other, 0)
                }
            };
            let divisor = 1000.0 * header.scale_factor(system, code);
            columns.columns.push(Column { signal, quantity, divisor });
        }
        columns
    }

    fn signal_index(&mut self, signal: Signal) -> usize {
        self.signals.iter().position(|known| *known == signal).unwrap_or_else(|| {
            self.signals.push(signal);
            self.signals.len() - 1
        })
    }

    /// An observation without content for each signal.
    pub(super) fn blank(&self, satellite: Satellite) -> impl Iterator<Item = Observation> + '_ {
        self.signals.iter().map(move |&signal| Observation {
            satellite,
            signal,
            pseudorange_m: None,
            phase_cycles: None,
            doppler_hz: None,
            cn0_dbhz: None,
            lock: Lock::default(),
        })
    }
}

/// Whether the format has no such code. A list of RINEX 2 serves all systems, and some of it means
/// nothing for most of them; what means nothing for any system is reported once, with the first.
fn means_nothing(
    system: System,
    code: ObservationCode,
    codes: &[ObservationCode],
    header: &ObservationHeader,
) -> bool {
    let [first, ..] = System::ALL;
    let is_told = header.version.major >= 3
        || system == first
            && System::ALL.iter().all(|system| version_2_meaning(*system, code, codes).is_none());
    is_told && quantity_of(code.0[0]) != Quantity::Other
}

fn quantity_of(letter: u8) -> Quantity {
    match letter {
        b'C' | b'P' => Quantity::Pseudorange,
        b'L' => Quantity::Phase,
        b'D' => Quantity::Doppler,
        b'S' => Quantity::Strength,
        _ => Quantity::Other,
    }
}

/// RINEX 3 and 4: quantity letter, band digit, tracking letter (RINEX 4.02, tables 12 to 18).
fn version_3_meaning(
    system: System,
    code: ObservationCode,
    header: &ObservationHeader,
) -> Option<(Quantity, Signal)> {
    let [letter, digit @ b'1'..=b'9', attribute @ b'A'..=b'Z'] = code.0 else { return None };
    let quantity = quantity_of(letter);
    // B1I is band 2 since RINEX 3.03 and was band 1 in 3.02; B1C (since 3.03) has no I and no Q.
    let b1i = system == System::BeiDou
        && digit == b'1'
        && (matches!(attribute, b'I' | b'Q')
            || attribute == b'X' && header.version.is_before(3, 3));
    let band = Band::new(system, if b1i { 2 } else { digit - b'0' });
    let signal = Signal { band, attribute };
    let known = quantity != Quantity::Other && letter != b'P' && codes::exists(signal);
    known.then_some((quantity, signal))
}

/// RINEX 2: quantity letter and band digit; which code was tracked is known for pseudoranges only.
///
/// A band's phase, Doppler and strength belong to one code, chosen for the whole header: on band 1
/// the C/A code where the file has `C1`, else P; on band 2 P where the file has `P2`, else the
/// civil code. (RINEX 2.11, section 10.1.1; the letters A to D are those of RINEX 2.12.)
fn version_2_meaning(
    system: System,
    code: ObservationCode,
    codes: &[ObservationCode],
) -> Option<(Quantity, Signal)> {
    let [letter, place, b' '] = code.0 else { return None };
    let quantity = quantity_of(letter);
    let has = |name: &[u8; 3]| codes.iter().any(|code| code.0 == *name);
    let precise = if system == System::Glonass { b'P' } else { b'W' };
    let (digit, attribute) = match (system, place) {
        (_, b'A') => (1, b'C'),
        (_, b'B') => (1, b'X'),
        (System::Glonass, b'D') => (2, b'C'),
        (_, b'C') => (2, b'X'),
        (System::Gps | System::Glonass, b'1') => match letter {
            b'C' => (1, b'C'),
            b'P' => (1, precise),
            _ if has(b"C1 ") => (1, b'C'),
            _ => (1, precise),
        },
        (System::Gps | System::Glonass, b'2') => match letter {
            b'C' => (2, b'C'),
            b'P' => (2, precise),
            _ if has(b"P2 ") => (2, precise),
            _ => (2, b'C'),
        },
        (System::Sbas | System::Qzss, b'1') => (1, b'C'),
        (System::BeiDou, b'1' | b'2') => (2, b'I'),
        (System::BeiDou, b'6' | b'7') => (place - b'0', b'I'),
        (_, b'1'..=b'9') => (place - b'0', b'X'),
        _ => return None,
    };
    let signal = Signal::new(system, digit, attribute);
    let has_p_code = matches!(system, System::Gps | System::Glonass);
    let known = quantity != Quantity::Other
        && (letter != b'P' || has_p_code)
        && signal.band.frequency_hz(Some(0)).is_some();
    known.then_some((quantity, signal))
}
