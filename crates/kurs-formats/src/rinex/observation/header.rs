//! The header of an observation file, and the header records that events bring in mid-file.

use core::fmt;
use std::collections::BTreeMap;

use kurs::frames::{Ecef, Vector};
use kurs::observation::{Lock, Observation};
use kurs::signal::{Band, Satellite, Signal, System};
use kurs::time::{Calendar, GPST_MINUS_BDT_S, GpsTime};

use super::type_list::TypeList;
use crate::damage::DamageLog;
use crate::rinex::fields::{columns, decimal, integer, label, small_integer, text};

/// Version of a RINEX file; 2.1 is written 2.10.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
pub struct Version {
    /// Before the point.
    pub major: u8,
    /// Two digits after the point.
    pub minor: u8,
}

/// The time scale of the epochs in a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum TimeSystem {
    /// GPS time, and the scales kept equal to it: Galileo, QZSS and NavIC time.
    #[default]
    Gps,
    /// GLONASS time as RINEX writes it: UTC.
    Utc,
    /// BeiDou time, 14 s behind GPS time.
    BeiDou,
}

/// Name of a column: `C1C` in RINEX 3 and 4, `C1` and a blank in RINEX 2.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct ObservationCode(pub [u8; 3]);

/// The numbers of these columns are multiplied by `factor` in the file.
#[derive(Debug, Clone, PartialEq)]
pub struct ScaleFactor {
    /// System it is for.
    pub system: System,
    /// 1, 10, 100 or 1000.
    pub factor: f64,
    /// Its columns; all of the system if empty.
    pub codes: Vec<ObservationCode>,
}

/// Correction that the writer applied to align a carrier phase with its band's reference signal.
#[derive(Debug, Clone, PartialEq)]
pub struct PhaseShift {
    /// The signal.
    pub signal: Signal,
    /// Already added to the phases in the file, cycles; `None` if the file does not know it.
    pub correction_cycles: Option<f64>,
    /// Satellites it is for; all of the system if empty.
    pub satellites: Vec<Satellite>,
}

/// What the header says, kept up to date by the header records of events.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ObservationHeader {
    /// Version of the format.
    pub version: Version,
    /// The only system in the file; `None` for a mixed one.
    pub system: Option<System>,
    /// Marker (station) name.
    pub marker_name: String,
    /// Marker number (DOMES).
    pub marker_number: String,
    /// Marker type, for example `GEODETIC`.
    pub marker_type: String,
    /// Receiver serial number.
    pub receiver_number: String,
    /// Receiver type.
    pub receiver_type: String,
    /// Receiver firmware.
    pub receiver_version: String,
    /// Antenna serial number.
    pub antenna_number: String,
    /// Antenna type with radome, for example `ASH701945E_M    NONE`.
    pub antenna_type: String,
    /// Approximate position of the marker, m; zeros in the file are `None`.
    pub approximate_position_m: Option<Vector<Ecef>>,
    /// Antenna reference point relative to the marker: height, east, north, m.
    pub antenna_delta_hen_m: [f64; 3],
    /// Interval of the epochs, s.
    pub interval_s: Option<f64>,
    /// Time scale of the file; every time that leaves the reader is on the GPS scale.
    pub time_system: TimeSystem,
    /// First epoch as declared.
    pub first_epoch: Option<GpsTime>,
    /// Last epoch as declared.
    pub last_epoch: Option<GpsTime>,
    /// The columns of each system's records.
    pub observation_types: BTreeMap<System, Vec<ObservationCode>>,
    /// Scale factors, the latest last.
    pub scale_factors: Vec<ScaleFactor>,
    /// Phase alignment.
    pub phase_shifts: Vec<PhaseShift>,
    /// GLONASS frequency channel of each orbital slot.
    pub glonass_channels: BTreeMap<u8, i8>,
    /// GLONASS code-phase biases that the writer applied, m.
    pub glonass_biases_m: Vec<(Signal, f64)>,
    /// Whether epochs, codes and phases are corrected for the receiver clock offset.
    pub clock_offset_applied: bool,
    /// GPST − UTC as declared, s.
    pub leap_seconds: Option<i32>,
    /// Unit of the `S` observations, for example `DBHZ`.
    pub signal_strength_unit: String,
    /// RINEX 2: 2 where the phases of band 1 and 2 are ambiguous by half cycles (squaring).
    pub wavelength_factors: [u8; 2],
    /// The same for single satellites.
    pub satellite_wavelength_factors: BTreeMap<Satellite, [u8; 2]>,
}

impl Version {
    /// Whether this is older than `major`.`minor`.
    #[must_use]
    pub fn is_before(self, major: u8, minor: u8) -> bool {
        self < Self { major, minor }
    }

    /// From columns such as `     2.11` or `     3`.
    pub(crate) fn parse(field: &[u8]) -> Option<Self> {
        let field = field.trim_ascii();
        let point = field.iter().position(|byte| *byte == b'.').unwrap_or(field.len());
        let minor = match &field[(point + 1).min(field.len())..] {
            [] => 0,
            [tenths] => small_integer(&[*tenths])? * 10,
            [tenths, hundredths, ..] => small_integer(&[*tenths, *hundredths])?,
        };
        Some(Self { major: small_integer(&field[..point])?, minor })
    }
}

impl fmt::Display for Version {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}.{:02}", self.major, self.minor)
    }
}

impl fmt::Display for ObservationCode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(String::from_utf8_lossy(&self.0).trim_end())
    }
}

impl TimeSystem {
    /// From the three letters of `TIME OF FIRST OBS`.
    fn named(name: &[u8]) -> Option<Self> {
        match name {
            b"GPS" | b"GAL" | b"QZS" | b"IRN" => Some(Self::Gps),
            b"GLO" | b"UTC" => Some(Self::Utc),
            b"BDT" | b"BDS" => Some(Self::BeiDou),
            _ => None,
        }
    }

    /// What a file of one system uses unless it says otherwise.
    const fn of(system: Option<System>) -> Self {
        match system {
            Some(System::Glonass) => Self::Utc,
            Some(System::BeiDou) => Self::BeiDou,
            _ => Self::Gps,
        }
    }

    /// The instant that a date in this scale means; `None` if there is no such date.
    #[must_use]
    pub fn instant(self, date: Calendar) -> Option<GpsTime> {
        match self {
            Self::Gps => GpsTime::from_calendar(date),
            Self::Utc => GpsTime::from_utc(date),
            Self::BeiDou => Some(GpsTime::from_calendar(date)? + GPST_MINUS_BDT_S),
        }
    }
}

impl ObservationHeader {
    /// The header of a file of which only the first record is known.
    pub(super) fn new(version: Version, system: Option<System>) -> Self {
        Self { version, system, time_system: TimeSystem::of(system), ..Self::default() }
    }

    /// The factor that the numbers of a column were multiplied with.
    pub(super) fn scale_factor(&self, system: System, code: ObservationCode) -> f64 {
        let latest = self.scale_factors.iter().rev().find(|scale| {
            scale.system == system && (scale.codes.is_empty() || scale.codes.contains(&code))
        });
        latest.map_or(1.0, |scale| scale.factor)
    }

    /// In half-cycle data (RINEX 2) the digit marks the phases whose ambiguity is a whole cycle.
    pub(super) fn apply_wavelength_factors(&self, observations: &mut [Observation]) {
        let factors = &self.satellite_wavelength_factors;
        let any = self.wavelength_factors.contains(&2) || !factors.is_empty();
        if self.version.major >= 3 || !any {
            return;
        }
        for o in observations.iter_mut().filter(|o| o.phase_cycles.is_some()) {
            if self.is_half_wavelength(o.satellite, o.signal.band) {
                o.lock.0 ^= Lock::HALF_CYCLE;
            }
        }
    }

    /// Whether the phases of this satellite and band are ambiguous by half cycles (RINEX 2).
    fn is_half_wavelength(&self, satellite: Satellite, band: Band) -> bool {
        let own = self.satellite_wavelength_factors.get(&satellite);
        let factors = own.unwrap_or(&self.wavelength_factors);
        matches!((band.digit, factors), (1, [2, _]) | (2, [_, 2]))
    }

    /// The system that a blank system letter means.
    pub(super) fn default_system(&self) -> System {
        self.system.unwrap_or(System::Gps)
    }
}

/// Reads header records one after the other into a header.
///
/// Lists that begin anew replace the list before: the records of an event are read with a new
/// `HeaderRecords` into the header that is in force.
#[derive(Debug, Default)]
pub(super) struct HeaderRecords {
    types: Option<TypeList>,
    scale_of: Option<usize>,
    shift_of: Option<usize>,
    biases_begun: bool,
}

/// Codes of a scale factor that are kept; the header of a sane file stays far below.
const CODES_MAX: usize = 200;
/// Scale factors and phase shifts that are kept, events without end notwithstanding.
const RECORDS_MAX: usize = 1000;

impl HeaderRecords {
    /// Reads one record; unknown labels and comments are passed over.
    pub(super) fn read(
        &mut self,
        header: &mut ObservationHeader,
        line: &[u8],
        line_number: u64,
        damage: &mut DamageLog,
    ) {
        let understood = match label(line) {
            b"MARKER NAME" => set(&mut header.marker_name, text(line, 0..60)),
            b"MARKER NUMBER" => set(&mut header.marker_number, text(line, 0..20)),
            b"MARKER TYPE" => set(&mut header.marker_type, text(line, 0..20)),
            b"REC # / TYPE / VERS" => {
                header.receiver_number = text(line, 0..20);
                header.receiver_type = text(line, 20..40);
                set(&mut header.receiver_version, text(line, 40..60))
            }
            b"ANT # / TYPE" => {
                header.antenna_number = text(line, 0..20);
                set(&mut header.antenna_type, text(line, 20..40))
            }
            b"APPROX POSITION XYZ" => three(line).map(|[x, y, z]| {
                let known = (x, y, z) != (0.0, 0.0, 0.0);
                header.approximate_position_m = known.then(|| Vector::new(x, y, z));
            }),
            b"ANTENNA: DELTA H/E/N" => three(line).map(|delta| header.antenna_delta_hen_m = delta),
            b"INTERVAL" => {
                decimal(columns(line, 0..10)).map(|s| header.interval_s = (s > 0.0).then_some(s))
            }
            b"TIME OF FIRST OBS" => self.first_epoch(header, line),
            b"TIME OF LAST OBS" => {
                calendar(line).map(|date| header.last_epoch = header.time_system.instant(date))
            }
            b"# / TYPES OF OBSERV" => self.types_2(header, line, line_number, damage),
            b"WAVELENGTH FACT L1/2" => wavelength_factors(header, line),
            b"SYS / # / OBS TYPES" => self.types_3(header, line, line_number, damage),
            b"SYS / SCALE FACTOR" => self.scale(header, line),
            b"SYS / PHASE SHIFT" | b"SYS / PHASE SHIFTS" => self.phase_shift(header, line),
            b"GLONASS SLOT / FRQ #" => slots(header, line),
            b"GLONASS COD/PHS/BIS" | b"GLONASS COD/PHS/BIS#" => self.biases(header, line),
            b"RCV CLOCK OFFS APPL" => {
                integer(columns(line, 0..6)).map(|flag| header.clock_offset_applied = flag == 1)
            }
            b"LEAP SECONDS" => {
                integer(columns(line, 0..6)).map(|seconds| header.leap_seconds = Some(seconds))
            }
            b"SIGNAL STRENGTH UNIT" => set(&mut header.signal_strength_unit, text(line, 0..20)),
            _ => Some(()),
        };
        if understood.is_none() {
            damage.note_with(line_number, || {
                format!("header record {:?} not understood, skipped", text(line, 60..80)).into()
            });
        }
    }

    fn first_epoch(&self, header: &mut ObservationHeader, line: &[u8]) -> Option<()> {
        let named = columns(line, 48..51).trim_ascii();
        header.time_system = match named {
            b"" => TimeSystem::of(header.system),
            named => TimeSystem::named(named)?,
        };
        header.first_epoch = Some(header.time_system.instant(calendar(line)?)?);
        Some(())
    }

    /// Ends the list of types that is open: now it should have all its names.
    pub(super) fn end_types(&mut self, damage: &mut DamageLog) {
        if let Some(list) = self.types.take() {
            list.note_count(damage);
        }
    }

    /// `I6,9(4X,A2)`; the number is blank on continuation lines. One list for all systems.
    fn types_2(
        &mut self,
        header: &mut ObservationHeader,
        line: &[u8],
        line_number: u64,
        damage: &mut DamageLog,
    ) -> Option<()> {
        const NAMES: usize = 9;
        let declared = columns(line, 0..6);
        if self.types.is_none() || !declared.trim_ascii().is_empty() {
            self.end_types(damage);
            self.types = Some(TypeList::begin(line_number, None, declared, NAMES));
        }
        let list = self.types.as_mut()?;
        list.take((0..NAMES).map(|place| match *columns(line, 10 + 6 * place..12 + 6 * place) {
            [b' ', b' '] => None,
            [quantity, band] => Some(ObservationCode([quantity, band, b' '])),
            _ => None,
        }));
        header.observation_types = System::ALL.map(|system| (system, list.columns())).into();
        Some(())
    }

    /// `A1,2X,I3,13(1X,A3)`; system and number are blank on continuation lines.
    fn types_3(
        &mut self,
        header: &mut ObservationHeader,
        line: &[u8],
        line_number: u64,
        damage: &mut DamageLog,
    ) -> Option<()> {
        const NAMES: usize = 13;
        let letter = line.first().copied().unwrap_or(b' ');
        if letter != b' ' {
            self.end_types(damage);
            let system = Some(System::from_letter(letter)?);
            self.types = Some(TypeList::begin(line_number, system, columns(line, 3..6), NAMES));
        }
        let list = self.types.as_mut()?;
        list.take(places(line, 7, NAMES));
        header.observation_types.insert(list.system?, list.columns());
        Some(())
    }

    /// `A1,1X,I4,2X,I2,12(1X,A3)`; no list means all columns of the system.
    fn scale(&mut self, header: &mut ObservationHeader, line: &[u8]) -> Option<()> {
        let letter = line.first().copied().unwrap_or(b' ');
        if letter != b' ' {
            self.scale_of = None;
            let system = System::from_letter(letter)?;
            let factor = integer(columns(line, 2..6))?;
            if !matches!(factor, 1 | 10 | 100 | 1000) {
                return None;
            }
            if header.scale_factors.len() == RECORDS_MAX {
                return None;
            }
            self.scale_of = Some(header.scale_factors.len());
            let factor = f64::from(factor);
            header.scale_factors.push(ScaleFactor { system, factor, codes: Vec::new() });
        }
        let scale = header.scale_factors.get_mut(self.scale_of?)?;
        if scale.codes.len() < CODES_MAX {
            scale.codes.extend(places(line, 11, 12).flatten());
        }
        Some(())
    }

    /// `A1,1X,A3,1X,F8.5,2X,I2.2,10(1X,A3)`; the quantity is left out by some programs. What cannot
    /// be read is passed over, because the record changes nothing.
    fn phase_shift(&mut self, header: &mut ObservationHeader, line: &[u8]) -> Option<()> {
        let letter = line.first().copied().unwrap_or(b' ');
        if letter != b' ' {
            self.shift_of = None;
            let (
                Some(system),
                &([b'L', digit @ b'1'..=b'9', attribute]
                | [b' ', digit @ b'1'..=b'9', attribute]
                | [digit @ b'1'..=b'9', attribute, b' ']),
            ) = (System::from_letter(letter), columns(line, 2..5))
            else {
                return Some(());
            };
            let signal = Signal::new(system, digit - b'0', attribute);
            let correction_cycles = decimal(columns(line, 6..14));
            if header.phase_shifts.len() == RECORDS_MAX {
                return None;
            }
            self.shift_of = Some(header.phase_shifts.len());
            let shift = PhaseShift { signal, correction_cycles, satellites: Vec::new() };
            header.phase_shifts.push(shift);
        }
        let Some(index) = self.shift_of else { return Some(()) };
        let shift = header.phase_shifts.get_mut(index)?;
        if shift.satellites.len() < RECORDS_MAX {
            let names = (0..10).map(|place| columns(line, 19 + 4 * place..22 + 4 * place));
            shift.satellites.extend(names.filter_map(satellite));
        }
        Some(())
    }

    /// `4(1X,A3,1X,F8.3)`; a second record of the same header continues the list.
    fn biases(&mut self, header: &mut ObservationHeader, line: &[u8]) -> Option<()> {
        if !core::mem::replace(&mut self.biases_begun, true) {
            header.glonass_biases_m.clear();
        }
        if header.glonass_biases_m.len() >= RECORDS_MAX {
            return None;
        }
        for place in 0..4 {
            let at = 13 * place;
            let &[b'C', digit @ b'1'..=b'9', attribute] = columns(line, at + 1..at + 4) else {
                continue;
            };
            let signal = Signal::new(System::Glonass, digit - b'0', attribute);
            header
                .glonass_biases_m
                .extend(decimal(columns(line, at + 5..at + 13)).map(|m| (signal, m)));
        }
        Some(())
    }
}

fn set(field: &mut String, value: String) -> Option<()> {
    *field = value;
    Some(())
}

/// Three numbers of 14 columns.
fn three(line: &[u8]) -> Option<[f64; 3]> {
    let number = |at: usize| decimal(columns(line, at..at + 14));
    Some([number(0)?, number(14)?, number(28)?])
}

/// `5I6,F13.7`.
fn calendar(line: &[u8]) -> Option<Calendar> {
    let part = |at: usize| small_integer(columns(line, at..at + 6));
    Some(Calendar {
        year: integer(columns(line, 0..6))?,
        month: part(6)?,
        day: part(12)?,
        hour: part(18)?,
        minute: part(24)?,
        second: decimal(columns(line, 30..43))?,
    })
}

/// Codes of three characters, each after a blank; `None` where none stands.
fn places(
    line: &[u8],
    start: usize,
    count: usize,
) -> impl Iterator<Item = Option<ObservationCode>> + '_ {
    (0..count).map(move |place| {
        let at = start + 4 * place;
        let name = <[u8; 3]>::try_from(columns(line, at..at + 3)).ok()?;
        (name != [b' '; 3]).then_some(ObservationCode(name))
    })
}

/// `3I6,7(3X,A1,I2)`: factors of band 1 and 2, number of satellites, satellites; for all if none.
fn wavelength_factors(header: &mut ObservationHeader, line: &[u8]) -> Option<()> {
    let factor = |at: usize| match columns(line, at..at + 6).trim_ascii() {
        b"" => Some(0),
        field => small_integer(field),
    };
    let factors = [factor(0)?, factor(6)?];
    if factor(12)? == 0 {
        header.wavelength_factors = factors;
        return Some(());
    }
    for place in 0..7 {
        let name = columns(line, 18 + 6 * place + 3..18 + 6 * place + 6);
        let named = match *name {
            [b' ', tens, units] => {
                satellite(&[header.default_system().letter() as u8, tens, units])
            }
            _ => satellite(name),
        };
        header.satellite_wavelength_factors.extend(named.map(|satellite| (satellite, factors)));
    }
    Some(())
}

/// `I3,8(1X,A1,I2,1X,I2)`: the frequency channels of GLONASS slots.
fn slots(header: &mut ObservationHeader, line: &[u8]) -> Option<()> {
    for place in 0..8 {
        let at = 4 + 7 * place;
        if columns(line, at..at + 7).trim_ascii().is_empty() {
            continue;
        }
        let satellite = satellite(columns(line, at..at + 3))?;
        let channel = i8::try_from(integer(columns(line, at + 4..at + 6))?).ok()?;
        if satellite.system == System::Glonass && (-7..=13).contains(&channel) {
            header.glonass_channels.insert(satellite.number, channel);
        }
    }
    Some(())
}

/// `A1,I2` with a known system letter and a number above zero.
pub(super) fn satellite(name: &[u8]) -> Option<Satellite> {
    let &[letter, ref number @ ..] = name else { return None };
    let system = System::from_letter(letter)?;
    let number = small_integer(number).filter(|number| (1..=99).contains(number))?;
    Some(Satellite { system, number })
}
