//! Shares and means with 95 % intervals.

/// Half width of the 95 % interval of a normal estimate, in standard deviations.
const NORMAL_95: f64 = 1.96;

/// `hits` of `total` in per cent with its interval (Wilson, half width).
pub(crate) fn percent(hits: usize, total: usize) -> String {
    let (n, p) = (total as f64, hits as f64 / total as f64);
    let z2 = NORMAL_95 * NORMAL_95;
    let half = NORMAL_95 / (1.0 + z2 / n) * (p * (1.0 - p) / n + z2 / (4.0 * n * n)).sqrt();
    format!("{:.1} ± {:.1}", 100.0 * p, 100.0 * half)
}

/// Mean of `values` with its interval.
pub(crate) fn mean(values: &[f64]) -> String {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0);
    format!("{mean:.3} ± {:.3}", NORMAL_95 * (variance / n).sqrt())
}
