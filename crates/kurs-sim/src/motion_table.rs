//! The table `body.motion` of a scenario file: every kind of motion has keys of its own.
//!
//! Read as one table with all keys, so that an error names the key and its line.

use core::fmt;

use serde::Deserialize;

use crate::scenario::{MotionPlan, Place};

const DEFAULT_ACCELERATION_MPS2: f64 = 2.0;
const DEFAULT_TURN_RADIUS_M: f64 = 12.0;
const DEFAULT_LEAN_DEG_PER_MPS2: f64 = 0.6;

#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
enum Kind {
    Static,
    Car,
    Ship,
    Uav,
    Orbit,
    Recorded,
}

/// All keys of all kinds.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct MotionTable {
    kind: Kind,
    place: Option<Place>,
    waypoints_m: Option<Vec<[f64; 2]>>,
    heading_deg: Option<f64>,
    pitch_deg: Option<f64>,
    roll_deg: Option<f64>,
    speed_mps: Option<f64>,
    wait_s: Option<f64>,
    acceleration_mps2: Option<f64>,
    turn_radius_m: Option<f64>,
    lean_deg_per_mps2: Option<f64>,
    period_s: Option<f64>,
    roll_rms_deg: Option<f64>,
    pitch_rms_deg: Option<f64>,
    yaw_rms_deg: Option<f64>,
    heave_rms_m: Option<f64>,
    radius_m: Option<f64>,
    tilt_deg: Option<f64>,
    max_rate_degps: Option<f64>,
    altitude_m: Option<f64>,
    inclination_deg: Option<f64>,
    node_deg: Option<f64>,
    latitude_argument_deg: Option<f64>,
    yaw_deg: Option<f64>,
    file: Option<String>,
}

/// A key is missing, or belongs to another kind of motion.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub(crate) enum WrongKey {
    /// A key without default.
    #[error("missing field `{key}` of motion kind `{kind}`")]
    Missing {
        /// Its name.
        key: &'static str,
        /// The kind, as in the file.
        kind: String,
    },
    /// A key that means nothing here.
    #[error("key `{key}` does not belong to motion kind `{kind}`")]
    Foreign {
        /// Its name.
        key: &'static str,
        /// The kind, as in the file.
        kind: String,
    },
}

impl TryFrom<MotionTable> for MotionPlan {
    type Error = WrongKey;

    fn try_from(mut table: MotionTable) -> Result<Self, WrongKey> {
        let kind = table.kind;
        let plan = match kind {
            Kind::Static => Self::Static {
                place: needed(&mut table.place, "place", kind)?,
                heading_deg: needed(&mut table.heading_deg, "heading_deg", kind)?,
                pitch_deg: table.pitch_deg.take().unwrap_or(0.0),
                roll_deg: table.roll_deg.take().unwrap_or(0.0),
            },
            Kind::Car => Self::Car {
                place: needed(&mut table.place, "place", kind)?,
                waypoints_m: needed(&mut table.waypoints_m, "waypoints_m", kind)?,
                speed_mps: needed(&mut table.speed_mps, "speed_mps", kind)?,
                wait_s: table.wait_s.take().unwrap_or(0.0),
                acceleration_mps2: table
                    .acceleration_mps2
                    .take()
                    .unwrap_or(DEFAULT_ACCELERATION_MPS2),
                turn_radius_m: table.turn_radius_m.take().unwrap_or(DEFAULT_TURN_RADIUS_M),
                lean_deg_per_mps2: table
                    .lean_deg_per_mps2
                    .take()
                    .unwrap_or(DEFAULT_LEAN_DEG_PER_MPS2),
            },
            Kind::Ship => Self::Ship {
                place: needed(&mut table.place, "place", kind)?,
                heading_deg: needed(&mut table.heading_deg, "heading_deg", kind)?,
                speed_mps: needed(&mut table.speed_mps, "speed_mps", kind)?,
                period_s: needed(&mut table.period_s, "period_s", kind)?,
                roll_rms_deg: needed(&mut table.roll_rms_deg, "roll_rms_deg", kind)?,
                pitch_rms_deg: needed(&mut table.pitch_rms_deg, "pitch_rms_deg", kind)?,
                yaw_rms_deg: table.yaw_rms_deg.take().unwrap_or(0.0),
                heave_rms_m: table.heave_rms_m.take().unwrap_or(0.0),
            },
            Kind::Uav => Self::Uav {
                place: needed(&mut table.place, "place", kind)?,
                radius_m: needed(&mut table.radius_m, "radius_m", kind)?,
                speed_mps: needed(&mut table.speed_mps, "speed_mps", kind)?,
                tilt_deg: needed(&mut table.tilt_deg, "tilt_deg", kind)?,
                max_rate_degps: needed(&mut table.max_rate_degps, "max_rate_degps", kind)?,
            },
            Kind::Orbit => Self::Orbit {
                altitude_m: needed(&mut table.altitude_m, "altitude_m", kind)?,
                inclination_deg: needed(&mut table.inclination_deg, "inclination_deg", kind)?,
                node_deg: needed(&mut table.node_deg, "node_deg", kind)?,
                latitude_argument_deg: table.latitude_argument_deg.take().unwrap_or(0.0),
                yaw_deg: table.yaw_deg.take().unwrap_or(0.0),
                pitch_deg: table.pitch_deg.take().unwrap_or(0.0),
                roll_deg: table.roll_deg.take().unwrap_or(0.0),
            },
            Kind::Recorded => Self::Recorded { file: needed(&mut table.file, "file", kind)? },
        };
        match table.left() {
            Some(key) => Err(WrongKey::Foreign { key, kind: kind.to_string() }),
            None => Ok(plan),
        }
    }
}

impl MotionTable {
    /// A key that was given and not taken.
    fn left(&self) -> Option<&'static str> {
        let keys = [
            (self.place.is_some(), "place"),
            (self.waypoints_m.is_some(), "waypoints_m"),
            (self.heading_deg.is_some(), "heading_deg"),
            (self.pitch_deg.is_some(), "pitch_deg"),
            (self.roll_deg.is_some(), "roll_deg"),
            (self.speed_mps.is_some(), "speed_mps"),
            (self.wait_s.is_some(), "wait_s"),
            (self.acceleration_mps2.is_some(), "acceleration_mps2"),
            (self.turn_radius_m.is_some(), "turn_radius_m"),
            (self.lean_deg_per_mps2.is_some(), "lean_deg_per_mps2"),
            (self.period_s.is_some(), "period_s"),
            (self.roll_rms_deg.is_some(), "roll_rms_deg"),
            (self.pitch_rms_deg.is_some(), "pitch_rms_deg"),
            (self.yaw_rms_deg.is_some(), "yaw_rms_deg"),
            (self.heave_rms_m.is_some(), "heave_rms_m"),
            (self.radius_m.is_some(), "radius_m"),
            (self.tilt_deg.is_some(), "tilt_deg"),
            (self.max_rate_degps.is_some(), "max_rate_degps"),
            (self.altitude_m.is_some(), "altitude_m"),
            (self.inclination_deg.is_some(), "inclination_deg"),
            (self.node_deg.is_some(), "node_deg"),
            (self.latitude_argument_deg.is_some(), "latitude_argument_deg"),
            (self.yaw_deg.is_some(), "yaw_deg"),
            (self.file.is_some(), "file"),
        ];
        keys.iter().find(|(is_left, _)| *is_left).map(|(_, key)| *key)
    }
}

fn needed<T>(value: &mut Option<T>, key: &'static str, kind: Kind) -> Result<T, WrongKey> {
    value.take().ok_or_else(|| WrongKey::Missing { key, kind: kind.to_string() })
}

impl fmt::Display for Kind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Static => "static",
            Self::Car => "car",
            Self::Ship => "ship",
            Self::Uav => "uav",
            Self::Orbit => "orbit",
            Self::Recorded => "recorded",
        })
    }
}
