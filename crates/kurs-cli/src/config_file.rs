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
        UsageError(format!("{name}:{line}: {}", explain(error.message())))
    })
}

/// Turns serde's message about an unknown field into one that names the nearest known key.
fn explain(message: &str) -> String {
    let mut quoted = message.split('`').skip(1).step_by(2);
    match (message.starts_with("unknown field"), quoted.next()) {
        (true, Some(found)) => {
            let likeness = |key: &&str| strsim::jaro(found, key);
            let nearest = quoted
                .filter(|key| likeness(key) > 0.7)
                .max_by(|a, b| likeness(a).total_cmp(&likeness(b)));
            let hint = nearest.map_or_else(String::new, |key| format!(", did you mean `{key}`?"));
            format!("unknown key `{found}`{hint}")
        }
        _ => message.to_owned(),
    }
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
    }
}
