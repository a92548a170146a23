//! What the reading of navigation data found, whatever their format.

use std::collections::BTreeMap;

use kurs::signal::System;

use crate::damage::DamageLog;

/// What was found in a file.
#[derive(Debug, Clone, Default)]
pub struct ReadSummary {
    /// Ephemerides taken (SP3: nodes), per system.
    pub records: BTreeMap<System, usize>,
    /// Records read past on purpose, per system letter and message (`"G CNAV"`).
    pub read_past: BTreeMap<String, usize>,
    /// What could not be used.
    pub damage: DamageLog,
    /// Bytes of a log that belong to no whole message: reading its observations finds them too.
    pub framing: DamageLog,
}
