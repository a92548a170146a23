//! The median, which outliers do not move.

/// The upper one of two middle values; `None` of none. Reorders the values.
pub(crate) fn median(values: &mut [f64]) -> Option<f64> {
    let middle = values.len() / 2;
    let in_range = middle < values.len();
    in_range.then(|| *values.select_nth_unstable_by(middle, f64::total_cmp).1)
}
