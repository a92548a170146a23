//! TOML configuration files: strict about keys, and an error names file, line and nearest key.

use std::fs;
use std::path::Path;

use serde::de::DeserializeOwned;

use crate::failure::UsageError;

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
    fs::read_to_string(path)
        .map_err(|error| UsageError(format!("{}: cannot be read: {error}", path.display())))
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
    // What is wrong with the file itself is told with its line.
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
    // The line is one of a text that nobody has written.
    parse(&text, "")
        .map_err(|UsageError(what)| what.splitn(3, ':').last().unwrap_or("").trim().to_owned())
}

/// Sets `table.key=value`, or `key=value` of the table `usual`, which is the whole file if it is empty; returns
/// `table.key`.
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
    toml::from_str(text).map_err(|error| {
        let start = error.span().map_or(0, |span| span.start.min(text.len()));
        let line = text.as_bytes()[..start].iter().filter(|byte| **byte == b'\n').count() + 1;
        let found = text.lines().nth(line - 1).unwrap_or_default();
        UsageError(format!("{name}:{line}: {}", explain(error.message(), found)))
    })
}

/// Turns serde's message into one that names the key, and for an unknown key or word the nearest known
/// one.
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
}
