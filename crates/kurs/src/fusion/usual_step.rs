//! How far the samples of a sensor are usually apart, and from when on a longer time without one has lost some.

/// A step longer than so many usual ones has lost samples.
pub const LOST_SAMPLES: f64 = 2.5;
/// The samples at the ends of a longer pause say nothing of the body in it, s: it turns into a bend and out
/// again, or rolls to and fro, in some tenths of a second.
pub const LONGEST_BRIDGED_S: f64 = 0.2;
/// So many steps say what is usual.
const STEPS: usize = 15;
/// The longest of them are pauses, it may be.
const PAUSES: usize = 2;

/// The step in which the middle of the time of the last steps lies, but for the longest ones: shorter
/// steps make up half of that time. Tags that come in bunches have next to no time, and a pause is one step.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct UsualStep {
    /// The last ones in turn; 0 where there was none yet.
    steps_s: [f64; STEPS],
    next: usize,
    usual_s: Option<f64>,
}

impl UsualStep {
    /// The usual step; `None` before the first.
    #[must_use]
    pub const fn seconds(&self) -> Option<f64> {
        self.usual_s
    }

    /// Whether samples were lost in a step.
    #[must_use]
    pub fn has_lost(&self, step_s: f64) -> bool {
        self.usual_s.is_some_and(|usual_s| step_s > LOST_SAMPLES * usual_s)
    }

    /// Takes a step; one that is not above zero is none.
    pub fn follow(&mut self, step_s: f64) {
        if step_s > 0.0 {
            self.steps_s[self.next] = step_s;
            self.next = (self.next + 1) % STEPS;
            self.usual_s = middle_of_time(self.steps_s);
        }
    }
}

/// The smallest step with which the steps up to it make up half of the time; of the first few steps the
/// shortest.
fn middle_of_time(mut steps_s: [f64; STEPS]) -> Option<f64> {
    steps_s.sort_by(f64::total_cmp);
    let mut left_s = steps_s[..STEPS - PAUSES].iter().sum::<f64>() / 2.0;
    let is_middle = |step_s: &f64| {
        left_s -= step_s;
        *step_s > 0.0 && left_s <= 0.0
    };
    steps_s.into_iter().find(is_middle)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn after(steps_s: impl IntoIterator<Item = f64>) -> f64 {
        let mut usual = UsualStep::default();
        steps_s.into_iter().for_each(|step_s| usual.follow(step_s));
        usual.seconds().unwrap()
    }

    /// Whatever the first steps were, the usual one is found within a fifth of a second of a sensor of 100 Hz.
    #[test]
    fn a_bad_beginning_is_forgotten() {
        for first_s in [0.0, 1e-9, 1e-4, 0.009, 0.2, 60.0] {
            let found_s = after([first_s].into_iter().chain([0.01; 20]));
            assert!((found_s - 0.01).abs() < 1e-12, "{first_s}: {found_s}");
        }
    }

    #[test]
    fn pauses_and_bunches_are_not_usual() {
        let with_pause = [0.01; 40].into_iter().chain([5.0, 0.01, 0.03, 0.01]);
        assert!((after(with_pause) - 0.01).abs() < 1e-12);
        // Four samples tagged at once, as a serial line gives them.
        let bunched = (0..100).map(|k| if k % 4 == 3 { 0.04 } else { 1e-5 });
        assert!((after(bunched) - 0.04).abs() < 1e-12);
        let slower = [0.01; 40].into_iter().chain([1.0; 10]);
        assert!((after(slower) - 1.0).abs() < 1e-12);
    }
}
