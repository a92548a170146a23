//! What antenna and accelerometers at the end of a rotating arm measure: the physically correct
//! model.
//!
//! The antenna's place and speed on the arm enter pseudorange, carrier phase and range rate; the
//! accelerometers sense specific force with gravity, Coriolis, centripetal and Euler terms.
//! Derivatives take the level axes and gravity as constants unless the caller adds
//! [`Gradient::turn_level`] and [`Gradient::turn_gravity`] (below 1e-5 per metre of position).

use nalgebra::{Matrix3, Vector3};

use super::ArmMotion;
use super::gradient::{Gradient, Motion, Prediction};
use super::ranging::SatelliteMotion;
use crate::fusion::earth::local_level::LocalLevel;

/// The arm's end in space, shared by all measurements of one instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ArmEnd {
    motion: Motion,
    arm: ArmMotion,
    /// r_A = r + C ρ.
    position_m: Vector3<f64>,
    /// v_A = v + C (ω×ρ + ρ̇).
    velocity_mps: Vector3<f64>,
    /// ω×ρ + ρ̇, velocity against the body's origin, in body axes.
    relative_velocity_mps: Vector3<f64>,
    /// ∂r_A/∂φ = −C [ρ×], which is also ∂v_A/∂ω.
    position_by_attitude: Matrix3<f64>,
    /// ∂v_A/∂φ = −C [(ω×ρ + ρ̇)×].
    velocity_by_attitude: Matrix3<f64>,
    /// ∂(ω×ρ + ρ̇)/∂θ in body axes.
    relative_velocity_by_angle: Vector3<f64>,
}

impl ArmEnd {
    /// The arm's end for a motion of the body and an arm angle.
    #[must_use]
    pub fn new(motion: &Motion, arm: &ArmMotion) -> Self {
        let c = motion.ecef_from_body;
        let omega = motion.rate_radps;
        let relative_velocity_mps = omega.cross(&arm.position_m) + arm.velocity_mps;
        Self {
            motion: *motion,
            arm: *arm,
            position_m: motion.position_m + c * arm.position_m,
            velocity_mps: motion.velocity_mps + c * relative_velocity_mps,
            relative_velocity_mps,
            position_by_attitude: -c * arm.position_m.cross_matrix(),
            velocity_by_attitude: -c * relative_velocity_mps.cross_matrix(),
            relative_velocity_by_angle: omega.cross(&arm.position_by_angle) + arm.velocity_by_angle,
        }
    }

    /// Antenna position, ECEF, m.
    #[must_use]
    pub const fn position_m(&self) -> Vector3<f64> {
        self.position_m
    }

    /// Antenna velocity, ECEF, m/s.
    #[must_use]
    pub const fn velocity_mps(&self) -> Vector3<f64> {
        self.velocity_mps
    }

    /// D = |r_A − s| + Δ; with the ambiguity added it is the carrier phase in m.
    #[must_use]
    pub fn pseudorange(&self, satellite: &SatelliteMotion) -> Prediction {
        let range = self.position_m - satellite.position_m;
        let distance_m = range.norm();
        let e = range / distance_m;
        Prediction {
            value: distance_m + self.motion.clock_m,
            gradient: Gradient {
                position: e,
                clock: 1.0,
                attitude: self.position_by_attitude.tr_mul(&e),
                arm_angle: e.dot(&(self.motion.ecef_from_body * self.arm.position_by_angle)),
                ..Gradient::ZERO
            },
        }
    }

    /// Ḋ = eᵀ(v_A − ṡ) + Δ̇.
    #[must_use]
    pub fn range_rate(&self, satellite: &SatelliteMotion) -> Prediction {
        let range = self.position_m - satellite.position_m;
        let distance_m = range.norm();
        let e = range / distance_m;
        let velocity = self.velocity_mps - satellite.velocity_mps;
        let rate_mps = e.dot(&velocity);
        // g = (I − e eᵀ)(v_A − ṡ) / |r_A − s|
        let g = (velocity - e * rate_mps) / distance_m;
        let c = &self.motion.ecef_from_body;
        Prediction {
            value: rate_mps + self.motion.clock_rate_mps,
            gradient: Gradient {
                position: g,
                velocity: e,
                clock_rate: 1.0,
                attitude: self.position_by_attitude.tr_mul(&g)
                    + self.velocity_by_attitude.tr_mul(&e),
                rate: self.position_by_attitude.tr_mul(&e),
                arm_angle: g.dot(&(c * self.arm.position_by_angle))
                    + e.dot(&(c * self.relative_velocity_by_angle)),
                ..Gradient::ZERO
            },
        }
    }

    /// n = Cᵀ(a + γ û + 2 Ω×v_A) + ω̇×ρ + ω×(ω×ρ) + 2 ω×ρ̇ + ρ̈, along the three axes of the triad,
    /// without bias. `earth_rate_radps` is Ω.
    #[must_use]
    pub fn specific_force(&self, here: &LocalLevel, earth_rate_radps: f64) -> [Prediction; 3] {
        let Motion {
            ecef_from_body, rate_radps: omega, angular_acceleration_radps2: alpha, ..
        } = self.motion;
        let ArmMotion { position_m: rho, velocity_mps: rho_dot, .. } = self.arm;
        let body_from_ecef = ecef_from_body.transpose();
        let earth_rate = Vector3::new(0.0, 0.0, earth_rate_radps);
        let earth_rate_body = body_from_ecef * earth_rate;

        // s = Cᵀ(a + γ û + 2 Ω×v_A)
        let gravity = here.up * here.gravity_mps2;
        let coriolis = earth_rate.cross(&self.velocity_mps) * 2.0;
        let s = body_from_ecef * (self.motion.acceleration_mps2 + gravity + coriolis);
        let on_the_arm = alpha.cross(&rho)
            + omega.cross(&omega.cross(&rho))
            + omega.cross(&rho_dot) * 2.0
            + self.arm.acceleration_mps2;
        let in_body = s + on_the_arm;

        let earth_skew = earth_rate_body.cross_matrix() * 2.0;
        // ∂n/∂v = 2 Cᵀ[Ω×];  ∂n/∂φ = [s×] − 2 [Ω_b×][u×], u = ω×ρ + ρ̇
        let by_velocity = earth_skew * body_from_ecef;
        let by_attitude = s.cross_matrix() - earth_skew * self.relative_velocity_mps.cross_matrix();
        // ∂n/∂ω = −2 [Ω_b×][ρ×] − [(ω×ρ)×] − [ω×][ρ×] − 2 [ρ̇×];  ∂n/∂ω̇ = −[ρ×]
        let rho_skew = rho.cross_matrix();
        let by_rate = -earth_skew * rho_skew
            - omega.cross(&rho).cross_matrix()
            - omega.cross_matrix() * rho_skew
            - rho_dot.cross_matrix() * 2.0;
        let by_angle = earth_skew * self.relative_velocity_by_angle
            + alpha.cross(&self.arm.position_by_angle)
            + omega.cross(&omega.cross(&self.arm.position_by_angle))
            + omega.cross(&self.arm.velocity_by_angle) * 2.0
            + self.arm.acceleration_by_angle;

        let turn = self.arm.triad_from_body;
        let value = turn * in_body;
        let by_acceleration = turn * body_from_ecef;
        let by_velocity = turn * by_velocity;
        let by_attitude = turn * by_attitude;
        let by_rate = turn * by_rate;
        let by_angular_acceleration = -turn * rho_skew;
        let by_angle = turn * by_angle - self.arm.triad_axis.cross(&value);
        [0, 1, 2].map(|axis| Prediction {
            value: value[axis],
            gradient: Gradient {
                velocity: by_velocity.row(axis).transpose(),
                acceleration: by_acceleration.row(axis).transpose(),
                attitude: by_attitude.row(axis).transpose(),
                rate: by_rate.row(axis).transpose(),
                angular_acceleration: by_angular_acceleration.row(axis).transpose(),
                arm_angle: by_angle[axis],
                ..Gradient::ZERO
            },
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::{RotatingArm, Triad};
    use super::*;
    use crate::frames::{EARTH_RATE_RADPS, Geodetic};
    use nalgebra::Rotation3;

    struct Point {
        motion: Motion,
        arm: RotatingArm,
        angle_rad: f64,
        satellite: SatelliteMotion,
    }

    fn point(triad: Triad) -> Point {
        let position_m = Geodetic::from_degrees(55.75, 37.62, 200.0).to_ecef().xyz();
        Point {
            motion: Motion {
                position_m,
                clock_m: 1500.0,
                velocity_mps: Vector3::new(130.0, -200.0, -40.0),
                clock_rate_mps: -12.0,
                acceleration_mps2: Vector3::new(4.0, 14.0, -6.0),
                ecef_from_body: *Rotation3::from_euler_angles(0.4, -0.9, 2.0).matrix(),
                rate_radps: Vector3::new(0.6, -0.5, 1.1),
                angular_acceleration_radps2: Vector3::new(-0.7, 0.2, 0.9),
            },
            arm: RotatingArm {
                centre_m: Vector3::new(0.2, -0.1, 0.3),
                triad,
                ..RotatingArm::new(1.4, 1.7)
            },
            angle_rad: 0.8,
            satellite: SatelliteMotion {
                position_m: position_m + Vector3::new(8.0e6, 1.2e7, 1.6e7),
                velocity_mps: Vector3::new(-2300.0, 1060.0, 1240.0),
            },
        }
    }

    /// All five predictions.
    fn predict(p: &Point) -> [Prediction; 5] {
        let end = ArmEnd::new(&p.motion, &p.arm.at_angle(p.angle_rad));
        let here = LocalLevel::at(&point(p.arm.triad).motion.position_m);
        let [n1, n2, n3] = end.specific_force(&here, EARTH_RATE_RADPS);
        [end.pseudorange(&p.satellite), end.range_rate(&p.satellite), n1, n2, n3]
    }

    /// Moves a point along one axis.
    type Change = fn(&mut Point, usize, f64);
    /// The gradient's part along that axis.
    type Part = fn(&Gradient, usize) -> f64;

    /// Everything with three axes, with the step and the tolerance of its differences.
    const VECTORS: [(Change, Part, f64, f64); 6] = [
        (|p, axis, h| p.motion.position_m[axis] += h, |g, axis| g.position[axis], 10.0, 1e-8),
        (|p, axis, h| p.motion.velocity_mps[axis] += h, |g, axis| g.velocity[axis], 1.0, 1e-9),
        (
            |p, axis, h| p.motion.acceleration_mps2[axis] += h,
            |g, axis| g.acceleration[axis],
            1.0,
            1e-9,
        ),
        (|p, axis, h| turn(p, axis, h), |g, axis| g.attitude[axis], 1e-4, 1e-6),
        (|p, axis, h| p.motion.rate_radps[axis] += h, |g, axis| g.rate[axis], 1e-4, 1e-7),
        (
            |p, axis, h| p.motion.angular_acceleration_radps2[axis] += h,
            |g, axis| g.angular_acceleration[axis],
            1e-2,
            1e-9,
        ),
    ];
    const SCALARS: [(Change, Part, f64, f64); 3] = [
        (|p, _, h| p.motion.clock_m += h, |g, _| g.clock, 1.0, 1e-9),
        (|p, _, h| p.motion.clock_rate_mps += h, |g, _| g.clock_rate, 1.0, 1e-9),
        (|p, _, h| p.angle_rad += h, |g, _| g.arm_angle, 1e-4, 1e-6),
    ];

    fn turn(p: &mut Point, axis: usize, angle_rad: f64) {
        let mut phi = Vector3::zeros();
        phi[axis] = angle_rad;
        p.motion.ecef_from_body *= *Rotation3::new(phi).matrix();
    }

    #[test]
    fn gradients_agree_with_differences() {
        for triad in [Triad::HeldParallel, Triad::TurnsWithArm] {
            let at = predict(&point(triad));
            let vectors = VECTORS.iter().flat_map(|row| [0, 1, 2].map(|axis| (row, axis)));
            for ((change, part, step, tolerance), axis) in
                vectors.chain(SCALARS.iter().map(|row| (row, 0)))
            {
                let moved = |h: f64| {
                    let mut p = point(triad);
                    change(&mut p, axis, h);
                    predict(&p)
                };
                let (after, before) = (moved(*step), moved(-step));
                for k in 0..5 {
                    // The pseudorange of 2e7 m carries 4e-9 m of rounding.
                    let rounding = if k == 0 { 4e-9 / step } else { 0.0 };
                    let difference = (after[k].value - before[k].value) / (2.0 * step);
                    let error = (difference - part(&at[k].gradient, axis)).abs();
                    let allowed = tolerance * difference.abs().max(1.0) + rounding;
                    assert!(error < allowed, "{k}, axis {axis}: {error:e}");
                }
            }
        }
    }

    /// A triad fixed on a resting, level arm that is not turning feels 1 g upwards.
    #[test]
    fn at_rest_gravity_alone() {
        let mut p = point(Triad::HeldParallel);
        let here = LocalLevel::at(&p.motion.position_m);
        p.motion.velocity_mps = Vector3::zeros();
        p.motion.acceleration_mps2 = Vector3::zeros();
        p.motion.rate_radps = Vector3::zeros();
        p.motion.angular_acceleration_radps2 = Vector3::zeros();
        p.motion.ecef_from_body = here.nhe_from_ecef.transpose();
        let end = ArmEnd::new(&p.motion, &RotatingArm::new(1.0, 0.0).at_angle(0.3));
        let n = end.specific_force(&here, EARTH_RATE_RADPS).map(|axis| axis.value);
        assert!(n[0].abs() < 1e-12 && n[2].abs() < 1e-12);
        assert!((n[1] - 9.815).abs() < 0.002, "{n:?}");
    }
}
