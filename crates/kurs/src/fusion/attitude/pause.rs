//! What is known of the time between two samples when others between them were lost.

use super::session::ImuSample;
use crate::frames::{Body, Vector};
use crate::fusion::usual_step::{LONGEST_BRIDGED_S, LOST_SAMPLES, UsualStep};

/// The first sample may be the mean over as much as this.
const LONGEST_FIRST_STEP_S: f64 = 1.0;
/// How fast the mean change follows the changes.
const CHANGE_SHARE: f64 = 0.05;

/// A sample that says nothing.
pub(super) const NOTHING: ImuSample =
    ImuSample { rate_radps: None, specific_force_mps2: None, saturated: false };

/// The time before a sample that it says nothing of.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Pause {
    pub(super) until_s: f64,
    /// What stands for the lost samples.
    pub(super) sample: ImuSample,
    /// By how much rate and force are less sure in it: rad/√s and (m/s²)/√Hz.
    pub(super) noise: [f64; 2],
}

/// How the samples of a sensor follow each other.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Cadence {
    step: UsualStep,
    /// Mean square of how much rate and force change from sample to sample, rad²/s² and m²/s⁴.
    change_squares: [Option<f64>; 2],
}

impl Pause {
    pub(super) const NONE: Self = Self::unknown(f64::NEG_INFINITY);

    pub(super) const fn unknown(until_s: f64) -> Self {
        Self { until_s, sample: NOTHING, noise: [0.0; 2] }
    }
}

impl Cadence {
    /// Until when the last sample may be taken to hold.
    pub(super) fn held_until_s(&self, last_s: f64) -> f64 {
        last_s + LOST_SAMPLES * self.step.seconds().unwrap_or(0.0)
    }

    /// Takes two samples that follow each other.
    pub(super) fn follow(
        &mut self,
        (last_s, last): (f64, ImuSample),
        (at_s, at): (f64, ImuSample),
    ) {
        let step_s = at_s - last_s;
        self.step.follow(step_s);
        if self.step.has_lost(step_s) {
            return;
        }
        for (mean, change) in self.change_squares.iter_mut().zip(changes(&last, &at)) {
            let square = change.map(|change| change * change);
            let followed = |before: f64, square: f64| before + CHANGE_SHARE * (square - before);
            *mean = mean.zip(square).map_or(mean.or(square), |(m, s)| Some(followed(m, s)));
        }
    }

    /// The time before a sample of which it says nothing: none where it follows the one before it in the
    /// usual step, otherwise all but that step.
    pub(super) fn pause(
        &self,
        last: Option<(f64, ImuSample)>,
        (at_s, at): (f64, ImuSample),
    ) -> Pause {
        let Some((last_s, last)) = last else { return Pause::unknown(at_s - LONGEST_FIRST_STEP_S) };
        let has_lost = self.step.has_lost(at_s - last_s);
        let Some(usual_s) = self.step.seconds().filter(|_| has_lost) else { return Pause::NONE };
        let until_s = at_s - usual_s;
        let lost_s = until_s - last_s;
        if lost_s > LONGEST_BRIDGED_S {
            return Pause::unknown(until_s);
        }
        // In the pause the value stands anywhere in a range w: as wide as it changed over the pause, or as it
        // usually does, d a step, over so many steps, w = d (t + u)/u. σ = w/√12 all through t is the
        // density σ √t.
        let steps = (lost_s + usual_s) / usual_s;
        let changed = changes(&last, &at);
        let noise = core::array::from_fn(|k| {
            let usually = self.change_squares[k].unwrap_or(0.0).sqrt() * steps;
            changed[k].unwrap_or(0.0).max(usually) * (lost_s / 12.0).sqrt()
        });
        let sample = ImuSample {
            rate_radps: middle(last.rate_radps, at.rate_radps),
            specific_force_mps2: middle(last.specific_force_mps2, at.specific_force_mps2),
            saturated: false,
        };
        Pause { until_s, sample, noise }
    }
}

/// By how much rate and force differ, rad/s and m/s²; `None` where one of them is not known.
fn changes(from: &ImuSample, to: &ImuSample) -> [Option<f64>; 2] {
    let change = |from: Option<Vector<Body>>, to: Option<Vector<Body>>| {
        let change = from.zip(to).map(|(from, to)| (to - from).norm());
        change.filter(|change| change.is_finite())
    };
    [
        change(from.rate_radps, to.rate_radps),
        change(from.specific_force_mps2, to.specific_force_mps2),
    ]
}

fn middle(from: Option<Vector<Body>>, to: Option<Vector<Body>>) -> Option<Vector<Body>> {
    from.zip(to).map(|(from, to)| (from + to) * 0.5)
}
