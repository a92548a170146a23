//! Lock time indicators: minimum lock times in steps that grow with them.

use crate::logs::lock_time::LockTime;

/// The last indicator of DF407.
const EXTENDED_MAX: u64 = 704;

/// The last indicator of DF013.
const SEVEN_BITS_MAX: u64 = 127;

/// DF402, four bits: 0, 24, 48, 96, … ms.
pub(super) fn of_four_bits(indicator: u64) -> LockTime {
    let least_ms = |i: u64| if i == 0 { 0 } else { 12 << i };
    let most_ms = (indicator < 15).then(|| least_ms(indicator + 1));
    lock_time(least_ms(indicator), most_ms)
}

/// DF013, seven bits: steps of 1, 2, 4, … s (table 3.4-2).
pub(super) fn of_seven_bits(indicator: u64) -> LockTime {
    let most_ms = (indicator < SEVEN_BITS_MAX).then(|| 1000 * seconds(indicator + 1));
    lock_time(1000 * seconds(indicator), most_ms)
}

/// Seconds of an indicator; every 24 indicators they grow twice as fast: i, 2 i − 24, 4 i − 120, …
fn seconds(indicator: u64) -> u64 {
    match indicator {
        SEVEN_BITS_MAX.. => 937,
        i => {
            let k = i / 24;
            // The lines meet where one part ends: 2ᵏ i − 24 (k 2ᵏ − 2ᵏ + 1).
            (i << k) - 24 * ((k << k) + 1 - (1 << k))
        }
    }
}

/// DF407, ten bits: 64 steps of 1 ms, then 32 each of 2, 4, 8, … ms.
pub(super) fn of_ten_bits(indicator: u64) -> LockTime {
    let most_ms = (indicator < EXTENDED_MAX).then(|| extended_ms(indicator + 1));
    lock_time(extended_ms(indicator.min(EXTENDED_MAX)), most_ms)
}

/// The indicator of DF407 for a lock time.
pub(super) fn to_ten_bits(lock_s: f64) -> u64 {
    let lock_ms = lock_s * 1e3 + 1e-6;
    let (mut low, mut high) = (0, EXTENDED_MAX + 1);
    while high - low > 1 {
        let middle = u64::midpoint(low, high);
        if extended_ms(middle) as f64 <= lock_ms { low = middle } else { high = middle }
    }
    low
}

/// Table 3.5-75: 2^k (i − 32 k) with k = ⌊i / 32⌋ − 1, from i = 64 on.
fn extended_ms(indicator: u64) -> u64 {
    let k = (indicator / 32).saturating_sub(1);
    (indicator - 32 * k) << k
}

fn lock_time(least_ms: u64, most_ms: Option<u64>) -> LockTime {
    LockTime {
        least_s: least_ms as f64 * 1e-3,
        most_s: most_ms.map_or(f64::INFINITY, |ms| ms as f64 * 1e-3),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_of_the_standard() {
        for (indicator, least_ms) in [
            (0, 0),
            (63, 63),
            (64, 64),
            (65, 66),
            (95, 126),
            (96, 128),
            (127, 252),
            (128, 256),
            (703, 66_060_288),
            (704, 67_108_864),
        ] {
            assert_eq!(extended_ms(indicator), least_ms, "{indicator}");
            assert_eq!(to_ten_bits(least_ms as f64 * 1e-3), indicator);
        }
        for (indicator, least_s) in [
            (0, 0),
            (23, 23),
            (24, 24),
            (47, 70),
            (48, 72),
            (71, 164),
            (95, 352),
            (126, 936),
            (127, 937),
        ] {
            assert_eq!(seconds(indicator), least_s, "{indicator}");
        }
        assert_eq!(of_seven_bits(127).most_s, f64::INFINITY);
        assert_eq!(of_four_bits(0).most_s, 0.024);
        assert_eq!(of_four_bits(4), LockTime { least_s: 0.192, most_s: 0.384 });
        assert_eq!(of_four_bits(15), LockTime { least_s: 393.216, most_s: f64::INFINITY });
    }
}
