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
    let text = fs::read_to_string(path)
        .map_err(|error| UsageError(format!("{}: cannot be read: {error}", path.display())))?;
    parse(&text, &path.display().to_string())
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
