//! Keeps a bounded number of epochs for plots, without hiding trouble: a group of epochs is
//! represented by one that is not fixed, if it has any.

use kurs::solution::Status;

use super::Sample;

/// Groups never exceed this number; when they do, neighbours are joined.
const MOST: usize = 2000;

/// See the module.
#[derive(Debug, Default)]
pub(super) struct Thinned {
    /// One of every group that is complete.
    kept: Vec<Sample>,
    /// Of the group that is open, and how many epochs it has.
    open: Option<(Sample, usize)>,
    /// Epochs in a group, less one.
    more: usize,
}

impl Thinned {
    pub(super) fn push(&mut self, sample: Sample) {
        let (chosen, count) = match self.open.take() {
            Some((chosen, count)) => (worse(chosen, sample), count + 1),
            None => (sample, 1),
        };
        if count <= self.more {
            self.open = Some((chosen, count));
            return;
        }
        self.kept.push(chosen);
        if self.kept.len() == MOST {
            let mut all = core::mem::take(&mut self.kept).into_iter();
            while let Some(one) = all.next() {
                self.kept.push(match all.next() {
                    Some(other) => worse(one, other),
                    None => one,
                });
            }
            self.more = 2 * self.more + 1;
        }
    }

    /// What is kept, in time order; an incomplete last group is left out.
    pub(super) fn all(&self) -> &[Sample] {
        &self.kept
    }

    /// Epochs in a group.
    pub(super) const fn kept_every(&self) -> usize {
        self.more + 1
    }
}

/// The one that is not fixed, else the first.
fn worse(one: Sample, other: Sample) -> Sample {
    if one.status == Status::Fixed && other.status != Status::Fixed { other } else { one }
}

#[cfg(test)]
mod tests {
    use super::*;
    use kurs::time::GpsTime;

    #[test]
    fn a_long_run_stays_small_and_shows_its_only_trouble() {
        let mut thinned = Thinned::default();
        for k in 0..36_000 {
            thinned.push(Sample {
                time: GpsTime::default(),
                elapsed_s: f64::from(k) * 0.1,
                status: if k == 12_345 { Status::Lost } else { Status::Fixed },
                reason: "",
                angles_deg: [None; 3],
                sd_deg: [0.0; 3],
                truth_deg: None,
                satellites: 0,
                success_rate: None,
                residual_rms_m: None,
                lengths_m: Vec::new(),
                position: None,
            });
        }
        let all = thinned.all();
        assert!((MOST / 2..=MOST).contains(&all.len()), "{}", all.len());
        assert_eq!(thinned.kept_every(), 32);
        let lost: Vec<f64> =
            all.iter().filter(|s| s.status == Status::Lost).map(|s| s.elapsed_s).collect();
        assert_eq!(lost, [1234.5]);
        assert!(all.windows(2).all(|pair| pair[0].elapsed_s < pair[1].elapsed_s));
    }
}
