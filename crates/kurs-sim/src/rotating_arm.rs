//! A body with antenna and accelerometers at the end of a rotating arm: truth and measurements.
//!
//! Antenna motion and specific force come from differences of the true antenna position relative to
//! the centre, C(t) ρ(t), not from formulas of angular rates.

use core::f64::consts::TAU;

use kurs::frames::{EARTH_RATE_RADPS, Geodetic};
use kurs::fusion::earth::gravity::normal_gravity_mps2;
use nalgebra::{Matrix3, Rotation3, Vector3};

use crate::noise::Noise;
use crate::walker::SatelliteTruth;

/// Start of the turn, s.
pub const TURN_STARTS_S: f64 = 20.0;
/// Length of the turn: there in 1.5 s, hold 0.9 s, back in 1.5 s; 39 samples of 0.1 s.
pub const TURN_LASTS_S: f64 = 3.9;
/// How far the heading goes, rad.
const TURN_RAD: f64 = 30.0 * TAU / 360.0;
const TURN_THERE_S: f64 = 1.5;
const TURN_HOLDS_S: f64 = 0.9;

/// How the heading goes from one value to the other.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TurnShape {
    /// Quintic: rate and acceleration begin and end at zero.
    Smooth,
    /// Constant rate.
    Ramp,
}

/// What the centre of rotation does.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Course {
    /// Stands still.
    Standing,
    /// Straight with constant velocity, level, in the first heading.
    Uniform {
        /// Speed.
        speed_mps: f64,
    },
    /// Velocity along the heading: turns with it.
    AlongHeading {
        /// Speed.
        speed_mps: f64,
    },
    /// Straight from rest with constant acceleration, level.
    Accelerated {
        /// Acceleration.
        acceleration_mps2: f64,
        /// Its azimuth.
        azimuth_rad: f64,
    },
}

/// The whole scenario.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ArmScenario {
    /// Where the centre is at time zero.
    pub site: Geodetic,
    /// What it does.
    pub course: Course,
    /// How it turns.
    pub shape: TurnShape,
    /// Roll, right side up positive, as in the paper.
    pub roll_rad: f64,
    /// Pitch at time zero, nose down positive, as in the paper.
    pub pitch_rad: f64,
    /// How fast it grows, over the top and on.
    pub pitch_rate_radps: f64,
    /// Heading before and after the turn.
    pub heading_rad: f64,
    /// R.
    pub radius_m: f64,
    /// f.
    pub rate_hz: f64,
    /// The arm's angle at time zero.
    pub phase_rad: f64,
    /// Centre of rotation in body axes (forward, up, right).
    pub centre_m: Vector3<f64>,
    /// Body axes from the arm's axes, in which it turns from x towards y.
    pub body_from_arm: Matrix3<f64>,
    /// Whether the accelerometers turn with the arm; parallel to the body at angle zero.
    pub triad_turns: bool,
}

/// The true motion at an instant, ECEF; body axes forward, up, right.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ArmTruth {
    /// Origin of the body axes; the centre of rotation unless the scenario puts it elsewhere.
    pub position_m: Vector3<f64>,
    /// Likewise.
    pub velocity_mps: Vector3<f64>,
    /// Likewise.
    pub acceleration_mps2: Vector3<f64>,
    /// Antenna.
    pub antenna_m: Vector3<f64>,
    /// Antenna.
    pub antenna_velocity_mps: Vector3<f64>,
    /// What ideal accelerometers at the antenna read, in body axes unless they turn with the arm.
    pub specific_force_mps2: Vector3<f64>,
    /// Roll, pitch, heading, rad.
    pub angles_rad: Vector3<f64>,
    /// ECEF from body.
    pub ecef_from_body: Matrix3<f64>,
}

impl ArmScenario {
    /// The reference scenario: 55.75° N 37.62° E, 1 m arm at 1 Hz, roll and pitch 10°, heading 30°.
    #[must_use]
    pub fn reference(course: Course, shape: TurnShape) -> Self {
        Self {
            site: Geodetic::from_degrees(55.75, 37.62, 200.0),
            course,
            shape,
            roll_rad: 10f64.to_radians(),
            pitch_rad: 10f64.to_radians(),
            pitch_rate_radps: 0.0,
            heading_rad: 30f64.to_radians(),
            radius_m: 1.0,
            rate_hz: 1.0,
            phase_rad: 0.0,
            centre_m: Vector3::zeros(),
            body_from_arm: Matrix3::identity(),
            triad_turns: false,
        }
    }

    /// True heading, rad.
    #[must_use]
    pub fn heading_at_rad(&self, time_s: f64) -> f64 {
        let since = time_s - TURN_STARTS_S;
        let back_starts = TURN_THERE_S + TURN_HOLDS_S;
        let there = self.shape.portion(since / TURN_THERE_S);
        let back = self.shape.portion((since - back_starts) / TURN_THERE_S);
        self.heading_rad + TURN_RAD * (there - back)
    }

    /// The truth on a grid of times `0, step_s, …`, with the positions of the centre integrated
    /// where they have no closed form.
    #[must_use]
    pub fn run(&self, step_s: f64, samples: usize) -> Vec<ArmTruth> {
        self.run_from(0.0, step_s, samples)
    }

    /// As [`ArmScenario::run`] on a grid that begins at another time, where the body then is at the
    /// site.
    #[must_use]
    pub fn run_from(&self, first_s: f64, step_s: f64, samples: usize) -> Vec<ArmTruth> {
        let mut displacement_m = Vector3::zeros();
        let mut run = Vec::with_capacity(samples);
        for sample in 0..samples {
            let time_s = first_s + sample as f64 * step_s;
            run.push(self.truth(time_s, &displacement_m));
            // Simpson's rule over the step; exact for straight courses.
            let velocity = |t: f64| self.course_velocity(t);
            displacement_m += (velocity(time_s)
                + velocity(time_s + step_s / 2.0) * 4.0
                + velocity(time_s + step_s))
                * (step_s / 6.0);
        }
        run
    }

    /// Velocity of the centre in the north-up-east axes of the site.
    fn course_velocity(&self, time_s: f64) -> Vector3<f64> {
        let along = |heading: f64, speed: f64| {
            Vector3::new(heading.cos() * speed, 0.0, heading.sin() * speed)
        };
        match self.course {
            Course::Standing => Vector3::zeros(),
            Course::Uniform { speed_mps } => along(self.heading_rad, speed_mps),
            Course::AlongHeading { speed_mps } => along(self.heading_at_rad(time_s), speed_mps),
            Course::Accelerated { acceleration_mps2, azimuth_rad } => {
                along(azimuth_rad, acceleration_mps2 * time_s)
            }
        }
    }

    fn truth(&self, time_s: f64, displacement_m: &Vector3<f64>) -> ArmTruth {
        let site_axes = nhe_axes(&self.site);
        let position_m = self.site.to_ecef().xyz() + site_axes * displacement_m;
        let velocity_mps = site_axes * self.course_velocity(time_s);
        let acceleration_mps2 = site_axes * derivative(|t| self.course_velocity(t), time_s);
        let here = Geodetic::from_ecef(kurs::frames::Vector::from_xyz(position_m));
        let axes = nhe_axes(&here);
        let ecef_from_body = axes * self.nhe_from_body(time_s);

        // Relative to the centre, in level axes; their own turning along the course is below 1e-5
        // rad/s and left out, as in the measurement model of the paper.
        let lever = |t: f64| self.nhe_from_body(t) * self.arm(t);
        let relative_m = axes * lever(time_s);
        let relative_velocity = axes * derivative(lever, time_s);
        let relative_acceleration = axes * second_derivative(lever, time_s);
        let antenna_velocity_mps = velocity_mps + relative_velocity;
        let earth = Vector3::new(0.0, 0.0, EARTH_RATE_RADPS);
        let up = axes.column(1);
        let gravity_mps2 = normal_gravity_mps2(here.latitude_rad, here.height_m);
        let felt = acceleration_mps2
            + relative_acceleration
            + earth.cross(&antenna_velocity_mps) * 2.0
            + up * gravity_mps2;
        ArmTruth {
            position_m,
            velocity_mps,
            acceleration_mps2,
            antenna_m: position_m + relative_m,
            antenna_velocity_mps,
            specific_force_mps2: self.triad_from_body(time_s) * (ecef_from_body.transpose() * felt),
            angles_rad: Vector3::new(
                self.roll_rad,
                self.pitch_at_rad(time_s),
                self.heading_at_rad(time_s),
            ),
            ecef_from_body,
        }
    }

    fn pitch_at_rad(&self, time_s: f64) -> f64 {
        self.pitch_rad + self.pitch_rate_radps * time_s
    }

    fn arm_angle_rad(&self, time_s: f64) -> f64 {
        TAU * self.rate_hz * time_s + self.phase_rad
    }

    /// The arm's end in body axes.
    fn arm(&self, time_s: f64) -> Vector3<f64> {
        let (sin, cos) = self.arm_angle_rad(time_s).sin_cos();
        self.centre_m + self.body_from_arm * Vector3::new(cos, sin, 0.0) * self.radius_m
    }

    /// The accelerometers' axes.
    fn triad_from_body(&self, time_s: f64) -> Matrix3<f64> {
        if !self.triad_turns {
            return Matrix3::identity();
        }
        let (sin, cos) = self.arm_angle_rad(time_s).sin_cos();
        // The arm's axes turned back by its angle, seen in body axes.
        let back = Matrix3::new(cos, sin, 0.0, -sin, cos, 0.0, 0.0, 0.0, 1.0);
        self.body_from_arm * back * self.body_from_arm.transpose()
    }

    /// Three left-handed turns about up, right and forward.
    fn nhe_from_body(&self, time_s: f64) -> Matrix3<f64> {
        let turn = |axis: Vector3<f64>, angle: f64| Rotation3::new(axis * -angle).into_inner();
        turn(Vector3::y(), self.heading_at_rad(time_s))
            * turn(Vector3::z(), self.pitch_at_rad(time_s))
            * turn(Vector3::x(), self.roll_rad)
    }
}

impl TurnShape {
    /// From 0 to 1 while `s` goes from 0 to 1.
    fn portion(self, s: f64) -> f64 {
        let s = s.clamp(0.0, 1.0);
        match self {
            Self::Ramp => s,
            Self::Smooth => s * s * s * (10.0 - 15.0 * s + 6.0 * s * s),
        }
    }
}

/// Noise of the receiver and the accelerometers, 1 σ of each measurement.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ArmSensors {
    /// Pseudorange.
    pub pseudorange_sd_m: f64,
    /// Range rate.
    pub range_rate_sd_mps: f64,
    /// Carrier phase.
    pub phase_sd_m: f64,
    /// Accelerometers.
    pub accelerometer_sd_mps2: f64,
    /// Constant accelerometer bias.
    pub bias_mps2: Vector3<f64>,
}

/// One satellite's noisy measurements.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NoisyRange {
    /// Pseudorange with the receiver clock.
    pub pseudorange_m: f64,
    /// Range rate with the receiver clock's.
    pub range_rate_mps: f64,
    /// Carrier phase, without its constant.
    pub phase_m: f64,
}

impl ArmSensors {
    /// σ_D² = 10 m², σ_Ḋ² = 0.01 (m/s)², σ_n² = 1e-4 (m/s²)², phase 3 mm.
    #[must_use]
    pub fn reference() -> Self {
        Self {
            pseudorange_sd_m: 10f64.sqrt(),
            range_rate_sd_mps: 0.1,
            phase_sd_m: 0.003,
            accelerometer_sd_mps2: 0.01,
            bias_mps2: Vector3::zeros(),
        }
    }

    /// What the accelerometers read.
    pub fn specific_force(&self, truth: &ArmTruth, noise: &mut Noise) -> Vector3<f64> {
        truth.specific_force_mps2 + self.bias_mps2 + noise.normal3(self.accelerometer_sd_mps2)
    }

    /// What the receiver reads; signal travel time is neglected.
    pub fn range(
        &self,
        antenna_m: &Vector3<f64>,
        antenna_velocity_mps: &Vector3<f64>,
        satellite: &SatelliteTruth,
        clock: &Clock,
        noise: &mut Noise,
    ) -> NoisyRange {
        let range = antenna_m - satellite.position_m;
        let distance_m = range.norm();
        let rate = range.dot(&(antenna_velocity_mps - satellite.velocity_mps)) / distance_m;
        NoisyRange {
            pseudorange_m: distance_m + clock.bias_m + noise.normal(self.pseudorange_sd_m),
            range_rate_mps: rate + clock.rate_mps + noise.normal(self.range_rate_sd_mps),
            phase_m: distance_m + clock.bias_m + noise.normal(self.phase_sd_m),
        }
    }
}

/// A receiver clock whose rate wanders.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Clock {
    /// Δ.
    pub bias_m: f64,
    /// Δ̇.
    pub rate_mps: f64,
    /// Spectral density of the noise of the rate, (m/s)²/s.
    pub density: f64,
}

impl Clock {
    /// Moves on by a step, with both parts of the integrated noise.
    pub fn advance(&mut self, step_s: f64, noise: &mut Noise) {
        // [Δt³/3 Δt²/2; Δt²/2 Δt] by Cholesky's factor, rate first.
        let rate = noise.normal((self.density * step_s).sqrt());
        let rest = noise.normal((self.density * step_s.powi(3) / 12.0).sqrt());
        self.bias_m += self.rate_mps * step_s + rate * step_s / 2.0 + rest;
        self.rate_mps += rate;
    }
}

/// ECEF from north-up-east at a point.
fn nhe_axes(at: &Geodetic) -> Matrix3<f64> {
    let ecef_from_ned = at.ecef_from_ned().matrix();
    let [north, east, down] = [0, 1, 2].map(|k| ecef_from_ned.column(k).into_owned());
    Matrix3::from_columns(&[north, -down, east])
}

/// First derivative by a difference of fourth order; error below 1e-9 for motions of the arm.
fn derivative(f: impl Fn(f64) -> Vector3<f64>, at: f64) -> Vector3<f64> {
    let h = 1e-3;
    ((f(at + h) - f(at - h)) * 8.0 - (f(at + 2.0 * h) - f(at - 2.0 * h))) / (12.0 * h)
}

/// Second derivative by a difference of fourth order.
fn second_derivative(f: impl Fn(f64) -> Vector3<f64>, at: f64) -> Vector3<f64> {
    let h = 1e-3;
    let near = f(at + h) + f(at - h);
    let far = f(at + 2.0 * h) + f(at - 2.0 * h);
    (near * 16.0 - far - f(at) * 30.0) / (12.0 * h * h)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_turn_takes_39_samples() {
        let scenario = ArmScenario::reference(Course::Standing, TurnShape::Smooth);
        let heading = |t: f64| scenario.heading_at_rad(t).to_degrees();
        assert!((heading(20.0) - 30.0).abs() < 1e-12);
        assert!((heading(21.6) - 60.0).abs() < 1e-12);
        assert!((heading(22.3) - 60.0).abs() < 1e-12);
        assert!((heading(23.9) - 30.0).abs() < 1e-12);
        // Peak rate 37.5°/s.
        assert!((heading(20.751) - heading(20.749) - 0.075).abs() < 1e-5);
    }

    #[test]
    fn positions_are_the_integral_of_velocity() {
        let course = Course::AlongHeading { speed_mps: 20.0 };
        let run = ArmScenario::reference(course, TurnShape::Smooth).run(0.01, 2400);
        for k in [2050, 2105, 2300] {
            let moved = (run[k + 1].position_m - run[k - 1].position_m) / 0.02;
            assert!((moved - run[k].velocity_mps).norm() < 1e-3);
            let moved = (run[k + 1].antenna_m - run[k - 1].antenna_m) / 0.02;
            assert!((moved - run[k].antenna_velocity_mps).norm() < 0.02);
            let change = (run[k + 1].velocity_mps - run[k - 1].velocity_mps) / 0.02;
            assert!((change - run[k].acceleration_mps2).norm() < 0.01);
        }
    }
}
