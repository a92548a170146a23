//! A low circular orbit, with the attitude kept against the local level axes.

use kurs::frames::{Attitude, EARTH_RATE_RADPS, Geodetic, Vector, WGS84_A_M, wrap_heading};
use nalgebra::{Rotation3, Vector3};

use super::Pose;
use crate::scenario::MotionPlan;
use crate::walker::GM_M3PS2;

/// See the module.
#[derive(Debug, Clone)]
pub struct LowOrbit {
    radius_m: f64,
    inclination_rad: f64,
    node_rad: f64,
    latitude_argument_rad: f64,
    /// Heading against the motion, pitch, roll.
    angles_rad: [f64; 3],
}

impl LowOrbit {
    pub(super) fn new(plan: &MotionPlan) -> Result<Self, String> {
        let MotionPlan::Orbit {
            altitude_m,
            inclination_deg,
            node_deg,
            latitude_argument_deg,
            yaw_deg,
            pitch_deg,
            roll_deg,
        } = plan
        else {
            return Err("not the plan of an orbit".to_owned());
        };
        if *altitude_m <= 0.0 {
            return Err(format!("altitude_m: {altitude_m} must be above 0"));
        }
        Ok(Self {
            radius_m: WGS84_A_M + altitude_m,
            inclination_rad: inclination_deg.to_radians(),
            node_rad: node_deg.to_radians(),
            latitude_argument_rad: latitude_argument_deg.to_radians(),
            angles_rad: [*yaw_deg, *pitch_deg, *roll_deg].map(f64::to_radians),
        })
    }

    pub(super) fn pose(&self, time_s: f64) -> Pose {
        let rate = (GM_M3PS2 / self.radius_m.powi(3)).sqrt();
        let u = self.latitude_argument_rad + rate * time_s;
        let plane = Rotation3::from_axis_angle(
            &Vector3::z_axis(),
            self.node_rad - EARTH_RATE_RADPS * time_s,
        ) * Rotation3::from_axis_angle(&Vector3::x_axis(), self.inclination_rad);
        let position = plane * Vector3::new(u.cos(), u.sin(), 0.0) * self.radius_m;
        let inertial = plane * Vector3::new(-u.sin(), u.cos(), 0.0) * (self.radius_m * rate);
        let earth = Vector3::new(0.0, 0.0, EARTH_RATE_RADPS);
        let position_m = Vector::from_xyz(position);
        // The nose points along the motion over the ground.
        let velocity = Vector::from_xyz(inertial - earth.cross(&position));
        let level = Geodetic::from_ecef(position_m).ned_from_ecef() * velocity;
        let course_rad = level.xyz().y.atan2(level.xyz().x);
        let [yaw_rad, pitch_rad, roll_rad] = self.angles_rad;
        let heading_rad = wrap_heading(course_rad + yaw_rad);
        Pose { position_m, attitude: Attitude { heading_rad, pitch_rad, roll_rad } }
    }
}
