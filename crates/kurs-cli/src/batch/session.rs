//! One session: solved unless it is done, whatever happens to the others.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};

use super::manifest::Entry;
use super::status::{self, FAILURE, SessionStatus};
use crate::failure::told;
use crate::interrupt::Interrupted;
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
        let mut hash = None;
        let attempt = catch_unwind(AssertUnwindSafe(|| self.solve(&mut hash)));
        let reason = match attempt {
            Ok(Ok(())) => None,
            // No failure of this session: the next run solves it.
            Ok(Err(error)) if error.is::<Interrupted>() => None,
            Ok(Err(error)) => Some(told(&error)),
            Err(_) => Some("stopped by an error of the program".to_owned()),
        };
        let found = SessionStatus::of_result(&self.label, &self.folder);
        match (reason, found) {
            (None, Some(found)) => found,
            // Rows that are all lost are a result too; an older one, which could not be taken away,
            // is none.
            (Some(_), Some(found)) if hash.is_some_and(|hash| self.is_done(&hash)) => found,
            (None, None) => SessionStatus::failed(&self.label, "interrupted".to_owned()),
            (Some(reason), _) => {
                let failure = serde_json::json!({ "reason": reason });
                // Where it cannot be written the closing line still counts it.
                let _ = output::write_json(&self.folder, FAILURE, &failure);
                SessionStatus::failed(&self.label, reason)
            }
        }
    }

    /// Solves the session; `hash` becomes that of what it is made from, once this is known.
    fn solve(&self, hash: &mut Option<String>) -> anyhow::Result<()> {
        let identity = match self.session.load() {
            Ok(session) => session.identity(&self.formats, &[]),
            Err(error) => {
                // An older result is not one of these inputs.
                solve::remove_result(&self.folder)?;
                return Err(error);
            }
        };
        let hash = hash.insert(configuration_hash(&identity));
        if !self.is_done(hash) {
            solve::run(&solve::Args::of_batch(
                self.session.clone(),
                self.folder.clone(),
                self.formats.clone(),
            ))?;
        }
        Ok(())
    }

    /// Whether a whole result of these inputs is there, and no later attempt failed.
    fn is_done(&self, hash: &str) -> bool {
        let has_rows = self.formats.iter().all(|format| self.folder.join(format.rows()).exists());
        let has_failed = self.folder.join(FAILURE).exists();
        let found = status::Summary::read(&self.folder);
        has_rows
            && !has_failed
            && found.is_some_and(|s| s.configuration_hash == hash && !s.interrupted)
    }
}
