//! A row as messages of ROS 2: as JSON for rosbridge, and in CDR, which ROS 2 has on the wire and
//! in bags.
//!
//! ROS counts in other axes (REP 103): the world is east-north-up, the body forward-left-up. A yaw
//! is therefore counter-clockwise from east (90° − heading), a pitch nose down, a roll right side
//! down as here. Covariances of orientations are those of roll, pitch, yaw, rad². A covariance that
//! begins with −1 says that there is no estimate.

use core::f64::consts::{FRAC_PI_2, PI};
use std::fmt::Write as _;

use kurs::frames::{Attitude, Body, Enu, Rotation, enu_from_ned};
use kurs::solution::{AttitudeEstimate, EpochSolution, PositionOrigin, Status};
use kurs::time::GpsTime;
use nalgebra::{Matrix3, Vector3};

pub mod bus;

use crate::json;
use crate::unix_time;
use bus::{TOPICS, Topic};

/// Variance of an angle that the antennas do not see, rad²: every direction is as likely.
const UNSEEN_RAD2: f64 = PI * PI / 3.0;
/// First element of a covariance without an estimate.
const NO_ESTIMATE: f64 = -1.0;
/// The body's own frame.
const FRAME: &str = "base_link";

/// A message and where it goes.
#[derive(Debug, Clone, PartialEq)]
pub struct Message {
    /// Where it goes.
    pub topic: Topic,
    fields: Value,
}

#[derive(Debug, Clone, PartialEq)]
enum Value {
    Struct(Vec<(&'static str, Value)>),
    Byte(i8),
    Short(u16),
    Int(i32),
    Nanoseconds(u32),
    Numbers(Vec<f64>),
    Number(f64),
    Text(&'static str),
}

/// Topics and their types; `tests/profiles/check.py` lays the hashes beside those of rosbags.
const IMU: Topic = Topic {
    name: "/kurs/imu",
    kind: "sensor_msgs/msg/Imu",
    type_hash: "RIHS01_7d9a00ff131080897a5ec7e26e315954b8eae3353c3f995c55faf71574000b5b",
};
const HEADING: Topic = Topic {
    name: "/kurs/heading",
    kind: "geometry_msgs/msg/QuaternionStamped",
    type_hash: "RIHS01_381add86c6c3160644d228ca342182c7fd6c7fab11c7a85ad817a9cc22dbac6e",
};
const FIX: Topic = Topic {
    name: "/kurs/fix",
    kind: "sensor_msgs/msg/NavSatFix",
    type_hash: "RIHS01_62223ab3fe210a15976021da7afddc9e200dc9ec75231c1b6a557fc598a65404",
};

/// The messages of a row: Imu and NavSatFix always, the heading alone as a quaternion where there
/// is one. With `float`, angles of float rows too.
#[must_use]
pub fn messages(row: &EpochSolution, float: bool) -> Vec<Message> {
    let leaves = row.is_fixed() || float && row.status() == Status::Float;
    let attitude = row.attitude().filter(|attitude| leaves && attitude.heading_rad.is_some());
    let heading = attitude.and_then(|attitude| heading(row.time, attitude));
    let all = [
        Some((IMU, imu(row.time, attitude))),
        heading.map(|h| (HEADING, h)),
        Some((FIX, fix(row))),
    ];
    let message = |(topic, fields)| Message { topic, fields };
    all.into_iter().flatten().map(message).collect()
}

/// What rosbridge has to hear before the first message: which topics there are.
#[must_use]
pub fn advertisement() -> Vec<u8> {
    let line = |Topic { name, kind, .. }| {
        format!("{{\"op\":\"advertise\",\"topic\":\"{name}\",\"type\":\"{kind}\"}}\n")
    };
    TOPICS.map(line).concat().into_bytes()
}

impl Message {
    /// A line for rosbridge.
    #[must_use]
    pub fn rosbridge(&self) -> String {
        let mut text = format!("{{\"op\":\"publish\",\"topic\":\"{}\",\"msg\":", self.topic.name);
        self.fields.write_json(&mut text);
        text.push_str("}\n");
        text
    }

    /// In CDR, little-endian, with its header of four bytes.
    #[must_use]
    pub fn cdr(&self) -> Vec<u8> {
        let mut body = Vec::new();
        self.fields.write_cdr(&mut body);
        [&[0, 1, 0, 0], body.as_slice()].concat()
    }
}

/// Orientation; there are no gyros and accelerometers.
fn imu(time: GpsTime, attitude: Option<&AttitudeEstimate>) -> Value {
    let level = Attitude { heading_rad: FRAC_PI_2, pitch_rad: 0.0, roll_rad: 0.0 };
    let rotation = attitude.map_or(level, angles);
    let covariance = attitude.map_or_else(no_estimate, |a| numbers(&covariance(a)));
    Value::Struct(vec![
        ("header", header(time)),
        ("orientation", quaternion(rotation)),
        ("orientation_covariance", covariance),
        ("angular_velocity", vector()),
        ("angular_velocity_covariance", no_estimate()),
        ("linear_acceleration", vector()),
        ("linear_acceleration_covariance", no_estimate()),
    ])
}

/// The turn about the vertical alone.
fn heading(time: GpsTime, attitude: &AttitudeEstimate) -> Option<Value> {
    let level = Attitude { heading_rad: attitude.heading_rad?, pitch_rad: 0.0, roll_rad: 0.0 };
    Some(Value::Struct(vec![("header", header(time)), ("quaternion", quaternion(level))]))
}

/// Position over the ellipsoid.
fn fix(row: &EpochSolution) -> Value {
    const NO_FIX: i8 = -1;
    const COVARIANCE_KNOWN: i8 = 3;
    const COVARIANCE_UNKNOWN: i8 = 0;
    let position = row.position.as_ref();
    let status = match position.map(|p| p.origin) {
        None => NO_FIX,
        Some(PositionOrigin::Alone) => 0,
        // By ground stations.
        Some(PositionOrigin::StationCode | PositionOrigin::StationPhase) => 2,
    };
    // Which systems were used a row does not say.
    let status = Value::Struct(vec![("status", Value::Byte(status)), ("service", Value::Short(0))]);
    let geodetic = position.map(|p| p.geodetic);
    let number = |value: Option<f64>| Value::Number(value.unwrap_or(f64::NAN));
    let covariance = position.map(|p| enu_from_ned().turn_covariance(&p.covariance_m2));
    Value::Struct(vec![
        ("header", header(row.time)),
        ("status", status),
        ("latitude", number(geodetic.map(|g| g.latitude_rad.to_degrees()))),
        ("longitude", number(geodetic.map(|g| g.longitude_rad.to_degrees()))),
        ("altitude", number(geodetic.map(|g| g.height_m))),
        ("position_covariance", numbers(&covariance.unwrap_or_else(Matrix3::zeros))),
        (
            "position_covariance_type",
            Value::Byte(if position.is_some() { COVARIANCE_KNOWN } else { COVARIANCE_UNKNOWN }),
        ),
    ])
}

/// The time of measurement in UTC.
fn header(time: GpsTime) -> Value {
    const NS_PER_S: i64 = 1_000_000_000;
    let unix_ns = unix_time::nanoseconds(time);
    let seconds = i32::try_from(unix_ns.div_euclid(NS_PER_S)).unwrap_or(i32::MAX);
    let nanoseconds = u32::try_from(unix_ns.rem_euclid(NS_PER_S)).unwrap_or(0);
    let stamp = vec![("sec", Value::Int(seconds)), ("nanosec", Value::Nanoseconds(nanoseconds))];
    Value::Struct(vec![("stamp", Value::Struct(stamp)), ("frame_id", Value::Text(FRAME))])
}

/// Unseen angles are taken as zero; their variance says so.
fn angles(attitude: &AttitudeEstimate) -> Attitude {
    Attitude {
        heading_rad: attitude.heading_rad.unwrap_or(0.0),
        pitch_rad: attitude.pitch_rad.unwrap_or(0.0),
        roll_rad: attitude.roll_rad.unwrap_or(0.0),
    }
}

/// Covariance of roll, pitch and yaw in the axes of ROS, rad².
fn covariance(attitude: &AttitudeEstimate) -> Matrix3<f64> {
    /// Index in heading, pitch, roll and sign.
    const FROM: [(usize, f64); 3] = [(2, 1.0), (1, -1.0), (0, -1.0)];
    let known = attitude.angles_rad().map(|angle| angle.is_some());
    Matrix3::from_fn(|row, column| {
        let ((i, sign_i), (j, sign_j)) = (FROM[row], FROM[column]);
        match known[i] && known[j] {
            true => sign_i * sign_j * attitude.covariance_rad2[(i, j)],
            false if i == j => UNSEEN_RAD2,
            false => 0.0,
        }
    })
}

/// East-north-up from forward-left-up, scalar last.
fn quaternion(attitude: Attitude) -> Value {
    let frd_from_flu = Matrix3::from_diagonal(&Vector3::new(1.0, -1.0, -1.0));
    let enu_from_frd: Rotation<Enu, Body> = enu_from_ned() * attitude.ned_from_body();
    let enu_from_flu: Rotation<Enu, Body> =
        Rotation::from_matrix(enu_from_frd.matrix() * frd_from_flu);
    let [w, x, y, z] = enu_from_flu.quaternion();
    let parts = [("x", x), ("y", y), ("z", z), ("w", w)];
    Value::Struct(parts.map(|(name, value)| (name, Value::Number(value))).to_vec())
}

fn vector() -> Value {
    Value::Struct(["x", "y", "z"].map(|name| (name, Value::Number(0.0))).to_vec())
}

fn numbers(matrix: &Matrix3<f64>) -> Value {
    Value::Numbers(matrix.transpose().iter().copied().collect())
}

fn no_estimate() -> Value {
    let mut elements = vec![0.0; 9];
    elements[0] = NO_ESTIMATE;
    Value::Numbers(elements)
}

impl Value {
    fn write_json(&self, text: &mut String) {
        /// Shortest text that reads as the same number; infinities and NaN are null in JSON.
        fn number(value: f64) -> String {
            if value.is_finite() { format!("{value:?}") } else { "null".to_owned() }
        }
        let _ = match self {
            Self::Struct(fields) => {
                for (k, (name, value)) in fields.iter().enumerate() {
                    let _ = write!(text, "{}\"{name}\":", if k == 0 { '{' } else { ',' });
                    value.write_json(text);
                }
                write!(text, "}}")
            }
            Self::Byte(value) => write!(text, "{value}"),
            Self::Short(value) => write!(text, "{value}"),
            Self::Int(value) => write!(text, "{value}"),
            Self::Nanoseconds(value) => write!(text, "{value}"),
            Self::Number(value) => write!(text, "{}", number(*value)),
            Self::Numbers(values) => {
                let values: Vec<String> = values.iter().map(|value| number(*value)).collect();
                write!(text, "[{}]", values.join(","))
            }
            Self::Text(value) => write!(text, "{}", json::word(value)),
        };
    }

    /// Every number stands at a multiple of its length; texts have their length, with a zero,
    /// before them.
    fn write_cdr(&self, body: &mut Vec<u8>) {
        fn push(body: &mut Vec<u8>, number: &[u8]) {
            body.resize(body.len().next_multiple_of(number.len()), 0);
            body.extend(number);
        }
        match self {
            Self::Struct(fields) => fields.iter().for_each(|(_, value)| value.write_cdr(body)),
            Self::Byte(value) => push(body, &value.to_le_bytes()),
            Self::Short(value) => push(body, &value.to_le_bytes()),
            Self::Int(value) => push(body, &value.to_le_bytes()),
            Self::Nanoseconds(value) => push(body, &value.to_le_bytes()),
            Self::Number(value) => push(body, &value.to_le_bytes()),
            Self::Numbers(values) => values.iter().for_each(|v| push(body, &v.to_le_bytes())),
            Self::Text(value) => {
                let length = u32::try_from(value.len() + 1).unwrap_or(u32::MAX);
                push(body, &length.to_le_bytes());
                body.extend(value.bytes().chain([0]));
            }
        }
    }
}
