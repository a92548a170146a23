//! The backward run of `direction = "both"`.
//!
//! Files are read forward only. Each pass over them keeps the last epochs before those that are
//! done, as many as memory is meant for, and the engine takes these in reverse: a session that fits
//! is read once more than without, a longer one once more for each such part.

use std::collections::VecDeque;

use kurs::both_directions::BackwardRows;
use kurs::differential::Differential;
use kurs::ephemeris::NavigationData;
use kurs::observation::{AntennaEpoch, ArrayEpoch, Observation};
use kurs::time::GpsTime;

use super::config::Loaded;
use super::input;
use crate::interrupt::Watch;
use crate::progress::Progress;

/// What epochs may take at a time, bytes: two hours of four antennas with 30 satellites on two
/// bands at 1 Hz.
const MAX_MEMORY: usize = 150_000_000;

/// Solves the session from its end to its begin, with an engine that goes backward.
pub(super) fn solve(
    loaded: &Loaded,
    navigation: &NavigationData,
    mut engine: Differential,
    watch: &Watch,
    progress: &mut Progress,
) -> anyhow::Result<BackwardRows> {
    let mut rows = BackwardRows::default();
    let mut end = None;
    loop {
        let epochs = last_epochs(loaded, navigation, end)?;
        let Some(first) = epochs.front() else { return Ok(rows) };
        end = Some(first.time);
        for epoch in epochs.into_iter().rev() {
            if watch.asks_to_end() {
                return Ok(rows);
            }
            let row = engine.push(&epoch, None);
            progress.epoch(row.is_fixed(), || None);
            rows.push(row);
        }
    }
}

/// The last epochs before `end`, or of the session, that fit into memory, in the order of time.
fn last_epochs(
    loaded: &Loaded,
    navigation: &NavigationData,
    end: Option<GpsTime>,
) -> anyhow::Result<VecDeque<ArrayEpoch>> {
    let mut streams = input::streams(loaded, navigation)?;
    let (mut epochs, mut kept) = (VecDeque::new(), 0);
    loop {
        let mut epoch = ArrayEpoch::default();
        if !streams.next(&mut epoch)? || end.is_some_and(|end| epoch.time >= end) {
            return Ok(epochs);
        }
        kept += memory(&epoch);
        epochs.push_back(epoch);
        while kept > MAX_MEMORY && epochs.len() > 1 {
            kept -= epochs.pop_front().as_ref().map_or(0, memory);
        }
    }
}

/// What an epoch takes, bytes.
fn memory(epoch: &ArrayEpoch) -> usize {
    let of_antenna = |antenna: &AntennaEpoch| {
        size_of::<AntennaEpoch>() + antenna.observations.capacity() * size_of::<Observation>()
    };
    let antennas = epoch.antennas.iter().flatten().chain(&epoch.station);
    size_of::<ArrayEpoch>() + antennas.map(of_antenna).sum::<usize>()
}
