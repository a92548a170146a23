//! H of the rotating-arm model against dual numbers, at random points all over the Earth: the model
//! written a second time, straight from its formulas, and differentiated by machine.
#![allow(clippy::cast_possible_truncation)]

use core::f64::consts::{PI, TAU};
use core::ops::{Add, Div, Mul, Neg, Sub};

use kurs::frames::{EARTH_RATE_RADPS, Geodetic};
use kurs::fusion::arm::RotatingArm;
use kurs::fusion::arm::attitude_form::Carried;
use kurs::fusion::arm::gradient::Prediction;
use kurs::fusion::arm::layout::Layout;
use kurs::fusion::arm::model::ArmEnd;
use kurs::fusion::arm::ranging::SatelliteMotion;
use kurs::fusion::earth::local_level::LocalLevel;
use nalgebra::Vector3;
use rand::{RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;

/// 17 states and the three second derivatives of the angles.
const STATES: usize = 20;

/// A value with its derivative by one state.
#[derive(Clone, Copy)]
struct Dual(f64, f64);
type Triple = [Dual; 3];

impl Add for Dual {
    type Output = Self;
    fn add(self, b: Self) -> Self {
        Self(self.0 + b.0, self.1 + b.1)
    }
}
impl Sub for Dual {
    type Output = Self;
    fn sub(self, b: Self) -> Self {
        Self(self.0 - b.0, self.1 - b.1)
    }
}
impl Mul for Dual {
    type Output = Self;
    fn mul(self, b: Self) -> Self {
        Self(self.0 * b.0, self.1 * b.0 + self.0 * b.1)
    }
}
impl Div for Dual {
    type Output = Self;
    fn div(self, b: Self) -> Self {
        Self(self.0 / b.0, (self.1 - self.0 / b.0 * b.1) / b.0)
    }
}
impl Neg for Dual {
    type Output = Self;
    fn neg(self) -> Self {
        Self(-self.0, -self.1)
    }
}

fn constant(value: f64) -> Dual {
    Dual(value, 0.0)
}
fn constants(v: &Vector3<f64>) -> Triple {
    [0, 1, 2].map(|k| constant(v[k]))
}
fn sin_cos(angle: Dual) -> (Dual, Dual) {
    let (sin, cos) = angle.0.sin_cos();
    (Dual(sin, cos * angle.1), Dual(cos, -sin * angle.1))
}
fn add(a: Triple, b: Triple) -> Triple {
    [0, 1, 2].map(|k| a[k] + b[k])
}
fn subtract(a: Triple, b: Triple) -> Triple {
    [0, 1, 2].map(|k| a[k] - b[k])
}
fn times(a: Triple, factor: f64) -> Triple {
    a.map(|component| component * constant(factor))
}
fn dot(a: Triple, b: Triple) -> Dual {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}
fn cross(a: Triple, b: Triple) -> Triple {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}
fn norm(a: Triple) -> Dual {
    let square = dot(a, a);
    let root = square.0.sqrt();
    Dual(root, square.1 / (2.0 * root))
}
/// Matrix (rows) times vector.
fn turn(m: [Triple; 3], v: Triple) -> Triple {
    m.map(|row| dot(row, v))
}
fn transposed(m: [Triple; 3]) -> [Triple; 3] {
    [0, 1, 2].map(|k| [m[0][k], m[1][k], m[2][k]])
}

struct Point {
    x: [f64; STATES],
    arm: RotatingArm,
    time_s: f64,
    satellite: SatelliteMotion,
}

/// Latitudes to ±89°, heights to 20 km, speeds to 3 km/s, pitch to ±80°, turning to 3 rad/s.
fn random_point(generator: &mut Xoshiro256PlusPlus) -> Point {
    let mut within = |limit: f64| limit * (2.0 * generator.random::<f64>() - 1.0);
    let place = Geodetic::from_degrees(within(89.0), within(180.0), 10_000.0 + within(10_000.0));
    let position = place.to_ecef().xyz();
    let mut x = [0.0; STATES];
    x[..3].copy_from_slice(position.as_slice());
    let limits = [
        1e6, 1800.0, 1800.0, 1800.0, 300.0, 50.0, 50.0, 50.0, PI, 1.4, PI, 3.0, 3.0, 3.0, 5.0, 5.0,
        5.0,
    ];
    for (value, limit) in x[3..].iter_mut().zip(limits) {
        *value = within(limit);
    }
    let direction = (position.normalize()
        + Vector3::new(within(1.0), within(1.0), within(1.0)) * 0.5)
        .normalize();
    Point {
        x,
        arm: RotatingArm {
            phase_rad: within(PI),
            centre_m: Vector3::new(within(0.5), within(0.5), within(0.5)),
            ..RotatingArm::new(1.6 + within(1.4), 2.6 + within(2.4))
        },
        time_s: 5.0 + within(5.0),
        satellite: SatelliteMotion {
            position_m: direction * 2.66e7,
            velocity_mps: Vector3::new(within(3e3), within(3e3), within(3e3)),
        },
    }
}

/// D, Ḋ and n with their derivatives by state `seed`, level axes and gravity as constants.
fn measured(p: &Point, seed: usize) -> [Dual; 5] {
    let x = |k: usize| Dual(p.x[k], if k == seed { 1.0 } else { 0.0 });
    let three = |k: usize| [x(k), x(k + 1), x(k + 2)];
    let here = LocalLevel::at(&Vector3::new(p.x[0], p.x[1], p.x[2]));
    let t_en = [0, 1, 2].map(|row| constants(&here.nhe_from_ecef.row(row).transpose()));

    let ((sr, cr), (sp, cp), (sh, ch)) = (sin_cos(x(11)), sin_cos(x(12)), sin_cos(x(13)));
    let ([r1, p1, h1], [r2, p2, h2]) = (three(14), three(17));
    let t_bn = [
        [ch * cp, ch * sp * cr + sh * sr, ch * sp * sr - sh * cr],
        [-sp, cp * cr, cp * sr],
        [sh * cp, sh * sp * cr - ch * sr, sh * sp * sr + ch * cr],
    ];
    let omega = [-(r1 - h1 * sp), p1 * sr - h1 * cr * cp, -(p1 * cr + h1 * sr * cp)];
    let alpha = [
        -(r2 - h2 * sp - h1 * p1 * cp),
        p2 * sr + p1 * r1 * cr - h2 * cr * cp + h1 * r1 * sr * cp + h1 * p1 * cr * sp,
        -(p2 * cr - p1 * r1 * sr + h2 * sr * cp + h1 * r1 * cr * cp - h1 * p1 * sr * sp),
    ];
    // C = T_ENᵀ T_BN
    let to_ecef = |v: Triple| turn(transposed(t_en), turn(t_bn, v));
    let to_body = |v: Triple| turn(transposed(t_bn), turn(t_en, v));

    let theta = TAU * p.arm.rate_hz * p.time_s + p.arm.phase_rad;
    let (sin, cos) = theta.sin_cos();
    let (radius, rate) = (p.arm.radius_m, TAU * p.arm.rate_hz);
    let radial = Vector3::new(cos, sin, 0.0) * radius;
    let rho = constants(&(p.arm.centre_m + radial));
    let rho_dot = constants(&(Vector3::new(-sin, cos, 0.0) * radius * rate));
    let rho_ddot = constants(&(-radial * rate * rate));

    let antenna = add(three(0), to_ecef(rho));
    let velocity = add(three(4), to_ecef(add(cross(omega, rho), rho_dot)));
    let range = subtract(antenna, constants(&p.satellite.position_m));
    let distance = norm(range);
    let relative = subtract(velocity, constants(&p.satellite.velocity_mps));
    let earth = [constant(0.0), constant(0.0), constant(EARTH_RATE_RADPS)];
    let gravity = constants(&(here.up * here.gravity_mps2));
    let felt = add(add(three(8), gravity), times(cross(earth, velocity), 2.0));
    let on_arm = add(
        add(cross(alpha, rho), cross(omega, cross(omega, rho))),
        add(times(cross(omega, rho_dot), 2.0), rho_ddot),
    );
    let [n1, n2, n3] = add(to_body(felt), on_arm);
    [distance + x(3), dot(range, relative) / distance + x(7), n1, n2, n3]
}

/// |ΔH| ≤ 1e-9 max(1, |H|), for 17 and 20 states.
#[test]
fn gradients_are_those_of_dual_numbers() {
    let mut generator = Xoshiro256PlusPlus::seed_from_u64(17);
    let layout = Layout::new(true, false, false, 0);
    let (mut worst, mut worst_value): (f64, f64) = (0.0, 0.0);
    for _ in 0..500 {
        let p = random_point(&mut generator);
        let here = LocalLevel::at(&Vector3::new(p.x[0], p.x[1], p.x[2]));
        let decoded = Carried::Euler.decode(&p.x, &layout, &here);
        let end = ArmEnd::new(&decoded.motion, &p.arm.at_angle(p.arm.angle_rad(p.time_s)));
        let [n1, n2, n3] = end.specific_force(&here, EARTH_RATE_RADPS);
        let found: [Prediction; 5] =
            [end.pseudorange(&p.satellite), end.range_rate(&p.satellite), n1, n2, n3];
        let rows = found.map(|prediction| {
            let mut row = [0.0; STATES];
            decoded.write_row(&prediction.gradient, &layout, &mut row);
            row
        });
        for state in 0..STATES {
            for (k, expected) in measured(&p, state).iter().enumerate() {
                let relative = |a: f64, b: f64| (a - b).abs() / b.abs().max(1.0);
                worst = worst.max(relative(rows[k][state], expected.1));
                worst_value = worst_value.max(relative(found[k].value, expected.0));
            }
        }
    }
    assert!(worst < 1e-9, "{worst:e}");
    assert!(worst_value < 1e-9, "{worst_value:e}");
}
