//! Keeps a bounded number of epochs for plots, without hiding trouble or the solution: a group of
//! epochs is represented by one that is not fixed, if it has any, and by one that has an attitude.

use kurs::solution::Status;

use super::Sample;

/// Groups never exceed this number; when they do, neighbours are joined.
const MOST: usize = 2000;

/// See the module.
#[derive(Debug, Default)]
pub(super) struct Thinned {
    /// Groups that are complete.
    kept: Vec<Group>,
    /// The group that is open, and how many epochs it has.
    open: Option<(Group, usize)>,
    /// Epochs in a group, less one.
    more: usize,
}

/// What represents some epochs that follow each other.
#[derive(Debug, Clone)]
struct Group {
    /// Not fixed, else the first.
    worst: Sample,
    /// With an attitude, where the other has none.
    solved: Option<Sample>,
}

impl Thinned {
    pub(super) fn push(&mut self, sample: Sample) {
        let alone = Group { worst: sample, solved: None };
        let (group, count) = match self.open.take() {
            Some((group, count)) => (group.joined(alone), count + 1),
            None => (alone, 1),
        };
        if count <= self.more {
            self.open = Some((group, count));
            return;
        }
        self.kept.push(group);
        if self.kept.len() == MOST {
            let mut all = core::mem::take(&mut self.kept).into_iter();
            while let Some(one) = all.next() {
                self.kept.push(match all.next() {
                    Some(other) => one.joined(other),
                    None => one,
                });
            }
            self.more = 2 * self.more + 1;
        }
    }

    /// What is kept, in time order.
    pub(super) fn all(&self) -> Vec<Sample> {
        let groups = self.kept.iter().chain(self.open.as_ref().map(|(group, _)| group));
        let mut samples: Vec<Sample> =
            groups.flat_map(|g| g.solved.iter().chain([&g.worst])).cloned().collect();
        samples.sort_by_key(|sample| sample.time);
        samples
    }

    /// Epochs in a group.
    pub(super) const fn kept_every(&self) -> usize {
        self.more + 1
    }
}

impl Group {
    fn joined(self, other: Self) -> Self {
        let is_worse = self.worst.status == Status::Fixed && other.worst.status != Status::Fixed;
        let (worst, better) =
            if is_worse { (other.worst, self.worst) } else { (self.worst, other.worst) };
        let solved = [self.solved, other.solved, Some(better)].into_iter().flatten();
        let has_attitude = |sample: &Sample| sample.angles_deg.iter().any(Option::is_some);
        let wanted = !has_attitude(&worst);
        Self { solved: solved.into_iter().find(|sample| wanted && has_attitude(sample)), worst }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use kurs::time::GpsTime;

    fn sample(k: i64, status: Status) -> Sample {
        Sample {
            time: GpsTime::from_nanoseconds(k * 100_000_000),
            status,
            reason: "",
            angles_deg: [(status == Status::Fixed).then_some(1.0); 3],
            sd_deg: [0.0; 3],
            rates: [None; 3],
            truth_deg: None,
            satellites: 0,
            success_rate: None,
            residual_rms_m: None,
            lengths_m: Vec::new(),
            position: None,
        }
    }

    #[test]
    fn a_solution_between_gaps_is_kept() {
        let mut thinned = Thinned::default();
        for k in 0..9000 {
            thinned.push(sample(k, if k % 2 == 0 { Status::Lost } else { Status::Fixed }));
        }
        let all = thinned.all();
        let fixed = all.iter().filter(|s| s.status == Status::Fixed).count();
        assert!(all.len() <= 2 * MOST && (all.len() / 2).abs_diff(fixed) <= 1, "{fixed}");
        assert!(all.windows(2).all(|pair| pair[0].time < pair[1].time));
    }

    #[test]
    fn a_long_run_stays_small_and_shows_its_only_trouble() {
        let mut thinned = Thinned::default();
        for k in 0..36_000 {
            thinned.push(sample(k, if k == 12_345 { Status::Lost } else { Status::Fixed }));
        }
        let all = thinned.all();
        assert!((MOST / 2..=MOST + 1).contains(&all.len()), "{}", all.len());
        assert_eq!(thinned.kept_every(), 32);
        let lost: Vec<f64> =
            all.iter().filter(|s| s.status == Status::Lost).map(|s| s.time.tow_s()).collect();
        assert_eq!(lost, [1234.5]);
        assert!(all.windows(2).all(|pair| pair[0].time < pair[1].time));
    }
}
