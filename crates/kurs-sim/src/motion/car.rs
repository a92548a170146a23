//! A car: straight lines between way points, corners rounded by arcs, body roll in turns.

use core::f64::consts::{PI, TAU};

use kurs::frames::{Attitude, wrap_heading};

use super::{LevelPlane, Pose};
use crate::scenario::MotionPlan;

/// Half the length over which the body follows a change of curvature.
const LEAN_HALF_WINDOW_M: f64 = 4.0;
/// Nose-up pitch for each m/s² of acceleration, rad.
const SQUAT_RAD_PER_MPS2: f64 = 0.4 * PI / 180.0;
/// Time in which the acceleration rises and falls, s.
const JERK_TIME_S: f64 = 1.0;
/// Shorter pieces of the way are none.
const SHORTEST_M: f64 = 1e-6;

/// See the module.
#[derive(Debug, Clone)]
pub struct Car {
    plane: LevelPlane,
    pieces: Vec<Piece>,
    speed_mps: f64,
    wait_s: f64,
    acceleration_mps2: f64,
    lean_rad_per_mps2: f64,
}

/// A straight line or an arc of the way.
#[derive(Debug, Clone, Copy)]
struct Piece {
    /// Length of the way before it.
    start_m: f64,
    length_m: f64,
    east_m: f64,
    north_m: f64,
    heading_rad: f64,
    /// Change of heading for each metre; positive to the right.
    curvature: f64,
}

impl Car {
    pub(super) fn new(plan: &MotionPlan) -> Result<Self, String> {
        let MotionPlan::Car {
            place,
            waypoints_m,
            speed_mps,
            wait_s,
            acceleration_mps2,
            turn_radius_m,
            lean_deg_per_mps2,
        } = plan
        else {
            return Err("not the plan of a car".to_owned());
        };
        if waypoints_m.len() < 2 {
            return Err(format!("waypoints_m: {} given, at least 2 needed", waypoints_m.len()));
        }
        if *speed_mps <= 0.0 || *acceleration_mps2 <= 0.0 || *turn_radius_m <= 0.0 {
            return Err("speed_mps, acceleration_mps2 and turn_radius_m must be above 0".to_owned());
        }
        Ok(Self {
            plane: LevelPlane::at(place),
            pieces: pieces(waypoints_m, *turn_radius_m),
            speed_mps: *speed_mps,
            wait_s: *wait_s,
            acceleration_mps2: *acceleration_mps2,
            lean_rad_per_mps2: lean_deg_per_mps2.to_radians(),
        })
    }

    pub(super) fn pose(&self, time_s: f64) -> Pose {
        let (way_m, speed_mps) = self.way(time_s);
        let (east_m, north_m, heading_rad) = self.on_way(way_m);
        // The mean curvature around the car, as a difference of headings: it never jumps.
        let ahead = self.on_way(way_m + LEAN_HALF_WINDOW_M).2;
        let behind = self.on_way(way_m - LEAN_HALF_WINDOW_M).2;
        let curvature = (ahead - behind) / (2.0 * LEAN_HALF_WINDOW_M);
        let lateral_mps2 = speed_mps * speed_mps * curvature;
        let half_s = JERK_TIME_S / 2.0;
        let gained = self.way(time_s + half_s).1 - self.way(time_s - half_s).1;
        Pose {
            position_m: self.plane.point_m(east_m, north_m, 0.0),
            attitude: Attitude {
                heading_rad: wrap_heading(heading_rad),
                pitch_rad: SQUAT_RAD_PER_MPS2 * gained / JERK_TIME_S,
                // A turn to the right presses the left side down: negative roll.
                roll_rad: -self.lean_rad_per_mps2 * lateral_mps2,
            },
        }
    }

    /// Way and speed: standing, then evenly accelerated, then at constant speed; at the end of the
    /// way points it drives on straight ahead.
    fn way(&self, time_s: f64) -> (f64, f64) {
        let driving_s = (time_s - self.wait_s).max(0.0);
        let accelerating_s = self.speed_mps / self.acceleration_mps2;
        if driving_s < accelerating_s {
            let speed_mps = self.acceleration_mps2 * driving_s;
            (speed_mps * driving_s / 2.0, speed_mps)
        } else {
            (self.speed_mps * (driving_s - accelerating_s / 2.0), self.speed_mps)
        }
    }

    /// East, north and (unwrapped) heading after a length of way.
    fn on_way(&self, way_m: f64) -> (f64, f64, f64) {
        let index = self.pieces.partition_point(|piece| piece.start_m <= way_m).max(1) - 1;
        let piece = &self.pieces[index];
        let is_last = index + 1 == self.pieces.len();
        let along_m = way_m - piece.start_m;
        piece.at(if is_last { along_m } else { along_m.min(piece.length_m) })
    }
}

impl Piece {
    fn at(&self, along_m: f64) -> (f64, f64, f64) {
        let heading = self.heading_rad + self.curvature * along_m;
        if self.curvature == 0.0 {
            let (sin, cos) = self.heading_rad.sin_cos();
            return (self.east_m + along_m * sin, self.north_m + along_m * cos, heading);
        }
        // ∫ sin(h + κ s) ds = (cos h − cos(h + κ s)) / κ
        let east = (self.heading_rad.cos() - heading.cos()) / self.curvature;
        let north = (heading.sin() - self.heading_rad.sin()) / self.curvature;
        (self.east_m + east, self.north_m + north, heading)
    }
}

/// Straight lines and arcs through the way points; an arc never takes more than half of a side.
fn pieces(waypoints_m: &[[f64; 2]], turn_radius_m: f64) -> Vec<Piece> {
    let mut sides = waypoints_m.windows(2).map(|ends| {
        let (east, north) = (ends[1][0] - ends[0][0], ends[1][1] - ends[0][1]);
        (east.hypot(north), east.atan2(north))
    });
    let (mut left_m, mut heading_rad) = sides.next().unwrap_or((0.0, 0.0));
    let mut way = Way {
        east_m: waypoints_m[0][0],
        north_m: waypoints_m[0][1],
        heading_rad,
        length_m: 0.0,
        pieces: Vec::new(),
    };
    let mut half_m = left_m;
    for (length_m, next_rad) in sides {
        // The turn in (−π, π]; tangent length t = r tan(|turn| / 2).
        let turn = (next_rad - heading_rad + PI).rem_euclid(TAU) - PI;
        let tangent = (turn.abs() / 2.0).tan();
        let cut_m = (turn_radius_m * tangent).min(half_m * 0.5).min(length_m * 0.5);
        way.go(left_m - cut_m, 0.0);
        if turn.abs() > 1e-9 {
            let radius_m = cut_m / tangent;
            way.go(radius_m * turn.abs(), turn.signum() / radius_m);
        }
        (left_m, half_m, heading_rad) = (length_m - cut_m, length_m, next_rad);
    }
    way.go(left_m.max(1.0), 0.0);
    way.pieces
}

/// The end of the way so far.
struct Way {
    east_m: f64,
    north_m: f64,
    heading_rad: f64,
    length_m: f64,
    pieces: Vec<Piece>,
}

impl Way {
    fn go(&mut self, length_m: f64, curvature: f64) {
        if length_m < SHORTEST_M {
            return;
        }
        let piece = Piece {
            start_m: self.length_m,
            length_m,
            east_m: self.east_m,
            north_m: self.north_m,
            heading_rad: self.heading_rad,
            curvature,
        };
        (self.east_m, self.north_m, self.heading_rad) = piece.at(length_m);
        self.length_m += length_m;
        self.pieces.push(piece);
    }
}
