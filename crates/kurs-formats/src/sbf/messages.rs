//! Decoded navigation messages: GPSNav, QZSNav, GALNav, BDSNav, GLONav.
//!
//! Source: reference guide, 4.2.3 to 4.2.7. Angles are in semicircles, times those of the system.

use kurs::ephemeris::{Ephemeris, KeplerElements, Message};
use kurs::signal::{Satellite, System};
use kurs::time::GpsTime;

use super::block::{Block, BlockFields, BlockReader, BlockWriter};
use super::measurements::CHANNEL_OFFSET;
use super::signal::{satellite, satellite_number};
use crate::navigation_frames::kepler_message::PI;
use crate::navigation_frames::{Collector, GlonassMessage, KeplerMessage, Taken, glonass};

const GPS_NAV: u16 = 5891;
const QZS_NAV: u16 = 4095;
const GAL_NAV: u16 = 4002;
const BDS_NAV: u16 = 4081;
const GLO_NAV: u16 = 4004;

/// `Source` of a Galileo message.
const INAV: u64 = 2;
const FNAV: u64 = 16;
/// GPS week of the first week of Galileo; where its weeks begin anew.
const GST_WEEK_0: u64 = 1024;
const GST_WEEKS: u64 = 4096;
/// GPS weeks are sent without those above this.
const WEEKS: i64 = 1024;
/// Unit of the accuracy of GLONASS, m.
const CENTIMETRE_M: f64 = 0.01;

/// Takes the ephemeris in a block, received at `time`.
pub(super) fn take(block: &Block<'_>, time: GpsTime, collector: &mut Collector) -> Taken {
    let system = match block.number {
        GPS_NAV => System::Gps,
        QZS_NAV => System::Qzss,
        GAL_NAV => System::Galileo,
        BDS_NAV => System::BeiDou,
        GLO_NAV => System::Glonass,
        _ => return None,
    };
    let mut reader = BlockReader::new(block.content);
    let [svid] = reader.bytes([0]);
    let satellite = satellite(svid).filter(|satellite| satellite.system == system)?;
    if system == System::Glonass {
        return take_glonass(satellite, reader, time, collector);
    }
    let mut message = KeplerMessage::empty(satellite, Message::Lnav);
    match system {
        System::Galileo => describe_galileo(&mut reader, &mut message),
        System::BeiDou => describe_beidou(&mut reader, &mut message),
        _ => describe_lnav(&mut reader, &mut message),
    }
    if !reader.is_whole() {
        return Some(Err(format!("{satellite}: the block of its ephemeris is too short")));
    }
    message.set_sent(time);
    collector.give(message, time)
}

/// Number and content of the block with an ephemeris; `None` if a value does not fit.
pub(super) fn block(ephemeris: &Ephemeris, sent: GpsTime) -> Option<(u16, Vec<u8>)> {
    let svid = satellite_number(ephemeris.satellite())?;
    let mut writer = BlockWriter::default();
    writer.bytes([svid]);
    let number = match ephemeris {
        Ephemeris::Kepler(kepler) => describe_kepler(&mut writer, kepler.elements(), sent),
        Ephemeris::Glonass(glonass) => {
            let e = glonass.elements();
            let mut channel = u64::from((e.channel + CHANNEL_OFFSET).cast_unsigned());
            let mut message = GlonassMessage::of(e, sent);
            describe_glonass(&mut writer, &mut channel, &mut message, e.reference_time);
            GLO_NAV
        }
    };
    Some((number, writer.finish()?))
}

fn describe_kepler(writer: &mut BlockWriter, elements: &KeplerElements, sent: GpsTime) -> u16 {
    let mut message = KeplerMessage::of(elements, sent);
    match elements.satellite.system {
        System::Galileo => {
            describe_galileo(writer, &mut message);
            GAL_NAV
        }
        System::BeiDou => {
            describe_beidou(writer, &mut message);
            BDS_NAV
        }
        system => {
            message.issue &= 0xff;
            describe_lnav(writer, &mut message);
            if system == System::Qzss { QZS_NAV } else { GPS_NAV }
        }
    }
}

/// GPSNav and QZSNav.
fn describe_lnav(f: &mut impl BlockFields, m: &mut KeplerMessage) {
    f.skip(1);
    f.u2(&mut m.week);
    f.skip(1); // codes on L2
    f.u1(&mut m.accuracy);
    f.u1(&mut m.health);
    f.skip(1); // data on L2 P
    f.u2(&mut m.clock_issue);
    let mut issue_of_subframe_2 = m.issue;
    f.u1(&mut issue_of_subframe_2);
    f.u1(&mut m.issue);
    f.u1(&mut m.long_fit);
    f.skip(1);
    f.f4(1.0, &mut m.elements.group_delays_s[0]);
    clock_and_orbit(f, m);
    f.u2(&mut clock_week(m));
    f.u2(&mut { m.week });
}

/// BDSNav.
fn describe_beidou(f: &mut impl BlockFields, m: &mut KeplerMessage) {
    let is_geo = m.elements.satellite.is_beidou_geo();
    m.elements.message = if is_geo { Message::BeiDouD2 } else { Message::BeiDouD1 };
    f.skip(1);
    f.u2(&mut m.week);
    f.u1(&mut m.accuracy);
    f.u1(&mut m.health);
    f.u1(&mut m.clock_issue);
    f.u1(&mut m.issue);
    f.skip(2);
    f.f4(1.0, &mut m.elements.group_delays_s[0]);
    f.f4(1.0, &mut m.elements.group_delays_s[1]);
    clock_and_orbit(f, m);
    f.u2(&mut clock_week(m));
    f.u2(&mut { m.week });
}

/// Week of t_oc, for others: reading takes the times that are next to the time stamp.
#[allow(clippy::cast_possible_truncation)] // at most a week apart
fn clock_week(m: &KeplerMessage) -> u64 {
    const WEEK_S: f64 = 604_800.0;
    let earlier = ((m.clock_s - m.orbit_s) / WEEK_S).round() as i64;
    m.week.saturating_add_signed(-earlier)
}

/// t_oc to the rate of the inclination: one order for GPS, QZSS and BeiDou.
fn clock_and_orbit(f: &mut impl BlockFields, m: &mut KeplerMessage) {
    f.seconds(&mut m.clock_s);
    let e = &mut m.elements;
    f.f4(1.0, &mut e.clock_drift_rate);
    f.f4(1.0, &mut e.clock_drift);
    f.f4(1.0, &mut e.clock_bias_s);
    f.f4(1.0, &mut e.radius_harmonics_m[1]);
    f.f4(PI, &mut e.mean_motion_correction_radps);
    f.f8(PI, &mut e.mean_anomaly_rad);
    f.f4(1.0, &mut e.latitude_harmonics_rad[0]);
    f.f8(1.0, &mut e.eccentricity);
    f.f4(1.0, &mut e.latitude_harmonics_rad[1]);
    f.f8(1.0, &mut e.sqrt_axis);
    f.seconds(&mut m.orbit_s);
    f.f4(1.0, &mut e.inclination_harmonics_rad[0]);
    f.f8(PI, &mut e.node_rad);
    f.f4(1.0, &mut e.inclination_harmonics_rad[1]);
    f.f8(PI, &mut e.inclination_rad);
    f.f4(1.0, &mut e.radius_harmonics_m[0]);
    f.f8(PI, &mut e.perigee_rad);
    f.f4(PI, &mut e.node_rate_radps);
    f.f4(PI, &mut e.inclination_rate_radps);
}

/// GALNav.
fn describe_galileo(f: &mut impl BlockFields, m: &mut KeplerMessage) {
    let mut source = if m.elements.message == Message::GalileoFnav { FNAV } else { INAV };
    f.u1(&mut source);
    let is_fnav = source == FNAV;
    m.elements.message = if is_fnav { Message::GalileoFnav } else { Message::GalileoInav };
    let e = &mut m.elements;
    f.f8(1.0, &mut e.sqrt_axis);
    f.f8(PI, &mut e.mean_anomaly_rad);
    f.f8(1.0, &mut e.eccentricity);
    f.f8(PI, &mut e.inclination_rad);
    f.f8(PI, &mut e.perigee_rad);
    f.f8(PI, &mut e.node_rad);
    f.f4(PI, &mut e.node_rate_radps);
    f.f4(PI, &mut e.inclination_rate_radps);
    f.f4(PI, &mut e.mean_motion_correction_radps);
    for harmonics in
        [&mut e.latitude_harmonics_rad, &mut e.radius_harmonics_m, &mut e.inclination_harmonics_rad]
    {
        harmonics.iter_mut().for_each(|harmonic| f.f4(1.0, harmonic));
    }
    f.seconds(&mut m.orbit_s);
    f.seconds(&mut m.clock_s);
    f.f4(1.0, &mut e.clock_drift_rate);
    f.f4(1.0, &mut e.clock_drift);
    f.f8(1.0, &mut e.clock_bias_s);
    // Weeks of the reference times, counted as those of GPS.
    f.u2(&mut ((m.week + GST_WEEK_0) % GST_WEEKS));
    f.u2(&mut ((clock_week(m) + GST_WEEK_0) % GST_WEEKS));
    f.u2(&mut m.issue);
    galileo_health(f, &mut m.health);
    f.skip(1); // of the regulated service
    // Accuracies with E5a and with E5b: F/NAV has the first one, I/NAV the second.
    let mut other = 255;
    let (e5a, e5b) =
        if is_fnav { (&mut m.accuracy, &mut other) } else { (&mut other, &mut m.accuracy) };
    f.u1(e5a);
    f.u1(e5b);
    f.skip(1);
    m.elements.group_delays_s.iter_mut().for_each(|delay| f.f4(1.0, delay));
    f.skip(4 + 1); // delay of E6, encryption
}

/// `Health_OSSOL`: for E1-B, E5b and E5a a bit that says whether the three behind it are known. In
/// the word of RINEX these stand at bits 0, 6 and 3.
fn galileo_health(f: &mut impl BlockFields, health: &mut u64) {
    const PARTS: [(u32, u32); 3] = [(0, 0), (4, 6), (8, 3)];
    let mut bits = 0;
    for (from, to) in PARTS {
        bits |= (1 | (*health >> to & 7) << 1) << from;
    }
    f.u2(&mut bits);
    *health = 0;
    for (from, to) in PARTS {
        let part = bits >> from;
        if part & 1 == 1 {
            *health |= (part >> 1 & 7) << to;
        }
    }
}

fn take_glonass(
    satellite: Satellite,
    mut reader: BlockReader<'_>,
    time: GpsTime,
    collector: &mut Collector,
) -> Taken {
    let (mut channel, mut message) = (0, GlonassMessage::default());
    describe_glonass(&mut reader, &mut channel, &mut message, time);
    if !reader.is_whole() {
        return Some(Err(format!("{satellite}: the block of its ephemeris is too short")));
    }
    message.frame_s = glonass::frame_s(time);
    let channel = i8::try_from(channel).ok()? - CHANNEL_OFFSET;
    collector.give_glonass(satellite, channel, &message, time)
}

/// GLONav.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // `as` saturates, neither is negative
fn describe_glonass(
    f: &mut impl BlockFields,
    channel: &mut u64,
    m: &mut GlonassMessage,
    reference_time: GpsTime,
) {
    f.u1(channel);
    m.position_km.iter_mut().for_each(|x| f.f8(1.0, x));
    m.velocity_kmps.iter_mut().for_each(|v| f.f4(1.0, v));
    m.acceleration_kmps2.iter_mut().for_each(|a| f.f4(1.0, a));
    f.f4(1.0, &mut m.drift);
    f.f4(1.0, &mut m.minus_bias_s);
    f.f4(1.0, &mut m.l2_delay_s);
    // The reference time on the scale of GPS: for others, t_b says the same.
    f.seconds(&mut reference_time.tow_s().round());
    f.u2(&mut reference_time.week().rem_euclid(WEEKS).unsigned_abs());
    f.skip(2 + 1); // P1, P2, age
    f.u1(&mut m.health);
    let mut reference_min = (m.reference_s / 60.0).round() as u64;
    f.u2(&mut reference_min);
    m.reference_s = reference_min as f64 * 60.0;
    f.skip(2); // M, P
    f.u1(&mut m.unhealthy);
    f.skip(1); // P4
    f.u2(&mut m.day);
    let mut accuracy_cm = (glonass::accuracy_m(m.accuracy) / CENTIMETRE_M).round() as u64;
    f.u2(&mut accuracy_cm);
    m.accuracy = glonass::accuracy_index(accuracy_cm as f64 * CENTIMETRE_M);
}
