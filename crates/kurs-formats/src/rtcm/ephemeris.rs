//! Ephemeris messages: 1019 (GPS), 1020 (GLONASS), 1042 (BeiDou), 1044 (QZSS), 1045 and 1046
//! (Galileo F/NAV and I/NAV).

use std::collections::BTreeMap;

use kurs::ephemeris::{Ephemeris, KeplerElements, Message};
use kurs::signal::{Satellite, System};
use kurs::time::GpsTime;

use crate::fields::{BitReader, BitWriter, Fields};
use crate::navigation_frames::galileo::health;
use crate::navigation_frames::{GlonassMessage, KeplerMessage, week_bits};

/// The messages of Keplerian orbits: number, system, message, bits of the satellite number.
const KEPLER: [(u16, System, Message, u32); 6] = [
    (1019, System::Gps, Message::Lnav, 6),
    (1042, System::BeiDou, Message::BeiDouD1, 6),
    (1042, System::BeiDou, Message::BeiDouD2, 6),
    (1044, System::Qzss, Message::Lnav, 4),
    (1045, System::Galileo, Message::GalileoFnav, 6),
    (1046, System::Galileo, Message::GalileoInav, 6),
];
const GLONASS: u16 = 1020;

/// Whether a message of this number has an ephemeris.
pub(super) fn is_one(number: u16) -> bool {
    number == GLONASS || KEPLER.iter().any(|(of, ..)| *of == number)
}

/// An ephemeris in a message, and whether it tells the date on its own.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Received {
    pub(crate) ephemeris: Ephemeris,
    /// The week is whole, not its last ten bits.
    pub(crate) is_dated: bool,
}

/// The ephemeris in a message of this number; `None` if it has none. `near` decides between dates
/// that the message does not tell apart. The error says what is out of range.
pub(crate) fn read(number: u16, body: &[u8], near: GpsTime) -> Option<Result<Received, String>> {
    if number == GLONASS {
        return read_glonass(body, near);
    }
    let (_, system, message, width) = *KEPLER.iter().find(|(of, ..)| *of == number)?;
    let mut reader = BitReader::new(body);
    reader.take(12);
    let satellite = Satellite::new(system, u8::try_from(reader.take(width)).ok()?);
    let is_geo = satellite.is_beidou_geo();
    let message = if is_geo { Message::BeiDouD2 } else { message };
    let mut received = KeplerMessage::empty(satellite, message);
    describe(&mut reader, &mut received, number);
    if !reader.is_whole() || satellite.number == 0 {
        return Some(Err(format!("message {number} is too short or of no satellite")));
    }
    // The message does not say when it was sent.
    received.sent_s = received.orbit_s;
    let Some(date) = received.date(near) else {
        return Some(Err(format!("{satellite}: week {} is none", received.week)));
    };
    let is_dated = week_bits(system) > 10;
    let ephemeris = received.ephemeris(date);
    Some(ephemeris.map(|ephemeris| Received { ephemeris, is_dated }))
}

/// Takes the channel of a GLONASS satellite from message 1020.
pub(crate) fn glonass_channel(message: &[u8], channels: &mut BTreeMap<u8, i8>) {
    let mut reader = BitReader::new(message);
    let [number, slot, channel] = [12, 6, 5].map(|width| reader.take(width));
    if let (true, Ok(slot @ 1..), Ok(channel @ 0..=13)) =
        (number == u64::from(GLONASS), u8::try_from(slot), i8::try_from(channel))
    {
        channels.insert(slot, channel - 7);
    }
}

/// The message with an ephemeris; `None` if there is none for it or a value does not fit.
pub(crate) fn write(ephemeris: &Ephemeris, sent: GpsTime) -> Option<Vec<u8>> {
    match ephemeris {
        Ephemeris::Kepler(kepler) => write_kepler(kepler.elements(), sent),
        Ephemeris::Glonass(glonass) => {
            let e = glonass.elements();
            let mut message = GlonassMessage::of(e, sent);
            let mut writer = BitWriter::default();
            writer.constant(12, u64::from(GLONASS));
            writer.constant(6, u64::from(e.satellite.number));
            writer.constant(5, u64::from((e.channel + 7).cast_unsigned()));
            describe_glonass(&mut writer, &mut message);
            writer.finish()
        }
    }
}

fn write_kepler(elements: &KeplerElements, sent: GpsTime) -> Option<Vec<u8>> {
    let system = elements.satellite.system;
    let of = |row: &&(u16, System, Message, u32)| row.1 == system && row.2 == elements.message;
    let (number, _, _, width) = *KEPLER.iter().find(of)?;
    let mut message = KeplerMessage::of(elements, sent);
    if elements.message == Message::Lnav {
        message.issue &= 0xff;
    }
    let mut writer = BitWriter::default();
    writer.constant(12, u64::from(number));
    writer.constant(width, u64::from(elements.satellite.number));
    describe(&mut writer, &mut message, number);
    writer.finish()
}

/// Everything behind the satellite number.
fn describe(f: &mut impl Fields, m: &mut KeplerMessage, number: u16) {
    match number {
        1019 => {
            f.unsigned(10, &mut m.week);
            f.unsigned(4, &mut m.accuracy);
            f.constant(2, 1); // P code on L2
            m.inclination_rate(f);
            f.unsigned(8, &mut m.issue);
            clock_backwards(f, m);
            f.unsigned(10, &mut m.clock_issue);
            orbit(f, m);
            m.group_delay(f, 0);
            f.unsigned(6, &mut m.health);
            f.constant(1, 0);
            f.unsigned(1, &mut m.long_fit);
        }
        1044 => {
            clock_backwards(f, m);
            f.unsigned(8, &mut m.issue);
            orbit(f, m);
            m.inclination_rate(f);
            f.constant(2, 2); // codes on L2
            f.unsigned(10, &mut m.week);
            f.unsigned(4, &mut m.accuracy);
            f.unsigned(6, &mut m.health);
            m.group_delay(f, 0);
            f.unsigned(10, &mut m.clock_issue);
            f.unsigned(1, &mut m.long_fit);
        }
        1042 => {
            f.unsigned(13, &mut m.week);
            f.unsigned(4, &mut m.accuracy);
            m.inclination_rate(f);
            f.unsigned(5, &mut m.issue);
            clock_backwards(f, m);
            f.unsigned(5, &mut m.clock_issue);
            orbit(f, m);
            m.group_delay(f, 0);
            m.group_delay(f, 1);
            f.unsigned(1, &mut m.health);
        }
        _ => {
            f.unsigned(12, &mut m.week);
            f.unsigned(10, &mut m.issue);
            f.unsigned(8, &mut m.accuracy);
            m.inclination_rate(f);
            clock_backwards(f, m);
            orbit(f, m);
            m.group_delay(f, 0);
            if number == 1045 {
                health(f, m, &[(2, 4), (1, 3)]);
                f.constant(7, 0);
            } else {
                m.group_delay(f, 1);
                health(f, m, &[(2, 7), (1, 6), (2, 1), (1, 0)]);
                f.constant(2, 0);
            }
        }
    }
}

/// t_oc, a_f2, a_f1, a_f0: one order for all systems.
fn clock_backwards(f: &mut impl Fields, m: &mut KeplerMessage) {
    m.clock_time(f);
    m.clock_coefficient(f, 2);
    m.clock_coefficient(f, 1);
    m.clock_coefficient(f, 0);
}

/// C_rs to the rate of the node: one order for all systems.
fn orbit(f: &mut impl Fields, m: &mut KeplerMessage) {
    m.radius_harmonic(f, 1);
    m.mean_motion_correction(f);
    m.mean_anomaly(f);
    m.latitude_harmonic(f, 0);
    m.eccentricity(f);
    m.latitude_harmonic(f, 1);
    m.sqrt_axis(f);
    m.orbit_time(f);
    m.inclination_harmonic(f, 0);
    m.node(f);
    m.inclination_harmonic(f, 1);
    m.inclination(f);
    m.radius_harmonic(f, 0);
    m.perigee(f);
    m.node_rate(f);
}

fn read_glonass(body: &[u8], near: GpsTime) -> Option<Result<Received, String>> {
    let mut reader = BitReader::new(body);
    reader.take(12);
    let satellite = Satellite::new(System::Glonass, u8::try_from(reader.take(6)).ok()?);
    let channel = i8::try_from(reader.take(5)).ok()? - 7;
    let mut message = GlonassMessage::default();
    describe_glonass(&mut reader, &mut message);
    if !reader.is_whole() || satellite.number == 0 {
        return Some(Err("message 1020 is too short or of no satellite".into()));
    }
    let dated = message.date();
    let ephemeris = message.ephemeris(satellite, channel, dated.unwrap_or(near));
    Some(ephemeris.map(|ephemeris| Received { ephemeris, is_dated: dated.is_some() }))
}

/// Everything behind the channel.
fn describe_glonass(f: &mut impl Fields, m: &mut GlonassMessage) {
    f.constant(4, 0); // almanac health, P1
    m.frame_time(f);
    let mut unhealthy = u64::from(m.health >= 4);
    f.unsigned(1, &mut unhealthy);
    m.health = 4 * unhealthy;
    f.constant(1, 1); // P2
    m.reference_time(f);
    for axis in 0..3 {
        m.velocity(f, axis);
        m.position(f, axis);
        m.acceleration(f, axis);
    }
    f.constant(1, 1); // P3
    m.clock_drift(f);
    f.constant(2, 0); // P
    f.unsigned(1, &mut m.unhealthy);
    m.clock_bias(f);
    m.l2_delay(f);
    f.constant(5 + 1, 0); // age, P4
    f.unsigned(4, &mut m.accuracy);
    f.unsigned(11, &mut m.day);
    f.constant(2, 1); // M: GLONASS-M
    f.constant(1, 1); // the following data are there
    f.constant(11 + 32, 0); // N_A, τ_c
    f.unsigned(5, &mut m.four_years);
    f.constant(22 + 1 + 7, 0); // τ_GPS, l_n, reserved
}
