//! Epochs spread over the whole session, few enough to be solved many times.

use std::collections::{BTreeMap, BTreeSet};

use kurs::observation::ArrayEpoch;
use kurs::signal::Band;

use super::patient::MANY;
use crate::copies::Copies;
use crate::session_span::SessionSpan;
use crate::solve::streams::Streams;

/// The sample, and what was seen of the rest.
pub(crate) struct Sample {
    pub(crate) epochs: Vec<ArrayEpoch>,
    /// Epochs of the session.
    pub(crate) of: usize,
    /// How many there should be.
    pub(crate) session: SessionSpan,
    /// Antennas with the same observations.
    pub(crate) copies: Copies,
    /// Time spans of the antennas, in words.
    pub(crate) spans: String,
}

impl Sample {
    /// Keeps every epoch at first, and every second of those kept whenever there are more than
    /// `max_epochs`.
    pub(crate) fn take(streams: &mut Streams, max_epochs: usize) -> anyhow::Result<Self> {
        let mut epochs: Vec<ArrayEpoch> = Vec::new();
        let (mut session, mut copies) = (SessionSpan::default(), Copies::default());
        let (mut of, mut stride) = (0, 1);
        let mut epoch = ArrayEpoch::default();
        while streams.next(&mut epoch)? {
            session.add(epoch.time);
            copies.add(&epoch);
            if of % stride == 0 {
                if epochs.len() == max_epochs {
                    stride *= 2;
                    let mut number = 0;
                    epochs.retain(|_| {
                        number += 1;
                        number % 2 == 1
                    });
                }
                if of % stride == 0 {
                    epochs.push(epoch.clone());
                }
            }
            of += 1;
        }
        anyhow::ensure!(of > 0, "no epoch in any observation file ({})", streams.spans());
        Ok(Self { epochs, of, session, copies, spans: streams.spans() })
    }

    /// Bands that two antennas have in many of the epochs.
    pub(crate) fn shared_bands(&self) -> BTreeSet<Band> {
        let mut counts: BTreeMap<(usize, Band), usize> = BTreeMap::new();
        for (antenna, epoch) in self.epochs.iter().flat_map(|e| e.antennas.iter().enumerate()) {
            let observed = epoch.iter().flat_map(|e| &e.observations);
            let bands: BTreeSet<Band> = observed.map(|o| o.signal.band).collect();
            for band in bands {
                *counts.entry((antenna, band)).or_default() += 1;
            }
        }
        let many = |count: usize| count as f64 > MANY * self.epochs.len() as f64;
        let frequent = counts.iter().filter(|(_, count)| many(**count));
        let mut antennas: BTreeMap<Band, usize> = BTreeMap::new();
        for ((_, band), _) in frequent {
            *antennas.entry(*band).or_default() += 1;
        }
        antennas.into_iter().filter(|(_, count)| *count >= 2).map(|(band, _)| band).collect()
    }
}
