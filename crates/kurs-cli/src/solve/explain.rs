//! `--explain`: every key in force and where its value comes from, as lines or as a configuration.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use kurs::engine::Constraint;

use super::config::{Config, ConstraintKey, Loaded};

/// How `--explain` prints.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum ExplainFormat {
    /// A line for every key.
    Text,
    /// A configuration, with the origins as comments.
    Toml,
}

/// What stands for the default of `bands`, which has no value.
const ALL_BANDS: &str = "every band that two antennas share";

/// A table of the configuration with its keys.
struct Section {
    /// `antenna.0`
    place: String,
    /// `[[antenna]]`
    header: String,
    keys: Vec<Key>,
}

struct Key {
    name: String,
    /// As TOML has it; words where there is no value.
    value: Result<String, &'static str>,
    origin: String,
}

impl Loaded {
    /// Every key in force and where its value comes from.
    pub(crate) fn explain(&self, format: ExplainFormat) -> String {
        let mut text = String::new();
        if format == ExplainFormat::Toml {
            let version = env!("CARGO_PKG_VERSION");
            let _ = writeln!(
                text,
                "# kurs {version}: every key in force and where its value comes from"
            );
        }
        for section in self.sections() {
            if format == ExplainFormat::Toml {
                let _ = writeln!(text, "\n{}", section.header);
            }
            for Key { name, value, origin } in section.keys {
                let _ = match (format, value) {
                    (ExplainFormat::Text, Ok(value)) => {
                        writeln!(text, "{}.{name} = {value}  [{origin}]", section.place)
                    }
                    (ExplainFormat::Text, Err(words)) => {
                        writeln!(text, "{}.{name}: {words}  [{origin}]", section.place)
                    }
                    (ExplainFormat::Toml, Ok(value)) => {
                        writeln!(text, "{name} = {value}  # {origin}")
                    }
                    (ExplainFormat::Toml, Err(words)) => {
                        writeln!(text, "# {name}: {words}  # {origin}")
                    }
                };
            }
        }
        text
    }

    fn sections(&self) -> Vec<Section> {
        // Through text: dates have a form of their own only there.
        let text = toml::to_string(&self.in_force()).unwrap_or_default();
        let tables: toml::Table = text.parse().unwrap_or_default();
        let mut sections = Vec::new();
        for (name, value) in tables {
            match value {
                toml::Value::Array(items) => {
                    let tables = items.into_iter().enumerate();
                    sections.extend(tables.filter_map(|(index, item)| match item {
                        toml::Value::Table(table) => Some(self.section(
                            format!("{name}.{index}"),
                            format!("[[{name}]]"),
                            table,
                        )),
                        _ => None,
                    }));
                }
                toml::Value::Table(table) => {
                    sections.push(self.section(name.clone(), format!("[{name}]"), table));
                }
                _ => {}
            }
        }
        sections.retain(|section| !section.keys.is_empty());
        sections
    }

    fn section(&self, place: String, header: String, table: toml::Table) -> Section {
        let origin = |key: &str| {
            let found = self.origins.get(&format!("{place}.{key}"));
            found.map_or_else(|| self.default_of(&place, key), str::to_owned)
        };
        let mut keys: Vec<Key> = table
            .into_iter()
            .filter(|(_, value)| !matches!(value, toml::Value::Array(items) if items.is_empty()))
            .map(|(name, value)| Key { origin: origin(&name), name, value: Ok(value.to_string()) })
            .collect();
        if place == "solve" && self.config.solve.bands.is_none() {
            let key = Key { name: "bands".into(), value: Err(ALL_BANDS), origin: origin("bands") };
            keys.push(key);
        }
        keys.sort_by(|a, b| (a.name != "name", &a.name).cmp(&(b.name != "name", &b.name)));
        Section { place, header, keys }
    }

    /// Why a key that was not set has its value.
    fn default_of(&self, place: &str, key: &str) -> String {
        let has_places = self.config.antenna.iter().all(|antenna| antenna.position_m.is_some());
        match (place, key, has_places) {
            ("solve", "constraint", true) => "default: every antenna has a position",
            ("solve", "constraint", false) => "default: the antennas have no positions",
            _ => "default",
        }
        .to_owned()
    }

    /// The configuration with whole paths and the constraint in force.
    fn in_force(&self) -> Config {
        let mut config = self.config.clone();
        let whole = |path: &mut PathBuf| {
            let joined = self.path(path);
            *path = std::path::absolute(&joined).unwrap_or(joined);
        };
        let observations = config.antenna.iter_mut().flat_map(|antenna| &mut antenna.obs);
        let of_station = config.station.iter_mut().flat_map(|station| &mut station.obs);
        let navigation = config.nav.files.iter_mut().chain(&mut config.antex.files);
        observations.chain(of_station).chain(navigation).for_each(whole);
        config.solve.constraint = Some(match self.config.constraint() {
            Constraint::None => ConstraintKey::None,
            Constraint::Length => ConstraintKey::Length,
            Constraint::Array => ConstraintKey::Array,
        });
        config
    }

    /// Every file that the configuration names.
    pub(crate) fn inputs(&self, file: Option<&Path>) -> Vec<PathBuf> {
        self.input_files().into_iter().chain(file.map(Path::to_owned)).collect()
    }
}
