//! Faults: whatever is done to the observations, no wrong fix leaves the engine as `fixed`, and
//! right fixes return as soon as the fault is over.
#![allow(clippy::unwrap_used, clippy::print_stdout)] // a test

mod glonass;
mod lasting;
mod scene;
mod unlike;

use kurs::engine::{Ambiguities, Constraint};
use kurs::float_solution::recursive::Motion;
use kurs::observation::{ArrayEpoch, Lock};
use kurs::signal::System;
use scene::{Outcome, Scene};

const CONTINUOUS: Ambiguities = Ambiguities::Continuous(Motion::Free);
const MODES: [Ambiguities; 2] = [Ambiguities::Instantaneous, CONTINUOUS];

/// A span of time in which something is wrong.
#[derive(Clone, Copy)]
struct Span {
    from_s: f64,
    to_s: f64,
}

impl Span {
    fn contains(self, time_s: f64) -> bool {
        // Epochs are 0.1 s apart.
        (self.from_s - 0.01..self.to_s - 0.01).contains(&time_s)
    }
}

/// How a run went.
#[derive(Debug, Default)]
struct Tally {
    epochs: usize,
    wrong: usize,
    fixed: usize,
    /// Rows of the faulty span, and those fixed (rightly) of them.
    during: usize,
    fixed_during: usize,
    /// Rows after the faulty span, s: from its end to the first right fix, and rows without one
    /// later.
    return_s: Option<f64>,
    not_fixed_later: usize,
}

/// Runs the scene with `spoil` applied within `fault`.
fn tally(scene: Scene, fault: Span, spoil: impl Fn(f64, &mut ArrayEpoch)) -> Tally {
    let mut tally = Tally::default();
    let spoil = |time_s: f64, mut epoch: ArrayEpoch| {
        spoil(time_s, &mut epoch);
        vec![epoch]
    };
    scene.run(spoil, |time_s, row, outcome| {
        tally.count(fault, time_s, outcome);
        if outcome == Outcome::Wrong {
            println!("wrong at {time_s:.1} s: {row:?}");
        }
    });
    tally
}

impl Tally {
    fn count(&mut self, fault: Span, time_s: f64, outcome: Outcome) {
        let right = outcome == Outcome::Right;
        self.epochs += 1;
        self.wrong += usize::from(outcome == Outcome::Wrong);
        self.fixed += usize::from(right);
        if fault.contains(time_s) {
            self.during += 1;
            self.fixed_during += usize::from(right);
        } else if time_s >= fault.to_s - 0.01 {
            match self.return_s {
                None if right => self.return_s = Some(time_s - fault.to_s),
                Some(_) if !right => self.not_fixed_later += 1,
                _ => {}
            }
        }
    }

    /// No wrong fix; right ones within `limit_s` after the fault.
    fn assert(&self, what: &str, mode: Ambiguities) {
        println!("{what}, {mode:?}: {self:?}");
        assert_eq!(self.wrong, 0, "{what}, {mode:?}");
        let limit_s = if mode == Ambiguities::Instantaneous { 0.15 } else { 2.0 };
        assert!(self.return_s.is_some_and(|s| s < limit_s), "{what}, {mode:?}: {self:?}");
    }
}

fn scene(mode: Ambiguities, constraint: Constraint) -> Scene {
    let mut scene = Scene::new(3, |_| {});
    (scene.settings.ambiguities, scene.settings.constraint) = (mode, constraint);
    scene
}

/// Adds cycles to the `index`-th satellite with a phase of one antenna.
fn add_cycles(epoch: &mut ArrayEpoch, antenna: usize, index: usize, cycles: f64, lock: Lock) {
    let Some(observed) = &mut epoch.antennas[antenna] else { return };
    let mut with_phase = observed.observations.iter_mut().filter(|o| o.phase_cycles.is_some());
    if let Some(observation) = with_phase.nth(index) {
        observation.phase_cycles = observation.phase_cycles.map(|phase| phase + cycles);
        observation.lock = Lock(observation.lock.0 | lock.0);
    }
}

/// One cycle every 10 s on one antenna, each time another satellite, with and without a flag; no
/// Doppler shift that could tell.
#[test]
fn slips_of_one_cycle() {
    for mode in MODES {
        for flagged in [true, false] {
            for constraint in [Constraint::Array, Constraint::None] {
                let tally = tally(scene(mode, constraint), EVERY, |time_s, epoch| {
                    for observed in epoch.antennas.iter_mut().flatten() {
                        observed.observations.iter_mut().for_each(|o| o.doppler_hz = None);
                    }
                    for (count, index) in (1..6).zip([0, 3, 5, 7, 2]) {
                        let slip_s = 10.0 * f64::from(count);
                        let first = Span { from_s: slip_s, to_s: slip_s + 0.1 }.contains(time_s);
                        if time_s >= slip_s - 0.01 {
                            let lock = if flagged && first { Lock::SLIP } else { 0 };
                            add_cycles(epoch, 1, index, 1.0, Lock(lock));
                        }
                    }
                });
                println!("flagged {flagged}, {constraint:?}, {mode:?}: {tally:?}");
                assert_eq!(tally.wrong, 0);
                let least = if constraint == Constraint::Array { 0.99 } else { 0.9 };
                let all = tally.epochs as f64;
                if mode != Ambiguities::Instantaneous || constraint == Constraint::Array {
                    assert!(tally.fixed as f64 >= least * all, "{tally:?}");
                }
            }
        }
    }
}

/// Covers the whole run: there is nothing to return from.
const EVERY: Span = Span { from_s: 0.0, to_s: 1e9 };

#[test]
fn an_antenna_is_silent_for_30_s() {
    for mode in MODES {
        for silent in 0..3 {
            let fault = Span { from_s: 15.0, to_s: 45.0 };
            let tally = tally(scene(mode, Constraint::Array), fault, |time_s, epoch| {
                if fault.contains(time_s) {
                    epoch.antennas[silent] = None;
                }
            });
            tally.assert(&format!("antenna {silent} silent"), mode);
            assert_eq!(tally.not_fixed_later, 0, "{tally:?}");
        }
    }
}

/// Half cycles on three satellites of one antenna, flagged as unresolved and, worse, not flagged.
#[test]
fn half_cycles() {
    for mode in MODES {
        for flagged in [true, false] {
            let fault = Span { from_s: 20.0, to_s: 30.0 };
            let tally = tally(scene(mode, Constraint::Array), fault, |time_s, epoch| {
                if fault.contains(time_s) {
                    let lock = if flagged { Lock::HALF_CYCLE } else { 0 };
                    for index in [1, 4, 6] {
                        add_cycles(epoch, 2, index, 0.5, Lock(lock));
                    }
                }
            });
            tally.assert(&format!("half cycles, flagged {flagged}"), mode);
        }
    }
}

/// All Galileo phases of one antenna are off, each by another part of a cycle: GPS alone goes on.
#[test]
fn a_biased_constellation() {
    for mode in MODES {
        // Proving that no integers fit takes the search long, so not many epochs.
        let fault = Span { from_s: 20.0, to_s: 22.0 };
        let tally = tally(scene(mode, Constraint::Array), fault, |time_s, epoch| {
            if !fault.contains(time_s) {
                return;
            }
            for observation in &mut epoch.antennas[1].as_mut().unwrap().observations {
                if observation.satellite.system == System::Galileo {
                    let part = f64::from(observation.satellite.number % 5) * 0.21;
                    observation.phase_cycles = observation.phase_cycles.map(|phase| phase + part);
                }
            }
        });
        tally.assert("biased constellation", mode);
        assert!(tally.fixed_during * 10 >= tally.during * 9, "{tally:?}");
        assert_eq!(tally.not_fixed_later, 0, "{tally:?}");
    }
}

#[test]
fn tags_off_by_400_ms() {
    for mode in MODES {
        let fault = Span { from_s: 20.0, to_s: 30.0 };
        let tally = tally(scene(mode, Constraint::Array), fault, |time_s, epoch| {
            if fault.contains(time_s) {
                let observed = epoch.antennas[1].as_mut().unwrap();
                observed.time += 0.4;
            }
        });
        tally.assert("tags off by 0.4 s", mode);
    }
}

#[test]
fn doubled_and_swapped_epochs() {
    for mode in MODES {
        let mut tally = Tally::default();
        let mut waiting: Option<ArrayEpoch> = None;
        let mut count = 0;
        let spoil = |_: f64, epoch: ArrayEpoch| {
            count += 1;
            match count % 10 {
                // Every tenth epoch comes twice; of two others the later one comes first.
                0 => vec![epoch.clone(), epoch],
                5 => {
                    waiting = Some(epoch);
                    Vec::new()
                }
                6 => [Some(epoch), waiting.take()].into_iter().flatten().collect(),
                _ => vec![epoch],
            }
        };
        scene(mode, Constraint::Array).run(spoil, |time_s, _, outcome| {
            tally.count(EVERY, time_s, outcome);
        });
        println!("doubled and swapped, {mode:?}: {tally:?}");
        assert_eq!((tally.wrong, tally.epochs), (0, 661));
        assert!(tally.fixed >= 660, "{tally:?}");
    }
}
