//! Finds the rests in a log: where the sensor neither turned nor shook.

use core::ops::Range;

use nalgebra::Vector3;

use super::sensor_model::Pose;

/// What counts as a rest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RestSettings {
    /// Samples of the window whose scatter is judged.
    pub window: usize,
    /// Shortest rest, samples.
    pub shortest: usize,
    /// A window is quiet up to so many times the scatter of the quietest windows.
    pub factor: f64,
}

impl RestSettings {
    /// Windows of half a second, rests of two seconds, three times the quietest scatter.
    #[must_use]
    #[allow(clippy::cast_possible_truncation)] // between 2 and a million
    pub fn for_step(step_s: f64) -> Self {
        let samples = |seconds: f64| ((seconds / step_s).clamp(2.0, 1e6)) as usize;
        Self { window: samples(0.5), shortest: samples(2.0), factor: 3.0 }
    }
}

/// Steps in a window.
const HOPS: usize = 5;

/// The rests, as ranges of samples, in time order.
///
/// A window is quiet if the scatter of each axis is at most `factor` times the lowest tenth of all
/// windows; quiet windows that touch and have the same mean form a rest.
#[must_use]
pub fn find(samples: &[Vector3<f64>], settings: &RestSettings) -> Vec<Range<usize>> {
    let window = settings.window.max(2);
    // Overlapping, so that a rest is found as long as it is, not in whole windows.
    let hop = (window / HOPS).max(1);
    let windows: Vec<Pose> = samples.windows(window).step_by(hop).map(pose).collect();
    let mut scatters: Vec<f64> = windows.iter().map(|pose| pose.sample_sd_mps2).collect();
    scatters.sort_by(f64::total_cmp);
    let Some(quietest) = scatters.get(scatters.len() / 10) else { return Vec::new() };
    let limit = (settings.factor * quietest).max(f64::MIN_POSITIVE);
    let mut rests: Vec<Range<usize>> = Vec::new();
    for (k, one) in windows.iter().enumerate() {
        let range = k * hop..k * hop + window;
        // A scatter that is not a number is no rest.
        if one.sample_sd_mps2.is_nan() || one.sample_sd_mps2 > limit {
            continue;
        }
        // The quiet window a whole window before, or the first of the rest: those between share samples.
        let continues = rests.last().is_some_and(|rest| {
            let before = &windows[k.saturating_sub(window.div_ceil(hop)).max(rest.start / hop)];
            rest.end >= range.start && (before.mean_mps2 - one.mean_mps2).norm() < limit
        });
        match rests.last_mut() {
            Some(rest) if continues => rest.end = range.end,
            // Windows that reach over a change have samples of the rest before it.
            Some(rest) if rest.end > range.start => {}
            _ => rests.push(range),
        }
    }
    rests.retain(|rest| rest.len() >= settings.shortest);
    rests
}

/// Mean and scatter of the samples of a rest.
#[must_use]
pub fn pose(samples: &[Vector3<f64>]) -> Pose {
    let n = samples.len().max(1) as f64;
    let mean_mps2 = samples.iter().sum::<Vector3<f64>>() / n;
    let squares: Vector3<f64> =
        samples.iter().map(|s| (s - mean_mps2).component_mul(&(s - mean_mps2))).sum();
    let sample_sd_mps2 = (squares.max() / (n - 1.0).max(1.0)).sqrt();
    Pose { mean_mps2, sample_sd_mps2, samples: samples.len() }
}

/// The axis that reads one and the same value all the time while another one does not: at the end of
/// its range, or stuck.
#[must_use]
pub fn stuck_axis(samples: &[Vector3<f64>]) -> Option<usize> {
    let first = samples.first()?;
    let constant = [0, 1, 2].map(|axis| samples.iter().all(|s| s[axis] == first[axis]));
    let some_vary = constant.iter().any(|is_constant| !is_constant);
    constant.iter().position(|is_constant| *is_constant).filter(|_| some_vary)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};
    use rand_xoshiro::Xoshiro256PlusPlus;

    #[test]
    fn three_rests_between_turns() {
        let mut generator = Xoshiro256PlusPlus::seed_from_u64(2);
        let mut samples = Vec::new();
        for k in 0..3000 {
            let rest = k / 1000;
            let turning = k % 1000 >= 700;
            let angle =
                f64::from(rest) + if turning { f64::from(k % 1000 - 700) / 300.0 } else { 0.0 };
            let noise = Vector3::from_fn(|_, _| {
                let unit: f64 = StandardNormal.sample(&mut generator);
                unit * 0.02
            });
            samples.push(Vector3::new(9.81 * angle.sin(), 0.0, 9.81 * angle.cos()) + noise);
        }
        let rests = find(&samples, &RestSettings::for_step(0.01));
        assert_eq!(rests.len(), 3, "{rests:?}");
        for (k, rest) in rests.iter().enumerate() {
            assert!(rest.start >= k * 1000 && rest.end <= k * 1000 + 700, "{rests:?}");
            assert!(rest.len() >= 600);
        }
    }

    /// Rests of 2.2 s that begin anywhere on the grid of the windows.
    #[test]
    fn short_rests_are_found_wherever_they_begin() {
        let mut generator = Xoshiro256PlusPlus::seed_from_u64(3);
        let mut samples = Vec::new();
        for k in 0..6000 {
            let (turn, part) = (k / 320, k % 320);
            let sd = if part < 220 { 0.02 } else { 2.0 };
            let level = if turn % 2 == 0 { 9.81 } else { -9.81 };
            let noise = Vector3::from_fn(|_, _| {
                let unit: f64 = StandardNormal.sample(&mut generator);
                unit * sd
            });
            samples.push(Vector3::new(0.0, 0.0, level) + noise);
        }
        let rests = find(&samples, &RestSettings::for_step(0.01));
        assert_eq!(rests.len(), 19, "{rests:?}");
        for (k, rest) in rests.iter().enumerate() {
            assert!(rest.start >= 320 * k && rest.end <= 320 * k + 222, "{rests:?}");
        }
    }

    #[test]
    fn an_axis_at_its_end_is_seen() {
        let clipped: Vec<Vector3<f64>> =
            (0..100).map(|k| Vector3::new(f64::from(k % 3), 8.0, f64::from(k % 5))).collect();
        assert_eq!(stuck_axis(&clipped), Some(1));
        assert_eq!(stuck_axis(&vec![Vector3::repeat(8.0); 100]), None);
        assert_eq!(stuck_axis(&[]), None);
    }

    #[test]
    fn nothing_in_nothing_or_in_numbers_that_are_none() {
        let settings = RestSettings::for_step(0.01);
        assert!(find(&[], &settings).is_empty());
        assert!(find(&vec![Vector3::repeat(f64::NAN); 1000], &settings).is_empty());
    }
}
