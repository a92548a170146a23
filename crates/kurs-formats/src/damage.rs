//! What a reader could not use, and where: undamaged data on both sides is read all the same.

use std::borrow::Cow;

/// One thing in a file that was skipped, cut or contradicts itself.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Damage {
    /// Line of the (decompressed) file, counted from 1; in a receiver log, which has no lines, the
    /// offset of the byte where it begins.
    pub line: u64,
    /// What was wrong and what was done about it.
    pub what: Cow<'static, str>,
}

/// The damage of one file: the first entries in full, all of them counted.
#[derive(Debug, Clone, Default)]
pub struct DamageLog {
    listed: Vec<Damage>,
    total: u64,
}

impl DamageLog {
    /// Entries that are kept; noise given as a file must not fill the memory.
    pub const LISTED_MAX: usize = 1000;

    /// Notes that `what` happened at `line`.
    pub fn note(&mut self, line: u64, what: impl Into<Cow<'static, str>>) {
        self.note_with(line, || what.into());
    }

    /// As [`DamageLog::note`]; the text is only made if it is kept.
    pub fn note_with(&mut self, line: u64, what: impl FnOnce() -> Cow<'static, str>) {
        self.total += 1;
        if self.listed.len() < Self::LISTED_MAX {
            self.listed.push(Damage { line, what: what() });
        }
    }

    /// The first [`DamageLog::LISTED_MAX`] entries, in the order of reading.
    #[must_use]
    pub fn listed(&self) -> &[Damage] {
        &self.listed
    }

    /// How many there were altogether.
    #[must_use]
    pub const fn total(&self) -> u64 {
        self.total
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_list_is_capped_and_the_count_is_not() {
        let mut log = DamageLog::default();
        for line in 1..=1500 {
            log.note(line, "bad");
        }
        assert_eq!((log.listed().len(), log.total()), (1000, 1500));
        assert_eq!(log.listed()[999].line, 1000);
    }
}
