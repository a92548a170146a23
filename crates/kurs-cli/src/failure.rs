//! How a command ends: 0 done; 1 input could not be used; 2 wrong usage or configuration; 3 it ran,
//! but nothing was fixed, or less than is required; 130 it was interrupted.

use crate::interrupt::{INTERRUPTED, Interrupted};
use crate::pipe;
use crate::summary::Summary;

/// The exit status of a command, as a number that a caller inside the process can read too.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct ExitCode(u8);

impl ExitCode {
    /// Done.
    pub(crate) const SUCCESS: Self = Self(0);

    /// As the operating system gets it.
    pub(crate) const fn number(self) -> u8 {
        self.0
    }
}

impl From<u8> for ExitCode {
    fn from(number: u8) -> Self {
        Self(number)
    }
}

/// How much must be fixed for exit status 0.
#[derive(Debug, Clone, Copy, Default, clap::Args)]
pub(crate) struct RequiredFix {
    /// Exit status 3 if less than this share of the session's epochs is fixed; 0 turns it off
    /// (default: if nothing is fixed).
    #[arg(long = "require-fix", value_name = "PERCENT", value_parser = percent)]
    percent: Option<f64>,
}

/// Reads a percentage.
fn percent(text: &str) -> Result<f64, String> {
    let value: Option<f64> = text.trim_end_matches('%').trim().parse().ok();
    value.filter(|p| (0.0..=100.0).contains(p)).ok_or_else(|| "expected 0 to 100".to_owned())
}

impl RequiredFix {
    /// Nothing needs to be fixed.
    pub(crate) const fn none() -> Self {
        Self { percent: Some(0.0) }
    }

    /// The exit status of a run whose outputs are complete; says what is missing.
    pub(crate) fn exit_code(self, summary: &Summary) -> ExitCode {
        let found = 100.0 * summary.fixed_of_session().unwrap_or(0.0);
        match self.percent {
            None if summary.fixed() == 0 => eprintln!("nothing was fixed"),
            Some(required) if found < required => eprintln!(
                "{found:.2} % of the session is fixed, {required} % are required (--require-fix)"
            ),
            _ => return ExitCode::SUCCESS,
        }
        ExitCode::from(3)
    }
}

/// Wrong usage or configuration; the text names the key or option, what was found and what was
/// expected.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub(crate) struct UsageError(pub(crate) String);

/// The error with its causes; a cause that the text before already tells is not repeated.
pub(crate) fn told(error: &anyhow::Error) -> String {
    let text = error.chain().fold(String::new(), |text, cause| {
        let cause = cause.to_string();
        match (text.is_empty(), text.contains(&cause)) {
            (true, _) => cause,
            (false, true) => text,
            (false, false) => format!("{text}: {cause}"),
        }
    });
    pipe::told(&text)
}

/// Prints the error, if there is one, and gives the exit status that belongs to it.
pub(crate) fn exit_code(result: anyhow::Result<ExitCode>) -> ExitCode {
    match result {
        Ok(code) => code,
        Err(error) => {
            eprintln!("error: {}", told(&error));
            ExitCode::from(match () {
                () if error.is::<Interrupted>() => INTERRUPTED,
                () if error.is::<UsageError>() => 2,
                () => 1,
            })
        }
    }
}
