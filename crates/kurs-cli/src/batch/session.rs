//! One session: solved unless it is done, whatever happens to the others.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};

use super::manifest::Entry;
use super::status::{self, FAILURE, SessionStatus};
use crate::failure::told;
use crate::output;
use crate::solve::session_args::SessionArgs;
use crate::solve::{self, Format};
use crate::summary::configuration_hash;

/// A session of the manifest and where its result goes.
#[derive(Debug)]
pub(super) struct SessionPlan {
    label: String,
    session: SessionArgs,
    folder: PathBuf,
    formats: Vec<Format>,
}

impl SessionPlan {
    pub(super) fn new(entry: &Entry, out: &Path, set: &[String], formats: &[Format]) -> Self {
        let set = entry.set.iter().chain(set).cloned().collect();
        Self {
            label: entry.label.clone(),
            session: SessionArgs::of_manifest(
                entry.files.clone(),
                entry.nav.clone(),
                entry.observations.clone(),
                set,
            ),
            folder: status::folder(out, &entry.label),
            formats: formats.to_vec(),
        }
    }

    /// Solves the session unless that was done; an error of it is its status.
    pub(super) fn run(&self) -> SessionStatus {
        let attempt = catch_unwind(AssertUnwindSafe(|| self.solve()));
        let reason = match attempt {
            Ok(Ok(())) => None,
            Ok(Err(error)) => Some(told(&error)),
            Err(_) => Some("stopped by an error of the program".to_owned()),
        };
        let found = SessionStatus::of_result(&self.label, &self.folder);
        match (reason, found) {
            // A result whose rows are all lost is a result.
            (_, Some(found)) => found,
            (None, None) => SessionStatus::failed(&self.label, "interrupted".to_owned()),
            (Some(reason), None) => {
                let failure = serde_json::json!({ "reason": reason });
                // Where it cannot be written the closing line still counts it.
                let _ = output::write_json(&self.folder, FAILURE, &failure);
                SessionStatus::failed(&self.label, reason)
            }
        }
    }

    fn solve(&self) -> anyhow::Result<()> {
        let hash = match self.session.load().map(|session| session.identity(&[])) {
            Ok(identity) => configuration_hash(&identity),
            Err(error) => {
                // An older result is not one of these inputs.
                solve::remove_result(&self.folder)?;
                return Err(error);
            }
        };
        if !self.is_done(&hash) {
            solve::run(&solve::Args::of_batch(
                self.session.clone(),
                self.folder.clone(),
                self.formats.clone(),
            ))?;
        }
        Ok(())
    }

    /// Whether a whole result of these inputs is there.
    fn is_done(&self, hash: &str) -> bool {
        let has_rows = self.formats.iter().all(|format| self.folder.join(format.rows()).exists());
        let found = status::Summary::read(&self.folder);
        has_rows && found.is_some_and(|s| s.configuration_hash == hash && !s.interrupted)
    }
}
