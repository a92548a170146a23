//! Carrier phases over time: slips that the receiver tells of, and jumps that the phases show.
//!
//! The geometry-free combination of two bands, `L_a − L_b` in metres, holds neither distances nor
//! clocks: it changes with the ionosphere only, and jumps where either phase slips.

use std::collections::BTreeMap;

use kurs::observation::Observation;
use kurs::signal::{Satellite, Signal};

/// A change of the geometry-free combination that the ionosphere does not make: at once, and per
/// second between the epochs.
const JUMP_M: f64 = 0.05;
const JUMP_MPS: f64 = 0.002;
/// Longest step over which jumps can be seen, s.
const LONGEST_STEP_S: f64 = 120.0;

/// A phase of one satellite in one epoch.
#[derive(Debug, Clone, Copy)]
pub(super) struct Phase {
    pub(super) signal: Signal,
    pub(super) phase_m: f64,
    pub(super) slipped: bool,
}

/// Two signals of one satellite in the epoch before.
#[derive(Debug, Clone, Copy)]
struct Pair {
    signals: (Signal, Signal),
    epoch: u64,
    difference_m: f64,
}

/// Jumps of one pair of signals, over all satellites.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Jumps {
    /// Steps from one epoch to the next that could be judged.
    pub(super) steps: u64,
    /// Those at which the combination jumps.
    pub(super) jumps: u64,
    /// Those of the jumps that neither of the two loss-of-lock digits announces.
    pub(super) unannounced: u64,
}

/// Follows the geometry-free combinations of all satellites.
#[derive(Debug, Default)]
pub(super) struct Arcs {
    pairs: BTreeMap<Satellite, Vec<Pair>>,
    pub(super) jumps: BTreeMap<(Signal, Signal), Jumps>,
}

impl Arcs {
    /// Takes in the phases of one satellite in epoch number `epoch`, `step_s` after the one before:
    /// the first one against each that is of another band.
    pub(super) fn add(
        &mut self,
        satellite: Satellite,
        phases: &[Phase],
        epoch: u64,
        step_s: Option<f64>,
    ) {
        let Some((first, others)) = phases.split_first() else { return };
        let pairs = self.pairs.entry(satellite).or_default();
        for other in others.iter().filter(|other| other.signal.band != first.signal.band) {
            let difference_m = first.phase_m - other.phase_m;
            let signals = (first.signal, other.signal);
            let now = Pair { signals, epoch, difference_m };
            let Some(known) = pairs.iter_mut().find(|pair| pair.signals == signals) else {
                pairs.push(now);
                continue;
            };
            let before = core::mem::replace(known, now);
            let Some(step_s) = step_s else { continue };
            if before.epoch + 1 != epoch || step_s > LONGEST_STEP_S {
                continue;
            }
            let jumps = self.jumps.entry(signals).or_default();
            jumps.steps += 1;
            if (difference_m - before.difference_m).abs() > JUMP_M + JUMP_MPS * step_s {
                jumps.jumps += 1;
                jumps.unannounced += u64::from(!(first.slipped || other.slipped));
            }
        }
    }
}

/// Replaces `phases` by those of one satellite's observations that can be expressed in metres, in
/// the order of signals: that of a file may change within it.
pub(super) fn fill_phases(
    phases: &mut Vec<Phase>,
    observations: &[Observation],
    channel: Option<i8>,
    power_failure: bool,
) {
    phases.clear();
    phases.extend(observations.iter().filter_map(|o| {
        Some(Phase {
            signal: o.signal,
            phase_m: o.phase_cycles? * o.signal.band.wavelength_m(channel)?,
            slipped: o.lock.slipped() || power_failure,
        })
    }));
    phases.sort_by_key(|phase| phase.signal);
}

#[cfg(test)]
mod tests {
    use super::*;
    use kurs::signal::System;

    #[test]
    fn a_slip_of_one_cycle_shows_announced_or_not() {
        let satellite = Satellite::new(System::Gps, 5);
        let signals = [Signal::new(System::Gps, 1, b'C'), Signal::new(System::Gps, 2, b'W')];
        let mut arcs = Arcs::default();
        for epoch in 0..10_u64 {
            let distance_m = 2e7 + 500.0 * epoch as f64;
            let wavelength_m = signals[0].band.wavelength_m(None).unwrap();
            let cycles = [f64::from(u8::from(epoch >= 4)), 0.0];
            let late_m = if epoch >= 7 { 3.0 } else { 0.0 };
            let phases = [0, 1].map(|i| Phase {
                signal: signals[i],
                phase_m: distance_m + cycles[i] * wavelength_m + late_m * i as f64,
                slipped: epoch == 7 && i == 1,
            });
            arcs.add(satellite, &phases, epoch, (epoch > 0).then_some(1.0));
        }
        let jumps = arcs.jumps[&(signals[0], signals[1])];
        assert_eq!(jumps, Jumps { steps: 9, jumps: 2, unannounced: 1 });
    }
}
