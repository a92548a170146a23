//! How much of the noise changes slowly, as multipath does.

use crate::difference::Link;
use crate::float_solution::recursive::CORRELATION_S;
use crate::signal::{Band, Satellite};
use crate::time::GpsTime;

use super::noise_levels::{MAX_SQUARE, kept};

/// "All noise changes slowly" counts as much as so many squares.
const SLOW_PRIOR: f64 = 100.0;

/// Share `s` of the noise variance that changes slowly, in the time `τ` of a Gauss–Markov process; the rest is
/// white. It is the correlation of the residuals `z` of a link in successive epochs,
///
/// `E z_t z_{t−1} / E z² = s e^{−Δt/τ}`.
///
/// Squares of residuals `kΔt` apart then correlate by `s² e^{−2kΔt/τ}`, so that one epoch of a long series counts
/// as
///
/// `1 / (1 + 2 Σ_k s² e^{−2kΔt/τ}) ≈ 1 / (1 + s² τ/Δt)`
///
/// independent ones.
#[derive(Debug, Clone, Default)]
pub(super) struct Slowness {
    /// Of the last epoch, sorted.
    last: Vec<(LinkKey, f64)>,
    last_time: Option<GpsTime>,
    products: f64,
    squares: f64,
}

/// In the order in which links stand, but for the codes of a band.
type LinkKey = (Band, Satellite, usize, u8);

impl Slowness {
    /// `s`
    pub(super) fn share(&self) -> f64 {
        ((self.products + SLOW_PRIOR) / (self.squares + SLOW_PRIOR)).clamp(0.0, 1.0)
    }

    /// How much of an independent epoch one is that comes so long after the one before.
    pub(super) fn weight(&self, elapsed_s: f64) -> f64 {
        let share = self.share();
        1.0 / (1.0 + share * share * CORRELATION_S / elapsed_s.max(1e-3))
    }

    /// Compares the residuals of an epoch with those of the one before.
    pub(super) fn learn(&mut self, links: &[Link], residuals: &[(usize, f64)], time: GpsTime) {
        let key = |link: usize| {
            let Link { antenna, satellite, signal, .. } = links[link];
            (signal.band, satellite, antenna, signal.attribute)
        };
        let limit = MAX_SQUARE.sqrt();
        let mut now: Vec<(LinkKey, f64)> =
            residuals.iter().map(|(link, z)| (key(*link), z.clamp(-limit, limit))).collect();
        now.sort_by_key(|(key, _)| *key);
        let elapsed_s = self.last_time.map_or(f64::INFINITY, |last| time - last);
        let (mut products, mut squares) = (0.0, 0.0);
        if elapsed_s > 0.0 && elapsed_s < CORRELATION_S {
            let mut last = self.last.iter().peekable();
            for (key, z) in &now {
                while last.next_if(|(old, _)| old < key).is_some() {}
                let Some((_, before)) = last.next_if(|(old, _)| old == key) else { continue };
                products += z * before;
                squares += 0.5 * (z * z + before * before);
            }
            products *= (elapsed_s / CORRELATION_S).exp();
        }
        let keep = kept(squares);
        self.products = self.products * keep + products;
        self.squares = self.squares * keep + squares;
        (self.last, self.last_time) = (now, Some(time));
    }
}
