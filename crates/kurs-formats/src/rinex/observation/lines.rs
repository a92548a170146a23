//! The lines of an observation file, whether it is compact or not.

use super::compact::CompactLines;
use crate::damage::DamageLog;
use crate::source::{ReadError, Source};

/// A cursor over lines, as [`Source`] has it.
#[derive(Debug)]
pub(super) enum Lines {
    Plain(Source),
    Compact(Box<CompactLines>),
}

impl Lines {
    pub(super) fn advance(&mut self, damage: &mut DamageLog) -> Result<bool, ReadError> {
        match self {
            Self::Plain(source) => source.advance(),
            Self::Compact(lines) => lines.advance(damage),
        }
    }

    pub(super) fn line(&self) -> &[u8] {
        match self {
            Self::Plain(source) => source.line(),
            Self::Compact(lines) => lines.line(),
        }
    }

    /// Line of the file itself, also where it is compact.
    pub(super) fn line_number(&self) -> u64 {
        match self {
            Self::Plain(source) => source.line_number(),
            Self::Compact(lines) => lines.line_number(),
        }
    }

    pub(super) fn hold_line(&mut self) {
        match self {
            Self::Plain(source) => source.hold_line(),
            Self::Compact(lines) => lines.hold_line(),
        }
    }

    /// Whether epochs were dropped since this was asked last.
    pub(super) fn take_lost(&mut self) -> bool {
        match self {
            Self::Plain(_) => false,
            Self::Compact(lines) => lines.take_lost(),
        }
    }

    /// The file underneath.
    pub(super) const fn source(&self) -> &Source {
        match self {
            Self::Plain(source) => source,
            Self::Compact(lines) => lines.source(),
        }
    }

    pub(super) const fn source_mut(&mut self) -> &mut Source {
        match self {
            Self::Plain(source) => source,
            Self::Compact(lines) => lines.source_mut(),
        }
    }
}
