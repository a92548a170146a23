//! From when to when epochs are, how often, and where they are missing.

use kurs::time::GpsTime;

/// Where the next epoch is so many intervals away, some are missing.
const GAP: f64 = 1.5;

/// What the gaps are called.
const GAPS: &str = "gaps without any epoch";

/// See the module; fed in time order.
#[derive(Debug, Default)]
pub(crate) struct Span {
    first: Option<GpsTime>,
    last: Option<GpsTime>,
    /// Shortest step so far, s.
    interval_s: Option<f64>,
    epochs: u64,
    gaps: u64,
    longest_gap_s: f64,
}

impl Span {
    /// The next epoch; whether some are missing before it.
    pub(crate) fn take(&mut self, time: GpsTime) -> bool {
        self.epochs += 1;
        self.first.get_or_insert(time);
        let Some(last) = self.last.replace(time) else { return false };
        let step_s = time - last;
        let Some(interval_s) = self.interval_s else {
            self.interval_s = Some(step_s);
            return false;
        };
        self.interval_s = Some(interval_s.min(step_s));
        let is_gap = step_s > GAP * interval_s;
        if is_gap {
            self.gaps += 1;
            self.longest_gap_s = self.longest_gap_s.max(step_s);
        }
        is_gap
    }

    /// How many gaps there are and how long; `None` without any.
    pub(crate) fn gaps_text(&self) -> Option<String> {
        let text =
            || format!("{GAPS}: {}, the longest of {}", self.gaps, duration(self.longest_gap_s));
        (self.gaps > 0).then(text)
    }

    /// In words: a name and a value each.
    pub(crate) fn facts(&self) -> Vec<Vec<String>> {
        let (Some(first), Some(last)) = (self.first, self.last) else { return Vec::new() };
        let interval =
            self.interval_s.map_or_else(String::new, |s| format!(", every {} s", plain(s)));
        let span = format!("{first} to {last} GPS time ({}){interval}", duration(last - first));
        let mut facts = vec![vec!["span".to_owned(), span]];
        let gaps = self.gaps_text();
        facts.extend(gaps.and_then(|text| {
            text.split_once(": ").map(|(name, value)| vec![name.to_owned(), value.to_owned()])
        }));
        facts
    }
}

/// A number of seconds without needless digits.
fn plain(seconds: f64) -> String {
    let text = format!("{seconds:.3}");
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

/// `3 h 25 min`, `12 min 5 s`, `59.8 s`
fn duration(seconds: f64) -> String {
    let minutes = (seconds / 60.0).floor();
    match seconds {
        s if s < 60.0 => format!("{} s", plain(s)),
        s if s < 3600.0 => format!("{minutes} min {} s", plain((s - 60.0 * minutes).round())),
        s => {
            let hours = (s / 3600.0).floor();
            format!("{hours} h {} min", plain((minutes - 60.0 * hours).round()))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gaps_are_counted() {
        let first = GpsTime::from_week_tow(2320, 113_400.0).unwrap();
        let mut span = Span::default();
        let gaps: Vec<bool> =
            [0.0, 0.2, 0.4, 2.0, 2.2, 3725.4].into_iter().map(|s| span.take(first + s)).collect();
        assert_eq!(gaps, [false, false, false, true, false, true]);
        let facts = span.facts();
        assert_eq!(
            facts[0][1],
            "2024-06-24T07:30:00.000 to 2024-06-24T08:32:05.400 GPS time (1 h 2 min), every 0.2 s"
        );
        assert_eq!(facts[1][1], "2, the longest of 1 h 2 min");
        assert_eq!([59.8, 725.0].map(duration), ["59.8 s", "12 min 5 s"]);
    }
}
