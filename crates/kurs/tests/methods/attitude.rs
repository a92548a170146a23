//! Properties of the attitude methods on random problems, and reduced runs of the studies.

use super::scene::{Antennas, Scene, random_rotation};
use kurs::attitude::coordinates::{CoordinateNormal, MeasuredPoint};
use kurs::attitude::reduction::{BaselineWeight, SingleDifferences};
use kurs::attitude::undifferenced::{self, UndifferencedPhase};
use kurs::attitude::weighted::{exponential, logarithm};
use kurs::attitude::{AttitudeProblem, Uniqueness, joint};
use kurs::frames::skew;
use nalgebra::{DMatrix, DVector, Matrix3, Matrix6, Vector3};
use proptest::prelude::*;
use rand::seq::SliceRandom;
use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use rand_xoshiro::Xoshiro256PlusPlus;

const FULL: BaselineWeight = BaselineWeight::SharedAntenna;

fn roof_scene(seed: u64) -> Scene {
    let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
    let body = Antennas::Roof.baselines(&mut random);
    Scene::random(&mut random, 9, body, 1.0)
}

fn solved(problem: &AttitudeProblem) -> Matrix3<f64> {
    problem.global_minimum(1.0).unwrap().minimum.rotation
}

/// `cargo run --release -p kurs --example attitude_study -- minima` is the full run.
#[test]
fn wahba_and_newton_reach_the_global_minimum() {
    for (antennas, noise) in [(Antennas::Roof, 0.4), (Antennas::Roof, 1.0), (Antennas::Cube, 4.0)] {
        let study = super::minima::study(antennas, 300, noise);
        assert_eq!(study.newton_misses, [0_usize; 0], "{antennas:?} ×{noise}");
        assert_eq!(study.checked_misses, [0_usize; 0], "{antennas:?} ×{noise}");
        assert!(study.certified >= 270, "{antennas:?} ×{noise}: {study:?}");
        assert!(study.iterations <= 300 * 9 / 2, "{antennas:?} ×{noise}: {study:?}");
    }
}

/// Medians of reference figures (`docs/papers/000-relative-orientation.md`): as printed the continuation
/// diverges; scaled, two steps leave some hundredths of a degree and Newton's method nothing.
#[test]
fn continuation_against_newton() {
    let errors = super::continuation::errors(60);
    let median = |name: &str| {
        let found = errors.iter().find(|errors| errors.name == name).unwrap();
        found.angles_deg[found.angles_deg.len() / 2]
    };
    assert!(median("Euler 2, as printed") > 20.0);
    assert!((0.1..1.0).contains(&median("Wahba start")));
    assert!((0.01..0.15).contains(&median("Euler 2, κ = tr N/3")));
    assert!(median("Euler 4, κ = tr N/3") < median("Euler 2, κ = tr N/3"));
    assert!(median("1 Newton step") < 5e-3);
    assert!(median("3 Newton steps") < 1e-12);
    let euler = errors.iter().find(|errors| errors.name == "Euler 2, κ = tr N/3").unwrap();
    let polar = errors.iter().find(|errors| errors.name == "polar 2, κ").unwrap();
    assert!(euler.defect > 1e-6 && polar.defect < 1e-13, "{} {}", euler.defect, polar.defect);
}

#[test]
fn turning_the_array_turns_the_answer() {
    for seed in 0..50 {
        let mut scene = roof_scene(seed);
        let before = solved(&scene.problem(FULL).unwrap());
        let turn = random_rotation(&mut Xoshiro256PlusPlus::seed_from_u64(1000 + seed));
        scene.body.iter_mut().for_each(|l| *l = turn * *l);
        let after = solved(&scene.problem(FULL).unwrap());
        assert!((after - before * turn.transpose()).norm() < 1e-12);
    }
}

#[test]
fn numbering_does_not_matter() {
    for seed in 0..50 {
        let scene = roof_scene(seed);
        let before = solved(&scene.problem(FULL).unwrap());
        let mut random = Xoshiro256PlusPlus::seed_from_u64(2000 + seed);
        let (satellites, rows) = (scene.lines_of_sight.len(), scene.sigma_m.len());
        let mut order: Vec<usize> = (0..satellites).collect();
        order.shuffle(&mut random);
        let mut antennas: Vec<usize> = (0..scene.body.len()).collect();
        antennas.shuffle(&mut random);
        let row_of = |row: usize| row / satellites * satellites + order[row % satellites];
        let renumbered = Scene {
            lines_of_sight: order.iter().map(|s| scene.lines_of_sight[*s]).collect(),
            body: antennas.iter().map(|a| scene.body[*a]).collect(),
            sigma_m: (0..rows).map(|row| scene.sigma_m[row_of(row)]).collect(),
            phases_m: antennas
                .iter()
                .flat_map(|antenna| (0..rows).map(move |row| (antenna, row)))
                .map(|(antenna, row)| scene.phases_m[antenna * rows + row_of(row)])
                .collect(),
        };
        let after = solved(&renumbered.problem(FULL).unwrap());
        assert!((after - before).norm() < 1e-12);
    }
}

#[test]
fn antenna_zero_is_not_special() {
    for seed in 0..50 {
        let scene = roof_scene(seed);
        let before = solved(&scene.problem(FULL).unwrap());
        // Differences to antenna 2 instead.
        let (rows, chosen) = (scene.sigma_m.len(), 1);
        let phase = |baseline: usize, row: usize| scene.phases_m[baseline * rows + row];
        let mut other = Scene {
            lines_of_sight: scene.lines_of_sight.clone(),
            sigma_m: scene.sigma_m.clone(),
            body: vec![-scene.body[chosen]],
            phases_m: (0..rows).map(|row| -phase(chosen, row)).collect(),
        };
        for baseline in (0..scene.body.len()).filter(|baseline| *baseline != chosen) {
            other.body.push(scene.body[baseline] - scene.body[chosen]);
            other.phases_m.extend((0..rows).map(|row| phase(baseline, row) - phase(chosen, row)));
        }
        let after = solved(&other.problem(FULL).unwrap());
        assert!((after - before).norm() < 1e-12);
        // The published weight does depend on it.
        let [a, b] = [&scene, &other]
            .map(|scene| solved(&scene.problem(BaselineWeight::Independent).unwrap()));
        assert!((a - b).norm() > 1e-6);
    }
}

/// Star, chain and anything between, with the covariance that belongs to each.
#[test]
fn every_spanning_tree_gives_the_same_attitude() {
    for seed in 0..50 {
        let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
        let (star, star_body, information) = measured_star(&mut random);
        let before = joint_problem(&star_body, &star, &information);
        // Antenna i hangs on an earlier one: parents[i − 1] < i.
        let parents: Vec<usize> =
            (0..star_body.len()).map(|i| random.random_range(0..=i)).collect();
        let edges = DMatrix::from_fn(star_body.len(), star_body.len(), |edge, antenna| {
            f64::from(u8::from(antenna == edge)) - f64::from(u8::from(antenna + 1 == parents[edge]))
        });
        let tree_body: Vec<Vector3<f64>> = (0..star_body.len())
            .map(|edge| (0..star_body.len()).map(|a| edges[(edge, a)] * star_body[a]).sum())
            .collect();
        let transform = edges.kronecker(&DMatrix::identity(3, 3));
        let back = transform.clone().try_inverse().unwrap();
        let weight = back.transpose() * information * back;
        let after = joint_problem(&tree_body, &(&transform * star), &weight);
        assert!((solved(&before) - solved(&after)).norm() < 1e-12);
    }
}

fn joint_problem(
    body: &[Vector3<f64>],
    z: &DVector<f64>,
    weight: &DMatrix<f64>,
) -> AttitudeProblem {
    joint::problem(body, z, &(0.5 * (weight + weight.transpose()))).unwrap()
}

/// Baselines of five antennas with a random full information matrix.
fn measured_star(
    random: &mut Xoshiro256PlusPlus,
) -> (DVector<f64>, Vec<Vector3<f64>>, DMatrix<f64>) {
    let body: Vec<Vector3<f64>> =
        (0..4).map(|_| Vector3::from_fn(|_, _| random.random_range(-1.0..1.0))).collect();
    let truth = random_rotation(random);
    let exact = DVector::from_fn(12, |row, _| (truth * body[row / 3])[row % 3]);
    let factor = DMatrix::from_fn(12, 12, |i, j| {
        f64::from(u8::from(i == j)) * 0.01 + random.random_range(-0.003..0.003)
    });
    let noise = &factor * DVector::from_fn(12, |_, _| StandardNormal.sample(random));
    let information = (&factor * factor.transpose()).try_inverse().unwrap();
    (exact + noise, body, information)
}

/// One epoch of the roof without differences; antenna 3 sees only the first satellites.
fn undifferenced_roof(seed: u64, seen_by_last: usize) -> AttitudeProblem {
    let scene = roof_scene(seed);
    let (satellites, rows) = (scene.lines_of_sight.len(), scene.sigma_m.len());
    let mut positions = vec![Vector3::zeros()];
    positions.extend(&scene.body);
    let lines_of_sight: Vec<_> =
        (0..rows).map(|row| scene.lines_of_sight[row % satellites]).collect();
    let mut phases = Vec::new();
    for antenna in 0..positions.len() {
        for row in 0..rows {
            if antenna == 3 && row % satellites >= seen_by_last {
                continue;
            }
            // Any satellite clock will do; the differences keep their own receiver clocks.
            let difference =
                if antenna == 0 { 0.0 } else { scene.phases_m[(antenna - 1) * rows + row] };
            phases.push(UndifferencedPhase {
                antenna,
                clock: antenna,
                signal: row,
                sigma_m: scene.sigma_m[row] * core::f64::consts::FRAC_1_SQRT_2,
                phase_m: difference + 0.37 * row as f64,
            });
        }
    }
    undifferenced::problem(&positions, &lines_of_sight, &phases).unwrap()
}

#[test]
fn undifferenced_phases_give_the_full_weight() {
    for seed in 0..50 {
        let differenced = roof_scene(seed).problem(FULL).unwrap().minimum().unwrap();
        let minimum = undifferenced_roof(seed, 9).minimum().unwrap();
        assert!((minimum.rotation - differenced.rotation).norm() < 1e-11);
        let scale = differenced.information.norm();
        assert!((minimum.information - differenced.information).norm() < 1e-11 * scale);
    }
}

#[test]
fn an_antenna_with_three_satellites_still_helps() {
    for seed in 0..20 {
        let trace =
            |seen| undifferenced_roof(seed, seen).minimum().unwrap().covariance().unwrap().trace();
        let (without, with_three, with_all) = (trace(0), trace(3), trace(9));
        assert!(with_all < with_three && with_three < without, "{without} {with_three} {with_all}");
        // One satellite gives its clock and nothing more.
        assert!((trace(1) / without - 1.0).abs() < 1e-9);
    }
}

/// Normalised squared errors of 2000 epochs: mean 3 within the 99.9 % band of χ²(6000)/2000.
#[test]
fn covariance_is_honest() {
    let epochs: u32 = 2000;
    let mut sum = 0.0;
    for seed in 0..u64::from(epochs) {
        let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
        let body: Vec<Vector3<f64>> =
            Antennas::Roof.baselines(&mut random).iter().map(|l| 3.0 * l).collect();
        let truth = random_rotation(&mut random);
        let points: Vec<MeasuredPoint> = core::iter::once(Vector3::zeros())
            .chain(body)
            .map(|body_m| {
                let sd = Vector3::new(0.01, 0.01, 0.02);
                let noise = sd.map(|sd| {
                    let normal: f64 = StandardNormal.sample(&mut random);
                    sd * normal
                });
                MeasuredPoint {
                    body_m,
                    measured_m: truth * body_m + noise,
                    information: Matrix3::from_diagonal(&sd.map(|sd| 1.0 / (sd * sd))),
                }
            })
            .collect();
        let minimum = CoordinateNormal::new(&points).unwrap().problem.minimum().unwrap();
        let error = logarithm(&(truth.transpose() * minimum.rotation));
        sum += error.dot(&(minimum.information * error));
    }
    let mean = sum / f64::from(epochs);
    // 3 ± 3.29 √(2·3/2000)
    assert!((mean - 3.0).abs() < 0.18, "{mean}");
}

/// Attitude and position of coordinates, against the information of all six unknowns at once.
#[test]
fn coordinates_against_the_six_unknowns() {
    for seed in 0..30 {
        let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
        let truth = random_rotation(&mut random);
        let origin = Vector3::new(20.0, -3.0, 7.0);
        let points: Vec<MeasuredPoint> = (0..4)
            .map(|_| {
                let body_m = Vector3::from_fn(|_, _| random.random_range(-1.0..1.0));
                let factor = Matrix3::from_fn(|i, j| {
                    f64::from(u8::from(i == j)) + random.random_range(-0.3..0.3)
                });
                MeasuredPoint {
                    body_m,
                    measured_m: truth * body_m + origin,
                    information: 1e4 * factor * factor.transpose(),
                }
            })
            .collect();
        let normal = CoordinateNormal::new(&points).unwrap();
        let minimum = normal.problem.minimum().unwrap();
        assert!((minimum.rotation - truth).norm() < 1e-11);
        assert!((normal.origin_m(&minimum.rotation) - origin).norm() < 1e-11);
        // ∂y/∂t = I,  ∂y/∂θ = −Q [p]×
        let mut information = Matrix6::zeros();
        for MeasuredPoint { body_m, information: weight, .. } in &points {
            let mut design = nalgebra::Matrix3x6::zeros();
            design.fixed_view_mut::<3, 3>(0, 0).copy_from(&Matrix3::identity());
            design.fixed_view_mut::<3, 3>(0, 3).copy_from(&(-truth * skew(body_m)));
            information += design.transpose() * weight * design;
        }
        let covariance = information.try_inverse().unwrap();
        let found = normal.point_covariance_m2(&minimum, &Vector3::zeros()).unwrap();
        assert!((found - covariance.fixed_view::<3, 3>(0, 0)).norm() < 1e-9 * found.norm());
        let found = minimum.covariance().unwrap();
        assert!((found - covariance.fixed_view::<3, 3>(3, 3)).norm() < 1e-9 * found.norm());
    }
}

/// A certificate is never wrong: no random attitude is cheaper than it allows.
#[test]
fn certificates_hold() {
    let mut certified = 0;
    for seed in 0..200 {
        let problem = roof_scene(seed).problem(FULL).unwrap();
        let global = problem.global_minimum(5.0).unwrap();
        let Uniqueness::Certified { margin } = global.uniqueness else { continue };
        certified += 1;
        let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
        for _ in 0..100 {
            let angle = Vector3::from_fn(|_, _| random.random_range(-3.0..3.0));
            let other = global.minimum.rotation * exponential(&angle);
            let cosine = 0.5 * ((global.minimum.rotation.transpose() * other).trace() - 1.0);
            let gap = problem.cost(&other) - global.minimum.cost;
            assert!(gap >= margin * (1.0 - cosine) * (1.0 - 1e-9), "{gap} {cosine}");
        }
    }
    assert!(certified > 150, "{certified}");
}

proptest! {
    /// Any numbers, of any size: an answer or an error.
    #[test]
    fn no_input_panics(
        seed in any::<u64>(), antennas in 0..5_usize, satellites in 0..8_usize, kind in 0..4_usize,
    ) {
        let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
        let mut number = || match (kind, random.random_range(0..8)) {
            (1, 0) => f64::NAN,
            (1, 1) => f64::INFINITY,
            (2, 0..=4) => 0.0,
            (3, 0) => 1e200,
            (3, 1) => -1e-200,
            _ => random.random_range(-2.0..2.0),
        };
        let mut vectors = |count: usize| -> Vec<Vector3<f64>> {
            (0..count).map(|_| Vector3::from_fn(|_, _| number())).collect()
        };
        let (body, lines_of_sight) = (vectors(antennas), vectors(satellites));
        let flat = |vectors: &[Vector3<f64>]| -> Vec<f64> {
            vectors.iter().flat_map(|v| v.iter().copied()).collect()
        };
        let sigma_m = flat(&vectors(satellites));
        let phases_m = flat(&vectors(satellites * antennas));
        let epoch = SingleDifferences {
            lines_of_sight: &lines_of_sight, sigma_m: &sigma_m, phases_m: &phases_m,
        };
        if let Ok(normal) = epoch.reduce() {
            let _ = normal.baselines_m();
            exercise(normal.problem(&body, FULL));
        }
        let measured = DVector::from_vec(flat(&vectors(antennas)));
        let size = 3 * antennas;
        let factor = DMatrix::from_vec(size, size, flat(&vectors(antennas * size)));
        exercise(joint::problem(&body, &measured, &(&factor * factor.transpose())));
        exercise(joint::problem(&body, &measured, &factor));
        let points: Vec<MeasuredPoint> = body
            .iter()
            .map(|p| {
                let rows = vectors(3);
                let factor = Matrix3::from_columns(&[rows[0], rows[1], rows[2]]);
                MeasuredPoint {
                    body_m: *p, measured_m: rows[0], information: factor * factor.transpose(),
                }
            })
            .collect();
        exercise(CoordinateNormal::new(&points).map(|normal| normal.problem));
        let phases: Vec<UndifferencedPhase> = vectors(antennas * satellites)
            .iter()
            .enumerate()
            .map(|(i, v)| UndifferencedPhase {
                antenna: i % antennas, clock: i % antennas, signal: i / antennas,
                sigma_m: v.x, phase_m: v.y,
            })
            .collect();
        exercise(undifferenced::problem(&body, &lines_of_sight, &phases));
    }
}

/// Everything that can be done with a problem; what is found is a rotation.
fn exercise(problem: Result<AttitudeProblem, kurs::attitude::AttitudeError>) {
    use kurs::attitude::continuation::{Scale, Step};
    let Ok(problem) = problem else { return };
    if let Ok(found) = problem.global_minimum(1.0) {
        assert!((found.minimum.rotation.determinant() - 1.0).abs() < 1e-9, "{found:?}");
    }
    if let Ok(found) = problem.direction(&Vector3::x()) {
        assert!((found.unit.norm() - 1.0).abs() < 1e-9, "{found:?}");
    }
    let _ = problem.continuation(2, Scale::Trace, Step::Polar);
}
