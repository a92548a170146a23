//! What leaves for autopilots, in front of the gates of ArduPilot and PX4 as they are described:
//! which bits, ages and lengths a heading needs to be believed. The gates are written from their
//! descriptions, so that every message is also shown to be refused where one thing about it is
//! wrong.

use kurs::frames::{Body, Vector};
use kurs::solution::EpochSolution;
use kurs_formats::nmea::{self, Profile};
use kurs_formats::ubx::{AntennaLine, navigation};

use crate::leaving_rows::{angles, fixed, fixed_line, float, without_heading};

const ATTITUDES: [[f64; 3]; 6] = [
    [0.0, 0.0, 0.0],
    [90.0, 12.0, 0.0],
    [200.0, -8.0, 20.0],
    [359.9, 5.0, -15.0],
    [359.999_999, 0.0, 0.0],
    [45.0, 0.0, 0.0],
];

/// A message of UBX.
#[derive(Debug, Clone)]
struct Ubx {
    id: [u8; 2],
    payload: Vec<u8>,
}

impl Ubx {
    fn u32(&self, at: usize) -> u32 {
        u32::from_le_bytes(self.payload[at..at + 4].try_into().unwrap())
    }

    fn i32(&self, at: usize) -> i32 {
        i32::from_le_bytes(self.payload[at..at + 4].try_into().unwrap())
    }

    /// Centimetres and tenths of millimetres of NAV-RELPOSNED, m.
    fn metres(&self, at: usize, tenths_at: usize) -> f64 {
        let tenths = i8::from_le_bytes([self.payload[tenths_at]]);
        f64::from(self.i32(at)) * 1e-2 + f64::from(tenths) * 1e-4
    }

    fn degrees(&self, at: usize) -> f64 {
        f64::from(self.i32(at)) * 1e-5
    }
}

fn messages(bytes: &[u8]) -> Vec<Ubx> {
    let mut rest = bytes;
    let mut found = Vec::new();
    while let [0xb5, 0x62, class, number, low, high, behind @ ..] = rest {
        let length = usize::from(u16::from_le_bytes([*low, *high]));
        found.push(Ubx { id: [*class, *number], payload: behind[..length].to_vec() });
        rest = &behind[length + 2..];
    }
    assert!(rest.is_empty());
    found
}

fn sent(row: &EpochSolution, line: &AntennaLine) -> Vec<Ubx> {
    messages(&navigation(row, line, true))
}

const PVT: [u8; 2] = [0x01, 0x07];
const RELPOSNED: [u8; 2] = [0x01, 0x3c];
const DAHEADING: [u8; 2] = [0x01, 0x45];

/// ArduPilot as the rover of a moving base, in the attitude that it believes itself to be in.
struct ArduPilot {
    /// `GPS1_MB_OFS`, from the rover to the base.
    offset_m: Vector<Body>,
    attitude_deg: [f64; 3],
    pvt_ms: Option<u32>,
    vector: Option<(Ubx, u64)>,
}

impl ArduPilot {
    fn new(line: &AntennaLine, attitude_deg: [f64; 3]) -> Self {
        Self { offset_m: -line.body_m, attitude_deg, pvt_ms: None, vector: None }
    }

    fn take(&mut self, messages: &[Ubx], now_ms: u64) {
        for message in messages {
            match message.id {
                PVT => self.pvt_ms = Some(message.u32(0)),
                RELPOSNED => self.vector = Some((message.clone(), now_ms)),
                _ => {}
            }
        }
    }

    /// Degrees; all gates have to be open.
    fn yaw(&self, now_ms: u64) -> Option<f64> {
        const NEEDED: u32 = 1 | 1 << 2 | 1 << 4 | 1 << 5 | 1 << 8;
        const FORBIDDEN: u32 = 1 << 3 | 1 << 6 | 1 << 7;
        const MAX_AGE_MS: u64 = 400;
        let (vector, came_ms) = self.vector.as_ref()?;
        let flags = vector.u32(60);
        let (length_m, down_m) = (vector.metres(20, 35), vector.metres(16, 34));
        let offset_m = self.offset_m.norm();
        let predicted_m = -(angles(self.attitude_deg).ned_from_body() * self.offset_m).xyz().z;
        let [x, y, _]: [f64; 3] = (-self.offset_m.xyz()).into();
        let is_open = flags & NEEDED == NEEDED
            && flags & FORBIDDEN == 0
            && (length_m - offset_m).abs() <= 0.2 * offset_m
            && length_m >= 0.05
            && (down_m - predicted_m).abs() <= 0.2 * offset_m
            && self.pvt_ms == Some(vector.u32(4))
            && now_ms - came_ms < MAX_AGE_MS;
        is_open.then(|| (vector.degrees(24) - y.atan2(x).to_degrees()).rem_euclid(360.0))
    }
}

/// PX4, whose driver looks at one message and whose sensors know the two antennas.
fn px4_yaw(message: &Ubx, line: &AntennaLine) -> Option<f64> {
    const MAX_LINE_M: f64 = 10.0;
    let (flags, heading_valid, length_m) = match message.id {
        RELPOSNED => (message.u32(60), 1 << 8, message.metres(20, 35)),
        DAHEADING => (message.u32(56), 1 << 6, f64::from(message.i32(20)) * 1e-3),
        _ => return None,
    };
    let needed = heading_valid | 1 << 2 | 1 << 4;
    let known_m = line.body_m.norm();
    let [x, y, _]: [f64; 3] = line.body_m.xyz().into();
    let is_open = flags & needed == needed
        && length_m < MAX_LINE_M
        && (length_m - known_m).abs() <= 0.2 * known_m;
    is_open.then(|| (message.degrees(24) - y.atan2(x).to_degrees()).rem_euclid(360.0))
}

fn of(messages: &[Ubx], id: [u8; 2]) -> &Ubx {
    messages.iter().find(|message| message.id == id).unwrap()
}

fn assert_points(found: Option<f64>, wanted_deg: f64, what: &str) {
    let found = found.unwrap_or_else(|| panic!("{what}: refused"));
    let off = (found - wanted_deg + 180.0).rem_euclid(360.0) - 180.0;
    assert!(off.abs() < 0.01, "{what}: {found}, wanted {wanted_deg}");
}

fn forward() -> AntennaLine {
    AntennaLine { rover: 1, body_m: Vector::new(1.2, 0.0, 0.0) }
}

#[test]
fn fixed_rows_are_believed_at_every_heading_and_tilt() {
    for degrees in ATTITUDES {
        // A line that is not along the body shows its heading in the horizontal plane only while it
        // is level.
        let level = degrees[1] == 0.0 && degrees[2] == 0.0;
        let oblique = AntennaLine { rover: 2, body_m: Vector::new(-0.3, 0.9, 0.0) };
        for line in [forward(), oblique].into_iter().take(if level { 2 } else { 1 }) {
            let row = fixed(0, degrees);
            let messages = sent(&row, &line);
            let mut ardupilot = ArduPilot::new(&line, degrees);
            ardupilot.take(&messages, 0);
            assert_points(ardupilot.yaw(100), degrees[0], "ArduPilot");
            for id in [RELPOSNED, DAHEADING] {
                assert_points(px4_yaw(of(&messages, id), &line), degrees[0], "PX4");
            }
        }
        let row = fixed_line(0, degrees, forward().body_m);
        let messages = sent(&row, &forward());
        let mut ardupilot = ArduPilot::new(&forward(), degrees);
        ardupilot.take(&messages, 0);
        assert_points(ardupilot.yaw(0), degrees[0], "ArduPilot, two antennas");
        assert_points(
            px4_yaw(of(&messages, RELPOSNED), &forward()),
            degrees[0],
            "PX4, two antennas",
        );
    }
}

/// Without a fix nothing is believed, but positions go on and say that there is no heading.
#[test]
fn other_rows_are_refused_and_go_on() {
    let lost = EpochSolution::lost(without_heading(0).time, kurs::solution::Reason::NoEphemeris);
    for (row, has_position) in [(without_heading(0), 1), (float(0, [20.0; 3]), 1), (lost, 0)] {
        let messages = sent(&row, &forward());
        let mut ardupilot = ArduPilot::new(&forward(), [20.0; 3]);
        ardupilot.take(&messages, 0);
        assert_eq!(ardupilot.yaw(0), None);
        for id in [RELPOSNED, DAHEADING] {
            assert_eq!(px4_yaw(of(&messages, id), &forward()), None);
        }
        let pvt = of(&messages, PVT);
        let (fix_type, flags, invalid) = (pvt.payload[20], pvt.payload[21], pvt.payload[78]);
        assert_eq!(
            (fix_type, flags & 1, invalid),
            (3 * has_position, has_position, 1 - has_position)
        );
        assert_eq!(flags & 1 << 5, 0, "headVehValid");
    }
    // A line of 10 m is one that PX4 does not believe, and ArduPilot does.
    let long = AntennaLine { rover: 1, body_m: Vector::new(10.0, 0.0, 0.0) };
    let messages = sent(&fixed(0, [20.0, 0.0, 0.0]), &long);
    assert_eq!(px4_yaw(of(&messages, RELPOSNED), &long), None);
    let mut ardupilot = ArduPilot::new(&long, [20.0, 0.0, 0.0]);
    ardupilot.take(&messages, 0);
    assert_points(ardupilot.yaw(0), 20.0, "ArduPilot, 10 m");
}

/// Each gate closes by itself: the messages above pass because of what they say.
#[test]
fn every_gate_is_one() {
    let line = forward();
    let degrees = [90.0, 12.0, 0.0];
    let messages = sent(&fixed(0, degrees), &line);
    let yaw_of = |messages: &[Ubx], line: &AntennaLine, degrees, now_ms| {
        let mut ardupilot = ArduPilot::new(line, degrees);
        ardupilot.take(messages, 0);
        ardupilot.yaw(now_ms)
    };
    let bit_turned = |id, at: usize, bit: u32| {
        let mut changed = messages.clone();
        let message = changed.iter_mut().find(|message| message.id == id).unwrap();
        let flags = message.u32(at) ^ 1 << bit;
        message.payload[at..at + 4].copy_from_slice(&flags.to_le_bytes());
        changed
    };
    for bit in [0, 2, 3, 4, 5, 6, 7, 8] {
        assert_eq!(yaw_of(&bit_turned(RELPOSNED, 60, bit), &line, degrees, 0), None, "bit {bit}");
    }
    for (id, at, bits) in [(RELPOSNED, 60, [2, 4, 8]), (DAHEADING, 56, [2, 4, 6])] {
        for bit in bits {
            assert_eq!(px4_yaw(of(&bit_turned(id, at, bit), id), &line), None, "bit {bit}");
        }
    }
    // A bit that the description does not have is no gate.
    assert!(yaw_of(&bit_turned(RELPOSNED, 60, 9), &line, degrees, 0).is_some());
    // The positions that the autopilot knows are 30 % longer; it is pitched otherwise.
    let longer = AntennaLine { body_m: line.body_m * 1.3, ..line };
    let hardly_longer = AntennaLine { body_m: line.body_m * 1.1, ..line };
    assert_eq!(yaw_of(&messages, &longer, degrees, 0), None);
    assert_eq!(px4_yaw(of(&messages, RELPOSNED), &longer), None);
    assert!(yaw_of(&messages, &hardly_longer, degrees, 0).is_some());
    assert_eq!(yaw_of(&messages, &line, [90.0, -12.0, 0.0], 0), None);
    // Ages, and a position of another epoch.
    assert!(yaw_of(&messages, &line, degrees, 399).is_some());
    assert_eq!(yaw_of(&messages, &line, degrees, 400), None);
    let mut later = messages.clone();
    later.extend(sent(&fixed(1, degrees), &line).into_iter().filter(|message| message.id == PVT));
    assert_eq!(yaw_of(&later, &line, degrees, 0), None, "iTOW");
    let short = AntennaLine { body_m: Vector::new(0.04, 0.0, 0.0), ..line };
    assert_eq!(yaw_of(&sent(&fixed(0, degrees), &short), &short, degrees, 0), None);
}

/// Rows at 10 Hz, five of them without a heading: the yaw of the last fixed one is not said again.
#[test]
fn a_gap_is_one_for_the_autopilot_too() {
    let line = forward();
    let degrees = [200.0, 0.0, 0.0];
    let mut ardupilot = ArduPilot::new(&line, degrees);
    let believed: Vec<bool> = (0..10)
        .map(|k| {
            let row = if (3..8).contains(&k) { without_heading(k) } else { fixed(k, degrees) };
            let now_ms = 100 * k.unsigned_abs();
            ardupilot.take(&sent(&row, &line), now_ms);
            ardupilot.yaw(now_ms).is_some()
        })
        .collect();
    assert_eq!(believed, [true, true, true, false, false, false, false, false, true, true]);
}

/// ArduPilot's NMEA: the yaw of KSXT counts while its eleventh field is 3; no other sentence may
/// bring one, an empty one neither.
#[test]
fn ksxt_is_the_only_sentence_with_a_heading() {
    let sentences = |row: &EpochSolution| {
        let mut text = String::new();
        nmea::encode(Profile::ArduPilot, row, [None; 3], &mut text);
        text.lines().map(|line| line.split_once('*').unwrap().0.to_owned()).collect::<Vec<_>>()
    };
    let yaw = |row: &EpochSolution| {
        let all = sentences(row);
        assert!(!all.iter().any(|s| s.contains("HDT") || s.contains("THS")));
        assert!(all[0].starts_with("$GNGGA") && all[1].starts_with("$GNRMC"));
        let ksxt = all.iter().find(|s| s.starts_with("$KSXT"))?;
        let fields: Vec<&str> = ksxt.split(',').collect();
        (fields[11] == "3").then(|| fields[5].parse::<f64>().unwrap())
    };
    for degrees in ATTITUDES {
        assert_points(yaw(&fixed(0, degrees)), degrees[0], "KSXT");
    }
    assert_eq!(yaw(&fixed(0, [359.9999, 0.0, 0.0])), Some(0.0), "rounded, a full turn is none");
    assert_eq!(yaw(&without_heading(0)), None);
    assert_eq!(yaw(&float(0, [20.0; 3])), None);
    assert_eq!(sentences(&without_heading(0)).len(), 2, "positions go on");
}
