//! From when to when epochs are, how often, and where they are missing, in words.

use crate::session_span::SessionSpan;

/// A name and a value each.
pub(crate) fn facts(span: &SessionSpan) -> Vec<Vec<String>> {
    let Some((first, last)) = span.first().zip(span.last()) else { return Vec::new() };
    let interval =
        span.interval_s().map_or_else(String::new, |s| format!(", every {} s", plain(s)));
    let whole = format!("{first} to {last} GPS time ({}){interval}", duration(last - first));
    let mut facts = vec![vec!["span".to_owned(), whole]];
    facts.extend(gaps(span).map(|gaps| vec!["gaps without any epoch".to_owned(), gaps]));
    facts
}

/// How many gaps there are and how long; `None` without any.
pub(crate) fn gaps(span: &SessionSpan) -> Option<String> {
    let (count, longest_s) = span.gaps()?;
    Some(format!("{count}, the longest of {}", duration(longest_s)))
}

/// A number of seconds without needless digits.
pub(crate) fn plain(seconds: f64) -> String {
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
    use kurs::time::GpsTime;

    #[test]
    fn span_and_gaps_are_told() {
        let first = GpsTime::from_week_tow(2320, 113_400.0).unwrap();
        let mut span = SessionSpan::default();
        [0.0, 0.2, 0.4, 2.0, 2.2, 3725.4].into_iter().for_each(|s| span.add(first + s));
        let facts = facts(&span);
        assert_eq!(
            facts[0][1],
            "2024-06-24T07:30:00.000 to 2024-06-24T08:32:05.400 GPS time (1 h 2 min), every 0.2 s"
        );
        assert_eq!(facts[1][1], "2, the longest of 1 h 2 min");
        assert_eq!([59.8, 725.0].map(duration), ["59.8 s", "12 min 5 s"]);
    }
}
