//! How much of a serial line is in use.

/// Bits of a byte on a serial line: start, eight, stop.
const BITS_A_BYTE: f64 = 10.0;
/// Length of a window.
const LOAD_WINDOW_S: f64 = 10.0;

/// Bytes of a line, counted in windows of time.
#[derive(Debug, Default)]
pub(super) struct LineLoad {
    /// Start of the window, s after that of the stream.
    since_s: f64,
    /// Bytes in the window so far.
    bytes: u64,
    /// Share of the line in use in the window before.
    pub(super) share: f64,
}

impl LineLoad {
    /// Counts bytes; whenever a window is over, the share of the line that was in use in it.
    pub(super) fn add(&mut self, now_s: f64, bytes: u64, baud: u64) -> Option<f64> {
        self.bytes += bytes;
        let length_s = now_s - self.since_s;
        if baud == 0 || length_s < LOAD_WINDOW_S {
            return None;
        }
        let share = self.bytes as f64 * BITS_A_BYTE / (baud as f64 * length_s);
        *self = Self { since_s: now_s, bytes: 0, share };
        Some(share)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 2400 bytes a second are 24 000 bits of 38 400.
    #[test]
    fn the_load_of_a_line_is_that_of_the_last_seconds() {
        let mut load = LineLoad::default();
        assert_eq!(load.add(5.0, 12_000, 38_400), None);
        assert_eq!(load.add(10.0, 12_000, 38_400), Some(0.625));
        assert_eq!(load.add(15.0, 0, 38_400), None);
        assert_eq!(load.add(20.0, 0, 38_400), Some(0.0));
        assert_eq!(load.add(40.0, 1000, 0), None, "no serial line");
    }
}
