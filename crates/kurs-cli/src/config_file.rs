//! TOML configuration files: strict about keys, and an error names file, line and nearest key.

use std::ops::RangeInclusive;
use std::path::Path;

use serde::de::DeserializeOwned;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

use crate::failure::UsageError;
use crate::text_file;

/// Reads a configuration file into `T`, whose structs are marked `deny_unknown_fields`.
///
/// # Errors
///
/// [`UsageError`] naming file, line, key, and for an unknown key the nearest known one.
pub(crate) fn read<T: DeserializeOwned>(path: &Path) -> Result<T, UsageError> {
    parse(&text(path)?, &path.display().to_string())
}

/// The text of a configuration file.
pub(crate) fn text(path: &Path) -> Result<String, UsageError> {
    text_file::text(path).map_err(|error| UsageError(format!("{error:#}")))
}

/// As [`read`], with the values of `--set`: `table.key=value`, or `key=value` of the table `usual`.
///
/// # Errors
///
/// As [`read`]; what is wrong with a value of `--set` names it.
pub(crate) fn read_with<T: DeserializeOwned>(
    path: &Path,
    assignments: &[String],
    usual: &str,
) -> Result<T, UsageError> {
    parse_with(&text(path)?, &path.display().to_string(), assignments, usual)
}

/// As [`read_with`], for text that is already in memory.
pub(crate) fn parse_with<T: DeserializeOwned>(
    text: &str,
    name: &str,
    assignments: &[String],
    usual: &str,
) -> Result<T, UsageError> {
    // An error in the file itself names its line.
    let mut read: T = parse(text, name)?;
    let mut table: toml::Table = parse(text, name)?;
    for assignment in assignments {
        set(&mut table, assignment, usual)?;
        read = typed(&table).map_err(|what| UsageError(format!("--set {assignment}: {what}")))?;
    }
    Ok(read)
}

/// A table in its typed form; what is wrong with it otherwise.
pub(crate) fn typed<T: DeserializeOwned>(table: &toml::Table) -> Result<T, String> {
    let text = toml::to_string(table).map_err(|error| error.to_string())?;
    // The line number is left out: it counts in a text that the user has not written.
    parse(&text, "")
        .map_err(|UsageError(what)| what.splitn(3, ':').last().unwrap_or("").trim().to_owned())
}

/// Sets `table.key=value`, or `key=value` of the table `usual`, which is the whole file if it is
/// empty; returns `table.key`.
pub(crate) fn set(
    table: &mut toml::Table,
    assignment: &str,
    usual: &str,
) -> Result<String, UsageError> {
    let (key, value) = assignment
        .split_once('=')
        .ok_or_else(|| UsageError(format!("--set {assignment}: expected key=value")))?;
    let (section, key) = key.trim().split_once('.').unwrap_or((usual, key.trim()));
    if section.is_empty() {
        table.insert(key.to_owned(), parse_value(value.trim()));
        return Ok(key.to_owned());
    }
    let entry = table.entry(section).or_insert_with(|| toml::Table::new().into());
    let toml::Value::Table(inner) = entry else {
        return Err(UsageError(format!(
            "--set {assignment}: `{section}` is not a table with keys"
        )));
    };
    inner.insert(key.to_owned(), parse_value(value.trim()));
    Ok(format!("{section}.{key}"))
}

/// A value as TOML reads it; bare words and comma lists of them need no quotes on a command line.
fn parse_value(text: &str) -> toml::Value {
    if let Ok(mut parsed) = format!("v = {text}").parse::<toml::Table>()
        && let Some(value) = parsed.remove("v")
    {
        return value;
    }
    let inside = text.strip_prefix('[').and_then(|t| t.strip_suffix(']'));
    match inside {
        Some(list) => {
            let words = list.split(',').map(str::trim).filter(|word| !word.is_empty());
            toml::Value::Array(
                words.map(|word| toml::Value::String(word.trim_matches('"').to_owned())).collect(),
            )
        }
        None => toml::Value::String(text.to_owned()),
    }
}

/// As [`read`], for text that is already in memory; `name` stands for the file in errors.
pub(crate) fn parse<T: DeserializeOwned>(text: &str, name: &str) -> Result<T, UsageError> {
    let refused = |error: toml::de::Error| {
        let line = line_at(text, error.span().map_or(0, |span| span.start));
        let found = text.lines().nth(line - 1).unwrap_or_default();
        UsageError(format!("{name}:{line}: {}", explain(error.message(), found)))
    };
    let read = toml::from_str(text).map_err(refused)?;
    // This reader takes the beginning of an array that is too long; that of tables refuses it.
    let mut table: toml::Table = toml::from_str(text).map_err(refused)?;
    leave_dates_out(&mut table);
    match T::deserialize(table) {
        Err(error) if error.message().starts_with("invalid length") => {
            Err(UsageError(format!("{name}:{}", too_long(&error.to_string(), text))))
        }
        _ => Ok(read),
    }
}

/// The reader of tables takes no dates.
fn leave_dates_out(table: &mut toml::Table) {
    table.retain(|_, value| !value.is_datetime());
    for (_, value) in table.iter_mut() {
        match value {
            toml::Value::Table(inner) => leave_dates_out(inner),
            toml::Value::Array(items) => {
                items.iter_mut().filter_map(toml::Value::as_table_mut).for_each(leave_dates_out);
            }
            _ => {}
        }
    }
}

/// Refuses a number of a key that is out of range, or none.
pub(crate) fn check_range(
    key: &str,
    found: f64,
    range: RangeInclusive<f64>,
) -> Result<(), UsageError> {
    if range.contains(&found) {
        return Ok(());
    }
    let (least, most) = range.into_inner();
    Err(UsageError(format!("{key} is {found}, expected {least} to {most}")))
}

/// The line in which a byte stands, from 1.
pub(crate) fn line_at(text: &str, byte: usize) -> usize {
    let before = &text.as_bytes()[..byte.min(text.len())];
    before.iter().filter(|byte| **byte == b'\n').count() + 1
}

/// Line and words for an array with more values than its key takes; the message has the key in
/// ticks.
fn too_long(message: &str, text: &str) -> String {
    let key = message.split('`').nth(1).unwrap_or_default();
    let keys: Vec<&str> = key.split('.').collect();
    let table = DeTable::parse(text).ok();
    let longest = table.and_then(|table| {
        let start = table.span().start;
        longest_array(&Spanned::new(start..start, DeValue::Table(table.into_inner())), &keys)
    });
    let (values, byte) = longest.unwrap_or_default();
    format!(
        "{}: `{key}` has {values} values, which is too many: decimals are written with a point",
        line_at(text, byte)
    )
}

/// Number of values and place of the longest array under the keys.
fn longest_array(value: &Spanned<DeValue<'_>>, keys: &[&str]) -> Option<(usize, usize)> {
    match value.get_ref() {
        DeValue::Table(table) => {
            let (key, inner) = keys.split_first()?;
            let (_, value) = table.iter().find(|(name, _)| name.get_ref() == key)?;
            longest_array(value, inner)
        }
        DeValue::Array(items) => {
            let own = keys.is_empty().then(|| (items.len(), value.span().start));
            items.iter().filter_map(|item| longest_array(item, keys)).chain(own).max()
        }
        _ => None,
    }
}

/// Turns serde's message into one that names the key, and for an unknown key or word the nearest
/// known one.
fn explain(message: &str, line: &str) -> String {
    let mut quoted = message.split('`').skip(1).step_by(2);
    let mut nearest = |found: &str| {
        let likeness = |known: &&str| strsim::jaro(found, known);
        let known = quoted.by_ref().skip(1).filter(|known| likeness(known) > 0.7);
        let nearest = known.max_by(|a, b| likeness(a).total_cmp(&likeness(b)));
        nearest.map_or_else(String::new, |known| format!(", did you mean `{known}`?"))
    };
    let first = message.split('`').nth(1).unwrap_or_default();
    if message.starts_with("unknown field") {
        return format!("unknown key `{first}`{}", nearest(first));
    }
    if message.starts_with("missing field") {
        return message.to_owned();
    }
    let key = line.split_once('=').map_or("", |(key, _)| key.trim());
    let of_key = if key.is_empty() { String::new() } else { format!(" (key `{key}`)") };
    let hint = if message.starts_with("unknown variant") { nearest(first) } else { String::new() };
    format!("{message}{hint}{of_key}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Debug, serde::Deserialize)]
    #[serde(deny_unknown_fields)]
    struct Example {
        #[allow(dead_code)] // only its name matters here
        elevation_mask_deg: f64,
        #[allow(dead_code)]
        bands: Vec<String>,
    }

    #[test]
    fn unknown_key_names_line_and_nearest() {
        let text = "bands = []\nelevation_mask = 10.0\n";
        let error = parse::<Example>(text, "a.toml").unwrap_err().to_string();
        assert_eq!(
            error,
            "a.toml:2: unknown key `elevation_mask`, did you mean `elevation_mask_deg`?"
        );
    }

    #[test]
    fn wrong_type_names_line() {
        let text = "bands = []\nelevation_mask_deg = \"ten\"\n";
        let error = parse::<Example>(text, "a.toml").unwrap_err().to_string();
        assert!(error.starts_with("a.toml:2: invalid type: string \"ten\""), "{error}");
        assert!(error.ends_with("(key `elevation_mask_deg`)"), "{error}");
    }

    #[derive(Debug, serde::Deserialize)]
    struct Places {
        #[allow(dead_code)] // only how many values it takes matters here
        antenna: Vec<Place>,
        #[allow(dead_code)]
        a_day: Option<toml::value::Datetime>,
    }

    #[derive(Debug, serde::Deserialize)]
    struct Place {
        #[allow(dead_code)]
        position_m: [f64; 3],
    }

    #[test]
    fn decimal_commas_are_refused_with_their_line() {
        let text = "a_day = 2024-05-01\n[[antenna]]\nposition_m = [0, 0, 0]\n\
                    [[antenna]]\nposition_m = [-6,0, -2,0, 0,1]\n";
        let error = parse::<Places>(text, "a.toml").unwrap_err().to_string();
        let expected = "a.toml:5: `antenna.position_m` has 6 values, which is too many: decimals are \
                        written with a point";
        assert_eq!(error, expected);
        let table = toml::from_str(text).unwrap();
        assert!(typed::<Places>(&table).unwrap_err().starts_with("`antenna.position_m` has 6"));
        assert!(parse::<Places>("a_day = 2024-05-01\nantenna = []\n", "a.toml").is_ok());
    }
}
