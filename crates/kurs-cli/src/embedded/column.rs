//! A column of a table that a command wrote: what its name says of its fields.

use std::collections::BTreeMap;

/// Columns that hold whole numbers in every row.
const WHOLE: [&str; 4] = ["gps_week", "antennas", "satellites", "ambiguities"];
/// Columns that hold words, the empty one for "none".
const WORDS: [&str; 6] = ["status", "reason", "base", "rover", "name", "session"];
/// Columns that hold instants.
const TIMES: [&str; 2] = ["time_gpst", "time_utc"];

/// A column in the making, typed by its name.
#[derive(Debug, Clone, PartialEq)]
pub enum Column {
    /// Numbers, NaN for "not available".
    Reals(Vec<f64>),
    /// Whole numbers.
    Integers(Vec<i64>),
    /// Nanoseconds since 1970 on the scale of the column.
    Times(Vec<i64>),
    /// Words.
    Words {
        /// Places among `words`, −1 for none.
        codes: Vec<i32>,
        /// The words in the order of their first use.
        words: Vec<String>,
        /// Their places.
        places: BTreeMap<String, i32>,
    },
}

impl Column {
    /// An empty column of this name.
    #[must_use]
    pub fn named(name: &str) -> Self {
        match name {
            _ if WHOLE.contains(&name) => Self::Integers(Vec::new()),
            _ if TIMES.contains(&name) => Self::Times(Vec::new()),
            _ if WORDS.contains(&name) => Self::words(),
            _ => Self::Reals(Vec::new()),
        }
    }

    /// An empty column of words.
    #[must_use]
    pub const fn words() -> Self {
        Self::Words { codes: Vec::new(), words: Vec::new(), places: BTreeMap::new() }
    }

    /// Takes a field in; `None` if it does not belong into such a column.
    pub fn push(&mut self, field: &str) -> Option<()> {
        match self {
            Self::Reals(values) if field.is_empty() => values.push(f64::NAN),
            Self::Reals(values) => values.push(field.parse().ok()?),
            Self::Integers(values) => values.push(field.parse().ok()?),
            Self::Times(values) => values.push(nanoseconds(field)?),
            Self::Words { codes, .. } if field.is_empty() => codes.push(-1),
            Self::Words { codes, words, places } => {
                let code = match places.get(field) {
                    Some(code) => *code,
                    None => {
                        let code = i32::try_from(words.len()).ok()?;
                        places.insert(field.to_owned(), code);
                        words.push(field.to_owned());
                        code
                    }
                };
                codes.push(code);
            }
        }
        Some(())
    }
}

/// `2024-06-24T08:20:00.5`, with or without a Z, as nanoseconds since 1970.
fn nanoseconds(text: &str) -> Option<i64> {
    let (date, time) = text.trim_end_matches('Z').split_once('T')?;
    let mut parts = date.split('-').map(str::parse::<i64>);
    let mut next = || parts.next()?.ok();
    let (year, month, day) = (next()?, next()?, next()?);
    let (clock, fraction) = time.split_once('.').unwrap_or((time, ""));
    let mut parts = clock.split(':').map(str::parse::<i64>);
    let mut next = || parts.next()?.ok();
    let seconds = next()? * 3600 + next()? * 60 + next()?;
    let fraction: i64 = format!("{fraction:0<9}").get(..9)?.parse().ok()?;
    // Days from March on, of which all but the last month of a year have a fixed place.
    let (year, month) = if month > 2 { (year, month - 3) } else { (year - 1, month + 9) };
    let days =
        365 * year + year / 4 - year / 100 + year / 400 + (153 * month + 2) / 5 + day - 719_469;
    Some((days * 86_400 + seconds) * 1_000_000_000 + fraction)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn instants_are_nanoseconds_since_1970() {
        assert_eq!(nanoseconds("1970-01-01T00:00:00.000"), Some(0));
        assert_eq!(nanoseconds("2000-03-01T00:00:00.0000001Z"), Some(951_868_800_000_000_100));
        assert_eq!(nanoseconds("2024-02-29T12:00:00"), Some(1_709_208_000_000_000_000));
        assert_eq!(nanoseconds("2024-02-29"), None);
    }

    #[test]
    fn fields_are_what_the_name_of_the_column_says() {
        let mut status = Column::named("status");
        for field in ["fixed", "", "float", "fixed"] {
            assert_eq!(status.push(field), Some(()));
        }
        let Column::Words { codes, words, .. } = status else { panic!("words") };
        assert_eq!((codes, words), (vec![0, -1, 1, 0], vec!["fixed".to_owned(), "float".into()]));
        assert_eq!(Column::named("gps_week").push("2.5"), None);
        let mut reals = Column::named("heading_deg");
        assert_eq!((reals.push("-1.25"), reals.push("")), (Some(()), Some(())));
        assert!(matches!(reals, Column::Reals(v) if v[0] == -1.25 && v[1].is_nan()));
    }
}
