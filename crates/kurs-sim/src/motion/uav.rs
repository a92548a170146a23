//! A small aircraft: a level circle, with pitch and roll that swing as fast as asked.

use kurs::frames::{Attitude, wrap_heading};

use super::{LevelPlane, Pose};
use crate::scenario::MotionPlan;

/// Pitch swings slower than roll by this factor, so that the two never repeat together.
const PITCH_SLOWER: f64 = 0.618;

/// See the module.
#[derive(Debug, Clone)]
pub struct Uav {
    plane: LevelPlane,
    radius_m: f64,
    turn_radps: f64,
    tilt_rad: f64,
    swing_radps: f64,
}

impl Uav {
    pub(super) fn new(plan: &MotionPlan) -> Result<Self, String> {
        let MotionPlan::Uav { place, radius_m, speed_mps, tilt_deg, max_rate_degps } = plan else {
            return Err("not the plan of an aircraft".to_owned());
        };
        if *radius_m <= 0.0 || *tilt_deg <= 0.0 {
            return Err("radius_m and tilt_deg must be above 0".to_owned());
        }
        Ok(Self {
            plane: LevelPlane::at(place),
            radius_m: *radius_m,
            turn_radps: speed_mps / radius_m,
            tilt_rad: tilt_deg.to_radians(),
            // The largest rate of A sin(w t) is A w.
            swing_radps: max_rate_degps / tilt_deg,
        })
    }

    pub(super) fn pose(&self, time_s: f64) -> Pose {
        let bearing = self.turn_radps * time_s;
        let (sin, cos) = bearing.sin_cos();
        let swing = self.swing_radps * time_s;
        Pose {
            position_m: self.plane.point_m(self.radius_m * sin, self.radius_m * cos, 0.0),
            attitude: Attitude {
                // Clockwise around the centre: the nose is a quarter turn ahead of the bearing.
                heading_rad: wrap_heading(bearing + core::f64::consts::FRAC_PI_2),
                pitch_rad: self.tilt_rad * (PITCH_SLOWER * swing).sin(),
                roll_rad: self.tilt_rad * swing.sin(),
            },
        }
    }
}
