//! Epochs spread over the whole session, few enough to be solved many times.

use kurs::observation::ArrayEpoch;

use crate::solve::streams::Streams;

/// No more than this many epochs are kept.
const MAX_EPOCHS: usize = 400;

/// The sample, and what was seen of the rest.
pub(super) struct Sample {
    pub(super) epochs: Vec<ArrayEpoch>,
    /// Epochs of the session.
    pub(super) of: usize,
    /// Time spans of the antennas, in words.
    pub(super) spans: String,
}

impl Sample {
    /// Keeps every epoch at first, and every second of those kept whenever there are too many.
    pub(super) fn take(streams: &mut Streams) -> anyhow::Result<Self> {
        let mut epochs: Vec<ArrayEpoch> = Vec::new();
        let (mut of, mut stride) = (0, 1);
        let mut epoch = ArrayEpoch::default();
        while streams.next(&mut epoch)? {
            if of % stride == 0 {
                if epochs.len() == MAX_EPOCHS {
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
        Ok(Self { epochs, of, spans: streams.spans() })
    }
}
