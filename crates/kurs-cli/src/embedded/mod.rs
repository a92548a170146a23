//! What programs call that have Kurs inside their process: the commands, with errors that come back
//! to the caller, and the engine of a configuration, to which observations come one by one.

mod column;
mod decoder;
mod engine;
mod station;

use std::ffi::OsString;

use crate::failure::{UsageError, told};
use crate::interrupt::Interrupted;
use crate::{Cli, interrupt};

pub use crate::interrupt::INTERRUPTED;
pub use column::Column;
pub use engine::{EmbeddedEngine, Rows};

/// Why a command ended without a result, in the words of the command line.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum Failure {
    /// Wrong usage or configuration: exit status 2.
    #[error("{0}")]
    Usage(String),
    /// Input that could not be used: exit status 1.
    #[error("{0}")]
    Input(String),
}

impl From<anyhow::Error> for Failure {
    fn from(error: anyhow::Error) -> Self {
        if error.is::<UsageError>() { Self::Usage(told(&error)) } else { Self::Input(told(&error)) }
    }
}

/// Runs the program with these arguments, of which the first is its name, and gives its exit
/// status, which is no failure: 0, 3, or [`INTERRUPTED`] after [`ask_to_end`]. Signals are left to the caller.
///
/// # Errors
///
/// [`Failure`] in place of the exit statuses 1 and 2.
pub fn call(
    arguments: impl IntoIterator<Item = impl Into<OsString> + Clone>,
) -> Result<u8, Failure> {
    let cli = Cli::read(arguments).map_err(|error| {
        let text = error.render().to_string();
        Failure::Usage(text.trim_start_matches("error: ").trim_end().to_owned())
    })?;
    match cli.command.run() {
        Err(error) if error.is::<Interrupted>() => Ok(INTERRUPTED),
        done => Ok(done?.number()),
    }
}

/// Asks every command that runs over epochs for its end, with a valid result of what there is;
/// `false` takes it back.
pub fn ask_to_end(is_wanted: bool) {
    interrupt::ask_to_end(is_wanted);
}
