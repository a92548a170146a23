//! True motion: where a body is and how it is turned at any instant.

mod car;
mod orbit;
mod recorded;
mod ship;
mod uav;

pub use recorded::{BadPoseTable, RecordedPose};

use kurs::frames::{Attitude, Body, Ecef, Geodetic, Ned, Rotation, Vector};

use crate::noise::Noise;
use crate::scenario::{MotionPlan, Place};
use car::Car;
use orbit::LowOrbit;
use recorded::Recorded;
use ship::Ship;
use uav::Uav;

/// Position and attitude at one instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    /// Origin of the body axes.
    pub position_m: Vector<Ecef>,
    /// Against the local level axes at the origin.
    pub attitude: Attitude,
}

/// How a body moves, as a function of time from the start of the scenario.
#[derive(Debug, Clone)]
pub enum Motion {
    /// Always the same pose.
    Static(Pose),
    /// Along way points.
    Car(Car),
    /// On a swell.
    Ship(Box<Ship>),
    /// On a circle, shaking.
    Uav(Uav),
    /// Around the Earth.
    Orbit(LowOrbit),
    /// From a table.
    Recorded(Recorded),
}

/// A step for derivatives, s: rounding and curvature errors are both far below 1 mm/s.
const STEP_S: f64 = 1e-3;

impl Motion {
    /// From a plan; `recorded` is the table of a recorded motion, `noise` draws the swell.
    ///
    /// # Errors
    ///
    /// What is wrong with the plan, in words.
    pub fn new(
        plan: &MotionPlan,
        recorded: Option<&[RecordedPose]>,
        noise: &mut Noise,
    ) -> Result<Self, String> {
        Ok(match plan {
            MotionPlan::Static { place, heading_deg, pitch_deg, roll_deg } => Self::Static(Pose {
                position_m: place.geodetic().to_ecef(),
                attitude: attitude_of([*heading_deg, *pitch_deg, *roll_deg]),
            }),
            MotionPlan::Car { .. } => Self::Car(Car::new(plan)?),
            MotionPlan::Ship { .. } => Self::Ship(Box::new(Ship::new(plan, noise)?)),
            MotionPlan::Uav { .. } => Self::Uav(Uav::new(plan)?),
            MotionPlan::Orbit { .. } => Self::Orbit(LowOrbit::new(plan)?),
            MotionPlan::Recorded { file } => {
                let poses = recorded.ok_or_else(|| format!("file: {file:?} was not read"))?;
                Self::Recorded(
                    Recorded::new(poses).map_err(|error| format!("file: {file}: {error}"))?,
                )
            }
        })
    }

    /// The pose at a time.
    #[must_use]
    pub fn pose(&self, time_s: f64) -> Pose {
        match self {
            Self::Static(pose) => *pose,
            Self::Car(car) => car.pose(time_s),
            Self::Ship(ship) => ship.pose(time_s),
            Self::Uav(uav) => uav.pose(time_s),
            Self::Orbit(orbit) => orbit.pose(time_s),
            Self::Recorded(recorded) => recorded.pose(time_s),
        }
    }

    /// Velocity of a point of the body, by a central difference.
    #[must_use]
    pub fn velocity_mps(&self, lever_arm_m: Vector<Body>, time_s: f64) -> Vector<Ecef> {
        let point = |time_s| self.pose(time_s).point_m(lever_arm_m);
        (point(time_s + STEP_S) - point(time_s - STEP_S)) * (0.5 / STEP_S)
    }
}

impl Pose {
    /// Body axes in ECEF.
    #[must_use]
    pub fn ecef_from_body(&self) -> Rotation<Ecef, Body> {
        let here = Geodetic::from_ecef(self.position_m);
        here.ecef_from_ned() * self.attitude.ned_from_body()
    }

    /// ECEF position of a point of the body.
    #[must_use]
    pub fn point_m(&self, lever_arm_m: Vector<Body>) -> Vector<Ecef> {
        self.position_m + self.ecef_from_body() * lever_arm_m
    }
}

impl Place {
    /// In radians.
    #[must_use]
    pub fn geodetic(&self) -> Geodetic {
        Geodetic::from_degrees(self.latitude_deg, self.longitude_deg, self.height_m)
    }
}

/// A point of the level plane that touches the Earth at a place.
#[derive(Debug, Clone, Copy)]
struct LevelPlane {
    origin_m: Vector<Ecef>,
    ecef_from_ned: Rotation<Ecef, Ned>,
}

impl LevelPlane {
    fn at(place: &Place) -> Self {
        let here = place.geodetic();
        Self { origin_m: here.to_ecef(), ecef_from_ned: here.ecef_from_ned() }
    }

    fn point_m(&self, east_m: f64, north_m: f64, up_m: f64) -> Vector<Ecef> {
        self.origin_m + self.ecef_from_ned * Vector::new(north_m, east_m, -up_m)
    }
}

/// Heading, pitch and roll in degrees.
pub(crate) fn attitude_of(angles_deg: [f64; 3]) -> Attitude {
    let [heading_rad, pitch_rad, roll_rad] = angles_deg.map(f64::to_radians);
    Attitude { heading_rad, pitch_rad, roll_rad }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PLACE: Place = Place { latitude_deg: 55.0, longitude_deg: 37.0, height_m: 150.0 };

    fn plans() -> [MotionPlan; 4] {
        [
            MotionPlan::Car {
                place: PLACE,
                waypoints_m: vec![[0.0, 0.0], [0.0, 120.0], [80.0, 120.0], [80.0, 0.0]],
                speed_mps: 12.0,
                wait_s: 2.0,
                acceleration_mps2: 2.0,
                turn_radius_m: 15.0,
                lean_deg_per_mps2: 0.6,
            },
            MotionPlan::Ship {
                place: PLACE,
                heading_deg: 70.0,
                speed_mps: 6.0,
                period_s: 9.0,
                roll_rms_deg: 6.0,
                pitch_rms_deg: 2.0,
                yaw_rms_deg: 1.0,
                heave_rms_m: 0.8,
            },
            MotionPlan::Uav {
                place: PLACE,
                radius_m: 40.0,
                speed_mps: 10.0,
                tilt_deg: 35.0,
                max_rate_degps: 200.0,
            },
            MotionPlan::Orbit {
                altitude_m: 500e3,
                inclination_deg: 97.4,
                node_deg: 20.0,
                latitude_argument_deg: 30.0,
                yaw_deg: 0.0,
                pitch_deg: 0.0,
                roll_deg: 0.0,
            },
        ]
    }

    /// No motion jumps: neither position nor attitude, at a grid finer than any epoch.
    #[test]
    fn motions_are_continuous() {
        for plan in plans() {
            let motion = Motion::new(&plan, None, &mut Noise::seeded(1)).unwrap();
            let mut before = motion.pose(0.0);
            for k in 1..6000 {
                let now = motion.pose(f64::from(k) * 0.01);
                let moved_m = (now.position_m - before.position_m).norm();
                assert!(moved_m < 80.0, "{plan:?} at {k}: {moved_m} m in 10 ms");
                let turn = now.attitude.ned_from_body().inverse() * before.attitude.ned_from_body();
                let cos = (turn.matrix().trace() - 1.0) / 2.0;
                let turned_deg = cos.clamp(-1.0, 1.0).acos().to_degrees();
                assert!(turned_deg < 4.5, "{plan:?} at {k}: {turned_deg} degrees in 10 ms");
                before = now;
            }
        }
    }

    /// A level body that moves forwards moves along its own x axis.
    #[test]
    fn noses_point_along_the_motion() {
        let [car, _, _, orbit] = plans();
        for (plan, time_s) in [(car, 12.0), (orbit, 100.0)] {
            let motion = Motion::new(&plan, None, &mut Noise::seeded(1)).unwrap();
            let velocity = motion.velocity_mps(Vector::new(0.0, 0.0, 0.0), time_s);
            let nose = motion.pose(time_s).ecef_from_body() * Vector::new(1.0, 0.0, 0.0);
            let off = velocity.direction().cross(&nose).norm();
            assert!(off < 0.02 && velocity.dot(&nose) > 0.0, "{plan:?}: {off} rad");
        }
    }
}
