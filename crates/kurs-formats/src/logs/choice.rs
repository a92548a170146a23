//! Which of several sources of observations in one log is wanted: a station of RTCM 3, an antenna
//! of SBF.

use std::collections::BTreeSet;

/// The source that was chosen, else the only one.
#[derive(Debug)]
pub(super) struct Choice {
    wanted: Option<u16>,
    is_made: bool,
    found: BTreeSet<u16>,
}

impl Choice {
    /// `wanted`, or whichever comes first and must be the only one.
    pub(super) const fn new(wanted: Option<u16>) -> Self {
        Self { wanted, is_made: wanted.is_some(), found: BTreeSet::new() }
    }

    /// Whether observations of `source` are wanted; `None` if none was chosen of several.
    pub(super) fn takes(&mut self, source: u16) -> Option<bool> {
        self.found.insert(source);
        let is_wanted = *self.wanted.get_or_insert(source) == source;
        (is_wanted || self.is_made).then_some(is_wanted)
    }

    /// The source that is wanted, as soon as that is known.
    pub(super) const fn wanted(&self) -> Option<u16> {
        self.wanted
    }

    /// Whether only others than the wanted one have been found so far.
    pub(super) fn is_missing(&self) -> bool {
        !self.found.is_empty() && self.wanted.is_some_and(|wanted| !self.found.contains(&wanted))
    }

    /// All sources found so far.
    pub(super) fn found(&self) -> impl Iterator<Item = u16> {
        self.found.iter().copied()
    }
}
