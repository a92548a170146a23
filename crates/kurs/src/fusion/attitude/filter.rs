//! The multi-antenna attitude carried on by a gyro, and by accelerometers where there are any.
//!
//! An error-state filter: attitude, velocity and the sensors' biases are integrated from the
//! inertial samples; attitudes and velocities from the antennas correct them. The attitude error is
//! a rotation vector in body axes, C ← C exp\[φ×\]. Between fixes the filter coasts; its attitude and
//! covariance are also a prediction for the next integer search.

use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};

use crate::chi_square::chi_square_tail;
use crate::frames::{Body, EARTH_RATE_RADPS, Geodetic, Ned, Rotation, Vector};
use crate::fusion::earth::gravity::normal_gravity_mps2;
use crate::fusion::health::{FilterError, LONGEST_GAP_S, Tally};
use crate::fusion::kalman::{Batch, Estimate, Gate};

/// Attitude error φ, body axes.
const ATTITUDE: usize = 0;
/// Gyro bias error, body axes.
const GYRO_BIAS: usize = 3;
/// Velocity error, north-east-down.
const VELOCITY: usize = 6;
/// Accelerometer bias error, body axes.
const ACCELEROMETER_BIAS: usize = 9;
/// How much the body may turn where no gyro says it, rad/√s.
const UNKNOWN_TURNING: f64 = 1.0;
/// Error of the sensor's mounting, body axes: the last states, left out where the mounting is exact.
const MOUNTING: usize = 12;
/// Number of states with all of them.
pub const STATES: usize = 15;

/// Quality of the inertial sensors and of the start.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InertialSettings {
    /// Noise density of the gyro (angle random walk), rad/√s.
    pub gyro_noise: f64,
    /// Bias at the start, 1 σ.
    pub gyro_bias_sd_radps: f64,
    /// Random walk of the bias, (rad/s)/√s.
    pub gyro_bias_walk: f64,
    /// Noise density of the accelerometers, (m/s²)/√Hz.
    pub accelerometer_noise: f64,
    /// Bias at the start, 1 σ.
    pub accelerometer_bias_sd_mps2: f64,
    /// Random walk of the bias, (m/s²)/√s.
    pub accelerometer_bias_walk: f64,
    /// Constant error of the sensor's mounting on each axis, 1 σ; 0: exact.
    pub mounting_sd_rad: f64,
    /// How much the body accelerates where no accelerometer says it, (m/s²)/√Hz.
    pub unknown_acceleration: f64,
    /// Which corrections are refused.
    pub gate: Gate,
}

/// An attitude from the antennas, fixed or float.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MeasuredAttitude {
    /// The attitude.
    pub ned_from_body: Rotation<Ned, Body>,
    /// Of the rotation vector of its error in body axes, rad²; a direction that was not measured has
    /// a large variance.
    pub covariance: Matrix3<f64>,
}

/// A velocity from the antennas.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MeasuredVelocity {
    /// The velocity.
    pub velocity_mps: Vector<Ned>,
    /// (m/s)².
    pub covariance: Matrix3<f64>,
}

/// One inertial sample: mean rate and specific force since the sample before.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InertialSample {
    /// Time of the sample.
    pub time_s: f64,
    /// Angular rate against inertial space, rad/s.
    pub rate_radps: Vector<Body>,
    /// Specific force, m/s², if there are accelerometers.
    pub specific_force_mps2: Option<Vector<Body>>,
}

/// The integrated part of the state.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Nominal {
    /// NED from body.
    pub attitude: UnitQuaternion<f64>,
    /// Body axes, rad/s.
    pub gyro_bias_radps: Vector3<f64>,
    /// North-east-down, m/s.
    pub velocity_mps: Vector3<f64>,
    /// Body axes, m/s².
    pub accelerometer_bias_mps2: Vector3<f64>,
    /// Body from the axes in which the samples are given.
    pub mounting: UnitQuaternion<f64>,
}

/// What became of the measurements of one instant, by their components.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Corrected {
    /// The attitude; nothing used nor rejected if its covariance says nothing.
    pub attitude: Tally,
    /// The velocity, likewise.
    pub velocity: Tally,
}

/// Error-state filter of attitude and velocity.
#[derive(Debug, Clone, PartialEq)]
pub struct AttitudeFilter {
    settings: InertialSettings,
    time_s: f64,
    nominal: Nominal,
    estimate: Estimate,
    /// Transition since it was last taken, one column a state; for smoothing.
    transition: Vec<f64>,
    place: Place,
    batch: Batch,
}

/// What the place on the Earth adds: gravity, the Earth's rate, and how the level axes turn as the
/// body moves.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Place {
    gravity_ned_mps2: Vector3<f64>,
    earth_rate_ned: Vector3<f64>,
    /// One over the radii of curvature with the height: of the meridian, and across it.
    by_radius: [f64; 2],
    tan_latitude: f64,
}

/// The linear part of one integration step.
struct Step {
    seconds: f64,
    turn_back: Matrix3<f64>,
    velocity_by_attitude: Matrix3<f64>,
    velocity_by_bias: Matrix3<f64>,
    attitude_by_mounting: Matrix3<f64>,
}

impl Nominal {
    /// Moved by an error state: attitude, gyro bias, velocity, accelerometer bias, mounting if it has that.
    #[must_use]
    pub fn moved(&self, error: &[f64]) -> Self {
        let part = |start: usize| Vector3::new(error[start], error[start + 1], error[start + 2]);
        Self {
            attitude: self.attitude * UnitQuaternion::from_scaled_axis(part(ATTITUDE)),
            gyro_bias_radps: self.gyro_bias_radps + part(GYRO_BIAS),
            velocity_mps: self.velocity_mps + part(VELOCITY),
            accelerometer_bias_mps2: self.accelerometer_bias_mps2 + part(ACCELEROMETER_BIAS),
            mounting: match error.len() {
                STATES => UnitQuaternion::from_scaled_axis(part(MOUNTING)) * self.mounting,
                _ => self.mounting,
            },
        }
    }

    /// The error state that moves `from` to this.
    #[must_use]
    pub fn error_from(&self, from: &Self) -> [f64; STATES] {
        let mut error = [0.0; STATES];
        let parts = [
            (from.attitude.inverse() * self.attitude).scaled_axis(),
            self.gyro_bias_radps - from.gyro_bias_radps,
            self.velocity_mps - from.velocity_mps,
            self.accelerometer_bias_mps2 - from.accelerometer_bias_mps2,
            (self.mounting * from.mounting.inverse()).scaled_axis(),
        ];
        for (block, part) in error.chunks_exact_mut(3).zip(parts) {
            block.copy_from_slice(part.as_slice());
        }
        error
    }
}

impl AttitudeFilter {
    /// Starts at a first attitude and velocity. The place (for gravity and the Earth's rate) may be
    /// off by kilometres.
    #[must_use]
    pub fn new(
        settings: InertialSettings,
        time_s: f64,
        place: &Geodetic,
        attitude: &MeasuredAttitude,
        velocity: &MeasuredVelocity,
    ) -> Self {
        let mut sd = [0.0; STATES];
        sd[GYRO_BIAS..VELOCITY].fill(settings.gyro_bias_sd_radps);
        sd[ACCELEROMETER_BIAS..MOUNTING].fill(settings.accelerometer_bias_sd_mps2);
        sd[MOUNTING..].fill(settings.mounting_sd_rad);
        let states = if settings.mounting_sd_rad > 0.0 { STATES } else { MOUNTING };
        let mut estimate = Estimate::new(&sd[..states]);
        for (start, block) in [(ATTITUDE, attitude.covariance), (VELOCITY, velocity.covariance)] {
            estimate.covariance.fixed_view_mut::<3, 3>(start, start).copy_from(&block);
        }
        let rotation = Rotation3::from_matrix_unchecked(attitude.ned_from_body.matrix());
        Self {
            settings,
            time_s,
            nominal: Nominal {
                attitude: UnitQuaternion::from_rotation_matrix(&rotation),
                gyro_bias_radps: Vector3::zeros(),
                velocity_mps: velocity.velocity_mps.xyz(),
                accelerometer_bias_mps2: Vector3::zeros(),
                mounting: UnitQuaternion::identity(),
            },
            estimate,
            transition: identity(states),
            place: Place::at(place),
            batch: Batch::default(),
        }
    }

    /// Tells where the body is now: for gravity, the Earth's rate and the turning of the level axes.
    pub fn move_to(&mut self, place: &Geodetic) {
        self.place = Place::at(place);
    }

    /// Integrates an inertial sample. A sample that is not a number only adds time.
    ///
    /// # Errors
    ///
    /// [`FilterError::TimeGoesBack`] or [`FilterError::Gap`]; nothing is changed then.
    pub fn integrate(&mut self, sample: &InertialSample) -> Result<(), FilterError> {
        self.bridge(sample, [0.0; 2])
    }

    /// As [`Self::integrate`], over a time in which the sample only stands for others: rate and force are
    /// less sure by these noise densities, rad/√s and (m/s²)/√Hz.
    ///
    /// # Errors
    ///
    /// As [`Self::integrate`].
    pub fn bridge(
        &mut self,
        sample: &InertialSample,
        more_noise: [f64; 2],
    ) -> Result<(), FilterError> {
        let seconds = sample.time_s - self.time_s;
        if seconds > LONGEST_GAP_S {
            return Err(FilterError::Gap { gap_s: seconds });
        }
        if seconds.is_nan() || seconds <= 0.0 {
            return Err(FilterError::TimeGoesBack { from_s: self.time_s, to_s: sample.time_s });
        }
        let finite_rate = sample.rate_radps.is_finite();
        let mounting = self.nominal.mounting;
        let rate = if finite_rate { mounting * sample.rate_radps.xyz() } else { Vector3::zeros() };
        let force = sample.specific_force_mps2.filter(Vector::is_finite);
        let force = force.map(|f| mounting * f.xyz());
        let step = self.advance_nominal(seconds, &rate, force);
        self.estimate.propagate(|column| step.apply(column));
        for column in self.transition.chunks_exact_mut(self.estimate.correction.len()) {
            step.apply(column);
        }
        self.add_noise(seconds, finite_rate, force.is_some(), more_noise);
        self.time_s = sample.time_s;
        Ok(())
    }

    /// Absorbs an attitude and a velocity of the antennas, measured at the filter's time. Each of them
    /// passes the gate as a whole or not at all.
    pub fn correct(
        &mut self,
        attitude: Option<&MeasuredAttitude>,
        velocity: Option<&MeasuredVelocity>,
    ) -> Corrected {
        self.batch.begin(self.states());
        let mut corrected = Corrected::default();
        if let Some(measured) = attitude {
            let rotation = Rotation3::from_matrix_unchecked(measured.ned_from_body.matrix());
            let seen = UnitQuaternion::from_rotation_matrix(&rotation);
            let error = (self.nominal.attitude.inverse() * seen).scaled_axis();
            corrected.attitude = self.push(ATTITUDE, &error, &measured.covariance);
        }
        let after_attitude = self.batch.len();
        if let Some(measured) = velocity {
            let error = measured.velocity_mps.xyz() - self.nominal.velocity_mps;
            corrected.velocity = self.push(VELOCITY, &error, &measured.covariance);
        }
        self.estimate.update(&mut self.batch, Gate::Open);
        self.nominal = self.nominal.moved(self.estimate.correction.as_slice());
        let (of_attitude, of_velocity) = self.batch.outcomes().split_at(after_attitude);
        corrected.attitude.nis = of_attitude.iter().map(|o| o.normalised_square).sum();
        corrected.velocity.nis = of_velocity.iter().map(|o| o.normalised_square).sum();
        corrected
    }

    /// Adds three correlated measurements of a block of states as three independent ones of variance
    /// 1, if they pass the gate; says how many were used or rejected, none if they say nothing.
    fn push(&mut self, block: usize, error: &Vector3<f64>, covariance: &Matrix3<f64>) -> Tally {
        let Some(whitener) = whitener(covariance) else { return Tally::default() };
        if !error.iter().all(|value| value.is_finite()) {
            return Tally::default();
        }
        let predicted = self.estimate.covariance.fixed_view::<3, 3>(block, block).into_owned();
        if !self.passes(error, &predicted, covariance) {
            return Tally { rejected: 3, ..Tally::default() };
        }
        let white = whitener * error;
        for axis in 0..3 {
            let row = self.batch.push(white[axis], 1.0);
            for k in 0..3 {
                row[block + k] = whitener[(axis, k)];
            }
        }
        Tally { used: 3, ..Tally::default() }
    }

    /// eᵀ(P + N)⁻¹e or eᵀN⁻¹e is no less probable than so many sigmas of a single value.
    fn passes(&self, error: &Vector3<f64>, predicted: &Matrix3<f64>, noise: &Matrix3<f64>) -> bool {
        let (sigmas, covariance) = match self.settings.gate {
            Gate::Open => return true,
            Gate::NoiseOnly { sigmas } => (sigmas, *noise),
            Gate::Innovation { sigmas } => (sigmas, predicted + noise),
        };
        let Some(factor) = covariance.cholesky() else { return false };
        let square = error.dot(&factor.solve(error));
        // Probabilities this small are no longer told apart.
        const SMALLEST: f64 = 1e-12;
        let least = chi_square_tail(sigmas * sigmas, 1).max(SMALLEST);
        square < sigmas * sigmas || chi_square_tail(square, 3) > least
    }

    /// Time of the state.
    #[must_use]
    pub const fn time_s(&self) -> f64 {
        self.time_s
    }

    /// Attitude.
    #[must_use]
    pub fn ned_from_body(&self) -> Rotation<Ned, Body> {
        Rotation::from_matrix(self.nominal.attitude.to_rotation_matrix().into_inner())
    }

    /// Covariance of the rotation vector of the attitude error in body axes, rad².
    #[must_use]
    pub fn attitude_covariance(&self) -> Matrix3<f64> {
        self.estimate.covariance.fixed_view::<3, 3>(ATTITUDE, ATTITUDE).into_owned()
    }

    /// Attitude, velocity, biases and mounting.
    #[must_use]
    pub const fn nominal(&self) -> &Nominal {
        &self.nominal
    }

    /// Covariance of the error state: attitude, gyro bias, velocity, accelerometer bias, and mounting if it is
    /// not exact.
    #[must_use]
    pub const fn covariance(&self) -> &nalgebra::DMatrix<f64> {
        &self.estimate.covariance
    }

    /// Number of error states.
    pub(super) fn states(&self) -> usize {
        self.estimate.correction.len()
    }

    /// The transition of the error state since the last call, as columns; starts a new one.
    pub(super) fn take_transition(&mut self) -> Vec<f64> {
        let states = self.states();
        core::mem::replace(&mut self.transition, identity(states))
    }

    /// Turns and accelerates the nominal state; returns the linear part for its errors.
    fn advance_nominal(
        &mut self,
        seconds: f64,
        rate: &Vector3<f64>,
        force: Option<Vector3<f64>>,
    ) -> Step {
        let body_from_ned = self.nominal.attitude.inverse();
        // ω_b = ω − b − Cᵀ(Ω + ω_t), ω_t the turning of the level axes along the way
        let transport = self.place.transport_rate(&self.nominal.velocity_mps);
        let level_rate = body_from_ned * (self.place.earth_rate_ned + transport);
        let turn = (rate - self.nominal.gyro_bias_radps - level_rate) * seconds;
        let mut velocity_by_attitude = Matrix3::zeros();
        let mut velocity_by_bias = Matrix3::zeros();
        if let Some(force) = force {
            // The force is the mean over the step: it acts along the axes half-way.
            let half_way = self.nominal.attitude * UnitQuaternion::from_scaled_axis(turn / 2.0);
            let ned_from_body = half_way.to_rotation_matrix().into_inner();
            let felt = force - self.nominal.accelerometer_bias_mps2;
            // v̇ = C f + g − (2 Ω + ω_t)×v
            let turning = self.place.earth_rate_ned * 2.0 + transport;
            let coriolis = turning.cross(&self.nominal.velocity_mps);
            let acceleration = ned_from_body * felt + self.place.gravity_ned_mps2 - coriolis;
            self.nominal.velocity_mps += acceleration * seconds;
            // δv̇ = −C [f×] φ − C δb
            velocity_by_attitude = -ned_from_body * felt.cross_matrix() * seconds;
            velocity_by_bias = -ned_from_body * seconds;
        }
        self.nominal.attitude *= UnitQuaternion::from_scaled_axis(turn);
        self.nominal.attitude.renormalize_fast();
        let turn_back = Rotation3::new(-turn).into_inner();
        let attitude_by_mounting = -rate.cross_matrix() * seconds;
        Step { seconds, turn_back, velocity_by_attitude, velocity_by_bias, attitude_by_mounting }
    }

    fn add_noise(&mut self, seconds: f64, has_rate: bool, has_force: bool, more: [f64; 2]) {
        let s = &self.settings;
        let gyro_noise = if has_rate { s.gyro_noise.hypot(more[0]) } else { UNKNOWN_TURNING };
        let of_force = s.accelerometer_noise.hypot(more[1]);
        let velocity_noise = if has_force { of_force } else { s.unknown_acceleration };
        for (start, density) in [
            (ATTITUDE, gyro_noise),
            (GYRO_BIAS, s.gyro_bias_walk),
            (VELOCITY, velocity_noise),
            (ACCELEROMETER_BIAS, s.accelerometer_bias_walk),
        ] {
            for index in start..start + 3 {
                self.estimate.covariance[(index, index)] += density * density * seconds;
            }
        }
    }
}

impl Place {
    fn at(place: &Geodetic) -> Self {
        let (sin, cos) = place.latitude_rad.sin_cos();
        let gravity_mps2 = normal_gravity_mps2(place.latitude_rad, place.height_m);
        Self {
            gravity_ned_mps2: Vector3::new(0.0, 0.0, gravity_mps2),
            earth_rate_ned: Vector3::new(cos, 0.0, -sin) * EARTH_RATE_RADPS,
            by_radius: place.curvature_radii_m().map(|radius_m| 1.0 / (radius_m + place.height_m)),
            // Within a kilometre of a pole the level axes turn without limit: not followed.
            tan_latitude: sin / cos.max(1e-4),
        }
    }

    /// ω_t = (v_e/(N+h), −v_n/(M+h), −v_e tan φ/(N+h)) in level axes, rad/s.
    fn transport_rate(&self, velocity_mps: &Vector3<f64>) -> Vector3<f64> {
        let [meridian, across] = self.by_radius;
        let (north, east) = (velocity_mps.x * meridian, velocity_mps.y * across);
        Vector3::new(east, -north, -east * self.tan_latitude)
    }
}

impl Step {
    /// Multiplies one column by Φ.
    fn apply(&self, column: &mut [f64]) {
        let part = |column: &[f64], start: usize| {
            Vector3::new(column[start], column[start + 1], column[start + 2])
        };
        let phi = part(column, ATTITUDE);
        // φ⁺ = exp[−ω Δt×] φ − δb Δt − [ω×] μ Δt;  δv⁺ = δv − C [f×] (φ + μ) Δt − C δb Δt
        let mut velocity = part(column, VELOCITY)
            + self.velocity_by_attitude * phi
            + self.velocity_by_bias * part(column, ACCELEROMETER_BIAS);
        let mut attitude = self.turn_back * phi - part(column, GYRO_BIAS) * self.seconds;
        if column.len() == STATES {
            let mounting = part(column, MOUNTING);
            attitude += self.attitude_by_mounting * mounting;
            velocity += self.velocity_by_attitude * mounting;
        }
        column[ATTITUDE..ATTITUDE + 3].copy_from_slice(attitude.as_slice());
        column[VELOCITY..VELOCITY + 3].copy_from_slice(velocity.as_slice());
    }
}

/// L⁻¹ of covariance = L Lᵀ; `None` if it is not positive definite.
fn whitener(covariance: &Matrix3<f64>) -> Option<Matrix3<f64>> {
    covariance.cholesky()?.l().try_inverse()
}

fn identity(states: usize) -> Vec<f64> {
    let mut columns = vec![0.0; states * states];
    columns.iter_mut().step_by(states + 1).for_each(|diagonal| *diagonal = 1.0);
    columns
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frames::Attitude;

    fn settings() -> InertialSettings {
        InertialSettings {
            gyro_noise: 3e-5,
            gyro_bias_sd_radps: 5e-5,
            gyro_bias_walk: 1e-7,
            accelerometer_noise: 1e-3,
            accelerometer_bias_sd_mps2: 0.02,
            accelerometer_bias_walk: 1e-5,
            mounting_sd_rad: 0.02,
            unknown_acceleration: 1.0,
            gate: Gate::Innovation { sigmas: 5.0 },
        }
    }

    fn filter() -> AttitudeFilter {
        let attitude = Attitude { heading_rad: 0.7, pitch_rad: 0.1, roll_rad: -0.2 };
        AttitudeFilter::new(
            settings(),
            0.0,
            &Geodetic::from_degrees(55.75, 37.62, 200.0),
            &MeasuredAttitude {
                ned_from_body: attitude.ned_from_body(),
                covariance: Matrix3::identity() * 1e-6,
            },
            &MeasuredVelocity {
                velocity_mps: Vector::new(1.0, 2.0, 0.0),
                covariance: Matrix3::identity() * 1e-4,
            },
        )
    }

    /// At rest the gyro feels the Earth's rate and the accelerometers the plumb line only.
    #[test]
    fn a_resting_body_stays_at_rest() {
        let mut filter = filter();
        filter.nominal.velocity_mps = Vector3::zeros();
        let before = filter.nominal;
        let body_from_ned = before.attitude.inverse();
        let rate_radps = Vector::from_xyz(body_from_ned * filter.place.earth_rate_ned);
        let force = Vector::from_xyz(body_from_ned * -filter.place.gravity_ned_mps2);
        for step in 1..=1000 {
            let sample = InertialSample {
                time_s: f64::from(step) * 0.01,
                rate_radps,
                specific_force_mps2: Some(force),
            };
            filter.integrate(&sample).unwrap();
        }
        let moved = filter.nominal.error_from(&before);
        assert!(moved.iter().all(|error| error.abs() < 1e-10), "{moved:?}");
    }

    /// The transition against differences of the nominal integration.
    #[test]
    fn transition_agrees_with_differences() {
        let sample = InertialSample {
            time_s: 0.01,
            rate_radps: Vector::new(0.4, -0.7, 0.9),
            specific_force_mps2: Some(Vector::new(1.0, -2.0, -9.0)),
        };
        let integrated = |start: &Nominal| {
            let mut filter = filter();
            filter.nominal = *start;
            filter.integrate(&sample).unwrap();
            filter
        };
        let base = filter().nominal;
        let mut at = integrated(&base);
        let transition = at.take_transition();
        let step = 1e-4;
        for state in 0..STATES {
            let mut change = [0.0; STATES];
            change[state] = step;
            let after = integrated(&base.moved(&change)).nominal.error_from(&at.nominal);
            change[state] = -step;
            let before = integrated(&base.moved(&change)).nominal.error_from(&at.nominal);
            for row in 0..STATES {
                let difference = (after[row] - before[row]) / (2.0 * step);
                let error = (difference - transition[state * STATES + row]).abs();
                // First order in the step: half-way axes and the Earth's rate are left out.
                assert!(error < 1e-3, "{row} {state}: {difference}");
            }
        }
    }

    /// A box that leans by 2°, on a body that turns about the vertical with an attitude each second: its error
    /// is found, or at least known, and where it is taken to be exact the attitude is off by many sigmas.
    #[test]
    fn an_uncertain_mounting_is_found() {
        let leaning = UnitQuaternion::from_scaled_axis(Vector3::new(0.02, -0.03, 0.0));
        let off = |mounting_sd_rad: f64| {
            let place = Geodetic::from_degrees(55.75, 37.62, 200.0);
            let velocity = MeasuredVelocity {
                velocity_mps: Vector::new(0.0, 0.0, 0.0),
                covariance: Matrix3::identity() * 1e-4,
            };
            let level = |heading_rad| Attitude { heading_rad, pitch_rad: 0.0, roll_rad: 0.0 };
            let measured = |heading_rad: f64| MeasuredAttitude {
                ned_from_body: level(heading_rad).ned_from_body(),
                covariance: Matrix3::identity() * 1e-5,
            };
            let settings = InertialSettings { mounting_sd_rad, gate: Gate::Open, ..settings() };
            let first = measured(0.0);
            let mut filter = AttitudeFilter::new(settings, 0.0, &place, &first, &velocity);
            let turning = Vector3::new(0.0, 0.0, 0.5);
            for step in 1..=6000 {
                let time_s = f64::from(step) * 0.01;
                let middle = measured((time_s - 0.005) * turning.z).ned_from_body;
                let body_from_ned = middle.matrix().transpose();
                let rate = turning + body_from_ned * filter.place.earth_rate_ned;
                let force = body_from_ned * -filter.place.gravity_ned_mps2;
                let sample = InertialSample {
                    time_s,
                    rate_radps: Vector::from_xyz(leaning.inverse() * rate),
                    specific_force_mps2: Some(Vector::from_xyz(leaning.inverse() * force)),
                };
                filter.integrate(&sample).unwrap();
                if step % 100 == 0 {
                    filter.correct(Some(&measured(time_s * turning.z)), Some(&velocity));
                }
            }
            let wanted = measured(60.0 * turning.z).ned_from_body;
            let wanted = Rotation3::from_matrix_unchecked(wanted.matrix());
            let wanted = UnitQuaternion::from_rotation_matrix(&wanted);
            let error = (filter.nominal.attitude.inverse() * wanted).scaled_axis();
            let covariance = filter.attitude_covariance();
            let square = error.dot(&(covariance.try_inverse().unwrap() * error)) / 3.0;
            let left = (leaning * filter.nominal.mounting.inverse()).scaled_axis();
            (square, left.xy().norm())
        };
        let (square, left) = off(0.03);
        assert!(square < 1.0 && left < 0.003, "{square} {left}");
        let (square, _) = off(0.0);
        assert!(square > 10.0, "{square}");
    }

    #[test]
    fn bad_samples_are_named_or_survived() {
        let mut filter = filter();
        let sample = |time_s, x| InertialSample {
            time_s,
            rate_radps: Vector::new(x, 0.0, 0.0),
            specific_force_mps2: None,
        };
        filter.integrate(&sample(1.0, 0.0)).unwrap();
        assert_eq!(
            filter.integrate(&sample(0.5, 0.0)),
            Err(FilterError::TimeGoesBack { from_s: 1.0, to_s: 0.5 })
        );
        assert_eq!(filter.integrate(&sample(12.0, 0.0)), Err(FilterError::Gap { gap_s: 11.0 }));
        let sure = filter.attitude_covariance().trace();
        filter.integrate(&sample(1.5, f64::NAN)).unwrap();
        assert!(filter.nominal.attitude.coords.iter().all(|c| c.is_finite()));
        assert!(filter.attitude_covariance().trace() > sure + 1.0);
        let unusable = MeasuredAttitude {
            ned_from_body: filter.ned_from_body(),
            covariance: Matrix3::zeros(),
        };
        assert_eq!(filter.correct(Some(&unusable), None), Corrected::default());
    }
}
