//! What became of each session, and of all together: `manifest-status.csv`.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::path::{Path, PathBuf};

use serde::Deserialize;

use super::manifest::Manifest;
use crate::failure::ExitCode;
use crate::table::{Table, TableFormat};

/// Begins the name of a session's folder.
const FOLDER: &str = "session=";
/// Why a session has no result, in its folder.
pub(crate) const FAILURE: &str = "failure.json";

const COLUMNS: &[&str] =
    &["label", "status", "reason", "configuration_hash", "epochs", "fixed", "wall_s"];

/// What became of a session.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Outcome {
    /// There is a result with fixed epochs.
    Done,
    /// There is a result, but no epoch of it is fixed.
    NothingFixed,
    /// There is no result; the reason says why.
    Failed,
    /// It was not its turn yet.
    Missing,
}

impl Outcome {
    const fn word(self) -> &'static str {
        match self {
            Self::Done => "done",
            Self::NothingFixed => "nothing_fixed",
            Self::Failed => "failed",
            Self::Missing => "missing",
        }
    }
}

/// A row of `manifest-status.csv`.
#[derive(Debug)]
pub(super) struct SessionStatus {
    label: String,
    pub(super) outcome: Outcome,
    reason: String,
    summary: Option<Summary>,
}

/// The fields of a summary.json that are read.
#[derive(Debug, Deserialize)]
pub(super) struct Summary {
    pub(super) configuration_hash: String,
    pub(super) interrupted: bool,
    epochs: u32,
    fixed: u32,
    wall_s: f64,
    reasons: BTreeMap<String, u64>,
}

impl Summary {
    /// Reads the summary in a session's folder; `None` without a whole one.
    pub(super) fn read(folder: &Path) -> Option<Self> {
        let text = std::fs::read(folder.join("summary.json")).ok()?;
        serde_json::from_slice(&text).ok()
    }
}

/// The fields of a failure.json that are read.
#[derive(Debug, Deserialize)]
struct Failure {
    reason: String,
}

/// The folder of a session in the data set; a label may have any letters.
pub(super) fn folder(out: &Path, label: &str) -> PathBuf {
    let mut name = String::from(FOLDER);
    for byte in label.bytes() {
        match byte {
            b'A'..=b'Z' | b'a'..=b'z' | b'0'..=b'9' | b'-' | b'_' | b'.' | b'~' => {
                name.push(char::from(byte));
            }
            _ => name.push_str(&format!("%{byte:02X}")),
        }
    }
    out.join(name)
}

impl SessionStatus {
    /// The status of a session by the result in its folder, if there is a whole one.
    pub(super) fn of_result(label: &str, folder: &Path) -> Option<Self> {
        let summary = Summary::read(folder).filter(|summary| !summary.interrupted)?;
        let most = summary.reasons.iter().max_by_key(|(_, count)| **count);
        let (outcome, reason) = match summary.fixed {
            0 => (Outcome::NothingFixed, most.map_or(String::new(), |(word, _)| word.clone())),
            _ => (Outcome::Done, String::new()),
        };
        Some(Self { label: label.to_owned(), outcome, reason, summary: Some(summary) })
    }

    /// The status of a session without a result.
    pub(super) fn failed(label: &str, reason: String) -> Self {
        Self { label: label.to_owned(), outcome: Outcome::Failed, reason, summary: None }
    }

    /// The status of a session by what is in its folder.
    fn of_folder(label: &str, folder: &Path) -> Self {
        // Of a later attempt than a result that is there.
        let failure = std::fs::read(folder.join(FAILURE)).ok();
        if let Some(failure) =
            failure.and_then(|text| serde_json::from_slice::<Failure>(&text).ok())
        {
            return Self::failed(label, failure.reason);
        }
        let missing = || Self { outcome: Outcome::Missing, ..Self::failed(label, String::new()) };
        Self::of_result(label, folder).unwrap_or_else(missing)
    }
}

/// Sums up all sessions by what is in their folders, and writes it.
pub(super) fn merge(manifest: &Manifest, out: &Path) -> anyhow::Result<Vec<SessionStatus>> {
    let of = |label: &str| SessionStatus::of_folder(label, &folder(out, label));
    let statuses: Vec<_> = manifest.entries.iter().map(|entry| of(&entry.label)).collect();
    write(out, &statuses)?;
    Ok(statuses)
}

/// How many folders of sessions the data set has that are not in the manifest: whoever reads it as one table reads
/// them too.
pub(super) fn others(manifest: &Manifest, out: &Path) -> usize {
    let own: BTreeSet<PathBuf> =
        manifest.entries.iter().map(|entry| folder(out, &entry.label)).collect();
    let folders = std::fs::read_dir(out).into_iter().flatten().flatten();
    let others = folders.filter(|entry| {
        entry.file_name().to_string_lossy().starts_with(FOLDER) && !own.contains(&entry.path())
    });
    others.count()
}

/// Writes `manifest-status.csv`.
pub(super) fn write(out: &Path, statuses: &[SessionStatus]) -> anyhow::Result<()> {
    let mut table = Table::create(out, "manifest-status", TableFormat::Csv, COLUMNS)?;
    for status in statuses {
        let summary = status.summary.as_ref();
        table.text(&status.label);
        table.text(status.outcome.word());
        table.text(&status.reason);
        table.text(summary.map_or("", |s| &s.configuration_hash));
        table.real(summary.map(|s| f64::from(s.epochs)), 0);
        table.real(summary.map(|s| f64::from(s.fixed)), 0);
        table.real(summary.map(|s| s.wall_s), 3);
        table.end_row()?;
    }
    table.finish()
}

/// How many sessions came to what.
#[derive(Debug)]
pub(super) struct Counts {
    done: usize,
    nothing_fixed: usize,
    failed: usize,
    missing: usize,
    /// Folders of sessions that are not in the manifest.
    others: usize,
    first: Option<(String, String)>,
}

impl Counts {
    pub(super) fn of(statuses: &[SessionStatus], others: usize) -> Self {
        let count = |outcome| statuses.iter().filter(|s| s.outcome == outcome).count();
        let first = statuses.iter().find(|s| s.outcome == Outcome::Failed);
        Self {
            done: count(Outcome::Done),
            nothing_fixed: count(Outcome::NothingFixed),
            failed: count(Outcome::Failed),
            missing: count(Outcome::Missing),
            others,
            first: first.map(|s| (s.label.clone(), s.reason.clone())),
        }
    }

    pub(super) fn json(&self) -> serde_json::Value {
        let Self { done, nothing_fixed, failed, missing, others, .. } = self;
        serde_json::json!({
            "done": done, "nothing_fixed": nothing_fixed, "failed": failed, "missing": missing,
            "others": others
        })
    }

    /// 0 all done; 1 none usable; 3 some failed, are missing or have nothing fixed.
    pub(super) fn exit_code(&self) -> ExitCode {
        let Self { done, nothing_fixed, failed, missing, .. } = *self;
        match (done + nothing_fixed, nothing_fixed + failed + missing) {
            (_, 0) => ExitCode::SUCCESS,
            (0, _) => ExitCode::from(1),
            _ => ExitCode::from(3),
        }
    }
}

impl fmt::Display for Counts {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { done, nothing_fixed, failed, missing, others, first } = self;
        let all = done + nothing_fixed + failed + missing;
        write!(
            f,
            "{done} of {all} sessions done, {nothing_fixed} with nothing fixed, {failed} failed"
        )?;
        if *missing > 0 {
            write!(f, ", {missing} missing")?;
        }
        if *others > 0 {
            let folders = if *others == 1 { "folder" } else { "folders" };
            write!(f, "\n{others} {folders} of sessions that are not in the manifest")?;
        }
        match first {
            Some((label, reason)) => write!(f, "\nfirst failure: {label}: {reason}"),
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_become_names_of_folders() {
        let name = folder(Path::new("out"), "2024/06 a=b%ü");
        assert_eq!(name, Path::new("out/session=2024%2F06%20a%3Db%25%C3%BC"));
        assert_eq!(folder(Path::new(""), ".."), Path::new("session=.."));
    }
}
