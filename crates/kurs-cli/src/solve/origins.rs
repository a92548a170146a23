//! Where the value of every key of a configuration comes from.

use std::collections::BTreeMap;

use toml::de::{DeTable, DeValue};

use crate::config_file;

/// Origins by the key's place: `solve.bands`, `antenna.0.obs`.
#[derive(Debug, Clone, Default)]
pub(crate) struct Origins(BTreeMap<String, String>);

impl Origins {
    /// Notes every key of a file with its line.
    pub(super) fn of_file(&mut self, text: &str, name: &str) {
        // Whoever reads the file tells what is wrong with it.
        let Ok(table) = DeTable::parse(text) else { return };
        self.of_table(table.get_ref(), "", text, name);
    }

    fn of_table(&mut self, table: &DeTable<'_>, prefix: &str, text: &str, name: &str) {
        for (key, value) in table {
            let place = format!("{prefix}{}", key.get_ref());
            match value.get_ref() {
                DeValue::Table(inner) => self.of_table(inner, &format!("{place}."), text, name),
                DeValue::Array(items) if items.iter().any(|item| item.get_ref().is_table()) => {
                    for (index, item) in items.iter().enumerate() {
                        if let DeValue::Table(inner) = item.get_ref() {
                            self.of_table(inner, &format!("{place}.{index}."), text, name);
                        }
                    }
                }
                _ => {
                    let line = config_file::line_at(text, key.span().start);
                    self.0.insert(place, format!("{name}:{line}"));
                }
            }
        }
    }

    /// Notes all keys of a table.
    pub(super) fn of_keys(&mut self, place: &str, table: &toml::Table, origin: &str) {
        for key in table.keys() {
            self.set(&format!("{place}.{key}"), origin);
        }
    }

    /// Notes one key.
    pub(super) fn set(&mut self, place: &str, origin: &str) {
        self.0.insert(place.to_owned(), origin.to_owned());
    }

    /// Forgets all keys of a table.
    pub(super) fn forget(&mut self, table: &str) {
        let inside = format!("{table}.");
        self.0.retain(|place, _| !place.starts_with(&inside));
    }

    /// The origin of a key; `None` for a default.
    pub(super) fn get(&self, place: &str) -> Option<&str> {
        self.0.get(place).map(String::as_str)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_key_has_its_line() {
        let text =
            "[[antenna]]\nname = \"a\"\n\n[[antenna]]\nobs = [\"b\"]\n[solve]\nbands = [\n]\n";
        let mut origins = Origins::default();
        origins.of_file(text, "boat.toml");
        assert_eq!(origins.get("antenna.0.name"), Some("boat.toml:2"));
        assert_eq!(origins.get("antenna.1.obs"), Some("boat.toml:5"));
        assert_eq!(origins.get("solve.bands"), Some("boat.toml:7"));
        assert_eq!(origins.get("solve.array_sd_m"), None);
        origins.forget("antenna");
        assert_eq!(origins.get("antenna.0.name"), None);
    }
}
