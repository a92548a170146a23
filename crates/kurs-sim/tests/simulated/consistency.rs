//! Whether the estimator's own figures are true: with white noise of a known law, normalised squared
//! errors have the mean of their χ², and integers are right as often as predicted. All bands are
//! those of 99.9 %; seeds were chosen beforehand.
#![allow(clippy::unwrap_used, clippy::print_stdout)] // a test

use core::ops::Range;

use crate::solving::{
    self, Integers, NOISE, TrueCycles, angle_errors, baseline_error, normalised_square, settings,
};
use kurs::ambiguity::search::IntegerLeastSquares;
use kurs::ambiguity::success_rate::bootstrapped_success_rate;
use kurs::array::AntennaArray;
use kurs::difference::{self, Link};
use kurs::engine::{Constraint, Engine, Settings};
use kurs::ephemeris::NavigationData;
use kurs::float_solution::FloatSolution;
use kurs::frames::{Geodetic, Vector};
use kurs::point;
use kurs::signal::{Satellite, System};
use kurs::signal_residuals::integer_sums;
use kurs::solution::Status;
use kurs_sim::scenario::{MotionPlan, Scenario};
use kurs_sim::simulation::{Attachments, SimulatedEpoch, Simulation};
use nalgebra::{DMatrix, DVector, Vector3};
use rand::{RngExt, SeedableRng};
use rand_distr::StandardNormal;
use rand_xoshiro::Xoshiro256PlusPlus;

/// Quantile of the normal distribution for a two-sided 99.9 %.
const SIGMAS: f64 = 3.29;

/// The mean of `count` squares with three degrees of freedom each is 3 within this.
fn band(count: usize) -> f64 {
    SIGMAS * (6.0 / count as f64).sqrt()
}

fn roof(seed: u64, epochs: usize) -> Scenario {
    let mut scenario = solving::ready("roof-static");
    solving::with_known_noise(&mut scenario);
    (scenario.seed, scenario.interval_s) = (seed, 1.0);
    scenario.duration_s = (epochs - 1) as f64;
    scenario
}

#[test]
fn angles_and_baselines_are_as_good_as_they_say() {
    const EPOCHS: usize = 600;
    let scenario = roof(11, EPOCHS);
    let exact = Settings { array_sd_m: 0.0, ..settings(&scenario, Constraint::Array) };
    let (mut angles, mut baselines, mut fixed) = (0.0, [0.0; 3], 0);
    solving::solve(scenario, exact, |truth, row, integers| {
        if !row.is_fixed() {
            return;
        }
        assert_eq!(integers, Integers::Right, "{}", row.time);
        fixed += 1;
        let covariance = &row.attitude().unwrap().covariance_rad2;
        angles += normalised_square(&angle_errors(truth, row).unwrap(), covariance);
        for (k, sum) in baselines.iter_mut().enumerate() {
            let error = baseline_error(truth, row, k).unwrap();
            *sum += normalised_square(&error, &row.baselines[k].covariance_m2);
        }
    });
    assert!(fixed * 100 >= 99 * EPOCHS, "{fixed} of {EPOCHS} fixed");
    for (name, sum) in ["angles", "baseline 1", "baseline 2", "baseline 3"]
        .iter()
        .zip([angles].into_iter().chain(baselines))
    {
        let mean = sum / fixed as f64;
        println!("{name}: mean normalised square {mean:.3} of 3 ± {:.3}", band(fixed));
        assert!((mean - 3.0).abs() < band(fixed), "{name}: {mean}");
    }
}

/// Antennas surveyed to 5 mm and to 2 cm, each session with errors of its own: over sessions the errors
/// of the angles are as large as the covariance says, and about half of it or more is the installation's.
#[test]
fn the_survey_is_in_the_covariance() {
    const SESSIONS: usize = 200;
    for array_sd_m in [0.005, 0.02] {
        let mut random = Xoshiro256PlusPlus::seed_from_u64(34);
        let (mut sum, mut fixed, mut installation) = (0.0, 0, 0.0);
        for seed in 0..SESSIONS {
            let scenario = roof(3400 + seed as u64, 2);
            let exact = settings(&scenario, Constraint::None);
            let places = exact.array.as_ref().unwrap().positions_m().iter().map(|place| {
                let error = Vector3::from_fn(|_, _| random.sample::<f64, _>(StandardNormal));
                *place + Vector::from_xyz(error * array_sd_m)
            });
            let array = Some(AntennaArray::new(places.collect()).unwrap());
            solving::solve(scenario, Settings { array, array_sd_m, ..exact }, |truth, row, _| {
                if !row.is_fixed() {
                    return;
                }
                let attitude = row.attitude().unwrap();
                let error = angle_errors(truth, row).unwrap();
                sum += normalised_square(&error, &attitude.covariance_rad2);
                installation +=
                    attitude.installation_rad2.trace() / attitude.covariance_rad2.trace();
                fixed += 1;
            });
        }
        assert!(fixed * 100 >= 95 * SESSIONS, "{fixed} of {SESSIONS} fixed");
        let (mean, share) = (sum / fixed as f64, installation / fixed as f64);
        println!("survey to {array_sd_m} m: {mean:.3} of 3 ± {:.3}, share {share:.2}", band(fixed));
        assert!((mean - 3.0).abs() < band(fixed), "{mean}");
        assert!(share > 0.4 && share < 1.0, "{share}");
    }
}

/// Two antennas in all directions on a body that stands askew, by 5° at random in roll and in pitch:
/// whatever angles are told, their errors are as large as they say. The square of a heading that hangs
/// on the square of the roll has a variance of 10 at most.
#[test]
fn two_antennas_know_what_they_cannot_see() {
    const SESSIONS: usize = 150;
    let lines: [([f64; 3], [bool; 3]); 6] = [
        ([1.0, 0.0, 0.0], [true, true, false]),
        ([0.0, 1.2, 0.0], [true, false, true]),
        ([0.2, 1.2, 0.0], [true, false, true]),
        ([1.0, 1.0, 0.0], [true, false, false]),
        ([1.0, 0.0, -0.25], [true, true, false]),
        ([42.0, 0.0, -2.0], [true, true, false]),
    ];
    for (line, seen) in lines {
        let mut random = Xoshiro256PlusPlus::seed_from_u64(31);
        let mut squares = [(0.0, 0usize); 3];
        for seed in 0..SESSIONS {
            let mut scenario = roof(3100 + seed as u64, 1);
            scenario.body[0].antenna.truncate(2);
            scenario.body[0].antenna[1].position_m = line;
            if let MotionPlan::Static { pitch_deg, roll_deg, .. } = &mut scenario.body[0].motion {
                *pitch_deg = 5.0 * random.sample::<f64, _>(StandardNormal);
                *roll_deg = 5.0 * random.sample::<f64, _>(StandardNormal);
            }
            let known = Settings { array_sd_m: 0.0, ..settings(&scenario, Constraint::Length) };
            solving::solve(scenario, known, |truth, row, _| {
                if !row.is_fixed() {
                    return;
                }
                let attitude = row.attitude().unwrap();
                assert_eq!(attitude.angles_rad().map(|angle| angle.is_some()), seen, "{line:?}");
                assert!(attitude.ned_from_body.is_none() && attitude.line_elevation_rad.is_some());
                let wanted = &truth.attitude;
                let wanted = [wanted.heading_rad, wanted.pitch_rad, wanted.roll_rad];
                for (k, angle) in attitude.angles_rad().into_iter().enumerate() {
                    let Some(angle) = angle else { continue };
                    let error = (angle - wanted[k]).sin();
                    squares[k].0 += error * error / attitude.covariance_rad2[(k, k)];
                    squares[k].1 += 1;
                }
            });
        }
        for (k, (sum, count)) in squares.into_iter().enumerate().filter(|(_, s)| s.1 > 0) {
            let (mean, band) = (sum / count as f64, SIGMAS * (10.0 / count as f64).sqrt());
            println!("{line:?}, angle {k}: {mean:.3} of 1 ± {band:.3}, {count} fixed");
            assert!(count * 100 >= 90 * SESSIONS, "{count} of {SESSIONS} fixed");
            assert!((mean - 1.0).abs() < band, "{line:?}, angle {k}: {mean} ± {band}");
        }
    }
}

/// The antenna ahead of a rolling ship is silent for 30 s: the pair that is left lies across the body.
/// The pitch, of 1° RMS in 9 s, is told while it is still known and then no more; no angle is further
/// off than it says.
#[test]
fn an_array_that_lost_an_antenna_forgets_the_turn_about_the_others() {
    let (mut carried, mut forgotten, mut beyond) = (0, 0, 0);
    for seed in 0..4 {
        let mut scenario = solving::ready("ship");
        solving::with_known_noise(&mut scenario);
        (scenario.seed, scenario.interval_s, scenario.duration_s) = (300 + seed, 1.0, 59.0);
        if let MotionPlan::Ship { pitch_rms_deg, .. } = &mut scenario.body[0].motion {
            *pitch_rms_deg = 1.0;
        }
        let places = [[0.0; 3], [1.0, 0.0, 0.0], [0.2, 1.4866, 0.0]];
        for (antenna, place) in scenario.body[0].antenna.iter_mut().zip(places) {
            antenna.position_m = place;
        }
        let known = Settings { array_sd_m: 0.0, ..settings(&scenario, Constraint::Array) };
        let mut simulation = Simulation::new(scenario, &Attachments::default()).unwrap();
        let mut engine = Engine::new(known, simulation.navigation().clone()).unwrap();
        let mut epoch = SimulatedEpoch::default();
        for second in 0..60 {
            assert!(simulation.next_epoch(&mut epoch));
            let body = &mut epoch.bodies[0];
            let is_silent = (20..50).contains(&second);
            if is_silent {
                body.observed.antennas[1] = None;
            }
            let row = engine.push(&body.observed);
            if !row.is_fixed() {
                continue;
            }
            let attitude = row.attitude().unwrap();
            assert!(attitude.heading_rad.is_some() && attitude.roll_rad.is_some(), "{second}");
            assert_eq!(attitude.line_elevation_rad.is_some(), is_silent, "{second}");
            assert_eq!(attitude.ned_from_body.is_some(), attitude.pitch_rad.is_some());
            if is_silent {
                carried += usize::from(attitude.pitch_rad.is_some());
                forgotten += usize::from(attitude.pitch_rad.is_none());
                assert!(second < 35 || attitude.pitch_rad.is_none(), "{second}");
            } else {
                assert!(attitude.pitch_rad.is_some(), "{second}");
            }
            let truth = &body.truth.attitude;
            let wanted = [truth.heading_rad, truth.pitch_rad, truth.roll_rad];
            for (k, angle) in attitude.angles_rad().into_iter().enumerate() {
                let Some(angle) = angle else { continue };
                let sigmas =
                    (angle - wanted[k]).sin().abs() / attitude.covariance_rad2[(k, k)].sqrt();
                beyond += usize::from(sigmas > 3.0);
                assert!(sigmas < 5.0, "second {second}, angle {k}: {sigmas} standard deviations");
            }
        }
    }
    println!(
        "pitch told in {carried} rows without the antenna, empty in {forgotten}; {beyond} angles beyond 3 sd"
    );
    assert!(carried >= 4 && forgotten >= 60, "{carried} {forgotten}");
    assert!(beyond <= 12, "{beyond}");
}

/// The survey of an array does not average within a session: over sessions, each with an array surveyed
/// anew to 5 mm, the normalised squares of the angles have their mean.
#[test]
fn survey_errors_are_in_the_covariance() {
    const SESSIONS: usize = 150;
    let (mut angles, mut fixed) = (0.0, 0);
    for seed in 0..SESSIONS {
        let mut scenario = roof(2000 + seed as u64, 2);
        scenario.array_sd_m = 0.005;
        let known = settings(&scenario, Constraint::Array);
        solving::solve(scenario, known, |truth, row, _| {
            if row.is_fixed() {
                fixed += 1;
                let covariance = &row.attitude().unwrap().covariance_rad2;
                angles += normalised_square(&angle_errors(truth, row).unwrap(), covariance);
            }
        });
    }
    assert!(fixed * 100 >= 90 * SESSIONS, "{fixed} of {SESSIONS} fixed");
    let mean = angles / fixed as f64;
    println!("surveyed anew: mean normalised square {mean:.3} of 3 ± {:.3}", band(fixed));
    assert!((mean - 3.0).abs() < band(fixed), "{mean}");
}

/// One epoch of each of 300 skies, above the atmosphere, where the models of estimator and simulator
/// agree: what is left is code noise, and orbits as accurate as they are broadcast (2 m).
#[test]
fn positions_are_as_good_as_they_say() {
    const SKIES: usize = 300;
    let mut sum = 0.0;
    for seed in 0..SKIES {
        let mut scenario = roof(1000 + seed as u64, 1);
        scenario.atmosphere.ionosphere_zenith_m = 0.0;
        scenario.sky.orbit_error_sd_m = 2.0;
        scenario.start = format!("2024-03-10T{:02}:{:02}:00", seed % 24, seed % 60);
        if let MotionPlan::Static { place, .. } = &mut scenario.body[0].motion {
            place.height_m = 400e3;
            place.longitude_deg = (37 * seed % 360) as f64;
        }
        scenario.body[0].antenna.truncate(2);
        let known = settings(&scenario, Constraint::Length);
        solving::solve(scenario, known, |truth, row, _| {
            let position = row.position.as_ref().unwrap();
            let to_ned = Geodetic::from_ecef(truth.position_m).ned_from_ecef();
            let error = (to_ned * (position.position_m - truth.position_m)).xyz();
            sum += normalised_square(&error, &position.covariance_m2);
        });
    }
    let mean = sum / SKIES as f64;
    println!("position: mean normalised square {mean:.3} of 3 ± {:.3}", band(SKIES));
    assert!((mean - 3.0).abs() < band(SKIES), "{mean}");
}

/// The integers of a weak model, one band and eleven satellites, are right as often as the formula of
/// bootstrapping says, or a little more often: least squares is the better estimator.
#[test]
fn integers_are_right_as_often_as_predicted() {
    const EPOCHS: usize = 2000;
    let mut scenario = roof(21, EPOCHS);
    scenario.body[0].antenna.truncate(2);
    scenario.sky.max_satellites = Some(11);
    let mut simulation = Simulation::new(scenario, &Attachments::default()).unwrap();
    let mut cycles = TrueCycles::of(simulation.scenario());
    let mut search = IntegerLeastSquares::default();
    let mut epoch = SimulatedEpoch::default();
    let (mut right, mut predicted, mut variance) = (0.0, 0.0, 0.0);
    while simulation.next_epoch(&mut epoch) {
        cycles.take(&epoch);
        let (links, groups) = differences(&epoch, simulation.navigation());
        let float = FloatSolution::solve(&links, &groups, 0, &[1]).unwrap();
        let ambiguities = float.ambiguities_cycles.as_slice();
        let best = search.solve(ambiguities, float.ambiguity_covariance(), 1).unwrap();
        let integers: Vec<f64> = best[0].integers.iter().map(|n| *n as f64).collect();
        let sums = integer_sums(&links, &groups, &integers);
        right += if cycles.judge(&sums) == Integers::Right { 1.0 } else { 0.0 };
        let rate = bootstrapped_success_rate(search.decorrelation().conditional_variances());
        predicted += rate;
        variance += rate * (1.0 - rate);
    }
    let (share, expected) = (right / EPOCHS as f64, predicted / EPOCHS as f64);
    let band = SIGMAS * f64::sqrt(variance) / EPOCHS as f64;
    println!("right {share:.4}, predicted {expected:.4} ± {band:.4}");
    assert!((0.2..0.95).contains(&expected), "a weak model was wanted: {expected}");
    assert!(share > expected - band && share < expected + band + 0.05, "{share} {expected}");
}

/// What is known of a baseline from outside enters a float solution as one more observation: whatever the
/// integers, it does not matter whether they or it come first.
#[test]
fn a_float_solution_is_told_of_its_baseline() {
    let mut scenario = roof(22, 1);
    scenario.body[0].antenna.truncate(2);
    let mut simulation = Simulation::new(scenario, &Attachments::default()).unwrap();
    let mut epoch = SimulatedEpoch::default();
    assert!(simulation.next_epoch(&mut epoch));
    let (mut links, groups) = differences(&epoch, simulation.navigation());
    for link in &mut links {
        (link.variances.code_m2, link.variances.phase_m2) =
            (1.3 * link.variances.code_m2, 0.8 * link.variances.phase_m2);
    }
    let float = FloatSolution::solve(&links, &groups, 0, &[1]).unwrap();
    let directions = DMatrix::from_column_slice(3, 2, &[1.0, 0.0, 0.0, 0.0, 0.6, 0.8]);
    let measured_m = DVector::from_column_slice(&[0.02, -0.05]);
    let v = DMatrix::from_column_slice(2, 2, &[4e-4, 1e-4, 1e-4, 9e-4]);
    let told = float.informed(&directions, &measured_m, &v).unwrap();

    let integers: Vec<f64> = float.ambiguities_cycles.iter().map(|a| a.round() + 1.0).collect();
    let off =
        |float: &FloatSolution| &float.ambiguities_cycles - DVector::from_column_slice(&integers);
    let solved = |float: &FloatSolution| {
        float.ambiguity_covariance().clone().cholesky().unwrap().solve(&off(float))
    };
    // x̌ = x̂ − Q_x̂â Q_â⁻¹ (â − z), by normal equations and by covariances
    let by_equations = told.conditional(&integers).unwrap();
    let by_covariances = &told.correction_m - &told.cross_covariance * solved(&told);
    let difference_m = (&by_equations.correction_m - by_covariances).amax();
    assert!(difference_m < 1e-6, "{difference_m}");
    // |â − z|² and what the measurement adds, in both orders
    let first = told.code_fit.sum - float.code_fit.sum + off(&told).dot(&solved(&told));
    let alone = float.conditional(&integers).unwrap();
    let innovation_m = &measured_m - directions.tr_mul(&alone.correction_m);
    let s = directions.tr_mul(&alone.covariance_m2) * &directions + &v;
    let added = innovation_m.dot(&s.cholesky().unwrap().solve(&innovation_m));
    let last = off(&float).dot(&solved(&float)) + added;
    assert!((first / last - 1.0).abs() < 1e-6, "{first} {last}");
    assert_eq!(told.code_fit.degrees_of_freedom, float.code_fit.degrees_of_freedom + 2);
}

/// Observed less computed of both antennas at their true places, and the groups of one code.
fn differences(
    epoch: &SimulatedEpoch,
    navigation: &NavigationData,
) -> (Vec<Link>, Vec<Range<usize>>) {
    let body = &epoch.bodies[0];
    let first_m = body.truth.position_m;
    let ecef_from_ned = Geodetic::from_ecef(first_m).ecef_from_ned();
    let (mut links, mut tracked) = (Vec::new(), Vec::new());
    for (index, observed) in body.observed.antennas.iter().flatten().enumerate() {
        point::track(observed, navigation, |_| true, &mut tracked);
        let position_m = match index {
            0 => first_m,
            _ => first_m + ecef_from_ned * body.truth.baselines_m[index - 1],
        };
        let antenna = difference::Antenna {
            index,
            epoch: observed,
            tracked: &tracked,
            position_m,
            mount: None,
            body_from_ecef: None,
        };
        let mask_rad = 10f64.to_radians();
        difference::links(&antenna, navigation, &NOISE, mask_rad, |_| true, &mut links);
    }
    let groups = difference::group(&mut links);
    (links, groups)
}

/// Six satellites of GPS and two of Galileo: the terms of receivers and satellites take up nearly all that the two
/// would show of their noise, and small residuals must not be taken for small errors.
#[test]
fn two_satellites_of_a_system_are_no_quiet_band() {
    const EPOCHS: usize = 600;
    for seed in 40..43 {
        let mut scenario = roof(seed, EPOCHS);
        scenario.start = format!("2024-03-10T{:02}:00:00", 2 * (seed - 40));
        scenario.body[0].antenna.truncate(2);
        let exact = Settings { array_sd_m: 0.0, ..settings(&scenario, Constraint::Length) };
        let mut simulation = Simulation::new(scenario, &Attachments::default()).unwrap();
        let mut engine =
            Engine::new(solving::continuous(exact), simulation.navigation().clone()).unwrap();
        let mut epoch = SimulatedEpoch::default();
        let mut kept: Vec<Satellite> = Vec::new();
        let (mut squares, mut fixed, mut refused) = (0.0, 0, 0);
        while simulation.next_epoch(&mut epoch) {
            let body = &mut epoch.bodies[0];
            if kept.is_empty() {
                let seen = body.observed.antennas[0].iter().flat_map(|a| &a.observations);
                // The highest are the strongest.
                let mut seen: Vec<_> = seen.map(|o| (o.cn0_dbhz, o.satellite)).collect();
                seen.sort_by(|a, b| b.partial_cmp(a).unwrap());
                for (system, few) in [(System::Gps, 0..6), (System::Galileo, 1..3)] {
                    let own = seen.iter().map(|(_, satellite)| *satellite);
                    let own = own.filter(|satellite| satellite.system == system);
                    kept.extend(own.skip(few.start).take(few.len()));
                }
            }
            for antenna in body.observed.antennas.iter_mut().flatten() {
                antenna.observations.retain(|o| kept.contains(&o.satellite));
            }
            let row = engine.push(&body.observed);
            refused += usize::from(row.status() == Status::Inconsistent);
            if row.is_fixed() {
                fixed += 1;
                let error = baseline_error(&body.truth, &row, 0).unwrap();
                squares += normalised_square(&error, &row.baselines[0].covariance_m2);
            }
        }
        let mean = squares / fixed as f64;
        println!(
            "seed {seed}: {fixed} fixed, {refused} refused, mean normalised square {mean:.2} of 3"
        );
        assert!(fixed >= 480 && refused == 0, "{fixed} fixed, {refused} refused");
        // The levels that residuals teach are known to a few percent.
        assert!((mean - 3.0).abs() < 1.5 * band(fixed), "{mean}");
    }
}
