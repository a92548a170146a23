//! Whole cycles of phases, which logs have no room for.

use std::collections::BTreeMap;

use kurs::signal::{Satellite, Signal};

/// What was taken off the phases so that they fit beside their pseudoranges.
#[derive(Debug, Default)]
pub(crate) struct WholeCycles {
    taken_off: BTreeMap<(Satellite, Signal), f64>,
}

impl WholeCycles {
    /// The phase less whole cycles, within `span_cycles` of the range: the same number of them as
    /// long as it fits.
    pub(crate) fn take_off(
        &mut self,
        key: (Satellite, Signal),
        phase_cycles: f64,
        range_cycles: f64,
        span_cycles: f64,
    ) -> f64 {
        let away_cycles = phase_cycles - range_cycles;
        let taken_off = self.taken_off.entry(key).or_insert_with(|| away_cycles.round());
        if (away_cycles - *taken_off).abs() > span_cycles {
            *taken_off = away_cycles.round();
        }
        phase_cycles - *taken_off
    }
}
