//! Values of messages at the ends of their ranges, and what is not available. Foreign readers look
//! at all of them in `tests/profiles/run`.

use kurs::solution::EpochSolution;
use kurs::turn_rate::Rate;
use kurs_formats::nmea::{self, Profile};
use kurs_formats::nmea2000::{self, Form};
use kurs_formats::ubx::{self, AntennaLine};
use kurs_formats::{mavlink, ros, signal_k};

use crate::leaving_rows::{fixed, fixed_line, float, without_heading};
use kurs::frames::Vector;

const TURN: [Option<Rate>; 3] = [Some(Rate { radps: -0.25, sd_radps: 0.01 }), None, None];

/// Yaw of GPS_INPUT: bytes 63 and 64 of the payload, which begins at byte 10; zeros at its end are
/// left out.
fn yaw(row: &EpochSolution) -> u16 {
    let message = mavlink::gps_input(row, 7);
    let payload = &message[10..message.len() - 2];
    assert_eq!(usize::from(message[1]), payload.len());
    let byte = |at: usize| payload.get(at).copied().unwrap_or(0);
    u16::from_le_bytes([byte(63), byte(64)])
}

#[test]
fn gps_input_has_a_yaw_of_its_own_for_north_and_for_none() {
    let degrees = [0.0, 0.004, 0.006, 90.0, 200.0, 359.9, 359.994, 359.996];
    let found = degrees.map(|heading| yaw(&fixed(0, [heading, 3.0, -4.0])));
    assert_eq!(found, [36_000, 36_000, 1, 9000, 20_000, 35_990, 35_999, 36_000]);
    assert_eq!(yaw(&without_heading(0)), 0);
    assert_eq!(yaw(&float(0, [90.0; 3])), 0);
}

/// One antenna that is left has no double differences: the satellites beside its position are those
/// that it was located by. In NAV-PVT their number is byte 23, in GPS_INPUT byte 62 of the payload.
#[test]
fn a_position_never_has_no_satellites() {
    let mut row = without_heading(0);
    (row.satellites, row.located_by) = (0, 11);
    let mut text = String::new();
    nmea::encode(Profile::Marine, &row, [None; 3], &mut text);
    assert!(text.starts_with("$GNGGA,") && text.contains(",E,1,11,0.90,"), "{text}");
    assert_eq!(mavlink::gps_input(&row, 0)[10 + 62], 11);
    let line = AntennaLine { rover: 1, body_m: Vector::new(1.0, 0.0, 0.0) };
    let messages = ubx::navigation(&row, &line, false);
    let is_pvt = |bytes: &[u8]| bytes.starts_with(&[0xb5, 0x62, 0x01, 0x07]);
    let pvt = (0..messages.len()).find(|at| is_pvt(&messages[*at..])).unwrap();
    assert_eq!(messages[pvt + 6 + 23], 11);
}

fn canboat(row: &EpochSolution, rates: &[Option<Rate>; 3]) -> Vec<String> {
    let text = String::from_utf8(nmea2000::lines(row, rates, Form::Canboat)).unwrap();
    text.lines().map(str::to_owned).collect()
}

/// 127250 of 2.1547 rad is `01 2b 54 ff 7f ff 7f fc`, measured with canboatjs.
#[test]
fn messages_of_the_bus() {
    let heading = 2.1547f64.to_degrees();
    let found = canboat(&fixed(0, [heading, -2.0, 1.0]), &TURN);
    let data = |line: &str| line.split(',').skip(7).collect::<Vec<_>>().join(" ");
    assert_eq!(&found[0][..41], "2024-03-10T11:59:42.000Z,2,127250,35,255,");
    assert_eq!(data(&found[0]), "2b 54 ff 7f ff 7f fc");
    let rate =
        found[1].split(',').skip(7).take(4).map(|byte| u8::from_str_radix(byte, 16).unwrap());
    let rate = i32::from_le_bytes(rate.collect::<Vec<_>>().try_into().unwrap());
    assert_eq!(f64::from(rate) * 3.125e-8, -0.25);
    // 359.9999° rounds to a full turn, which is none; −0.0349 rad is −349.
    let found = canboat(&fixed(0, [359.9999, -2.0, 1.0]), &TURN);
    assert_eq!(&data(&found[0])[..5], "00 00");
    assert_eq!(data(&found[2]), "00 00 a3 fe af 00 ff");
}

#[test]
fn the_bus_without_anything() {
    let lost = EpochSolution::lost(crate::leaving_rows::time(0), kurs::solution::Reason::Ratio);
    let found = canboat(&lost, &TURN);
    let data: Vec<String> =
        found.iter().map(|line| line.split(',').skip(6).collect::<Vec<_>>().join("")).collect();
    assert_eq!(&data[0][2..], "ffffff7fff7ffc");
    assert_eq!(&data[1][2..], "ffffff7fffffff", "no rate without a heading");
    assert_eq!(&data[2][2..], "ff7fff7fff7fff");
    assert_eq!(data[3], "ffffff7fffffff7f");
    assert_eq!(&data[4][2..], "fcffffffffffff");
    let nothing = "ffffffffffffff7f".repeat(3);
    assert_eq!(&data[5][14..], format!("{nothing}02fc00ff7fff7fffffff7f00"));
}

/// Seven frames of one fast packet; what a gateway takes has neither time nor direction.
#[test]
fn frames_of_the_bus() {
    let lines = |form| {
        let text = nmea2000::lines(&fixed(3, [20.0, 0.0, 0.0]), &TURN, form);
        String::from_utf8(text).unwrap().lines().map(str::to_owned).collect::<Vec<_>>()
    };
    let heard = lines(Form::YdwgRaw);
    assert_eq!(heard.len(), 5 + 7);
    assert!(heard[0].starts_with("11:59:42.300 R 09F11223 "), "{}", heard[0]);
    let fix: Vec<&String> = heard.iter().filter(|line| line.contains("0DF80523")).collect();
    let counts = fix.iter().map(|line| u8::from_str_radix(&line[24..26], 16).unwrap() & 31);
    assert_eq!(counts.collect::<Vec<_>>(), [0, 1, 2, 3, 4, 5, 6]);
    assert!(heard.iter().all(|line| line.len() == 15 + 8 + 8 * 3), "eight bytes each");
    let said: Vec<String> = heard.iter().map(|line| line[15..].to_owned()).collect();
    assert_eq!(lines(Form::YdwgToBus), said);
}

#[test]
fn deltas_say_null() {
    let text = |row: &EpochSolution| String::from_utf8(signal_k::delta(row, &TURN)).unwrap();
    let found = text(&fixed(0, [200.0, 5.0, -4.0]));
    assert!(found.contains("\"navigation.headingTrue\",\"value\":3.490659}"), "{found}");
    assert!(found.contains("{\"roll\":-0.069813,\"pitch\":0.087266,\"yaw\":-2.792527}"), "{found}");
    assert!(found.contains("\"navigation.rateOfTurn\",\"value\":-0.250000}"), "{found}");
    let found = text(&without_heading(0));
    for path in ["headingTrue", "attitude", "rateOfTurn"] {
        assert!(found.contains(&format!("\"navigation.{path}\",\"value\":null}}")), "{path}");
    }
    assert!(found.contains("\"latitude\":-43.100000000,"), "{found}");
    let two = fixed_line(0, [200.0, 5.0, -4.0], Vector::new(1.0, 0.0, 0.0));
    assert!(text(&two).contains("{\"roll\":null,\"pitch\":0.087266,"));
}

/// North and level: forward is north (y), left is west (−x). Two antennas do not see the roll.
#[test]
fn orientations_in_the_axes_of_ros() {
    let line = |row: &EpochSolution, float| ros::messages(row, float)[0].rosbridge();
    let north = line(&fixed(0, [0.0, 0.0, 0.0]), false);
    let half = core::f64::consts::FRAC_1_SQRT_2;
    let quaternion = north.split("\"orientation\":").nth(1).unwrap();
    let values: Vec<f64> =
        quaternion.split([':', ',', '}']).filter_map(|part| part.parse().ok()).take(4).collect();
    for (found, wanted) in values.iter().zip([0.0, 0.0, half, half]) {
        assert!((found - wanted).abs() < 1e-12, "{values:?}");
    }
    let two = line(&fixed_line(0, [0.0, 0.0, 0.0], Vector::new(1.0, 0.0, 0.0)), false);
    assert!(two.contains("\"orientation_covariance\":[3.289868133696453,0.0,0.0,"), "{two}");
    let none = "\"orientation_covariance\":[-1.0,";
    assert!(line(&without_heading(0), false).contains(none));
    assert!(line(&float(0, [20.0; 3]), false).contains(none));
    assert!(!line(&float(0, [20.0; 3]), true).contains(none));
    assert_eq!(ros::messages(&without_heading(0), false).len(), 2, "no heading, no message of one");
}

/// AgOpenGPS takes an empty field for zero: without a roll other sentences leave.
#[test]
fn agopen_has_no_empty_angle() {
    let names = |row: &EpochSolution| {
        let mut text = String::new();
        nmea::encode(Profile::AgOpen, row, TURN, &mut text);
        text.lines().map(|line| line.split(',').next().unwrap().to_owned()).collect::<Vec<_>>()
    };
    assert_eq!(names(&fixed(0, [20.0, 1.0, 2.0])), ["$PAOGI"]);
    let two = fixed_line(0, [20.0, 1.0, 2.0], Vector::new(1.0, 0.0, 0.0));
    assert_eq!(names(&two), ["$GNHDT", "$GNVTG", "$GNGGA"]);
    assert_eq!(names(&without_heading(0)), ["$GNVTG", "$GNGGA"]);
}
