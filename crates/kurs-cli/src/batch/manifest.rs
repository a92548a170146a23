//! The manifest: a row for every session.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use crate::failure::UsageError;
use crate::pipe::{self, InputFile};
use crate::text_file::TextFile;

/// Columns besides `obs:ANTENNA`.
const COLUMNS: [&str; 5] = ["label", "config", "files", "nav", "set"];
/// Begins the name of a column with the files of one antenna.
const OBSERVATIONS: &str = "obs:";

/// All sessions, in the order of the file.
#[derive(Debug)]
pub(super) struct Manifest {
    pub(super) entries: Vec<Entry>,
}

/// One session. Paths are relative to the manifest's folder there, and whole here.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(super) struct Entry {
    pub(super) label: String,
    /// A configuration, or observation and navigation files told by their content.
    pub(super) files: Vec<PathBuf>,
    pub(super) nav: Vec<PathBuf>,
    /// Files in place of those that the configuration names for an antenna.
    pub(super) observations: Vec<(String, Vec<PathBuf>)>,
    pub(super) set: Vec<String>,
}

impl Manifest {
    /// Reads the file.
    ///
    /// # Errors
    ///
    /// [`UsageError`] with the line: unknown columns, a label that is empty or there twice, no
    /// files.
    pub(super) fn read(path: &Path) -> anyhow::Result<Self> {
        let file = InputFile::open(path)?;
        let path = file.path();
        let wrong = |error: csv::Error| UsageError(format!("{}: {error}", path.display()));
        let mut reader = csv::ReaderBuilder::new()
            .trim(csv::Trim::All)
            .comment(Some(b'#'))
            .from_reader(TextFile::open(path).map_err(|error| UsageError(format!("{error:#}")))?);
        let columns = reader.headers().map_err(wrong)?.clone();
        check_columns(path, &columns)?;
        let folder = pipe::folder_of(path);
        let (mut entries, mut labels) = (Vec::new(), BTreeSet::new());
        for record in reader.records() {
            let record = record.map_err(wrong)?;
            let line = record.position().map_or(0, csv::Position::line);
            let at = |what: String| UsageError(format!("{}:{line}: {what}", path.display()));
            let entry = entry(&columns, &record, &folder);
            if entry.label.is_empty() {
                return Err(at("`label` is empty".into()).into());
            }
            let given = |name: &str| {
                columns
                    .iter()
                    .zip(&record)
                    .any(|(column, field)| column == name && !field.is_empty())
            };
            if given("config") == given("files") {
                return Err(at("give one of `config` and `files`".into()).into());
            }
            if !labels.insert(entry.label.clone()) {
                return Err(at(format!("label `{}` is there twice", entry.label)).into());
            }
            entries.push(entry);
        }
        if entries.is_empty() {
            return Err(UsageError(format!("{}: no sessions", path.display())).into());
        }
        Ok(Self { entries })
    }
}

fn check_columns(path: &Path, columns: &csv::StringRecord) -> Result<(), UsageError> {
    let is_known = |name: &str| COLUMNS.contains(&name) || name.starts_with(OBSERVATIONS);
    let expected = "label, config, files, obs:ANTENNA, nav, set";
    if let Some(unknown) = columns.iter().find(|name| !is_known(name)) {
        let text = format!("{}:1: column `{unknown}`, expected {expected}", path.display());
        return Err(UsageError(text));
    }
    if !columns.iter().any(|name| name == "label") {
        return Err(UsageError(format!(
            "{}:1: no column `label`, expected {expected}",
            path.display()
        )));
    }
    Ok(())
}

fn entry(columns: &csv::StringRecord, record: &csv::StringRecord, folder: &Path) -> Entry {
    let mut entry = Entry::default();
    for (column, field) in columns.iter().zip(record) {
        let parts = || field.split(';').map(str::trim).filter(|part| !part.is_empty());
        let paths = || parts().map(|part| folder.join(part)).collect::<Vec<_>>();
        match column {
            "label" => field.clone_into(&mut entry.label),
            "config" | "files" => entry.files.extend(paths()),
            "nav" => entry.nav = paths(),
            "set" => entry.set = parts().map(str::to_owned).collect(),
            _ => {
                let antenna = column.trim_start_matches(OBSERVATIONS).trim().to_owned();
                if !field.is_empty() {
                    entry.observations.push((antenna, paths()));
                }
            }
        }
    }
    entry
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Manifest, String> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("m.csv");
        std::fs::write(&path, text).unwrap();
        let place = folder.path().display().to_string() + "/";
        Manifest::read(&path).map_err(|error| error.to_string().replace(&place, ""))
    }

    #[test]
    fn lists_are_divided_by_semicolons_and_paths_start_from_the_manifest() {
        let text = "label,config,obs:bow,nav,set\nday 1,boat.toml,a.rnx; b.rnx,,\"bands=[G1,E1];array_sd_m=0.01\"\n";
        let manifest = read(text).unwrap();
        let entry = &manifest.entries[0];
        assert_eq!(entry.label, "day 1");
        assert!(entry.files[0].is_absolute() && entry.files[0].ends_with("boat.toml"));
        assert_eq!(entry.observations[0].0, "bow");
        assert!(entry.observations[0].1[1].ends_with("b.rnx"));
        assert_eq!(entry.set, ["bands=[G1,E1]", "array_sd_m=0.01"]);
    }

    #[test]
    fn what_is_wrong_is_told_with_its_line() {
        let error = |text: &str| read(text).unwrap_err();
        assert_eq!(
            error("label,config\na,c.toml\na,c.toml\n"),
            "m.csv:3: label `a` is there twice"
        );
        let one_of = "m.csv:2: give one of `config` and `files`";
        assert_eq!(error("label,config\na,\n"), one_of);
        assert_eq!(error("label,config,files\na,c.toml,a.rnx;b.rnx\n"), one_of);
        assert_eq!(error("label,config\n"), "m.csv: no sessions");
        assert!(
            error("label,konfig\na,b\n").starts_with("m.csv:1: column `konfig`, expected label")
        );
        assert!(error("config\nb\n").starts_with("m.csv:1: no column `label`"));
    }
}
