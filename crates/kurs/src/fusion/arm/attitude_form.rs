//! Two ways to carry the attitude in the state: the angles of the paper, or a quaternion with its
//! small error. The first is singular at pitch ±90°, the second nowhere; away from there they agree.

use nalgebra::{Rotation3, UnitQuaternion, Vector3};

use super::gradient::{Gradient, Motion};
use super::layout::{ACCELERATION, ATTITUDE, CLOCK, CLOCK_RATE, Layout, POSITION, RATE, VELOCITY};
use super::nhe::{Angles, EulerRotation};
use crate::fusion::earth::local_level::LocalLevel;

/// How the attitude is carried.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum AttitudeForm {
    /// Roll, pitch, heading and their rates, as in the paper.
    #[default]
    Euler,
    /// A quaternion; the state holds the rotation vector of its error in body axes, the rates are
    /// the angular velocity in body axes.
    Quaternion,
}

/// The attitude part of the nominal state.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Carried {
    /// The angles are in the state vector.
    Euler,
    /// NHE from body; the attitude block of the state vector stays zero.
    Quaternion(UnitQuaternion<f64>),
}

/// The motion that a state stands for, with what its gradients need on the way back to the state.
#[derive(Debug, Clone, Copy)]
pub struct Decoded {
    /// The motion.
    pub motion: Motion,
    euler: Option<EulerRotation>,
}

/// Three elements of a state vector.
pub(super) fn triple(x: &[f64], start: usize) -> Vector3<f64> {
    Vector3::new(x[start], x[start + 1], x[start + 2])
}

impl Carried {
    /// From angles; writes them or zeros into the attitude block of `x`.
    pub(super) fn new(form: AttitudeForm, angles: &Angles, x: &mut [f64]) -> Self {
        match form {
            AttitudeForm::Euler => {
                let values = [angles.roll_rad, angles.pitch_rad, angles.heading_rad];
                x[ATTITUDE].copy_from_slice(&values);
                Self::Euler
            }
            AttitudeForm::Quaternion => {
                x[ATTITUDE].fill(0.0);
                Self::Quaternion(angles.quaternion())
            }
        }
    }

    /// The angles now.
    pub fn angles(&self, x: &[f64]) -> Angles {
        match self {
            Self::Euler => {
                let [roll_rad, pitch_rad, heading_rad] = triple(x, ATTITUDE.start).into();
                Angles { roll_rad, pitch_rad, heading_rad }
            }
            Self::Quaternion(q) => Angles::from_nhe_from_body(q.to_rotation_matrix().matrix()),
        }
    }

    /// The motion of the body that the state stands for.
    pub fn decode(&self, x: &[f64], layout: &Layout, here: &LocalLevel) -> Decoded {
        let second = match layout.angular_acceleration.is_empty() {
            true => Vector3::zeros(),
            false => triple(x, layout.angular_acceleration.start),
        };
        let rates = triple(x, RATE.start);
        let (nhe_from_body, rate_radps, angular_acceleration_radps2, euler) = match self {
            Self::Euler => {
                let angles = self.angles(x);
                let euler = angles.rotation(&rates, &second);
                let matrix = angles.nhe_from_body();
                (matrix, euler.rate_radps, euler.acceleration_radps2, Some(euler))
            }
            Self::Quaternion(q) => (*q.to_rotation_matrix().matrix(), rates, second, None),
        };
        let motion = Motion {
            position_m: triple(x, POSITION.start),
            clock_m: x[CLOCK],
            velocity_mps: triple(x, VELOCITY.start),
            clock_rate_mps: x[CLOCK_RATE],
            acceleration_mps2: triple(x, ACCELERATION.start),
            ecef_from_body: here.nhe_from_ecef.transpose() * nhe_from_body,
            rate_radps,
            angular_acceleration_radps2,
        };
        Decoded { motion, euler }
    }

    /// Moves the nominal state on by `step_s`.
    pub(super) fn advance(&mut self, x: &mut [f64], layout: &Layout, step_s: f64) {
        if let Self::Quaternion(q) = self {
            *q *= UnitQuaternion::from_scaled_axis(turn_in(x, layout, step_s));
            q.renormalize_fast();
        }
        translate(x, step_s);
        match self {
            Self::Euler => integrate_angles(x, layout, step_s),
            Self::Quaternion(_) => integrate_rates(x, layout, step_s),
        }
    }

    /// Φ for the step just before [`Carried::advance`], as a function that multiplies one column.
    pub(super) fn transition<'a>(
        &self,
        x: &[f64],
        layout: &'a Layout,
        step_s: f64,
    ) -> impl Fn(&mut [f64]) + use<'a> {
        // φ⁺ = Rᵀ φ + J δω Δt + δω̇ Δt²/2,  R = exp[θ×], J = I − [θ×]/2, θ the turn of the step
        let turn = match self {
            Self::Euler => None,
            Self::Quaternion(_) => {
                let theta = turn_in(x, layout, step_s);
                let back = Rotation3::new(-theta).into_inner();
                let jacobian = nalgebra::Matrix3::identity() - theta.cross_matrix() / 2.0;
                Some((back, jacobian * step_s))
            }
        };
        move |column: &mut [f64]| {
            translate(column, step_s);
            match turn {
                None => integrate_angles(column, layout, step_s),
                Some((back, by_rate)) => {
                    let mut phi = back * triple(column, ATTITUDE.start)
                        + by_rate * triple(column, RATE.start);
                    if !layout.angular_acceleration.is_empty() {
                        let second = triple(column, layout.angular_acceleration.start);
                        phi += second * (step_s * step_s / 2.0);
                    }
                    column[ATTITUDE].copy_from_slice(phi.as_slice());
                    integrate_rates(column, layout, step_s);
                }
            }
        }
    }

    /// Adds the correction of a measurement update; returns the small rotation that the attitude
    /// error is now counted from, if it moved.
    pub(super) fn correct(&mut self, x: &mut [f64], correction: &[f64]) -> Option<Vector3<f64>> {
        for (value, change) in x.iter_mut().zip(correction) {
            *value += change;
        }
        let Self::Quaternion(q) = self else { return None };
        let phi = triple(correction, ATTITUDE.start);
        *q *= UnitQuaternion::from_scaled_axis(phi);
        x[ATTITUDE].fill(0.0);
        Some(phi)
    }
}

impl Decoded {
    /// The derivative by the state from the derivative by the motion, into one row of H.
    pub fn write_row(&self, gradient: &Gradient, layout: &Layout, row: &mut [f64]) {
        row[POSITION].copy_from_slice(gradient.position.as_slice());
        row[CLOCK] = gradient.clock;
        row[VELOCITY].copy_from_slice(gradient.velocity.as_slice());
        row[CLOCK_RATE] = gradient.clock_rate;
        row[ACCELERATION].copy_from_slice(gradient.acceleration.as_slice());
        let Gradient { attitude, rate, angular_acceleration, .. } = *gradient;
        let (by_attitude, by_rate, by_second) = match &self.euler {
            None => (attitude, rate, angular_acceleration),
            // φ = E δq, ω = E q̇, ω̇ = E q̈ + Ė q̇: chain rule with q = (r, p, h)
            Some(euler) => (
                euler.rate_matrix.tr_mul(&attitude)
                    + euler.rate_by_angles.tr_mul(&rate)
                    + euler.acceleration_by_angles.tr_mul(&angular_acceleration),
                euler.rate_matrix.tr_mul(&rate)
                    + euler.acceleration_by_rates.tr_mul(&angular_acceleration),
                euler.rate_matrix.tr_mul(&angular_acceleration),
            ),
        };
        row[ATTITUDE].copy_from_slice(by_attitude.as_slice());
        row[RATE].copy_from_slice(by_rate.as_slice());
        if !layout.angular_acceleration.is_empty() {
            row[layout.angular_acceleration.clone()].copy_from_slice(by_second.as_slice());
        }
        if !layout.arm_angle.is_empty() {
            row[layout.arm_angle.start] = gradient.arm_angle;
        }
    }
}

/// Turn of the body in a step, ω Δt + ω̇ Δt²/2.
fn turn_in(x: &[f64], layout: &Layout, step_s: f64) -> Vector3<f64> {
    let mut turn = triple(x, RATE.start) * step_s;
    if !layout.angular_acceleration.is_empty() {
        turn += triple(x, layout.angular_acceleration.start) * (step_s * step_s / 2.0);
    }
    turn
}

/// Position, clock and velocity over a step: exact, because A³ = 0.
pub(super) fn translate(x: &mut [f64], step_s: f64) {
    let half = step_s * step_s / 2.0;
    for axis in 0..3 {
        let acceleration = x[ACCELERATION.start + axis];
        x[POSITION.start + axis] += step_s * x[VELOCITY.start + axis] + half * acceleration;
        x[VELOCITY.start + axis] += step_s * acceleration;
    }
    x[CLOCK] += step_s * x[CLOCK_RATE];
}

/// Angles and rates over a step.
pub(super) fn integrate_angles(x: &mut [f64], layout: &Layout, step_s: f64) {
    for axis in 0..3 {
        x[ATTITUDE.start + axis] += step_s * x[RATE.start + axis];
    }
    if !layout.angular_acceleration.is_empty() {
        for axis in 0..3 {
            let second = x[layout.angular_acceleration.start + axis];
            x[ATTITUDE.start + axis] += step_s * step_s / 2.0 * second;
        }
    }
    integrate_rates(x, layout, step_s);
}

fn integrate_rates(x: &mut [f64], layout: &Layout, step_s: f64) {
    if !layout.angular_acceleration.is_empty() {
        for axis in 0..3 {
            x[RATE.start + axis] += step_s * x[layout.angular_acceleration.start + axis];
        }
    }
}
