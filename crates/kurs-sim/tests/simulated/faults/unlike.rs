//! Receivers that do not measure alike, or not as is assumed: GLONASS channels, BeiDou orbits, noise.

use kurs::engine::{Ambiguities, Constraint};
use kurs::float_solution::recursive::Motion;
use kurs::observation::ArrayEpoch;
use kurs::signal::System;
use kurs::solution::Status;
use kurs_sim::scenario::{BeiDouOrbit, Bias, Law};

use super::scene::{Outcome, Scene};

/// Rows of a span of a run.
#[derive(Debug, Default)]
struct Count {
    rows: usize,
    right: usize,
    wrong: usize,
}

impl Count {
    fn share(&self) -> f64 {
        self.right as f64 / self.rows.max(1) as f64
    }
}

/// Counts the rows before and after `from_s`.
fn count(scene: Scene, from_s: f64, spoil: impl Fn(f64, &mut ArrayEpoch)) -> [Count; 2] {
    let mut counts = [Count::default(), Count::default()];
    scene.run(
        |time_s, mut epoch| {
            spoil(time_s, &mut epoch);
            vec![epoch]
        },
        |time_s, _, outcome| {
            let count = &mut counts[usize::from(time_s >= from_s)];
            count.rows += 1;
            count.right += usize::from(outcome == Outcome::Right);
            count.wrong += usize::from(outcome == Outcome::Wrong);
        },
    );
    counts
}

/// Three antennas with these signals and a bias of antenna A1.
fn with_bias(antennas: usize, signals: &[&str], systems: &[&str], bias: &Bias) -> Scene {
    let owned = |names: &[&str]| names.iter().map(|name| (*name).to_owned()).collect();
    Scene::new(antennas, |scenario| {
        scenario.interval_s = 0.5;
        scenario.signals = owned(signals);
        scenario.sky.systems = owned(systems);
        scenario.bias.push(Bias { antenna: "A1".to_owned(), ..bias.clone() });
    })
}

/// All but the first `kept` satellites of GPS are lost.
fn keep_gps(epoch: &mut ArrayEpoch, kept: usize) {
    for observed in epoch.antennas.iter_mut().flatten() {
        let mut numbers: Vec<u8> = observed
            .observations
            .iter()
            .filter(|o| o.satellite.system == System::Gps)
            .map(|o| o.satellite.number)
            .collect();
        numbers.sort_unstable();
        numbers.dedup();
        numbers.truncate(kept);
        observed
            .observations
            .retain(|o| o.satellite.system != System::Gps || numbers.contains(&o.satellite.number));
    }
}

/// GPS teaches the bias of each step of the channel; when most of GPS is lost, GLONASS carries on.
#[test]
fn glonass_of_mixed_receivers_learns_from_gps() {
    const LOST_FROM_S: f64 = 20.0;
    let run = |cycles_per_channel: f64, systems: &[&str]| {
        let signals = ["G1C", "G2W", "R1C"];
        let bias = Bias { phase_cycles_per_channel: cycles_per_channel, ..Bias::default() };
        let mut scene = with_bias(2, &signals, systems, &bias);
        scene.settings.constraint = Constraint::Length;
        let counts = count(scene, LOST_FROM_S, |time_s, epoch| {
            if time_s >= LOST_FROM_S {
                keep_gps(epoch, 3);
            }
        });
        println!("{cycles_per_channel} cycles a channel, {systems:?}: {counts:?}");
        (counts[0].wrong + counts[1].wrong, [counts[0].share(), counts[1].share()])
    };
    let (gps_wrong, gps_alone) = run(0.0, &["G"]);
    let (alike_wrong, alike) = run(0.0, &["G", "R"]);
    assert_eq!((gps_wrong, alike_wrong), (0, 0));
    // 20, 29 and 47 mm for each step.
    for cycles_per_channel in [0.107, -0.155, 0.25] {
        let (wrong, [all, few]) = run(cycles_per_channel, &["G", "R"]);
        assert_eq!(wrong, 0, "{cycles_per_channel}");
        // Until five epochs are fixed by GPS alone nothing is known of the bias.
        assert!(all >= 0.9, "{cycles_per_channel}: {all}");
        println!("with three satellites of GPS left: {few} {alike:?} {gps_alone:?}");
        assert!(few >= 0.9 && few > gps_alone[1] + 0.5, "{few} {alike:?} {gps_alone:?}");
    }
}

/// The same where ambiguities are carried on, and GPS alone is too weak: the phases of GLONASS are left out until their
/// bias is known, and help then.
#[test]
fn glonass_of_mixed_receivers_in_continuous_sessions() {
    let run = |cycles_per_channel: f64, systems: &[&str]| {
        let bias = Bias { phase_cycles_per_channel: cycles_per_channel, ..Bias::default() };
        let mut scene = with_bias(3, &["G1C", "R1C"], systems, &bias);
        scene.settings.ambiguities = Ambiguities::Continuous(Motion::Free);
        let [counts, _] = count(scene, f64::INFINITY, |_, _| {});
        println!("{cycles_per_channel} cycles a channel, {systems:?}, continuous: {counts:?}");
        assert_eq!(counts.wrong, 0, "{cycles_per_channel}");
        counts.right
    };
    let gps_alone = run(0.0, &["G"]);
    for cycles_per_channel in [0.027, 0.107, -0.155] {
        let right = run(cycles_per_channel, &["G", "R"]);
        assert!(right >= gps_alone + 20, "{cycles_per_channel}: {right}, GPS alone {gps_alone}");
    }
}

/// A receiver that has the geostationary satellites of BeiDou a part of a cycle off the others.
#[test]
fn geostationary_satellites_off_by_a_part_of_a_cycle() {
    for phase_cycles in [0.0, 0.25, 0.5] {
        let bias = Bias {
            system: Some("C".to_owned()),
            orbit: Some(BeiDouOrbit::Geo),
            phase_cycles,
            ..Bias::default()
        };
        let scene = with_bias(3, &["G1C", "C2I"], &["G", "C"], &bias);
        let [counts, _] = count(scene, f64::INFINITY, |_, _| {});
        println!("geostationary satellites {phase_cycles} cycles off: {counts:?}");
        assert_eq!(counts.wrong, 0, "{phase_cycles}");
        assert!(counts.share() >= 0.95, "{phase_cycles}: {counts:?}");
    }
}

/// Code of one antenna full of reflections in every fifth epoch: phases and geometry say enough.
#[test]
fn code_full_of_reflections() {
    for antennas in [2, 3] {
        let mut scene = with_bias(antennas, &["G1C", "E1C"], &["G", "E"], &Bias::default());
        if antennas == 2 {
            scene.settings.constraint = Constraint::Length;
        }
        let (mut spoilt, mut right) = (0_u32, 0_u32);
        let is_spoilt = |time_s: f64| (time_s * 2.0).round().rem_euclid(5.0) == 3.0;
        scene.run(
            |time_s, mut epoch| {
                for observation in &mut epoch.antennas[1].as_mut().unwrap().observations {
                    let number = f64::from(observation.satellite.number);
                    let off_m = 30.0 * (number * 2.4 + time_s / 7.0).sin();
                    if is_spoilt(time_s) {
                        observation.pseudorange_m =
                            observation.pseudorange_m.map(|range| range + off_m);
                    }
                }
                vec![epoch]
            },
            |time_s, row, outcome| {
                assert_ne!(outcome, Outcome::Wrong, "{time_s} s: {row:?}");
                spoilt += u32::from(is_spoilt(time_s));
                right += u32::from(is_spoilt(time_s) && outcome == Outcome::Right);
            },
        );
        println!("{antennas} antennas, code of one off by up to 30 m: {right} of {spoilt} right");
        assert!(f64::from(right) >= 0.5 * f64::from(spoilt), "{right} of {spoilt}");
    }
}

/// White noise of 3 and 4.8 mm, of which nothing is told and which no fix teaches at first: the changes of the phases
/// show it, and neither the lengths nor the shape of the array are blamed.
#[test]
fn receivers_noisier_than_assumed() {
    for (antennas, phase_sd_cycles, least_fixed) in
        [(2, 0.01576, 0.6), (3, 0.01576, 0.6), (2, 0.025, 0.0), (3, 0.025, 0.0)]
    {
        let (mut rows, mut fixed, mut blamed) = (0, 0, 0);
        for seed in 1..=4 {
            let scene = Scene::new(antennas, |scenario| {
                (scenario.interval_s, scenario.duration_s) = (1.0, 100.0);
                scenario.seed = seed;
                scenario.noise.law = Law::Mixed;
                (scenario.noise.code_sd_m, scenario.noise.phase_sd_cycles) = (0.3, phase_sd_cycles);
                scenario.noise.cn0_zenith_dbhz = 60.0;
                (scenario.multipath.code_sd_m, scenario.multipath.phase_sd_m) = (0.0, 0.0);
            });
            scene.run(
                |_, epoch| vec![epoch],
                |_, row, outcome| {
                    assert_ne!(outcome, Outcome::Wrong, "seed {seed}: {row:?}");
                    rows += 1;
                    fixed += usize::from(outcome == Outcome::Right);
                    blamed += usize::from(row.status() == Status::Inconsistent);
                },
            );
        }
        println!(
            "{antennas} antennas, {phase_sd_cycles} cycles: {fixed} fixed, {blamed} blamed, of {rows}"
        );
        assert!(fixed as f64 >= least_fixed * rows as f64, "{fixed} of {rows}");
        assert!(20 * blamed <= rows, "{blamed} of {rows}");
    }
}
