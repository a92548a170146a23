//! How far apart the samples of a sensor usually are, and which steps are pauses.

/// The usual step from one sample to the next, which follows the steps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct UsualStep {
    step_s: Option<f64>,
    pause_steps: f64,
    share: f64,
}

impl UsualStep {
    /// Steps longer than `pause_steps` usual ones are pauses; `share` of each step goes into the usual one.
    #[must_use]
    pub const fn new(pause_steps: f64, share: f64) -> Self {
        Self { step_s: None, pause_steps, share }
    }

    /// The usual step, s; `None` before the first one.
    #[must_use]
    pub const fn step_s(&self) -> Option<f64> {
        self.step_s
    }

    /// The longest step that is no pause, s; `None` before the first step.
    #[must_use]
    pub fn longest_s(&self) -> Option<f64> {
        self.step_s.map(|step_s| self.pause_steps * step_s)
    }

    /// Whether samples are missing in a step of so many seconds.
    #[must_use]
    pub fn is_pause(&self, step_s: f64) -> bool {
        self.longest_s().is_some_and(|longest_s| step_s > longest_s)
    }

    /// Takes a step in; a pause counts as the longest one that is none, a repeated time is no step.
    pub fn follow(&mut self, step_s: f64) {
        if step_s <= 0.0 {
            return;
        }
        let usual_s = self.step_s.unwrap_or(step_s);
        let followed_s = step_s.min(self.pause_steps * usual_s);
        self.step_s = Some(usual_s + self.share * (followed_s - usual_s));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn repeated_times_are_no_steps_and_pauses_hardly_count() {
        let mut usual = UsualStep::new(2.5, 0.05);
        for _ in 0..3 {
            usual.follow(0.0);
            assert_eq!((usual.step_s(), usual.is_pause(10.0)), (None, false));
        }
        usual.follow(0.01);
        assert!(usual.is_pause(0.026) && !usual.is_pause(0.025));
        usual.follow(60.0);
        assert!((usual.step_s().unwrap() - 0.010_75).abs() < 1e-12);
    }
}
