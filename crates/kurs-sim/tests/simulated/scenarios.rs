//! The ready scenarios solved as `kurs solve` would: fixed, right, and as accurate as they can be.
//! Here a part of each; `cargo run --release -p kurs-sim --example scenarios` solves them whole.
#![allow(clippy::unwrap_used, clippy::print_stdout)] // a test

use crate::bound;
use crate::links::{CLASSES_DB, Links, RECORDED};
use crate::solving::{self, Tally, TrueCycles, as_told, continuous, settings};
use kurs::both_directions::BackwardRows;
use kurs::engine::{Constraint, Direction, Engine, Settings};
use kurs::solution::EpochSolution;
use kurs_sim::simulation::{Attachments, SimulatedEpoch, Simulation};

/// At least 99 % fixed, no integer wrong.
#[test]
fn moving_bodies_are_fixed_and_right() {
    for name in ["car", "ship", "uav"] {
        let mut scenario = solving::ready(name);
        scenario.interval_s = 1.0;
        let known = settings(&scenario, Constraint::Array);
        let mut tally = Tally::default();
        solving::solve(scenario, known, |truth, row, integers| tally.add(truth, row, integers));
        println!("{name}: {tally:?}");
        assert!(tally.fixed * 100 >= tally.epochs * 99, "{name}: {tally:?}");
        assert_eq!(tally.wrong, 0, "{name}: {tally:?}");
    }
}

/// Where reflections stay for seconds and houses hide half of the sky, errors are not more than 1.5
/// times what the covariances say, with the noise that `kurs solve` assumes when it is told nothing.
/// Every epoch of `urban` that has observations is fixed, also those in which one antenna sees next
/// to nothing.
#[test]
fn covariances_hold_under_reflections() {
    for (name, least_fixed) in [("car", 0.99), ("ship", 0.99), ("uav", 0.99), ("urban", 0.96)] {
        let mut scenario = solving::ready(name);
        scenario.interval_s = 1.0;
        let known = settings(&scenario, Constraint::Array);
        let known = Settings { noise: Settings::default().noise, ..known };
        let mut tally = Tally::default();
        solving::solve(scenario, known, |truth, row, integers| tally.add(truth, row, integers));
        let optimism = (tally.normalised / (3.0 * tally.fixed as f64)).sqrt();
        println!("{name}: errors {optimism:.2} times what they are said to be, {tally:?}");
        assert!(optimism < 1.5, "{name}: {optimism}");
        assert!(tally.fixed as f64 >= least_fixed * tally.epochs as f64, "{name}: {tally:?}");
        assert_eq!(tally.wrong, 0, "{name}: {tally:?}");
    }
}

/// Four antennas under branches, where most epochs are fixed only without one of their systems: what is known of the
/// array costs a tenth of the fixes at most, and none is wrong.
#[test]
fn a_known_array_costs_no_fixes() {
    let solve = |constraint| {
        let mut scenario = solving::ready("canopy-array");
        scenario.duration_s = 400.0;
        let known = as_told(&scenario, constraint);
        let mut tally = Tally::default();
        solving::solve(scenario, known, |truth, row, integers| tally.add(truth, row, integers));
        println!("{constraint:?}: {tally:?}");
        assert_eq!(tally.wrong, 0, "{constraint:?}: {tally:?}");
        tally.fixed
    };
    let free = solve(Constraint::None);
    for constraint in [Constraint::Length, Constraint::Array] {
        let fixed = solve(constraint);
        assert!(fixed * 10 >= free * 9, "{constraint:?}: {fixed} of {free}");
    }
}

/// Few satellites on one band, and twenty seconds without any: what the forward run gathers only after a while the
/// backward run knows from later epochs. With it a tenth more of the rows are fixed than by the forward run alone, and
/// nothing wrong.
#[test]
fn both_directions_fix_more_than_the_forward_run() {
    let mut scenario = solving::ready("few-satellites");
    scenario.interval_s = 1.0;
    scenario.duration_s = 300.0;
    scenario.signals = vec!["G1C".to_owned()];
    scenario.outage.push(toml::from_str("from_s = 140.0\nto_s = 160.0").unwrap());
    let forward = continuous(as_told(&scenario, Constraint::Array));
    let backward = Settings { direction: Direction::Backward, ..forward.clone() };

    let mut simulation = Simulation::new(scenario, &Attachments::default()).unwrap();
    let engine = |settings| Engine::new(settings, simulation.navigation().clone()).unwrap();
    let (mut forward, mut backward) = (engine(forward), engine(backward));
    let mut cycles = TrueCycles::of(simulation.scenario());
    let (mut epochs, mut epoch) = (Vec::new(), SimulatedEpoch::default());
    while simulation.next_epoch(&mut epoch) {
        epochs.push(epoch.clone());
    }
    let of_epoch = |epoch: &SimulatedEpoch| backward.push(&epoch.bodies[0].observed);
    let backward_rows: Vec<EpochSolution> = epochs.iter().rev().map(of_epoch).collect();
    let mut hindsight = BackwardRows::default();
    backward_rows.iter().cloned().for_each(|row| hindsight.push(row));

    let mut tallies = [Tally::default(); 3];
    for (epoch, backward) in epochs.iter().zip(backward_rows.iter().rev()) {
        cycles.take(epoch);
        let body = &epoch.bodies[0];
        let row = forward.push(&body.observed);
        let both = hindsight.join(row.clone());
        for (tally, row) in tallies.iter_mut().zip([&row, backward, &both]) {
            tally.add(&body.truth, row, cycles.judge(row.integer_sums()));
        }
    }
    println!("forward, backward, both: {tallies:?}");
    let [forward, backward, both] = tallies;
    assert_eq!([forward.wrong, backward.wrong, both.wrong], [0; 3], "{tallies:?}");
    let alone = forward.fixed.max(backward.fixed);
    assert!(both.fixed >= alone + both.epochs / 20, "{tallies:?}");
}

/// Errors within 5 % of the bound of Cramér and Rao for the phases that are used, and the 99.9 % band
/// of so few epochs.
#[test]
fn the_roof_reaches_the_bound() {
    let mut scenario = solving::ready("roof-static");
    scenario.duration_s = 300.0;
    let (tally, ratio) = bound::laid_against(scenario);
    assert_eq!((tally.fixed, tally.wrong), (tally.epochs, 0), "{tally:?}");
    let band = 3.29 / (2.0 * tally.fixed as f64).sqrt();
    println!("heading, pitch, roll: {ratio:.3?} of the bound, band {band:.3}");
    for (k, name) in ["heading", "pitch", "roll"].iter().enumerate() {
        assert!(ratio[k] < 1.05 + band && ratio[k] > 1.0 - band, "{name}: {}", ratio[k]);
    }
}

/// Simulated obstacles are those of real skies: of the links of `edge`, `canopy` and `street` together the
/// same share is off as recorded, within a factor of 1.5, in every class of C/N0 differences.
#[test]
fn links_are_off_as_often_as_recorded() {
    let mut links = Links::default();
    for name in ["edge", "canopy", "street"] {
        for seed in 0..96 {
            let mut scenario = solving::session(name, seed);
            scenario.interval_s = 10.0;
            links.add(&Links::of(&scenario));
        }
    }
    println!("{links:?}");
    // Recorded is 0.0 %: less than half of a tenth.
    assert!(links.share(0) < 0.0005, "{links:?}");
    for class in 1..CLASSES_DB.len() {
        let ratio = links.share(class) / RECORDED[class];
        assert!((1.0 / 1.5..1.5).contains(&ratio), "from {} dB: {ratio}", CLASSES_DB[class]);
    }
}
