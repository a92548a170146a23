//! One record of a navigation file: its lines as numbers, and what they mean.

use kurs::ephemeris::{
    Ephemeris, GlonassElements, GlonassEphemeris, IonosphereParameters, KeplerElements,
    KeplerEphemeris, Klobuchar, Message, NavigationData,
};
use kurs::frames::Vector;
use kurs::signal::{Satellite, System};
use kurs::time::{Calendar, GPST_MINUS_BDT_S, GpsTime};

use super::Version;
use super::header::time_offset;

/// Numbers that a record of 9 lines after the epoch line can have; what goes beyond is dropped.
const VALUES_MAX: usize = 40;

/// Range accuracy by the index F_T (GLONASS ICD 5.1, table 4.4); where there is none, 5 m.
const GLONASS_ACCURACY_M: [f64; 15] =
    [1.0, 2.0, 2.5, 4.0, 5.0, 7.0, 10.0, 12.0, 14.0, 16.0, 32.0, 64.0, 128.0, 256.0, 512.0];

/// What a record is about.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) enum Kind {
    /// No record was begun.
    #[default]
    None,
    Ephemeris,
    Ionosphere,
    TimeOffset,
    /// Read past.
    Other,
}

/// A record under construction.
#[derive(Debug, Default)]
pub(super) struct Record {
    pub(super) kind: Kind,
    /// Line of the file where it begins.
    pub(super) line: u64,
    satellite: Option<Satellite>,
    /// Message type of RINEX 4, empty in older files.
    message: String,
    /// First line of RINEX 4 STO records: which time scales.
    offset_code: [u8; 4],
    epoch: Option<Calendar>,
    values: Vec<f64>,
    has_lines: bool,
    /// The first thing that could not be read.
    damage: Option<String>,
}

/// Whether `line` belongs to the record begun before it.
pub(super) fn is_continuation(line: &[u8], version: Version) -> bool {
    line.iter().take(indent(version)).all(|byte| *byte == b' ')
}

/// A number in the notation of FORTRAN; blank is zero, as RINEX says.
pub(super) fn number(field: &[u8]) -> Option<f64> {
    let text = field.trim_ascii();
    if text.is_empty() {
        return Some(0.0);
    }
    let mut digits = [0; 32];
    let digits = digits.get_mut(..text.len())?;
    digits.copy_from_slice(text);
    for digit in digits.iter_mut().filter(|digit| matches!(digit, b'D' | b'd')) {
        *digit = b'E';
    }
    let value: f64 = str::from_utf8(digits).ok()?.parse().ok()?;
    value.is_finite().then_some(value)
}

/// Columns `from..to` of a line, as far as it reaches.
pub(super) fn columns(line: &[u8], from: usize, to: usize) -> &[u8] {
    let to = to.min(line.len());
    line.get(from..to).unwrap_or_default()
}

/// Blanks before the numbers of a continuation line; also the width of the satellite's name.
const fn indent(version: Version) -> usize {
    if version.major == 2 { 3 } else { 4 }
}

impl Record {
    /// Begins with a frame line of RINEX 4: `> EPH G05 LNAV`.
    pub(super) fn begin_frame(&mut self, line: &[u8], number: u64) {
        let text = String::from_utf8_lossy(line);
        let mut words = text.split_ascii_whitespace().skip(1);
        let kind = match words.next() {
            Some("EPH") => Kind::Ephemeris,
            Some("ION") => Kind::Ionosphere,
            Some("STO") => Kind::TimeOffset,
            _ => Kind::Other,
        };
        let satellite = words.next().and_then(|name| name.parse().ok());
        let message = words.next().unwrap_or_default().to_owned();
        *self = Self { kind, line: number, satellite, message, ..Self::default() };
    }

    /// Whether a RINEX 4 frame line was the last line.
    pub(super) fn is_frame_without_lines(&self) -> bool {
        self.kind != Kind::None && !self.has_lines
    }

    /// Begins with an epoch line (RINEX 2 and 3), or takes it as the first line of a frame.
    pub(super) fn begin(&mut self, line: &[u8], number: u64, version: Version) {
        if self.kind == Kind::None {
            self.kind = Kind::Ephemeris;
            self.line = number;
            self.satellite = satellite(columns(line, 0, 3), version.system);
            if self.satellite.is_none() {
                let name = String::from_utf8_lossy(columns(line, 0, 3)).into_owned();
                self.damage = Some(format!("{name:?} is not a satellite"));
            }
        }
        self.has_lines = true;
        let start = indent(version);
        self.epoch = calendar(columns(line, start - 1, start + 19));
        if self.epoch.is_none() && self.damage.is_none() {
            let text = String::from_utf8_lossy(columns(line, start, start + 19)).into_owned();
            self.damage = Some(format!("{text:?} is not a date and time"));
        }
        if self.kind == Kind::TimeOffset {
            let code = columns(line, 24, 28);
            self.offset_code[..code.len()].copy_from_slice(code);
        } else {
            self.take_numbers(line, start + 19, 3);
        }
    }

    /// Takes one more line.
    pub(super) fn continue_with(&mut self, line: &[u8], version: Version) {
        self.take_numbers(line, indent(version), 4);
    }

    fn take_numbers(&mut self, line: &[u8], start: usize, count: usize) {
        for i in 0..count {
            let field = columns(line, start + 19 * i, start + 19 * (i + 1));
            let value = number(field);
            if value.is_none() && self.damage.is_none() {
                let text = String::from_utf8_lossy(field).into_owned();
                self.damage = Some(format!("{text:?} is not a number"));
            }
            if self.values.len() < VALUES_MAX {
                self.values.push(value.unwrap_or(0.0));
            }
        }
    }

    /// System and message, for the count of records that are read past.
    pub(super) fn name(&self) -> String {
        let letter = self.satellite.map_or('?', |satellite| satellite.system.letter());
        match self.message.as_str() {
            "" => letter.to_string(),
            message => format!("{letter} {message}"),
        }
    }

    /// The ephemeris in this record; `None` if its message is read past.
    pub(super) fn ephemeris(&self) -> Result<Option<Ephemeris>, String> {
        let satellite = self.satellite.ok_or_else(|| self.cause("no satellite"))?;
        let Some(message) = self.message_of(satellite) else { return Ok(None) };
        if let Some(damage) = &self.damage {
            return Err(format!("{satellite}: {damage}; the record is left out"));
        }
        let checked = if message == Message::GlonassFdma {
            GlonassEphemeris::new(self.glonass_elements(satellite)?).map(Ephemeris::Glonass)
        } else {
            KeplerEphemeris::new(self.kepler_elements(satellite, message)?).map(Ephemeris::Kepler)
        };
        checked.map(Some).map_err(|error| error.to_string())
    }

    fn cause(&self, otherwise: &str) -> String {
        self.damage.clone().unwrap_or_else(|| otherwise.to_owned())
    }

    /// Which message a record is; `None` for those that are read past.
    fn message_of(&self, satellite: Satellite) -> Option<Message> {
        // Bit 8 of Galileo's data sources: the clock is that of E1 and E5a.
        let is_fnav = || whole(self.value(20)).is_some_and(|sources| sources & 0x100 != 0);
        match (satellite.system, self.message.as_str()) {
            (System::Gps | System::Qzss, "" | "LNAV") => Some(Message::Lnav),
            (System::Galileo, "") if is_fnav() => Some(Message::GalileoFnav),
            (System::Galileo, "" | "INAV") => Some(Message::GalileoInav),
            (System::Galileo, "FNAV") => Some(Message::GalileoFnav),
            (System::BeiDou, "") if satellite.is_beidou_geo() => Some(Message::BeiDouD2),
            (System::BeiDou, "" | "D1") => Some(Message::BeiDouD1),
            (System::BeiDou, "D2") => Some(Message::BeiDouD2),
            (System::Glonass, "" | "FDMA") => Some(Message::GlonassFdma),
            _ => None,
        }
    }

    fn value(&self, index: usize) -> f64 {
        self.values.get(index).copied().unwrap_or(0.0)
    }

    /// RINEX 4.02, tables A5 (GPS), A8 (Galileo), A14 (BeiDou), A11 (QZSS): one layout.
    fn kepler_elements(
        &self,
        satellite: Satellite,
        message: Message,
    ) -> Result<KeplerElements, String> {
        const LINES: usize = 7; // the eighth is cut off in some files
        if self.values.len() < 3 + 4 * (LINES - 1) {
            return Err(format!("{satellite}: the record ends too early and is left out"));
        }
        let v = |index| self.value(index);
        let clock_date = self.epoch.and_then(GpsTime::from_calendar);
        let own_clock = clock_date.ok_or_else(|| format!("{satellite}: date before 1980"))?;
        let own_orbit = own_clock
            .nearest_with_tow(v(11))
            .ok_or_else(|| format!("{satellite}: second of week {}", v(11)))?;
        let own_sent = match self.values.get(27) {
            Some(tow_s) => own_orbit.nearest_with_tow(*tow_s).unwrap_or(own_orbit),
            None => own_orbit,
        };
        let is_beidou = satellite.system == System::BeiDou;
        let to_gpst = |own: GpsTime| if is_beidou { own + GPST_MINUS_BDT_S } else { own };
        let lnav = message == Message::Lnav;
        Ok(KeplerElements {
            satellite,
            message,
            reference_time: to_gpst(own_orbit),
            clock_reference_time: to_gpst(own_clock),
            transmission_time: to_gpst(own_sent),
            issue: whole(v(3)).unwrap_or(0),
            clock_bias_s: v(0),
            clock_drift: v(1),
            clock_drift_rate: v(2),
            sqrt_axis: v(10),
            eccentricity: v(8),
            mean_anomaly_rad: v(6),
            mean_motion_correction_radps: v(5),
            perigee_rad: v(17),
            node_rad: v(13),
            node_rate_radps: v(18),
            inclination_rad: v(15),
            inclination_rate_radps: v(19),
            latitude_harmonics_rad: [v(7), v(9)],
            radius_harmonics_m: [v(16), v(4)],
            inclination_harmonics_rad: [v(12), v(14)],
            group_delays_s: [v(25), if lnav { 0.0 } else { v(26) }],
            health: whole(v(24)).ok_or_else(|| format!("{satellite}: health {}", v(24)))?,
            accuracy_m: v(23),
            fit_interval_s: (lnav && v(28) > 0.0).then(|| v(28) * 3600.0),
        })
    }

    /// RINEX 4.02, table A10; the last line is missing before RINEX 3.05.
    fn glonass_elements(&self, satellite: Satellite) -> Result<GlonassElements, String> {
        const LINES: usize = 4;
        if self.values.len() < 3 + 4 * (LINES - 1) {
            return Err(format!("{satellite}: the record ends too early and is left out"));
        }
        let v = |index| self.value(index);
        let vector_km = |x, y, z| Vector::new(v(x), v(y), v(z)) * 1e3;
        let date = self.epoch.ok_or_else(|| self.cause("no date"))?;
        let reference_time =
            GpsTime::from_utc(date).ok_or_else(|| format!("{satellite}: date before 1980"))?;
        Ok(GlonassElements {
            satellite,
            reference_time,
            transmission_time: reference_time + until_frame_s(date, v(2)),
            clock_bias_s: v(0),
            clock_drift: v(1),
            position_m: vector_km(3, 7, 11),
            velocity_mps: vector_km(4, 8, 12),
            acceleration_mps2: vector_km(5, 9, 13),
            channel: glonass_channel(v(10))
                .ok_or_else(|| format!("{satellite}: frequency channel {}", v(10)))?,
            l2_delay_s: self.values.get(16).copied().filter(|delay_s| delay_s.abs() < 1e-6),
            health: whole(v(6)).ok_or_else(|| format!("{satellite}: health {}", v(6)))?,
            accuracy_m: self.values.get(17).map_or(GLONASS_ACCURACY_M[4], |index| {
                let known = whole(*index).and_then(|i| GLONASS_ACCURACY_M.get(usize::from(i)));
                *known.unwrap_or(&GLONASS_ACCURACY_M[4])
            }),
        })
    }

    /// RINEX 4.02, tables A33 to A35.
    pub(super) fn store_ionosphere(
        &self,
        ionosphere: &mut IonosphereParameters,
    ) -> Result<(), String> {
        if let Some(damage) = &self.damage {
            return Err(format!("ionosphere: {damage}; the record is left out"));
        }
        let system = self.satellite.map(|satellite| satellite.system);
        let v = |index| self.value(index);
        let klobuchar =
            Klobuchar { alpha: [v(0), v(1), v(2), v(3)], beta: [v(4), v(5), v(6), v(7)] };
        match (system, self.message.as_str()) {
            (Some(System::Gps), "LNAV") => ionosphere.gps = Some(klobuchar),
            (Some(System::BeiDou), "D1D2") => ionosphere.beidou = Some(klobuchar),
            (Some(System::Qzss), "LNAV") => ionosphere.qzss = Some(klobuchar),
            (Some(System::Galileo), "IFNV") => ionosphere.galileo = Some([v(0), v(1), v(2)]),
            _ => {}
        }
        Ok(())
    }

    /// RINEX 4.02, table A31.
    pub(super) fn store_time_offset(&self, data: &mut NavigationData) -> Result<(), String> {
        if let Some(damage) = &self.damage {
            return Err(format!("time offset: {damage}; the record is left out"));
        }
        let reference = self.epoch.and_then(GpsTime::from_calendar).unwrap_or_default();
        time_offset(self.offset_code, [self.value(1), self.value(2)], reference, data);
        Ok(())
    }
}

/// Seconds from a UTC date to the nearest time with this second of the day (or week).
fn until_frame_s(date: Calendar, frame_s: f64) -> f64 {
    const DAY_S: f64 = 86_400.0;
    let of_day_s = f64::from(date.hour) * 3600.0 + f64::from(date.minute) * 60.0 + date.second;
    let ahead_s = frame_s - of_day_s;
    if ahead_s.abs() > 8.0 * DAY_S { 0.0 } else { ahead_s - DAY_S * (ahead_s / DAY_S).round() }
}

/// Channels below zero are written as 256 less their size by some programs.
fn glonass_channel(value: f64) -> Option<i8> {
    let in_range = value.fract() == 0.0 && (-128.0..256.0).contains(&value);
    let signed = if value > 127.0 { value - 256.0 } else { value };
    #[allow(clippy::cast_possible_truncation)] // checked above
    in_range.then_some(signed as i8)
}

/// A number that must be a whole one.
fn whole(value: f64) -> Option<u16> {
    let in_range = value.fract() == 0.0 && (0.0..=f64::from(u16::MAX)).contains(&value);
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // checked above
    in_range.then_some(value as u16)
}

/// `"G05"`, `"G 5"`, or in RINEX 2 `" 5"` of the file's system.
fn satellite(field: &[u8], of_file: System) -> Option<Satellite> {
    let (system, digits) = match field.first()? {
        b' ' | b'0'..=b'9' => (of_file, columns(field, 0, 2)),
        letter => (System::from_letter(*letter)?, columns(field, 1, 3)),
    };
    let number = str::from_utf8(digits).ok()?.trim().parse().ok()?;
    (1..=99).contains(&number).then_some(Satellite::new(system, number))
}

/// `yyyy mm dd hh mm ss` or `yy mm dd hh mm ss.s`; two digits are 1980 to 2079.
fn calendar(field: &[u8]) -> Option<Calendar> {
    let mut words = str::from_utf8(field).ok()?.split_ascii_whitespace();
    let year: i32 = words.next()?.parse().ok()?;
    let mut small = || words.next()?.parse::<u8>().ok();
    let (month, day, hour, minute) = (small()?, small()?, small()?, small()?);
    let second = words.next()?.parse().ok()?;
    let year = match year {
        0..80 => 2000 + year,
        80..100 => 1900 + year,
        _ => year,
    };
    Some(Calendar { year, month, day, hour, minute, second })
}
