//! Attitudes at the edges of the methods, against a referee that starts from many attitudes: half
//! turns, flat arrays, satellites on a cone, arrays that are nearly a line.

use core::f64::consts::PI;

use super::scene::random_rotation;
use kurs::attitude::reduction::{BaselineWeight, SingleDifferences};
use kurs::attitude::uniqueness::angle_between;
use kurs::attitude::weighted::exponential;
use kurs::attitude::{AttitudeError, AttitudeProblem, GlobalMinimum, Uniqueness};
use nalgebra::{Matrix3, Vector3};
use rand::{Rng, RngExt, SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use rand_xoshiro::Xoshiro256PlusPlus;

const WEIGHT: BaselineWeight = BaselineWeight::SharedAntenna;
const SIGMA_M: f64 = 0.005;

/// Phases of one band with noise of `noise · 5 mm`.
fn problem(
    random: &mut impl Rng,
    lines_of_sight: &[Vector3<f64>],
    body: &[Vector3<f64>],
    truth: &Matrix3<f64>,
    noise: f64,
) -> AttitudeProblem {
    let mut phases_m = Vec::new();
    for l in body {
        for u in lines_of_sight {
            let normal: f64 = StandardNormal.sample(random);
            phases_m.push(-u.dot(&(truth * l)) + 17.0 + noise * SIGMA_M * normal);
        }
    }
    let sigma_m = vec![SIGMA_M; lines_of_sight.len()];
    let epoch = SingleDifferences { lines_of_sight, sigma_m: &sigma_m, phases_m: &phases_m };
    epoch.reduce().unwrap().problem(body, WEIGHT).unwrap()
}

fn sky(random: &mut impl Rng, satellites: usize) -> Vec<Vector3<f64>> {
    let direction = |_| {
        let elevation: f64 = random.random_range(0.2..1.5);
        let azimuth: f64 = random.random_range(0.0..2.0 * PI);
        let level = elevation.cos();
        Vector3::new(level * azimuth.cos(), level * azimuth.sin(), -elevation.sin())
    };
    (0..satellites).map(direction).collect()
}

fn points(random: &mut impl Rng, count: usize, sides: [f64; 3]) -> Vec<Vector3<f64>> {
    let mut point = || Vector3::from(sides).map(|side| random.random_range(-1.0..1.0) * side);
    (0..count).map(|_| point()).collect()
}

/// The lowest cost that Newton's method reaches from 100 random attitudes.
fn referee(problem: &AttitudeProblem, random: &mut impl Rng) -> f64 {
    let found = (0..100).filter_map(|_| problem.minimum_from(random_rotation(random)).ok());
    found.map(|minimum| minimum.cost).fold(f64::INFINITY, f64::min)
}

fn assert_lowest(global: &GlobalMinimum, problem: &AttitudeProblem, random: &mut impl Rng) {
    let lowest = referee(problem, random);
    let cost = global.minimum.cost;
    assert!(cost <= lowest + 1e-9 * lowest.abs(), "{cost} where {lowest} is reached");
}

#[test]
fn half_turns() {
    let mut random = Xoshiro256PlusPlus::seed_from_u64(1);
    for less in [0.0, 1e-15, 1e-9, 1e-6, 1e-3] {
        for _ in 0..20 {
            let axis = points(&mut random, 1, [1.0; 3])[0].normalize();
            let truth = exponential(&((PI - less) * axis));
            let lines_of_sight = sky(&mut random, 7);
            let body = points(&mut random, 3, [1.0, 1.0, 0.3]);
            let exact = problem(&mut random, &lines_of_sight, &body, &truth, 0.0);
            let found = exact.global_minimum(1.0).unwrap().minimum.rotation;
            assert!((found - truth).norm() < 1e-10, "{}", (found - truth).norm());
            let noisy = problem(&mut random, &lines_of_sight, &body, &truth, 1.0);
            assert_lowest(&noisy.global_minimum(1.0).unwrap(), &noisy, &mut random);
        }
    }
}

#[test]
fn flat_and_almost_straight_arrays_in_much_noise() {
    let mut random = Xoshiro256PlusPlus::seed_from_u64(2);
    for sides in [[1.0, 1.0, 0.0], [1.0, 1.0, 1e-6], [1.0, 0.05, 0.0], [1.0, 0.02, 0.02]] {
        for case in 0..100 {
            let truth = random_rotation(&mut random);
            let satellites = random.random_range(4..10);
            let lines_of_sight = sky(&mut random, satellites);
            let body = points(&mut random, 3, sides);
            let noise = [0.5, 2.0, 8.0][case % 3];
            let problem = problem(&mut random, &lines_of_sight, &body, &truth, noise);
            let global = problem.global_minimum(1.0).unwrap();
            assert!((global.minimum.rotation.determinant() - 1.0).abs() < 1e-12);
            assert_lowest(&global, &problem, &mut random);
        }
    }
}

/// Satellites of one elevation leave the vertical open, antennas in a plane their other side: two
/// attitudes fit exactly as well, whatever the noise, and both are told.
#[test]
fn a_flat_array_under_a_cone_has_two_equal_minima() {
    let mut random = Xoshiro256PlusPlus::seed_from_u64(3);
    for _ in 0..50 {
        let truth = random_rotation(&mut random);
        let cone: Vec<Vector3<f64>> = (0..6)
            .map(|_| {
                let azimuth: f64 = random.random_range(0.0..2.0 * PI);
                Vector3::new(0.6 * azimuth.cos(), 0.6 * azimuth.sin(), -0.8)
            })
            .collect();
        let body = points(&mut random, 3, [1.0, 1.0, 0.0]);
        let problem = problem(&mut random, &cone, &body, &truth, 1.0);
        let global = problem.global_minimum(1.0).unwrap();
        let cost = global.minimum.cost;
        match global.uniqueness {
            Uniqueness::SecondMinimum { rotation, cost_gap } => {
                assert!(cost_gap < 1e-9 * cost.abs(), "{cost_gap} of {cost}");
                let error = (problem.cost(&rotation) - cost).abs();
                assert!(error < 1e-9 * cost.abs());
                assert!(angle_between(&rotation, &global.minimum.rotation) > 1e-3);
            }
            other => panic!("one minimum: {other:?}"),
        }
        assert_lowest(&global, &problem, &mut random);
    }
}

#[test]
fn lines_and_coincident_antennas_have_no_attitude() {
    let mut random = Xoshiro256PlusPlus::seed_from_u64(4);
    let lines_of_sight = sky(&mut random, 8);
    let truth = random_rotation(&mut random);
    let axis = Vector3::new(0.3, -0.7, 0.2);
    for body in [vec![axis], vec![axis, 2.0 * axis, -0.4 * axis], vec![Vector3::zeros(); 3]] {
        let problem = problem(&mut random, &lines_of_sight, &body, &truth, 1.0);
        assert_eq!(problem.minimum(), Err(AttitudeError::Unobservable));
        assert_eq!(problem.global_minimum(1.0), Err(AttitudeError::Unobservable));
    }
}
