//! What is gathered on the way through an observation file.

use std::collections::{BTreeMap, BTreeSet};

use kurs::observation::{AntennaEpoch, Observation};
use kurs::signal::{Satellite, Signal, System};

use super::arcs::{Arcs, Phase, fill_phases};
use super::timeline::Timeline;

/// Counts of one signal.
#[derive(Debug, Default)]
pub(super) struct SignalCount {
    /// Number of satellites.
    pub(super) satellites: usize,
    pub(super) pseudoranges: u64,
    pub(super) phases: u64,
    pub(super) dopplers: u64,
    pub(super) strengths: u64,
    pub(super) strength_sum: f64,
    pub(super) strength_range: Option<(f64, f64)>,
    pub(super) lock_lost: u64,
    pub(super) slips: u64,
    pub(super) half_cycles: u64,
}

/// Everything that is gathered on the way through the file.
#[derive(Debug, Default)]
pub(super) struct Gathered {
    pub(super) timeline: Timeline,
    pub(super) signals: BTreeMap<Signal, SignalCount>,
    pub(super) arcs: Arcs,
    /// With the signals of each, and the number of the last epoch in which the phase was there.
    pub(super) satellites: BTreeMap<Satellite, Vec<(Signal, Option<u64>)>>,
    /// Epochs whose receiver clock offset is stated and not applied.
    pub(super) clock_offsets: u64,
    /// GLONASS satellites without a known frequency.
    pub(super) without_channel: BTreeSet<Satellite>,
    epochs: u64,
    /// Phases of one satellite in one epoch.
    phases: Vec<Phase>,
}

impl Gathered {
    /// Takes an epoch in; `channel` tells the frequency channels of GLONASS satellites.
    pub(super) fn add(&mut self, epoch: &AntennaEpoch, channel: impl Fn(Satellite) -> Option<i8>) {
        let step_s = self.timeline.add(epoch.time);
        self.epochs += 1;
        self.clock_offsets += u64::from(epoch.clock_offset_s.is_some());
        for observations in epoch.observations.chunk_by(|a, b| a.satellite == b.satellite) {
            let satellite = observations[0].satellite;
            self.count(satellite, observations);
            let channel = (satellite.system == System::Glonass).then(|| channel(satellite));
            if channel == Some(None) {
                self.without_channel.insert(satellite);
            }
            fill_phases(&mut self.phases, observations, channel.flatten(), epoch.power_failure);
            self.arcs.add(satellite, &self.phases, self.epochs, step_s);
        }
    }

    fn count(&mut self, satellite: Satellite, observations: &[Observation]) {
        let of_satellite = self.satellites.entry(satellite).or_default();
        for o in observations {
            let count = self.signals.entry(o.signal).or_default();
            let known = of_satellite.iter().position(|(signal, _)| *signal == o.signal);
            let place = known.unwrap_or_else(|| {
                count.satellites += 1;
                of_satellite.push((o.signal, None));
                of_satellite.len() - 1
            });
            count.pseudoranges += u64::from(o.pseudorange_m.is_some());
            count.dopplers += u64::from(o.doppler_hz.is_some());
            if let Some(cn0) = o.cn0_dbhz {
                count.strengths += 1;
                count.strength_sum += cn0;
                let (least, most) = count.strength_range.unwrap_or((cn0, cn0));
                count.strength_range = Some((least.min(cn0), most.max(cn0)));
            }
            if o.phase_cycles.is_none() {
                continue;
            }
            count.phases += 1;
            let before = of_satellite[place].1.replace(self.epochs);
            let continues = before == Some(self.epochs - 1);
            count.lock_lost += u64::from(o.lock.slipped());
            count.slips += u64::from(o.lock.slipped() && continues);
            count.half_cycles += u64::from(o.lock.half_cycle_unresolved());
        }
    }

    /// The signals that were observed.
    pub(super) fn observed(&self) -> impl Iterator<Item = Signal> {
        self.signals.keys().copied()
    }

    /// Number of satellites of each system.
    pub(super) fn satellites_by_system(&self) -> BTreeMap<String, usize> {
        let mut systems = BTreeMap::new();
        for satellite in self.satellites.keys() {
            *systems.entry(satellite.system.to_string()).or_default() += 1;
        }
        systems
    }
}
