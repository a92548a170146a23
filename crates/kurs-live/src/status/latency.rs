//! How long rows take, counted by class.

use std::fmt::Write as _;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::time::Duration;

/// Upper bounds of the latency classes, ms.
const BOUNDS_MS: [f64; 16] = [
    0.5, 1.0, 2.0, 3.0, 5.0, 7.5, 10.0, 15.0, 20.0, 30.0, 50.0, 100.0, 200.0, 300.0, 1000.0,
    10_000.0,
];

/// Counts of latencies by class.
#[derive(Debug, Default)]
pub(crate) struct Histogram {
    classes: [AtomicU64; BOUNDS_MS.len()],
    count: AtomicU64,
    sum_us: AtomicU64,
}

impl Histogram {
    pub(super) fn add(&self, latency: Duration) {
        let ms = latency.as_secs_f64() * 1e3;
        if let Some(class) = BOUNDS_MS.iter().position(|bound| ms <= *bound) {
            self.classes[class].fetch_add(1, Relaxed);
        }
        self.count.fetch_add(1, Relaxed);
        self.sum_us.fetch_add(u64::try_from(latency.as_micros()).unwrap_or(u64::MAX), Relaxed);
    }

    /// Bounds of the classes below which these shares are; `None` without any, or beyond the last
    /// class.
    pub(crate) fn quantiles_ms<const N: usize>(&self, shares: [f64; N]) -> [Option<f64>; N] {
        let count = self.count.load(Relaxed) as f64;
        shares.map(|share| {
            let mut below = 0;
            let classes = BOUNDS_MS.iter().zip(&self.classes).filter(|_| count > 0.0);
            classes.into_iter().find_map(|(bound, class)| {
                below += class.load(Relaxed);
                (below as f64 >= share * count).then_some(*bound)
            })
        })
    }

    /// Writes the histogram as Prometheus reads it.
    pub(super) fn write(&self, text: &mut String, name: &str, help: &str) {
        let _ = writeln!(text, "# HELP {name} {help}\n# TYPE {name} histogram");
        let mut below = 0;
        for (bound, class) in BOUNDS_MS.iter().zip(&self.classes) {
            below += class.load(Relaxed);
            let _ = writeln!(text, "{name}_bucket{{le=\"{}\"}} {below}", bound * 1e-3);
        }
        let count = self.count.load(Relaxed);
        let _ = writeln!(text, "{name}_bucket{{le=\"+Inf\"}} {count}");
        let _ = writeln!(text, "{name}_sum {}", self.sum_us.load(Relaxed) as f64 * 1e-6);
        let _ = writeln!(text, "{name}_count {count}");
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn latencies_are_counted_by_class() {
        let histogram = Histogram::default();
        for ms in [0.4, 0.5, 7.0, 20_000.0] {
            histogram.add(Duration::from_secs_f64(ms * 1e-3));
        }
        let mut text = String::new();
        histogram.write(&mut text, "x", "Help.");
        for line in [
            "# TYPE x histogram",
            "x_bucket{le=\"0.0005\"} 2",
            "x_bucket{le=\"0.005\"} 2",
            "x_bucket{le=\"0.0075\"} 3",
            "x_bucket{le=\"10\"} 3",
            "x_bucket{le=\"+Inf\"} 4",
            "x_sum 20.0079",
            "x_count 4",
        ] {
            assert!(text.lines().any(|found| found == line), "{line}: {text}");
        }
    }
}
