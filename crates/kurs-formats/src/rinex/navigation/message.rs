//! What the numbers of a record mean, by system and message.

use kurs::ephemeris::{
    Ephemeris, GlonassElements, GlonassEphemeris, IonosphereParameters, KeplerElements,
    KeplerEphemeris, Klobuchar, Message, NavigationData,
};
use kurs::frames::Vector;
use kurs::signal::{Satellite, System};
use kurs::time::{Calendar, GPST_MINUS_BDT_S, GpsTime};

use super::header::time_offset;
use super::record::Record;
use crate::damage::DamageLog;

/// Range accuracy by the index F_T (GLONASS ICD 5.1, table 4.4).
const GLONASS_ACCURACY_M: [f64; 15] =
    [1.0, 2.0, 2.5, 4.0, 5.0, 7.0, 10.0, 12.0, 14.0, 16.0, 32.0, 64.0, 128.0, 256.0, 512.0];
/// Where a GLONASS record has no index.
const GLONASS_ACCURACY_UNKNOWN_M: f64 = 5.0;
/// Galileo's data sources, bit 8: the clock is that of E1 and E5a.
const CLOCK_OF_E5A: u16 = 0x100;

/// What an ephemeris does with a number of its record.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Need {
    /// It cannot be without.
    Must,
    /// It can.
    May,
    /// It does not look at it: spare, or of no use here.
    Not,
}

/// Clock and orbit, health, group delay; accuracy, issue, time of transmission and fit interval may
/// be unknown. Sources of the data decide between the messages of Galileo where the record does
/// not.
fn kepler_need(message: Message, index: usize) -> Need {
    let is_galileo = matches!(message, Message::GalileoInav | Message::GalileoFnav);
    match index {
        3 | 27 => Need::May,
        28 if message == Message::Lnav => Need::May,
        0..=19 | 23..=25 => Need::Must,
        20 if is_galileo => Need::Must,
        26 if message != Message::Lnav => Need::Must,
        _ => Need::Not,
    }
}

/// Clock, orbit, health and channel; the delay of L2 and the accuracy may be unknown.
const fn glonass_need(_: Message, index: usize) -> Need {
    match index {
        0..=13 => Need::Must,
        16 | 17 => Need::May,
        _ => Need::Not,
    }
}

/// Whether a number that is needed may be left blank. RINEX lets writers leave out what they do not
/// know: an accuracy, a group delay that QZSS marks as not to be used, of Galileo's F/NAV the delay
/// of E5b, and for GLONASS the time of the frame. Zero is right for them; an orbit, a clock or a
/// health of zero would be another one.
fn may_be_blank(satellite: Satellite, message: Message, index: usize) -> bool {
    match message {
        Message::GlonassFdma => index == 2,
        Message::GalileoFnav if index == 26 => true,
        _ if satellite.system == System::Qzss && index == 25 => true,
        _ => index == 23,
    }
}

impl Record {
    /// The ephemeris in this record; `None` if its message is read past. A number that the
    /// ephemeris can do without is noted, one that means nothing is not looked at.
    pub(super) fn ephemeris(
        &mut self,
        damage: &mut DamageLog,
    ) -> Result<Option<Ephemeris>, String> {
        let Some(satellite) = self.satellite else {
            return Err(self.damage.clone().unwrap_or_else(|| "a record of no satellite".into()));
        };
        let Some(message) = self.ephemeris_message(satellite) else { return Ok(None) };
        self.shed_lines(satellite, message, damage)?;
        let need = if message == Message::GlonassFdma { glonass_need } else { kepler_need };
        let needed = |index: usize| need(message, index);
        let is_must = |index: usize| needed(index) == Need::Must;
        self.refuse_damage(&satellite.to_string(), is_must)?;
        let may_be_blank = |index| may_be_blank(satellite, message, index);
        self.refuse_gaps(&satellite.to_string(), |i| is_must(i) && !may_be_blank(i))?;
        for (_, what) in self.damaged_values.iter().filter(|(i, _)| needed(*i) == Need::May) {
            damage.note_with(self.line, || format!("{satellite}: {what}; taken as unknown").into());
        }
        let checked = if message == Message::GlonassFdma {
            GlonassEphemeris::new(self.glonass(satellite)?).map(Ephemeris::Glonass)
        } else {
            KeplerEphemeris::new(self.kepler(satellite, message)?).map(Ephemeris::Kepler)
        };
        checked.map(Some).map_err(|error| error.to_string())
    }

    /// Refuses a record without satellite or date, or with a damaged number that it needs.
    fn refuse_damage(&self, about: &str, needs: impl Fn(usize) -> bool) -> Result<(), String> {
        let number = self.damaged_values.iter().find(|(index, _)| needs(*index));
        match self.damage.as_ref().or(number.map(|(_, what)| what)) {
            Some(damage) => Err(format!("{about}: {damage}; the record is left out")),
            None => Ok(()),
        }
    }

    /// Refuses a record that lacks a number without which it would be another one.
    fn refuse_gaps(&self, about: &str, needs: impl Fn(usize) -> bool) -> Result<(), String> {
        match self.gaps.iter().find(|gap| needs(gap.index)) {
            Some(gap) => Err(format!("{about}: {gap}; the record is left out")),
            None => Ok(()),
        }
    }

    /// Which message a record is; `None` for those that are read past.
    fn ephemeris_message(&self, satellite: Satellite) -> Option<Message> {
        let is_fnav = || whole(self.value(20)).is_some_and(|sources| sources & CLOCK_OF_E5A != 0);
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

    fn wrong_date(&self, satellite: Satellite) -> String {
        format!("{satellite}: {:?} is not a date since 1980", self.date_text)
    }

    /// The date of the record on a scale that counts days as GPST does.
    fn time(&self, satellite: Satellite) -> Result<GpsTime, String> {
        let time = self.date.and_then(GpsTime::from_calendar);
        time.ok_or_else(|| self.wrong_date(satellite))
    }

    /// Refuses a record with a line too many: its numbers are not where they belong. As many as a
    /// whole record has are one that lost its first line; they are noted and shed.
    fn shed_lines(
        &mut self,
        satellite: Satellite,
        message: Message,
        damage: &mut DamageLog,
    ) -> Result<(), String> {
        // The last line of each is not in all files.
        let most = if message == Message::GlonassFdma { 4 } else { 7 };
        let (least, found) = (most - 1, self.further_lines);
        if found <= most {
            return Ok(());
        }
        let surplus = format!("{satellite}: {} lines, expected {most} or {}", found + 1, most + 1);
        if found < 2 * least {
            return Err(format!("{surplus}; the record is left out"));
        }
        damage.note(self.line, format!("{surplus}; the rest has no satellite and is not read"));
        let own = 3 + 4 * if found == 2 * most { most } else { least };
        self.values.truncate(own);
        self.damaged_values.retain(|(index, _)| *index < own);
        self.gaps.retain(|gap| gap.index < own);
        Ok(())
    }

    /// A record whose last line is missing ends before it, not in it.
    fn refuse_shorter_than(&self, lines: usize, satellite: Satellite) -> Result<(), String> {
        if self.values.len() < 3 + 4 * (lines - 1) {
            return Err(format!("{satellite}: the record ends too early and is left out"));
        }
        Ok(())
    }

    /// RINEX 4.02, tables A5 (GPS), A8 (Galileo), A14 (BeiDou), A11 (QZSS): one layout. The eighth
    /// line (time of transmission) is cut off in some files.
    fn kepler(&self, satellite: Satellite, message: Message) -> Result<KeplerElements, String> {
        self.refuse_shorter_than(7, satellite)?;
        let v = |index| self.value(index);
        let own_clock = self.time(satellite)?;
        let own_orbit = own_clock
            .nearest_with_tow(v(11))
            .ok_or_else(|| format!("{satellite}: second of week {}", v(11)))?;
        let own_sent = self.has(27).then(|| own_orbit.nearest_with_tow(v(27))).flatten();
        let is_beidou = satellite.system == System::BeiDou;
        let to_gpst = |own: GpsTime| if is_beidou { own + GPST_MINUS_BDT_S } else { own };
        let lnav = message == Message::Lnav;
        Ok(KeplerElements {
            satellite,
            message,
            reference_time: to_gpst(own_orbit),
            clock_reference_time: to_gpst(own_clock),
            transmission_time: to_gpst(own_sent.unwrap_or(own_orbit)),
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

    /// RINEX 4.02, table A10; the fifth line is missing before RINEX 3.05.
    fn glonass(&self, satellite: Satellite) -> Result<GlonassElements, String> {
        self.refuse_shorter_than(4, satellite)?;
        let v = |index| self.value(index);
        let vector_km = |x, y, z| Vector::new(v(x), v(y), v(z)) * 1e3;
        let in_utc = |date| Some((date, GpsTime::from_utc(date)?));
        let (date, reference_time) =
            self.date.and_then(in_utc).ok_or_else(|| self.wrong_date(satellite))?;
        let accuracy_index = self.has(17).then(|| whole(v(17))).flatten();
        let accuracy_m =
            accuracy_index.and_then(|index| GLONASS_ACCURACY_M.get(usize::from(index)));
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
            // 0.999999999999e9 stands for unknown.
            l2_delay_s: self.has(16).then(|| v(16)).filter(|delay_s| delay_s.abs() < 1.0),
            health: whole(v(6)).ok_or_else(|| format!("{satellite}: health {}", v(6)))?,
            accuracy_m: *accuracy_m.unwrap_or(&GLONASS_ACCURACY_UNKNOWN_M),
        })
    }

    /// RINEX 4.02, tables A33 to A35. The models of the CNAV family are read past.
    pub(super) fn store_ionosphere(
        &self,
        ionosphere: &mut IonosphereParameters,
    ) -> Result<(), String> {
        self.refuse_damage("ionosphere", |index| index < 8)?;
        let system = self.satellite.map(|satellite| satellite.system);
        let needed = if system == Some(System::Galileo) { 3 } else { 8 };
        self.refuse_gaps("ionosphere", |index| index < needed)?;
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
        self.refuse_damage("time offset", |index| matches!(index, 1 | 2))?;
        self.refuse_gaps("time offset", |index| matches!(index, 1 | 2))?;
        let reference = self.date.and_then(GpsTime::from_calendar).unwrap_or_default();
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
