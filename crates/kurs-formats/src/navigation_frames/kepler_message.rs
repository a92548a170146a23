//! The elements of a Keplerian message as they are sent: short times, indices, scaled integers.
//!
//! The widths and units of most elements are the same in GPS and QZSS LNAV, Galileo, BeiDou and in
//! the RTCM messages made of them (IS-GPS-200N tables 20-I and 20-III; Galileo OS SIS ICD 2.1,
//! tables 67 to 71; BDS-SIS-ICD-B1I-3.0, tables 5-8 and 5-10).

use kurs::ephemeris::{Ephemeris, KeplerElements, KeplerEphemeris, Message};
use kurs::signal::{Satellite, System};
use kurs::time::{GPST_MINUS_BDT_S, GpsTime};

use crate::fields::{Fields, two_to};

/// π as all the interface documents define it.
#[allow(clippy::approx_constant)] // 0.002 units of the smallest angle
pub(crate) const PI: f64 = 3.141_592_653_589_8;
const HOUR_S: f64 = 3600.0;

/// A message with the short times and indices that it carries.
#[derive(Debug, Clone)]
pub(crate) struct KeplerMessage {
    /// Elements in their units; the times among them are not set.
    pub(crate) elements: KeplerElements,
    /// Week as it is sent, cut to the width of its field.
    pub(crate) week: u64,
    /// tₒₑ, seconds of week of the system's own time.
    pub(crate) orbit_s: f64,
    /// tₒ꜀
    pub(crate) clock_s: f64,
    /// When the frame was sent.
    pub(crate) sent_s: f64,
    /// IODE, IODnav, AODE.
    pub(crate) issue: u64,
    /// IODC, AODC.
    pub(crate) clock_issue: u64,
    /// URA, SISA, URAI.
    pub(crate) accuracy: u64,
    /// As RINEX prints it.
    pub(crate) health: u64,
    /// LNAV: the curve fit is longer than four hours.
    pub(crate) long_fit: u64,
}

/// Widths and units that differ between the systems.
#[derive(Debug, Clone, Copy)]
struct Units {
    harmonic_bits: u32,
    /// The unit of C_uc, C_us, C_ic and C_is is 2 to this power.
    angle_exponent: i32,
    /// The unit of C_rc and C_rs is 2 to this power.
    radius_exponent: i32,
    time_bits: u32,
    time_s: f64,
}

const fn units(system: System) -> Units {
    let (harmonic_bits, angle_exponent, radius_exponent) = match system {
        System::BeiDou => (18, -31, -6),
        _ => (16, -29, -5),
    };
    let (time_bits, time_s) = match system {
        System::Galileo => (14, 60.0),
        System::BeiDou => (17, 8.0),
        _ => (16, 16.0),
    };
    Units { harmonic_bits, angle_exponent, radius_exponent, time_bits, time_s }
}

impl KeplerMessage {
    /// A message to be read into.
    pub(crate) const fn empty(satellite: Satellite, message: Message) -> Self {
        let time = GpsTime::from_nanoseconds(0);
        let elements = KeplerElements {
            satellite,
            message,
            reference_time: time,
            clock_reference_time: time,
            transmission_time: time,
            issue: 0,
            clock_bias_s: 0.0,
            clock_drift: 0.0,
            clock_drift_rate: 0.0,
            sqrt_axis: 0.0,
            eccentricity: 0.0,
            mean_anomaly_rad: 0.0,
            mean_motion_correction_radps: 0.0,
            perigee_rad: 0.0,
            node_rad: 0.0,
            node_rate_radps: 0.0,
            inclination_rad: 0.0,
            inclination_rate_radps: 0.0,
            latitude_harmonics_rad: [0.0; 2],
            radius_harmonics_m: [0.0; 2],
            inclination_harmonics_rad: [0.0; 2],
            group_delays_s: [0.0; 2],
            health: 0,
            accuracy_m: 0.0,
            fit_interval_s: None,
        };
        let (orbit_s, clock_s, sent_s) = (0.0, 0.0, 0.0);
        let (week, issue, clock_issue, accuracy, health, long_fit) = (0, 0, 0, 0, 0, 0);
        Self {
            elements,
            week,
            orbit_s,
            clock_s,
            sent_s,
            issue,
            clock_issue,
            accuracy,
            health,
            long_fit,
        }
    }

    /// The message that says `elements`, as sent at `sent`.
    pub(crate) fn of(elements: &KeplerElements, sent: GpsTime) -> Self {
        let system = elements.satellite.system;
        let orbit = own_time(system, elements.reference_time);
        let clock = own_time(system, elements.clock_reference_time);
        let week = (orbit.week() - week_zero(system)).max(0).unsigned_abs();
        let issue = u64::from(elements.issue);
        Self {
            elements: *elements,
            week: week % (1 << week_bits(system)),
            orbit_s: orbit.tow_s(),
            clock_s: clock.tow_s(),
            sent_s: own_time(system, sent).tow_s().floor(),
            issue,
            clock_issue: issue,
            accuracy: accuracy_index(system, elements.accuracy_m),
            health: u64::from(elements.health),
            long_fit: u64::from(elements.fit_interval_s.is_some_and(|fit_s| fit_s > 4.0 * HOUR_S)),
        }
    }

    /// The ephemeris, its times being those next to `near`; the error says what is out of range.
    pub(crate) fn ephemeris(self, near: GpsTime) -> Result<Ephemeris, String> {
        let satellite = self.elements.satellite;
        let system = satellite.system;
        let base = own_time(system, near);
        let wrong =
            |what: &str, value: f64| format!("{satellite}: {what} at {value} s of the week");
        let orbit = base.nearest_with_tow(self.orbit_s);
        let orbit = orbit.ok_or_else(|| wrong("reference time", self.orbit_s))?;
        let clock = orbit.nearest_with_tow(self.clock_s);
        let clock = clock.ok_or_else(|| wrong("clock reference time", self.clock_s))?;
        let sent = orbit.nearest_with_tow(self.sent_s).unwrap_or(orbit);
        let gpst = |own: GpsTime| own + (near - base);
        let lnav = self.elements.message == Message::Lnav;
        let fit_s = if self.long_fit == 0 { 4.0 * HOUR_S } else { 6.0 * HOUR_S };
        let elements = KeplerElements {
            reference_time: gpst(orbit),
            clock_reference_time: gpst(clock),
            transmission_time: gpst(sent),
            issue: u16::try_from(self.issue).unwrap_or(u16::MAX),
            health: u16::try_from(self.health).unwrap_or(u16::MAX),
            accuracy_m: accuracy_m(system, self.accuracy),
            fit_interval_s: lnav.then_some(fit_s),
            ..self.elements
        };
        let checked = KeplerEphemeris::new(elements).map_err(|error| error.to_string())?;
        Ok(Ephemeris::Kepler(checked))
    }

    /// The instant of the reference time by the week that was sent, cut as it is: the week next to
    /// `near` that has those last bits.
    pub(crate) fn date(&self, near: GpsTime) -> Option<GpsTime> {
        let system = self.elements.satellite.system;
        let period = 1i64 << week_bits(system);
        let sent = i64::try_from(self.week).ok()? + week_zero(system);
        let expected = own_time(system, near).week();
        let periods = (expected - sent + period / 2).div_euclid(period);
        let week = i32::try_from(sent + periods * period).ok()?;
        let own = GpsTime::from_week_tow(week, self.orbit_s)?;
        Some(own + (near - own_time(system, near)))
    }

    /// Sets when it was sent, for messages that do not say it.
    pub(crate) fn set_sent(&mut self, time: GpsTime) {
        self.sent_s = own_time(self.elements.satellite.system, time).tow_s().floor();
    }

    pub(crate) fn orbit_time(&mut self, f: &mut impl Fields) {
        let units = units(self.elements.satellite.system);
        f.time(units.time_bits, units.time_s, &mut self.orbit_s);
    }

    pub(crate) fn clock_time(&mut self, f: &mut impl Fields) {
        let units = units(self.elements.satellite.system);
        f.time(units.time_bits, units.time_s, &mut self.clock_s);
    }

    pub(crate) fn mean_anomaly(&mut self, f: &mut impl Fields) {
        angle(f, &mut self.elements.mean_anomaly_rad);
    }

    pub(crate) fn node(&mut self, f: &mut impl Fields) {
        angle(f, &mut self.elements.node_rad);
    }

    pub(crate) fn inclination(&mut self, f: &mut impl Fields) {
        angle(f, &mut self.elements.inclination_rad);
    }

    pub(crate) fn perigee(&mut self, f: &mut impl Fields) {
        angle(f, &mut self.elements.perigee_rad);
    }

    pub(crate) fn mean_motion_correction(&mut self, f: &mut impl Fields) {
        f.scaled(16, PI * two_to(-43), &mut self.elements.mean_motion_correction_radps);
    }

    pub(crate) fn node_rate(&mut self, f: &mut impl Fields) {
        f.scaled(24, PI * two_to(-43), &mut self.elements.node_rate_radps);
    }

    pub(crate) fn inclination_rate(&mut self, f: &mut impl Fields) {
        f.scaled(14, PI * two_to(-43), &mut self.elements.inclination_rate_radps);
    }

    pub(crate) fn eccentricity(&mut self, f: &mut impl Fields) {
        f.scaled_unsigned(32, two_to(-33), &mut self.elements.eccentricity);
    }

    pub(crate) fn sqrt_axis(&mut self, f: &mut impl Fields) {
        f.scaled_unsigned(32, two_to(-19), &mut self.elements.sqrt_axis);
    }

    /// C_uc (0) or C_us (1).
    pub(crate) fn latitude_harmonic(&mut self, f: &mut impl Fields, which: usize) {
        let units = units(self.elements.satellite.system);
        let value = &mut self.elements.latitude_harmonics_rad[which];
        f.scaled(units.harmonic_bits, two_to(units.angle_exponent), value);
    }

    /// C_ic (0) or C_is (1).
    pub(crate) fn inclination_harmonic(&mut self, f: &mut impl Fields, which: usize) {
        let units = units(self.elements.satellite.system);
        let value = &mut self.elements.inclination_harmonics_rad[which];
        f.scaled(units.harmonic_bits, two_to(units.angle_exponent), value);
    }

    /// C_rc (0) or C_rs (1).
    pub(crate) fn radius_harmonic(&mut self, f: &mut impl Fields, which: usize) {
        let units = units(self.elements.satellite.system);
        let value = &mut self.elements.radius_harmonics_m[which];
        f.scaled(units.harmonic_bits, two_to(units.radius_exponent), value);
    }

    /// a_f2, a_f1, a_f0 with the widths and exponents of the system.
    pub(crate) fn clock_coefficient(&mut self, f: &mut impl Fields, which: usize) {
        let widths = match self.elements.satellite.system {
            System::Galileo => [(31, -34), (21, -46), (6, -59)],
            System::BeiDou => [(24, -33), (22, -50), (11, -66)],
            _ => [(22, -31), (16, -43), (8, -55)],
        };
        let (width, exponent) = widths[which];
        let e = &mut self.elements;
        let value = [&mut e.clock_bias_s, &mut e.clock_drift, &mut e.clock_drift_rate];
        if let Some(value) = value.into_iter().nth(which) {
            f.scaled(width, two_to(exponent), value);
        }
    }

    /// TGD; BGD E5a (0) and E5b (1); TGD1 (0) and TGD2 (1).
    pub(crate) fn group_delay(&mut self, f: &mut impl Fields, which: usize) {
        let (width, unit_s) = match self.elements.satellite.system {
            System::Galileo => (10, two_to(-32)),
            System::BeiDou => (10, 1e-10),
            _ => (8, two_to(-31)),
        };
        f.scaled(width, unit_s, &mut self.elements.group_delays_s[which]);
    }
}

fn angle(f: &mut impl Fields, value_rad: &mut f64) {
    // A whole turn of 2^32 units: angles of other programs may be beyond half a turn.
    let turns = *value_rad / (2.0 * PI);
    *value_rad -= 2.0 * PI * (turns + 0.5).floor();
    f.scaled(32, PI * two_to(-31), value_rad);
}

/// The time of the system, written on the scale of days and weeks of GPS.
fn own_time(system: System, gpst: GpsTime) -> GpsTime {
    if system == System::BeiDou { gpst + -GPST_MINUS_BDT_S } else { gpst }
}

/// Week 0 of the system in weeks of GPS.
const fn week_zero(system: System) -> i64 {
    match system {
        System::Galileo => 1024,
        System::BeiDou => 1356,
        _ => 0,
    }
}

/// Bits of the week number.
pub(crate) const fn week_bits(system: System) -> u32 {
    match system {
        System::Galileo => 12,
        System::BeiDou => 13,
        _ => 10,
    }
}

/// Range accuracy of an index, m; negative where none is predicted.
///
/// IS-GPS-200N 20.3.3.3.1.3 and BDS-SIS-ICD-B1I-3.0 5.2.4.5 (nominal values); Galileo OS SIS ICD
/// 2.1, table 89.
fn accuracy_m(system: System, index: u64) -> f64 {
    const NONE_M: f64 = -1.0;
    let n = index as f64;
    if system == System::Galileo {
        return match index {
            0..50 => 0.01 * n,
            50..75 => 0.5 + 0.02 * (n - 50.0),
            75..100 => 1.0 + 0.04 * (n - 75.0),
            100..=125 => 2.0 + 0.16 * (n - 100.0),
            _ => NONE_M,
        };
    }
    match index {
        0..=6 => (10.0 * 2f64.powf(1.0 + n / 2.0)).round() / 10.0,
        7..15 => 2f64.powf(n - 2.0),
        _ => NONE_M,
    }
}

/// The first index that promises no more than `accuracy`.
fn accuracy_index(system: System, accuracy: f64) -> u64 {
    let last = if system == System::Galileo { 255 } else { 15 };
    let enough = |index: &u64| accuracy > 0.0 && accuracy_m(system, *index) >= accuracy - 1e-9;
    (0..last).find(enough).unwrap_or(last)
}
